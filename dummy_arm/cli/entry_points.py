"""
The entry points of the commands.

This module imports fast, so that the handlers of Ctrl-C and SIGTERM are set before the module of a
command is imported, which can be slow. A new command needs a line here; "To add a command" in
CONTRIBUTING.md lists the other steps.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
import sys

from dummy_arm.cli.signals import (
    begin_exit,
    record_signals,
    signal_received,
    signals_blocked,
)

_ROS = ('rclpy', 'builtin_interfaces', 'geometry_msgs', 'rcl_interfaces', 'sensor_msgs',
        'std_msgs')


def _command(module: str, interrupted: int = 0,
             context: Callable[[], AbstractContextManager[None]] = nullcontext
             ) -> Callable[[], int]:
    """
    Return a function that imports a module and runs its `main`.

    :param interrupted: the exit code if a signal ends the import.
    :param context: the context of the import.
    """
    def run() -> int:
        # Otherwise Ctrl-C would raise KeyboardInterrupt in the middle of an import, and the import
        # might turn it into another exception.
        record_signals()
        try:
            with context():
                main = import_module(module).main
            # With --bag, `main` prints that it was ended early.
            is_ended = signal_received() and '--bag' not in str(sys.argv)
            return interrupted if is_ended else int(main())
        except KeyboardInterrupt:
            return interrupted
        except ModuleNotFoundError as error:
            if error.name not in _ROS:
                raise
            print(f'{module.rpartition(".")[2]}: this command needs ROS, but {error.name} cannot '
                  "be imported: pip install 'ros-jazzy-rclpy[fastrtps]' "
                  'ros-jazzy-common-interfaces, or source the setup file of a ROS installation. '
                  'check_arm, tf2_echo, tf_doctor, tf_trajectory, view_frames and web_view can '
                  'read a bag without ROS: --bag FILE', file=sys.stderr)
            return 1
        finally:
            begin_exit()

    return run


# Threads that libraries of check_arm start keep signals blocked, so that only the main thread
# takes them: it needs to know who has sent them.
check_arm = _command('dummy_arm.tools.check_arm', interrupted=1, context=signals_blocked)
dummy_arm = _command('dummy_arm.dummy_arm')
dynamic_tf_publisher = _command('dummy_arm.tools.dynamic_tf_publisher')
joint_state_publisher = _command('dummy_arm.tools.joint_state_publisher')
param = _command('dummy_arm.tools.param')
robot_state_publisher = _command('dummy_arm.tools.robot_state_publisher')
static_transform_publisher = _command('dummy_arm.tools.static_transform_publisher')
tf2_echo = _command('dummy_arm.tools.tf2_echo')
tf2_monitor = _command('dummy_arm.tools.tf2_monitor')
tf_doctor = _command('dummy_arm.tools.tf_doctor')
tf_trajectory = _command('dummy_arm.tools.tf_trajectory')
view_frames = _command('dummy_arm.tools.view_frames')
web_view = _command('dummy_arm.tools.web_view')
