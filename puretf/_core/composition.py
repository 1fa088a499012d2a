"""Composition, inversion and normalisation of poses, with tf2's arithmetic."""

from math import nan, sqrt

import numpy as np
from numpy.typing import NDArray

from puretf._core.pose import IDENTITY, Pose, Quaternion


def inverse(pose: Pose) -> Pose:
    """Return b_from_a for a_from_b, the pose of b in a; one pose, or columns. See `compose`."""
    x, y, z, qx, qy, qz, qw = pose
    ux, uy, uz = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
    return (qw * ux - x - qy * uz + qz * uy,
            qw * uy - y - qz * ux + qx * uz,
            qw * uz - z - qx * uy + qy * ux,
            -qx, -qy, -qz, qw)


def compose(left: Pose, right: Pose) -> Pose:
    """
    Return a_from_c for a_from_b and b_from_c; each is one pose, or columns.

    A quaternion with the vector part q and the scalar part q_w rotates a vector v to
    v + q_w u + cross(q, u), where u = 2 cross(q, v).
    """
    x, y, z, ax, ay, az, aw = left
    vx, vy, vz, bx, by, bz, bw = right
    ux, uy, uz = 2.0 * (ay * vz - az * vy), 2.0 * (az * vx - ax * vz), 2.0 * (ax * vy - ay * vx)
    return (x + vx + aw * ux + ay * uz - az * uy,
            y + vy + aw * uy + az * ux - ax * uz,
            z + vz + aw * uz + ax * uy - ay * ux,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by + ay * bw + az * bx - ax * bz,
            aw * bz + az * bw + ax * by - ay * bx,
            aw * bw - ax * bx - ay * by - az * bz)


def signed(x: float, y: float, z: float, w: float) -> Quaternion:
    """Return q or -q: the one that tf2 and KDL compute from the matrix of the rotation."""
    largest = w if w * w - 0.25 > 1e-12 else max(z, y, x, key=abs)
    return (-x, -y, -z, -w) if largest < 0.0 else (x, y, z, w)


def matrices(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the homogeneous matrices, (n, 4, 4), of n poses, (7, n)."""
    result = np.tile(np.eye(4), (columns.shape[1], 1, 1))
    result[:, :3, 3] = columns[:3].T
    x, y, z, w = columns[3:]
    for i in range(3):
        unit = (*np.eye(3)[i].tolist(), *IDENTITY[3:])
        result[:, :3, i] = np.transpose(compose((0.0, 0.0, 0.0, x, y, z, w), unit)[:3])
    return result


def normalized(x: float, y: float, z: float, w: float) -> Quaternion:
    """
    Normalise a quaternion as tf2 does, by conversion to a rotation matrix and back.

    The operations and their order are those of tf2, since the last bit matters: it changes slerp
    between rotations that differ by less than 1e-7 rad. The matrix is converted as in S. W.
    Shepperd, Quaternion from Rotation Matrix, J. Guidance and Control 1 (1978). If the conversion
    fails, for example for a quaternion of length 0, four NaN are returned.
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
            root = sqrt(trace + 1.0)
            s = 0.5 / root
            return (((yz + wx) - (yz - wx)) * s, ((xz + wy) - (xz - wy)) * s,
                    ((xy + wz) - (xy - wz)) * s, root * 0.5)
        if m00 < m22 if m00 >= m11 else m11 < m22:
            root = sqrt(m22 - m00 - m11 + 1.0)
            s = 0.5 / root
            return (((xz - wy) + (xz + wy)) * s, ((yz + wx) + (yz - wx)) * s,
                    root * 0.5, ((xy + wz) - (xy - wz)) * s)
        if m00 < m11:
            root = sqrt(m11 - m22 - m00 + 1.0)
            s = 0.5 / root
            return (((xy - wz) + (xy + wz)) * s, root * 0.5,
                    ((yz + wx) + (yz - wx)) * s, ((xz + wy) - (xz - wy)) * s)
        root = sqrt(m00 - m11 - m22 + 1.0)
        s = 0.5 / root
        return (root * 0.5, ((xy + wz) + (xy - wz)) * s,
                ((xz - wy) + (xz + wy)) * s, ((yz + wx) - (yz - wx)) * s)
    except (ZeroDivisionError, ValueError):
        return (nan, nan, nan, nan)
