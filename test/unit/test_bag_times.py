"""Times as people write them, and times relative to a bag."""

from argparse import ArgumentTypeError
from datetime import datetime, timedelta, timezone

from hypothesis import given
from hypothesis import strategies as st
import pytest

from puretf import Frame
from puretf_tools.cli.times import when
from puretf_tools.inspection.bag_times import both, span_of, why_outside

S = 10**9
BEGIN, END = 1_760_000_000 * S, 1_760_000_060 * S


@given(st.integers(0, 2**62), st.sampled_from(['', '+', '-']))
def test_seconds_are_exact(time, sign):
    """All nine digits count; a sign counts from the begin or the end of a bag."""
    found = when(f'{sign}{time // S}.{time % S:09d}')
    assert found.within((BEGIN, END)) == {'': time, '+': BEGIN + time, '-': END - time}[sign]


@given(st.datetimes(datetime(1970, 1, 2), datetime(2200, 1, 1)), st.integers(0, 999),
       st.integers(-14 * 60, 14 * 60))
def test_dates(date, nanoseconds, minutes):
    """They are those of ISO 8601 with a time zone, and up to nine digits."""
    zone = timezone(timedelta(minutes=minutes))
    there = date.replace(tzinfo=timezone.utc).astimezone(zone)
    text = f'{there:%Y-%m-%dT%H:%M:%S}.{there.microsecond:06d}{nanoseconds:03d}'
    shift = f'{"-" if minutes < 0 else "+"}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}'
    whole = (date - datetime(1970, 1, 1)) // timedelta(microseconds=1) * 1000
    assert when(text + shift).within((BEGIN, END)) == whole + nanoseconds
    if not minutes:
        assert when(f'{text}Z') == when(text + shift)


@pytest.mark.parametrize('text', [
    '', '+', '-', '.', 'nan', 'inf', '1e5', '1_0', '٣', '--1', '1.0000000001', '9' * 11,
    '9223372036.854775808', '+-1', '2025-10-09', '2025-10-09T08:53:32', '2025-13-09T08:53:32Z',
    '2025-10-09T25:53:32Z'])
def test_other_texts_are_refused(text):
    """The error shows all forms."""
    with pytest.raises(ArgumentTypeError, match=r'1760000012\.34 .* \+12\.34 .* -1\.5 .*Z'):
        when(text)


@pytest.mark.parametrize(('text', 'seconds'), [
    ('2025-10-09T08:53:32', 1_760_000_012), ('2025-10-09 08:53', 1_759_999_980),
    ('1760000012340000000', 1_760_000_012.34)])
def test_a_time_that_is_almost_right(text, seconds):
    """A date without a zone, or a stamp in ns: the remedy in the error works."""
    with pytest.raises(ArgumentTypeError) as raised:
        when(text)
    assert when(str(raised.value).partition(', write ')[2]).time == round(seconds * 100) * S // 100


def dynamic(oldest, latest):
    return Frame('x', 'map', '', False, 2, latest, oldest)


def test_the_span_of_a_bag():
    """Static frames, the stamp 0, and stamps that are wrong by years do not count."""
    frames = [dynamic(BEGIN + i * S, END - i * S) for i in range(3)]
    assert span_of([*frames, dynamic(5, 7), dynamic(0, END + S),
                    Frame('y', 'map', '', True, 1, 0, 0)]) == (BEGIN, END)
    assert span_of([]) == (1, 1)


@pytest.mark.parametrize(('recorded', 'span'), [
    ((BEGIN + S, END + S), (BEGIN, END)),
    ((0, 0), (BEGIN - 1000 * S, END + 1000 * S)),
    ((BEGIN + 10**6 * S, END + 10**6 * S), (BEGIN - 1000 * S, END + 1000 * S))])
def test_stamps_of_another_clock_than_the_recording(recorded, span):
    """They do not count if at least half of the stamps are of its clock; else all count."""
    assert span_of([dynamic(BEGIN, END + 1000 * S), dynamic(BEGIN - 1000 * S, END)],
                   recorded) == span
    late = BEGIN + 5000 * S
    assert span_of([dynamic(BEGIN, END), dynamic(BEGIN, END), dynamic(late, late)], (
        late, late)) == (BEGIN, late)


@pytest.mark.parametrize(('time', 'text'), [
    (BEGIN + 12_340_000_000, '+12.34 s, 1760000012.340000000'),
    (BEGIN, '+0 s, 1760000000.000000000'),
    (BEGIN - S // 2, '1759999999.500000000')])
def test_both_forms_of_a_time(time, text):
    """A time after the begin, and the stamp."""
    assert both(time, BEGIN) == text
    assert bool(why_outside(time, (BEGIN, END))) is (time < BEGIN)


def test_a_time_outside():
    """The text names the bag, and no clocks; time 0 is the latest."""
    assert why_outside(0, (BEGIN, END)) == ''
    assert why_outside(END + 1, (BEGIN, END)) == (
        '+60.000000001 s, 1760000060.000000001 is outside of the bag, whose transforms are from '
        '1760000000.000000000 to +60 s, 1760000060.000000000')
