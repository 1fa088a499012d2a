"""The controls of a bag: pause, time, speed and step, and the findings of `tf_doctor`."""

from argparse import ArgumentTypeError
from collections import deque
from collections.abc import Callable
from functools import partial
from math import ceil
from typing import Any

import viser

from puretf import SECOND, visible
from puretf_tools.cli.times import when
from puretf_tools.inspection.bag_times import both, why_outside
from puretf_tools.view.controls import within
from puretf_tools.view.details import html
from puretf_tools.view.feed import BagFeed

#: The step of the time slider (s).
_TIME_STEP = 0.01
#: The labels of the speeds, from 0.1 to 10 times that of the recording, and of the steps (s).
_SPEEDS = '0.1', '0.2', '0.5', '1', '2', '5', '10'
_STEPS = '-0.1', '-0.01', '+0.01', '+0.1'
#: Of more requests between two updates, only the last ones are carried out.
_MOST_REQUESTS = 100
_MOST_FINDINGS = 20
#: The largest number of characters of a time that a viewer types.
_LONGEST_GOAL = 100


class Playback:
    """
    The controls of a bag; all viewers share them.

    The callbacks of the controls store what viewers request, and `update` carries it out: it can
    overwrite the values of the controls, and it runs in another thread.
    """

    def __init__(self, gui: viser.GuiApi, feed: BagFeed) -> None:
        """Create the controls; they appear when the bag has a length."""
        self._gui, self._feed, self._player = gui, feed, feed.player
        self._requests: deque[Callable[[], object]] = deque(maxlen=_MOST_REQUESTS)
        self._length = 0.0  # of the slider (s)
        self._reading = gui.add_html('')
        self._pause = gui.add_checkbox('Pause', False, visible=False)
        self._time = gui.add_slider('Time (s)', 0.0, _TIME_STEP, _TIME_STEP, 0.0, visible=False)
        self._time.on_update(self._on_time)
        self._shown_time = gui.add_html('', visible=False)
        goal = gui.add_text('Go to', '', visible=False, hint=(
            'a time: 1760000012.34 (s), +12.34 (s after the start of the bag), -1.5 (s before its '
            'end) or 2025-10-09T08:53:32.34Z'))
        goal.on_update(self._on_goal)
        self._problem = gui.add_html('', visible=False)
        speed = gui.add_dropdown('Speed', _SPEEDS, initial_value='1', visible=False)
        speed.on_update(self._on_speed)
        step = gui.add_button_group('Step (s)', _STEPS, visible=False)
        step.on_click(self._on_step)
        self._controls = (
            self._pause, self._time, self._shown_time, goal, self._problem, speed, step)
        self._folder = gui.add_folder('Findings of tf_doctor', expand_by_default=False,
                                      visible=False)

    async def _on_time(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._requests.append(partial(
                self._seek, within(event.target.value, 0.0, self._player.length)))

    async def _on_goal(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._requests.append(partial(self._go_to, event.target.value[:_LONGEST_GOAL]))

    async def _on_speed(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            if event.target.value in _SPEEDS:
                self._player.speed = float(event.target.value)
            else:  # a viewer has sent what the dropdown does not offer
                event.target.value = f'{self._player.speed:g}'

    async def _on_step(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None and event.target.value in _STEPS:
            self._requests.append(partial(self._step, float(event.target.value)))

    async def _on_finding(self, time: int, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._requests.append(partial(self._stop_at, time))

    def update(self) -> int:
        """Advance the player, show its position, and return its time (ns)."""
        player = self._player
        self._reading.content = html(self._feed.update(), 'reading')
        self._set_length(ceil(player.length / _TIME_STEP) * _TIME_STEP)
        player.advance(not self._pause.value)
        while self._requests:
            self._requests.popleft()()
        self._time.value = round(player.position, 2)
        self._shown_time.content = html(both(player.time, player.begin), 'time')
        if self._feed.findings and not self._folder.visible:
            self._show_findings()
        return player.time

    def _set_length(self, length: float) -> None:
        if length != self._length:
            self._length = self._time.max = length
            for control in self._controls:
                control.visible = True

    def _seek(self, position: float) -> None:
        self._player.seek(self._player.begin + round(position * SECOND))

    def _step(self, seconds: float) -> None:
        self._stop_at(self._player.time + round(seconds * SECOND))

    def _stop_at(self, time: int) -> None:
        self._player.seek(time)
        self._pause.value = True

    def _go_to(self, text: str) -> None:
        span, problem = (self._player.begin, self._player.end), ''
        try:
            if text:
                time = when(text).within(span)
                if not (problem := why_outside(time, span)):
                    self._stop_at(time or self._player.end)  # 0: the latest
        except ArgumentTypeError as error:
            problem = str(error)
        self._problem.content = html(problem, 'problem')

    def _show_findings(self) -> None:
        player = self._player
        self._folder.visible = True
        with self._folder:
            for text, time in self._feed.findings[:_MOST_FINDINGS]:
                if player.begin <= time <= player.end:
                    button = self._gui.add_button(
                        f'{(time - player.begin) / SECOND:+.2f} s: {visible(text)}',
                        hint=f'{both(time, player.begin)}: {visible(text)}')
                    button.on_click(partial(self._on_finding, time))
                else:
                    self._gui.add_html(html(text, 'finding'))
            if more := len(self._feed.findings[_MOST_FINDINGS:]):
                self._gui.add_html(html(f'and {more} more', 'finding'))
