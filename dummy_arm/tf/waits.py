"""Futures for transforms that are not there yet."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from threading import Lock, Timer
from typing import Any, Optional
from weakref import ref, WeakSet

from geometry_msgs.msg import TransformStamped
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.task import Future

from dummy_arm.tf.exceptions import TimeoutException, TransformException


class TransformFuture(Future):
    """
    A future whose result is a TransformStamped.

    Whoever drops it without having added a callback, or cancels it, leaves nothing behind.
    """

    def __init__(self, waits: 'Waits', lookup: Callable[[], TransformStamped]) -> None:
        """
        Wait for what a lookup gives.

        :param lookup: raises a TransformException as long as there is no answer.
        """
        super().__init__()
        self.lookup = lookup
        self.timer: Optional[Timer] = None
        self._waits = waits

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        """Add a function to be called when this is done; until then it is not forgotten."""
        super().add_done_callback(callback)
        # An executor that spins until this is done holds it, and never removes its callback.
        if callback.__module__ != 'rclpy.executors':
            self._waits.keep(self)

    def cancel(self) -> None:
        """End the wait."""
        super().cancel()
        self._waits.forget(self)


class Waits:
    """
    The futures that wait for the data of a buffer.

    What is done with them may happen in any thread. The callbacks of a future run in the executor
    of the node, if there is one, else in the thread that brings the data.
    """

    def __init__(self, node: Optional[Node]) -> None:
        """
        Begin with none.

        :param node: whose executor is woken when a wait is over.
        """
        self._node = node
        self._lock = Lock()
        self._futures: WeakSet[TransformFuture] = WeakSet()
        self._kept: set[TransformFuture] = set()

    def __len__(self) -> int:
        return len(self._futures)

    def add(self, lookup: Callable[[], TransformStamped], timeout: Optional[float], what: str
            ) -> Future:
        """
        Make a future, done at once if its lookup gives an answer.

        :param timeout: after how long the wait ends with a TimeoutException (s); None: never.
        :param what: what is waited for, for that error.
        """
        future = TransformFuture(self, lookup)
        with self._lock:
            self._futures.add(future)
        try:
            self._try(future)
        except BaseException:
            self.forget(future)
            raise
        if timeout is not None and not future.done():
            future.timer = timer = Timer(
                timeout, _expire, [ref(future, lambda _: timer.cancel()), timeout, what])
            timer.daemon = True
            timer.start()
        return future

    def keep(self, future: TransformFuture) -> None:
        """Keep a future that somebody waits for, until it is done."""
        with self._lock:
            if future in self._futures:
                self._kept.add(future)

    def forget(self, future: TransformFuture) -> bool:
        """Forget a future; tell whether it was waiting still."""
        with self._lock:
            waited = future in self._futures
            self._futures.discard(future)
            self._kept.discard(future)
        if future.timer is not None:
            future.timer.cancel()
        return waited

    def check(self) -> None:
        """Look for answers, now that there are new data."""
        with self._lock:
            futures = list(self._futures)
        for future in futures:
            self._try(future)

    def _try(self, future: TransformFuture) -> None:
        try:
            transform = future.lookup()
        except TransformException:
            return
        self.finish(future, partial(future.set_result, transform))

    def finish(self, future: TransformFuture, set_outcome: Callable[[], Any]) -> None:
        """Set the outcome of a future, unless it has one, and wake who waits for it."""
        if not self.forget(future):
            return
        executor = None if self._node is None else self._node.executor
        future._set_executor(executor)
        set_outcome()
        if executor is not None:
            with suppress(InvalidHandle):  # raised when it was shut down in the meantime
                executor.wake()


def _expire(future_ref: 'ref[TransformFuture]', timeout: float, what: str) -> None:
    """End a wait that has taken too long."""
    future = future_ref()
    if future is None:
        return
    try:
        transform = future.lookup()
    except TransformException as error:
        outcome = partial(future.set_exception, TimeoutException(
            f'Timed out after {timeout:g} s, waiting for {what}: {error}'))
    else:
        outcome = partial(future.set_result, transform)
    future._waits.finish(future, outcome)
