"""The command `tf_doctor` finds nothing where nothing is wrong, in systems of any size."""

import json

from processes import ARM, BUSY, tool
import pytest
from rclpy.duration import Duration
from ros_node import stamped
from sensor_msgs.msg import LaserScan

from puretf import StaticTransformBroadcaster, TransformBroadcaster

FRAMES = """
import rclpy
from puretf import TransformBroadcaster
rclpy.init()
node = rclpy.create_node('many')
frames = TransformBroadcaster(node).prepare([('map', f'frame_{i}') for i in range(500)])
poses = [(0.0,) * 6 + (1.0,)] * 500
node.create_timer(0.01, lambda: frames.send(node.get_clock().now(), poses))
rclpy.spin(node)
"""


def lab(start, ros):
    """Start the publishers of the lab, and the arm."""
    for program in ARM, tool('dynamic_tf_publisher'), tool(
            'static_transform_publisher', '--frame-id', 'base_link', '--child-frame-id', 'camera'):
        start(*program)


def frames(start, ros):
    """Publish 500 frames at 100 Hz."""
    start('-c', FRAMES)


def scans(start, ros):
    """Publish a robot, and scans at 40 Hz that are late by 30 ms."""
    sender = TransformBroadcaster(ros.node)
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform([stamped('map', 'odom'), stamped('base_link', 'laser')])
    publisher = ros.node.create_publisher(LaserScan, '/scan', 10)

    def scan():
        message = LaserScan()
        message.header.frame_id = 'laser'
        message.header.stamp = (
            ros.node.get_clock().now() - Duration(nanoseconds=30_000_000)).to_msg()
        publisher.publish(message)

    ros.node.create_timer(0.02, lambda: sender.sendTransform(
        stamped('odom', 'base_link', ros.node.get_clock().now().nanoseconds)))
    ros.node.create_timer(0.025, scan)


@pytest.mark.parametrize('is_busy', [False, True], ids=['idle', 'busy'])
@pytest.mark.parametrize('begin', [lab, frames, scans])
def test_healthy(start, ros, begin, is_busy):
    """Gaps and late transforms may be real, on a busy machine."""
    begin(start, ros)
    for _ in range(2 * is_busy):
        start('-c', BUSY)
    ros.until(lambda: ros.node.count_publishers('/tf'))
    # It listens from the first transform on; a publisher may be discovered 3 s late.
    process = start(*tool(
        'tf_doctor', '--json', '--time', '6', '--ignore', 'gap', '--ignore', 'late', '--ignore',
        'listener_busy'))
    ros.until(process.has_ended)
    assert process.exit_code() == 0
    data = json.loads(process.output[process.output.index('{'):])  # after log messages
    assert (data['findings'], data['not_checked']) == ([], [])
    assert [topic['topic'] for topic in data['topics']] == ['/scan'] * (begin is scans)
