"""Waiting, with a progress bar on a terminal."""

from collections.abc import Callable
import sys
import time

from tqdm import tqdm

from dummy_arm.interruption import sleep

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
    with tqdm(desc=what, total=seconds, bar_format=_BAR, leave=False,
              disable=not sys.stderr.isatty()) as bar:
        while not (holds := bool(until())) and (passed := time.monotonic() - begin) < seconds:
            bar.update(passed - bar.n)
            sleep(min(_STEP, seconds - passed))
    return holds
