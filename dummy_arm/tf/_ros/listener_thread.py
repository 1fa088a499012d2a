"""The thread of a listener: it waits for messages, wakes the node's executor, and ends."""

import atexit
from collections.abc import Callable
from contextlib import suppress
import os
from threading import current_thread, Lock, Thread
from time import monotonic
from typing import Any, NamedTuple

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.subscription import Subscription

from dummy_arm.tf._ros.rclpy_private import guard_condition, RCLError, WaitSet

#: The longest wait (s): a signal shuts a context down without waking this thread.
_STEP = 0.2
#: The executor of the node is woken at most once in this time (s): it takes 0.1 to 0.3 ms.
_BETWEEN_WAKES = 0.1
#: How long a thread is joined at its end (s); a callback that it runs may take longer.
_ENDING = 0.5

_running: set['ListenerThread'] = set()


class Round(NamedTuple):
    """What a listener's thread has done after it was woken."""

    has_news: bool  #: whether there are new data
    is_urgent: bool  #: whether somebody in the executor waits for them
    pause: float  #: for how long messages may stay in the queue (s)


class ListenerThread:
    """
    A thread that works whenever messages arrive.

    It ends when it is told to, when the node is destroyed or when ROS is shut down. It waits in a
    wait set of its own, and may pause after its work, so that messages gather.
    """

    def __init__(self, node: Node, group: CallbackGroup, tf_static: Subscription, tf: Subscription,
                 work: Callable[[], Round], on_end: Callable[[], object],
                 is_blocked: Callable[[], bool], clock: Callable[[], float] = monotonic) -> None:
        """
        Create the thread; `start` starts it.

        :param group: of the guard condition by which the node's executor is woken.
        :param tf_static: the subscription that is always waited for.
        :param tf: the subscription that is not waited for during a pause.
        :param work: is called by the thread whenever messages have arrived, and at least 5 times a
            second.
        :param on_end: is called by the thread at its end; or by `stop`, if it was never started.
        :param is_blocked: return whether the calling thread holds what this thread needs to end.
        :param clock: returns the time (s).
        """
        self._node, self._context, self._clock = node, node.context, clock
        self._tf_static, self._tf = tf_static, tf
        self._work, self._on_end, self._is_blocked = work, on_end, is_blocked
        self._wake = GuardCondition(None, None, context=node.context)
        self._guard = guard_condition(node, group, self.stop)
        self.has_ended = self._wakes_executor = False
        self._next_wake = 0.0
        #: Acquired by whoever starts the thread; or by `stop`, so that it never starts.
        self._once = Lock()
        self._thread = Thread(target=self._run, name=f'tf of {node.get_name()}', daemon=True)

    def start(self) -> None:
        """Start the thread, unless it was started or stopped before."""
        if self._once.acquire(blocking=False):
            _running.add(self)
            self._thread.start()

    def wake(self) -> None:
        """Have the thread work now."""
        with suppress(InvalidHandle, RCLError):  # when it ends just now
            self._wake.trigger()

    def _wake_executor(self) -> None:
        """Have the executor that spins the node return from its wait."""
        self._wakes_executor = False
        self._next_wake = self._clock() + _BETWEEN_WAKES
        self._guard.trigger()

    def end(self) -> None:
        """End the thread; from any thread, any number of times."""
        self._node.destroy_guard_condition(self._guard)  # which calls `stop`, unless it has

    def stop(self) -> None:
        """Stop the thread and join it, unless this thread is it, or holds what it needs."""
        self.has_ended = True
        if self._once.acquire(blocking=False):
            self._on_end()
            return
        if self not in _running:
            return
        self.wake()
        if self._thread is not current_thread() and not self._is_blocked():
            self._thread.join(_ENDING)

    def _run(self) -> None:
        try:
            with self._wake.handle, self._tf_static.handle, self._tf.handle:
                self._listen()
        except (InvalidHandle, RCLError):
            if not self.has_ended and self._context.ok():
                raise
        finally:
            self.has_ended = True
            # Ctrl-C shuts ROS down, but does not always wake a thread that is blocked in a spin.
            with suppress(InvalidHandle, RCLError):
                self._guard.trigger()
            self._on_end()
            _running.discard(self)

    def _listen(self) -> None:
        context = self._context.handle
        assert context is not None  # as long as there is a node
        wait_set = WaitSet(2, 1, 0, 0, 0, 0, context)
        pause = 0.0
        while context.ok() and not self.has_ended:
            self._wait(wait_set, pause)
            if self.has_ended:
                return
            has_news, is_urgent, pause = self._work()
            self._wakes_executor |= has_news
            if is_urgent or (self._wakes_executor and self._clock() >= self._next_wake):
                self._wake_executor()

    def _wait(self, wait_set: Any, pause: float) -> None:
        wait_set.clear_entities()
        wait_set.add_guard_condition(self._wake.handle)
        wait_set.add_subscription(self._tf_static.handle)
        if not pause:
            wait_set.add_subscription(self._tf.handle)
        limit = pause or _STEP
        if self._wakes_executor and not pause:
            limit = min(limit, max(0.0, self._next_wake - self._clock()))
        wait_set.wait(int(limit * 1e9))


def _after_fork_in_child() -> None:
    """Mark the threads as ended: a process that was forked does not have them."""
    for listening in _running:
        listening.has_ended = True
    _running.clear()


if hasattr(os, 'register_at_fork'):  # not on Windows
    os.register_at_fork(after_in_child=_after_fork_in_child)


@atexit.register
def _stop_all() -> None:
    """End all threads before the interpreter does, which would abort during a wait."""
    running = list(_running)
    for listening in running:
        listening.has_ended = True
        listening.wake()
    for listening in running:
        listening.stop()
