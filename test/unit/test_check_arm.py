"""The command check_arm where there is no ROS: bags, drawings, wrong use."""

from contextlib import suppress
from itertools import pairwise
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
from typing import Any
from xml.etree import ElementTree

from arms import Arm, changed, hand, WRONG
from environment import code_without, on_linux, ROS
from hand_ins import read_table
import numpy as np
from processes import tool_without, tool_without_ros
import pytest

from dummy_arm.check_arm import main
from dummy_arm.grading import grade
from dummy_arm.grading.picture import picture
from dummy_arm.grading.records import Grade, Verdict
from dummy_arm.grading.sheet import FRAMES
from puretf import TransformBuffer, TransformException


def test_a_bag(bags, tmp_path, capsys):
    """The table has a line for each requirement, with what was measured."""
    path = bags.make(tmp_path, 'mcap', Arm().messages())
    assert main(['--bag', str(path)]) == 0
    output, error = capsys.readouterr()
    lines = output.splitlines()
    assert lines[0] == (
        'ok          all transforms are valid                      2005 transforms')
    assert 'ok          joint_1 is 0.3 m along z from base_link       (0.000, 0.000, 0.300) m' in (
        lines)
    assert ('not judged  base_link reaches a late listener             This was not observed.'
            ) in lines
    assert ('ok          the joints have three different speeds        0.30, 0.50, 0.70 rad/s '
            '(phase)') in lines
    assert lines[-1] == 'passed: 23 ok, 1 not judged (base_link reaches a late listener)'
    assert not error


def test_a_bag_of_a_wrong_arm(bags, tmp_path, failed):
    """The cause stands below its line, the exit code is 1; no ROS is needed."""
    path = bags.make(tmp_path, 'mcap', (
        ('/robot' + topic, time, rows)
        for topic, time, rows in WRONG['joint_2 stays']['exceeded by 3.0°'].messages()))
    done = subprocess.run(
        [sys.executable, *tool_without_ros(
            'check_arm', '--bag', str(path), '--namespace', 'robot')],
        capture_output=True, encoding='utf-8', check=False, env={**os.environ, 'PYTHONUTF8': '1'})
    assert done.returncode == 1
    assert re.search(
        r'not ok +joint_2 stays within ±30° +-33\.0° to 33\.0°\n'
        r'    The limit is exceeded by 3\.0°\. .*\n', done.stdout)
    assert done.stdout.endswith('not passed: 22 ok, 1 not ok, 1 not judged (base_link reaches a '
                                'late listener)\n')
    assert failed(main, '--bag', str(path))[0] == 1  # nothing is on /tf


def test_a_bag_without_times_or_with_damage(bags, tmp_path, capsys):
    """Stamps are not judged without times; a message that cannot be decoded is left out."""
    messages = [(topic, 0, rows) for topic, _, rows in Arm().messages()]
    path = bags.make(tmp_path, 'mcap', [*messages, ('/tf', 0, b'nonsense')])
    assert main(['--bag', str(path)]) == 1
    output = capsys.readouterr().out
    assert 'The bag has no times.' in output
    assert output.endswith('not passed: 22 ok, 2 not judged (the stamps are the current time, '
                           'base_link reaches a late listener)\n')


def buffer_of(arm):
    """Return a buffer with the transforms of an arm that tf2 accepts."""
    buffer = TransformBuffer(None)
    for topic, _, rows in arm.messages():
        for row in rows:
            with suppress(ValueError):
                buffer.insert(row.stamp_ns, row.frame_id, row.child_frame_id, row.pose,
                              is_static=topic == '/tf_static')
    return buffer


def lines_of(svg):
    """Return the points of each line of a picture."""
    return [np.array([point.split(',') for point in line.get('points', '').split()], float)
            for line in svg.iterfind('{*}polyline')]


def test_the_picture():
    """It has the path of the hand, the limits of the joints, and a grid with its coordinates."""
    buffer = buffer_of(Arm())
    svg = ElementTree.fromstring(picture(buffer))
    path, *edges = lines_of(svg)
    ends = hand(buffer.path_stamps('map', 'end_effector'))[:, :2] * [1, -1]
    np.testing.assert_allclose(path, ends, atol=1e-3)
    assert edges[-1][-1].tolist() == path[-1].tolist()
    texts = [(each.text or '', float(each.get('x', '')), float(each.get('y', '')))
             for each in svg.iterfind('{*}text')]
    left, _, width, _ = map(float, svg.get('viewBox', '').split())
    font = 0.6 * float(svg.get('font-size', ''))  # about the mean width of a character
    assert all(left <= x and x + font * len(text) <= left + width for text, x, _ in texts)
    assert [text for text, _, _ in texts if not text.endswith(' m')] == [
        'joint_1 ±45°', 'joint_2 ±30°', 'joint_3 ±60°', 'end_effector']
    grid = [(float(text[:-2]), x, -y) for text, x, y in texts if text.endswith(' m')]
    assert all(value in (x, y) for value, x, y in grid)
    assert {value > 0.0 for value, _, _ in grid} == {True, False}


@pytest.mark.parametrize(('arm', 'parents'), [
    (Arm(), FRAMES[:5]),
    (WRONG['the tree']['The parent of joint_3 must be joint_2, not joint_1'],
     ('map', 'base_link', 'joint_1', 'joint_1', 'joint_3'))])
def test_the_edges_of_a_picture(arm, parents):
    """Each frame is joined to its parent, right or wrong."""
    _, *edges = lines_of(ElementTree.fromstring(picture(buffer_of(arm))))
    places = {'map': [0.0, 0.0], **{name: end.tolist() for name, (_, end) in zip(
        FRAMES[1:], edges)}}
    assert [begin.tolist() for begin, _ in edges] == [places[name] for name in parents]


@pytest.mark.parametrize('arm', [
    *WRONG['the tree'].values(), *WRONG['base_link is on /tf_static'].values(),
    changed(topics=('/tf_static',) * 5), changed(positions=((0.0, 0.0, 0.0),) * 5),
    changed(positions=(*Arm.positions[:4], (float('inf'), 0.0, 0.0)))])
def test_a_picture_of_any_arm(arm):
    """It is drawn, or an error of TF says why it is not."""
    with suppress(TransformException):
        assert 'nan' not in picture(buffer_of(arm))


EDGE = ('"{}" -> "{}"[label=" Broadcaster: default_authority\\nAverage rate: 50.2\\nBuffer '
        'length: 4.9\\nMost recent transform: 1.1\\nOldest transform: 0.1\\n"];')
CHAIN = [*pairwise(FRAMES)]


def as_tf2_writes_it(edges):
    """Return a graph as the view_frames of tf2 writes it."""
    return '\n'.join([
        'digraph G {', *(EDGE.format(*edge) for edge in edges), 'edge [style=invis];',
        ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";',
        '"Recorded at time: 1718889.2"[ shape=plaintext ] ;', f'}}->"{FRAMES[0]}";', '}'])


@pytest.mark.parametrize(('edges', 'fault'), [
    (CHAIN, ''), (CHAIN[:4], "Missing: 'end_effector'."),
    ([*CHAIN, ('map', 'moving_frame')], "Other frames: 'moving_frame'."),
    ([*CHAIN[:3], ('joint_2', 'jiont_3'), ('jiont_3', 'end_effector')],
     "'jiont_3' is misspelt: the name is joint_3."),
    ([*CHAIN[:4], ('map', 'hand')], "Missing: 'end_effector'. Other frames: 'hand'."),
    ([(FRAMES[min(i, 1)], child) for i, (_, child) in enumerate(CHAIN)],
     'joint_2 is not below joint_1')])
def test_a_drawing_of_tf2(tmp_path, capsys, edges, fault):
    """It shows the six names from top to bottom and no other."""
    pytest.importorskip('pypdf')
    path = tmp_path / 'frames.pdf'
    pytest.importorskip('pygraphviz').AGraph(string=as_tf2_writes_it(edges)).draw(
        str(path), prog='dot')
    assert main(['--frames', str(path)]) == bool(fault)
    assert capsys.readouterr().out.startswith(
        f'{path}: not ok: {fault}' if fault else f'{path}: ok\n')


def test_drawings_that_cannot_be_read(tmp_path, capsys, monkeypatch):
    """Several files can be checked at once; each gets its line with the reason."""
    pytest.importorskip('pypdf').PdfWriter().write(tmp_path / 'no_page.pdf')
    monkeypatch.chdir(tmp_path)
    Path('frames.gv').write_text(as_tf2_writes_it(CHAIN))
    reasons = {
        'missing.pdf': 'It cannot be read: No such file or directory.',
        f'{"x" * 300}.pdf': 'It cannot be read: File name too long.',
        'frames.gv': 'It is not a PDF with text that can be read.',
        'no_page.pdf': 'It is not a PDF with text that can be read.'}
    assert main(['--frames', *reasons]) == 1
    assert capsys.readouterr().out.splitlines() == [
        f'{name}: not ok: {reason}' for name, reason in reasons.items()]


def test_without_pypdf(capsys, monkeypatch):
    """The remedy is named."""
    monkeypatch.setitem(sys.modules, 'pypdf', None)
    assert main(['--frames', 'frames.pdf']) == 1
    assert capsys.readouterr().out == (
        'frames.pdf: not judged: pypdf is needed to read a PDF: apt install python3-pypdf, or pip '
        'install pypdf.\n')


@on_linux
def test_without_psutil(failed, monkeypatch):
    """The remedy is named; what runs no program does not need it."""
    pytest.importorskip('rclpy', reason='the first remedy is to install ROS')
    monkeypatch.setitem(sys.modules, 'psutil', None)
    assert failed(main, 'arm.py') == (
        1, 'check_arm: psutil is missing: pip install psutil, or apt install python3-psutil\n')
    code = f'{code_without(["psutil"])}import dummy_arm.check_arm, dummy_arm.grading.requirements'
    subprocess.run([sys.executable, '-c', code], check=True)


@on_linux
def test_programs_without_ros(tmp_path):
    """One line says what is missing, and no program is run; so does the error of `grade`."""
    path = tmp_path / 'arm.py'
    path.write_text('open("run", "w")')
    missing = [*ROS, 'psutil']
    code = f'{code_without(missing)}from dummy_arm.grading import grade\ngrade([{str(path)!r}])'
    by_command, by_function = (
        subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False,
                       cwd=tmp_path)
        for arguments in (tool_without(missing, 'check_arm', str(path)), ('-c', code)))
    assert (by_command.returncode, by_command.stdout) == (1, '')
    assert re.fullmatch('check_arm: this command needs ROS, but rclpy cannot be imported: .*\n',
                        by_command.stderr)
    assert by_function.stderr.splitlines()[-1].startswith(
        'ModuleNotFoundError: this needs ROS, but rclpy is not installed: ')
    assert [*tmp_path.iterdir()] == [path]


NO_TEXT = 'It is not text in UTF-8, but perhaps a PDF: hand in the '
LAUNCH = 'It is a launch file, which starts programs: hand in the program.'
UMLAUT = '# größer\n'
#: By name: the bytes of a hand-in, and the reason why it is not run.
REFUSED: dict[str, tuple[Any, str]] = {
    'umlaut.py': (UMLAUT.encode('latin-1'), NO_TEXT),
    'coding.py': (f'# coding: foo\n{UMLAUT}'.encode(), f'{NO_TEXT}source, a .py file, saved as '
                                                       'UTF-8 (unknown encoding: foo).'),
    'blank.py': (b'\n \n', 'It is empty.'),
    'long.py': (b'#' * 1_000_001, 'It has more than 1 MB.'),
    '=1+2': (b'print(\n', "It does not compile: line 1: '(' was never closed."),
    'arm.launch.xml': (b'<?xml version="1.0"?>\n<launch>\n</launch>\n', LAUNCH),
    'arm.launch.py': (b'import launch\ndef generate_launch_description():\n    pass\n', LAUNCH),
    'empty': ('folder', 'It is empty, or cannot be read.'),
    'folder': ('folder', 'It does not compile'),
    'with_report': ('folder', 'It does not compile')}


@on_linux
def test_hand_ins_that_are_not_run(tmp_path, monkeypatch, capsys):
    """Each has one line, one row and its feedback, with that on its frames.pdf."""
    monkeypatch.chdir(tmp_path)
    for name, (content, _) in REFUSED.items():
        if content == 'folder':
            Path(name).mkdir()
        else:
            Path(name).write_bytes(content)
    for name, program, drawing in (
            ('folder', 'src/dummy_arm/dummy_arm/dummy_arm.py', 'frames.pdf'),
            ('with_report', 'ros2_ws/src/dummy_arm/dummy_arm/dummy_arm.py',
             'report/frames.pdf')):
        for path in Path(name, program), Path(name, drawing):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text('print(')
    assert main([*REFUSED, *REFUSED, '--csv', 'grades.csv', '--feedback', 'feedback']) == 1
    lines = capsys.readouterr().out.splitlines()
    for name, (_, reason) in REFUSED.items():
        (line,) = [line for line in lines if line.startswith(f'{name}: not ok: {reason}')]
        drawing = 'not (ok|judged): .+' if name in ('folder', 'with_report') else 'missing'
        assert re.fullmatch(rf'{re.escape(line)}\n\nframes\.pdf: {drawing}\n',
                            (tmp_path / 'feedback' / f'{name}.txt').read_text())
    assert Path('grades.csv').read_bytes().startswith(
        b'\xef\xbb\xbf"file","verdict","reason","frames.pdf",')
    rows = read_table(Path('grades.csv'))
    assert [(row['file'], row['verdict']) for row in rows] == [
        ("'=1+2" if name == '=1+2' else name, 'not ok') for name in REFUSED]
    assert [row['file'] for row in rows if row['frames.pdf'].startswith('not ')] == [
        'folder', 'with_report']
    assert {row['frames.pdf'] for row in rows[:-2]} == {'missing'}


@on_linux
def test_a_hand_in_that_is_graded_again(tmp_path, monkeypatch):
    """Its row and its report are replaced, those of the others stay; a slash does not matter."""
    monkeypatch.chdir(tmp_path)
    options = '--csv', 'grades.csv', '--feedback', 'feedback'
    for name in 'ann', 'bob':
        Path(name).mkdir()
        Path(name, 'dummy_arm.py').write_text('print(')
    assert main(['ann', 'bob', *options]) == 1
    Path('ann', 'dummy_arm.py').write_text('')
    assert main(['./ann/', *options]) == 1
    assert [(row['file'], row['reason']) for row in read_table(Path('grades.csv'))] == [
        ('ann', 'It is empty.'), ('bob', "It does not compile: line 1: '(' was never closed.")]
    assert [(path.name, path.read_text()) for path in sorted(Path('feedback').rglob('*'))] == [
        ('ann.txt', 'ann: not ok: It is empty.\n\nframes.pdf: missing\n'),
        ('bob.txt', "bob: not ok: It does not compile: line 1: '(' was never closed.\n\n"
                    'frames.pdf: missing\n')]


@on_linux
@pytest.mark.parametrize('content', [
    b'', b'name,points\n', b'\xff', b'\xef\xbb\xbf"file","verdict"\n', 'a short row'])
def test_a_file_that_is_no_table(tmp_path, monkeypatch, capsys, failed, content):
    """It stays, and no program is run. Without it, there is a table."""
    monkeypatch.chdir(tmp_path)
    table = Path('grades.csv')
    if isinstance(content, str):
        main(['arm.py', '--csv', 'grades.csv'])
        content = table.read_bytes() + b'"arm.py"\n'
        capsys.readouterr()
    table.write_bytes(content)
    assert failed(main, 'arm.py', '--csv', 'grades.csv') == (
        1, 'check_arm: grades.csv does not have the columns of a table of check_arm: remove it, '
        'or name another file\n')
    assert table.read_bytes() == content
    table.unlink()
    main(['arm.py', '--csv', 'grades.csv'])
    assert len(read_table(table)) == 1


@on_linux
def test_the_names_of_reports(tmp_path, monkeypatch):
    """Each is the path from the working directory, and in the directory of the reports."""
    work = tmp_path / 'work'
    (work / 'in').mkdir(parents=True)
    monkeypatch.chdir(work)
    for files, names in {
            ('in/ann.py',): ['in/ann.py'], ('in/ann.py', 'bob.py'): ['bob.py', 'in/ann.py'],
            (str(work / 'in' / 'ann.py'),): ['in/ann.py'], ('../cid.py',): ['cid.py'],
            ('.',): ['work'], ('in/../../in',): ['in']}.items():
        assert main([*files, '--feedback', 'reports']) == 1
        assert sorted(str(path.relative_to('reports')) for path in Path('reports').rglob('*.txt')
                      ) == [f'{name}.txt' for name in names]
        shutil.rmtree('reports')


@on_linux
@pytest.mark.filterwarnings('ignore:Python 3.14 will')  # of tarfile
def test_a_hand_in_whose_arm_may_be_right(tmp_path):
    """A folder without dummy_arm.py, and what is not text, is not judged; each remedy helps."""
    def assert_not_judged(path, remedy):
        (result,) = grade([str(path)])
        assert (result.verdict, remedy in result.reason) == ('not judged', True)

    def assert_judged(path):
        (result,) = grade([str(path)])
        assert result.reason.startswith('It does not compile')

    program = tmp_path / 'ann' / 'dummy_arm (1).py'
    program.parent.mkdir()
    program.write_text('print(', encoding='utf-16')
    assert_not_judged(program, 'save it as text in UTF-8, a .py file')
    program.write_text('print(')
    assert_not_judged(program.parent, "'dummy_arm (1).py': unpack an archive, rename the program")
    assert_not_judged(program.parent, ', or give its path')
    assert_judged(program)
    program.rename(program.with_name('dummy_arm.py'))
    assert_judged(program.parent)
    for kind in 'zip', 'gztar':
        folder = tmp_path / kind
        archive = shutil.make_archive(str(folder / 'arm'), kind, program.parent)
        assert_not_judged(folder, f"{os.path.basename(archive)}': unpack an archive")
        assert_not_judged(archive, 'unpack it')
        shutil.unpack_archive(archive, folder)
        assert_judged(folder)
        (folder / 'ann').mkdir()
        (folder / 'dummy_arm.py').rename(folder / 'ann' / 'dummy_arm.py')
        assert_judged(folder)


@on_linux
@pytest.mark.parametrize(('program', 'file', 'hides'), [
    ('from json import loads', 'json.py', 'json'),
    ('import numpy; numpy.array', 'numpy.py', 'numpy'),
    ('import numpy.linalg', 'numpy/__init__.py', 'numpy'),
    ('import own; own.none', 'own.py', ''),
    ('import json; json.loads("?")', 'own.py', '')])
def test_a_file_that_hides_a_module(tmp_path, monkeypatch, program, file, hides):
    """It is named; a file of another name, or without the fault, is not."""
    if not hides:  # it can be imported here, too
        monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).touch()
    (tmp_path / 'arm.py').write_text(program)
    (grade_of_arm,) = grade([str(tmp_path / 'arm.py')], 1.0)
    assert grade_of_arm.reason.startswith('It fails: ')
    assert grade_of_arm.reason.partition(' (line 1): ')[2] == (
        f'{file} of the hand-in hides the module {hides}: rename it' if hides else '')


OF_ROS1 = ': it is of ROS 1; import rclpy, tf2_ros or tf_transformations'


@on_linux
@pytest.mark.parametrize(('program', 'reason'), [
    ('import rospy', f"'rospy' (line 1){OF_ROS1}"),
    ('import tf.transformations', f"'tf' (line 1){OF_ROS1}"),
    ('print(10**6 * 9 * "x")\n1 / 0', 'It fails: ZeroDivisionError: division by zero (line 2)'),
    ('import rclpy', 'does it call rclpy.spin?'),
    ('import rospy2', "'rospy2' (line 1)")])
def test_a_program_that_ends(tmp_path, program, reason):
    """Its error has a remedy where the cause is known."""
    (tmp_path / 'arm.py').write_text(program)
    (grade_of_arm,) = grade([str(tmp_path / 'arm.py')], 1.0)
    assert grade_of_arm.reason.endswith(reason)


@on_linux
def test_an_observer_that_crashes(tmp_path, monkeypatch):
    """
    The program is not judged, since it is not to blame; the others are.

    The observer imports nothing from the folder of the programs, which is the current one.
    """
    (tmp_path / 'rclpy').mkdir()
    (tmp_path / 'rclpy' / '__init__.py').write_text('import os\nos.abort()\n')
    monkeypatch.syspath_prepend(tmp_path)
    handed_in = tmp_path / 'handed_in'
    handed_in.mkdir()
    for name in 'arm.py', 'json.py', 'random.py':
        (handed_in / name).write_text('raise SystemExit')
    monkeypatch.chdir(handed_in)
    assert [*grade(['arm.py'], 1.0)] == [Grade(
        'arm.py', None, 'The process that runs and observes it ended by signal 6.',
        Verdict.NOT_JUDGED)]
