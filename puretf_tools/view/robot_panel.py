"""The controls and texts of the bodies of robots."""

from collections.abc import Sequence
from html import escape

import viser

from puretf.formatting import abbreviated, visible
from puretf_tools.view.body import BodyDisplay
from puretf_tools.view.controls import within
from puretf_tools.view.details import STYLE

_OPACITIES = 0.1, 1.0
_MOST_LINES, _LONGEST_LINE = 30, 500


class RobotPanel:
    """The controls of a `BodyDisplay`, and lines about descriptions and meshes."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the current container."""
        self._visual = gui.add_checkbox('Visual', True, hint='the shapes as they look')
        self._collision = gui.add_checkbox(
            'Collision', False, hint='the shapes with which programs check for collisions')
        self._opacity = gui.add_slider('Opacity', *_OPACITIES, 0.05, _OPACITIES[1])
        self._text = gui.add_html('')
        self._lines: Sequence[str] = ()

    @property
    def display(self) -> BodyDisplay:
        """What the viewer has chosen."""
        return BodyDisplay(bool(self._visual.value), bool(self._collision.value),
                           within(self._opacity.value, *_OPACITIES))

    def show(self, lines: Sequence[str]) -> None:
        """Show lines of text; the same object: they have not changed."""
        if lines is not self._lines:
            self._lines = lines
            shown = [*lines[:_MOST_LINES], *[f'and {len(lines) - _MOST_LINES} more lines'] * (
                len(lines) > _MOST_LINES)]
            self._text.content = (f'<div style="{STYLE}" data-text="robot">'
                                  f'{"<br>".join(map(_text, shown))}</div>')


def _text(line: str) -> str:
    return escape(visible(abbreviated(line, _LONGEST_LINE)))
