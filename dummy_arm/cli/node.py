"""Commands that are a node, or have one: from its start to its end."""

from _thread import interrupt_main
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Event, Thread

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from dummy_arm.cli.fast_dds import destroy
from dummy_arm.cli.parser import CommandError, rcl_error_text, UsageError
from dummy_arm.cli.signals import signal_received

_LONGEST_WAIT = 0.2  # s; a signal does not end a wait in the middleware


def run_node(make_node: Callable[[], Node], ros_args: Sequence[str]) -> int:
    """
    Run a node until it is told to stop: by Ctrl-C, by SIGTERM or by a shutdown of the context.

    :param make_node: makes the node; may raise a UsageError.
    :param ros_args: the command line with the command.
    :returns: the exit code: 0.
    :raises UsageError: on ROS arguments that the node does not take.
    """
    with ros(ros_args), suppress(ExternalShutdownException):
        _spin_until_signal(make_node())
    return 0


@contextmanager
def ros(ros_args: Sequence[str]) -> Iterator[None]:
    """
    Have ROS from here to the end of the block.

    :param ros_args: the command line with the command.
    :raises UsageError: on ROS arguments that a node in the block does not take.
    :raises CommandError: when ROS does not start.
    """
    try:
        # Not rclpy's handlers: they shut the context down while a node may be at work in it.
        rclpy.init(args=list(ros_args), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # by rcl, as of the environment
        raise CommandError(rcl_error_text(error)) from None
    try:
        yield
    except ParameterException as error:
        raise UsageError(rcl_error_text(error)) from None
    finally:
        try_shutdown()


@contextmanager
def spinning_node(name: str, ros_args: Sequence[str]) -> Iterator[Node]:
    """
    Have ROS and a node, which is spun in a thread, from here to the end of the block.

    :raises CommandError: when the thread ends within the block, which is interrupted then.
    """
    with ros(ros_args):
        node, ends = rclpy.create_node(name), Event()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        errors: list[BaseException] = []

        def spin() -> None:
            try:
                while not ends.is_set():
                    executor.spin_once(timeout_sec=_LONGEST_WAIT)
            except BaseException as error:
                if not ends.is_set():
                    errors.append(error)
                    interrupt_main()  # else the command would go on with data that are old

        thread = Thread(target=spin, name=f'spin of {name}')
        thread.start()
        try:
            yield node
        except KeyboardInterrupt:
            if not errors:
                raise
        finally:
            ends.set()
            executor.wake()
            thread.join()
            executor.shutdown()
            destroy(node)
        if errors:
            raise CommandError(f'the node stopped, because its executor raised '
                               f'{type(errors[0]).__name__}: {errors[0]}') from errors[0]


def _spin_until_signal(node: Node) -> None:
    executor = SingleThreadedExecutor()
    try:
        executor.add_node(node)
        while not signal_received():
            executor.spin_once(timeout_sec=_LONGEST_WAIT)
    finally:
        executor.shutdown()  # before the context: it would complain, when it is collected
        destroy(node)
