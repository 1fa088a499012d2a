"""Ctrl-C and SIGTERM as normal ends: noted when they come, heeded where nothing is half done."""

import signal
import time
from typing import Any

_SIGNALS = signal.SIGINT, signal.SIGTERM
_STEP = 0.05  # s; a signal that is only noted does not end a sleep

_came: list[int] = []


def record_signals() -> dict[int, Any]:
    """
    Note signals from now on; the second raises KeyboardInterrupt.

    :returns: the handlers before; none where signals are noted already: what came stays noted.
    """
    if signal.getsignal(signal.SIGINT) is _note:
        return {}
    _came.clear()
    return {number: signal.signal(number, _note) for number in _SIGNALS}


def ignore_signals() -> None:
    """Let signals do nothing more: it ends as it is."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def signal_received() -> bool:
    """Tell whether a signal has come."""
    return bool(_came)


def sleep(seconds: float) -> None:
    """Sleep; raise KeyboardInterrupt when a signal comes, or has come."""
    end = time.monotonic() + seconds
    while not _came and (left := end - time.monotonic()) > 0.0:
        time.sleep(min(_STEP, left))
    check_signals()


def check_signals() -> None:
    """Raise KeyboardInterrupt when a signal has come."""
    if _came:
        raise KeyboardInterrupt


def _note(number: int, _: object) -> None:
    _came.append(number)
    if len(_came) > 1:
        raise KeyboardInterrupt
