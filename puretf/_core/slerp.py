"""
Slerp, spherical linear interpolation: of a single pose, and of many at once.

See K. Shoemake, Animating Rotation with Quaternion Curves, SIGGRAPH 1985.
"""

from math import acos, log, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puretf._core.pose import Columns, Pose

#: tf2 divides the dot product of the two quaternions by their norms, which are 1 up to rounding.
#: That matters only if the dot product is larger than this; otherwise, no division is made.
_NEAR = 0.999999999999
#: If all dot products are larger than this number (rotations of less than 16 degrees), a series
#: replaces sin and acos, which take longer.
_SERIES = 0.99


def slerp_weights(angle: float, ratio: float) -> tuple[float, float]:
    """
    Return the weights with which the sum of two unit quaternions is their slerp.

    :param angle: the angle between the two as vectors (rad), half of the rotation between them.
    """
    scale = 1.0 / sin(angle)
    return sin((1.0 - ratio) * angle) * scale, sin(ratio * angle) * scale


def interpolate(two_poses: tuple[float, ...], ratio: float) -> Pose:
    """
    Interpolate between two poses as tf2: position linearly, rotation through the smaller angle.

    :param two_poses: the seven numbers of the first pose, then those of the second pose.
    :param ratio: from 0 (the first pose) to 1 (the second pose).
    """
    x, y, z, ax, ay, az, aw, nx, ny, nz, bx, by, bz, bw = two_poses
    cosine = ax * bx + ay * by + az * bz + aw * bw
    if cosine < 0.0:
        cosine, bx, by, bz, bw = -cosine, -bx, -by, -bz, -bw
    if cosine > _NEAR:
        cosine /= sqrt((ax * ax + ay * ay + az * az + aw * aw)
                       * (bx * bx + by * by + bz * bz + bw * bw))
    a, b = slerp_weights(acos(cosine), ratio) if cosine < 1.0 else (1.0, 0.0)
    s = 1.0 - ratio
    return (s * x + ratio * nx, s * y + ratio * ny, s * z + ratio * nz,
            a * ax + b * bx, a * ay + b * by, a * az + b * bz, a * aw + b * bw)


def interpolate_columns(pairs: Columns, ratios: NDArray[np.float64]) -> Columns:
    """
    Interpolate between the two poses of n pairs, as `interpolate` does for one pair.

    :param pairs: seven arrays of shape (2, n), which are overwritten.
    :param ratios: (2, n) from 1, 0 (the first pose) to 0, 1 (the second pose).
    """
    x, y, z, qx, qy, qz, qw = pairs
    weights = _weights_of_many(qx, qy, qz, qw, ratios)
    return (_weighted(x, ratios), _weighted(y, ratios), _weighted(z, ratios),
            _weighted(qx, weights), _weighted(qy, weights), _weighted(qz, weights),
            _weighted(qw, weights))


def _weighted(pair: Any, weights: NDArray[np.float64]) -> Any:
    pair *= weights
    return pair[0] + pair[1]


def _weights_of_many(x: Any, y: Any, z: Any, w: Any, ratios: NDArray[np.float64]
                     ) -> NDArray[np.float64]:
    """
    Return the (2, n) weights of the two quaternions of n pairs; see `slerp_weights`.

    sin(s p) / sin(p) is a series in u = 1 - cos(p), with the divisors j (2 j + 1):

        s (1 + (1 - s^2) u / 3 (1 + (4 - s^2) u / 10 (1 + (9 - s^2) u / 21 (1 + ...)))).

    See D. Eberly, A Fast and Accurate Algorithm for Computing SLERP, J. Graphics, GPU, and Game
    Tools 15 (2011). The terms after the one with u^k are less than (u / 2)^(k + 1), for both
    weights together. The smallest k is used for which this is less than 1e-13.
    """
    cosine = x[0] * x[1] + y[0] * y[1] + z[0] * z[1] + w[0] * w[1]
    smallest = cosine.min()
    sign = np.where(cosine < 0.0, -1.0, 1.0) if smallest < 0.0 else 1.0
    cosine *= sign
    has_near = cosine.max() > _NEAR
    if has_near:
        norms = x * x + y * y + z * z + w * w
        cosine /= np.sqrt(norms[0] * norms[1])
    if smallest > _SERIES:
        u = 1.0 - cosine
        squares = ratios * ratios
        weights = np.ones_like(ratios)
        k = int(log(1e-13) / log(max(u.max(), 1e-9) / 2.0))
        for j in range(k, 0, -1):
            weights *= j * j - squares
            weights *= u / (j * (2 * j + 1))
            weights += 1.0
        weights *= ratios
    else:
        weights = np.sin(np.arccos(cosine) * ratios)
        weights /= np.sqrt((1.0 - cosine) * (1.0 + cosine))
        weights[1] *= sign
    if has_near:
        # As in `interpolate`: if the cosine is 1 up to rounding, the result is the first pose.
        same = cosine >= 1.0
        weights[0][same], weights[1][same] = 1.0, 0.0
    return weights
