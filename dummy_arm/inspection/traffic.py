"""The rates and delays of received transforms, by frame and by publishing node."""

from collections import deque
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from threading import Lock
from time import time_ns
from typing import NamedTuple, Optional, TYPE_CHECKING

from dummy_arm.tf import is_too_long
from dummy_arm.tf.formatting import in_seconds, SECOND

if TYPE_CHECKING:
    from dummy_arm.tf.publisher_listener import ReceivedMessage

#: The window of the statistics: the current second of the clock, and this many seconds before it.
WINDOW = 10
#: The messages of a publisher are not counted for this time (ns) after its first message. They may
#: be late: they may have waited until the publisher had discovered the subscription.
_SETTLING = SECOND // 5
#: The largest number of pairs of a frame and a publisher for which statistics are kept.
_MOST = 100_000
#: The largest number of publishers for which the time of the first message is kept.
_MOST_PUBLISHERS = 10_000


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

    __slots__ = ('_seconds', 'last')

    def __init__(self) -> None:
        """Create the statistics, without an arrival."""
        self._seconds: deque[_Second] = deque(maxlen=WINDOW + 1)
        #: The time of the last arrival (ns); 0 if nothing has arrived.
        self.last = 0

    def add(self, arrival: int, delay: int) -> None:
        """
        Count an arrival.

        :param arrival: the time of the arrival (ns).
        :param delay: the time from the stamp to the arrival (ns).
        """
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
        """Discard all arrivals."""
        self._seconds.clear()
        self.last = 0

    def within(self, now: int) -> list[_Second]:
        """
        Return the arrivals within the window, second by second.

        :param now: the end of the window (ns).
        :returns: an item for each second that has arrivals.
        """
        return [second for second in self._seconds if second.number >= now // SECOND - WINDOW]


def summarize(delays: Collection[Delays], now: int) -> Optional[Summary]:
    """
    Compute the rate and the delays of one stream, or of several streams together.

    :param delays: the delays of each stream.
    :param now: the end of the window (ns).
    :returns: the summary; None if nothing arrived within the window.
    """
    seconds = [second for each in delays for second in each.within(now)]
    if not seconds:
        return None
    count = sum(second.count for second in seconds)
    span = max(second.last for second in seconds) - min(second.first for second in seconds)
    return Summary((count - 1) * SECOND / span if span else None,
                   in_seconds(sum(second.total for second in seconds) // count),
                   in_seconds(max(second.greatest for second in seconds)))


class Stream(NamedTuple):
    """The transforms that a node publishes, either of one frame or of all frames of the node."""

    frame: str  #: the child frame; '': all frames of the node
    node: str  #: the full name of the node
    is_static: bool  #: True if no transform was received on /tf, only on /tf_static
    #: True if the node still publishes on /tf or /tf_static; False if not; None: not known.
    is_present: Optional[bool]
    #: The rate and the delays of dynamic transforms; None if none was counted within the window.
    summary: Optional[Summary]
    #: The time since the last dynamic transform that was counted (s); None if none was counted.
    silence: Optional[float]


class _Arrivals:
    """The transforms received from a publisher, either of one frame or of all frames."""

    __slots__ = ('delays', 'is_dynamic')

    def __init__(self) -> None:
        self.delays, self.is_dynamic = Delays(), False


class Traffic:
    """Statistics of the messages that are received on /tf and /tf_static."""

    def __init__(self, now: Callable[[], int], only: str = '',
                 system_clock: Callable[[], int] = time_ns) -> None:
        """
        Create the statistics, without a message.

        :param now: a function that returns the time on the clock of the stamps (ns), or 0 if no
            /clock message has arrived.
        :param only: the only child frame that is counted; '': all frames.
        :param system_clock: a function that returns the time on the clock of the reception times
            (ns).
        """
        self._system_clock = system_clock
        self._now, self._only, self._bytes_of_name = now, only, only.encode()
        self._lock = Lock()
        #: The key is a frame and the gid of a publisher; the frame '' stands for all frames of the
        #: publisher.
        self._arrivals: dict[tuple[str, str], _Arrivals] = {}
        #: By gid: the reception time of the first dynamic message of the publisher (ns).
        self._since: dict[str, int] = {}
        #: The time that `now` returned last (ns).
        self._latest = 0
        #: The system time (ns) at which `_read_clocks` last saw that `now` had jumped back; 0:
        #: never.
        self._set_back = 0

    def observe(self, messages: 'Iterable[ReceivedMessage]') -> None:
        """
        Count the transforms of received messages.

        :param messages: the messages; those that cannot be decoded are skipped.
        """
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
                arrivals.delays.clear()
        self._latest = now
        return now, system

    def _count(self, message: 'ReceivedMessage', offset: Optional[int]) -> None:
        """
        Count the transforms of a message.

        :param offset: the time of `now` minus the time of the system clock (ns); None: not known.
        """
        rows = message.rows()
        if self._only:
            rows = [row for row in rows if row.child_frame_id.removeprefix('/') == self._only]
        streams = [(self._arrivals_of(frame, message.publisher), row) for row in rows
                   if (frame := row.child_frame_id.removeprefix('/')) and not is_too_long(frame)]
        all_frames = self._arrivals_of('', message.publisher)
        if message.is_static or not rows:
            return
        for arrivals in [all_frames, *(arrivals for arrivals, _ in streams)]:
            arrivals.is_dynamic = True
        since = self._since.setdefault(message.publisher, message.time)
        if len(self._since) > _MOST_PUBLISHERS:
            del self._since[next(iter(self._since))]
        if offset is None or message.time < max(since + _SETTLING, self._set_back):
            return
        arrival = message.time + offset
        all_frames.delays.add(arrival, sum(arrival - row.stamp_ns for row in rows) // len(rows))
        for arrivals, row in streams:
            arrivals.delays.add(arrival, arrival - row.stamp_ns)

    def _arrivals_of(self, frame: str, gid: str) -> _Arrivals:
        """Return the `_Arrivals` of a frame and a publisher; keep at most `_MOST` such objects."""
        arrivals = self._arrivals.get((frame, gid))
        if arrivals is None:
            arrivals = _Arrivals()
            if len(self._arrivals) < _MOST:
                self._arrivals[frame, gid] = arrivals
        return arrivals

    def streams(self, names_of: Callable[[Iterable[str]], dict[str, str]],
                is_present: Callable[[str], Optional[bool]]) -> list[Stream]:
        """
        Summarise the received transforms by frame and node.

        :param names_of: a function that takes gids of publishers, and returns a dict from each gid
            to the full name of the node.
        :param is_present: a function that takes the gid of a publisher, and returns whether the
            publisher still exists; None: not known.
        :returns: a stream for each pair of a frame and a node, sorted by the two names; then, for
            each node, a stream for all its frames.
        """
        with self._lock:
            gids = {gid for _, gid in self._arrivals}
        names = names_of(gids)
        gids_of: dict[tuple[str, str], list[str]] = {}
        with self._lock:
            now, _ = self._read_clocks()
            for frame, gid in self._arrivals:
                gids_of.setdefault((frame, names.get(gid, '')), []).append(gid)
            return [self._stream(*key, gids_of[key], is_present, now) for key in sorted(
                gids_of, key=lambda key: (not key[0], key))]

    def _stream(self, frame: str, node: str, gids: list[str],
                is_present: Callable[[str], Optional[bool]], now: int) -> Stream:
        all_arrivals = [self._arrivals[frame, gid] for gid in gids]
        delays = [arrivals.delays for arrivals in all_arrivals]
        last = max(each.last for each in delays)
        found = {is_present(gid) for gid in gids}
        return Stream(frame, node, not any(arrivals.is_dynamic for arrivals in all_arrivals),
                      True if True in found else None if None in found else False,
                      summarize(delays, now),
                      in_seconds(max(0, now - last)) if last else None)
