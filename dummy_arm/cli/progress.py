"""Progress bars on a terminal; waiting with one."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import sys
import time
from typing import Any

from dummy_arm.cli.signals import sleep

_STEP = 0.05  # s
_BAR = '{desc} {bar} {n:.1f} of {total:g} s'


@contextmanager
def progress(total: float, **kwargs: Any) -> Iterator[Callable[[float], object]]:
    """
    Show a progress bar from here to the end of the block.

    Where stderr is no terminal, or tqdm is not installed, nothing is shown.

    :param total: what the bar counts up to.
    :param kwargs: of tqdm: `desc`, `bar_format`.
    :returns: a function that shows how much is done.
    """
    try:
        from tqdm import tqdm
    except ImportError:
        tqdm = None
    if tqdm is None or not (sys.stderr and sys.stderr.isatty()):
        yield lambda done: None
        return
    shown = 0.0
    with tqdm(total=total, leave=False, **kwargs) as bar:
        def show(done: float) -> None:
            nonlocal shown
            if done != shown:  # else it would take most of the time
                shown = done
                bar.update(done - bar.n)

        yield show


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
