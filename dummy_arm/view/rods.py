"""The rods that are drawn for a frame: its three axes, and a line to its parent."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf.rotations import quaternion_multiply
from dummy_arm.view.snapshot import Snapshot

#: A frame whose age is at least this (s) is not drawn. In rviz2, the setting "Frame Timeout" has
#: the same default.
TIMEOUT = 15.0
_HALF = np.sqrt(0.5)
#: For each axis of a frame: the quaternion (x, y, z, w) that rotates the z axis onto this axis,
#: and the colour (red, green, blue) of this axis.
_AXES = (
    ((0.0, _HALF, 0.0, _HALF), (200, 0, 0)),
    ((-_HALF, 0.0, 0.0, _HALF), (0, 130, 0)),
    ((0.0, 0.0, 0.0, 1.0), (0, 40, 210)))
#: For each axis: a (4, 4) matrix. For each quaternion `q`, `q @ matrix` is the quaternion product
#: of `q` and the quaternion of the axis.
_TURNS = [np.array([quaternion_multiply(unit, turn) for unit in np.eye(4)]) for turn, _ in _AXES]
_LINE = (205, 135, 0)
_GREY = 178
_AXIS_RADIUS, _LINE_RADIUS = 0.05, 0.025  # fractions of the length of an axis


class Rods(NamedTuple):
    """
    The poses, scales and colours of cylinders.

    An unscaled cylinder has radius 1, and length 1 along z.

    For n frames, there are 4 n cylinders in four groups of n: the x axes, the y axes, the z axes,
    and the lines to the parents.
    """

    positions: NDArray[np.float32]  #: (4 n, 3): x, y, z (m) of the end at the frame's origin
    wxyzs: NDArray[np.float32]  #: (4 n, 4): quaternions w, x, y, z
    scales: NDArray[np.float32]  #: (4 n, 3): radius, radius, length (m)
    colors: NDArray[np.uint8]  #: (4 n, 3): red, green, blue


def rods(snapshot: Snapshot, size: float, selected: str = '') -> Rods:
    """
    Compute the rods of all frames.

    :param snapshot: the frames.
    :param size: the length of an axis (m).
    :param selected: the name of a frame whose axes are drawn thicker; '' for none.
    :returns: the rods. The order in each of the four groups is that of `snapshot.names`.
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
    Compute how much frames have faded.

    In the first third of `TIMEOUT`, a frame does not change. In the second third, it turns grey.
    In the last third, it gets thinner until it disappears. (rviz2 makes a frame transparent
    instead. With transparency, the browser would have to create all rods again at each update.)

    :param ages: (n,): the ages of the frames (s), as in `Snapshot`.
    :returns: two arrays (n,): the colourfulness of the frames, from 1 (full colour) to 0 (grey),
        and their thickness, from 1 (full) to 0 (timed out).
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
