"""What is shown to people: lines in place on a terminal or in a pipe, and numbers."""

from collections.abc import Sequence
import shutil
import sys
from textwrap import wrap
from unicodedata import combining, east_asian_width

_HOME_AND_CLEAR = '\x1b[H\x1b[2J'


def show(lines: Sequence[str]) -> None:
    """Show lines in place of those before, as many as a terminal has; or print them."""
    if sys.stdout.isatty():
        columns, height = shutil.get_terminal_size()
        if len(lines) >= height:
            rest = len(lines) - height + 2
            lines = [*lines[:max(0, height - 2)], f'... {rest} more lines, which a pipe shows']
        print(_HOME_AND_CLEAR + '\n'.join(cut(line, columns) for line in lines))
    else:
        print(*lines, '', sep='\n')


def wrapped(text: str) -> list[str]:
    """Break a long line where a terminal ends; leave it whole in a pipe."""
    return wrap(text, shutil.get_terminal_size().columns) if sys.stdout.isatty() else [text]


def width(text: str) -> int:
    """Count the columns of a terminal that a text takes."""
    return sum(0 if combining(c) else 1 + (east_asian_width(c) in 'WF') for c in text)


def padded(text: str, columns: int) -> str:
    """Fill a text up with blanks."""
    return text + ' ' * (columns - width(text))


def cut(line: str, columns: int) -> str:
    """Cut a line off after some columns."""
    while width(line) > columns:
        line = line[:-1]
    return line


def fixed_point(value: float, precision: int) -> str:
    """Write a number with some digits after the point; what is rounded to zero is not negative."""
    text = f'{value:.{precision}f}'
    return text if float(text) else text.removeprefix('-')
