"""A wake-up call for one waiting thread."""

from contextlib import suppress
from threading import Lock


class Wake:
    """
    Wakes one waiting thread; signal handlers may interrupt each method, and call it.

    `SimpleQueue.get` is no way to wait for some time: in Python up to 3.12, it waits for ever if a
    signal arrives shortly before its timeout.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._lock.acquire()

    def set(self) -> None:
        """Wake the thread, now or when it waits."""
        with suppress(RuntimeError):  # it is set
            self._lock.release()

    def is_set(self) -> bool:
        return not self._lock.locked()

    def wait(self, timeout: float) -> bool:
        """Wait until it is set, and reset it; return False if the timeout (s) is over before."""
        return self._lock.acquire(timeout=timeout)
