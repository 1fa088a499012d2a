"""
From when on the messages of other topics can be transformed at their stamps.

A message is judged as by a listener that keeps transforms for 10 s, and that has received all
transforms since the observation began. It is transformed into the root of its tree; the tree is
that of the newest parents.
"""

from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from operator import attrgetter
from typing import NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from puretf._causes.facts import OTHER_CLOCK
from puretf._text.times import CACHE_TIME, SECOND
from puretf.bag import Headers
from puretf_tools.inspection.stamp_clock import StampClock
from puretf_tools.inspection.traffic import LATEST

#: A message that waits at least this long (ns) is reported.
LONG_WAIT = SECOND // 10
#: Messages that cannot be transformed within the observation are not judged if they have arrived
#: less than this before its end (ns), or than this many times the usual wait.
_LAST, _WAITS = 2 * SECOND, 3
_Array = NDArray[np.int64]
_NEVER, _ALWAYS = np.iinfo(np.int64).max, np.iinfo(np.int64).min


class Verdict(IntEnum):
    """What holds for a message."""

    #: Its frame is in no tree, or has no stamps or arrivals; or it is older than the first
    #: transforms, arrives before them, was latched before, or waits at the end.
    NOT_JUDGED = 0
    ZERO_STAMP = 1  #: a lookup at its stamp takes the latest transform; not judged
    AT_ONCE = 2  #: it can be transformed when it arrives
    WAITS = 3  #: it can be transformed some time later
    NEVER = 4  #: the transforms do not reach its stamp
    TOO_OLD = 5  #: it is older than the transforms that are kept
    OTHER_CLOCK = 6  #: its stamp is far from those of all transforms


class Edge:
    """The transforms of a frame, as a listener receives them."""

    def __init__(self, child: str, arrivals: _Array, stamps: _Array) -> None:
        """Take transforms (at least one), given by their arrivals and their stamps (ns)."""
        # When a bag or a simulation starts again, listeners clear their data.
        goes_back = np.maximum(stamps[1:-1], stamps[2:]) < stamps[:-2] - CACHE_TIME
        start = int(np.flatnonzero(goes_back)[-1]) + 1 if goes_back.any() else 0
        self.child, self.arrivals, stamps = child, arrivals[start:], stamps[start:]
        self._newest = np.maximum.accumulate(stamps)  # (n,) at each arrival
        self._stamps = np.sort(stamps)
        self.begin, self.end = int(stamps[0]), int(self._newest[-1])  #: first, newest stamp (ns)

    def reaches(self, stamps: _Array) -> _Array:
        """Return when a transform with these stamps or newer ones arrives; `_NEVER`: never."""
        return np.append(self.arrivals, _NEVER)[self._newest.searchsorted(stamps)]

    def needed_cache(self, stamps: _Array, times: _Array) -> _Array:
        """Return how long transforms must be kept (ns) if stamps are looked up at some times."""
        # A transform that arrives does not count yet when the old ones are dropped.
        last = np.maximum(self.arrivals.searchsorted(times, 'right') - 2, 0)
        before = np.maximum(self._stamps.searchsorted(stamps, 'right') - 1, 0)
        return self._newest[last] - self._stamps[before]


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
    #: (n,) from the arrival until it can be transformed, a large time if that is never; if it is
    #: too old: how long a listener would have to keep transforms (ns)
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

    def number_of(self, verdict: Verdict) -> int:
        """Return of how many messages of the sample those of a verdict are a part."""
        return self.judged if verdict >= Verdict.AT_ONCE else len(self.verdicts)

    def quantiles(self) -> list[float]:
        """Return the median, the 95 % quantile and the largest of the waits (s); 0.0: none."""
        waits = self.waits[self.verdicts == Verdict.WAITS]
        return [float(each) / SECOND for each in np.quantile(
            waits if len(waits) else [0], (0.5, 0.95, 1.0), method='higher')]

    def queue(self) -> int:
        """
        Return a queue size of a MessageFilter that drops no message which has to wait; 0: none.

        A full queue drops the message that has waited longest, so all that arrive while one waits
        must find room.
        """
        waits = self.verdicts == Verdict.WAITS
        queued = self.arrivals[~np.isin(self.verdicts, (
            Verdict.AT_ONCE, Verdict.TOO_OLD, Verdict.ZERO_STAMP))]
        begin, end = self.arrivals[waits], self.arrivals[waits] + self.waits[waits]
        numbers = queued.searchsorted(end) - queued.searchsorted(begin)
        return int(numbers.max(initial=0)) * self.step

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
                 clock: Optional[StampClock]) -> None:
        """
        Set what all messages have in common.

        :param edges_above: returns the dynamic edges from a frame to its root; None: the frame is
            in no tree.
        :param spans: the oldest and the newest stamp (ns) of the transforms of each frame.
        :param begin: the beginning of the observation (ns), on the clock of the arrivals.
        :param end: its end.
        :param clock: that of the stamps; None: it is not known.
        """
        self._edges_above, self._begin, self._end, self._clock = edges_above, begin, end, clock
        spans = sorted(spans)
        self._oldest = np.array([oldest for oldest, _ in spans], np.int64)
        # (n + 1,) of no frames, the first one, the first two, ..., the newest stamp
        self._newest = np.maximum.accumulate([_ALWAYS, *(newest for _, newest in spans)])

    def judge(self, topic: str, headers: Headers) -> MessageTimes:
        """Judge the messages of a topic."""
        order = np.argsort(headers.arrivals, kind='stable')
        arrivals, stamps, numbers = (
            np.array(each, np.int64)[order].clip(-LATEST, LATEST)
            for each in (headers.arrivals, headers.stamps, headers.frame_numbers))
        verdicts, waits, edge_numbers = (np.zeros_like(stamps) for _ in range(3))
        all_edges: list[Edge] = []
        for number, frame in enumerate(headers.frames):
            edges = self._edges_above(frame)
            if edges is not None:
                at = numbers == number
                # Of several edges that end too early, the first to end is named.
                edges = sorted(edges, key=attrgetter('end'))
                verdicts[at], waits[at], slowest = self._judge(stamps[at], arrivals[at], edges)
                edge_numbers[at] = slowest + len(all_edges)
                all_edges += edges
        return MessageTimes(topic, headers.count, headers.step, [*headers.frames], numbers,
                            arrivals, stamps, verdicts, waits, edge_numbers, all_edges)

    def _judge(self, stamps: _Array, arrivals: _Array, edges: Sequence[Edge]
               ) -> tuple[_Array, _Array, _Array]:
        """
        Judge the messages of one frame.

        :param edges: the dynamic edges from the frame to the root.
        :returns: verdicts, waits as in `MessageTimes`, and the index of the edge that was waited
            for.
        """
        ready, slowest = arrivals.copy(), np.zeros_like(stamps)
        has_begun = np.ones(len(stamps), np.bool_)
        for i, edge in enumerate(edges):
            reached = edge.reaches(stamps)
            slowest[reached > ready] = i
            ready = np.maximum(ready, reached)
            has_begun &= (arrivals >= edge.arrivals[0]) & (stamps >= edge.begin)
        needed_cache = _needed_cache(edges, stamps, arrivals)
        is_reached = (ready < _NEVER) & (_needed_cache(edges, stamps, ready) <= CACHE_TIME)
        is_far = self._is_far(stamps, arrivals) & bool(edges)
        # What was latched long before is received at the beginning.
        is_latched = is_far & (arrivals < self._begin + _LAST) & (
            stamps < self._oldest.min(initial=_NEVER))
        verdicts = np.select(
            [stamps == 0, is_latched, is_far, ~has_begun, needed_cache > CACHE_TIME,
             ready <= arrivals, is_reached],
            [Verdict.ZERO_STAMP, Verdict.NOT_JUDGED, Verdict.OTHER_CLOCK, Verdict.NOT_JUDGED,
             Verdict.TOO_OLD, Verdict.AT_ONCE, Verdict.WAITS], Verdict.NEVER)
        usual = (ready - arrivals)[np.isin(verdicts, (Verdict.AT_ONCE, Verdict.WAITS))]
        patience = max(_LAST, _WAITS * float(np.median(usual)) if len(usual) else 0.0)
        may_come = (verdicts == Verdict.NEVER) & (self._end - arrivals < patience)
        waits = np.where(verdicts == Verdict.TOO_OLD, needed_cache, ready - arrivals)
        return np.where(may_come, Verdict.NOT_JUDGED, verdicts), waits, slowest

    def _is_far(self, stamps: _Array, arrivals: _Array) -> NDArray[np.bool_]:
        """Return whether stamps are far from those of all transforms, and from the present."""
        last = self._oldest.searchsorted(stamps + OTHER_CLOCK, 'right')
        is_far = np.asarray(self._newest[last] < stamps - OTHER_CLOCK)
        if self._clock and (times := self._clock.at(arrivals)) is not None:
            is_far &= np.abs(times - stamps) > OTHER_CLOCK
        return is_far


def _needed_cache(edges: Iterable[Edge], stamps: _Array, times: _Array) -> _Array:
    """Return the longest time that an edge needs; see `Edge.needed_cache`."""
    needed = np.zeros_like(stamps)
    for edge in edges:
        needed = np.maximum(needed, edge.needed_cache(stamps, times))
    return needed
