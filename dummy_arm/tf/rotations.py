"""
Rotations as quaternions x, y, z, w, with the names that tf_transformations has.

Angles are in rad. A quaternion may come in of any length but zero, and of either sign; what comes
out is of unit length, unless it is said otherwise.
"""

from collections.abc import Iterable
from itertools import product
import math
import sys
from typing import Union

import numpy as np
from numpy.typing import ArrayLike, NDArray
from transforms3d import euler, quaternions

from dummy_arm.tf._core.pose import Quaternion as Quaternion

#: First axis, parity, repetition, frame, as in K. Shoemake, Euler Angle Conversion, Graphics
#: Gems IV (1994).
Code = tuple[int, int, int, int]
#: Such as 'sxyz' or (0, 0, 0, 0).
Axes = Union[str, Code]

#: What rounding leaves of zero.
_ROUNDING = 4.0 * sys.float_info.epsilon
#: How far a matrix may be off: some are typed in.
_OFF = 1e-3
_NEEDED = 'a quaternion of a rotation must have a length, such as (0, 0, 0, 1)'


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Axes = 'sxyz') -> Quaternion:
    """
    Compose three rotations: by `ai`, then `aj`, then `ak`.

    :param axes: 's' when they stay where they are or 'r' when they turn with the body, and their
        names: 'sxyz' for roll, pitch, yaw, 'rzyx' for yaw, pitch, roll.
    :raises ValueError: when an angle is not finite, or there are no such axes.
    """
    angles = _numbers((ai, aj, ak), 3, 'Euler angles must be three finite numbers (rad)')
    return _xyzw(euler.euler2quat(*angles, _code_of(axes)))


def euler_from_quaternion(quaternion: Iterable[float], axes: Axes = 'sxyz'
                          ) -> tuple[float, float, float]:
    """
    Find the angles `ai`, `aj`, `ak` from which `quaternion_from_euler` makes a rotation.

    `ai` and `ak` are in (-pi, pi]. `aj` is in [-pi/2, pi/2] where the three axes differ; where the
    last is the first again, `aj` is in [0, pi] if the second follows it in the order x, y, z, x,
    else in [-pi, 0]. At gimbal lock, `ak` is 0 for 's' and `ai` for 'r'.

    E. Bernardes and S. Viollet, Quaternion to Euler angles conversion: A direct, general and
    computationally efficient method, PLoS ONE 17 (2022): nothing is lost near gimbal lock.

    :raises ValueError: when it is no rotation, or there are no such axes.
    """
    i, parity, repetition, frame = _code_of(axes)
    q = _unit(quaternion)
    if max(q, key=abs) < 0.0:
        q = _divided(q, -1.0)
    j = (i + 1 + parity) % 3
    x, y, z, w = q[i], -q[j] if parity else q[j], q[3 - i - j], q[3]
    a, b, c, d = (w, x, y, z) if repetition else (w - y, x + z, w + y, z - x)
    of_sum, of_difference = math.hypot(a, b), math.hypot(c, d)
    half_sum, half_difference = math.atan2(b, a), math.atan2(d, c)
    if of_sum < _ROUNDING:
        half_sum = -half_difference
    elif of_difference < _ROUNDING:
        half_difference = -half_sum
    middle = 2.0 * math.atan2(of_difference, of_sum) - (0.0 if repetition else math.pi / 2.0)
    first, last = _wrapped(half_sum - half_difference), _wrapped(half_sum + half_difference)
    if parity:
        middle = -middle
    return (last, middle + 0.0, first) if frame else (first, middle + 0.0, last)


def quaternion_about_axis(angle: float, axis: Iterable[float]) -> Quaternion:
    """
    Turn about an axis.

    :param axis: x, y, z; of any length but zero.
    :raises ValueError: when the angle is not finite, or it is no axis.
    """
    what = 'an axis must be three finite numbers x, y, z, not all zero'
    x, y, z = _numbers(axis, 3, what)
    length = _length((x, y, z), what)
    angle, = _numbers((angle,), 1, 'an angle must be a finite number (rad)')
    return _xyzw(quaternions.axangle2quat((x / length, y / length, z / length), angle, True))


def quaternion_matrix(quaternion: Iterable[float]) -> NDArray[np.float64]:
    """
    Write a rotation as a homogenous (4, 4) matrix.

    :raises ValueError: when it is no rotation.
    """
    result = np.eye(4)
    result[:3, :3] = matrix(_unit(quaternion))
    return result


def quaternion_from_matrix(matrix: ArrayLike) -> Quaternion:
    """
    Read the rotation from a matrix.

    :param matrix: (3, 3), or homogenous (4, 4), of which the translation is no matter.
    :returns: that with w >= 0.
    :raises ValueError: on another shape, or when the matrix does more than to rotate and move.
    """
    given = np.asarray(matrix, dtype=np.float64)
    if given.shape not in ((3, 3), (4, 4)):
        raise ValueError(f'a matrix must be of shape (3, 3) or (4, 4), got {given.shape}')
    rotation, numbers = given[:3, :3], given.tolist()
    if len(given) == 4 and not abs(given[3] - (0.0, 0.0, 0.0, 1.0)).max() < _OFF:
        raise ValueError(f'the last row of a (4, 4) matrix must be 0, 0, 0, 1, got {numbers[3]}')
    with np.errstate(all='ignore'):
        off, determinant = abs(rotation @ rotation.T - np.eye(3)).max(), np.linalg.det(rotation)
    if not (off < _OFF and determinant > 0.0):
        raise ValueError(
            'the rows of a matrix of a rotation must be unit vectors at right angles, and its '
            f'determinant 1, got {numbers}: off by {off:.2g}, determinant {determinant:.3g}')
    return _xyzw(quaternions.mat2quat(rotation))


def quaternion_multiply(quaternion1: Iterable[float], quaternion0: Iterable[float]) -> Quaternion:
    """
    Multiply any two quaternions: rotate first by `quaternion0`, then by `quaternion1`.

    :raises ValueError: when these are not four finite numbers each.
    """
    return multiply(_quaternion(quaternion1), _quaternion(quaternion0))


def quaternion_conjugate(quaternion: Iterable[float]) -> Quaternion:
    """
    Change the signs of x, y, z of any quaternion: that inverts one of unit length.

    :raises ValueError: when these are not four finite numbers.
    """
    return conjugate(_quaternion(quaternion))


def quaternion_inverse(quaternion: Iterable[float]) -> Quaternion:
    """
    Invert a quaternion: its product with the inverse is (0, 0, 0, 1), whatever its length.

    :raises ValueError: when it is no rotation.
    """
    q = _quaternion(quaternion)
    length = _length(q, _NEEDED)
    return conjugate(_divided(_divided(q, length), length))


def quaternion_slerp(quat0: Iterable[float], quat1: Iterable[float], fraction: float,
                     spin: int = 0, shortestpath: bool = True) -> Quaternion:
    """
    Turn evenly about one axis from one rotation to another.

    K. Shoemake, Animating Rotation with Quaternion Curves, SIGGRAPH 1985, written with the sum and
    the difference of the two, so that it is exact where they are close, too. At the ends it gives
    what it was given.

    :param fraction: from 0 at `quat0` to 1 at `quat1`; beyond, it goes on.
    :param spin: so many whole turns more.
    :param shortestpath: the short way, whatever the signs; else they tell which way, and opposite
        ones the long way.
    :raises ValueError: when these are no rotations, or another number is not finite.
    """
    fraction, turns = _numbers((fraction, spin), 2, 'fraction and spin must be finite numbers')
    begin, end = _unit(quat0), _unit(quat1)
    if fraction in (0.0, 1.0):
        return end if fraction else begin
    if shortestpath and sum(a * b for a, b in zip(begin, end)) < 0.0:
        end = _divided(end, -1.0)
    difference = [b - a for a, b in zip(begin, end)]
    total = [a + b for a, b in zip(begin, end)]
    apart, together = math.hypot(*difference), math.hypot(*total)
    if min(apart, together) < _ROUNDING:  # one rotation, and no axis known
        return begin
    half = math.atan2(apart, together)
    angle = fraction * (2.0 * half + turns * math.pi) - half  # from the middle
    ahead, middle = math.sin(angle) / apart, math.cos(angle) / together
    return _unit([middle * m + ahead * d for m, d in zip(total, difference)])


def multiply(left: Iterable[float], right: Iterable[float]) -> Quaternion:
    """Compose two rotations, whatever the numbers are: first `right`, then `left`."""
    return _xyzw(quaternions.qmult(_wxyz(left), _wxyz(right)))


def conjugate(rotation: Quaternion) -> Quaternion:
    """Invert a rotation, given as a unit quaternion, whatever the numbers are."""
    x, y, z, w = rotation
    return -x, -y, -z, w


def matrix(rotation: Iterable[float]) -> NDArray[np.float64]:
    """Convert a rotation of any length to its (3, 3) matrix; that of zeros is the identity."""
    converted: NDArray[np.float64] = quaternions.quat2mat(_wxyz(rotation))
    return converted


def _wxyz(rotation: Iterable[float]) -> Quaternion:
    """Reorder for transforms3d, whose quaternions are w, x, y, z."""
    x, y, z, w = map(float, rotation)
    return w, x, y, z


def _xyzw(rotation: NDArray[np.float64]) -> Quaternion:
    """Reorder what transforms3d gives."""
    w, x, y, z = rotation.tolist()
    return x, y, z, w


def _numbers(given: Iterable[float], count: int, needed: str) -> list[float]:
    """Read so many finite numbers."""
    try:
        numbers = [float(number) for number in given]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError(f'{needed}, got {" ".join(repr(given).split())}')
    return numbers


def _quaternion(given: Iterable[float]) -> Quaternion:
    x, y, z, w = _numbers(given, 4, 'a quaternion must be four finite numbers x, y, z, w')
    return x, y, z, w


def _length(vector: tuple[float, ...], needed: str) -> float:
    length = math.hypot(*vector)
    if not sys.float_info.min <= length < math.inf:
        raise ValueError(f'{needed}, got {vector} of length {length:.3g}')
    return length


def _unit(given: Iterable[float]) -> Quaternion:
    """Normalise a quaternion; one of unit length stays as it is."""
    q = _quaternion(given)
    length = _length(q, _NEEDED)
    return q if abs(length - 1.0) < _ROUNDING else _divided(q, length)


def _divided(rotation: Quaternion, length: float) -> Quaternion:
    x, y, z, w = rotation
    return x / length, y / length, z / length, w / length


def _wrapped(angle: float) -> float:
    """Take whole turns away, to (-pi, pi]."""
    rest = math.remainder(angle, math.tau)
    return math.pi if rest == -math.pi else rest + 0.0


def _all_codes() -> dict[Axes, Code]:
    """List the codes of all conventions, by their names and by themselves."""
    codes: dict[Axes, Code] = {}
    for i, parity, repetition, frame in product(range(3), range(2), range(2), range(2)):
        j = (i + 1 + parity) % 3
        order = [i, j, i if repetition else 3 - i - j]
        name = ''.join('xyz'[axis] for axis in (reversed(order) if frame else order))
        codes['sr'[frame] + name] = codes[i, parity, repetition, frame] = (
            i, parity, repetition, frame)
    return codes


_CODES = _all_codes()


def _code_of(axes: Axes) -> Code:
    """
    Find the code of a convention.

    :raises ValueError: when there is no such convention.
    """
    try:
        return _CODES[axes.lower() if isinstance(axes, str) else axes]
    except (KeyError, TypeError):
        raise ValueError(
            "axes must be 's' (they stay) or 'r' (they turn with the body) and three of x, y, z, "
            "neighbours differing, such as 'sxyz', 'rzyx' or 'szxz', or the code of such, as "
            f'(0, 0, 0, 0) is of sxyz; got {axes!r}') from None
