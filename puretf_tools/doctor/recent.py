"""What the checks find in the transforms that arrive, while a program listens."""

from collections.abc import Sequence
from math import inf
from time import thread_time
from typing import TYPE_CHECKING

from puretf.transform_table import Message, transform_tables, TransformTable
from puretf_tools.doctor.checks import diagnose, Finding, SEVERITIES
from puretf_tools.doctor.observation import listened, Observation
from puretf_tools.doctor.stream import FEWEST
from puretf_tools.doctor.tf_statistics import Statistics
from puretf_tools.inspection.traffic import SETTLING

if TYPE_CHECKING:
    from puretf.publisher_listener import Received, TransformSampler
    from puretf_tools.inspection.frame_listener import FrameListener

#: The time between two examinations, what they look at, and what is over if it is not found in the
#: last part of it (s). An examination is followed by a rest of `_REST` times as long.
_PERIOD, _LENGTH, _LAST, _REST = 3.0, 30.0, 6.0, 19.0
#: With more messages, an examination does not wait.
_MOST_WAITING = 10_000
#: The largest number of transforms that are kept; a table counts as some more.
_MOST, _TABLE = 300_000, 10
#: Of a frame that is sent too seldom now, it is not known whether these are over.
_OF_STEPS = 'gap', 'jump', 'one_shot'
_NOT_KNOWN = dict.fromkeys(('headers', 'listeners', 'qos'), 'tf_doctor looks for them')
#: By publisher and child: the newest static transform, as a table.
_Static = dict[tuple[str, str], TransformTable]


class RecentFindings:
    """The findings in what has arrived in the last half minute."""

    def __init__(self, listener: 'FrameListener', others: 'TransformSampler') -> None:
        """Examine nothing yet; `others`: listens to other topics of transforms."""
        self._listener, self._others, self._pulse = listener, others, listener.pulse
        self._begin, self._next = inf, 0.0  # of the first examination, and of the next one (s)
        self._waiting: list[Message] = []  #: those since the last examination
        #: When transforms were received (s), and these; the static ones before.
        self._tables: list[tuple[float, TransformTable]] = []
        self._before: _Static = {}
        self.findings: Sequence[Finding] = ()  #: those that are over come last
        self.verdict = ''

    def update(self, received: 'Received', now: float) -> bool:
        """
        Examine the messages of the last half minute, if it is time to.

        That takes 5 % of the time at most, unless there are very many messages.

        :param received: the messages since the last call.
        :param now: on the monotonic clock (s).
        :returns: whether they were examined.
        """
        self._waiting += received.messages
        if received.dropped:
            self._before, self._tables = self._parts(inf)
        if now < self._next and len(self._waiting) <= _MOST_WAITING:
            return False
        begin, self._begin = thread_time(), min(self._begin, now)
        self._others.poll()
        self._tables += ((now, table) for table in transform_tables(self._waiting))
        self._waiting = []
        count, oldest = 0, now - _LENGTH + _PERIOD
        for time, table in reversed(self._tables):
            count += table.stamps.size + _TABLE
            if count > _MOST and time < now:
                oldest = max(oldest, time)
        self._before, self._tables = self._parts(oldest)
        self._examine(now)
        self._next = now + max(_PERIOD, _REST * (thread_time() - begin))
        return True

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

    def _observed(self, now: float, time: float) -> Observation:
        """Return what was received after a time (s)."""
        listener, (static, after) = self._listener, self._parts(time)
        statistics = Statistics(SETTLING, listener.clock)
        for table in (*static.values(), *(table for _, table in after)):
            statistics.add(table)
        return listened(listener, statistics, '', now - self._begin, {**_NOT_KNOWN},
                        other_transforms=self._others.heard(time), late=self._pulse.late(_LENGTH))

    def _examine(self, now: float) -> None:
        observed = self._observed(now, now - _LENGTH)
        found = diagnose(observed, ignored=['no_transforms'])
        if found and now >= self._begin + _LAST:
            observed = self._observed(now, now - _LAST)
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
