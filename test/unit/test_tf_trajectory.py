"""The command `tf_trajectory` with bags: poses over time, compared with the motion of the arm."""

import csv
from math import pi
import os
import re
import signal
import subprocess
import sys

from arms import Arm, BEGIN, hand
import numpy as np
from processes import tool_without_ros
import pytest

from puretf import bag as tf_bag
from puretf import TransformBuffer
from puretf.rotations import quaternion_from_euler
from puretf_tools.commands import tf_trajectory

bags = pytest.importorskip('bags')
typesys = pytest.importorskip('rosbags.typesys')
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


def test_the_table(run, arm_bag, monkeypatch, tmp_path):
    """There is a row for each stamp, and the poses are those of the arm; in a file, or printed."""
    monkeypatch.chdir(tmp_path)
    summary = '101 rows from 1700000000.000000000 s to 1700000005.000000000 s\n'
    assert run('--bag', arm_bag, *FRAMES, '-o', 'arm.csv') == (f'wrote arm.csv: {summary}', '')
    text = (tmp_path / 'arm.csv').read_text()
    assert run('--bag', arm_bag, *FRAMES) == (text, f'tf_trajectory: {summary}')
    header, stamps, numbers = read_csv(text)
    assert header == POSE
    assert stamps.tolist() == [BEGIN + 50 * MS * i for i in range(101)]
    assert_is_hand(stamps, numbers)


def test_the_file_of_evo(run, arm_bag, tmp_path):
    """Each line has the exact time in s, and the pose of the CSV file."""
    path = tmp_path / 'arm.tum'
    run('--bag', arm_bag, *FRAMES, '-o', str(path))
    _, stamps, numbers = read_csv(run('--bag', arm_bag, *FRAMES)[0])
    lines = [line.split(' ') for line in path.read_text().splitlines()]
    assert [time for time, *_ in lines] == [
        f'{stamp // S}.{stamp % S:09d}' for stamp in stamps.tolist()]
    assert [[*map(float, pose)] for _, *pose in lines] == numbers[:, :7].tolist()


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


def test_the_stamps_are_those_of_edges_that_move(run, tmp_path):
    """Frames above and beside the path do not count."""
    bag = bag_of(tmp_path / 'bag', rows_of(
        ('map', 'odom', [1.0, 2.0, 3.0]), ('odom', 'base', [1.5, 2.5]), ('base', 'arm', None),
        ('base', 'wheel', [1.75]), ('earth', 'map', [0.5])))
    output, _ = run('--bag', bag, 'map', 'arm')
    assert read_csv(output)[1].tolist() == [3 * S // 2, 2 * S, 5 * S // 2]


def test_stamps_outside_of_the_data_are_counted(run, tmp_path):
    """The line names the edges that begin last and end first, and how much is left out."""
    bag = bag_of(tmp_path / 'bag', rows_of(
        ('map', 'odom', [1.0, 1.5, 2.0, 3.0]), ('odom', 'base', [1.75, 2.5, 4.0])))
    output, error = run('--bag', bag, 'map', 'base')
    _, stamps, numbers = read_csv(output)
    assert stamps.tolist() == [1750 * MS, 2 * S, 2500 * MS, 3 * S]
    assert np.isfinite(numbers).all()
    assert error == (
        'tf_trajectory: 4 rows from 1.750000000 s to 3.000000000 s\n'
        'tf_trajectory: 3 of 7 stamps are outside the data of odom -> base: the first 0.75 s; of '
        'map -> odom: the last 1 s\n')
    # In more than one part; the first row is where all edges have data.
    _, error = run('--bag', bag, 'map', 'base', '--every', '0.0001')
    assert '12501 rows from 1.750000000 s to 3.000000000 s' in error
    assert '10000 of 22501 stamps are outside the data of map -> odom: the last 1 s' in error


@pytest.mark.parametrize('output', [[], ['-o', 'x.npz'], ['-o', 'x.svg']])
def test_no_row_has_a_transform(failed, monkeypatch, tmp_path, output):
    """The error names the reasons, and no file is written."""
    if 'x.svg' in output:
        pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    bag = bag_of(tmp_path / 'bag', rows_of(('map', 'odom', [1.0]), ('odom', 'base', [2.0])))
    assert failed(tf_trajectory.main, '--bag', bag, 'map', 'base', *output) == (
        1, 'tf_trajectory: there is no row: 2 of 2 stamps are outside the data of odom -> base: '
        'the first 1 s; of map -> odom: the last 1 s\n')
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
    assert [axes.xaxis.get_major_ticks()[0].label1.get_visible() for axes in panels] == [
        False, False, False, True]
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


@pytest.mark.parametrize(('ending', 'every'), [
    ('csv', ['--every', '0.0005']), ('npz', ['--every', '0.0005']), ('png', [])])
def test_a_signal_leaves_no_partial_file(failed, monkeypatch, arm_bag, there, ending, every):
    """It is noticed between parts of many rows, and at the end. An old file stays."""
    if ending == 'png':
        pytest.importorskip('matplotlib')
    look_up = TransformBuffer.lookup_transforms
    parts: list[int] = []

    def interrupt(buffer, target, source, times):
        if not parts:
            signal.raise_signal(signal.SIGTERM)
        parts.append(len(times))
        return look_up(buffer, target, source, times)

    monkeypatch.setattr(TransformBuffer, 'lookup_transforms', interrupt)
    (there / f'arm.{ending}').write_text('old')
    outcome = failed(tf_trajectory.main, '--bag', arm_bag, *FRAMES, *every, '-o', f'arm.{ending}')
    assert outcome == (143, 'tf_trajectory: ended early by SIGTERM\n')
    (count,) = parts
    assert count < 10_001 if every else count == 101
    assert [path.name for path in there.iterdir()] == [f'arm.{ending}']
    assert (there / f'arm.{ending}').read_text() == 'old'


@pytest.fixture(scope='module')
def walk_bag(tmp_path_factory):
    """A bag of a walk with x = stamp - 100 s, recorded from 100 s to 110.001 s."""
    return bag_of(tmp_path_factory.mktemp('walk') / 'walk_bag', bags.walk())


@pytest.mark.parametrize(('window', 'first', 'last'), [
    (['--start', '+2.5'], 102_500, 110_000),
    (['--stop', '-1.5'], 100_000, 108_500),
    (['--start', '103.25', '--stop', '104'], 103_300, 104_000),
    (['--start', '-1', '--stop', '1970-01-01T00:01:49.5Z'], 109_000, 109_500),
    # Nine digits are exact.
    (['--start', '100.100000001', '--stop', '100.3'], 100_200, 100_300),
    (['--start', '100.1', '--stop', '+0.299999999'], 100_100, 100_200),
    (['--start', '50', '--stop', '9000000000'], 100_000, 110_000)])
def test_a_window(run, walk_bag, window, first, last):
    """It is inclusive, and bounds the stamps (ms)."""
    output, _ = run('--bag', walk_bag, 'odom', 'base_link', *window)
    assert read_csv(output)[1].tolist() == [*range(first * MS, last * MS + 1, 100 * MS)]


@pytest.mark.parametrize(('options', 'first'), [
    ([], 100_000), (['--twist'], 100_050), (['--twist', '--start', '+0.06'], 100_060)])
def test_equal_distances_begin_where_a_row_is_possible(run, walk_bag, options, first):
    """A velocity needs data 0.05 s before its time, so there is none at the first stamp (ms)."""
    output, error = run('--bag', walk_bag, 'odom', 'base_link', '--every', '0.25', *options)
    assert read_csv(output)[1][0] == first * MS
    assert 'left out' not in error


def test_equal_distances_in_a_window(run, walk_bag):
    """The first row is at its begin, also between two stamps."""
    output, _ = run('--bag', walk_bag, 'odom', 'base_link', '--start', '+0.123456789', '--stop',
                    '+1', '--every', '0.3')
    _, stamps, numbers = read_csv(output)
    assert stamps.tolist() == [100 * S + 123_456_789 + 300 * MS * i for i in range(3)]
    np.testing.assert_allclose(numbers[:, 0], stamps / S - 100.0)


#: By part of the error: the exit code, and arguments.
FAULTS = {
    'tf_trajectory: there is no row in this time: the bag is from 100.000000000 to +10 s, '
    '110.000000000\n': (1, ['--start +20', '--stop 99', '--start 100.01 --stop 100.02',
                           '--start 9000000000 --every 1']),
    'tf_trajectory: --start must not be after --stop\n': (2, ['--start +2 --stop 101']),
    'tf_trajectory: 1.000000000 is outside of the bag, ': (2, ['--start 1', '--stop 1']),
    '; for seconds after its start, write + before them\n': (2, ['--start 1', '--stop 1']),
    'tf_trajectory: --every 1e-07 would give 100000001 rows, and at most 10000000 are possible: '
    'choose at least 1.1e-06 s\n': (2, ['--every 1e-7'])}


@pytest.mark.parametrize('text', FAULTS)
def test_what_a_bag_does_not_have(failed, walk_bag, text):
    """The error is one line that says what the bag has instead, or what is possible."""
    exit_code, each = FAULTS[text]
    for arguments in each:
        code, error = failed(tf_trajectory.main, '--bag', walk_bag, 'odom', 'base_link',
                             *arguments.split())
        assert (code, error.count('\n')) == (exit_code, 1)
        assert text in error
    code, error = failed(tf_trajectory.main, '--bag', walk_bag, 'odom', 'base_lnk')
    assert (code, error.count('\n')) == (1, 1)
    assert "does not exist. Nearest known: 'base_link'" in error


def scans(*stamps, frame='odom', kind='mcap'):
    """Yield messages with a header on /scan: stamps (ns)."""
    for stamp in stamps:
        yield ('/scan', stamp + 5 * MS, bags.point(frame, stamp, 1 if kind == 'bag' else 2),
               'geometry_msgs/msg/PointStamped')


SCANS = [100 * S + 123_456_789 + 70 * MS * i for i in range(20)]


@pytest.mark.parametrize('kind', ['mcap', 'mcap message', 'db3', 'bag'])
@pytest.mark.parametrize('arguments', [
    ['base_link', '--at', '/scan'], ['--at', 'scan', 'base_link'],
    ['odom', '--at', '/scan', 'base_link']])
def test_rows_at_the_stamps_of_a_topic(run, tmp_path, kind, arguments):
    """They are those of the headers; the frame of the messages is the default target."""
    bag = str(bags.make(tmp_path, kind, [*bags.walk(), *scans(*SCANS, kind=kind)]))
    _, stamps, numbers = read_csv(run(*arguments, '--bag', bag)[0])
    assert stamps.tolist() == SCANS
    np.testing.assert_allclose(numbers[:, 0], stamps / S - 100.0)


def test_no_message_of_many_is_left_out(run, tmp_path):
    """Elsewhere, a sample of 20 000 headers of a topic is read."""
    stamps = [100 * S + 400_000 * i for i in range(20_500)]
    bag = bag_of(tmp_path / 'bag', [*bags.walk(), *scans(*stamps)])
    path = tmp_path / 'x.npz'
    run('base_link', '--at', '/scan', '--bag', bag, '--start', '+0.0004', '-o', str(path))
    with np.load(path) as arrays:
        assert arrays['stamps'].tolist() == stamps[1:]


def test_a_static_pose_at_the_stamps_of_a_topic(run, tmp_path):
    """Nothing needs to move."""
    bag = bag_of(tmp_path / 'bag', [*bags.walk(), *scans(*SCANS, frame='map')])
    _, stamps, numbers = read_csv(run('odom', '--at', '/scan', '--bag', bag)[0])
    assert stamps.tolist() == SCANS
    assert (numbers[:, :3] == [1.0, 2.0, 3.0]).all()


def test_a_topic_without_stamps(failed, tmp_path):
    """The error names the topics that have headers."""
    bag = bag_of(tmp_path / 'bag', [
        *bags.walk(), *scans(*SCANS), ('/text', S, bags.string('x'), bags.STRING)])
    for topic, why in (('/scn', 'there is no topic /scn'), (
            '/text', 'no message on /text has a header'), (
            '/tf', 'no message on /tf has a header')):
        assert failed(tf_trajectory.main, 'base_link', '--at', topic, '--bag', bag) == (
            1, f'tf_trajectory: {why}; topics with headers: /scan\n')


@pytest.mark.parametrize(('frames', 'text'), [('ab', 'a, b'), (('',), "''")])
def test_a_topic_without_a_default_target(failed, run, tmp_path, frames, text):
    """If its messages have several frames, or none, both frames are needed."""
    bag = bag_of(tmp_path / 'bag', [*bags.walk(), *(
        message for frame in frames for message in scans(*SCANS, frame=frame))])
    assert failed(tf_trajectory.main, 'base_link', '--at', '/scan', '--bag', bag) == (
        1, f'tf_trajectory: the messages on /scan must be in one frame, got {text}: give both '
        'frames\n')
    output, _ = run('odom', 'base_link', '--at', '/scan', '--bag', bag)
    assert read_csv(output)[1].tolist() == SCANS


@pytest.fixture(scope='module')
def torn_bag(tmp_path_factory):
    """The walk without its data between 104 and 107 s; tool moves on base_link at 10 Hz."""
    messages = [message for message in bags.walk() if not 104 * S + MS < message[1] < 107 * S]
    return bag_of(tmp_path_factory.mktemp('torn') / 'torn_bag', [*messages, *(
        ('/tf', 100 * S + i * S // 10, [bags.row(100 * S + i * S // 10, 'base_link', 'tool')])
        for i in range(101))])


def test_rows_in_a_gap_are_counted(run, torn_bag):
    """
    With --max-gap, they are left out.

    At 104.0 and 107.0 s, nothing is interpolated; between, there are 29 stamps of the tool.
    """
    output, error = run('--bag', torn_bag, 'odom', 'tool')
    assert output.count('\n') == 102
    assert error.splitlines()[1:] == [
        'tf_trajectory: 29 rows are interpolated over gaps without data; in the longest, '
        'odom -> base_link has none between +4.00 and +7.00 s']
    output, error = run('--bag', torn_bag, 'odom', 'tool', '--max-gap', '2.999999999')
    assert read_csv(output)[1].tolist() == [
        100 * S + i * S // 10 for i in range(101) if not 40 < i < 70]
    assert error.splitlines()[1:] == [
        'tf_trajectory: 29 rows are left out, in gaps without data; in the longest, odom -> '
        'base_link has none between +4.00 and +7.00 s']
    output, error = run('--bag', torn_bag, 'odom', 'tool', '--max-gap', '3')
    assert output.count('\n') == 102
    assert error.count('\n') == 1


def test_a_gap_is_dashed(run, drawn, torn_bag, tmp_path):
    """The 41 rows up to 104.0 s and the 31 rows from 107.0 s on are connected by dashes only."""
    run('--bag', torn_bag, 'odom', 'base_link', '-o', str(tmp_path / 'torn.png'))
    run('--bag', torn_bag, 'odom', 'base_link', '--max-gap', '3', '-o', str(tmp_path / 'torn.png'))
    for axes in drawn[0].axes[0], drawn[0].axes[-1]:
        solid, dashed = axes.lines[:2]
        assert np.flatnonzero(np.isnan(solid.get_xdata())).tolist() == [41]
        assert (dashed.get_linestyle(), len(dashed.get_xdata())) == ('--', 72)
        assert dashed.get_color() == solid.get_color()
    assert 'no data' in texts(drawn[0])
    assert 'no data' not in texts(drawn[1])


def test_the_signs_of_quaternions_do_not_flip(run, tmp_path):
    """The first row keeps its sign; each later one is on the side of the one before."""
    # The buffer keeps the sign of which w is positive, so it flips where the half angle of top in
    # mid is pi / 2. The half angle in map grows from 2 to 7 rad.
    bag = bag_of_samples(tmp_path / 'bag', *(
        (1 + i, *edge, *STILL[:3], *quaternion_from_euler(0.0, 0.0, angle)) for i in range(100)
        for edge, angle in ((('map', 'mid'), 3.0), (('mid', 'top'), 1.0 + i / 10))))
    _, _, numbers = read_csv(run('--bag', bag, 'map', 'top')[0])
    half = 2.0 + np.arange(100) / 20
    np.testing.assert_allclose(
        numbers[:, 5:7], np.stack([np.sin(half), np.cos(half)], axis=1), atol=1e-12)
    path = tmp_path / 'top.npz'
    run('--bag', bag, 'map', 'top', '--every', '0.004', '-o', str(path))  # more than two parts
    with np.load(path) as arrays:
        quaternions = arrays['quaternions']
    assert len(quaternions) == 24_751
    assert ((quaternions[1:] * quaternions[:-1]).sum(axis=1) > 0.0).all()
    assert quaternions[0, 3] < 0.0


def posed(msgtype, stamp, x):
    """Serialize a message with a pose of base in odom at x, turned by x about z."""
    store = typesys.get_typestore(typesys.Stores.LATEST)

    def new(name, *fields):
        return store.types[name](*fields)

    header = new('std_msgs/msg/Header', new(
        'builtin_interfaces/msg/Time', *divmod(stamp, S)), 'odom')
    rotation = new('geometry_msgs/msg/Quaternion', *quaternion_from_euler(0.0, 0.0, x))
    vector = new('geometry_msgs/msg/Vector3', x, 0.5, -0.5)
    pose = new('geometry_msgs/msg/Pose', new('geometry_msgs/msg/Point', x, 0.5, -0.5), rotation)
    certain = new('geometry_msgs/msg/PoseWithCovariance', pose, np.zeros(36))
    fields = {
        'nav_msgs/msg/Odometry': ('base', certain, new(
            'geometry_msgs/msg/TwistWithCovariance',
            new('geometry_msgs/msg/Twist', vector, vector), np.zeros(36))),
        'geometry_msgs/msg/PoseStamped': (pose,),
        'geometry_msgs/msg/PoseWithCovarianceStamped': (certain,),
        'geometry_msgs/msg/TransformStamped': (
            'base', new('geometry_msgs/msg/Transform', vector, rotation))}[msgtype]
    return bytes(store.serialize_cdr(new(msgtype, header, *fields), msgtype))


POSES = ('nav_msgs/msg/Odometry', 'geometry_msgs/msg/PoseStamped',
         'geometry_msgs/msg/PoseWithCovarianceStamped', 'geometry_msgs/msg/TransformStamped')


@pytest.mark.parametrize('msgtype', POSES)
def test_the_poses_of_a_topic(run, tmp_path, msgtype):
    """They are in the same formats as those of transforms, and a bag needs no transforms."""
    bag = bag_of(tmp_path, [
        ('/odom', 50 * S + i, posed(msgtype, S + i * 20 * MS, i / 50), msgtype)
        for i in range(100)])
    path = tmp_path / 'odom.tum'
    run('--bag', bag, '--topic', '/odom', '-o', str(path))
    rows = np.loadtxt(path)
    times = np.arange(100) / 50
    np.testing.assert_allclose(rows[:, 0], 1.0 + times)
    np.testing.assert_allclose(rows[:, 1:4], [[x, 0.5, -0.5] for x in times])
    np.testing.assert_allclose(
        rows[:, 4:], [quaternion_from_euler(0.0, 0.0, x) for x in times], atol=1e-12)
    output, _ = run('--bag', bag, '--topic', 'odom', '--every', '0.1', '--start', '1.5', '--stop',
                    '1.7', '--twist')
    _, stamps, numbers = read_csv(output)
    assert stamps.tolist() == [1500 * MS, 1600 * MS, 1700 * MS]
    np.testing.assert_allclose(numbers[:, [10, 15]], 1.0)


def test_a_topic_of_another_type(failed, tmp_path):
    """The line names the type, those that are possible, and the topics that have them."""
    bag = bag_of(tmp_path / 'bag', [
        *bags.walk(), *scans(*SCANS), ('/pose', S, posed(POSES[1], S, 1.0), POSES[1])])
    four = f'it must be {", ".join(POSES[:3])} or {POSES[3]}; topics of these types: /pose'
    for topic, what in (('/scan', 'the type of /scan is geometry_msgs/msg/PointStamped'),
                        ('/tf', 'the type of /tf is tf2_msgs/msg/TFMessage'),
                        ('/odom', 'there is no topic /odom')):
        assert failed(tf_trajectory.main, '--bag', bag, '--topic', topic) == (
            1, f'tf_trajectory: {what}; {four}\n')
