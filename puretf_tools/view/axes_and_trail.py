"""What is drawn of frames: their axes, lines to their parents, and the trail of one."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND
from puretf_tools.inspection.gaps import AnyBuffer
from puretf_tools.view.feed import LENGTH
from puretf_tools.view.placement import Floats, Placement, REACH

#: The axes of the selected frame are this many times as large as those of others.
_SELECTED = 1.5
#: Numbers are rounded to multiples of this.
_FINEST = 2.0**-13
#: The time between two points of a trail, and the duration of a piece of it (ns).
STEP, _PIECE = SECOND // 20, SECOND
#: By the number of a piece: its lines (m, 2, 3), start and end of each, x, y, z (m).
Pieces = Mapping[int, Floats]


class Display(NamedTuple):
    """What is drawn."""

    hidden: frozenset[str] = frozenset()  #: the names of frames that are not drawn
    size: float = 0.16  #: the length of an axis (m)
    with_axes: bool = True
    with_lines: bool = True  #: from each frame to its parent
    with_names: bool = True
    with_grid: bool = True
    is_dark: bool = False  #: whether the page is dark
    with_visuals: bool = True  #: bodies as they look
    with_collisions: bool = False  #: their shapes for collision checking
    opacity: float = 1.0  #: of bodies: multiplies that of each color

    def shown(self, placement: Placement) -> set[str]:
        """Return the frames that are drawn: neither hidden nor far."""
        return {*placement.names}.difference(self.hidden, placement.far)


def axes(placement: Placement, display: Display, selected: str = ''
         ) -> tuple[Floats, Floats, Floats]:
    """
    Return of all axes: x, y, z (m), w, x, y, z, and the scale (0.0: they are not drawn).

    After a third of the timeout without an update, the axes shrink, until the frame is dead.
    """
    shown = display.shown(placement)
    scales = np.clip(1.5 - 1.5 * placement.ages / placement.timeout, 0.0, 1.0) * [
        (_SELECTED if name == selected else 1.0) * (name in shown) for name in placement.names]
    return rounded(placement.points), rounded(placement.poses[:, [6, 3, 4, 5]]), scales


def lines(placement: Placement, display: Display) -> Floats:
    """Return (m, 2, 3): the lines to parents, x, y, z (m) of both ends."""
    shown = display.shown(placement)
    drawn = [i for i, name in enumerate(placement.names)
             if placement.parents[i] >= 0 and name in shown]
    ends = [placement.parents[i] for i in drawn]
    return rounded(np.stack([placement.points[drawn], placement.points[ends]], axis=1))


def rounded(values: Floats) -> Floats:
    """Round positions (m) and quaternions to what can be seen: they need half the bytes."""
    return np.asarray(np.round(values / _FINEST) * _FINEST)


def poses_over_time(buffer: AnyBuffer, target: str, frame: str, begin: int, end: int,
                    step: int = STEP) -> tuple[NDArray[np.int64], Floats]:
    """Return times (n,) (ns), and poses (n, 7): x, y, z (m), quaternion; unknown ones are NaN."""
    times = np.arange(begin, end + 1, step, dtype=np.int64)
    translations, rotations, _ = buffer.lookup_transforms(target, frame, times)
    return times, np.column_stack([translations, rotations])


def trail(buffer: AnyBuffer, placement: Placement, name: str, display: Display) -> Pieces:
    """
    Return the pieces of the path of a placed frame over the last `LENGTH` seconds.

    It is a little longer, since whole pieces are dropped: only the newest one changes.

    :returns: lines in the scene, the oldest piece first; none at unknown times, and none if the
        frame is not drawn.
    """
    if name not in display.shown(placement):
        return {}
    i = placement.names.index(name)
    anchor, end = placement.anchors[i], placement.stamps[i]
    begin = max(1, (end - LENGTH * SECOND) // _PIECE * _PIECE)
    times, poses = poses_over_time(buffer, anchor, name, begin, end)
    points = np.concatenate([poses[:, :3], placement.poses[[i], :3]]) + [
        0.0, placement.trees[anchor], 0.0] - placement.origin
    lines = np.stack([points[:-1], points[1:]], axis=1)
    known = (np.abs(lines) <= REACH).all(axis=(1, 2))
    numbers, begins = np.unique(times[known] // _PIECE, return_index=True)
    return dict(zip(numbers.tolist(), np.split(lines[known], begins[1:])))
