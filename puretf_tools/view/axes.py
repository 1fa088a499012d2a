"""What is drawn of each frame: its axes, and a line to its parent."""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puretf_tools.view.placement import Placement
from puretf_tools.view.silent_frames import TIMEOUT

#: The colours of a line at the frame and at its parent, and of an old one.
_LINE, _AT_PARENT, _GREY = (225, 160, 20), (120, 50, 0), (178, 178, 178)
#: The axes of the selected frame are this many times as large as those of others.
_SELECTED = 1.5
#: Numbers are rounded to multiples of this.
_STEP = 2.0**-13


class Display(NamedTuple):
    """What is drawn."""

    size: float = 0.16  #: the length of an axis (m)
    with_axes: bool = True
    with_lines: bool = True  #: from each frame to its parent
    with_names: bool = True
    with_grid: bool = True
    timeout: float = TIMEOUT  #: a frame of this age (s) is not drawn
    hidden: frozenset[str] = frozenset()  #: the names of frames that are not drawn
    is_dark: bool = False  #: whether the page is dark

    def alive(self, placement: Placement) -> set[str]:
        """Return the frames that have not timed out."""
        return {name for name, age in zip(placement.names, placement.ages.tolist())
                if age < self.timeout}

    def shown(self, placement: Placement) -> set[str]:
        """Return the frames that are drawn: neither hidden nor timed out."""
        return self.alive(placement) - self.hidden


class Axes(NamedTuple):
    """The axes of n frames."""

    positions: NDArray[np.float64]  #: (n, 3): x, y, z (m)
    wxyzs: NDArray[np.float64]  #: (n, 4): quaternions w, x, y, z
    scales: NDArray[np.float64]  #: (n,): 0.0: not drawn


class Lines(NamedTuple):
    """Lines from m frames to their parents."""

    points: NDArray[np.float64]  #: (m, 2, 3): x, y, z (m) of the frame and of its parent
    colors: NDArray[np.uint8]  #: (m, 2, 3): red, green, blue at both ends


def axes(placement: Placement, display: Display, selected: Collection[str] = ()) -> Axes:
    """Return the axes of all frames; those of selected ones are larger."""
    _, scales = fading(placement.ages, display.timeout)
    if display.hidden:
        scales = scales * [name not in display.hidden for name in placement.names]
    scales = scales * np.where([name in selected for name in placement.names], _SELECTED, 1.0)
    return Axes(rounded(placement.points), rounded(placement.poses[:, [6, 3, 4, 5]]), scales)


def lines(placement: Placement, display: Display) -> Lines:
    """Return the lines of those frames that are drawn and whose parent has a pose."""
    shown = display.shown(placement)
    drawn = [i for i, name in enumerate(placement.names)
             if placement.parents[i] >= 0 and name in shown]
    ends = [placement.parents[i] for i in drawn]
    points = np.stack([placement.points[drawn], placement.points[ends]], axis=1)
    colourfulness, _ = fading(placement.ages[drawn], display.timeout)
    colours = _GREY + colourfulness[:, None, None] * (np.array([_LINE, _AT_PARENT]) - _GREY)
    return Lines(rounded(points), np.round(colours).astype(np.uint8))


def rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round positions (m) and quaternions to what can be seen: they need half the bytes."""
    result: NDArray[np.float64] = np.round(values / _STEP) * _STEP
    return result


def fading(ages: NDArray[np.float64], timeout: float = TIMEOUT
           ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return the colourfulness of lines, from 1 to 0 (grey), and the scale of axes, from 1 to 0.

    In the second third of the timeout (s), a line turns grey; in the last third, the axes shrink.
    """
    thirds = ages / (timeout / 3)
    return np.clip(2.0 - thirds, 0.0, 1.0), np.clip(3.0 - thirds, 0.0, 1.0)
