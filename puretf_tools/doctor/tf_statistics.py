"""
Statistics of the messages on /tf and /tf_static.

Of each message, only its time of arrival and its stamps are kept (16 bytes, if it has one stamp).
"""

from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from math import ceil, log2
from typing import Any, NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from puretf import is_frozen, SECOND, shortened
from puretf._causes.facts import OTHER_CLOCK
from puretf.transform_table import Message, transform_tables, TransformTable
from puretf_tools.inspection.stamp_clock import StampClock
from puretf_tools.inspection.traffic import Counts, DELAYS, rate

#: A transform is late if it arrives more than `LATE` (ns) after its stamp, and it is from the
#: future if its stamp is more than `FUTURE` (ns) after its arrival.
LATE, FUTURE = SECOND // 2, SECOND // 10
#: The largest number of names that are kept of a message with odd stamps.
_MOST_NAMES = 100
#: The norm of a quaternion may differ from 1 by this.
NORM_TOLERANCE = 1e-3
#: Poses are equal if their positions differ by at most this (m), and the cosine of half the angle
#: between them differs from 1 by at most this (the angle is about 1e-5 rad).
_SAME_POSITION, _SAME_ROTATION = 1e-6, 1e-11
#: Stamps that alternate between two clocks go back by more than this (ns), more often than this,
#: and for more than this part of the transforms.
_TURN, _FEW_TURNS, _TURNS = 5 * SECOND, 3, 0.05
#: A jump is a move from pose to pose of at least this (m plus rad). Moves within more than
#: `_LONGEST_MOVE` (ns) do not count; moves within less than `_SHORTEST_MOVE` (s) count as such.
SMALLEST_JUMP, _LONGEST_MOVE, _SHORTEST_MOVE = 0.2, SECOND // 2, 0.02
#: The histogram of the speeds of jumps: the number of bins for a factor of two, and of all. The
#: first bin begins at the least possible speed.
_JUMPS_PER_OCTAVE, _JUMPS = 4, 80

_FIELDS = np.dtype([
    *DELAYS,
    ('count', 'i8'),  # the number of transforms
    ('invalid', 'i8'),  # of those: with NaN or infinite numbers
    ('unnormalized', 'i8'),  # with a quaternion whose norm is not 1
    ('worst_norm', 'f8'),  # the norm that differs most from 1
    ('changes', 'i8'),  # with another pose than the one before; on /tf only if the stamp is equal
    ('zero_stamps', 'i8'),  # with the stamp 0
    ('backwards', 'i8'),  # with an earlier stamp than the one before
    ('step_back', 'i8'),  # the largest difference of these two stamps (ns)
    ('step_back_at', 'i8'),  # the later one of these two stamps
    ('oldest', 'i8'), ('latest', 'i8'),  # the range of the stamps that are not 0 (ns)
    ('stamp', 'i8'), ('pose', '7f8'),  # the last stamp that is not 0 (ns), and the last pose
    ('pose_before', '7f8'),  # the pose before the last one
    ('speed', 'f8'),  # the speed between these two (m/s plus rad/s)
    ('usual_speed', 'f8'),  # the largest of the speeds but those of jumps; see `_add_moves`
    ('largest_speed', 'f8'), ('jump', 'f8'), ('jump_at', 'i8'),  # the move at the largest speed
    ('jumps', 'i8', _JUMPS),  # the histogram of the speeds of moves of `SMALLEST_JUMP` or more
    ('first_time', 'i8'), ('last_time', 'i8'),  # the range of the times of arrival (ns)
    ('late', 'i8'), ('future', 'i8'),  # how many delays are late or from the future
    ('foreign', 'i8'),  # how many delays are so large that the stamp is from another clock
])


class Steps(NamedTuple):
    """The steps forward from stamp to stamp of a track."""

    lengths: NDArray[np.int64]  #: (n,) ns
    largest: tuple[int, int]  #: as `Track.largest_step`
    period: float  #: as `Track.period`


class Track:
    """The transforms of one child from one publisher on one topic."""

    def __init__(self, number: int, child: str, publisher: str, is_static: bool,
                 statistics: 'Statistics') -> None:
        self._statistics = statistics
        self.number, self.child = number, child
        self.publisher, self.is_static = publisher, is_static
        self.parents: dict[str, None] = {}  #: the newest parent is the last one
        self.switches = 0  #: how often the parent has changed
        self.slashed: set[str] = set()  #: the names that were sent with a leading slash
        self.values: Any = np.zeros((), _FIELDS)

    def __getitem__(self, field: str) -> Any:
        """Return one of the statistics in `_FIELDS`; a number as an int or float of Python."""
        value = self.values[field]  # numbers of numpy overflow
        return value if value.ndim else value.item()

    @property
    def mean_delay(self) -> float:
        """The mean of the delays (ns); NaN if there is none, or they are from two clocks."""
        return float(self['total_delay'] / self['delays']) if (
            self['delays'] and not self.alternates) else float('nan')

    @property
    def alternates(self) -> bool:
        """True if the stamps are of two clocks in turn, as those of two publishers."""
        return bool(self['step_back'] > _TURN
                    and self['backwards'] > max(_FEW_TURNS, _TURNS * self['count']))

    @property
    def steps(self) -> NDArray[np.int64]:
        """The (n,) steps forward from stamp to stamp (ns), of transforms that are not static."""
        return self._statistics.steps(self).lengths

    @property
    def largest_step(self) -> tuple[int, int]:
        """The largest step, and the stamp before it (ns); 0, 0: there is none."""
        return self._statistics.steps(self).largest

    @property
    def period(self) -> float:
        """The median of the steps (ns); 0.0: there is none."""
        return self._statistics.steps(self).period

    @property
    def rate(self) -> Optional[float]:
        """The average rate, by stamps (Hz); None if it is not known."""
        return rate(self['count'] - self['zero_stamps'], self['oldest'], self['latest'])

    @property
    def is_frozen(self) -> bool:
        """True if the stamp has not advanced for a second or more."""
        return (is_frozen(self['oldest'], self['latest'], self['count'])
                and not self['zero_stamps'] and self['last_time'] - self['first_time'] >= SECOND)

    def jumps_beyond(self, speed: float) -> int:
        """Count the jumps that are faster than a speed (m/s plus rad/s), within 20 %."""
        least = SMALLEST_JUMP * SECOND / _LONGEST_MOVE
        first = ceil(log2(max(speed, least) / least) * _JUMPS_PER_OCTAVE)
        return int(self['jumps'][first:].sum())


class Statistics(Counts):
    """The statistics of all tracks."""

    fields, most_tracks = _FIELDS, 10_000
    of_clock = *Counts.of_clock, 'first_time', 'last_time', 'late', 'future', 'foreign'

    def __init__(self, settling: int = 0, clock: Optional[StampClock] = None) -> None:
        super().__init__(settling, clock)
        self._tracks: list[Track] = []  #: by their numbers
        self.malformed = Counter[str]()  #: the errors of messages that cannot be decoded
        #: By publisher and topic (True: static): the other names of the transforms with an empty
        #: name, and how many there are.
        self.empty_names: dict[tuple[str, bool], Counter[str]] = {}
        #: By publisher and topic: the largest nanosec, if one is a second or more, and the
        #: children of these messages.
        self.too_many_ns: dict[tuple[str, bool], tuple[int, set[str]]] = {}
        #: By the numbers of dynamic tracks whose transforms arrive together: the times of arrival
        #: and the stamps (ns).
        self._arrivals: dict[tuple[int, ...], tuple[array[int], array[int]]] = {}
        self._steps: dict[frozenset[tuple[int, ...]], Steps] = {}  #: by the key of `together`

    def tracks(self) -> list[Track]:
        """Return the tracks, in the order of their first messages."""
        for track, values in zip(self._tracks, self._values):
            track.values = values
        return [*self._tracks]

    def publishers(self) -> set[str]:
        """Return all publishers, including those that sent only transforms with an empty name."""
        return {track.publisher for track in self._tracks} | {
            publisher for publisher, _ in self.empty_names}

    def publishers_by_child(self, nodes: Mapping[str, str]) -> dict[str, str]:
        """
        Return the names of the publishers of each child, as a text.

        :param nodes: by publisher: the name of its node, if the two differ.
        """
        names: dict[str, dict[str, None]] = {}
        for track in self._tracks:
            names.setdefault(track.child, {})[nodes.get(track.publisher, track.publisher)] = None
        return {child: ', '.join(map(shortened, each)) for child, each in names.items()}

    def span_of_arrivals(self) -> tuple[int, ...]:
        """Return when the first and the last dynamic transform have arrived (ns), if known."""
        times = [times for _, times in self.sources()]
        return (int(min(each.min() for each in times)), int(max(each.max() for each in times))
                ) if times else ()

    def sources(self) -> Iterator[tuple[list[Track], NDArray[np.int64]]]:
        """Yield the dynamic tracks whose transforms arrive together, and when they arrive (ns)."""
        for key, (times, _) in self._arrivals.items():
            yield [self._tracks[number] for number in key], np.asarray(times)

    def together(self, tracks: Iterable[Track]) -> frozenset[tuple[int, ...]]:
        """Return a key for `arrivals`: equal for tracks whose transforms arrive together."""
        numbers = {track.number for track in tracks}
        return frozenset(key for key in self._arrivals if not numbers.isdisjoint(key))

    def arrivals(self, key: frozenset[tuple[int, ...]]
                 ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """
        Return (n,) times of arrival and (n,) stamps (ns) of dynamic tracks, by arrival.

        Transforms without a known time of arrival or without a stamp are left out.
        """
        times, stamps = (np.concatenate([np.empty(0, np.int64), *(
            self._arrivals[each][column] for each in sorted(key))]) for column in (0, 1))
        order = np.argsort(times, kind='stable')
        order = order[stamps[order] != 0]
        return times[order], stamps[order]

    def steps(self, track: Track) -> Steps:
        key = self.together([track])
        if key not in self._steps:
            _, stamps = self.arrivals(key)
            steps = np.diff(stamps)
            forward = steps[steps > 0]
            if len(forward):
                i = int(steps.argmax())
                self._steps[key] = Steps(
                    forward, (int(steps[i]), int(stamps[i])), float(np.median(forward)))
            else:
                self._steps[key] = Steps(forward, (0, 0), 0.0)
        return self._steps[key]

    def add_messages(self, messages: Iterable[Message]) -> None:
        """Count the transforms of messages; see `add`."""
        for table in transform_tables(messages, lambda error: self.malformed.update([str(error)])):
            self.add(table)

    def add(self, table: TransformTable) -> None:
        super().add(table)
        if table.nanosec >= SECOND:
            key = table.publisher, table.is_static
            largest, children = self.too_many_ns.get(key, (0, set()))
            self.too_many_ns[key] = max(largest, table.nanosec), children | {
                child.removeprefix('/') for _, child in table.edges[:_MOST_NAMES]}

    def _count(self, values: Any, numbers: NDArray[np.intp], table: TransformTable) -> None:
        super()._count(values, numbers, table)
        stamps, poses = table.stamps, table.poses
        is_new = values['count'] == 0
        # A simulation that starts again begins with a stamp 0, which must not hide the step back.
        known = _without_zeros(np.concatenate([
            np.where(is_new, stamps[0], values['stamp'])[None], stamps]))
        before = known[:-1]
        is_compared = np.ones_like(stamps, np.bool_) if table.is_static else (
            (stamps == before) & (stamps != 0))
        is_compared[0] &= ~is_new
        _add_poses(values, poses, is_compared)
        if not table.is_static:
            _add_moves(values, poses, stamps, before)
            _add_stamps(values, stamps, before)
        is_timed = table.times != 0
        if is_timed.any():
            arrivals = table.times[is_timed]
            if not table.is_static:
                self._keep(numbers, arrivals, stamps[is_timed])
            if (times := self.clock.at(arrivals)) is not None:
                first = values['first_time']
                values['first_time'] = np.where(first == 0, times.min(), first)
                values['last_time'] = np.maximum(values['last_time'], times.max())
        values['count'] += len(stamps)
        values['stamp'], values['pose'] = known[-1], poses[-1]

    def _count_delays(self, values: Any, times: NDArray[np.int64], stamps: NDArray[np.int64]
                      ) -> None:
        super()._count_delays(values, times, stamps)
        delays = times[:, None] - stamps
        is_near = (stamps != 0) & (np.abs(delays) <= OTHER_CLOCK)
        values['foreign'] += ((stamps != 0) & ~is_near).sum(axis=0)
        values['late'] += (is_near & (delays > LATE)).sum(axis=0)
        values['future'] += (is_near & (delays < -FUTURE)).sum(axis=0)

    def _keep(self, numbers: NDArray[np.intp], times: NDArray[np.int64],
              stamps: NDArray[np.int64]) -> None:
        """Keep arrivals; the transforms of a message usually have the same stamp."""
        self._steps.clear()
        columns = {tuple(numbers.tolist()): stamps[:, 0]} if (
            (stamps == stamps[:, :1]).all()) else {
                (number,): column for number, column in zip(numbers.tolist(), stamps.T)}
        for key, column in columns.items():
            kept = self._arrivals.setdefault(key, (array('q'), array('q')))
            for values, new in zip(kept, (times, column)):
                values.frombytes(new.tobytes())

    def _number(self, table: TransformTable, parent: str, child: str) -> Optional[int]:
        names = parent.removeprefix('/'), child.removeprefix('/')
        if not all(names):
            others = self.empty_names.setdefault((table.publisher, table.is_static), Counter())
            others[''.join(names)] += len(table.times)
            return None
        number = super()._number(table, parent, child)
        if number is not None:
            if number == len(self._tracks):
                self._tracks.append(
                    Track(number, names[1], table.publisher, table.is_static, self))
            track = self._tracks[number]
            track.switches += bool(track.parents) and next(reversed(track.parents)) != names[0]
            track.parents.pop(names[0], None)
            track.parents[names[0]] = None
            track.slashed.update(name for name in (parent, child) if name.startswith('/'))
        return number


# Each of these functions changes the statistics of n tracks: an array (n,) of _FIELDS.


def _add_poses(values: Any, poses: NDArray[np.float64], is_compared: NDArray[np.bool_]) -> None:
    """Count (m, n, 7) poses; `is_compared`: (m, n), True if a change from the last pose counts."""
    is_valid = np.isfinite(poses).all(axis=2)
    values['invalid'] += (~is_valid).sum(axis=0)
    with np.errstate(over='ignore', invalid='ignore'):
        norms = np.where(is_valid, np.sqrt(np.square(poses[..., 3:]).sum(axis=2)), 1.0)
    deviations = np.abs(norms - 1.0)
    values['unnormalized'] += (deviations > NORM_TOLERANCE).sum(axis=0)
    worst = np.take_along_axis(norms, deviations.argmax(axis=0)[None], 0)[0]
    values['worst_norm'] = np.where(
        (values['count'] == 0) | (np.abs(worst - 1.0) > np.abs(values['worst_norm'] - 1.0)),
        worst, values['worst_norm'])
    if is_compared.any():
        poses_before = np.concatenate([values['pose'][None], poses[:-1]])
        values['changes'] += (is_compared & _differ(poses, poses_before)).sum(axis=0)


def _differ(poses: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
    with np.errstate(over='ignore', invalid='ignore'):
        is_moved = (np.abs(poses[..., :3] - others[..., :3]) > _SAME_POSITION).any(axis=-1)
        a, b = poses[..., 3:], others[..., 3:]
        cosine = np.abs((a * b).sum(axis=-1))
        largest = np.sqrt(np.square(a).sum(axis=-1) * np.square(b).sum(axis=-1))
        return np.asarray(is_moved | (cosine < largest * (1.0 - _SAME_ROTATION)))


def _add_moves(values: Any, poses: NDArray[np.float64], stamps: NDArray[np.int64],
               before: NDArray[np.int64]) -> None:
    """
    Count the moves from pose to pose, (m, n, 7), and their speeds.

    The usual speed at a pose is the least of three: from the pose before, to the pose after, and
    between these two. So a single jump, and poses of another publisher in between, are not usual.
    """
    is_first, is_second = (values['count'] == count for count in (0, 1))
    last = np.where(is_first[:, None], poses[0], values['pose'])
    chain = np.concatenate([np.where((is_first | is_second)[:, None], last,
                                     values['pose_before'])[None], last[None], poses])
    spans = np.where((stamps < before) | (stamps - before > _LONGEST_MOVE), np.inf,
                     np.maximum((stamps - before) / SECOND, _SHORTEST_MOVE))
    moves = distances(chain[2:], chain[1:-1])
    speeds = moves / spans
    both = np.concatenate([values['speed'][None], speeds])
    usual = np.minimum(both[1:], both[:-1])
    values['speed'], values['pose_before'] = speeds[-1], chain[-2]
    if moves.max() >= SMALLEST_JUMP:
        usual = np.minimum(usual, distances(chain[2:], chain[:-2]) / (2.0 * spans))
        _keep_largest(values, largest_speed=speeds, jump=moves, jump_at=stamps)
        rows, columns = np.nonzero((moves >= SMALLEST_JUMP) & (speeds > 0.0))
        bins = np.log2(speeds[rows, columns] * _LONGEST_MOVE / SECOND / SMALLEST_JUMP)
        indices = np.clip(bins * _JUMPS_PER_OCTAVE, 0, _JUMPS - 1).astype(np.int64)
        np.add.at(values['jumps'], (columns, indices), 1)
    values['usual_speed'] = np.maximum(values['usual_speed'], usual.max(axis=0))


def distances(poses: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return distance (m) plus angle (rad) between (m, n, 7) poses; 0 where it is not finite.

    The angle is approximated by twice the chord between two unit quaternions: 2.8 for pi.
    """
    with np.errstate(over='ignore', invalid='ignore'):
        steps = poses[..., :3] - others[..., :3]
        cosine = np.abs(np.einsum('ijk,ijk->ij', poses[..., 3:], others[..., 3:]))
        result = np.sqrt(np.einsum('ijk,ijk->ij', steps, steps)) + np.sqrt(
            np.maximum(8.0 - 8.0 * cosine, 0.0))
    return np.where(np.isfinite(result), result, 0.0)


def _add_stamps(values: Any, stamps: NDArray[np.int64], before: NDArray[np.int64]) -> None:
    """Count (m, n) stamps (ns); `before`: (m, n), those before but 0; of the first, itself."""
    is_zero = stamps == 0
    values['zero_stamps'] += is_zero.sum(axis=0)
    largest = np.iinfo(np.int64).max
    oldest, latest = np.where(is_zero, largest, stamps).min(axis=0), stamps.max(axis=0)
    known = values['latest'] != 0
    values['oldest'] = np.where(oldest == largest, values['oldest'], np.where(
        known, np.minimum(oldest, values['oldest']), oldest))
    values['latest'] = np.where(known, np.maximum(latest, values['latest']), latest)
    steps = np.where(is_zero | (before == 0), 0, stamps - before)
    values['backwards'] += (steps < 0).sum(axis=0)
    _keep_largest(values, step_back=-steps, step_back_at=before)


def _without_zeros(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (m, n) stamps, in which the stamp before replaces a 0."""
    rows = np.where(stamps != 0, np.arange(len(stamps))[:, None], 0)
    return np.take_along_axis(stamps, np.maximum.accumulate(rows), 0)


def _keep_largest(values: Any, **columns: NDArray[Any]) -> None:
    """Keep the row of (m, n) columns where the first is largest, if it is larger than before."""
    first = next(iter(columns))
    at = columns[first].argmax(axis=0)[None]
    is_larger = np.take_along_axis(columns[first], at, 0)[0] > values[first]
    for name, column in columns.items():
        values[name] = np.where(is_larger, np.take_along_axis(column, at, 0)[0], values[name])
