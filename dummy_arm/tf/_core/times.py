"""Conversion of times and durations: ROS types to nanoseconds, nanoseconds to seconds or text."""

from operator import index
from typing import Any

#: One second (ns).
SECOND = 1_000_000_000


def nanoseconds(time: Any, name: str = 'time') -> int:
    """
    Convert a time or duration of rclpy, or of a ROS message, to nanoseconds.

    :param name: the name of the argument, for the text of the TypeError.
    """
    try:
        return int(time.nanoseconds)
    except AttributeError:
        pass
    if hasattr(time, 'sec') and hasattr(time, 'nanosec'):
        return int(time.sec) * SECOND + int(time.nanosec)
    raise TypeError(f'{name} must have sec and nanosec, or nanoseconds. '
                    f'Got {time!r} of type {type(time).__name__}')


def nanoseconds_or_int(time: Any, name: str = 'time') -> int:
    """Convert a time as `nanoseconds` does; also accept an integer (ns) of Python or numpy."""
    if hasattr(time, '__index__'):
        return index(time)
    try:
        return nanoseconds(time, name)
    except TypeError as error:
        raise TypeError(f'{error}; an integer (ns) is accepted, too') from None


def in_seconds(time: int) -> float:
    """
    Convert nanoseconds to seconds with the rounding of tf2, as in `tf2::timeToSec`.

    >>> in_seconds(1_500_000_000)
    1.5
    """
    fraction = abs(time) % SECOND * (-1 if time < 0 else 1)
    return (time - fraction) // SECOND + 1e-9 * fraction


def display_time(time: int) -> str:
    """
    Write a time (ns) as seconds with six decimals, as `tf2::displayTimePoint` does.

    >>> display_time(1_700_000_000_123_456_789)
    '1700000000.123457'
    """
    return f'{in_seconds(time):.6f}'


def exact_time(time: int) -> str:
    """
    Write a time (ns) as seconds with nine decimals, without rounding.

    >>> exact_time(1_700_000_000_000_000_001), exact_time(-1_500_000_000)
    ('1700000000.000000001', '-1.500000000')
    """
    whole, fraction = divmod(abs(time), SECOND)
    return f'{"-" if time < 0 else ""}{whole}.{fraction:09d}'
