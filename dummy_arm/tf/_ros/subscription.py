"""The subscriptions of a listener as a source from which a buffer pulls messages."""

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

#: The authority that the Python listener of tf2_ros passes for every transform.
AUTHORITY = 'default_authority'
#: The time between two checks for incompatible publishers (s).
_CHECK_INTERVAL = 1.0
#: The largest number of messages that are taken at once, unless the queue is longer.
_MAX_MESSAGES = 1000
#: The longest pause (s).
_LONGEST_PAUSE = 0.1
#: The rate (messages/s) up to which there is no pause.
_LOW_RATE = 100.0


class Topic:
    """A subscription whose messages are taken as bytes."""

    def __init__(self, subscription: Subscription, is_static: bool) -> None:
        """
        Create the topic of a subscription.

        :param subscription: a subscription to /tf or /tf_static.
        :param is_static: True if it is to /tf_static.
        """
        self.name: str = subscription.topic_name
        self.handle: Any = subscription.handle
        self.is_static = is_static
        #: The largest number of messages to take at once. It bounds how long the lock is held.
        self.max_messages = max(_MAX_MESSAGES, int(subscription.qos_profile.depth))
        self._take = partial(rclpy_private.take_message, self.handle, TFMessage, True)

    def take(self, messages: list[Any]) -> None:
        """
        Take the messages that have arrived.

        One call of C code takes and appends all messages. So no KeyboardInterrupt is raised after
        a message is taken and before it is appended, and no message is lost.

        :param messages: the list to which pairs of bytes and message info are appended.
        :raises InvalidHandle: if the subscription is destroyed.
        """
        with self.handle:
            messages.extend(islice(iter(self._take, None), self.max_messages))


class SubscriptionSource:
    """
    The source from which a buffer pulls the messages of /tf and /tf_static.

    The source has no lock of its own: the buffer holds the buffer's lock when it calls `take`. The
    listener's thread calls `end_round` without a lock. Therefore the number of messages that
    `end_round` uses may be too low.
    """

    def __init__(self, tf_static: Subscription, tf: Subscription,
                 on_fault: Callable[[Exception], None], wake: Callable[[], None],
                 clock: Callable[[], float] = monotonic) -> None:
        """
        Create the source.

        :param tf_static: the subscription to /tf_static.
        :param tf: the subscription to /tf.
        :param on_fault: called with the error of each message that cannot be decoded.
        :param wake: makes the listener's thread update the buffer now.
        :param clock: returns the time (s).
        """
        self.wake, self._on_fault, self._clock = wake, on_fault, clock
        #: The topics, each with its reader and the messages that are taken but not decoded.
        self._topics: list[tuple[Topic, MessageReader, list[Any]]] = [
            (Topic(tf_static, True), MessageReader(on_fault), []),
            (Topic(tf, False), MessageReader(on_fault), [])]
        #: The transforms that are decoded but not inserted.
        self._batches: list[BatchOrRows] = []
        qos = tf.qos_profile
        self._depth = qos.depth if qos.history == HistoryPolicy.KEEP_LAST else inf
        #: The time of the last call of `end_round` (s), and the number of messages since then.
        self._last, self._count = clock(), 0

    def take(self) -> list[BatchOrRows]:
        """
        Take and decode the messages that have arrived.

        /tf is taken before /tf_static, but inserted after it. So if a publisher sends a static
        transform before a dynamic one, no lookup sees the dynamic one without the static one.

        :returns: a list that this source keeps; the buffer clears it after the insertion.
        """
        try:
            for topic, _, arrived in reversed(self._topics):
                topic.take(arrived)
        except (InvalidHandle, rclpy_private.RCLError):  # another thread ends the listener
            pass
        for topic, reader, arrived in self._topics:
            if arrived:
                self._count += len(arrived)
                try:
                    self._batches += reader.read(
                        map(itemgetter(0), arrived), AUTHORITY, topic.is_static)
                except Exception as error:  # a bug in this package must not end the thread
                    self._on_fault(error)
                arrived.clear()
        return self._batches

    def end_round(self) -> float:
        """
        Compute how long the listener's thread may leave messages in the queue.

        The thread calls this after each update, without a lock. It pauses because a wake-up costs
        more than the insertion of a message. If messages arrive as fast as since the last call, at
        least half of the queue stays free during the pause.

        :returns: the pause (s).
        """
        now = self._clock()
        count, self._count, since, self._last = self._count, 0, now - self._last, now
        if count <= _LOW_RATE * since or self._depth <= 1:
            return 0.0
        if count > 0.75 * self._depth:  # messages may have been lost: the rate is not known
            return 0.0
        return min(_LONGEST_PAUSE, 0.5 * self._depth * since / count)


class QosMonitor:
    """A monitor that warns of publishers whose QoS is incompatible with a subscription."""

    def __init__(self, subscription: Subscription, clock: Callable[[], float] = monotonic
                 ) -> None:
        """
        Create the monitor of a subscription.

        :param subscription: the subscription.
        :param clock: returns the time (s).
        """
        self._clock = clock
        self._topic = subscription.topic_name
        self._log = get_logger(subscription.logger_name)
        self._incompatible_qos = rclpy_private.incompatible_qos(subscription)
        self._next = 0.0

    def check(self) -> None:
        """
        Warn if there are new incompatible publishers; check once a second at most.

        The text begins with the warning of rclpy's default callback.
        """
        if self._incompatible_qos is None or (now := self._clock()) < self._next:
            return
        self._next = now + _CHECK_INTERVAL
        status: Any = self._incompatible_qos.take_event()
        if status is not None and status.total_count_change > 0:
            policy = qos_policy_name_from_kind(status.last_policy_kind)
            self._log.warning(
                f"New publisher discovered on topic '{self._topic}', offering incompatible QoS. "
                f'No messages will be received from it. Last incompatible policy: {policy}. '
                f'Change {policy} of the publisher, or qos or static_qos of the '
                'TransformListener.')

    def close(self) -> None:
        """Release the event, which refers to the subscription."""
        if self._incompatible_qos is not None:
            self._incompatible_qos.destroy_when_not_in_use()
