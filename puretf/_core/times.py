"""Conversion of times and durations of ROS to nanoseconds."""

from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from math import isfinite
from numbers import Real
from operator import index
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from puretf._text.times import SECOND
from puretf.exceptions import described

#: The seconds of the times of messages are smaller: they are an int32.
_MOST_SECONDS = 1 << 31
#: The arguments that are durations, so that the present is not meant.
_DURATIONS = 'buffer_timeout', 'cache_time', 'interval', 'timeout', 'tolerance'


def nanoseconds(time: Any, name: str = 'time') -> int:
    """
    Convert a time or duration of rclpy, or of a ROS message, to nanoseconds.

    :param name: the name of the argument, for the text of the TypeError.
    """
    if (number := getattr(time, 'nanoseconds', None)) is not None:
        return int(number)
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
    if isinstance(number, np.timedelta64 if kind == 'Duration' else np.datetime64):
        with suppress(ValueError, OverflowError):  # NaT, and other centuries
            return f'{kind}(nanoseconds={nanoseconds_or_int(number)})'
    is_number = isinstance(number, Real) and not isinstance(number, (bool, np.timedelta64))
    return (f'{kind}(seconds={number})' if is_number and 0 <= number < _MOST_SECONDS else
            f'{kind}(nanoseconds={int(number)})'
            if is_number and 0 < number < _MOST_SECONDS * SECOND else '')


def nanoseconds_or_int(time: Any, name: str = 'time') -> int:
    """Convert a time as `nanoseconds` does; also accept an integer (ns), or a time of numpy."""
    if hasattr(time, '__index__'):
        return index(time)
    if isinstance(time, (np.datetime64, np.timedelta64)):
        return int(int64_times([time], name)[0])
    try:
        return nanoseconds(time, name)
    except TypeError:
        raise TypeError(f'{name} must be an integer (ns), or a time or duration of numpy or ROS, '
                        f'got {described(time)}{_in_nanoseconds(time, name)}') from None


def _in_nanoseconds(time: Any, name: str) -> str:
    """Return how a time is written in ns."""
    if isinstance(time, datetime):
        return (f': write {round(time.timestamp() * 10**6) * 1000}' if time.tzinfo else
                f': write np.datetime64({name}) if it is UTC, or '
                f'round({name}.timestamp() * 1e6) * 1000 if it is local time')
    if isinstance(time, timedelta):
        return f': write {time // timedelta(microseconds=1) * 1000}'
    if not isinstance(time, Real) or not isfinite(time):
        return ''
    now = ', or time.time_ns() in place of time.time()' * (
        float(time) > 1e8 and name not in _DURATIONS)
    return f': write int({name}) if it is in ns, round({name} * 1e9) if it is in s{now}'


def int64_times(times: 'ArrayLike | Sequence[Any]', name: str) -> NDArray[np.int64]:
    """Convert many times as `nanoseconds_or_int` does."""
    given = np.asarray(times)
    if given.ndim != 1:
        raise ValueError(f'{name} must be of shape (n,), got {given.shape}')
    if given.dtype.kind in 'mM':
        if np.isnat(given).any():
            raise ValueError(f'{name} must be valid, got NaT at index {np.isnat(given).argmax()}')
        try:
            in_ns = given.astype(f'{given.dtype.kind}8[ns]')
            is_exact = bool((in_ns.astype(given.dtype) == given).all())
        except OverflowError:  # before numpy 2.5, the numbers overflow
            is_exact = False
        if not is_exact:
            raise OverflowError(f'{name} must be whole ns from 1678 to 2261, got {given.min()} to '
                                f'{given.max()}')
        return in_ns.astype(np.int64)
    if given.dtype.kind == 'f' and given.size and np.isfinite(given).all():
        raise TypeError(f'{name} must be integers (ns), or times of numpy or ROS, got '
                        f'{given.dtype}: write np.asarray({name}, np.int64) if they are in ns, '
                        f'np.round(np.multiply({name}, 1e9)).astype(np.int64) if they are in s')
    if given.dtype.kind not in 'iu':
        given = np.array([nanoseconds_or_int(time, f'{name}[{i}]')
                          for i, time in enumerate(given.tolist())], np.object_)
    for bound in (given.min(), given.max()) if given.size else ():
        if not -2**63 <= int(bound) < 2**63:
            raise OverflowError(f'{name} must be int64 (ns), got {bound}')
    return given.astype(np.int64)


def split(time: int) -> tuple[int, int]:
    """Split a time (ns) into sec and nanosec; raise a ValueError if sec does not fit an int32."""
    sec, nanosec = divmod(time, SECOND)
    if not -_MOST_SECONDS <= sec < _MOST_SECONDS:
        raise ValueError(f'a stamp must be from -2**31 to 2**31 - 1 seconds, got {time} ns')
    return sec, nanosec
