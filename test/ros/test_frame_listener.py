"""The listener of the commands: what it says if nothing arrives on /tf."""

from geometry_msgs.msg import TransformStamped
import pytest
from rclpy.node import Node
from ros_node import Ros, stamped

from dummy_arm.inspection import frame_listener
from dummy_arm.inspection.frame_listener import FrameListener
from dummy_arm.tf import StaticTransformBroadcaster, TransformBroadcaster


def test_the_remedies(ros):
    """A remedy is the namespace of the topic, no namespace, or a remapping."""
    node = Node('listener', context=ros.context, namespace='/a',
                cli_args=['--ros-args', '-r', '/tf:=/a/tf', '-r', '/tf_static:=/a/tf_static'])
    listener = FrameListener(node)
    assert listener.topics == ['/a/tf_static', '/a/tf']
    assert listener.other_topics_hint() == ''
    for topic in '/tf', '/b/c/tf', '/tf_old':
        TransformBroadcaster(ros.node, tf_topic=topic)
    for topic in '/b/c/tf_static', '/d/tf_static':
        StaticTransformBroadcaster(ros.node, tf_static_topic=topic)
    hint = ('No transform has arrived on /a/tf, but /b/c/tf has 1 publisher: --namespace b/c; '
            '/d/tf_static has 1 publisher: --namespace d; /tf has 1 publisher: omit --namespace; '
            '/tf_old has 1 publisher: --ros-args -r /tf:=/tf_old -r /tf_static:=/tf_old_static.')
    ros.until(lambda: listener.other_topics_hint() == hint)
    assert listener.why_no_frames() == hint
    publisher = TransformBroadcaster(ros.node, tf_topic='/a/tf').pub_tf
    ros.until(lambda: listener.other_topics_hint() == '')
    assert 'Publishers on /a/tf and /a/tf_static here: 1. Check' in listener.why_no_frames()
    ros.node.destroy_publisher(publisher)
    ros.until(lambda: listener.other_topics_hint() == hint)
    listener.buffer.set_transform_static(stamped('map', 'camera'), 'test')
    assert listener.other_topics_hint() == ''  # a robot may have static transforms only
    node.destroy_node()


def test_no_remedy_is_needed(ros):
    """Once a dynamic transform has been received, nothing is said about other topics."""
    listener = FrameListener(ros.node)
    TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    ros.until(listener.other_topics_hint)
    listener.buffer.set_transform_static(stamped('map', 'camera'), 'test')
    assert listener.why_no_transform('map', 'camara').endswith(
        'No transform has arrived on /tf, but /robot1/tf has 1 publisher: --namespace robot1.')
    listener.buffer.set_transform(stamped('map', 'robot', 1), 'test')
    assert listener.other_topics_hint() == ''


@pytest.fixture
def student(ros):
    """Another participant: within one, a topic cannot have two types."""
    other = Ros(ros.context.get_domain_id())
    yield other.node
    other.close()


def test_another_type(ros, student, monkeypatch):
    """
    Publishers of another type are named once each, and do not count as those of transforms.

    Other topics are named after 6 s, since /tf may not have been discovered earlier.
    """
    monkeypatch.setattr(frame_listener, 'monotonic', iter([0.0, 5.9, 6.0]).__next__)
    listener = FrameListener(ros.node)
    for topic in '/tf_static', '/tf', '/tf':
        student.create_publisher(TransformStamped, topic, 10)
    text = ('/test publishes geometry_msgs/msg/TransformStamped on /tf_static, /test publishes '
            'geometry_msgs/msg/TransformStamped on /tf. The type must be tf2_msgs/msg/TFMessage: '
            'send transforms with a TransformBroadcaster or a StaticTransformBroadcaster.')
    ros.until(lambda: listener.topics_hint() == text)
    assert listener.why_no_frames() == text
    TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    other = 'No transform has arrived on /tf, but /robot1/tf has 1 publisher: --namespace robot1.'
    ros.until(lambda: listener.topics_hint() == f'{text} {other}')
    for expected in text, f'{text} {other}':
        assert listener.why_no_transform('map', 'camera').endswith(expected)


def test_another_type_beside_transforms(ros, student):
    """The cause of a missing frame is named where other frames exist."""
    listener = FrameListener(ros.node)
    student.create_publisher(TransformStamped, '/tf', 10)
    listener.buffer.set_transform(stamped('map', 'robot', 1), 'test')
    ros.until(listener.wrong_type_hint)
    assert 'on /tf. The type must be' in listener.why_no_transform('map', 'camera')
    assert not listener.why_no_transform('map', 'robot')
