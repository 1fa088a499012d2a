"""
The transforms of many messages as arrays.

The messages are those of `PublisherListener.received` or of `dummy_arm.tf.bag.messages`. For
statistics, arrays are much faster than the method `rows` of each message.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
import re
import struct
from typing import NamedTuple, Optional, Protocol

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._core.times import SECOND
from dummy_arm.tf._wire import cdr
from dummy_arm.tf._wire.streams import Encoding

#: Messages are converted when they take more than `_MOST_BYTES` bytes. A message takes `_OVERHEAD`
#: bytes more than its data.
_MOST_BYTES, _OVERHEAD = 2**20, 100
#: When the layouts are of messages that take more than this (bytes), all of them are dropped.
_MOST_OF_LAYOUTS = 10_000_000

#: What messages with the same frames have in common: the publisher, the topic (True: static), the
#: length (bytes), and the key of the encoding.
_Key = tuple[str, bool, int, bytes]


class Message(Protocol):
    """A message that was received or recorded: a `ReceivedMessage` or a `BagMessage`."""

    @property
    def time(self) -> int:
        """The time of arrival or of the recording (ns); 0: not known."""

    @property
    def is_static(self) -> bool:
        """True if the message is from `/tf_static`."""

    @property
    def publisher(self) -> str:
        """An identifier of the publisher."""

    @property
    def data(self) -> bytes:
        """The bytes of the message."""

    @property
    def encoding(self) -> Encoding:
        """The encoding of the bytes."""

    def rows(self) -> list[Row]:
        """
        Return the transforms of the message.

        :returns: for each transform, its stamp (ns), frame_id, child_frame_id and pose.
        :raises ValueError: if the bytes are not those of a TFMessage.
        """


class TransformTable(NamedTuple):
    """The transforms of m messages of one publisher, each of n transforms of the same frames."""

    publisher: str  #: the publisher, as in the messages
    is_static: bool  #: True if the messages are from `/tf_static`
    edges: list[tuple[str, str]]  #: (n) frame_id and child_frame_id, unchanged
    times: NDArray[np.int64]  #: (m,) the times of arrival or of the recording (ns); 0: not known
    stamps: NDArray[np.int64]  #: (m, n) the stamps (ns)
    #: (m, n, 7) x, y, z (m), quaternion x, y, z, w of any norm
    poses: NDArray[np.float64]


class _Layout:
    """The positions of the fields in messages that have the same frames."""

    def __init__(self, encoding: Encoding, edges: list[tuple[str, str]]) -> None:
        """
        Create the layout.

        :param encoding: the encoding of the messages.
        :param edges: (n) frame_id and child_frame_id of each transform.
        :raises ValueError: if a frame id contains a NUL or is not valid Unicode.
        """
        self._edges, self._seconds = edges, encoding.SECONDS
        #: The children without a leading slash.
        self.children = frozenset(child.removeprefix('/') for _, child in edges)
        fields, names = encoding.layout(edges)
        # The fields are the head, the number of transforms, and four fields for each transform:
        # the stamp, frame_id, child_frame_id and the pose.
        positions: list[NDArray[np.int64]] = []
        self._size = 0
        for count, kind in re.findall(r'(\d*)([sxI])', fields):
            begin = self._size
            self._size += int(count or 1) * struct.calcsize(kind)
            if kind != 'x':
                positions.append(np.arange(begin, self._size))
        self._stamps_at, self._poses_at = np.array(positions[2::4]), np.array(positions[5::4])
        self._fixed_at = np.concatenate([*positions[:2], *positions[3::4], *positions[4::4]])
        self._fixed = np.frombuffer(b''.join(
            [encoding.HEAD, struct.pack('<I', len(edges)), *names[::2], *names[1::2]]), np.uint8)

    def read(self, messages: Sequence[Message]) -> Optional[TransformTable]:
        """
        Convert messages.

        :param messages: m messages of one publisher and topic, and of the same length.
        :returns: the table; None if a message has another layout.
        """
        first = messages[0]
        if len(first.data) < self._size:
            return None
        data = np.frombuffer(b''.join([message.data for message in messages]),
                             np.uint8).reshape(len(messages), -1)
        if (data.take(self._fixed_at, 1) != self._fixed).any():
            return None
        seconds, nanoseconds = (data.take(self._stamps_at[:, i:i + 4], 1) for i in (0, 4))
        stamps = seconds.view(self._seconds)[..., 0].astype(np.int64) * SECOND
        return TransformTable(
            first.publisher, first.is_static, self._edges,
            np.array([message.time for message in messages], np.int64),
            stamps + nanoseconds.view('<u4')[..., 0],
            data.take(self._poses_at, 1).view('<f8'))


def transform_tables(messages: Iterable[Message],
                     on_malformed: Callable[[ValueError], object] = lambda error: None
                     ) -> Iterator[TransformTable]:
    """
    Convert messages to tables.

    The transforms of each child from one publisher on one topic stay in order. The order of other
    transforms may change.

    :param messages: the messages, in the order of their arrival.
    :param on_malformed: called with the error of each message that cannot be decoded.
    :returns: an iterator over the tables. In a table, each frame is the child of one edge only.
    """
    layouts: dict[_Key, Optional[_Layout]] = {}
    pending: dict[_Key, tuple[_Layout, list[Message]]] = {}
    size = learned = 0

    def complete(keys: Iterable[_Key]) -> Iterator[TransformTable]:
        """
        Convert pending messages.

        :param keys: the keys of the messages.
        :returns: the tables.
        """
        for key in keys:
            layout, group = pending.pop(key)
            if (table := layout.read(group)) is not None:
                yield table
            else:
                for message in group:
                    yield from _tables_of(message, on_malformed)

    for message in messages:
        if size > _MOST_BYTES:
            yield from complete([*pending])
            size = 0
        data = message.data
        key = message.publisher, message.is_static, len(data), message.encoding.key(data)
        if key not in pending:
            if key not in layouts:
                if learned > _MOST_OF_LAYOUTS:
                    layouts.clear()
                    learned = 0
                layouts[key] = _learn(message)
                learned += len(data) + _OVERHEAD
            layout = layouts[key]
            yield from complete([
                other for other, (open_layout, _) in pending.items()
                if layout is None or (other[:2] == key[:2]
                                      and not layout.children.isdisjoint(open_layout.children))])
            if layout is None:
                yield from _tables_of(message, on_malformed)
                continue
            pending[key] = layout, []
        pending[key][1].append(message)
        size += len(data) + _OVERHEAD
    yield from complete([*pending])


def header_frame(data: bytes) -> str:
    """
    Return the frame_id of a message that begins with a std_msgs/Header.

    :param data: the message, in CDR; it may be of any type, and incomplete after the header.
    :returns: the frame_id.
    :raises ValueError: if the bytes end too early.
    """
    try:
        return cdr.header_frame(data)
    except struct.error as error:
        raise ValueError(f'the message has no header: {error}') from None


def _learn(message: Message) -> Optional[_Layout]:
    """
    Return the layout of a message.

    :returns: the layout; None if there is none: the message is malformed, big-endian or empty, it
        has a child twice, or a name that is not valid Unicode.
    """
    try:
        edges = [(row.frame_id, row.child_frame_id) for row in message.rows()]
        layout = _Layout(message.encoding, edges)
    except ValueError:
        return None
    is_regular = edges and len(layout.children) == len(edges)
    return layout if is_regular and layout.read([message]) is not None else None


def _tables_of(message: Message, on_malformed: Callable[[ValueError], object]
               ) -> Iterator[TransformTable]:
    """Convert the transforms of one message, each to a table."""
    try:
        rows = message.rows()
    except ValueError as error:
        on_malformed(error)
        return
    for row in rows:
        yield TransformTable(
            message.publisher, message.is_static, [(row.frame_id, row.child_frame_id)],
            np.array([message.time]), np.array([[row.stamp_ns]]), np.array([[row.pose]]))
