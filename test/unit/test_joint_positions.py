"""The positions of movable joints: limits, the centre, and joints that follow others."""

from math import inf, nan, pi

import pytest

from puretf_tools.robot.description import parse
from puretf_tools.robot.joint_positions import bounds, JointPositions


def robot(*joints):
    """Return a robot with a chain of joints: name, type, limits, and what it mimics."""
    text = '<link name="0"/>'
    for i, (name, kind, limits, *mimic) in enumerate(joints):
        text += (f'<link name="{i + 1}"/><joint name="{name}" type="{kind}"><parent link="{i}"/>'
                 f'<child link="{i + 1}"/><axis xyz="0 0 1"/>')
        if limits:
            text += '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'.format(*limits)
        for joint, multiplier, offset in mimic:
            text += f'<mimic joint="{joint}" multiplier="{multiplier}" offset="{offset}"/>'
        text += '</joint>'
    return parse(f'<robot name="robot">{text}</robot>')


def test_a_joint_starts_at_0_or_in_the_middle_of_its_limits():
    """As with joint_state_publisher_gui; fixed joints have no position."""
    positions = JointPositions(robot(
        ('a', 'revolute', (-1, 2)), ('b', 'prismatic', (0.2, 0.6)), ('c', 'continuous', None),
        ('d', 'fixed', None), ('e', 'revolute', (3, 1)), ('f', 'revolute', (-1, 1.5e308))))
    assert positions.all() == {'a': 0.0, 'b': pytest.approx(0.4), 'c': 0.0, 'e': 2.0, 'f': 0.0}
    positions.set('b', 0.6)
    positions.centre()
    assert positions['b'] == pytest.approx(0.4)
    assert [bounds(joint) for joint in positions.free.values()] == [
        (-1, 2), (0.2, 0.6), (-pi, pi), (1, 3), (-1, 1e9)]


@pytest.mark.parametrize(('name', 'position', 'expected'), [
    ('a', 1.5, 1.5), ('a', 2.5, 2.0), ('a', -9.0, -1.0), ('a', nan, 0.0), ('a', inf, 0.0),
    ('c', 3.0, 3.0), ('c', 1.5 * pi, -0.5 * pi), ('x', 1.0, None)])
def test_a_position_is_clamped_to_the_limits(name, position, expected):
    """What is not finite has no effect; whole turns of a continuous joint do not count."""
    positions = JointPositions(robot(('a', 'revolute', (-1, 2)), ('c', 'continuous', None)))
    positions.set(name, position)
    assert positions.all().get(name) == (
        expected if expected is None else pytest.approx(expected, abs=1e-12))


def test_joints_that_follow_others():
    """Not a fixed or unknown joint, or themselves; joints in a loop are free."""
    positions = JointPositions(robot(
        ('a', 'revolute', (-1, 1)), ('b', 'revolute', (-9, 9), ('a', 2, 0.5)),
        ('c', 'prismatic', (0, 1), ('b', -3, 1)), ('d', 'fixed', None),
        ('e', 'continuous', None, ('d', 1, 1)), ('f', 'continuous', None, ('gone', 1, 1)),
        ('g', 'continuous', None, ('g', 2, 1)), ('h', 'continuous', None, ('i', 1, 1)),
        ('i', 'continuous', None, ('h', 1, 1)), ('j', 'continuous', None, ('h', 1, 1)),
        ('k', 'continuous', None, ('f', 2, 0))))
    assert [*positions.free] == ['a', 'e', 'f', 'g', 'h', 'i']
    for name, position in ('a', 0.25), ('b', 7.0), ('f', 0.5), ('h', 2.0):
        positions.set(name, position)
    found = positions.all()
    assert [*found] == [*'abcefghijk']
    assert [found[name] for name in 'abcjk'] == [0.25, 1.0, -2.0, 3.0, 1.0]


def test_a_new_description_keeps_the_joints_where_they_are():
    """As far as it has them, and its limits allow."""
    positions = JointPositions(robot(('a', 'revolute', (-1, 1))), {'a': 0.5, 'gone': 2.0})
    assert positions.all() == {'a': 0.5}
    changed = JointPositions(robot(('a', 'revolute', (1, 2)), ('b', 'continuous', None)),
                             positions.all())
    assert changed.all() == {'a': 1.0, 'b': 0.0}


def test_a_long_chain_of_joints_that_follow_each_other():
    """Each rule is found once; joints whose factor would be huge are free."""
    positions = JointPositions(robot(('j0', 'continuous', None), *(
        (f'j{i}', 'continuous', None, (f'j{i - 1}', 2 if i < 40 else 1, 0.0))
        for i in range(1, 20_000))))
    for name in 'j0', 'j30':
        positions.set(name, 1.0)
    assert [*positions.free] == ['j0', 'j30']
    found = positions.all()
    assert (found['j29'], found['j19999']) == (2.0**29, 2.0**9)
