"""
Signal handlers that end a command on SIGINT (Ctrl-C) and SIGTERM.

The first signal is only recorded. The command checks for it where it can stop without leaving
anything half done: `sleep`, `wait_until` and `check_signals` raise KeyboardInterrupt, which
`cli.parser.run` turns into a normal end; the spinning of `cli.node` ends. The second signal raises
KeyboardInterrupt at once, except during the cleanup at the end of a command.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
import sys
import time
from typing import Any

_SIGNALS = signal.SIGINT, signal.SIGTERM
#: The longest `time.sleep` (s), which a recorded signal does not end (PEP 475).
_STEP = 0.05

_received: list[int] = []
#: The number of signals that are only recorded. Each signal after them raises KeyboardInterrupt.
_recorded = 1


def record_signals() -> dict[int, Any]:
    """Set the handlers; return the previous ones by signal, or {} if these are already set."""
    global _recorded
    if signal.getsignal(signal.SIGINT) is _record:
        return {}
    _received.clear()
    _recorded = 1
    return {number: signal.signal(number, _record) for number in _SIGNALS}


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Block all signals; threads and processes that the `with` block starts keep them blocked."""
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
    Make only the third signal and later ones raise KeyboardInterrupt, from now on.

    Ctrl-C in `make` sends two signals to a command: one from the terminal, and one from `make`.
    """
    global _recorded
    _recorded = 2


def forget_signals() -> None:
    """Forget the signals to which the command has reacted, since it goes on."""
    global _recorded
    _received.clear()
    _recorded = 1


def ignore_signals() -> None:
    """Ignore signals, since the process is about to exit."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def signal_received() -> int:
    """Return the first signal that was received, or 0."""
    return _received[0] if _received else 0


def sleep(seconds: float) -> None:
    """Sleep; raise KeyboardInterrupt if a signal has been recorded, before or meanwhile."""
    end = time.monotonic() + seconds
    while not _received and (left := end - time.monotonic()) > 0.0:
        time.sleep(min(_STEP, left))
    check_signals()


def wait_until(seconds: float, holds: Callable[[], object]) -> bool:
    """Sleep, but only until a condition holds, which is checked at once and every 0.05 s."""
    end = time.monotonic() + seconds
    while not (result := bool(holds())) and (left := end - time.monotonic()) > 0.0:
        sleep(min(_STEP, left))
    return result


def check_signals() -> None:
    if _received:
        raise KeyboardInterrupt


def _record(number: int, _: object) -> None:
    _received.append(number)
    if len(_received) > _recorded:
        raise KeyboardInterrupt
