"""What `tf_doctor` finds: in a list with causes and remedies, and as marks of frames."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import viser

from puretf import comma_list, SECOND, shortened
from puretf_tools.doctor.checks import Finding
from puretf_tools.view.controls import change, html, Row, Rows
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
        self._feed = feed
        with container:
            self._verdict = gui.add_html('')
        self._rows = Rows(gui, container)
        self.clicks: deque[Finding] = self._rows.clicks
        self._shown: Sequence[Finding] = ()

    def update(self) -> None:
        """Show what is new."""
        findings, verdict = self._feed.findings, self._feed.verdict
        if len(findings) > _MOST:
            verdict += f' (the first {_MOST} are below)'
        change(self._verdict, content=html(verdict or 'not examined yet', 'verdict'))
        if findings is not self._shown:
            self._shown = findings
            self._rows.show([Row(
                finding, self._title(finding), _COLOURS[finding.severity],
                html(f'{finding.evidence.rstrip(".")}. {finding.remedy}', 'finding'))
                for finding in findings[:_MOST]])

    def _title(self, finding: Finding) -> str:
        names = comma_list(finding.frames or finding.topics, _MOST_NAMES, shortened)
        player = self._feed.player
        time = f'{(finding.time - player.begin) / SECOND:+.2f} s: ' if player and (
            player.begin <= finding.time <= player.end) else ''
        return f'{time}{finding.code}: {names}'
