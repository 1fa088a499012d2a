"""The geometry and the motion of the arm."""

from hypothesis import given
from hypothesis import strategies as st
from model import matrix
import numpy as np
import pytest

from dummy_arm.arm import poses, Wave

times = st.floats(-1e4, 1e4)
speeds = st.floats(-10, 10)
limits = st.floats(0, np.pi)


@given(st.tuples(*[st.floats(-20, 20)] * 3))
def test_the_end_effector_is_where_a_planar_arm_has_it(angles):
    """The product of the poses equals the sum of the links of a planar arm."""
    a, b, c = angles
    along = np.array([np.cos([a, a + b, a + b + c]), np.sin([a, a + b, a + b + c])])
    end = np.linalg.multi_dot([matrix(pose[:3], pose[3:]) for pose in poses(angles)])[:3, 3]
    np.testing.assert_allclose(end, [*along @ [0.4, 0.3, 0.2], 0.3], atol=1e-12)


@given(times, speeds, limits)
def test_a_wave_is_a_sine(t, speed, limit):
    """The angle is limit * sin(speed * t), also for negative times."""
    assert Wave(speed, limit).angle(t) == pytest.approx(limit * np.sin(speed * t), abs=1e-9)


@given(st.floats(-1, 1), st.lists(st.tuples(
    st.floats(0, 3), st.sampled_from(['speed', 'limit', 'release']), speeds, limits), max_size=8))
def test_changes_do_not_make_it_jump(held_at, changes):
    """The angle at the time of a change is the same before and after the change."""
    wave, t = Wave(0.3, 1.0).with_hold(held_at), 0.0
    for wait, change, speed, limit in changes:
        t += wait
        changed = {'speed': wave.with_speed(speed, t), 'limit': wave.with_limit(limit, t),
                   'release': wave.with_release(t)}[change]
        assert changed.angle(t) == pytest.approx(wave.angle(t), abs=1e-9)
        assert changed.angle(t + 1e-6) == pytest.approx(wave.angle(t), abs=1e-3)
        wave = changed


def test_a_new_limit_is_reached_after_a_second():
    """In between, the joint gets smoothly from its angle to the wave with the new limit."""
    before, after = Wave(0.5, 1.0), Wave(0.5, 2.0)
    wave = before.with_limit(2.0, 10.0)
    assert wave.angle(10.0) == before.angle(10.0)
    assert wave.angle(10.5) == pytest.approx((before.angle(10.0) + after.angle(10.5)) / 2)
    times = 9.0, 11.0, 99.0  # at 9.0, the clock was set back
    assert [wave.angle(t) for t in times] == [after.angle(t) for t in times]


@given(times, speeds, limits, st.floats(-4, 4))
def test_a_held_joint_does_not_move(t, speed, limit, angle):
    """It is at the angle, or at the limit if that is nearer to 0, whatever the phase is."""
    wave = Wave(speed, limit).with_hold(angle)
    assert wave.angle(t) == np.clip(angle, -limit, limit)


def test_a_released_joint_waves_after_a_second():
    """Its phase has gone on; a joint that is not held is not changed."""
    wave = Wave(0.5, 1.0)
    released = wave.with_hold(0.8).with_release(10.0)
    assert released.angle(10.0) == 0.8
    middle = (0.8 + np.sin(0.5 * 10.5)) / 2
    assert released.angle(10.5) == pytest.approx(middle, abs=1e-12)
    times = 9.0, 11.0, 99.0  # at 9.0, the clock was set back
    assert [released.angle(t) for t in times] == [wave.angle(t) for t in times]
    assert wave.with_release(10.0) == wave
