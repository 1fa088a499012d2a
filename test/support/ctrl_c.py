"""KeyboardInterrupt at each line of some files."""

from collections.abc import Callable, Iterator
from itertools import count
import linecache
from pathlib import Path
import sys
from typing import Any, Optional


def interruptions(prepare: Callable[[], Callable[[], object]], *files: str, step: int = 1
                  ) -> Iterator[Optional[KeyboardInterrupt]]:
    """
    Run some work repeatedly, each time with a KeyboardInterrupt before another line.

    Lines with `with` are left out: no signal is handled between `__enter__` and the block, nor
    between the block and `__exit__`, if both methods are written in C.

    :param prepare: called before each run; returns the work, a function.
    :param files: the names of the files, without directories.
    :param step: interrupt before every line (1), or only before each `step`-th line.
    :returns: an iterator over the exceptions, one for each run; the last item is None, since the
        last run was not interrupted.
    """
    for number in count(0, step):
        interrupt = _interrupted(prepare(), number, files)
        yield interrupt
        if interrupt is None:
            return


def _interrupted(work: Callable[[], object], number: int, files: tuple[str, ...]
                 ) -> Optional[KeyboardInterrupt]:
    left = number

    def trace(frame: Any, event: str, _: object) -> Any:
        nonlocal left
        path = frame.f_code.co_filename
        if event == 'call':
            return trace if Path(path).name in files else None
        if event == 'line' and not linecache.getline(path, frame.f_lineno).strip().startswith(
                'with '):
            left -= 1
            if left < 0:
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    try:
        sys.settrace(trace)
        work()
    except KeyboardInterrupt as error:
        return error
    finally:
        sys.settrace(before)
    return None
