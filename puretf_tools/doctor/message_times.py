"""
From when on the messages of other topics can be transformed at their stamps.

A message is judged as by a listener that keeps transforms for 10 s, and that has received all
transforms since the observation began. It is transformed into the root of its tree; the tree is
that of the newest parents.
"""

from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from typing import NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND
from puretf._causes.facts import OTHER_CLOCK
from puretf.bag import Headers
from puretf_tools.inspection.stamp_clock import StampClock
from puretf_tools.inspection.traffic import LATEST

#: A message that waits at least this long (ns) is reported.
LONG_WAIT = SECOND // 10
#: How long a listener keeps transforms (ns).
CACHE = 10 * SECOND
#: Messages that cannot be transformed within the observation are not judged if they have arrived
#: less than this before its end (ns), or than this many times the usual wait.
_LAST, _WAITS = 2 * SECOND, 3
_Array = NDArray[np.int64]
_NEVER, _ALWAYS = np.iinfo(np.int64).max, np.iinfo(np.int64).min


class Verdict(IntEnum):
    """What holds for a message."""

    #: Its frame is in no tree, or there are no stamps or arrivals of a transform; not judged.
    NO_TREE = 0
    ZERO_STAMP = 1  #: a lookup at its stamp takes the latest transform; not judged
    #: It is older than the first transforms that were received, or arrives before them, or it was
    #: latched before; not judged.
    START = 2
    END = 3  #: it waits at the end of the observation; not judged
    AT_ONCE = 4  #: it can be transformed when it arrives
    WAITS = 5  #: it can be transformed some time later
    NEVER = 6  #: the transforms do not reach its stamp
    TOO_OLD = 7  #: it is older than the transforms that are kept
    OTHER_CLOCK = 8  #: its stamp is far from those of all transforms


class Edge:
    """The transforms of a frame, as a listener receives them."""

    def __init__(self, child: str, arrivals: _Array, stamps: _Array) -> None:
        """Take transforms (at least one), given by their arrivals and their stamps (ns)."""
        # When a bag or a simulation starts again, listeners clear their data.
        goes_back = (stamps[1:-1] < stamps[:-2] - CACHE) & (stamps[2:] < stamps[:-2] - CACHE)
        begin = int(np.flatnonzero(goes_back)[-1]) + 1 if goes_back.any() else 0
        self.restart = int(arrivals[begin]) if begin else 0  #: when it has started again; 0: never
        arrivals, stamps = arrivals[begin:], stamps[begin:]
        self.child = child
        self.arrivals = arrivals  #: (n,) in ascending order
        self.newest = np.maximum.accumulate(stamps)  #: (n,) the newest stamp at each arrival
        self._first = np.minimum.accumulate(stamps)  # (n,) the oldest stamp so far
        self._stamps = np.sort(stamps)

    @property
    def end(self) -> int:
        """The newest stamp (ns)."""
        return int(self.newest[-1])

    def arrives_at(self, time: int) -> bool:
        """Return whether transforms still arrive at a time (ns), as often as before."""
        periods = np.diff(self.arrivals)
        return bool(time - self.arrivals[-1] < max(
            _LAST, _WAITS * float(np.median(periods)) if len(periods) else 0.0))

    def oldest_at(self, times: _Array) -> tuple[_Array, NDArray[np.bool_]]:
        """
        Return the oldest stamps that are kept at some times, and whether they are the first ever.

        Before the first arrival, they are the first.
        """
        # A transform that arrives does not count yet when the old ones are dropped.
        last = np.maximum(self.arrivals.searchsorted(times, 'right') - 1, 0)
        limits = np.where(last > 0, self.newest[last - 1] - CACHE, _ALWAYS)
        first = self._first[last]
        return (np.maximum(first, self._stamps[self._stamps.searchsorted(limits)]),
                limits <= first)

    def needed_cache(self, stamps: _Array, times: _Array) -> _Array:
        """Return how long transforms must be kept (ns) if those of some stamps are needed."""
        # As in `oldest_at`, the last transform that has arrived does not count.
        last = np.maximum(self.arrivals.searchsorted(times, 'right') - 2, 0)
        before = np.maximum(self._stamps.searchsorted(stamps, 'right') - 1, 0)
        return self.newest[last] - np.minimum(self._stamps[before], stamps)

    def reaches(self, stamps: _Array) -> _Array:
        """Return when a transform with these stamps or newer ones arrives; `_NEVER`: never."""
        return np.append(self.arrivals, _NEVER)[self.newest.searchsorted(stamps)]


class MessageTimes(NamedTuple):
    """The messages of a topic: n of them were judged, in the order of their arrival."""

    topic: str
    messages: int  #: how many there were
    step: int  #: of so many messages, one was judged
    frames: list[str]  #: the frames that their headers name
    frame_numbers: _Array  #: (n,) indices of `frames`
    arrivals: _Array  #: (n,) ns
    stamps: _Array  #: (n,) ns
    verdicts: _Array  #: (n,) `Verdict`
    #: (n,) if it waits: from the arrival until it can be transformed; if it is too old: how long a
    #: listener would have to keep transforms (ns)
    waits: _Array
    #: (n,) if it waits or waits in vain, the index in `edges` of the last edge whose data come.
    edge_numbers: _Array
    edges: list[Edge]

    def count(self, *verdicts: Verdict) -> int:
        """Return how many messages of the sample have one of some verdicts."""
        return int(np.isin(self.verdicts, verdicts).sum())

    @property
    def judged(self) -> int:
        """How many messages of the sample were judged."""
        return int((self.verdicts >= Verdict.AT_ONCE).sum())

    def quantiles(self) -> list[float]:
        """Return the median, the 95 % quantile and the largest of the waits (s); 0.0: none."""
        waits = self.waits[self.verdicts == Verdict.WAITS]
        if not len(waits):
            return [0.0] * 3
        return [float(each) / SECOND for each in np.quantile(
            waits, (0.5, 0.95, 1.0), method='higher')]

    def queue(self) -> int:
        """
        Return the queue size of a MessageFilter that drops no message which has to wait; 0: none.

        A full queue drops the message that has waited longest. So of the messages that wait in
        vain, only those count that have arrived after such a message.
        """
        waits = self.verdicts == Verdict.WAITS
        arrivals = self.arrivals[waits]
        ready = arrivals + self.waits[waits]
        in_vain = self.arrivals[np.isin(self.verdicts, (
            Verdict.NEVER, Verdict.END, Verdict.START, Verdict.OTHER_CLOCK, Verdict.NO_TREE))]
        if not len(arrivals):
            return 0
        # At each arrival: how many wait, and from when on the one waits that has waited longest.
        times = np.sort(np.concatenate([arrivals, in_vain]))
        waiting = arrivals.searchsorted(times, 'right') - np.sort(ready).searchsorted(
            times, 'right')
        longest = np.maximum.accumulate(ready).searchsorted(times, 'right')
        since = arrivals[np.minimum(longest, len(arrivals) - 1)]
        younger = in_vain.searchsorted(times, 'right') - in_vain.searchsorted(since)
        return int((waiting + younger)[waiting > 0].max(initial=1)) * self.step

    def row(self) -> dict[str, object]:
        """Return a row of the table in the report: plain values, times in s."""
        judged = max(1, self.judged)
        median, most, largest = self.quantiles()
        return {'topic': self.topic, 'messages': self.messages, 'judged': self.judged,
                'at_once': self.count(Verdict.AT_ONCE) / judged,
                'waiting': self.count(Verdict.WAITS) / judged,
                'median_wait': median, 'wait_of_95_percent': most, 'largest_wait': largest,
                'never': self.count(Verdict.NEVER, Verdict.TOO_OLD, Verdict.OTHER_CLOCK) / judged,
                'queue': self.queue()}


class Judge:
    """Judges the messages of topics."""

    def __init__(self, edges_above: Callable[[str], Optional[Sequence[Edge]]],
                 spans: Iterable[tuple[int, int]], begin: int, end: int,
                 clock: Optional[StampClock], settling: int) -> None:
        """
        Set what all messages have in common.

        :param edges_above: returns the dynamic edges from a frame to its root; None: the frame is
            in no tree.
        :param spans: the oldest and the newest stamp (ns) of the transforms of each frame.
        :param begin: the beginning of the observation (ns), on the clock of the arrivals.
        :param end: its end.
        :param clock: that of the stamps; None: it is not known.
        :param settling: messages that arrive before the first transform of an edge, or less than
            this after it (ns), are not judged; 0: they are.
        """
        self._edges_above, self._begin, self._end = edges_above, begin, end
        self._clock, self._settling = clock, settling
        self._spans: list[tuple[int, int]] = []
        for oldest, newest in sorted(spans):
            if self._spans and oldest <= self._spans[-1][1] + OTHER_CLOCK:
                oldest, newest = self._spans[-1][0], max(newest, self._spans.pop()[1])
            self._spans.append((oldest, newest))

    def judge(self, topic: str, headers: Headers) -> MessageTimes:
        """Judge the messages of a topic."""
        arrivals = np.array(headers.arrivals, np.int64).clip(-LATEST, LATEST)
        order = np.argsort(arrivals, kind='stable')
        arrivals = arrivals[order]
        stamps, numbers = (np.array(each, np.int64)[order]
                           for each in (headers.stamps, headers.frame_numbers))
        is_far = self._is_far(stamps, arrivals)
        # What was latched long before is received at the beginning.
        is_latched = is_far & (arrivals < self._begin + _LAST) & (
            stamps < min((oldest for oldest, _ in self._spans), default=0))
        verdicts, waits, edge_numbers = (np.zeros_like(stamps) for _ in range(3))
        all_edges: list[Edge] = []
        for number, frame in enumerate(headers.frames):
            edges = self._edges_above(frame)
            if edges is not None:
                at = numbers == number
                begin = max((max(edge.restart, self._settling and (
                    int(edge.arrivals[0]) + self._settling)) for edge in edges), default=0)
                verdicts[at], waits[at], slowest = _judge(
                    stamps[at], arrivals[at], edges, np.where(is_latched[at], _NEVER, begin),
                    self._end, is_far[at] & ~is_latched[at])
                edge_numbers[at] = slowest + len(all_edges)
                all_edges += edges
        return MessageTimes(topic, headers.count, headers.step, [*headers.frames], numbers,
                            arrivals, stamps, verdicts, waits, edge_numbers, all_edges)

    def _is_far(self, stamps: _Array, arrivals: _Array) -> NDArray[np.bool_]:
        """Return whether stamps are far from those of all transforms, and from the present."""
        is_far = np.ones(len(stamps), np.bool_)
        for oldest, newest in self._spans:
            is_far &= (stamps < oldest - OTHER_CLOCK) | (stamps > newest + OTHER_CLOCK)
        if self._clock and (times := self._clock.at(arrivals)) is not None:
            is_far &= np.abs(times - stamps) > OTHER_CLOCK
        return is_far


def _judge(stamps: _Array, arrivals: _Array, edges: Sequence[Edge], begin: _Array,
           end: int, is_other_clock: NDArray[np.bool_]) -> tuple[_Array, _Array, _Array]:
    """
    Judge n messages of one frame.

    :param stamps: (n,) ns
    :param arrivals: (n,) ns, on the clock of the arrivals of the transforms.
    :param edges: the dynamic edges from the frame to the root.
    :param begin: (n,) if the message arrives earlier, it is not judged (ns).
    :param end: the end of the observation (ns), on the same clock.
    :param is_other_clock: (n,) whether the stamp is far from those of all transforms.
    :returns: (n,) verdicts, (n,) waits as in `MessageTimes`, (n,) the index of the edge that was
        waited for.
    """
    ready, slowest = arrivals.copy(), np.zeros(len(stamps), np.int64)
    needed_cache, ends = np.zeros_like(stamps), np.array([edge.end for edge in edges], np.int64)
    for i, edge in enumerate(edges):
        reached = edge.reaches(stamps)
        # Of several edges that end too early, the first to end is named.
        is_last = (reached > ready) | ((reached == _NEVER) & (edge.end < ends[slowest]))
        slowest[is_last], ready = i, np.maximum(ready, reached)
        needed_cache = np.maximum(needed_cache, edge.needed_cache(stamps, arrivals))
    oldest, is_first = _oldest_at(arrivals, edges)
    is_reached = ready < _NEVER
    is_reached &= stamps >= _oldest_at(np.where(is_reached, ready, arrivals), edges)[0]
    verdicts = np.select(
        [stamps == 0, np.full(len(stamps), not edges), is_other_clock,
         (arrivals < begin) | (stamps < oldest) & is_first, stamps < oldest, ready <= arrivals,
         is_reached],
        [Verdict.ZERO_STAMP, Verdict.AT_ONCE, Verdict.OTHER_CLOCK, Verdict.START, Verdict.TOO_OLD,
         Verdict.AT_ONCE, Verdict.WAITS], Verdict.NEVER)
    usual = (ready - arrivals)[np.isin(verdicts, (Verdict.AT_ONCE, Verdict.WAITS))]
    longest = max(_LAST, _WAITS * float(np.median(usual)) if len(usual) else 0.0)
    patience = np.array([longest if edge.arrives_at(end) else _LAST for edge in edges] or [_LAST])
    verdicts[(verdicts == Verdict.NEVER) & (end - arrivals < patience[slowest])] = Verdict.END
    waits = np.select([verdicts == Verdict.WAITS, verdicts == Verdict.TOO_OLD],
                      [ready - arrivals, needed_cache], 0)
    return verdicts, waits, slowest


def _oldest_at(times: _Array, edges: Sequence[Edge]) -> tuple[_Array, NDArray[np.bool_]]:
    """Return what `Edge.oldest_at` returns, for the edge whose oldest stamp is the newest."""
    oldest, is_first = np.full(len(times), _ALWAYS), np.ones(len(times), np.bool_)
    for edge in edges:
        stamps, is_own_first = edge.oldest_at(times)
        is_first = np.where(stamps > oldest, is_own_first, is_first)
        oldest = np.maximum(oldest, stamps)
    return oldest, is_first
