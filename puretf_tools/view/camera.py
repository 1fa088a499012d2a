"""Where the camera stands: what it shows first, until a viewer moves it."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import product
from math import inf
from typing import Any

import numpy as np

from puretf_tools.view.placement import Floats

#: By the name of a view: the direction from the middle of the frames to the camera (x, y, z).
VIEWS = {'all': (0.55, -0.7, 0.45), 'top': (0.0, -1e-3, 1.0), 'front': (1.0, 0.0, 0.0),
         'side': (0.0, -1.0, 0.0)}
#: How long after the first frame the first camera follows where the frames go, and the time
#: between two of its moves (s).
_FIRST, _PERIOD = 5.0, 1.0
#: (3, 26): x, y, z of vectors along and between the axes.
_DIRECTIONS = np.array([each for each in product((-1.0, 0.0, 1.0), repeat=3) if any(each)]).T
#: A camera has been moved by a viewer if it is this far from where it was put, as a fraction of
#: the distance to what it looks at.
_MOVED = 0.02
#: The camera shows a sphere around all points. The radius of the sphere is at least this (m).
_SMALLEST_VIEW = 0.5
#: The camera sees this many metres or radii of the sphere, whichever is more.
_FAR = 1000.0
#: The vertical field of view of the camera (rad); from the top, it looks from far with a narrow
#: one, so that what lies above another is drawn above it.
_ANGLE, _TOP_ANGLE = 0.8, 0.1
#: The distance of the camera from the middle of the sphere, in radii of the sphere.
_DISTANCE = 3.6


class FirstCamera:
    """Shows where the frames go, and again after a resize, until the viewer moves the camera."""

    def __init__(self, cameras: Sequence[Any]) -> None:
        """Move these cameras; the first one is that of the viewer."""
        self._cameras = cameras
        self._points = np.empty((0, 3))  # those that are farthest in each direction (m)
        #: When the cameras can be moved again, and when no more points are added (s).
        self._next, self._end = 0.0, inf
        self._shown: tuple[float, ...] = ()  # the size of the page, and the points
        #: Where the camera was before, and where it was put (m): reports of a browser that has not
        #: moved it yet may still be on their way.
        self._put: list[Floats] = []
        self.is_over = False  #: True after the viewer has moved the camera

    def extend(self, points: Floats) -> None:
        """Show some more points, too: (n, 3), x, y, z in the scene (m)."""
        if len(points := np.concatenate([self._points, points])):
            self._points = points[np.unique(np.argmax(points @ _DIRECTIONS, axis=0))]

    def update(self, points: Callable[[], Floats], now: float) -> None:
        """Move the cameras if it is time to; `points`: of the frames, (n, 3) in the scene (m)."""
        if self.is_over:
            return
        if now < self._end:
            self.extend(points())
        if not len(self._points):
            return
        self._end = min(self._end, now + _FIRST)
        shown = *page_size(self._cameras[0]), *self._points.flat
        if now < self._next or shown == self._shown:
            return
        self.is_over = self._is_moved()
        if not self.is_over:
            before = self._put[-1:] or [np.array(self._cameras[0].position)]
            look_at(self._points, self._cameras)
            self._put = [*before, np.array(self._cameras[0].position)]
            self._shown, self._next = shown, now + _PERIOD

    @property
    def view(self) -> list[float]:
        """The camera that the viewer has moved: position, what it looks at (m), angle (rad)."""
        camera = self._cameras[0]
        self.is_over = self.is_over or self._is_moved()
        return [round(float(value), 4) for value in (
            *camera.position, *camera.look_at, camera.fov)] if self.is_over else []

    def restore(self, view: list[float]) -> None:
        """Set a `view`; if it is empty, show where the frames go."""
        self.is_over = bool(view)
        if view:
            _put(self._cameras, np.array(view[:3]), np.array(view[3:6]), view[6], _FAR)
        else:
            self._put, self._shown = [], ()

    def _is_moved(self) -> bool:
        camera = self._cameras[0]
        return bool(self._put) and all(
            np.linalg.norm(np.subtract(camera.position, place)) > _MOVED * np.linalg.norm(
                np.subtract(camera.position, camera.look_at)) for place in self._put)


def look_at(points: Floats, cameras: Sequence[Any],
            direction: Sequence[float] = VIEWS['all']) -> None:
    """Move cameras so that points (n, 3) are visible, seen from a direction (x, y, z)."""
    if not len(points):
        return
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = max(_SMALLEST_VIEW, np.linalg.norm(points - middle, axis=1).max())
    angle = _TOP_ANGLE if direction == VIEWS['top'] else _ANGLE
    away = np.array(direction) / np.linalg.norm(direction) * radius
    away *= np.tan(_ANGLE / 2) / np.tan(angle / 2)
    width, height = page_size(cameras[0])
    away *= _DISTANCE * max(1.0, height / width)
    _put(cameras, middle + away, middle, angle, max(_FAR, _FAR * radius))


def _put(cameras: Sequence[Any], position: Floats, target: Floats,
         angle: float, far: float) -> None:
    for each in cameras:
        # viser refuses numbers that are not finite, and to look along the camera's own `up`.
        with suppress(ValueError), np.errstate(all='ignore'):
            each.position, each.look_at, each.fov, each.far = position, target, angle, far


def page_size(camera: Any) -> tuple[float, float]:
    """Return the width and the height of the page of a camera (pixels of CSS), or a guess."""
    size = getattr(camera, 'page_size', (0.0, 0.0))
    if min(size) <= 0.0:
        size = tuple(getattr(camera, name, 0) for name in ('image_width', 'image_height'))
    return size if min(size) > 0.0 else (1800.0, 900.0)
