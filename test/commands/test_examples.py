"""Tests of the examples in docs/examples."""

import re
import signal
import time

from environment import ROOT
import pytest
from ros_node import LATCHED, stamped
from std_msgs.msg import String

from puretf import StaticTransformBroadcaster, TransformBroadcaster

EXAMPLES = ROOT / 'docs' / 'examples'


def test_listen_receives_the_arm(start, arm_domain):
    """The example prints the transforms of the arm, as `make listen` beside `make demo`."""
    listener = start(str(EXAMPLES / 'listen.py'), domain=arm_domain)
    listener.line_with('map -> base_link')
    listener.line_with('joint_3 -> end_effector xyz  0.200  0.000  0.000')
    listener.end_normally()


#: The example, with a line of output when the bag has 51 messages, and another limit of messages.
RECORDER = f"""
import threading, time
from puretf import publisher_listener
publisher_listener._MOST_MESSAGES = LIMIT
names = {{}}
def tell():
    while 'bag' not in names or sum(list(names['bag'].counts.values())) < 51:
        time.sleep(0.01)
    print('has recorded', flush=True)
threading.Thread(target=tell, daemon=True).start()
path = {str(EXAMPLES / 'record.py')!r}
exec(compile(open(path).read(), path, 'exec'), names)
"""


def test_record_reports_dropped_messages(start, ros, tmp_path):
    """Messages are dropped if more arrive between two calls of `received` than are kept."""
    pytest.importorskip('rosbags.rosbag2')
    recorder = start('-c', RECORDER.replace('LIMIT', '2'), str(tmp_path / 'bag'))
    broadcaster = TransformBroadcaster(ros.node)

    def is_reported():
        for _ in range(100):
            broadcaster.sendTransform(stamped('map', 'robot', time.time_ns()))
        return 'messages arrived too fast' in recorder.output

    ros.until(is_reported)
    recorder.end_normally()
    assert re.search(r'\[ERROR\].* [1-9]\d* messages arrived too fast and are not in the bag\n',
                     recorder.output)


def test_record_writes_a_bag(start, ros, tmp_path):
    """The bag has all messages with the times of their arrival, and the QoS of both topics."""
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    from rosbags.interfaces import QosDurability
    from rosbags.typesys import get_typestore, Stores

    recorder = start('-c', RECORDER.replace('LIMIT', '1000').replace('51', '52'),
                     str(tmp_path / 'bag'))
    description = ros.node.create_publisher(String, '/robot_description', LATCHED)
    description.publish(String(data='<robot/>'))
    dynamic = TransformBroadcaster(ros.node)
    ros.until(lambda: dynamic.pub_tf.get_subscription_count() == 1)
    StaticTransformBroadcaster(ros.node).sendTransform(stamped('map', 'odom'))
    stamps = []
    for _ in range(50):
        stamps.append(time.time_ns())
        dynamic.sendTransform(stamped('odom', 'robot', stamps[-1]))
    recorder.line_with('has recorded')
    recorder.end_normally(signal.SIGTERM)
    assert recorder.output.endswith(': 52 messages\n')
    types = get_typestore(Stores.ROS2_JAZZY)
    found: dict[str, list[tuple[str, int, int]]] = {'/tf': [], '/tf_static': []}
    with rosbag2.Reader(tmp_path / 'bag') as bag:
        assert {connection.topic: connection.ext.offered_qos_profiles[0].durability
                for connection in bag.connections} == {
            '/tf': QosDurability.VOLATILE, '/tf_static': QosDurability.TRANSIENT_LOCAL,
            '/robot_description': QosDurability.TRANSIENT_LOCAL,
            '/joint_states': QosDurability.VOLATILE}
        for connection, arrival, data in bag.messages():
            message = types.deserialize_cdr(data, connection.msgtype)
            if connection.topic == '/robot_description':
                assert message.data == '<robot/>'
                continue
            (transform,) = message.transforms
            stamp = transform.header.stamp
            found[connection.topic].append(
                (transform.child_frame_id, stamp.sec * 10**9 + stamp.nanosec, arrival))
    assert [child for child, *_ in found['/tf_static']] == ['odom']
    assert [(child, stamp) for child, stamp, _ in found['/tf']] == [
        ('robot', stamp) for stamp in stamps]
    assert all(stamp <= arrival <= time.time_ns() for _, stamp, arrival in found['/tf'])
