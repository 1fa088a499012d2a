"""KeyboardInterrupt at every place at which Python may raise it."""

from collections.abc import Callable, Iterator
import dis
from itertools import count
from pathlib import Path
import re
import sys
from typing import Any, Optional


def interruptions(prepare: Callable[[], Callable[[], object]], *files: str
                  ) -> Iterator[Optional[KeyboardInterrupt]]:
    """
    Do work again and again, each time with Ctrl-C at the next place in some files.

    Python runs signal handlers at the start of a function, after a call and when a loop jumps
    back: ceval.c, CHECK_EVAL_BREAKER.

    :param prepare: returns the work, before each time.
    :param files: the names of the files.
    :returns: what was raised, after each time; None after the last, which was not interrupted.
    """
    for number in count():
        interrupt = _interrupted(prepare(), number, files)
        yield interrupt
        if interrupt is None:
            return


def _interrupted(work: Callable[[], object], number: int, files: tuple[str, ...]
                 ) -> Optional[KeyboardInterrupt]:
    left, last = number, {}

    def trace(frame: Any, event: str, _: object) -> Any:
        nonlocal left
        if event == 'call' and Path(frame.f_code.co_filename).name not in files:
            return None
        frame.f_trace_opcodes = True
        if event == 'call':
            last[id(frame)] = 'start'
        if event == 'opcode':
            before, last[id(frame)] = last[id(frame)], dis.opname[
                frame.f_code.co_code[frame.f_lasti]]
            is_raised = last[id(frame)] in ('PUSH_EXC_INFO', 'POP_EXCEPT')  # by what was called
            if re.match('start|CALL|JUMP_BACKWARD|JUMP_ABS', before) and not is_raised:
                left -= 1
                if left < 0:
                    sys.settrace(None)
                    raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys._getframe().f_trace_opcodes = True  # else Python 3.12 traces those of no frame
    try:
        sys.settrace(trace)
        work()
    except KeyboardInterrupt as error:
        return error
    finally:
        sys.settrace(before)
    return None
