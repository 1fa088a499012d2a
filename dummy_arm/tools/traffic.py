"""How often and how late transforms come in: by frame, and by sender."""

from collections import deque
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from threading import Lock
from time import time_ns
from typing import NamedTuple, Optional

from dummy_arm.tf.senders import Sent
from dummy_arm.tf.times import in_seconds, SECOND
from dummy_arm.tf.wire import MalformedMessage, unpack

#: What is older is not counted (s).
WINDOW = 10
#: So many streams are told apart at most.
_MOST = 100_000


class Summary(NamedTuple):
    """What came in within the window."""

    rate: Optional[float]  #: Hz; None: of less than two
    average_delay: float  #: s
    maximum_delay: float  #: s


class _Second:
    """The arrivals of a second; times in ns."""

    __slots__ = ('count', 'first', 'greatest', 'last', 'number', 'total')

    def __init__(self, number: int, arrival: int, delay: int) -> None:
        self.number, self.count = number, 1
        self.first = self.last = arrival
        self.greatest = self.total = delay


class Delays:
    """The delays of what comes in, over the window."""

    __slots__ = ('_seconds', 'last')

    def __init__(self) -> None:
        """Begin with none."""
        self._seconds: deque[_Second] = deque(maxlen=WINDOW + 1)
        #: When something came in last (ns).
        self.last = 0

    def add(self, arrival: int, delay: Optional[int]) -> None:
        """
        Count an arrival.

        :param arrival: when (ns).
        :param delay: ns; None: do not count it, except as the last.
        """
        number = arrival // SECOND
        seconds = self._seconds
        if arrival < self.last - SECOND:
            seconds.clear()  # time has gone back
        self.last = arrival
        if delay is None:
            return
        if not seconds or seconds[-1].number != number:
            seconds.append(_Second(number, arrival, delay))
            return
        second = seconds[-1]
        second.count += 1
        second.last = arrival
        second.total += delay
        if delay > second.greatest:
            second.greatest = delay

    def within(self, now: int) -> list[_Second]:
        """List the seconds of the window before a time (ns)."""
        return [second for second in self._seconds if second.number >= now // SECOND - WINDOW]


def summed_up(delays: Collection[Delays], now: int) -> Optional[Summary]:
    """
    Sum up the delays of one stream, or of several together.

    :param now: where the window ends (ns).
    :returns: None: nothing came in.
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
    """What a node sends, of a frame or of all."""

    frame: str  #: '' where it is of all
    sender: str  #: the name of the node
    is_static: bool  #: nothing of it moves
    is_present: bool  #: the node is there still
    summary: Optional[Summary]  #: None: nothing that moves came in within the window
    silence: float  #: how long nothing that moves has come in (s)


class Traffic:
    """All that comes in on /tf and /tf_static."""

    def __init__(self, now: Callable[[], int]) -> None:
        """
        Begin to observe.

        :param now: the clock that stamps count by (ns).
        """
        self._now = now
        self._lock = Lock()
        #: By frame and gid of the publisher; the frame '' stands for all that it sends.
        self._delays: dict[tuple[str, str], Delays] = {}
        #: When the first of a publisher came in (ns).
        self._since: dict[str, int] = {}

    def observe(self, messages: Iterable[Sent], is_static: bool) -> None:
        """Count messages; as SenderListener has it."""
        now = self._now()
        offset = now - time_ns()  # from the clock of the middleware to that of the stamps
        with self._lock:
            for message in messages:
                with suppress(MalformedMessage):  # the listener tells of it
                    self._count(message, None if is_static or not now else offset)

    def _count(self, message: Sent, offset: Optional[int]) -> None:
        """
        Count a message.

        :param offset: from its times to those of the stamps (ns); None: count only that it is
            there.
        """
        rows = unpack(message)
        streams = [self._stream(row[3].removeprefix('/'), message.gid) for row in rows]
        everything = self._stream('', message.gid)
        if offset is None or not rows:
            return
        arrival = message.received + offset
        delays = [arrival - row[0] * SECOND - row[1] for row in rows]
        # What was sent before the first came in had to wait until its sender was discovered.
        counts = message.sent >= self._since.setdefault(message.gid, message.received)
        for stream, delay in zip([everything, *streams], [sum(delays) // len(rows), *delays]):
            stream.add(arrival, delay if counts else None)

    def _stream(self, frame: str, gid: str) -> Delays:
        known = self._delays.get((frame, gid))
        if known is None:
            known = Delays()
            if len(self._delays) < _MOST:
                self._delays[frame, gid] = known
        return known

    def streams(self, names_of: Callable[[Iterable[str]], dict[str, str]],
                present: Collection[str]) -> list[Stream]:
        """
        Sum up what came in.

        :param names_of: tells the names of nodes by the gids of their publishers.
        :param present: the gids of the publishers that there are still.
        :returns: of each frame and node, in the order of their names; then of each node.
        """
        with self._lock:
            gids = {gid for _, gid in self._delays}
        names, now = names_of(gids), self._now()
        together: dict[tuple[str, str], list[str]] = {}
        with self._lock:
            for frame, gid in self._delays:
                together.setdefault((frame, names.get(gid, '')), []).append(gid)
            return [self._stream_of(*key, together[key], present, now) for key in sorted(
                together, key=lambda key: (not key[0], key))]

    def _stream_of(self, frame: str, sender: str, gids: list[str], present: Collection[str],
                   now: int) -> Stream:
        delays = [self._delays[frame, gid] for gid in gids]
        last = max(each.last for each in delays)
        return Stream(frame, sender, not last, any(gid in present for gid in gids),
                      summed_up(delays, now), in_seconds(now - last))
