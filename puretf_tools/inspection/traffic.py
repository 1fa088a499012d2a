"""Counts of received transforms: how many, how often and how late, by frame and by publisher."""

from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple, Optional, TYPE_CHECKING

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
#: What `Traffic` knows of the delays of a track: the times from the stamps to the arrivals (ns).
_FIELDS: Any = [
    ('delays', 'i8'), ('total_delay', 'f8'),  # their number and their sum
    ('greatest_delay', 'i8'),
    ('first', 'i8'), ('last', 'i8')]  # when the first and the last of these transforms arrived
_EXTREMES = {'greatest_delay': np.maximum, 'first': np.minimum, 'last': np.maximum}
#: A program has fewer broadcasters than this without a frame of their own, unless it creates them
#: again and again.
_MANY, _MANY_SILENT = 6, 20


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


class Counts:
    """
    Counts transforms by track: those of one child from one publisher on one topic.

    The counts of a track are a row of an array, whose fields are those of a subclass.
    """

    fields: np.dtype[np.void]
    most_tracks = 100_000

    def __init__(self) -> None:
        #: By child, publisher and topic (True: static): the number of the track.
        self._numbers: dict[tuple[str, str, bool], int] = {}
        self._values: Any = np.zeros(16, self.fields)  #: by the number of the track
        #: The number of counted transforms, and of those left out as there are too many tracks.
        self.count = self.not_counted = 0

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

    def _number(self, table: TransformTable, parent: str, child: str) -> Optional[int]:
        """Return the number of the track of an edge; None if the edge is not counted."""
        key = child.removeprefix('/'), table.publisher, table.is_static
        if key not in self._numbers:
            if len(self._numbers) >= self.most_tracks:
                self.not_counted += len(table.times)
                return None
            if len(self._numbers) == len(self._values):
                self._values = np.concatenate([self._values, np.zeros_like(self._values)])
            self._numbers[key] = len(self._numbers)
        return self._numbers[key]

    def _count(self, values: Any, numbers: NDArray[np.intp], table: TransformTable) -> None:
        """Change the values (n,) of the tracks with some numbers by n transforms each message."""
        raise NotImplementedError


def _merge(values: Any, new: Any) -> None:
    has_new, is_first = new['delays'] > 0, values['delays'] == 0
    for field, extreme in _EXTREMES.items():
        values[field] = np.where(has_new, np.where(
            is_first, new[field], extreme(values[field], new[field])), values[field])
    for field in 'delays', 'total_delay':
        values[field] += new[field]


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


class Traffic(Counts):
    """The messages that were received within the window; the child '' is all of a message."""

    fields = np.dtype(_FIELDS)

    def __init__(self, clock: StampClock) -> None:
        """Count nothing yet; `clock`: that of the stamps."""
        super().__init__()
        self._clock = clock
        #: By publisher: the time of arrival of the first dynamic message (ns).
        self._since: dict[str, int] = {}
        self._seconds: deque[Any] = deque(maxlen=WINDOW)  #: the values of each second before
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
                first, *_ = stamps = table.stamps.T
                mean = first + np.rint((stamps - first).mean(axis=0)).astype(np.int64)
                stamps = np.column_stack([table.stamps[:, kept], mean])
                # A stamp 0 is as late as any other, as for tf2.
                self.add(table._replace(
                    edges=[*(table.edges[i] for i in kept), ('', '')],
                    stamps=np.where(stamps == 0, 1, stamps), poses=np.empty((*stamps.shape, 0))))

    def _count(self, values: Any, numbers: NDArray[np.intp], table: TransformTable) -> None:
        if table.is_static:
            return
        since = self._since.setdefault(table.publisher, int(table.times.min()))
        is_settled = table.times >= since + SETTLING
        times = self._clock.at(table.times[is_settled])
        if times is not None and len(times):
            new, delays = np.zeros_like(values), times[:, None] - table.stamps[is_settled]
            new['delays'] = len(times)
            new['total_delay'] = delays.sum(axis=0, dtype=np.float64)
            new['greatest_delay'] = delays.max(axis=0)
            new['first'], new['last'] = times.min(), times.max()
            _merge(values, new)

    def _read_clock(self) -> int:
        """Return the time on the clock (ns); if it has jumped back, discard all delays."""
        now = self._clock.now()
        if now < self._latest - SECOND:
            self._set_back = self._clock.system()
            self._seconds.clear()
            self._values = np.zeros_like(self._values)
        for _ in range(min(now // SECOND - self._latest // SECOND, WINDOW + 1)):
            self._seconds.append(self._values)
            self._values = np.zeros_like(self._values)
            self._values['last'] = self._seconds[-1]['last']
        self._latest = now
        return now

    def by_node(self, listener: 'PublisherListener', frame: Optional[str] = None
                ) -> list[NodeTraffic]:
        """Summarise by frame and node, then all of each node; or only one frame by node."""
        now = self._read_clock()
        keys = [key for key in self._numbers if frame in (None, key[0])]
        names = listener.names_of({gid for _, gid, _ in keys})
        groups: dict[tuple[bool, str, str], list[tuple[str, str, bool]]] = {}
        for key in keys:
            groups.setdefault((not key[0], key[0], names[key[1]]), []).append(key)
        window = self._values.copy()
        for values in self._seconds:
            _merge(window[:len(values)], values)
        rows = []
        for (_, child, node), group in sorted(groups.items()):
            found = window[[self._numbers[key] for key in group]]
            last = int(found['last'].max())
            present = {listener.is_present(gid) for _, gid, _ in group}
            rows.append(NodeTraffic(
                child, node, all(is_static for *_, is_static in group),
                True if True in present else None if None in present else False,
                _summary(found[found['delays'] > 0]),
                in_seconds(max(0, now - last)) if last else None))
        return rows


def _summary(values: Any) -> Optional[Summary]:
    if not len(values):
        return None
    count = int(values['delays'].sum())
    return Summary(rate(count, int(values['first'].min()), int(values['last'].max())),
                   in_seconds(int(values['total_delay'].sum() // count)),
                   in_seconds(int(values['greatest_delay'].max())))
