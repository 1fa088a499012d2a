"""The bar of a bag at the foot of the page: time, pause, steps and speed."""

from argparse import ArgumentTypeError
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from math import ceil
from typing import Any

import viser

from puretf import SECOND
from puretf._text.names import abbreviated
from puretf_tools.cli.times import when
from puretf_tools.inspection.bag_times import both, why_outside
from puretf_tools.view.camera import page_size
from puretf_tools.view.controls import change, html
from puretf_tools.view.feed import BagFeed

#: The step of the time slider (s).
_TIME_STEP = 0.01
#: The speeds, from 0.1 to 10 times that of the recording.
_SPEEDS = '0.1', '0.2', '0.5', '1', '2', '5', '10'
_PAUSE, _PLAY, _BACK, _NEXT, _LOOP, _ONCE = (
    'pause', 'play', 'step back', 'step', 'loop: on', 'loop: off')
#: The bar is this much narrower than the scene, and at least this wide (pixels).
_MARGIN, _NARROWEST = 30.0, 320.0


class Playback:
    """
    The controls of a bag; all viewers share them.

    The callbacks of the controls store what viewers request, and `update` carries it out: it can
    overwrite the values of the controls, and it runs in another thread.
    """

    def __init__(self, gui: viser.GuiApi, feed: BagFeed) -> None:
        """Create the controls; the bar appears when the bag has a length."""
        self._gui, self._feed, self._player = gui, feed, feed.player
        self._requests: deque[Callable[[], object]] = deque()
        self._length, self._width = 0.0, 0.0  # of the slider (s), of the bar (pixels)
        self._marked: object = ()
        self._reading = gui.add_html('')
        self._bar = gui.add_panel(visible=False)
        self._tab = self._bar.add_tab(feed.name)
        with self._tab:
            self._time = self._slider()
            self._shown_time = gui.add_html('')
            self._play = gui.add_button_group('Play', (_PAUSE, _BACK, _NEXT, _LOOP))
            gui.add_button_group('Speed', _SPEEDS).on_click(self._on_speed)
            gui.add_text('Go to', '').on_update(self._on_goal)
            self._problem = gui.add_html('')
        self._play.on_click(self._on_play)

    def _slider(self) -> Any:
        player = self._player
        marks = tuple({(finding.time - player.begin) / SECOND: None
                       for finding in self._feed.findings
                       if player.begin <= finding.time <= player.end})
        slider = self._gui.add_slider('Time (s)', 0.0, self._length or _TIME_STEP, _TIME_STEP,
                                      0.0, marks=marks or None, order=0.0)
        slider.on_update(self._on_time)
        return slider

    async def _on_time(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._requests.append(partial(self._player.seek, self._player.begin + round(
                event.target.value * SECOND)))

    async def _on_goal(self, event: 'viser.GuiEvent[Any]') -> None:
        problem = ''
        try:
            if text := abbreviated(event.target.value):
                self._requests.append(partial(self._player.stop_at, self._goal(text)))
        except ArgumentTypeError as error:
            problem = str(error)
        self._problem.content = html(problem, 'problem')

    async def _on_speed(self, event: 'viser.GuiEvent[Any]') -> None:
        self._player.speed = float(_SPEEDS[_SPEEDS.index(event.target.value)])

    async def _on_play(self, event: 'viser.GuiEvent[Any]') -> None:
        action = event.target.value
        if action in (_LOOP, _ONCE):
            self._player.loops = action == _ONCE
        else:
            await (self.on_pause() if action in (_PAUSE, _PLAY) else self.on_step(action == _BACK))

    async def on_pause(self, _: Any = None) -> None:
        """Pause or play."""
        self._player.plays = not self._player.plays

    async def on_step(self, is_back: bool, _: Any = None) -> None:
        """Go to the next transform, or back to the last one."""
        self._requests.append(partial(self._step, is_back))

    def update(self, clients: Sequence[viser.ClientHandle]) -> int:
        """Advance the player if somebody looks, show where it is, and return its time (ns)."""
        player = self._player
        change(self._reading, content=html(self._feed.update(), 'reading'))
        length = ceil(player.length / _TIME_STEP) * _TIME_STEP
        if length != self._length:
            self._length = self._time.max = length
            self._bar.visible = True
        if self._feed.findings is not self._marked and player.is_whole:
            self._marked = self._feed.findings
            self._time.remove()
            with self._tab:
                self._time = self._slider()
        player.advance(player.plays and bool(clients))
        while self._requests:
            self._requests.popleft()()
        self._time.value = round(player.position, 2)
        speed = f', {player.speed:g} times as fast as recorded' * (player.speed != 1.0)
        change(self._shown_time, content=html(both(player.time, player.begin) + speed, 'time'))
        change(self._play, options=(_PAUSE if player.plays else _PLAY, _BACK, _NEXT,
                                    _LOOP if player.loops else _ONCE))
        width = min((page_size(client.camera)[0] for client in clients), default=self._width)
        if width != self._width:  # the bar is as wide as the narrowest scene
            self._width = width
            self._bar.float(x=_MARGIN / 2, y=-_MARGIN / 2, width=max(_NARROWEST, width - _MARGIN))
        return player.time

    def _step(self, is_back: bool) -> None:
        time, stamps = self._player.time, []
        for frame in self._feed.buffer.frames():
            if not frame.is_static:
                own = self._feed.buffer.path_stamps(frame.parent, frame.name)
                i = int(own.searchsorted(time, 'left')) - 1 if is_back else int(
                    own.searchsorted(time, 'right'))
                stamps += own[max(i, 0):i + 1].tolist()
        if stamps:
            self._player.stop_at(max(stamps) if is_back else min(stamps))

    def _goal(self, text: str) -> int:
        """Return the time (ns) that a viewer has typed; ArgumentTypeError: there is none."""
        span = self._player.begin, self._player.end
        time = when(text).within(span)
        if problem := why_outside(time, span):
            raise ArgumentTypeError(problem)
        return time or self._player.end  # 0: the latest
