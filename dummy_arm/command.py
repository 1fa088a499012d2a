"""What the commands share: arguments, spinning, and how they end."""

import argparse
from collections.abc import Callable, Sequence
import signal
import sys
from typing import Optional

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

_LONGEST_WAIT = 0.2  # s; a signal does not end a wait in the middleware


class UsageError(ValueError):
    """A command or node was asked for what cannot be; the text says what and why."""


def run_node(parser: argparse.ArgumentParser, make_node: Callable[[], Node],
             args: Optional[Sequence[str]] = None) -> int:
    """
    Run a node until it is told to stop: by Ctrl-C, by SIGTERM or by a shutdown of the context.

    :param parser: for what is no ROS argument.
    :param make_node: makes the node; may raise a UsageError.
    :param args: the command line without the command; None: that of the process.
    :returns: the exit code: 0, or 2 after a line on stderr that says what was used wrongly.
    """
    arguments = [parser.prog, *(sys.argv[1:] if args is None else args)]
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        parser.parse_args(remove_ros_args(arguments)[1:])
        # Not rclpy's handlers: they shut the context down while the node may be at work in it.
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        _spin_until_signal(make_node())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except _rclpy.UnknownROSArgsError as error:
        print(f'{parser.prog}: unknown ROS arguments: {error}', file=sys.stderr)
        return 2
    except (UsageError, ParameterException, _rclpy.RCLInvalidROSArgsError) as error:
        print(f'{parser.prog}: {str(error).splitlines()[0]}', file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return 0


def _spin_until_signal(node: Node) -> None:
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.append(number))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not signals:
        executor.spin_once(timeout_sec=_LONGEST_WAIT)
    executor.shutdown()  # before the context: it would complain, when it is collected
    node.destroy_node()
