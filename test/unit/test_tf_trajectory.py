"""The command `tf_trajectory` with bags: poses over time, compared with the motion of the arm."""

from contextlib import nullcontext
import csv
from math import pi
import os
import re
import signal
import subprocess
import sys
import tracemalloc
from xml.etree import ElementTree

from arms import Arm, BEGIN, hand
from environment import on_unix
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from processes import tool_without_ros
import pytest

from puretf import bag as tf_bag
from puretf.rotations import euler_from_quaternion, quaternion_from_euler
from puretf_tools.commands import tf_trajectory

bags = pytest.importorskip('bags')
S = 10**9
MS = 10**6
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
POSE = ['stamp_ns', 'x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw', 'roll_rad', 'pitch_rad',
        'yaw_rad']
TWIST = ['vx_m_s', 'vy_m_s', 'vz_m_s', 'wx_rad_s', 'wy_rad_s', 'wz_rad_s']
SECONDS = 5  # of the bag
FRAMES = 'map', 'end_effector'


def read_csv(text):
    """Return the header, the stamps as integers, and the numbers."""
    header, *rows = csv.reader(text.splitlines())
    assert all(re.fullmatch(r'-?\d+', row[0]) for row in rows)
    return header, np.array([int(row[0]) for row in rows]), np.array(
        [[float(number) for number in row[1:]] for row in rows])


def assert_is_hand(stamps, numbers, begin=BEGIN, within=1e-9):
    """Compare the columns of a pose with the motion of the arm, at the same stamps."""
    expected = hand(stamps, begin)
    np.testing.assert_allclose(numbers[:, :3], expected[:, :3], rtol=0.0, atol=within)
    np.testing.assert_allclose(numbers[:, 7:10], expected[:, 3:], rtol=0.0, atol=within)
    half = expected[:, 5] / 2.0
    sign = np.sign(numbers[:, 6:7])
    zero = np.zeros(len(half))
    np.testing.assert_allclose(
        sign * numbers[:, 3:7], np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1),
        rtol=0.0, atol=within)


def bag_of(path, messages):
    """Write a bag, and return its path."""
    return str(bags.make(path, 'mcap', messages))


def bag_of_samples(path, *samples):
    """Write a bag with one message on /tf: stamp (s), parent, child, and the pose's first part."""
    return bag_of(path, [('/tf', S, [
        bags.row(round(stamp * S), parent, child, (*pose, *STILL[len(pose):]))
        for stamp, parent, child, *pose in samples])])


def rows_of(*edges):
    """Yield the messages of edges: the parent, the child, and the stamps (s), or None: static."""
    for parent, child, stamps in edges:
        for x, stamp in enumerate(stamps or [0.0]):
            yield '/tf_static' if stamps is None else '/tf', 100 * S + x, [
                bags.row(round(stamp * S), parent, child, (float(x), *STILL[1:]))]


@pytest.fixture(scope='module')
def arm_bag(tmp_path_factory):
    """A bag of the arm, with a stamp each 50 ms."""
    return bag_of(tmp_path_factory.mktemp('arm') / 'arm_bag', Arm().messages(SECONDS))


@pytest.fixture
def run(capsys):
    """Call the command by `run('argument', …)`; it must succeed. Return its stdout and stderr."""
    def call(*arguments):
        assert tf_trajectory.main([*arguments]) == 0
        return capsys.readouterr()

    return call


def test_a_bag_without_ros(arm_bag, tmp_path):
    """There is a row for each stamp, and the poses are those of the arm."""
    done = subprocess.run(
        [sys.executable, *tool_without_ros('tf_trajectory', '--bag', arm_bag, *FRAMES, '-o',
                                           'arm.csv')],
        cwd=tmp_path, text=True, capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (
        'wrote arm.csv: 101 rows from 1700000000.000000000 s to 1700000005.000000000 s\n', '')
    header, stamps, numbers = read_csv((tmp_path / 'arm.csv').read_text())
    assert header == POSE
    assert stamps.tolist() == [BEGIN + 50 * MS * i for i in range(101)]
    assert_is_hand(stamps, numbers)


def test_the_table_is_printed_and_the_summary_is_on_stderr(run, arm_bag, tmp_path):
    """So the table can be piped into another program."""
    output, error = run('--bag', arm_bag, *FRAMES)
    run('--bag', arm_bag, *FRAMES, '-o', f'{tmp_path}/arm.csv')
    assert output == (tmp_path / 'arm.csv').read_text()
    assert error == (
        'tf_trajectory: 101 rows from 1700000000.000000000 s to 1700000005.000000000 s\n')


def test_csv_loses_no_bit(run, arm_bag):
    """The numbers are exactly those of a lookup."""
    _, stamps, numbers = read_csv(run('--bag', arm_bag, *FRAMES)[0])
    positions, rotations, _ = tf_bag.read(arm_bag).lookup_transforms(*FRAMES, stamps)
    assert (numbers[:, :3] == positions).all()
    assert (numbers[:, 3:7] == rotations).all()


def test_the_file_of_evo(run, arm_bag, tmp_path):
    """Each line has the exact time in s, and the pose of the CSV file."""
    path = tmp_path / 'arm.tum'
    run('--bag', arm_bag, *FRAMES, '-o', str(path))
    _, stamps, numbers = read_csv(run('--bag', arm_bag, *FRAMES)[0])
    lines = [line.split(' ') for line in path.read_text().splitlines()]
    assert [time for time, *_ in lines] == [
        f'{stamp // S}.{stamp % S:09d}' for stamp in stamps.tolist()]
    assert [[*map(float, pose)] for _, *pose in lines] == numbers[:, :7].tolist()


def test_times_before_1970(run, tmp_path):
    """In the file of evo, the sign is that of the whole time."""
    bag = bag_of(tmp_path / 'bag', rows_of(('map', 'base', [-1.5, -0.25, 0.5])))
    path = tmp_path / 'base.tum'
    run('--bag', bag, 'map', 'base', '-o', str(path))
    assert [line.split()[0] for line in path.read_text().splitlines()] == [
        '-1.500000000', '-0.250000000', '0.500000000']


def test_arrays(run, arm_bag, tmp_path):
    """An .npz file has the columns of the CSV file."""
    path = tmp_path / 'arm.NPZ'
    run('--bag', arm_bag, *FRAMES, '--twist', '-o', str(path))
    _, stamps, numbers = read_csv(run('--bag', arm_bag, *FRAMES, '--twist')[0])
    with np.load(path) as arrays:
        assert {name: (array.dtype, array.shape[1:]) for name, array in arrays.items()} == {
            'stamps': (np.int64, ()), 'positions': (np.float64, (3,)),
            'quaternions': (np.float64, (4,)), 'rpy': (np.float64, (3,)),
            'linear': (np.float64, (3,)), 'angular': (np.float64, (3,))}
        assert (arrays['stamps'] == stamps).all()
        assert (np.hstack([arrays[name] for name in arrays if name != 'stamps']) == numbers).all()
    run('--bag', arm_bag, *FRAMES, '-o', str(path))
    with np.load(path) as arrays:
        assert [*arrays] == ['stamps', 'positions', 'quaternions', 'rpy']
        assert arrays['positions'].shape == (101, 3)


def test_velocities(run, arm_bag):
    """They are averages over 0.1 s; rows at the begin, where there is none, are left out."""
    output, error = run('--bag', arm_bag, *FRAMES, '--twist')
    header, stamps, numbers = read_csv(output)
    assert header == [*POSE, *TWIST]
    assert stamps.tolist() == [BEGIN + 50 * MS * i for i in range(1, 101)]
    expected = (hand(stamps + 50 * MS) - hand(stamps - 50 * MS)) / 0.1
    assert abs(numbers[:-1, 10:] - expected[:-1]).max() < 1e-9
    last = tf_bag.read(arm_bag).lookup_twist(*FRAMES, int(stamps[-1]), S // 10)
    assert numbers[-1, 10:].tolist() == np.ravel(last).tolist()
    assert '1 of 101 rows is left out, without a transform or a velocity; the first, at ' \
        '1700000000.000000000 s: there is no velocity: Lookup would require extrap' in error


def test_rows_at_equal_distances(run, arm_bag):
    """They begin with the first stamp, and are interpolated between the stamps."""
    _, stamps, numbers = read_csv(run('--bag', arm_bag, *FRAMES, '--every', '0.33')[0])
    assert stamps.tolist() == [BEGIN + 330 * MS * i for i in range(16)]
    assert_is_hand(stamps, numbers, within=1e-3)


def test_frames_may_begin_with_a_slash(run, arm_bag):
    """This holds in tf2_echo, too."""
    assert run('--bag', arm_bag, '/map', '/end_effector') == run('--bag', arm_bag, *FRAMES)


def test_the_stamps_are_those_of_edges_that_move(run, tmp_path):
    """Frames above and beside the path do not count."""
    bag = bag_of(tmp_path / 'bag', rows_of(
        ('map', 'odom', [1.0, 2.0, 3.0]), ('odom', 'base', [1.5, 2.5]), ('base', 'arm', None),
        ('base', 'wheel', [1.75]), ('earth', 'map', [0.5])))
    output, _ = run('--bag', bag, 'map', 'arm')
    assert read_csv(output)[1].tolist() == [3 * S // 2, 2 * S, 5 * S // 2]


def test_rows_without_a_transform_are_left_out_and_counted(run, tmp_path):
    """The line names the number, the first of them, and the reason."""
    bag = bag_of(tmp_path / 'bag', rows_of(
        ('map', 'odom', [1.0, 1.5, 2.0, 3.0]), ('odom', 'base', [1.75, 2.5, 4.0])))
    output, error = run('--bag', bag, 'map', 'base')
    _, stamps, numbers = read_csv(output)
    assert stamps.tolist() == [1750 * MS, 2 * S, 2500 * MS, 3 * S]
    assert np.isfinite(numbers).all()
    summary, line = error.splitlines()
    assert '4 rows from 1.750000000 s to 3.000000000 s' in summary
    assert line.startswith(
        'tf_trajectory: 3 of 7 rows are left out, without a transform; the first, at '
        '1.000000000 s: '
        'Lookup would require extrapolation into the past.')
    assert "edge 'odom' -> 'base' are from 1.750000000 to 4.000000000 and begin 0.75" in line
    _, error = run('--bag', bag, 'map', 'base', '--every', '0.0001')  # more than one part
    assert '12501 rows from 1.750000000 s to 3.000000000 s' in error
    assert '17500 of 30001 rows are left out, without a transform; the first, at 1.00' in error


@pytest.mark.parametrize('output', [[], ['-o', 'x.npz'], ['-o', 'x.svg']])
def test_no_row_has_a_transform(failed, monkeypatch, tmp_path, output):
    """The error names the first reason, and no file is written."""
    if 'x.svg' in output:
        pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    bag = bag_of(tmp_path / 'bag', rows_of(('map', 'odom', [1.0]), ('odom', 'base', [2.0])))
    code, line = failed(tf_trajectory.main, '--bag', bag, 'map', 'base', *output)
    assert code == 1
    assert re.fullmatch('tf_trajectory: no row has a transform; the first of 2, at '
                        r'1\.000000000 s: .*extrapolation.*\n', line)
    assert [path.name for path in tmp_path.iterdir()] == ['bag']


def test_a_stamp_of_zero_is_left_out(run, tmp_path):
    """A lookup at 0 would return the latest transform."""
    bag = bag_of(tmp_path / 'bag', rows_of(('map', 'base', [-1.0, 0.0, 1.0, 2.0])))
    output, error = run('--bag', bag, 'map', 'base')
    _, stamps, numbers = read_csv(output)
    assert stamps.tolist() == [-S, S, 2 * S]
    assert numbers[:, 0].tolist() == [0.0, 2.0, 3.0]
    assert '1 of 4 rows is left out, without a transform; the first, at 0.0000000' \
        '00 s: the stamp is ' \
        '0, and a lookup' in error


def test_numbers_that_overflow_are_left_out(run, tmp_path):
    """The table has neither NaN nor infinity."""
    bag = bag_of_samples(tmp_path / 'bag', *(
        (i, *edge, x) for edge in ('ab', 'bc') for i, x in ((1, 1.0), (2, 1.5e308))))
    output, error = run('--bag', bag, 'a', 'c')
    assert read_csv(output)[1].tolist() == [S]
    assert error.endswith('at 2.000000000 s: a number is too large for a float64\n')


def test_a_parent_that_changes(run, tmp_path):
    """A cup on a table is taken by a hand; its rows follow the path at each time."""
    bag = bag_of_samples(
        tmp_path / 'bag', *((i, 'map', 'table') for i in (1, 8)),
        *((i, 'map', 'hand', float(i)) for i in range(1, 9)),
        *((i, 'table', 'cup', 9.0) for i in (1, 3)),
        *((i, 'hand', 'cup', 0.25) for i in (4.5, 6.5)))
    _, stamps, numbers = read_csv(run('--bag', bag, 'map', 'cup')[0])
    assert dict(zip((stamps / S).tolist(), numbers[:, 0].tolist())) == {
        1.0: 9.0, 3.0: 9.0, 4.5: 4.75, 5.0: 5.25, 6.0: 6.25, 6.5: 6.75}


@pytest.mark.parametrize(('target', 'text'), [
    ('map', "'odom' never moves in 'map': there is no dynamic transform between them. Print its "
     'pose with tf2_echo'), ('odom', 'both frames are the same')])
def test_frames_that_do_not_move(failed, tmp_path, target, text):
    """The error says so, and which command prints the pose."""
    bag = bag_of(tmp_path / 'bag', bags.walk())
    for every in [], ['--every', '1']:
        assert failed(tf_trajectory.main, '--bag', bag, target, 'odom', *every) == (
            1, f'tf_trajectory: {text}\n')


@given(st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(
    x * x for x in q) > 1e-6), min_size=1))
def test_angles_are_those_of_rotations(quaternions):
    """They are computed for many rotations at once."""
    given = np.array(quaternions) / np.linalg.norm(quaternions, axis=1, keepdims=True)
    difference = tf_trajectory.roll_pitch_yaw(given) - [
        euler_from_quaternion(quaternion) for quaternion in given.tolist()]
    assert abs(np.exp(1j * difference) - 1.0).max() < 1e-7


@pytest.mark.parametrize(('given', 'expected', 'within'), [
    # At gimbal lock, the yaw is 0, as in tf2_echo.
    ((0.3, pi / 2, 0.2), [0.1, pi / 2, 0.0], 1e-12),
    ((0.3, -pi / 2, 0.2), [0.5, -pi / 2, 0.0], 1e-12),
    *((angles, [*angles], 1e-15) for angle in (0.0, pi / 2, pi, -pi / 2, 3.0, -3.0)
      for angles in ((angle, 0.0, 0.0), (0.0, 0.0, angle)))], ids=str)
def test_angles_of_single_rotations(given, expected, within):
    """They are in (-pi, pi], for both signs of the quaternion; a table has no -0.0."""
    quaternion = np.array([quaternion_from_euler(*given)])
    for each in quaternion, -quaternion:
        (angles,) = tf_trajectory.roll_pitch_yaw(each)
        assert angles.tolist() == pytest.approx(expected, abs=within)
        assert not np.signbit(angles[angles == 0.0]).any()


def test_a_drawing_in_svg(run, arm_bag, tmp_path):
    """The ending is the format."""
    pytest.importorskip('matplotlib')
    path = tmp_path / 'arm.svg'
    output, _ = run('--bag', arm_bag, *FRAMES, '--twist', '-o', str(path))
    assert output.startswith(f'wrote {path}: 100 rows')
    assert ElementTree.parse(path).getroot().tag.endswith('svg')


def test_odd_names_are_drawn_as_they_are(run, tmp_path):
    """A name may look like a formula, or have control characters."""
    pytest.importorskip('matplotlib')
    pypdf = pytest.importorskip('pypdf')
    names = 'a$b_1$', '\\frac{\x1b'
    bag = bag_of(tmp_path / 'bag', rows_of((*names, [1.0])))
    run('--bag', bag, *names, '-o', str(tmp_path / 'odd.pdf'))
    (page,) = pypdf.PdfReader(tmp_path / 'odd.pdf').pages
    assert '\\frac{\\x1b in a$b_1$' in page.extract_text()


@pytest.fixture
def drawn(monkeypatch):
    """The figures of matplotlib, which are not written to files."""
    figure = pytest.importorskip('matplotlib.figure')
    figures = []

    def savefig(self, file, **_):
        figures.append(self)
        file.write(b'a drawing')

    monkeypatch.setattr(figure.Figure, 'savefig', savefig)
    return figures


def texts(figure):
    """Return the texts in a figure."""
    from matplotlib.text import Text
    return {text.get_text() for text in figure.findobj(Text)}


def test_a_drawing_says_what_it_shows(run, drawn, arm_bag, tmp_path):
    """The title names the frames; axes have units; each line has its name."""
    path = str(tmp_path / 'arm.png')
    run('--bag', arm_bag, *FRAMES, '--twist', '-o', path)
    run('--bag', arm_bag, *FRAMES, '-o', path)
    assert texts(drawn[0]) >= {
        'end_effector in map', 'position (m)', 'angle (°)', 'velocity (m/s)',
        'angular velocity\n(rad/s)', 'time (s), from 1700000000.050000000 s', 'x (m)', 'y (m)',
        'path from above', 'start', 'end', 'x', 'y', 'z', 'roll', 'pitch', 'yaw'}
    assert 'angle (°)' in texts(drawn[1])
    assert 'velocity (m/s)' not in texts(drawn[1])
    assert (tmp_path / 'arm.png').read_bytes() == b'a drawing'


def test_a_drawing_shows_the_rows(run, drawn, arm_bag, tmp_path):
    """They are those of the table, angles in degrees. The ends of the path are marked."""
    run('--bag', arm_bag, *FRAMES, '--twist', '-o', str(tmp_path / 'arm.png'))
    _, stamps, numbers = read_csv(run('--bag', arm_bag, *FRAMES, '--twist')[0])
    panels, above = drawn[0].axes[:-1], drawn[0].axes[-1]
    shown = np.array([line.get_ydata()[1:] for axes in panels for line in axes.lines])
    expected = np.delete(numbers, range(3, 7), axis=1)
    expected[:, 3:6] *= 180.0 / pi
    np.testing.assert_allclose(shown, expected.T, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(panels[0].lines[0].get_xdata()[1:], (stamps - stamps[0]) / S)
    path, start, end = (line.get_xydata() for line in above.lines)
    np.testing.assert_allclose(path[1:], numbers[:, :2])
    np.testing.assert_allclose([start[0], end[0]], numbers[[0, -1], :2])


def test_a_drawing_of_many_rows_has_some_of_them(run, drawn, monkeypatch, arm_bag, tmp_path):
    """The title and the summary say so."""
    monkeypatch.setattr(tf_trajectory, 'MAX_DRAWN', 20)
    output, _ = run('--bag', arm_bag, *FRAMES, '-o', str(tmp_path / 'arm.png'))
    assert 'end_effector in map, one of 6 rows' in texts(drawn[0])
    assert output.endswith(': 17 rows from 1700000000.000000000 s to 1700000004.800000000 s, of '
                           '101 rows one of 6\n')


def test_the_line_of_an_angle_does_not_jump(run, drawn, tmp_path):
    """Between 180 and -180 degrees there is a gap; so there is where rows are left out."""
    bag = bag_of_samples(tmp_path / 'bag', *(
        (i, 'map', 'top', *STILL[:3], *quaternion_from_euler(0.0, 0.0, float(i)))
        for i in range(-2, 8)))
    run('--bag', bag, 'map', 'top', '-o', str(tmp_path / 'top.png'))
    (yaw,) = (line for line in drawn[0].axes[1].lines if line.get_label() == 'yaw')
    angles = np.degrees([-2.0, -1.0, np.nan, 1.0, 2.0, 3.0, np.nan, *np.arange(4.0, 8.0) - 2 * pi])
    np.testing.assert_allclose(yaw.get_ydata(), angles)
    assert yaw.get_xdata()[[0, 1, 3, 7]].tolist() == [0.0, 1.0, 3.0, 6.0]


@pytest.mark.parametrize(('x', 'ending'), [(1.01e300, 'png'), (-1.7e308, 'pdf')])
def test_a_pose_that_is_too_large_to_draw(failed, run, there, ending, x):
    """The line names the frames, the number and the remedy; a table can be written."""
    pytest.importorskip('matplotlib')
    bag = bag_of_samples(
        there.parent / 'bag', (1, 'map', 'base', 0.0, 1.0), (2, 'map', 'base', 0.0, x))
    assert failed(tf_trajectory.main, '--bag', bag, 'map', 'base', '-o', f'x.{ending}') == (
        1, f"tf_trajectory: the pose of 'base' in 'map' is too large to draw: y_m is {x:g} at "
        '2.000000000 s, and the limit is 1e+300. Write a table (.csv, .tum, .npz)\n')
    assert not [*there.iterdir()]
    assert run('--bag', bag, 'map', 'base')[0].count('\n') == 3


@pytest.mark.filterwarnings('error')
def test_the_largest_poses_that_are_drawn(run, there):
    """There is neither an error nor a warning."""
    pytest.importorskip('matplotlib')
    bag = bag_of_samples(
        there.parent / 'bag', (1, 'map', 'base', -1e300, 1e300), (2, 'map', 'base', 1e300, -1e300))
    run('--bag', bag, 'map', 'base', '-o', 'x.png')
    assert (there / 'x.png').read_bytes().startswith(b'\x89PNG')


def test_no_backend_of_matplotlib_is_needed(arm_bag, there):
    """No window is opened, so the variable that chooses one does not matter; here for one row."""
    pytest.importorskip('matplotlib')
    done = subprocess.run(
        [sys.executable, *tool_without_ros('tf_trajectory', '--bag', arm_bag, *FRAMES, '--every',
                                           '10', '-o', 'arm.PNG')],
        env={**os.environ, 'MPLBACKEND': 'module://nowhere'}, text=True, capture_output=True,
        check=True)
    assert done.stderr == ''
    assert done.stdout.startswith('wrote arm.PNG: 1 row from ')
    assert (there / 'arm.PNG').read_bytes().startswith(b'\x89PNG')


def test_a_format_whose_backend_is_missing(failed, monkeypatch, there):
    """The error has the remedy and comes before the bag is read."""
    backend_bases = pytest.importorskip('matplotlib.backend_bases')

    def fail(name):
        raise ImportError(f'no backend_{name}')

    monkeypatch.setattr(backend_bases, 'get_registered_canvas_class', fail)
    code, line = failed(tf_trajectory.main, '--bag', 'nowhere', *FRAMES, '-o', 'arm.svg')
    assert code == 1
    assert re.fullmatch('tf_trajectory: drawing needs matplotlib, which cannot be imported .*'
                        'no backend_svg.*: pip install matplotlib; .*\n', line)


def test_without_matplotlib(failed, monkeypatch, run, arm_bag, tmp_path):
    """The error has the remedy and comes before the bag is read; tables are written."""
    for name in [*sys.modules]:
        if name.startswith('matplotlib'):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'matplotlib', None)
    code, line = failed(tf_trajectory.main, '--bag', 'nowhere', *FRAMES, '-o', 'arm.png')
    assert code == 1
    assert re.fullmatch('tf_trajectory: drawing needs matplotlib, which cannot be imported .*: '
                        'pip install matplotlib; .*\n', line)
    run('--bag', arm_bag, *FRAMES, '-o', str(tmp_path / 'arm.npz'))


def test_too_many_rows(failed, arm_bag, tmp_path):
    """The error names an interval that is possible."""
    code, line = failed(tf_trajectory.main, '--bag', arm_bag, *FRAMES, '--every', '1e-7', '-o',
                        str(tmp_path / 'x.csv'))
    assert code == 2
    assert line == ('tf_trajectory: --every 1e-07 would give 50000001 rows, and at most 10000000 '
                    'are possible: choose at least 5.2e-07 s\n')


@pytest.mark.parametrize(('arguments', 'why'), [
    (('map', 'end_efector'), "does not exist. Nearest known: 'end_effector'"),
    (('mars', 'end_effector'), '"mars" passed to lookupTransform argument target_frame does not'),
    (('camera', 'lens'), '"camera" passed to'),
    (('--namespace', 'robot', *FRAMES), 'robot')])
def test_what_a_bag_does_not_have(failed, arm_bag, arguments, why):
    """The exit code is 1; the error says what the bag contains instead."""
    code, error = failed(tf_trajectory.main, '--bag', arm_bag, *arguments)
    assert code == 1
    assert why in error
    assert error.count('\n') == 1


def test_frames_that_are_not_connected(failed, tmp_path):
    """The error names the roots of the two trees."""
    bag = bag_of(tmp_path / 'bag', rows_of(('map', 'base', [1.0]), ('earth', 'moon', [1.0])))
    code, error = failed(tf_trajectory.main, '--bag', bag, 'map', 'moon')
    assert code == 1
    assert "Could not find a connection between 'map' and 'moon'" in error
    assert "'earth'" in error


@pytest.fixture
def there(tmp_path, monkeypatch):
    """A directory of its own, which is the working directory."""
    there = tmp_path / 'there'
    there.mkdir()
    monkeypatch.chdir(there)
    return there


@on_unix
@pytest.mark.parametrize('ending', ['csv', 'npz', 'pdf'])
def test_a_full_disk(failed, arm_bag, there, ending):
    """There is no partial file, and an old file stays."""
    if ending == 'pdf':
        pytest.importorskip('matplotlib')
    import resource
    (there / f'arm.{ending}').write_text('old')
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, before[1]))
    try:
        outcome = failed(tf_trajectory.main, '--bag', arm_bag, *FRAMES, '-o', f'arm.{ending}')
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert outcome == (1, f'tf_trajectory: cannot write arm.{ending}: File too large\n')
    assert [path.name for path in there.iterdir()] == [f'arm.{ending}']
    assert (there / f'arm.{ending}').read_text() == 'old'


@pytest.mark.parametrize(('ending', 'every'), [
    ('csv', ['--every', '0.0005']), ('npz', ['--every', '0.0005']), ('png', [])])
def test_a_signal_leaves_no_partial_file(failed, monkeypatch, arm_bag, there, ending, every):
    """It is noticed between parts of many rows, and at the end. An old file stays."""
    if ending == 'png':
        pytest.importorskip('matplotlib')
    convert = tf_trajectory.roll_pitch_yaw
    parts: list[int] = []

    def interrupt(quaternions):
        if not parts:
            signal.raise_signal(signal.SIGTERM)
        parts.append(len(quaternions))
        return convert(quaternions)

    monkeypatch.setattr(tf_trajectory, 'roll_pitch_yaw', interrupt)
    (there / f'arm.{ending}').write_text('old')
    outcome = failed(tf_trajectory.main, '--bag', arm_bag, *FRAMES, *every, '-o', f'arm.{ending}')
    assert outcome == (143, 'tf_trajectory: ended early by SIGTERM\n')
    (count,) = parts
    assert count < 10_001 if every else count == 101
    assert [path.name for path in there.iterdir()] == [f'arm.{ending}']
    assert (there / f'arm.{ending}').read_text() == 'old'


def test_rows_are_written_before_the_next_are_looked_up(run, monkeypatch, arm_bag, there):
    """So the memory is that of a part of the rows; the bar shows how many have been looked up."""
    convert = tf_trajectory.roll_pitch_yaw
    sizes: list[int] = []

    def look(quaternions):
        sizes.append(sum(path.stat().st_size for path in there.iterdir()))
        return convert(quaternions)

    shown: list[int] = []
    monkeypatch.setattr(tf_trajectory, 'progress', lambda *_, **__: nullcontext(shown.append))
    monkeypatch.setattr(tf_trajectory, 'roll_pitch_yaw', look)
    output, _ = run('--bag', arm_bag, *FRAMES, '--every', '0.0002', '-o', 'arm.csv')
    assert output == ('wrote arm.csv: 25001 rows from 1700000000.000000000 s to '
                      '1700000005.000000000 s\n')
    assert len(sizes) > 2
    assert sizes == sorted({*sizes})
    assert len(shown) == len(sizes)
    assert shown[-1] == 25_001
    assert (there / 'arm.csv').read_text().count('\n') == 25_002


def test_arrays_of_many_rows(run, tmp_path):
    """The memory is that of the times and of a part of the rows: less than the file."""
    bag = bag_of(tmp_path / 'bag', rows_of(('map', 'base', [1.0, 21.0])))
    path = tmp_path / 'base.npz'
    run('--bag', bag, 'map', 'base', '-o', str(path))  # this finishes late imports
    tracemalloc.start()
    try:
        run('--bag', bag, 'map', 'base', '--every', '0.0001', '-o', str(path))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    with np.load(path) as arrays:
        assert (arrays['stamps'] == S + np.arange(200_001) * MS // 10).all()
        assert abs(arrays['positions'][:, 0] - np.arange(200_001) * 5e-6).max() < 1e-9
    assert peak < path.stat().st_size
