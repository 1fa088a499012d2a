"""Times as people write them: `1760000012.34`, `+12.34`, `-1.5`, `2025-10-09T08:53:32.34Z`."""

from argparse import ArgumentTypeError
from datetime import datetime, timezone
from decimal import Context, Inexact, InvalidOperation
import re
from typing import NamedTuple

from puretf import exact_time, SECOND

#: Decimal arithmetic that raises an exception instead of rounding.
_EXACT = Context(prec=50, traps=[Inexact, InvalidOperation])
_NUMBER = re.compile(r'([+-]?)(\d*\.?\d+|\d+\.)', re.ASCII)
_STAMP = re.compile(r'1\d{18}', re.ASCII)  # ns, from 2001 to 2033
_DATE = re.compile(r'(\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d)?)(\.\d+)?(Z|[+-]\d\d:\d\d)', re.ASCII)


class When(NamedTuple):
    """A time, or a distance (ns) from the begin ('+') or the end ('-') of a bag."""

    time: int
    sign: str = ''

    def within(self, span: tuple[int, int]) -> int:
        """Return the time (ns) in a bag with a begin and an end."""
        return {'': 0, '+': span[0], '-': span[1]}[self.sign] + self.time


#: The latest time for which there is a transform.
LATEST = When(0)


#: The help of an option with such a time.
WHEN = ('time of the transform: s, such as 1760000012.34, or 2025-10-09T08:53:32.34Z; in a bag '
        'also +12.34 s after its first transform or -1.5 s before its last; 0: the latest')


def when(text: str) -> When:
    """
    Convert an argument to a time, exact to the ns.

    >>> when('1760000012.34'), when('+12.34'), when('-1.5')
    (When(time=1760000012340000000, sign=''), When(time=12340000000, sign='+'), When(time=-1500000000, sign='-'))
    >>> when('2025-10-09T08:53:32.34Z')
    When(time=1760000012340000000, sign='')
    """  # noqa: E501
    try:
        if match := _NUMBER.fullmatch(text):
            return When(_nanoseconds(text), match[1])
        if match := _DATE.fullmatch(text):
            zone = match[3].replace('Z', '+00:00')
            date = datetime.fromisoformat(match[1].replace(' ', 'T') + zone)
            whole = (date - datetime(1970, 1, 1, tzinfo=timezone.utc)).total_seconds()
            return When(int(whole) * SECOND + _nanoseconds(f'0{match[2] or ""}'))
    except (ArithmeticError, ValueError):
        pass
    hint = (f'; if it is UTC, write {text}Z' if _DATE.fullmatch(f'{text}Z') else
            f'; if it is in ns, write {exact_time(int(text))}' if _STAMP.fullmatch(text) else '')
    raise ArgumentTypeError(
        f'{text!r} must be a time, such as 1760000012.34 (s), +12.34 (s after the start of the '
        'bag), -1.5 (s before its end) or 2025-10-09T08:53:32.34Z, with at most 9 digits after '
        f'the point{hint}')


def seconds(text: str) -> int:
    """Convert an argument in s to a time in ns, from 0 to 2**63 - 1, without rounding."""
    try:
        time = _nanoseconds(text.replace('_', '?'))
        if time < 0:
            raise ValueError
    except (ArithmeticError, ValueError):
        raise ArgumentTypeError(
            f'{text!r} must be a time in s, from 0 to 9223372036, with at most 9 digits after the '
            'point') from None
    return time


def _nanoseconds(text: str) -> int:
    time = _EXACT.multiply(_EXACT.create_decimal(text), SECOND)
    if not -2**63 < time < 2**63 or time != int(time):  # int(1e999999) would take minutes
        raise ValueError
    return int(time)
