"""
The layouts of TFMessages, and the reading of messages whose layout is known.

The frames of a publisher's messages rarely change. So the layout of messages, that is, the
positions of their fields, is worked out once, and later messages are read by one call of `struct`.
"""

from collections.abc import Callable, Iterable, Sequence
import struct
from typing import Any, Optional

import numpy as np
from numpy.typing import ArrayLike, NDArray

from puretf._core.pose import Batch, BatchOrRows, POSE_BYTES, Row, Rows
from puretf._core.times import split
from puretf._text.times import SECOND
from puretf._wire.encoding import CDR, Encoding, MalformedMessage

pack_stamp = struct.Struct('<iI').pack
#: When the messages of the kept layouts take more than this (bytes), all layouts are dropped.
_MOST_BYTES = 10_000_000
#: No message is added to a batch of this many transforms: larger arrays do not fit the CPU caches.
_FULL_BATCH = 1000


#: The parts of a message: its layout, its n stamps and its n poses, each as bytes.
Parts = tuple['Layout', tuple[bytes, ...], tuple[bytes, ...]]


class Layout:
    """The positions of the fields in messages that have the same frames; packs such messages."""

    def __init__(self, encoding: Encoding, edges: Sequence[tuple[str, str]]) -> None:
        self.edges = edges
        self.parents = [parent.removeprefix('/') for parent, _ in edges]
        self.children = [child.removeprefix('/') for _, child in edges]
        self.names = frozenset(self.children)
        fields, names = encoding.layout(edges)
        self._struct = struct.Struct(fields)
        self._head = encoding.head, len(edges)
        self._frame_ids, self._child_frame_ids = tuple(names[::2]), tuple(names[1::2])
        self._stamp_type = np.dtype([('sec', f'<{encoding.stamp[0]}'), ('nanosec', '<I')])
        self._template: list[Any] = [*self._head, *[None] * (4 * len(edges))]
        self._template[3::4], self._template[4::4] = self._frame_ids, self._child_frame_ids

    def read(self, data: bytes) -> Optional[Parts]:
        if len(data) < self._struct.size:
            return None
        fields = self._struct.unpack_from(data)
        if (fields[:2] != self._head or fields[3::4] != self._frame_ids
                or fields[4::4] != self._child_frame_ids):
            return None
        return self, fields[2::4], fields[5::4]

    def arrays(self, stamps: bytes, poses: bytearray
               ) -> tuple[NDArray[np.int64], NDArray[np.float64], int]:
        """Convert parts of m messages: (m, n) stamps (ns), (m, n, 7) poses, largest nanosec."""
        number = len(self.edges)
        times = np.frombuffer(stamps, self._stamp_type).reshape(-1, number)
        return (times['sec'].astype(np.int64) * SECOND + times['nanosec'],
                np.frombuffer(poses, '<f8').reshape(-1, number, 7), int(times['nanosec'].max()))


    def pack(self, stamp_ns: int, poses: ArrayLike) -> bytes:
        """Serialise n poses, (n, 7) float64, with one stamp; a ValueError names what is wrong."""
        values = np.asarray(poses, '<f8')
        if values.shape != (len(self.edges), 7):
            raise ValueError(f'poses must be of shape ({len(self.edges)}, 7), got {values.shape}')
        data = values.tobytes()
        return self.fill([pack_stamp(*split(stamp_ns))] * len(values),
                         [data[at:at + POSE_BYTES] for at in range(0, len(data), POSE_BYTES)])

    def fill(self, stamps: list[bytes], poses: list[bytes]) -> bytes:
        fields = self._template.copy()
        fields[2::4], fields[5::4] = stamps, poses
        return self._struct.pack(*fields)


class KnownLayouts:
    """The layouts of messages of one encoding; each is learned from a message."""

    def __init__(self, encoding: Encoding) -> None:
        self._encoding, self._key = encoding, encoding.key
        self._kept: dict[tuple[int, bytes], Layout] = {}
        self._size = 0  # of the messages (bytes)

    def read(self, data: bytes) -> Optional[Parts]:
        layout = self._kept.get((len(data), self._key(data)))
        return None if layout is None else layout.read(data)

    def learn(self, data: bytes, rows: Sequence[Row]) -> Optional[Parts]:
        """
        Keep the layout of a message, which has these rows, and read the message.

        A child may not occur twice: neither a `Batch` nor a table keeps the order of its rows.
        """
        edges = [(row.frame_id, row.child_frame_id) for row in rows]
        children = {child.removeprefix('/') for _, child in edges}
        if not edges or len(children) < len(edges) or len(data) > _MOST_BYTES:
            return None
        layout = Layout(self._encoding, edges)
        parts = layout.read(data)
        if parts is not None:
            if self._size > _MOST_BYTES:
                self._kept.clear()
                self._size = 0
            self._kept[len(data), self._key(data)] = layout
            self._size += len(data)
        return parts


class MessageReader:
    """Reads the messages of a topic."""

    def __init__(self, on_malformed: Callable[[MalformedMessage], object], encoding: Encoding = CDR
                 ) -> None:
        self._on_malformed, self._unpack = on_malformed, encoding.unpack
        self._layouts = KnownLayouts(encoding)
        self._unpack_stamp = struct.Struct(f'<{encoding.stamp}').unpack

    def read(self, messages: Iterable[bytes], authority: str, is_static: bool
             ) -> list[BatchOrRows]:
        """
        Join dynamic messages with a known layout and a single stamp into batches.

        Each other message becomes a `Rows` object. The transforms of each child stay in order.
        """
        closed: list[BatchOrRows] = []
        batches: dict[Layout, Batch] = {}
        read_known, unpack_stamp = self._layouts.read, self._unpack_stamp
        for data in messages:
            # Static transforms must stay in order across all frames.
            parts = None if is_static else read_known(data)
            if parts is not None:
                layout, stamps, poses = parts
                if stamps.count(stamps[0]) == len(stamps):
                    sec, nanosec = unpack_stamp(stamps[0])
                    stamp, batch = sec * SECOND + nanosec, batches.get(layout)
                    if batch is None or stamp <= batch.stamps[-1] or (
                            len(batch.poses) >= _FULL_BATCH):
                        # The order matters only for transforms of the same child.
                        for other in tuple(batches):
                            if not layout.names.isdisjoint(other.names):
                                closed.append(batches.pop(other))
                        batch = batches[layout] = Batch(layout.parents, layout.children, authority)
                    batch.stamps.append(stamp)
                    batch.poses += poses
                    if nanosec >= SECOND:
                        batch.nanosec = nanosec
                    continue
            try:
                rows = self._unpack(data)
            except MalformedMessage as error:
                self._on_malformed(error)
                continue
            if parts is None and not is_static:
                self._layouts.learn(data, rows)
            closed += batches.values()
            batches.clear()
            closed.append(Rows(rows, authority, is_static))
        return [*closed, *batches.values()]
