"""The path that a frame has drawn."""

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf.times import SECOND
from dummy_arm.view.source import AnyBuffer

#: How long it is (s).
LENGTH = 20
_STEP = SECOND // 20
_GAP = 4 * _STEP


class Trail:
    """Draws the path of a frame again and again; what was drawn before stays as it is."""

    def __init__(self, buffer: AnyBuffer) -> None:
        """Begin with no frame."""
        self._buffer = buffer
        self._begin('', '')

    def _begin(self, target: str, frame: str) -> None:
        self._of = target, frame
        self._times = np.empty(0, np.int64)
        self._points = np.empty((0, 3))

    def draw(self, target: str, frame: str, end: int, point: NDArray[np.float64]
             ) -> NDArray[np.float64]:
        """
        Draw the path of a frame.

        :param target: the frame in which it is drawn.
        :param end: its last time (ns).
        :param point: where it is then, (3,): x, y, z (m).
        :returns: (m, 2, 3): lines from point to point (m), the oldest first; without those to
            times at which nothing is known.
        """
        first = max(1, end - LENGTH * SECOND)
        last = max(self._times[-1:].tolist(), default=first)
        if self._of != (target, frame) or last > max(end, first):  # time was set back
            self._begin(target, frame)
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
        points = np.concatenate([self._points, [point]])
        lines = np.stack([points[:-1], points[1:]], axis=1)
        return lines[np.isfinite(lines).all(axis=(1, 2))]
