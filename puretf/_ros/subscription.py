"""The source from which a buffer takes a listener's messages, and a monitor of the QoS."""

from collections.abc import Callable
from contextlib import suppress
from operator import itemgetter
import sys
from threading import RLock
from time import monotonic
from typing import Any, Optional

from rclpy.exceptions import InvalidHandle
from rclpy.qos import HistoryPolicy, qos_policy_name_from_kind
from rclpy.subscription import Subscription

from puretf._core.pose import BatchOrRows
from puretf._core.texts import ThrottledLog
from puretf._ros.rclpy_private import incompatible_qos, RCLError, take_bytes
from puretf._wire.message_reader import MessageReader

#: The authority that the Python listener of tf2_ros passes with every transform.
AUTHORITY = 'default_authority'
#: The largest number of messages that are taken at once, unless the queue is deeper. The buffer's
#: lock is held meanwhile.
_MAX_MESSAGES = 1000
#: The longest pause of the listener's thread (s).
_LONGEST_PAUSE = 0.1
#: The rate (messages/s) up to which the thread does not pause.
_LOW_RATE = 100.0


class TopicSubscription:
    """A subscription whose messages are taken as bytes."""

    def __init__(self, subscription: Subscription, is_static: bool,
                 on_fault: Callable[[Exception], None]) -> None:
        self.subscription = subscription
        self.is_static = is_static
        qos = subscription.qos_profile
        self.depth = int(qos.depth) if qos.history == HistoryPolicy.KEEP_LAST else sys.maxsize
        self.max_messages = max(_MAX_MESSAGES, self.depth)
        self.reader = MessageReader(on_fault)


class SubscriptionSource:
    """The source from which a buffer takes the messages of /tf and /tf_static."""

    def __init__(self, tf_static: Subscription, tf: Optional[Subscription],
                 on_fault: Callable[[Exception], None], wake: Callable[[], None],
                 clock: Callable[[], float] = monotonic) -> None:
        """
        Create the source.

        :param on_fault: called with the error of each message that cannot be decoded.
        :param wake: a function that makes the listener's thread update the buffer now.
        """
        self.wake, self._clock = wake, clock
        self._subscriptions = [TopicSubscription(each, each is tf_static, on_fault)
                               for each in (tf, tf_static) if each is not None]
        self._depth = self._subscriptions[0].depth
        #: Held while messages are taken; reentrant because a signal handler may close the source.
        self._taking = RLock()
        #: The time of the last call of `next_pause` (s), and the number of messages since then.
        self._last, self._count = clock(), 0

    def is_alive(self) -> bool:
        return True  # the listener's thread removes it

    def take(self) -> list[BatchOrRows]:
        """Take and decode the messages that have arrived; the buffer's lock is held."""
        # The messages of /tf are taken first and inserted last, so that no lookup sees a dynamic
        # transform without a static one that was sent before it.
        arrived, batches = [], []
        with self._taking, suppress(InvalidHandle, RCLError):  # the source is closed
            for subscription in self._subscriptions:
                arrived.append((subscription, self._take(subscription)))
        for subscription, messages in reversed(arrived):
            if messages:
                self._count += len(messages)
                batches += self._read(subscription, messages)
        return batches

    def close(self) -> None:
        """Destroy the subscriptions while no other thread takes messages."""
        with self._taking:
            for subscription in self._subscriptions:
                subscription.subscription.destroy()

    def _take(self, subscription: TopicSubscription) -> list[Any]:
        return take_bytes(subscription.subscription, subscription.max_messages)

    def _read(self, subscription: TopicSubscription, messages: list[Any]) -> list[BatchOrRows]:
        return subscription.reader.read(
            map(itemgetter(0), messages), AUTHORITY, subscription.is_static)

    def next_pause(self) -> float:
        """
        Return for how long (s) the listener's thread may leave messages of /tf in the queue.

        The thread calls this after each update. A wake-up costs more than the insertion of a
        message, so at high rates the thread takes several messages at once. At the current rate,
        they fill at most half of the queue. A lookup may change the count at the same time; then
        one pause is too short or too long.
        """
        now = self._clock()
        count, self._count, since, self._last = self._count, 0, now - self._last, now
        # With a queue that was nearly full, messages may have been lost: the rate is not known.
        if count <= _LOW_RATE * since or count > 0.75 * self._depth:
            return 0.0
        return min(_LONGEST_PAUSE, 0.5 * self._depth * since / count)


class QosMonitor:
    """A monitor that warns of publishers whose QoS is incompatible with a subscription."""

    def __init__(self, subscription: Subscription, log: ThrottledLog) -> None:
        self._topic, self._log = subscription.topic_name, log
        self._event = incompatible_qos(subscription)

    def check(self) -> None:
        """Warn of new incompatible publishers, in the words of rclpy, at most once a second."""
        status: Any = self._event and self._event.take_event()
        if status is not None and status.total_count_change > 0 and self._log.is_due(self._topic):
            policy = qos_policy_name_from_kind(status.last_policy_kind)
            self._log.write(
                f"New publisher discovered on topic '{self._topic}', offering incompatible QoS. "
                f'No messages will be received from it. Last incompatible policy: {policy}. '
                f'Change {policy} of the publisher, or qos or static_qos of the '
                'TransformListener.')

    def close(self) -> None:
        """Release the event, which refers to the subscription."""
        if self._event is not None:
            self._event.destroy_when_not_in_use()
