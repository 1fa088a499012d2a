"""Interpolation between the poses of many pairs; `History.pose_at` does it for one pair."""

from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puretf._core.pose import Columns

#: If all dot products are larger than this number (rotations of less than 16 degrees), a series
#: replaces sin and acos, which take longer.
_SERIES = 0.99


def interpolate_columns(pairs: Columns, ratios: NDArray[np.float64]) -> Columns:
    """
    Interpolate between the two poses of n pairs, as `History.pose_at` does for one pair.

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


def _weights_of_many(x: Any, y: Any, z: Any, w: Any, ratios: NDArray[np.float64]) -> Any:
    """
    Return the (2, n) weights of the two quaternions of n pairs.

    sin(s p) / sin(p) is a series in u = 1 - cos(p), with the divisors j (2 j + 1):

        s (1 + (1 - s^2) u / 3 (1 + (4 - s^2) u / 10 (1 + (9 - s^2) u / 21 (1 + ...)))).

    See D. Eberly, A Fast and Accurate Algorithm for Computing SLERP, J. Graphics, GPU, and Game
    Tools 15 (2011). The terms after the one with u^k are less than (u / 2)^(k + 1), for both
    weights together. The smallest k is used for which this is less than 1e-13.
    """
    cosine = x[0] * x[1] + y[0] * y[1] + z[0] * z[1] + w[0] * w[1]
    smallest = cosine.min()
    sign: Any = 1.0
    weights: Any = 1.0
    if smallest < 0.0:
        sign = np.where(cosine < 0.0, -1.0, 1.0)
        cosine *= sign
    if smallest > _SERIES:
        u = 1.0 - cosine
        squares = ratios * ratios
        k = int(log(1e-13) / log(max(1.0 - smallest, 1e-9) / 2.0))
        for j in range(k, 0, -1):
            weights = weights * (j * j - squares)
            weights *= u / (j * (2 * j + 1))
            weights += 1.0
        weights *= ratios
    else:
        weights = np.sin(np.arccos(cosine) * ratios)
        weights /= np.sqrt((1.0 - cosine) * (1.0 + cosine))
        weights[1] *= sign
    same = cosine >= 1.0  # as in `History.pose_at`: the first pose
    weights[0][same], weights[1][same] = 1.0, 0.0
    return weights
