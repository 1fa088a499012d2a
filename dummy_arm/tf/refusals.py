"""Why tf2 refuses a transform, in the words of its log, said at most once a second a cause."""

from collections import deque
from collections.abc import Callable
import logging
from math import inf, isnan
import time

from dummy_arm.tf.history import Pose
from dummy_arm.tf.times import display


def problems(parent: str, child: str, pose: Pose, authority: str) -> list[str]:
    """
    List all that is wrong with a transform.

    :param pose: with the rotation normalised, NaN where that cannot be.
    """
    if parent != child and parent and child and not any(map(isnan, pose)):
        return []
    found = []
    numbers = '({:f} {:f} {:f}) ({:f} {:f} {:f} {:f})'.format(*pose)
    if parent == child:
        found.append(f'TF_SELF_TRANSFORM: Ignoring transform from authority "{authority}" with '
                     f'frame_id and  child_frame_id "{child}" because they are the same')
    if not child:
        found.append(f'TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "{authority}" '
                     'because child_frame_id not set ')
    if not parent:
        found.append(f'TF_NO_FRAME_ID: Ignoring transform with child_frame_id "{child}"  from '
                     f'authority "{authority}" because frame_id not set')
    if any(map(isnan, pose)):
        found.append(f'TF_NAN_INPUT: Ignoring transform for child_frame_id "{child}" from '
                     f'authority "{authority}" because of a nan value in the transform {numbers}')
    if any(map(isnan, pose[3:])):
        found.append('TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id '
                     f'"{child}" from authority "{authority}" because of an invalid quaternion '
                     f'in the transform {numbers.partition(") ")[2]}')
    return found


def too_old(child: str, stamp: int, authority: str) -> str:
    """Tell that a transform is older than the cache time allows."""
    return (f'TF_OLD_DATA ignoring data from the past for frame {child} at time {display(stamp)} '
            f'according to authority {authority}\nPossible reasons are listed at '
            'http://wiki.ros.org/tf/Errors%20explained')


def too_many_frames(child: str, limit: int, authority: str) -> str:
    """Tell that a frame is new and there may be no more."""
    return (f'TF_TOO_MANY_FRAMES: Ignoring transform for child_frame_id "{child}" from authority '
            f'"{authority}", and every other with a new frame: {limit} frames are known, and no '
            'more are allowed (max_frames of the buffer). Does something send ever new names?')


class Refusals:
    """
    A log that says the same cause at most once a second.

    What is told is logged by `log_all`, for which no lock must be held: a log may look up.
    """

    def __init__(self) -> None:
        """Begin with nothing said."""
        self.log: Callable[[str], None] = logging.getLogger('dummy_arm.tf').warning
        self._again: dict[str, float] = {}
        self._told: deque[str] = deque()

    def tell(self, *problems: str) -> None:
        """Tell problems, but not one whose cause, its first word, was told within a second."""
        for problem in problems:
            self._tell(problem.partition(' ')[0], problem, 1.0)

    def tell_once(self, cause: str, problem: str) -> None:
        """Tell a problem, but not if its cause was told before."""
        self._tell(cause, problem, inf)

    def _tell(self, cause: str, problem: str, silence: float) -> None:
        now = time.monotonic()
        if now >= self._again.get(cause, now):
            self._again[cause] = now + silence
            self._told.append(problem)

    def log_all(self) -> None:
        """Log what was told."""
        while self._told:
            self.log(self._told.popleft())
