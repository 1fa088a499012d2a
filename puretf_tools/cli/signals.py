"""
Signal handlers that end a command on SIGINT (Ctrl-C) and SIGTERM.

The first signal is only recorded. The command checks for it where it can stop without leaving
anything half done: `sleep`, `wait_until` and `check_signals` raise KeyboardInterrupt. If nothing
checks for it within 2 s, as in a long loop of a library, the first signal raises it, too. The
second signal does so at once, except during the cleanup at the end of a command.

The last resort: if the shutdown of ROS, or then the exit of Python, takes more than 5 s each, or
at the third signal in it, the process ends at once, by _exit. Nothing but this is limited: a
command may go on after Ctrl-C, and write what it has recorded.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import faulthandler
import gc
import os
import signal
import sys
import time
from typing import Any

_SIGNALS = signal.SIGINT, signal.SIGTERM
#: The longest `time.sleep` (s), which a recorded signal does not end (PEP 475).
_STEP = 0.05
#: How long a command may go on without a check for a signal that it has received (s).
_LONGEST_UNCHECKED = 2.0
#: How long the shutdown of ROS, and the exit of Python, may take (s).
_LONGEST_END = 5

_received: list[int] = []
#: The number of signals that are only recorded. Each signal after them raises KeyboardInterrupt.
_recorded = 1


def record_signals(has_limit: bool = False) -> dict[int, Any]:
    """
    Set the handlers that are not set yet; return the previous ones by signal.

    :param has_limit: whether a signal that is not checked for within 2 s ends the command.
    """
    handlers = dict[int, Any]()
    if signal.getsignal(signal.SIGINT) is not _record:
        forget_signals()
        handlers = {number: signal.signal(number, _record) for number in _SIGNALS}
    if has_limit and sys.platform != 'win32':
        handlers[signal.SIGALRM] = signal.signal(signal.SIGALRM, signal.default_int_handler)
    return handlers


def restore_signals(handlers: dict[int, Any]) -> None:
    """Set the handlers that `record_signals` has returned."""
    _set_timer(0.0)
    for number, handler in handlers.items():
        signal.signal(number, handler)


def _set_timer(seconds: float) -> None:
    """Set the timer of the limit, if there is one: in an import, there is none."""
    if sys.platform != 'win32' and (
            signal.getsignal(signal.SIGALRM) is signal.default_int_handler):
        # Again and again, since what is raised in a callback of the garbage collector is lost.
        signal.setitimer(signal.ITIMER_REAL, seconds, seconds)


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
    Limit the time of what follows, and make only the third signal and later ones end it.

    Ctrl-C in `make` sends two signals to a command: one from the terminal, and one from `make`.
    """
    global _recorded
    _recorded = 2
    _set_timer(0.0)
    _limit_end()


def end_cleanup() -> None:
    """Take the limit back, since ROS is shut down, and the command may go on."""
    global _recorded
    _recorded = 1
    faulthandler.cancel_dump_traceback_later()


def _limit_end() -> None:
    """
    Print the stacks of all threads and end the process, unless the limit is taken back in time.

    Fast DDS may wait for ever, while the GIL is held, for a lock that a killed process has left.
    Then no Python code runs, and no signal handler, but the thread of faulthandler does.
    """
    faulthandler.dump_traceback_later(_LONGEST_END, file=2, exit=True)


def forget_signals() -> None:
    """Forget the signals to which the command has reacted, since it goes on."""
    global _recorded
    _received.clear()
    _recorded = 1


def begin_exit() -> None:
    """Ignore signals, and limit the time until the process ends, since it is about to exit."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # else Python would look for garbage among all objects once more
    _limit_end()


def signal_received() -> int:
    """Return the first signal that was received, or 0."""
    if _received:
        _set_timer(0.0)
        return _received[0]
    return 0


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
    if signal_received():
        raise KeyboardInterrupt


def _record(number: int, _: object) -> None:
    _received.append(number)
    if len(_received) > _recorded:
        if _recorded == 2:
            name = os.path.basename(sys.argv[0])
            os.write(2, os.fsencode(f'{name}: ended before the cleanup was complete\n'))
            os._exit(128 + _received[0])
        raise KeyboardInterrupt
    if _recorded == 1:  # the cleanup has its own limit
        _set_timer(_LONGEST_UNCHECKED)
