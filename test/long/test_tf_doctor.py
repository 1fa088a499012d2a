"""The command `tf_doctor` finds nothing where nothing is wrong, in systems of any size."""

import json

from processes import ARM, tool
import pytest
from ros_node import stamped

from dummy_arm.tf import TransformBroadcaster

FRAMES = """
import rclpy
from dummy_arm.tf import TransformBroadcaster
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


def wheels(start, ros):
    """Publish four wheels."""
    sender = TransformBroadcaster(ros.node)
    ros.node.create_timer(0.02, lambda: sender.sendTransform([stamped(
        'base_link', f'{name}_wheel', ros.node.get_clock().now().nanoseconds)
        for name in ('fl', 'fr', 'rl', 'rr')]))


@pytest.mark.parametrize('begin', [lab, frames, wheels])
def test_healthy(start, ros, begin):
    """Gaps and late transforms may be real, on a busy machine."""
    begin(start, ros)
    ros.until(lambda: ros.node.count_publishers('/tf'))
    # It listens from the first transform on; a publisher may be discovered 3 s late.
    process = start(*tool(
        'tf_doctor', '--json', '--time', '6', '--ignore', 'gap', '--ignore', 'late'))
    ros.until(process.has_ended)
    assert process.exit_code() == 0
    data = json.loads(process.output[process.output.index('{'):])  # after log messages
    assert (data['findings'], data['not_checked']) == ([], [])
