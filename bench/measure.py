"""The measurement of times. When run by itself, the times of imports."""

from collections.abc import Callable, Iterator
from importlib.util import find_spec
import os
import subprocess
import sys
from time import perf_counter
from timeit import Timer

#: The work, its cost, its cost in u if it is a time, and what it is compared with.
Row = tuple[str, str, str, str]


def best(work: Callable[[], object]) -> float:
    """Return the time of a call (s): the best of five runs of a tenth of a second each."""
    timer = Timer(work)
    count, _ = timer.autorange()
    count = max(1, count // 2)
    return min(timer.repeat(5, count)) / count


def cost(seconds: float, u: float) -> tuple[str, str]:
    """
    Return a time in µs and in u, each with three digits.

    :param seconds: the time (s).
    :param u: the unit u (s).
    """
    return f'{_three_digits(seconds * 1e6)} µs', _three_digits(seconds / u)


def _three_digits(value: float) -> str:
    return f'{value:.0f}' if value >= 100.0 else f'{value:#.3g}'


def has_real_tf2() -> bool:
    """Return True if the tf2 of ROS is installed; the packages of `compat` are this package."""
    return find_spec('tf2_py') is not None and find_spec('tf2_py._tf2_py') is not None


def imports() -> Iterator[Row]:
    """Yield the time of a process that imports a buffer and a listener, by both of their names."""
    codes = ['import rclpy.node', 'from puretf import Buffer, TransformListener',
             'from tf2_ros import Buffer, TransformListener']
    seconds = [float('inf')] * len(codes)
    for _ in range(20):
        for i, code in enumerate(codes):
            begin = perf_counter()
            subprocess.run([sys.executable, '-c', code], check=True)
            seconds[i] = min(seconds[i], perf_counter() - begin)
    for code, time in zip(codes, seconds):
        yield f'`{code}`', f'{time * 1e3:.0f} ms', '', f'{time / seconds[0]:.2f}'


def resident(pid: object = 'self') -> float:
    """Return the resident memory of a process (MiB)."""
    with open(f'/proc/{pid}/statm') as statm:
        return int(statm.read().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 2**20


def cpu_seconds(pid: int) -> float:
    """Return the sum of the user and system time of a process (s)."""
    with open(f'/proc/{pid}/stat') as stat:
        fields = stat.read().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


if __name__ == '__main__':
    for row in imports():
        print(f'| {" | ".join(row)} |')
