"""The graph of the frames: its text, its drawings, and graphviz that fails."""

import os
from pathlib import Path
import signal
import sys
from xml.etree import ElementTree

from environment import on_linux, on_unix
import pytest

from puretf import Frame
from puretf_tools.inspection.forest import Forest
from puretf_tools.inspection.graph import as_dot, draw, DrawingError

S = 10**9
ODD = ['54', 'on', 'a: b', 'say "hi"', 'two\nlines', 'ünï', 'back\\slash', 'end\\', '<b>b</b>',
       '&amp;', '{x|y}', '\\N', '--', 'digraph', "it's", 'n' * 80]


def static(name, parent, publisher='/node'):
    """Return a static frame."""
    return Frame(name, parent, publisher, True, 1, 0, 0)


def drawn_lines(frames, tmp_path):
    """Draw frames into a PDF, and return the lines of its text."""
    pytest.importorskip('pygraphviz')
    pypdf = pytest.importorskip('pypdf')
    path = tmp_path / 'drawn.pdf'
    path.write_bytes(draw(as_dot(Forest(frames), 100 * S), 'pdf'))
    (page,) = pypdf.PdfReader(path).pages
    return [line.strip() for line in page.extract_text().splitlines()]


def test_labels(tmp_path):
    """They are those of tf2, except for static frames and for frames of an unknown rate."""
    lines = drawn_lines([
        Frame('a', 'map', '/node', False, 51, 100 * S, 95 * S), static('b', 'a', '/other'),
        Frame('c', 'a', '/node', False, 1, 5 * S, 5 * S)], tmp_path)
    for line, number in (
            ('Broadcaster: /node', 2), ('Broadcaster: /other', 1), ('static', 1),
            ('Average rate: 10.000 Hz', 1), ('Average rate: unknown', 1),
            ('Buffer length: 5.000 s', 1), ('Most recent transform: 100.000000000', 1),
            ('Oldest transform: 95.000000000', 1), ('Recorded at time: 100.000000', 1)):
        assert lines.count(line) == number, line


def test_odd_names_several_roots_and_a_loop(tmp_path):
    """tf2 reads 54 as a number, rejects a: b, draws the last root, and nothing with a loop."""
    edges = [*((name, 'odd "root"') for name in ODD), ('a', 'root 2'), ('x', 'y'), ('y', 'x')]
    lines = drawn_lines([static(*edge) for edge in edges], tmp_path)
    for names in edges:
        assert {line for name in names for line in name.split('\n')} <= {*lines}
    assert lines.count('static') == len(edges)


def test_an_svg_is_well_formed():
    """Characters that XML does not allow are escaped."""
    pytest.importorskip('pygraphviz')
    svg = draw(as_dot(Forest([
        static('\x1b[31mred', '\x00'), *(static(name, 'root') for name in ODD)]), 0), 'svg')
    assert ElementTree.fromstring(svg).tag.endswith('svg')


def test_each_frame_is_a_node_of_its_own():
    """This holds for names that look like escaped names, or like graphviz's own."""
    pygraphviz = pytest.importorskip('pygraphviz')
    names = ['a\n', r"'a\n'", '%3', "'%3'", '"a"', 'a']
    graph = pygraphviz.AGraph(string=as_dot(Forest([static(name, 'map') for name in names]), 0))
    assert len({*graph.nodes()}) == len({*graph.edges()}) + 1 == len(names) + 1


@pytest.fixture
def stand_in(monkeypatch, tmp_path):
    """
    Stand-ins for pygraphviz, by `stand_in(code)`.

    The code is that of the method `draw`; it can use `self.string` and `format`.
    """
    def make(code):
        (tmp_path / 'pygraphviz.py').write_text(
            'import os, signal, time\n'
            'class AGraph:\n'
            '    def __init__(self, string):\n'
            '        self.string = string\n'
            '    def draw(self, format, prog):\n'
            f'        {code}\n')
        monkeypatch.delitem(sys.modules, 'pygraphviz', raising=False)
        monkeypatch.syspath_prepend(tmp_path)

    yield make
    sys.modules.pop('pygraphviz', None)


@pytest.mark.parametrize(('code', 'why'), [
    ('raise OSError("no format pdf")', 'OSError: no format pdf'),
    ('os.write(2, b"\\nFontconfig warning\\nError: trouble\\n"); os._exit(1)', 'Error: trouble'),
    ('return b""', 'exit code 0'),
    pytest.param('os.abort()', f'exit code -{int(signal.SIGABRT)}', marks=on_unix)])
def test_graphviz_that_fails(stand_in, code, why):
    """The error has the last line of graphviz, which may be preceded by warnings."""
    stand_in(code)
    with pytest.raises(DrawingError, match=f'^graphviz cannot draw this: {why}$'):
        draw('digraph G {}', 'pdf')


def test_a_process_that_cannot_be_started(stand_in, monkeypatch):
    """The error is one line with the reason."""
    stand_in('return b"drawn"')
    monkeypatch.setattr(sys, 'executable', str(Path('nowhere') / 'python'))
    with pytest.raises(DrawingError, match=r'^cannot start the process that draws: No such file'):
        draw('digraph G {}', 'pdf')


@on_linux
def test_an_interruption_ends_what_draws(stand_in):
    """The code of graphviz cannot be interrupted."""
    stand_in(f'os.kill({os.getpid()}, signal.SIGINT); time.sleep(1000)')
    with pytest.raises(KeyboardInterrupt):
        draw('digraph G {}', 'pdf')


def test_modules_of_the_working_directory_do_not_draw(stand_in, monkeypatch, there):
    """The process that draws does not import them."""
    stand_in('return b"drawn"')
    for name in 'pygraphviz.py', 'subprocess.py':
        (there / name).write_text('raise SystemExit("found where it should not")\n')
    monkeypatch.setattr(sys, 'path', [path for path in sys.path if path])
    assert draw('digraph G {}', 'pdf') == b'drawn'
