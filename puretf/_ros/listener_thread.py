"""The threads of listeners, which end with their nodes."""

import atexit
from collections.abc import Callable
from contextlib import suppress
import os
from threading import current_thread, RLock, Thread
from threading import enumerate as running_threads
from time import monotonic
from typing import Any, Optional, Union

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.subscription import Subscription

from puretf._ros.own_node import OwnNode
from puretf._ros.rclpy_private import guard_condition, RCLError, WaitSet

#: The longest wait (s): a signal that shuts ROS down does not wake the thread.
_MAX_WAIT = 0.2
#: The shortest time (s) between two wake-ups of the executor that are not urgent. A wake-up costs
#: 0.1 to 0.3 ms.
_WAKE_INTERVAL = 0.1
#: The longest time (s) for which `stop` waits: the caller may hold a lock that the thread needs.
_JOIN_TIMEOUT = 0.5


class NodeThread(Thread):
    """
    A thread that ends when `end` is called, its node is destroyed or Python exits.

    It never destroys the handles of the listener. The thread that calls `stop` does so, by
    `release`. Both hold a lock while they use the handles; this thread takes no other lock
    meanwhile, so `stop` need not wait long for it, whatever locks the caller holds.
    """

    def __init__(self, node: Node, group: CallbackGroup, on_end: Callable[[], object],
                 release: Callable[[], object]) -> None:
        super().__init__(name=f'tf of {node.get_name()}', daemon=True)
        self._node, self._on_end, self._release = node, on_end, release
        self._process, self._using = os.getpid(), RLock()
        self.must_end = self._is_released = False
        #: That of /parameter_events: the first handle that `destroy_node` destroys.
        self._first_publisher: Any = next(node.publishers, None)
        self._guard = guard_condition(node, group, self.stop)

    def wake(self) -> None:
        """End the wait of the thread, unless it is short."""

    def work_until_end(self) -> None:
        raise NotImplementedError

    def run(self) -> None:
        """Work; an error of a handle that is being destroyed is the end."""
        try:
            self.work_until_end()
        except (InvalidHandle, RCLError):
            if self._goes_on():
                raise

    def _goes_on(self) -> bool:
        return (not self.must_end and self._node.context.ok()
                and self._first_publisher in (None, *self._node.publishers))

    def end(self) -> None:
        self._node.destroy_guard_condition(self._guard)  # calls `stop`, but only once

    def stop(self) -> None:
        """
        Make the thread end, wait for its end, but at most for `_JOIN_TIMEOUT`, and release.

        Do nothing in the child of a fork, where neither the thread nor its handles exist.
        """
        self.must_end = True
        if self._process != os.getpid():
            return
        try:
            if self.is_alive():
                self.wake()
                if self is not current_thread():
                    self.join(_JOIN_TIMEOUT)
        finally:
            with self._using:
                self._is_released = True
                self._release()


class SpinThread(NodeThread):
    """A thread that spins a node, as in tf2_ros; `stop` calls `on_end`, even if not started."""

    def stop(self) -> None:
        super().stop()
        self._on_end()

    def work_until_end(self) -> None:
        executor = _Executor(context=self._node.context)
        try:
            executor.add_node(self._node)
            with suppress(ExternalShutdownException):
                while not self.must_end:
                    executor.spin_once(_MAX_WAIT)
        finally:
            executor.remove_node(self._node)
            executor.shutdown()


class _Executor(SingleThreadedExecutor):
    """An executor that `destroy_node` and `shutdown` may wake while its thread shuts it down."""

    def wake(self) -> None:
        with suppress(InvalidHandle):
            super().wake()


class MessageWait:
    """A wait for the messages of subscriptions to static transforms, and to dynamic ones."""

    def __init__(self, node: Node, tf_static: Subscription, tf: Optional[Subscription]) -> None:
        self._guard = GuardCondition(None, None, context=node.context)
        self._tf_static, self._tf = tf_static, tf
        context = node.context.handle
        assert context is not None  # a context with a node has a handle
        self._wait_set = WaitSet(2, 1, 0, 0, 0, 0, context)

    def wait(self, limit: float, only_static: bool) -> None:
        """Wait for at most a time (s), or until `wake` is called."""
        tf, wait_set = self._tf or self._tf_static, self._wait_set
        with self._guard.handle, self._tf_static.handle, tf.handle:
            wait_set.clear_entities()
            wait_set.add_guard_condition(self._guard.handle)
            wait_set.add_subscription(self._tf_static.handle)
            if self._tf is not None and not only_static:
                wait_set.add_subscription(tf.handle)
            wait_set.wait(int(limit * 1e9))

    def wake(self) -> None:
        with suppress(InvalidHandle, RCLError):  # if the thread ends at this moment
            self._guard.trigger()


class ListenerThread(NodeThread):
    """
    A thread that calls `work` whenever messages arrive, and at least 5 times a second.

    In a pause, messages of /tf do not wake it, so that the next call handles several of them. It
    calls `on_end` at its end.

    `work` returns whether there are new data, whether a future was completed (the executor is then
    woken at once), and how long the thread may leave messages of /tf in the queue (s).
    """

    def __init__(self, node: Node, group: CallbackGroup, messages: Union[MessageWait, OwnNode],
                 work: Callable[[], tuple[bool, bool, float]],
                 on_end: Callable[[], object], release: Callable[[], object],
                 clock: Callable[[], float] = monotonic) -> None:
        super().__init__(node, group, on_end, release)
        self._messages, self._clock, self._work = messages, clock, work
        self._is_wake_pending = False
        self._next_wake = 0.0

    def wake(self) -> None:
        self._messages.wake()

    def run(self) -> None:
        try:
            super().run()
        finally:
            self.must_end = True
            # Ctrl-C shuts ROS down, but does not always wake an executor that is spinning.
            self._wake_executor()
            self._on_end()

    def work_until_end(self) -> None:
        pause = 0.0
        while self._wait(pause):
            has_news, is_urgent, pause = self._work()
            self._is_wake_pending |= has_news
            if is_urgent or (self._is_wake_pending and self._clock() >= self._next_wake):
                self._is_wake_pending = False
                self._next_wake = self._clock() + _WAKE_INTERVAL
                self._wake_executor()

    def _wake_executor(self) -> None:
        with self._using, suppress(InvalidHandle, RCLError):
            if not self._is_released:
                self._guard.trigger()

    def _wait(self, pause: float) -> bool:
        """Wait for messages; return False if the thread must end."""
        # In rclpy 9, the shutdown of a context has a lock that `ok` needs, and calls `stop`. So
        # `ok` is not called while handles are used, but by the executor of an OwnNode.
        if not self._goes_on():
            return False
        limit = pause or _MAX_WAIT
        if self._is_wake_pending and not pause:
            limit = min(limit, max(0.0, self._next_wake - self._clock()))
        if isinstance(self._messages, OwnNode):
            self._messages.wait(limit)
        else:
            with self._using:
                if not self._is_released:
                    self._messages.wait(limit, bool(pause))
        return self._goes_on()


@atexit.register
def _stop_all() -> None:
    """Stop all threads at exit, because a thread that still waits in rcl aborts the process."""
    for thread in running_threads():
        if isinstance(thread, NodeThread):
            thread.stop()
