"""
Let Ctrl-C and SIGTERM end a command normally.

At the first signal, the signal handler raises no exception; it only records the signal. The
command checks for a recorded signal at points where it can stop without leaving anything half
done. The second signal raises KeyboardInterrupt at once, except during the cleanup at the end of a
command.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
import sys
import time
from typing import Any

_SIGNALS = signal.SIGINT, signal.SIGTERM
#: The longest single `time.sleep` (s). If the signal handler raises no exception, the signal does
#: not end a `time.sleep` (PEP 475).
_STEP = 0.05

_received: list[int] = []
#: The number of signals that are only recorded. Each signal after them raises KeyboardInterrupt.
_recorded = 1


def record_signals() -> dict[int, Any]:
    """
    Record SIGINT and SIGTERM from now on; the second signal raises KeyboardInterrupt.

    :returns: the previous handlers, by signal number. If the handlers of this module are already
        set, nothing changes and the result is empty.
    """
    global _recorded
    if signal.getsignal(signal.SIGINT) is _record:
        return {}
    _received.clear()
    _recorded = 1
    return {number: signal.signal(number, _record) for number in _SIGNALS}


@contextmanager
def signals_blocked() -> Iterator[None]:
    """
    Block all signals; threads and processes that the `with` block starts keep them blocked.

    A signal of the kernel for a fault, such as SIGSEGV, has its effect all the same. On Windows,
    this does nothing.
    """
    if sys.platform == 'win32':
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_cleanup() -> None:
    """
    From now on, make the third signal raise KeyboardInterrupt instead of the second one.

    If the program `make` has started a command, Ctrl-C may send the command two signals: one from
    the terminal and one from `make`. The second signal must not interrupt the cleanup that the
    first signal caused.
    """
    global _recorded
    _recorded = 2


def forget_signals() -> None:
    """Forget the recorded signals, since the command has reacted to them and goes on."""
    global _recorded
    _received.clear()
    _recorded = 1


def ignore_signals() -> None:
    """Ignore SIGINT and SIGTERM from now on, since the process is about to exit."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def signal_received() -> bool:
    """Return whether a signal has been recorded."""
    return bool(_received)


def sleep(seconds: float) -> None:
    """
    Sleep until the time is over or a signal is recorded.

    :param seconds: how long to sleep (s).
    :raises KeyboardInterrupt: if a signal has been recorded, before or during the sleep.
    """
    end = time.monotonic() + seconds
    while not _received and (left := end - time.monotonic()) > 0.0:
        time.sleep(min(_STEP, left))
    check_signals()


def wait_until(seconds: float, holds: Callable[[], object]) -> bool:
    """
    Wait until a condition holds or the time is over.

    :param seconds: how long to wait at most (s).
    :param holds: a function that returns whether the condition holds. It is called at once, and
        then every 0.05 s.
    :returns: True if the condition holds; False if the time ended before the condition held.
    :raises KeyboardInterrupt: if a signal has been recorded, before or during the wait.
    """
    end = time.monotonic() + seconds
    while not (result := bool(holds())) and (left := end - time.monotonic()) > 0.0:
        sleep(min(_STEP, left))
    return result


def check_signals() -> None:
    """Raise KeyboardInterrupt if a signal has been recorded."""
    if _received:
        raise KeyboardInterrupt


def _record(number: int, _: object) -> None:
    _received.append(number)
    if len(_received) > _recorded:
        raise KeyboardInterrupt
