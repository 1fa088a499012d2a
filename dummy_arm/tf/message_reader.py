"""The bytes of messages to what a buffer takes; what repeats in a stream is worked out once."""

from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any, Optional, Protocol, Union

from dummy_arm.tf import wire
from dummy_arm.tf.refusals import is_too_long
from dummy_arm.tf.times import SECOND
from dummy_arm.tf.wire import Layout, MalformedMessage, Row

#: The layouts that are kept are those of messages of at most so many bytes, added up.
_MOST_BYTES = 10_000_000
#: A run ends with so many transforms: longer arrays would not stay in the caches.
_LONG = 1000

#: The length of a message, and what its form has for a key.
_Key = tuple[int, bytes]


class Form(Protocol):
    """What bytes mean: the module `wire` or `wire_ros1`."""

    @property
    def Layout(self) -> type[wire.Layout]:  # noqa: N802
        """Where the fields lie of messages whose frames are known."""

    def unpack(self, data: bytes) -> list[Row]:
        """Unpack the bytes of a message into transforms."""

    def rows(self, data: bytes) -> Iterator[Row]:
        """Unpack the bytes of a message, one transform after the other."""

    def key(self, data: bytes) -> bytes:
        """Tell what a message is found again by."""


class Edges:
    """
    The frames of a stream, without a leading slash; and where an Intake has found them.

    That is by weak references: a stream may never come again.
    """

    __slots__ = ('children', 'common', 'found', 'found_in', 'layout', 'names', 'parents', 'parted')

    def __init__(self, layout: Layout, edges: Sequence[tuple[str, str]]) -> None:
        """
        Keep what is given.

        :param edges: frame_id and child_frame_id of each of the n transforms, as on the wire.
        """
        self.layout = layout
        self.parents = [parent.removeprefix('/') for parent, _ in edges]
        self.children = [child.removeprefix('/') for _, child in edges]
        self.names = frozenset(self.children)
        self.found: list[Callable[[], Any]] = []
        self.common: Callable[[], Any] = nothing
        self.found_in: object = None
        #: The stamp (ns) at which they were seen not to have their samples in common.
        self.parted: Optional[int] = None


class Run:
    """Messages with the same frames, each with one stamp, in the order of their arrival."""

    __slots__ = ('edges', 'poses', 'stamps')

    def __init__(self, edges: Edges) -> None:
        """
        Begin without a message.

        :param edges: of n transforms.
        """
        self.edges = edges
        #: Of each of the m messages (ns), larger than the one before.
        self.stamps = array('q')
        #: m x n times 7 float64: x, y, z (m) and the rotation's x, y, z, w.
        self.poses: list[bytes] = []


class MessageReader:
    """Reads messages, and remembers the layouts of those whose frames repeat."""

    def __init__(self, on_malformed: Callable[[MalformedMessage], object], form: Form = wire
                 ) -> None:
        """
        Begin with no layout.

        :param on_malformed: is called with the error of each message that is none.
        :param form: how messages are written.
        """
        self._on_malformed, self._form = on_malformed, form
        self._known: dict[_Key, Edges] = {}
        self._size = 0  # of the messages (bytes)

    def read(self, messages: Iterable[bytes], only_rows: bool = False
             ) -> list[Union[list[Row], Run]]:
        """
        Read messages.

        :param only_rows: gather none of them into runs.
        :returns: the transforms of a message whose layout was not known or that has several
            stamps, as rows; those of others, in runs. What is of one child is in the order of
            its arrival.
        """
        pieces: list[Union[list[Row], Run]] = []
        runs: dict[Edges, Run] = {}
        for data in messages:
            try:
                rows = self._form.unpack(data) if only_rows else self._read(data, runs, pieces)
                if rows is not None:
                    pieces += runs.values()
                    runs.clear()
                    pieces.append(rows)
            except MalformedMessage as error:
                self._on_malformed(error)
        return [*pieces, *runs.values()]

    def _read(self, data: bytes, runs: dict[Edges, Run], pieces: list[Union[list[Row], Run]]
              ) -> Optional[list[Row]]:
        """
        Append a message to a run, if its layout is known and it has one stamp.

        Runs that have a frame in common with one that begins go to the pieces before it.

        :returns: the rows of another message.
        """
        key = len(data), self._form.key(data)
        edges = self._known.get(key)
        if edges is None or (fields := edges.layout.read(data)) is None:
            rows = self._form.unpack(data)
            self._learn(key, data, rows)
            return rows
        stamps, poses = fields
        if stamps.count(stamps[0]) < len(stamps):
            return self._form.unpack(data)
        sec, nanosec = edges.layout.unpack_stamp(stamps[0])
        stamp = sec * SECOND + nanosec
        run = runs.get(edges)
        if run is not None and (stamp <= run.stamps[-1] or len(run.poses) >= _LONG):
            pieces.append(runs.pop(edges))
            run = None
        if run is None:
            if runs:
                pieces += [runs.pop(other) for other in list(runs)
                           if not edges.names.isdisjoint(other.names)]
            runs[edges] = run = Run(edges)
        run.stamps.append(stamp)
        run.poses += poses
        return None

    def _learn(self, key: _Key, data: bytes, rows: list[Row]) -> None:
        """Keep the layout of a message."""
        pairs = [row[2:4] for row in rows]
        if not pairs or any(map(is_too_long, chain(*pairs))):  # the latter are refused
            return
        layout = self._form.Layout(pairs)
        edges = Edges(layout, pairs)
        # A frame twice in a message would not keep its order in a run.
        if (layout.size <= len(data) and layout.read(data) is not None
                and len(edges.names) == len(pairs)):
            if self._size > _MOST_BYTES:
                self._known.clear()
                self._size = 0
            if key not in self._known:
                self._size += len(data)
            self._known[key] = edges


def nothing() -> None:
    """Refer to nothing, in place of a weak reference."""
