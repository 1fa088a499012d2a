"""The command `tf_trajectory`: poses over time out of bags and live, compared with the arm's."""

import contextlib
import csv
from math import pi
import os
import re
import signal
import struct
import subprocess
import sys
import threading
import tracemalloc
from xml.etree import ElementTree

from arms import Arm, BEGIN, hand
from conftest import (
    ARM,
    BEGUN,
    on_unix,
    run_in_terminal,
    run_on_full_disk,
    tool,
    tool_without_ros,
)
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from dummy_arm.tf import bag as tf_bag
from dummy_arm.tf import BufferCore
from dummy_arm.tf._core.pose import Batch
from dummy_arm.tf.rotations import euler_from_quaternion, quaternion_from_euler
from dummy_arm.tools import tf_trajectory

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


def bag_of(path, messages, kind='mcap'):
    """Write a bag, and return its path."""
    return str(pytest.importorskip('bags').make(path, kind, messages))


def rows_of(*edges):
    """Yield the messages of edges: the parent, the child, and the stamps (s), or None: static."""
    bags = pytest.importorskip('bags')
    for parent, child, stamps in edges:
        for x, stamp in enumerate(stamps or [0.0]):
            yield '/tf_static' if stamps is None else '/tf', 100 * S + x, [
                bags.row(round(stamp * S), parent, child, (float(x), *STILL[1:]))]


@pytest.fixture(autouse=True, scope='module')
def font_cache():
    """Build the font cache of matplotlib; a command that did it would print a warning."""
    with contextlib.suppress(ImportError):
        import matplotlib.font_manager  # noqa: F401


@pytest.fixture
def arm_bag(tmp_path):
    """A bag of the arm, with a stamp each 50 ms."""
    return bag_of(tmp_path / 'arm_bag', Arm().messages(SECONDS))


@pytest.fixture
def run(capsys):
    """Call the command by `run('argument', …)`; it must succeed. Return its stdout and stderr."""
    def call(*arguments):
        assert tf_trajectory.main([*arguments]) == 0
        return capsys.readouterr()

    return call


@pytest.mark.parametrize('kind', ['db3', 'mcap', 'bag'])
def test_a_bag_without_ros(start, tmp_path, kind):
    """There is a row for each stamp, and the poses are those of the arm."""
    bag = bag_of(tmp_path / 'arm', Arm().messages(SECONDS), kind)
    process = start(*tool_without_ros(
        'tf_trajectory', '--bag', bag, *FRAMES, '-o', 'arm.csv'), cwd=tmp_path)
    assert process.exit_code() == 0
    assert process.output == (
        'wrote arm.csv: 101 rows from 1700000000.000000000 s to 1700000005.000000000 s\n')
    header, stamps, numbers = read_csv((tmp_path / 'arm.csv').read_text())
    assert header == POSE
    assert stamps.tolist() == [BEGIN + 50 * MS * i for i in range(101)]
    assert_is_hand(stamps, numbers)


def test_the_table_is_printed_and_the_summary_is_on_stderr(run, arm_bag):
    """So the table can be piped into another program."""
    output, error = run('--bag', arm_bag, *FRAMES)
    header, stamps, numbers = read_csv(output)
    assert header == POSE
    assert len(stamps) == 101
    assert_is_hand(stamps, numbers)
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


def test_velocities_are_those_of_lookup_twist(run, arm_bag):
    """They are averages over 0.1 s; rows at the begin, where there is none, are left out."""
    output, error = run('--bag', arm_bag, *FRAMES, '--twist')
    header, stamps, numbers = read_csv(output)
    assert header == [*POSE, *TWIST]
    buffer = tf_bag.read(arm_bag)
    for stamp, row in zip(stamps.tolist(), numbers.tolist()):
        linear, angular = buffer.lookup_twist(*FRAMES, stamp, S // 10)
        assert row[10:] == [*linear, *angular]
    assert stamps[0] == BEGIN + 50 * MS
    assert '1 of 101 rows is left out, without a transform or a velocity; the first, at ' \
        '1700000000.000000000 s: there is no velocity: Lookup would require extrap' in error


def test_velocities_are_those_of_the_arm(run, arm_bag):
    """They are the differences of the analytic motion, but for the last rows."""
    _, stamps, numbers = read_csv(run('--bag', arm_bag, *FRAMES, '--twist')[0])
    expected = (hand(stamps + 50 * MS) - hand(stamps - 50 * MS)) / 0.1
    assert abs(numbers[:-1, 10:] - expected[:-1]).max() < 1e-9


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
    assert "The data of edge 'odom' -> 'base' begin 0.750000000 s after" in line


@pytest.mark.parametrize('output', [[], ['-o', 'x.csv'], ['-o', 'x.npz'], ['-o', 'x.svg']])
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
    bags = pytest.importorskip('bags')
    bag = bag_of(tmp_path / 'bag', [('/tf', S, [
        bags.row(i * S, *edge, (x, *STILL[1:]))
        for edge in (('a', 'b'), ('b', 'c')) for i, x in ((1, 1.0), (2, 1.5e308))])])
    output, error = run('--bag', bag, 'a', 'c')
    assert read_csv(output)[1].tolist() == [S]
    assert error.endswith('at 2.000000000 s: a number is too large for a float64\n')


def test_a_parent_that_changes(run, tmp_path):
    """A cup on a table is taken by a hand; its rows follow the path at each time."""
    bags = pytest.importorskip('bags')
    bag = bag_of(tmp_path / 'bag', [('/tf_static', 0, [bags.row(0, 'map', 'table')]), ('/tf', S, [
        *(bags.row(i * S, 'map', 'hand', (float(i), *STILL[1:])) for i in range(1, 9)),
        *(bags.row(i * S, 'table', 'cup', (9.0, *STILL[1:])) for i in (1, 3)),
        *(bags.row(i * S + S // 2, 'hand', 'cup', (0.25, *STILL[1:])) for i in (4, 6))])])
    _, stamps, numbers = read_csv(run('--bag', bag, 'map', 'cup')[0])
    assert dict(zip((stamps / S).tolist(), numbers[:, 0].tolist())) == {
        1.0: 9.0, 3.0: 9.0, 4.5: 4.75, 5.0: 5.25, 6.0: 6.25, 6.5: 6.75}


@pytest.mark.parametrize(('target', 'text'), [
    ('map', "'odom' never moves in 'map': there is no dynamic transform between them. Print its "
     'pose with tf2_echo'), ('odom', 'both frames are the same')])
@pytest.mark.parametrize('every', [[], ['--every', '1']])
def test_frames_that_do_not_move(failed, tmp_path, target, text, every):
    """The error says so, and which command prints the pose."""
    bag = bag_of(tmp_path / 'bag', pytest.importorskip('bags').walk())
    code, line = failed(tf_trajectory.main, '--bag', bag, target, 'odom', *every)
    assert code == 1
    assert line == f'tf_trajectory: {text}\n'


@given(st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(
    x * x for x in q) > 1e-6), min_size=1))
def test_angles_are_those_of_rotations(quaternions):
    """They are computed for many rotations at once."""
    given = np.array(quaternions) / np.linalg.norm(quaternions, axis=1, keepdims=True)
    difference = tf_trajectory.roll_pitch_yaw(given) - [
        euler_from_quaternion(quaternion) for quaternion in given.tolist()]
    assert abs(np.exp(1j * difference) - 1.0).max() < 1e-7


@pytest.mark.parametrize('pitch', [pi / 2, -pi / 2])
def test_angles_at_gimbal_lock(pitch):
    """The yaw is 0, as in tf2_echo."""
    quaternion = quaternion_from_euler(0.3, pitch, 0.2)
    for sign in 1.0, -1.0:
        assert tf_trajectory.roll_pitch_yaw(sign * np.array([quaternion]))[0] == pytest.approx(
            euler_from_quaternion(quaternion), abs=1e-12)


@pytest.mark.parametrize('angle', [0.0, pi / 2, pi, -pi / 2, 3.0, -3.0])
def test_angles_of_a_rotation_about_one_axis(angle):
    """They are in (-pi, pi], for both signs of the quaternion."""
    for axis in 0, 2:
        expected = [0.0, 0.0, 0.0]
        expected[axis] = angle
        roll, pitch, yaw = expected
        for sign in 1.0, -1.0:
            quaternion = sign * np.array([quaternion_from_euler(roll, pitch, yaw)])
            assert tf_trajectory.roll_pitch_yaw(quaternion)[0].tolist() == pytest.approx(
                expected, abs=1e-15)


@pytest.mark.parametrize(('name', 'begin'), [
    ('arm.png', b'\x89PNG'), ('arm.svg', b'<?xml'), ('arm.pdf', b'%PDF')])
@pytest.mark.parametrize('arguments', [[], ['--twist'], ['--every', '10']])
def test_drawings(run, arm_bag, tmp_path, name, begin, arguments):
    """The ending is the format; one row can be drawn, too."""
    pytest.importorskip('matplotlib')
    path = tmp_path / name
    output, _ = run('--bag', arm_bag, *FRAMES, *arguments, '-o', str(path))
    assert output.startswith(f'wrote {path}: ')
    assert path.read_bytes().startswith(begin)


@pytest.fixture
def texts_of_pdf(tmp_path):
    """Draw a bag, and return the texts of the PDF."""
    pytest.importorskip('matplotlib')
    pypdf = pytest.importorskip('pypdf')

    def texts(bag, *arguments):
        path = tmp_path / 'drawn.pdf'
        assert tf_trajectory.main(['--bag', bag, *arguments, '-o', str(path)]) == 0
        (page,) = pypdf.PdfReader(path).pages
        return page.extract_text()

    return texts


def test_a_drawing_says_what_it_shows(texts_of_pdf, arm_bag):
    """The title names the frames; axes have units."""
    text = texts_of_pdf(arm_bag, *FRAMES, '--twist')
    for words in ('end_effector in map', 'position (m)', 'angle (°)', 'velocity (m/s)', '(rad/s)',
                  'time (s), from 1700000000.050000000 s', 'x (m)', 'y (m)', 'path from above',
                  'start', 'end', 'roll', 'pitch', 'yaw'):
        assert words in text
    assert 'velocity' not in texts_of_pdf(arm_bag, *FRAMES)


def test_odd_names_are_drawn_as_they_are(texts_of_pdf, tmp_path):
    """A name may look like a formula, or have control characters."""
    names = 'a$b_1$', '\\frac{', 'esc\x1b'
    bag = bag_of(tmp_path / 'bag', rows_of((names[0], names[1], [1.0]), (
        names[0], names[2], [1.0, 2.0])))
    assert f'{names[1]} in {names[0]}' in texts_of_pdf(bag, *names[:2])
    assert f'esc\\x1b in {names[0]}' in texts_of_pdf(bag, names[0], names[2])


def test_a_drawing_of_many_rows_has_some_of_them(run, texts_of_pdf, monkeypatch, arm_bag):
    """The title and the summary say so."""
    monkeypatch.setattr(tf_trajectory, 'MAX_DRAWN', 20)
    assert 'end_effector in map, one of 6 rows' in texts_of_pdf(arm_bag, *FRAMES)


def test_the_line_of_an_angle_does_not_jump(monkeypatch, run, tmp_path):
    """Between 180 and -180 degrees there is a gap; so there is where rows are left out."""
    figure = pytest.importorskip('matplotlib.figure')
    bags = pytest.importorskip('bags')
    drawn = []

    def savefig(self, *_, **__):
        drawn.append(self)

    monkeypatch.setattr(figure.Figure, 'savefig', savefig)
    bag = bag_of(tmp_path / 'bag', [('/tf', S, [
        bags.row(i * S, 'map', 'top', (*STILL[:3], *quaternion_from_euler(0.0, 0.0, float(i))))
        for i in range(-2, 8)])])
    run('--bag', bag, 'map', 'top', '-o', str(tmp_path / 'top.png'))
    (yaw,) = (line for line in drawn[0].axes[1].lines if line.get_label() == 'yaw')
    angles = np.degrees([-2.0, -1.0, np.nan, 1.0, 2.0, 3.0, np.nan, *np.arange(4.0, 8.0) - 2 * pi])
    np.testing.assert_allclose(yaw.get_ydata(), angles)
    assert yaw.get_xdata()[[0, 1, 3, 7]].tolist() == [0.0, 1.0, 3.0, 6.0]


def test_an_svg_is_well_formed(run, arm_bag, tmp_path):
    """Any program can read it."""
    pytest.importorskip('matplotlib')
    run('--bag', arm_bag, *FRAMES, '-o', str(tmp_path / 'arm.svg'))
    assert ElementTree.parse(tmp_path / 'arm.svg').getroot().tag.endswith('svg')


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


@pytest.mark.parametrize(('arguments', 'why'), [
    (('map',), 'the following arguments are required: source_frame'),
    (('map', ''), 'a frame must have a name'),
    (('/', 'odom'), 'a frame must have a name'),
    (('map', 'odom', '-o', 'x'), "'x' must end in .csv, .tum, .npz, .png, .svg, .pdf"),
    (('map', 'odom', '-o', ''), "'' must end in .csv"),
    (('map', 'odom', '-o', '.csv'), "'.csv' must end in .csv"),
    (('map', 'odom', '-o', 'x.csv/'), "'x.csv/' must end in .csv"),
    (('map', 'odom', '-o', 'x.json'), "'x.json' must end in .csv"),
    (('map', 'odom', '-o', 'x.tum', '--twist'), 'a .tum file has no place for velocities'),
    (('map', 'odom', '--every', '0'), '--every must be at least 1e-09 s'),
    (('map', 'odom', '--every', '-1'), '--every must be at least 1e-09 s'),
    (('map', 'odom', '--every', '1e-10'), '--every must be at least 1e-09 s'),
    (('map', 'odom', '--every', '1e10'), '--every must be at least 1e-09 s, and less than'),
    (('map', 'odom', '--every', 'nan'), "'nan' is not finite"),
    (('map', 'odom', '--time', '0'), 'the time to listen must be more than 0 s'),
    (('map', 'odom', '--time', '1e10'), 'and at most 1e+09 s, got 1e+10'),
    (('map', 'odom', '--bag', 'x', '--time', '1'), 'leave it out with --bag'),
    (('map', 'odom', '--bag', ''), '--bag needs the path of a bag'),
    (('map', 'odom', '--partial'), '--partial needs --bag')])
def test_wrong_use(failed, arguments, why):
    """The exit code is 2, and the error is one line."""
    code, error = failed(tf_trajectory.main, *arguments)
    assert code == 2
    assert why in error
    assert error.startswith('tf_trajectory: ')
    assert error.count('\n') == 1


def test_too_many_rows(failed, arm_bag, tmp_path):
    """The error names an interval that is possible."""
    code, line = failed(tf_trajectory.main, '--bag', arm_bag, *FRAMES, '--every', '1e-7', '-o',
                        str(tmp_path / 'x.csv'))
    assert code == 2
    assert line == ('tf_trajectory: --every 1e-07 would give 50000001 rows, and at most 10000000 '
                    'are possible: choose at least 5e-07 s\n')


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


@pytest.mark.parametrize('ending', ['csv', 'tum', 'npz', 'png'])
def test_where_nothing_can_be_written(failed, tmp_path, ending):
    """The error comes before the bag is read."""
    (tmp_path / f'directory.{ending}').mkdir()
    for name, why in ((f'directory.{ending}', 'it is a directory'),
                      (f'missing/x.{ending}', 'missing is not a writable directory')):
        code, line = failed(tf_trajectory.main, '--bag', 'nowhere', *FRAMES, '-o',
                            str(tmp_path / name))
        assert code == 1
        assert line.startswith(f'tf_trajectory: cannot write {tmp_path / name}: ')
        assert line.endswith(f'{why}\n')


@on_unix
@pytest.mark.parametrize('ending', ['csv', *(
    pytest.param(ending, marks=pytest.mark.soak) for ending in ('tum', 'npz', 'pdf', 'svg'))])
def test_a_file_is_written_whole_or_not_at_all(tmp_path, arm_bag, ending):
    """On a full disk, there is no partial file, and an old file stays."""
    if ending in ('pdf', 'svg'):
        pytest.importorskip('matplotlib')
    there = tmp_path / 'there'
    there.mkdir()
    (there / f'arm.{ending}').write_text('old')
    done = run_on_full_disk('tf_trajectory', 3000, '--bag', arm_bag, *FRAMES, '-o',
                            f'arm.{ending}', directory=there)
    assert done.returncode == 1
    assert done.stderr == f'tf_trajectory: cannot write arm.{ending}: File too large\n'
    assert [path.name for path in there.iterdir()] == [f'arm.{ending}']
    assert (there / f'arm.{ending}').read_text() == 'old'


@on_unix
def test_a_closed_pipe_is_no_error(arm_bag):
    """This happens when the table is piped to `head`."""
    process = subprocess.Popen(
        [sys.executable, *tool('tf_trajectory', '--bag', arm_bag, *FRAMES, '--every', '1e-5')],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.readline().startswith(b'stamp_ns,')
    process.stdout.close()
    assert process.stderr.read() == b''
    assert process.wait() == 0
    process.stderr.close()


#: The command, which says when it has looked up the first rows, and then waits for a signal.
SLOW = """if True:
    import sys, time
    import dummy_arm.cli.entry_points as e
    import dummy_arm.tools.tf_trajectory as t
    from dummy_arm.cli.signals import signal_received
    t._PART = 10
    part = t.Trajectory._part
    def slow(self, times):
        rows = part(self, times)
        if self.count > 10:
            print('looking up', flush=True)
            while not signal_received():
                time.sleep(0.01)
        return rows
    t.Trajectory._part = slow
    sys.exit(e.tf_trajectory())
"""


@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('ending', ['csv', 'npz', 'png'])
def test_a_signal_leaves_no_partial_file(start, tmp_path, arm_bag, signal_number, ending):
    """The exit code is 0, and an old file stays."""
    if ending == 'png':
        pytest.importorskip('matplotlib')
    there = tmp_path / 'there'
    there.mkdir()
    (there / f'arm.{ending}').write_text('old')
    process = start('-c', SLOW, '--bag', arm_bag, *FRAMES, '-o', f'arm.{ending}', cwd=there)
    process.line_with('looking up')
    process.end(signal_number)
    assert process.exit_code() == 0
    assert process.output == 'looking up\n'
    assert [path.name for path in there.iterdir()] == [f'arm.{ending}']
    assert (there / f'arm.{ending}').read_text() == 'old'


def test_the_running_arm(start, tmp_path):
    """The poses are those of the arm at the exact stamps."""
    (begin,) = re.findall(r't = 0 at (\d+) ns', start(*ARM).line_with('t = 0'))
    process = start(*tool('tf_trajectory', *FRAMES, '--time', '2', '-o', 'arm.csv'), cwd=tmp_path)
    assert process.exit_code(40.0) == 0
    assert process.output.startswith('wrote arm.csv: ')
    _, stamps, numbers = read_csv((tmp_path / 'arm.csv').read_text())
    assert len(stamps) > 10
    assert_is_hand(stamps, numbers, int(begin))


@pytest.fixture
def recording(start, ros, tmp_path):
    """
    Record map -> base by `recording('argument', …)`, until 20 transforms have been received.

    :returns: a function; its arguments are those of python, without those of the command.
    """
    from dummy_arm.tf import TransformBroadcaster
    from dummy_arm.tf._core.pose import Row
    from dummy_arm.tf._ros.transform_stamped import message_of
    broadcaster = TransformBroadcaster(ros.node)
    (publisher,) = (each for each in ros.node.publishers if each.topic_name == '/tf')

    def record(*arguments):
        process = start(*arguments, 'map', 'base', '--time', '100', '-o', 'base.tum', cwd=tmp_path)
        ros.until(publisher.get_subscription_count)
        broadcaster.sendTransform([
            message_of(Row(1000 * S + i, 'map', 'base', STILL)) for i in range(20)])
        assert publisher.wait_for_all_acked()
        return process

    return record


@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_recording(recording, tmp_path, signal_number):
    """What has been received is written; it could have gone on for 100 s."""
    process = recording(*tool('tf_trajectory'))
    process.end(signal_number)
    assert process.exit_code() == 0
    assert process.output == 'wrote base.tum: 20 rows from 1000.000000000 s to 1000.000000019 s\n'
    assert (tmp_path / 'base.tum').read_text().count('\n') == 20


@pytest.mark.soak
def test_another_signal_ends_the_writing(recording, tmp_path):
    """The first one has ended the recording. No file is left."""
    process = recording('-c', SLOW)
    process.press_ctrl_c()
    process.line_with('looking up')
    process.end(signal.SIGINT)
    assert process.exit_code() == 0
    assert process.output == 'looking up\n'
    assert not [*tmp_path.iterdir()]


@pytest.mark.soak
def test_nothing_is_received(start, tmp_path):
    """The error says what to check, also if a signal ends the recording."""
    process = start(*tool('tf_trajectory', *FRAMES, '--time', '1.5', '-o', 'arm.csv'),
                    cwd=tmp_path)
    assert process.exit_code() == 1
    assert re.fullmatch(r'tf_trajectory: .*"map" .*frame does not exist\. No transform has been '
                        r'received yet\..*here: 0.*ROS_DOMAIN_ID.*\n', process.output)
    assert not [*tmp_path.iterdir()]


@pytest.mark.soak
def test_a_namespace(start, ros):
    """The topics of the namespace are used."""
    from dummy_arm.tf import TransformBroadcaster
    from dummy_arm.tf._core.pose import Row
    from dummy_arm.tf._ros.transform_stamped import message_of
    broadcaster = TransformBroadcaster(ros.node, tf_topic='/robot/tf')
    ros.node.create_timer(0.1, lambda: broadcaster.sendTransform([
        message_of(Row(1000 * S + i, 'map', 'base', STILL)) for i in range(20)]))
    process = start(*tool('tf_trajectory', 'map', 'base', '--namespace', 'robot', '--time', '2'))
    ros.until(process.has_ended)
    assert process.exit_code() == 0
    assert '20 rows from 1000.000000000 s' in process.output


@pytest.mark.parametrize('delay', [0.1, 0.4, *(
    pytest.param(delay, marks=pytest.mark.soak) for delay in (0.2, 0.3, 0.5, 0.7, 0.9, 1.2))])
def test_ctrl_c_at_any_time_is_no_traceback(start, tmp_path, delay):
    """It may be importing, starting or listening; no file is left."""
    option, code, *arguments = tool('tf_trajectory', *FRAMES, '--time', '0.5', '-o', 'arm.csv')
    process = start(option, BEGUN + code, *arguments, cwd=tmp_path)
    process.line_with('begun')
    threading.Event().wait(delay)
    process.end(signal.SIGINT)
    assert process.exit_code() in (0, 1)
    assert 'Traceback' not in process.output
    assert 'ignored' not in process.output
    assert not [*tmp_path.iterdir()]


@on_unix
def test_a_bar_on_a_terminal(arm_bag, tmp_path):
    """It is shown while a file is written, but not within a table on the same terminal."""
    arguments = tool_without_ros('tf_trajectory', '--bag', arm_bag, *FRAMES)
    written = run_in_terminal(0, *arguments, '-o', str(tmp_path / 'arm.csv'),
                              until=lambda _: False)
    assert 'looking up' in written
    assert 'wrote ' in written
    assert 'looking up' not in run_in_terminal(0, *arguments, until=lambda _: False)


@pytest.mark.soak
@pytest.mark.parametrize('ending', ['csv', 'tum', 'npz', 'png'])
def test_many_rows_in_bounded_memory(tmp_path, monkeypatch, ending):
    """The memory is that of the stamps and of a part of the rows: less than the file."""
    if ending == 'png':
        pytest.importorskip('matplotlib.backends.backend_agg')
    count = 200_000
    buffer = BufferCore(count * S)
    batch = Batch(['map'], ['base'], 'test')
    batch.stamps.extend(range(MS, (count + 1) * MS, MS))
    batch.poses += [struct.pack('7d', i * 1e-6, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8)
                    for i in range(count)]
    buffer.insert_batches([batch])
    monkeypatch.setattr(tf_trajectory, 'read_bag', lambda *_: buffer)
    path = tmp_path / f'base.{ending}'
    tracemalloc.start()
    try:
        assert tf_trajectory.main(['--bag', 'x', 'map', 'base', '-o', str(path)]) == 0
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 25e6
    if ending == 'npz':
        with np.load(path) as arrays:
            assert (arrays['stamps'] == np.arange(1, count + 1) * MS).all()
            assert (arrays['positions'][:, 0] == np.arange(count) * 1e-6).all()
    elif ending != 'png':
        assert path.read_text().count('\n') == count + (ending == 'csv')
        assert os.path.getsize(path) > peak
