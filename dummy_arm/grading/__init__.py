"""Judge the arm of the lab's final task: requirements, running hand-ins, drawings."""

from collections.abc import Callable, Generator, Sequence
import sys

from dummy_arm.grading.records import Grade
from puretf._text.distribution import require_ros
from puretf_tools.cli.parser import CommandError

__all__ = ['grade']


def grade(files: Sequence[str], seconds: float = 25.0, jobs: int = 1,
          on_wait: Callable[[int, str], object] = lambda done, what: None
          ) -> Generator[Grade, None, None]:
    """
    Run each program in a ROS domain of its own, and judge the arm that it publishes.

    Each program runs under a process of its own, which ends all that the program starts. The
    iteration must be in the main thread, and nothing else may start processes meanwhile.

    :param files: the paths of the programs, or of the folders in which they lie.
    :param seconds: how long to observe each arm (s).
    :param jobs: how many programs run at the same time: at most 17, since each has a ROS domain.
    :param on_wait: called every 0.05 s with the number of hand-ins that are graded, and with what
        is waited for.
    :returns: an iterator of the grades, in the order in which the programs end; closing it ends
        the programs. It raises KeyboardInterrupt at Ctrl-C, and at a SIGTERM that no program has
        sent.
    :raises CommandError: if this is not Linux, or psutil is missing.
    :raises ModuleNotFoundError: if ROS is missing.
    """
    if sys.platform != 'linux':
        raise CommandError('programs can be run on Linux only; record a bag, and use --bag')
    require_ros(['rclpy', 'geometry_msgs'])
    try:
        import psutil  # noqa: F401
    except ImportError:
        raise CommandError('psutil is missing: pip install psutil, or apt install python3-psutil'
                           ) from None
    from dummy_arm.grading.hand_ins import graded
    return graded(files, seconds, jobs, on_wait)
