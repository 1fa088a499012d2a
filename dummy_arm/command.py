"""What the commands share: arguments, spinning, and how they end."""

import argparse
from collections.abc import Callable, Sequence
import signal
import sys
from typing import Optional

import rclpy
from rclpy.exceptions import ROSInterruptException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args


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
    try:
        parser.parse_args(remove_ros_args(arguments)[1:])
        rclpy.init(args=arguments)
        rclpy.spin(make_node())
    except (KeyboardInterrupt, ExternalShutdownException, ROSInterruptException):
        pass
    except _rclpy.UnknownROSArgsError as error:
        print(f'{parser.prog}: unknown ROS arguments: {error}', file=sys.stderr)
        return 2
    except (UsageError, _rclpy.RCLInvalidROSArgsError) as error:
        print(f'{parser.prog}: {str(error).splitlines()[0]}', file=sys.stderr)
        return 2
    except Exception:
        if rclpy.ok():
            raise
        # The context was shut down while the node was at work: a normal end as well.
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C is no error either
        rclpy.try_shutdown()
    return 0
