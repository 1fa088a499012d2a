"""What is observed, and what is found: plain values, which need neither numpy nor ROS."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import Any, NamedTuple, Optional

from puretf._text.names import visible

#: How long to wait for the first transform on /tf (s).
START = 20.0
#: ROS domains whose ports are outside the range from which Linux takes ports for clients.
DOMAINS = range(215, 232)


class Verdict:
    """The verdicts of a line; those of a hand-in have no ADVICE."""

    OK, NOT_OK, NOT_JUDGED, NOT_RUN, ADVICE = 'ok', 'not ok', 'not judged', 'not run', 'advice'


class ArmMessage(NamedTuple):
    """A message that was received or recorded."""

    time: int  #: the time of arrival or of the recording (ns); 0: not known
    is_static: bool  #: True if the message is from /tf_static
    publisher: str  #: an identifier of the publisher
    #: The transforms: `stamp_ns`, `frame_id`, `child_frame_id`, and `pose` (x, y, z in m, then the
    #: quaternion x, y, z, w).
    rows: Sequence[Any]


class Messages(list[ArmMessage]):
    size = 0  #: the number of their transforms

    def add(self, message: Any) -> None:
        """Add a message that was received or recorded, if it can be decoded."""
        with suppress(ValueError):  # the listener logs this error
            rows = message.rows()
            self.append(ArmMessage(message.time, message.is_static, message.publisher, rows))
            self.size += len(rows)


class ArmPublisher(NamedTuple):
    """A publisher on /tf or /tf_static that has been in the ROS graph during the observation."""

    gid: str  #: as `Message.publisher`
    node: str  #: the full name of its node
    is_static: bool  #: True if it is on /tf_static
    pid: int  #: the process id; 0: not known


class Line(NamedTuple):
    """A line of the table: what was found about a requirement."""

    measured: str
    text: str = ''  #: the likely cause, why it is not judged, or the advice; '' if it is met
    broken: Collection[str] = ()  #: the frames of which nothing that needs this is judged
    value: Any = None  #: for other requirements
    verdict: str = ''  #: OK, NOT_OK or NOT_JUDGED; ADVICE for good practice that is not followed
    requirement: str = ''
    follows: bool = False  #: True if it is not judged because another requirement is not met

    @property
    def is_judged(self) -> bool:
        return self.verdict != Verdict.NOT_JUDGED


class Report(NamedTuple):
    """The result of a check."""

    lines: list[Line]  #: the requirements
    advice: list[Line]  #: good practice, which has no influence on `passed`
    passed: bool  #: True if every requirement is met; a late listener need not be judged

    @property
    def first_failure(self) -> Optional[Line]:
        """The first line with the verdict NOT_OK; if there is none, the first with NOT_JUDGED."""
        return next((line for verdict in (Verdict.NOT_OK, Verdict.NOT_JUDGED)
                     for line in self.lines if line.verdict == verdict and not self.passed), None)

    @property
    def reason(self) -> str:
        """The first failure, and the number of the others; the advice if the arm passed."""
        line = self.first_failure
        if line is None:
            advice = [f'{each.requirement} ({each.measured}): {each.text}' for each in self.advice
                      if each.verdict == Verdict.ADVICE]
            return f'advice: {" ".join(advice)}' if advice else ''
        count = sum(each.verdict == Verdict.NOT_OK for each in self.lines)
        measured = f' ({line.measured})' if line.measured else ''
        return (f'{line.requirement}{measured}. {line.text}'
                f'{f" (requirements that are not met: {count})" if count > 1 else ""}')


class Grade(NamedTuple):
    """The result of a hand-in, or of a drawing."""

    file: str
    report: Optional[Report]  #: None if the program could not be judged
    reason: str  #: why it did not pass; if it passed, the good practice that is not followed
    verdict: str  #: OK, NOT_OK, NOT_JUDGED or NOT_RUN
    drawing: str = ''  #: the result for its frames.pdf; '' if nobody has looked for it

    @property
    def result(self) -> str:
        separator = '; ' if self.verdict == Verdict.OK else ': '
        return f'{self.verdict}{self.reason and separator + self.reason}'

    @property
    def line(self) -> str:
        return f'{visible(self.file)}: {self.result}'
