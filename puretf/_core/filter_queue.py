"""
The queue of a MessageFilter: which messages wait, are ready, or are dropped, and why.

A message waits until its transforms are available; then it is *due*, and the filter passes it on.
A dropped message is due, too, with the reason: `put` drops messages without a frame, `put` and
`ready` drop those that are older than the cache, `expire` drops those that have waited for too
long, and `shorten` drops those that have waited longest while too many wait.
"""

from bisect import insort
from collections.abc import Callable, Iterator, Sequence
from enum import IntEnum
from itertools import count
from time import monotonic_ns
from typing import Any, NamedTuple, Optional

from puretf._core.buffer_base import BufferBase
from puretf._core.engine import engine_of


class FilterFailureReason(IntEnum):
    """The reason why a MessageFilter has dropped a message; the names are those of tf2 in C++."""

    #: The transforms were available, but not any more when the callbacks were due.
    Unknown = 0
    #: The transforms will never be available: the message is older than the cache of the buffer.
    OutTheBack = 1
    #: The frame id of the message is empty.
    EmptyFrameID = 2
    #: The timeout of the message was over before its transforms were available.
    NoTransformFound = 3
    #: The queue was full, and this message was the oldest in it.
    QueueFull = 4


class Entry(NamedTuple):
    """A message in a filter."""

    stamp: int  #: ns
    number: int  #: counts the messages in the order of their arrival
    frame: str
    message: Any
    arrival: int  #: ns, on the monotonic clock
    #: Why the message was dropped: a FilterFailureReason; None: it is passed on.
    reason: Any = None


class FilterQueue:
    """The messages that wait for transforms of a buffer, whose lock guards them."""

    def __init__(self, buffer: BufferBase[Any, Any, Any], targets: Sequence[str],
                 tolerance: int = 0, size: int = 0, clock: Callable[[], int] = monotonic_ns
                 ) -> None:
        """
        Create an empty queue; call `restart` after a change of `targets`, `tolerance` or `size`.

        :param targets: the frames that a message needs; without any, no message is ready.
        :param tolerance: a message needs them at its stamp, and at its stamp plus this time (ns).
        :param size: the largest number of messages that wait; 0: any number.
        """
        self._buffer, self._engine, self._clock = buffer, engine_of(buffer), clock
        self.targets, self.tolerance, self.size = targets, tolerance, size
        #: The messages that wait, by their numbers; the one that has waited longest first.
        self.waiting: dict[int, Entry] = {}
        #: The messages that are taken next, in the order of their stamps.
        self.due: list[Entry] = []
        #: How many messages were dropped for each reason.
        self.dropped = dict.fromkeys(FilterFailureReason, 0)
        self._count = count()
        #: The generation of the data when all messages were looked up; -1: never.
        self._generation = -1

    def put(self, stamp: int, frame: str, message: Any) -> tuple[Entry, Optional[Entry]]:
        """Add a message, look it up, and return it and the message that has waited longest."""
        with self._buffer.updated():
            new = Entry(stamp, next(self._count), frame.removeprefix('/'), message, self._clock())
            self.waiting[new.number] = new
            if not new.frame:
                self._make_due(new._replace(reason=FilterFailureReason.EmptyFrameID))
            self.ready(new)
            return new, self._oldest()

    def ready(self, *new: Entry) -> None:
        """
        Make the messages due whose transforms are available, and those that are too old.

        New messages are looked up in any case. All messages are, if the data or the settings have
        changed, so that messages that become ready together are taken in the order of stamps.
        """
        with self._buffer.updated():
            is_new = self._generation != self._engine.generation
            for entry in self._decided([*self.waiting.values()] if is_new else new):
                self._make_due(entry)
            self._generation = self._engine.generation

    def expire(self, timeout: int) -> int:
        """Drop messages that have waited for `timeout` (ns); return the rest of the next one's."""
        with self._engine.lock:
            begin = self._clock() - timeout
            while (oldest := self._oldest()) and oldest.arrival <= begin:
                self._make_due(oldest._replace(reason=FilterFailureReason.NoTransformFound))
            return oldest.arrival - begin if oldest else 0

    def shorten(self) -> None:
        """Drop the messages that have waited longest while more wait than the size allows."""
        with self._engine.lock:
            while 0 < self.size < len(self.waiting) and (oldest := self._oldest()):
                self._make_due(oldest._replace(reason=FilterFailureReason.QueueFull))

    def restart(self) -> None:
        """Look up all messages again, also those that were ready, with the new settings."""
        with self._buffer.updated():
            again = {entry.number: entry for entry in self.due if entry.reason is None}
            self.due = [entry for entry in self.due if entry.reason is not None]
            self.waiting = dict(sorted({**self.waiting, **again}.items()))
            self._generation = -1
            self.ready()

    def take(self) -> Optional[Entry]:
        """Remove and return the next message that is due; drop it if its transforms are lost."""
        with self._buffer.updated():
            entry = self.due.pop(0) if self.due else None
            if entry and entry.reason is None and entry not in self._decided([entry]):
                self.dropped[FilterFailureReason.Unknown] += 1
                return entry._replace(reason=FilterFailureReason.Unknown)
            return entry

    def clear(self) -> None:
        with self._engine.lock:
            self.waiting, self.due = {}, []

    def _decided(self, entries: Sequence[Entry]) -> Iterator[Entry]:
        """Yield the messages that are ready and, with the reason, those that are too old."""
        for frame in {entry.frame for entry in entries}:  # one lookup for all messages of a frame
            group = [entry for entry in entries if entry.frame == frame]
            with self._engine.reading():
                answers = [(shift, *self._engine.lookups.available(
                    target, frame, [entry.stamp + shift for entry in group]))
                    for target in self.targets for shift in {0, self.tolerance}]
            for i, entry in enumerate(group):
                if answers and all(available[i] for _, available, _ in answers):
                    yield entry
                elif any(not available[i] and 0 != entry.stamp + shift < earliest
                         for shift, available, earliest in answers):
                    yield entry._replace(reason=FilterFailureReason.OutTheBack)

    def _oldest(self) -> Optional[Entry]:
        return next(iter(self.waiting.values()), None)

    def _make_due(self, entry: Entry) -> None:
        if self.waiting.pop(entry.number, None) is not None:
            insort(self.due, entry)
            if entry.reason is not None:
                self.dropped[entry.reason] += 1
