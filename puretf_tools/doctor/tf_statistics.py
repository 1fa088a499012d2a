"""
Statistics of the messages on /tf and /tf_static.

Of each message, only its time of arrival and its stamps are kept (16 bytes, if it has one stamp).
"""

from array import array
from collections import Counter
from collections.abc import Iterable
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND
from puretf.transform_table import Message, transform_tables, TransformTable
from puretf_tools.doctor.stream import Stream
from puretf_tools.inspection.stamp_clock import StampClock
from puretf_tools.inspection.traffic import LATEST

#: The largest number of tracks.
_MOST_TRACKS = 10_000
#: The norm of a quaternion may differ from 1 by this.
NORM_TOLERANCE = 1e-3
#: Poses are equal if their positions differ by at most this (m), and the cosine of half the angle
#: between them differs from 1 by at most this (the angle is about 1e-5 rad).
_SAME_POSITION, _SAME_ROTATION = 1e-6, 1e-11
#: A jump is a move from pose to pose of at least `SMALLEST_JUMP` (m plus rad), this many times as
#: fast as the frame usually is. Moves within more than `_LONGEST_MOVE` (ns) do not count; moves
#: within less than `_SHORTEST_MOVE` (s) count as such.
SMALLEST_JUMP, JUMP, _LONGEST_MOVE, _SHORTEST_MOVE = 0.2, 10, SECOND // 2, 0.02

_FIELDS = np.dtype([
    ('count', 'i8'),  # the number of transforms
    ('invalid', 'i8'),  # of those: with NaN or infinite numbers
    ('unnormalized', 'i8'),  # with a quaternion whose norm is not 1
    ('norm_error', 'f8'),  # the largest difference of the norm from 1
    ('changes', 'i8'),  # with another pose than the one before; on /tf only if the stamp is equal
    ('nanosec', 'i8'),  # the largest nanosec of a stamp in its messages
    ('stamp', 'i8'), ('pose', '7f8'),  # the last stamp (ns), and the last pose
    ('pose_before', '7f8'),  # the pose before the last one
    ('speed', 'f8'),  # the speed between these two (m/s plus rad/s)
    ('usual_speed', 'f8'),  # the largest of the speeds but those of jumps; see `_add_moves`
    ('largest_speed', 'f8'), ('jump', 'f8'), ('jump_at', 'i8'),  # the move at the largest speed
    ('jumps', 'i8'),  # the number of jumps
    ('first_time', 'i8'), ('last_time', 'i8'),  # the range of the times of arrival (ns)
])


class Track:
    """
    The transforms of one child from one publisher on one topic.

    Its items are those of `_FIELDS`, and the attributes of its `Stream`.
    """

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
        if field not in (_FIELDS.names or ()):
            return getattr(self.stream, field)
        value = self.values[field]
        return value if value.ndim else value.item()  # numbers of numpy overflow

    @property
    def stream(self) -> Stream:
        """The arrivals and stamps; none of a static track."""
        return self._statistics.stream([self])


class Statistics:
    def __init__(self, settling: int = 0, clock: Optional[StampClock] = None) -> None:
        """Count nothing yet; `settling`: how long (ns) a new publisher has no delays."""
        self.settling, self.clock = settling, clock or StampClock()
        #: By child, publisher and topic (True: static), in the order of their numbers.
        self._tracks: dict[tuple[str, str, bool], Track] = {}
        self._values: Any = np.zeros(_MOST_TRACKS, _FIELDS)  #: by the number of the track
        #: The number of counted transforms, and of those left out as there are too many tracks.
        self.count = self.not_counted = 0
        self.malformed = Counter[str]()  #: the errors of messages that cannot be decoded
        #: By publisher and topic (True: static): the other names of the transforms with an empty
        #: name, and how many there are.
        self.empty_names: dict[tuple[str, bool], Counter[str]] = {}
        #: By the numbers of dynamic tracks whose transforms arrive together: the times of arrival
        #: and the stamps (ns).
        self._arrivals: dict[tuple[int, ...], tuple[array[int], array[int]]] = {}
        self._keys: dict[int, list[tuple[int, ...]]] = {}  #: by the number of a track: those keys
        self._streams: dict[tuple[tuple[int, ...], ...], Stream] = {}
        self._since: dict[str, int] = {}  #: by publisher: its first dynamic message (ns)

    def tracks(self) -> list[Track]:
        """Return the tracks, in the order of their first messages."""
        all_values = self._values[:len(self._tracks)].copy()
        for field in 'first_time', 'last_time':
            times = self.clock.at(all_values[field])
            all_values[field] = 0 if times is None else np.where(all_values[field] == 0, 0, times)
        for track, values in zip(self._tracks.values(), all_values):
            track.values = values
        return [*self._tracks.values()]

    def publishers(self) -> set[str]:
        """Return all publishers, including those that sent only transforms with an empty name."""
        return {publisher for _, publisher, _ in self._tracks} | {
            publisher for publisher, _ in self.empty_names}

    def stream(self, tracks: Iterable[Track]) -> Stream:
        """Return that of dynamic tracks; the same one for tracks that arrive together."""
        since = [self._since.get(track.publisher, 0) for track in tracks]
        keys = (*sorted({key for track in tracks for key in self._keys.get(track.number, ())}),)
        if keys not in self._streams:
            kept = [self._arrivals[key] for key in keys] or [(array('q'), array('q'))]
            arrivals, stamps = (np.concatenate(columns) for columns in zip(*kept))
            self._streams[keys] = Stream(
                arrivals, stamps, self.clock.at(arrivals), max(since, default=0) + self.settling)
        return self._streams[keys]

    def add_messages(self, messages: Iterable[Message]) -> None:
        """Count the transforms of messages; see `add`."""
        for table in transform_tables(messages, lambda error: self.malformed.update([str(error)])):
            self.add(table)

    def add(self, table: TransformTable) -> None:
        found = [self._number(table, *edge) for edge in table.edges]
        kept = [i for i, number in enumerate(found) if number is not None]
        if kept:
            self.count += len(table.times) * len(kept)
            numbers = np.array([found[i] for i in kept])
            values = self._values[numbers]
            self._count(values, numbers, table._replace(
                times=table.times.clip(-LATEST, LATEST), stamps=table.stamps[:, kept],
                poses=table.poses[:, kept]))
            self._values[numbers] = values

    def _count(self, values: Any, numbers: NDArray[np.intp], table: TransformTable) -> None:
        """Change the values (n,) of the tracks with some numbers by n transforms each message."""
        stamps, poses = table.stamps, table.poses
        is_new = values['count'] == 0
        before = np.concatenate([np.where(is_new, stamps[0], values['stamp'])[None], stamps[:-1]])
        is_compared = np.ones_like(stamps, np.bool_) if table.is_static else (
            (stamps == before) & (stamps != 0))
        is_compared[0] &= ~is_new
        _add_poses(values, poses, is_compared)
        if not table.is_static:
            _add_moves(values, poses, stamps, before)
            self._keep(numbers, table)
        times = table.times[table.times != 0]
        if len(times):
            first = values['first_time']
            values['first_time'] = np.where(first == 0, times.min(), first)
            values['last_time'] = np.maximum(values['last_time'], times.max())
        values['nanosec'] = np.maximum(values['nanosec'], table.nanosec)
        values['count'] += len(stamps)
        values['stamp'], values['pose'] = stamps[-1], poses[-1]

    def _keep(self, numbers: NDArray[np.intp], table: TransformTable) -> None:
        """Keep arrivals; the transforms of a message usually have the same stamp."""
        self._streams.clear()
        self._since.setdefault(table.publisher, int(table.times.min()))
        stamps = table.stamps
        columns = {tuple(numbers.tolist()): stamps[:, 0]} if (
            (stamps == stamps[:, :1]).all()) else {
                (number,): column for number, column in zip(numbers.tolist(), stamps.T)}
        for key, column in columns.items():
            if key not in self._arrivals:
                self._arrivals[key] = array('q'), array('q')
                for number in key:
                    self._keys.setdefault(number, []).append(key)
            for kept, new in zip(self._arrivals[key], (table.times, column)):
                kept.frombytes(new.tobytes())

    def _number(self, table: TransformTable, parent: str, child: str) -> Optional[int]:
        """Return the number of the track of an edge; None if the edge is not counted."""
        names = parent.removeprefix('/'), child.removeprefix('/')
        if not all(names):
            others = self.empty_names.setdefault((table.publisher, table.is_static), Counter())
            others[''.join(names)] += len(table.times)
            return None
        key = names[1], table.publisher, table.is_static
        if key not in self._tracks:
            number = len(self._tracks)
            if number >= _MOST_TRACKS:
                self.not_counted += len(table.times)
                return None
            self._tracks[key] = Track(number, *key, self)
        track = self._tracks[key]
        track.switches += bool(track.parents) and next(reversed(track.parents)) != names[0]
        track.parents.pop(names[0], None)
        track.parents[names[0]] = None
        track.slashed.update(name for name in (parent, child) if name.startswith('/'))
        return track.number


# Each of these functions changes the statistics of n tracks: an array (n,) of _FIELDS.


def _add_poses(values: Any, poses: NDArray[np.float64], is_compared: NDArray[np.bool_]) -> None:
    """Count (m, n, 7) poses; `is_compared`: (m, n), True if a change from the last pose counts."""
    is_valid = np.isfinite(poses).all(axis=2)
    values['invalid'] += (~is_valid).sum(axis=0)
    with np.errstate(over='ignore', invalid='ignore'):
        norms = np.where(is_valid, np.sqrt(np.square(poses[..., 3:]).sum(axis=2)), 1.0)
    deviations = np.abs(norms - 1.0)
    values['unnormalized'] += (deviations > NORM_TOLERANCE).sum(axis=0)
    values['norm_error'] = np.maximum(values['norm_error'], deviations.max(axis=0))
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
    has_jumps = moves.max() >= SMALLEST_JUMP
    if has_jumps:
        usual = np.minimum(usual, distances(chain[2:], chain[:-2]) / (2.0 * spans))
        at = speeds.argmax(axis=0)[None]
        is_larger = np.take_along_axis(speeds, at, 0)[0] > values['largest_speed']
        for name, column in ('largest_speed', speeds), ('jump', moves), ('jump_at', stamps):
            values[name] = np.where(is_larger, np.take_along_axis(column, at, 0)[0], values[name])
    values['usual_speed'] = np.maximum(values['usual_speed'], usual.max(axis=0))
    if has_jumps:
        values['jumps'] += ((moves >= SMALLEST_JUMP) & (
            speeds > JUMP * values['usual_speed'])).sum(axis=0)


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
