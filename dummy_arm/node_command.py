"""Commands that are a node: from its start to its end."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import signal

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from dummy_arm.command import UsageError

_LONGEST_WAIT = 0.2  # s; a signal does not end a wait in the middleware


def run_node(make_node: Callable[[], Node], ros_args: Sequence[str]) -> int:
    """
    Run a node until it is told to stop: by Ctrl-C, by SIGTERM or by a shutdown of the context.

    :param make_node: makes the node; may raise a UsageError.
    :param ros_args: the command line with the command.
    :returns: the exit code: 0.
    :raises UsageError: on ROS arguments that the node does not take.
    """
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with ros(ros_args):
            _spin_until_signal(make_node())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return 0


@contextmanager
def ros(ros_args: Sequence[str]) -> Iterator[None]:
    """
    Have ROS from here to the end of the block.

    :param ros_args: the command line with the command.
    :raises UsageError: on ROS arguments that a node in the block does not take.
    """
    try:
        # Not rclpy's handlers: they shut the context down while a node may be at work in it.
        rclpy.init(args=list(ros_args), signal_handler_options=SignalHandlerOptions.NO)
        yield
    except (ParameterException, _rclpy.RCLInvalidROSArgsError) as error:
        raise UsageError(str(error).splitlines()[0]) from None
    finally:
        rclpy.try_shutdown()


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
