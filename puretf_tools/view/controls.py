"""What the panel is made of: choices, texts, and values for the script of the page."""

from collections.abc import Iterable
from html import escape
import json
from typing import Any, Optional

import viser

from puretf._text.names import visible
from puretf_tools.view.settings import Settings

#: The choice of no frame, and that of the frame that the program proposes.
NONE, AUTOMATIC = '(none)', '(automatic)'


class Choice:
    """
    What a viewer has chosen, or else what the program proposes, as the value of a control.

    viser stores what a viewer has set some time before it calls back. Meanwhile `propose` must not
    put the old value back, so it writes only what differs from what it knows.
    """

    def __init__(self, control: Any, settings: Optional[Settings] = None) -> None:
        self._control, self._known = control, control.value
        self._proposal: Any = type(self._known)()
        self._chosen: Any = None
        control.on_update(self._on_update)
        if settings:
            settings.add(control.label, lambda: self._chosen, self.choose)

    async def _on_update(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._known = event.target.value
            self.choose(self._known)

    @property
    def value(self) -> Any:
        """What is chosen or proposed."""
        return self._proposal if self._chosen is None else self._chosen

    def choose(self, value: Any) -> None:
        """Choose a value, as if a viewer had set it; None: what is proposed."""
        self._chosen = value

    def propose(self, proposal: Any) -> None:
        """Set the proposal, and show what is chosen or proposed."""
        self._proposal = proposal
        self._show(self.value)

    def _show(self, value: Any) -> None:
        if value != self._known:
            self._known = self._control.value = value


class FrameChoice(Choice):
    """A dropdown of frames, or of none: ''."""

    def __init__(self, gui: viser.GuiApi, label: str, none: str = NONE,
                 settings: Optional[Settings] = None) -> None:
        """Add a dropdown, in which `none` stands before the frames."""
        self._none = none
        super().__init__(gui.add_dropdown(label, (none,)), settings)

    @property
    def chosen(self) -> str:
        """The frame that a viewer has chosen; '' if there is none."""
        return self._chosen or ''

    def choose(self, value: Optional[str]) -> None:
        super().choose(None if value == AUTOMATIC else '' if value == NONE else value)

    def _show(self, value: str) -> None:
        if (shown := value or self._none) in self._control.options:
            super()._show(shown)

    def set_options(self, names: Iterable[str]) -> None:
        """Set the frames; the chosen one stays, since it may be published again."""
        options = self._none, *sorted({*names, self.chosen} - {''})
        if options != self._control.options:
            self._control.options = options
            self._known = self._control.value


def change(handle: Any, **values: Any) -> None:
    """Set those attributes of a control that differ: viser sends each that is set."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def values(kind: str, content: object) -> str:
    """Return a hidden element with values for page.js."""
    text = json.dumps(content, separators=(',', ':')).replace('<', r'\u003c')
    return f'<script type="application/json" data-tf="{kind}">{text}</script>'


def html(text: str, key: str) -> str:
    """Return a text as an element of the panel; '' if it is empty."""
    return f'<div class="tf-text" data-text="{key}">{escaped(text)}</div>' if text else ''


def copied(text: str, key: str) -> str:
    """Return in HTML a text that a click selects and, from this machine or by HTTPS, copies."""
    return (f'<pre class="tf-text tf-copied" data-text="{key}" '
            f'onclick="navigator.clipboard?.writeText(this.textContent)">{escape(text)}</pre>')


def escaped(text: str) -> str:
    """Return a text for HTML, in which control characters are visible."""
    return escape(visible(text))
