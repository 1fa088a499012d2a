"""
Rotations as quaternions x, y, z, w; the functions are named as in tf_transformations.

Angles are in rad. A quaternion that is given as an argument may have either sign, and any length
(norm) except zero. A quaternion that is returned has length 1. If a function differs from these
rules, its docstring says so.
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

#: The code of a convention of Euler angles, as in K. Shoemake, Euler Angle Conversion, Graphics
#: Gems IV (1994). A code has four numbers:
#:
#: - first axis: 0 for x, 1 for y, 2 for z;
#: - parity: 0 if the second axis follows the first axis in the cycle x, y, z, x; otherwise 1;
#: - repetition: 1 if the third axis is the same as the first axis; otherwise 0;
#: - frame: 0 if the axes are static; 1 if the axes rotate with the body.
#:
#: If frame is 1, the other three numbers describe the axes in reverse order, from the last axis to
#: the first. For example, the code of 'rzyx' is (0, 0, 0, 1): z, y, x in reverse order is x, y, z.
Code = tuple[int, int, int, int]
#: A convention of Euler angles: its name, such as 'sxyz', or its code, such as (0, 0, 0, 0).
Axes = Union[str, Code]

#: The largest error by rounding. A length that differs from 1 by less than this number is treated
#: as 1, and a length that is less than this number as 0.
_ROUNDING = 4.0 * sys.float_info.epsilon
#: The largest error that is accepted in a matrix, which may have been typed by hand.
_TOLERANCE = 1e-3
_NEEDED = 'a quaternion must have a finite length that is not zero; the identity is (0, 0, 0, 1)'


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Axes = 'sxyz') -> Quaternion:
    """
    Return the rotation by three Euler angles: first by `ai`, then by `aj`, then by `ak`.

    :param ai: the angle about the first axis (rad).
    :param aj: the angle about the second axis (rad).
    :param ak: the angle about the third axis (rad).
    :param axes: the convention: its name, or its `Code`. A name begins with 's' if the axes are
        static, or with 'r' if the axes rotate with the body; then come the names of the three
        axes. Examples: 'sxyz' (roll, pitch, yaw) and 'rzyx' (yaw, pitch, roll).
    :returns: the unit quaternion.
    :raises ValueError: if an angle is not finite, or the convention does not exist.

    >>> def rounded(numbers):
    ...     return [round(number, 3) for number in numbers]

    'sxyz' rotates about the static x axis, then the static y axis, then the static z axis. Here
    the roll and the yaw are 90 degrees:

    >>> rounded(quaternion_from_euler(math.pi / 2, 0.0, math.pi / 2, 'sxyz'))
    [0.5, 0.5, 0.5, 0.5]

    With 'rxyz', the axes rotate with the body. So the yaw is a rotation about the rotated z axis:

    >>> rounded(quaternion_from_euler(math.pi / 2, 0.0, math.pi / 2, 'rxyz'))
    [0.5, -0.5, 0.5, 0.5]

    'rzyx' takes the angles of 'sxyz' in reverse order, and (0, 0, 0, 0) is the code of 'sxyz':

    >>> roll, pitch, yaw = 0.1, 0.2, 0.3
    >>> rotation = quaternion_from_euler(roll, pitch, yaw, 'sxyz')
    >>> rotation == quaternion_from_euler(yaw, pitch, roll, 'rzyx')
    True
    >>> rotation == quaternion_from_euler(roll, pitch, yaw, (0, 0, 0, 0))
    True
    """
    angles = _numbers((ai, aj, ak), 3, 'Euler angles must be three finite numbers (rad)')
    return _xyzw(euler.euler2quat(*angles, _code_of(axes)))


def euler_from_quaternion(quaternion: Iterable[float], axes: Axes = 'sxyz'
                          ) -> tuple[float, float, float]:
    """
    Return the Euler angles of a rotation; the inverse function is `quaternion_from_euler`.

    `ai` and `ak` are in (-pi, pi]. `aj` is in [-pi/2, pi/2] if the three axes differ. If the last
    axis is the same as the first axis, as in 'sxyx', the range of `aj` depends on the first two
    axes: the range is [0, pi] for xy, yz and zx, and [-pi, 0] for xz, yx and zy.

    At gimbal lock, the first and the last axis are parallel. Then `ak` is 0 for static axes, and
    `ai` is 0 for rotating axes. The method is accurate near gimbal lock, too. See E. Bernardes and
    S. Viollet, Quaternion to Euler angles conversion: A direct, general and computationally
    efficient method, PLoS ONE 17 (2022).

    :param quaternion: x, y, z, w.
    :param axes: the convention, as in `quaternion_from_euler`.
    :returns: `ai`, `aj`, `ak` (rad).
    :raises ValueError: if the quaternion is not finite or has length zero, or the convention does
        not exist.

    A rotation by 180 degrees about z is the third angle of 'sxyz', and the first angle of 'rzyx'.
    The code of 'rzyx' is (0, 0, 0, 1):

    >>> euler_from_quaternion((0.0, 0.0, 1.0, 0.0), 'sxyz')
    (0.0, 0.0, 3.141592653589793)
    >>> euler_from_quaternion((0.0, 0.0, 1.0, 0.0), 'rzyx')
    (3.141592653589793, 0.0, 0.0)
    >>> euler_from_quaternion((0.0, 0.0, 1.0, 0.0), (0, 0, 0, 1))
    (3.141592653589793, 0.0, 0.0)
    """
    i, parity, repetition, frame = _code_of(axes)
    q = _unit(quaternion)
    if max(q, key=abs) < 0.0:
        q = _divided(q, -1.0)
    j = (i + 1 + parity) % 3
    x, y, z, w = q[i], -q[j] if parity else q[j], q[3 - i - j], q[3]
    a, b, c, d = (w, x, y, z) if repetition else (w - y, x + z, w + y, z - x)
    sum_norm, difference_norm = math.hypot(a, b), math.hypot(c, d)
    half_sum, half_difference = math.atan2(b, a), math.atan2(d, c)
    if sum_norm < _ROUNDING:
        half_sum = -half_difference
    elif difference_norm < _ROUNDING:
        half_difference = -half_sum
    middle = 2.0 * math.atan2(difference_norm, sum_norm) - (0.0 if repetition else math.pi / 2.0)
    first, last = _wrapped(half_sum - half_difference), _wrapped(half_sum + half_difference)
    if parity:
        middle = -middle
    return (last, middle + 0.0, first) if frame else (first, middle + 0.0, last)


def quaternion_about_axis(angle: float, axis: Iterable[float]) -> Quaternion:
    """
    Return the rotation by an angle about an axis.

    :param angle: the angle (rad).
    :param axis: x, y, z; of any length except zero.
    :returns: the unit quaternion.
    :raises ValueError: if the angle or the axis is not finite, or the axis has length zero.
    """
    needed = 'an axis must be three finite numbers x, y, z, not all zero'
    x, y, z = _numbers(axis, 3, needed)
    length = _length((x, y, z), needed)
    angle, = _numbers((angle,), 1, 'an angle must be a finite number (rad)')
    return _xyzw(quaternions.axangle2quat((x / length, y / length, z / length), angle, True))


def quaternion_matrix(quaternion: Iterable[float]) -> NDArray[np.float64]:
    """
    Return the homogeneous matrix of a rotation.

    :param quaternion: x, y, z, w.
    :returns: (4, 4) float64.
    :raises ValueError: if the quaternion is not finite or has length zero.
    """
    result = np.eye(4)
    result[:3, :3] = matrix(_unit(quaternion))
    return result


def quaternion_from_matrix(matrix: ArrayLike) -> Quaternion:
    """
    Return the rotation that a matrix describes.

    :param matrix: a (3, 3) rotation matrix, or a (4, 4) homogeneous matrix, whose translation is
        ignored.
    :returns: the unit quaternion with w >= 0.
    :raises ValueError: if the matrix has another shape, or does not describe a rotation.
    """
    given = np.asarray(matrix, dtype=np.float64)
    if given.shape not in ((3, 3), (4, 4)):
        raise ValueError(f'a matrix must be of shape (3, 3) or (4, 4), got {given.shape}')
    rotation, numbers = given[:3, :3], given.tolist()
    if len(given) == 4 and not abs(given[3] - (0.0, 0.0, 0.0, 1.0)).max() < _TOLERANCE:
        raise ValueError(f'the last row of a (4, 4) matrix must be 0, 0, 0, 1, got {numbers[3]}')
    with np.errstate(all='ignore'):
        error, determinant = abs(rotation @ rotation.T - np.eye(3)).max(), np.linalg.det(rotation)
    if not (error < _TOLERANCE and determinant > 0.0):
        raise ValueError(
            'the rows of a rotation matrix must be unit vectors at right angles, and its '
            f'determinant 1, got {numbers}: error {error:.2g}, determinant {determinant:.3g}')
    return _xyzw(quaternions.mat2quat(rotation))


def quaternion_multiply(quaternion1: Iterable[float], quaternion0: Iterable[float]) -> Quaternion:
    """
    Return the product of two quaternions: the rotation by `quaternion0`, then by `quaternion1`.

    :param quaternion1: x, y, z, w; of any length.
    :param quaternion0: x, y, z, w; of any length.
    :returns: the product; its length is the product of the two lengths.
    :raises ValueError: if a quaternion is not four finite numbers.
    """
    return multiply(_quaternion(quaternion1), _quaternion(quaternion0))


def quaternion_conjugate(quaternion: Iterable[float]) -> Quaternion:
    """
    Return a quaternion with the signs of x, y, z changed.

    The conjugate of a unit quaternion is its inverse.

    :param quaternion: x, y, z, w; of any length.
    :returns: the conjugate, of the same length.
    :raises ValueError: if the quaternion is not four finite numbers.
    """
    return conjugate(_quaternion(quaternion))


def quaternion_inverse(quaternion: Iterable[float]) -> Quaternion:
    """
    Return the inverse of a quaternion.

    The product of a quaternion and its inverse is (0, 0, 0, 1).

    :param quaternion: x, y, z, w.
    :returns: the inverse. Its length is 1 divided by the length of the given quaternion.
    :raises ValueError: if the quaternion is not finite or has length zero.
    """
    q = _quaternion(quaternion)
    length = _length(q, _NEEDED)
    return conjugate(_divided(_divided(q, length), length))


def quaternion_slerp(quat0: Iterable[float], quat1: Iterable[float], fraction: float,
                     spin: int = 0, shortestpath: bool = True) -> Quaternion:
    """
    Interpolate between two rotations (slerp), at constant angular velocity about a fixed axis.

    See K. Shoemake, Animating Rotation with Quaternion Curves, SIGGRAPH 1985. The formula here
    uses the sum and the difference of the two quaternions. So the result is accurate even if the
    quaternions are nearly equal.

    :param quat0: x, y, z, w of the first rotation.
    :param quat1: x, y, z, w of the second rotation.
    :param fraction: from 0 (`quat0`) to 1 (`quat1`); other values extrapolate.
    :param spin: the number of whole turns that are added between the two rotations.
    :param shortestpath: True: rotate by the smaller angle. False: if the dot product of the
        quaternions is negative, rotate by the larger angle, in the opposite direction. If the two
        rotations are equal, there is no axis, and `spin` and `shortestpath` have no effect.
    :returns: the unit quaternion. At fraction 0, the result is `quat0`, normalised; at fraction 1,
        the result is `quat1`, normalised.
    :raises ValueError: if a quaternion is not finite or has length zero, or if `fraction` or
        `spin` is not finite.
    """
    fraction, turns = _numbers((fraction, spin), 2, 'fraction and spin must be finite numbers')
    begin, end = _unit(quat0), _unit(quat1)
    if fraction in (0.0, 1.0):
        return end if fraction else begin
    if shortestpath and sum(a * b for a, b in zip(begin, end)) < 0.0:
        end = _divided(end, -1.0)
    difference = [b - a for a, b in zip(begin, end)]
    total = [a + b for a, b in zip(begin, end)]
    difference_norm, sum_norm = math.hypot(*difference), math.hypot(*total)
    if min(difference_norm, sum_norm) < _ROUNDING:  # the rotations are equal, so there is no axis
        return begin
    half = math.atan2(difference_norm, sum_norm)
    # The angle is measured from the mean of the two rotations.
    angle = fraction * (2.0 * half + turns * math.pi) - half
    along, middle = math.sin(angle) / difference_norm, math.cos(angle) / sum_norm
    return _unit([middle * m + along * d for m, d in zip(total, difference)])


def multiply(left: Iterable[float], right: Iterable[float]) -> Quaternion:
    """
    Return the product of two quaternions: the rotation by `right`, then by `left`.

    The arguments are not checked.

    :param left: x, y, z, w, of any length.
    :param right: x, y, z, w, of any length.
    :returns: the product; its length is the product of the two lengths.
    """
    return _xyzw(quaternions.qmult(_wxyz(left), _wxyz(right)))


def conjugate(rotation: Quaternion) -> Quaternion:
    """
    Return the inverse of a unit quaternion, without checks.

    :param rotation: x, y, z, w; of length 1.
    :returns: the quaternion with the signs of x, y, z changed.
    """
    x, y, z, w = rotation
    return -x, -y, -z, w


def matrix(rotation: Iterable[float]) -> NDArray[np.float64]:
    """
    Return the matrix of a rotation, without checks.

    :param rotation: x, y, z, w, of any length. A length below about 1e-8 gives the identity.
    :returns: (3, 3) float64.
    """
    converted: NDArray[np.float64] = quaternions.quat2mat(_wxyz(rotation))
    return converted


def _wxyz(rotation: Iterable[float]) -> Quaternion:
    """Reorder a quaternion from x, y, z, w to w, x, y, z, which is the order of transforms3d."""
    x, y, z, w = map(float, rotation)
    return w, x, y, z


def _xyzw(rotation: NDArray[np.float64]) -> Quaternion:
    """Reorder a quaternion from w, x, y, z, which is the order of transforms3d, to x, y, z, w."""
    w, x, y, z = rotation.tolist()
    return x, y, z, w


def _numbers(given: Iterable[float], count: int, needed: str) -> list[float]:
    """Return the numbers as floats; raise a ValueError if they are not `count` finite numbers."""
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
    """Normalise a quaternion; a quaternion of unit length is returned unchanged."""
    q = _quaternion(given)
    length = _length(q, _NEEDED)
    return q if abs(length - 1.0) < _ROUNDING else _divided(q, length)


def _divided(rotation: Quaternion, length: float) -> Quaternion:
    x, y, z, w = rotation
    return x / length, y / length, z / length, w / length


def _wrapped(angle: float) -> float:
    """Return an angle without its whole turns, in (-pi, pi]."""
    rest = math.remainder(angle, math.tau)
    return math.pi if rest == -math.pi else rest + 0.0


def _all_codes() -> dict[Axes, Code]:
    """Return a dict of the codes of all conventions; the keys are both the names and the codes."""
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
    Return the code of a convention of Euler angles; `axes` is the name or the code itself.

    :raises ValueError: if there is no such convention.

    >>> _code_of('sxyz')
    (0, 0, 0, 0)

    For rotating axes, the code describes the axes from the last to the first:

    >>> _code_of('rzyx')
    (0, 0, 0, 1)
    >>> _code_of('RZYX')
    (0, 0, 0, 1)

    In 'szxz', the first axis is z (2). The second axis is x, which follows z in the cycle
    x, y, z, x (0). The third axis is the same as the first axis (1). The axes are static (0):

    >>> _code_of('szxz')
    (2, 0, 1, 0)
    >>> _code_of((2, 0, 1, 0))
    (2, 0, 1, 0)
    """
    try:
        return _CODES[axes.lower() if isinstance(axes, str) else axes]
    except (KeyError, TypeError):
        raise ValueError(
            "axes must be 's' (static) or 'r' (rotating with the body) and three of x, y, z, "
            "where no axis follows itself, such as 'sxyz', 'rzyx' or 'szxz', or the code of a "
            f'convention, such as (0, 0, 0, 0) for sxyz; got {axes!r}') from None
