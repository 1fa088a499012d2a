"""Conversion and display of times."""

from datetime import datetime, timedelta, timezone
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from puretf._core.times import int64_times, nanoseconds, nanoseconds_or_int
from puretf._text.times import display_time, exact_time, in_seconds

S = 1_000_000_000


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


def remedy_of(convert, *arguments):
    """Return what the error says to write."""
    with pytest.raises(TypeError) as raised:
        convert(*arguments)
    return str(raised.value).partition(': write ')[2]


def test_a_datetime_is_refused():
    """Without a zone, Python takes it as local time, and numpy as UTC."""
    time = datetime(2023, 11, 14, 22, 13, 20, 123456)
    ns = 1_700_000_000_123_456_000
    assert remedy_of(nanoseconds_or_int, time.replace(tzinfo=timezone.utc)) == str(ns)
    (utc, local), = re.findall('(.*) if it is UTC, or (.*) if it is local time$',
                               remedy_of(nanoseconds_or_int, time, 'since'))
    assert nanoseconds_or_int(eval(utc, {'np': np, 'since': time})) == ns
    there = time.replace(tzinfo=timezone.utc).astimezone().replace(tzinfo=None)
    assert eval(local, {'since': there}) == ns
    assert remedy_of(nanoseconds_or_int, timedelta(seconds=-1, microseconds=2)) == '-999998000'


@pytest.mark.parametrize('number', [0.5, np.float32(0.5), -2.0, 1.77e9, 1.77e18])
def test_a_float_in_an_unknown_unit_is_refused(number):
    """The text names both units."""
    for name, time in ('time', number), ('interval', 1e8), ('cache_time', 1e18):
        (in_ns, in_s, now), = re.findall('(.*) if it is in ns, (.*) if it is in s(.*)$', remedy_of(
            nanoseconds_or_int, time, name))
        assert now == (', or time.time_ns() in place of time.time()' if name == 'time'
                       and number > 1e9 else '')
        assert eval(in_ns, {name: time}) == int(time)
        assert eval(in_s, {name: time}) == pytest.approx(float(time) * 1e9, abs=0.5)


@pytest.mark.parametrize('convert', [list, np.array])
def test_floats_in_an_array_are_refused(convert):
    for times in convert([1.77e9, 1.78e9]), convert([0.29]):
        (in_ns, in_s), = re.findall('(.*) if they are in ns, (.*) if they are in s$', remedy_of(
            int64_times, times, 'times'))
        names = {'np': np, 'times': times}
        assert int64_times(eval(in_ns, names), 'times').tolist() == [int(t) for t in times]
        assert int64_times(eval(in_s, names), 'times').tolist() == [round(t * 1e9) for t in times]
    with pytest.raises(TypeError, match=r'^times\[0\] must be .*, got nan of type float$'):
        int64_times(convert([math.nan, 0.5]), 'times')
    assert int64_times(convert([]), 'times').tolist() == []


def test_times_of_numpy():
    """They are accepted with any unit that has whole ns; NaT is no time."""
    assert nanoseconds_or_int(np.datetime64('2023-11-14T22:13:20')) == 1_700_000_000 * 10**9
    assert nanoseconds_or_int(np.timedelta64(-20, 'ms')) == -20_000_000
    assert exact_time(np.datetime64('2023-11-14T22:13:20')) == '1700000000.000000000'
    assert in_seconds(np.timedelta64(-20, 'ms')) == -0.02
    for convert in exact_time, in_seconds:
        with pytest.raises(TypeError, match=r'in ns, round\(time \* 1e9\) if it is in s'):
            convert(1.5)
    for convert in nanoseconds_or_int, exact_time, in_seconds:
        for kind in np.datetime64, np.timedelta64:
            with pytest.raises(ValueError, match='time must be valid, got NaT'):
                convert(kind('NaT', 'ns'))


@pytest.mark.parametrize(('time', 'text'), [
    (0, '0.000000'), (1_700_000_000_123_456_789, '1700000000.123457'), (-1, '-0.000000'),
    (-1_500_000_000, '-1.500000')])
def test_displays_times_as_tf2(time, text):
    """A time is displayed in seconds with six decimals."""
    assert display_time(time) == text
