"""The panel at the left: the tree of frames, and what `tf_doctor` finds wrong with them."""

from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from math import inf
from typing import Any

import viser

from puretf import SECOND
from puretf._text.names import comma_list, shortened
from puretf_tools.doctor.checks import ERROR, Finding
from puretf_tools.inspection.forest import Forest, self_and_ancestors
from puretf_tools.view.controls import change, html, Row, Rows
from puretf_tools.view.details import rate_text
from puretf_tools.view.feed import Feed
from puretf_tools.view.placement import Placement
from puretf_tools.view.settings import Settings

#: The largest number of rows, and the time between two updates (s).
_ROWS, _PERIOD = 200, 0.5
#: The colours of rows by what is wrong, and of others: red, green, blue. White text on each of
#: these has a contrast of more than 5:1.
_COLOURS, _QUIET = {'error': (190, 30, 30), 'warning': (133, 100, 0)}, (95, 100, 105)
#: Words behind this many characters of a text do not count, so that each search takes little time.
_LONGEST_TEXT = 1024
_SELECTED = ' ◀'
#: The number of characters of a name in a row, and in the bar; the number of levels that are
#: indented.
_NAME, _SHORT_NAME, _DEEPEST = 28, 20, 20
_HIDE, _SHOW, _HIDE_BRANCH, _SHOW_BRANCH, _FOCUS = (
    'hide', 'show', 'hide its branch', 'show its branch', 'focus')
#: The largest numbers of findings, and of rows that one marks.
_MOST, _MOST_MARKS = 20, 10


class Tree:
    """A row for each frame; a click selects it, and a click on the selected row folds it."""

    def __init__(self, gui: viser.GuiApi, container: Any, settings: Settings,
                 on_focus: Callable[[], Awaitable[object]]) -> None:
        """Add the controls to a tab; `on_focus` moves the camera to the selected frame."""
        self._on_focus = on_focus
        self._selected = ''
        #: What the shown rows depend on, and the time of their next update (s, monotonic clock).
        self._key: tuple[object, ...] = ()
        self._next = 0.0
        #: The frames that the viewer has hidden, and those hidden with all that is below them, and
        #: those whose children have no rows.
        self._hidden, self._hidden_branches, self._folded = map(
            settings.names, ('Hidden', 'Hidden branches', 'Folded'))
        with container:
            gui.add_html('<div class="tf-tree"></div>')  # for additions.html, as "tf-rows" below
            self._search = gui.add_text('Search', '')
            self._bar = gui.add_button_group('', (_HIDE, _HIDE_BRANCH, _FOCUS))
            self._bar.on_click(self._on_bar)
            self._status = gui.add_html('')
        self.rows = Rows(gui, container)

    async def _on_bar(self, event: 'viser.GuiEvent[Any]') -> None:
        action, name = event.target.value, self._selected
        hidden = self._hidden_branches if action in (_HIDE_BRANCH, _SHOW_BRANCH) else self._hidden
        if action == _FOCUS:
            await self._on_focus()
        elif name:
            hidden ^= {name}

    def hidden(self, placement: Placement, passes: Callable[[str], bool]) -> frozenset[str]:
        """Return the frames that are not to be drawn; `passes`: whether a name passes filters."""
        branches = self._hidden_branches
        return frozenset(name for name in placement.names if (
            name in self._hidden or not passes(name) or (branches and
            not branches.isdisjoint(self_and_ancestors(name, placement.frames)))))

    def fold(self, name: str) -> None:
        """Fold the row of a frame, or unfold it."""
        self._folded ^= {name}

    def unfold(self, placement: Placement, name: str) -> None:
        """Let a frame have a row."""
        self._folded.difference_update([*self_and_ancestors(name, placement.frames)][1:])

    def update(self, placement: Placement, selected: str, hidden: frozenset[str],
               findings: Sequence[Finding], now: float) -> None:
        """Show the rows: at once if the viewer has changed something, and twice a second."""
        key = selected, self._search.value, hidden, frozenset(self._folded), (
            selected in self._hidden, selected in self._hidden_branches)
        if now < self._next and key == self._key:
            return
        self._selected, self._key, self._next = selected, key, now + _PERIOD
        change(self._bar, label=shortened(selected, _SHORT_NAME), options=(
            _SHOW if selected in self._hidden else _HIDE,
            _SHOW_BRANCH if selected in self._hidden_branches else _HIDE_BRANCH, _FOCUS))
        rows = [*self._tree(placement, selected, hidden, findings)]
        status = f'{len(rows)} of {len(placement.names)} frames'
        if len(rows) > _ROWS:
            status += f'; {len(rows) - _ROWS} more have no row: search, or fold some'
        change(self._status, content=f'<div class="tf-rows">{html(status, "tree")}</div>')
        self.rows.show(rows[:_ROWS])

    def _tree(self, placement: Placement, selected: str, hidden: frozenset[str],
              findings: Sequence[Finding]) -> Iterator[Row]:
        lines = [*Forest(placement.frames.values()).lines()]
        parents = {frame.parent for frame in placement.frames.values()}
        wanted = words_of(self._search.value)
        found = {each for line in lines if has_words(line.name, wanted)
                 for each in self_and_ancestors(line.name, placement.frames)} if wanted else None
        marks = {frame: finding for finding in reversed(findings)  # the worst comes last
                 for frame in finding.frames if len(finding.frames) <= _MOST_MARKS}
        folded_at = inf
        for line in lines:
            if line.level <= folded_at:
                folded_at = inf
            if line.level > folded_at or (found is not None and line.name not in found):
                continue
            is_folded = not wanted and line.name in self._folded
            if is_folded:
                folded_at = line.level
            fold = ' ' if line.name not in parents else '▸' if is_folded else '▾'
            mark = marks.get(line.name)
            severity = mark.severity if mark else 'warning' if line.name in placement.late else ''
            yield Row(line.name, '  '.join((
                f'{"  " * min(line.level, _DEEPEST)}{fold} {shortened(line.name, _NAME)}',
                *([f'{"✖" if mark.severity == ERROR else "⚠"} {mark.code}'] if mark else []),
                'hidden' if line.name in hidden else rate_text(placement, line.name)))
                + _SELECTED * (line.name == selected), _COLOURS.get(severity, _QUIET))


class Findings:
    """A button and a text for each finding."""

    def __init__(self, gui: viser.GuiApi, container: Any, feed: Feed) -> None:
        """Add the controls to a tab."""
        self._feed = feed
        with container:
            self._verdict = gui.add_html('')
        self.rows = Rows(gui, container)
        self._shown: Sequence[Finding] = ()

    def update(self) -> None:
        """Show what is new."""
        findings, verdict = self._feed.findings, self._feed.verdict
        if len(findings) > _MOST:
            verdict += f' (the first {_MOST} are below)'
        change(self._verdict, content=html(verdict or 'not examined yet', 'verdict'))
        if findings is not self._shown:
            self._shown = findings
            self.rows.show([Row(
                finding, self._title(finding), _COLOURS.get(finding.severity, _QUIET),
                html(f'{finding.evidence.rstrip(".")}. ' + bool(finding.nodes) * (
                    f'Sent by {comma_list(finding.nodes)}. ') + finding.remedy,
                     'finding')) for finding in findings[:_MOST]])

    def _title(self, finding: Finding) -> str:
        names = comma_list(finding.frames or finding.topics, shortened, shown=3)
        player = self._feed.player
        time = f'{(finding.time - player.begin) / SECOND:+.2f} s: ' if player and (
            player.begin <= finding.time <= player.end) else ''
        return f'{time}{finding.code}: {names}'


def words_of(text: str) -> list[str]:
    """Return the words of a text; a hyphen alone is no word yet."""
    return [word for word in text[:_LONGEST_TEXT].casefold().split() if word != '-']


def has_words(name: str, words: Iterable[str]) -> bool:
    """Return whether a name has all words, in any case, and none of those behind a hyphen."""
    name = name.casefold()
    return all(word[1:] not in name if word.startswith('-') else word in name for word in words)
