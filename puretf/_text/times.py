"""Times (ns) as seconds and as text."""

from operator import index
from typing import Any

#: One second (ns).
SECOND = 1_000_000_000


def in_seconds(time: Any) -> float:
    """
    Convert nanoseconds to seconds with the rounding of tf2, as in `tf2::timeToSec`.

    :param time: an integer (ns), or a time or duration of numpy.

    >>> in_seconds(1_500_000_000)
    1.5
    """
    number = _integer(time)
    fraction = abs(number) % SECOND * (-1 if number < 0 else 1)
    return (number - fraction) // SECOND + 1e-9 * fraction


def display_time(time: int) -> str:
    """Write a time (ns) as seconds with six decimals, as `tf2::displayTimePoint` does."""
    return f'{in_seconds(time):.6f}'


def exact_time(time: Any) -> str:
    """
    Write a time (ns, or one of numpy) as seconds with nine decimals, without rounding.

    >>> exact_time(1_700_000_000_000_000_001), exact_time(-1_500_000_000)
    ('1700000000.000000001', '-1.500000000')
    """
    number = _integer(time)
    whole, fraction = divmod(abs(number), SECOND)
    return f'{"-" if number < 0 else ""}{whole}.{fraction:09d}'


def cache_text(cache_time: int) -> str:
    """Write a cache time (ns) in s; in ns if it is so short that it may be meant in s."""
    return f'{cache_time / SECOND:g} s' if cache_time >= 1_000_000 else f'{cache_time} ns'


def longer_cache(span: int, takes_ns: bool) -> str:
    """Write the argument of a buffer that is to keep a span (ns), with a second to spare."""
    seconds = -(-span // SECOND) + 1
    return f'cache_time={seconds * SECOND:_} (ns)' if takes_ns else f'a cache_time of {seconds} s'


def _integer(time: Any) -> int:
    kind = getattr(getattr(time, 'dtype', None), 'kind', '')  # numpy need not be there
    if time != time:
        raise ValueError('time must be valid, got NaT')
    if isinstance(time, float):
        raise TypeError(f'time must be an integer (ns), or a time of numpy, got {time!r}: write '
                        'int(time) if it is in ns, round(time * 1e9) if it is in s')
    return int(time.astype(f'{kind}8[ns]')) if kind in ('M', 'm') else index(time)
