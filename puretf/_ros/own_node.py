"""
Receiving by rclpy's public API, where one of its private parts is not as this package needs it.

The messages then arrive in a node of our own, so that the node of the user need not be spun.
"""

from collections import deque
from contextlib import suppress
from functools import cache
from threading import Lock
from typing import Any, Union

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.subscription import Subscription

from puretf._ros.rclpy_private import missing_part, subscribe
from puretf._text.distribution import rclpy_version

#: The largest number of messages that are received in one call.
_MOST = 100


class OwnSubscription:
    """A subscription of an `OwnNode`, with the messages that it has received."""

    def __init__(self, owner: 'OwnNode', message_type: Any, topic: str, qos: QoSProfile,
                 is_polled: bool = False) -> None:
        """
        Subscribe to a topic, which is remapped as for the node of the user.

        :param is_polled: whether `take` receives; it must not while locks are held.
        """
        self._owner, self._is_polled = owner, is_polled
        self._messages: deque[tuple[bytes, Any]] = deque(
            maxlen=qos.depth if qos.history == HistoryPolicy.KEEP_LAST else None)
        add: Any = self._add  # that rclpy passes an info, too, its annotation does not say
        subscription = owner.node.create_subscription(
            message_type, owner.user.resolve_topic_name(topic), add, qos, raw=True)
        self.topic_name: str = subscription.topic_name
        self.qos_profile: QoSProfile = subscription.qos_profile

    def _add(self, data: bytes, info: Any) -> None:
        self._messages.append((data, info))
        self._owner.count += 1

    def take(self, most: int) -> list[tuple[bytes, Any]]:
        """Take at most a number of messages, each as its bytes and its info."""
        if self._is_polled:
            self._owner.wait(0.0)
        return [self._messages.popleft() for _ in range(min(most, len(self._messages)))]

    def destroy(self) -> None:
        self._owner.close()


class OwnNode:
    """A node beside the node of a user; its subscriptions receive while `wait` is called."""

    def __init__(self, node: Node) -> None:
        self.user, self.count = node, 0
        self.node = Node(
            f'{node.get_name()}_tf', namespace=node.get_namespace(), context=node.context,
            use_global_arguments=False, start_parameter_services=False, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(self.node)
        self._receiving, self._is_closed = Lock(), False
        _warn_once(node.get_logger().name)

    def wait(self, limit: float) -> None:
        """Receive what has arrived; wait for it at most a time (s), unless another thread does."""
        if self._receiving.acquire(blocking=False):
            try:
                for _ in range(_MOST):
                    before = self.count
                    self._executor.spin_once(limit)
                    limit = 0.0
                    if self.count == before:
                        break
            except ExternalShutdownException:
                pass
            finally:
                self._receiving.release()
            if self._is_closed:
                self.close()

    def wake(self) -> None:
        pass  # a wait is short

    def close(self) -> None:
        """Destroy the node, now or when the thread that receives has done so."""
        self._is_closed = True
        if self._receiving.acquire(blocking=False):
            try:
                with suppress(Exception):  # ROS has been shut down
                    self._executor.shutdown(0.0)
                    self.node.destroy_node()
            finally:
                self._receiving.release()


def subscribe_to_bytes(node: Node, message_type: Any, topic: str, qos: QoSProfile
                       ) -> Union[Subscription, OwnSubscription]:
    """Create a subscription that no executor of the user serves."""
    if missing_part():
        return OwnSubscription(OwnNode(node), message_type, topic, qos, is_polled=True)
    return subscribe(node, message_type, topic, lambda _: None, qos, node.default_callback_group)


@cache
def _warn_once(logger: str) -> None:
    get_logger(logger).warning(
        f'rclpy {rclpy_version()} differs from 7.1 and 9.1 in {missing_part()}. So transforms '
        'are received in a node of their own, by the executor of rclpy, which takes up to ten '
        'times as much time of a core.')
