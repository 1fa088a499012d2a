"""The tree of frames, and what `tf_doctor` finds wrong with them, as page.js draws them."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from puretf import SECOND
from puretf._text.names import comma_list, shortened, visible
from puretf_tools.doctor.checks import Finding
from puretf_tools.inspection.forest import Forest, self_and_ancestors
from puretf_tools.view.controls import change, values
from puretf_tools.view.details import rate_text
from puretf_tools.view.feed import Feed
from puretf_tools.view.placement import Placement
from puretf_tools.view.settings import Settings

#: Words behind this many characters of a text do not count, so that each search takes little time.
_LONGEST_TEXT = 1024
#: The largest numbers of findings, and of rows that one marks.
_MOST, _MOST_MARKS = 20, 10


class Tree:
    """The rows of the frames, the findings below them, and the line at the foot of the page."""

    def __init__(self, state: Any, settings: Settings, feed: Feed, events: str) -> None:
        """Write into a text; `events`: the uuid of the control by which the page answers."""
        self._state, self._feed, self._events = state, feed, events
        #: By action: the frames that the viewer has hidden, and those hidden with all that is
        #: below them, and those whose children have no rows.
        self.sets = {action: settings.names(name) for action, name in (
            ('hide', 'Hidden'), ('branch', 'Hidden branches'), ('fold', 'Folded'))}

    def hidden(self, placement: Placement, words: str) -> frozenset[str]:
        """Return the frames that are not to be drawn; `words`: those of the filter."""
        branches, passes = self.sets['branch'], filter_of(words)
        return frozenset(name for name in placement.names if (
            name in self.sets['hide'] or not passes(name) or (branches and
            not branches.isdisjoint(self_and_ancestors(name, placement.frames)))))

    def update(self, placement: Placement, selected: str, hidden: frozenset[str],
               progress: Sequence[str], now: float) -> None:
        """Show the rows; `progress`: further texts for the line at the foot."""
        findings, count = self._feed.findings[:_MOST], len(placement.names)
        change(self._state, content=values('state', {  # the beat: so that it changes each second
            'events': self._events, 'selected': visible(selected), 'beat': int(now),
            'rows': [*self._rows(placement, hidden, findings)], 'findings': [
                (finding.severity, self.title(finding), f'{finding.evidence.rstrip(".")}.'
                 + _senders(finding), finding.remedy,
                 _since(finding, now), finding.over > 0.0) for finding in findings],
            'verdict': self._feed.verdict, 'more': len(self._feed.findings) - len(findings),
            'status': [f'fixed frame {visible(placement.fixed) or "none"}',
                       f'{count} frame{"" if count == 1 else "s"}', *progress,
                       f'{self._feed.now() / SECOND:.1f} s']}))

    def _rows(self, placement: Placement, hidden: frozenset[str], findings: Sequence[Finding]
              ) -> Iterator[tuple[Any, ...]]:
        """Yield rows: name, level, whether it is unfolded, rate, age, is hidden, findings."""
        parents = {frame.parent for frame in placement.frames.values()}
        ages = dict(zip(placement.names, (placement.ages * (10.0 / placement.timeout)).tolist()))
        marks = [(i, finding.frames) for i, finding in enumerate(findings)
                 if len(finding.frames) <= _MOST_MARKS and not finding.over]
        for line in Forest(placement.frames.values()).lines():
            name, is_dynamic = line.name, line.frame and not line.frame.is_static
            yield (visible(name), line.level, name not in self.sets['fold'] if name in parents
                   else None, 'hidden' if name in hidden else rate_text(placement, name),
                   round(ages[name]) if is_dynamic else None, name in hidden,
                   [i for i, frames in marks if name in frames])

    def title(self, finding: Finding) -> str:
        """Return when a finding was, its code and its frames."""
        names = comma_list(finding.frames or finding.topics, shortened, shown=3)
        player = self._feed.player
        time = f'{(finding.time - player.begin) / SECOND:+.2f} s: ' if player and (
            player.begin <= finding.time <= player.end) else ''
        return f'{time}{finding.code}: {names}'


def _senders(finding: Finding) -> str:
    if all(node in finding.evidence for node in finding.nodes):
        return ''
    return f' Sent by {comma_list(finding.nodes)}.'


def _since(finding: Finding, now: float) -> str:
    if finding.over:
        return f'over since {now - finding.over:.0f} s'
    return f'since {now - finding.since:.0f} s' if finding.since else ''


def filter_of(text: str) -> Callable[[str], bool]:
    """Return whether a name has all words, in any case, and none of those behind a hyphen."""
    # A hyphen alone is no word yet.
    words = [word for word in text[:_LONGEST_TEXT].casefold().split() if word != '-']

    def passes(name: str) -> bool:
        name = name.casefold()
        return all(word[1:] not in name if word.startswith('-') else word in name
                   for word in words)

    return passes
