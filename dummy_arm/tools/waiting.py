"""Waiting, with a progress bar on a terminal."""

from collections.abc import Callable
import time

from dummy_arm.interruption import sleep
from dummy_arm.progress import progress

_STEP = 0.05  # s
_BAR = '{desc} {bar} {n:.1f} of {total:g} s'


def wait(seconds: float, what: str, until: Callable[[], object] = lambda: False) -> bool:
    """
    Wait for a time, or until a condition holds.

    :param seconds: the time, at most.
    :param what: what is shown beside the bar.
    :returns: whether the condition holds.
    :raises KeyboardInterrupt: when a signal comes.
    """
    begin = time.monotonic()
    with progress(seconds, desc=what, bar_format=_BAR) as show:
        while not (holds := bool(until())) and (passed := time.monotonic() - begin) < seconds:
            show(passed)
            sleep(min(_STEP, seconds - passed))
    return holds
