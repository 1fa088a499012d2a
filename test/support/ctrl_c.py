"""KeyboardInterrupt at every place where Python can raise it."""

from collections.abc import Callable, Iterator
import dis
from functools import cache
from itertools import count
from pathlib import Path
import re
import sys
from types import CodeType
from typing import Any, Optional


def interruptions(prepare: Callable[[], Callable[[], object]], *files: str, step: int = 1
                  ) -> Iterator[Optional[KeyboardInterrupt]]:
    """
    Run some work repeatedly, each time with a KeyboardInterrupt at the next place in some files.

    Python runs signal handlers at the start of a function, after a call and when a loop jumps
    back: ceval.c, CHECK_EVAL_BREAKER.

    :param prepare: called before each run; returns the work, a function.
    :param files: the names of the files, without directories.
    :param step: interrupt at every place (1), or only at each `step`-th place.
    :returns: an iterator over the exceptions, one for each run; the last item is None, since the
        last run was not interrupted.
    """
    loaded = {Path(file).name for module in sys.modules.values()
              if (file := getattr(module, '__file__', None))}
    assert loaded.issuperset(files)
    for number in count(0, step):
        interrupt = _interrupted(prepare(), number, files)
        yield interrupt
        if interrupt is None:
            return


@cache
def _handler(code: CodeType, offset: int) -> Any:
    """Return the offset of the exception handler of an instruction; None before Python 3.11."""
    entries = getattr(dis.Bytecode(code), 'exception_entries', ())
    return next((entry.target for entry in entries if entry.start <= offset < entry.end), None)


def _interrupted(work: Callable[[], object], number: int, files: tuple[str, ...]
                 ) -> Optional[KeyboardInterrupt]:
    """Run the work with a KeyboardInterrupt at one place; return it, or None if it ended."""
    left, last = number, {}

    def trace(frame: Any, event: str, _: object) -> Any:
        nonlocal left
        if event == 'call' and Path(frame.f_code.co_filename).name not in files:
            return None
        frame.f_trace_opcodes = True
        if event == 'call':
            last[id(frame)] = 'start', None
        if event == 'exception':  # the last call has not returned: no signal is handled after it
            last[id(frame)] = 'raised', None
        if event == 'opcode':
            now = dis.opname[frame.f_code.co_code[frame.f_lasti]]
            handler = _handler(frame.f_code, frame.f_lasti)
            (before, handler_before), last[id(frame)] = last[id(frame)], (now, handler)
            is_raised = now in ('PUSH_EXC_INFO', 'POP_EXCEPT')  # an error of the callee
            # CPython raises KeyboardInterrupt where the handler of the call catches it. A trace
            # function raises at the next instruction, which must have the same handler.
            is_same = before == 'start' or handler == handler_before
            if re.match('start|CALL|JUMP_BACKWARD|JUMP_ABS', before) and is_same and (
                    not is_raised):
                left -= 1
                if left < 0:
                    sys.settrace(None)
                    raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys._getframe().f_trace_opcodes = True  # else Python 3.12 traces opcodes of no frame
    try:
        sys.settrace(trace)
        work()
    except KeyboardInterrupt as error:
        return error
    finally:
        sys.settrace(before)
    return None
