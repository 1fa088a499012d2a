"""Measuring times."""

from collections.abc import Callable
import os
from timeit import Timer

#: The work, its cost, the same in u if it is a time, and what it is compared with.
Row = tuple[str, str, str, str]


def best(work: Callable[[], object]) -> float:
    """Measure the time of a call (s): the best of five runs of a tenth of a second each."""
    timer = Timer(work)
    count, _ = timer.autorange()
    count = max(1, count // 2)
    return min(timer.repeat(5, count)) / count


def cost(seconds: float, u: float) -> tuple[str, str]:
    """Write a time in µs, and in u (s); both with three digits."""
    return f'{_three_digits(seconds * 1e6)} µs', _three_digits(seconds / u)


def _three_digits(value: float) -> str:
    return f'{value:.0f}' if value >= 100.0 else f'{value:#.3g}'


def cpu_seconds(pid: int) -> float:
    """Read the user and system time (s) of a process, added up."""
    with open(f'/proc/{pid}/stat') as stat:
        fields = stat.read().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
