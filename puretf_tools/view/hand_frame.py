"""A static frame that a viewer places by hand: its controls, its handles, and texts to copy."""

from collections.abc import Iterable
from math import degrees, radians
from typing import Any, Optional

import viser

from puretf import Transform
from puretf._text.names import is_too_long, shortened
from puretf._text.similar_names import suggest_names
from puretf.rotations import euler_from_quaternion, Quaternion, quaternion_from_euler
from puretf_tools.inspection.forest import self_and_ancestors
from puretf_tools.view.controls import change, Choice, copied, FrameChoice, html
from puretf_tools.view.details import command_line
from puretf_tools.view.feed import HandPublisher
from puretf_tools.view.placement import Placement, REACH
from puretf_tools.view.viser_private import HANDLES

Vector = tuple[float, float, float]
#: The size of the handles (m).
_SIZE = 0.3
#: Numbers are rounded to these digits: 1 mm, 0.01°.
_DIGITS, _ANGLE_DIGITS = 3, 2
_ZERO: Vector = (0.0, 0.0, 0.0)


class HandFrame:
    """
    A static frame that a viewer places by hand.

    Callbacks run in the thread of viser. They store what viewers set, and keep the numbers and the
    handles equal.
    """

    def __init__(self, gui: viser.GuiApi, scene: viser.SceneApi,
                 publisher: Optional[HandPublisher] = None) -> None:
        """Add the controls to the current container; `publisher`: None for a bag."""
        self._publisher = publisher
        self._published: Optional[Transform] = None
        self._name = ''
        #: By the name and the parent that were refused last: why.
        self._refusal: dict[tuple[str, str], str] = {}
        #: In the parent: x, y, z (m), roll, pitch, yaw (degrees), and these as a quaternion.
        self._pose: tuple[Vector, Vector, Quaternion] = _ZERO, _ZERO, (0.0, 0.0, 0.0, 1.0)
        gui.add_text('New frame', '').on_update(self._on_name)
        self.parent = FrameChoice(gui, 'Parent')
        self._position = gui.add_vector3(
            'x, y, z (m)', _ZERO, min=(-REACH,) * 3, max=(REACH,) * 3, step=10.0**-_DIGITS)
        self._angles = gui.add_vector3('RPY (°)', _ZERO, step=10.0**-_ANGLE_DIGITS)
        for control in self._position, self._angles:
            control.on_update(self._on_numbers)
        self._is_on = Choice(gui.add_checkbox('Publish', False, visible=publisher is not None))
        self._text = gui.add_html('')
        self._parent_node = scene.add_frame(HANDLES.rpartition('/')[0], show_axes=False)
        self._handles = scene.add_transform_controls(
            HANDLES, _SIZE, depth_test=False, visible=False)
        self._handles.on_update(self._on_drag)

    async def _on_name(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None and (name := event.target.value.strip()) != self._name:
            # What is typed letter by letter must not be published.
            self._is_on.choose(False)
            self._name = name

    async def _on_numbers(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._set_pose(self._position.value, self._angles.value)
            self._handles.position, _, (x, y, z, w) = self._pose
            self._handles.wxyz = w, x, y, z

    async def _on_drag(self, event: 'viser.TransformControlsEvent') -> None:
        if event.phase == 'update':
            w, x, y, z = event.target.wxyz.tolist()
            roll, pitch, yaw = map(degrees, euler_from_quaternion((x, y, z, w)))
            self._set_pose(event.target.position.tolist(), (roll, pitch, yaw))

    def _set_pose(self, position: Iterable[float], angles: Iterable[float]) -> None:
        x, y, z = (round(value, _DIGITS) + 0.0 for value in position)
        roll, pitch, yaw = (round(angle, _ANGLE_DIGITS) + 0.0 for angle in angles)
        self._pose = (x, y, z), (roll, pitch, yaw), quaternion_from_euler(
            radians(roll), radians(pitch), radians(yaw))
        self._position.value, self._angles.value, _ = self._pose

    def update(self, placement: Placement) -> None:
        """Move the handles with the parent, publish what has changed, and show the texts."""
        if self._is_on.value and self.parent.value:
            # The proposal may change, but the parent of a published frame must not.
            self.parent.choose(self.parent.value)
        self.parent.propose(placement.fixed)
        name, parent, (position, angles, rotation) = self._name, self.parent.value, self._pose
        transform = Transform(0, parent, name, position, rotation)
        if (point := placement.point(parent)) is not None:
            x, y, z, w = placement.poses[placement.names.index(parent), 3:]
            self._parent_node.position, self._parent_node.wxyz = point, (w, x, y, z)
        self._handles.visible = bool(name) and point is not None
        problem = _problem(transform, placement)
        if self._publisher:
            self._publish(transform, problem, self._publisher)
        elif name in placement.frames:
            problem = f'the bag has a frame {name} already'
        shown = self._refusal.get((name, parent)) or (problem if name else '')
        numbers = zip(('x', 'y', 'z', 'roll', 'pitch', 'yaw'), (*position, *map(radians, angles)))
        change(self._text, content=html(shown, 'hand') + ('' if problem else copied(
            command_line(parent, name, numbers), 'command')))

    def _publish(self, transform: Transform, problem: str, publisher: HandPublisher) -> None:
        """Send a transform that has changed; a refusal switches 'Publish' off."""
        if self._is_on.value and transform != self._published:
            if why := problem or publisher.send(transform, self):
                self._is_on.choose(False)
                why = f'not published: {why}'
            else:
                self._published = transform
            self._refusal = {(transform.child_frame_id, transform.frame_id): why}
        if not self._is_on.value:
            self.stop()
        self._is_on.propose(False)

    def stop(self) -> None:
        if self._publisher and self._published:
            self._publisher.stop(self._published.child_frame_id)
            self._published = None


def _problem(transform: Transform, placement: Placement) -> str:
    """Return why a transform cannot be published, whoever publishes its frame; '' if it can."""
    parent, name = transform.frame_id, transform.child_frame_id
    if not name:
        return 'the new frame has no name'
    if any(is_too_long(each) or not each.isprintable() for each in (name, parent)):
        return 'the names of both frames must be printable, and at most 1024 bytes long'
    if name.startswith('/'):
        return f'the name {name} begins with a slash, which tf2 does not allow'
    if parent not in placement.names:
        return (f'the parent {shortened(parent)} does not exist. '
                f'{suggest_names(parent, tuple(placement.names))}' if parent else
                'choose a parent')
    if name in self_and_ancestors(parent, placement.frames):
        return f'frame {name} is above {parent}, or the same: there would be a loop'
    return ''
