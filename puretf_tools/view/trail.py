"""The trail: the recent path of a frame, in pieces, of which only the newest one grows."""

from collections.abc import Mapping
from typing import Union

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND
from puretf_tools.view.axes import Display
from puretf_tools.view.feed import AnyBuffer, LENGTH
from puretf_tools.view.placement import Placement, within_reach

#: The time between two points (ns).
_STEP = SECOND // 20
#: If a gap is longer than this (ns), it is filled with points from the buffer.
_GAP = 4 * _STEP
#: The duration of a piece (ns).
_PIECE = SECOND
#: By the number of a piece: its lines (m, 2, 3), start and end of each, x, y, z (m).
Pieces = Mapping[int, NDArray[np.float64]]


class Trail:
    """The path over the last `LENGTH` seconds, or a little more: whole pieces are dropped."""

    def __init__(self, buffer: AnyBuffer) -> None:
        self._buffer = buffer
        self._restart('', '')

    def _restart(self, target: str, frame: str) -> None:
        self._frames = target, frame
        self._times = np.empty(0, np.int64)
        self._points = np.empty((0, 3))

    def draw(self, target: str, frame: str, end: int, point: NDArray[np.float64],
             shift: Union[tuple[float, ...], NDArray[np.float64]] = (0.0, 0.0, 0.0)) -> Pieces:
        """
        Return the pieces of the path, the oldest first; each call can add points to it.

        :param point: (3,): the position at the time `end` (ns), x, y, z (m).
        :param shift: the position of the target in the scene (m).
        :returns: lines in the scene, none at unknown times.
        """
        first = max(1, (end - LENGTH * SECOND) // _PIECE * _PIECE)
        last = max(self._times[-1:].tolist(), default=first)
        # If the last point is later than `end`, time was set back.
        if self._frames != (target, frame) or last > max(end, first):
            self._restart(target, frame)
            last = first
        if end - last > _GAP:
            times = np.arange(max(first, last + 1), end, _STEP, dtype=np.int64)
            points, _, _ = self._buffer.lookup_transforms(target, frame, times)
            self._times = np.append(self._times, times)
            self._points = np.concatenate([self._points, points])
        elif end - last >= _STEP:
            self._times = np.append(self._times, end)
            self._points = np.concatenate([self._points, [point]])
        kept = self._times >= first
        self._times, self._points = self._times[kept], self._points[kept]
        points = within_reach(np.concatenate([self._points, [point]]) + shift)
        lines = np.stack([points[:-1], points[1:]], axis=1)
        known = np.isfinite(lines).all(axis=(1, 2))
        numbers, begins = np.unique(self._times[known] // _PIECE, return_index=True)
        return dict(zip(numbers.tolist(), np.split(lines[known], begins[1:])))

    def pieces(self, placement: Placement, name: str, display: Display) -> Pieces:
        """Draw the trail of a placed frame in the scene; none if the frame is not drawn."""
        if name not in display.shown(placement):
            return {}
        i = placement.names.index(name)
        anchor, y = placement.anchor_of(name)
        return self.draw(anchor, name, placement.stamps[i], placement.poses[i, :3],
                         (0.0, y, 0.0) - placement.origin)
