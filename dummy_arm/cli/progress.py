"""Progress bars on a terminal, and a wait with a progress bar."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import sys
import time
from typing import Any

from dummy_arm.cli.signals import wait_until

_BAR = '{desc} {bar} {n:.1f} of {total:g} s'
#: How long to wait at least for another process (s). On a busy computer, discovery can take this
#: long: Fast DDS announces a participant every 3 s.
DISCOVERY = 7.0


@contextmanager
def progress(total: float, **kwargs: Any) -> Iterator[Callable[[float], object]]:
    """
    Show a progress bar until the end of the `with` block.

    Nothing is shown if stderr is not a terminal, or if the library `tqdm` is not installed.

    :param total: the value at which the bar is full.
    :param kwargs: further arguments of the class `tqdm.tqdm`, such as `desc`.
    :returns: a context manager. In `with progress(10) as show:`, `show(3)` sets the bar to 3.
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
            """
            Move the bar.

            :param done: the new value of the bar, at most `total`.
            """
            nonlocal shown
            if done != shown:  # drawing an unchanged bar would only cost time
                shown = done
                bar.update(done - bar.n)

        yield show


def wait(seconds: float, what: str, until: Callable[[], object] = lambda: False) -> bool:
    """
    Show a progress bar while waiting until a condition holds or the time is over.

    :param seconds: how long to wait at most (s).
    :param what: the text beside the bar.
    :param until: a function that returns whether the condition holds. It is called at once, and
        then every 0.05 s. The default is a condition that never holds.
    :returns: True if the condition holds; False if the time ended before the condition held.
    :raises KeyboardInterrupt: if Ctrl-C or SIGTERM was received; see `dummy_arm.cli.signals`.
    """
    start = time.monotonic()
    with progress(seconds, desc=what, bar_format=_BAR) as show:
        def holds() -> bool:
            """Move the bar, and return whether the condition holds."""
            show(min(seconds, time.monotonic() - start))
            return bool(until())

        return wait_until(seconds, holds)


def listen(seconds: float, has_received: Callable[[], object],
           poll: Callable[[], object] = lambda: None) -> float:
    """
    Wait for the first transform; then wait for some time, with a progress bar.

    Ctrl-C or SIGTERM ends the wait early.

    :param seconds: how long to wait after the first transform (s). If none is received within this
        time, or within 7 s if this is longer, the wait ends.
    :param has_received: a function that returns whether a transform has been received.
    :param poll: a function that is called every 0.05 s, and once more at the end.
    :returns: how long this function has waited after the first transform, or at all (s).
    """
    start = time.monotonic()
    with suppress(KeyboardInterrupt):
        if wait(max(DISCOVERY, seconds), 'waiting for transforms',
                lambda: poll() or has_received()):
            start = time.monotonic()
            wait(seconds, 'listening', lambda: poll() and False)
    poll()
    return time.monotonic() - start
