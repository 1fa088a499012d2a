"""The velocity of a frame, from its poses at two times."""

from math import acos, atan2, copysign, floor, hypot, sqrt
import sys

from puretf._core.lookup import Lookups
from puretf._core.pose import compose, IDENTITY, inverse, Pose, signed
from puretf._text.times import in_seconds, SECOND
from puretf.exceptions import TransformException
from puretf.transform import Twist, Vector

_FIRST = 0.00001  # the earliest begin (s) of the interval in tf2, since 0 is the latest time


def twist(lookups: Lookups, target: str, source: str, time: int, interval: int) -> Twist:
    """
    Compute the velocity of the source frame as seen in the target frame.

    `time` is the middle of the averaging interval (ns). If it is 0, or if the latest common time
    is in the interval, the interval is moved so that it ends at this time.
    """
    if interval <= 0:
        raise ValueError(f'interval must be longer than 0 ns, got {interval}')
    latest = lookups.latest_common_time(target, source)
    end = time + interval // 2
    if not time or end - interval <= latest < end:
        end = latest
    begin = max(end - interval, 1)  # time 0 would mean the latest time
    end = max(end, begin + 1)
    _, before = lookups.pose(target, source, begin)
    _, after = lookups.pose(target, source, end)
    seconds = (end - begin) / SECOND
    *_, x, y, z, w = compose(_rotation(after), inverse(_rotation(before)))
    sine = hypot(x, y, z)
    # q and -q are the same rotation; with a negative w, it would be the longer way round.
    rate = copysign(2.0 * atan2(sine, abs(w)), w) / sine / seconds if sine else 0.0
    return Twist(_scaled(_difference(after, before), 1.0 / seconds), _scaled((x, y, z), rate))


def tf2_velocity(lookups: Lookups, tracking: str, observation: str, reference: str, point: Vector,
                 point_frame: str, time: int, interval: int) -> tuple[Vector, Vector]:
    """
    Compute what `tf2::BufferCore::lookupVelocity` computes, which is not always the velocity.

    The steps and the rounding of times to float64 seconds are those of tf2. Three of the steps are
    wrong. The velocity is in the axes of the observation frame, but is rotated as if it were in
    the axes of the tracking frame. The cross product of the position of the tracking frame and the
    angular velocity is added. To move the velocity to the reference point, two vectors are
    multiplied element by element, where a cross product belongs.

    :returns: the linear velocity (m/s) and the angular velocity (rad/s).
    """
    try:
        latest = lookups.latest_common_time(observation, tracking)
    except TransformException:  # the lookups below raise an error with tf2's text
        latest = 0
    middle, seconds = in_seconds(time), interval / SECOND
    end = min(middle + seconds * 0.5, in_seconds(latest))
    begin = max(_FIRST + seconds, end) - seconds
    if begin == end:
        raise ValueError(f'averaging_interval is too short at this time: {interval} ns')
    _, before = lookups.pose(observation, tracking, _nanoseconds(begin))
    _, after = lookups.pose(observation, tracking, _nanoseconds(end))
    rate = 1.0 / (end - begin)
    _, tracked = lookups.pose(reference, tracking, _nanoseconds(middle))
    _, of_point = lookups.pose(reference, point_frame, _nanoseconds(middle))
    angular = _rotated(tracked, _scaled(_rotated(before, _angle_axis(before, after)), rate))
    linear = _rotated(tracked, _scaled(_difference(after, before), rate))
    x, y, z = tracked[:3]
    rx, ry, rz = angular
    arm = _difference(compose(of_point, (*point, *IDENTITY[3:])), tracked)
    vx, vy, vz = linear
    return (vx + y * rz - z * ry + rx * arm[0], vy + z * rx - x * rz + ry * arm[1],
            vz + x * ry - y * rx + rz * arm[2]), angular


def _angle_axis(before: Pose, after: Pose) -> Vector:
    """Return the rotation from one pose to another as tf2 does: the unit axis times the angle."""
    x, y, z, w = signed(*compose(inverse(_rotation(before)), _rotation(after))[3:])
    square = 1.0 - w * w
    if square < 10.0 * sys.float_info.epsilon:
        x, y, z, square = 1.0, 0.0, 0.0, 1.0
    return _scaled((x, y, z), 2.0 * acos(max(-1.0, min(1.0, w))) / sqrt(square))


def _nanoseconds(seconds: float) -> int:
    """Convert a time in seconds to ns as `tf2::timeFromSec` does."""
    whole = floor(seconds)
    return whole * SECOND + round((seconds - whole) * 1e9)


def _rotation(pose: Pose) -> Pose:
    return (0.0, 0.0, 0.0, *pose[3:])


def _rotated(pose: Pose, vector: Vector) -> Vector:
    return compose(_rotation(pose), (*vector, *IDENTITY[3:]))[:3]


def _difference(after: Pose, before: Pose) -> Vector:
    return after[0] - before[0], after[1] - before[1], after[2] - before[2]


def _scaled(vector: Vector, factor: float) -> Vector:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor
