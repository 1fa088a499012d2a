"""Futures for transforms that are not there yet."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
import heapq
from itertools import count
from threading import Condition, RLock, Thread, TIMEOUT_MAX
from time import monotonic
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

    def __init__(self, waits: 'Waits', lookup: Callable[[], TransformStamped], what: str) -> None:
        """
        Wait for what a lookup gives.

        :param lookup: raises a TransformException as long as there is no answer.
        :param what: what is waited for, for the error when it takes too long.
        """
        super().__init__()
        self.lookup, self.what = lookup, what
        self._waits = waits

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        """Add a function to be called when this is done; until then it is not forgotten."""
        super().add_done_callback(callback)
        # An executor that spins until this is done holds it, and never removes its callback.
        if callback.__module__ != 'rclpy.executors':
            self._waits.keep(self)

    def cancel(self) -> None:
        """End the wait."""
        if self._waits.forget(self):
            super().cancel()


#: When (s, of the monotonic clock), a number that differs, after how long (s), of what.
_Deadline = tuple[float, int, float, ref[TransformFuture]]


class Waits:
    """
    The futures that wait for the data of a buffer.

    A future is done, and its callbacks run, in the thread that brings the data or that sees that
    its time is up; then the executor of the node is woken, for coroutines that wait. The lock is
    reentrant and held for moments only: the garbage collector may come by at any of them.
    """

    def __init__(self, node: Optional[Node]) -> None:
        """
        Begin with none.

        :param node: whose executor is woken when a wait is over.
        """
        self._node = node
        self.lock = RLock()
        self._futures: WeakSet[TransformFuture] = WeakSet()
        self._kept: set[TransformFuture] = set()
        self._changed = Condition(self.lock)
        self._deadlines: list[_Deadline] = []
        self._numbers = count()
        self._thread: Optional[Thread] = None

    def __len__(self) -> int:
        return len(self._futures)

    def add(self, lookup: Callable[[], TransformStamped], timeout: Optional[float], what: str
            ) -> Future:
        """
        Make a future, done at once if its lookup gives an answer.

        :param timeout: after how long the wait ends with a TimeoutException (s); None: never.
        :param what: what is waited for, for that error.
        """
        future = TransformFuture(self, lookup, what)
        with self.lock:
            self._futures.add(future)
        try:
            transform = lookup()
        except TransformException:
            if timeout is not None:
                self._end_after(future, timeout)
        except BaseException:
            self.forget(future)
            raise
        else:
            self._finish(future, partial(future.set_result, transform))
        return future

    def keep(self, future: TransformFuture) -> None:
        """Keep a future that somebody waits for, until it is done."""
        with self.lock:
            if future in self._futures:
                self._kept.add(future)

    def forget(self, future: TransformFuture) -> bool:
        """Forget a future; tell whether it was waiting still."""
        with self.lock:
            waited = future in self._futures
            self._futures.discard(future)
            self._kept.discard(future)
            self._changed.notify_all()
        future.lookup = _nothing  # rclpy may hold the future on: not the buffer with it
        return waited

    def forget_all(self) -> None:
        """Forget all futures: this is in a process that was forked, where no data come in."""
        self._node = self._thread = None
        self._futures.clear()
        self._kept.clear()
        self._deadlines.clear()
        self._changed = Condition(self.lock)

    def check(self) -> bool:
        """Look for answers, now that there are new data; tell whether there were any."""
        with self.lock:
            futures = list(self._futures)
        return sum(map(self._try, futures)) > 0

    def _try(self, future: TransformFuture, waited: Optional[float] = None) -> bool:
        """
        Finish a future if there is an answer, or if the lookup fails in another way.

        :param waited: after how long (s) its time is up now; None: it goes on waiting.
        :returns: whether it is done now.
        """
        try:
            outcome = partial(future.set_result, future.lookup())
        except TransformException as error:
            if waited is None:
                return False
            outcome = partial(future.set_exception, TimeoutException(
                f'Timed out after {waited:g} s, waiting for {future.what}: {error}'))
        except Exception as error:
            outcome = partial(future.set_exception, error)
        self._finish(future, outcome)
        return True

    def _finish(self, future: TransformFuture, set_outcome: Callable[[], Any]) -> None:
        """Set the outcome of a future, unless it has one, and wake who waits for it."""
        if not self.forget(future):
            return
        set_outcome()
        if self._node is not None and (executor := self._node.executor) is not None:
            with suppress(AttributeError, InvalidHandle):  # when it is shut down just now
                executor.wake()

    def _end_after(self, future: TransformFuture, timeout: float) -> None:
        """See to it that a wait ends after a timeout (s)."""
        with self.lock:
            if len(self._deadlines) > 2 * len(self._futures) + 10:
                self._deadlines = [entry for entry in self._deadlines if self._waits(entry)]
                heapq.heapify(self._deadlines)
            heapq.heappush(self._deadlines, (
                monotonic() + timeout, next(self._numbers), timeout, ref(future, self._notify)))
            self._changed.notify_all()
            if self._thread is None or not self._thread.is_alive():
                self._thread = Thread(target=self._watch_deadlines, daemon=True)
                self._thread.start()

    def _waits(self, entry: _Deadline) -> bool:
        return entry[3]() in self._futures

    def _notify(self, _: Any) -> None:
        with self.lock:
            self._changed.notify_all()

    def _watch_deadlines(self) -> None:
        """End the waits whose time is up, as long as there are any that may have to be ended."""
        while True:
            with self.lock:
                while self._deadlines and not self._waits(self._deadlines[0]):
                    heapq.heappop(self._deadlines)
                if not self._deadlines:
                    self._thread = None
                    return
                deadline, _, timeout, future_ref = self._deadlines[0]
                left = deadline - monotonic()
                if left > 0.0:
                    self._changed.wait(min(left, TIMEOUT_MAX))
                    continue
                heapq.heappop(self._deadlines)
            if (future := future_ref()) is not None:
                self._try(future, timeout)
                del future


def _nothing() -> TransformStamped:
    """Give no answer, in place of the lookup of a future that needs none."""
    raise TransformException
