"""What is known of a frame that moves: its poses in its parent, in the order of time."""

from array import array
from bisect import bisect_left, bisect_right
import struct
from typing import Any, Optional

from dummy_arm.tf.times import display
from dummy_arm.tf.wire import POSE_BYTES

#: x, y, z (m) and the rotation's x, y, z, w.
Pose = tuple[float, float, float, float, float, float, float]

#: So many samples of one stamp are kept at most; the first and the last of them matter.
_MOST_OF_ONE_STAMP = 100
#: What is `regular` while samples are not.
NO_STAMPS = array('q')
_pack_pose = struct.Struct('7d').pack
_read_pose = struct.Struct('7d').unpack_from


class NoPose(LookupError):
    """There is no pose for the time that was asked for."""


class History:
    """
    The samples of a frame that moves, no older than a cache time before the newest.

    The samples lie in an array of stamps and in the bytes of their poses, 64 bytes each. Those
    before `start` have expired; they are removed many at a time. `all_parents` has each parent
    once; only while there are several, `parents` has that of each sample. `regular` is `stamps`,
    but empty while two of them are the same or the parents differ. `latest` is the newest stamp,
    or 0. `recent` is where the last lookup was, as a hint for the next.
    """

    __slots__ = ('all_parents', 'authority', 'cache_time', 'latest', 'parents', 'poses', 'recent',
                 'regular', 'stamps', 'start')

    is_static = False

    def __init__(self, cache_time: int) -> None:
        """
        Begin with no sample.

        :param cache_time: ns.
        """
        self.cache_time = cache_time
        self.authority = ''
        self.parents: Optional[list[str]] = None
        self.all_parents: tuple[str, ...] = ()
        self.stamps = array('q')
        self.poses = bytearray()
        self.regular = self.stamps
        self.start = 0
        self.recent = 0
        self.latest = 0

    def __len__(self) -> int:
        return len(self.stamps) - self.start

    def insert(self, stamp: int, parent: str, pose: Pose, authority: str) -> bool:
        """
        Insert a sample where its stamp (ns) belongs, after those of the same stamp.

        A sample that is there already is not inserted again.

        :returns: False when it is older than the cache time allows, and was left out.
        """
        stamps = self.stamps
        position = len(stamps)
        try:
            if position:
                earliest = stamps[-1] - self.cache_time
                if stamps[self.start] < earliest:
                    self.expire(earliest)
                if stamp < earliest:
                    return False
                position = bisect_right(stamps, stamp, self.start)
                if position > self.start and stamps[position - 1] == stamp:
                    first = bisect_left(stamps, stamp, self.start)
                    if self._has(first, position, parent, pose):
                        self.authority = authority
                        return True
                    self.regular = NO_STAMPS
                    if position - first >= _MOST_OF_ONE_STAMP:
                        position -= 1
                        self._delete(position, 1)
            else:
                self.all_parents = (parent,)
            self.authority = authority
            if self.parents is not None or self.all_parents != (parent,):
                self._insert_parent(position, parent)
            self.poses[position * POSE_BYTES:position * POSE_BYTES] = _pack_pose(*pose)
            stamps.insert(position, stamp)
            self.latest = stamps[-1]
        except BaseException:
            self.mend(position)
            raise
        return True

    def _has(self, first: int, end: int, parent: str, pose: Pose) -> bool:
        """Tell whether a sample is there, among those of its stamp."""
        return any(self.pose(i) == pose and self.parent_of(i) == parent
                   for i in range(first, end))

    def _insert_parent(self, position: int, parent: str) -> None:
        if self.parents is None:
            self.regular = NO_STAMPS
            self.parents = [*self.all_parents] * len(self.stamps)
        if parent not in self.all_parents:
            self.all_parents = (*self.all_parents, parent)
        self.parents.insert(position, parent)

    def _delete(self, begin: int, count: int) -> None:
        if self.parents is not None:
            del self.parents[begin:begin + count]
        del self.poses[begin * POSE_BYTES:(begin + count) * POSE_BYTES]
        del self.stamps[begin:begin + count]

    def mend(self, position: int) -> None:
        """Undo or complete what Ctrl-C interrupted: an insertion at an index, or a deletion."""
        columns: list[tuple[int, Any, int]] = [
            (len(self.stamps), self.stamps, 1),
            (len(self.poses) // POSE_BYTES, self.poses, POSE_BYTES)]
        if self.parents is not None:
            columns.append((len(self.parents), self.parents, 1))
        lengths = [length for length, _, _ in columns]
        longest = max(lengths)
        surplus = longest - min(lengths)
        # Stamps come last: more of them than of the others are of a deletion.
        begin = 0 if lengths[0] == longest and surplus > 1 else position
        for length, column, width in columns:
            if length == longest and surplus:
                del column[begin * width:(begin + surplus) * width]
        if self.stamps:
            self.latest = self.stamps[-1]

    def expire(self, earliest: int) -> None:
        """Forget the samples before a time (ns)."""
        stamps = self.stamps
        self.start = expired = bisect_left(stamps, earliest, self.start)
        if expired <= 16 or expired * 5 <= len(stamps):
            return
        self.start = 0
        self._delete(0, expired)
        if self.parents is not None:
            self.all_parents = tuple(set(self.parents))
            if len(self.all_parents) == 1:
                self.parents = None
        if self.parents is None and len(self.regular) < len(stamps) == len(set(stamps)):
            self.regular = stamps

    def find(self, time: int) -> int:
        """
        Find the sample of a time (ns), or the last one before it.

        0 is the time of the newest. Of several with the same stamp it is the last inserted, but
        the first inserted at the very beginning of the history.

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
        """Read the pose of a sample."""
        return _read_pose(self.poses, index * POSE_BYTES)

    def pose_at(self, time: int) -> Optional[Pose]:
        """
        Read the pose at a time (ns) where a sample gives it as it is, else None.

        :raises NoPose: as `find` does.
        """
        i = self.find(time)
        if (i + 1 == len(self.stamps) or self.stamps[i] == time
                or self.parent_of(i) != self.parent_of(i + 1)):
            return self.pose(i)
        return None

    def pair_around(self, time: int) -> 'History':
        """Make a history of the samples before and after a time (ns)."""
        i = self.find(time)
        pair = History(0)
        pair.stamps.extend(self.stamps[i:i + 2])
        pair.latest = pair.stamps[-1]
        pair.poses += self.poses[i * POSE_BYTES:(i + 2) * POSE_BYTES]
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

    @property
    def oldest(self) -> int:
        """The stamp of the oldest sample (ns); 0 without one."""
        return self.stamps[self.start] if len(self) else 0

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
