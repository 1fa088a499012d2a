"""The tree of frames in the panel: which frames there are, and which of them are drawn."""

from collections import deque
from collections.abc import Iterator
from functools import partial
import re
from typing import Any, NamedTuple, Optional

import viser

from puretf import LONGEST_NAME, shortened
from puretf_tools.inspection.forest import descend, Forest, self_and_ancestors
from puretf_tools.inspection.traffic import rate_of
from puretf_tools.view.controls import change, Setting
from puretf_tools.view.details import html
from puretf_tools.view.placement import Placement

#: The number of rows that are shown at a time, and the time between two updates (s).
_ROWS, _PERIOD = 50, 0.5
#: The colour of a row by its age: the colour, and the largest age (s).
_COLOURS = ('green', 1.0), ('yellow', 5.0), ('orange', 15.0), ('gray', float('inf'))
_STATIC, _HIDDEN = 'blue', 'dark'
_SELECTED = ' ◀'
_LONGEST_FILTER = 200  # characters
#: The number of characters in a row; the number of levels that are indented, each by `_INDENT`.
_WIDTH, _DEEPEST, _INDENT = 42, 8, 3
#: Blanks that HTML does not drop. A text that is too long for a button begins at its left side.
_FILL = '\u00a0' * 100


class _Row(NamedTuple):
    """A row of the tree."""

    name: str
    text: str
    colour: str


class Tree:
    """A row for each frame; filters and checkboxes say which frames are drawn."""

    def __init__(self, gui: viser.GuiApi, container: Any) -> None:
        """Add the controls to a tab or a folder."""
        self._gui, self._container = gui, container
        self._buttons: list[Any] = []
        self._rows: list[_Row] = []  # those of the page that is shown
        self._page, self._next = 0, 0.0
        #: The pages that the viewer has turned since the last update.
        self._turns: deque[int] = deque()
        #: The frame that was clicked last, until somebody takes it.
        self.clicks: deque[str] = deque(maxlen=1)
        self._selected = ''
        self._wanted = ''  # the frame to whose page the next update turns
        #: The frames that the viewer has hidden, and those hidden with all that is below them.
        self._hidden: set[str] = set()
        self._hidden_branches: set[str] = set()
        with container:
            self._add_controls(gui)
        #: The expressions of the frames that are shown, and of those that are not; None: of none.
        self._filters: list[Optional[re.Pattern[str]]] = [None, None]
        self._problem = ''

    def _add_controls(self, gui: viser.GuiApi) -> None:
        self._include = gui.add_text('Include', '', hint='a regular expression: only frames with '
                                     'a part that matches it are shown; empty: all')
        self._exclude = gui.add_text('Exclude', '', hint='a regular expression: frames with a '
                                     'part that matches it are not shown')
        self._show = Setting(
            gui.add_checkbox('Show the frame', True, hint='the selected one'),
            partial(self._on_show, self._hidden))
        self._show_branch = Setting(
            gui.add_checkbox('Show its branch', True, hint='the selected frame and all below it'),
            partial(self._on_show, self._hidden_branches))
        self._status = gui.add_html('')
        self._turn = gui.add_button_group('Page', ('previous', 'next'))
        self._turn.on_click(self._on_turn)
        for box in self._include, self._exclude:
            box.on_update(self._on_filter)

    async def _on_filter(self, event: 'viser.GuiEvent[Any]') -> None:
        filters, self._problem = [], ''
        for label, box in ('Include', self._include), ('Exclude', self._exclude):
            try:
                filters.append(_pattern(str(box.value)))
            except ValueError as error:
                self._problem = f'{label}: {error}'
                filters.append(None)
        self._filters, self._next = filters, 0.0

    def _on_show(self, hidden: set[str], is_shown: bool) -> None:
        if self._selected and is_shown:
            hidden.discard(self._selected)
        elif self._selected:
            hidden.add(self._selected)
        self._next = 0.0

    async def _on_turn(self, event: 'viser.GuiEvent[Any]') -> None:
        self._turns.append(1 if event.target.value == 'next' else -1)

    async def _on_click(self, event: 'viser.GuiEvent[Any]') -> None:
        number, rows = self._buttons.index(event.target), self._rows
        if number < len(rows):
            self.clicks.append(rows[number].name)

    def turn_to(self, name: str) -> None:
        """Turn to the page with the row of a frame."""
        self._wanted, self._next = name, 0.0

    def hidden(self, placement: Placement) -> frozenset[str]:
        """Return the frames that are not to be drawn."""
        if not (self._hidden or self._hidden_branches or any(self._filters)):
            return frozenset()
        hidden = {name for name in placement.names
                  if name in self._hidden or not self._passes(name)}
        if self._hidden_branches:
            below = {name: name in self._hidden_branches for name in placement.trees}
            hidden.update(name for name, is_below in descend(
                placement.frames, below, lambda name, is_below: (
                    is_below or name in self._hidden_branches)).items() if is_below)
        return frozenset(hidden)

    def _passes(self, name: str) -> bool:
        include, exclude = self._filters
        return (include is None or include.search(name) is not None) and (
            exclude is None or exclude.search(name) is None)

    def update(self, placement: Placement, selected: str, hidden: frozenset[str], now: float
               ) -> None:
        """Show the rows, twice a second at most; `now`: on the monotonic clock (s)."""
        if selected != self._selected:
            self._selected, self._next = selected, 0.0
        if now < self._next and not self._turns:
            return
        self._next = now + _PERIOD
        for box, names in (self._show, self._hidden), (self._show_branch, self._hidden_branches):
            box.show(selected not in names)
        rows = [*self._tree(placement, selected, hidden)]
        pages = max(1, -(-len(rows) // _ROWS))
        for i, row in enumerate(rows):
            if row.name == self._wanted:
                self._page = i // _ROWS
        self._wanted = ''
        while self._turns:
            self._page = min(self._page + self._turns.popleft(), pages - 1)
            self._page = max(self._page, 0)
        self._page = min(self._page, pages - 1)
        self._turn.visible = pages > 1
        self._rows = rows[self._page * _ROWS:(self._page + 1) * _ROWS]
        text = self._problem or (f'{len(rows)} of {len(placement.names)} frames'
                                 + f', page {self._page + 1} of {pages}' * (pages > 1))
        if selected:
            text += f'. Selected: {selected}{self._why_hidden(placement, selected)}'
        self._status.content = html(text, 'tree')
        with self._container:
            while len(self._buttons) < len(self._rows):
                button = self._gui.add_button('')
                button.on_click(self._on_click)
                self._buttons.append(button)
        for button, row in zip(self._buttons, self._rows):
            change(button, label=row.text, color=row.colour,
                   hint=shortened(row.name, LONGEST_NAME), visible=True)
        for button in self._buttons[len(self._rows):]:
            change(button, visible=False)

    def _why_hidden(self, placement: Placement, name: str) -> str:
        """Return why a frame is hidden although its own checkboxes are ticked, or ''."""
        if not self._passes(name):
            return ', hidden by the filters'
        branch = next((each for each in self_and_ancestors(name, placement.frames)
                       if each in self._hidden_branches and each != name), '')
        return f', hidden with the branch of {branch}' if branch else ''

    def _tree(self, placement: Placement, selected: str, hidden: frozenset[str]
              ) -> Iterator[_Row]:
        lines = [line for line in Forest(placement.frames.values()).lines()
                 if self._passes(line.name)]
        top = min((line.level for line in lines), default=0)
        for line in lines:
            frame = line.frame
            rate = '' if frame is None else 'static' if frame.is_static else (
                '-' if (hertz := rate_of(frame)) is None else f'{hertz:.1f} Hz')
            silence = placement.silences.get(line.name, 0.0)
            colour = (_HIDDEN if line.name in hidden else _STATIC if frame is None
                      or frame.is_static else next(
                          colour for colour, age in _COLOURS if silence <= age))
            text = _row_text(min(line.level - top, _DEEPEST), shortened(line.name), rate,
                             _SELECTED if line.name == selected else '')
            yield _Row(line.name, text, colour)


def _row_text(level: int, name: str, rate: str, mark: str) -> str:
    """Return the text of a row, with the end of a name that is too long."""
    room = _WIDTH - level * _INDENT // 2 - len(rate) - 2 * len(mark)  # a blank is half as wide
    if len(name) > room:
        name = f'…{name[-room + 1:]}'
    return f'{" " * level * _INDENT}{name}  {rate}{mark}'.replace(' ', '\u00a0') + _FILL


def _pattern(text: str) -> 'Optional[re.Pattern[str]]':
    """Compile a regular expression; None: it is empty; raise a ValueError if it is none."""
    if len(text) > _LONGEST_FILTER:
        raise ValueError(f'more than {_LONGEST_FILTER} characters')
    try:
        return re.compile(text) if text else None
    except (re.error, RecursionError, OverflowError) as error:
        raise ValueError(f'not a regular expression: {error}') from None
