"""The rods that are drawn for a frame: its three axes, and a line to its parent."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puretf.rotations import quaternion_multiply
from puretf_tools.view.placement import Placement
from puretf_tools.view.silent_frames import TIMEOUT

_HALF = np.sqrt(0.5)
#: For each axis: the quaternion (x, y, z, w) that rotates z onto it, and its colour.
_AXES = (
    ((0.0, _HALF, 0.0, _HALF), (200, 0, 0)),
    ((-_HALF, 0.0, 0.0, _HALF), (0, 130, 0)),
    ((0.0, 0.0, 0.0, 1.0), (0, 40, 210)))
#: For each axis a matrix (4, 4): `q @ matrix` is the product of `q` and the axis's quaternion.
_TURNS = [np.array([quaternion_multiply(unit, turn) for unit in np.eye(4)]) for turn, _ in _AXES]
#: The colours of a line, and of its head: the thicker part at the parent, of this length at most,
#: as a fraction of the length of an axis.
_LINE, _HEAD_COLOUR, _HEAD = (205, 135, 0), (140, 70, 0), 0.6
_GREY = 178
_AXIS_RADIUS, _LINE_RADIUS = 0.05, 0.025  # fractions of the length of an axis


class Display(NamedTuple):
    """What is drawn."""

    size: float = 0.16  #: the length of an axis (m)
    with_axes: bool = True
    with_lines: bool = True  #: from each frame to its parent
    with_names: bool = True
    cell: float = 0.5  #: the side of a cell of the grid (m); 0.0: there is no grid
    timeout: float = TIMEOUT  #: a frame of this age (s) is not drawn
    hidden: frozenset[str] = frozenset()  #: the names of frames that are not drawn
    is_dark: bool = False  #: whether the page is dark

    def shown(self, placement: Placement) -> set[str]:
        """Return the frames that are drawn: neither hidden nor timed out."""
        return {name for name, age in zip(placement.names, placement.ages.tolist())
                if age < self.timeout and name not in self.hidden}


class Rods(NamedTuple):
    """
    Cylinders of radius 1 and length 1 along z, to be scaled and placed.

    For n frames: n x axes, n y axes, n z axes, n lines to the parents, and their n heads.
    """

    positions: NDArray[np.float32]  #: (5 n, 3): x, y, z (m) of the end from which z points
    wxyzs: NDArray[np.float32]  #: (5 n, 4): quaternions w, x, y, z
    scales: NDArray[np.float32]  #: (5 n, 3): radius, radius, length (m)
    colors: NDArray[np.uint8]  #: (5 n, 3): red, green, blue


def rods(placement: Placement, display: Display, selected: str = '') -> Rods:
    """Compute the rods of all frames; those of frames that are not shown have the radius 0."""
    count, size = len(placement.names), display.size
    translations, rotations = placement.points, placement.poses[:, 3:]
    turns = [rotations @ turn for turn in _TURNS]
    colourfulness, thickness = fading(placement.ages, display.timeout)
    if display.hidden:
        thickness = thickness * [name not in display.hidden for name in placement.names]
    line_radii = thickness * size * _LINE_RADIUS * display.with_lines
    axis_radii = thickness * size * _AXIS_RADIUS * display.with_axes
    if selected in placement.names:
        axis_radii[placement.names.index(selected)] *= 1.7
    axes = np.column_stack([axis_radii, axis_radii, np.full(count, size)])
    parents = np.array(placement.parents, np.intp)
    to_parents = np.where(parents[:, None] < 0, 0.0, translations[parents] - translations)
    lengths = np.linalg.norm(to_parents, axis=1)
    heads = np.minimum(_HEAD * size, 0.5 * lengths)
    lines = np.column_stack([line_radii, line_radii, lengths])
    head_rods = np.column_stack([2.0 * line_radii, 2.0 * line_radii, heads])
    along = _turns_to(to_parents, lengths)
    rotated = np.concatenate([*turns, along, along])
    heads_at = translations + to_parents * (
        1.0 - heads / np.where(lengths > 0.0, lengths, 1.0))[:, None]
    colors = np.concatenate([_GREY + colourfulness[:, None] * (np.array(full) - _GREY)
                             for full in [*(full for _, full in _AXES), _LINE, _HEAD_COLOUR]])
    return Rods(
        np.concatenate([np.tile(translations, (4, 1)), heads_at]).astype(np.float32),
        rotated[:, [3, 0, 1, 2]].astype(np.float32),
        np.concatenate([axes, axes, axes, lines, head_rods]).astype(np.float32),
        np.round(colors).astype(np.uint8))


def fading(ages: NDArray[np.float64], timeout: float = TIMEOUT
           ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return the colourfulness, from 1 to 0 (grey), and the thickness, from 1 to 0 (timed out).

    In the second third of the timeout (s), a frame turns grey; in the last third, it gets thinner.
    (With transparency, as in rviz2, the browser would create all rods again at each update.)
    """
    thirds = ages / (timeout / 3)
    return np.clip(2.0 - thirds, 0.0, 1.0), np.clip(3.0 - thirds, 0.0, 1.0)


def _turns_to(vectors: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions (n, 4), x, y, z, w, that rotate the z axis onto the vectors (n, 3)."""
    x, y, z = (vectors / np.where(lengths > 0.0, lengths, 1.0)[:, None]).T
    turns = np.column_stack([-y, x, np.zeros(len(z)), 1.0 + z])
    turns[turns[:, 3] < 1e-9] = 1.0, 0.0, 0.0, 0.0  # for -z: half a turn about x
    unit: NDArray[np.float64] = turns / np.linalg.norm(turns, axis=1)[:, None]
    return unit
