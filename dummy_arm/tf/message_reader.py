"""The bytes of messages to what a buffer takes; what repeats in a stream is worked out once."""

from array import array
from collections.abc import Callable, Iterable
import struct
from sys import intern

from dummy_arm.tf.times import SECOND
from dummy_arm.tf.wire import Layout, MalformedMessage, Row, unpack

#: So many edges may lie in the layouts that are kept, all together.
_MOST_EDGES = 100_000
_LITTLE_ENDIAN = b'\x00\x01'
_FIRST_NAME = 16
_unpack_stamp = struct.Struct('<iI').unpack

#: The length of a message and its first two names.
_Key = tuple[int, bytes, bytes]


class Run:
    """Messages with the same frames, each with one stamp, in the order of their arrival."""

    __slots__ = ('children', 'parents', 'poses', 'stamps')

    def __init__(self, parents: list[str], children: list[str]) -> None:
        """
        Begin without a message.

        :param parents: of each of the n transforms, without a leading slash.
        :param children: likewise.
        """
        self.parents, self.children = parents, children
        #: Of each of the m messages (ns).
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
        self._layouts: dict[_Key, tuple[Layout, list[str], list[str]]] = {}
        self._edges = 0

    def read(self, messages: Iterable[bytes], in_order: bool = False
             ) -> tuple[list[Row], list[Run]]:
        """
        Read messages.

        :param in_order: give all as rows, in the order of arrival.
        :returns: the transforms of messages whose layout was not known or that have several
            stamps; and the others, gathered by their frames.
        """
        rows: list[Row] = []
        runs: dict[Layout, Run] = {}
        for data in messages:
            try:
                if in_order or not self._read_known(data, runs):
                    rows += unpack(data)
            except MalformedMessage as error:
                self._on_malformed(error)
        return rows, list(runs.values())

    def _read_known(self, data: bytes, runs: dict[Layout, Run]) -> bool:
        """Append a message to a run, if its layout is known and it has one stamp."""
        key = _key(data)
        known = self._layouts.get(key)
        if known is None or (fields := known[0].read(data)) is None:
            self._learn(key, data)
            return False
        stamps, poses = fields
        if stamps.count(stamps[0]) < len(stamps):
            return False
        layout, parents, children = known
        run = runs.get(layout)
        if run is None:
            runs[layout] = run = Run(parents, children)
        sec, nanosec = _unpack_stamp(stamps[0])
        run.stamps.append(sec * SECOND + nanosec)
        run.poses += poses
        return True

    def _learn(self, key: _Key, data: bytes) -> None:
        """Keep the layout of a message."""
        rows = unpack(data)
        if not rows or data[:2] != _LITTLE_ENDIAN:
            return
        layout = Layout([row[2:4] for row in rows])
        if layout.size > len(data):
            return
        if self._edges > _MOST_EDGES:
            self._layouts.clear()
            self._edges = 0
        self._edges += len(rows)
        # Interned as the buffer's are: the same object is the same name.
        self._layouts[key] = (layout, [intern(row[2].removeprefix('/')) for row in rows],
                              [intern(row[3].removeprefix('/')) for row in rows])


def _key(data: bytes) -> _Key:
    """Tell what a message is found again by, if it is little-endian."""
    end = _FIRST_NAME + 4 + int.from_bytes(data[_FIRST_NAME:_FIRST_NAME + 4], 'little')
    begin = end + (-end & 3)
    length = int.from_bytes(data[begin:begin + 4], 'little')
    return len(data), data[_FIRST_NAME:end], data[begin:begin + 4 + length]
