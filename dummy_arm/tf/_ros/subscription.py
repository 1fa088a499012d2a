"""The messages of a listener's subscriptions, as a buffer pulls them."""

from collections.abc import Callable
from functools import partial
from itertools import islice
from math import inf
from operator import itemgetter
from time import monotonic
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.logging import get_logger
from rclpy.qos import HistoryPolicy, qos_policy_name_from_kind
from rclpy.subscription import Subscription

from dummy_arm.tf._core.pose import BatchOrRows
from dummy_arm.tf._ros import rclpy_private
from dummy_arm.tf._ros.messages import TFMessage
from dummy_arm.tf._wire.streams import MessageReader

#: The publisher that tf2_ros's listener in Python names.
AUTHORITY = 'default_authority'
#: How often incompatible publishers are looked for (s).
_BETWEEN_LOOKS = 1.0
#: So many messages are taken at once, or as many as the queue has places.
_MOST_AT_ONCE = 1000
#: The longest pause (s).
_LONGEST_PAUSE = 0.1
#: At fewer messages a second there is no pause.
_SLOW = 100.0


class Topic:
    """A subscription whose messages are taken as bytes."""

    def __init__(self, subscription: Subscription, is_static: bool) -> None:
        """Create it for a subscription to /tf, or to /tf_static."""
        self.name: str = subscription.topic_name
        self.handle: Any = subscription.handle
        self.is_static = is_static
        #: So many messages are taken at most, so that a flood does not hold the lock.
        self.most = max(_MOST_AT_ONCE, int(subscription.qos_profile.depth))
        self._take = partial(rclpy_private.take_message, self.handle, TFMessage, True)

    def take(self, messages: list[Any]) -> None:
        """
        Append what has arrived: pairs of bytes and message info.

        One call takes all messages, so that a KeyboardInterrupt cannot come between the taking of
        a message and its appending.

        :raises InvalidHandle: when the subscription was destroyed.
        """
        with self.handle:
            messages.extend(islice(iter(self._take, None), self.most))


class SubscriptionSource:
    """
    The source of a buffer: what arrives on /tf and /tf_static.

    The lock of the buffer is held while messages are taken, so there is no other lock.
    """

    def __init__(self, tf_static: Subscription, tf: Subscription,
                 on_fault: Callable[[Exception], None], wake: Callable[[], None],
                 clock: Callable[[], float] = monotonic) -> None:
        """
        Create the source.

        :param on_fault: is called with the error of each message that cannot be decoded.
        :param wake: has the listener's thread update the buffer now.
        :param clock: returns the time (s).
        """
        self.wake, self._on_fault, self._clock = wake, on_fault, clock
        #: Each with its reader, and with the messages that were taken and are not decoded.
        self._topics: list[tuple[Topic, MessageReader, list[Any]]] = [
            (Topic(tf_static, True), MessageReader(on_fault), []),
            (Topic(tf, False), MessageReader(on_fault), [])]
        #: What was decoded and is not inserted.
        self._batches: list[BatchOrRows] = []
        qos = tf.qos_profile
        self._depth = qos.depth if qos.history == HistoryPolicy.KEEP_LAST else inf
        #: The end of the last round (s), and the number of messages since then.
        self._last, self._count = clock(), 0

    def take(self) -> list[BatchOrRows]:
        """
        Return what has arrived, in a list that is kept; the buffer clears it.

        /tf is taken before /tf_static, but inserted after it: so a transform that was sent after a
        static one is not seen without that.
        """
        try:
            for topic, _, arrived in reversed(self._topics):
                topic.take(arrived)
        except (InvalidHandle, rclpy_private.RCLError):  # the listener is ended concurrently
            pass
        for topic, reader, arrived in self._topics:
            if arrived:
                self._count += len(arrived)
                try:
                    self._batches += reader.read(
                        map(itemgetter(0), arrived), AUTHORITY, topic.is_static)
                except Exception as error:  # a fault of this package
                    self._on_fault(error)
                arrived.clear()
        return self._batches

    def end_round(self) -> float:
        """
        Return for how long the listener's thread may leave messages in the queue (s).

        The thread calls this after each update, without a lock. To be woken costs it more than to
        insert a message. At least half of the queue stays free.
        """
        now = self._clock()
        count, self._count, since, self._last = self._count, 0, now - self._last, now
        if count <= _SLOW * since or self._depth <= 1:
            return 0.0
        if count > 0.75 * self._depth:  # some may have been lost: the rate is higher than that
            return 0.0
        return min(_LONGEST_PAUSE, 0.5 * self._depth * since / count)


class QosMonitor:
    """Warns of publishers whose QoS is incompatible with a subscription."""

    def __init__(self, subscription: Subscription, clock: Callable[[], float] = monotonic
                 ) -> None:
        """
        Create the watch over a subscription.

        :param clock: returns the time (s).
        """
        self._clock = clock
        self._topic = subscription.topic_name
        self._log = get_logger(subscription.logger_name)
        self._incompatible_qos = rclpy_private.incompatible_qos(subscription)
        self._next = 0.0

    def look(self) -> None:
        """Warn, in rclpy's words, of those that came up since the last look; once a second."""
        if self._incompatible_qos is None or (now := self._clock()) < self._next:
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
        """Release the subscription."""
        if self._incompatible_qos is not None:
            self._incompatible_qos.destroy_when_not_in_use()
