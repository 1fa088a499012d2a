"""Futures for transforms that are not available yet."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import inf
import os
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

from puretf._causes.facts import Waited
from puretf._core.wake import Wake
from puretf._ros.rclpy_private import is_of_executor
from puretf.exceptions import TimeoutException, TransformException


class TransformFuture(Future):
    """
    A future whose result is a TransformStamped.

    To stop waiting, cancel the future. If it has never had a done callback, it is enough to drop
    the last reference to the future.
    """

    def __init__(self, owner: 'PendingFutures', lookup: Callable[[], TransformStamped],
                 timeout: Optional[float], what: str) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.lookup, self.timeout, self.what, self._owner = lookup, timeout, what, owner
        self.deadline = inf if timeout is None else monotonic() + timeout

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        """Add a function that is called when this future is done; keep the future until then."""
        super().add_done_callback(callback)  # type: ignore[no-untyped-call]
        # `spin_until_future_complete` keeps the future alive itself, but leaves its callback when
        # the spin times out.
        if not is_of_executor(callback):
            self._owner.keep(self)

    def cancel(self) -> None:
        if self._owner.forget(self):
            super().cancel()  # type: ignore[no-untyped-call]


class PendingFutures:
    """
    The futures that wait for the data of a buffer; a `Waiter` of its engine.

    `_futures` needs no lock: each change is one atomic operation, and only the thread that has
    removed a future completes it. So the garbage collector, which removes dropped futures, and
    signal handlers may interrupt any method. A `Wake` allows that, too.
    """

    def __init__(self, node: Optional[Node]) -> None:
        """Create an empty set; when a future is done, the executor of the node is woken."""
        self._node, self._process = node, os.getpid()
        #: The pending futures, by their `id`.
        self._futures: dict[int, ref[TransformFuture]] = {}
        #: The futures that were passed to `keep` and are pending. This set keeps them alive.
        self._kept: set[TransformFuture] = set()
        self._wake = Wake()
        self._starting = RLock()
        #: The thread that ends futures by timeout; None while no future has one.
        self._thread: Optional[Thread] = None

    @property
    def is_waiting(self) -> bool:
        return bool(self._futures)

    def add(self, lookup: Callable[[], TransformStamped], timeout: Optional[float], what: str
            ) -> Future:
        """
        Create a future; if its lookup succeeds now, the future is already done.

        :param lookup: raises a TransformException while the result is not available.
        :param timeout: s; None: no limit.
        :param what: the transform, for the text of the TimeoutException.
        """
        if os.getpid() != self._process:
            raise RuntimeError('this buffer was created before the process was forked: lookups '
                               'work here, but nothing completes a future; create another buffer')
        future = TransformFuture(self, lookup, timeout, what)
        key = id(future)
        self._futures[key] = ref(future, partial(self._remove, key))
        try:
            transform = lookup()
        except TransformException:
            if timeout is not None:
                self._wake.set()
                with self._starting:
                    if self._thread is None:
                        self._thread = Thread(target=self._watch_deadlines, daemon=True)
                        self._thread.start()
        except BaseException:
            self.forget(future)
            raise
        else:
            self._complete(future, partial(future.set_result, transform))
        return future

    def keep(self, future: TransformFuture) -> None:
        """Keep a reference to a future until it is done."""
        self._kept.add(future)
        if id(future) not in self._futures:
            self._kept.discard(future)

    def forget(self, future: TransformFuture) -> bool:
        """Remove a future; return True if it was pending; then only the caller may complete it."""
        was_pending = self._remove(id(future))
        self._kept.discard(future)
        # rclpy may refer to the future for longer, and its lookup refers to the buffer.
        future.lookup = _raise
        return was_pending

    def _remove(self, key: int, _: Any = None) -> bool:
        was_pending = self._futures.pop(key, None) is not None
        if not self._futures and self._thread is not None:
            self._wake.set()  # the thread ends
        return was_pending

    def check(self) -> bool:
        """Complete the futures whose transforms are available; return True if there are some."""
        is_done, error = False, None
        for future in self._pending():
            try:
                is_done |= self._try(future)
            except BaseException as raised:
                # A done callback has failed. Try the other futures before raising its error.
                error = raised
        if error is not None:
            raise error
        return is_done

    def _pending(self) -> list[TransformFuture]:
        return [future for reference in self._futures.copy().values()
                if (future := reference()) is not None]

    def _try(self, future: TransformFuture, is_expired: bool = False) -> bool:
        """Complete a future if its lookup succeeds or it is expired; return True if so."""
        try:
            outcome = partial(future.set_result, future.lookup())
        except TransformException as error:
            if not is_expired:
                return False
            error._waited = Waited(future.timeout or 0.0)
            outcome = partial(future.set_exception, TimeoutException(
                f'Timed out after {future.timeout:g} s, waiting for {future.what}: {error}'))
        except Exception as error:
            outcome = partial(future.set_exception, error)
        self._complete(future, outcome)
        return True

    def _complete(self, future: TransformFuture, set_outcome: Callable[[], Any]) -> None:
        if not self.forget(future):
            return
        set_outcome()
        if self._node is not None and (executor := self._node.executor) is not None:
            with suppress(AttributeError, InvalidHandle):  # if the executor is being shut down
                executor.wake()

    def _watch_deadlines(self) -> None:
        """End the futures that time out, until no pending future has a timeout."""
        while True:
            deadline = min((each.deadline for each in self._pending()), default=inf)
            with self._starting:
                if deadline == inf and not self._wake.is_set():
                    self._thread = None
                    return
            self._wake.wait(min(max(0.0, deadline - monotonic()), TIMEOUT_MAX))
            self._end_expired()

    def _end_expired(self) -> None:
        """End the futures whose timeouts are over; the calling frame keeps none of them."""
        for future in self._pending():
            if future.deadline <= monotonic():
                try:
                    self._try(future, True)
                except BaseException:
                    # A done callback has failed. Its error must not end this thread.
                    get_logger('tf2_buffer').error(format_exc())


def _raise() -> TransformStamped:
    raise TransformException
