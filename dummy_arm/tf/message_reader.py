"""The bytes of messages to what a buffer takes; what repeats in a stream is worked out once."""

from array import array
from collections.abc import Callable, Iterable, Sequence
import struct
from typing import Any, Optional, Union

from dummy_arm.tf.times import SECOND
from dummy_arm.tf.wire import Layout, MalformedMessage, Row, unpack

#: So many edges may lie in the layouts that are kept, all together.
_MOST_EDGES = 100_000
#: A run ends with so many transforms: longer arrays would not stay in the caches.
_LONG = 1000
_LITTLE_ENDIAN = b'\x00\x01'
_FIRST_NAME = 16
_unpack_stamp = struct.Struct('<iI').unpack

#: The length of a message and its first two names.
_Key = tuple[int, bytes, bytes]


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

    def __init__(self, on_malformed: Callable[[MalformedMessage], object]) -> None:
        """
        Begin with no layout.

        :param on_malformed: is called with the error of each message that is none.
        """
        self._on_malformed = on_malformed
        self._known: dict[_Key, Edges] = {}
        self._count = 0  # of the edges in them

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
                rows = unpack(data) if only_rows else self._read(data, runs, pieces)
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
        key = _key(data)
        edges = self._known.get(key)
        if edges is None or (fields := edges.layout.read(data)) is None:
            rows = unpack(data)
            self._learn(key, data, rows)
            return rows
        stamps, poses = fields
        if stamps.count(stamps[0]) < len(stamps):
            return unpack(data)
        sec, nanosec = _unpack_stamp(stamps[0])
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
        if not pairs or data[:2] != _LITTLE_ENDIAN:
            return
        layout = Layout(pairs)
        edges = Edges(layout, pairs)
        # A frame twice in a message would not keep its order in a run.
        if layout.size <= len(data) and len(edges.names) == len(pairs):
            if self._count > _MOST_EDGES:
                self._known.clear()
                self._count = 0
            if key not in self._known:
                self._count += len(pairs)
            self._known[key] = edges


def _key(data: bytes) -> _Key:
    """Tell what a message is found again by, if it is little-endian."""
    end = _FIRST_NAME + 4 + int.from_bytes(data[_FIRST_NAME:_FIRST_NAME + 4], 'little')
    begin = end + (-end & 3)
    length = int.from_bytes(data[begin:begin + 4], 'little')
    return len(data), data[_FIRST_NAME:end], data[begin:begin + 4 + length]


def nothing() -> None:
    """Refer to nothing, in place of a weak reference."""
