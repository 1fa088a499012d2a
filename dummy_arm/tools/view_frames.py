"""The command `view_frames`: the tree of all frames, drawn into a file or in the terminal."""

from collections.abc import Sequence
from contextlib import suppress
import os
from pathlib import Path
import shutil
import sys
from textwrap import wrap
from typing import Optional
from unicodedata import combining, east_asian_width

from rclpy.duration import Duration
from rclpy.node import Node

from dummy_arm.command import CommandError, number, Parser, run, UsageError
from dummy_arm.interruption import sleep
from dummy_arm.node_command import spun_node
from dummy_arm.tf import Buffer
from dummy_arm.tf.frames import Frame
from dummy_arm.tf.senders import SenderListener
from dummy_arm.tf.times import in_seconds
from dummy_arm.tools.forest import Forest, frequency
from dummy_arm.tools.frame_graph import as_dot, draw, visible
from dummy_arm.tools.waiting import wait

FORMS = ('.pdf', '.svg', '.png')
NO_FORMS = ('.dot', '.eps', '.gif', '.gv', '.jpeg', '.jpg', '.ps', '.txt')
WAIT = 5.0  # s
_LONGEST = 1e9  # s
_REFRESH = 1.0  # s
_HOME_AND_CLEAR = '\x1b[H\x1b[2J'


class FrameViewer:
    """Rebuilds the tree of frames from what a node hears."""

    def __init__(self, node: Node, seconds: float) -> None:
        """
        Begin to listen.

        :param seconds: how long transforms are kept at least.
        """
        self._node = node
        buffer = Buffer(Duration(seconds=max(10.0, seconds)), node)
        self._listener = SenderListener(buffer, node)

    def now(self) -> int:
        """Tell the time (ns)."""
        return int(self._node.get_clock().now().nanoseconds)

    def frames(self) -> list[Frame]:
        """List the frames that were heard of, with their senders."""
        return self._listener.frames()

    def why_none(self) -> str:
        """Tell what may be the reason that nothing was heard."""
        publishers = sum(map(self._node.count_publishers, ('/tf', '/tf_static')))
        return (f'Publishers on /tf and /tf_static here: {publishers}. Check that something '
                'publishes, and that it has the same '
                f'ROS_DOMAIN_ID (here: {os.environ.get("ROS_DOMAIN_ID") or 0}) and '
                'ROS_AUTOMATIC_DISCOVERY_RANGE (here: '
                f'{os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"}); or listen '
                'longer: to discover others may take seconds.')


def lines_of(frames: list[Frame], now: int) -> list[str]:
    """Draw the trees of frames, with rates, ages and senders."""
    rows = []
    for branches, name, frame in Forest(frames).drawn():
        rate = age = ''
        if frame is not None and not frame.is_static:
            hertz = frequency(frame)
            rate = '? Hz' if hertz is None else f'{hertz:.1f} Hz'
            age = f'{in_seconds(now - frame.latest):.3f} s old'
        rows.append((branches + visible(name),
                     'static' if frame and frame.is_static else rate, age,
                     visible(frame.authority) if frame else ''))
    width = max((_width(row[0]) for row in rows), default=0)
    return [f'{tree}{" " * (width - _width(tree))}  {rate:>9}  {age:>13}  {sender}'.rstrip()
            for tree, rate, age, sender in rows]


def _width(text: str) -> int:
    """Count the columns of a terminal that a text takes."""
    return sum(0 if combining(c) else 1 + (east_asian_width(c) in 'WF') for c in text)


def _cut(line: str, columns: int) -> str:
    while _width(line) > columns:
        line = line[:-1]
    return line


def command(output: str = 'frames', wait_time: float = WAIT, text: bool = False,
            watch: bool = False, *, ros_args: Sequence[str] = ()) -> int:
    """
    Listen for a while, and draw what was heard.

    :param output: the file, which ends in .pdf, .svg or .png, else .pdf is added; what was drawn
        is written beside it, to a file that ends in .gv.
    :param wait_time: how long to listen (s).
    :param text: print the trees instead.
    :param watch: print them again and again, until Ctrl-C.
    :returns: the exit code.
    :raises UsageError: when the time is not positive, or there is no name of a file.
    :raises CommandError: when nothing was heard, or a file cannot be drawn or written.
    """
    if not 0.0 < wait_time <= _LONGEST:
        raise UsageError(f'the time to listen must be more than 0 s, and at most {_LONGEST:g} s, '
                         f'got {wait_time:g}')
    path = Path() if text or watch else path_of(output)
    with spun_node('view_frames', ros_args) as node:
        listening = FrameViewer(node, wait_time)
        if watch:
            return _watch(listening)
        wait(wait_time, 'listening to /tf and /tf_static')
        frames, now = listening.frames(), listening.now()
        if not frames:
            raise CommandError(f'nothing was heard within {wait_time:g} s. {listening.why_none()}')
    forest = Forest(frames)
    for loop in forest.loops:
        print(f'view_frames: warning: these frames form a loop: '
              f'{" -> ".join(map(visible, [*loop, loop[0]]))}', file=sys.stderr)
    if text:
        print('\n'.join(lines_of(frames, now)))
        return 0
    save(frames, now, path)
    print(f'wrote {visible(str(path))} and {visible(str(path.with_suffix(".gv")))}: '
          f'{_summary(forest)}')
    return 0


def path_of(output: str) -> Path:
    """
    Give the path of the file that is drawn, with .pdf added unless it tells another form.

    :raises UsageError: when that is no name of a file that can be drawn.
    :raises CommandError: when its directory cannot be written to.
    """
    path = Path(output)
    if path.name in ('', '..') or output.endswith('/'):
        raise UsageError(f'{output!r} is no name of a file')
    if path.suffix.lower() in NO_FORMS:
        raise UsageError(f'{output!r} must end in {", ".join(FORMS)}, or in none of the endings '
                         'of files: then .pdf is added')
    if path.suffix.lower() not in FORMS:
        path = path.with_name(f'{path.name}.pdf')
    if not os.access(path.parent, os.W_OK):
        raise CommandError(f'cannot write {path}: {path.parent} is no directory, or read-only')
    return path


def save(frames: list[Frame], now: int, path: Path) -> None:
    """
    Draw frames into a file, and write what was drawn beside it.

    :param now: the time that the drawing tells (ns).
    :raises CommandError: when one of them cannot be drawn or written.
    """
    dot = as_dot(frames, now)
    try:
        drawn = draw(dot, path.suffix[1:].lower())
    except CommandError:
        write(path.with_suffix('.gv'), dot.encode())
        raise
    write(path, drawn)
    write(path.with_suffix('.gv'), dot.encode())


def _summary(forest: Forest) -> str:
    roots = ', '.join(map(visible, forest.roots))
    return (f'frames: {len(forest.frames) + len(forest.roots)}, transforms: {len(forest.frames)}, '
            f'root: {roots or "none"}')


def _watch(listening: FrameViewer) -> int:
    while True:
        columns, height = shutil.get_terminal_size()
        frames = listening.frames()
        lines = (lines_of(frames, listening.now()) if frames else
                 wrap(f'nothing yet. {listening.why_none()}', columns))
        if sys.stdout.isatty():
            lines = [_cut(line, columns) for line in lines[:max(1, height - 1)]]
            lines[0] = _HOME_AND_CLEAR + lines[0]
            print(*lines, sep='\n')
        else:
            print(*lines, '', sep='\n')
        sleep(_REFRESH)


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
        'view_frames', 'Listen to /tf and /tf_static, and draw the tree of the frames into '
        'frames.pdf (and frames.gv).',
        'examples: view_frames\n          view_frames -t 10 -o robot.svg\n'
        '          view_frames --watch')
    parser.add_argument('-t', '--wait-time', type=number, default=WAIT, metavar='SECONDS',
                        help='how long to listen (default: %(default)g)')
    parser.add_argument('-o', '--output', default='frames', metavar='NAME',
                        help='the file; .svg and .png at its end say how to draw, else it is .pdf')
    parser.add_argument('--text', action='store_true',
                        help='print the tree, with rates, ages and senders, and write no file')
    parser.add_argument('--watch', action='store_true',
                        help='print the tree again and again, until Ctrl-C')
    return run(parser, command, args)
