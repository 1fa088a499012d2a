"""A filter that passes messages on when their transforms are available, like that of tf2_ros."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from enum import IntEnum
from functools import partial
from heapq import heapify, heappop, heappush
from inspect import iscoroutine
from itertools import count
from operator import index
from threading import RLock
from time import monotonic_ns
from typing import Any, NamedTuple, Optional, Union

from rclpy.clock import Clock, TimeJump
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from puretf._core.engine import engine_of
from puretf._core.texts import in_log, ThrottledLog, visible
from puretf._core.times import display_time, nanoseconds, nanoseconds_or_int, SECOND
from puretf._ros.qos import check_node
from puretf._ros.rclpy_private import guard_condition, RCLError
from puretf.buffer import create_jump_handle
from puretf.buffer_core import BufferCore
from puretf.exceptions import described

#: The shortest time (s) between two log lines about messages dropped for the same reason, and
#: about messages that wait.
_LOG_PERIOD, _WAIT_LOG_PERIOD = 1.0, 10.0
#: When the oldest message has waited longer than this (ns), the log says why.
_LONG_WAIT = 2 * SECOND
#: The longest period of a timer (ns).
_LONGEST_PERIOD = 3600 * SECOND


class FilterFailureReason(IntEnum):
    """The reason why a MessageFilter has dropped a message; the names are those of tf2 in C++."""

    #: The transforms were available, but not any more when the callbacks were due.
    Unknown = 0
    #: The transforms will never be available: the message is older than the cache of the buffer.
    OutTheBack = 1
    #: The frame id of the message is empty.
    EmptyFrameID = 2
    #: The timeout of the message was over before its transforms were available.
    NoTransformFound = 3
    #: The queue was full, and this message was the oldest in it.
    QueueFull = 4


#: tf2's texts for the log.
_REASON_TEXTS = {
    FilterFailureReason.Unknown: 'unknown',
    FilterFailureReason.OutTheBack:
        'the timestamp on the message is earlier than all the data in the transform cache',
    FilterFailureReason.EmptyFrameID: 'the frame id of the message is empty',
    FilterFailureReason.NoTransformFound:
        'did not find a valid transform, this usually happens at startup ...',
    FilterFailureReason.QueueFull: 'discarding message because the queue is full'}


class _Entry(NamedTuple):
    """A message in a filter."""

    stamp: int  #: ns
    number: int  #: counts the messages in the order of their arrival
    frame: str
    message: Any
    arrival: int  #: ns, on the monotonic clock
    reason: Optional[FilterFailureReason] = None  #: why the message was dropped


class _Requirement(NamedTuple):
    """The transforms that a message needs."""

    targets: tuple[str, ...]
    tolerance: int  #: ns


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
        #: How many messages were dropped for each reason.
        self.dropped = dict.fromkeys(FilterFailureReason, 0)
        self._buffer, self._engine, self._node = buffer, engine_of(buffer), node
        #: How long a message waits at most (ns); not used if there is no timer.
        self._timeout = nanoseconds_or_int(
            0 if buffer_timeout is None else buffer_timeout, 'buffer_timeout')
        if self._timeout < 0:
            raise ValueError(f'buffer_timeout must not be negative, got {self._timeout} ns')
        self._requirement = _Requirement(
            _frame_names(target_frames), nanoseconds_or_int(tolerance, 'tolerance'))
        self._queue_size = _checked_size(queue_size)
        self._callbacks: list[tuple[Callable[..., object], tuple[Any, ...]]] = []
        self._failure_callbacks: list[Callable[[Any, FilterFailureReason], object]] = []
        #: Guards the next four attributes. No callback is called and no other lock is taken while
        #: it is held. Reentrant because a signal handler may add a message.
        self._lock = RLock()
        #: The messages that wait, by their numbers; the oldest first.
        self._waiting: dict[int, _Entry] = {}
        #: A heap of the messages that are passed on or reported next.
        self._due: list[_Entry] = []
        self._numbers = count()
        #: The generation of the buffer at the last check of all messages.
        self._checked = -1
        self._log = ThrottledLog()
        self._log.write = node.get_logger().warning
        self._has_ended = False
        self._timer: Optional[Timer] = None
        self._subscription: Optional[Subscription] = None
        self._connection: object = None
        self._guard = guard_condition(
            node, node.default_callback_group, self._end, self._call_back)
        try:
            if buffer_timeout is not None:
                self._timer = node.create_timer(
                    1.0, self._on_timeout, node.default_callback_group,
                    Clock(clock_type=ClockType.STEADY_TIME), autostart=False)
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
        return bool(self._waiting)

    def unregister(self) -> None:
        """Drop all messages, and end the filter for good; callbacks that are running go on."""
        self._node.destroy_guard_condition(self._guard)  # calls `_end`, but only once

    def _end(self) -> None:
        self._has_ended = True
        self._engine.remove_waiter(self)
        self._disconnect()
        if self._timer is not None:
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
        # message_filters cannot unregister a callback. So each callback gets its connection, and
        # ignores messages if the filter has another connection by then.
        connection = object()
        if hasattr(input, 'registerCallback'):
            self._disconnect()
            self._connection = connection
            input.registerCallback(self._on_input, connection)
            return
        if not (isinstance(input, Sequence) and len(input) == 3 and isinstance(input[0], type)):
            raise TypeError('input must be a tuple (message type, topic, QoS) or an object with '
                            f'the method registerCallback, got {described(input)}')
        message_type, topic, qos = input
        if not hasattr(message_type, 'header'):
            raise TypeError(f'messages must have a header, but {message_type.__name__} has none')
        subscription = self._node.create_subscription(
            message_type, topic, partial(self._on_message, connection), qos)
        self._disconnect()
        self._connection, self._subscription = connection, subscription

    def _disconnect(self) -> None:
        self._connection = None
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _on_input(self, message: Any, connection: object) -> None:
        if connection is self._connection:
            self.add(message)

    def _on_message(self, connection: object, message: Any) -> None:
        if connection is self._connection:
            self._put(message)
            self._call_back()  # at once, because the executor calls this method

    def add(self, message: Any) -> None:
        """
        Add a message with a header; any thread may call this method.

        If messages are added faster than the executor can call the callbacks, they collect in
        memory: the size of the queue limits only the messages that wait for transforms.
        """
        self._put(message)
        if self._due or self._timer is not None:
            self._trigger()

    def _put(self, message: Any) -> None:
        """Add a message, without triggering the guard condition."""
        header: Any = getattr(message, 'header', None)
        if not (hasattr(header, 'stamp') and hasattr(header, 'frame_id')):
            raise TypeError('a message must have a header with stamp and frame_id, got '
                            f'{type(message).__name__}')
        if self._has_ended or not self._requirement.targets:
            return
        with self._lock:
            entry = _Entry(nanoseconds(header.stamp), next(self._numbers),
                           header.frame_id.removeprefix('/'), message, monotonic_ns())
            self._waiting[entry.number] = entry
            if not entry.frame:
                self._drop(entry, FilterFailureReason.EmptyFrameID)
                return
        # Check only now that the message is in the queue: if transforms are inserted after this
        # check, the check that follows the insertion finds the message.
        self._check_if_new([entry])
        if (oldest := self._oldest()) is None:
            return
        if oldest is entry:
            self._engine.wake_sources()  # so that the thread of the listener does not pause
        elif (entry.arrival - oldest.arrival > _LONG_WAIT
                and self._log.is_due('waiting', _WAIT_LOG_PERIOD)):
            self._log.write(
                f"Messages wait for their transforms. The oldest, of frame "
                f"'{in_log(oldest.frame)}' at time {display_time(oldest.stamp)}, has waited for "
                f'{(entry.arrival - oldest.arrival) / SECOND:.1f} s.{self._why_not(oldest)}')
        self._start_timer()
        self._shorten()

    def _oldest(self) -> Optional[_Entry]:
        """Return the message that has waited longest."""
        with self._lock:
            return next(iter(self._waiting.values()), None)

    def clear(self) -> None:
        """Drop all messages in the filter; no callback is called for them, not even a failure."""
        with self._lock:
            self._waiting.clear()
            self._due.clear()

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Drop all messages, because the clock of the node has jumped back or was switched."""
        if (self._waiting or self._due) and self._log.is_due('jump', _LOG_PERIOD):
            self._log.write('Detected jump back in time. Clearing the message filter.')
        self.clear()

    # Settings

    def setTargetFrame(self, target_frame: str) -> None:  # noqa: N802
        """Set one target frame, also for the messages that wait."""
        self.setTargetFrames([target_frame])

    def setTargetFrames(self, target_frames: Union[str, Iterable[str]]) -> None:  # noqa: N802
        """Set the target frames, as in the constructor, also for the messages that wait."""
        self._require(targets=_frame_names(target_frames))

    def setTolerance(self, tolerance: Union[Duration, int]) -> None:  # noqa: N802
        """Set the tolerance (a Duration, or ns), also for the messages that wait."""
        self._require(tolerance=nanoseconds_or_int(tolerance, 'tolerance'))

    def setQueueSize(self, queue_size: int) -> None:  # noqa: N802
        """Set the largest number of messages that wait; 0: any number; drop surplus messages."""
        self._queue_size = _checked_size(queue_size)
        self._shorten()
        if self._due:
            self._trigger()

    def getQueueSize(self) -> int:  # noqa: N802
        """Return the largest number of messages that wait; 0: any number."""
        return self._queue_size

    def _require(self, **changes: Any) -> None:
        """Change the requirement; messages that are due, but not passed on yet, wait again."""
        with self._lock:
            again = {entry.number: entry for entry in self._due if entry.reason is None}
            self._due = [entry for entry in self._due if entry.reason is not None]
            heapify(self._due)
            self._waiting = dict(sorted({**self._waiting, **again}.items()))
            # Last, because `_check_if_new` reads the requirement before `_waiting`.
            self._requirement = self._requirement._replace(**changes)
            self._checked = -1
        self._check_if_new()
        self._engine.wake_sources()
        self._start_timer()
        self._shorten()
        self._trigger()

    # Checks

    def check(self) -> bool:
        """
        Make the executor pass on the messages whose transforms are available.

        The buffer calls this after insertions. The result tells it to wake no executor.
        """
        self._check_if_new()
        if self._due:
            self._trigger()
        return False

    def _check_if_new(self, entries: Sequence[_Entry] = ()) -> None:
        """
        Move messages that are ready, or too old, from `_waiting` to `_due`.

        `entries` are checked in any case; all messages are, if the buffer or the requirement has
        changed, so that messages that become ready together are moved together.
        """
        with self._buffer.updated():  # so that all lookups use the same data
            requirement = self._requirement
            generation = self._engine.update()
            if generation != self._checked:
                # A message that another thread adds from now on is checked by that thread, with
                # these data or newer ones. `_lock` must not be taken in this block.
                entries = tuple(self._waiting.copy().values())
            if not entries:
                return
            ready, expired = self._ready_and_expired(entries, requirement)
        with self._lock:
            if requirement is not self._requirement:  # `_require` checks the messages again
                return
            self._checked = generation
            for entry in ready:
                if self._waiting.pop(entry.number, None) is not None:
                    heappush(self._due, entry)
            for entry in expired:
                self._drop(entry, FilterFailureReason.OutTheBack)

    def _ready_and_expired(self, entries: Sequence[_Entry], requirement: _Requirement
                           ) -> tuple[list[_Entry], list[_Entry]]:
        """
        Return the messages whose transforms are available, and those that are too old.

        All messages of a frame share one lookup: a full queue may be checked often.
        """
        ready: list[_Entry] = []
        expired: list[_Entry] = []
        if not requirement.targets:
            return ready, expired
        frames: dict[str, list[_Entry]] = {}
        for entry in entries:
            frames.setdefault(entry.frame, []).append(entry)
        for frame, group in frames.items():
            answers = [
                (shift, *self._engine.availability(
                    target, frame, [entry.stamp + shift for entry in group]))
                for target in requirement.targets for shift in {0, requirement.tolerance}]
            for i, entry in enumerate(group):
                if all(available[i] for _, available, _ in answers):
                    ready.append(entry)
                elif any(not available[i] and 0 != entry.stamp + shift < earliest
                         for shift, available, earliest in answers):
                    expired.append(entry)
        return ready, expired

    def _drop(self, entry: _Entry, reason: FilterFailureReason) -> None:
        """Move a message from `_waiting` to `_due`, with a reason; the caller holds the lock."""
        if self._waiting.pop(entry.number, None) is not None:
            self.dropped[reason] += 1
            heappush(self._due, entry._replace(reason=reason))

    def _shorten(self) -> None:
        with self._lock:
            while 0 < self._queue_size < len(self._waiting):
                self._drop(next(iter(self._waiting.values())), FilterFailureReason.QueueFull)

    # Timeouts

    def _start_timer(self) -> None:
        """Start the timer for the oldest message, if it is not running."""
        if (timer := self._timer) is None:
            return
        with suppress(InvalidHandle):  # if the filter is ended at this moment
            if timer.is_canceled() and (oldest := self._oldest()) is not None:
                remaining = oldest.arrival + self._timeout - monotonic_ns()
                timer.timer_period_ns = min(max(1, remaining), _LONGEST_PERIOD)
                timer.reset()

    def _on_timeout(self) -> None:
        """Drop the messages whose timeout is over."""
        if self._timer is None:
            return
        with suppress(InvalidHandle):  # if the filter is ended at this moment
            self._timer.cancel()
        self._check_if_new()
        latest_arrival = monotonic_ns() - self._timeout
        with self._lock:
            for entry in tuple(self._waiting.values()):
                if entry.arrival > latest_arrival:
                    break
                self._drop(entry, FilterFailureReason.NoTransformFound)
        self._start_timer()
        self._call_back()

    # Output

    def registerCallback(  # noqa: N802
            self, callback: Callable[..., object], *args: Any) -> None:
        """
        Register a function, or coroutine function, that is called with each message passed on.

        :param args: further arguments of the function, after the message.
        """
        _check_callable(callback)
        self._callbacks.append((callback, args))

    def registerFailureCallback(  # noqa: N802
            self, callback: Callable[[Any, FilterFailureReason], object]) -> None:
        """
        Register a function that is called with each message that is dropped, and the reason.

        It may be a coroutine function. Without such a function, dropped messages are logged.
        """
        _check_callable(callback)
        self._failure_callbacks.append(callback)

    def _trigger(self) -> None:
        with suppress(InvalidHandle, RCLError):  # if the filter is ended at this moment
            self._guard.trigger()

    def _call_back(self) -> None:
        """Call the callbacks for the messages that are due; the executor calls this."""
        coroutines: list[Any] = []
        try:
            for _ in range(len(self._due)):
                with self._lock:
                    if not self._due:
                        return
                    entry = heappop(self._due)
                if entry.reason is None and not self._ready_and_expired(
                        [entry], self._requirement)[0]:
                    self.dropped[FilterFailureReason.Unknown] += 1
                    entry = entry._replace(reason=FilterFailureReason.Unknown)
                if entry.reason is None:
                    for callback, args in tuple(self._callbacks):
                        coroutines.append(callback(entry.message, *args))
                else:
                    for failure_callback in tuple(self._failure_callbacks):
                        coroutines.append(failure_callback(entry.message, entry.reason))
                    if not self._failure_callbacks:
                        self._log_drop(entry, entry.reason)
        finally:
            self._start(filter(iscoroutine, coroutines))
            if self._due:
                self._trigger()

    def _start(self, coroutines: Iterator[Any]) -> None:
        """
        Make the executor start coroutines in their order, and run them concurrently.

        rclpy's executor runs its newest task first. So each task first creates the next one.
        """
        executor, coroutine = self._node.executor, next(coroutines, None)
        if coroutine is None or executor is None:
            return

        async def run() -> None:
            self._start(coroutines)
            await coroutine

        executor.create_task(run)

    def _log_drop(self, entry: _Entry, reason: FilterFailureReason) -> None:
        if not self._log.is_due(reason.name, _LOG_PERIOD):
            return
        why = '' if reason is FilterFailureReason.EmptyFrameID else self._why_not(entry)
        self._log.write(
            f"Message Filter dropping message: frame '{in_log(entry.frame)}' at time "
            f"{display_time(entry.stamp)} for reason '{_REASON_TEXTS[reason]}'. Messages dropped "
            f'for this reason: {self.dropped[reason]}.{why}')

    def _why_not(self, entry: _Entry) -> str:
        """Return why a transform of a message is not available; '' if all are available now."""
        for target in self._requirement.targets:
            for shift in 0, self._requirement.tolerance:
                if why := self._buffer.why_not(target, entry.frame, entry.stamp + shift):
                    return f' {visible(why)}'
        return ''


def _check_callable(callback: object) -> None:
    if not callable(callback):
        raise TypeError(f'a callback must be a function, got {described(callback)}')


def _frame_names(target_frames: Union[str, Iterable[str]]) -> tuple[str, ...]:
    if not isinstance(target_frames, Iterable):
        raise TypeError('target_frames must be a name or several names, got '
                        f'{described(target_frames)}')
    names = [target_frames] if isinstance(target_frames, str) else list(target_frames)
    for name in names:
        if not isinstance(name, str):
            raise TypeError(f'a target frame must be a str, got {described(name)}')
        if not name.removeprefix('/'):
            raise ValueError('a target frame must have a name, got an empty one')
    return tuple(name.removeprefix('/') for name in names)


def _checked_size(queue_size: int) -> int:
    if not hasattr(queue_size, '__index__'):
        raise TypeError(f'queue_size must be an integer, got {described(queue_size)}')
    if index(queue_size) < 0:
        raise ValueError(f'queue_size must be 0 (any number of messages) or more, got '
                         f'{queue_size}')
    return index(queue_size)
