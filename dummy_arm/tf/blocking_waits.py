"""Waiting for data that are not there yet, in the thread that asks for them."""

from collections.abc import Callable
from threading import Condition
from time import monotonic
from typing import Any, TypeVar

from dummy_arm.tf.exceptions import TransformException

_Answer = TypeVar('_Answer')

#: How long a wait lasts before it sees that no data can come in any more (s).
_STEP = 0.2


class BlockingWaits:
    """The threads that wait for the data of a buffer."""

    def __init__(self, lock: Any) -> None:
        """
        Begin with none.

        :param lock: of the data; reentrant.
        """
        self._lock = lock
        self._changed = Condition(lock)
        self._count = 0

    def __bool__(self) -> bool:
        return self._count > 0

    def notify(self) -> None:
        """Have them look again."""
        if self._count:
            with self._changed:
                self._changed.notify_all()

    def wait(self, timeout: float, is_alive: Callable[[], bool], on_wait: Callable[[], None],
             lookup: Callable[..., _Answer], *arguments: Any) -> _Answer:
        """
        Call a lookup again and again, as data come in, until it answers or time is up.

        Where this thread has the lock, as in a signal handler that interrupted a lookup, nothing
        can come in: there it is called once.

        :param timeout: s.
        :param is_alive: tells whether data may come in; a wait ends when that ends.
        :param on_wait: is called before each lookup that is a wait, with the lock held.
        :raises TransformException: the last that the lookup raised.
        """
        try:
            return lookup(*arguments)
        except TransformException:
            if timeout <= 0.0 or self._lock._is_owned():
                raise
        deadline, was_alive = monotonic() + timeout, is_alive()
        with self._changed:
            self._count += 1
            try:
                while True:
                    on_wait()
                    try:
                        return lookup(*arguments)
                    except TransformException:
                        left = deadline - monotonic()
                        if left <= 0.0 or was_alive != is_alive():
                            raise
                    self._changed.wait(min(left, _STEP))
            finally:
                self._count -= 1
