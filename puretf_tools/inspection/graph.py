"""The graph of the frames: in the DOT language, and as a drawing."""

from html import escape
import subprocess
import sys

from puretf import exact_time, Frame, in_seconds
from puretf._text.names import dot_escaped, dot_quoted, LONGEST_NAME, shortened
from puretf._text.times import display_time
from puretf_tools.inspection.forest import Forest
from puretf_tools.inspection.traffic import rate_of

#: The program that draws. It gets `sys.path`, since `python -c` prefers the working directory.
_DRAWING = """
import sys
file_format, *sys.path = sys.argv[1:]
from pygraphviz import AGraph
dot = sys.stdin.buffer.read().decode()
sys.stdout.buffer.write(AGraph(string=dot).draw(format=file_format, prog='dot'))
"""


class DrawingError(Exception):
    """The graph cannot be drawn; the text says why, and what to do."""


def as_dot(forest: Forest, now: int) -> str:
    """Return the graph in the DOT language, with the labels of tf2's view_frames."""
    frames = forest.frames.values()
    names = [*(name for frame in frames for name in (frame.parent, frame.name)), *forest.roots]
    lines = ['digraph G {',
             f'label="view_frames Result\\nRecorded at time: {display_time(now)}";',
             'labelloc=t;',
             # In some other fonts, "ff" is one character, so a search for "end_effector" fails.
             'fontname=monospace;',
             'node [fontname=monospace];',
             'edge [fontname=monospace, fontsize=10];']
    lines += [f'{_id(name)} [label="{_label(name)}"];' for name in dict.fromkeys(names)]
    lines += [f'{_id(frame.parent)} -> {_id(frame.name)} [label="{_edge_label(frame)}"];'
              for frame in frames]
    return '\n'.join([*lines, '}\n'])


def _id(name: str) -> str:
    # Graphviz copies identifiers into SVG files, which must not contain control characters. A name
    # that begins with a quote could equal the escaped form of another name. Graphviz takes a name
    # that begins with a percent sign for an anonymous node.
    is_plain = name.isprintable() and not name.startswith(("'", '"', '%'))
    return dot_quoted(name if is_plain else repr(name))


def _edge_label(frame: Frame) -> str:
    lines = [f'Broadcaster: {_label(frame.authority)}']
    if frame.is_static:
        lines += ['static']
    else:
        hertz = rate_of(frame)
        lines += [f'Average rate: {"unknown" if hertz is None else f"{hertz:.3f} Hz"}',
                  f'Buffer length: {in_seconds(frame.latest - frame.oldest):.3f} s',
                  f'Most recent transform: {exact_time(frame.latest)}',
                  f'Oldest transform: {exact_time(frame.oldest)}']
    return ''.join(f'  {line}\\l' for line in lines)


def _label(text: str) -> str:
    text = '\n'.join(shortened(line, LONGEST_NAME) for line in text.split('\n'))
    return dot_escaped(escape(text, quote=False))


def draw(dot: str, file_format: str) -> bytes:
    """Draw a graph as pdf, svg or png; raise a DrawingError if that fails."""
    try:
        import pygraphviz  # noqa: F401  (an error is clearer here than from the process)
    except ImportError as error:
        raise DrawingError(
            f'drawing needs pygraphviz, which cannot be imported ({error}): pip install '
            'pygraphviz; or with ROS on Ubuntu: apt install python3-pygraphviz') from None
    # Ctrl-C cannot interrupt the C code of graphviz, but its process can be killed.
    try:
        done = subprocess.run([sys.executable, '-c', _DRAWING, file_format, *sys.path],
                              input=dot.encode(), capture_output=True, check=False)
    except OSError as error:
        raise DrawingError(f'cannot start the process that draws: {error.strerror}') from None
    if done.returncode or not done.stdout:
        # The last line is the error; the lines before it may be warnings of fontconfig.
        lines = done.stderr.decode(errors='replace').strip().splitlines()
        raise DrawingError('graphviz cannot draw this: '
                           f'{lines[-1] if lines else f"exit code {done.returncode}"}')
    return done.stdout
