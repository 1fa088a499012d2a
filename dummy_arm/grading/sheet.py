"""What the sheet of the lab requires of each frame."""

from math import radians
from typing import NamedTuple

Vector = tuple[float, float, float]


class SheetFrame(NamedTuple):
    """What the sheet of the lab requires of a frame."""

    name: str
    parent: str
    position: Vector  #: the origin of the frame in its parent (m)
    limit: float = 0.0  #: the largest angle about z, in both directions (rad); 0: does not rotate
    speed: float = 0.0  #: rad/s; see `Sine.speed` and `Sine.fastest`

    @property
    def place(self) -> str:
        """The position in words, such as '0.3 m along z'."""
        length, axis = max(zip(self.position, 'xyz'))
        return f'{length:g} m along {axis}'


BASE = SheetFrame('base_link', 'map', (0.0, 0.0, 0.0))
JOINTS = (SheetFrame('joint_1', 'base_link', (0.0, 0.0, 0.3), radians(45), 0.3),
          SheetFrame('joint_2', 'joint_1', (0.4, 0.0, 0.0), radians(30), 0.5),
          SheetFrame('joint_3', 'joint_2', (0.3, 0.0, 0.0), radians(60), 0.7))
HAND = SheetFrame('end_effector', 'joint_3', (0.2, 0.0, 0.0))
SHEET = (BASE, *JOINTS, HAND)
#: The names of all frames, from the root to the hand.
FRAMES = (BASE.parent, *(edge.name for edge in SHEET))
