"""What is known of a frame that moves: its poses in its parent, in the order of time."""

from bisect import bisect_left, bisect_right
import struct
from typing import Optional

from dummy_arm.tf.samples import NO_STAMPS, Samples
from dummy_arm.tf.times import display
from dummy_arm.tf.wire import POSE_BYTES

#: x, y, z (m) and the rotation's x, y, z, w.
Pose = tuple[float, float, float, float, float, float, float]

#: So many samples of one stamp are kept at most; the first and the last of them matter.
_MOST_OF_ONE_STAMP = 100
_pack_pose = struct.Struct('7d').pack
_read_pose = struct.Struct('7d').unpack_from


class NoPose(LookupError):
    """There is no pose for the time that was asked for."""


class History:
    """
    The samples of a frame that moves, no older than a cache time before the newest.

    `place` is where they lie: Samples, of this frame or in common with others, and the offset of
    its pose in a row (bytes). `all_parents` has each parent once; only while there are several,
    `parents` has that of each sample.
    """

    __slots__ = ('__weakref__', 'all_parents', 'cache_time', 'parents', 'place')

    is_static = False

    def __init__(self, cache_time: int) -> None:
        """
        Begin with no sample.

        :param cache_time: ns.
        """
        self.cache_time = cache_time
        self.parents: Optional[list[str]] = None
        self.all_parents: tuple[str, ...] = ()
        self.place = Samples(), 0

    def __len__(self) -> int:
        samples = self.place[0]
        return len(samples.stamps) - samples.start

    @property
    def authority(self) -> str:
        """Who published the last sample."""
        return self.place[0].authority

    @property
    def latest(self) -> int:
        """The stamp of the newest sample (ns); 0 without one."""
        return self.place[0].latest

    @property
    def oldest(self) -> int:
        """The stamp of the oldest sample (ns); 0 without one."""
        samples = self.place[0]
        return samples.stamps[samples.start] if len(self) else 0

    def known_at(self, time: int) -> tuple[int, int]:
        """Tell how many samples there were at a time (ns; 0: now), and the newest stamp then."""
        if not 0 < time < self.latest:
            return len(self), self.latest
        samples, newest = self.place[0], self.find(time)
        return newest - samples.start + 1, samples.stamps[newest]

    def own_samples(self) -> Samples:
        """Give the samples, from now on not in common with others."""
        samples, offset = self.place
        if samples.row == POSE_BYTES:
            return samples
        own = samples.column(offset, samples.start, len(samples.stamps))
        samples.abandoned = True
        self.place = own, 0
        return own

    def insert(self, stamp: int, parent: str, pose: Pose, authority: str) -> bool:
        """
        Insert a sample where its stamp (ns) belongs, after those of the same stamp.

        A sample that is there already is not inserted again.

        :returns: False when it is older than the cache time allows, and was left out.
        """
        samples = self.own_samples()
        stamps = samples.stamps
        position = len(stamps)
        try:
            if position:
                earliest = stamps[-1] - self.cache_time
                if stamps[samples.start] < earliest:
                    self._expire(earliest)
                if stamp < earliest:
                    return False
                position = bisect_right(stamps, stamp, samples.start)
                if position > samples.start and stamps[position - 1] == stamp:
                    first = bisect_left(stamps, stamp, samples.start)
                    if self._has(first, position, parent, pose):
                        samples.authority = authority
                        return True
                    samples.regular = NO_STAMPS
                    if position - first >= _MOST_OF_ONE_STAMP:
                        position -= 1
                        if self.parents is not None:
                            del self.parents[position]
                        samples.delete(position, 1)
            else:
                self.all_parents = (parent,)
            samples.authority = authority
            if self.parents is not None or self.all_parents != (parent,):
                self._insert_parent(position, parent)
            samples.poses[position * POSE_BYTES:position * POSE_BYTES] = _pack_pose(*pose)
            stamps.insert(position, stamp)
            samples.latest = stamps[-1]
        except BaseException:
            samples.mend(position)
            self._mend_parents(position)
            raise
        return True

    def _has(self, first: int, end: int, parent: str, pose: Pose) -> bool:
        """Tell whether a sample is there, among those of its stamp."""
        return any(self.pose(i) == pose and self.parent_of(i) == parent
                   for i in range(first, end))

    def _insert_parent(self, position: int, parent: str) -> None:
        samples = self.place[0]
        if self.parents is None:
            samples.regular = NO_STAMPS
            self.parents = [*self.all_parents] * len(samples.stamps)
        if parent not in self.all_parents:
            self.all_parents = (*self.all_parents, parent)
        self.parents.insert(position, parent)

    def _mend_parents(self, position: int) -> None:
        """Undo an insertion or complete a deletion at an index, which Ctrl-C interrupted."""
        if self.parents is not None:
            surplus = len(self.parents) - len(self.place[0].stamps)
            if surplus > 0:
                del self.parents[position:position + surplus]

    def _expire(self, earliest: int) -> None:
        """Forget the samples before a time (ns)."""
        samples = self.place[0]
        try:
            removed = samples.expire(earliest)
        except BaseException:
            self._mend_parents(1)
            raise
        if not removed:
            return
        stamps = samples.stamps
        if self.parents is not None:
            del self.parents[1:1 + removed]
            self.parents[0] = self.parents[1]
            self.all_parents = tuple(set(self.parents))
            if len(self.all_parents) == 1:
                self.parents = None
        if self.parents is None and len(samples.regular) < len(stamps) == len(set(stamps)):
            samples.regular = stamps

    def find(self, time: int) -> int:
        """
        Find the sample of a time (ns), or the last one before it.

        0 is the time of the newest. Of several with the same stamp it is the last inserted, but
        the first inserted at the very beginning of the history.

        :raises NoPose: when the time is before the first sample or after the last.
        """
        samples = self.place[0]
        stamps, start = samples.stamps, samples.start
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
        """Read the pose of a sample."""
        samples, offset = self.place
        return _read_pose(samples.poses, index * samples.row + offset)

    def pose_at(self, time: int) -> Optional[Pose]:
        """
        Read the pose at a time (ns) where a sample gives it as it is, else None.

        :raises NoPose: as `find` does.
        """
        i = self.find(time)
        stamps = self.place[0].stamps
        if (i + 1 == len(stamps) or stamps[i] == time
                or self.parent_of(i) != self.parent_of(i + 1)):
            return self.pose(i)
        return None

    def pair_around(self, time: int) -> 'History':
        """Make a history of the samples before and after a time (ns)."""
        i = self.find(time)
        samples, offset = self.place
        pair = History(0)
        pair.place = samples.column(offset, i, i + 2), 0
        return pair

    def parent_of(self, index: int) -> str:
        """Tell the parent in a sample."""
        return self.all_parents[0] if self.parents is None else self.parents[index]

    def parent_at(self, time: int) -> Optional[str]:
        """Tell the parent at a time (ns; 0: the newest); None when nothing is known of it."""
        try:
            return self.parent_of(self.find(time))
        except NoPose:
            return None

    def newest_parent(self) -> Optional[str]:
        """Return the parent in the newest sample; None without any."""
        if self.parents is not None:
            return self.parents[-1]
        return self.all_parents[0] if self.all_parents else None

    def distance_to(self, time: int) -> int:
        """Return how far a time (ns) is outside of the samples (ns); 0 within, or without any."""
        samples = self.place[0]
        if len(samples.stamps) == samples.start:
            return 0
        if time > samples.latest:
            return time - samples.latest
        return max(0, samples.stamps[samples.start] - time)

    def why_not(self, time: int) -> str:
        """Tell in tf2's words why there is no pose at a time (ns); '' without any sample."""
        if not len(self):
            return ''
        if len(self) == 1:
            return (f'Lookup would require extrapolation at time {display(time)}, but only time '
                    f'{display(self.latest)} is in the buffer')
        if time > self.latest:
            return ('Lookup would require extrapolation into the future.  Requested time '
                    f'{display(time)} but the latest data is at time {display(self.latest)}')
        return ('Lookup would require extrapolation into the past.  Requested time '
                f'{display(time)} but the earliest data is at time {display(self.oldest)}')
