"""The command `view_frames`: draw the tree of all frames to a file or in the terminal."""

from collections.abc import Sequence
from pathlib import Path
import sys
from typing import Optional, TYPE_CHECKING

from puretf import exact_time, Frame, in_seconds
from puretf._text.names import shortened, visible
from puretf._text.similar_names import suggest_names
from puretf_tools.cli.bag_options import add_bag_options, BagOption
from puretf_tools.cli.files import path_to_write, whole_file
from puretf_tools.cli.parser import CommandError, frame_name, Parser, run, UsageError
from puretf_tools.cli.signals import check_signals, sleep
from puretf_tools.inspection.forest import Forest
from puretf_tools.inspection.graph import as_dot, draw, DrawingError
from puretf_tools.inspection.terminal import columns, is_terminal, Once, show, wrapped
from puretf_tools.inspection.traffic import rate_text
from puretf_tools.source import source

if TYPE_CHECKING:
    from puretf_tools.inspection.frame_listener import FrameListener

FORMATS = ('.pdf', '.svg', '.png')
#: A drawing of more frames is not legible, and can take minutes.
MAX_FRAMES = 2000
#: The interval at which --watch prints the tree (s).
_REFRESH = 1.0


def format_tree(forest: Forest, now: int) -> list[str]:
    """Draw trees as text, with rates, ages at a time (ns) and publishers."""
    rows = []
    for branches, name, frame in forest.lines():
        rate, age, publisher = (
            rate_text(frame), '' if frame.is_static else _age(now, frame.latest),
            shortened(frame.authority)) if frame else ('', '', '')
        rows.append((branches + shortened(name), f'{rate:>9}', f'{age:>13}', publisher))
    return columns(rows)


def _age(now: int, stamp: int) -> str:
    if not now or not stamp:  # nothing has arrived on /clock
        return '? s old'
    seconds = in_seconds(now - stamp)
    return f'{seconds:.3f} s old' if seconds > -0.0005 else f'{-seconds:.3f} s ahead'


def command(output: str, seconds: float, text: bool, watch: bool, bag: Optional[BagOption],
            namespace: str, root: Optional[str], ros_args: Sequence[str]) -> int:
    """Listen to transforms for some time, or read a bag; then draw the tree of frames."""
    if bag and watch:
        raise UsageError('--watch is for listening: leave it out with --bag')
    path = Path() if text or watch else output_path(output)
    with source('view_frames', bag, namespace, ros_args, seconds) as found:
        clock, say = '', Once(is_terminal())
        if listener := found.listener:
            while watch:
                _show(listener, root, say)
                sleep(_REFRESH)
            found.listen(seconds, listener.time_hint)
            check_signals()
            if not listener.buffer.frame_names():
                raise CommandError(f'no transform was received. {listener.why_nothing()}')
            if hint := listener.topics_hint():
                print(f'view_frames: warning: {visible(hint)}', file=sys.stderr)
            clock = listener.clock_text()
        now, frames = found.now(), found.frames()
    forest = _forest(frames, root)
    for loop in forest.loops:
        print(f'view_frames: warning: these frames form a loop: '
              f'{" -> ".join(map(shortened, [*loop, loop[0]]))}', file=sys.stderr)
    if text:
        print('\n'.join(format_tree(forest, now)))
    else:
        save(forest, now, path)
        roots = ', '.join(map(shortened, forest.roots))
        print(f'wrote {visible(str(path))} and {visible(str(path.with_suffix(".gv")))}: '
              f'frames: {len(forest.names)}, transforms: {len(forest.frames)}, '
              f'root: {roots or "none"}')
    if clock or bag:
        print(clock or f'ages are relative to the end of the bag, {exact_time(now)} s')
    return 0


def _show(frame_listener: 'FrameListener', root: Optional[str], say: Once) -> None:
    # The time first: reading and arranging 100,000 frames takes long, and would add to the ages.
    now, frames = frame_listener.now(), frame_listener.frames()
    if not frames:
        show(wrapped(frame_listener.nothing_received(say)))
        return
    try:
        forest = _forest(frames, root)
    except CommandError as error:  # the root may be published later
        show(wrapped(f'waiting for the root: {error}'))
    else:
        hint = frame_listener.topics_hint()
        line = f'Warning: {hint}' if hint else frame_listener.clock_text()
        show([*(wrapped(line) if line else []), *format_tree(forest, now)])


def _forest(frames: list[Frame], root: Optional[str]) -> Forest:
    forest = Forest(frames)
    if root is not None and root not in forest.names:
        raise CommandError(f'frame {root!r} does not exist. {suggest_names(root, forest.names)}')
    return forest if root is None else forest.subtree(root)


def output_path(output: str) -> Path:
    """Return the path of the drawing, with its ending; check that it can be written."""
    has_ending = '.' in Path(output).name
    return path_to_write(output if has_ending else f'{output}.pdf', FORMATS)


def save(forest: Forest, now: int, path: Path) -> None:
    """Draw frames to a file, and write a .gv file, also if they cannot be drawn."""
    dot, dot_path = as_dot(forest, now), path.with_suffix('.gv')
    try:
        if (count := len(forest.names)) > MAX_FRAMES:
            raise CommandError(f'{count} frames are too many to draw; the limit is {MAX_FRAMES}: '
                               'draw a part with --root FRAME, or print the tree with --text')
        drawing = draw(dot, path.suffix[1:].lower())
    except (CommandError, DrawingError) as error:
        write(dot_path, dot.encode())
        raise CommandError(f'{error}; wrote {dot_path}') from None
    write(path, drawing)
    write(dot_path, dot.encode())


def write(path: Path, data: bytes) -> None:
    """Write a file completely, or leave it unchanged."""
    with whole_file(path) as part:
        part.write_bytes(data)


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command with some arguments, or those of the command line."""
    parser = Parser(
        'view_frames', 'Listen to /tf and /tf_static, or read a bag, and draw the tree of frames '
        'to frames.pdf (and frames.gv).',
        'examples: view_frames\n          view_frames -t 10 -o robot.svg\n'
        '          view_frames --watch --root base_link\n'
        '          view_frames --bag robot.mcap')
    parser.add_argument('-o', '--output', default='frames', metavar='NAME',
                        help='the file of the drawing, in the format .pdf, .svg or .png; to a '
                             'name without an ending, .pdf is added (default: %(default)s)')
    parser.add_argument('--text', action='store_true',
                        help='print the tree with rates, ages and publishers, and write no file')
    parser.add_argument('--watch', action='store_true',
                        help='print the tree every second, until Ctrl-C')
    parser.add_argument('--root', type=frame_name, metavar='FRAME',
                        help='draw or print only this frame and its descendants')
    add_bag_options(parser, '-t', '--wait-time')
    return run(parser, command, args)
