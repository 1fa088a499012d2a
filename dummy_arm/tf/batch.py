"""What a path gives at many times at once: the formulas of `path`, on arrays."""

from collections.abc import Sequence
from typing import Optional

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf.history import AnyHistory
from dummy_arm.tf.path import NEAR, Path

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
#: Translations x, y, z and rotations x, y, z, w: each a list of columns (n,).
_Columns = tuple[Sequence[Floats], Sequence[Floats]]


def poses(path: Path, times: Times) -> tuple[Floats, NDArray[np.bool_]]:
    """
    Compute the poses of the source in the target.

    :param path: a fixed one.
    :param times: (n,) ns; 0: the latest common time.
    :returns: (n, 7) x, y, z, qx, qy, qz, qw, and (n,) which of them are answers.
    """
    if not times.all():
        times = np.where(times == 0, path.latest_common_time(), times)
    known = np.ones(len(times), np.bool_)
    with np.errstate(invalid='ignore', over='ignore'):
        source = _compose(path.from_source, times, known)
        target = _compose(path.from_target, times, known)
        if target is None:
            columns = source
        else:
            (x, y, z), (qx, qy, qz, qw) = target
            back = (-qx, -qy, -qz, qw)
            if source is None:
                columns = _turn(back, (-x, -y, -z)), back
            else:
                (sx, sy, sz), rotation = source
                columns = _turn(back, (sx - x, sy - y, sz - z)), _multiply(back, rotation)
    result = np.empty((len(times), 7))
    assert columns is not None
    for i, column in enumerate((*columns[0], *columns[1])):
        result[:, i] = column
    return result, known


def _compose(edges: Sequence[AnyHistory], times: Times, known: NDArray[np.bool_]
             ) -> Optional[_Columns]:
    """Compose a chain from its lowest edge up; clear `known` where an edge has no pose."""
    composed: Optional[_Columns] = None
    for edge in edges:
        position, rotation = _interpolate(edge, times, known)
        if composed is not None:
            position = [a + b for a, b in zip(position, _turn(rotation, composed[0]))]
            rotation = _multiply(rotation, composed[1])
        composed = position, rotation
    return composed


def _interpolate(edge: AnyHistory, times: Times, known: NDArray[np.bool_]) -> _Columns:
    if edge.is_static:
        columns = list(np.array([edge.pose_at(0)]).T)
        return columns[:3], columns[3:]
    stamps = np.frombuffer(edge.stamps, np.int64)[edge.start:]
    samples = np.frombuffer(edge.poses).reshape(-1, 7)[edge.start:]
    try:
        newest = len(stamps) - 1
        before = stamps.searchsorted(times, 'right') - 1
        known &= (before >= 0) & ((before < newest) | (times == stamps[newest]) | (times == 0))
        if edge.regular is not edge.stamps:
            before[(times == stamps[0]) & (times != stamps[newest])] = 0
        if edge.latest == 0:
            before[times == 0] = newest
        before.clip(0, newest, out=before)
        after = np.minimum(before + 1, newest)
        stamps_before = stamps.take(before)
        # As unsigned numbers, since a span of time may be longer than an int64.
        span = (stamps.take(after) - stamps_before).view(np.uint64)
        span[span == 0] = 1
        r = (times - stamps_before).view(np.uint64) / span
        # Copied into columns, which are far faster to work on than rows.
        ax, ay, az, aqx, aqy, aqz, aqw = samples.take(before, axis=0).T.copy()
        bx, by, bz, bqx, bqy, bqz, bqw = samples.take(after, axis=0).T.copy()
    finally:
        del stamps, samples  # whatever happens: an array that is looked at cannot grow
    s = 1.0 - r
    position = s * ax + r * bx, s * ay + r * by, s * az + r * bz
    cosine = aqx * bqx + aqy * bqy + aqz * bqz + aqw * bqw
    sign = np.where(cosine < 0.0, -1.0, 1.0)
    cosine *= sign
    if (cosine > NEAR).any():
        cosine /= np.sqrt((aqx * aqx + aqy * aqy + aqz * aqz + aqw * aqw)
                          * (bqx * bqx + bqy * bqy + bqz * bqz + bqw * bqw))
    angle = np.arccos(np.minimum(cosine, 1.0))
    same = angle == 0.0
    scale = 1.0 / np.where(same, 1.0, np.sin(angle))
    s = np.where(same, 1.0, np.sin(s * angle) * scale)
    r = np.sin(r * angle) * scale * sign
    return position, (s * aqx + r * bqx, s * aqy + r * bqy, s * aqz + r * bqz, s * aqw + r * bqw)


def _turn(rotation: Sequence[Floats], vector: Sequence[Floats]) -> Sequence[Floats]:
    qx, qy, qz, qw = rotation
    x, y, z = vector
    ux, uy, uz = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
    return (x + qw * ux + qy * uz - qz * uy, y + qw * uy + qz * ux - qx * uz,
            z + qw * uz + qx * uy - qy * ux)


def _multiply(left: Sequence[Floats], right: Sequence[Floats]) -> Sequence[Floats]:
    ax, ay, az, aw = left
    bx, by, bz, bw = right
    return (aw * bx + ax * bw + ay * bz - az * by, aw * by + ay * bw + az * bx - ax * bz,
            aw * bz + az * bw + ax * by - ay * bx, aw * bw - ax * bx - ay * by - az * bz)
