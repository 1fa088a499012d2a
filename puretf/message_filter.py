"""A filter that passes messages on when their transforms are available, like that of tf2_ros."""

# Before the packages of ROS, to say how to install them.
from puretf._ros.qos import check_node

# isort: split
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from inspect import iscoroutine
from itertools import islice
from typing import Any, Union

from rclpy.clock import Clock, TimeJump
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from puretf._core.engine import engine_of
from puretf._core.filter_queue import Entry, FilterQueue
from puretf._core.filter_queue import FilterFailureReason as FilterFailureReason
from puretf._core.texts import ThrottledLog
from puretf._core.times import nanoseconds, nanoseconds_or_int
from puretf._ros.rclpy_private import guard_condition, RCLError
from puretf._text.names import shortened, visible
from puretf._text.times import display_time, SECOND
from puretf.buffer import create_jump_handle
from puretf.buffer_core import BufferCore
from puretf.exceptions import described

#: tf2's texts for the log, in the order of the reasons.
_TEXTS = (
    'unknown',
    'the timestamp on the message is earlier than all the data in the transform cache',
    'the frame id of the message is empty',
    'did not find a valid transform, this usually happens at startup ...',
    'discarding message because the queue is full')


class MessageFilter:
    """
    A filter that holds each message back until its transforms are available.

    A message has its transforms when it can be transformed to every target frame at the stamp of
    its header and, with a tolerance, also at the stamp plus the tolerance. Otherwise it waits in a
    queue, and is passed on as soon as it has them; other messages that wait do not hold it back.
    Messages that can be passed on at the same moment are passed on in the order of their stamps.
    In the callbacks, `buffer.transform` and `buffer.lookup_transform` therefore need no timeout.

    The callbacks are called by the executor that spins the node, in the default callback group of
    the node. When the clock of the node jumps back by 1 s or more, or switches between system time
    and simulated time, all messages in the filter are dropped, as `clear` does. The filter ends
    when its node is destroyed.

    The methods have the names of tf2_ros::MessageFilter, which exists in C++ only.
    """

    def __init__(self, input: Any, buffer: BufferCore,  # noqa: A002
                 target_frames: Union[str, Iterable[str]], queue_size: int, node: Node, *,
                 tolerance: Union[Duration, int] = 0,
                 buffer_timeout: Union[Duration, int, None] = None) -> None:
        """
        Create the filter, and connect it to its input.

        :param input: a tuple (message type, topic, QoS), an object with the method
            `registerCallback` (such as a Subscriber of message_filters), or None: messages are
            only added by `add`. A message must have a `header`.
        :param target_frames: one or several names. While there is none, new messages are ignored,
            as in tf2, and messages that wait go on waiting.
        :param queue_size: the largest number of messages that wait; 0: any number. If the queue is
            full, the message that has waited longest is dropped.
        :param node: the node that subscribes, and whose executor calls the callbacks.
        :param tolerance: a Duration, or an int (ns). If it is not 0, a message also needs its
            transforms at its stamp plus the tolerance.
        :param buffer_timeout: how long a message waits at most, on the wall clock: a Duration, or
            an int (ns); None: no limit. While a message waits, the thread of the listener does not
            pause. So set a timeout if some transforms may never come.
        :raises ValueError: if a target frame has no name, or if the queue size or the timeout is
            negative.
        """
        check_node(node, 'MessageFilter(input, buffer, target_frames, queue_size, node)')
        self._buffer, self._engine, self._node = buffer, engine_of(buffer), node
        self._queue = FilterQueue(
            buffer, _frame_names(target_frames), nanoseconds_or_int(tolerance, 'tolerance'),
            _checked_size(queue_size))
        #: How many messages were dropped for each reason.
        self.dropped = self._queue.dropped
        self._on_pass: list[Callable[[Entry], object]] = []
        self._on_drop: list[Callable[[Entry], object]] = []
        self._log = ThrottledLog(node.get_logger().warning)
        self._has_ended = False
        self._timer: Any = None
        self._subscription: Any = None
        #: The callback of the current input.
        self._receive: object = None
        self._guard = guard_condition(node, node.default_callback_group, self._end, self._deliver)
        try:
            if buffer_timeout is not None:
                self._timeout = timeout = nanoseconds_or_int(buffer_timeout, 'buffer_timeout')
                if timeout < 0:
                    raise ValueError(f'buffer_timeout must not be negative, got {timeout} ns')
                clock = Clock(clock_type=ClockType.STEADY_TIME)
                self._timer = node.create_timer(1, self._on_timeout, clock=clock, autostart=False)
            self._jump_handle = create_jump_handle(node.get_clock(), self)
            self._engine.add_waiter(self)
            if input is not None:
                self.connectInput(input)
        except BaseException:
            self.unregister()
            raise

    @property
    def is_waiting(self) -> bool:
        """True if a message waits for its transforms."""
        return bool(self._queue.waiting)

    def unregister(self) -> None:
        """Drop all messages, and end the filter for good; callbacks that are running go on."""
        self._node.destroy_guard_condition(self._guard)  # calls `_end`, but only once

    def _end(self) -> None:
        self._has_ended = True
        self._engine.remove_waiter(self)
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_timer(self._timer)
        self.clear()

    # Input

    def connectInput(self, input: Any) -> None:  # noqa: A002, N802
        """
        Connect the filter to another input; messages of the previous input are ignored.

        :param input: as for the constructor, but not None.
        :raises RuntimeError: if the filter has ended.
        """
        if self._has_ended:
            raise RuntimeError('the filter has ended, because of unregister or destroy_node')

        def receive(message: Any, *, deliver: Callable[[], None] = self._trigger) -> None:
            if self._receive is receive:  # message_filters cannot unregister a callback
                self._put(message)
                deliver()

        if hasattr(input, 'registerCallback'):
            subscription = None
        elif not (isinstance(input, Sequence) and len(input) == 3 and isinstance(input[0], type)):
            raise TypeError('input must be a tuple (message type, topic, QoS) or an object with '
                            f'the method registerCallback, got {described(input)}')
        elif not hasattr(input[0], 'header'):
            raise TypeError(f'messages must have a header, but {input[0].__name__} has none')
        else:
            # The executor calls this function, so the callbacks of the filter are called at once.
            subscription = self._node.create_subscription(
                input[0], input[1], partial(receive, deliver=self._deliver), input[2])
        self._node.destroy_subscription(self._subscription)
        self._receive, self._subscription = receive, subscription
        if subscription is None:
            input.registerCallback(receive)

    def add(self, message: Any) -> None:
        """
        Add a message with a header; any thread may call this method.

        If messages are added faster than the executor can call the callbacks, they collect in
        memory: the size of the queue limits only the messages that wait for transforms.
        """
        self._put(message)
        self._trigger()

    def _put(self, message: Any) -> None:
        header: Any = getattr(message, 'header', None)
        if not (hasattr(header, 'stamp') and hasattr(header, 'frame_id')):
            raise TypeError('a message must have a header with stamp and frame_id, got '
                            f'{type(message).__name__}')
        if self._has_ended or not self._queue.targets:
            return
        new, oldest = self._queue.put(nanoseconds(header.stamp), header.frame_id, message)
        if oldest is new:
            self._engine.wake_sources()  # so that the thread of the listener does not pause
        elif oldest and (waited := new.arrival - oldest.arrival) > 2 * SECOND and (
                self._log.is_due('waiting', 10.0)):
            self._log.write(
                f"Messages wait for their transforms. The oldest, of frame "
                f"'{shortened(oldest.frame)}' at time {display_time(oldest.stamp)}, has waited "
                f'for {waited / SECOND:.1f} s.{self._why_not(oldest)}')
        self._limit()

    def clear(self) -> None:
        """Drop all messages in the filter; no callback is called for them, not even a failure."""
        self._queue.clear()

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Drop all messages, because the clock of the node has jumped back or was switched."""
        if (self._queue.waiting or self._queue.due) and self._log.is_due('jump'):
            self._log.write('Detected jump back in time. Clearing the message filter.')
        self.clear()

    # Settings

    def setTargetFrame(self, target_frame: str) -> None:  # noqa: N802
        """Set one target frame, also for the messages that wait."""
        self.setTargetFrames([target_frame])

    def setTargetFrames(self, target_frames: Union[str, Iterable[str]]) -> None:  # noqa: N802
        """Set the target frames, as in the constructor, also for the messages that wait."""
        self._queue.targets = _frame_names(target_frames)
        self._restart()

    def setTolerance(self, tolerance: Union[Duration, int]) -> None:  # noqa: N802
        """Set the tolerance (a Duration, or ns), also for the messages that wait."""
        self._queue.tolerance = nanoseconds_or_int(tolerance, 'tolerance')
        self._restart()

    def setQueueSize(self, queue_size: int) -> None:  # noqa: N802
        """Set the largest number of messages that wait; 0: any number; drop surplus messages."""
        self._queue.size = _checked_size(queue_size)
        self._restart()

    def getQueueSize(self) -> int:  # noqa: N802
        """Return the largest number of messages that wait; 0: any number."""
        return self._queue.size

    def _restart(self) -> None:
        """Check all messages again, also those that are due, but not passed on yet."""
        self._queue.restart()
        self._engine.wake_sources()
        self._limit()
        self._trigger()

    # Checks

    def check(self) -> bool:
        """
        Make the executor pass on the messages whose transforms are available.

        The buffer calls this after insertions. The result tells it to wake no executor.
        """
        self._queue.ready()
        self._trigger()
        return False

    def _limit(self) -> None:
        """Drop messages that are too many or wait too long; start the timer if others wait."""
        self._queue.shorten()
        remaining = self._timer and self._queue.expire(self._timeout)
        with suppress(InvalidHandle, RCLError):  # if the filter is ended at this moment
            if remaining and self._timer.is_canceled():
                self._timer.timer_period_ns = min(remaining, 3600 * SECOND)
                self._timer.reset()
                self._guard.trigger()  # so that the executor heeds the timer

    def _on_timeout(self) -> None:
        with suppress(InvalidHandle):  # if the filter is ended at this moment
            self._timer.cancel()
        self._queue.ready()
        self._limit()
        self._deliver()

    # Output

    def registerCallback(self, callback: Callable[..., object], *args: Any) -> None:  # noqa: N802
        """
        Register a function, or coroutine function, that is called with each message passed on.

        :param args: further arguments of the function, after the message.
        """
        _check_callable(callback)
        self._on_pass.append(lambda entry: callback(entry.message, *args))

    def registerFailureCallback(  # noqa: N802
            self, callback: Callable[[Any, FilterFailureReason], object]) -> None:
        """
        Register a function that is called with each message that is dropped, and the reason.

        It may be a coroutine function. Without such a function, dropped messages are logged.
        """
        _check_callable(callback)
        self._on_drop.append(lambda entry: callback(entry.message, entry.reason))

    def _trigger(self) -> None:
        """Make the executor call `_deliver` if messages are due."""
        with suppress(InvalidHandle, RCLError):  # if the filter is ended at this moment
            if self._queue.due:
                self._guard.trigger()

    def _deliver(self) -> None:
        """Call the callbacks for the messages that are due; the executor calls this."""
        results: list[Any] = []
        try:
            # Not those that become due meanwhile, so that the executor can call other callbacks.
            for entry in islice(iter(self._queue.take, None), len(self._queue.due)):
                results.extend(call(entry) for call in tuple(
                    self._on_pass if entry.reason is None else self._on_drop or [self._log_drop]))
        finally:
            if executor := self._node.executor:
                coroutines = deque(filter(iscoroutine, results))
                # Some releases of rclpy run the newest task first, others the oldest one.
                for _ in range(len(coroutines)):
                    executor.create_task(_run_first, coroutines)
            self._trigger()

    def _log_drop(self, entry: Entry) -> None:
        if self._log.is_due(entry.reason.name):
            self._log.write(
                f"Message Filter dropping message: frame '{shortened(entry.frame)}' at time "
                f"{display_time(entry.stamp)} for reason '{_TEXTS[entry.reason]}'. Messages "
                f'dropped for this reason: {self.dropped[entry.reason]}.{self._why_not(entry)}')

    def _why_not(self, entry: Entry) -> str:
        """Return why a transform of a message is not available; '' if all are available now."""
        return next((
            f' {visible(why)}' for target in self._queue.targets if entry.frame
            for shift in (0, self._queue.tolerance)
            if (why := self._buffer.why_not(target, entry.frame, entry.stamp + shift))), '')


async def _run_first(coroutines: deque[Any]) -> None:
    await coroutines.popleft()


def _check_callable(callback: object) -> None:
    if not callable(callback):
        raise TypeError(f'a callback must be a function, got {described(callback)}')


def _frame_names(given: Union[str, Iterable[str]]) -> tuple[str, ...]:
    if not isinstance(given, Iterable):
        raise TypeError(f'target_frames must be a name or several names, got {described(given)}')
    names = [given] if isinstance(given, str) else list(given)
    for name in names:
        if not isinstance(name, str):
            raise TypeError(f'a target frame must be a str, got {described(name)}')
        if not name.removeprefix('/'):
            raise ValueError('a target frame must have a name, got an empty one')
    return tuple(name.removeprefix('/') for name in names)


def _checked_size(size: int) -> int:
    if not hasattr(size, '__index__'):
        raise TypeError(f'queue_size must be an integer, got {described(size)}')
    if size < 0:
        raise ValueError(f'queue_size must be 0 (any number of messages) or more, got {size}')
    return int(size)
