"""Which arms meet the requirements, by messages of right and wrong arms."""

import re

from arms import Arm, changed, each, FIXED_STEP, jitter, RIGHT, S, WRONG
from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from dummy_arm.check_arm import format_report
from dummy_arm.grading import requirements, samples
from dummy_arm.grading.records import ArmMessage, ArmPublisher, Line, Verdict
from dummy_arm.grading.sheet import FRAMES
from dummy_arm.grading.sine import fit_sine
from puretf.bag import NOT_RECORDED


def received(arm, seconds=25.0):
    """Return the messages of an arm as they are received, in the time of the arm."""
    return [ArmMessage(time, topic == '/tf_static', 'one', rows)
            for topic, time, rows in arm.messages(seconds)]


def check(*arguments, **keywords):
    """Return the report of an arm, of which these are the messages and so on."""
    return requirements.check(samples.Arm(*arguments, **keywords))


def failures(report):
    """Return the lines that are not ok."""
    return [line for line in report.lines if line.verdict == Verdict.NOT_OK]


def line_of(report, beginning):
    """Return the first line of a report whose requirement begins with a text."""
    return next(line for line in [*report.lines, *report.advice]
                if line.requirement.startswith(beginning))


@pytest.mark.parametrize('name', RIGHT)
def test_a_right_arm_passes(name):
    """Only a late listener cannot be judged."""
    report = check(received(RIGHT[name]))
    assert [line for line in report.lines if line.verdict != Verdict.OK] == [
        Line('', 'This was not observed.', verdict=Verdict.NOT_JUDGED,
             requirement='base_link reaches a late listener')]
    assert report.passed
    assert report.first_failure is None


@pytest.mark.parametrize(('requirement', 'cause'), [
    (requirement, cause) for requirement, arms in WRONG.items() for cause in arms])
def test_a_wrong_arm_fails_where_it_is_wrong(requirement, cause):
    """The first failure is the broken requirement; what cannot be judged has a reason."""
    report = check(received(WRONG[requirement][cause]))
    assert not report.passed
    first = failures(report)[0]
    assert first == report.first_failure
    assert first.requirement.startswith(requirement)
    assert cause in first.text
    for line in report.lines:
        assert line.verdict in (Verdict.OK, Verdict.NOT_OK, Verdict.NOT_JUDGED)
        assert bool(line.text) == (line.verdict != Verdict.OK)
        assert re.fullmatch(r'|.+[.?)]', line.text)
        assert (line.measured + line.text).isprintable()
    # What is broken once does not fail again elsewhere, unless it is wrong at several joints.
    kinds = {re.sub(r'joint_\d|[\d.]+', '', line.requirement) for line in failures(report)}
    assert len(kinds) == 1


def test_what_cannot_be_judged_says_why():
    """After a misspelt frame, the lines of this frame and of its child are not judged."""
    report = check(received(WRONG['the tree']["'joint1' is misspelt"]))
    assert {line.requirement.split()[0] for line in report.lines if line.text.startswith(
        'It is not judged, since this is not met: the tree.')} == {'joint_1', 'joint_2'}
    assert line_of(report, 'the joints have').text == 'The speed of joint_1 cannot be measured.'
    assert line_of(report, 'joint_3 moves as a sine').verdict == Verdict.OK


def test_the_sine_is_found():
    """Noise, uneven times and few periods do not matter."""
    random = np.random.default_rng(7)
    for speed in (0.05, 0.3, 0.7, 3.0, 15.0):
        for periods in (1.0, 1.2, 7.7):
            times = np.sort(random.uniform(0.0, periods * 2 * np.pi / speed, 400))
            angles = 0.1 + 0.5 * np.sin(speed * (times - times[0]) + 2.0)
            sine = fit_sine(times, angles)
            assert (sine.speed, sine.amplitude, sine.phase) == pytest.approx((speed, 0.5, 2.0))
            assert sine.residual < 1e-6
            noisy = fit_sine(times, angles + random.normal(0.0, 0.005, 400))
            assert noisy.speed == pytest.approx(speed, rel=0.02)
            assert noisy.residual == pytest.approx(0.01, rel=0.2)


@given(st.lists(st.tuples(st.floats(0.0, 1e5), st.floats(-4.0, 4.0)), min_size=20))
def test_any_angles_can_be_fitted(samples):
    """The fit of odd motions is poor, but it is not an error."""
    times, angles = np.array(sorted(samples)).T
    assume(np.ptp(times) >= 1.0)
    assume(np.ptp(angles) > 0.01)
    assert np.isfinite(fit_sine(times, angles)).all()


@pytest.mark.parametrize(('residual', 'verdict'), [(0.019, Verdict.OK), (0.021, Verdict.NOT_OK)])
def test_the_limit_of_the_residual(residual, verdict):
    """A second harmonic of 2 % of the amplitude (as root mean square) is the limit."""
    share = residual * 2 ** 0.5
    arm = changed(angle=lambda self, joint, t: 0.4 * (
        np.sin(self.speeds[joint - 1] * t) + share * np.sin(2 * self.speeds[joint - 1] * t)))
    # Three periods of joint_1 are not whole periods of the others, so only joint_1 is judged.
    report = check(received(arm, 3 * 2 * np.pi / 0.3))
    assert line_of(report, 'joint_1 moves as a sine').verdict == verdict


@pytest.mark.parametrize(('seconds', 'hertz', 'reason'), [
    (2.5, 20, 'joint_1 moves as a sine (0.'),
    (15.0, 20, ' s are less than a period: observe or record the arm for 25 s (--time 25).'),
    (17.0, 20, ''), (900.0, 5, '')])
def test_how_long_an_arm_is_observed(seconds, hertz, reason):
    """Nothing fails because it is short; 17 s are enough, as a busy machine takes 8 of 25 s."""
    report = check(received(changed(hertz=hertz), seconds), True)
    assert report.passed == (not reason)
    assert reason in report.reason
    assert failures(report) == []
    triangle = WRONG['joint_1 moves as a sine']['triangle']
    assert not check(received(triangle, min(seconds, 25.0)), True).passed


def test_an_arm_that_stops():
    """It fails if it is sent no more when the observation ends, or when other frames go on."""
    messages = received(Arm())
    end = messages[-1].time
    assert check(messages, True, end + 5 * S).passed  # also a late listener is judged
    report = check(messages, True, end + 7 * S)
    assert report.first_failure == line_of(report, 'joint_1 moves')
    assert 'has not been sent for the last 7.0 s' in line_of(report, 'joint_1 moves').text
    report = check([message._replace(rows=[
        row for row in message.rows if row.child_frame_id != 'joint_2'
        or message.time < end - 10 * S]) for message in messages], True)
    assert report.first_failure == line_of(report, 'joint_2 moves')


def test_a_late_listener():
    """It is a requirement where it can be judged."""
    report = check(received(Arm()), False)
    assert not report.passed
    assert [line.requirement for line in failures(report)] == ['base_link reaches a late listener']


def test_two_publishers_of_one_frame():
    """Frames that two programs publish at once fail; a program that was restarted does not."""
    messages = received(Arm())
    both = [message._replace(publisher=publisher) for message in messages
            for publisher in ('one', 'two')]
    (failure,) = failures(check(both))
    assert failure.requirement == 'the tree'
    assert 'Two publishers send joint_1' in failure.text
    half = len(messages) // 2
    assert check([*messages[:half], *(
        message._replace(publisher='two') for message in [messages[0], *messages[half:]])]).passed


def test_two_copies_of_one_program():
    """Both processes are named, and which of them is to be ended: the oldest is the first."""
    messages = [message._replace(publisher=publisher) for message in received(Arm())
                for publisher in ('one', 'two')]

    def cause(*senders):
        publishers = [ArmPublisher(gid, node, False, pid) for gid, node, pid in senders]
        return failures(check(messages, publishers=publishers))[0].text

    assert cause(('two', '/dummy_arm', 1300), ('one', '/dummy_arm', 1234)) == (
        'Programs with the node name /dummy_arm send joint_1 at the same time: PID 1300 and PID '
        '1234. End all but one: if the last one is to stay, kill 1300.')
    lines = format_report(check(messages, publishers=[
        ArmPublisher(gid, '/dummy_arm', False, pid)
        for gid, pid in (('one', 1234), ('two', 1300))]))
    assert lines[0].startswith('not ok      the tree')
    assert not [line for line in lines[3:-1] if 'joint' in line]
    for unknown in ('two', '/other', 1300), ('two', '/dummy_arm', 0), ('x', '/dummy_arm', 1300):
        assert 'Two publishers send joint_1' in cause(unknown, ('one', '/dummy_arm', 1234))


def in_callback(arm, number=lambda tick: tick):
    """Return the messages of a program that creates a broadcaster in each tick of its timer."""
    return [message if message.is_static else message._replace(publisher=f'gid {number(tick)}')
            for tick, message in enumerate(received(arm))]


@pytest.mark.parametrize(('messages', 'requirement'), [
    ([], 'all transforms'),
    (in_callback(changed(topics=('/tf_static', *[''] * 4))), 'the tree'),
    (in_callback(Arm())[:2], 'joint_1 moves'),
    (in_callback(Arm())[:500:50], 'joint_1 moves as a sine'),
    (in_callback(Arm(), lambda tick: tick // 4 * 2 + tick % 2), 'the tree'),
    (in_callback(Arm()), 'each broadcaster')])
def test_broadcasters_that_are_created_in_a_callback(messages, requirement):
    """They are the cause of what is missing, or sent twice; if all arrives, it is advice."""
    publishers = [ArmPublisher('one', '/dummy_arm', True, 0), *(
        ArmPublisher(f'gid {i}', '/dummy_arm', False, 0) for i in range(1000))]
    report = check(messages, True, publishers=publishers)
    line = report.first_failure or line_of(report, 'each broadcaster')
    assert line.requirement.startswith(requirement)
    assert re.match('(999|1000) publishers, one after another: create the broadcaster once',
                    line.text)
    assert '\n'.join(format_report(report)).count('one after another') == 1


def test_a_broadcaster_for_each_frame():
    """It is not advised against, and no cause of anything, since each frame has only one."""
    arm = RIGHT['a message for each frame']
    messages = [message._replace(publisher=message.rows[0].child_frame_id)
                for message in received(arm)]
    publishers = [ArmPublisher(frame, '/dummy_arm', frame == 'base_link', 7)
                  for frame in FRAMES[1:]]
    advice = line_of(check(messages, publishers=publishers), 'each broadcaster')
    assert advice.verdict == Verdict.OK
    messages = [message for message in messages if message.publisher != 'joint_2']
    assert failures(check(messages, publishers=publishers))[0].text == (
        'No transform of joint_2 was received.')


def test_the_same_stamp_is_advised_where_one_node_sends_all():
    """Not where each joint has its node, or nobody knows; and wrong stamps come first."""
    def verdict(arm, *nodes, gid=str):
        messages = [message._replace(publisher=gid(message.rows[0].child_frame_id))
                    for message in received(arm)]
        publishers = [ArmPublisher(frame, node, False, 7) for frame, node in zip(FRAMES, nodes)]
        return line_of(check(messages, publishers=publishers), 'all frames have the same').verdict

    arm = RIGHT['a message for each frame']
    assert verdict(arm, *['/arm'] * 6) == Verdict.ADVICE
    assert verdict(arm, *FRAMES) == Verdict.NOT_JUDGED
    assert verdict(arm, gid=lambda _: NOT_RECORDED) == Verdict.NOT_JUDGED
    unset = WRONG['the stamps']['The stamp of joint_3 is not set']
    assert verdict(unset, *['/arm'] * 6) == Verdict.NOT_JUDGED
    assert verdict(WRONG['base_link is on /tf_static']['which sends on /tf_static']) == Verdict.OK


def test_doubled_angles():
    """If all are doubled, it is the half angle, though one is also at the limit of another."""
    report = check(received(WRONG['joint_1 stays']['half angle']))
    assert {line.text.partition('. ')[2] for line in failures(report)} == {
        'In the quaternion, use the half angle: z = sin(angle / 2), w = cos(angle / 2).'}


def test_nothing_on_tf_but_static_joints():
    """The static joints are the cause, also if the tree is not complete."""
    report = check(received(changed(topics=(*('/tf_static',) * 4, ''))))
    assert report.reason.startswith('the tree (no end_effector). joint_1, joint_2, joint_3 are se')
    assert report.reason.endswith(' in a timer. (requirements that are not met: 4)')


@pytest.mark.parametrize(('arm', 'practice', 'text'), [
    (changed(**FIXED_STEP), 'the motion follows the clock', 'Use the clock: with a fixed step'),
    (changed(hertz=8), 'at least 10', 'joint_1 is sent 8.0 times'),
    (RIGHT['a message for each frame'], 'all frames have the same stamp', 'once in each tick'),
    (changed(limits=(45.0, 14.0, 60.0)), 'the joints use', 'joint_2 uses only 47 %'),
    (each(lambda topic, time, rows: [(topic, time, rows), ('/tf_static', time, [
        Arm().row(0, time)])]), 'base_link is sent once', 'once, in __init__'),
    (RIGHT['another node'], 'no other frames', 'Other frames: other.'),
    (changed(speeds=(1.5, 2.5, 3.5)), 'speeds of about', 'time in seconds'),
    (changed(speeds=(1.885, 3.142, 4.398)), 'speeds of about', 'a factor 2π?'),
    # Its largest speeds are 0.24, 0.52 and 0.73 rad/s, which fit the sheet better.
    (changed(speeds=(0.3, 1.0, 0.7)), 'speeds of about',
     'joint_2 is twice as fast as the sheet (1.00 in place of 0.5 rad/s)'),
    (changed(speeds=(0.3, 0.7, 0.5)), 'speeds of about', 'By the phases, the speeds are not')])
def test_good_practice(arm, practice, text):
    """It is advised, and has no influence on the result; a good arm follows it."""
    report = check(received(arm))
    assert report.passed
    assert [line.requirement for line in report.advice if line.verdict == Verdict.ADVICE] == [
        line_of(report, practice).requirement]
    assert text in line_of(report, practice).text
    assert line_of(check(received(RIGHT['slow rate'])), practice).verdict == Verdict.OK


def test_largest_speeds_of_the_sheet():
    """The sheet can be read so: nothing is advised."""
    limits = np.radians((45.0, 30.0, 60.0))
    report = check(received(changed(speeds=tuple(np.divide((0.3, 0.5, 0.7), limits)))))
    assert report.passed
    assert {line.verdict for line in report.advice} == {Verdict.OK}


@pytest.mark.parametrize(('step', 'seconds', 'requirement', 'text'), [
    (0.01, 25.0, 'joint_1 moves as a sine',
     '. Or observe or record the arm for 45 s (--time 45).'),
    (0.01, 45.0, 'speeds of about', '.'), (0.02, 25.0, 'the motion follows', '')])
def test_a_fixed_step(step, seconds, requirement, text):
    """It is named where it shows, though the timer is exact to 0.1 ms."""
    arm = changed(hertz=50, time=jitter, t=lambda self, now: self.tick * step)
    report = check(received(arm, seconds), True)
    assert report.passed == (seconds * step > 0.4)
    assert line_of(report, requirement).text == (
        'joint_1 is half as fast as the sheet (0.15 in place of 0.3 rad/s): the step is fixed, so '
        f'the speed depends on the rate; take the time from the clock{text}' if text else
        'Use the clock: with a fixed step, the speed depends on the rate.')


def test_an_int():
    """In the container, an int arrives as a very small number; it is named, and w also."""
    report = check(received(changed(position=lambda self, edge, t: (
        *self.positions[edge][:2], self.positions[edge][2] or 5e-324))), True)
    assert report.passed
    assert line_of(report, 'all numbers are floats').text.startswith('Write 0.0 and not 0')
    arm = changed(rotation=lambda self, edge, angle: (
        (0.0, 0.0, 0.0, 4e-323) if edge == 4 else Arm.rotation(self, edge, angle)))
    assert 'The quaternion of end_effector has an int.' in check(received(arm)).reason
