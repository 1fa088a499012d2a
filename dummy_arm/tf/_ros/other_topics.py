"""Transforms on topics to which a listener does not listen, as when half a robot is namespaced."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from threading import Lock
from time import monotonic, sleep
from typing import Optional

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from dummy_arm.tf._core.hints import Elsewhere
from dummy_arm.tf._ros.graph import node_of, other_topics
from dummy_arm.tf._ros.messages import TFMessage
from dummy_arm.tf._ros.rclpy_private import subscribe, take_message
from dummy_arm.tf._wire import cdr

#: How long to listen, and the time from one look to the next (s).
_DURATION, _PAUSE = 0.5, 10.0
_POLL_INTERVAL = 0.01
#: The largest number of topics, and of edges that are kept.
_MOST_TOPICS, _MOST_EDGES = 20, 10_000


class OtherTopics:
    """The edges on other topics; a look at them may take half a second, once in ten seconds."""

    def __init__(self, node: Node, own: list[str]) -> None:
        self._node, self._own = node, own
        self._edges: dict[Elsewhere, None] = {}
        self._next, self._lock = 0.0, Lock()

    def find(self, is_wanted: Callable[[Elsewhere], bool]) -> Optional[Elsewhere]:
        """Return the first edge that is wanted; None if none is found in time."""
        for edge in tuple(self._edges):
            if is_wanted(edge):
                return self._with_nodes(edge)
        if monotonic() < self._next or not self._lock.acquire(blocking=False):
            return None
        try:
            self._edges = {}
            for edge in self._listen():
                if len(self._edges) < _MOST_EDGES:
                    self._edges[edge] = None
                if is_wanted(edge):
                    return self._with_nodes(edge)
            return None
        finally:
            self._next = monotonic() + _PAUSE
            self._lock.release()

    def _with_nodes(self, edge: Elsewhere) -> Elsewhere:
        infos = self._node.get_publishers_info_by_topic(edge.topic)
        return edge._replace(nodes=sorted({node_of(info) for info in infos}))

    def _listen(self) -> Iterator[Elsewhere]:
        subscriptions: list[Subscription] = []
        try:
            for topic in other_topics(self._node, self._own)[:_MOST_TOPICS]:
                subscriptions.append(self._subscribe(topic))
            deadline = monotonic() + _DURATION
            while monotonic() < deadline:
                for subscription in subscriptions:
                    while taken := self._take(subscription):
                        with suppress(cdr.MalformedMessage):
                            for row in cdr.unpack(taken[0]):
                                yield Elsewhere(
                                    row.frame_id.removeprefix('/'),
                                    row.child_frame_id.removeprefix('/'),
                                    subscription.topic_name)
                sleep(_POLL_INTERVAL)
        finally:
            for subscription in subscriptions:
                subscription.destroy()

    @staticmethod
    def _take(subscription: Subscription) -> Optional[tuple[bytes, object]]:
        with subscription.handle:
            return take_message(  # type: ignore[no-any-return]
                subscription.handle, TFMessage, True)

    def _subscribe(self, topic: str) -> Subscription:
        """Subscribe with a QoS that matches that of all publishers."""
        offered = [info.qos_profile for info in self._node.get_publishers_info_by_topic(topic)]
        is_reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in offered)
        is_latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offered)
        qos = QoSProfile(
            depth=100,
            reliability=(ReliabilityPolicy.RELIABLE if is_reliable
                         else ReliabilityPolicy.BEST_EFFORT),
            durability=(DurabilityPolicy.TRANSIENT_LOCAL if is_latched
                        else DurabilityPolicy.VOLATILE))
        return subscribe(self._node, TFMessage, topic, lambda _: None, qos,
                         ReentrantCallbackGroup())
