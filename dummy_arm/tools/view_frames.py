"""The command `view_frames`: the tree of all frames, drawn into a file or in the terminal."""

from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
import os
from pathlib import Path
import sys
from typing import Optional, TYPE_CHECKING

from dummy_arm.cli.bag_options import add_bag_options, read_bag
from dummy_arm.cli.parser import CommandError, number, Parser, run, UsageError
from dummy_arm.cli.progress import wait
from dummy_arm.cli.signals import check_signals, sleep
from dummy_arm.inspection.forest import Forest, frequency
from dummy_arm.inspection.graph import as_dot, draw, DrawingError
from dummy_arm.inspection.terminal import column, height, padded, show, width, wrapped
from dummy_arm.tf import Frame
from dummy_arm.tf.formatting import display, in_seconds, shortened, suggest_names, visible

if TYPE_CHECKING:
    from dummy_arm.inspection.frame_listener import FrameListener

FORMATS = ('.pdf', '.svg', '.png')
OTHER_FORMATS = ('.dot', '.eps', '.gif', '.gv', '.jpeg', '.jpg', '.ps', '.txt')
MOST = 2000  #: frames in a drawing; of more, nothing could be read, and some take minutes
WAIT = 5.0  # s
_LONGEST = 1e9  # s
_REFRESH = 1.0  # s


def format_tree(forest: Forest, now: int, most: Optional[int] = None) -> list[str]:
    """
    Draw the trees of frames, with rates, ages and senders.

    :param now: the time from which ages count (ns).
    :param most: how many lines to draw; None: all.
    """
    rows = []
    for branches, name, frame in islice(forest.lines(), most):
        rate = age = ''
        if frame is not None and not frame.is_static:
            hertz = frequency(frame)
            rate = '? Hz' if hertz is None else f'{hertz:.1f} Hz'
            age = f'{in_seconds(now - frame.latest):.3f} s old'
        rows.append((branches, shortened(name), 'static' if frame and frame.is_static else rate,
                     age, shortened(frame.authority) if frame else ''))
    columns = column(len(branches) + width(name) for branches, name, *_ in rows)
    return [f'{branches}{padded(name, columns - len(branches))}  {rate:>9}  {age:>13}  {sender}'
            .rstrip() for branches, name, rate, age, sender in rows]


def command(output: str = 'frames', wait_time: Optional[float] = None, text: bool = False,
            watch: bool = False, bag: Optional[str] = None, namespace: str = '',
            partial: bool = False, root: Optional[str] = None, *,
            ros_args: Sequence[str] = ()) -> int:
    """
    Listen for a while or read a bag, and draw what there is.

    :param output: the file, which ends in .pdf, .svg or .png, else .pdf is added; what was drawn
        is written beside it, to a file that ends in .gv.
    :param wait_time: how long to listen (s); None: 5 s.
    :param text: print the trees instead.
    :param watch: print them again and again, until Ctrl-C.
    :param bag: what to read instead; with namespace and partial as `dummy_arm.tf.bag.read` has
        them. Times and ages count to the newest transform in it.
    :param root: draw or print only this frame and those below it.
    :returns: the exit code.
    :raises UsageError: when the time is not positive, there is no name of a file or of the root,
        or a bag should be listened to.
    :raises CommandError: when nothing was heard, a bag cannot be read, there is no such root, or a
        file cannot be drawn or written.
    """
    if bag is not None and (watch or wait_time is not None):
        raise UsageError('a bag is read, not listened to: leave out --watch and --wait-time (-t)')
    seconds = WAIT if wait_time is None else wait_time
    if not 0.0 < seconds <= _LONGEST:
        raise UsageError(f'the time to listen must be more than 0 s, and at most {_LONGEST:g} s, '
                         f'got {seconds:g}')
    root = root if root is None else root.removeprefix('/')
    if root == '':
        raise UsageError('--root needs the name of a frame')
    path = Path() if text or watch else output_path(output)
    if buffer := read_bag(bag, namespace, partial):
        frames = buffer.frames()
        now = max(frame.latest for frame in frames)
    else:
        frames, now = _heard(seconds, watch, root, ros_args)
    forest = _forest(frames, root)
    for loop in forest.loops:
        print(f'view_frames: warning: these frames form a loop: '
              f'{" -> ".join(map(shortened, [*loop, loop[0]]))}', file=sys.stderr)
    if text:
        print('\n'.join(format_tree(forest, now)))
    else:
        save(forest, now, path)
        print(f'wrote {visible(str(path))} and {visible(str(path.with_suffix(".gv")))}: '
              f'{_summary(forest)}')
    if bag is not None:
        print(_span(forest, now))
    return 0


def _heard(seconds: float, watch: bool, root: Optional[str], ros_args: Sequence[str]
           ) -> tuple[list[Frame], int]:
    """Listen for a while; tell the frames, and the time (ns)."""
    from dummy_arm.cli.node import spinning_node
    from dummy_arm.inspection.frame_listener import FrameListener
    with spinning_node('view_frames', ros_args) as node:
        listening = FrameListener(node, max(10.0, seconds))
        while watch:
            _show(listening, root)
            sleep(_REFRESH)
        wait(seconds, 'listening to /tf and /tf_static')
        frames = listening.frames()
        if not frames:
            raise CommandError(
                f'nothing was heard within {seconds:g} s. {listening.why_no_frames()}')
        return frames, listening.now()


def _show(listening: 'FrameListener', root: Optional[str]) -> None:
    """Show the trees that there are now."""
    frames = listening.frames()
    if not frames:
        show(wrapped(f'nothing yet. {listening.why_no_frames()}'))
        return
    try:
        forest = _forest(frames, root)
    except CommandError as error:  # the root may come yet
        show(wrapped(f'nothing yet: {error}'))
    else:
        show(format_tree(forest, listening.now(), height()), forest.line_count)


def _forest(frames: list[Frame], root: Optional[str]) -> Forest:
    """
    Find the trees of frames, or that of a root.

    :raises CommandError: when there is no such root.
    """
    forest = Forest(frames)
    if root is None:
        return forest
    if root not in forest.names:
        raise CommandError(f'frame {root!r} does not exist. {suggest_names(root, forest.names)}')
    return forest.subtree(root)


def output_path(output: str) -> Path:
    """
    Give the path of the file that is drawn, with .pdf added unless it tells another form.

    :raises UsageError: when that is no name of a file that can be drawn.
    :raises CommandError: when its directory cannot be written to.
    """
    path = Path(output)
    if path.name in ('', '..') or output.endswith('/'):
        raise UsageError(f'{output!r} is no name of a file')
    if path.suffix.lower() in OTHER_FORMATS:
        raise UsageError(f'{output!r} must end in {", ".join(FORMATS)}, or in none of the endings '
                         'of files: then .pdf is added')
    if path.suffix.lower() not in FORMATS:
        path = path.with_name(f'{path.name}.pdf')
    if not os.access(path.parent, os.W_OK):
        raise CommandError(f'cannot write {path}: {path.parent} is no directory, or read-only')
    return path


def save(forest: Forest, now: int, path: Path) -> None:
    """
    Draw frames into a file, and write what was drawn beside it.

    :param now: the time that the drawing tells (ns).
    :raises CommandError: when one of them cannot be drawn or written.
    """
    dot, beside = as_dot(forest, now), path.with_suffix('.gv')
    try:
        if (count := len(forest.names)) > MOST:
            raise CommandError(f'{count} frames are too many to draw; the limit is {MOST}: draw '
                               'a part, by --root FRAME, or print the tree, by --text')
        drawn = draw(dot, path.suffix[1:].lower(), check_signals)
    except (CommandError, DrawingError) as error:
        write(beside, dot.encode())
        raise CommandError(f'{error}; wrote {beside}') from None
    write(path, drawn)
    write(beside, dot.encode())


def _summary(forest: Forest) -> str:
    roots = ', '.join(map(shortened, forest.roots))
    return (f'frames: {len(forest.names)}, transforms: {len(forest.frames)}, '
            f'root: {roots or "none"}')


def _span(forest: Forest, now: int) -> str:
    """Tell of what time frames are, and to what time (ns) their ages count."""
    moving = [frame for frame in forest.frames.values() if not frame.is_static]
    if not moving:
        return 'all is static'
    begin, end = min(frame.oldest for frame in moving), max(frame.latest for frame in moving)
    counted = 'the end' if end == now else f'the end of the bag, {display(now)} s'
    return (f'from {display(begin)} s to {display(end)} s, {in_seconds(end - begin):.3f} s; '
            f'ages count to {counted}')


def write(path: Path, data: bytes) -> None:
    """
    Write a file, whole or not at all.

    :raises CommandError: when that cannot be done.
    """
    part = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        part.write_bytes(data)
        part.replace(path)
    except OSError as error:
        raise CommandError(f'cannot write {path}: {error.strerror}') from None
    finally:
        with suppress(OSError):
            part.unlink()


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'view_frames', 'Listen to /tf and /tf_static, or read a bag, and draw the tree of the '
        'frames into frames.pdf (and frames.gv).',
        'examples: view_frames\n          view_frames -t 10 -o robot.svg\n'
        '          view_frames --watch --root base_link\n'
        '          view_frames --bag robot.mcap')
    parser.add_argument('-t', '--wait-time', type=number, metavar='SECONDS',
                        help=f'how long to listen (default: {WAIT:g})')
    parser.add_argument('-o', '--output', default='frames', metavar='NAME',
                        help='the file; .svg and .png at its end say how to draw, else it is .pdf')
    parser.add_argument('--text', action='store_true',
                        help='print the tree, with rates, ages and senders, and write no file')
    parser.add_argument('--watch', action='store_true',
                        help='print the tree again and again, until Ctrl-C')
    parser.add_argument('--root', metavar='FRAME',
                        help='draw or print only this frame and those below it')
    add_bag_options(parser)
    return run(parser, command, args)
