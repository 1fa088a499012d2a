"""The options, errors and exit codes that the commands share; this module works without ROS."""

import argparse
from collections.abc import Callable, Sequence
from math import isfinite
import os
import re
import signal
import sys
from typing import Any, NoReturn, Optional

from puretf._text.names import visible
from puretf._text.similar_names import near_names
from puretf_tools.cli.signals import record_signals, restore_signals, signal_received


class UsageError(ValueError):
    """An invalid argument or parameter: exit code 2. The text says what is allowed."""


class CommandError(Exception):
    """A failure: exit code 1. The text gives the reason, and perhaps a remedy."""


class Parser(argparse.ArgumentParser):
    """A parser that accepts negative numbers in any notation and prints errors in one line."""

    def __init__(self, prog: str, description: str, epilog: str = '', **kwargs: Any) -> None:
        super().__init__(prog=prog, description=description, epilog=epilog, allow_abbrev=False,
                         formatter_class=argparse.RawDescriptionHelpFormatter, **kwargs)
        # With the pattern of argparse, -1e-3 and -nan would be options instead of numbers.
        self._negative_number_matcher = re.compile(r'-(\d|\.\d|inf|nan)', re.IGNORECASE)
        #: Rewrites the arguments before they are parsed.
        self.prepare: Callable[[list[str]], list[str]] = list
        #: Called with the options by name, which it may change; may raise UsageError.
        self.finish: Callable[[dict[str, Any]], object] = len

    def error(self, message: str) -> NoReturn:
        """Print an error in one line on stderr, and exit with code 2."""
        if message.startswith(unknown := 'unrecognized arguments: '):
            for argument in message.removeprefix(unknown).split():
                near = near_names(argument.partition('=')[0], self._option_string_actions)
                if near and argument.startswith('--'):
                    message = f'{message} (did you mean {near[0]}?)'
        # A wrong value needs no usage: its error says what it must be.
        usage = '' if message.startswith('argument ') else f'; {self.format_usage()}'
        self.exit(2, f'{self.prog}: {visible(message)}{" ".join(usage.split())}\n')


def add_namespace_option(parser: Parser, what: str, *topics: str) -> None:
    """Add `--namespace`; the help says what the command does with the topics (default: TF's)."""
    parser.add_argument('--namespace', default='', metavar='NAME',
                        help=f'{what} ' + ' and '.join(
                            f'/NAME/{topic}' for topic in topics or ('tf', 'tf_static')))


def number(text: str) -> float:
    try:
        value = float(text.replace('_', '?'))  # float would read '1_0' as 10
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number') from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not finite')
    return value


def frame_name(text: str) -> str:
    """Convert an argument to the name of a frame, without a leading slash."""
    name = text.removeprefix('/')
    if not name:
        raise argparse.ArgumentTypeError('a frame must have a name')
    return name


def run(parser: Parser, command: Callable[..., int],
        args: Optional[Sequence[str]] = None, interrupted: int = 0) -> int:
    """
    Parse the arguments, run a command, print its error in one line, and return its exit code.

    :param command: gets the parsed arguments by keyword, and `ros_args`, the command line with the
        name of the command.
    :param interrupted: the exit code if a signal ends the command, unless it has the option
        `--bag`, or if the program that reads its output has ended.
    """
    arguments = [parser.prog, *(sys.argv[1:] if args is None else args)]
    handlers, bag = record_signals(has_limit=True), None
    try:
        given = _without_ros_args(arguments)[1:]
        options = vars(parser.parse_args(parser.prepare(given)))
        bag = options.get('bag')
        parser.finish(options)
        _make_writable()
        return command(ros_args=arguments, **options)
    except KeyboardInterrupt:
        if number := bag and (signal_received() or signal.SIGINT):
            print(f'{parser.prog}: ended early by {signal.Signals(number).name}', file=sys.stderr)
        return 128 + number if number else interrupted
    except BrokenPipeError:  # for example, the output is piped to `head`, which has ended
        _close_stdout()
        return interrupted
    except (UsageError, CommandError, OSError) as error:
        if isinstance(error, OSError):
            _close_stdout()
        print(f'{parser.prog}: {visible(str(error))}', file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    finally:
        restore_signals(handlers)


def _make_writable() -> None:
    """Flush each line, escape characters that cannot be encoded, and replace closed streams."""
    for name in 'stdout', 'stderr':
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, 'w'))  # noqa: SIM115
        getattr(sys, name).reconfigure(line_buffering=True, errors='backslashreplace')


def _close_stdout() -> None:
    """Redirect stdout to the null device, so that flushing it at exit does not fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _without_ros_args(arguments: list[str]) -> list[str]:
    rest, is_for_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            is_for_ros = True
        elif not is_for_ros:
            rest.append(argument)
        elif argument == '--':
            is_for_ros = False
    return rest
