"""Counts of received transforms: how many, how often and how late, by frame and by publisher."""

from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple, Optional, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from puretf import Frame, in_seconds, SECOND
from puretf._text.names import is_too_long
from puretf.transform_table import Message, transform_tables, TransformTable
from puretf_tools.inspection.stamp_clock import StampClock

if TYPE_CHECKING:
    from puretf.publisher_listener import PublisherListener

#: The window of `Traffic`: the current second of the clock, and this many seconds before it.
WINDOW = 10
#: The messages of a publisher have no delay for this time (ns) after its first message: they may
#: have waited until the publisher had discovered the subscription.
SETTLING = SECOND // 5
#: Times of arrival (ns) are limited to this, so that no difference from a stamp exceeds int64.
LATEST = 2**63 - 1 - 2**31 * SECOND
#: The largest number of streams that are counted, and of arrays of each that are kept.
_MOST_STREAMS, _MOST_TABLES = 100_000, 1000
#: A program has fewer broadcasters than this without a frame of their own, unless it creates them
#: again and again.
_MANY, _MANY_SILENT = 6, 20
_Array = NDArray[np.int64]


def rate(count: int, first: int, last: int) -> Optional[float]:
    """Return the average rate (Hz) of events between two times (ns); None if these are equal."""
    return (count - 1) * SECOND / (last - first) if last > first else None


def rate_of(frame: Frame) -> Optional[float]:
    """Return the average rate of the samples of a frame (Hz), by their stamps."""
    return rate(frame.length, frame.oldest, frame.latest)


def rate_text(frame: Frame) -> str:
    if frame.is_static:
        return 'static'
    hertz = rate_of(frame)
    return '? Hz' if hertz is None else f'{hertz:.1f} Hz'


def recreated(publishers: Mapping[str, Collection[str]]) -> list[str]:
    """
    Return the publishers that a node creates one after another, as in the callback of a timer.

    :param publishers: by publisher of one node on one topic: the frames that it has sent.
    :returns: the publishers that have no frame of their own, if there are at least 6; if none of
        them has sent anything, at least 20.
    """
    counts = Counter(frame for frames in publishers.values() for frame in frames)
    found = [publisher for publisher, frames in publishers.items()
             if all(counts[frame] > 1 for frame in frames)]
    return found if len(found) >= (_MANY if counts else _MANY_SILENT) else []


class Summary(NamedTuple):
    """The rate and the delays of the transforms that arrived within the window."""

    rate: Optional[float]  #: Hz; None if all transforms arrived at the same time
    average_delay: float  #: s
    maximum_delay: float  #: s


class NodeTraffic(NamedTuple):
    """The transforms that a node publishes, either of one frame or of all frames of the node."""

    frame: str  #: the child frame; '': all frames of the node
    node: str  #: the full name of the node
    is_static: bool  #: True if no transform was received on /tf, only on /tf_static
    is_present: Optional[bool]  #: True if the node still publishes; None: not known
    summary: Optional[Summary]  #: None if no dynamic transform was counted within the window
    silence: Optional[float]  #: s since the last one; None if none was counted
    senders: int  #: the number of publishers of the node that exist, and send the frame


class Traffic:
    """The messages that were received within the window."""

    def __init__(self, clock: StampClock) -> None:
        """Count nothing yet; `clock`: that of the stamps."""
        self._clock = clock
        #: By publisher: the time of arrival of the first dynamic message (ns).
        self._since: dict[str, int] = {}
        #: By frame, publisher and topic (True: static): when it has arrived last (ns); 0: at no
        #: known time.
        self._last: dict[tuple[str, str, bool], int] = {}
        #: By publisher, and the frames of a message, '' for all of it: of n messages at once, the
        #: times of arrival (n,) and the delays (n, number of frames), in ns.
        self._window: dict[tuple[str, tuple[str, ...]], deque[tuple[_Array, _Array]]] = {}
        self._latest = 0  #: the last time on this clock (ns)
        self._set_back = 0  #: the system time (ns) at which it jumped back last; 0: never

    def observe(self, messages: Iterable[Message]) -> None:
        """Count the transforms of received messages; the listener logs malformed ones."""
        self._read_clock()
        begin = max(self._set_back, self._clock.system() - WINDOW * SECOND)
        for table in transform_tables(
                each for each in messages if each.is_static or each.time >= begin):
            names = [child.removeprefix('/') for _, child in table.edges]
            kept = [i for i, name in enumerate(names) if name and not is_too_long(name)]
            if names:
                self._add(table, (*(names[i] for i in kept), ''), kept)

    def _add(self, table: TransformTable, frames: tuple[str, ...], kept: list[int]) -> None:
        last, arrivals = 0, table.times.clip(-LATEST, LATEST)
        if not table.is_static:
            since = self._since.setdefault(table.publisher, int(arrivals.min()))
            is_settled = arrivals >= since + SETTLING
            times, stamps = self._clock.at(arrivals[is_settled]), table.stamps[is_settled].T
            if times is not None and len(times):
                mean = stamps[0] + np.rint((stamps - stamps[0]).mean(axis=0)).astype(np.int64)
                delays = times - np.vstack([stamps[kept], mean])
                self._window.setdefault((table.publisher, frames), deque(
                    maxlen=_MOST_TABLES)).append((times, delays.T))
                last = int(times.max())
        for frame in frames:
            key = frame, table.publisher, table.is_static
            if key in self._last or len(self._last) < _MOST_STREAMS:
                self._last[key] = last or self._last.get(key, 0)

    def _read_clock(self) -> int:
        """Return the time on the clock (ns); if it has jumped back, discard all delays."""
        now = self._clock.now()
        if now < self._latest - SECOND:
            self._set_back = self._clock.system()
            self._window.clear()
            self._last = dict.fromkeys(self._last, 0)
        self._latest = now
        for key, tables in [*self._window.items()]:
            while tables and tables[0][0][-1] <= now - WINDOW * SECOND:
                tables.popleft()
            if not tables:
                del self._window[key]
        return now

    def by_node(self, listener: 'PublisherListener', frame: Optional[str] = None
                ) -> list[NodeTraffic]:
        """Summarise by frame and node, then all of each node; or only one frame by node."""
        now = self._read_clock()
        keys = [key for key in self._last if frame in (None, key[0])]
        names = listener.names_of({gid for _, gid, _ in keys})
        groups: dict[tuple[bool, str, str], list[tuple[str, str, bool]]] = {}
        for key in keys:
            groups.setdefault((not key[0], key[0], names[key[1]]), []).append(key)
        #: By frame and node: the times of arrival, and the delays (ns).
        found: dict[tuple[str, str], list[tuple[_Array, _Array]]] = {}
        for (publisher, frames), tables in self._window.items():
            if wanted := [i for i, name in enumerate(frames) if frame in (None, name)]:
                times = np.concatenate([each for each, _ in tables])
                delays = np.concatenate([each[:, wanted] for _, each in tables])
                for i, column in zip(wanted, delays.T):
                    found.setdefault((frames[i], names.get(publisher, '')), []).append(
                        (times, column))
        rows, begin = [], max(0, now - WINDOW * SECOND)
        for (_, child, node), group in sorted(groups.items()):
            last = max(map(self._last.__getitem__, group))
            present = [listener.is_present(gid) for _, gid, _ in group]
            recent = [is_static or self._last[frame, gid, is_static] > begin
                      for frame, gid, is_static in group]
            rows.append(NodeTraffic(
                child, node, all(is_static for *_, is_static in group),
                True if True in present else None if None in present else False,
                _summary(found.get((child, node), ())),
                in_seconds(max(0, now - last)) if last else None,
                [*zip(present, recent)].count((True, True))))
        return rows


def _summary(found: Sequence[tuple[_Array, _Array]]) -> Optional[Summary]:
    if not found:
        return None
    times, delays = map(np.concatenate, zip(*found))
    return Summary(rate(len(times), int(times.min()), int(times.max())),
                   in_seconds(round(delays.mean())), in_seconds(int(delays.max())))
