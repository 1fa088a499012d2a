"""The graph of the frames: in the DOT language, and drawn."""

from collections.abc import Callable
from contextlib import suppress
import os
import signal
import subprocess
import sys
from tempfile import TemporaryFile

from dummy_arm.inspection.forest import Forest, frequency
from dummy_arm.tf import Frame
from dummy_arm.tf.formatting import display, dot_quoted, in_seconds, visible

_STEP = 0.05  # s
#: The program that draws. It imports modules from where this process does, so that none in the
#: directory in which it runs takes their place.
_DRAWING = """
import sys
if sys.platform == 'linux':
    import ctypes
    ctypes.CDLL(None).prctl(1, 9)  # PR_SET_PDEATHSIG: SIGKILL, should the parent be killed
file_format, *sys.path = sys.argv[1:]
from pygraphviz import AGraph
dot = sys.stdin.buffer.read().decode()
sys.stdout.buffer.write(AGraph(string=dot).draw(format=file_format, prog='dot'))
"""


class DrawingError(Exception):
    """A graph cannot be drawn; the text says why, and what to do."""


def as_dot(forest: Forest, now: int) -> str:
    """
    Write the graph of the frames.

    :param now: the time that it tells (ns).
    """
    frames = forest.frames.values()
    names = [*(name for frame in frames for name in (frame.parent, frame.name)), *forest.roots]
    lines = ['digraph G {',
             f'label="view_frames Result\\nRecorded at time: {display(now)}";',
             'labelloc=t;',
             # Other fonts have ligatures, by which "end_effector" is not found in the PDF.
             'fontname=monospace;',
             'node [fontname=monospace];',
             'edge [fontname=monospace, fontsize=10];']
    lines += [f'{_id(name)} [label="{_label(name)}"];' for name in dict.fromkeys(names)]
    lines += [f'{_id(frame.parent)} -> {_id(frame.name)} [label="{_known(frame)}"];'
              for frame in frames]
    return '\n'.join([*lines, '}\n'])


def _id(name: str) -> str:
    """Name a node; in a way that XML takes, too."""
    return dot_quoted(name if name.isprintable() else repr(name))


def _known(frame: Frame) -> str:
    lines = [f'Broadcaster: {_label(frame.authority)}']
    if frame.is_static:
        lines += ['static']
    else:
        rate = frequency(frame)
        lines += [f'Average rate: {"unknown" if rate is None else f"{rate:.3f} Hz"}',
                  f'Buffer length: {in_seconds(frame.latest - frame.oldest):.3f} s',
                  f'Most recent transform: {display(frame.latest)}',
                  f'Oldest transform: {display(frame.oldest)}']
    return ''.join(f'  {line}\\l' for line in lines)


def _label(text: str) -> str:
    """Write a text as a label shows it as it is; a newline begins a new line."""
    text = '\n'.join(visible(line) for line in text.split('\n'))
    for character, written in (('&', '&amp;'), ('<', '&lt;'), ('"', '&quot;'), ('\\', '\\\\'),
                               ('\n', '\\n')):
        text = text.replace(character, written)
    return text


def draw(dot: str, file_format: str, tick: Callable[[], object] = lambda: None) -> bytes:
    """
    Draw a graph.

    :param dot: the graph, in the DOT language.
    :param file_format: pdf, svg or png.
    :param tick: is called again and again meanwhile; what it raises ends the drawing.
    :returns: the bytes of the file.
    :raises DrawingError: when there is no pygraphviz, or graphviz fails.
    """
    try:
        import pygraphviz  # noqa: F401  (for a better error than that of the process)
    except ImportError as error:
        raise DrawingError(
            f'pygraphviz, which draws, cannot be imported ({error}): pip install pygraphviz; or '
            'with ROS on Ubuntu: apt install python3-pygraphviz') from None
    # In a process of its own, since a signal does not interrupt C code; and in a session of its
    # own, which Ctrl-C does not reach. The program dot, which pygraphviz starts before version 2,
    # is in this session, too. The graph is in a file, because a communicate() that is called again
    # after its timeout sends nothing more.
    try:
        with TemporaryFile() as graph:
            graph.write(dot.encode())
            graph.seek(0)
            process = subprocess.Popen(
                [sys.executable, '-c', _DRAWING, file_format, *sys.path], start_new_session=True,
                stdin=graph, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    except OSError as error:
        raise DrawingError(f'a process that draws cannot be started: {error.strerror}') from None
    with process:
        try:
            drawn, said = _outcome(process, tick)
        except BaseException:
            _kill(process)
            raise
    if process.returncode or not drawn:
        # The last line is the error; those before may be warnings, as of fontconfig.
        lines = said.decode(errors='replace').strip().splitlines()
        raise DrawingError('graphviz cannot draw this: '
                           f'{lines[-1] if lines else f"exit code {process.returncode}"}')
    return drawn


def _outcome(process: 'subprocess.Popen[bytes]', tick: Callable[[], object]
             ) -> tuple[bytes, bytes]:
    """Return what a process writes to stdout and stderr until it ends."""
    while True:
        tick()
        with suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=_STEP)


def _kill(process: 'subprocess.Popen[bytes]') -> None:
    """End a process and what it has started."""
    if sys.platform == 'win32':
        process.kill()
    else:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
