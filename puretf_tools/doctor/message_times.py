"""
From when on the messages of other topics can be transformed at their stamps.

A message is judged as by a listener that keeps transforms for 10 s, and that has received all
transforms since the observation began. It is transformed into the root of its tree; the tree is
that of the newest parents.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import IntEnum
from operator import attrgetter
from typing import NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from puretf._causes.facts import OTHER_CLOCK
from puretf._text.times import SECOND
from puretf.bag import Headers
from puretf.transform_buffer import CACHE_TIME
from puretf_tools.doctor.stream import Availability, NEVER, Stream
from puretf_tools.inspection.stamp_clock import StampClock
from puretf_tools.inspection.traffic import LATEST

#: A message that waits at least this long (ns) is reported.
LONG_WAIT = SECOND // 10
#: Messages that cannot be transformed within the observation are not judged if they have arrived
#: less than this before its end (ns), or than this many times the usual wait.
_LAST, _WAITS = 2 * SECOND, 3
_Array = NDArray[np.int64]


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


class MessageTimes(NamedTuple):
    """The messages of a topic: n of them were judged, in the order of their arrival."""

    topic: str
    messages: int  #: how many there were
    step: int  #: of so many messages, one was judged
    frames: list[str]  #: the frames that their headers name
    frame_numbers: _Array  #: (n,) indices of `frames`
    arrivals: _Array  #: (n,) ns
    stamps: _Array  #: (n,) ns
    stream: Stream  #: all but those with the stamp 0
    verdicts: _Array  #: (n,) `Verdict`
    #: (n,) from the arrival until it can be transformed, a large time if that is never; if it is
    #: too old: how long a listener would have to keep transforms (ns)
    waits: _Array
    #: (n,) if it waits or waits in vain, the index in `children` of that of the last edge whose
    #: data come.
    edge_numbers: _Array
    children: list[str]  #: those of the edges above the frames

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


def judge(topic: str, headers: Headers,
          edges_above: Callable[[str], Optional[Mapping[Availability, str]]],
          span: tuple[int, int], clock: Optional[StampClock]) -> MessageTimes:
    """
    Judge the messages of a topic.

    :param edges_above: returns the dynamic edges from a frame to its root, and their children;
        None: the frame is in no tree.
    :param span: the begin and the end of the observation (ns), on the clock of the arrivals.
    :param clock: that of the stamps; None: it is not known.
    """
    order = np.argsort(headers.arrivals, kind='stable')
    arrivals, stamps, numbers = (
        np.array(each, np.int64)[order].clip(-LATEST, LATEST)
        for each in (headers.arrivals, headers.stamps, headers.frame_numbers))
    times = clock.at(arrivals) if clock else None
    verdicts, waits, edge_numbers = (np.zeros_like(stamps) for _ in range(3))
    all_children: list[str] = []
    for number, frame in enumerate(headers.frames):
        children = edges_above(frame)
        if children is not None:
            at = numbers == number
            # Of several edges that end too early, the first to end is named.
            edges = sorted(children, key=attrgetter('end'))
            verdicts[at], waits[at], slowest = _verdicts(
                stamps[at], arrivals[at], None if times is None else times[at], edges, span)
            edge_numbers[at] = slowest + len(all_children)
            all_children += map(children.__getitem__, edges)
    return MessageTimes(
        topic, headers.count, headers.step, [*headers.frames], numbers, arrivals, stamps,
        Stream(arrivals, stamps, times), verdicts, waits, edge_numbers, all_children)


def _verdicts(stamps: _Array, arrivals: _Array, times: Optional[_Array],
              edges: Sequence[Availability], span: tuple[int, int]
              ) -> tuple[_Array, _Array, _Array]:
    """Return verdicts, waits and the index of the edge that was waited for; see `judge`."""
    ready, slowest = arrivals.copy(), np.zeros_like(stamps)
    for i, edge in enumerate(edges):
        reached = edge.reaches(stamps)
        slowest[reached > ready] = i
        ready = np.maximum(ready, reached)
    first = max((edge.begin for edge in edges), default=-NEVER)
    is_early = arrivals < max((edge.arrivals[0] for edge in edges), default=-NEVER)
    needed_cache = _needed_cache(edges, stamps, arrivals)
    is_reached = (ready < NEVER) & (_needed_cache(edges, stamps, ready) <= CACHE_TIME)
    # They are far from all transforms, and from the present.
    is_far = np.full(len(stamps), bool(edges))
    for edge in edges:
        is_far &= (stamps < edge.begin - OTHER_CLOCK) | (stamps > edge.end + OTHER_CLOCK)
    if times is not None:
        is_far &= np.abs(times - stamps) > OTHER_CLOCK
    # What was latched long before is received at the beginning.
    is_latched = (arrivals < span[0] + _LAST) & (stamps < first)
    verdicts = np.select(
        [stamps == 0, is_early | (is_far & is_latched), is_far, stamps < first,
         needed_cache > CACHE_TIME, ready <= arrivals, is_reached],
        [Verdict.ZERO_STAMP, Verdict.NOT_JUDGED, Verdict.OTHER_CLOCK, Verdict.NOT_JUDGED,
         Verdict.TOO_OLD, Verdict.AT_ONCE, Verdict.WAITS], Verdict.NEVER)
    usual = (ready - arrivals)[np.isin(verdicts, (Verdict.AT_ONCE, Verdict.WAITS))]
    patience = max(_LAST, _WAITS * float(np.median(usual)) if len(usual) else 0.0)
    may_come = (verdicts == Verdict.NEVER) & (span[1] - arrivals < patience)
    waits = np.where(verdicts == Verdict.TOO_OLD, needed_cache, ready - arrivals)
    return np.where(may_come, Verdict.NOT_JUDGED, verdicts), waits, slowest


def _needed_cache(edges: Iterable[Availability], stamps: _Array, times: _Array) -> _Array:
    needed = [edge.needed_cache(stamps, times) for edge in edges]
    return np.asarray(np.max([np.zeros_like(stamps), *needed], axis=0))
