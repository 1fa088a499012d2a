"""Controls of the panel, and the numbers that viewers send."""

from collections.abc import Iterable
from math import isfinite
from typing import Any, Optional

import viser

#: The choice of no frame, and that of the frame that the program proposes.
NONE, AUTOMATIC = '(none)', '(automatic)'


class FrameChoice:
    """
    A dropdown of frames; until a viewer chooses a frame, the program proposes one.

    The callback of the dropdown stores the choice at once, since `set_options` and `propose` can
    overwrite the value of the dropdown.
    """

    def __init__(self, gui: viser.GuiApi, label: str, hint: str, none: str = NONE) -> None:
        """Add a dropdown, in which `none` stands before the frames."""
        self._none = none
        self._dropdown = gui.add_dropdown(label, (none,), hint=hint)
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
        self._chosen = None if name == AUTOMATIC else '' if name == NONE else name

    def set_options(self, names: Iterable[str]) -> None:
        """Set the frames; the chosen one stays, since it may be published again."""
        change(self._dropdown, options=(self._none, *sorted({*names, self.chosen} - {''})))

    def propose(self, proposal: str) -> None:
        """Set the proposal, and show the frame that is chosen or proposed."""
        self._proposal = proposal
        shown = self.name or self._none
        if shown in self._dropdown.options:
            change(self._dropdown, value=shown)


def change(handle: Any, **values: Any) -> None:
    """Set those attributes of a control that differ: viser sends each that is set."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def within(value: Any, smallest: float, largest: float) -> float:
    """Clamp a number that a viewer has set; if it is not finite, return `smallest`."""
    number = float(value)
    return min(max(number, smallest), largest) if isfinite(number) else smallest
