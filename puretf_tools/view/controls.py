"""Controls of the panel, and the numbers that viewers send."""

from collections.abc import Callable, Iterable
from math import isfinite
from typing import Any, Optional

import viser

#: The choice of no frame, and that of the frame that the program proposes.
NONE, AUTOMATIC = '(none)', '(automatic)'


class Setting:
    """
    The value of a control that viewers and the program set.

    viser stores what a viewer has set some time before it calls back. Meanwhile `show` must not
    put the old value back, so it writes only what differs from what it knows.
    """

    def __init__(self, control: Any, on_set: Callable[[Any], object]) -> None:
        """Call a function with each value that a viewer sets."""
        self._control, self._known, self._on_set = control, control.value, on_set
        control.on_update(self._on_update)

    async def _on_update(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._known = event.target.value
            self._on_set(self._known)

    def show(self, value: object) -> None:
        """Set the value, as the program wants it."""
        if value != self._known:
            self._known = self._control.value = value

    def set_options(self, options: tuple[str, ...]) -> None:
        """Set the options of a dropdown; if its value is none of them, it becomes the first."""
        if options != self._control.options:
            self._control.options = options
            self._known = self._control.value


class FrameChoice:
    """A dropdown of frames; until a viewer chooses a frame, the program proposes one."""

    def __init__(self, gui: viser.GuiApi, label: str, hint: str, none: str = NONE) -> None:
        """Add a dropdown, in which `none` stands before the frames."""
        self._none = none
        self._dropdown = gui.add_dropdown(label, (none,), hint=hint)
        self._shown = Setting(self._dropdown, self.choose)
        self._chosen: Optional[str] = None
        self._proposal = ''

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
        self._chosen = None if name == AUTOMATIC else '' if name == NONE else name

    def set_options(self, names: Iterable[str]) -> None:
        """Set the frames; the chosen one stays, since it may be published again."""
        self._shown.set_options((self._none, *sorted({*names, self.chosen} - {''})))

    def propose(self, proposal: str) -> None:
        """Set the proposal, and show the frame that is chosen or proposed."""
        self._proposal = proposal
        shown = self.name or self._none
        if shown in self._dropdown.options:
            self._shown.show(shown)


def change(handle: Any, **values: Any) -> None:
    """Set those attributes of a control that differ: viser sends each that is set."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def within(value: Any, smallest: float, largest: float) -> float:
    """Clamp a number that a viewer has set; if it is not finite, return `smallest`."""
    number = float(value)
    return min(max(number, smallest), largest) if isfinite(number) else smallest
