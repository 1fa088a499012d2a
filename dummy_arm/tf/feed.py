"""From a listener's subscriptions straight into a buffer."""

from collections.abc import Callable
from contextlib import suppress
from math import inf
from time import monotonic

from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription

from dummy_arm.tf.buffer_core import BufferCore
from dummy_arm.tf.listening import Listening
from dummy_arm.tf.message_reader import MessageReader
from dummy_arm.tf.subscribing import take_all

#: The broadcaster that tf2_ros's listener in Python names.
AUTHORITY = 'default_authority'
#: The longest pause (s); the first, from which they grow: a stream that has just begun is faster
#: than its messages since the last look tell.
_LONGEST_PAUSE, _FIRST_PAUSE = 0.1, 0.01
#: While there are pauses, messages are inserted after so long at the latest (s) ...
_LONGEST_DELAY = 0.3
#: ... or when there are more than so many bytes, since a lookup has to insert them before it.
_MOST_DELAYED = 500_000
#: After a pause the queue has room for so long still (s), or else for three quarters of all.
_RESERVE = 0.1
#: At fewer messages a second there is no pause.
_SLOW = 100.0


class Feed:
    """
    Takes messages and inserts them, in the listener's thread and before every lookup.

    So a lookup has all that has arrived, although the thread pauses while messages come in fast
    and nobody waits for a transform, and inserts many at once. Nothing is taken or inserted
    without the buffer's lock.
    """

    def __init__(self, buffer: BufferCore, tf: Subscription, tf_static: Subscription,
                 listening: Listening, on_fault: Callable[[BaseException], None]) -> None:
        """
        Create a feed; `begin` adds it to the buffer.

        :param listening: the thread that calls `take`.
        :param on_fault: is called with the MalformedMessage of each message that is none, and
            with what goes wrong in a callback of the user.
        """
        self._buffer, self._tf, self._tf_static = buffer, tf, tf_static
        self._listening, self._on_fault = listening, on_fault
        self._reader = MessageReader(on_fault)
        # What was taken and is not in the buffer yet.
        self._arrived: list[bytes] = []
        self._arrived_static: list[bytes] = []
        qos = tf.qos_profile
        self._places = qos.depth if qos.history == HistoryPolicy.KEEP_LAST else inf
        self._is_pausing = self._has_ended = False
        self._pause = 0.0  # the last
        self._has_news = False  # of which nobody was told yet
        self._count = 0  # of messages since the last `take`, which was then:
        self._last = self._last_insertion = monotonic()

    def begin(self) -> None:
        """Have the buffer call `fetch` before every lookup."""
        self._buffer.add_source(self)

    def end(self) -> None:
        """
        Insert what has arrived, and no more from then on.

        Within a block in which this thread holds the lock, what has arrived since its begin is
        left out: the block sees one state.
        """
        is_within_block = self._buffer.is_held
        with self._buffer.lock:
            if not self._has_ended:
                if is_within_block:
                    self._insert_all()  # what was taken before
                else:
                    self.fetch()
            self._has_ended = True
            self._buffer.remove_source(self)
            has_news, self._has_news = self._has_news, False
        if has_news:
            self._wake_waiting()

    def abandon(self) -> None:
        """Take and insert nothing more: this is in a process that was forked."""
        self._has_ended = True

    def fetch(self) -> None:
        """Insert what has arrived on /tf; on /tf_static too, if its thread itself looks up."""
        with suppress(InvalidHandle, _rclpy.RCLError):  # when the listener ends just now
            if self._listening.is_current():
                self._take_static()
            self._take_from(self._tf, self._arrived)
        self._insert_all()
        if self._has_news and not self._is_pausing:
            self._listening.wake()

    def hurry(self) -> None:
        """Take what arrives at once, as long as the buffer is waited for."""
        if self._is_pausing:
            self._listening.wake()

    def take(self) -> tuple[bool, float]:
        """
        Take what has arrived on both topics, for the listener's thread; insert it now or later.

        :returns: whether there is anything new since the last call; and how long to pause (s).
        """
        with self._buffer.lock:
            if self._has_ended:
                return False, 0.0
            self._take_static()
            self._take_from(self._tf, self._arrived)
            now = monotonic()
            count, self._count, since, self._last = self._count, 0, now - self._last, now
            # In this order: who begins to wait either is seen here, or sees the flag.
            self._is_pausing = count > _SLOW * since
            self._is_pausing = self._is_pausing and not self._buffer.is_waited_for
            if (not self._is_pausing or now - self._last_insertion > _LONGEST_DELAY
                    or sum(map(len, self._arrived)) > _MOST_DELAYED):
                self._insert_all()
                self._last_insertion = now
            has_news, self._has_news = self._has_news, False
        if has_news and self._wake_waiting():
            self._listening.wake_executor()
        if not self._is_pausing:
            self._pause = 0.0
            return count > 0, 0.0
        room = self._places * since / count
        self._pause = min(_LONGEST_PAUSE, 2 * self._pause + _FIRST_PAUSE,
                          max(room - _RESERVE, room / 4))
        return True, self._pause

    def _wake_waiting(self) -> bool:
        """Wake those who wait for a transform; tell whether an executor has to be woken."""
        try:
            return self._buffer.on_new_data()
        except BaseException as error:
            # SystemExit of a future's callback does not end the listener's thread; but Ctrl-C, or
            # the exit of a callback, that comes in another thread is of that thread.
            if not isinstance(error, Exception) and not self._listening.is_current():
                raise
            self._on_fault(error)
            return True

    def _take_static(self) -> None:
        self._take_from(self._tf_static, self._arrived_static)
        if self._arrived_static:
            self._insert_all()

    def _take_from(self, subscription: Subscription, arrived: list[bytes]) -> None:
        before = len(arrived)
        self._take_all(subscription, arrived)
        self._count += len(arrived) - before

    def _take_all(self, subscription: Subscription, arrived: list[bytes]) -> None:
        take_all(subscription, arrived)

    def _insert_all(self) -> None:
        self._insert(self._arrived, False)
        self._insert(self._arrived_static, True)

    def _insert(self, arrived: list[bytes], is_static: bool) -> None:
        if not arrived:
            return
        try:
            self._insert_messages(arrived, is_static)
        except Exception as error:  # a fault of this package; the next messages may be good
            self._on_fault(error)
        self._has_news = True
        arrived.clear()

    def _insert_messages(self, messages: list[bytes], is_static: bool) -> None:
        self._buffer.insert_messages(messages, self._reader, AUTHORITY, is_static)
