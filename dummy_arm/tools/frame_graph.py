"""The graph of the frames: in the DOT language, and drawn."""

from collections.abc import Iterator
from contextlib import contextmanager
import os

from dummy_arm.command import CommandError
from dummy_arm.tf.frames import Frame, quoted
from dummy_arm.tf.texts import visible
from dummy_arm.tf.times import display, in_seconds
from dummy_arm.tools.forest import Forest, frequency


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
    return quoted(name if name.isprintable() else repr(name))


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


def draw(dot: str, form: str) -> bytes:
    """
    Draw a graph.

    :param dot: the graph, in the DOT language.
    :param form: pdf, svg or png.
    :returns: the bytes of the file.
    :raises CommandError: when there is no pygraphviz.
    """
    try:
        from pygraphviz import AGraph
    except ImportError as error:
        raise CommandError(
            f'pygraphviz, which draws, cannot be imported ({error}): pip install pygraphviz; or '
            'with ROS on Ubuntu: apt install python3-pygraphviz') from None
    with _no_word():
        drawn: bytes = AGraph(string=dot).draw(format=form, prog='dot')
    return drawn


@contextmanager
def _no_word() -> Iterator[None]:
    """Have C libraries say nothing on stderr: fontconfig does, whenever it reads its files."""
    stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)
