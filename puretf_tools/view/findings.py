"""What `tf_doctor` finds: in a list with causes and remedies, and as marks of frames."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import viser

from puretf import comma_list, SECOND, shortened, visible
from puretf_tools.doctor.checks import Finding
from puretf_tools.view.controls import change
from puretf_tools.view.details import html
from puretf_tools.view.feed import Feed

_MOST, _MOST_NAMES = 20, 3
_COLOURS = {'error': (190, 30, 30), 'warning': (133, 100, 0), 'info': (28, 100, 190)}


def marks(findings: Sequence[Finding]) -> dict[str, str]:
    """Return by frame the code of its worst finding."""
    return {frame: finding.code for finding in reversed(findings) for frame in finding.frames}


class Findings:
    """A button and a text for each finding."""

    def __init__(self, gui: viser.GuiApi, container: Any, feed: Feed) -> None:
        """Add the controls to a tab."""
        self._gui, self._container, self._feed = gui, container, feed
        self._rows: list[tuple[Any, Any]] = []
        self._shown: Sequence[Finding] = ()
        #: The finding that was clicked last, until somebody takes it.
        self.clicks: deque[Finding] = deque(maxlen=1)
        with container:
            self._verdict = gui.add_html('')

    async def _on_click(self, event: 'viser.GuiEvent[Any]') -> None:
        number = [button for button, _ in self._rows].index(event.target)
        if number < len(self._shown):
            self.clicks.append(self._shown[number])

    def update(self) -> None:
        """Show what is new."""
        verdict = self._feed.verdict
        if more := len(self._feed.findings) - _MOST:
            verdict += f' (the first {_MOST} are below)' * (more > 0)
        change(self._verdict, content=html(verdict or 'not examined yet', 'verdict'))
        if self._feed.findings is self._shown:
            return
        self._shown = self._feed.findings
        with self._container:
            for _ in self._shown[len(self._rows):_MOST]:
                button = self._gui.add_button('')
                button.on_click(self._on_click)
                self._rows.append((button, self._gui.add_html('')))
        for i, (button, text) in enumerate(self._rows):
            if is_shown := i < len(self._shown):
                finding = self._shown[i]
                change(button, label=self._title(finding), color=_COLOURS[finding.severity])
                change(text, content=html(
                    f'{visible(finding.evidence.rstrip("."))}. {finding.remedy}', 'finding'))
            change(button, visible=is_shown)
            change(text, visible=is_shown)

    def _title(self, finding: Finding) -> str:
        names = comma_list(finding.frames or finding.topics, _MOST_NAMES, shortened)
        player = self._feed.player
        time = f'{(finding.time - player.begin) / SECOND:+.2f} s: ' if player and (
            player.begin <= finding.time <= player.end) else ''
        return f'{time}{finding.code}: {names}'
