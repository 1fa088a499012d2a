"""The sliders in the panel, with which viewers move the joints of a robot."""

from collections import deque
from collections.abc import Mapping
from itertools import islice
from math import degrees, floor, log10
from typing import Any, Optional

import viser

from puretf import abbreviated, visible
from puretf_tools.robot.description import Joint
from puretf_tools.robot.joint_positions import bounds, JointPositions
from puretf_tools.robot.joint_senders import JointControl, JointControls
from puretf_tools.view.controls import change
from puretf_tools.view.details import html

#: The largest number of sliders, and the time between two updates (s).
_SLIDERS, _PERIOD = 200, 0.1
_LONGEST_NAME = 40  # characters
#: A slider has about this power of ten of steps.
_STEPS = 4


class _Slider:
    """The slider of a joint, in m or degrees."""

    def __init__(self, gui: viser.GuiApi, joint: Joint, position: float) -> None:
        self.joint, is_linear = joint, joint.kind == 'prismatic'
        self._scale = 1.0 if is_linear else degrees(1.0)
        lower, upper = (bound * self._scale for bound in bounds(joint))
        width = upper - lower if upper - lower > 1e-9 else 1.0
        self._digits = max(0, _STEPS - 1 - floor(log10(width)))
        self.shown = self._rounded(position)
        name, unit = abbreviated(joint.name, _LONGEST_NAME), 'm' if is_linear else '°'
        self.handle = gui.add_slider(
            f'{visible(name)} ({unit})', round(lower, self._digits),
            round(upper, self._digits), 10.0**-self._digits, self.shown)

    def _rounded(self, position: float) -> float:
        return round(position * self._scale, self._digits)

    def position(self, value: float) -> float:
        """Return the position (rad or m) of a value."""
        return value / self._scale

    def show(self, position: float) -> None:
        if self.shown != (value := self._rounded(position)):
            self.handle.value = self.shown = value


class Joints:
    """
    The sliders for the joints of one robot.

    Callbacks run in the thread of viser. They store what the viewer does until the next update.
    """

    def __init__(self, gui: viser.GuiApi, container: Any, source: JointControls) -> None:
        """Add the controls to a tab or a folder."""
        self._gui, self._container, self._source = gui, container, source
        with container:
            self._status = gui.add_html('')
            self._choice = gui.add_dropdown('Joints of', ('',), visible=False)
            self._centre = gui.add_button('Centre', visible=False)
            self._wave = gui.add_button('Wave', visible=False)
        for button in self._centre, self._wave:
            button.on_click(self._on_event)
        self._control: Optional[JointControl] = None  # the one that is shown
        self._sliders: list[_Slider] = []
        self._shown: Optional[JointPositions] = None  # what the sliders belong to
        self._next = 0.0
        #: What the viewer has done since the last update: the handle, its value, and the topic of
        #: the robot that was chosen.
        self._actions: deque[tuple[Any, Any, str]] = deque()

    async def _on_event(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._actions.append((event.target, event.target.value, self._choice.value))

    def act(self) -> None:
        """Do what the viewer wants."""
        if self._actions:
            self._act({control.topic: control for control in self._source.controls})

    def update(self, now: float) -> None:
        """Do what the viewer wants, and show the positions; `now`: on the monotonic clock (s)."""
        self.act()
        if now < self._next:
            return
        self._next = now + _PERIOD
        controls = {control.topic: control for control in self._source.controls}
        change(self._choice, options=(*controls,) or ('',), visible=len(controls) > 1)
        control = self._control = controls.get(self._choice.value)
        change(self._centre, visible=control is not None)
        change(self._wave, visible=control is not None and control.can_wave)
        self._show(control.positions if control else None)
        text = self._source.why_none
        if control:
            text = control.warning or f'The positions are sent on {control.topic}.'
        if control and (rest := len(control.positions.free) - _SLIDERS) > 0:
            text += f' {rest} more joints have no slider.'
        change(self._status, content=html(text, 'joints'))

    def _act(self, controls: Mapping[str, JointControl]) -> None:
        while self._actions:
            target, value, topic = self._actions.popleft()
            chosen, shown = controls.get(topic), self._control
            if target is self._centre and chosen:
                chosen.centre()
            elif target is self._wave and chosen:
                chosen.wave()
            for slider in self._sliders:
                # The robot of the sliders may have left since they were shown.
                if target is slider.handle and shown and controls.get(shown.topic) is shown:
                    slider.shown = float(value)
                    shown.set(slider.joint.name, slider.position(slider.shown))

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
                slider.handle.on_update(self._on_event)
        for slider in self._sliders:
            if positions:
                slider.show(positions[slider.joint.name])
