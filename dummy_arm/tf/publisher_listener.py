"""
A listener that knows which node has published a transform.

Each publisher has a *gid*, by which the middleware identifies the publisher. A gid arrives with
each message, and the ROS graph tells to which node the publisher with this gid belongs.
"""

from collections import deque
from collections.abc import Iterable
from itertools import groupby
from operator import attrgetter
from time import monotonic, time_ns
from typing import Any, NamedTuple, Optional

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from dummy_arm.tf._core.frames import Frame
from dummy_arm.tf._core.pose import BatchOrRows, Row
from dummy_arm.tf._core.texts import comma_list, full_name, TF_MESSAGE
from dummy_arm.tf._ros.rclpy_private import GID_SIZE, rcl_take, RCLError, Taker
from dummy_arm.tf._ros.subscription import SubscriptionSource
from dummy_arm.tf._wire import cdr
from dummy_arm.tf._wire.streams import Encoding
from dummy_arm.tf.transform_listener import TransformListener

#: The name of a publisher whose node is not known.
UNKNOWN = 'unknown publisher'
#: The time between two regular queries of the ROS graph (s).
_QUERY_INTERVAL = 0.5
#: If there are more node names than this, the oldest names of publishers that are gone are
#: dropped.
_MOST_NAMES = 10_000
#: The largest number of nodes that are named in place of one node.
_SHOWN = 5
#: The node name that rmw reports for a publisher whose node is not discovered yet.
_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
#: The largest number of messages that are kept for `received`, and the largest sum of their sizes
#: (bytes).
_MOST_MESSAGES, _MOST_BYTES = 10_000, 2**24


class ReceivedMessage(bytes):
    """The bytes of a TFMessage, with the publisher's gid, the time of arrival and the topic."""

    #: The gid of the publisher, in hex; '' if the gid is not known. If the middleware does not
    #: report gids: what else it reports of the publisher.
    publisher = ''
    time = 0  #: the time of arrival, on the system clock (ns)
    is_static = False  #: True if the message is from /tf_static
    #: The encoding of the bytes.
    #:
    #: :meta private:
    encoding: Encoding = cdr

    @property
    def data(self) -> bytes:
        """The bytes of the message."""
        return self

    @classmethod
    def of(cls, data: bytes, publisher: str = '', time: int = 0) -> 'ReceivedMessage':
        """
        Create a message.

        :param data: the bytes of a TFMessage.
        :param publisher: the gid of the publisher, in hex; '' if the gid is not known.
        :param time: the time of arrival, on the system clock (ns); 0: the current time.
        :returns: the message.
        """
        message = cls(data)
        message.publisher, message.time = publisher, time or time_ns()
        return message

    def rows(self) -> list[Row]:
        """
        Return the transforms of the message, unchanged: names may have a leading slash.

        :returns: for each transform, a tuple of `stamp_ns`, `frame_id`, `child_frame_id` and
            `pose`. The pose is x, y, z (m) and the quaternion x, y, z, w, which may have any norm.
        :raises ValueError: if the bytes are not those of a TFMessage.
        """
        return cdr.unpack(self)


class Received(NamedTuple):
    """The messages that have arrived since the last call of `PublisherListener.received`."""

    messages: list[ReceivedMessage]  #: the messages of each topic are in the order of arrival
    dropped: int  #: the number of older messages that were dropped, to limit the memory


def gid_of(info: TopicEndpointInfo) -> str:
    """Return the gid (in hex) of a publisher in the ROS graph."""
    return bytes(info.endpoint_gid[:GID_SIZE]).hex()


class _NodeNames:
    """
    A table from the gid of each publisher to the name of the publisher's node.

    With some middleware, what arrives with a message is not the gid of any publisher in the ROS
    graph. Then the publisher is one of those on the topic; it is known if there was only one.
    """

    def __init__(self, node: Node) -> None:
        """
        Create an empty table; no name is found before `topics` is set.

        :param node: the node that queries the ROS graph.
        """
        self._node = node
        #: The topics whose publishers are queried.
        self.topics: set[str] = set()
        #: By gid: the name of the node, and the topic.
        self._nodes: dict[str, tuple[str, str]] = {}
        #: By gid: the topic, if the gid may never be that of a publisher in the ROS graph.
        self._topics: dict[str, str] = {}
        self._next_query = 0.0
        #: The gids of the publishers that existed at the last query.
        self.present: frozenset[str] = frozenset()

    def query_if_due(self) -> None:
        """
        Query the ROS graph, but at most every half second.

        Because of these regular queries, the name of a node is known even if the node ends before
        `names_of` is called.
        """
        if (now := monotonic()) >= self._next_query:
            self._next_query = now + _QUERY_INTERVAL
            self.query()

    def publishers(self) -> dict[str, tuple[str, str]]:
        """Return the publishers that were found, as `PublisherListener.publishers`."""
        self.query_if_due()
        return dict(self._nodes)

    def names_of(self, gids: Iterable[str]) -> dict[str, str]:
        """
        Return the full names of the publishers' nodes.

        :param gids: the gids of the publishers, in hex.
        :returns: as `PublisherListener.names_of`.
        """
        requested = set(gids)
        if not requested <= self._nodes.keys():
            self.query()
        return {gid: self._name_of(gid) for gid in requested}

    def _name_of(self, gid: str) -> str:
        if found := self._nodes.get(gid):
            return found[0]
        if self.present - self._nodes.keys():  # the node of a publisher is not discovered yet
            return UNKNOWN
        topic = self._topics.get(gid)
        # Also publishers that are gone: one of them may have sent the message.
        names = sorted({name for name, each in tuple(self._nodes.values()) if each == topic})
        if len(names) > 1:
            return f'one of {comma_list(names, _SHOWN)}'
        return names[0] if names else UNKNOWN

    def is_present(self, gid: str) -> Optional[bool]:
        """
        Return whether a publisher exists.

        :param gid: the gid of the publisher, in hex.
        :returns: as `PublisherListener.is_present`.
        """
        return True if gid in self.present else False if gid in self._nodes else None

    def add_topic(self, gid: str, topic: str) -> None:
        """
        Keep the topic of a publisher, if its gid may never be found in the ROS graph.

        :param gid: the gid that has arrived with a message on the topic, in hex.
        :param topic: the name of the topic.
        """
        self._topics[gid] = topic
        if len(self._topics) > _MOST_NAMES:
            del self._topics[next(iter(self._topics))]

    def query(self) -> None:
        """
        Query the ROS graph for the publishers and the names of their nodes.

        The table also keeps the names of publishers that are gone. If there are more than
        `_MOST_NAMES` names, the oldest names of such publishers are dropped.
        """
        present = set()
        for topic in self.topics:
            for info in self._node.get_publishers_info_by_topic(topic):
                if info.topic_type != TF_MESSAGE:  # this listener receives nothing from it
                    continue
                gid = gid_of(info)
                present.add(gid)
                if info.node_name != _UNKNOWN_NODE:
                    self._nodes[gid] = full_name(info.node_namespace, info.node_name), topic
        self.present = frozenset(present)
        if (surplus := len(self._nodes) - _MOST_NAMES) > 0:
            gone = [gid for gid in tuple(self._nodes) if gid not in present]
            for gid in gone[:surplus]:
                self._nodes.pop(gid, None)


class _GidSource(SubscriptionSource):
    """
    A source that passes the gid of the publisher as the authority of the transforms.

    The source also keeps the newest messages for `received`.
    """

    def __init__(self, *args: Any, names: _NodeNames) -> None:
        """
        Create the source.

        :param args: the arguments of SubscriptionSource.
        :param names: the table of node names, which the source updates.
        """
        super().__init__(*args)
        names.topics = {topic.name for topic, _, _ in self._topics}
        self._names = names
        #: The takers of the messages of /tf and of /tf_static. All are None if rcl cannot be
        #: called; then no gid is known.
        self._takers = [Taker(topic.handle, ReceivedMessage.of) if rcl_take() else None
                        for topic, _, _ in reversed(self._topics)]
        self._has_gids = all(taker is None or taker.has_gids for taker in self._takers)
        self._has_reception_times = all(taker and taker.has_reception_times
                                        for taker in self._takers)
        self._kept: deque[ReceivedMessage] = deque()
        self._size = self._dropped = 0

    def take(self) -> list[BatchOrRows]:
        """
        Take and decode the messages that have arrived; see `SubscriptionSource.take`.

        :returns: the decoded messages that are not inserted yet.
        """
        try:
            for taker, (topic, _, arrived) in zip(self._takers, reversed(self._topics)):
                if taker is not None:
                    taker.take(topic.max_messages, arrived)
                    continue
                without_gids: list[Any] = []
                topic.take(without_gids)
                arrived += [ReceivedMessage.of(data) for data, _ in without_gids]
        except (InvalidHandle, RCLError):  # if another thread ends the listener
            pass
        for topic, reader, arrived in self._topics:
            if arrived:
                self._count += len(arrived)
                try:
                    for gid, messages in groupby(arrived, attrgetter('publisher')):
                        if not self._has_gids:
                            self._names.add_topic(gid, topic.name)
                        self._batches += reader.read(messages, gid, topic.is_static)
                except Exception as error:  # a bug in this package must not end the thread
                    self._on_fault(error)
                self._keep(arrived, topic.is_static)
        return self._batches

    def end_round(self) -> float:
        """
        Update the names of the nodes; then do the same as `SubscriptionSource.end_round`.

        :returns: how long the thread can pause before its next round (s). It is 0 if a pause
            would count as delay of the messages.
        """
        self._names.query_if_due()
        pause = super().end_round()
        return pause if self._has_reception_times else 0.0

    def _keep(self, messages: list[Any], is_static: bool) -> None:
        """Move messages to `_kept`; if `_kept` is then too large, drop its oldest messages."""
        for message in messages:
            message.is_static = is_static
        size = sum(map(len, messages))
        # The next three lines contain no call, so that Ctrl-C cannot interrupt between them.
        self._size += size
        self._kept += messages
        del messages[:]
        while len(self._kept) > _MOST_MESSAGES or self._size > _MOST_BYTES:
            self._size -= len(self._kept.popleft())
            self._dropped += 1

    def received(self) -> Received:
        """
        Return the kept messages and clear `_kept`; the caller must hold the buffer's lock.

        :returns: the messages that have arrived since the last call.
        """
        received = Received(list(self._kept), self._dropped)
        self._kept.clear()
        self._size = self._dropped = 0
        return received


class PublisherListener(TransformListener):
    """A TransformListener that knows which node has published the newest transform of a frame."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """
        Subscribe and start the thread, as TransformListener does.

        :param args: the arguments of TransformListener. The buffer must be a Buffer,
            MessageBufferCore or BufferCore.
        :param kwargs: the keyword arguments of TransformListener, except `source`.
        """
        node: Any = kwargs.get('node', args[1] if len(args) > 1 else None)
        self._names = names = _NodeNames(node)

        def create_source(*args: Any) -> _GidSource:
            """
            Create the source and keep a reference to it.

            :param args: the arguments of SubscriptionSource.
            :returns: the source.
            """
            self._source = _GidSource(*args, names=names)
            return self._source

        super().__init__(*args, source=create_source, **kwargs)

    @property
    def present(self) -> frozenset[str]:
        """The gids (in hex) of the publishers that exist; updated every half second."""
        return self._names.present

    def publishers(self) -> dict[str, tuple[str, str]]:
        """
        Return the publishers that were found in the ROS graph, also those that are gone.

        :returns: by gid (in hex): the full name of the node, and the topic; at most half a second
            old.
        """
        return self._names.publishers()

    def is_present(self, gid: str) -> Optional[bool]:
        """
        Return whether a publisher exists.

        :param gid: the gid of the publisher, in hex.
        :returns: True if it exists; False if it existed and has ended; None if it is not known:
            the gid was never that of a publisher in the ROS graph.
        """
        return self._names.is_present(gid)

    def received(self) -> Received:
        """
        Return the messages that have arrived since the last call of this method.

        Between two calls, only the newest messages are kept: at most 10 000 messages, and at most
        16 MiB.

        :returns: the messages, and the number of older messages that were dropped.
        """
        with self.buffer.fetched():
            return self._source.received()

    def frames(self) -> list[Frame]:
        """
        Return the frames of the buffer, each with the name of the node that has published it.

        :returns: the frames that have a parent, as `buffer.frames()` returns them. But the
            `authority` of a frame is a name as `names_of` returns it.
        """
        frames: list[Frame] = self.buffer.frames()
        names = self.names_of(frame.authority for frame in frames)
        return [frame._replace(authority=names[frame.authority]) for frame in frames]

    def names_of(self, gids: Iterable[str]) -> dict[str, str]:
        """
        Return the full names of the publishers' nodes.

        :param gids: the gids of the publishers, in hex.
        :returns: a dict from each gid to the name of the node, or to `UNKNOWN`. If the middleware
            does not report gids: to the name of the only node that has published on the topic, or
            to a text such as 'one of /a, /b'.
        """
        return self._names.names_of(gids)
