"""Points in time: integer nanoseconds, and what other libraries have for them."""

from operator import index
from typing import Any

SECOND = 1_000_000_000


def nanoseconds(time: Any, name: str = 'time') -> int:
    """
    Read a time or a duration in ns from what has `sec` and `nanosec`, or `nanoseconds`.

    :param name: what it is called in an error.
    :raises TypeError: when it has neither.
    """
    try:
        # First, because most are rclpy's; no type has both.
        return int(time.nanoseconds)
    except AttributeError:
        pass
    if hasattr(time, 'sec') and hasattr(time, 'nanosec'):
        return int(time.sec) * SECOND + int(time.nanosec)
    raise TypeError(f'{name} must have sec and nanosec, or nanoseconds. '
                    f'Got {time!r} of type {type(time).__name__}')


def nanoseconds_or_int(time: Any, name: str = 'time') -> int:
    """
    Read a time or a duration in ns as `nanoseconds` does, or from an integer of ns.

    :raises TypeError: when it is none of these.
    """
    if hasattr(time, '__index__'):
        return index(time)
    try:
        return nanoseconds(time, name)
    except TypeError as error:
        raise TypeError(f'{error}; an integer of ns is good, too') from None


def in_seconds(time: int) -> float:
    """Convert ns to s, rounded as tf2 rounds: the parts before and after the point apart."""
    after = abs(time) % SECOND * (-1 if time < 0 else 1)
    return (time - after) // SECOND + 1e-9 * after


def display(time: int) -> str:
    """Write a time (ns) as tf2 writes it in its texts: s, six digits after the point."""
    return f'{in_seconds(time):.6f}'
