"""The logic of `tf2_echo`: tf2's text, arguments, and transforms out of a bag."""

from math import pi

import pytest

from puretf import Transform
from puretf.rotations import quaternion_from_euler
from puretf_tools.commands.tf2_echo import format_transform, main

S = 10**9

# The output of tf2_echo of Jazzy for odom -> base_link, turned by 90 degrees.
JAZZY = """\
At time 1795204941.212668814
- Translation: [10.000, 2.000, 0.000]
- Rotation: in Quaternion [0.000, 0.000, 0.707, 0.707]
- Rotation: in RPY (radian) [0.000, -0.000, 1.571]
- Rotation: in RPY (degree) [0.000, -0.000, 90.000]
- Matrix:
  0.000 -1.000  0.000 10.000
  1.000  0.000  0.000  2.000
  0.000  0.000  1.000  0.000
  0.000  0.000  0.000  1.000"""


def turned(stamp, translation, *roll_pitch_yaw):
    """Return a transform map -> base_link; its stamp in ns, its rotation in rad."""
    return Transform(stamp, 'map', 'base_link', translation,
                     quaternion_from_euler(*roll_pitch_yaw))


@pytest.mark.parametrize('tiny', [0.0, -1e-9])
def test_the_text_is_that_of_tf2(tiny):
    """It is identical except for negative zeros; the columns keep their positions."""
    lists, matrix = JAZZY.split('- Matrix:')
    assert format_transform(turned(
        1795204941_212668814, (10.0, 2.0, tiny), tiny, tiny, pi / 2)) == (
        lists.replace('-0.000', '0.000') + '- Matrix:' + matrix.replace('-0.000', ' 0.000'))


def test_nanoseconds_have_nine_digits():
    """Otherwise 12.005 would look like 12.5."""
    assert format_transform(turned(12 * S + 5_000_000, (0.0,) * 3, 0, 0, 0)).startswith(
        'At time 12.005000000\n')


@pytest.mark.parametrize(('pitch', 'roll'), [(pi / 2, 0.1), (-pi / 2, 0.5)])
def test_rpy_is_right_at_gimbal_lock(pitch, roll):
    """For roll 0.3, pitch +-pi/2 and yaw 0.2, tf2 prints a roll of 0.1244 and 0.4636."""
    assert f'RPY (radian) [{roll:.3f}, {pitch:.3f}, 0.000]' in format_transform(
        turned(0, (0.0,) * 3, 0.3, pitch, 0.2))


def test_the_precision():
    """It applies to every number; the columns of the matrix widen with it."""
    transform = turned(S, (1000.0, -2 / 3, -0.4), 0.0, 0.0, 0.0)
    lines = format_transform(transform, 6).splitlines()
    assert lines[1] == '- Translation: [1000.000000, -0.666667, -0.400000]'
    assert lines[6:8] == ['  1.000000  0.000000  0.000000 1000.000000',
                          '  0.000000  1.000000  0.000000 -0.666667']
    assert format_transform(transform, 0).splitlines()[1:3] == [
        '- Translation: [1000, -1, 0]', '- Rotation: in Quaternion [0, 0, 0, 1]']


@pytest.fixture
def bag(bags, tmp_path):
    """A bag of a robot that moves."""
    return str(bags.make(tmp_path, 'mcap', bags.walk()))


@pytest.mark.parametrize(('time', 'stamp', 'x'), [
    ((), '110.000000000', 11.0), (('-t', '105.05', '--once'), '105.050000000', 6.05)])
def test_out_of_a_bag(bag, capsys, time, stamp, x):
    """It prints the latest transform, or that of an exact time."""
    assert main(['--bag', bag, '/map', '/base_link', *time, '-p', '3', '--ros-args',
                 '--log-level', 'info']) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f'At time {stamp}\n- Translation: [{x:.3f}, 2.000, 3.000]\n')
    assert (out.count('\n'), err) == (10, '')


@pytest.mark.parametrize(('arguments', 'why'), [
    (('map', 'base_lnik'), "does not exist. Nearest known: 'base_link'. More: tf_doctor"),
    (('map', 'base_link', '-t', '99'), 'tf2_echo: 99.000000000 is outside of the bag'),
    (('map', 'base_link', '-t', '+11'), '100.000000000 to +10 s, 110.000000000')])
def test_what_a_bag_does_not_have(failed, bag, arguments, why):
    """The exit code is 1; the error says what the bag contains instead."""
    code, error = failed(main, '--bag', bag, *arguments)
    assert code == 1
    assert why in error
    assert error.count('\n') == 1


def test_a_time_in_a_hole_of_a_bag(bags, capsys, tmp_path):
    """It is said that the pose is interpolated; a frame in itself never is."""
    times = [*range(100 * S, 102 * S, S // 10), *range(106 * S, 108 * S, S // 10)]
    path = str(bags.make(tmp_path, 'mcap', [
        ('/tf', time, [bags.row(time, 'odom', 'base_link')]) for time in times]))
    for stamp, end in (('+4', 'interpolated between +1.90 and +6.00 s: odom -> base_link has no '
                        'data there\n'), ('+1.85', '1.000\n'), ('106', '1.000\n')):
        assert main(['--bag', path, 'odom', 'base_link', '-t', stamp]) == 0
        assert capsys.readouterr().out.endswith(end)
    assert main(['--bag', path, 'x', 'x']) == 0
