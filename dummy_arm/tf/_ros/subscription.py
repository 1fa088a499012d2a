"""The source from which a buffer pulls a listener's messages, and a monitor of the QoS."""

from collections.abc import Callable
from functools import partial
from itertools import islice
from math import inf
from operator import itemgetter
from time import monotonic
from typing import Any, Optional

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
#: The largest number of messages that are taken at once. If the depth of the queue is larger, the
#: depth is used instead.
_MAX_MESSAGES = 1000
#: The longest pause of the listener's thread (s).
_LONGEST_PAUSE = 0.1
#: The rate (messages/s) up to which the thread does not pause.
_LOW_RATE = 100.0


class Topic:
    """A subscription whose messages are taken as bytes."""

    def __init__(self, subscription: Subscription, is_static: bool) -> None:
        """
        Create the topic of a subscription.

        :param subscription: a subscription to /tf or /tf_static.
        :param is_static: True if the subscription is to /tf_static.
        """
        self.name: str = subscription.topic_name
        self.handle: Any = subscription.handle
        self.is_static = is_static
        #: The largest number of messages that one call of `take` takes. The number is limited,
        #: because the buffer's lock is held during the call.
        self.max_messages = max(_MAX_MESSAGES, int(subscription.qos_profile.depth))
        self._take = partial(rclpy_private.take_message, self.handle, TFMessage, True)

    def take(self, messages: list[Any]) -> None:
        """
        Take the messages that have arrived, at most `max_messages`.

        One call of C code takes and appends all these messages. So a KeyboardInterrupt cannot be
        raised between the taking and the appending of a message, and no message is lost.

        :param messages: the list to which the messages are appended. Each message is appended as a
            pair (bytes, info).
        :raises InvalidHandle: if the subscription is destroyed.
        """
        with self.handle:
            messages.extend(islice(iter(self._take, None), self.max_messages))


class SubscriptionSource:
    """
    The source from which a buffer pulls the messages of /tf and /tf_static.

    The source has no lock of its own. The buffer holds the buffer's lock when it calls `take`. The
    listener's thread calls `end_round` without a lock, so another thread may call `take` at the
    same time. Then `end_round` may use a wrong number of messages, but the only effect is a pause
    that is too short or too long.
    """

    def __init__(self, tf_static: Subscription, tf: Optional[Subscription],
                 on_fault: Callable[[Exception], None], wake: Callable[[], None],
                 clock: Callable[[], float] = monotonic) -> None:
        """
        Create the source.

        :param tf_static: the subscription to /tf_static.
        :param tf: the subscription to /tf; None: there is no such subscription.
        :param on_fault: called with the error of each message that cannot be decoded, and with any
            other error that is raised while messages are decoded.
        :param wake: a function that makes the listener's thread update the buffer now.
        :param clock: a function that returns the time (s).
        """
        self.wake, self._on_fault, self._clock = wake, on_fault, clock
        #: For each topic: the topic, its reader, and its messages that are not decoded yet.
        self._topics: list[tuple[Topic, MessageReader, list[Any]]] = [
            (Topic(subscription, subscription is tf_static), MessageReader(on_fault), [])
            for subscription in (tf_static, tf) if subscription is not None]
        #: The transforms that are decoded but not inserted yet.
        self._batches: list[BatchOrRows] = []
        qos = (tf or tf_static).qos_profile
        self._depth = qos.depth if qos.history == HistoryPolicy.KEEP_LAST else inf
        #: The time of the last call of `end_round` (s), and the number of messages that were
        #: decoded since that call.
        self._last, self._count = clock(), 0

    def take(self) -> list[BatchOrRows]:
        """
        Take and decode the messages that have arrived.

        The messages of /tf are taken first and inserted last. So if a publisher sends a static
        transform before a dynamic transform, no lookup sees the dynamic transform without the
        static transform.

        :returns: the transforms that are decoded but not inserted yet. The buffer must clear this
            list after it has inserted the transforms.
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
        Compute how long the listener's thread may leave messages of /tf in the queue.

        The thread calls this method after each update, without a lock. A wake-up of the thread
        costs more than the insertion of a message. So if many messages arrive, the thread pauses,
        and then takes several messages at once. The pause is so short that messages at the current
        rate fill at most half of the queue.

        :returns: the pause (s); 0 means no pause.
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
        :param clock: a function that returns the time (s).
        """
        self._clock = clock
        self._topic = subscription.topic_name
        self._log = get_logger(subscription.logger_name)
        self._incompatible_qos = rclpy_private.incompatible_qos(subscription)
        self._next = 0.0

    def check(self) -> None:
        """
        Warn if there are new incompatible publishers.

        If the last check was less than 1 s ago, this method does nothing. The warning begins with
        the text that rclpy itself logs for such a publisher.
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
        """Release the event of rclpy that `check` reads; the event refers to the subscription."""
        if self._incompatible_qos is not None:
            self._incompatible_qos.destroy_when_not_in_use()
