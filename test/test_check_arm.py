"""check_arm: right and wrong arms, from messages, from bags, live and as programs; drawings."""

import csv
from itertools import pairwise
import os
from pathlib import Path
import re
import signal
import socket
import sys
import time

from arms import Arm, changed, RIGHT, S, WRONG
from conftest import (
    code_without,
    is_running,
    on_unix,
    run_on_full_disk,
    TIMEOUT,
    tool,
    tool_without_ros,
)
from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from dummy_arm import arm as own_arm
from dummy_arm.inspection.arm_check import (
    ADVICE,
    check,
    EDGES,
    fit_sine,
    FRAMES,
    JOINTS,
    Line,
    Message,
    NOT_JUDGED,
    NOT_OK,
    OK,
)
from dummy_arm.tools.check_arm import main

MODEL = Path(__file__).parent.parent / 'lab' / 'dummy_arm.py'


def received(arm, seconds=25.0):
    """Return the messages of an arm as they are received, in the time of the arm."""
    return [Message(time, topic == '/tf_static', 'one', rows)
            for topic, time, rows in arm.messages(seconds)]


def failures(report):
    """Return the lines that are not ok."""
    return [line for line in report.lines if line.verdict == NOT_OK]


def line_of(report, beginning):
    """Return the first line of a report whose requirement begins with a text."""
    return next(line for line in [*report.lines, *report.advice]
                if line.requirement.startswith(beginning))


@pytest.mark.parametrize('name', RIGHT)
def test_a_right_arm_passes(name):
    """Nothing is wrong, and only a late listener cannot be judged."""
    report = check(received(RIGHT[name]))
    assert [line for line in report.lines if line.verdict != OK] == [
        Line('base_link reaches a late listener', '', NOT_JUDGED, 'A bag does not show this.')]
    assert report.passed
    assert report.first_failure is None


@pytest.mark.parametrize('name', WRONG)
def test_a_wrong_arm_fails_where_it_is_wrong(name):
    """The first failure is the broken requirement; what cannot be judged has a reason."""
    arm, requirement, cause = WRONG[name]
    report = check(received(arm))
    assert not report.passed
    first = failures(report)[0]
    assert first == report.first_failure
    assert first.requirement.startswith(requirement)
    assert cause in first.text
    for line in report.lines:
        assert line.verdict in (OK, NOT_OK, NOT_JUDGED)
        assert bool(line.text) == (line.verdict != OK)
        assert re.fullmatch(r'|[^\n]+[.?)]', line.text)
    # What is broken once does not fail again elsewhere, unless it is wrong at several joints.
    kinds = {re.sub(r'joint_\d|[\d.]+', '', line.requirement) for line in failures(report)}
    assert len(kinds) == 1


def test_what_cannot_be_judged_says_why():
    """After a misspelt frame, the lines of this frame and of its child are not judged."""
    report = check(received(WRONG['misspelt'][0]))
    not_judged = {line.requirement: line.text for line in report.lines
                  if line.verdict == NOT_JUDGED}
    assert not_judged.pop('base_link reaches a late listener')
    assert not_judged.pop('the joints have three different speeds') == (
        'The speed of joint_1 cannot be measured.')
    assert {text for requirement, text in not_judged.items() if 'joint_1' in requirement.split()[0]
            } == {'There is no joint_1.'}
    assert {text for requirement, text in not_judged.items() if 'joint_2' in requirement.split()[0]
            } == {'The parent of joint_2 is not joint_1.'}
    assert line_of(report, 'joint_3 moves as a sine').verdict == OK


def test_the_requirements_are_those_of_the_arm():
    """The sheet in arm_check and the arm of this package, which is written apart, agree."""
    arm = own_arm.Arm()
    assert ('map', *arm.frames) == FRAMES
    assert [joint.speed for joint in JOINTS] == [joint.speed for joint in arm.joints]
    assert [joint.limit for joint in JOINTS] == [joint.limit for joint in arm.joints]
    assert [edge.position for edge in EDGES[1:]] == [
        tuple(pose[:3]) for pose in arm.poses([0.0, 0.0, 0.0]).tolist()]


def test_the_sine_is_found():
    """Amplitude, speed and phase are found, also with noise, uneven times and few periods."""
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


@pytest.mark.parametrize(('residual', 'verdict'), [(0.019, OK), (0.021, NOT_OK)])
def test_the_limit_of_the_residual(residual, verdict):
    """A second harmonic of 2 % of the amplitude (as root mean square) is the limit."""
    share = residual * 2 ** 0.5
    arm = changed(angle=lambda self, joint, t: 0.4 * (
        np.sin(self.speeds[joint - 1] * t) + share * np.sin(2 * self.speeds[joint - 1] * t)))
    # Seven periods of joint_1 are not whole periods of the others, so only joint_1 is judged.
    report = check(received(arm, 7 * 2 * np.pi / 0.3))
    assert line_of(report, 'joint_1 moves as a sine').verdict == verdict


def test_too_short_an_observation_does_not_pass():
    """If less than a period is seen, the sine is not judged, and the arm does not pass."""
    report = check(received(Arm(), 15.0), True)
    assert not report.passed
    assert not failures(report)
    assert report.first_failure == line_of(report, 'joint_1 moves as a sine')
    assert 'longer (--time)' in line_of(report, 'joint_1 moves as a sine').text
    assert line_of(report, 'joint_2 moves as a sine').verdict == OK


@pytest.mark.parametrize('seconds', [2.5, 10.0])
def test_a_short_observation_is_no_slow_arm(seconds):
    """Nothing fails because the observation is short."""
    assert failures(check(received(Arm(), seconds), True)) == []


@pytest.mark.parametrize('speeds', [
    Arm.speeds, RIGHT['second reading of the speeds'].speeds, (1.5, 2.5, 3.5)])
def test_a_long_observation(speeds):
    """The speeds are found in an hour of messages, too."""
    assert check(received(changed(speeds=speeds, hertz=5), 3600.0), True).passed


def test_an_arm_that_stops():
    """It fails if it is sent no more when the observation ends, or when other frames go on."""
    messages = received(Arm())
    end = messages[-1].time
    assert check(messages, True, end + 2 * S).passed
    report = check(messages, True, end + 4 * S)
    assert report.first_failure == line_of(report, 'joint_1 moves')
    assert 'has not been sent for the last 4.0 s' in line_of(report, 'joint_1 moves').text
    report = check([message._replace(rows=[
        row for row in message.rows if row.child_frame_id != 'joint_2'
        or message.time < end - 10 * S]) for message in messages], True)
    assert report.first_failure == line_of(report, 'joint_2 moves')


def test_old_stamps_and_static_transforms_without_times():
    """Joints on both topics, without times and with old stamps, are judged without an error."""
    messages = received(changed(stamp=lambda self, edge, now: now - 10 * S))
    static = Message(0, True, 'one', messages[1].rows)
    report = check([static, *messages], True)
    assert not report.passed


def test_a_late_listener():
    """It is a requirement where it can be judged."""
    assert check(received(Arm()), True).passed
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


@pytest.mark.parametrize(('arm', 'practice', 'text'), [
    (changed(hertz=8), 'at least 10', 'joint_1 is sent 8.0 times'),
    (RIGHT['a message for each frame'], 'all frames have the same stamp', 'once in each tick'),
    (changed(limits=(45.0, 14.0, 60.0)), 'the joints use', 'joint_2 uses only 47 %'),
    (RIGHT['another node'], 'no other frames', 'Other frames: other.'),
    (changed(speeds=(1.5, 2.5, 3.5)), 'speeds of about', 'time in seconds')])
def test_good_practice(arm, practice, text):
    """It is advised, and has no influence on the result; a good arm follows it."""
    report = check(received(arm))
    assert report.passed
    assert [line.requirement for line in report.advice if line.verdict == ADVICE] == [
        line_of(report, practice).requirement]
    assert text in line_of(report, practice).text
    assert line_of(check(received(Arm())), practice).verdict == OK


def test_names_of_others_cannot_harm_the_terminal():
    """Escape sequences in the names of frames are escaped."""
    arm = changed(names=(*Arm.names[:5], 'end_effector\x1b[2J'))
    report = check(received(arm))
    texts = [text for line in [*report.lines, *report.advice] for text in line]
    assert all(text.isprintable() for text in texts)
    assert 'end_effector\\x1b[2J' in ' '.join(texts)


def test_the_measured_values():
    """They are those of the arm."""
    assert line_of(check(received(changed(hertz=8))), 'at least 10').measured == '8.0 Hz'
    line = line_of(check(received(WRONG['full angle'][0])), 'joint_1 stays')
    assert line.measured == '-90.0° to 90.0°'
    assert line.text.startswith('The limit is exceeded by 45.0°: the angle is twice as large')


# Bags

@pytest.mark.parametrize('kind', ['mcap', 'db3', 'bag'])
def test_a_bag(tmp_path, capsys, kind):
    """A recording of the arm is judged without ROS; the table has a line for each requirement."""
    bags = pytest.importorskip('bags')
    path = bags.make(tmp_path, kind, Arm().messages())
    assert main(['--bag', str(path)]) == 0
    output, error = capsys.readouterr()
    lines = output.splitlines()
    assert lines[0] == (
        'ok          all transforms are valid                      2005 transforms')
    assert 'ok          joint_1 is 0.3 m along z from base_link       (0.000, 0.000, 0.300) m' in (
        lines)
    assert ('not judged  base_link reaches a late listener             A bag does not show this.'
            ) in lines
    assert ('ok          the joints have three different speeds        0.30, 0.50, 0.70 rad/s '
            '(phase)') in lines
    assert lines[-1] == 'passed: 23 ok, 1 not judged'
    assert not error


def test_a_bag_of_a_wrong_arm(tmp_path, capsys, start):
    """The cause stands below its line, the exit code is 1; no ROS is needed."""
    bags = pytest.importorskip('bags')
    path = bags.make(tmp_path, 'mcap', (
        ('/robot' + topic, time, rows)
        for topic, time, rows in WRONG['a little too far'][0].messages()))
    process = start(*tool_without_ros('check_arm', '--bag', str(path), '--namespace', 'robot'))
    assert process.exit_code() == 1
    assert re.search(
        r'not ok +joint_2 stays within ±30° +-33\.0° to 33\.0°\n'
        r'    The limit is exceeded by 3\.0°\. .*\n', process.output)
    assert process.output.endswith('not passed: 22 ok, 1 not ok, 1 not judged\n')
    assert main(['--bag', str(path)]) == 1
    assert capsys.readouterr().err.startswith('check_arm: ')


def test_a_bag_without_times_or_with_damage(tmp_path, capsys):
    """Stamps are not judged without times; a message that cannot be decoded is left out."""
    bags = pytest.importorskip('bags')
    messages = [(topic, 0, rows) for topic, _, rows in Arm().messages()]
    path = bags.make(tmp_path, 'mcap', [*messages, ('/tf', 0, b'nonsense')])
    assert main(['--bag', str(path)]) == 1
    output = capsys.readouterr().out
    assert 'The bag has no times.' in output
    assert output.endswith('not passed: 22 ok, 2 not judged\n')


# Wrong use

@pytest.mark.parametrize(('arguments', 'text'), [
    (['a.py', '--bag', 'b'], 'give files of programs, or --bag, or --frames'),
    (['--frames', 'f.pdf', '--bag', 'b'], 'give files of programs, or --bag, or --frames'),
    (['--bag', 'b', '--time', '9'], '--time is for an arm that is running'),
    (['--time', '0.5'], '--time must be at least 1 s, and at most 3600 s, got 0.5'),
    (['--time', 'nan'], "'nan' is not finite"),
    (['a.py', '--jobs', '0'], '--jobs must be at least 1, and at most 17, got 0'),
    (['--jobs', '2'], '--csv and --jobs need the files'),
    (['--csv', 'out.csv'], '--csv and --jobs need the files'),
    (['a.py', '--namespace', 'robot'], '--namespace is for --bag'),
    (['a.py', '--csv', 'b.py'], "--csv needs the name of a file that ends in .csv, got 'b.py'"),
    (['a.csv', '--csv', 'a.csv'], '--csv needs the name of a file that ends in .csv'),
    (['--partial'], '--partial needs --bag'),
    (['--bag', ''], '--bag needs the path of a bag'),
    (['--frames', 'frames.txt'], "'frames.txt' must end in .pdf or .gv")])
def test_wrong_use(failed, arguments, text):
    """Wrong arguments end with exit code 2, and one line."""
    code, error = failed(main, *arguments)
    assert code == 2
    assert text in error
    assert error.count('\n') == 1


def test_a_bag_that_does_not_exist(failed):
    """It ends with exit code 1, and one line that names the bag."""
    code, error = failed(main, '--bag', 'missing')
    assert code == 1
    assert re.fullmatch(r'check_arm: .*missing.*\n', error)


@pytest.mark.usefixtures('domain_id')  # which needs ROS, as to grade programs does
def test_a_table_that_cannot_be_written(failed, tmp_path):
    """No program is run, since its row could not be written."""
    table = tmp_path / 'missing' / 'grades.csv'
    code, error = failed(main, 'a.py', '--csv', str(table))
    assert code == 1
    assert error == f'check_arm: cannot write {table}: No such file or directory\n'


@pytest.mark.usefixtures('domain_id')
def test_a_table_does_not_replace_a_pipe_or_a_link(failed, tmp_path):
    """A link stays, too; its file is written."""
    os.mkfifo(tmp_path / 'pipe.csv')
    code, error = failed(main, '--csv', str(tmp_path / 'pipe.csv'), 'a.py')
    assert code == 1
    assert error == f'check_arm: cannot write {tmp_path}/pipe.csv: it is not a regular file\n'
    (tmp_path / 'link.csv').symlink_to('table.csv')
    main(['--csv', str(tmp_path / 'link.csv'), str(tmp_path / 'a.py')])
    assert (tmp_path / 'link.csv').is_symlink()
    assert (tmp_path / 'table.csv').read_text().startswith('file,')


@pytest.mark.usefixtures('domain_id')
def test_a_table_on_a_full_disk(tmp_path):
    """The error names the file; an old table stays, and there is no partial one."""
    there = tmp_path / 'there'
    there.mkdir()
    (there / 'grades.csv').write_text('old')
    done = run_on_full_disk('check_arm', 100, 'a.py', '--csv', 'grades.csv', directory=there)
    assert done.returncode == 1
    assert done.stderr == 'check_arm: cannot write grades.csv: File too large\n'
    assert [path.name for path in there.iterdir()] == ['grades.csv']
    assert (there / 'grades.csv').read_text() == 'old'


# Drawings

EDGE = ('"{}" -> "{}"[label=" Broadcaster: default_authority\\nAverage rate: 50.2\\nBuffer '
        'length: 4.9\\nMost recent transform: 1.1\\nOldest transform: 0.1\\n"];')
CHAIN = [*pairwise(FRAMES)]


def as_tf2_writes_it(edges):
    """Return a graph as the view_frames of tf2 writes it."""
    return '\n'.join([
        'digraph G {', *(EDGE.format(*edge) for edge in edges), 'edge [style=invis];',
        ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";',
        '"Recorded at time: 1718889.2"[ shape=plaintext ] ;', f'}}->"{FRAMES[0]}";', '}'])


@pytest.mark.parametrize(('edges', 'in_pdf', 'in_gv'), [
    (CHAIN, 'ok', 'ok'),
    (CHAIN[::-1], 'ok', 'ok'),
    (CHAIN[:4], "Missing: 'end_effector'.", 'Missing: joint_3 -> end_effector.'),
    ([*CHAIN, ('map', 'moving_frame')], "Other frames: 'moving_frame'.",
     'Other edges: map -> moving_frame.'),
    ([(FRAMES[min(i, 1)], child) for i, (_, child) in enumerate(CHAIN)],
     'joint_2 is not below joint_1', 'Missing: joint_1 -> joint_2, joint_2 -> joint_3'),
    ([(child, parent) for parent, child in CHAIN], 'base_link is not below map',
     'Missing: base_link -> joint_1')])
def test_a_drawing_of_tf2(tmp_path, capsys, edges, in_pdf, in_gv):
    """A PDF shows the six names from top to bottom and no other; a graph has the five edges."""
    pytest.importorskip('pypdf')
    pygraphviz = pytest.importorskip('pygraphviz')
    graph = tmp_path / 'frames.gv'
    graph.write_text(as_tf2_writes_it(edges))
    pygraphviz.AGraph(string=graph.read_text()).draw(str(tmp_path / 'frames.pdf'), prog='dot')
    for name, expected in (('frames.pdf', in_pdf), ('frames.gv', in_gv)):
        code = main(['--frames', str(tmp_path / name)])
        output = capsys.readouterr().out
        assert code == (0 if expected == 'ok' else 1)
        assert output.startswith(f'{tmp_path / name}: {"" if code == 0 else "not ok: "}{expected}')


@on_unix
def test_drawings_that_cannot_be_read(tmp_path, capsys, monkeypatch):
    """Several files can be checked at once; each gets its line with the reason."""
    pytest.importorskip('pypdf')
    monkeypatch.chdir(tmp_path)
    for name, text in {'text.pdf': 'no PDF', 'empty.pdf': '', 'text.gv': 'no graph',
                       'quotes.gv': '\\"' * 100_000, 'escape.gv': '"map\x1b" -> "x\x07"',
                       'comments.gv': as_tf2_writes_it(CHAIN).replace('\n', '\n// '),
                       'chain.gv': f'digraph {{ {" -> ".join(FRAMES)} /* -> other */ }}',
                       'right.gv': as_tf2_writes_it(CHAIN)}.items():
        Path(name).write_text(text)
    os.mkfifo('fifo.gv')
    os.mkfifo('fifo.pdf')
    assert main(['--frames', 'missing.pdf', 'missing.gv', 'text.pdf', 'empty.pdf', 'text.gv',
                 'quotes.gv', 'comments.gv', 'fifo.gv', 'fifo.pdf', 'chain.gv', 'right.gv']) == 1
    assert capsys.readouterr() == (
        'missing.pdf: not ok: It cannot be read: No such file or directory.\n'
        'missing.gv: not ok: It cannot be read: No such file or directory.\n'
        'text.pdf: not ok: It is not a PDF with text that can be read.\n'
        'empty.pdf: not ok: It is not a PDF with text that can be read.\n'
        'text.gv: not ok: It has no edges of a tree.\n'
        'quotes.gv: not ok: It has no edges of a tree.\n'
        'comments.gv: not ok: It has no edges of a tree.\n'
        'fifo.gv: not ok: It is not a regular file.\n'
        'fifo.pdf: not ok: It is not a regular file.\n'
        'chain.gv: ok\n'
        'right.gv: ok\n', '')
    assert main(['--frames', 'escape.gv']) == 1
    assert r'Other edges: map\x1b -> x\x07.' in capsys.readouterr().out


def test_without_pypdf(start, tmp_path):
    """The remedy is named."""
    code = code_without(['pypdf']) + tool('check_arm')[1]
    process = start('-c', code, '--frames', 'frames.pdf')
    assert process.exit_code() == 1
    assert process.output.startswith(
        'check_arm: pypdf is needed to read a PDF: apt install python3-pypdf, or pip')


# Live

FAST = [argument for number, speed in enumerate((3.0, 5.0, 7.0), 1)
        for argument in ('-p', f'joint_{number}.speed:={speed}')]


def test_the_arm_that_is_running(start):
    """Our arm passes, ten times as fast so that the test is short; in a namespace, too."""
    arm = start(*tool('dummy_arm', '--namespace', 'robot', '--ros-args', *FAST))
    arm.line_with('t = 0')
    process = start(*tool('check_arm', '--time', '12', '--namespace', 'robot'))
    assert process.exit_code(60.0) == 0, process.output
    assert 'base_link reaches a late listener             received\n' in process.output
    assert process.output.endswith('passed: 24 ok\n')


@pytest.mark.soak
def test_an_arm_that_is_static(start):
    """If nothing is on /tf, the frames are judged all the same, and base_link is received."""
    start(*tool('static_transform_publisher', '--frame-id', 'map', '--child-frame-id',
                'base_link')).line_with('translation')
    process = start(*tool('check_arm', '--time', '1'))
    assert process.exit_code(60.0) == 1
    assert 'base_link reaches a late listener             received\n' in process.output
    assert 'No transform of joint_1 was received: nothing arrives on /tf.' in process.output


def test_no_arm(start):
    """If nothing is received, the reasons are named; Ctrl-C ends the command with exit code 1."""
    process = start(*tool('check_arm'))
    interrupted = start(*tool('check_arm', '--time', '1000'))
    arm = start(*tool('dummy_arm', '--namespace', 'robot'))
    arm.line_with('t = 0')
    assert process.exit_code(60.0) == 1
    assert 'check_arm: no transform was received within 20 s. ' in process.output
    assert '--namespace robot' in process.output
    interrupted.press_ctrl_c()
    assert interrupted.exit_code() == 1
    assert 'Traceback' not in interrupted.output


# Programs


def program(*changes):
    """Return the model answer with small changes."""
    code = MODEL.read_text()
    for old, new in changes:
        assert code.count(old) == 1, old
        code = code.replace(old, new)
    return code


FASTER = [("'joint_1', (0.0, 0.0, 0.3), 0.3,", "'joint_1', (0.0, 0.0, 0.3), 3.0,"),
          ("'joint_2', (0.4, 0.0, 0.0), 0.5,", "'joint_2', (0.4, 0.0, 0.0), 5.0,"),
          ("'joint_3', (0.3, 0.0, 0.0), 0.7,", "'joint_3', (0.3, 0.0, 0.0), 7.0,")]
#: By file: the program, and the line that is printed, with # for each measured number, since these
#: depend on the load of the machine. test_the_measured_values checks the numbers.
PROGRAMS = {
    'model.py': (program(), 'ok'),
    'only_main.py': (program(("\n\nif __name__ == '__main__':\n    main()\n", '\n'),
                             ('create_timer(0.02', 'create_timer(0.2'),
                             ('\n\nclass', '\nimport sys\nname = __name__\nif sys.path:\n'
                                           '    sys.path.append("")\n\nclass')),
                     'ok; advice: at least 10 messages per second (# Hz)'),
    'full_angle.py': (program(('sin(angle / 2)', 'sin(angle)'), ('cos(angle / 2)', 'cos(angle)')),
                      'not ok: joint_1 stays within ±45° (#° to #°). The limit is exceeded by #°: '
                      'the angle is twice as large as it should be. In the quaternion, use the '
                      'half angle: z = sin(angle / 2), w = cos(angle / 2). (2 more)'),
    'base_on_tf.py': (program(('self.static_broadcaster.sendTransform(self.transform(',
                               'self.create_timer(0.1, lambda: self.broadcaster.sendTransform('
                               'self.transform('),
                              ("'base_link', (0.0, 0.0, 0.0), 0.0))",
                               "'base_link', (0.0, 0.0, 0.0), 0.0)))")),
                      'not ok: base_link is on /tf_static (/tf). map → base_link is sent on /tf: '
                      'use StaticTransformBroadcaster, which sends on /tf_static.'),
    'dropped.py': (program(('        self.start = ', '        self.later = self.create_timer(\n'
                            '            15.0, lambda: self.destroy_publisher(\n'
                            '                self.static_broadcaster.pub_tf))\n'
                            '        self.start = ')),
                   'not ok: base_link reaches a late listener (not received). A listener that '),
    'stamp_once.py': (program(('self.transform(now, parent', 'self.transform(self.start, parent')),
                      'not ok: the stamps are the current time (joint_1: always the same). '),
    'star.py': (program(("('joint_1', 'joint_2'", "('base_link', 'joint_2'"),
                        ("('joint_2', 'joint_3'", "('base_link', 'joint_3'")),
                'not ok: the tree (base_link → joint_2). The tree is a star: joint_1, joint_2, '
                'joint_3 have the same parent.'),
    'syntax.py': ('import rclpy\nprint("no end)\n',
                  'not ok: It does not compile: line 2: unterminated string literal'),
    'crash.py': ('import rclpy\nrclpy.init()\nnode = rclpy.create_node("a")\n\n\ndef f():\n'
                 '    node.no_method()\n\n\nf()\n',
                 "not ok: It fails: AttributeError: 'Node' object has no attribute 'no_method' "
                 '(line 7)'),
    'fails_often.py': (program(('        now = self', '        import traceback\n        try:\n'
                              '            1 / 0\n        except ZeroDivisionError:\n'
                              '            traceback.print_exc()\n        now = self')),
                     'not ok: It fails: ZeroDivisionError: division by zero (line '),
    'slow_traceback.py': ('import time\nprint("Traceback (most recent call last):", flush=True)\n'
                          'time.sleep(2)\nprint("  File a, line 1\\nValueError: x", flush=True)\n'
                          'time.sleep(100)\n', 'not ok: It fails: ValueError: x'),
    'deep.py': ('-' * 100_000 + '1\n', 'not ok: It does not compile: '),
    'ends.py': ('print("done")\n', 'not ok: It ended by itself after '),
    'loud.py': ('while True:\n    print("x" * 10_000)\n', 'not ok: It prints more than 1 MB.'),
    'silent.py': ('import signal, subprocess, sys, time\nsignal.signal(2, signal.SIG_IGN)\n'
                  'subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"],\n'
                  '                 start_new_session=True)\ntime.sleep(1000)\n',
                  'not ok: It publishes nothing on /tf and /tf_static within 20 s: is the timer '
                  'created, and does rclpy.spin run?'),
    'missing.py': (None, 'not ok: It cannot be read: No such file or directory.'),
    'binary.py': ('\0', 'not ok: It does not compile: '),
}


#: These programs take long; or they are variants of others.
LONG = {'only_main.py', 'fails_often.py', 'slow_traceback.py', 'silent.py'}


@pytest.mark.parametrize('names', [
    {*PROGRAMS} - LONG,
    pytest.param(LONG | {'model.py', 'full_angle.py'}, marks=pytest.mark.soak)])
def test_programs(start, tmp_path, names):
    """Each program gets its line, in the order of the arguments, and a row of the table."""
    programs = {name: each for name, each in PROGRAMS.items() if name in names}
    for name, (code, _) in programs.items():
        if code is not None:
            (tmp_path / name).write_text(code)
    process = start(*tool('check_arm', *programs, '--csv', 'grades.csv', '--jobs', '8'),
                    cwd=tmp_path)
    assert process.exit_code(240.0) == 1
    lines = process.output.splitlines()
    assert len(lines) == len(programs), process.output
    for line, (name, (_, expected)) in zip(lines, programs.items()):
        assert re.sub(r'-?\d+\.\d+', '#', line).startswith(f'{name}: {expected}'), line
    assert not process.has_left_processes()
    with (tmp_path / 'grades.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [row['file'] for row in rows] == [*programs]
    assert [row['verdict'] == 'ok' for row in rows] == [
        expected.startswith('ok') for _, expected in programs.values()]
    assert [*rows[0].values()] == ['model.py', 'ok', '', *['ok'] * 29]
    (full_angle,) = (row for row in rows if row['file'] == 'full_angle.py')
    assert full_angle['at least 10 messages per second'] == 'ok'
    assert full_angle['joint_1 stays within ±45°'] == 'not ok'
    assert full_angle['joint_1 moves as a sine'] == 'ok'
    assert f"full_angle.py: not ok: {full_angle['reason']}" in lines
    assert {path.name for path in tmp_path.iterdir()} == {
        'grades.csv', *(name for name, (code, _) in programs.items() if code is not None)}


ENDLESS = """import os, signal, subprocess, sys, time
from pathlib import Path
signal.signal(2, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(1000)'],
                         start_new_session=True)
Path(sys.argv[0]).with_suffix('.pid').write_text(f'{os.getpid()} {child.pid} end')
time.sleep(1000)
"""


def started_pids(path):
    """Wait until a program has written its process ids, and return them."""
    deadline = time.monotonic() + TIMEOUT
    while not path.exists() or not path.read_text().endswith('end'):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return [int(word) for word in path.read_text().split()[:-1]]


def test_ctrl_c_ends_the_programs(start, tmp_path):
    """What was judged is printed and in the table, and no program is left, nor its children."""
    for name, code in ('first.py', ENDLESS), ('fast.py', ''), ('last.py', ENDLESS):
        (tmp_path / name).write_text(code)
    process = start(*tool('check_arm', 'first.py', 'fast.py', 'last.py', '--csv', 'grades.csv',
                          '--jobs', '2'), cwd=tmp_path)
    pids = [*started_pids(tmp_path / 'first.pid'), *started_pids(tmp_path / 'last.pid')]
    process.end(signal.SIGINT)
    assert process.exit_code() == 1
    lines = process.output.splitlines()
    assert lines[0].startswith('fast.py: not ok: It ended by itself')
    assert lines[1:] == ['check_arm: interrupted: the files without a line were not judged']
    assert not [pid for pid in pids if is_running(pid)]
    with (tmp_path / 'grades.csv').open(newline='') as file:
        assert [row['file'] for row in csv.DictReader(file)] == ['fast.py']


def test_a_killed_check_arm_leaves_no_program(start, tmp_path):
    """The kernel ends the program if check_arm is killed, or its terminal is closed."""
    (tmp_path / 'endless.py').write_text(ENDLESS)
    process = start(*tool('check_arm', 'endless.py'), cwd=tmp_path)
    pid, child = started_pids(tmp_path / 'endless.pid')
    process.end(signal.SIGKILL)
    deadline = time.monotonic() + TIMEOUT
    while is_running(pid):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)


@pytest.mark.soak
def test_busy_domains_are_waited_for(start, tmp_path):
    """If all domains are in use, no program fails for it."""
    (tmp_path / 'fast.py').write_text('')
    # A domain of its own, since other tests use those of the command, and free them at any time.
    option, code, *arguments = tool('check_arm', 'fast.py')
    own_domain = 'import dummy_arm.tools.check_arm as c; c._DOMAINS = range(232, 233); '
    with socket.socket(socket.AF_UNIX) as reservation:
        reservation.bind('\0dummy_arm.check_arm.232')
        process = start(option, own_domain + code, *arguments, cwd=tmp_path)
        time.sleep(3.0)
        assert not process.has_ended()
    assert process.line_with('fast.py: not ok: It ended by itself')


@pytest.mark.soak
def test_a_closed_output(start, tmp_path):
    """If the reader of the output has ended, not all is judged: the exit code is 1."""
    for name in 'a.py', 'b.py':
        (tmp_path / name).write_text('')
    code = 'import os, subprocess, sys\n' \
           'done = subprocess.Popen(sys.argv[1:], stdout=subprocess.PIPE)\n' \
           'done.stdout.close()\nsys.exit(done.wait())\n'
    process = start('-c', code, sys.executable, '-u', *tool('check_arm', 'a.py', 'b.py'),
                    cwd=tmp_path)
    assert process.exit_code() == 1
    assert 'Traceback' not in process.output
