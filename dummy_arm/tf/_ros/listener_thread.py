"""The thread of a listener, which waits for messages and wakes the node's executor."""

import atexit
from collections.abc import Callable
from contextlib import suppress
import os
from threading import current_thread, Lock, Thread
from time import monotonic
from typing import Any, NamedTuple, Optional

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.subscription import Subscription

from dummy_arm.tf._ros.rclpy_private import guard_condition, RCLError, WaitSet

#: The longest time for which the thread waits (s). The time is short because a signal that shuts
#: ROS down does not wake the thread.
_MAX_WAIT = 0.2
#: The shortest time (s) between two wake-ups of the executor that are not urgent. A wake-up costs
#: 0.1 to 0.3 ms.
_WAKE_INTERVAL = 0.1
#: The longest time for which `stop` waits for the end of the thread (s). The time is limited,
#: because the thread may be running a long callback.
_JOIN_TIMEOUT = 0.5

#: The threads that were started and have not ended.
_running: set['ListenerThread'] = set()


class Round(NamedTuple):
    """The result that the function `work` of a `ListenerThread` returns."""

    has_news: bool  #: True if there are new data
    is_urgent: bool  #: True if a future was completed; then the executor is woken at once
    pause: float  #: how long the thread may leave messages of /tf in the queue (s)


class ListenerThread:
    """
    A thread that calls a function whenever messages arrive.

    The thread waits for messages, calls the function, and then waits again. It waits with a wait
    set of rcl that no other thread uses. After a call of the function, the thread may ignore the
    messages of /tf for some time, so that the next call handles several messages. This time is
    called a pause. The thread ends when `end` or `stop` is called, when the node is destroyed, or
    when ROS is shut down.
    """

    def __init__(self, node: Node, group: CallbackGroup, tf_static: Subscription,
                 tf: Optional[Subscription],
                 work: Callable[[], Round], on_end: Callable[[], object],
                 is_blocked: Callable[[], bool], clock: Callable[[], float] = monotonic) -> None:
        """
        Create the thread; `start` starts it.

        :param node: the node of the subscriptions; the executor that spins the node is woken.
        :param group: the callback group of the guard condition that wakes the executor.
        :param tf_static: the subscription to /tf_static, whose messages always wake the thread.
        :param tf: the subscription to /tf, whose messages do not wake the thread during a pause;
            None: there is no such subscription.
        :param work: the function that the thread calls when messages have arrived, and at least 5
            times per second. It returns a `Round`.
        :param on_end: a function that the thread calls at its end. If the thread was never
            started, `stop` calls this function.
        :param is_blocked: a function that `stop` calls. It returns True if the thread that calls
            `stop` holds a lock that the ListenerThread needs in order to end.
        :param clock: a function that returns the time (s).
        """
        self._node, self._context, self._clock = node, node.context, clock
        self._tf_static, self._tf = tf_static, tf
        self._work, self._on_end, self._is_blocked = work, on_end, is_blocked
        self._wake = GuardCondition(None, None, context=node.context)
        self._guard = guard_condition(node, group, self.stop)
        self.has_ended = self._is_wake_pending = False
        self._next_wake = 0.0
        #: Acquired by the first call of `start` or `stop`, and never released.
        self._once = Lock()
        self._thread = Thread(target=self._run, name=f'tf of {node.get_name()}', daemon=True)

    def start(self) -> None:
        """Start the thread, unless it was started or stopped before."""
        if self._once.acquire(blocking=False):
            _running.add(self)
            self._thread.start()

    def wake(self) -> None:
        """End the wait of the thread, so that the thread calls its function now."""
        with suppress(InvalidHandle, RCLError):  # if the thread ends at this moment
            self._wake.trigger()

    def _wake_executor(self) -> None:
        """Wake the executor that spins the node."""
        self._is_wake_pending = False
        self._next_wake = self._clock() + _WAKE_INTERVAL
        self._guard.trigger()

    def end(self) -> None:
        """Stop the thread; any thread may call this method, even several times."""
        self._node.destroy_guard_condition(self._guard)  # calls `stop`, but only once

    def stop(self) -> None:
        """
        Stop the thread and join it.

        The thread is not joined if the thread itself calls this method, or if the caller holds a
        lock that the thread needs in order to end.
        """
        self.has_ended = True
        if self._once.acquire(blocking=False):
            self._on_end()
            return
        if self not in _running:
            return
        self.wake()
        if self._thread is not current_thread() and not self._is_blocked():
            self._thread.join(_JOIN_TIMEOUT)

    def _run(self) -> None:
        try:
            tf = self._tf or self._tf_static
            with self._wake.handle, self._tf_static.handle, tf.handle:
                self._listen()
        except (InvalidHandle, RCLError):
            if not self.has_ended and self._context.ok():
                raise
        finally:
            self.has_ended = True
            # Wake the executor: Ctrl-C shuts ROS down, but does not always wake an executor that
            # is spinning.
            with suppress(InvalidHandle, RCLError):
                self._guard.trigger()
            self._on_end()
            _running.discard(self)

    def _listen(self) -> None:
        context = self._context.handle
        assert context is not None  # a context with a node has a handle
        wait_set = WaitSet(2, 1, 0, 0, 0, 0, context)
        pause = 0.0
        while context.ok() and not self.has_ended:
            self._wait(wait_set, pause)
            if self.has_ended:
                return
            has_news, is_urgent, pause = self._work()
            self._is_wake_pending |= has_news
            if is_urgent or (self._is_wake_pending and self._clock() >= self._next_wake):
                self._wake_executor()

    def _wait(self, wait_set: Any, pause: float) -> None:
        wait_set.clear_entities()
        wait_set.add_guard_condition(self._wake.handle)
        wait_set.add_subscription(self._tf_static.handle)
        if self._tf is not None and not pause:
            wait_set.add_subscription(self._tf.handle)
        limit = pause or _MAX_WAIT
        if self._is_wake_pending and not pause:
            limit = min(limit, max(0.0, self._next_wake - self._clock()))
        wait_set.wait(int(limit * 1e9))


def _after_fork_in_child() -> None:
    """Mark all listener threads as ended, because they do not run in the child process."""
    for thread in _running:
        thread.has_ended = True
    _running.clear()


if hasattr(os, 'register_at_fork'):  # not on Windows
    os.register_at_fork(after_in_child=_after_fork_in_child)


@atexit.register
def _stop_all() -> None:
    """Stop all threads at exit, because a thread that still waits in rcl aborts the process."""
    running = list(_running)
    for thread in running:
        thread.has_ended = True
        thread.wake()
    for thread in running:
        thread.stop()
