"""
The entry points of the commands.

Importing this module is fast. Each entry point first sets the handlers of Ctrl-C and SIGTERM, and
then imports the module of its command. This import can be slow.
"""

from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
import sys

from dummy_arm.cli.signals import (
    ignore_signals,
    record_signals,
    signal_received,
    signals_blocked,
)

_ROS = 'rclpy', 'builtin_interfaces', 'geometry_msgs', 'rcl_interfaces', 'std_msgs'


def check_arm() -> int:
    """Run `dummy_arm.tools.check_arm` and return its exit code."""
    # Threads that libraries start keep signals blocked, so that only the main thread takes them:
    # it needs to know who has sent them.
    return _run('dummy_arm.tools.check_arm', interrupted=1, context=signals_blocked())


def dummy_arm() -> int:
    """Run `dummy_arm.dummy_arm` and return its exit code."""
    return _run('dummy_arm.dummy_arm')


def dynamic_tf_publisher() -> int:
    """Run `dummy_arm.tools.dynamic_tf_publisher` and return its exit code."""
    return _run('dummy_arm.tools.dynamic_tf_publisher')


def param() -> int:
    """Run `dummy_arm.tools.param` and return its exit code."""
    return _run('dummy_arm.tools.param')


def static_transform_publisher() -> int:
    """Run `dummy_arm.tools.static_transform_publisher` and return its exit code."""
    return _run('dummy_arm.tools.static_transform_publisher')


def tf2_echo() -> int:
    """Run `dummy_arm.tools.tf2_echo` and return its exit code."""
    return _run('dummy_arm.tools.tf2_echo')


def tf2_monitor() -> int:
    """Run `dummy_arm.tools.tf2_monitor` and return its exit code."""
    return _run('dummy_arm.tools.tf2_monitor')


def tf_doctor() -> int:
    """Run `dummy_arm.tools.tf_doctor` and return its exit code."""
    return _run('dummy_arm.tools.tf_doctor')


def tf_trajectory() -> int:
    """Run `dummy_arm.tools.tf_trajectory` and return its exit code."""
    return _run('dummy_arm.tools.tf_trajectory')


def view_frames() -> int:
    """Run `dummy_arm.tools.view_frames` and return its exit code."""
    return _run('dummy_arm.tools.view_frames')


def web_view() -> int:
    """Run `dummy_arm.tools.web_view` and return its exit code."""
    return _run('dummy_arm.tools.web_view')


def _run(module: str, interrupted: int = 0,
         context: AbstractContextManager[None] = nullcontext()) -> int:  # noqa: B008
    """
    Import a module, run its `main`, and return the exit code.

    :param interrupted: the exit code if a signal ends the import.
    :param context: the context of the import.
    """
    # Without this call, Ctrl-C would raise KeyboardInterrupt in the middle of an import, and the
    # import might turn it into another exception.
    record_signals()
    try:
        with context:
            main = import_module(module).main
        return interrupted if signal_received() else int(main())
    except KeyboardInterrupt:
        return interrupted
    except ModuleNotFoundError as error:
        if error.name not in _ROS:
            raise
        print(f'{module.rpartition(".")[2]}: this command needs ROS, but {error.name} cannot be '
              "imported: pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces, or "
              'source the setup file of a ROS installation. check_arm, tf2_echo, tf_doctor, '
              'tf_trajectory, view_frames and web_view can read a bag without ROS: --bag FILE',
              file=sys.stderr)
        return 1
    finally:
        ignore_signals()
