"""What is shown to people: lines in place on a terminal or in a pipe, and numbers."""

from collections.abc import Iterable, Sequence
import shutil
import sys
from textwrap import wrap
from typing import Optional
from unicodedata import combining, east_asian_width

from dummy_arm.tf.formatting import LONGEST

_HOME_AND_CLEAR = '\x1b[H\x1b[2J'


def show(lines: Sequence[str], count: Optional[int] = None) -> None:
    """
    Show lines in place of those before, as many as a terminal has; or print them.

    :param lines: the lines; for a terminal, the first `height` of them are enough.
    :param count: how many lines there are in all; None: no more than these.
    """
    if sys.stdout.isatty():
        columns, rows = shutil.get_terminal_size()
        count = len(lines) if count is None else count
        if count >= rows:
            rest = count - rows + 2
            lines = [*lines[:max(0, rows - 2)], f'... {rest} more lines, which a pipe shows']
        print(_HOME_AND_CLEAR + '\n'.join(cut(line, columns) for line in lines))
    else:
        print(*lines, '', sep='\n')


def height() -> Optional[int]:
    """Return the number of lines of the terminal; None in a pipe, which shows any number."""
    return shutil.get_terminal_size().lines if sys.stdout.isatty() else None


def wrapped(text: str) -> list[str]:
    """Break a long line where a terminal ends; leave it whole in a pipe."""
    return wrap(text, shutil.get_terminal_size().columns) if sys.stdout.isatty() else [text]


def width(text: str) -> int:
    """Count the columns of a terminal that a text takes."""
    return len(text) if text.isascii() else sum(map(_columns_of, text))


def _columns_of(character: str) -> int:
    return 0 if combining(character) else 1 + (east_asian_width(character) in 'WF')


def column(widths: Iterable[int]) -> int:
    """
    Return the width to which the cells of a column are padded.

    It is that of the widest cell that is narrower than an abbreviated name. A wider one moves what
    is to its right; the other lines are not as long because of it.
    """
    return max((width for width in widths if width < LONGEST), default=0)


def padded(text: str, columns: int) -> str:
    """Fill a text up with blanks; leave it as it is where it is wider already."""
    return text + ' ' * (columns - width(text))


def cut(line: str, columns: int) -> str:
    """Cut a line off after some columns."""
    taken = 0
    for i, character in enumerate(line):
        taken += _columns_of(character)
        if taken > columns:
            return line[:i]
    return line


def fixed_point(value: float, precision: int) -> str:
    """Write a number with some digits after the point; what is rounded to zero is not negative."""
    text = f'{value:.{precision}f}'
    return text if float(text) else text.removeprefix('-')
