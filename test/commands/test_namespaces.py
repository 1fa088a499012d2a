"""Tests of `--namespace`: several robots on one network, each with its own topics."""

import re

from cli_runner import call, once
from processes import ARM
import pytest
from ros_node import stamped

from dummy_arm import dummy_arm, dynamic_tf_publisher
from puretf import StaticTransformBroadcaster, TransformBroadcaster
from puretf_tools.cli.node import run_node
from puretf_tools.cli.parser import UsageError
from puretf_tools.commands import (
    static_transform_publisher,
    tf2_echo,
    tf2_monitor,
    view_frames,
)

HINT = ('No transform has arrived on /tf, but transforms are published on /robot1/tf. To listen '
        'to /robot1/tf, ')


def test_two_arms_are_watched_side_by_side(start, domain_id):
    """Each command sees the arm of its namespace, and nothing of the other."""
    for name in 'left', 'right':
        start(*ARM, '--namespace', f'/{name}/', '--ros-args', '-p', f'frame_prefix:={name}_')
    for main, arguments, expected, other in (
            (tf2_monitor.main, ('--namespace', 'left'),
             '  left_end_effector .* /left/dummy_arm\n', 'right_'),
            (tf2_echo.main, ('map', 'right_joint_1', '--namespace', 'right'),
             r'- Translation: \[0.000, 0.000, 0.300\]', 'left_'),
            (view_frames.main, ('--watch', '--namespace', 'right'),
             '└── right_end_effector', 'left_')):
        code, output, _ = call(main, *arguments, domain=domain_id,
                               until=re.compile(expected).search)
        assert code == 0
        assert other not in output


@pytest.mark.parametrize(('main', 'arguments', 'topic'), [
    (dynamic_tf_publisher.main, (), '/robot/tf'),
    (static_transform_publisher.main, ('--frame-id', 'a', '--child-frame-id', 'b'),
     '/robot/tf_static')])
def test_publishers_in_a_namespace(ros, main, arguments, topic):
    """The node and its topic are in the namespace."""
    assert call(main, *arguments, '--namespace', 'robot', domain=ros.domain, until=once(
        lambda: '/robot' in [info.node_namespace for info in
                             ros.node.get_publishers_info_by_topic(topic)])).code == 0


@pytest.mark.parametrize(('main', 'arguments', 'text'), [
    (tf2_echo.main, ('map', 'robot'), "'camera'.*[.] " + HINT),
    (tf2_monitor.main, (), f'Warning: {HINT}'),
    (view_frames.main, ('--watch',), f'Warning: {HINT}')])
def test_every_command_names_other_topics(ros, monkeypatch, main, arguments, text):
    """It does so as long as nothing arrives on /tf, before and after a static transform."""
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.0)
    for _ in range(2):
        TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    broadcaster = StaticTransformBroadcaster(ros.node)
    begun: list[int] = []

    def until(written):
        if HINT in written and not begun:
            begun.append(len(written))
            broadcaster.sendTransform(stamped('map', 'camera'))
        return begun and re.search(text, written)

    assert call(main, *arguments, domain=ros.domain, until=until).code == 0


def test_a_remapping_wins_over_the_namespace(domain_id):
    """The rule that the user has written is used first."""
    text = 'publishing map -> base_link on /a/tf_static, base_link -> .* on /tf_old, '
    assert call(dummy_arm.main, '--namespace', 'a', '--ros-args', '-r', '/tf:=/tf_old',
                domain=domain_id, until=lambda found: re.search(text, found)).code == 0


@pytest.mark.parametrize('name', ['robot-1', '1robot', 'a b', 'ä'])
def test_an_invalid_namespace(name):
    """It is refused before ROS is initialised."""
    with pytest.raises(UsageError, match='Invalid namespace: '):
        run_node(lambda: pytest.fail('no node must be created'), ['name'], name)
