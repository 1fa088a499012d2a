"""Readers of any topics, whose messages are taken as bytes, and the publishers of the messages."""

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress
from time import monotonic, time_ns
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from puretf._causes.facts import UNKNOWN
from puretf._ros.graph import nodes_by_gid
from puretf._ros.own_node import subscribe_to_bytes
from puretf._ros.rclpy_private import Taker
from puretf._wire.received_message import ReceivedMessage

#: The time between two searches for topics (s).
_SCAN_INTERVAL = 0.5
#: With more names, the oldest ones of publishers that are gone are dropped.
_MOST_NAMES = 10_000
_LATCHED = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
_OTHER = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE


class Publishers:
    """
    The publishers on some topics in the ROS graph, also those that are gone.

    :param type_name: the type of their messages; '': any.
    """

    def __init__(self, node: Node, topics: Collection[str], type_name: str = '') -> None:
        self._node, self._topics, self._type = node, topics, type_name
        #: By gid: the name of the node, and the topic; also of publishers that are gone.
        self.nodes: dict[str, tuple[str, str]] = {}
        #: The gids of the publishers that exist.
        self.present: frozenset[str] = frozenset()
        self._next_query = 0.0

    def query_if_due(self) -> None:
        """Query every half second, so that the names of nodes that end are known afterwards."""
        if (now := monotonic()) >= self._next_query:
            self._next_query = now + 0.5
            self._query()

    def _query(self) -> None:
        found = {topic: nodes_by_gid(self._node, topic, self._type) for topic in self._topics}
        for topic, nodes in found.items():
            self.nodes.update((gid, (name, topic)) for gid, name in nodes.items()
                              if name != UNKNOWN)
        self.present = frozenset().union(*found.values())
        gone = [gid for gid in tuple(self.nodes) if gid not in self.present]
        for gid in gone[:max(0, len(self.nodes) - _MOST_NAMES)]:
            self.nodes.pop(gid, None)

    def names_of(self, gids: Iterable[str]) -> dict[str, str]:
        """Return by gid the full name of the publisher's node, or UNKNOWN."""
        requested = set(gids)
        if not requested <= self.nodes.keys():
            self._query()
        return {gid: self.nodes.get(gid, (UNKNOWN, ''))[0] for gid in requested}


class TopicReader(Publishers):
    """
    A subscription to a topic of any type, whose messages are taken as bytes with their publishers.

    It matches all publishers; or, if it also receives the latched messages of the past, those that
    latch. No executor serves it. It must be closed before its node is destroyed.
    """

    def __init__(self, node: Node, message_type: Any, topic: str, depth: int,
                 is_latched: bool = False) -> None:
        self.begin, self._depth = time_ns(), depth
        reliability, durability = _LATCHED if is_latched else _OTHER
        qos = QoSProfile(depth=depth, reliability=reliability, durability=durability)
        #: The time of the last `take`, and the shortest time between sending and arrival (ns).
        self._last_take, self._delay = self.begin, 2**63
        self._subscription = subscribe_to_bytes(node, message_type, topic, qos)
        self._taker = Taker(self._subscription)
        self.topic: str = self._subscription.topic_name  #: after remapping
        super().__init__(node, [topic])

    def take(self) -> list[ReceivedMessage]:
        last, self._last_take = self._last_take, time_ns()
        messages = [ReceivedMessage.of(*each) for each in self._taker.take(self._depth)]
        if not self._taker.has_reception_times:
            # They are estimated, since a message may have arrived at any time since the last call.
            for each in messages:
                self._delay = min(self._delay, each.time - each.sent)
                each.time = max(last, each.sent + self._delay)
        if any(each.publisher not in self.nodes for each in messages):
            self.query_if_due()
        return messages

    def close(self) -> None:
        self._subscription.destroy()


class TopicWatch:
    """
    Readers of the topics that are wanted, which are searched for twice a second.

    A topic has a reader with QoS best effort, and one for the latched messages of the past, each
    if the publishers need it. All must be closed before the node is destroyed.
    """

    def __init__(self, node: Node, wants: Callable[[], Iterable[tuple[str, Any]]], limit: int,
                 depth: int) -> None:
        """
        Search for nothing yet.

        :param wants: returns topics and the types of their messages.
        :param limit: the largest number of topics.
        :param depth: that of the queue of a reader.
        """
        self._node, self._wants, self._limit = node, wants, limit
        self._depth, self._next_scan = depth, 0.0
        #: By topic, and whether latched messages of the past are read.
        self.readers: dict[str, dict[bool, TopicReader]] = {}
        self._unmapped: list[Node] = []

    def poll(self) -> None:
        """Search for topics if it is time."""
        if monotonic() >= self._next_scan:
            self._next_scan = monotonic() + _SCAN_INTERVAL
            for topic, message_type in self._wants():
                # A topic without readers was refused, and would be refused again.
                if self.readers.get(topic, len(self.readers) < self._limit):
                    self._read(topic, message_type)

    def take(self, topic: str) -> Iterator[tuple[ReceivedMessage, bool]]:
        """
        Take the messages of a topic.

        :returns: each with whether it is new; False: it was sent before the reader existed, or the
            other reader has it, too.
        """
        readers = self.readers.get(topic, {})
        for is_latched, reader in readers.items():
            for message in reader.take():
                yield message, not is_latched or (
                    False not in readers and message.sent > reader.begin)

    def node_for(self, topic: str) -> Node:
        """Return a node that does not remap a topic, as `--namespace` does with /tf."""
        if self._node.resolve_topic_name(topic) == topic:
            return self._node
        if not self._unmapped:
            self._unmapped.append(Node(
                '_tf_other_topics', context=self._node.context, use_global_arguments=False,
                start_parameter_services=False, enable_rosout=False))
        return self._unmapped[0]

    def _read(self, topic: str, message_type: Any) -> None:
        node, readers = self.node_for(topic), self.readers.setdefault(topic, {})
        for is_latched in {(info.qos_profile.reliability, info.qos_profile.durability) == _LATCHED
                           for info in node.get_publishers_info_by_topic(topic)} or {False}:
            if is_latched not in readers:
                with suppress(RuntimeError):  # this node listens to another type on the topic
                    readers[is_latched] = TopicReader(
                        node, message_type, topic, self._depth, is_latched)

    def leave(self, topic: str) -> None:
        """Close the readers of a topic, until it is wanted again."""
        for reader in self.readers.pop(topic, {}).values():
            reader.close()

    def close(self) -> None:
        for topic in [*self.readers]:
            self.leave(topic)
        for node in self._unmapped:
            node.destroy_node()
