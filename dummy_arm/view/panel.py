"""The panel beside the scene; all viewers share one panel."""

from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from math import ceil, isfinite
from typing import Any, Optional

import viser

from dummy_arm.view.scene import NAMES_AT_ONCE
from dummy_arm.view.snapshot import Snapshot

_NONE = '(none)'
#: The smallest and the largest length of an axis (m).
_SIZES = 0.02, 2.0
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
        """
        Create the dropdown, without frames.

        :param gui: the panel of viser to which the dropdown is added.
        :param label: the label of the dropdown.
        :param hint: the text that the page shows when the pointer is on the dropdown.
        """
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
        """The frame that a viewer has chosen; '' if no frame is chosen."""
        return self._chosen or ''

    def choose(self, name: str) -> None:
        """
        Choose a frame, as if a viewer had selected it in the dropdown.

        :param name: the name of the frame, or the entry '(none)'.
        """
        self._chosen = '' if name == _NONE else name

    def set_options(self, names: Iterable[str]) -> None:
        """
        Set the frames of the dropdown; the chosen frame stays, since it may be published again.

        :param names: the names of the frames.
        """
        options = (_NONE, *sorted({*names, self.chosen} - {''}))
        if options != self._dropdown.options:
            self._dropdown.options = options

    def propose(self, proposal: str) -> None:
        """
        Set the proposal, and show the frame that is chosen or proposed.

        :param proposal: the frame to use until a viewer chooses one; '' for none.
        """
        self._proposal = proposal
        shown = self.name or _NONE
        if self._dropdown.value != shown and shown in self._dropdown.options:
            self._dropdown.value = shown


class Panel:
    """The controls and texts of the page."""

    def __init__(self, gui: viser.GuiApi, length: float,
                 look_at_all: Callable[[viser.ClientHandle], Awaitable[object]]) -> None:
        """
        Create the controls.

        :param gui: the panel of viser.
        :param length: the largest value of the time slider (s); 0: the slider is hidden.
        :param look_at_all: a coroutine function that moves the camera of a client so that all
            frames are visible.
        """
        #: The frames of the dropdowns, and the earliest time of their next change (s, monotonic
        #: clock).
        self._options: list[str] = []
        self._next_options = 0.0
        self._overview = gui.add_html('')
        self._pause = gui.add_checkbox('Pause', False)
        self._requested_time: deque[float] = deque(maxlen=1)
        self._length = max(_TIME_STEP, ceil(length / _TIME_STEP) * _TIME_STEP)
        self._time = gui.add_slider('Time (s)', 0.0, self._length, _TIME_STEP, 0.0,
                                    visible=length > 0.0)
        self._time.on_update(self._on_time)
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

    async def _on_time(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._requested_time.append(_within(event.target.value, 0.0, self._length))

    async def _on_names(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._names_chosen = event.target.value

    async def _on_look_at_all(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client is not None:
            await self._look_at_all(event.client)

    @property
    def is_paused(self) -> bool:
        """Whether the view is paused."""
        return bool(self._pause.value)

    @property
    def size(self) -> float:
        """The length of an axis (m)."""
        return _within(self._size.value, *_SIZES)

    @property
    def with_names(self) -> bool:
        """Whether the names of the frames are shown."""
        return bool(self._names.value)

    def take_requested_time(self) -> Optional[float]:
        """
        Return the time that a viewer has set with the time slider since the last call.

        :returns: seconds after the start of the bag. If the slider was set more than once, this is
            the last value; if it was not set, None.
        """
        return self._requested_time.popleft() if self._requested_time else None

    def show_time(self, position: float) -> None:
        """
        Set the time slider.

        :param position: seconds after the start of the bag.
        """
        self._time.value = round(position, 2)

    def set_frames(self, snapshot: Snapshot, names: list[str], now: float) -> None:
        """
        Set the proposals and frames of the dropdowns, and the checkbox 'Show names'.

        Until a viewer uses the checkbox, it is ticked if the snapshot has at most `NAMES_AT_ONCE`
        frames.

        :param snapshot: the frames that are shown.
        :param names: the names of the frames that a viewer can choose.
        :param now: the time (s, monotonic clock).
        """
        choices = self.fixed, self.trail, self.selected
        if names != self._options and now >= self._next_options:
            self._options, self._next_options = names, now + len(names) * _OPTION_PERIOD
            for choice in choices:
                choice.set_options(names)
        for choice, name in zip(choices, (snapshot.fixed, snapshot.deepest, snapshot.deepest)):
            choice.propose(name)
        few = len(snapshot.names) <= NAMES_AT_ONCE
        self._names.value = few if self._names_chosen is None else self._names_chosen

    def show_texts(self, overview: str, details: str) -> None:
        """
        Show the overview and the details.

        :param overview: the text about all frames, as HTML.
        :param details: the text about the selected frame, as HTML.
        """
        self._overview.content, self._details.content = overview, details


def _within(value: Any, smallest: float, largest: float) -> float:
    """Clamp a number that a viewer has set; if it is not finite, return `smallest`."""
    number = float(value)
    return min(max(number, smallest), largest) if isfinite(number) else smallest
