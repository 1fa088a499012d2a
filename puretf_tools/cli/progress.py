"""Progress bars on a terminal, and waits with a progress bar: how long the commands listen."""

from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import sys
import time
from typing import Any

from puretf_tools.cli.parser import number
from puretf_tools.cli.signals import check_signals, signals_blocked, wait_until

#: The format of a bar over a time (s).
BAR = '{desc} {bar} {n:.1f} of {total:g} s'
#: On a busy computer, discovery can take this long (s): Fast DDS announces itself every 3 s.
DISCOVERY = 7.0
#: How long the commands listen by default, and at most (s).
DEFAULT_TIME, _LONGEST_TIME = 5.0, 1e9


@contextmanager
def progress(total: float, **kwargs: Any) -> Iterator[Callable[..., object]]:
    """
    Show a bar if stderr is a terminal and `tqdm` is installed.

    In `with progress(10.0) as show:`, `show(3.0)` sets the bar to 3, and `show(3.0, 'eating')` its
    description, too; a signal that was recorded ends it, by KeyboardInterrupt.
    """
    try:
        from tqdm import tqdm
    except ImportError:
        tqdm = None
    if tqdm is None or not sys.stderr:
        yield lambda *_: check_signals()
        return
    with signals_blocked():  # in its thread; this one is to receive them
        bar = tqdm(total=total, leave=False, disable=None, **kwargs)  # None: in a pipe
    with bar:
        def show(done: float, what: str = '') -> None:
            check_signals()
            if what:
                bar.set_description_str(what, refresh=False)
            bar.update(done - bar.n)

        yield show


def wait(seconds: float, what: str, until: Callable[[], object] = lambda: False) -> bool:
    """Wait as `wait_until` does, with a bar; by default, for the whole time."""
    start = time.monotonic()
    with progress(seconds, desc=what, bar_format=BAR) as show:
        def holds() -> bool:
            show(min(seconds, time.monotonic() - start))
            return bool(until())

        return wait_until(seconds, holds)


def listening_time(text: str) -> float:
    """Convert an argument to how long a command listens (s)."""
    seconds = number(text)
    if not 0.0 < seconds <= _LONGEST_TIME:
        raise ArgumentTypeError(f'the time to listen must be more than 0 s, and at most '
                                f'{_LONGEST_TIME:g} s, got {seconds:g}')
    return seconds


def listen(seconds: float, has_received: Callable[[], object],
           poll: Callable[[], object] = lambda: None) -> float:
    """
    Wait for the first transform, and then for some time (s); a signal ends the wait early.

    If nothing is received within the larger of `seconds` and 7 s, the wait ends.

    :param poll: called every 0.05 s, and once more at the end.
    :returns: how long it has waited (s), since the first transform if one was received.
    """
    start = time.monotonic()
    with suppress(KeyboardInterrupt):
        if wait(max(DISCOVERY, seconds), 'waiting for transforms',
                lambda: poll() or has_received()):
            start = time.monotonic()
            wait(seconds, 'listening', lambda: poll() and False)
    poll()
    return time.monotonic() - start
