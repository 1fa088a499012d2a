"""Rotations as quaternions x, y, z, w."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from transforms3d import quaternions

Quaternion = tuple[float, float, float, float]

_NAN = (math.nan, math.nan, math.nan, math.nan)


def normalized(x: float, y: float, z: float, w: float) -> Quaternion:
    """
    Normalise a quaternion as tf2 does: to a rotation matrix and back.

    The operations are tf2's, in tf2's order, so that the result is tf2's to the last bit: between
    rotations that differ by less than 1e-7 rad, the last bit decides what slerp gives. Back from
    the matrix as in S. W. Shepperd, Quaternion from Rotation Matrix, J. Guidance and Control 1
    (1978). NaN where there is no such matrix.
    """
    try:
        s = 2.0 / (x * x + y * y + z * z + w * w)
        xs, ys, zs = x * s, y * s, z * s
        wx, wy, wz = w * xs, w * ys, w * zs
        xx, xy, xz = x * xs, x * ys, x * zs
        yy, yz, zz = y * ys, y * zs, z * zs
        m00, m11, m22 = 1.0 - (yy + zz), 1.0 - (xx + zz), 1.0 - (xx + yy)
        trace = m00 + m11 + m22
        if trace > 0.0:
            root = math.sqrt(trace + 1.0)
            s = 0.5 / root
            return (((yz + wx) - (yz - wx)) * s, ((xz + wy) - (xz - wy)) * s,
                    ((xy + wz) - (xy - wz)) * s, root * 0.5)
        if m00 < m22 if m00 >= m11 else m11 < m22:
            root = math.sqrt(m22 - m00 - m11 + 1.0)
            s = 0.5 / root
            return (((xz - wy) + (xz + wy)) * s, ((yz + wx) + (yz - wx)) * s,
                    root * 0.5, ((xy + wz) - (xy - wz)) * s)
        if m00 < m11:
            root = math.sqrt(m11 - m22 - m00 + 1.0)
            s = 0.5 / root
            return (((xy - wz) + (xy + wz)) * s, root * 0.5,
                    ((yz + wx) + (yz - wx)) * s, ((xz + wy) - (xz - wy)) * s)
        root = math.sqrt(m00 - m11 - m22 + 1.0)
        s = 0.5 / root
        return (root * 0.5, ((xy + wz) + (xy - wz)) * s,
                ((xz - wy) + (xz + wy)) * s, ((yz + wx) - (yz - wx)) * s)
    except (ZeroDivisionError, ValueError):
        return _NAN


def multiply(left: Quaternion, right: Quaternion) -> Quaternion:
    """Compose two rotations: first `right`, then `left`."""
    w, x, y, z = quaternions.qmult(_wxyz(left), _wxyz(right)).tolist()
    return x, y, z, w


def inverse(rotation: Quaternion) -> Quaternion:
    """Invert a rotation, given as a unit quaternion."""
    x, y, z, w = rotation
    return -x, -y, -z, w


def matrix(rotation: ArrayLike) -> NDArray[np.float64]:
    """
    Convert a rotation of any length to its (3, 3) matrix; that of (0, 0, 0, 0) is the identity.

    :param rotation: (4,) x, y, z, w.
    """
    converted: NDArray[np.float64] = quaternions.quat2mat(_wxyz(rotation))
    return converted


def _wxyz(rotation: ArrayLike) -> NDArray[np.float64]:
    """Reorder for transforms3d, whose quaternions are w, x, y, z."""
    return np.asarray(rotation, dtype=np.float64)[[3, 0, 1, 2]]
