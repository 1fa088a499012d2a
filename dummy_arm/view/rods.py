"""The rods that frames are drawn as: three axes each, and a line to the parent."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf.rotations import quaternion_multiply
from dummy_arm.view.snapshot import Snapshot

#: After so long without news a frame is gone (s); rviz's Frame Timeout.
TIMEOUT = 15.0
_HALF = np.sqrt(0.5)
#: Which turn takes z to an axis (x, y, z, w); and its colour.
_AXES = (
    ((0.0, _HALF, 0.0, _HALF), (200, 0, 0)),
    ((-_HALF, 0.0, 0.0, _HALF), (0, 130, 0)),
    ((0.0, 0.0, 0.0, 1.0), (0, 40, 210)))
#: For each axis the matrix by which a quaternion (a row) is multiplied to be turned by it first.
_TURNS = [np.array([quaternion_multiply(unit, turn) for unit in np.eye(4)]) for turn, _ in _AXES]
_LINE = (205, 135, 0)
_GREY = 178
_AXIS_RADIUS, _LINE_RADIUS = 0.05, 0.025


class Rods(NamedTuple):
    """
    Cylinders of length 1 along z and radius 1, placed, turned and scaled.

    Of n frames there are 4 n: the x axes of all, the y axes, the z axes, the lines to the parents.
    """

    positions: NDArray[np.float32]  #: (4 n, 3): of the lower ends (m)
    wxyzs: NDArray[np.float32]  #: (4 n, 4): quaternions w, x, y, z
    scales: NDArray[np.float32]  #: (4 n, 3): radius, radius, length (m)
    colors: NDArray[np.uint8]  #: (4 n, 3): red, green, blue


def rods(snapshot: Snapshot, size: float, selected: str = '') -> Rods:
    """
    Draw frames.

    :param size: the length of an axis (m).
    :param selected: the name of a frame that is drawn thicker.
    """
    count = len(snapshot.names)
    translations, rotations = snapshot.points, snapshot.poses[:, 3:]
    turns = [rotations @ turn for turn in _TURNS]
    colourfulness, thickness = fading(snapshot.ages)
    line_radii = thickness * size * _LINE_RADIUS
    axis_radii = thickness * size * _AXIS_RADIUS
    if selected in snapshot.names:
        axis_radii[snapshot.names.index(selected)] *= 1.7
    axes = np.column_stack([axis_radii, axis_radii, np.full(count, size)])
    parents = np.array(snapshot.parents, np.intp)
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
    Compute how far frames have faded, as rviz does, by thirds of the timeout.

    In the first they are as they were, in the second they turn grey, and in the last they dwindle
    away: were they to be transparent, as in rviz, the browser would make all rods anew each time.

    :param ages: (n,): how long nothing was heard of them (s).
    :returns: their colourfulness and thickness, (n,) each: 1 at first, 0 at last.
    """
    thirds = ages / (TIMEOUT / 3)
    return np.clip(2.0 - thirds, 0.0, 1.0), np.clip(3.0 - thirds, 0.0, 1.0)


def _turns_to(vectors: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the shortest turns that take z to vectors of some lengths; (n, 4): x, y, z, w."""
    x, y, z = (vectors / np.where(lengths > 0.0, lengths, 1.0)[:, None]).T
    turns = np.column_stack([-y, x, np.zeros(len(z)), 1.0 + z])
    turns[turns[:, 3] < 1e-9] = 1.0, 0.0, 0.0, 0.0  # to -z: about any axis
    unit: NDArray[np.float64] = turns / np.linalg.norm(turns, axis=1)[:, None]
    return unit
