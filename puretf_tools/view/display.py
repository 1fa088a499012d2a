"""The controls with which a viewer chooses what is drawn, and from where it is seen."""

from collections.abc import Awaitable, Callable, Sequence
from html import escape
from typing import Any, Optional

import viser

from puretf import abbreviated, visible
from puretf_tools.view.axes import Display
from puretf_tools.view.body import BodyDisplay
from puretf_tools.view.controls import Setting, within
from puretf_tools.view.details import STYLE
from puretf_tools.view.silent_frames import TIMEOUT

#: By the name of a view: the direction from the middle of the frames to the camera (x, y, z).
VIEWS = {'all': (0.55, -0.7, 0.45), 'top': (0.0, -1e-3, 1.0), 'front': (1.0, 0.0, 0.0),
         'side': (0.0, -1.0, 0.0)}
#: The smallest and the largest length of an axis (m), side of a cell of the grid (m), timeout (s)
#: and update rate (Hz).
_SIZES, _CELLS, _TIMEOUTS, _RATES = (0.02, 2.0), (0.1, 10.0), (1.0, 60.0), (1.0, 30.0)
_OPACITIES = 0.1, 1.0
_MOST_LINES, _LONGEST_LINE = 30, 500
#: The place of a text below all controls, also those that are added later.
_LAST = 1e9


class DisplayPanel:
    """The controls of a `Display`."""

    def __init__(self, gui: viser.GuiApi, look_from: Callable[[str], Awaitable[object]]) -> None:
        """Add the controls; `look_from` moves the camera to one of `VIEWS`."""
        self._gui, self._look_from = gui, look_from
        views = gui.add_button_group('View', tuple(VIEWS))
        views.on_click(self._on_view)
        self._axes = gui.add_checkbox('Axes', True)
        self._size = gui.add_slider('Axis length (m)', *_SIZES, 0.02, 0.16)
        self._lines = gui.add_checkbox('Lines to parents', True)
        self._names = gui.add_checkbox('Show names', True)
        self._names_shown = Setting(self._names, self._choose_names)
        self._names_chosen: Optional[bool] = None
        self._grid = gui.add_checkbox('Grid', True)
        self._cell = gui.add_slider('Cell of the grid (m)', *_CELLS, 0.1, 0.5)
        self._timeout = gui.add_slider(
            'Frame timeout (s)', *_TIMEOUTS, 1.0, TIMEOUT,
            hint='a frame that was not updated for this time is not drawn')
        self._rate = gui.add_slider('Update rate (Hz)', *_RATES, 1.0, _RATES[1])
        self._dark = gui.add_checkbox('Dark', False)
        self._dark.on_update(self._on_dark)

    async def _on_view(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.target.value in VIEWS:
            await self._look_from(event.target.value)

    def _choose_names(self, are_shown: bool) -> None:
        self._names_chosen = are_shown

    async def _on_dark(self, event: 'viser.GuiEvent[Any]') -> None:
        configure(self._gui, bool(event.target.value))

    @property
    def period(self) -> float:
        """The shortest time between two updates (s); 0.0: the page is updated whenever it can."""
        rate = within(self._rate.value, *_RATES)
        return 0.0 if rate == _RATES[1] else 1.0 / rate

    def show_names(self, are_few: bool) -> None:
        """Tick the checkbox for names if there are few, unless the viewer has used it."""
        self._names_shown.show(are_few if self._names_chosen is None else self._names_chosen)

    def display(self, hidden: frozenset[str]) -> Display:
        """Return what is to be drawn, without some frames."""
        size = within(value := self._size.value, *_SIZES)
        if size != value:  # such as NaN, which a viewer has sent
            self._size.value = size
        return Display(
            size, bool(self._axes.value), bool(self._lines.value), bool(self._names.value),
            within(self._cell.value, *_CELLS) if self._grid.value else 0.0,
            within(self._timeout.value, *_TIMEOUTS), hidden, bool(self._dark.value))


def configure(gui: viser.GuiApi, is_dark: bool) -> None:
    """Set the theme of a viewer."""
    gui.configure_theme(dark_mode=is_dark, show_logo=False, show_share_button=False,
                        control_width='large')


class RobotPanel:
    """The controls of a `BodyDisplay`, and lines about descriptions and meshes."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the current container."""
        self._visual = gui.add_checkbox('Visual', True, hint='the shapes as they look')
        self._collision = gui.add_checkbox(
            'Collision', False, hint='the shapes with which programs check for collisions')
        self._opacity = gui.add_slider('Opacity', *_OPACITIES, 0.05, _OPACITIES[1])
        self._text = gui.add_html('', order=_LAST)
        self._lines: tuple[Sequence[str], Sequence[str]] = (), ()

    @property
    def display(self) -> BodyDisplay:
        """What the viewer has chosen."""
        return BodyDisplay(bool(self._visual.value), bool(self._collision.value),
                           within(self._opacity.value, *_OPACITIES))

    def show(self, lines: tuple[Sequence[str], Sequence[str]]) -> None:
        """Show lines of text, and folded ones; the same object: they have not changed."""
        if lines is self._lines:
            return
        self._lines = lines
        shown, folded = map(_joined, lines)
        if folded:
            shown += ('<details><summary>meshes that are not drawn</summary>'
                      f'{folded}</details>')
        self._text.content = f'<div style="{STYLE}" data-text="robot">{shown}</div>'


def _joined(lines: Sequence[str]) -> str:
    rest = len(lines) - _MOST_LINES
    return '<br>'.join(escape(visible(abbreviated(line, _LONGEST_LINE))) for line in [
        *lines[:_MOST_LINES], *[f'and {rest} more lines'] * (rest > 0)])
