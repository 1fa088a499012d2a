"""The command `tf2_echo`: the transform between two frames, printed again and again."""

from argparse import ArgumentTypeError
from collections.abc import Sequence
from decimal import Context, Inexact, InvalidOperation
from math import degrees
from time import monotonic
from typing import Optional

from dummy_arm.cli.bag_options import add_bag_options, read_bag
from dummy_arm.cli.parser import CommandError, number, Parser, run, UsageError
from dummy_arm.cli.signals import sleep
from dummy_arm.inspection.terminal import fixed_point
from dummy_arm.tf import Transform, TransformException
from dummy_arm.tf.formatting import logged, SECOND, visible_lines
from dummy_arm.tf.rotations import euler_from_quaternion

RATE = 1.0  # Hz
PRECISION = 3
_MOST_DIGITS = 17
_BETWEEN_WORDS = 1.0  # s
_BETWEEN_LOOKS = 0.05  # s
_EXACT = Context(prec=50, traps=[Inexact, InvalidOperation])


def format_transform(transform: Transform, precision: int = PRECISION) -> str:
    """
    Write a transform as tf2 does, but for its nanoseconds, gimbal lock and negative zeros.

    :param precision: digits after the point.
    """
    roll_pitch_yaw = euler_from_quaternion(transform.rotation)
    lines = [
        f'At time {transform.stamp // SECOND}.{transform.stamp % SECOND:09d}',
        f'- Translation: {_listed(transform.translation, precision)}',
        f'- Rotation: in Quaternion {_listed(transform.rotation, precision)}',
        f'- Rotation: in RPY (radian) {_listed(roll_pitch_yaw, precision)}',
        f'- Rotation: in RPY (degree) {_listed([*map(degrees, roll_pitch_yaw)], precision)}',
        '- Matrix:']
    lines += [''.join(f' {fixed_point(value, precision):>{precision + 3}}' for value in row)
              for row in transform.matrix().tolist()]
    return '\n'.join(lines)


def _listed(values: Sequence[float], precision: int) -> str:
    return f'[{", ".join(fixed_point(value, precision) for value in values)}]'


def command(source_frame: str, target_frame: str, echo_rate: Optional[float] = None,
            rate: Optional[float] = None, time: int = 0, precision: int = PRECISION,
            once: bool = False, bag: Optional[str] = None, namespace: str = '',
            partial: bool = False, *, ros_args: Sequence[str] = ()) -> int:
    """
    Print the transform that takes data from the target frame to the source frame.

    :param echo_rate: how often (Hz); None: once a second. That, or:
    :param rate: the same.
    :param time: of the transform (ns); 0: the latest.
    :param precision: digits after the point.
    :param once: end when it was printed.
    :param bag: what to read instead of listening; it is printed once. With namespace and partial
        as `dummy_arm.tf.bag.read` has them.
    :returns: the exit code.
    :raises UsageError: when there is no frame, or a number is impossible.
    :raises CommandError: when a bag cannot be read, or does not have it.
    """
    source_frame, target_frame = (name.removeprefix('/') for name in (source_frame, target_frame))
    if not source_frame or not target_frame:
        raise UsageError('a frame must have a name')
    rates = [given for given in (echo_rate, rate) if given is not None]
    if len(rates) == 2:
        raise UsageError('the rate is given twice')
    if bag is not None and rates:
        raise UsageError('of a bag, a transform is printed once: leave out the rate')
    hertz = rates[0] if rates else RATE
    if hertz <= 0.0:
        raise UsageError(f'the rate must be more than 0 Hz, got {hertz:g}')
    if not 0 <= precision <= _MOST_DIGITS:
        raise UsageError(f'the precision must be from 0 to {_MOST_DIGITS} digits, got {precision}')
    if buffer := read_bag(bag, namespace, partial):
        try:
            transform = buffer.lookup_transform(source_frame, target_frame, time)
        except TransformException as error:
            raise CommandError(str(error)) from None
        print(format_transform(transform, precision))
        return 0
    return _echo(source_frame, target_frame, hertz, time, precision, once, ros_args)


def _echo(source_frame: str, target_frame: str, hertz: float, time: int, precision: int,
          once: bool, ros_args: Sequence[str]) -> int:
    from rclpy.time import Time

    from dummy_arm.cli.node import spinning_node
    from dummy_arm.inspection.frame_listener import FrameListener
    with spinning_node('tf2_echo', ros_args) as node:
        listening = FrameListener(node)
        while why := listening.why_no_transform(source_frame, target_frame, time):
            node.get_logger().info(
                f'Waiting for transform {logged(source_frame)} ->  {logged(target_frame)}: '
                f'{visible_lines(why)}')
            next_word = monotonic() + _BETWEEN_WORDS
            while monotonic() < next_word and not listening.buffer.can_transform(
                    source_frame, target_frame, Time(nanoseconds=time)):
                sleep(_BETWEEN_LOOKS)
        while True:
            try:
                print(format_transform(Transform.from_message(listening.buffer.lookup_transform(
                    source_frame, target_frame, Time(nanoseconds=time))), precision))
                if once:
                    return 0
            except TransformException as error:
                frames = listening.buffer.all_frames_as_string()
                print(visible_lines(
                    f'Failure at {listening.now() / SECOND:.3f}\nException thrown:{error}\n'
                    f'The current list of frames is:\n{frames}'))
            sleep(1.0 / hertz)


def seconds(text: str) -> int:
    """
    Read a time of an argument (s), exactly to the ns.

    :raises argparse.ArgumentTypeError: when it is none, or finer than that.
    """
    try:
        time = _EXACT.multiply(_EXACT.create_decimal(text.replace('_', '?')), SECOND)
        if not 0 <= time < 2**63 or time != int(time):
            raise ValueError
    except (ArithmeticError, ValueError):
        raise ArgumentTypeError(f'{text!r} must be a time in s, not negative, with at most 9 '
                                'digits after the point') from None
    return int(time)


def digits(text: str) -> int:
    """
    Read a number of digits of an argument.

    :raises argparse.ArgumentTypeError: when it is none.
    """
    value = number(text)
    if value != int(value):
        raise ArgumentTypeError(f'{text!r} is no whole number')
    return int(value)


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'tf2_echo', 'Print the transform to get data from target_frame into source_frame, again '
        'and again.',
        'examples: tf2_echo map base_link\n          tf2_echo map base_link 10\n'
        '          tf2_echo map base_link --once -p 6\n'
        '          tf2_echo --bag robot.mcap map base_link -t 1795204940.25')
    parser.add_argument('source_frame')
    parser.add_argument('target_frame')
    parser.add_argument('echo_rate', nargs='?', type=number, metavar='rate',
                        help=f'how often (Hz; default: {RATE:g})')
    parser.add_argument('-r', '--rate', type=number, help='the same')
    parser.add_argument('-t', '--time', type=seconds, default=0,
                        help='of the transform (s; default: 0, the latest)')
    parser.add_argument('-p', '--precision', type=digits, default=PRECISION, metavar='DIGITS',
                        help='after the point (default: %(default)s)')
    parser.add_argument('--once', action='store_true', help='print it once')
    add_bag_options(parser)
    return run(parser, command, args)
