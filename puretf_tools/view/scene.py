"""The scene: a grid, a trail, and the frames (their axes, names and lines to the parents)."""

from collections.abc import Callable, Collection
from functools import partial
from itertools import count
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import NDArray
import viser

from puretf._text.names import comma_list, shortened
from puretf.rotations import euler_from_quaternion
from puretf_tools.inspection.forest import descend
from puretf_tools.view.axes_and_trail import axes, Display, lines, Pieces, rounded
from puretf_tools.view.body import Body
from puretf_tools.view.camera import page_size
from puretf_tools.view.feed import Descriptions, LENGTH
from puretf_tools.view.meshes import Meshes
from puretf_tools.view.placement import Floats, Placement
from puretf_tools.view.viser_private import set_pose, WORLD

#: If there are more frames, their names are not shown until a viewer wants them.
MOST_NAMES = 50
_LONGEST_NAME = 40  # characters
#: The width of a letter of a label, and half the height of a label (pixels).
_LETTER, _HALF_LINE = 7.0, 8.0
_AXIS_RADIUS = 0.05  # of an axis, as a fraction of its length
_CELLS, _CELL = 20, 0.5  # the number of cells along each side of the grid, and their side (m)
#: Red, green, blue: the background, the grid, and lines to parents; of a light and a dark page.
_GREYS = np.array([[[255] * 3, [220] * 3, [150] * 3], [[20] * 3, [56] * 3, [125] * 3]])
_TRAIL, _PAIR = np.array([[200, 60, 200], [0, 150, 160]])
#: Of lines (pixels).
_THIN, _TRAIL_WIDTH, _PAIR_WIDTH = 1.0, 3.0, 4.0
#: A click selects a frame if it is this near to an axis (pixels).
_TARGET = 10.0
#: If a static frame is closer to its parent than this (as a fraction of the length of an axis),
#: one label shows both names, since two labels would overlap.
_NEAR = 0.34
#: The text of a label, and its position (x, y, z; m).
_Label = tuple[str, Floats]


class Scene:
    """The three-dimensional view of the frames, of one viewer or of all."""

    def __init__(self, owner: Union[viser.ClientHandle, viser.ViserServer], meshes: Meshes,
                 send: Callable[[str, str], object] = lambda action, name: None) -> None:
        """Draw nothing yet; `send`: called with 'select' or 'pair' when a frame is clicked."""
        self._scene, self._owner = owner.scene, owner
        #: Everything is drawn in this node; its yaw (rad) and its position in the scene (m).
        self._world = owner.scene.add_frame(WORLD, show_axes=False)
        self._yaw, self._shift = 0.0, np.zeros(3)
        #: The frame that stays where it is in the scene, whether it is followed, and with its yaw;
        #: its position (m) and yaw (rad) there.
        self._staying = '', False, False
        self._held = np.zeros(3), 0.0
        self._axes = owner.scene.add_batched_axes(
            f'{WORLD}/frames', np.eye(1, 4), np.zeros((1, 3)), np.zeros(1), visible=False)
        #: By name: the grid, lines to the parents, the line between a pair, pieces of the trail.
        self._segments: dict[str, viser.LineSegmentsHandle] = {}
        self._grid = _grid()
        #: By the name of their frame: the labels, of which some are not visible. None is used for
        #: another frame: a slow browser would show it with the old text for a moment.
        self._labels: dict[str, viser.LabelHandle] = {}
        self._label_numbers = count()
        self._moves: list[tuple[Any, ...]] = []
        #: The last placement, how it was drawn, and the labels; None: nothing has been drawn.
        self.shown: Optional[tuple[Placement, Display, dict[str, _Label]]] = None
        self._send = send
        self.body = Body(self._scene, meshes, partial(send, 'select'), self._put)
        if isinstance(owner, viser.ClientHandle):
            owner.scene.on_click()(partial(self._on_click, 'select'))
            owner.scene.on_click(modifier='shift')(partial(self._on_click, 'pair'))

    def show(self, placement: Placement, display: Display, selected: str,
             trail: Pieces, descriptions: Descriptions, follow: str = '', with_yaw: bool = False,
             pair: Collection[str] = ()) -> None:
        """
        Show frames, a trail, and the bodies of robots, but do not `move` names and bodies yet.

        A browser draws what `move` sends in the next picture, and all else one picture later.

        :param follow: the frame that stays where it is in the scene; '': the fixed frame does.
        :param with_yaw: whether it keeps its yaw, too.
        :param pair: two frames that a line connects; or none.
        """
        with self._owner.atomic():
            self._move_world(placement, follow, with_yaw)
            background, grid, line = _GREYS[int(display.is_dark)]
            self._show_segments('grid', self._grid, grid, _THIN, display.with_grid)
            self._move_grid(placement.point(follow))
            self._show_axes(*axes(placement, display, selected), display)
            self._show_segments('lines', lines(placement, display), line, _THIN,
                                display.with_lines)
            self._show_names(placement, display, selected)
            ends = [point for name in pair if (point := placement.point(name)) is not None]
            self._show_segments(
                'pair', rounded(np.array([ends])), _PAIR, _PAIR_WIDTH, len(ends) == 2)
            self._show_trail(trail, background)
            self.body.show(descriptions, placement, display)

    def _put(self, node: viser.SceneNodeHandle, position: Any, wxyz: Any = None) -> None:
        """Let `move` set the pose of a node; if it is not visible yet, show it there at once."""
        if node.visible:
            self._moves.append((node, position, wxyz))
        else:
            set_pose(node, position, wxyz)
            node.visible = True

    def move(self) -> None:
        """Move names and bodies to where the last call of `show` has drawn the frames."""
        with self._owner.atomic():
            for each in self._moves:
                set_pose(*each)
        self._moves.clear()

    def in_scene(self, points: Floats) -> Floats:
        """Return where points (n, 3) of a placement are in the scene (m)."""
        turn = viser.transforms.SO3.from_z_radians(self._yaw)
        return np.asarray(turn.apply(points)) + self._shift

    def _pixels(self, points: Floats, camera: viser.CameraHandle) -> Floats:
        """Return where a camera sees points (n, 3): column, row (pixels), depth (m)."""
        # The camera looks along its z axis; its y axis points down (as in viser's documentation).
        x, y, z = viser.transforms.SO3(camera.wxyz).inverse().apply(
            self.in_scene(points) - camera.position).T
        width, height = page_size(camera)
        focal = height / 2 / np.tan(camera.fov / 2)
        with np.errstate(all='ignore'):
            return np.column_stack([width / 2 + focal * x / z, height / 2 + focal * y / z, z])

    def seen(self, placement: Placement, names: Collection[str]) -> Floats:
        """Return where frames are in the scene (m): (n, 3)."""
        return self.in_scene(placement.points[[name in names for name in placement.names]])

    def _move_world(self, placement: Placement, follow: str, with_yaw: bool) -> None:
        """Let a frame stay where it is in the scene: one that is followed, or the fixed one."""
        point, yaw = placement.point(follow) if follow else -placement.origin, 0.0
        if point is None:
            return
        if follow and with_yaw:
            *_, yaw = euler_from_quaternion(
                (*placement.poses[placement.names.index(follow), 3:].tolist(),))
        before, staying = (self._yaw, *self._shift), (
            follow or placement.fixed, bool(follow), with_yaw)
        if self._staying != staying:
            self._staying, self._held = staying, (self.in_scene(point[None])[0], self._yaw + yaw)
        place, heading = self._held
        self._yaw = heading - yaw
        self._shift = self._shift + place - self.in_scene(point[None])[0]
        if follow or before != (self._yaw, *self._shift):
            x, y, z = self._shift.tolist()
            turn = viser.transforms.SO3.from_z_radians(self._yaw)
            self._put(self._world, (x, y, z), (*turn.wxyz.tolist(),))

    def _show_axes(self, positions: Floats, wxyzs: Floats, scales: Floats, display: Display
                   ) -> None:
        self._axes.visible = display.with_axes and len(positions) > 0
        if self._axes.visible:
            self._axes.axes_length = display.size
            self._axes.axes_radius = display.size * _AXIS_RADIUS
            self._axes.batched_positions = positions.astype(np.float32)
            self._axes.batched_wxyzs = wxyzs.astype(np.float32)
            self._axes.batched_scales = scales.astype(np.float32)

    def _move_grid(self, followed: Optional[Floats]) -> None:
        """Keep the lines of the grid where they are, and a followed frame within its middle."""
        x, y, _ = (0.0, 0.0, 0.0) if followed is None else _CELL * np.round(followed / _CELL)
        grid, place = self._segments.get('grid'), (float(x), float(y), 0.0)
        if grid and grid.visible and place != (*grid.position.tolist(),):
            self._put(grid, place)

    def _show_segments(self, name: str, points: Floats, colour: NDArray[Any], width: float,
                       are_visible: bool = True) -> None:
        """Show or hide line segments: (n, 2, 3), both ends."""
        segments, colour = self._segments.get(name), colour.astype(np.uint8)
        if not are_visible or not len(points):
            if segments:
                segments.visible = False
        elif segments:
            segments.points, segments.colors = points.astype(np.float32), colour
            segments.visible = True
        else:
            self._segments[name] = self._scene.add_line_segments(
                f'{WORLD}/{name}', points, colour, thickness=width, thickness_units='screen')

    async def _on_click(self, action: str, event: viser.SceneClickEvent) -> None:
        x, y = np.multiply(event.screen_pos, page_size(event.client.camera))
        if name := self._at(x, y, event.client.camera):
            self._send(action, name)

    def _at(self, x: float, y: float, camera: viser.CameraHandle) -> str:
        """Return the frame whose name or axes are drawn at a pixel; '' if there is none."""
        if self.shown is None:
            return ''
        placement, display, labels = self.shown
        for name, (text, place) in labels.items():
            (left, bottom, depth), = self._pixels(place[None], camera)
            if (depth > 0.0 and 0.0 <= x - left <= _LETTER * (len(text) + 2)
                    and 0.0 <= bottom - y <= 2 * _HALF_LINE):
                return name
        positions, wxyzs, scales = axes(placement, display)
        if not display.with_axes or not scales.any():
            return ''
        # (n, 3, 9, 3): points along the axes.
        along = viser.transforms.SO3(wxyzs).as_matrix().swapaxes(1, 2)[:, :, None] * np.linspace(
            0.0, display.size, 9)[:, None]
        points = (positions[:, None, None] + along).reshape(-1, 3)
        *places, depths = self._pixels(points, camera).T
        distances = np.where((depths > 0.0) & np.repeat(scales > 0.0, 27),
                             np.hypot(places[0] - x, places[1] - y), np.inf)
        best = int(distances.argmin())
        return placement.names[best // 27] if distances[best] <= _TARGET else ''

    def _show_names(self, placement: Placement, display: Display, selected: str) -> None:
        shown = _labels(placement, display) if display.with_names else {}
        if isinstance(self._owner, viser.ClientHandle):
            # Names that are shown stay, so that they do not flicker.
            first = [selected, *(name for name, label in self._labels.items() if label.visible)]
            ordered = {**{name: shown[name] for name in first if name in shown}, **shown}
            shown = self._without_overlap(ordered, self._owner.camera)
        self.shown = placement, display, shown
        for name in self._labels.keys() - shown.keys():
            self._labels[name].visible = False
        for name in self._labels.keys() - {*placement.names}:
            self._labels.pop(name).remove()
        for name, (text, position) in shown.items():
            if name not in self._labels:
                self._labels[name] = self._scene.add_label(
                    f'{WORLD}/names/{next(self._label_numbers)}', text, visible=False,
                    anchor='bottom-left')
            label = self._labels[name]
            label.text = text
            x, y, z = position.tolist()
            if not label.visible or (x, y, z) != (*label.position.tolist(),):
                self._put(label, (x, y, z))

    def _without_overlap(self, labels: dict[str, _Label], camera: viser.CameraHandle
                         ) -> dict[str, _Label]:
        """Leave out labels that would cover earlier ones, as seen by a camera."""
        places = np.array([place for _, place in labels.values()]).reshape(-1, 3)
        taken, kept = set[tuple[float, float]](), {}
        for (name, label), (x, y, depth) in zip(
                labels.items(), self._pixels(places, camera).tolist()):
            cells = {(x // _LETTER + i, y // _HALF_LINE - j) for i in range(len(label[0]) + 2)
                     for j in range(3) if depth > 0.0}  # none behind the camera
            if taken.isdisjoint(cells):
                taken |= cells
                kept[name] = label
        return kept

    def _show_trail(self, trail: Pieces, background: NDArray[Any]) -> None:
        for name in [name for name in self._segments if name.startswith('trail/')]:
            if int(name[6:]) not in trail:
                self._segments.pop(name).remove()
        newest = max(trail, default=0)
        for number, points in trail.items():
            age = (newest - number) / (LENGTH + 1)
            self._show_segments(f'trail/{number}', points, _TRAIL + age * (background - _TRAIL),
                                _TRAIL_WIDTH)


def _grid() -> Floats:
    """
    Return the lines of a grid: (n, 2, 3), two ends, x, y, z (m).

    Without a GPU, drawing viser's own grid would take most of the time.
    """
    half = _CELLS * _CELL / 2
    places = np.linspace(-half, half, _CELLS + 1)
    along_y = np.array([[(x, -half, 0.0), (x, half, 0.0)] for x in places])
    return np.concatenate([along_y, along_y[..., [1, 0, 2]]])


def _labels(placement: Placement, display: Display) -> dict[str, _Label]:
    """Return the labels of frames; a static frame at its parent is in the label of the parent."""
    shown, frames = display.shown(placement), placement.frames
    points = dict(zip(placement.names, rounded(placement.points)))

    def label_of(name: str, above: str) -> str:
        parent = frames[name].parent
        return above if frames[name].is_static and {name, parent} <= shown and np.linalg.norm(
            points[name] - points[parent]) < _NEAR * display.size else name

    labels = descend(frames, {
        name: name for name in placement.names if name not in frames}, label_of)
    texts: dict[str, list[str]] = {}
    for name in dict.fromkeys([*labels, *placement.names]):  # parents first
        if name in shown:
            texts.setdefault(labels.get(name, name), []).append(shortened(name, _LONGEST_NAME))
    return {name: (comma_list(names, shown=2), points[name])
            for name, names in texts.items()}
