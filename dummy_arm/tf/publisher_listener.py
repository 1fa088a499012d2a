"""The publishers of transforms, by the gids that rcl reports with each message."""

from collections import deque
from collections.abc import Iterable
from itertools import groupby
from operator import attrgetter
from time import monotonic, time_ns
from typing import Any, NamedTuple

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from dummy_arm.tf._core.frames import Frame
from dummy_arm.tf._core.pose import BatchOrRows, Row
from dummy_arm.tf._ros.rclpy_private import GID_SIZE, rcl_take, RCLError, Taker
from dummy_arm.tf._ros.subscription import SubscriptionSource
from dummy_arm.tf._wire import cdr
from dummy_arm.tf.transform_listener import TransformListener

UNKNOWN = 'unknown publisher'
_BETWEEN_LOOKS = 0.5  # s
#: The names of so many publishers are kept, those that are gone included.
_MOST_NAMES = 10_000
_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'  # of a publisher whose node is not discovered yet
#: At most so many messages, and bytes, are kept for `received`.
_MOST_MESSAGES, _MOST_BYTES = 10_000, 2**24


class ReceivedMessage(bytes):
    """The bytes of a message, with what the middleware knows of it."""

    gid = ''  #: of its publisher, in hex; '' where that is not known
    reception_time = 0  #: when it arrived, on the system's clock (ns)
    is_static = False  #: whether it is from /tf_static

    @classmethod
    def of(cls, data: bytes, gid: str = '', reception_time: int = 0) -> 'ReceivedMessage':
        """
        Create a message.

        :param gid: of its publisher, in hex; '': not known.
        :param reception_time: when it arrived, on the system's clock (ns); 0: now.
        """
        message = cls(data)
        message.gid, message.reception_time = gid, reception_time or time_ns()
        return message

    def rows(self) -> list[Row]:
        """
        Return its transforms, as they are in the message: names may have a leading slash.

        :returns: tuples with `stamp_ns`, `frame_id`, `child_frame_id` and `pose`: x, y, z (m) and
            the quaternion x, y, z, w, of any length.
        :raises ValueError: when the bytes are no TFMessage.
        """
        return cdr.unpack(self)


class Received(NamedTuple):
    """The messages that have arrived since the last call of `PublisherListener.received`."""

    messages: list[ReceivedMessage]  #: in the order of their arrival on each topic
    dropped: int  #: how many before these were dropped, because there were too many


class _Names:
    """The names of the nodes of publishers."""

    def __init__(self, node: Node) -> None:
        """Create without names."""
        self._node = node
        self.topics: set[str] = set()
        self._names: dict[str, str] = {}
        self._next_look = 0.0
        #: The gids of the publishers that there are.
        self.present: frozenset[str] = frozenset()

    def look_now_and_then(self) -> None:
        """Look up the publishers, since a node may end before somebody asks for its name."""
        if (now := monotonic()) >= self._next_look:
            self._next_look = now + _BETWEEN_LOOKS
            self.look()

    def of(self, gids: Iterable[str]) -> dict[str, str]:
        """Return the full names of the nodes of publishers, by their gids."""
        asked = set(gids)
        if not asked <= self._names.keys():
            self.look()
        return {gid: self._names.get(gid, UNKNOWN) for gid in asked}

    def look(self) -> None:
        """
        Look up the names of the publishers that there are.

        Those of publishers that are gone are kept, up to a number; the oldest are forgotten.
        """
        present = set()
        for topic in self.topics:
            for info in self._node.get_publishers_info_by_topic(topic):
                gid = bytes(info.endpoint_gid[:GID_SIZE]).hex()
                present.add(gid)
                if info.node_name != _UNKNOWN_NODE:
                    self._names[gid] = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
        self.present = frozenset(present)
        if (surplus := len(self._names) - _MOST_NAMES) > 0:
            gone = [gid for gid in tuple(self._names) if gid not in present]
            for gid in gone[:surplus]:
                self._names.pop(gid, None)


class _GidSource(SubscriptionSource):
    """A source whose authorities are the gids of the publishers; it keeps the messages, too."""

    def __init__(self, *arguments: Any, names: _Names) -> None:
        """Create the source; as SubscriptionSource."""
        super().__init__(*arguments)
        names.topics = {topic.name for topic, _, _ in self._topics}
        self._names = names
        #: None where rcl cannot be called: then gids are not known.
        self._takers = [Taker(ReceivedMessage.of) if rcl_take() else None for _ in range(2)]
        self._kept: deque[ReceivedMessage] = deque()
        self._size = self._dropped = 0

    def take(self) -> list[BatchOrRows]:
        """Return what has arrived; as SubscriptionSource."""
        try:
            for taker, (topic, _, arrived) in zip(self._takers, reversed(self._topics)):
                if taker is not None:
                    taker.take(topic.handle, topic.most, arrived)
                    continue
                plain: list[Any] = []
                topic.take(plain)
                arrived += [ReceivedMessage.of(data) for data, _ in plain]
        except (InvalidHandle, RCLError):  # the listener is ended concurrently
            pass
        for topic, reader, arrived in self._topics:
            if arrived:
                self._count += len(arrived)
                try:
                    for gid, sent in groupby(arrived, attrgetter('gid')):
                        self._batches += reader.read(sent, gid, topic.is_static)
                except Exception as error:  # a fault of this package
                    self._on_fault(error)
                self._keep(arrived, topic.is_static)
        return self._batches

    def end_round(self) -> float:
        """Look up the publishers now and then; else as SubscriptionSource."""
        self._names.look_now_and_then()
        return super().end_round()

    def _keep(self, messages: list[Any], is_static: bool) -> None:
        """Move messages to those that are kept."""
        for message in messages:
            message.is_static = is_static
        size = sum(map(len, messages))
        self._size += size  # these lines without a call, after which Ctrl-C could come
        self._kept += messages
        del messages[:]
        while len(self._kept) > _MOST_MESSAGES or self._size > _MOST_BYTES:
            self._size -= len(self._kept.popleft())
            self._dropped += 1

    def received(self) -> Received:
        """Return what was kept, and keep it no more; the lock of the buffer is held."""
        received = Received(list(self._kept), self._dropped)
        self._kept.clear()
        self._size = self._dropped = 0
        return received


class PublisherListener(TransformListener):
    """A TransformListener that knows which node has sent the newest transform of a frame."""

    def __init__(self, *arguments: Any, **kwargs: Any) -> None:
        """Start to listen; as TransformListener, to a Buffer, MessageBufferCore or BufferCore."""
        node: Any = kwargs.get('node', arguments[1] if len(arguments) > 1 else None)
        self._names = names = _Names(node)

        def source(*arguments: Any) -> _GidSource:
            self._source = _GidSource(*arguments, names=names)
            return self._source

        super().__init__(*arguments, source=source, **kwargs)

    @property
    def present(self) -> frozenset[str]:
        """The gids of the publishers that there are, as of half a second ago."""
        return self._names.present

    def received(self) -> Received:
        """
        Return the messages that have arrived since the last call, or since the begin.

        At most 10 000 messages and 16 MiB of them are kept, the newest.
        """
        with self.buffer.fetched():
            return self._source.received()

    def frames(self) -> list[Frame]:
        """Return the frames of the buffer, with the full names of nodes as their authorities."""
        frames: list[Frame] = self.buffer.frames()
        names = self.names_of(frame.authority for frame in frames)
        return [frame._replace(authority=names[frame.authority]) for frame in frames]

    def names_of(self, gids: Iterable[str]) -> dict[str, str]:
        """Return the full names of the nodes of publishers, by their gids."""
        return self._names.of(gids)
