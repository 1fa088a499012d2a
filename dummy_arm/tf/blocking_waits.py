"""Waiting for data that are not there yet, in the thread that asks for them."""

from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any, TypeVar

from dummy_arm.tf.exceptions import TransformException

_Answer = TypeVar('_Answer')

#: How long a wait lasts before it sees that no data can come in any more (s).
_STEP = 0.2


class BlockingWaits:
    """
    The threads that wait for the data of a buffer, each on a queue of its own.

    Not on a Condition: Ctrl-C inside its methods can leave the buffer locked.
    """

    def __init__(self, lock: Any) -> None:
        """
        Create without a waiting thread.

        :param lock: of the data; reentrant.
        """
        self._lock = lock
        self._queues: set[SimpleQueue[None]] = set()

    def __bool__(self) -> bool:
        return bool(self._queues)

    def forget(self) -> None:
        """Forget all threads that wait: this is in a process that was forked, without them."""
        self._queues.clear()

    def notify(self) -> None:
        """Wake all threads that wait, so that they look again."""
        for queue in tuple(self._queues):
            if queue.empty():
                queue.put(None)

    def wait(self, timeout: float, conditions: Callable[[], tuple[bool, ...]],
             on_wait: Callable[[], None], lookup: Callable[..., _Answer], *arguments: Any
             ) -> _Answer:
        """
        Call a lookup again and again, as data come in, until it answers or time is up.

        Where this thread has the lock, as in a signal handler that interrupted a lookup, nothing
        can come in: there it is called once.

        :param timeout: s.
        :param conditions: return what data may depend on. The wait ends when one of them was true
            at its begin and is no longer.
        :param on_wait: is called before each lookup of a wait.
        :raises TransformException: the last that the lookup raised.
        """
        try:
            return lookup(*arguments)
        except TransformException:
            if timeout <= 0.0 or self._lock._is_owned():
                raise
        deadline, before = monotonic() + timeout, conditions()
        queue: SimpleQueue[None] = SimpleQueue()
        try:
            self._queues.add(queue)
            while True:
                now = conditions()  # before the lookup, which then sees the last data that came
                on_wait()
                try:
                    return lookup(*arguments)
                except TransformException:
                    left = deadline - monotonic()
                    if left <= 0.0 or any(held and not holds for held, holds in zip(before, now)):
                        raise
                with suppress(Empty):
                    queue.get(timeout=min(left, _STEP))
        finally:
            self._queues.discard(queue)
