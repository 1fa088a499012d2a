"""`lookup_twist`, compared with known motions."""

from math import cos, sin

import numpy as np
import pytest

from puretf import ExtrapolationException, LookupException, rotations, TransformBuffer

S, MS = 10**9, 10**6


def turned(angle):
    """Return a rotation about z."""
    return 0.0, 0.0, sin(angle / 2.0), cos(angle / 2.0)


@pytest.fixture(scope='module')
def buffer():
    """
    A buffer with a motion of 4 s from 100 s on, sampled each millisecond.

    `disk` turns in `map` at 0.5 rad/s about z, around the point (1, 2, 0). `rim` is fixed to it,
    3 m from its centre. `sled` moves in `map` by (0.3, -0.2, 0.1) m/s, and does not turn.
    """
    buffer = TransformBuffer()
    buffer.insert(0, 'disk', 'rim', (3.0, 0.0, 0.0, *turned(0.3)), is_static=True)
    for i in range(4001):
        t = i / 1000.0
        buffer.insert(100 * S + i * MS, 'map', 'disk', (1.0, 2.0, 0.0, *turned(0.5 * t)))
        buffer.insert(100 * S + i * MS, 'map', 'sled', (0.3 * t, -0.2 * t, 0.1 * t, *turned(1.0)))
    return buffer


def test_straight_motion(buffer):
    """The velocity is exact at all times and for all intervals."""
    for time, interval in (102 * S, 10 * MS), (100 * S + 500 * MS, S), (0, S), (104 * S, 2 * S):
        twist = buffer.lookup_twist('map', 'sled', time, interval)
        assert twist.linear == pytest.approx((0.3, -0.2, 0.1))
        assert twist.angular == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_motion_on_a_circle(buffer):
    """The linear velocity is that of the origin of the frame, in the axes of the target frame."""
    for t in 0.5, 1.7, 3.9:
        twist = buffer.lookup_twist('map', 'rim', 100 * S + int(t * S), 20 * MS)
        assert twist.linear == pytest.approx(
            (-1.5 * sin(0.5 * t), 1.5 * cos(0.5 * t), 0.0), abs=1e-4)
        assert twist.angular == pytest.approx((0.0, 0.0, 0.5))


def test_motion_seen_from_a_frame_that_turns(buffer):
    """From the disk, the world turns backwards; the sled's velocity contains this turn."""
    t = 2.0
    twist = buffer.lookup_twist('disk', 'sled', 102 * S, 20 * MS)
    backwards = np.array([[cos(t / 2), sin(t / 2)], [-sin(t / 2), cos(t / 2)]])
    x, y = backwards @ (0.3 * t - 1.0, -0.2 * t - 2.0)  # the sled in the disk
    vx, vy = backwards @ (0.3, -0.2)
    assert twist.linear == pytest.approx((vx + 0.5 * y, vy - 0.5 * x, 0.1), abs=1e-4)
    assert twist.angular == pytest.approx((0.0, 0.0, -0.5))


def test_a_general_rotation():
    """The angular velocity is that of a rotation about any axis, up to almost half a turn."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    begin = rotations.quaternion_from_euler(0.3, -1.0, 2.0)
    for angle in 1e-7, 0.1, 3.1, -3.1:
        for sign in 1.0, -1.0:
            turn = rotations.quaternion_about_axis(angle, axis)
            x, y, z, w = rotations.quaternion_multiply(turn, begin)
            end = sign * x, sign * y, sign * z, sign * w
            buffer = TransformBuffer()
            buffer.insert(S, 'map', 'top', (0.0, 0.0, 0.0, *begin))
            buffer.insert(3 * S, 'map', 'top', (0.0, 0.0, 0.0, *end))
            twist = buffer.lookup_twist('map', 'top', 2 * S, 2 * S)
            assert twist.angular == pytest.approx(tuple(angle / 2.0 * axis), rel=1e-6)


def test_the_interval_ends_with_the_data(buffer):
    """At the end of the data and at time 0, the last interval is used."""
    last = buffer.lookup_twist('map', 'rim', 104 * S - 50 * MS, 100 * MS)
    assert buffer.lookup_twist('map', 'rim', 104 * S, 100 * MS) == last
    assert buffer.lookup_twist('map', 'rim', 0, 100 * MS) == last


def test_frames_that_do_not_move(buffer):
    """Static transforms and equal frames have no velocity."""
    for frames in ('disk', 'rim'), ('rim', 'rim'):
        for time in 0, 102 * S:
            assert buffer.lookup_twist(*frames, time, S) == ((0.0,) * 3, (0.0,) * 3)


def test_times_near_zero():
    """A simulation that starts at 0 has a velocity; 0 is not taken for the latest time."""
    buffer = TransformBuffer()
    for i in range(1, 5):
        buffer.insert(i, 'map', 'robot', (float(i), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert buffer.lookup_twist('map', 'robot', 2, 4).linear == pytest.approx((S, 0.0, 0.0))


@pytest.mark.parametrize(('frame', 'time', 'interval', 'error', 'text'), [
    ('moon', 0, S, LookupException, '"moon" passed to'),
    ('sled', 100 * S, S, ExtrapolationException, 'into the past'),
    # Long after the data: a frame that is not published any more may have stopped.
    ('rim', 104 * S + 51 * MS, 100 * MS, ExtrapolationException, 'into the future'),
    ('rim', 3700 * S, S, ExtrapolationException, 'into the future'),
    ('sled', 0, 0, ValueError, 'interval must be longer than 0 ns, got'),
    ('sled', 0, -1, ValueError, 'interval must be longer than 0 ns, got'),
    ('sled', 0, 0.1, TypeError, 'interval must be an integer')])
def test_errors(buffer, frame, time, interval, error, text):
    """They are those of lookups; the interval must be longer than 0."""
    with pytest.raises(error, match=text):
        buffer.lookup_twist('map', frame, time, interval)
