"""Conversion of times and durations: ROS types to nanoseconds, nanoseconds to seconds or text."""

from datetime import timedelta
from math import isfinite
from numbers import Integral, Real
from operator import index
from typing import Any

from puretf.exceptions import described

#: One second (ns).
SECOND = 1_000_000_000
#: The seconds of the times of messages are smaller: they are an int32.
_MOST_SECONDS = 1 << 31


def is_frozen(oldest: int, latest: int, count: int) -> bool:
    """
    Return True if the stamp of an edge does not advance: several transforms have the same.

    >>> is_frozen(5, 5, 30), is_frozen(5, 6, 30), is_frozen(5, 5, 1)
    (True, False, False)
    """
    return oldest == latest != 0 and count > 2


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
    remedy = written(time, 'Time' if name == 'time' else 'Duration')
    raise TypeError(f'{name} must have sec and nanosec, or nanoseconds. Got {described(time)}'
                    f'{remedy and f": write {remedy}"}')


def written(number: Any, kind: str) -> str:
    """
    Return how a value is written as a time or duration of rclpy; '' if that is not known.

    A number that is too large for seconds is meant as nanoseconds.

    >>> written(1.5, 'Time'), written(1_700_000_000_000_000_000, 'Time')
    ('Time(seconds=1.5)', 'Time(nanoseconds=1700000000000000000)')
    """
    if isinstance(number, timedelta) and kind == 'Duration':
        number = number.total_seconds()
    is_number = isinstance(number, Real) and not isinstance(number, bool)
    is_integer = is_number and isinstance(number, Integral)
    return (f'{kind}(seconds={number})' if is_number and 0 <= number < _MOST_SECONDS else
            f'{kind}(nanoseconds={number})' if is_integer and 0 < number < _MOST_SECONDS * SECOND
            else '')


def nanoseconds_or_int(time: Any, name: str = 'time') -> int:
    """Convert a time as `nanoseconds` does; also accept an integer (ns) of Python or numpy."""
    if hasattr(time, '__index__'):
        return index(time)
    try:
        return nanoseconds(time, name)
    except TypeError as error:
        is_finite = isinstance(time, float) and isfinite(time)
        example = f', such as {round(time * SECOND)}' if is_finite else ''
        raise TypeError(f'{error}; an integer (ns) is accepted, too{example}') from None


def split(time: int) -> tuple[int, int]:
    """Split a time (ns) into `sec` and `nanosec` of a stamp."""
    return divmod(time, SECOND)


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
