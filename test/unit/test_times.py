"""Conversion and display of times."""

from types import SimpleNamespace

import numpy as np
import pytest

from puretf._core.times import nanoseconds, nanoseconds_or_int
from puretf._text.times import display_time


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
    for bad in 0.5, '1', None:
        with pytest.raises(TypeError, match=r'or nanoseconds.*an integer \(ns\) is accepted, too'):
            nanoseconds_or_int(bad)


@pytest.mark.parametrize(('time', 'text'), [
    (0, '0.000000'), (1_700_000_000_123_456_789, '1700000000.123457'), (-1, '-0.000000'),
    (-1_500_000_000, '-1.500000')])
def test_displays_times_as_tf2(time, text):
    """A time is displayed in seconds with six decimals."""
    assert display_time(time) == text
