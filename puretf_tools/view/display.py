"""The controls with which a viewer chooses what is drawn, and from where it is seen."""

from collections.abc import Sequence
from html import escape
import re
from typing import Any, Optional

import viser

from puretf import abbreviated, visible
from puretf_tools.view.axes import Display
from puretf_tools.view.body import BodyDisplay
from puretf_tools.view.controls import Setting, Settings, within
from puretf_tools.view.details import html, STYLE
from puretf_tools.view.silent_frames import TIMEOUT

#: By the name of a view: the direction from the middle of the frames to the camera (x, y, z).
VIEWS = {'all': (0.55, -0.7, 0.45), 'top': (0.0, -1e-3, 1.0), 'front': (1.0, 0.0, 0.0),
         'side': (0.0, -1.0, 0.0)}
#: The smallest and the largest length of an axis (m), and timeout (s).
_SIZES, _TIMEOUTS = (0.02, 2.0), (1.0, 60.0)
_OPACITIES = 0.1, 1.0
#: Red, green, blue of the buttons, by whether the page is dark: viser's own are too light for
#: white text.
_BRANDS = (10, 70, 145), (95, 150, 225)
_MOST_LINES, _LONGEST_LINE = 30, 500
_LONGEST_FILTER = 200  # characters
#: The place of a text below all controls, also those that are added later.
LAST = 1e9


class DisplayPanel:
    """The controls of a `Display`."""

    def __init__(self, gui: viser.GuiApi, settings: Settings) -> None:
        """Add the controls to the current container."""
        self._gui = gui
        self._include, self._exclude = (
            settings.control(gui.add_text(label, '')) for label in ('Include', 'Exclude'))
        self._problem = gui.add_html('')
        #: The expressions of the frames that are shown, and of those that are not; None: of none.
        self._filters: list[Optional[re.Pattern[str]]] = [None, None]
        for box in self._include, self._exclude:
            box.on_update(self._on_filter)
        self._axes = settings.control(gui.add_checkbox('Axes', True))
        self._size = settings.control(gui.add_slider('Axis length (m)', *_SIZES, 0.02, 0.16))
        self._lines = settings.control(gui.add_checkbox('Lines to parents', True))
        self._names_shown = Setting(gui.add_checkbox('Show names', True), self._choose_names)
        self._names_chosen: Optional[bool] = None
        settings.add('Show names', lambda: self._names_chosen, self._choose_names, bool,
                     type(None))
        self._grid = settings.control(gui.add_checkbox('Grid', True))
        self._timeout = settings.control(
            gui.add_slider('Frame timeout (s)', *_TIMEOUTS, 1.0, TIMEOUT))
        self._dark = settings.control(gui.add_checkbox('Dark', False))
        self._dark.on_update(self._on_dark)

    async def _on_filter(self, event: 'viser.GuiEvent[Any]') -> None:
        filters, problem = [], ''
        for label, box in ('Include', self._include), ('Exclude', self._exclude):
            try:
                filters.append(_pattern(str(box.value)))
            except ValueError as error:
                problem = f'{label}: {error}'
                filters.append(None)
        self._filters, self._problem.content = filters, html(problem, 'filter')

    def passes(self, name: str) -> bool:
        """Return whether the name of a frame passes the filters."""
        include, exclude = self._filters
        return (include is None or include.search(name) is not None) and (
            exclude is None or exclude.search(name) is None)

    def _choose_names(self, are_shown: Optional[bool]) -> None:
        self._names_chosen = are_shown

    async def _on_dark(self, event: 'viser.GuiEvent[Any]') -> None:
        configure(self._gui, bool(event.target.value))

    def show_names(self, are_few: bool) -> None:
        """Tick the checkbox for names if there are few, unless the viewer has used it."""
        self._names_shown.show(are_few if self._names_chosen is None else self._names_chosen)

    def display(self, hidden: frozenset[str]) -> Display:
        """Return what is to be drawn, without some frames."""
        size = within(value := self._size.value, *_SIZES)
        if size != value:  # such as NaN, which a viewer has sent
            self._size.value = size
        return Display(
            size, bool(self._axes.value), bool(self._lines.value),
            bool(self._names_shown.value), bool(self._grid.value),
            within(self._timeout.value, *_TIMEOUTS), hidden, bool(self._dark.value))


def configure(gui: viser.GuiApi, is_dark: bool) -> None:
    """Set the theme of a viewer."""
    gui.configure_theme(dark_mode=is_dark, show_logo=False, show_share_button=False,
                        control_width='large', brand_color=_BRANDS[is_dark])


def _pattern(text: str) -> 'Optional[re.Pattern[str]]':
    """Compile a regular expression; None: it is empty; raise a ValueError if it is none."""
    if len(text) > _LONGEST_FILTER:
        raise ValueError(f'more than {_LONGEST_FILTER} characters')
    try:
        return re.compile(text) if text else None
    except (re.error, RecursionError, OverflowError) as error:
        raise ValueError(f'not a regular expression: {error}') from None


class RobotPanel:
    """The controls of a `BodyDisplay`, and lines about descriptions and meshes."""

    def __init__(self, gui: viser.GuiApi, settings: Settings) -> None:
        """Add the controls to the current container."""
        self._visual, self._collision, self._opacity = map(settings.control, (
            gui.add_checkbox('Visual', True), gui.add_checkbox('Collision', False),
            gui.add_slider('Opacity', *_OPACITIES, 0.05, _OPACITIES[1])))
        self._text = gui.add_html('', order=LAST)
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
