"""Lines on a terminal: cut off by columns, padded up to a limit, redrawn in place."""

import io
import sys

import pytest

from puretf_tools.inspection import terminal


def test_a_cell_that_is_too_wide_does_not_make_its_column_wide():
    """It is neither padded nor cut off; the other cells are padded to the widest of them."""
    cells = ['map', 'odom', 'a' * 1000]
    assert terminal.columns([(cell, 'x') for cell in cells]) == [
        'map   x', 'odom  x', f'{"a" * 1000}  x']


def open_screen(monkeypatch):
    """Let stdout be a terminal of 6 columns and 4 lines."""
    class Screen(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setenv('COLUMNS', '6')
    monkeypatch.setenv('LINES', '4')
    screen = Screen()
    monkeypatch.setattr(sys, 'stdout', screen)
    return screen


@pytest.mark.parametrize(('lines', 'shown'), [
    (['a', 'b', 'long line'], ['a', 'b', 'long l']), (['a', 'b', 'c', 'd'], ['a', 'b', '... 2 '])])
def test_a_screen(monkeypatch, lines, shown):
    """Each is cleared before it is drawn; what does not fit is counted in its last line."""
    screen = open_screen(monkeypatch)
    terminal.show(lines)
    assert screen.getvalue() == '\x1b[H\x1b[2J' + '\n'.join(shown) + '\n'


def test_lines_in_a_pipe(capsys):
    """They are whole, and an empty line follows."""
    terminal.show(['a', 'long line'])
    assert capsys.readouterr().out == 'a\nlong line\n\n'
    assert terminal.wrapped('a long line', '  ') == ['  a long line']


def test_a_text_is_wrapped_at_the_width_of_the_terminal(monkeypatch):
    """Each line is indented."""
    open_screen(monkeypatch)
    assert terminal.wrapped('a long line', ' ') == [' a', ' long', ' line']


@pytest.mark.parametrize(('texts', 'printed'), [
    (['at 1.5 s: a, b', 'at 2.5 s: a, b'], ['at 1.5 s: a, b', '']),
    (['-1 of 2.', '7 of 10.'], ['-1 of 2.', '']),
    (['a', 'b', 'a'], ['a', 'b', 'a']),
    (['a', '', 'a'], ['a', '', 'a']),
    *((names, names) for names in (
        ['joint_1', 'joint_2'], ['/robot1/tf', '/robot2/tf'], ['camera-1', 'camera-2'],
        ['/ns/1', '/ns/2']))])
def test_a_text_is_printed_once(texts, printed):
    """Then only its short form, until more than numbers changes; names with digits are names."""
    say = terminal.Once()
    assert [say(text, '') for text in texts] == printed


def test_a_text_in_place_is_never_abbreviated():
    """On a terminal that is cleared, it would be seen for a moment only."""
    say = terminal.Once(in_place=True)
    assert [say('a long text', 'a') for _ in range(2)] == ['a long text'] * 2
