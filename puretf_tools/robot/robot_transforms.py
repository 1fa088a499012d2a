"""The transforms of a robot from the positions of its joints; needs no ROS."""

from collections.abc import Callable, Sequence
from math import inf, isfinite
from time import monotonic
from typing import Optional

from puretf import SECOND
from puretf._text.names import comma_list, quoted, shortened
from puretf._text.times import display_time
from puretf_tools.robot.description import Description, Joint
from puretf_tools.robot.shapes import Pose

#: A transform without its stamp: frame_id, child_frame_id, pose.
LinkTransform = tuple[str, str, Pose]

#: The largest number of joint names whose stamps are remembered.
_MAX_NAMES = 10_000
#: The longest interval (ms) between two messages, about 300 years.
_LONGEST_INTERVAL = 1e13
#: A stamp is not in time if it is later than the time of the node by more than this (ns).
_AHEAD = SECOND
#: How long (s) such states are ignored if those before were in time.
_DOUBT = 0.5
#: The warnings that can come again after the clock ran back.
_OF_CLOCKS = _IGNORED, _ANSWERED = [
    f'{what} a JointState message that is ahead of the clock of this node'
    for what in ('ignored', 'answered')]


class RobotTransforms:
    """
    The rules by which robot_state_publisher 3.3.3 answers to JointState messages.

    The attributes and the description can be changed at any time.
    """

    def __init__(self, description: Description, warn: Callable[[str], object],
                 publishers: Callable[[], str] = lambda: '') -> None:
        """
        Take the robot.

        :param publishers: returns who publishes the JointState messages, as the end of a warning.
        """
        self.publish_frequency = 20.0
        self.frame_prefix = ''
        self.ignore_timestamp = False
        self._warn, self._publishers = warn, publishers
        self._warned: set[str] = set()
        self._now = 0
        self._last: dict[str, int] = {}
        #: By name: until when states ahead of the clock are ignored (s, monotonic clock); 0: the
        #: last state was in time.
        self._ignored_until: dict[str, float] = {}
        self.set_description(description)

    def set_description(self, description: Description) -> None:
        self._joints = {joint.name: joint for joint in sorted(
            description.joints, key=lambda joint: joint.name)}
        self._never_sent = {joint.name for joint in description.joints if joint.is_movable}

    def fixed(self) -> list[LinkTransform]:
        """Return the transforms of fixed joints, and of planar ones at their origin."""
        return [self._link_transform(joint, joint.pose) for joint in self._joints.values()
                if joint.kind in ('fixed', 'planar')]

    def moving(self, stamp: int, names: Sequence[str], positions: Sequence[float], now: int
               ) -> Optional[list[LinkTransform]]:
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
            self._warned.difference_update(_OF_CLOCKS)
        self._now = now
        last = min([now, *(self._last.get(name, 0) for name in names)])
        period = min(1000.0 / (self.publish_frequency or inf), _LONGEST_INTERVAL)  # ms
        if not self.ignore_timestamp and stamp < last + int(period) * 1_000_000:
            if stamp == 0:
                self._warn_once('ignored a JointState message with the stamp 0: set its '
                                'header.stamp, or the parameter ignore_timestamp')
            elif stamp < last - _AHEAD:
                self._warn_of_stamp('ignored a JointState message that is older than the last one',
                                    stamp, last - stamp, names)
            return None
        if len(self._last) > _MAX_NAMES:
            self._last.clear()
            self._ignored_until.clear()
        if stamp <= now + _AHEAD or not names:
            self._last.update(dict.fromkeys(names, stamp))
            self._ignored_until.update(dict.fromkeys(names, 0.0))
        elif now and self._is_doubtful(stamp, names):  # 0: nothing has arrived on /clock yet
            return None
        else:  # the stamp does not hold back states that are in time
            for name in names:
                self._last.setdefault(name, now)
        # If a name occurs twice, the first position counts.
        return self._transforms_at(dict(zip(reversed(names), reversed(positions))))

    def missing(self) -> str:
        """Return a warning that names the joints without a position so far; '' if all had one."""
        if not self._never_sent:
            return ''
        if not self._last:
            return 'no JointState message has been accepted yet, so no joint moves' + (
                '' if self._warned else ': start a program that publishes on joint_states')
        unknown = sorted(self._last.keys() - self._joints.keys())
        return ('no position has arrived for ' + comma_list(
            sorted(self._never_sent), quoted) + ', so these joints have no transform' + (
                f'; the robot does not have {comma_list(unknown, quoted)}' if unknown else ''))

    def _is_doubtful(self, stamp: int, names: Sequence[str]) -> bool:
        """
        Return True if a state ahead of the clock is to be ignored; warn of it.

        Buffers that got its transform would refuse older ones. It is answered if its joints have
        been ahead from the start, or for some time.
        """
        present = monotonic()
        for name in names:
            if self._ignored_until.get(name) == 0.0:
                self._ignored_until[name] = present + _DOUBT
        is_doubtful = not self.ignore_timestamp and any(
            present < self._ignored_until.get(name, 0.0) for name in names)
        self._warn_of_stamp(
            _IGNORED if is_doubtful else _ANSWERED, stamp, stamp - self._now, names,
            '. It is from before a reset of the clock, or the clock of its publisher differs')
        return is_doubtful

    def _transforms_at(self, positions: dict[str, float]) -> list[LinkTransform]:
        for joint in self._joints.values():
            if joint.mimic and joint.mimic.joint in positions:
                positions.setdefault(joint.name, positions[joint.mimic.joint]
                                     * joint.mimic.multiplier + joint.mimic.offset)
        transforms = []
        for name, joint in self._joints.items():
            if name in positions and joint.is_movable:
                if isfinite(positions[name]):
                    self._never_sent.discard(name)
                    transforms.append(self._link_transform(joint, joint.pose_at(positions[name])))
                else:
                    self._warn_once('ignored positions that are not finite, such as '
                                    f'{positions[name]} of joint', f' {shortened(name)}')
        return transforms

    def _link_transform(self, joint: Joint, pose: Pose) -> LinkTransform:
        return self.frame_prefix + joint.parent, self.frame_prefix + joint.child, pose

    def _warn_of_lengths(self, names: Sequence[str], positions: Sequence[float]) -> None:
        if positions:
            self._warn_once('Robot state publisher ignored an invalid JointState message',
                            f': it has {len(names)} names and {len(positions)} positions')
        else:
            self._warn_once('Robot state publisher ignored a JointState message about joint(s) ',
                            f'"{shortened(names[0])}"(,...) whose position member was empty.')

    def _warn_of_stamp(self, cause: str, stamp: int, difference: int, names: Sequence[str],
                       why: str = '') -> None:
        if cause not in self._warned:
            self._warn_once(cause, (
                f' by {difference / SECOND:.1f} s: joint {comma_list(names, quoted)}, stamp '
                f'{display_time(stamp)}{why}{self._publishers()}'))

    def _warn_once(self, cause: str, details: str = '') -> None:
        if cause not in self._warned:
            self._warned.add(cause)
            self._warn(cause + details)
