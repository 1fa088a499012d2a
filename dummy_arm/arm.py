"""
The geometry of the arm of the sheet, and its motion as a pure function of time.

The angle of a joint is limit * sin(phase), and the phase changes at a constant speed. Units are m,
rad and s; quaternions are x, y, z, w.
"""

from dataclasses import dataclass, replace
import math
from typing import Optional

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dummy_arm.grading.sheet import HAND, JOINTS

#: The distance (m) of each joint from its parent, and the direction.
OFFSETS = [max(joint.position) for joint in JOINTS]
_DIRECTIONS = np.sign([joint.position for joint in JOINTS])
#: Duration of the transition to a new limit, and from a held angle to the wave (s).
_BLEND = 1.0


def poses(angles: ArrayLike, offsets: ArrayLike = OFFSETS) -> NDArray[np.float64]:
    """
    Return the pose of each frame from joint_1 to end_effector in its parent.

    :param angles: the joint angles (rad).
    :param offsets: the distances of the joints from their parents (m).
    :returns: (4, 7) float64: x, y, z (m), quaternion x, y, z, w.
    """
    half = np.divide(angles, 2.0)
    found = np.zeros((4, 7))
    found[:3, :3] = _DIRECTIONS * np.reshape(offsets, (3, 1))
    found[:3, 5], found[:3, 6] = np.sin(half), np.cos(half)
    found[3, :3], found[3, 6] = HAND.position, 1.0
    return found


@dataclass(frozen=True)
class Wave:
    """
    The motion of one joint: the joint angle limit * sin(phase) as a function of the time t (s).

    The phase is `phase_at_0` (rad) at the time 0, and advances at `speed` (rad/s). If `held_at` is
    an angle (rad), the joint is held at it, or at the limit if this is nearer to 0. In the second
    that begins at the time `changed` (s), the joint gets there smoothly from the angle `start`
    (rad).
    """

    speed: float
    limit: float
    phase_at_0: float = 0.0
    held_at: Optional[float] = None
    start: float = 0.0
    changed: float = -math.inf

    def angle(self, t: float) -> float:
        if self.held_at is None:
            goal = self.limit * math.sin(self.phase_at_0 + self.speed * t)
        else:
            goal = min(max(self.held_at, -self.limit), self.limit)
        # A time before the change is that of a clock that was set back: the transition is over.
        progress = min((t - self.changed) / _BLEND, 1.0) if t >= self.changed else 1.0
        smooth = progress * progress * (3.0 - 2.0 * progress)
        return (1.0 - smooth) * self.start + smooth * goal

    def with_speed(self, speed: float, t: float) -> 'Wave':
        """Return this wave with another speed (rad/s) from the time t on; the phase is steady."""
        return replace(self, speed=speed, phase_at_0=self.phase_at_0 + (self.speed - speed) * t)

    def with_limit(self, limit: float, t: float) -> 'Wave':
        """Return this wave with a limit (rad) that is reached smoothly, one second after t."""
        return replace(self, limit=limit, start=self.angle(t), changed=t)

    def with_hold(self, angle: float) -> 'Wave':
        """Return this wave with the joint held at an angle (rad); the phase goes on."""
        return replace(self, held_at=angle, changed=-math.inf)

    def with_release(self, t: float) -> 'Wave':
        """Return this wave with the joint, if it is held, released at the time t."""
        return self if self.held_at is None else replace(
            self, held_at=None, start=self.angle(t), changed=t)
