"""What is known of a frame that moves: its poses in its parent, in the order of time."""

from bisect import bisect_left, bisect_right
import struct
from typing import Optional

from dummy_arm.tf.samples import NO_STAMPS, Samples
from dummy_arm.tf.times import display
from dummy_arm.tf.wire import POSE_BYTES

#: x, y, z (m) and the rotation's x, y, z, w.
Pose = tuple[float, float, float, float, float, float, float]

#: What is known of a frame: its newest parent, who sent that, whether it is static, the number of
#: samples, the newest and the oldest stamp (ns).
State = tuple[str, str, bool, int, int, int]

#: So many samples of one stamp are kept at most; the first and the last of them matter.
MOST_OF_ONE_STAMP = 100
_pack_pose = struct.Struct('7d').pack
_read_pose = struct.Struct('7d').unpack_from


class NoPose(LookupError):
    """There is no pose for the time that was asked for."""


class History:
    """
    The samples of a frame that moves, no older than a cache time before the newest.

    `place` is where they lie: Samples, of this frame or in common with others, and the offset of
    its pose in a row (bytes). `only_parent` is the parent in all samples; '' while there are
    several, or no sample. Only while there are several, `parents` has the parent of each sample.
    `all_parents` has each parent once, as a key; it is another dict, or longer, whenever there are
    others.
    """

    __slots__ = ('__weakref__', 'all_parents', 'cache_time', 'only_parent', 'parents', 'place')

    is_static = False

    def __init__(self, cache_time: int) -> None:
        """
        Begin with no sample.

        :param cache_time: ns.
        """
        self.cache_time = cache_time
        self.only_parent = ''
        self.parents: Optional[list[str]] = None
        self.all_parents: dict[str, None] = {}
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

    def state(self, until: int) -> Optional[State]:
        """
        Return what is known of the frame at a time (ns; 0: now).

        :returns: None when no sample is that old.
        """
        samples = self.place[0]
        stamps, start = samples.stamps, samples.start
        newest = len(stamps) - 1
        if newest < start:
            return None
        if until and until < stamps[newest]:
            try:
                newest = self.find(until)
            except NoPose:
                return None
        return (self.parent_of(newest), samples.authority, False, newest - start + 1,
                stamps[newest], stamps[start])

    def own_samples(self) -> Samples:
        """
        Return the samples, from now on not in common with others.

        The others get their own, too: what is in common would fill the memory as long as one has
        it.
        """
        samples = self.place[0]
        if samples.row > POSE_BYTES:
            samples.regular = NO_STAMPS  # nothing more comes into them, even if Ctrl-C comes now
            for reference in samples.histories:
                history = reference()
                if history is not None and history.place[0] is samples:
                    history.place = samples.column(
                        history.place[1], samples.start, len(samples.stamps)), 0
        return self.place[0]

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
                    self.drop_before(bisect_left(stamps, earliest, samples.start))
                if stamp < earliest:
                    return False
                position = bisect_right(stamps, stamp, samples.start)
                if position > samples.start and stamps[position - 1] == stamp:
                    first = bisect_left(stamps, stamp, samples.start)
                    if self._has(first, position, parent, pose):
                        samples.authority = authority
                        return True
                    samples.regular = NO_STAMPS
                    if position - first >= MOST_OF_ONE_STAMP:
                        position -= 1
                        samples.delete(position, 1)
                        if self.parents is not None:
                            del self.parents[position]
            else:
                self.only_parent, self.all_parents = parent, {parent: None}
            samples.authority = authority
            if self.parents is not None or self.only_parent != parent:
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
        return any(self.parent_of(i) == parent and self.pose(i) == pose
                   for i in range(first, end))

    def _insert_parent(self, position: int, parent: str) -> None:
        if self.parents is None:
            samples = self.place[0]
            samples.regular = NO_STAMPS
            self.parents = [self.only_parent] * len(samples.stamps)
        self.only_parent = ''
        self.all_parents[parent] = None
        self.parents.insert(position, parent)

    def _mend_parents(self, position: int) -> None:
        """Undo an insertion or complete a deletion at an index, which Ctrl-C interrupted."""
        if self.parents is not None:
            surplus = len(self.parents) - len(self.place[0].stamps)
            if surplus > 0:
                del self.parents[position:position + surplus]

    def drop_before(self, start: int) -> bool:
        """
        Forget the samples before an index.

        :returns: whether there are fewer parents than before.
        """
        samples, parents = self.place[0], self.all_parents
        try:
            removed = samples.drop_before(start)
            if removed and self.parents is not None:
                del self.parents[1:1 + removed]
        except BaseException:
            self._mend_parents(1)
            raise
        if not removed:
            return False
        stamps = samples.stamps
        if self.parents is not None:
            self.parents[0] = self.parents[1]
            left = dict.fromkeys(self.parents)
            if len(left) < len(parents):
                self.all_parents = left
            if len(left) == 1:
                (self.only_parent,), self.parents = left, None
        if self.parents is None and len(samples.regular) < len(stamps) == len(set(stamps)):
            samples.regular = stamps
        return self.all_parents is not parents

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
        return self.only_parent if self.parents is None else self.parents[index]

    def parent_at(self, time: int) -> Optional[str]:
        """Tell the parent at a time (ns; 0: the newest); None when nothing is known of it."""
        try:
            return self.parent_of(self.find(time))
        except NoPose:
            return None

    def newest_parent(self) -> Optional[str]:
        """Return the parent in the newest sample; None without any."""
        return (self.only_parent if self.parents is None else self.parents[-1]) or None

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
