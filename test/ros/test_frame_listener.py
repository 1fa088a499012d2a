"""The listener of the commands: what it says if nothing arrives on /tf."""

from rclpy.node import Node
from ros_node import stamped

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
