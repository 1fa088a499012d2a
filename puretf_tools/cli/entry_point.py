"""Makes the entry point of a command."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
import sys

from puretf_tools.cli.signals import begin_exit, record_signals, signal_received

_ROS = ('rclpy', 'builtin_interfaces', 'geometry_msgs', 'rcl_interfaces', 'sensor_msgs',
        'std_msgs')


def entry_point(module: str, interrupted: int = 0,
                context: Callable[[], AbstractContextManager[None]] = nullcontext
                ) -> Callable[[], int]:
    """
    Return a function that imports a module and runs its `main`.

    It sets the handlers of Ctrl-C and SIGTERM before the import, which can be slow.

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
        except ImportError as error:
            if error.name == 'tf2_msgs':  # its message cannot be made at run time
                print(f'{module.rpartition(".")[2]}: {error}', file=sys.stderr)
                return 1
            if error.name not in _ROS:
                raise
            from puretf._text.distribution import how_to_install_ros
            print(f'{module.rpartition(".")[2]}: this command needs ROS, but {error.name} cannot '
                  f'be imported: {how_to_install_ros()}. '
                  'check_arm, tf2_echo, tf_doctor, tf_trajectory, view_frames and web_view can '
                  'read a bag without ROS: --bag FILE', file=sys.stderr)
            return 1
        finally:
            begin_exit()

    return run
