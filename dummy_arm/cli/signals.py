"""
Ctrl-C and SIGTERM as normal ends of a command.

The signal handler only records the first signal. The command checks for it where it can stop
without leaving anything half done. The second signal raises KeyboardInterrupt at once, but not
during the cleanup.
"""

import signal
import time
from typing import Any

_SIGNALS = signal.SIGINT, signal.SIGTERM
#: The longest `time.sleep` (s). The first signal does not end a `time.sleep`, because its handler
#: raises no exception (PEP 475).
_STEP = 0.05

_received: list[int] = []
#: The number of signals that are recorded before the next one raises KeyboardInterrupt.
_recorded = 1


def record_signals() -> dict[int, Any]:
    """
    Record SIGINT and SIGTERM from now on; the second signal raises KeyboardInterrupt.

    :returns: the previous handler of each signal. If signals are recorded already, nothing changes
        and the result is empty.
    """
    global _recorded
    if signal.getsignal(signal.SIGINT) is _record:
        return {}
    _received.clear()
    _recorded = 1
    return {number: signal.signal(number, _record) for number in _SIGNALS}


def begin_cleanup() -> None:
    """
    Record a second signal, too: from now on, only the third one raises KeyboardInterrupt.

    A terminal and make may both send a signal at Ctrl-C. The second one must not interrupt the
    cleanup that the first one has caused.
    """
    global _recorded
    _recorded = 2


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


def check_signals() -> None:
    """Raise KeyboardInterrupt if a signal has been recorded."""
    if _received:
        raise KeyboardInterrupt


def _record(number: int, _: object) -> None:
    _received.append(number)
    if len(_received) > _recorded:
        raise KeyboardInterrupt
