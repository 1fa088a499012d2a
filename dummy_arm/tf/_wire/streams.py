"""Streams of messages: the bytes of TFMessages to batches of poses and to rows."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
import struct
from typing import Optional, Protocol

from dummy_arm.tf._core.pose import Batch, BatchOrRows, is_too_long, Row, Rows
from dummy_arm.tf._core.times import SECOND
from dummy_arm.tf._wire import cdr
from dummy_arm.tf._wire.cdr import MalformedMessage

#: The layouts that are kept are those of messages of at most so many bytes, added up.
_MOST_BYTES = 10_000_000
#: A batch ends with so many transforms: longer arrays would not stay in the caches.
_LONG = 1000


class Encoding(Protocol):
    """What the bytes mean: the module `cdr` (ROS 2) or `ros1`."""

    HEAD: bytes

    def unpack(self, data: bytes) -> list[Row]:
        """Unpack the bytes of a message into transforms."""

    def rows(self, data: bytes) -> Iterator[Row]:
        """Unpack the bytes of a message, one transform after the other."""

    def key(self, data: bytes) -> bytes:
        """Return what messages with the same frames have in common."""

    def layout(self, edges: Sequence[tuple[str, str]]) -> tuple[str, list[bytes]]:
        """Return where the fields of a message lie whose frames are known."""

    def unpack_stamp(self, data: bytes) -> tuple[int, ...]:
        """Unpack the eight bytes of a stamp: s, ns."""


class _Layout:
    """Where the fields lie of the messages of one stream, whose frames are always the same."""

    def __init__(self, encoding: Encoding, edges: Sequence[tuple[str, str]]) -> None:
        """
        Create the layout.

        :param edges: frame_id and child_frame_id of each of the n transforms, as on the wire.
        """
        self.parents = [parent.removeprefix('/') for parent, _ in edges]
        self.children = [child.removeprefix('/') for _, child in edges]
        self.names = frozenset(self.children)
        fields, names = encoding.layout(edges)
        self._struct = struct.Struct(fields)
        self._head = encoding.HEAD, len(edges)
        self._unpack_stamp = encoding.unpack_stamp
        self._frame_ids, self._child_frame_ids = tuple(names[::2]), tuple(names[1::2])

    def read(self, data: bytes) -> Optional[tuple[int, tuple[bytes, ...]]]:
        """
        Read a message.

        :returns: its stamp (ns), and the pose of each transform (7 float64); None when the message
            has another layout, or several stamps.
        """
        if len(data) < self._struct.size:
            return None
        fields = self._struct.unpack_from(data)
        stamps = fields[2::4]
        if (fields[:2] != self._head or fields[3::4] != self._frame_ids
                or fields[4::4] != self._child_frame_ids
                or stamps.count(stamps[0]) < len(stamps)):
            return None
        sec, nanosec = self._unpack_stamp(stamps[0])
        return sec * SECOND + nanosec, fields[5::4]


class MessageReader:
    """Reads the messages of a topic, and remembers the layouts of those whose frames repeat."""

    def __init__(self, on_malformed: Callable[[MalformedMessage], object], encoding: Encoding = cdr
                 ) -> None:
        """
        Create a reader that knows no layout.

        :param on_malformed: is called with the error of each message that cannot be decoded.
        :param encoding: how messages are written.
        """
        self._on_malformed, self._encoding = on_malformed, encoding
        self._layouts: dict[tuple[int, bytes], _Layout] = {}
        self._size = 0  # of the messages (bytes)

    def read(self, messages: Iterable[bytes], authority: str, is_static: bool
             ) -> list[BatchOrRows]:
        """
        Read messages.

        :param authority: their publisher.
        :param is_static: whether they are from /tf_static. Static transforms are inserted in the
            order in which they were sent, so they are not gathered.
        :returns: batches; and rows, of a message that is static, whose layout was not known or
            that has several stamps. The transforms of one child are in the order of arrival.
        """
        encoding, result = self._encoding, list[BatchOrRows]()
        open_batches: dict[_Layout, Batch] = {}  # those that may get more messages
        for data in messages:
            try:
                if is_static:
                    result.append(Rows(encoding.unpack(data), authority, True))
                    continue
                key = len(data), encoding.key(data)
                layout = self._layouts.get(key)
                fields = None if layout is None else layout.read(data)
                if layout is None or fields is None:
                    rows = encoding.unpack(data)
                    self._learn(key, data, rows)
                    result += [*open_batches.values(), Rows(rows, authority, False)]
                    open_batches.clear()
                    continue
                stamp, poses = fields
                batch = open_batches.get(layout)
                if batch is None or stamp <= batch.stamps[-1] or len(batch.poses) >= _LONG:
                    # Those with a frame of this one come before it.
                    for other in tuple(open_batches):
                        if not layout.names.isdisjoint(other.names):
                            result.append(open_batches.pop(other))
                    batch = Batch(layout.parents, layout.children, authority)
                    open_batches[layout] = batch
                batch.stamps.append(stamp)
                batch.poses += poses
            except MalformedMessage as error:
                self._on_malformed(error)
        return [*result, *open_batches.values()]

    def _learn(self, key: tuple[int, bytes], data: bytes, rows: list[Row]) -> None:
        """Keep the layout of a message, if it has one stamp."""
        edges = [(row.frame_id, row.child_frame_id) for row in rows]
        if len({row.stamp_ns for row in rows}) != 1 or any(map(is_too_long, chain(*edges))):
            return  # long names are refused
        layout = _Layout(self._encoding, edges)
        # A frame twice in a message would not keep its order in a batch.
        if layout.read(data) is not None and len(layout.names) == len(edges):
            if self._size > _MOST_BYTES:
                self._layouts.clear()
                self._size = 0
            if key not in self._layouts:
                self._size += len(data)
            self._layouts[key] = layout
