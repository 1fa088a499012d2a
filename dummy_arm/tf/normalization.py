"""Normalising rotations as tf2 does, to the last bit."""

import math

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf.rotations import Quaternion

#: From so many rotations on, arrays of them are faster.
_MANY = 20
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


def normalize_poses(poses: NDArray[np.float64]) -> bool:
    """
    Normalise the rotations of many poses, each as `normalized` does.

    :param poses: (n, 7) x, y, z, qx, qy, qz, qw; changed in place.
    :returns: True when all is finite; of numbers so large that their sum is not, False.
    """
    rotations = poses[:, 3:]
    if len(poses) < _MANY:
        rotations[:] = [normalized(*rotation) for rotation in rotations.tolist()]
        return all(map(math.isfinite, poses.ravel().tolist()))
    q = rotations.T.copy()
    result = np.empty_like(q)
    with np.errstate(all='ignore'):
        doubled = q[:3] * (2.0 / np.add.reduce(q * q))
        w_xyz = q[3] * doubled
        products = q[:3, np.newaxis] * doubled
        xx, yy, zz = products[0, 0], products[1, 1], products[2, 2]
        mixed = np.array((products[1, 2], products[0, 2], products[0, 1]))
        trace = 1.0 - (yy + zz)
        trace += 1.0 - (xx + zz)
        trace += 1.0 - (xx + yy)
        root = np.sqrt(trace + 1.0)
        above, below = mixed + w_xyz, mixed - w_xyz
        np.multiply(above - below, 0.5 / root, result[:3])
        np.multiply(root, 0.5, result[3])
        if not trace.min() > 0.0:
            diagonal = 1.0 - np.array((yy + zz, xx + zz, xx + yy))
            _turn_far(~(trace > 0.0), diagonal, above, below, result)
        rotations[:] = result.T
        return math.isfinite(poses.sum())


def _turn_far(rows: NDArray[np.bool_], diagonal: NDArray[np.float64], above: NDArray[np.float64],
              below: NDArray[np.float64], result: NDArray[np.float64]) -> None:
    """
    Set some quaternions of matrices whose trace is not positive.

    :param above: (3, n) the elements 21, 02, 10.
    :param below: (3, n) the elements 12, 20, 01.
    """
    m0, m1, m2 = diagonal
    largest = np.where(np.where(m0 >= m1, m0, m1) < m2, 2, np.where(m0 < m1, 1, 0))
    for i, j, k in (0, 1, 2), (1, 2, 0), (2, 0, 1):
        n = (rows & (largest == i)).nonzero()[0]
        if len(n):
            root = np.sqrt(diagonal[i, n] - diagonal[j, n] - diagonal[k, n] + 1.0)
            scale = 0.5 / root
            result[i, n] = root * 0.5
            result[j, n] = (above[k, n] + below[k, n]) * scale
            result[k, n] = (above[j, n] + below[j, n]) * scale
            result[3, n] = (above[i, n] - below[i, n]) * scale
