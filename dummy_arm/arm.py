"""
The arm: its geometry, and its motion as a pure function of time.

Frames, each in the one before it: base_link, a link for every joint, end_effector. A joint turns
its link about its axis, at its origin; at phase zero all are aligned with base_link. Units are m,
rad and s; quaternions are x, y, z, w.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = tuple[float, float, float]

_BLEND = 1.0  # s


@dataclass(frozen=True)
class Joint:
    """
    A joint and the link that it turns.

    The link's frame has the joint's name. Its origin lies `offset` m along `direction` from that
    of the link before, it turns about `axis` (both unit vectors, in the frame of the link before),
    within +-`limit` rad, its phase at `speed` rad/s.
    """

    name: str
    offset: float
    direction: Vector
    axis: Vector
    speed: float
    limit: float

    def __post_init__(self) -> None:
        for vector in (self.direction, self.axis):
            if not math.isclose(math.hypot(*vector), 1.0):
                raise ValueError(f'{self.name}: {vector} is no unit vector')


_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Arm:
    """An arm of joints in a row, and an end effector `tool` m along x of the last link."""

    joints: tuple[Joint, ...] = (
        Joint('joint_1', 0.3, _Z, _Z, 0.3, math.radians(45)),
        Joint('joint_2', 0.4, _X, _Z, 0.5, math.radians(30)),
        Joint('joint_3', 0.3, _X, _Z, 0.7, math.radians(60)))
    tool: float = 0.2

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames from base_link to end_effector, each the parent of the next."""
        return ('base_link', *(joint.name for joint in self.joints), 'end_effector')

    def angles(self, phases: ArrayLike) -> NDArray[np.float64]:
        """
        Compute the joint angles: limit * sin(phase).

        :param phases: (n,) rad, one for each joint.
        :returns: (n,) rad.
        """
        return np.array([joint.limit for joint in self.joints]) * np.sin(phases)

    def poses(self, phases: ArrayLike) -> NDArray[np.float64]:
        """
        Compute the pose of every frame but the first in the one before it.

        :param phases: (n,) rad, one for each joint.
        :returns: (n + 1, 7): x, y, z (m) and the rotation's x, y, z, w.
        """
        return self.poses_at(self.angles(phases).tolist())

    def poses_at(self, angles: Sequence[float]) -> NDArray[np.float64]:
        """Compute the poses, as `poses` does, for n joint angles (rad)."""
        poses = np.zeros((len(self.joints) + 1, 7))
        for pose, joint, angle in zip(poses, self.joints, angles):
            pose[:3] = [joint.offset * component for component in joint.direction]
            # With 0.0 added, so that no component is a negative zero.
            pose[3:6] = [math.sin(angle / 2) * component + 0.0 for component in joint.axis]
            pose[6] = math.cos(angle / 2)
        poses[-1] = self.tool, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
        return poses


@dataclass(frozen=True)
class Wave:
    """
    How one joint waves: its angle, limit * sin(phase), as a function of the time t (s).

    A change makes a new wave, whose angle is that of the old one at the time of the change.
    """

    speed: float
    limit: float
    phase_at_change: float = 0.0
    speed_changed: float = 0.0
    limit_before: float = 0.0
    limit_changed: float = -math.inf

    def phase(self, t: float) -> float:
        """Compute the phase (rad) at the time t."""
        return self.phase_at_change + self.speed * (t - self.speed_changed)

    def limit_at(self, t: float) -> float:
        """Compute the limit (rad) at t, blended in over a second after a change."""
        done = min(max((t - self.limit_changed) / _BLEND, 0.0), 1.0)
        smooth = done * done * (3.0 - 2.0 * done)
        return self.limit_before + smooth * (self.limit - self.limit_before)

    def angle(self, t: float) -> float:
        """Compute the joint's angle (rad) at t."""
        return self.limit_at(t) * math.sin(self.phase(t))

    def with_speed(self, speed: float, t: float) -> 'Wave':
        """Change the speed (rad/s) at t; the phase goes on from where it is."""
        return replace(self, speed=speed, phase_at_change=self.phase(t), speed_changed=t)

    def with_limit(self, limit: float, t: float) -> 'Wave':
        """Change the limit (rad) from t on, smoothly."""
        return replace(self, limit=limit, limit_before=self.limit_at(t), limit_changed=t)

    def settled(self) -> 'Wave':
        """Take a change of the limit for done."""
        return replace(self, limit_changed=-math.inf)
