"""The bodies of robots: the shapes of their descriptions, drawn at the frames of their links."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from typing import Any, Optional, Union

import numpy as np
import viser

from puretf_tools.robot.description import Description
from puretf_tools.robot.observed import prefix
from puretf_tools.robot.shapes import Rgba, Shape
from puretf_tools.view.axes_and_trail import Display, rounded
from puretf_tools.view.feed import Descriptions
from puretf_tools.view.meshes import Mesh, MeshError, Meshes
from puretf_tools.view.placement import Placement, REACH
from puretf_tools.view.viser_private import WORLD

#: The largest number of triangles of the meshes of a robot that are drawn.
MAX_TRIANGLES = 5_000_000
#: The side of the box in place of a mesh that is missing (m).
_MISSING_SIZE = 0.1
_DEFAULT: Rgba = (0.66, 0.71, 0.78, 1.0)
_MISSING: Rgba = (0.5, 0.5, 0.5, 1.0)
_COLLISION: Rgba = (0.0, 0.6, 0.55, 0.35)


@dataclass
class _Part:
    link: str
    is_collision: bool
    shapes: list[Shape] = field(default_factory=list)  #: those that are not drawn yet
    node: Any = None  #: moves with the link; None: it was never visible
    pose: Optional[list[float]] = None  #: of the node: x, y, z (m), quaternion x, y, z, w
    drawn: list[tuple[Any, float]] = field(default_factory=list)  #: handles, and their opacity


class _Robot:
    def __init__(self, topic: str, description: Description) -> None:
        self.topic, self.description = topic, description
        self.names: list[str] = []  # the frames for which the prefix was found
        self.prefix, self.found = '', 0  # the number of links that have a frame
        self.problems: dict[str, None] = {}  #: a line for each mesh that cannot be drawn
        self.triangles = 0  # of the meshes that are drawn
        parts: dict[tuple[str, bool], _Part] = {}
        for is_collision, shapes in enumerate((description.visuals, description.collisions)):
            for shape in shapes:
                key = shape.link, bool(is_collision)
                parts.setdefault(key, _Part(*key)).shapes.append(shape)
        self.parts = [*parts.values()]

    def lines(self) -> list[str]:
        description = self.description
        found = (f'{description.name} on {self.topic}: {self.found} of {len(description.links)} '
                 'links have a frame')
        with_prefix = f', with the prefix {self.prefix}' * bool(self.prefix)
        return [found + with_prefix, *description.warnings]


#: A shape that is not drawn yet.
_Waiting = tuple[_Robot, _Part, Shape]


class Body:
    """The bodies in the scene of one viewer or of all."""

    #: How much one call of `show` adds (bytes): at 800 kbit/s, frames wait for a second.
    at_a_time = 100_000

    def __init__(self, scene: viser.SceneApi, meshes: Meshes, on_click: Callable[[str], object],
                 put: Callable[..., object]) -> None:
        """
        Draw nothing yet.

        :param on_click: called with the name of a frame when a shape there is clicked.
        :param put: called with a node and its pose, to show it there.
        """
        self._scene, self._meshes, self._on_click, self._put = scene, meshes, on_click, put
        self._descriptions: Descriptions = {}
        self._robots: dict[str, _Robot] = {}  # by topic
        # The name of a node must not depend on that of its link, which can have slashes.
        self._node_numbers = count()
        self.progress: Sequence[str] = ()  #: a text while there are meshes that are not drawn yet
        self._opacity = 1.0

    def show(self, descriptions: Descriptions, placement: Placement, display: Display) -> None:
        if descriptions != self._descriptions:
            self._replace(descriptions)
        if not self._robots:
            return
        if display.opacity != self._opacity:
            self._opacity = display.opacity
            for handle, own in [each for robot in self._robots.values() for part in robot.parts
                                for each in part.drawn]:
                handle.opacity = _opacity(own * display.opacity)
        rows = rounded(np.column_stack([placement.points, placement.poses[:, 3:]])).tolist()
        far, waiting = {*placement.far}, list[_Waiting]()
        poses = {name: row for name, row in zip(placement.names, rows) if name not in far}
        for robot in self._robots.values():
            if robot.names != placement.names:
                robot.names = placement.names
                robot.prefix, robot.found = prefix(
                    robot.topic, robot.description.root, robot.description.links,
                    {*placement.names})
            for part in robot.parts:
                frame = robot.prefix + part.link
                is_on = display.with_collisions if part.is_collision else display.with_visuals
                if is_on and frame in poses:
                    self._place(part, poses[frame])
                    waiting += [(robot, part, shape) for shape in part.shapes]
                elif part.node:
                    part.node.visible = False
        self._add_some(waiting)
        left = sum(shape.kind == 'mesh' for *_, shape in waiting)
        self.progress = [f'meshes to come: {left}'] * (left > 0)

    def lines(self) -> tuple[list[str], list[str]]:
        """Return what the panel says of descriptions, and of each mesh that cannot be drawn."""
        return [line for topic, each in self._descriptions.items() for line in (
            [f'{topic}: {each}'] if isinstance(each, str) else self._robots[topic].lines())], [
            line for robot in self._robots.values() for line in robot.problems]

    def _replace(self, descriptions: Descriptions) -> None:
        for topic, robot in [*self._robots.items()]:
            if descriptions.get(topic) is not robot.description:
                for part in robot.parts:
                    if part.node:
                        part.node.remove()
                del self._robots[topic]
        for topic, description in descriptions.items():
            if isinstance(description, Description) and topic not in self._robots:
                self._robots[topic] = _Robot(topic, description)
        self._descriptions = descriptions

    def _place(self, part: _Part, pose: list[float]) -> None:
        if not part.node:
            part.node = self._scene.add_frame(
                f'{WORLD}/robots/{next(self._node_numbers)}', show_axes=False, visible=False)
        if pose != part.pose or not part.node.visible:
            part.pose = pose
            *position, x, y, z, w = pose
            self._put(part.node, position, (w, x, y, z))

    def _add_some(self, waiting: list[_Waiting]) -> None:
        """Add shapes, the largest last: while others are being loaded, it waits for them."""
        found = [(self._meshes.get(shape.file) if shape.kind == 'mesh' else None, robot, part,
                  shape) for robot, part, shape in waiting]
        ready = [each for each in found if each[0] or each[3].kind != 'mesh']
        left = self.at_a_time
        for mesh, robot, part, shape in sorted(ready, key=lambda each: _bytes(each[0])):
            if (size := _bytes(mesh)) > left and (
                    left < self.at_a_time or len(ready) < len(found)):
                break
            left -= size
            self._add(shape, mesh, robot, part)

    def _add(self, shape: Shape, mesh: Union[Mesh, MeshError, None], robot: _Robot, part: _Part
             ) -> None:
        part.shapes.remove(shape)
        kind, size, rgba = shape.kind, _within_reach(shape.size), shape.rgba or _DEFAULT
        if isinstance(mesh, Mesh):
            rgba = shape.rgba or mesh.rgba or _DEFAULT
            robot.triangles += len(mesh.faces)
            if robot.triangles > MAX_TRIANGLES:
                mesh = MeshError(
                    f'the robot has more than {MAX_TRIANGLES} triangles: simplify its meshes')
        if isinstance(mesh, MeshError):
            robot.problems[f'link {shape.link}: {shape.file}: {mesh}'] = None
            kind, size, rgba = 'box', [_MISSING_SIZE] * 3, _MISSING
        red, green, blue, alpha = _COLLISION if part.is_collision else rgba
        x, y, z, w = shape.pose[3:]
        name = f'{part.node.name}/{len(part.drawn)}'
        common: dict[str, Any] = {
            'color': (red, green, blue), 'opacity': _opacity(alpha * self._opacity),
            'wxyz': (w, x, y, z), 'position': _within_reach(shape.pose[:3])}
        if isinstance(mesh, Mesh):
            handle = self._scene.add_mesh_simple(
                name, mesh.vertices, mesh.faces, scale=(*size,), flat_shading=True,
                side='double', **common)
        elif kind == 'box':
            handle = self._scene.add_box(name, dimensions=(*size,), **common)
        elif kind == 'cylinder':
            handle = self._scene.add_cylinder(name, radius=size[0], height=size[1], **common)
        else:
            handle = self._scene.add_icosphere(name, radius=size[0], **common)
        handle.on_click(partial(self._click, robot, part))
        part.drawn.append((handle, alpha))

    async def _click(self, robot: _Robot, part: _Part, _: Any) -> None:
        self._on_click(robot.prefix + part.link)


def _bytes(mesh: Union[Mesh, MeshError, None]) -> int:
    """Return about how many bytes a viewer is sent of a shape."""
    return mesh.vertices.nbytes + mesh.faces.nbytes if isinstance(mesh, Mesh) else 1000


def _opacity(value: float) -> Optional[float]:
    """Return an opacity for viser, to which an opaque shape has none."""
    return value if value < 1.0 else None


def _within_reach(values: Sequence[float]) -> list[float]:
    """Clamp numbers, since a browser computes in float32."""
    return [min(max(value, -REACH), REACH) for value in values]
