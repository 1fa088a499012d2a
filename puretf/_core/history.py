"""The history of one frame: samples of its pose in its parent, in the order of their stamps."""

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from math import acos, log, sin
from operator import index, itemgetter
import struct
from time import monotonic_ns
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

from puretf._core.frames import Frame
from puretf._core.pose import Columns, Pose, POSE_BYTES
from puretf._text.times import SECOND

#: The largest number of samples with the same stamp. Lookups use only the first and the last of
#: them.
MAX_SAMPLES_PER_STAMP = 100
#: If all dot products are larger than this number (rotations of less than 16 degrees), a series
#: replaces sin and acos, which take longer.
_SERIES = 0.99
_pack_pose = struct.Struct('7d').pack
_read_pose = struct.Struct('7d').unpack_from
_read_two_poses = struct.Struct('14d').unpack_from


class NoPose(LookupError):
    """The history has no pose for the requested time."""


class Neighbours:
    """
    Many times, and for each time the two neighbouring samples: the one before and the one after.

    Frames that arrive together have the same stamps, so the next history is searched only if its
    stamps differ.
    """

    def __init__(self, times: NDArray[np.int64]) -> None:
        self._times, self._samples = times, array('q')
        self.first, self.last = int(times.min()), int(times.max())
        #: (2, n) the indices of the samples in `search`.
        self.indices: NDArray[np.intp] = np.empty((2, 0), np.intp)
        #: (2, n) the weights of the samples in a linear interpolation.
        self.ratios: NDArray[np.float64] = np.empty((2, 0))

    def search(self, samples: 'array[int]') -> None:
        """Search among the stamps of samples, of which at most one is before the first time."""
        if samples == self._samples:
            return
        self._samples, stamps = samples, np.array(samples)
        before = stamps.searchsorted(self._times, 'right') - 1
        if stamps[0] != stamps[-1]:
            before[self._times == stamps[0]] = 0  # as `History.find` does
        self.indices = np.stack((before, np.minimum(before + 1, len(stamps) - 1)))
        begin, end = stamps[self.indices]
        # The difference of two int64 may be too large for an int64, but not for a uint64.
        span = np.maximum((end - begin).view(np.uint64), 1)
        ratio = (self._times - begin).view(np.uint64) / span
        self.ratios = np.stack((1.0 - ratio, ratio))


class History:
    """
    The samples of a frame; `StaticHistory` is that of a static one.

    A sample is *expired* if it is older than the newest sample by more than the cache time. Before
    a new sample is inserted, the expired samples are dropped.

    The stamp of sample i is `stamps[i]` (ns). Its pose is `poses[56 * i:56 * i + 56]`, the bytes
    of 7 float64. The samples before the index `start` are dropped, but they stay in memory until
    `drop_before` removes many of them at once. If `parents` is None, all samples have the parent
    `only_parent`. Otherwise `only_parent` is '', and `parents[i]` is the parent of sample i. The
    keys of the dict `all_parents` are all parents that occur in the samples, and perhaps some
    parents that occurred only in samples that have been dropped.

    `arrived` is the stamp (ns) of the last transform that arrived, and `arrival` the monotonic
    time (ns) at which it did (`advance`: that with the newest stamp), also if it was not inserted:
    `repeated` transforms were in the history already, and `refused` ones were too old.
    `refused_stamp` is the stamp (ns) of the last of these, and `refused_authority` its publisher;
    `is_refusing` is True if it arrived last. `offsets` has some newest stamps minus their
    `advance`, one of each of the last eight seconds.
    """

    is_static = False

    def __init__(self, cache_time: int) -> None:
        self.cache_time = cache_time
        self.stamps = array('q')
        self.poses = bytearray()
        self.start = 0
        self.authority = ''
        self.only_parent = ''
        self.parents: Optional[list[str]] = None
        self.all_parents: dict[str, None] = {}
        self.arrived = self.arrival = self.advance = self.repeated = self.next_offset = 0
        self.offsets: tuple[int, ...] = ()
        self.is_full = False  #: True if samples were dropped since there were too many
        self.refused = self.refused_stamp = 0
        self.is_refusing = False
        self.refused_authority = ''

    def __len__(self) -> int:
        return len(self.stamps) - self.start

    @property
    def latest(self) -> int:
        """The newest stamp (ns); 0 if there are no samples."""
        return self.stamps[-1] if self.stamps else 0

    def note_arrival(self, now: int, is_newer: bool) -> None:
        """Note when a transform arrived (monotonic, ns), and whether its stamp is the newest."""
        self.arrival = now
        if is_newer:
            self.advance = now
            if now >= self.next_offset:
                self.next_offset = now + SECOND
                self.offsets = *self.offsets[-7:], self.latest - now

    @property
    def is_frozen(self) -> bool:
        """Whether several transforms have arrived, all with the same stamp."""
        return self.oldest == self.latest != 0 and len(self) + self.repeated > 2

    @property
    def oldest(self) -> int:
        """The oldest stamp (ns); 0 if there are no samples."""
        return self.stamps[self.start] if self.stamps else 0

    def state(self, name: str, until: int) -> Optional[Frame]:
        """Return the state up to a time (ns; 0: any); None without samples."""
        try:
            newest = self.find(min(until, self.latest) if until else 0)
        except NoPose:
            return None
        return Frame(name, self.parent_of(newest), self.authority, self.is_static,
                     newest - self.start + 1, self.stamps[newest], self.oldest, self.arrived,
                     self.refused_authority if self.is_refusing else self.authority)

    def append(self, stamps: 'array[int]', poses: bytes, authority: str) -> bool:
        """
        Append samples with the parent `only_parent`, if they are newer than the newest sample.

        Return False if nothing was appended; then call `insert` for each sample.
        """
        own_stamps = self.stamps
        if self.parents is not None or not own_stamps or stamps[0] <= own_stamps[-1]:
            return False
        self.authority, self.arrived, self.is_refusing = authority, stamps[-1], False
        # Drop the samples that would be dropped if `insert` were called for each new sample.
        # `insert` drops the expired samples before it adds the new sample. So in the last call,
        # `insert` would count the cache time back from the second last stamp.
        earliest = (own_stamps[-1] if len(stamps) == 1 else stamps[-2]) - self.cache_time
        self.poses += poses
        own_stamps.extend(stamps)
        if own_stamps[self.start] < earliest:
            self.drop_before(bisect_left(own_stamps, earliest, self.start))
        return True

    def insert(self, stamp: int, parent: str, pose: Pose, authority: str) -> bool:
        """
        Insert a sample in the order of the stamps, after the samples with the same stamp.

        A sample that is in the history already is not inserted again. Of more than
        `MAX_SAMPLES_PER_STAMP` samples with the same stamp, the last is replaced. Return False if
        the sample is older than the cache time allows.
        """
        stamps, self.arrived, self.is_refusing = self.stamps, stamp, False
        position = len(stamps)
        if position:
            earliest = stamps[-1] - self.cache_time
            if stamps[self.start] < earliest:
                self.drop_before(bisect_left(stamps, earliest, self.start))
            if stamp < earliest:
                self.refused, self.is_refusing = self.refused + 1, True
                self.refused_stamp, self.refused_authority = stamp, authority
                return False
            position = bisect_right(stamps, stamp, self.start)
            if position > self.start and stamps[position - 1] == stamp:
                first = bisect_left(stamps, stamp, self.start)
                if any(self.parent_of(i) == parent and self.pose(i) == pose
                       for i in range(first, position)):
                    self.authority = authority
                    self.repeated += 1
                    return True
                if position - first >= MAX_SAMPLES_PER_STAMP:
                    position -= 1
                    del self.poses[position * POSE_BYTES:(position + 1) * POSE_BYTES]
                    del stamps[position]
                    if self.parents is not None:
                        del self.parents[position]
            if self.parents is None and parent != self.only_parent:
                self.parents, self.only_parent = [self.only_parent] * len(stamps), ''
        else:
            self.only_parent, self.all_parents = parent, {}
        self.authority = authority
        self.all_parents[parent] = None
        if self.parents is not None:
            self.parents.insert(position, parent)
        self.poses[position * POSE_BYTES:position * POSE_BYTES] = _pack_pose(*pose)
        stamps.insert(position, stamp)
        return True

    def is_consistent(self) -> bool:
        """Return False if a change of the samples was interrupted."""
        count = len(self.stamps)
        return len(self.poses) == count * POSE_BYTES and (
            self.parents is None or len(self.parents) == count)

    def drop_before(self, start: int) -> None:
        self.start = start
        if start <= 16 or start * 5 <= len(self.stamps):
            return
        # A bytearray does not reuse the memory of bytes that are deleted at its very beginning. So
        # one dropped sample stays at the beginning, and the other dropped samples are deleted.
        self.start = 1
        del self.poses[POSE_BYTES:start * POSE_BYTES]
        del self.stamps[1:start]
        if self.parents is not None:
            del self.parents[1:start]
            self.parents[0] = self.parents[1]
            self.all_parents = dict.fromkeys(self.parents)
            if len(self.all_parents) == 1:
                (self.only_parent,), self.parents = self.all_parents, None

    def find(self, time: int) -> int:
        """
        Return the index of the last sample that is not newer than a time (ns; 0: the newest).

        If several samples have the same stamp, the result is the one that was inserted last, as in
        tf2. There is one exception, also as in tf2: if `time` is the oldest stamp, and there are
        newer samples, the result is the sample with this stamp that was inserted first.
        """
        stamps, start = self.stamps, self.start
        newest = len(stamps) - 1
        if newest >= start:
            if time in (0, stamps[newest]):
                return newest
            if time == stamps[start]:
                return start
            if stamps[start] < time < stamps[newest]:
                return bisect_right(stamps, time, start) - 1
        raise NoPose

    def pose(self, index: int) -> Pose:
        return _read_pose(self.poses, index * POSE_BYTES)

    def pose_at(self, time: int) -> Pose:
        """
        Return the pose at a time (ns; 0: the newest); raise NoPose outside of the history.

        Between two samples with the same parent, the pose is interpolated as in tf2: the position
        linearly, the rotation by slerp through the smaller angle (K. Shoemake, Animating Rotation
        with Quaternion Curves, SIGGRAPH 1985). Between two samples with different parents, the
        result is the pose of the earlier sample.
        """
        stamps, start = self.stamps, self.start
        after = len(stamps) - 1
        if not time or after <= start:
            return self.pose(self.find(time))
        if time == (stamp := stamps[after]):
            return _read_pose(self.poses, after * POSE_BYTES)
        # Most requested times are between the last two stamps, so try these before the search.
        if not (before := stamps[after - 1]) < time < stamp:
            if not stamps[start] < time < stamp:
                return self.pose(self.find(time))
            after = bisect_right(stamps, time, start, after)
            before, stamp = stamps[after - 1], stamps[after]
        if self.parents is not None and self.parents[after - 1] != self.parents[after]:
            return self.pose(after - 1)
        t = (time - before) / (stamp - before)
        x, y, z, ax, ay, az, aw, nx, ny, nz, bx, by, bz, bw = _read_two_poses(
            self.poses, (after - 1) * POSE_BYTES)
        cosine = ax * bx + ay * by + az * bz + aw * bw
        if cosine < 0.0:
            cosine, bx, by, bz, bw = -cosine, -bx, -by, -bz, -bw
        s = 1.0 - t
        if cosine < 1.0:
            angle = acos(cosine)  # half of the rotation between the two
            scale = 1.0 / sin(angle)
            a, b = scale * sin(s * angle), scale * sin(t * angle)
        else:
            a, b = 1.0, 0.0
        if x != nx or y != ny or z != nz:  # most joints turn only
            x, y, z = s * x + t * nx, s * y + t * ny, s * z + t * nz
        return x, y, z, a * ax + b * bx, a * ay + b * by, a * az + b * bz, a * aw + b * bw

    def poses_at(self, neighbours: Neighbours) -> Columns:
        """
        Return the poses at many times, as `pose_at` does for one; search `neighbours`.

        The times must be within the history, and all samples must have the same parent.
        """
        first = max(bisect_left(self.stamps, neighbours.first) - 1, self.start)
        last = bisect_right(self.stamps, neighbours.last, first)
        neighbours.search(self.stamps[first:last + 1])
        # `poses` cannot grow while an array uses its memory. So no variable refers to the array:
        # the traceback of an exception would keep it alive.
        pairs = [*map(itemgetter(first + neighbours.indices),
                      np.frombuffer(self.poses).reshape(-1, 7).T)]
        weights = _weights(pairs[3:], neighbours.ratios)
        for i, pair in enumerate(pairs):
            pair *= neighbours.ratios if i < 3 else weights
        x, y, z, qx, qy, qz, qw = (before + after for before, after in pairs)
        return x, y, z, qx, qy, qz, qw

    def parent_of(self, index: int) -> str:
        return self.only_parent if self.parents is None else self.parents[index]

    def parent_at(self, time: int) -> Optional[str]:
        """Return the parent at a time (ns; 0: the newest); None if there is no pose."""
        try:
            return self.parent_of(self.find(time))
        except NoPose:
            return None

    def parent_near(self, time: int) -> Optional[str]:
        """Return the parent at a time (ns, 0 included); before the oldest sample, its parent."""
        if not len(self):
            return None
        return self.parent_of(max(bisect_right(self.stamps, time, self.start) - 1, self.start))

    def parent_changes(self) -> list[int]:
        """Return the stamps (ns) of the samples whose parent is not that of the sample before."""
        parents = self.parents or []
        return [self.stamps[i] for i in range(self.start + 1, len(parents))
                if parents[i] != parents[i - 1]]

    def stamps_around(self, begin: int, end: int) -> NDArray[np.int64]:
        """
        Return the stamps (ns) from `begin` to before `end`, and the nearest on both sides.

        A stamp may occur several times.
        """
        first = bisect_left(self.stamps, begin, self.start)
        last = bisect_left(self.stamps, end, first)
        return np.array(self.stamps[max(first - 1, self.start):last + 1], np.int64)

    def distance_to(self, time: int) -> int:
        """Return how far a time is before the oldest or after the newest sample (ns)."""
        if not self.stamps:
            return 0
        return max(0, time - self.latest, self.oldest - time)

    def dump(self) -> dict[str, Any]:
        indices = range(self.start, len(self.stamps))
        return {'parents': [self.parent_of(i) for i in indices],
                'stamps': self.stamps[self.start:].tolist(),
                'poses': [list(self.pose(i)) for i in indices],
                'authority': self.authority, 'is_static': self.is_static, 'arrived': self.arrived}


def _weights(rotations: Sequence[Any], ratios: NDArray[np.float64]) -> Any:
    """
    Return the (2, n) weights of the two quaternions of n pairs.

    sin(s p) / sin(p) is a series in u = 1 - cos(p), with the divisors j (2 j + 1):

        s (1 + (1 - s^2) u / 3 (1 + (4 - s^2) u / 10 (1 + (9 - s^2) u / 21 (1 + ...)))).

    See D. Eberly, A Fast and Accurate Algorithm for Computing SLERP, J. Graphics, GPU, and Game
    Tools 15 (2011). The terms after the one with u^k are less than (u / 2)^(k + 1), for both
    weights together. The smallest k is used for which this is less than 1e-13.
    """
    cosine: Any = sum(before * after for before, after in rotations)
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


class StaticHistory(History):
    """The history of a static frame: one pose, which holds at all times, with the stamp 0."""

    is_static = True

    def __init__(self, parent: str, pose: Pose, authority: str) -> None:
        super().__init__(0)
        self.stamps.append(0)
        self.only_parent, self.all_parents = parent, {parent: None}
        self.value, self.authority = pose, authority

    def find(self, time: int) -> int:
        return 0

    def pose(self, index: int) -> Pose:
        return self.value

    def pose_at(self, time: int) -> Pose:
        return self.value

    def poses_at(self, neighbours: Neighbours) -> Columns:
        x, y, z, qx, qy, qz, qw = np.array([self.value]).T
        return x, y, z, qx, qy, qz, qw


def load(dump: Mapping[str, Any], cache_time: int) -> Optional[History]:
    """Return the history whose data `dump` has returned; None: the frame is only a parent."""
    stamps, parents, authority = dump['stamps'], [*dump['parents']], dump['authority']
    poses: Any = np.array(dump['poses'], np.float64).reshape(-1, 7)
    if not (abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0) < 1e-6).all():
        raise ValueError('the rotations must be normalised')
    if not all(isinstance(name, str) for name in (*parents, authority)):
        raise TypeError('parents and authority must be names')
    history, arrived = History(cache_time), dump['arrived']
    for stamp, parent, pose in zip(stamps, parents, map(tuple, poses.tolist()), strict=True):
        history.insert(stamp, parent, pose, authority)
    if not parents:
        return None if arrived is None else history
    if dump['is_static']:
        return StaticHistory(parents[0], history.pose(0), authority)
    history.arrived, history.arrival = index(arrived), monotonic_ns()
    return history
