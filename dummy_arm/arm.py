"""
The geometry of the arm, and the motion of the arm as a pure function of time.

The frames are base_link, one frame for each link, and end_effector, in this order. Each frame is
the parent of the next frame. Each joint rotates one link, about an axis through the origin of the
frame of the link. The angle of a joint is limit * sin(phase), and the phase changes at a constant
speed. If all phases are zero, the axes of all frames are parallel to those of base_link. Units are
m, rad and s; quaternions are x, y, z, w.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = tuple[float, float, float]

#: Duration of the transition to a new limit, and from a held angle to the wave (s).
_BLEND = 1.0


def _smoothstep(time: float) -> float:
    """Return the progress of a transition, from 0 to 1, at a time (s) after its begin."""
    progress = min(max(time / _BLEND, 0.0), 1.0)
    return progress * progress * (3.0 - 2.0 * progress)


@dataclass(frozen=True)
class Joint:
    """
    A joint and the link that it rotates.

    The frame of the link has the name of the joint. The origin of this frame is the origin of the
    parent frame, moved by `offset` (m) along `direction`. The link rotates about `axis`. The
    vectors `direction` and `axis` are unit vectors in the parent frame. The joint angle is
    `limit` * sin(phase) (rad), and the phase advances at `speed` (rad/s).
    """

    name: str
    offset: float
    direction: Vector
    axis: Vector
    speed: float
    limit: float


_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Arm:
    """A chain of joints; end_effector is at (`tool`, 0, 0) (m) in the frame of the last link."""

    joints: tuple[Joint, ...] = (
        Joint('joint_1', 0.3, _Z, _Z, 0.3, math.radians(45)),
        Joint('joint_2', 0.4, _X, _Z, 0.5, math.radians(30)),
        Joint('joint_3', 0.3, _X, _Z, 0.7, math.radians(60)))
    tool: float = 0.2

    @property
    def frames(self) -> tuple[str, ...]:
        """The names of the frames, from base_link to end_effector."""
        return ('base_link', *(joint.name for joint in self.joints), 'end_effector')

    def angles(self, phases: ArrayLike) -> NDArray[np.float64]:
        """Return the joint angles (rad), limit * sin(phase), from the n phases (rad)."""
        return np.array([joint.limit for joint in self.joints]) * np.sin(phases)

    def poses(self, phases: ArrayLike) -> NDArray[np.float64]:
        """Return `poses_at` the angles of n phases (rad)."""
        return self.poses_at(self.angles(phases).tolist())

    def poses_at(self, angles: Sequence[float]) -> NDArray[np.float64]:
        """
        Return the pose of each frame but base_link in its parent, from the n joint angles (rad).

        :returns: (n + 1, 7) float64: x, y, z (m), quaternion x, y, z, w.
        """
        poses = np.zeros((len(self.joints) + 1, 7))
        for pose, joint, angle in zip(poses, self.joints, angles):
            pose[:3] = [joint.offset * component for component in joint.direction]
            # q = (axis * sin(angle / 2), cos(angle / 2)); adding 0.0 turns -0.0 into 0.0.
            pose[3:6] = [math.sin(angle / 2) * component + 0.0 for component in joint.axis]
            pose[6] = math.cos(angle / 2)
        poses[-1] = self.tool, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
        return poses


@dataclass(frozen=True)
class Wave:
    """
    The motion of one joint: the joint angle limit * sin(phase) as a function of the time t (s).

    The phase is `phase_at_change` (rad) at the time `speed_changed` (s), and advances at `speed`
    (rad/s). In the second that begins at the time `limit_changed` (s), the limit changes smoothly
    from `limit_before` to `limit` (rad).

    Before the time `released` (s), the joint is held at the angle `held_at` (rad), or at the limit
    if this is nearer to 0. In the second that begins then, the joint returns smoothly to the wave.
    """

    speed: float
    limit: float
    phase_at_change: float = 0.0
    speed_changed: float = 0.0
    limit_before: float = 0.0
    limit_changed: float = -math.inf
    held_at: float = 0.0
    released: float = -math.inf

    @property
    def is_held(self) -> bool:
        return self.released == math.inf

    def phase(self, t: float) -> float:
        return self.phase_at_change + self.speed * (t - self.speed_changed)

    def limit_at(self, t: float) -> float:
        smooth = _smoothstep(t - self.limit_changed)
        return self.limit_before + smooth * (self.limit - self.limit_before)

    def angle(self, t: float) -> float:
        limit = self.limit_at(t)
        held_at = min(max(self.held_at, -limit), limit)
        smooth = _smoothstep(t - self.released)
        return (1.0 - smooth) * held_at + smooth * limit * math.sin(self.phase(t))

    def with_speed(self, speed: float, t: float) -> 'Wave':
        """Return this wave with another speed (rad/s) from the time t on; the phase is steady."""
        return replace(self, speed=speed, phase_at_change=self.phase(t), speed_changed=t)

    def with_limit(self, limit: float, t: float) -> 'Wave':
        """Return this wave with a limit (rad) that is reached smoothly, one second after t."""
        return replace(self, limit=limit, limit_before=self.limit_at(t), limit_changed=t)

    def with_hold(self, angle: float) -> 'Wave':
        """Return this wave with the joint held at an angle (rad); the phase goes on."""
        return replace(self, held_at=angle, released=math.inf)

    def with_release(self, t: float) -> 'Wave':
        """Return this wave with the joint, if it is held, released at the time t."""
        return replace(self, released=t) if self.is_held else self

    def settled(self) -> 'Wave':
        """Return this wave without transitions: they are over at every time."""
        return replace(self, limit_changed=-math.inf,
                       released=math.inf if self.is_held else -math.inf)
