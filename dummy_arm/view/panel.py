"""The panel beside the scene; all viewers share one panel."""

from collections.abc import Awaitable, Callable, Iterable
from typing import Any, Optional

import viser

from dummy_arm.view.placement import Placement
from dummy_arm.view.playback import within
from dummy_arm.view.scene import NAMES_AT_ONCE

_NONE = '(none)'
#: The smallest and the largest length of an axis (m).
_SIZES = 0.02, 2.0
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


class Panel:
    """The controls and texts of the page."""

    def __init__(self, gui: viser.GuiApi, is_live: bool,
                 look_at_all: Callable[[viser.ClientHandle], Awaitable[object]]) -> None:
        self._options: list[str] = []  # of the dropdowns
        self._next_options = 0.0  # when they may change again (s, monotonic clock)
        self._overview = gui.add_html('')
        self._pause = gui.add_checkbox('Pause', False) if is_live else None
        self.fixed = FrameChoice(gui, 'Fixed frame', 'the frame in which the others are shown')
        self._size = gui.add_slider('Axis length (m)', *_SIZES, 0.02, 0.16)
        self._names = gui.add_checkbox('Show names', True)
        self._names.on_update(self._on_names)
        self._names_chosen: Optional[bool] = None
        self.trail = FrameChoice(gui, 'Trail of', 'the frame whose recent path is drawn')
        self.selected = FrameChoice(
            gui, 'Frame',
            'the frame whose details are shown; to select a frame, you can also click on its axes')
        self._details = gui.add_html('')
        button = gui.add_button('Focus on all frames')
        button.on_click(self._on_look_at_all)
        self._look_at_all = look_at_all

    async def _on_names(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._names_chosen = event.target.value

    async def _on_look_at_all(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client is not None:
            await self._look_at_all(event.client)

    @property
    def is_paused(self) -> bool:
        return self._pause is not None and bool(self._pause.value)

    @property
    def size(self) -> float:
        return within(self._size.value, *_SIZES)

    @property
    def with_names(self) -> bool:
        return bool(self._names.value)

    def set_frames(self, placement: Placement, names: list[str], now: float) -> None:
        """
        Set the dropdowns and the checkbox 'Show names'.

        Until a viewer uses the checkbox, it is ticked if there are at most `NAMES_AT_ONCE` frames.
        """
        choices = self.fixed, self.trail, self.selected
        if names != self._options and now >= self._next_options:
            self._options, self._next_options = names, now + len(names) * _OPTION_PERIOD
            for choice in choices:
                choice.set_options(names)
        for choice, name in zip(choices, (placement.fixed, placement.deepest, placement.deepest)):
            choice.propose(name)
        if self._size.value != self.size:  # a viewer has sent NaN, or another wrong number
            self._size.value = self.size
        few = len(placement.names) <= NAMES_AT_ONCE
        self._names.value = few if self._names_chosen is None else self._names_chosen

    def show_texts(self, overview: str, details: str) -> None:
        """Show two texts in HTML."""
        self._overview.content, self._details.content = overview, details
