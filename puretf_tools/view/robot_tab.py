"""The tab of a robot: its description, and sliders for its joints."""

from collections.abc import Sequence
from functools import partial
from itertools import islice
from math import degrees
from typing import Any, Optional

import viser

from puretf._text.names import abbreviated, visible
from puretf_tools.robot.description import Joint
from puretf_tools.robot.joint_positions import bounds, JointPositions
from puretf_tools.robot.joint_senders import JointControl, JointControls
from puretf_tools.view.controls import change, escaped, html

_MOST_LINES, _LONGEST_LINE = 30, 500
#: The largest number of sliders.
_SLIDERS = 200
_LONGEST_NAME = 40  # characters
_CENTRE, _WAVE = 'Centre', 'Wave'
#: Positions are rounded to so many digits: 0.1 mm and 0.1 degrees.
_DIGITS, _ANGLE_DIGITS = 4, 1


def _joined(lines: Sequence[str]) -> str:
    rest = len(lines) - _MOST_LINES
    return '<br>'.join(escaped(abbreviated(line, _LONGEST_LINE)) for line in [
        *lines[:_MOST_LINES], *[f'and {rest} more lines'] * (rest > 0)])


class _Slider:
    def __init__(self, gui: viser.GuiApi, joint: Joint, position: float) -> None:
        self.joint, is_linear = joint, joint.kind == 'prismatic'
        self.scale = 1.0 if is_linear else degrees(1.0)
        self._digits = _DIGITS if is_linear else _ANGLE_DIGITS
        lower, upper = (self._rounded(bound) for bound in bounds(joint))
        self.shown = self._rounded(position)
        name, unit = abbreviated(joint.name, _LONGEST_NAME), 'm' if is_linear else '°'
        self.handle = gui.add_slider(
            f'{visible(name)} ({unit})', lower, upper, 10.0**-self._digits, self.shown)

    def _rounded(self, position: float) -> float:
        return round(position * self.scale, self._digits)

    def show(self, position: float) -> None:
        if self.shown != (value := self._rounded(position)):
            self.handle.value = self.shown = value


class RobotTab:
    """Lines about descriptions and meshes, and the sliders for the joints of one robot."""

    def __init__(self, gui: viser.GuiApi, container: Any, source: JointControls) -> None:
        self._gui, self._container, self._source = gui, container, source
        with container:
            self._text = gui.add_html('', order=1e9)  # below all joints
            self._status = gui.add_html('')
            self._choice = gui.add_dropdown('Joints of', ('',), visible=False)
            self._moves = gui.add_button_group('Move', (_CENTRE,), visible=False)
        self._moves.on_click(self._on_move)
        self._control: Optional[JointControl] = None  # the one that is shown
        self._sliders: list[_Slider] = []
        self._shown: Optional[JointPositions] = None  # what the sliders belong to

    @property
    def _chosen(self) -> Optional[JointControl]:
        return next((control for control in self._source.controls
                     if control.topic == self._choice.value), None)

    async def _on_move(self, event: 'viser.GuiEvent[Any]') -> None:
        if control := self._chosen:
            (control.centre if event.target.value == _CENTRE else control.wave)()

    async def _on_slider(self, slider: _Slider, event: 'viser.GuiEvent[Any]') -> None:
        # The robot of the sliders may have left since they were shown.
        control = self._control
        if event.client_id is not None and control and control in self._source.controls:
            slider.shown = event.target.value
            control.set(slider.joint.name, slider.shown / slider.scale)

    def update(self, lines: Sequence[str], folded_lines: Sequence[str]) -> None:
        """Show lines of text, and folded ones; and the joints, which move at once."""
        shown, folded = _joined(lines), _joined(folded_lines)
        if folded:
            shown += f'<details><summary>meshes that are not drawn</summary>{folded}</details>'
        change(self._text, content=f'<div class="tf-text" data-text="robot">{shown}</div>')
        topics = tuple(control.topic for control in self._source.controls)
        change(self._choice, options=topics or ('',), visible=len(topics) > 1)
        control = self._control = self._chosen
        change(self._moves, visible=control is not None,
               options=(_CENTRE, *[_WAVE] * bool(control and control.can_wave)))
        self._show(control.positions if control else None)
        text = self._source.why_none
        if control:
            text = self._source.warning or f'The positions are sent on {control.topic}.'
        if control and (rest := len(control.positions.free) - _SLIDERS) > 0:
            text += f' {rest} more joints have no slider.'
        change(self._status, content=html(text, 'joints'))

    def _show(self, positions: Optional[JointPositions]) -> None:
        if self._shown is not positions:
            self._shown = positions
            for slider in self._sliders:
                slider.handle.remove()
            with self._container:
                self._sliders = [
                    _Slider(self._gui, joint, positions[joint.name])
                    for joint in islice(positions.free.values(), _SLIDERS)] if positions else []
            for slider in self._sliders:
                slider.handle.on_update(partial(self._on_slider, slider))
        for slider in self._sliders:
            if positions:
                slider.show(positions[slider.joint.name])
