"""
A listener that knows which node has published a transform.

Each publisher has a *gid*, by which the middleware identifies the publisher. A gid arrives with
each message, and the ROS graph tells to which node the publisher with this gid belongs.
"""

from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from itertools import groupby, islice
from operator import attrgetter
from time import monotonic, time_ns
from typing import Any, NamedTuple, Optional

from rclpy.node import Node
from rclpy.qos import QoSProfile

from puretf._core import hints
from puretf._core.frames import Frame
from puretf._core.pose import BatchOrRows, Row
from puretf._core.texts import comma_list, TF_MESSAGE
from puretf._ros.graph import gid_of, node_of, UNKNOWN
from puretf._ros.other_topics import TransformSampler
from puretf._ros.rclpy_private import rcl_take, subscribe, take_message, Taker
from puretf._ros.subscription import SubscriptionSource, TopicSubscription
from puretf._wire import cdr
from puretf._wire.message_reader import Encoding
from puretf.transform_listener import TransformListener

__all__ = ['UNKNOWN', 'PublisherListener', 'Received', 'ReceivedMessage', 'TopicReader',
           'TransformSampler', 'gid_of', 'node_of']

#: The time between two regular queries of the ROS graph (s).
_QUERY_INTERVAL = 0.5
#: The largest number of node names; beyond it, the oldest names of ended publishers are dropped.
_MOST_NAMES = 10_000
#: The largest number of nodes in a text such as 'one of /a, /b'.
_SHOWN = 5
#: The largest number of messages that are kept for `received`, and of their bytes.
_MOST_MESSAGES, _MOST_BYTES = 10_000, 2**24


class ReceivedMessage(bytes):
    """The bytes of a TFMessage, with the publisher's gid, the time of arrival and the topic."""

    #: The gid of the publisher, in hex; '' if the gid is not known. If the middleware does not
    #: report gids: the bytes that it reports instead, in hex.
    publisher = ''
    time = 0  #: the time of arrival, on the system clock (ns)
    is_static = False  #: True if the message is from /tf_static
    encoding: Encoding = cdr

    @property
    def data(self) -> bytes:
        """The bytes of the message."""
        return self

    @classmethod
    def of(cls, data: bytes, publisher: str = '', time: int = 0) -> 'ReceivedMessage':
        """Create a message; a time of 0 is replaced by the current time."""
        message = cls(data)
        message.publisher, message.time = publisher, time or time_ns()
        return message

    def rows(self) -> list[Row]:
        """
        Return the transforms of the message, unchanged: names may have a leading slash.

        :returns: for each transform: `stamp_ns`, `frame_id`, `child_frame_id` and `pose`. The pose
            is x, y, z (m) and the quaternion x, y, z, w, which may have any norm.
        :raises ValueError: if the bytes are not those of a TFMessage.
        """
        return cdr.unpack(self)


class Received(NamedTuple):
    """The messages that have arrived since the last call of `PublisherListener.received`."""

    messages: list[ReceivedMessage]  #: the messages of each topic are in the order of arrival
    dropped: int  #: the number of older messages that were dropped, to limit the memory


class _GidSource(SubscriptionSource):
    """A source with the gid of the publisher as authority; it keeps the newest messages."""

    def __init__(self, *args: Any, query: Callable[[], None], add_topic: Callable[[str, str], None]
                 ) -> None:
        super().__init__(*args)
        self._query, self._add_topic = query, add_topic
        #: By subscription. Empty if rcl cannot be called; then no gid is known.
        self._takers = {each: Taker(each.handle, ReceivedMessage.of)
                        for each in self._subscriptions if rcl_take()}
        self._has_gids = all(taker.has_gids for taker in self._takers.values())
        self._has_reception_times = bool(self._takers) and all(
            taker.has_reception_times for taker in self._takers.values())
        self._kept: deque[ReceivedMessage] = deque()
        self._size = self._dropped = 0

    def _take(self, subscription: TopicSubscription) -> list[ReceivedMessage]:
        if taker := self._takers.get(subscription):
            return taker.take(subscription.max_messages)
        return [ReceivedMessage.of(data) for data, _ in subscription.take()]

    def _read(self, subscription: TopicSubscription, messages: list[Any]) -> list[BatchOrRows]:
        self._keep(messages, subscription.is_static)
        batches: list[BatchOrRows] = []
        for gid, group in groupby(messages, attrgetter('publisher')):
            if not self._has_gids:
                self._add_topic(gid, subscription.name)
            batches += subscription.reader.read(group, gid, subscription.is_static)
        return batches

    def _keep(self, messages: list[ReceivedMessage], is_static: bool) -> None:
        for message in messages:
            message.is_static = is_static
        self._kept += messages
        self._size += sum(map(len, messages))
        while len(self._kept) > _MOST_MESSAGES or self._size > _MOST_BYTES:
            self._size -= len(self._kept.popleft())
            self._dropped += 1

    def next_pause(self) -> float:
        self._query()
        pause = super().next_pause()
        # A pause would count as delay of the messages.
        return pause if self._has_reception_times else 0.0

    def received(self) -> Received:
        received = Received(list(self._kept), self._dropped)
        self._kept.clear()
        self._size = self._dropped = 0
        return received


class PublisherListener(TransformListener):
    """
    A TransformListener that knows which node has published the newest transform of a frame.

    With some middleware, the number that arrives with a message is not the gid of any publisher in
    the ROS graph. Then the node is known only if no other node has published on the topic.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """
        Subscribe and start the thread, as TransformListener does.

        :raises TypeError: if the listener would use subscriptions of the node; see
            `TransformListener`.
        """
        #: By gid: the name of the node, and the topic; also of publishers that are gone.
        self._nodes: dict[str, tuple[str, str]] = {}
        #: By gid: the topic, if the gid may never be that of a publisher in the ROS graph.
        self._topics: dict[str, str] = {}
        self._next_query = 0.0
        self._present: frozenset[str] = frozenset()
        super().__init__(*args, **kwargs)
        if self._uses_callbacks:
            self.unregister()
            raise TypeError('a PublisherListener needs a buffer of puretf and no overridden '
                            f'callbacks or setters, got {self.buffer!r}')

    def _create_source(self, *args: Any) -> SubscriptionSource:
        return _GidSource(*args, query=self._query_if_due, add_topic=self._add_topic)

    @property
    def present(self) -> frozenset[str]:
        """The gids (in hex) of the publishers that exist; updated every half second."""
        return self._present

    def publishers(self) -> dict[str, tuple[str, str]]:
        """
        Return the publishers that were found in the ROS graph, also those that are gone.

        :returns: by gid (in hex): the full name of the node, and the topic. The ROS graph is
            queried every half second.
        """
        self._query_if_due()
        return dict(self._nodes)

    def is_present(self, gid: str) -> Optional[bool]:
        """
        Return whether a publisher exists.

        :returns: True if it exists; False if it existed and has ended; None if the gid (in hex)
            was never that of a publisher in the ROS graph.
        """
        return True if gid in self._present else False if gid in self._nodes else None

    def received(self) -> Received:
        """
        Return the messages that have arrived since the last call of this method.

        Between two calls, only the newest messages are kept: at most 10 000, and at most 16 MiB.
        """
        with self.buffer.updated():
            received: Received = self._source.received()
            return received

    def frames(self) -> list[Frame]:
        """
        Return the frames of the buffer, each with the name of the node that has published it.

        :returns: the frames that have a parent, as `buffer.frames()` returns them, but with the
            name from `names_of` as the `authority`.
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
        requested = set(gids)
        if not requested <= self._nodes.keys():
            self._query()
        return {gid: self._name_of(gid) for gid in requested}

    def wrong_type_hint(self) -> str:
        """Return who publishes another type than TFMessage on the topics; '' if nobody does."""
        return hints.wrong_type(self._surroundings())

    def other_topics_hint(self) -> str:
        """
        Return which other topics have transforms, and how to receive them.

        It is '' if a dynamic transform was received or has a publisher here, or if a static one
        was received in a namespace.
        """
        return hints.other_topics(self._surroundings())

    def topics_hint(self) -> str:
        """Return why transforms may not arrive; '' if there is no sign of it."""
        return hints.topics(self._surroundings())

    def why_nothing(self) -> str:
        """Return why nothing at all was received; '' if something was."""
        around = self._surroundings()
        return hints.topics(around) or hints.nothing(around)

    def _surroundings(self) -> hints.Surroundings:
        return super()._surroundings()._replace(ended={
            gid: node for gid, (node, _) in tuple(self._nodes.items())
            if gid not in self._present})

    def _name_of(self, gid: str) -> str:
        if found := self._nodes.get(gid):
            return found[0]
        if self._present - self._nodes.keys():  # the node of a publisher is not discovered yet
            return UNKNOWN
        topic = self._topics.get(gid)
        # Also publishers that are gone: one of them may have sent the message.
        names = sorted({name for name, each in tuple(self._nodes.values()) if each == topic})
        if len(names) > 1:
            return f'one of {comma_list(names, _SHOWN)}'
        return names[0] if names else UNKNOWN

    def _add_topic(self, gid: str, topic: str) -> None:
        """Keep the topic of a publisher, because its gid may never be in the ROS graph."""
        self._topics[gid] = topic
        if len(self._topics) > _MOST_NAMES:
            del self._topics[next(iter(self._topics))]

    def _query_if_due(self) -> None:
        """Query the graph regularly, so that the names of nodes that end are known afterwards."""
        if (now := monotonic()) >= self._next_query:
            self._next_query = now + _QUERY_INTERVAL
            self._query()

    def _query(self) -> None:
        """Query the ROS graph for the publishers and the names of their nodes."""
        present = set()
        for topic in {each.topic_name for each in self.subscriptions}:
            for info in self.node.get_publishers_info_by_topic(topic):
                if info.topic_type != TF_MESSAGE:  # this listener receives nothing from it
                    continue
                gid = gid_of(info)
                present.add(gid)
                if (name := node_of(info)) != UNKNOWN:
                    self._nodes[gid] = name, topic
        self._present = frozenset(present)
        if (surplus := len(self._nodes) - _MOST_NAMES) > 0:
            gone = [gid for gid in tuple(self._nodes) if gid not in present]
            for gid in gone[:surplus]:
                self._nodes.pop(gid, None)


class TopicReader:
    """
    A subscription to a topic of any type, whose messages are taken as bytes with their publishers.

    No executor serves it. It must be closed before its node is destroyed.

    :meta private:
    """

    def __init__(self, node: Node, message_type: Any, topic: str, qos: QoSProfile) -> None:
        self._node, self.topic, self._type, self._depth = node, topic, message_type, qos.depth
        self._subscription = subscribe(
            node, message_type, topic, lambda _: None, qos, node.default_callback_group)
        self._taker = Taker(
            self._subscription.handle, ReceivedMessage.of) if rcl_take() else None
        #: False if it is not known which publisher has sent a message.
        self.has_gids = self._taker is not None and self._taker.has_gids
        self._nodes: dict[str, str] = {}
        self._next_query = 0.0

    def take(self) -> list[ReceivedMessage]:
        """Take the messages in the queue."""
        if self._taker:
            messages = self._taker.take(self._depth)
        else:
            handle = self._subscription.handle
            with handle:
                messages = [ReceivedMessage.of(taken[0]) for taken in islice(iter(partial(
                    take_message, handle, self._type, True), None), self._depth)]
        if monotonic() >= self._next_query and any(
                each.publisher not in self._nodes for each in messages):
            self._next_query = monotonic() + _QUERY_INTERVAL
            self._query()
        return messages

    def names_of(self, gids: Iterable[str]) -> dict[str, str]:
        """Return by gid the full name of the publisher's node, or UNKNOWN."""
        requested = set(gids)
        if not requested <= self._nodes.keys():
            self._query()
        return {gid: self._nodes.get(gid, UNKNOWN) for gid in requested}

    def _query(self) -> None:
        for info in self._node.get_publishers_info_by_topic(self.topic):
            if (name := node_of(info)) != UNKNOWN and len(self._nodes) < _MOST_NAMES:
                self._nodes[gid_of(info)] = name

    def close(self) -> None:
        self._subscription.destroy()
