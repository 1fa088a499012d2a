"""Rates and delays of received transforms, by frame and by publishing node."""

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from itertools import chain
from threading import Lock
from time import time_ns
from typing import NamedTuple, Optional, TYPE_CHECKING

from puretf import is_too_long
from puretf.formatting import in_seconds, SECOND

if TYPE_CHECKING:
    from puretf.publisher_listener import PublisherListener, ReceivedMessage

#: The window of the statistics: the current second of the clock, and this many seconds before it.
WINDOW = 10
#: The messages of a publisher are not counted for this time (ns) after its first message: they may
#: have waited until the publisher had discovered the subscription.
SETTLING = SECOND // 5
#: The largest number of pairs of a frame and a publisher for which statistics are kept.
_MOST = 100_000
#: The largest number of publishers for which the time of the first message is kept.
_MOST_PUBLISHERS = 10_000
#: A program has fewer broadcasters than this without a frame of their own, unless it creates them
#: again and again.
_MANY, _MANY_SILENT = 6, 20


def recreated(publishers: Mapping[str, Collection[str]]) -> list[str]:
    """
    Return the publishers that a node creates one after another, as in the callback of a timer.

    :param publishers: by publisher of one node on one topic: the frames that it has sent.
    :returns: the publishers that have no frame of their own, if there are at least 6; if none of
        them has sent anything, at least 20.
    """
    counts = Counter(chain.from_iterable(publishers.values()))
    found = [publisher for publisher, frames in publishers.items()
             if all(counts[frame] > 1 for frame in frames)]
    return found if len(found) >= (_MANY if counts else _MANY_SILENT) else []


class Summary(NamedTuple):
    """The rate and the delays of the transforms that arrived within the window."""

    rate: Optional[float]  #: Hz; None if all transforms arrived at the same time
    average_delay: float  #: s
    maximum_delay: float  #: s


class _Second:
    """The arrivals within one second of the clock; all times are in ns."""

    __slots__ = ('count', 'first', 'greatest', 'last', 'number', 'total')

    def __init__(self, number: int, arrival: int, delay: int) -> None:
        self.number, self.count = number, 1
        self.first = self.last = arrival
        self.greatest = self.total = delay


class Delays:
    """The number and the delays of arrivals, second by second over the window."""

    __slots__ = ('_seconds', 'is_dynamic', 'last')

    def __init__(self) -> None:
        self._seconds: deque[_Second] = deque(maxlen=WINDOW + 1)
        self.is_dynamic = False  #: True if a transform was received on /tf
        self.last = 0  #: the time of the last arrival (ns); 0: nothing has arrived

    def add(self, arrival: int, delay: int) -> None:
        """Count an arrival at a time (ns), with the time since its stamp (ns)."""
        self.last = arrival
        number = arrival // SECOND
        seconds = self._seconds
        if not seconds or seconds[-1].number < number:
            seconds.append(_Second(number, arrival, delay))
            return
        second = seconds[-1]
        second.count += 1
        second.last = max(second.last, arrival)
        second.total += delay
        if delay > second.greatest:
            second.greatest = delay

    def clear(self) -> None:
        self._seconds.clear()
        self.last = 0

    def within(self, now: int) -> list[_Second]:
        return [second for second in self._seconds if second.number >= now // SECOND - WINDOW]


def summarize(delays: Collection[Delays], now: int) -> Optional[Summary]:
    """Summarise arrivals within the window that ends now (ns); None if there are none."""
    seconds = [second for each in delays for second in each.within(now)]
    if not seconds:
        return None
    count = sum(second.count for second in seconds)
    span = max(second.last for second in seconds) - min(second.first for second in seconds)
    return Summary((count - 1) * SECOND / span if span else None,
                   in_seconds(sum(second.total for second in seconds) // count),
                   in_seconds(max(second.greatest for second in seconds)))


class NodeTraffic(NamedTuple):
    """The transforms that a node publishes, either of one frame or of all frames of the node."""

    frame: str  #: the child frame; '': all frames of the node
    node: str  #: the full name of the node
    is_static: bool  #: True if no transform was received on /tf, only on /tf_static
    is_present: Optional[bool]  #: True if the node still publishes; None: not known
    summary: Optional[Summary]  #: None if no dynamic transform was counted within the window
    silence: Optional[float]  #: s since the last one; None if none was counted


class Traffic:
    """Statistics of the messages that are received on /tf and /tf_static."""

    def __init__(self, now: Callable[[], int], only: str = '',
                 system_clock: Callable[[], int] = time_ns) -> None:
        """
        Create empty statistics.

        :param now: returns the time on the clock of the stamps (ns); 0: not known.
        :param only: the only child frame that is counted; '': all frames.
        :param system_clock: returns the time on the clock of the reception times (ns).
        """
        self._system_clock = system_clock
        self._now, self._only, self._bytes_of_name = now, only, only.encode()
        self._lock = Lock()
        #: By frame ('': all frames) and gid of the publisher.
        self._arrivals: dict[tuple[str, str], Delays] = {}
        #: By gid: the reception time of the first dynamic message of the publisher (ns).
        self._since: dict[str, int] = {}
        self._latest = 0  #: the last result of `now` (ns)
        self._set_back = 0  #: the system time (ns) at which `now` jumped back last; 0: never

    def observe(self, messages: 'Iterable[ReceivedMessage]') -> None:
        """Count the transforms of received messages."""
        with self._lock:
            now, system = self._read_clocks()
            for message in messages:
                # Decoding is slow, so messages that do not have the bytes of the name are skipped.
                if message.find(self._bytes_of_name) < 0:
                    continue
                with suppress(ValueError):  # the listener logs this error
                    self._count(message, now - system if now else None)

    def _read_clocks(self) -> tuple[int, int]:
        """Return the times of both clocks (ns); if `now` has jumped back, discard all delays."""
        now, system = self._now(), self._system_clock()
        if now < self._latest - SECOND:
            self._set_back = system
            for arrivals in self._arrivals.values():
                arrivals.clear()
        self._latest = now
        return now, system

    def _count(self, message: 'ReceivedMessage', offset: Optional[int]) -> None:
        rows = message.rows()
        if self._only:
            rows = [row for row in rows if row.child_frame_id.removeprefix('/') == self._only]
        counted = [(self._arrivals_of(frame, message.publisher), row) for row in rows
                   if (frame := row.child_frame_id.removeprefix('/')) and not is_too_long(frame)]
        all_frames = self._arrivals_of('', message.publisher)
        if message.is_static or not rows:
            return
        for arrivals in [all_frames, *(arrivals for arrivals, _ in counted)]:
            arrivals.is_dynamic = True
        since = self._since.setdefault(message.publisher, message.time)
        if len(self._since) > _MOST_PUBLISHERS:
            del self._since[next(iter(self._since))]
        if offset is None or message.time < max(since + SETTLING, self._set_back):
            return
        arrival = message.time + offset
        all_frames.add(arrival, sum(arrival - row.stamp_ns for row in rows) // len(rows))
        for arrivals, row in counted:
            arrivals.add(arrival, arrival - row.stamp_ns)

    def _arrivals_of(self, frame: str, gid: str) -> Delays:
        arrivals = self._arrivals.get((frame, gid))
        if arrivals is None:
            arrivals = Delays()
            if len(self._arrivals) < _MOST:
                self._arrivals[frame, gid] = arrivals
        return arrivals

    def by_node(self, listener: 'PublisherListener') -> list[NodeTraffic]:
        """Summarise the received transforms by frame and node; then all those of each node."""
        with self._lock:
            gids = {gid for _, gid in self._arrivals}
        names = listener.names_of(gids)
        gids_of: dict[tuple[str, str], set[str]] = {}
        with self._lock:
            now, _ = self._read_clocks()
            for frame, gid in self._arrivals:
                gids_of.setdefault((frame, names.get(gid, '')), set()).add(gid)
            rows = []
            for frame, node in sorted(gids_of, key=lambda key: (not key[0], key)):
                gids = gids_of[frame, node]
                arrivals = [self._arrivals[frame, gid] for gid in gids]
                last = max(each.last for each in arrivals)
                found = {listener.is_present(gid) for gid in gids}
                rows.append(NodeTraffic(
                    frame, node, not any(each.is_dynamic for each in arrivals),
                    True if True in found else None if None in found else False,
                    summarize(arrivals, now), in_seconds(max(0, now - last)) if last else None))
            return rows
