"""Why tf2 refuses a transform, in the words of its log, said at most once a second a cause."""

from collections import deque
from collections.abc import Callable
import logging
from math import inf, isnan
import time

from dummy_arm.tf.pose import Pose
from dummy_arm.tf.texts import logged
from dummy_arm.tf.times import display

#: The longest name (bytes of UTF-8) that a frame may have.
LONGEST_NAME = 1024


def problems(parent: str, child: str, pose: Pose, authority: str) -> list[str]:
    """
    List all that is wrong with a transform.

    :param pose: with the rotation normalised, NaN where that cannot be.
    """
    if parent != child and parent and child and not any(map(isnan, pose)):
        return []
    found = []
    is_own_parent = parent == child
    child, authority = logged(child), logged(authority)
    numbers = '({:f} {:f} {:f}) ({:f} {:f} {:f} {:f})'.format(*pose)
    if is_own_parent:
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
    return (f'TF_OLD_DATA ignoring data from the past for frame {logged(child)} at time '
            f'{display(stamp)} according to authority {logged(authority)}\n'
            'Possible reasons are listed at http://wiki.ros.org/tf/Errors%20explained')


def too_many_frames(child: str, limit: int, authority: str) -> str:
    """Tell that a frame is new and there may be no more."""
    return (f'TF_TOO_MANY_FRAMES: Ignoring transform for child_frame_id "{logged(child)}" from '
            f'authority "{logged(authority)}", and every other with a new frame: {limit} frames '
            'are known, and no more are allowed (max_frames of the buffer). Does something send '
            'ever new names?')


def too_long_name(parent: str, child: str, authority: str) -> str:
    """Return the warning for a transform one of whose names is too long."""
    what, name = ('child_frame_id', child) if is_too_long(child) else ('frame_id', parent)
    return (f'TF_LONG_FRAME_ID: Ignoring transform for child_frame_id "{logged(child)}" from '
            f'authority "{logged(authority)}" because its {what} has {_size(name)} bytes: no '
            f'more than {LONGEST_NAME} are allowed')


def is_too_long(name: str) -> bool:
    """Return whether a name is longer than a frame's may be."""
    return len(name) * 4 > LONGEST_NAME and _size(name) > LONGEST_NAME


def _size(name: str) -> int:
    return len(name.encode('utf-8', 'surrogatepass'))


def too_many_samples_of_a_frame(child: str, limit: int, authority: str) -> str:
    """Return the warning for a frame of which more transforms come than are kept."""
    return (f'TF_TOO_MANY_SAMPLES: Dropping the oldest transforms of child_frame_id '
            f'"{logged(child)}" from authority "{logged(authority)}", and of every other such '
            f'frame, before the cache time is over: of a frame, {limit} are kept, which is 10000 '
            'per second of cache time. Do its stamps hardly advance?')


def too_many_samples(child: str, limit: int, authority: str) -> str:
    """Return the warning for a buffer into which more transforms come than are kept."""
    return (f'TF_FULL_BUFFER: Dropping the oldest transforms of child_frame_id "{logged(child)}" '
            f'from authority "{logged(authority)}", and of every other frame that gets new ones, '
            f'before the cache time is over: the buffer has {limit}, and no more are kept '
            '(max_samples of the buffer). Is its cache time too long?')


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
