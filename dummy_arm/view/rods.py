"""The rods that are drawn for a frame: its three axes, and a line to its parent."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf.rotations import quaternion_multiply
from dummy_arm.view.placement import Placement

#: A frame of this age (s) is not drawn, as by default in rviz2 ("Frame Timeout").
TIMEOUT = 15.0
_HALF = np.sqrt(0.5)
#: For each axis: the quaternion (x, y, z, w) that rotates z onto it, and its colour.
_AXES = (
    ((0.0, _HALF, 0.0, _HALF), (200, 0, 0)),
    ((-_HALF, 0.0, 0.0, _HALF), (0, 130, 0)),
    ((0.0, 0.0, 0.0, 1.0), (0, 40, 210)))
#: For each axis a matrix (4, 4): `q @ matrix` is the product of `q` and the axis's quaternion.
_TURNS = [np.array([quaternion_multiply(unit, turn) for unit in np.eye(4)]) for turn, _ in _AXES]
_LINE = (205, 135, 0)
_GREY = 178
_AXIS_RADIUS, _LINE_RADIUS = 0.05, 0.025  # fractions of the length of an axis


class Rods(NamedTuple):
    """
    Cylinders of radius 1 and length 1 along z, to be scaled and placed.

    For n frames: n x axes, n y axes, n z axes, and n lines to the parents.
    """

    positions: NDArray[np.float32]  #: (4 n, 3): x, y, z (m) of the end at the frame's origin
    wxyzs: NDArray[np.float32]  #: (4 n, 4): quaternions w, x, y, z
    scales: NDArray[np.float32]  #: (4 n, 3): radius, radius, length (m)
    colors: NDArray[np.uint8]  #: (4 n, 3): red, green, blue


def rods(placement: Placement, size: float, selected: str = '') -> Rods:
    """Compute the rods of all frames."""
    count = len(placement.names)
    translations, rotations = placement.points, placement.poses[:, 3:]
    turns = [rotations @ turn for turn in _TURNS]
    colourfulness, thickness = fading(placement.ages)
    line_radii = thickness * size * _LINE_RADIUS
    axis_radii = thickness * size * _AXIS_RADIUS
    if selected in placement.names:
        axis_radii[placement.names.index(selected)] *= 1.7
    axes = np.column_stack([axis_radii, axis_radii, np.full(count, size)])
    parents = np.array(placement.parents, np.intp)
    to_parents = np.where(parents[:, None] < 0, 0.0, translations[parents] - translations)
    lengths = np.linalg.norm(to_parents, axis=1)
    lines = np.column_stack([line_radii, line_radii, lengths])
    rotated = np.concatenate([*turns, _turns_to(to_parents, lengths)])
    colors = np.concatenate([_GREY + colourfulness[:, None] * (np.array(full) - _GREY)
                             for full in [*(full for _, full in _AXES), _LINE]])
    return Rods(
        np.tile(translations, (4, 1)).astype(np.float32),
        rotated[:, [3, 0, 1, 2]].astype(np.float32),
        np.concatenate([axes, axes, axes, lines]).astype(np.float32),
        np.round(colors).astype(np.uint8))


def fading(ages: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return the colourfulness, from 1 to 0 (grey), and the thickness, from 1 to 0 (timed out).

    In the second third of `TIMEOUT`, a frame turns grey; in the last third, it gets thinner. (With
    transparency, as in rviz2, the browser would create all rods again at each update.)
    """
    thirds = ages / (TIMEOUT / 3)
    return np.clip(2.0 - thirds, 0.0, 1.0), np.clip(3.0 - thirds, 0.0, 1.0)


def _turns_to(vectors: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions (n, 4), x, y, z, w, that rotate the z axis onto the vectors (n, 3)."""
    x, y, z = (vectors / np.where(lengths > 0.0, lengths, 1.0)[:, None]).T
    turns = np.column_stack([-y, x, np.zeros(len(z)), 1.0 + z])
    turns[turns[:, 3] < 1e-9] = 1.0, 0.0, 0.0, 0.0  # for -z: half a turn about x
    unit: NDArray[np.float64] = turns / np.linalg.norm(turns, axis=1)[:, None]
    return unit
