"""The panel beside the scene; all who look share it."""

from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from math import ceil, isfinite
from typing import Any, Optional

import viser

from dummy_arm.view.scene import NAMES_AT_ONCE
from dummy_arm.view.snapshot import Snapshot

_NONE = '(none)'
_SIZES = 0.02, 2.0  # m
_TIME_STEP = 0.01  # s


class FrameChoice:
    """
    A choice of a frame; until somebody has chosen, it follows what is proposed.

    What is chosen is noted as it comes in; what the dropdown shows may be overwritten just then.
    """

    def __init__(self, gui: viser.GuiApi, label: str, hint: str) -> None:
        """Begin with no frame to choose."""
        self._dropdown = gui.add_dropdown(label, (_NONE,), hint=hint)
        self._dropdown.on_update(self._on_update)
        self._chosen: Optional[str] = None
        self._proposal = ''

    async def _on_update(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self.choose(event.target.value)

    @property
    def name(self) -> str:
        """The frame; '' where there is none."""
        return self._proposal if self._chosen is None else self._chosen

    @property
    def chosen(self) -> str:
        """The frame that somebody has chosen; '' where nobody has."""
        return self._chosen or ''

    def choose(self, name: str) -> None:
        """Choose a frame, as by hand."""
        self._chosen = '' if name == _NONE else name

    def set_options(self, names: Iterable[str], proposal: str) -> None:
        """
        Have more frames to choose from; those before stay, for they may come back.

        :param proposal: what is taken until somebody chooses; '': none.
        """
        self._proposal = proposal
        before = self._dropdown.options
        if new := {*names}.difference(before):
            self._dropdown.options = (_NONE, *sorted(new.union(before[1:])))
        shown = self.name or _NONE
        if self._dropdown.value != shown and shown in self._dropdown.options:
            self._dropdown.value = shown


class Panel:
    """Controls and texts."""

    def __init__(self, gui: viser.GuiApi, length: float,
                 look_at_all: Callable[[viser.ClientHandle], Awaitable[object]]) -> None:
        """
        Make it.

        :param length: of the time that can be chosen (s); 0: none can.
        :param look_at_all: turns somebody's camera to all frames.
        """
        self._overview = gui.add_html('')
        self._pause = gui.add_checkbox('Pause', False)
        self._requested_time: deque[float] = deque(maxlen=1)
        self._length = max(_TIME_STEP, ceil(length / _TIME_STEP) * _TIME_STEP)
        self._time = gui.add_slider('Time (s)', 0.0, self._length, _TIME_STEP, 0.0,
                                    visible=length > 0.0)
        self._time.on_update(self._on_time)
        self.fixed = FrameChoice(gui, 'Fixed frame', 'the frame in which all are shown')
        self._size = gui.add_slider('Axis size (m)', *_SIZES, 0.02, 0.16)
        self._names = gui.add_checkbox('Names', True)
        self._names.on_update(self._on_names)
        self._names_chosen: Optional[bool] = None
        self.trail = FrameChoice(gui, 'Trail of', 'the frame whose path is drawn')
        self.selected = FrameChoice(gui, 'Frame', 'the frame that is told of; or click it')
        self._details = gui.add_html('')
        button = gui.add_button('Look at all')
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
        """Whether nothing shall move."""
        return bool(self._pause.value)

    @property
    def size(self) -> float:
        """The length of an axis (m)."""
        return _within(self._size.value, *_SIZES)

    @property
    def with_names(self) -> bool:
        """Whether names are shown."""
        return bool(self._names.value)

    def take_requested_time(self) -> Optional[float]:
        """Tell which time somebody has chosen since the last call (s)."""
        return self._requested_time.popleft() if self._requested_time else None

    def show_time(self, position: float) -> None:
        """Show where the time is (s)."""
        self._time.value = round(position, 2)

    def set_frames(self, snapshot: Snapshot) -> None:
        """Have the frames to choose from that are shown."""
        self.fixed.set_options(snapshot.names, snapshot.fixed)
        self.trail.set_options(snapshot.names, snapshot.deepest)
        self.selected.set_options(snapshot.names, snapshot.deepest)
        few = len(snapshot.names) <= NAMES_AT_ONCE
        self._names.value = few if self._names_chosen is None else self._names_chosen

    def show_texts(self, overview: str, details: str) -> None:
        """Show texts, in HTML."""
        self._overview.content, self._details.content = overview, details


def _within(value: Any, smallest: float, largest: float) -> float:
    """Read a number of a control; while it is typed, it may be anything."""
    number = float(value)
    return min(max(number, smallest), largest) if isfinite(number) else smallest
