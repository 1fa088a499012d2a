"""Conversion of times and durations: ROS types to nanoseconds, nanoseconds to seconds or text."""

from operator import index
from typing import Any

#: One second (ns).
SECOND = 1_000_000_000


def nanoseconds(time: Any, name: str = 'time') -> int:
    """
    Convert a time or duration object of ROS to nanoseconds.

    :param time: an object with the attribute `nanoseconds` (as in rclpy), or with the attributes
        `sec` and `nanosec` (as in ROS messages).
    :param name: the name of the argument, for the error text.
    :returns: the time or duration (ns).
    :raises TypeError: if `time` is not such an object.
    """
    try:
        # rclpy's types are tried first, since they are the most frequent. The order does not
        # change the result, since no type has both `nanoseconds` and `nanosec`.
        return int(time.nanoseconds)
    except AttributeError:
        pass
    if hasattr(time, 'sec') and hasattr(time, 'nanosec'):
        return int(time.sec) * SECOND + int(time.nanosec)
    raise TypeError(f'{name} must have sec and nanosec, or nanoseconds. '
                    f'Got {time!r} of type {type(time).__name__}')


def nanoseconds_or_int(time: Any, name: str = 'time') -> int:
    """
    Convert a time, a duration or an integer (ns) to nanoseconds.

    :param time: an object as for `nanoseconds`, or an integer (ns), which may be of a numpy type.
    :param name: the name of the argument, for the error text.
    :returns: the time or duration (ns).
    :raises TypeError: if `time` is neither such an object nor an integer.

    >>> nanoseconds_or_int(5)
    5
    >>> from types import SimpleNamespace
    >>> nanoseconds_or_int(SimpleNamespace(sec=1, nanosec=500_000_000))
    1500000000
    """
    if hasattr(time, '__index__'):
        return index(time)
    try:
        return nanoseconds(time, name)
    except TypeError as error:
        raise TypeError(f'{error}; an integer (ns) is accepted, too') from None


def in_seconds(time: int) -> float:
    """
    Convert nanoseconds to seconds with the rounding of tf2.

    The whole seconds and the remaining nanoseconds are converted separately and then added, as in
    `tf2::timeToSec`.

    :param time: time or duration (ns).
    :returns: the time or duration in seconds.

    >>> in_seconds(1_500_000_000)
    1.5
    >>> in_seconds(-1)
    -1e-09
    """
    fraction = abs(time) % SECOND * (-1 if time < 0 else 1)
    return (time - fraction) // SECOND + 1e-9 * fraction


def display_time(time: int) -> str:
    """
    Convert a time to a text: the seconds with six decimals, as `tf2::displayTimePoint` does.

    :param time: time (ns).
    :returns: the text, without a unit.

    >>> display_time(1_700_000_000_123_456_789)
    '1700000000.123457'
    """
    return f'{in_seconds(time):.6f}'
