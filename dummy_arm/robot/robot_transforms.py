"""The transforms of a robot from the positions of its joints; needs no ROS."""

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Optional

from dummy_arm.robot.description import Description, Joint, Pose
from dummy_arm.tf.formatting import comma_list, in_log, quoted

#: A transform without its stamp: frame_id, child_frame_id, pose.
Edge = tuple[str, str, Pose]

#: The largest number of joint names whose stamps are remembered.
_MAX_NAMES = 10_000
#: The longest interval (ms) between two messages, about 300 years.
_LONGEST_INTERVAL = 1e13


class RobotTransforms:
    """
    The rules by which robot_state_publisher 3.3.3 answers to JointState messages.

    The attributes and the description can be changed at any time.
    """

    def __init__(self, description: Description, warn: Callable[[str], object]) -> None:
        """Take the robot, and a function that logs a warning."""
        self.publish_frequency = 20.0
        self.frame_prefix = ''
        self.ignore_timestamp = False
        self._warn = warn
        self._warned: set[str] = set()
        self._now = 0
        self._last: dict[str, int] = {}
        self.set_description(description)

    def set_description(self, description: Description) -> None:
        self._joints = {joint.name: joint for joint in sorted(
            description.joints, key=lambda joint: joint.name)}
        self._never_sent = {joint.name for joint in description.joints if joint.is_movable}

    def fixed(self) -> list[Edge]:
        """Return the transforms of fixed joints, and of planar ones at their origin."""
        return [self._edge(joint, joint.pose) for joint in self._joints.values()
                if joint.kind in ('fixed', 'planar')]

    def moving(self, stamp: int, names: Sequence[str], positions: Sequence[float], now: int
               ) -> Optional[list[Edge]]:
        """
        Return the transforms that answer to a JointState; None if it is ignored.

        :param stamp: the stamp of the message (ns).
        :param now: the time of the node (ns).
        """
        if len(names) != len(positions):
            self._warn_of_lengths(names, positions)
            return None
        if stamp < 0:
            self._warn_once('ignored a JointState message with a negative stamp')
            return None
        if now < self._now:
            self._warn('Moved backwards in time, re-publishing joint transforms!')
            self._last.clear()
        self._now = now
        last = min([now, *(self._last.get(name, 0) for name in names)])
        if not self.ignore_timestamp and stamp < last + self._interval():
            if stamp == 0:
                self._warn_once('ignored a JointState message with the stamp 0: set its '
                                'header.stamp, or the parameter ignore_timestamp')
            return None
        if len(self._last) > _MAX_NAMES:
            self._last.clear()
        self._last.update(dict.fromkeys(names, stamp))
        # If a name occurs twice, the first position counts.
        return self._edges(dict(zip(reversed(names), reversed(positions))))

    def missing(self) -> str:
        """Return a warning that names the joints without a position so far; '' if all had one."""
        if not self._never_sent:
            return ''
        if not self._last:
            return 'no JointState message has been accepted yet, so no joint moves' + (
                '' if self._warned else ': start a program that publishes on joint_states')
        unknown = sorted(self._last.keys() - self._joints.keys())
        return ('no position has arrived for ' + comma_list(
            sorted(self._never_sent), 10, quoted) + ', so these joints have no transform' + (
                f'; the robot does not have {comma_list(unknown, 10, quoted)}' if unknown else ''))

    def _interval(self) -> int:
        """Return the shortest time between two messages (ns); it is a multiple of 1 ms."""
        if self.publish_frequency == 0.0:
            return 0
        return int(min(1000.0 / self.publish_frequency, _LONGEST_INTERVAL)) * 1_000_000

    def _edges(self, positions: dict[str, float]) -> list[Edge]:
        for joint in self._joints.values():
            if joint.mimic and joint.mimic.joint in positions:
                positions.setdefault(joint.name, positions[joint.mimic.joint]
                                     * joint.mimic.multiplier + joint.mimic.offset)
        edges = []
        for name, joint in self._joints.items():
            if name in positions and joint.is_movable:
                if isfinite(positions[name]):
                    self._never_sent.discard(name)
                    edges.append(self._edge(joint, joint.pose_at(positions[name])))
                else:
                    self._warn_once('ignored positions that are not finite, such as '
                                    f'{positions[name]} of joint', f' {in_log(name)}')
        return edges

    def _edge(self, joint: Joint, pose: Pose) -> Edge:
        return self.frame_prefix + joint.parent, self.frame_prefix + joint.child, pose

    def _warn_of_lengths(self, names: Sequence[str], positions: Sequence[float]) -> None:
        if positions:
            self._warn_once('Robot state publisher ignored an invalid JointState message',
                            f': it has {len(names)} names and {len(positions)} positions')
        else:
            self._warn_once('Robot state publisher ignored a JointState message about joint(s) ',
                            f'"{in_log(names[0])}"(,...) whose position member was empty.')

    def _warn_once(self, cause: str, details: str = '') -> None:
        if cause not in self._warned:
            self._warned.add(cause)
            self._warn(cause + details)
