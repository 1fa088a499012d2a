"""Tests of `--namespace`: several robots on one network, each with its own topics."""

import re
import signal

from conftest import ARM, tool
import pytest
from rclpy.node import Node

from dummy_arm.cli.node import run_node
from dummy_arm.cli.parser import UsageError
from dummy_arm.inspection.frame_listener import FrameListener
from dummy_arm.tf import StaticTransformBroadcaster, TransformBroadcaster
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._ros.transform_stamped import message_of

STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
HINT = 'No transform has arrived on /tf, but /robot1/tf has 2 publishers: --namespace robot1'


def transform(stamp, child):
    """Return a TransformStamped from map to a child; the stamp is in ns."""
    return message_of(Row(stamp, 'map', child, STILL))


def test_two_arms_are_watched_side_by_side(start, ros):
    """Each command sees the arm of its namespace, and nothing of the other."""
    for name in 'left', 'right':
        start(*ARM, '--namespace', f'/{name}/', '--ros-args', '-p', f'frame_prefix:={name}_')
    monitor = start(*tool('tf2_monitor', '--namespace', 'left'))
    echo = start(*tool('tf2_echo', 'map', 'right_joint_1', '5', '--namespace', 'right'))
    ros.until(lambda: re.search('  left_end_effector .* /left/dummy_arm\n', monitor.output)
              and echo.output.count('- Translation: [0.000, 0.000, 0.300]') > 1)
    assert 'right_' not in monitor.output
    assert 'left_' not in echo.output
    for process in monitor, echo:
        process.end(signal.SIGINT)
        assert process.exit_code() == 0
    tree = start(*tool('view_frames', '--watch', '--namespace', 'right'))
    ros.until(lambda: '└── right_end_effector' in tree.output)
    assert 'left_' not in tree.output


@pytest.mark.parametrize(('command', 'topic'), [
    (('dynamic_tf_publisher',), '/robot/tf'),
    (('static_transform_publisher', '--frame-id', 'a', '--child-frame-id', 'b'),
     '/robot/tf_static')])
def test_publishers_in_a_namespace(start, ros, command, topic):
    """The node and its topic are in the namespace."""
    start(*tool(*command, '--namespace', 'robot'))
    ros.until(lambda: ros.node.get_publishers_info_by_topic(topic))
    ros.until(lambda: [info.node_namespace for info in ros.node.get_publishers_info_by_topic(topic)
                       ] == ['/robot'])


def test_every_command_names_other_topics(start, ros):
    """If nothing arrives on /tf, the text of a command names the topics with publishers."""
    for _ in range(2):
        TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    tree = start(*tool('view_frames', '--watch'))
    echo = start(*tool('tf2_echo', 'map', 'robot'))
    monitor = start(*tool('tf2_monitor'))
    for process in tree, echo, monitor:
        ros.until(lambda process=process: HINT in process.output)

    # Static transforms are received, but still nothing on /tf.
    StaticTransformBroadcaster(ros.node).sendTransform(transform(0, 'camera'))
    before = len(echo.output)
    ros.until(lambda: re.search(f"'camera'.*[.] {HINT}", echo.output[before:])
              and all(f'Warning: {HINT}' in process.output for process in (tree, monitor)))
    tree = start(*tool('view_frames', '-t', '4', '--text'))
    ros.until(tree.has_ended)
    assert tree.exit_code() == 0
    assert f'view_frames: warning: {HINT}.\n' in tree.output
    assert '└── camera' in tree.output


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
    listener.buffer.set_transform_static(transform(0, 'camera'), 'test')
    assert listener.other_topics_hint() == ''  # a robot may have static transforms only
    node.destroy_node()


def test_no_remedy_is_needed(ros):
    """Once a dynamic transform has been received, nothing is said about other topics."""
    listener = FrameListener(ros.node)
    TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    ros.until(listener.other_topics_hint)
    listener.buffer.set_transform_static(transform(0, 'camera'), 'test')
    assert listener.why_no_transform('map', 'camara').endswith(
        'No transform has arrived on /tf, but /robot1/tf has 1 publisher: --namespace robot1.')
    listener.buffer.set_transform(transform(1, 'robot'), 'test')
    assert listener.other_topics_hint() == ''


def test_a_remapping_wins_over_the_namespace(start, ros):
    """The rule that the user has written is used first."""
    start(*ARM, '--namespace', 'a', '--ros-args', '-r', '/tf:=/tf_old', '-p', 'rate:=10.0')
    ros.until(lambda: ros.node.count_publishers('/tf_old'))
    ros.until(lambda: ros.node.count_publishers('/a/tf_static'))
    assert not ros.node.count_publishers('/a/tf')


@pytest.mark.parametrize('name', ['robot-1', '1robot', 'a b', 'ä', 'a__b'])
def test_an_invalid_namespace(name):
    """It is refused before ROS is initialised."""
    with pytest.raises(UsageError, match='Invalid namespace: '):
        run_node(lambda: pytest.fail('no node must be created'), ['name'], name)
