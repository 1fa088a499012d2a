"""What the checks find in the transforms that arrive, while a program listens."""

from collections.abc import Callable, Iterable, Sequence
from math import inf
from time import thread_time
from typing import TYPE_CHECKING

from puretf._causes.facts import Heard
from puretf.transform_table import Message, transform_tables, TransformTable
from puretf_tools.doctor.checks import diagnose, Finding, SEVERITIES
from puretf_tools.doctor.observation import listened, Observation
from puretf_tools.doctor.stream import FEWEST
from puretf_tools.doctor.tf_statistics import Statistics
from puretf_tools.inspection.traffic import SETTLING

if TYPE_CHECKING:
    from puretf_tools.inspection.frame_listener import FrameListener

#: The time between two examinations, what they look at, and what is over if it is not found in the
#: last part of it (s). An examination is followed by a rest of `_REST` times as long.
_PERIOD, _LENGTH, _LAST, _REST = 3.0, 30.0, 6.0, 19.0
#: The largest number of transforms that are kept; a table counts as some more.
_MOST, _TABLE = 300_000, 10
#: Of a frame that is sent too seldom now, it is not known whether these are over.
_OF_STEPS = 'gap', 'jump', 'one_shot'
_NOT_KNOWN = dict.fromkeys(('headers', 'listeners', 'qos'), 'tf_doctor looks for them')
#: By publisher and child: the newest static transform, as a table.
_Static = dict[tuple[str, str], TransformTable]


class RecentFindings:
    """The findings in what has arrived in the last half minute."""

    def __init__(self, listener: 'FrameListener') -> None:
        self._listener, self._pulse = listener, listener.pulse
        self._begin, self._next = inf, 0.0  # of the first examination, and of the next one (s)
        #: When transforms were received (s), and these; the static ones before.
        self._tables: list[tuple[float, TransformTable]] = []
        self._before: _Static = {}
        self.findings: Sequence[Finding] = ()  #: those that are over come last
        self.verdict = ''

    def update(self, messages: Iterable[Message], is_complete: bool,
               others: Callable[[float], Sequence[Heard]], now: float) -> None:
        """
        Examine the messages of the last half minute.

        :param messages: those since the last call.
        :param is_complete: False if messages before these were lost.
        :param others: returns what was heard on other topics since a time (s).
        :param now: on the monotonic clock (s).
        """
        begin, self._begin = thread_time(), min(self._begin, now)
        if not is_complete:
            self._before, self._tables = self._parts(inf)
        self._tables += ((now, table) for table in transform_tables(messages))
        count, oldest = 0, now - _LENGTH + _PERIOD
        for time, table in reversed(self._tables):
            count += table.stamps.size + _TABLE
            if count > _MOST and time < now:
                oldest = max(oldest, time)
        self._before, self._tables = self._parts(oldest)
        self._examine(others, now)
        self._next = now + max(_PERIOD, _REST * (thread_time() - begin))

    def is_due(self, now: float) -> bool:
        """Return whether `update` is to be called, so that it takes 5 % of the time at most."""
        return now >= self._next

    def _parts(self, time: float) -> tuple[_Static, list[tuple[float, TransformTable]]]:
        """Return the static transforms before a time (s), and what was received after it."""
        static, after = {**self._before}, [each for each in self._tables if each[0] > time]
        for _, table in self._tables[:len(self._tables) - len(after)]:
            for i, edge in enumerate(table.edges if table.is_static else ()):
                static[table.publisher, edge[1].removeprefix('/')] = table._replace(
                    edges=[edge], times=table.times[-1:], stamps=table.stamps[-1:, i:i + 1],
                    poses=table.poses[-1:, i:i + 1])
        return {key: table for key, table in static.items()
                if self._listener.is_present(key[0]) is not False}, after

    def _observed(self, others: Callable[[float], Sequence[Heard]], now: float, time: float
                  ) -> Observation:
        """Return what was received after a time (s)."""
        listener, (static, after) = self._listener, self._parts(time)
        statistics = Statistics(SETTLING, listener.clock)
        for table in (*static.values(), *(table for _, table in after)):
            statistics.add(table)
        return listened(listener, statistics, '', now - self._begin, {**_NOT_KNOWN},
                        other_transforms=others(time), late=self._pulse.late(_LENGTH))

    def _examine(self, others: Callable[[float], Sequence[Heard]], now: float) -> None:
        observed = self._observed(others, now, now - _LENGTH)
        found = diagnose(observed, ignored=['no_transforms'])
        if found and now >= self._begin + _LAST:
            observed = self._observed(others, now, now - _LAST)
        still, findings = diagnose(observed) if found else [], []
        regular = {each.child for each in observed.tracks if each.stream.steps >= FEWEST}
        for each in found:
            before = next((old for old in self.findings if _is_same(old, each)), None)
            is_over = not any(_is_same(other, each) for other in still) and (
                each.code not in _OF_STEPS or {*each.frames} <= regular)
            since, over = (before.since, before.over) if before else (now, 0.0)
            findings.append(each._replace(
                since=since, over=(over or max(since, now - _LAST)) if is_over else 0.0))
        self.findings = sorted(findings, key=lambda each: (
            each.over > 0.0, SEVERITIES.index(each.severity), each.code, each.frames))
        over, clock = sum(each.over > 0.0 for each in findings), self._listener.clock_text()
        count, span = len(findings) - over, f'in the last {_LENGTH:.0f} s'
        self.verdict = (f'{count} finding{"" if count == 1 else "s"}' if count else 'healthy') + (
            f'; over {span}: {over}' if over else f' {span}') + (clock and f'; {clock}')


def _is_same(finding: Finding, other: Finding) -> bool:
    return finding.code == other.code and (
        finding.frames == other.frames or not {*finding.frames}.isdisjoint(other.frames))
