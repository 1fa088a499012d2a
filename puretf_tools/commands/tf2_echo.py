"""The command `tf2_echo`: print the transform between two frames repeatedly."""

from collections.abc import Sequence
from math import degrees
from time import monotonic
from typing import Optional, TYPE_CHECKING

from puretf import exact_time, SECOND, Transform, TransformException
from puretf._text.names import shortened, visible
from puretf.exceptions import tf2_words
from puretf.rotations import euler_from_quaternion
from puretf_tools.cli.bag_options import add_bag_options, BagOption
from puretf_tools.cli.parser import CommandError, frame_name, number, Parser, run, UsageError
from puretf_tools.cli.signals import sleep
from puretf_tools.cli.times import LATEST, WHEN, When, when
from puretf_tools.inspection.terminal import fixed_point, Once
from puretf_tools.source import source

if TYPE_CHECKING:
    from puretf_tools.inspection.frame_listener import FrameListener

RATE = 1.0  # Hz
PRECISION = 3
_MAX_DIGITS = 17
#: While the transform is not available: the interval between two log lines (s), and the interval
#: between two checks for the transform (s).
_LOG_PERIOD, _LOOKUP_PERIOD = 1.0, 0.05


def format_transform(transform: Transform, precision: int = PRECISION) -> str:
    """
    Format a transform like tf2_echo of tf2_ros.

    But nanoseconds have leading zeros, angles are right at gimbal lock, and zero has no minus.
    """
    roll_pitch_yaw = euler_from_quaternion(transform.rotation)
    lines = [
        f'At time {exact_time(transform.stamp)}',
        f'- Translation: {_bracketed(transform.translation, precision)}',
        f'- Rotation: in Quaternion {_bracketed(transform.rotation, precision)}',
        f'- Rotation: in RPY (radian) {_bracketed(roll_pitch_yaw, precision)}',
        f'- Rotation: in RPY (degree) {_bracketed([*map(degrees, roll_pitch_yaw)], precision)}',
        '- Matrix:']
    lines += [''.join(f' {fixed_point(value, precision):>{precision + 3}}' for value in row)
              for row in transform.matrix().tolist()]
    return '\n'.join(lines)


def _bracketed(values: Sequence[float], precision: int) -> str:
    return f'[{", ".join(fixed_point(value, precision) for value in values)}]'


def command(source_frame: str, target_frame: str, echo_rate: Optional[float],
            rate: Optional[float], time: When, precision: int, once: bool,
            bag: Optional[BagOption], namespace: str, ros_args: Sequence[str]) -> int:
    """
    Print the pose of the target frame in the source frame.

    Compared with `lookup_transform`, the names of the two frames are swapped.
    """
    rates = [given for given in (echo_rate, rate) if given is not None]
    if len(rates) == 2:
        raise UsageError('the rate is given twice')
    if bag is not None and rates:
        raise UsageError('with --bag, the transform is printed once: leave out the rate')
    hertz = rates[0] if rates else RATE
    if hertz <= 0.0:
        raise UsageError(f'the rate must be more than 0 Hz, got {hertz:g}')
    if not 0 <= precision <= _MAX_DIGITS:
        raise UsageError(f'the precision must be from 0 to {_MAX_DIGITS} digits, got {precision}')
    with source('tf2_echo', bag, namespace, ros_args) as found:
        listener, ends = found.listener, (source_frame, target_frame, time.within(found.span))
        if listener:
            _wait(listener, *ends)
        elif why := found.why_not(*ends):
            raise CommandError(why)
        told, say = '', Once()
        while True:
            before, told = told, listener.time_hint() if listener else ''
            if told not in ('', before):
                print(visible(told))
                sleep(_LOOKUP_PERIOD)  # until the next transforms arrive
            try:
                transform = found.lookup(*ends)
                print(format_transform(transform, precision))
                if note := found.interpolated(source_frame, target_frame, transform.stamp):
                    print(note)
                if once or bag:
                    return 0
                say = Once()
            except TransformException as error:
                words = tf2_words(error)
                print(_visible_lines(
                    f'Failure at {found.now() / SECOND:.3f}\n'
                    f'Exception thrown:{say(str(error), words)}\n'
                    f'The current list of frames is:\n{found.buffer.all_frames_as_string()}'))
            sleep(1.0 / hertz)


def _wait(listener: 'FrameListener', source_frame: str, target_frame: str, stamp: int) -> None:
    """Wait for a transform; log once a second what is missing."""
    ends, say = (source_frame, target_frame, stamp), Once()
    while why := listener.why_no_transform(*ends, say):
        listener.node.get_logger().info(
            f'Waiting for transform {shortened(source_frame)} ->  {shortened(target_frame)}: '
            f'{_visible_lines(why)}')
        next_log = monotonic() + _LOG_PERIOD
        while monotonic() < next_log and listener.buffer.why_not(*ends, has_hint=False):
            sleep(_LOOKUP_PERIOD)


def _visible_lines(text: str) -> str:
    return '\n'.join(map(visible, text.split('\n')))


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command with some arguments, or those of the command line."""
    parser = Parser(
        'tf2_echo', 'Repeatedly print the transform to get data from target_frame into '
        'source_frame: the pose of target_frame in source_frame.',
        'examples: tf2_echo map base_link\n          tf2_echo map base_link 10\n'
        '          tf2_echo map base_link --once -p 6\n'
        '          tf2_echo --bag robot.mcap map base_link -t 1795204940.25')
    parser.add_argument('source_frame', type=frame_name)
    parser.add_argument('target_frame', type=frame_name)
    parser.add_argument('echo_rate', nargs='?', type=number, metavar='rate',
                        help=f'how often to print the transform (Hz; default: {RATE:g})')
    parser.add_argument('-r', '--rate', type=number, help='the rate (Hz), as an option')
    parser.add_argument('-t', '--time', type=when, default=LATEST, help=f'{WHEN} (default: 0)')
    parser.add_argument('-p', '--precision', type=int, default=PRECISION, metavar='DIGITS',
                        help='digits after the point (default: %(default)s)')
    parser.add_argument('--once', action='store_true', help='print the transform once, then exit')
    add_bag_options(parser)
    return run(parser, command, args)
