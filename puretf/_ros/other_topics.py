"""Transforms on topics to which a listener does not listen, as when half a robot is namespaced."""

from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from threading import Lock
from time import monotonic, sleep
from typing import Optional

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from puretf._core.frames import is_too_long
from puretf._core.hints import Elsewhere
from puretf._ros.graph import nodes_on, other_topics, UNKNOWN
from puretf._ros.messages import TFMessage
from puretf._ros.rclpy_private import subscribe, take_bytes
from puretf._text.names import TF_MESSAGE
from puretf._wire import cdr

#: How long `OtherTopics` listens, the time until it listens again, and between two looks (s).
_DURATION, _PAUSE, _POLL_INTERVAL = 0.5, 5.0, 0.01
#: The time between two searches for topics (s).
_SCAN_INTERVAL = 0.5
#: The largest number of topics, and of frames of each.
_MOST_TOPICS, _MOST_FRAMES = 20, 10_000
#: How many messages of a topic are read at most in each `poll`.
_DEPTH = 20
_LATCHED = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)
_OTHER = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)


#: A topic, its newest parents by child frame, and the full names of the nodes that publish on it.
TopicFrames = tuple[str, dict[str, str], list[str]]


class TransformSampler:
    """
    Subscriptions to all topics of transforms except some; no executor serves them.

    :meta private:
    """

    def __init__(self, node: Node, own: Sequence[str]) -> None:
        self._node, self._own, self._next_scan = node, own, 0.0
        #: By topic, and whether latched messages of the past are wanted.
        self._subscriptions: dict[tuple[str, bool], Subscription] = {}
        self._parents: dict[str, dict[str, str]] = {}
        self._unmapped: Optional[Node] = None

    def poll(self) -> None:
        """Read what has arrived, and twice a second search for topics."""
        if monotonic() >= self._next_scan:
            self._next_scan = monotonic() + _SCAN_INTERVAL
            self._scan()
        for (topic, _), subscription in self._subscriptions.items():
            parents = self._parents[topic]
            for data, _ in take_bytes(subscription.handle, _DEPTH):
                with suppress(cdr.MalformedMessage):
                    for row in cdr.unpack(data):
                        parent, child = (name.removeprefix('/')
                                         for name in (row.frame_id, row.child_frame_id))
                        if parent and child and not is_too_long(child) and (
                                child in parents or len(parents) < _MOST_FRAMES):
                            parents[child] = parent

    def topics(self) -> list[TopicFrames]:
        """Return the topics on which transforms have arrived."""
        return [(topic, parents, nodes_on(self._node_for(topic), topic))
                for topic, parents in self._parents.items() if parents]

    def close(self) -> None:
        for subscription in self._subscriptions.values():
            subscription.destroy()
        if self._unmapped:
            self._unmapped.destroy_node()

    def _node_for(self, topic: str) -> Node:
        """Return a node that does not remap a topic, as `--namespace` does with /tf."""
        if self._node.resolve_topic_name(topic) == topic:
            return self._node
        if self._unmapped is None:
            self._unmapped = Node(
                '_tf_other_topics', context=self._node.context, use_global_arguments=False,
                start_parameter_services=False, enable_rosout=False)
        return self._unmapped

    def _scan(self) -> None:
        for topic in other_topics(self._node, self._own):
            if topic not in self._parents and len(self._parents) >= _MOST_TOPICS:
                continue
            node = self._node_for(topic)
            offered = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)
                       if info.topic_type == TF_MESSAGE]
            # Latched messages of the past are sent only to a reliable, transient-local reader.
            for is_latched in {(qos.reliability, qos.durability) == (
                    _LATCHED.reliability, _LATCHED.durability) for qos in offered}:
                if (topic, is_latched) not in self._subscriptions:
                    self._parents.setdefault(topic, {})
                    self._subscriptions[topic, is_latched] = subscribe(
                        node, TFMessage, topic, lambda _: None,
                        _LATCHED if is_latched else _OTHER, node.default_callback_group)


class OtherTopics:
    """The edges on other topics; a look may take half a second, once in five seconds."""

    def __init__(self, node: Node, own: Sequence[str]) -> None:
        self._node, self._own = node, own
        self._found: list[TopicFrames] = []
        self._next, self._lock = 0.0, Lock()

    def find(self, is_wanted: Callable[[Elsewhere], bool]) -> Optional[Elsewhere]:
        """Return the first edge that is wanted; None if none is found in time."""
        if monotonic() >= self._next and self._lock.acquire(blocking=False):
            try:
                with suppress(Exception):  # the node is destroyed, or ROS shut down
                    self._look(is_wanted)
            finally:
                self._next = monotonic() + _PAUSE
                self._lock.release()
        return self._first(is_wanted)

    def _look(self, is_wanted: Callable[[Elsewhere], bool]) -> None:
        with closing(TransformSampler(self._node, self._own)) as sampler:
            deadline = monotonic() + _DURATION
            while monotonic() < deadline:
                sampler.poll()
                self._found = sampler.topics()
                if (edge := self._first(is_wanted)) and UNKNOWN not in edge.nodes:
                    return
                sleep(_POLL_INTERVAL)

    def _first(self, is_wanted: Callable[[Elsewhere], bool]) -> Optional[Elsewhere]:
        edges = (Elsewhere(parent, child, topic, nodes) for topic, parents, nodes in self._found
                 for child, parent in parents.items())
        if edge := next(filter(is_wanted, edges), None):
            return edge._replace(siblings={
                child for topic, parents, _ in self._found
                if topic.removesuffix('_static') == edge.base for child in parents})
        return None
