"""Futures for transforms that are not there yet."""

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

    To stop waiting, cancel it, or drop the last reference to it if it has no done callback.
    """

    def __init__(self, owner: 'PendingFutures', lookup: Callable[[], TransformStamped],
                 what: str) -> None:
        """
        Create a future that is not done.

        :param lookup: returns the result, or raises a TransformException as long as there is none.
        :param what: what is waited for, for the error when it takes too long.
        """
        super().__init__()  # type: ignore[no-untyped-call]
        self.lookup, self.what = lookup, what
        self._owner = owner

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        """Add a function to be called when this is done; until then the future is kept."""
        super().add_done_callback(callback)  # type: ignore[no-untyped-call]
        if not is_of_executor(callback):  # which holds this, and would do so for ever
            self._owner.keep(self)

    def cancel(self) -> None:
        """Stop waiting."""
        if self._owner.forget(self):
            super().cancel()  # type: ignore[no-untyped-call]


#: The deadline (s, of the monotonic clock), a tie-breaker, the timeout (s), and the future.
_Deadline = tuple[float, int, float, 'ref[TransformFuture]']


class PendingFutures:
    """
    The futures that wait for the data of a buffer.

    There is no lock: each change of `_futures` is one operation of a dict, and whoever removes a
    future from it is the one that finishes it. So a signal handler or the garbage collector may
    interrupt any of these methods.
    """

    def __init__(self, node: Optional[Node]) -> None:
        """
        Create without futures.

        :param node: its executor is woken when a future is done.
        """
        self._node = node
        self._futures: dict[int, ref[TransformFuture]] = {}
        #: Those with a done callback, which are kept alive.
        self._kept: set[TransformFuture] = set()
        self._numbers = count()
        #: New deadlines for the thread that watches them; None wakes it.
        self._queue: SimpleQueue[Optional[_Deadline]] = SimpleQueue()
        #: A heap of deadlines, which only that thread uses.
        self._deadlines: list[_Deadline] = []
        self._starting = RLock()
        self._thread: Optional[Thread] = None

    def __len__(self) -> int:
        return len(self._futures)

    def add(self, lookup: Callable[[], TransformStamped], timeout: Optional[float], what: str
            ) -> Future:
        """
        Return a future, which is done if its lookup returns an answer now.

        :param timeout: after how long the wait ends with a TimeoutException (s); None: never.
        :param what: what is waited for, for that error.
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
            self._finish(future, partial(future.set_result, transform))
        return future

    def keep(self, future: TransformFuture) -> None:
        """Keep a future that somebody waits for, until it is done."""
        self._kept.add(future)
        if id(future) not in self._futures:
            self._kept.discard(future)

    def forget(self, future: TransformFuture) -> bool:
        """Forget a future; return whether it was waiting."""
        was_waiting = self._futures.pop(id(future), None) is not None
        self._kept.discard(future)
        future.lookup = _nothing  # rclpy may keep the future alive, but not the buffer with it
        if self._thread is not None:
            self._queue.put(None)
        return was_waiting

    def check(self) -> bool:
        """Finish the futures for which there are answers now; return whether there were any."""
        futures = [future for reference in self._futures.copy().values()
                   if (future := reference()) is not None]
        is_done, error = False, None
        for future in futures:
            try:
                is_done |= self._try(future)
            except BaseException as raised:  # by a done callback; the others have their turn, too
                error = raised
        if error is not None:
            raise error
        return is_done

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
        """Have the thread end a wait after a timeout (s)."""
        reference = ref(future, lambda _: self._queue.put(None))
        self._queue.put((monotonic() + timeout, next(self._numbers), timeout, reference))
        with self._starting:
            if self._thread is None or not self._thread.is_alive():
                self._thread = Thread(target=self._watch_deadlines, daemon=True)
                self._thread.start()

    def _watch_deadlines(self) -> None:
        """End the waits whose time is up, until there are none that may have to be ended."""
        deadlines = self._deadlines
        while True:
            if len(deadlines) > 2 * len(self._futures) + 10:
                deadlines[:] = filter(self._is_waiting, deadlines)
                heapq.heapify(deadlines)
            while deadlines and not self._is_waiting(deadlines[0]):
                heapq.heappop(deadlines)
            left = deadlines[0][0] - monotonic() if deadlines else 0.0
            try:
                if entry := self._queue.get(timeout=min(max(0.0, left), TIMEOUT_MAX)):
                    heapq.heappush(deadlines, entry)
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
                    except BaseException:  # of a done callback; the other deadlines go on
                        get_logger('tf2_buffer').error(format_exc())
                    del future

    def _is_waiting(self, deadline: _Deadline) -> bool:
        future = deadline[3]()
        return future is not None and id(future) in self._futures


def _nothing() -> TransformStamped:
    """Raise, in place of the lookup of a completed future."""
    raise TransformException
