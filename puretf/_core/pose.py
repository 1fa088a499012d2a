"""A pose, a pose with names and a stamp, the poses of messages, and how poses are composed."""

from array import array
from math import copysign, inf, isfinite, nan, sqrt
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
#: The smallest number of rotations that numpy normalises faster than a loop does.
_MANY = 12


class Row(NamedTuple):
    """One transform of a message; its values are not checked or changed."""

    stamp_ns: int  #: time (ns)
    frame_id: str  #: the parent, possibly with a leading slash
    child_frame_id: str  #: the child, possibly with a leading slash
    pose: Pose  #: x, y, z (m) and a quaternion x, y, z, w of any length


class Rows(NamedTuple):
    """The transforms of one message, which are inserted one by one."""

    rows: list[Row]
    authority: str  #: the publisher
    is_static: bool  #: True if the message is from /tf_static


class Batch:
    """m messages of /tf with the same n frames, in the order of their arrival."""

    def __init__(self, parents: list[str], children: list[str], authority: str) -> None:
        #: (n) names without a leading slash; no two children are equal.
        self.parents, self.children, self.authority = parents, children, authority
        #: (m,) one stamp (ns) for each message, strictly increasing.
        self.stamps = array('q')
        #: m * n poses, message by message, each as the bytes of 7 float64.
        self.poses: list[bytes] = []
        self.nanosec = 0  #: a `nanosec` of a stamp that is 10**9 or more; 0: there is none


BatchOrRows = Union[Batch, Rows]


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
    Normalise a quaternion; the sign is that of tf2, which converts it to a matrix and back.

    Four NaN are returned for a quaternion of length 0, or whose square is not finite.
    """
    square = x * x + y * y + z * z + w * w
    if not 0.0 < square < inf:
        return nan, nan, nan, nan
    norm = copysign(sqrt(square), w if 4.0 * w * w > square else max(x, y, z, key=abs))
    return x / norm + 0.0, y / norm + 0.0, z / norm + 0.0, w / norm + 0.0  # no -0.0


def normalize_poses(poses: NDArray[np.float64]) -> bool:
    """
    Normalise the rotations of (n, 7) poses in place, as `normalized` does.

    Return False if a number is not finite, or a rotation cannot be normalised.
    """
    if len(poses) < _MANY:
        poses[:, 3:] = [normalized(*rotation) for rotation in poses[:, 3:].tolist()]
        return all(map(isfinite, poses.ravel().tolist()))
    rotations = poses[:, 3:].T
    with np.errstate(all='ignore'):
        squares = np.add.reduce(rotations * rotations)
        w = rotations[3]
        is_large = 4.0 * w * w > squares
        decisive = w if is_large.all() else np.where(is_large, w, np.take_along_axis(
            rotations, abs(rotations[np.newaxis, :3]).argmax(1), 0))
        poses[:, 3:] = (rotations / np.copysign(np.sqrt(squares), decisive) + 0.0).T
        return isfinite(poses.sum() + squares.sum())
