"""
Poses of frames in other frames: composition, inversion, interpolation and normalisation.

A pose is seven numbers: x, y, z (m) and the quaternion x, y, z, w of its rotation. *Columns* are
many poses: seven arrays, one for each of the seven numbers. A `Row` is a pose with its stamp and
the names of its two frames. `Rows` has the transforms of one message; `Batch` has the transforms
of several messages with the same frames.
"""

from array import array
from math import acos, log, nan, sin, sqrt
from typing import Any, NamedTuple, Union

import numpy as np
from numpy.typing import NDArray

#: x, y, z (m) and the quaternion x, y, z, w of the rotation.
Pose = tuple[float, float, float, float, float, float, float]
#: The quaternion x, y, z, w of a rotation.
Quaternion = tuple[float, float, float, float]
#: n poses: seven arrays of shape (n,). If all n poses are equal, the shape may be (1,).
Columns = tuple[Any, Any, Any, Any, Any, Any, Any]

#: The size of a pose (bytes) in histories and in messages: 7 float64.
POSE_BYTES = 7 * 8
#: The pose of a frame in itself.
IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
#: Before slerp, tf2 divides the dot product of the two quaternions by their norms. The norms are 1
#: up to rounding, so the division changes only the last bits. These bits matter only if the dot
#: product is close to 1: if it is larger than this number. Otherwise, the division is omitted.
_NEAR = 0.999999999999
#: If the dot products of many pairs of quaternions are larger than this number (rotations of less
#: than 16 degrees), slerp uses a series. The series is faster than sin and acos.
_SERIES = 0.99
#: The largest size that a frame's name may have (bytes of UTF-8).
LONGEST_NAME = 1024


def inverse(pose: Pose) -> Pose:
    """
    Return the inverse of a pose.

    :param pose: a_from_b, that is, the pose of b in a; one pose, or columns.
    :returns: b_from_a; one pose, or columns.
    """
    x, y, z, qx, qy, qz, qw = pose
    return compose((0.0, 0.0, 0.0, -qx, -qy, -qz, qw), (-x, -y, -z, 0.0, 0.0, 0.0, 1.0))


def compose(left: Pose, right: Pose) -> Pose:
    """
    Return the composition of two poses.

    A quaternion with the vector part q and the scalar part q_w rotates a vector v to
    v + q_w u + cross(q, u), where u = 2 cross(q, v).

    :param left: a_from_b; one pose, or columns.
    :param right: b_from_c; one pose, or columns.
    :returns: a_from_c; columns if `left` or `right` is columns.
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


def interpolate(two_poses: tuple[float, ...], ratio: float) -> Pose:
    """
    Interpolate between two poses: the translation linearly, the rotation by slerp.

    Slerp (spherical linear interpolation) follows the shorter arc. See K. Shoemake, Animating
    Rotation with Quaternion Curves, SIGGRAPH 1985.

    :param two_poses: the seven numbers of the first pose, then those of the second pose.
    :param ratio: from 0 (the first pose) to 1 (the second pose).
    :returns: the pose between them.
    """
    x, y, z, ax, ay, az, aw, nx, ny, nz, bx, by, bz, bw = two_poses
    s = 1.0 - ratio
    cosine = ax * bx + ay * by + az * bz + aw * bw
    sign = 1.0
    if cosine < 0.0:
        cosine, sign = -cosine, -1.0
    if cosine > _NEAR:
        cosine = min(1.0, cosine / sqrt((ax * ax + ay * ay + az * az + aw * aw)
                                        * (bx * bx + by * by + bz * bz + bw * bw)))
    x, y, z = s * x + ratio * nx, s * y + ratio * ny, s * z + ratio * nz
    angle = acos(cosine)
    if not angle:
        return x, y, z, ax, ay, az, aw
    scale = 1.0 / sin(angle)
    a, b = sin(s * angle) * scale, sin(ratio * angle) * scale * sign
    return x, y, z, a * ax + b * bx, a * ay + b * by, a * az + b * bz, a * aw + b * bw


def interpolate_columns(pairs: Columns, ratios: NDArray[np.float64]) -> Columns:
    """
    Interpolate between the two poses of many pairs, as `interpolate` does for one pair.

    :param pairs: seven arrays of shape (2, n): the first and the second pose of each of n pairs.
        They are overwritten.
    :param ratios: (2, n) the weights of the two poses: from 1, 0 (the first pose) to 0, 1 (the
        second pose).
    :returns: the n interpolated poses.
    """
    x, y, z, qx, qy, qz, qw = pairs
    weights = _slerp_weights(qx, qy, qz, qw, ratios)
    return (_weighted(x, ratios), _weighted(y, ratios), _weighted(z, ratios),
            _weighted(qx, weights), _weighted(qy, weights), _weighted(qz, weights),
            _weighted(qw, weights))


def _weighted(pair: Any, weights: NDArray[np.float64]) -> Any:
    pair *= weights
    return pair[0] + pair[1]


def _slerp_weights(x: Any, y: Any, z: Any, w: Any, ratios: NDArray[np.float64]
                   ) -> NDArray[np.float64]:
    """
    Compute the weights of the two quaternions of many pairs, so that their sum is the slerp.

    If the angle between the quaternions is p, the weight of a quaternion with the ratio s is
    sin(s p) / sin(p). Near p = 0, this is the series in u = 1 - cos(p)

        s (1 + (1 - s^2) u / 3 (1 + (4 - s^2) u / 10 (1 + (9 - s^2) u / 21 (1 + ...)))),

    in which the divisors are j (2 j + 1). See D. Eberly, A Fast and Accurate Algorithm for
    Computing SLERP, J. Graphics, GPU, and Game Tools 15 (2011). Each term is less than u / 2 times
    the term before it. The terms after the one with u^k are less than (u / 2)^(k + 1), for both
    weights together. The smallest k is used for which this is less than 1e-13.

    :returns: (2, n) float64.
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


def normalized(x: float, y: float, z: float, w: float) -> Quaternion:
    """
    Normalise a quaternion as tf2 does, by conversion to a rotation matrix and back.

    The operations and their order are those of tf2, so that the result equals that of tf2 to the
    last bit. The last bit matters: it changes the result of slerp between two rotations that
    differ by less than 1e-7 rad. The matrix is converted back as in S. W. Shepperd, Quaternion
    from Rotation Matrix, J. Guidance and Control 1 (1978).

    :param x: x of a quaternion of any length.
    :param y: y of the quaternion.
    :param z: z of the quaternion.
    :param w: w of the quaternion.
    :returns: the quaternion x, y, z, w of length 1. If the conversion fails, for example for a
        quaternion of length 0, four NaN are returned.
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


class Row(NamedTuple):
    """One transform of a message; its values are not checked or changed."""

    stamp_ns: int  #: time (ns)
    frame_id: str  #: the parent, possibly with a leading slash
    child_frame_id: str  #: the child, possibly with a leading slash
    pose: Pose  #: x, y, z (m) and a quaternion x, y, z, w of any length


class Rows(NamedTuple):
    """Transforms that are inserted one by one."""

    rows: list[Row]  #: the transforms, in the order of the message
    authority: str  #: the publisher, as `Frame.authority`
    is_static: bool  #: True if the transforms are from /tf_static


class Batch:
    """
    Messages of /tf with the same frames, in the order of their arrival.

    All transforms of one message have the same stamp.
    """

    __slots__ = ('authority', 'children', 'parents', 'poses', 'stamps')

    is_static = False

    def __init__(self, parents: list[str], children: list[str], authority: str) -> None:
        """
        Create a batch without messages.

        :param parents: the parent of each of the n transforms of a message, without a leading
            slash.
        :param children: the child of each of these transforms, without a leading slash; no two
            children are equal.
        :param authority: the publisher, as `Frame.authority`.
        """
        self.parents, self.children, self.authority = parents, children, authority
        #: (m,) the stamps (ns) of the m messages, strictly increasing.
        self.stamps = array('q')
        #: m * n poses, message by message. Each pose is the bytes of 7 float64: x, y, z (m) and a
        #: quaternion x, y, z, w of any length.
        self.poses: list[bytes] = []


#: The type of the items in the list that a source returns to a buffer.
BatchOrRows = Union[Batch, Rows]


def is_too_long(name: str) -> bool:
    """
    Return True if a name is too long for a frame.

    :param name: the name of a frame.
    :returns: True if the name has more than `LONGEST_NAME` bytes in UTF-8.
    """
    return (len(name) * 4 > LONGEST_NAME
            and len(name.encode('utf-8', 'surrogatepass')) > LONGEST_NAME)
