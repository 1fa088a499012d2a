"""The rules of robot_state_publisher, against what the real 3.3.3 has answered."""

import re
from typing import Any
from xml.etree import ElementTree

import pytest
from recorded_robots import (
    ACCEPTED,
    answer,
    assert_equal,
    CASES,
    fixed,
    OF_THE_COMMAND,
    REFUSED,
    ZERO_AXES,
)

from puretf_tools.robot import DescriptionError, parse, robot_transforms
from puretf_tools.robot.robot_transforms import RobotTransforms

#: The time of the recording (ns): between the stamps of 1.7e9 s, and those in the future, 2e9 s.
NOW = 1_790_000_000_000_000_000
OF_THE_ROBOT = [name for name in CASES if name not in OF_THE_COMMAND]


def description_of(case):
    """Return the robot of a case; `odd_origins` without the joints that ours refuses."""
    if case['name'] != 'odd_origins':
        return parse(case['urdf'])
    robot = ElementTree.fromstring(case['urdf'])
    for joint in robot.findall('joint'):
        axis = joint.find('axis')
        if axis is not None and joint.get('name') in ZERO_AXES:
            axis.set('xyz', '0 0 1')
    return parse(ElementTree.tostring(robot, encoding='unicode'))


def without_zero_axes(case, transforms):
    """Leave out the joints of `odd_origins` for which the real one sends NaN."""
    return [transform for transform in transforms
            if case['name'] != 'odd_origins' or transform[1] not in ('m8', 'm9', 'm10', 'm11')]


def publisher(description, **attributes):
    """Return the rules for a robot, and the list of their warnings."""
    warnings: list[str] = []
    transforms = RobotTransforms(description, warnings.append)
    for name, value in attributes.items():
        setattr(transforms, name, value)
    return transforms, warnings


def apply(transforms, change, now):
    """Apply a change between two messages; return the time of the node (ns)."""
    if 'clock' in change:
        sec, nanosec = change['clock']
        return sec * 10**9 + nanosec
    (name, value), = change['set_parameters'].items()
    is_accepted = change['result'][0]
    if name == 'robot_description' and isinstance(value, str):
        if is_accepted:
            transforms.set_description(parse(value))
        else:
            with pytest.raises(DescriptionError):
                parse(value)
    elif is_accepted:
        setattr(transforms, name, value)
    return now


@pytest.mark.parametrize('name', OF_THE_ROBOT)
def test_a_description_is_accepted_as_by_the_real_one(name):
    """The exceptions are listed with their reasons."""
    case = CASES[name]
    dies_at_start = case.get('died_at') == -1
    if name in REFUSED or (dies_at_start and name not in ACCEPTED):
        with pytest.raises(DescriptionError) as caught:
            parse(case['urdf'])
        assert re.fullmatch('.+', str(caught.value))
    else:
        assert parse(case['urdf']).text == case['urdf']


@pytest.mark.parametrize('name', [name for name in OF_THE_ROBOT if CASES[name]['tf_static']])
def test_answers_are_those_of_the_real_one(name):
    """Which messages are answered, and frames, order, poses and warnings are the same."""
    case = CASES[name]
    if name in REFUSED and name != 'odd_origins':
        return
    parameters = case['parameters'].copy()
    now = 0 if parameters.pop('use_sim_time', False) else NOW
    transforms, warnings = publisher(description_of(case), **parameters)
    assert_equal(transforms.fixed(), fixed(case, -1))
    answered = {message['step']: message for message in case['tf']}
    static = {message['step'] for message in case['tf_static']}
    for step, states in enumerate(case['joint_states']):
        if step == case.get('died_at'):
            break
        for change in states.get('before', ()):
            now = apply(transforms, change, now)
        if step in static:
            assert_equal(transforms.fixed(), fixed(case, step))
        sec, nanosec = states['stamp']
        edges = transforms.moving(
            sec * 10**9 + nanosec, states['name'], [*map(float, states['position'])], now)
        assert (edges is not None) == (step in answered), step
        if edges is not None:
            assert_equal(without_zero_axes(case, edges),
                         without_zero_axes(case, answer(case, step)))
    texts = [line['text'] for line in case['log'] if line['name'] == 'robot_state_publisher'
             and line['text'].startswith(('Robot state publisher ', 'Moved backwards'))]
    # Ours logs each cause once; the real one, each time.
    expected = [text for i, text in enumerate(texts)
                if text.startswith('Moved') or text not in texts[:i]]
    kept = [text for text in warnings if text.startswith(('Robot state', 'Moved'))]
    assert len(kept) == len(expected)
    assert all(text.startswith(words) for text, words in zip(kept, expected))


TWO = CASES['stamp_negative']['urdf']


def test_a_negative_stamp_is_ignored_with_one_warning():
    """The real one dies."""
    transforms, warnings = publisher(parse(TWO))
    for _ in range(2):
        assert transforms.moving(-10**9, ['a'], [0.2], NOW) is None
    assert warnings == ['ignored a JointState message with a negative stamp']
    assert transforms.moving(10**9, ['a'], [0.2], NOW)


def test_positions_that_are_not_finite_are_left_out_with_one_warning():
    """The other joints of the message are sent."""
    transforms, warnings = publisher(parse(TWO))
    for stamp in 10**9, 2 * 10**9:
        edges = transforms.moving(stamp, ['b', 'a'], [float('nan'), 0.2], NOW)
        assert edges is not None
        assert [child for _, child, _ in edges] == ['tip']
    assert warnings == ['ignored positions that are not finite, such as nan of joint b']


def test_a_stamp_of_zero_is_explained():
    """The real one drops such messages without a word."""
    transforms, warnings = publisher(parse(TWO))
    assert transforms.moving(0, ['a'], [0.2], NOW) is None
    assert warnings == ['ignored a JointState message with the stamp 0: set its header.stamp, or '
                        'the parameter ignore_timestamp']
    # The remedy has been named.
    assert transforms.missing() == 'no JointState message has been accepted yet, so no joint moves'


@pytest.mark.parametrize('frequency', [0.0, 1e-300])
def test_extreme_frequencies(frequency):
    """0 is no limit: equal stamps pass; a tiny one lets nothing pass after the first message."""
    transforms, _ = publisher(parse(TWO), publish_frequency=frequency)
    passed = [transforms.moving(NOW, ['a'], [0.2], NOW) is not None for _ in range(2)]
    assert passed == ([True, True] if frequency == 0.0 else [False, False])


def test_joints_without_a_position_are_named():
    """So are names in the messages that the robot does not have."""
    transforms, _ = publisher(parse(TWO))
    assert transforms.missing() == (
        'no JointState message has been accepted yet, so no joint moves: start a program that '
        'publishes on joint_states')
    transforms.moving(10**9, ['a', 'bb'], [0.2, 0.0], NOW)
    assert transforms.missing() == (
        "no position has arrived for 'b', so these joints have no transform; the robot does not "
        "have 'bb'")
    transforms.moving(2 * 10**9, ['b'], [0.2], NOW)
    assert not transforms.missing()


S = 10**9


@pytest.fixture
def present(monkeypatch):
    """A list whose last item is the present on the monotonic clock (s)."""
    present = [1.0]
    monkeypatch.setattr(robot_transforms, 'monotonic', lambda: present[-1])
    return present


def answered(transforms, states):
    """Send states of joint 'a'; each is the stamp and the node's time (s). Return the stamps."""
    return [stamp for stamp, now in states
            if transforms.moving(round(stamp * S), ['a'], [0.2], round(now * S)) is not None]


LATE: dict[str, tuple[list[Any], list[Any]]] = {
    'after a reset': ([(110, 110)], [(110, 5.3)]),
    'the first one after a reset': ([(110, 110), (5, 5)], [(110, 5.3)]),
    'a burst': ([(110, 110), (5, 5)], [(109 + i / 10, 5.3) for i in range(10)]),
    'far in the future': ([(5, 5)], [(2**31 - 1, 5.3)]),
    'another clock': ([(5, 5), (1.7e9, 5.1), (5.1, 5.1), (1.7e9, 5.2)], [(1.7e9, 5.3)]),
}


@pytest.mark.parametrize('name', LATE)
@pytest.mark.usefixtures('present')
def test_a_state_ahead_of_the_clock_is_ignored(name):
    """Those in time go on at once; buffers would refuse them after the transform of this one."""
    before, late = LATE[name]
    transforms, warnings = publisher(parse(TWO))
    answered(transforms, before)
    assert answered(transforms, late) == []
    in_time = [(5.35 + i / 20, 5.36 + i / 20) for i in range(20)]
    assert answered(transforms, in_time) == [stamp for stamp, _ in in_time]
    assert sum('ahead of the clock' in text for text in warnings) == 1


AHEAD: dict[str, list[Any]] = {
    'from the start': [(100 + i / 10, 5 + i / 10) for i in range(30)],
    'far in the future, from the start': [(2**31 - 1, 5 + i) for i in range(5)],
    'before the first message on /clock': [(10 * i, 0) for i in range(1, 9)],
    'a clock that is ahead by less than 1 s': [(5.9 + i / 10, 5 + i / 10) for i in range(30)],
}


@pytest.mark.parametrize('name', AHEAD)
def test_states_that_are_always_ahead_are_answered(name):
    """As by the real one; and they do not hold back states that are in time afterwards."""
    transforms, _ = publisher(parse(TWO))
    assert answered(transforms, AHEAD[name]) == [stamp for stamp, _ in AHEAD[name]]
    now = AHEAD[name][-1][1] + 1.1
    assert answered(transforms, [(now, now), (now + 0.05, now + 0.05)]) == [now, now + 0.05]


def test_a_publisher_whose_clock_jumps_ahead_is_believed(present):
    """After half a second; so is one that goes on after /clock has stopped."""
    transforms, warnings = publisher(parse(TWO))
    assert answered(transforms, [(5, 5), (100, 5.1), (100.1, 5.1)]) == [5]
    present.append(1.5)
    assert answered(transforms, [(100.6, 5.1)]) == [100.6]
    assert [text.partition(' ')[0] for text in warnings] == ['ignored', 'answered']


def test_states_ahead_of_the_clock_are_answered_with_ignore_timestamp():
    """The parameter says so."""
    transforms, _ = publisher(parse(TWO), ignore_timestamp=True)
    assert answered(transforms, [(5, 5), (110, 5.1), (5.1, 5.1)]) == [5, 110, 5.1]


@pytest.mark.usefixtures('present')
def test_the_warning_of_a_state_names_joint_stamp_and_publishers():
    """It comes again after the clock ran back, since this may be another cause."""
    warnings: list[str] = []
    transforms = RobotTransforms(
        parse(TWO), warnings.append, lambda: '; publishers of /joint_states: /old')
    answered(transforms, [(110, 110), (5, 5), (110, 5.5), (110, 5.6), (4, 4), (110, 4.5)])
    text = ('ignored a JointState message that is ahead of the clock of this node by {} s: joint '
            "'a', stamp 110.000000. It is from before a reset of the clock, or the clock of "
            'its publisher differs; publishers of /joint_states: /old')
    moved = 'Moved backwards in time, re-publishing joint transforms!'
    assert warnings == [moved, text.format(104.5), moved, text.format(105.5)]


def test_a_state_that_is_much_older_is_explained():
    """It is ignored as by the real one, which says nothing."""
    transforms, warnings = publisher(parse(TWO))
    assert answered(transforms, [(100, 100), (99.99, 100), (40, 100.1), (39, 100.2)]) == [100]
    assert warnings == [
        'ignored a JointState message that is older than the last one by 60.0 s: joint '
        "'a', stamp 40.000000"]
