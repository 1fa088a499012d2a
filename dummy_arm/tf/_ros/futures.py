"""Futures for transforms that are not available yet."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
import heapq
from itertools import count
from queue import Empty, SimpleQueue
from threading import RLock, Thread, TIMEOUT_MAX
from time import monotonic
from traceback import format_exc
from typing import Any, Optional
from weakref import ref

from geometry_msgs.msg import TransformStamped
from rclpy.exceptions import InvalidHandle
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future

from dummy_arm.tf._ros.rclpy_private import is_of_executor
from dummy_arm.tf.exceptions import TimeoutException, TransformException


class TransformFuture(Future):
    """
    A future whose result is a TransformStamped.

    To stop waiting, cancel the future. If the future has no done callback, it is enough to drop
    the last reference to the future.
    """

    def __init__(self, owner: 'PendingFutures', lookup: Callable[[], TransformStamped],
                 what: str) -> None:
        """
        Create a future that is not done.

        :param owner: the set of pending futures to which this future belongs.
        :param lookup: a function that returns the result, or raises a TransformException if the
            result is not available.
        :param what: a description of the transform, for the text of a TimeoutException.
        """
        super().__init__()  # type: ignore[no-untyped-call]
        self.lookup, self.what = lookup, what
        self._owner = owner

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        """
        Add a function that is called when this future is done; keep the future alive until then.

        :param callback: the function; its argument is this future.
        """
        super().add_done_callback(callback)  # type: ignore[no-untyped-call]
        # `spin_until_future_complete` adds a callback, and does not remove it when the spin times
        # out. The executor itself keeps the future alive during the spin. After the spin, the
        # future must be deleted when the user drops it. So it is not kept for such a callback.
        if not is_of_executor(callback):
            self._owner.keep(self)

    def cancel(self) -> None:
        """Cancel the future, unless it is done."""
        if self._owner.forget(self):
            super().cancel()  # type: ignore[no-untyped-call]


#: The time when a future times out (s, monotonic clock), a number that orders equal times, the
#: timeout (s), and a weak reference to the future.
_Deadline = tuple[float, int, float, 'ref[TransformFuture]']


class PendingFutures:
    """
    The futures that wait for the data of a buffer.

    The dict `_futures` needs no lock, because each change of the dict is one atomic operation.
    Only the thread that has removed a future from the dict completes this future. So there is no
    deadlock if a signal handler or the garbage collector interrupts one method and calls another.
    """

    def __init__(self, node: Optional[Node]) -> None:
        """
        Create an empty set of futures.

        :param node: the node whose executor is woken when a future is done; None: no executor
            is woken.
        """
        self._node = node
        #: The pending futures, by their `id`.
        self._futures: dict[int, ref[TransformFuture]] = {}
        #: The futures that were passed to `keep` and are pending. This set keeps them alive.
        self._kept: set[TransformFuture] = set()
        self._numbers = count()
        #: The queue from which `_thread` gets new deadlines. A None in the queue only wakes
        #: `_thread`.
        self._queue: SimpleQueue[Optional[_Deadline]] = SimpleQueue()
        #: A heap of deadlines, used by `_thread` only.
        self._deadlines: list[_Deadline] = []
        self._starting = RLock()
        self._thread: Optional[Thread] = None

    @property
    def is_waiting(self) -> bool:
        """True if a future is pending."""
        return bool(self._futures)

    def add(self, lookup: Callable[[], TransformStamped], timeout: Optional[float], what: str
            ) -> Future:
        """
        Create a future; if its lookup succeeds now, the future is already done.

        :param lookup: a function that returns the result, or raises a TransformException if the
            result is not available.
        :param timeout: the time (s) after which the future ends with a TimeoutException; None
            means that there is no timeout.
        :param what: a description of the transform, for the text of the TimeoutException.
        :returns: the future.
        """
        future = TransformFuture(self, lookup, what)
        key = id(future)
        self._futures[key] = ref(future, partial(self._futures.pop, key))
        try:
            transform = lookup()
        except TransformException:
            if timeout is not None:
                self._end_after(future, timeout)
        except BaseException:
            self.forget(future)
            raise
        else:
            self._complete(future, partial(future.set_result, transform))
        return future

    def keep(self, future: TransformFuture) -> None:
        """
        Keep a reference to a future until the future is done.

        :param future: the future.
        """
        self._kept.add(future)
        if id(future) not in self._futures:
            self._kept.discard(future)

    def forget(self, future: TransformFuture) -> bool:
        """
        Remove a future from the pending futures.

        :param future: the future.
        :returns: True if the future was pending. In this case, only the calling thread may
            complete or cancel the future.
        """
        was_waiting = self._futures.pop(id(future), None) is not None
        self._kept.discard(future)
        # The lookup refers to the buffer. Without the lookup, the buffer can be freed even if
        # rclpy still refers to the future.
        future.lookup = _raise
        if self._thread is not None:
            self._queue.put(None)
        return was_waiting

    def check(self) -> bool:
        """
        Complete the futures whose lookups no longer raise a TransformException.

        :returns: True if at least one of the futures is no longer pending.
        """
        futures = [future for reference in self._futures.copy().values()
                   if (future := reference()) is not None]
        is_done, error = False, None
        for future in futures:
            try:
                is_done |= self._try(future)
            except BaseException as raised:
                # A done callback has failed. Try the other futures before raising its error.
                error = raised
        if error is not None:
            raise error
        return is_done

    def _try(self, future: TransformFuture, waited: Optional[float] = None) -> bool:
        """
        Call the lookup of a future, and complete the future with the result.

        If the lookup raises a TransformException before the timeout has expired, the future stays
        pending. If the lookup raises a TransformException after the timeout has expired, the
        future gets a TimeoutException. The future gets any other exception of the lookup.

        :param waited: the timeout (s) if it has expired; None if it has not expired.
        :returns: False if the future stays pending.
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
        self._complete(future, outcome)
        return True

    def _complete(self, future: TransformFuture, set_outcome: Callable[[], Any]) -> None:
        """If a future is pending, set its outcome, and wake the executor of the node."""
        if not self.forget(future):
            return
        set_outcome()
        if self._node is not None and (executor := self._node.executor) is not None:
            with suppress(AttributeError, InvalidHandle):  # if the executor is being shut down
                executor.wake()

    def _end_after(self, future: TransformFuture, timeout: float) -> None:
        """Register the timeout (s) of a future, and start `_thread` if it is not running."""
        reference = ref(future, lambda _: self._queue.put(None))
        self._queue.put((monotonic() + timeout, next(self._numbers), timeout, reference))
        with self._starting:
            if self._thread is None or not self._thread.is_alive():
                self._thread = Thread(target=self._watch_deadlines, daemon=True)
                self._thread.start()

    def _watch_deadlines(self) -> None:
        """End the futures that time out, until no pending future has a timeout."""
        deadlines = self._deadlines
        while True:
            if len(deadlines) > 2 * len(self._futures) + 10:
                deadlines[:] = filter(self._is_waiting, deadlines)
                heapq.heapify(deadlines)
            while deadlines and not self._is_waiting(deadlines[0]):
                heapq.heappop(deadlines)
            remaining = deadlines[0][0] - monotonic() if deadlines else 0.0
            try:
                if deadline := self._queue.get(timeout=min(max(0.0, remaining), TIMEOUT_MAX)):
                    heapq.heappush(deadlines, deadline)
                continue
            except Empty:
                pass
            if not deadlines:
                with self._starting:
                    if self._queue.empty():
                        self._thread = None
                        return
            elif deadlines[0][0] <= monotonic():
                _, _, timeout, reference = heapq.heappop(deadlines)
                if (future := reference()) is not None:
                    try:
                        self._try(future, timeout)
                    except BaseException:
                        # A done callback has failed. Its error must not end this thread.
                        get_logger('tf2_buffer').error(format_exc())
                    del future

    def _is_waiting(self, deadline: _Deadline) -> bool:
        """Return True if the future of a deadline is pending."""
        future = deadline[3]()
        return future is not None and id(future) in self._futures


def _raise() -> TransformStamped:
    """Raise a TransformException; `forget` replaces the lookup of a future by this function."""
    raise TransformException
