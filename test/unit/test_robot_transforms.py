"""The rules of robot_state_publisher, against what the real 3.3.3 has answered."""

import re
from xml.etree import ElementTree

import pytest
from recorded_robots import (
    ACCEPTED,
    answer,
    assert_equal,
    CASES,
    fixed,
    OF_THE_COMMAND,
    recorded,
    REFUSED,
    ZERO_AXES,
)

from dummy_arm.robot.description import Description, DescriptionError, parse
from dummy_arm.robot.robot_transforms import RobotTransforms

pytest.importorskip('urdf_parser_py')

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


@pytest.mark.parametrize('name', ['odd_origins', 'not_finite_positions'])
def test_the_real_one_sends_nan_where_ours_does_not(name):
    """The recordings have NaN, which `answer` leaves out."""
    messages = CASES[name]['tf']
    assert any(len(answer(CASES[name], message['step'])) < len(recorded(message['transforms']))
               for message in messages)


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


def test_remembered_names_are_bounded():
    """A publisher of ever new names does not fill the memory."""
    transforms, _ = publisher(Description('r', '', ('a',), (), 'a', (), ()))
    for i in range(30):
        transforms.moving(10**9, [f'{i} {j}' for j in range(1000)], [0.0] * 1000, NOW)
    assert len(transforms._last) <= 12_000
