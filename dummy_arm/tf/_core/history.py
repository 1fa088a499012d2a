"""The history of one frame: its poses in its parent, in the order of time."""

from array import array
from bisect import bisect_left, bisect_right
import struct
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf._core.pose import Columns, interpolate, interpolate_columns, Pose, POSE_BYTES

#: At most so many samples of one stamp are kept; only the first and the last of them matter.
MOST_OF_ONE_STAMP = 100
_pack_pose = struct.Struct('7d').pack
_read_pose = struct.Struct('7d').unpack_from
_read_two_poses = struct.Struct('14d').unpack_from

#: What is known of a frame: its newest parent, the authority of that, whether it is static, the
#: number of samples, the newest and the oldest stamp (ns).
State = tuple[str, str, bool, int, int, int]


class NoPose(LookupError):
    """There is no pose for the requested time."""


class History:
    """
    The samples of a frame that moves, no older than the cache time before the newest.

    `stamps` (ns) and `poses` (56 bytes each) hold the samples. Those before `start` have expired;
    they are removed from memory many at a time. `only_parent` is the parent in all samples; ''
    while there are several parents, or no sample. Only while there are several, `parents` holds
    the parent of each sample. `all_parents` has each parent once, as a key.

    KeyboardInterrupt can be raised after a call, at the start of a function and when a loop jumps
    back, but nowhere else. So the statements that change two lists together stand one after the
    other, with one call at most, the last.
    """

    __slots__ = ('all_parents', 'authority', 'cache_time', 'only_parent', 'parents', 'poses',
                 'stamps', 'start')

    is_static = False

    def __init__(self, cache_time: int) -> None:
        """
        Create a history without samples.

        :param cache_time: how long samples are kept (ns).
        """
        self.cache_time = cache_time
        self.stamps = array('q')
        self.poses = bytearray()
        self.start = 0
        self.authority = ''
        self.only_parent = ''
        self.parents: Optional[list[str]] = None
        self.all_parents: dict[str, None] = {}

    def __len__(self) -> int:
        return len(self.stamps) - self.start

    @property
    def latest(self) -> int:
        """The stamp of the newest sample (ns); 0 without one."""
        return self.stamps[-1] if self.stamps else 0

    @property
    def oldest(self) -> int:
        """The stamp of the oldest sample (ns); 0 without one."""
        return self.stamps[self.start] if self.stamps else 0

    def state(self, until: int) -> Optional[State]:
        """
        Return what is known of the frame at a time.

        :param until: the time (ns); 0: now.
        :returns: None when no sample is that old.
        """
        stamps, start = self.stamps, self.start
        newest = len(stamps) - 1
        if newest < start:
            return None
        if until and until < stamps[newest]:
            try:
                newest = self.find(until)
            except NoPose:
                return None
        return (self.parent_of(newest), self.authority, False, newest - start + 1,
                stamps[newest], stamps[start])

    def append(self, stamps: 'array[int]', poses: bytes, authority: str) -> bool:
        """
        Append samples of the only parent.

        :param stamps: (n,) ns, each larger than the one before.
        :param poses: n times 56 bytes.
        :returns: False if they are not all newer than the newest sample: use `insert` for these.
        """
        own = self.stamps
        if self.parents is not None or not own or stamps[0] <= own[-1]:
            return False
        self.authority = authority
        # What a single insertion of each would leave, which is before the last of them.
        earliest = (own[-1] if len(stamps) == 1 else stamps[-2]) - self.cache_time
        # In place of a surplus pose, which is there if memory for its stamp was lacking.
        self.poses[len(own) * POSE_BYTES:] = poses
        own.extend(stamps)
        if own[self.start] < earliest:
            self.drop_before(bisect_left(own, earliest, self.start))
        return True

    def insert(self, stamp: int, parent: str, pose: Pose, authority: str) -> bool:
        """
        Insert a sample where its stamp belongs, after those of the same stamp.

        A sample that is there already is not inserted again.

        :param stamp: ns.
        :returns: False when it is older than the cache time allows, and was left out.
        """
        stamps = self.stamps
        position = len(stamps)
        if position:
            earliest = stamps[-1] - self.cache_time
            if stamps[self.start] < earliest:
                self.drop_before(bisect_left(stamps, earliest, self.start))
            if stamp < earliest:
                return False
            position = bisect_right(stamps, stamp, self.start)
            if position > self.start and stamps[position - 1] == stamp:
                first = bisect_left(stamps, stamp, self.start)
                if any(self.parent_of(i) == parent and self.pose(i) == pose
                       for i in range(first, position)):
                    self.authority = authority
                    return True
                if position - first >= MOST_OF_ONE_STAMP:
                    position -= 1
                    self._delete(position)
            if self.parents is None and parent != self.only_parent:
                self.parents, self.only_parent = [self.only_parent] * len(stamps), ''
        else:
            self.only_parent, self.all_parents = parent, {}
        self.authority = authority
        self.all_parents[parent] = None
        packed = _pack_pose(*pose)
        if self.parents is not None:
            self.parents[position:position] = [parent]
        self.poses[position * POSE_BYTES:position * POSE_BYTES] = packed
        try:
            stamps.insert(position, stamp)
        except (BufferError, MemoryError):
            del self.poses[position * POSE_BYTES:(position + 1) * POSE_BYTES]
            if self.parents is not None:
                del self.parents[position]
            raise
        return True

    def _delete(self, index: int) -> None:
        """Remove a sample from memory."""
        if self.parents is not None:
            del self.parents[index]
        del self.poses[index * POSE_BYTES:(index + 1) * POSE_BYTES]
        del self.stamps[index]

    def drop_before(self, start: int) -> None:
        """Drop the samples before an index."""
        self.start = start
        if start <= 16 or start * 5 <= len(self.stamps):
            return
        # The first sample stays, so that the others move into its memory, which is used again.
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
        Find the sample of a time, or the last one before it.

        Of several with the same stamp it is the last inserted, but the first inserted at the very
        beginning of the history.

        :param time: ns; 0: that of the newest sample.
        :raises NoPose: when the time is before the first sample or after the last.
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
        """Return the pose of a sample."""
        return _read_pose(self.poses, index * POSE_BYTES)

    def pose_at(self, time: int) -> Pose:
        """
        Return the pose at a time, interpolated between two samples of one parent.

        :param time: ns; 0: that of the newest sample.
        :raises NoPose: when the time is before the first sample or after the last.
        """
        stamps = self.stamps
        if not time or not stamps or not stamps[self.start] < time < stamps[-1]:
            return self.pose(self.find(time))
        # Most lookups are between the last two samples.
        after = len(stamps) - 1 if time >= stamps[-2] else bisect_right(stamps, time, self.start)
        if self.parents is not None and self.parents[after - 1] != self.parents[after]:
            return self.pose(after - 1)
        before = stamps[after - 1]
        return interpolate(_read_two_poses(self.poses, (after - 1) * POSE_BYTES),
                           (time - before) / (stamps[after] - before))

    def poses_at(self, times: NDArray[np.int64], known: NDArray[np.bool_]) -> Columns:
        """
        Return the poses at many times; there is only one parent.

        :param times: (n,) ns.
        :param known: (n,) is set to False where there is no pose.
        """
        stamps: Any = None
        poses: Any = None
        try:
            stamps = np.frombuffer(self.stamps, np.int64)[self.start:]
            poses = np.frombuffer(self.poses, f'V{POSE_BYTES}')[self.start:]
            newest = len(stamps) - 1
            before = stamps.searchsorted(times, 'right') - 1
            known &= (before >= 0) & ((before < newest) | (times == stamps[newest]))
            if newest and stamps[0] == stamps[1] != stamps[newest]:
                before[times == stamps[0]] = 0
            before.clip(0, newest, out=before)
            after = np.minimum(before + 1, newest)
            stamps_before, stamps_after = stamps.take(before), stamps.take(after)
            poses_before, poses_after = _columns(poses[before]), _columns(poses[after])
        finally:
            del stamps, poses  # an array that is viewed, also by a traceback, cannot grow
        # As unsigned numbers, since a span of time may be longer than an int64.
        span = (stamps_after - stamps_before).view(np.uint64)
        span[span == 0] = 1
        ratio = (times - stamps_before).view(np.uint64) / span
        return interpolate_columns(poses_before, poses_after, ratio)

    def parent_of(self, index: int) -> str:
        """Return the parent in a sample."""
        return self.only_parent if self.parents is None else self.parents[index]

    def parent_at(self, time: int) -> Optional[str]:
        """
        Return the parent at a time; None when nothing is known of it.

        :param time: ns; 0: that of the newest sample.
        """
        try:
            return self.parent_of(self.find(time))
        except NoPose:
            return None

    def distance_to(self, time: int) -> int:
        """
        Return the time from the samples to a time outside of them (ns).

        :param time: ns.
        :returns: 0 where the samples include the time, or where there are none.
        """
        if not self.stamps:
            return 0
        return max(0, time - self.latest, self.oldest - time)

    def dump(self) -> dict[str, Any]:
        """Return everything that is known of the frame; see `BufferCore.dump`."""
        indices = range(self.start, len(self.stamps))
        return {'parents': [self.parent_of(i) for i in indices],
                'stamps': self.stamps[self.start:].tolist(),
                'poses': [list(self.pose(i)) for i in indices],
                'authority': self.authority, 'is_static': False}


class StaticHistory:
    """A pose that holds at all times."""

    __slots__ = ('authority', 'only_parent', 'pose')

    is_static = True
    parents = None
    latest = oldest = 0  # as of a history without samples

    def __init__(self, parent: str, pose: Pose, authority: str) -> None:
        """Create the history of a frame that does not move."""
        self.only_parent, self.pose, self.authority = parent, pose, authority

    def __len__(self) -> int:
        return 1

    @property
    def all_parents(self) -> tuple[str]:
        """The parent."""
        return (self.only_parent,)

    def state(self, until: int) -> State:
        """Return what is known of the frame, which is the same at any time."""
        return self.only_parent, self.authority, True, 1, 0, 0

    def pose_at(self, time: int) -> Pose:
        """Return the pose."""
        return self.pose

    def poses_at(self, times: NDArray[np.int64], known: NDArray[np.bool_]) -> Columns:
        """Return the pose as columns of one row, which numpy combines with any number of rows."""
        x, y, z, qx, qy, qz, qw = np.array([self.pose]).T
        return x, y, z, qx, qy, qz, qw

    def parent_at(self, time: int) -> str:
        """Return the parent."""
        return self.only_parent

    def distance_to(self, time: int) -> int:
        """Return 0: the pose holds at all times."""
        return 0

    def dump(self) -> dict[str, Any]:
        """Return everything that is known of the frame; see `BufferCore.dump`."""
        return {'parents': [self.only_parent], 'stamps': [0], 'poses': [list(self.pose)],
                'authority': self.authority, 'is_static': True}


AnyHistory = Union[History, StaticHistory]


def _columns(poses: NDArray[np.void]) -> Any:
    """Copy poses into columns, which are far faster to compute with than rows."""
    return poses.view(np.float64).reshape(-1, 7).T.copy()
