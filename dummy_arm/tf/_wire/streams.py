"""Conversion of serialised TFMessages to `Batch` and `Rows` objects."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
import struct
from typing import Optional, Protocol

from dummy_arm.tf._core.pose import Batch, BatchOrRows, is_too_long, Row, Rows
from dummy_arm.tf._core.times import SECOND
from dummy_arm.tf._wire import cdr
from dummy_arm.tf._wire.cdr import MalformedMessage

#: A `MessageReader` keeps layouts, each of which it has learned from one message. When the total
#: size of these messages (bytes) is larger than this number, the reader drops all layouts.
_MOST_BYTES = 10_000_000
#: No message is added to a batch that has this number of transforms or more, because the arrays of
#: a larger batch would not fit in the CPU caches.
_FULL_BATCH = 1000


class Encoding(Protocol):
    """The encoding of messages: the module `cdr` (ROS 2) or the module `ros1` (ROS 1)."""

    #: The first bytes of a message; b'' if a message begins with the number of transforms.
    HEAD: bytes
    #: The type of the seconds of a stamp, for numpy: '<i4' or '<u4'.
    SECONDS: str

    def unpack(self, data: bytes) -> list[Row]:
        """
        Deserialise a message.

        :param data: the message.
        :returns: the transforms.
        :raises MalformedMessage: if the bytes are not a message.
        """

    def rows(self, data: bytes) -> Iterator[Row]:
        """
        Deserialise a message, one transform after the other.

        :param data: the message.
        :returns: an iterator over the transforms.
        :raises MalformedMessage: if the bytes are not a message.
        """

    def key(self, data: bytes) -> bytes:
        """
        Return a key that depends only on the two names of the first transform.

        So messages with the same frames have the same key. Two messages with different frames may
        have the same key, too. `MessageReader` finds a layout by this key together with the length
        of the message.

        :param data: a message.
        :returns: the key.
        """

    def layout(self, edges: Sequence[tuple[str, str]]) -> tuple[str, list[bytes]]:
        """
        Return the layout of messages with certain frames.

        :param edges: (frame_id, child_frame_id) of each of the n transforms.
        :returns: a format for the module `struct`, and the bytes of the 2 n names; see
            `cdr.layout`.
        """

    def header_frame(self, data: bytes) -> str:
        """
        Return the frame_id of a message that begins with a std_msgs/Header.

        :param data: the message.
        :returns: the frame_id.
        :raises struct.error: if the bytes end too early.
        """

    def unpack_stamp(self, data: bytes) -> tuple[int, ...]:
        """
        Unpack a stamp.

        :param data: the eight bytes of the stamp.
        :returns: seconds and nanoseconds.
        """


class _Layout:
    """The positions of the fields in messages that have the same frames."""

    def __init__(self, encoding: Encoding, edges: Sequence[tuple[str, str]]) -> None:
        """
        Create the layout.

        :param encoding: the encoding of the messages.
        :param edges: (frame_id, child_frame_id) of each of the n transforms, as in the messages.
        """
        self.parents = [parent.removeprefix('/') for parent, _ in edges]
        self.children = [child.removeprefix('/') for _, child in edges]
        self.names = frozenset(self.children)
        # The fields are the head, the number of transforms, and four fields for each transform:
        # the stamp, frame_id, child_frame_id and the pose.
        fields, frame_ids = encoding.layout(edges)
        self._struct = struct.Struct(fields)
        self._head = encoding.HEAD, len(edges)
        self._unpack_stamp = encoding.unpack_stamp
        self._frame_ids, self._child_frame_ids = tuple(frame_ids[::2]), tuple(frame_ids[1::2])

    def read(self, data: bytes) -> Optional[tuple[int, tuple[bytes, ...]]]:
        """
        Read a message.

        :param data: the message.
        :returns: the stamp of the message (ns), and the pose of each transform as bytes
            (7 float64); None if the message has another layout or several stamps.
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
    """
    A reader of the messages of a topic.

    The reader keeps the layouts of messages, so that it reads later messages with the same frames
    fast.
    """

    def __init__(self, on_malformed: Callable[[MalformedMessage], object], encoding: Encoding = cdr
                 ) -> None:
        """
        Create a reader without layouts.

        :param on_malformed: called with the error of each message that cannot be decoded.
        :param encoding: the encoding of the messages.
        """
        self._on_malformed, self._encoding = on_malformed, encoding
        self._layouts: dict[tuple[int, bytes], _Layout] = {}
        #: The total size of the messages from which the kept layouts were learned (bytes).
        self._size = 0

    def read(self, messages: Iterable[bytes], authority: str, is_static: bool
             ) -> list[BatchOrRows]:
        """
        Read messages.

        Dynamic messages with a single stamp are joined into batches if their layout is kept. Each
        other message becomes a `Rows` object. Static messages are not joined into batches: their
        transforms must stay in order across all frames, but a batch keeps the order only of
        transforms with the same child.

        :param messages: the messages, in the order of their arrival.
        :param authority: the name of the publisher of the messages.
        :param is_static: True if the messages are from /tf_static.
        :returns: `Batch` and `Rows` objects. The transforms of each child are in the order of
            their arrival.
        """
        encoding, result = self._encoding, list[BatchOrRows]()
        open_batches: dict[_Layout, Batch] = {}  # batches to which messages can be appended
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
                if batch is None or stamp <= batch.stamps[-1] or len(batch.poses) >= _FULL_BATCH:
                    # First, each open batch that shares a child with the new batch is closed. So
                    # the closed batch is inserted before the new batch, and the transforms of each
                    # child stay in order.
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
        """Keep the layout of a message if messages with this layout can be joined into batches."""
        edges = [(row.frame_id, row.child_frame_id) for row in rows]
        if len({row.stamp_ns for row in rows}) != 1 or any(map(is_too_long, chain(*edges))):
            return  # A buffer refuses transforms whose names are too long.
        layout = _Layout(self._encoding, edges)
        # `layout.read` returns None for a big-endian message. If a message has two transforms of
        # the same child, the layout is not kept either, because a batch would not keep the order
        # of these transforms.
        if layout.read(data) is not None and len(layout.names) == len(edges):
            if self._size > _MOST_BYTES:
                self._layouts.clear()
                self._size = 0
            if key not in self._layouts:
                self._size += len(data)
            self._layouts[key] = layout
