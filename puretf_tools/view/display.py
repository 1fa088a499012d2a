"""The controls with which a viewer chooses what is drawn."""

import re
from typing import Any, Optional

import viser

from puretf_tools.view.axes_and_trail import Display
from puretf_tools.view.controls import Choice, html, Settings
from puretf_tools.view.silent_frames import TIMEOUT

#: Red, green, blue of the buttons, by whether the page is dark: viser's own are too light for
#: white text.
_BRANDS = (10, 70, 145), (95, 150, 225)


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
        self._size = settings.control(
            gui.add_slider('Axis length (m)', 0.02, 2.0, 0.02, Display().size))
        self._lines = settings.control(gui.add_checkbox('Lines to parents', True))
        self.names = Choice(gui.add_checkbox('Show names', True), settings)
        self._grid = settings.control(gui.add_checkbox('Grid', True))
        self._timeout = settings.control(
            gui.add_slider('Frame timeout (s)', 1.0, 60.0, 1.0, TIMEOUT))
        self._dark = settings.control(gui.add_checkbox('Dark', False))
        self._dark.on_update(self._on_dark)

    async def _on_filter(self, event: 'viser.GuiEvent[Any]') -> None:
        filters, problem = [], ''
        for label, box in ('Include', self._include), ('Exclude', self._exclude):
            try:
                filters.append(re.compile(box.value) if box.value else None)
            except (re.error, RecursionError, OverflowError) as error:
                problem = f'{label}: not a regular expression: {error}'
                filters.append(None)
        self._filters, self._problem.content = filters, html(problem, 'filter')

    def passes(self, name: str) -> bool:
        """Return whether the name of a frame passes the filters."""
        include, exclude = self._filters
        return (include is None or include.search(name) is not None) and (
            exclude is None or exclude.search(name) is None)

    async def _on_dark(self, event: 'viser.GuiEvent[Any]') -> None:
        configure(self._gui, bool(event.target.value))

    def display(self, hidden: frozenset[str]) -> Display:
        """Return what is to be drawn, without some frames."""
        return Display(
            self._size.value, self._axes.value, self._lines.value, self.names.value,
            self._grid.value, self._timeout.value, hidden, self._dark.value)


def configure(gui: viser.GuiApi, is_dark: bool) -> None:
    """Set the theme of a viewer."""
    gui.configure_theme(dark_mode=is_dark, show_logo=False, show_share_button=False,
                        control_width='large', brand_color=_BRANDS[is_dark])
