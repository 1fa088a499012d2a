"""What a path gives at many times at once: the formulas of `path`, on arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf.path import compose, IDENTITY, inverse, NEAR, Path
from dummy_arm.tf.static_history import AnyHistory

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
#: x, y, z and qx, qy, qz, qw: a column (n,) each, or (1,) of what is static.
_Columns = tuple[Any, Any, Any, Any, Any, Any, Any]


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
        columns = _along(path.from_source, times, known)
        if path.from_target:
            target_from_top = inverse(_along(path.from_target, times, known))
            columns = compose(target_from_top, columns) if path.from_source else target_from_top
    result = np.empty((len(times), 7))
    for i, column in enumerate(columns):
        result[:, i] = column
    return result, known


def _along(edges: Sequence[AnyHistory], times: Times, known: NDArray[np.bool_]) -> _Columns:
    """Compose a chain from its lowest edge up; clear `known` where an edge has no pose."""
    composed: _Columns = IDENTITY
    for i, edge in enumerate(edges):
        pose = _interpolate(edge, times, known)
        composed = compose(pose, composed) if i else pose
    return composed


def _interpolate(edge: AnyHistory, times: Times, known: NDArray[np.bool_]) -> _Columns:
    if edge.is_static:
        return tuple(np.array([edge.pose_at(0)]).T)
    samples, offset = edge.place
    stamps = np.frombuffer(samples.stamps, np.int64)[samples.start:]
    poses = samples.poses_of(offset)[samples.start:]
    try:
        newest = len(stamps) - 1
        before = stamps.searchsorted(times, 'right') - 1
        known &= (before >= 0) & ((before < newest) | (times == stamps[newest]) | (times == 0))
        if samples.regular is not samples.stamps:
            before[(times == stamps[0]) & (times != stamps[newest])] = 0
        if samples.latest == 0:
            before[times == 0] = newest
        before.clip(0, newest, out=before)
        after = np.minimum(before + 1, newest)
        stamps_before = stamps.take(before)
        # As unsigned numbers, since a span of time may be longer than an int64.
        span = (stamps.take(after) - stamps_before).view(np.uint64)
        span[span == 0] = 1
        r = (times - stamps_before).view(np.uint64) / span
        ax, ay, az, aqx, aqy, aqz, aqw = _columns(poses[before])
        bx, by, bz, bqx, bqy, bqz, bqw = _columns(poses[after])
    finally:
        del stamps, poses  # whatever happens: an array that is looked at cannot grow
    s = 1.0 - r
    x, y, z = s * ax + r * bx, s * ay + r * by, s * az + r * bz
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
    return (x, y, z, s * aqx + r * bqx, s * aqy + r * bqy, s * aqz + r * bqz,
            s * aqw + r * bqw)


def _columns(poses: NDArray[np.void]) -> Floats:
    """Copy poses into columns, which are far faster to work on than rows."""
    columns: Floats = poses.view(np.float64).reshape(-1, 7).T.copy()
    return columns
