"""
The entry points of the commands.

This module imports little. Therefore, the handlers of Ctrl-C and SIGTERM are set before the slow
imports of a command begin.
"""

from importlib import import_module
import sys

from dummy_arm.cli.signals import ignore_signals, record_signals, signal_received

_ROS = 'rclpy', 'builtin_interfaces', 'geometry_msgs', 'rcl_interfaces', 'std_msgs'


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


def view_frames() -> int:
    """Run `dummy_arm.tools.view_frames` and return its exit code."""
    return _run('dummy_arm.tools.view_frames')


def web_view() -> int:
    """Run `dummy_arm.tools.web_view` and return its exit code."""
    return _run('dummy_arm.tools.web_view')


def _run(module: str) -> int:
    """Import a module, run its `main` and return the exit code; it is 0 after a signal."""
    # Without this call, a KeyboardInterrupt during an import might be reported as another error.
    record_signals()
    try:
        main = import_module(module).main
        return 0 if signal_received() else int(main())
    except KeyboardInterrupt:
        return 0
    except ModuleNotFoundError as error:
        if error.name not in _ROS:
            raise
        print(f'{module.rpartition(".")[2]}: this command needs ROS, but {error.name} cannot be '
              "imported: pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces, or "
              'source the setup file of a ROS installation. view_frames, tf2_echo and web_view '
              'can read a bag without ROS: --bag FILE', file=sys.stderr)
        return 1
    finally:
        ignore_signals()
