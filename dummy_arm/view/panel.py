"""The panel beside the scene: the controls of each viewer, and those of a bag for all."""

from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from math import ceil
from typing import Any, Optional

import viser

from dummy_arm.view.display import configure, DisplayPanel, within
from dummy_arm.view.feed import Player
from dummy_arm.view.placement import Placement
from dummy_arm.view.scene import NAMES_AT_ONCE
from dummy_arm.view.tree import Tree

_NONE = '(none)'
#: The step of the time slider (s).
_TIME_STEP = 0.01
#: A change of the frames in a dropdown sends all names to all viewers. So after a change with n
#: names, the next change waits for n times this (s).
_OPTION_PERIOD = 0.5e-3


class FrameChoice:
    """
    A dropdown of frames; until a viewer chooses a frame, the program proposes one.

    The callback of the dropdown stores the choice at once, since `set_options` and `propose` can
    overwrite the value of the dropdown.
    """

    def __init__(self, gui: viser.GuiApi, label: str, hint: str) -> None:
        self._dropdown = gui.add_dropdown(label, (_NONE,), hint=hint)
        self._dropdown.on_update(self._on_update)
        self._chosen: Optional[str] = None
        self._proposal = ''

    async def _on_update(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self.choose(event.target.value)

    @property
    def name(self) -> str:
        """The chosen or proposed frame; '' if there is none."""
        return self._proposal if self._chosen is None else self._chosen

    @property
    def chosen(self) -> str:
        """The frame that a viewer has chosen; '' if there is none."""
        return self._chosen or ''

    def choose(self, name: str) -> None:
        """Choose a frame, as if a viewer had selected it in the dropdown."""
        self._chosen = '' if name == _NONE else name

    def set_options(self, names: Iterable[str]) -> None:
        """Set the frames; the chosen one stays, since it may be published again."""
        options = (_NONE, *sorted({*names, self.chosen} - {''}))
        if options != self._dropdown.options:
            self._dropdown.options = options

    def propose(self, proposal: str) -> None:
        """Set the proposal, and show the frame that is chosen or proposed."""
        self._proposal = proposal
        shown = self.name or _NONE
        if self._dropdown.value != shown and shown in self._dropdown.options:
            self._dropdown.value = shown


class Playback:
    """The controls of a bag; all viewers share them."""

    def __init__(self, gui: viser.GuiApi, player: Player) -> None:
        self._player = player
        self._requested: deque[float] = deque(maxlen=1)
        self._length = max(_TIME_STEP, ceil(player.length / _TIME_STEP) * _TIME_STEP)
        self._pause = gui.add_checkbox('Pause', False)
        self._time = gui.add_slider('Time (s)', 0.0, self._length, _TIME_STEP, 0.0,
                                    visible=player.length > 0.0)
        self._time.on_update(self._on_time)

    async def _on_time(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._requested.append(within(event.target.value, 0.0, self._length))

    def update(self) -> int:
        """Advance the player, show its position, and return its time (ns)."""
        self._player.advance(not self._pause.value)
        if self._requested:
            self._player.seek(self._requested.popleft())
        self._time.value = round(self._player.position, 2)
        return self._player.time


class Panel:
    """The controls and texts of one viewer."""

    def __init__(self, gui: viser.GuiApi, is_live: bool,
                 look_from: Callable[[str], Awaitable[object]]) -> None:
        """Add the controls; `look_from` moves the camera to one of `VIEWS`."""
        configure(gui, False)
        self._options: list[str] = []  # of the dropdowns
        self._next_options = 0.0  # when they may change again (s, monotonic clock)
        self._overview = gui.add_html('')
        self._pause = gui.add_checkbox('Pause', False) if is_live else None
        self.fixed = FrameChoice(gui, 'Fixed frame', 'the frame in which the others are shown')
        button = gui.add_button('Focus on all frames')
        button.on_click(self._on_look_at_all)
        self._look_from = look_from
        tabs = gui.add_tab_group()
        with tabs.add_tab('Frame'):
            self.selected = FrameChoice(
                gui, 'Frame', 'the frame whose details are shown; to select a frame, you can also '
                'click on its axes or in the tree')
            self.trail = FrameChoice(gui, 'Trail of', 'the frame whose recent path is drawn')
            self._details = gui.add_html('')
        self.tree = Tree(gui, tabs.add_tab('Tree'))
        with tabs.add_tab('Display'):
            self.display = DisplayPanel(gui, look_from)

    async def _on_look_at_all(self, event: 'viser.GuiEvent[Any]') -> None:
        await self._look_from('all')

    @property
    def is_paused(self) -> bool:
        return self._pause is not None and bool(self._pause.value)

    def set_frames(self, placement: Placement, names: list[str], now: float) -> None:
        """
        Set the dropdowns and the checkbox 'Show names'.

        Until the viewer uses the checkbox, it is ticked if there are at most `NAMES_AT_ONCE`
        frames.
        """
        choices = self.fixed, self.trail, self.selected
        if names != self._options and now >= self._next_options:
            self._options, self._next_options = names, now + len(names) * _OPTION_PERIOD
            for choice in choices:
                choice.set_options(names)
        for choice, name in zip(choices, (placement.fixed, placement.deepest, placement.deepest)):
            choice.propose(name)
        self.display.show_names(len(placement.names) <= NAMES_AT_ONCE)

    def show_texts(self, overview: str, details: str) -> None:
        """Show two texts in HTML."""
        self._overview.content, self._details.content = overview, details
