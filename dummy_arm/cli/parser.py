"""What the commands share: arguments, errors and exit codes; no ROS."""

import argparse
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from math import isfinite
import os
import re
import signal
import sys
from typing import Any, NoReturn, Optional

from dummy_arm.cli.signals import record_signals
from dummy_arm.tf.formatting import visible


class UsageError(ValueError):
    """A command or node was asked for what cannot be; the text says what and why."""


class CommandError(Exception):
    """A command could not do what it was asked for; the text says why, and what to do."""


class Parser(argparse.ArgumentParser):
    """A parser that takes negative numbers of any form, and tells an error in one line."""

    def __init__(self, prog: str, description: str, epilog: str = '', **kwargs: Any) -> None:
        """
        Make a parser.

        :param epilog: what the help ends with: an example.
        """
        super().__init__(prog=prog, description=description, epilog=epilog, allow_abbrev=False,
                         formatter_class=argparse.RawDescriptionHelpFormatter, **kwargs)
        # That of argparse takes an exponent or 'nan' for an option.
        self._negative_number_matcher = re.compile(r'-(\d|\.\d|inf|nan)', re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """End the program with exit code 2, the message and the usage."""
        for given in message.removeprefix('unrecognized arguments: ').split():
            name = given.split('=')[0]
            near = [*(option for option in self._option_string_actions if option.startswith(name)),
                    *get_close_matches(name, self._option_string_actions, cutoff=0.75)]
            if near and name.startswith('--') and message.startswith('unrecognized'):
                message = f'{message} (did you mean {near[0]}?)'
        usage = ' '.join(self.format_usage().split())
        self.exit(2, f'{self.prog}: {visible(message)}; {usage}\n')


def number(text: str) -> float:
    """
    Read a number of an argument.

    :raises argparse.ArgumentTypeError: when it is none, or not finite.
    """
    try:
        value = float(text.replace('_', '?'))  # Python would take 1_0 for 10
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is no number') from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not finite')
    return value


def run(parser: argparse.ArgumentParser, command: Callable[..., int],
        args: Optional[Sequence[str]] = None) -> int:
    """
    Parse the arguments, and do what a command does; Ctrl-C and SIGTERM are normal ends.

    :param command: is called with what was parsed, and with `ros_args`, all arguments; may raise
        a UsageError or a CommandError.
    :param args: the command line without the command; None: that of the process.
    :returns: the exit code: 0, or after a line on stderr 1 where the command could not do it, 2
        where it was used wrongly.
    """
    arguments = [parser.prog, *(sys.argv[1:] if args is None else args)]
    handlers = record_signals()
    try:
        options = parser.parse_args(_without_ros_args(arguments)[1:])
        _make_writable()
        return command(ros_args=arguments, **vars(options))
    except KeyboardInterrupt:
        return 0
    except BrokenPipeError:  # who reads the output has had enough
        _close_stdout()
        return 0
    except (UsageError, CommandError) as error:
        print(f'{parser.prog}: {visible(str(error))}', file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except OSError as error:
        _close_stdout()
        print(f'{parser.prog}: {visible(str(error))}', file=sys.stderr)
        return 1
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _make_writable() -> None:
    """Have output appear line by line, what cannot be encoded, too; have it somewhere at all."""
    for name in 'stdout', 'stderr':
        if getattr(sys, name) is None:  # closed by who started this
            setattr(sys, name, open(os.devnull, 'w'))  # noqa: SIM115
        getattr(sys, name).reconfigure(line_buffering=True, errors='backslashreplace')


def _close_stdout() -> None:
    """Have what could not be written forgotten, so that it is not tried again at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _without_ros_args(arguments: list[str]) -> list[str]:
    try:
        from rclpy.utilities import remove_ros_args
    except ImportError:
        return _without_ros_args_by_hand(arguments)
    try:
        return list(remove_ros_args(arguments))
    except UnicodeEncodeError as error:
        raise UsageError(f'the argument {error.object!r} must be valid Unicode') from None
    except RuntimeError as error:  # a list of what is unknown, or a text of rcl
        words = rcl_error_text(error)
        raise UsageError(f'unknown ROS arguments: {words}' if words.startswith('[') else words
                         ) from None


def _without_ros_args_by_hand(arguments: list[str]) -> list[str]:
    """Leave out what is from each --ros-args to the next --, or to the end."""
    rest, is_for_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            is_for_ros = True
        elif not is_for_ros:
            rest.append(argument)
        elif argument == '--':
            is_for_ros = False
    return rest


def rcl_error_text(error: Exception) -> str:
    """Give the first line of an error of rcl, without the places in its source."""
    return re.sub(r', at \S+:\d+.*', '', str(error).splitlines()[0])
