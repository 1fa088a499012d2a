"""The controls of a bag: pause, time, speed and step, and the findings of `tf_doctor`."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from math import ceil
from typing import Any

import viser

from puretf import visible
from puretf_tools.view.controls import within
from puretf_tools.view.details import html
from puretf_tools.view.feed import Player

#: The step of the time slider (s).
_TIME_STEP = 0.01
#: The labels of the speeds, from 0.1 to 10 times that of the recording, and of the steps (s).
_SPEEDS = '0.1', '0.2', '0.5', '1', '2', '5', '10'
_STEPS = '-0.1', '-0.01', '+0.01', '+0.1'
#: Of more requests between two updates, only the last ones are carried out.
_MOST_REQUESTS = 100
_MOST_FINDINGS = 20


class Playback:
    """
    The controls of a bag; all viewers share them.

    The callbacks of the controls store what viewers request, and `update` carries it out: it can
    overwrite the values of the controls, and it runs in another thread.
    """

    def __init__(self, gui: viser.GuiApi, player: Player,
                 findings: Sequence[tuple[str, int]] = ()) -> None:
        """
        Create the controls.

        :param findings: lines of text, each with its time (ns; 0: none). Once there are some, they
            are shown by the next update, and do not change any more.
        """
        self._gui, self._player, self._findings = gui, player, findings
        self._requests: deque[Callable[[], object]] = deque(maxlen=_MOST_REQUESTS)
        self._length = max(_TIME_STEP, ceil(player.length / _TIME_STEP) * _TIME_STEP)
        has_time = player.length > 0.0
        self._pause = gui.add_checkbox('Pause', False, visible=has_time)
        self._time = gui.add_slider('Time (s)', 0.0, self._length, _TIME_STEP, 0.0,
                                    visible=has_time)
        self._time.on_update(self._on_time)
        speed = gui.add_dropdown('Speed', _SPEEDS, initial_value='1', visible=has_time)
        speed.on_update(self._on_speed)
        step = gui.add_button_group('Step (s)', _STEPS, visible=has_time)
        step.on_click(self._on_step)
        self._folder = gui.add_folder('Findings of tf_doctor', expand_by_default=False,
                                      visible=False)

    async def _on_time(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._requests.append(
                partial(self._player.seek, within(event.target.value, 0.0, self._length)))

    async def _on_speed(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            if event.target.value in _SPEEDS:
                self._player.speed = float(event.target.value)
            else:  # a viewer has sent what the dropdown does not offer
                event.target.value = f'{self._player.speed:g}'

    async def _on_step(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None and event.target.value in _STEPS:
            self._requests.append(partial(self._step, float(event.target.value)))

    async def _on_finding(self, position: float, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._requests.append(partial(self._stop_at, position))

    def update(self) -> int:
        """Advance the player, show its position, and return its time (ns)."""
        self._player.advance(not self._pause.value)
        while self._requests:
            self._requests.popleft()()
        self._time.value = round(self._player.position, 2)
        if self._findings and not self._folder.visible:
            self._show_findings()
        return self._player.time

    def _step(self, seconds: float) -> None:
        self._stop_at(self._player.position + seconds)

    def _stop_at(self, position: float) -> None:
        self._player.seek(position)
        self._pause.value = True

    def _show_findings(self) -> None:
        self._folder.visible = True
        with self._folder:
            for text, time in self._findings[:_MOST_FINDINGS]:
                position = self._player.position_of(time)
                if 0.0 <= position <= self._player.length:
                    button = self._gui.add_button(f'{position:.2f} s: {visible(text)}',
                                                  hint=visible(text))
                    button.on_click(partial(self._on_finding, position))
                else:
                    self._gui.add_html(html(text, 'finding'))
            if more := len(self._findings[_MOST_FINDINGS:]):
                self._gui.add_html(html(f'and {more} more', 'finding'))
