"""
The geometry of the arm of the sheet, and its motion as a pure function of time.

The angle of a joint is limit * sin(phase), and the phase changes at a constant speed. Units are m,
rad and s; quaternions are x, y, z, w.
"""

from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dummy_arm.grading.sheet import HAND, JOINTS

#: The distance (m) of each joint from its parent, and the direction.
OFFSETS = [max(joint.position) for joint in JOINTS]
_DIRECTIONS = np.sign([joint.position for joint in JOINTS])
#: Duration of the transition to a new limit, and from a held angle to the wave (s).
_BLEND = 1.0


def _smoothstep(time: float) -> float:
    """Return the progress of a transition, from 0 to 1, at a time (s) after its begin."""
    # A time before its begin is that of a clock that was set back: the transition is over.
    progress = min(time / _BLEND, 1.0) if time >= 0.0 else 1.0
    return progress * progress * (3.0 - 2.0 * progress)


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

    The phase is `phase_at_0` (rad) at the time 0, and advances at `speed` (rad/s). In the second
    that begins at the time `limit_changed` (s), the limit changes smoothly from `limit_before` to
    `limit` (rad).

    If the time `released` (s) is infinite, the joint is held at the angle `held_at` (rad), or at
    the limit if this is nearer to 0. In the second that begins at `released`, the joint returns
    smoothly to the wave.
    """

    speed: float
    limit: float
    phase_at_0: float = 0.0
    limit_before: float = 0.0
    limit_changed: float = -math.inf
    held_at: float = 0.0
    released: float = -math.inf

    @property
    def is_held(self) -> bool:
        return self.released == math.inf

    def phase(self, t: float) -> float:
        return self.phase_at_0 + self.speed * t

    def limit_at(self, t: float) -> float:
        smooth = _smoothstep(t - self.limit_changed)
        return self.limit_before + smooth * (self.limit - self.limit_before)

    def angle(self, t: float) -> float:
        limit = self.limit_at(t)
        held_at = min(max(self.held_at, -limit), limit)
        smooth = 0.0 if self.is_held else _smoothstep(t - self.released)
        return (1.0 - smooth) * held_at + smooth * limit * math.sin(self.phase(t))

    def with_speed(self, speed: float, t: float) -> 'Wave':
        """Return this wave with another speed (rad/s) from the time t on; the phase is steady."""
        return replace(self, speed=speed, phase_at_0=self.phase(t) - speed * t)

    def with_limit(self, limit: float, t: float) -> 'Wave':
        """Return this wave with a limit (rad) that is reached smoothly, one second after t."""
        return replace(self, limit=limit, limit_before=self.limit_at(t), limit_changed=t)

    def with_hold(self, angle: float) -> 'Wave':
        """Return this wave with the joint held at an angle (rad); the phase goes on."""
        return replace(self, held_at=angle, released=math.inf)

    def with_release(self, t: float) -> 'Wave':
        """Return this wave with the joint, if it is held, released at the time t."""
        return replace(self, released=t) if self.is_held else self
