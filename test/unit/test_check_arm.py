"""The command check_arm where there is no ROS: bags, drawings, wrong use."""

from itertools import pairwise
import os
from pathlib import Path
import re
import subprocess
import sys

from arms import Arm, BEGIN, RIGHT, S, WRONG
from environment import on_linux, on_unix
from processes import TIMEOUT, tool_without_ros
import pytest

from dummy_arm.grading.arm_check import FRAMES, NOT_JUDGED
from dummy_arm.tools.check_arm import Grade, grade, main


def test_a_bag(tmp_path, capsys):
    """The table has a line for each requirement, with what was measured."""
    bags = pytest.importorskip('bags')
    path = bags.make(tmp_path, 'mcap', Arm().messages())
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


def test_a_bag_of_a_wrong_arm(tmp_path, failed):
    """The cause stands below its line, the exit code is 1; no ROS is needed."""
    bags = pytest.importorskip('bags')
    path = bags.make(tmp_path, 'mcap', (
        ('/robot' + topic, time, rows)
        for topic, time, rows in WRONG['a little too far'][0].messages()))
    done = subprocess.run(
        [sys.executable, *tool_without_ros(
            'check_arm', '--bag', str(path), '--namespace', 'robot')],
        capture_output=True, encoding='utf-8', check=False, env={**os.environ, 'PYTHONUTF8': '1'})
    assert done.returncode == 1
    assert re.search(
        r'not ok +joint_2 stays within ±30° +-33\.0° to 33\.0°\n'
        r'    The limit is exceeded by 3\.0°\. .*\n', done.stdout)
    assert done.stdout.endswith('not passed: 22 ok, 1 not ok, 1 not judged\n')
    assert failed(main, '--bag', str(path))[0] == 1  # nothing is on /tf


def test_a_bag_whose_messages_are_not_in_order(tmp_path, capsys):
    """As in the file of a ROS 1 bag; they are judged in the order of their times."""
    bags = pytest.importorskip('bags')
    # The last messages of joint_2 come first.
    messages = sorted(RIGHT['a message for each frame'].messages(), key=lambda message: (
        message[2][0].child_frame_id != 'joint_2' or message[1] < BEGIN + 20 * S))
    path = bags.make(tmp_path, 'bag', messages)
    assert main(['--bag', str(path)]) == 0
    assert capsys.readouterr().out.endswith('passed: 23 ok, 1 not judged\n')


def test_a_bag_without_times_or_with_damage(tmp_path, capsys):
    """Stamps are not judged without times; a message that cannot be decoded is left out."""
    bags = pytest.importorskip('bags')
    messages = [(topic, 0, rows) for topic, _, rows in Arm().messages()]
    path = bags.make(tmp_path, 'mcap', [*messages, ('/tf', 0, b'nonsense')])
    assert main(['--bag', str(path)]) == 1
    output = capsys.readouterr().out
    assert 'The bag has no times.' in output
    assert output.endswith('not passed: 22 ok, 2 not judged\n')


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
    """Exit code 2, and one line."""
    code, error = failed(main, *arguments)
    assert code == 2
    assert text in error
    assert error.count('\n') == 1


def test_a_bag_that_does_not_exist(failed):
    """Exit code 1, and one line that names the bag."""
    code, error = failed(main, '--bag', 'missing')
    assert code == 1
    assert re.fullmatch(r'check_arm: .*missing.*\n', error)


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


def test_without_pypdf(failed, monkeypatch):
    """The remedy is named."""
    monkeypatch.setitem(sys.modules, 'pypdf', None)
    code, error = failed(main, '--frames', 'frames.pdf')
    assert code == 1
    assert error.startswith(
        'check_arm: pypdf is needed to read a PDF: apt install python3-pypdf, or pip')


@on_linux
@pytest.mark.parametrize(('middleware', 'silence', 'reason'), [
    ('while True:\n    pass\n', 2.0, 'has said nothing for 2 s: probably the middleware hangs.'),
    ('import os\nos.kill(os.getpid(), 11)\n', TIMEOUT, 'ended by signal 11.')],
    ids=['hangs', 'crashes'])
def test_an_observer_that_fails(tmp_path, monkeypatch, middleware, silence, reason):
    """
    The program is not judged, since it is not to blame; the others are.

    The observer imports nothing from the folder of the programs, which is the current one.
    """
    (tmp_path / 'rclpy').mkdir()
    (tmp_path / 'rclpy' / '__init__.py').write_text(middleware)
    monkeypatch.syspath_prepend(tmp_path)
    handed_in = tmp_path / 'handed_in'
    handed_in.mkdir()
    for name in 'arm.py', 'json.py':
        (handed_in / name).write_text('raise SystemExit')
    monkeypatch.chdir(handed_in)
    assert grade('arm.py', 1.0, silence=silence) == Grade(
        'arm.py', None, f'The process that observes it {reason}', NOT_JUDGED)
