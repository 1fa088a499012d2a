"""What the checks find in the transforms that arrive, while a program listens."""

from collections.abc import Iterable, Sequence
from time import thread_time
from typing import TYPE_CHECKING

import numpy as np

from puretf._causes.facts import Heard
from puretf.transform_table import Message, TransformTable
from puretf_tools.doctor.checks import Finding, SEVERITIES
from puretf_tools.doctor.observation import Observation
from puretf_tools.doctor.report import examine
from puretf_tools.doctor.tf_statistics import Statistics
from puretf_tools.inspection.stamp_clock import StampClock
from puretf_tools.inspection.traffic import SETTLING

if TYPE_CHECKING:
    from puretf_tools.inspection.frame_listener import FrameListener

#: The time between two examinations, and that after which the statistics begin again (s). An
#: examination is followed by a rest of `_REST` times as long.
_PERIOD, _LENGTH, _REST = 3.0, 30.0, 19.0
_NOT_KNOWN = dict.fromkeys(('headers', 'listeners', 'qos'), 'tf_doctor looks for them')


class _Statistics(Statistics):
    """Statistics that know the last two transforms of each frame, from which others can begin."""

    def __init__(self, clock: StampClock) -> None:
        super().__init__(SETTLING, clock)
        self.last: dict[tuple[object, ...], TransformTable] = {}

    def add(self, table: TransformTable) -> None:
        super().add(table)
        key = table.publisher, table.is_static, *table.edges
        tables = [self.last[key], table] if key in self.last else [table]
        times, stamps, poses = (np.concatenate(each)[-2:] for each in zip(
            *((each.times, each.stamps, each.poses) for each in tables)))
        self.last[key] = table._replace(times=times, stamps=stamps, poses=poses)


class RecentFindings:
    """The findings in what has arrived in the last half minute."""

    def __init__(self, listener: 'FrameListener') -> None:
        self._listener = listener
        self._statistics = _Statistics(listener.clock)
        self._was_simulated = listener.clock.is_simulated
        self._next = self._begin = 0.0  # of the next examination, and of the statistics (s)
        #: By code and frames: the finding, and when it was last found (s).
        self._found: dict[tuple[str, tuple[str, ...]], tuple[Finding, float]] = {}
        self.findings: Sequence[Finding] = ()
        self.verdict = ''

    def update(self, messages: Iterable[Message], is_complete: bool,
               other_transforms: Sequence[Heard], now: float) -> None:
        """
        Count messages, and from time to time examine the statistics.

        :param is_complete: False if messages before these were lost.
        :param now: on the monotonic clock (s).
        """
        begin = thread_time()
        if self._was_simulated != (simulated := self._listener.clock.is_simulated):
            self._was_simulated, self._found = simulated, {}
        if not is_complete or now >= self._begin + _LENGTH:
            # Begin again with the last transforms of each frame: some are sent seldom, or once.
            before, self._begin = self._statistics.last, now
            self._statistics = _Statistics(self._listener.clock)
            for table in before.values():
                if table.is_static or (
                        is_complete and self._listener.is_present(table.publisher) is not False):
                    self._statistics.add(table)
        self._statistics.add_messages(messages)
        self._examine(other_transforms, now)
        self._next = now + max(_PERIOD, _REST * (thread_time() - begin))

    def is_due(self, now: float) -> bool:
        """Return whether `update` is to be called, so that it takes 5 % of the time at most."""
        return now >= self._next

    def _examine(self, other_transforms: Sequence[Heard], now: float) -> None:
        listener, statistics = self._listener, self._statistics
        static, dynamic = listener.topics
        end = listener.now()
        not_known = {} if end else {'arrivals': 'no message has arrived on /clock'}
        report = examine(Observation(
            statistics, '', (dynamic, static),
            nodes=listener.names_of(statistics.publishers()), present=listener.present,
            other_transforms=other_transforms, not_known=_NOT_KNOWN | not_known,
            end=end, ahead=listener.ahead))
        self._found = {key: each for key, each in self._found.items() if each[1] > now - _LENGTH}
        self._found.update({(finding.code, finding.frames): (finding, now)
                            for finding in report.findings if finding.code != 'no_transforms'})
        self.findings = sorted((finding for finding, _ in self._found.values()), key=lambda each: (
            SEVERITIES.index(each.severity), each.code, each.frames))
        count, clock = len(self.findings), listener.clock_text()
        self.verdict = (f'{count} finding{"" if count == 1 else "s"}' if count else 'healthy') + (
            f' in the last {_LENGTH:.0f} s{clock and f"; {clock}"}')
