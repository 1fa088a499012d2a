"""Output to a terminal: whether stdout is one, its size and escapes, and columns."""

from collections.abc import Sequence
import re
import shutil
import sys
from textwrap import wrap

from puretf._text.names import LONGEST

#: A number that is no part of a name.
_NUMBER = re.compile(r'(?<![\w./-])-?\d+(\.\d+)?(?!\w)')
_HOME_AND_CLEAR = '\x1b[H\x1b[2J'


def show(lines: Sequence[str]) -> None:
    """Print lines; on a terminal, clear it and cut them off at its size; else, end with ''."""
    if is_terminal():
        columns, rows = shutil.get_terminal_size()
        if len(lines) >= rows:
            rest = len(lines) - rows + 2
            lines = [*lines[:max(0, rows - 2)],
                     f'... {rest} more lines (pipe the output to see all)']
        print(_HOME_AND_CLEAR + '\n'.join(line[:columns] for line in lines))
    else:
        print(*lines, '', sep='\n')


def is_terminal() -> bool:
    return sys.stdout.isatty()


def wrapped(text: str, indent: str = '') -> list[str]:
    """Indent a long line, and wrap it at the width of the terminal, if stdout is one."""
    if not is_terminal():
        return [indent + text]
    columns = shutil.get_terminal_size().columns
    return wrap(text, columns, initial_indent=indent, subsequent_indent=indent)


class Once:
    """
    Abbreviates a text that is printed again and again, until more than its numbers changes.

    But not `in_place`, where each text replaces the one before.

    >>> once = Once()
    >>> [once(f'No data at {i} s. The publisher has ended.', f'No data at {i} s.') for i in (1, 2)]
    ['No data at 1 s. The publisher has ended.', 'No data at 2 s.']
    """

    def __init__(self, in_place: bool = False) -> None:
        self._last, self._in_place = '', in_place

    def __call__(self, text: str, short: str) -> str:
        before, self._last = self._last, _NUMBER.sub('', text)
        return short if self._last == before and not self._in_place else text


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """
    Pad the cells of each column to one width; cells of 100 characters or more do not count for it.

    >>> columns([['map', 'static'], ['odom', '']])
    ['map   static', 'odom']
    """
    widths = [max((size for size in map(len, column) if size < LONGEST), default=0)
              for column in zip(*rows)]
    return ['  '.join(map(str.ljust, row, widths)).rstrip() for row in rows]


def fixed_point(value: float, precision: int) -> str:
    """
    Format a number; zero has no minus sign.

    >>> fixed_point(-0.0004, 3)
    '0.000'
    """
    return f'{round(value, precision) + 0.0:.{precision}f}'  # -0.0 + 0.0 is 0.0
