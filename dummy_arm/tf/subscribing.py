"""Subscriptions to TFMessage that no executor sees, and publishers that do not fit."""

from collections.abc import Callable
from contextlib import suppress
from time import monotonic
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import QoSSubscriptionEventType as EventType
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind, QoSProfile
from rclpy.subscription import Subscription
from rclpy.type_support import check_is_valid_msg_type

from dummy_arm.tf.message import TFMessage

#: How often it is looked for publishers that do not fit (s).
_BETWEEN_LOOKS = 1.0
#: So many messages are taken at once, or as many as the queue has places.
_MOST_AT_ONCE = 1000


def subscribe(node: Node, topic: str, callback: Callable[[TFMessage], None], qos: QoSProfile,
              group: CallbackGroup) -> Subscription:
    """
    Subscribe a node to a topic; only whoever has the subscription can take messages from it.

    :param callback: what the subscription shows as its callback; nobody calls it.
    """
    # As create_subscription does: a generated class loads its type support only when asked to.
    check_is_valid_msg_type(TFMessage)
    with node.handle:
        handle = _rclpy.Subscription(node.handle, TFMessage, topic, qos.get_c_qos_profile())
    return Subscription(handle, TFMessage, topic, callback, group, qos, True,
                        SubscriptionEventCallbacks(use_default_callbacks=False))


def most_at_once(subscription: Subscription) -> int:
    """Tell how many messages are taken at most, so that others have their turn."""
    return max(_MOST_AT_ONCE, int(subscription.qos_profile.depth))


def take_all(subscription: Subscription, messages: list[bytes]) -> None:
    """
    Append the bytes of what has arrived to messages, but not of what arrives for ever meanwhile.

    :raises InvalidHandle: when the subscription was destroyed.
    """
    handle = subscription.handle
    with handle:
        for _ in range(most_at_once(subscription)):
            taken = handle.take_message(TFMessage, True)
            if taken is None:
                break
            messages.append(taken[0])


class Misfits:
    """Warns of publishers of which a subscription gets nothing."""

    def __init__(self, subscription: Subscription) -> None:
        """Begin to look out."""
        self._topic = subscription.topic_name
        self._log = get_logger(subscription.logger_name)
        self._incompatible_qos: Any = None
        with subscription.handle, suppress(UnsupportedEventTypeError):
            self._incompatible_qos = _rclpy.EventHandle(
                subscription.handle, EventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS)
        self._next = 0.0

    def look(self) -> None:
        """Warn, in rclpy's words, of those that came up since the last look; once a second."""
        if self._incompatible_qos is None or (now := monotonic()) < self._next:
            return
        self._next = now + _BETWEEN_LOOKS
        status: Any = self._incompatible_qos.take_event()
        if status is not None and status.total_count_change > 0:
            policy = qos_policy_name_from_kind(status.last_policy_kind)
            self._log.warning(
                f"New publisher discovered on topic '{self._topic}', offering incompatible QoS. "
                f'No messages will be received from it. Last incompatible policy: {policy}. '
                f'Change its {policy}, or the qos of the TransformListener.')

    def close(self) -> None:
        """Let go of the subscription."""
        if self._incompatible_qos is not None:
            self._incompatible_qos.destroy_when_not_in_use()
