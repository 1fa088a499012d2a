"""
Rotations as quaternions x, y, z, w; the functions are named as in tf_transformations.

Angles are in rad. An argument may be a quaternion of either sign, and of any length except zero; a
result has length 1. A ValueError is raised if a number is not finite, or a quaternion has length
zero. Where a function differs, its docstring says so.
"""

from collections.abc import Iterable
from itertools import product
import math
import sys
from typing import Union

import numpy as np
from numpy.typing import ArrayLike, NDArray
from transforms3d import euler, quaternions

from puretf._core.pose import Quaternion as Quaternion
from puretf._core.pose import signed as signed

#: The code of a convention of Euler angles, as in K. Shoemake, Euler Angle Conversion, Graphics
#: Gems IV (1994): first axis (0, 1, 2 for x, y, z); parity (0 if the second axis follows the first
#: one in the cycle x, y, z, x); repetition (1 if the third axis is the first one); frame (1 if the
#: axes rotate with the body; the other numbers then describe the axes in reverse order).
Code = tuple[int, int, int, int]
#: A convention of Euler angles: its name, such as 'sxyz', or its code, such as (0, 0, 0, 0).
Axes = Union[str, Code]

#: The largest rounding error: a length that differs from 1 or 0 by less counts as 1 or 0.
_ROUNDING = 4.0 * sys.float_info.epsilon
#: The largest error that is accepted in a matrix, which may have been typed by hand.
_TOLERANCE = 1e-3
_NEEDED = 'a quaternion must have a finite length that is not zero; the identity is (0, 0, 0, 1)'


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Axes = 'sxyz') -> Quaternion:
    """
    Return the rotation by three Euler angles: first by `ai`, then by `aj`, then by `ak`.

    :param axes: the convention: its `Code`, or its name: 's' if the axes are static, 'r' if they
        rotate with the body, and the three axes, as in 'sxyz' (roll, pitch, yaw).
    :raises ValueError: also if the convention does not exist.

    Three calls that return the same rotation by roll, pitch and yaw:

    >>> (quaternion_from_euler(0.1, 0.2, 0.3, 'sxyz')
    ...  == quaternion_from_euler(0.3, 0.2, 0.1, 'rzyx')
    ...  == quaternion_from_euler(0.1, 0.2, 0.3, (0, 0, 0, 0)))
    True
    """
    angles = _numbers((ai, aj, ak), 3, 'Euler angles must be three finite numbers (rad)')
    return _xyzw(euler.euler2quat(*angles, _code_of(axes)))


def euler_from_quaternion(quaternion: Iterable[float], axes: Axes = 'sxyz'
                          ) -> tuple[float, float, float]:
    """
    Return the Euler angles of a rotation; the inverse function is `quaternion_from_euler`.

    The method is accurate near gimbal lock, too. See E. Bernardes and S. Viollet, Quaternion to
    Euler angles conversion: A direct, general and computationally efficient method, PLoS ONE 17
    (2022).

    :returns: `ai`, `aj`, `ak` (rad). `ai` and `ak` are in (-pi, pi], `aj` is in [-pi/2, pi/2]. If
        the last axis is the first one, as in 'sxyx', `aj` is in [0, pi] if the axes begin with xy,
        yz or zx, otherwise in [-pi, 0]. At gimbal lock, `ak` (or `ai` for rotating axes) is 0.
    :raises ValueError: also if the convention does not exist.

    >>> euler_from_quaternion((0.0, 0.0, 1.0, 0.0), 'sxyz')
    (0.0, 0.0, 3.141592653589793)
    """
    i, parity, repetition, frame = _code_of(axes)
    q = signed(*_unit(quaternion))
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
    middle = (-middle if parity else middle) + 0.0
    return (last, middle, first) if frame else (first, middle, last)


def quaternion_about_axis(angle: float, axis: Iterable[float]) -> Quaternion:
    """Return the rotation by an angle (rad) about an axis x, y, z of any length except zero."""
    needed = 'an axis must be three finite numbers x, y, z, not all zero'
    x, y, z = _numbers(axis, 3, needed)
    length = _length((x, y, z), needed)
    angle, = _numbers((angle,), 1, 'an angle must be a finite number (rad)')
    return _xyzw(quaternions.axangle2quat((x / length, y / length, z / length), angle, True))


def quaternion_matrix(quaternion: Iterable[float]) -> NDArray[np.float64]:
    """Return the homogeneous matrix of a rotation, (4, 4) float64."""
    result = np.eye(4)
    result[:3, :3] = matrix(_unit(quaternion))
    return result


def quaternion_from_matrix(matrix: 'ArrayLike') -> Quaternion:
    """
    Return the rotation that a matrix describes, with w >= 0.

    :param matrix: (3, 3), or (4, 4) and homogeneous, whose translation is ignored.
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

    Its length is the product of the two lengths, which may be zero.
    """
    return multiply(_quaternion(quaternion1), _quaternion(quaternion0))


def quaternion_conjugate(quaternion: Iterable[float]) -> Quaternion:
    """Return a quaternion of any length with the signs of x, y, z changed."""
    return conjugate(_quaternion(quaternion))


def quaternion_inverse(quaternion: Iterable[float]) -> Quaternion:
    """Return the quaternion whose product with the given one is (0, 0, 0, 1)."""
    q = _quaternion(quaternion)
    length = _length(q, _NEEDED)
    return conjugate(_divided(_divided(q, length), length))


def quaternion_slerp(quat0: Iterable[float], quat1: Iterable[float], fraction: float,
                     spin: int = 0, shortestpath: bool = True) -> Quaternion:
    """
    Interpolate between two rotations (slerp), at constant angular velocity about a fixed axis.

    :param fraction: from 0 (`quat0`, exactly) to 1 (`quat1`); other values extrapolate.
    :param spin: the number of whole turns that are added between the two rotations. If it is odd,
        results of tf_transformations differ, and do not have length 1.
    :param shortestpath: True: rotate by the smaller angle. False: if the dot product of the
        quaternions is negative, rotate by the larger angle, in the opposite direction. If the two
        rotations are equal, there is no axis, and `spin` and `shortestpath` have no effect.
    """
    fraction, turns = _numbers((fraction, spin), 2, 'fraction and spin must be finite numbers')
    begin, end = _unit(quat0), _unit(quat1)
    if fraction in (0.0, 1.0):
        return end if fraction else begin
    if shortestpath and sum(a * b for a, b in zip(begin, end)) < 0.0:
        end = _divided(end, -1.0)
    difference = math.hypot(*(b - a for a, b in zip(begin, end)))
    total = math.hypot(*(a + b for a, b in zip(begin, end)))
    if min(difference, total) < _ROUNDING:  # the rotations are equal, so there is no axis
        return begin
    # The arc cosine of the dot product would not be accurate for small angles.
    angle = 2.0 * math.atan2(difference, total)
    ratio = fraction * (1.0 + turns * math.pi / angle)
    first, second = math.sin((1.0 - ratio) * angle), math.sin(ratio * angle)
    return _unit([first * a + second * b for a, b in zip(begin, end)])


def multiply(left: Iterable[float], right: Iterable[float]) -> Quaternion:
    """Return what `quaternion_multiply` returns, without checks."""
    return _xyzw(quaternions.qmult(_wxyz(left), _wxyz(right)))


def conjugate(rotation: Quaternion) -> Quaternion:
    """Return what `quaternion_conjugate` returns, without checks."""
    x, y, z, w = rotation
    return -x, -y, -z, w


def matrix(rotation: Iterable[float]) -> NDArray[np.float64]:
    """Return the (3, 3) matrix of a rotation, unchecked; the identity for a length below 1e-8."""
    return np.asarray(quaternions.quat2mat(_wxyz(rotation)))


def _wxyz(rotation: Iterable[float]) -> Quaternion:
    x, y, z, w = map(float, rotation)
    return w, x, y, z


def _xyzw(rotation: NDArray[np.float64]) -> Quaternion:
    w, x, y, z = rotation.tolist()
    return x, y, z, w


def _numbers(given: Iterable[float], count: int, needed: str) -> list[float]:
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
    """Normalise a quaternion; one of length 1 stays as it is, to the last bit."""
    q = _quaternion(given)
    length = _length(q, _NEEDED)
    return q if abs(length - 1.0) < _ROUNDING else _divided(q, length)


def _divided(rotation: Quaternion, length: float) -> Quaternion:
    x, y, z, w = rotation
    return x / length, y / length, z / length, w / length


def _wrapped(angle: float) -> float:
    rest = math.remainder(angle, math.tau)
    return math.pi if rest == -math.pi else rest + 0.0


def _name_of(code: Code) -> str:
    i, parity, repetition, frame = code
    j = (i + 1 + parity) % 3
    order = 'xyz'[i] + 'xyz'[j] + 'xyz'[i if repetition else 3 - i - j]
    return f'r{order[::-1]}' if frame else f's{order}'


#: The codes of all conventions, by their names and by themselves.
_CODES: dict[Axes, Code] = {key: code for code in product(range(3), range(2), range(2), range(2))
                            for key in (code, _name_of(code))}


def _code_of(axes: Axes) -> Code:
    try:
        return _CODES[axes.lower() if isinstance(axes, str) else axes]
    except (KeyError, TypeError):
        raise ValueError(
            "axes must be 's' (static) or 'r' (rotating with the body) and three of x, y, z, "
            "where no axis follows itself, such as 'sxyz', 'rzyx' or 'szxz', or the code of a "
            f'convention, such as (0, 0, 0, 0) for sxyz; got {axes!r}') from None
