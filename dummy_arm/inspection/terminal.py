"""Text output: columns, numbers, and lines that are redrawn in place on a terminal."""

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
    Print lines; if stdout is a terminal, clear the terminal first.

    On a terminal, each line is cut off at the width of the terminal. If not all lines fit, the
    last line says how many more lines there are. If stdout is not a terminal, an empty line is
    printed after the lines.

    :param lines: the lines; for a terminal, the first `height()` lines are enough.
    :param count: the number of all lines, if `lines` has only the first of them; None: `lines` has
        all lines.
    """
    if sys.stdout.isatty():
        columns, rows = shutil.get_terminal_size()
        count = len(lines) if count is None else count
        if count >= rows:
            rest = count - rows + 2
            lines = [*lines[:max(0, rows - 2)],
                     f'... {rest} more lines (pipe the output to see all)']
        print(_HOME_AND_CLEAR + '\n'.join(cut(line, columns) for line in lines))
    else:
        print(*lines, '', sep='\n')


def height() -> Optional[int]:
    """
    Return the number of lines of the terminal.

    :returns: the number; None if stdout is not a terminal.
    """
    return shutil.get_terminal_size().lines if sys.stdout.isatty() else None


def wrapped(text: str, indent: str = '') -> list[str]:
    """
    Wrap a long line at the width of the terminal.

    :param text: the line.
    :param indent: the text that each returned line begins with.
    :returns: the lines; a single line if stdout is not a terminal.
    """
    if not sys.stdout.isatty():
        return [indent + text]
    columns = shutil.get_terminal_size().columns
    return wrap(text, columns, initial_indent=indent, subsequent_indent=indent)


def width(text: str) -> int:
    """
    Return the number of terminal columns that a text occupies.

    :param text: the text, without control characters.
    :returns: the number of columns: two for a wide character, none for a combining one.

    >>> width('map')
    3
    >>> width('日本')
    4
    """
    return len(text) if text.isascii() else sum(map(_columns_of, text))


def _columns_of(character: str) -> int:
    return 0 if combining(character) else 1 + (east_asian_width(character) in 'WF')


def column_width(widths: Iterable[int]) -> int:
    """
    Return the width to which the cells of a table column are padded.

    Cells with a width of 100 or more are ignored, so that they make only their own lines longer.

    :param widths: the widths of the cells, as `width` returns them.
    :returns: the width of the widest cell that is not ignored; 0 if all cells are ignored.

    >>> column_width([3, 4, 2000])
    4
    >>> column_width([2000])
    0
    """
    return max((width for width in widths if width < LONGEST), default=0)


def padded(text: str, columns: int) -> str:
    """
    Pad a text with spaces on the right.

    :param text: the text.
    :param columns: the width that the text should have on a terminal.
    :returns: the padded text; the unchanged text if it is wide enough already.

    >>> padded('map', 5)
    'map  '
    >>> padded('日本', 5)
    '日本 '
    >>> padded('base_link', 5)
    'base_link'
    """
    return text + ' ' * (columns - width(text))


def cut(line: str, columns: int) -> str:
    """
    Cut a line off at a width.

    :param line: the line.
    :param columns: the largest width that the result may have on a terminal.
    :returns: the beginning of the line, without a wide character of which only half would fit.

    >>> cut('base_link', 4)
    'base'
    >>> cut('日本', 3)
    '日'
    """
    used = 0
    for i, character in enumerate(line):
        used += _columns_of(character)
        if used > columns:
            return line[:i]
    return line


def fixed_point(value: float, precision: int) -> str:
    """
    Format a number with a fixed number of digits after the point; zero has no minus sign.

    :param value: the number.
    :param precision: the number of digits after the point.
    :returns: the text.

    >>> fixed_point(-2 / 3, 3)
    '-0.667'
    >>> fixed_point(-0.0004, 3)
    '0.000'
    """
    text = f'{value:.{precision}f}'
    return text if float(text) else text.removeprefix('-')
