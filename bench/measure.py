"""Measuring times."""

from collections.abc import Callable
import os
from timeit import Timer

#: The work, what it costs, and what that is compared with something else.
Row = tuple[str, str, str]


def best(work: Callable[[], object]) -> float:
    """Measure the time of a call (s): the best of five runs of a tenth of a second each."""
    timer = Timer(work)
    count, _ = timer.autorange()
    count = max(1, count // 2)
    return min(timer.repeat(5, count)) / count


def cpu_seconds(pid: int) -> float:
    """Read the user and system time (s) of a process, added up."""
    with open(f'/proc/{pid}/stat') as stat:
        fields = stat.read().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
