"""What the panels are made of: keys, choices, rows and texts."""

from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Sequence
from functools import partial
from html import escape
from typing import Any, NamedTuple, Optional

import viser

from puretf._text.names import visible
from puretf_tools.view.settings import Settings

#: The choice of no frame, and that of the frame that the program proposes.
NONE, AUTOMATIC = '(none)', '(automatic)'
#: The place of a text below all controls, also those that are added later.
LAST = 1e9
#: Of the texts in the panel.
STYLE = ('margin: 0 1em .5em; font-size: .85em; line-height: 1.5; '
         'font-variant-numeric: tabular-nums; overflow-wrap: anywhere')
#: A click selects the whole text.
_COPIED = f'{STYLE}; white-space: pre-wrap; user-select: all; -webkit-user-select: all'


def add_keys(gui: viser.GuiApi, time: Any, on_view: Callable[..., Awaitable[object]],
             on_reset: Callable[[Any], Awaitable[object]]) -> None:
    """Add the keys of the page, by what viser's list of commands says of them."""
    for key, text, callback in (
            ('P', 'Pause or resume', time.on_pause),
            ('B', 'Step back', partial(time.on_step, True)),
            ('N', 'Step forward', partial(time.on_step, False)),
            ('A', 'Focus on all frames', partial(on_view, view='all')),
            ('F', 'Focus on the selected frame', partial(on_view, view='frame')),
            ('T', 'Look from the top', partial(on_view, view='top')),
            ('R', 'Reset view', on_reset)):
        gui.add_command(text, hotkey=key).on_trigger(callback)


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


class Row(NamedTuple):
    """A button, and perhaps a text below it."""

    key: Any  #: what a click gives
    label: str
    colour: tuple[int, int, int]
    text: str = ''  #: in HTML


class Rows:
    """Rows that change: controls are added when there are more rows, and hidden when fewer."""

    def __init__(self, gui: viser.GuiApi, container: Any) -> None:
        self._gui, self._container = gui, container
        self._rows: Sequence[Row] = ()
        self._buttons: list[Any] = []
        self._texts: list[Any] = []
        #: The key of the row that was clicked last, until somebody takes it.
        self.clicks: deque[Any] = deque(maxlen=1)

    async def _on_click(self, event: 'viser.GuiEvent[Any]') -> None:
        number = self._buttons.index(event.target)
        self.clicks += [row.key for row in self._rows[number:number + 1]]

    def show(self, rows: Sequence[Row]) -> None:
        """Show these rows; all of them have a text, or none."""
        self._rows = rows
        with self._container:
            for row in rows[len(self._buttons):]:
                self._buttons.append(self._gui.add_button(''))
                self._buttons[-1].on_click(self._on_click)
                if row.text:
                    self._texts.append(self._gui.add_html(''))
        for row, button in zip(rows, self._buttons):
            change(button, label=row.label, color=row.colour, visible=True)
        for row, text in zip(rows, self._texts):
            change(text, content=row.text, visible=True)
        for unused in *self._buttons[len(rows):], *self._texts[len(rows):]:
            change(unused, visible=False)


def change(handle: Any, **values: Any) -> None:
    """Set those attributes of a control that differ: viser sends each that is set."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def html(text: str, key: str) -> str:
    """Return a text as an element of the panel; '' if it is empty."""
    return f'<div style="{STYLE}" data-text="{key}">{escaped(text)}</div>' if text else ''


def copied(text: str, key: str) -> str:
    """Return in HTML a text that a click selects and, from this machine or by HTTPS, copies."""
    return (f'<pre style="{_COPIED}" data-text="{key}" '
            f'onclick="navigator.clipboard?.writeText(this.textContent)">{escape(text)}</pre>')


def escaped(text: str) -> str:
    """Return a text for HTML, in which control characters are visible."""
    return escape(visible(text))
