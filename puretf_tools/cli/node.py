"""Start, spin and destroy the node of a command."""

from _thread import interrupt_main
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import re
import sys
from threading import Event, Thread

import rclpy
from rclpy.exceptions import InvalidNamespaceException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier, remove_ros_args, try_shutdown
from rclpy.validate_namespace import validate_namespace

from puretf._text.names import namespace_path
from puretf_tools.cli.fast_dds import destroy, remove_unfinished_ports
from puretf_tools.cli.parser import CommandError, UsageError
from puretf_tools.cli.signals import begin_cleanup, end_cleanup, sleep

#: The timeout of `spin_once` (s), which a recorded signal does not end.
_LONGEST_WAIT = 0.2


def run_node(make_node: Callable[[], Node], ros_args: Sequence[str], namespace: str = '') -> int:
    """
    Run a node until a signal or a shutdown of the context; return the exit code.

    :param ros_args: the command line, with the name of the command.
    :param namespace: the namespace of the node and of the topics /tf and /tf_static; '': none.
    :raises UsageError: if the arguments are wrong; what else fails is a CommandError.
    """
    with spinning_node(make_node, ros_args, namespace) as node:
        while node.context.ok():
            sleep(_LONGEST_WAIT)
    return 0


@contextmanager
def ros_context(ros_args: Sequence[str], namespace: str = '') -> Iterator[None]:
    """Initialise ROS for a `with` block, then shut it down; raise the errors of `run_node`."""
    # The first rule that fits a name is used, so the user's own rules come first.
    arguments = [*ros_args, *_namespace_args(namespace)]
    for line in remove_unfinished_ports():  # with these files, ROS would hang
        print(f'{ros_args[0]}: warning: {line}', file=sys.stderr)
    try:
        _check(arguments)
        # The signal handlers of rclpy would shut down the context while a node is using it.
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except UnicodeEncodeError as error:
        raise UsageError(f'the argument {error.object!r} must be valid Unicode') from None
    except RuntimeError as error:  # rcl failed, for example because ROS_DOMAIN_ID is invalid
        raise CommandError(rcl_error_text(error)) from None
    try:
        yield
    finally:
        try_shutdown()
        end_cleanup()


def _check(ros_args: list[str]) -> None:
    try:
        remove_ros_args(ros_args)
    except RuntimeError as error:  # its text is a list of unknown arguments, or an error of rcl
        text = rcl_error_text(error)
        raise UsageError(f'unknown ROS arguments: {text}' if text.startswith('[') else text
                         ) from None


def rcl_error_text(error: Exception) -> str:
    """Return the first line of an rcl error, without locations in rcl's source code."""
    return re.sub(r', at \S+:\d+.*', '', str(error).partition('\n')[0])


@contextmanager
def spinning_node(node_or_name: Callable[[], Node] | str, ros_args: Sequence[str],
                  namespace: str = '') -> Iterator[Node]:
    """
    Initialise ROS and spin a node in a thread until the end of the `with` block.

    An error of the executor interrupts the block like Ctrl-C, and then becomes a CommandError.
    """
    make_node = node_or_name if callable(node_or_name) else (
        lambda: rclpy.create_node(node_or_name))
    with ros_context(ros_args, namespace):
        node, stop_requested = create(make_node), Event()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        errors: list[BaseException] = []

        def spin() -> None:
            try:
                while not stop_requested.is_set():
                    executor.spin_once(timeout_sec=_LONGEST_WAIT)
            except BaseException as error:
                # If a callback has shut down the context, rcl fails.
                if not stop_requested.is_set() and node.context.ok():
                    errors.append(error)
                    interrupt_main()  # without this, the command would go on with old data

        thread = Thread(target=spin, name=f'spin of {node.get_name()}')
        thread.start()
        try:
            yield node
        except KeyboardInterrupt:
            if not errors:
                raise
        finally:
            begin_cleanup()
            stop_requested.set()
            executor.wake()
            thread.join()
            executor.shutdown()
            destroy(node)
        if errors:
            raise CommandError(f'the node stopped, because its executor raised '
                               f'{type(errors[0]).__name__}: {errors[0]}') from errors[0]


def create(make_node: Callable[[], Node]) -> Node:
    """Create a node; an error of rcl becomes a CommandError, one of parameters a UsageError."""
    try:
        return make_node()
    except ParameterException as error:
        # The text may begin with '... Reason: ', and ends with the name.
        text, _, _ = rcl_error_text(error).rpartition(': ')
        raise UsageError(text.rpartition('Reason: ')[2]) from None
    except RuntimeError as error:  # rcl failed, for example because the middleware did
        raise CommandError(f'cannot create the node: {rcl_error_text(error)}. Lines above may be '
                           f'from {get_rmw_implementation_identifier()}, and say why') from None


def _namespace_args(namespace: str) -> list[str]:
    """Return ROS arguments that put nodes, /tf and /tf_static into a namespace; '': none."""
    path = namespace_path(namespace)
    if not path:
        return []
    try:
        validate_namespace(path)
    except (InvalidNamespaceException, TypeError) as error:  # TypeError: it is not valid Unicode
        reason = str(error).splitlines()[0].removesuffix(':')
        raise UsageError(f'{reason}, got {namespace!r}') from None
    return ['--ros-args', '-r', f'__ns:={path}', '-r', f'/tf:={path}/tf',
            '-r', f'/tf_static:={path}/tf_static']
