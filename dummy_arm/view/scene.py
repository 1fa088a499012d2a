"""The scene: frames as axes, joined by lines, with names; a trail; on a grid."""

from collections.abc import Iterable
from threading import Lock
from typing import Optional

import numpy as np
from numpy.typing import NDArray
import trimesh
import viser

from dummy_arm.tf.formatting import visible
from dummy_arm.view.rods import Rods, rods, TIMEOUT
from dummy_arm.view.server import Server
from dummy_arm.view.snapshot import Snapshot

#: So many names are moved at once at most; with more, each in its turn.
NAMES_AT_ONCE = 50
_LONGEST_NAME = 40
_SIDES = 8
_GRID, _CELL = 10.0, 0.5  # m
_GRID_COLOUR = (215, 215, 215)
_TRAIL_WIDTH = 3.0  # pixels
_TRAIL_COLOUR, _TRAIL_FADED = (200, 60, 200), (235, 205, 235)
_NEAR = 0.34  # axes; what is static and closer to its parent than this has its name beside that's
_SMALLEST_VIEW = 0.5  # m
_DIRECTION = np.array([0.55, -0.7, 0.45])  # from the middle of the frames to the camera
_FAR = 1000.0  # m; or that many times the farthest
_ANGLE = 0.8  # rad, that the camera sees from top to bottom
_DISTANCE = 4.4  # times the farthest frame from the middle
_ASIDE = 0.14  # of that, to the right: what is there is behind the panel


class Scene:
    """What is seen of frames, by all who look."""

    def __init__(self, server: Server) -> None:
        """Begin with a grid."""
        self._scene, self._server = server.scene, server
        self._scene.add_line_segments('/grid', _grid(), _GRID_COLOUR, thickness=1.0,
                                      thickness_units='screen')
        self._rods: Optional[viser.BatchedMeshHandle] = None
        self._trail: Optional[viser.LineSegmentsHandle] = None
        self._names: list[viser.LabelHandle] = []
        self._texts: list[str] = []
        self._next_name = 0
        self._snapshot: list[str] = []
        self._clicked = ''
        self._lock = Lock()

    def show(self, snapshot: Snapshot, size: float, selected: str, with_names: bool,
             trail: NDArray[np.float64]) -> None:
        """
        Show frames in place of those before.

        :param size: the length of an axis (m).
        :param selected: the frame that stands out.
        :param trail: lines, (m, 2, 3) (m).
        """
        with self._server.atomic():
            with self._lock:
                self._snapshot = snapshot.names
            self._show_rods(rods(snapshot, size, selected))
            self._show_names(snapshot, size, with_names)
            self._show_trail(trail)

    def take_click(self) -> str:
        """Tell which frame was clicked since the last time; '' when none was."""
        with self._lock:
            clicked, self._clicked = self._clicked, ''
        return clicked

    def look_at(self, snapshot: Snapshot, clients: Iterable[viser.ClientHandle]) -> None:
        """Turn somebody's camera to all frames, and that to which everybody's can be reset."""
        points = snapshot.points[snapshot.ages < TIMEOUT]
        if not len(points):
            return
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = max(_SMALLEST_VIEW, np.linalg.norm(points - middle, axis=1).max())
        away = _DIRECTION / np.linalg.norm(_DIRECTION) * radius * _DISTANCE
        middle += np.cross((0.0, 0.0, 1.0), away) * _ASIDE
        self._server.turn_cameras(clients, middle + away, middle, _ANGLE, max(_FAR, _FAR * radius))

    def _show_rods(self, new: Rods) -> None:
        if not len(new.positions):
            if self._rods is not None:
                self._rods.visible = False
            return
        if self._rods is None:
            cylinder = trimesh.creation.cylinder(1.0, segment=[[0, 0, 0], [0, 0, 1]],
                                                 sections=_SIDES)
            self._rods = self._scene.add_batched_meshes_simple(
                '/frames', cylinder.vertices, cylinder.faces, new.wxyzs, new.positions,
                batched_scales=new.scales, batched_colors=new.colors, lod='off',
                cast_shadow=False, receive_shadow=False)
            self._rods.on_click(self._click)
            return
        self._rods.batched_positions = new.positions
        self._rods.batched_wxyzs = new.wxyzs
        self._rods.batched_scales = new.scales
        self._rods.batched_colors = new.colors
        self._rods.visible = True

    async def _click(self, event: 'viser.SceneNodePointerEvent[viser.BatchedMeshHandle]') -> None:
        with self._lock:
            if event.instance_index is not None and self._snapshot:
                self._clicked = self._snapshot[event.instance_index % len(self._snapshot)]

    def _show_names(self, snapshot: Snapshot, size: float, with_names: bool) -> None:
        texts = _texts(snapshot, size) if with_names else []
        positions = snapshot.points
        while len(self._names) < len(texts):
            self._names.append(self._scene.add_label(
                f'/names/{len(self._names)}', '', visible=False, anchor='bottom-left'))
            self._texts.append('')
        for i, label in enumerate(self._names):
            text = texts[i] if i < len(texts) else ''
            if text != self._texts[i]:
                self._texts[i] = text
                label.visible = bool(text)
                if text:
                    label.text, label.position = text, positions[i]
        there = [i for i, text in enumerate(self._texts) if text]
        turn = there
        if len(there) > NAMES_AT_ONCE:
            begin = self._next_name % len(there)
            turn = (there[begin:] + there[:begin])[:NAMES_AT_ONCE]
            self._next_name = begin + NAMES_AT_ONCE
        for i in turn:
            self._names[i].position = positions[i]

    def _show_trail(self, lines: NDArray[np.float64]) -> None:
        if not len(lines):
            if self._trail is not None:
                self._trail.visible = False
            return
        age = np.linspace(0.0, 1.0, len(lines) + 1)[:, None]
        along = _TRAIL_FADED + age * (np.array(_TRAIL_COLOUR) - _TRAIL_FADED)
        colours = np.stack([along[:-1], along[1:]], axis=1).astype(np.uint8)
        if self._trail is None:
            self._trail = self._scene.add_line_segments(
                '/trail', lines, colours, thickness=_TRAIL_WIDTH, thickness_units='screen')
            return
        self._trail.points, self._trail.colors = lines, colours
        self._trail.visible = True


def _grid() -> NDArray[np.float64]:
    """Draw a grid in the plane of x and y; viser's own takes most of the time without a GPU."""
    half = _GRID / 2
    places = np.arange(-half, half + _CELL / 2, _CELL)
    along_y = np.array([[(x, -half, 0.0), (x, half, 0.0)] for x in places])
    return np.concatenate([along_y, along_y[..., [1, 0, 2]]])


def _texts(snapshot: Snapshot, size: float) -> list[str]:
    """Write the names of frames; of several that are at one place, beside the first of them."""
    texts = ['' if age >= TIMEOUT else _cut(visible(name))
             for name, age in zip(snapshot.names, snapshot.ages.tolist())]
    beside = list(range(len(texts)))
    for i, (name, parent) in enumerate(zip(snapshot.names, snapshot.parents)):
        if (parent >= 0 and snapshot.frames[name].is_static and texts[i] and texts[parent]
                and np.linalg.norm(snapshot.points[i] - snapshot.points[parent]) < _NEAR * size):
            beside[i] = parent
    for i, text in enumerate(texts):
        if beside[i] != i:
            first = beside[i]
            while beside[first] != first:
                first = beside[first]
            texts[first], texts[i] = f'{texts[first]}, {text}', ''
    return texts


def _cut(name: str) -> str:
    return name if len(name) <= _LONGEST_NAME else f'{name[:_LONGEST_NAME]}…'
