"""Conversion of times and durations of ROS to nanoseconds."""

from datetime import timedelta
from math import isfinite
from numbers import Integral, Real
from operator import index
from typing import Any

from puretf._text.times import SECOND
from puretf.exceptions import described

#: The seconds of the times of messages are smaller: they are an int32.
_MOST_SECONDS = 1 << 31


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
    """Split a time (ns) into sec and nanosec; raise a ValueError if sec does not fit an int32."""
    sec, nanosec = divmod(time, SECOND)
    if not -_MOST_SECONDS <= sec < _MOST_SECONDS:
        raise ValueError(f'a stamp must be from -2**31 to 2**31 - 1 seconds, got {time} ns')
    return sec, nanosec
