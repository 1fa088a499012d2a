"""Conversion and display of times."""

from datetime import datetime, timedelta, timezone
import math
from types import SimpleNamespace

import numpy as np
import pytest

from puretf._core.times import nanoseconds, nanoseconds_or_int
from puretf._text.times import display_time, exact_time, in_seconds


@pytest.mark.parametrize('time', [
    SimpleNamespace(nanoseconds=1_500_000_000), SimpleNamespace(sec=1, nanosec=500_000_000)])
def test_reads_what_other_libraries_have(time):
    """A time is recognised by its attributes; its class does not matter."""
    assert nanoseconds(time) == nanoseconds_or_int(time) == 1_500_000_000


def test_integers_are_times_where_that_cannot_be_mistaken():
    """tf2's own functions refuse integers, since 5 might be meant as seconds; others accept ns."""
    assert nanoseconds_or_int(np.int64(5)) == 5
    with pytest.raises(TypeError, match=r'^time must have sec and nanosec, or nanoseconds\.'):
        nanoseconds(5)
    for bad in '1', None, math.nan:
        with pytest.raises(TypeError, match=r'^time must be an integer \(ns\), or a time or '
                           r'duration of numpy or ROS, got \S+ of type \w+$'):
            nanoseconds_or_int(bad)


@pytest.mark.parametrize(('number', 'remedy'), [
    (0.5, '500000000'), (np.float32(0.5), '500000000'), (-2.0, '-2000000000'),
    (1.77e9, '1770000000000000000, or time.time_ns() for the present'),
    (1.77e18, '1770000000000000000, or time.time_ns() for the present'),
    (datetime(2023, 11, 14, 22, 13, 20, 123456, timezone.utc), '1700000000123456000'),
    (timedelta(seconds=-1, microseconds=2), '-999998000')])
def test_a_float_or_a_datetime_is_refused(number, remedy):
    """A float is meant as seconds, as of time.time(); a very large one is in ns already."""
    with pytest.raises(TypeError) as raised:
        nanoseconds_or_int(number)
    assert str(raised.value).partition(': write ')[2] == remedy


def test_times_of_numpy():
    """They are accepted with any unit that has whole ns; NaT is no time."""
    assert nanoseconds_or_int(np.datetime64('2023-11-14T22:13:20')) == 1_700_000_000 * 10**9
    assert nanoseconds_or_int(np.timedelta64(-20, 'ms')) == -20_000_000
    assert exact_time(np.datetime64('2023-11-14T22:13:20')) == '1700000000.000000000'
    assert in_seconds(np.timedelta64(-20, 'ms')) == -0.02
    for convert in nanoseconds_or_int, exact_time, in_seconds:
        for kind in np.datetime64, np.timedelta64:
            with pytest.raises(ValueError, match='time must be valid, got NaT'):
                convert(kind('NaT'))


@pytest.mark.parametrize(('time', 'text'), [
    (0, '0.000000'), (1_700_000_000_123_456_789, '1700000000.123457'), (-1, '-0.000000'),
    (-1_500_000_000, '-1.500000')])
def test_displays_times_as_tf2(time, text):
    """A time is displayed in seconds with six decimals."""
    assert display_time(time) == text
