"""What publishers of transforms send, on all topics, also those of no listener."""

from collections.abc import Sequence
from contextlib import closing, suppress
from threading import Lock
from time import monotonic, sleep
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from puretf._causes.facts import Heard
from puretf._core.frames import is_too_long
from puretf._ros.graph import gid_of, node_of, other_topics, UNKNOWN
from puretf._ros.messages import TFMessage
from puretf._ros.rclpy_private import subscribe
from puretf._ros.subscription import taker
from puretf._text.names import TF_MESSAGE
from puretf._wire import cdr

#: How long `Ear` listens, the time until it listens again, and between two looks (s).
_DURATION, _PAUSE, _POLL_INTERVAL = 0.5, 5.0, 0.01
#: The time between two searches for topics (s).
_SCAN_INTERVAL = 0.5
#: The largest number of topics, and of frames of each publisher.
_MOST_TOPICS, _MOST_FRAMES = 20, 10_000
#: How many messages of a topic are read at most in each `poll`.
_DEPTH = 20
_LATCHED = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)
_OTHER = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)


class TransformSampler:
    """
    Subscriptions to all topics of transforms except some; no executor serves them.

    :meta private:
    """

    def __init__(self, node: Node, own: Sequence[str]) -> None:
        self._node, self._own, self._next_scan = node, own, 0.0
        #: By topic, and whether latched messages of the past are wanted.
        self._subscriptions: dict[tuple[str, bool], tuple[Subscription, Any]] = {}
        #: By topic, then by publisher: the parents.
        self._parents: dict[str, dict[str, dict[str, str]]] = {}
        self._unmapped: list[Node] = []

    def poll(self) -> None:
        """Read what has arrived, and twice a second search for topics."""
        if monotonic() >= self._next_scan:
            self._next_scan = monotonic() + _SCAN_INTERVAL
            self._scan()
        for (topic, _), (_, source) in self._subscriptions.items():
            for data, gid in source.take(_DEPTH):
                parents = self._parents[topic].setdefault(gid if source.has_gids else '', {})
                with suppress(cdr.MalformedMessage):
                    for row in cdr.unpack(data):
                        parent, child = (name.removeprefix('/')
                                         for name in (row.frame_id, row.child_frame_id))
                        if parent and child and not is_too_long(child) and (
                                child in parents or len(parents) < _MOST_FRAMES):
                            parents[child] = parent

    def heard(self) -> list[Heard]:
        """Return what each publisher has sent."""
        found = []
        for topic, by_gid in self._parents.items():
            nodes = self._nodes(topic) if by_gid else {}
            found += [Heard(topic, gid, [nodes[gid]] if gid in nodes else sorted(
                {*nodes.values()}), parents) for gid, parents in by_gid.items()]
        return found

    def is_complete(self) -> bool:
        """Return whether each publisher has sent something, and its node is known."""
        return all(name != UNKNOWN and gid in by_gid for topic, by_gid in self._parents.items()
                   for gid, name in self._nodes(topic).items())

    def close(self) -> None:
        for subscription, _ in self._subscriptions.values():
            subscription.destroy()
        for node in self._unmapped:
            node.destroy_node()

    def _nodes(self, topic: str) -> dict[str, str]:
        """Return by gid the full names of the nodes that publish transforms on a topic."""
        return {gid_of(info): node_of(info)
                for info in self._node_for(topic).get_publishers_info_by_topic(topic)
                if info.topic_type == TF_MESSAGE}

    def _node_for(self, topic: str) -> Node:
        """Return a node that does not remap a topic, as `--namespace` does with /tf."""
        if self._node.resolve_topic_name(topic) == topic:
            return self._node
        if not self._unmapped:
            self._unmapped.append(Node(
                '_tf_other_topics', context=self._node.context, use_global_arguments=False,
                start_parameter_services=False, enable_rosout=False))
        return self._unmapped[0]

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
                    subscription = subscribe(
                        node, TFMessage, topic, lambda _: None,
                        _LATCHED if is_latched else _OTHER, node.default_callback_group)
                    self._subscriptions[topic, is_latched] = subscription, taker(
                        subscription.handle, lambda data, gid, *_: (data, gid))


class Ear:
    """Listens to all topics of transforms for half a second at most, once in five seconds."""

    def __init__(self, node: Node) -> None:
        self._node, self._heard = node, tuple[Heard, ...]()
        self._next, self._lock = 0.0, Lock()

    def listen(self) -> Sequence[Heard]:
        """Return what was heard last."""
        if monotonic() >= self._next and self._lock.acquire(blocking=False):
            try:
                with suppress(Exception):  # the node is destroyed, or ROS shut down
                    self._listen()
            finally:
                self._next = monotonic() + _PAUSE
                self._lock.release()
        return self._heard

    def _listen(self) -> None:
        with closing(TransformSampler(self._node, ())) as sampler:
            deadline = monotonic() + _DURATION
            while monotonic() < deadline:
                sampler.poll()
                if sampler.is_complete():
                    break
                sleep(_POLL_INTERVAL)
            self._heard = *sampler.heard(),
