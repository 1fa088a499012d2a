"""How often and how late transforms come in: by frame, and by node."""

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

#: What is older is not counted (s).
WINDOW = 10
#: Arrivals so soon after the first of a publisher are not counted (ns).
_SETTLING = SECOND // 5
#: So many streams are told apart at most.
_MOST = 100_000
#: Of so many publishers it is known when the first message came in.
_MOST_PUBLISHERS = 10_000


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

    def add(self, arrival: int, delay: int) -> None:
        """Count an arrival; times in ns."""
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
        """Forget all."""
        self._seconds.clear()
        self.last = 0

    def within(self, now: int) -> list[_Second]:
        """List the seconds of the window before a time (ns)."""
        return [second for second in self._seconds if second.number >= now // SECOND - WINDOW]


def summarize(delays: Collection[Delays], now: int) -> Optional[Summary]:
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
    node: str  #: the name of the node
    is_static: bool  #: nothing of it moves
    is_present: bool  #: the node is there still
    summary: Optional[Summary]  #: None: nothing that moves came in within the window
    silence: Optional[float]  #: how long nothing that moves has come in (s); None: ever


class _Heard:
    """What came in of a frame from a publisher."""

    __slots__ = ('delays', 'moves')

    def __init__(self) -> None:
        self.delays, self.moves = Delays(), False


class Traffic:
    """All that comes in on /tf and /tf_static."""

    def __init__(self, now: Callable[[], int], only: str = '',
                 system_clock: Callable[[], int] = time_ns) -> None:
        """
        Begin to observe.

        :param now: the clock that stamps count by (ns); 0: it does not run.
        :param only: the frame that is observed; '': all.
        :param system_clock: the clock that receptions count by (ns).
        """
        self._system_clock = system_clock
        self._now, self._only, self._bytes_of_name = now, only, only.encode()
        self._lock = Lock()
        #: By frame and gid of the publisher; the frame '' stands for all that it sends.
        self._heard: dict[tuple[str, str], _Heard] = {}
        #: When the first of a publisher came in, on the system's clock (ns).
        self._since: dict[str, int] = {}
        #: The time at the last look, and when on the system's clock it was last set back (ns).
        self._latest = self._set_back = 0

    def observe(self, messages: 'Iterable[ReceivedMessage]') -> None:
        """Count messages that have arrived."""
        with self._lock:
            now, system = self._look()
            for message in messages:
                if message.find(self._bytes_of_name) < 0:
                    continue
                with suppress(ValueError):  # the listener tells of it
                    self._count(message, now - system if now else None)

    def _look(self) -> tuple[int, int]:
        """Tell the time and that of the system (ns); forget all when time has gone back."""
        now, system = self._now(), self._system_clock()
        if now < self._latest - SECOND:
            self._set_back = system
            for heard in self._heard.values():
                heard.delays.clear()
        self._latest = now
        return now, system

    def _count(self, message: 'ReceivedMessage', offset: Optional[int]) -> None:
        """
        Count a message.

        :param offset: from its times to those of the stamps (ns); None: that is not known.
        """
        rows = message.rows()
        if self._only:
            rows = [row for row in rows if row.child_frame_id.removeprefix('/') == self._only]
        streams = [(self._of(frame, message.gid), row) for row in rows
                   if (frame := row.child_frame_id.removeprefix('/')) and not is_too_long(frame)]
        everything = self._of('', message.gid)
        if message.is_static or not rows:
            return
        for heard in [everything, *(heard for heard, _ in streams)]:
            heard.moves = True
        # The first had to wait until their node was discovered.
        since = self._since.setdefault(message.gid, message.reception_time)
        if len(self._since) > _MOST_PUBLISHERS:
            del self._since[next(iter(self._since))]
        if offset is None or message.reception_time < max(since + _SETTLING, self._set_back):
            return
        arrival = message.reception_time + offset
        everything.delays.add(arrival, sum(arrival - row.stamp_ns for row in rows) // len(rows))
        for heard, row in streams:
            heard.delays.add(arrival, arrival - row.stamp_ns)

    def _of(self, frame: str, gid: str) -> _Heard:
        known = self._heard.get((frame, gid))
        if known is None:
            known = _Heard()
            if len(self._heard) < _MOST:
                self._heard[frame, gid] = known
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
            gids = {gid for _, gid in self._heard}
        names = names_of(gids)
        together: dict[tuple[str, str], list[str]] = {}
        with self._lock:
            now, _ = self._look()
            for frame, gid in self._heard:
                together.setdefault((frame, names.get(gid, '')), []).append(gid)
            return [self._stream(*key, together[key], present, now) for key in sorted(
                together, key=lambda key: (not key[0], key))]

    def _stream(self, frame: str, node: str, gids: list[str], present: Collection[str], now: int
                ) -> Stream:
        all_heard = [self._heard[frame, gid] for gid in gids]
        delays = [heard.delays for heard in all_heard]
        last = max(each.last for each in delays)
        return Stream(frame, node, not any(heard.moves for heard in all_heard),
                      any(gid in present for gid in gids), summarize(delays, now),
                      in_seconds(max(0, now - last)) if last else None)
