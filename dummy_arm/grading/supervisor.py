"""
The process that runs a hand-in, and ends all that it has started.

It observes the arm by another process, since the middleware can hang or crash; so this process has
no library of ROS.
"""

from contextlib import suppress
from multiprocessing.connection import Connection
import os
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any
import warnings

from dummy_arm.grading import processes
from dummy_arm.grading.drawing import fault_of_drawing
from dummy_arm.grading.observer import observe
from dummy_arm.grading.program import Program, program_in, ProgramError
from dummy_arm.grading.records import Grade, Report, START, Verdict
from puretf._causes.domains import ros_domains
from puretf_tools.cli.parser import CommandError

#: How much longer than the start and the observation a hand-in may take (s).
_MARGIN = 20.0
#: How long to wait before the next look at all (s), and at the processes (s).
_STEP, _SCAN_INTERVAL = 0.05, 0.25
#: The limits of all processes of a hand-in together.
_MOST_PROCESSES, _MOST_MEMORY = 128, 2 * 2**30


def longest(seconds: float) -> float:
    """Return how long a hand-in may take (s) whose arm is observed for some time (s)."""
    return START + seconds + _MARGIN


def supervise(connection: Connection, file: str, seconds: float, directory: str, domain: int
              ) -> None:
    """
    Run and judge a hand-in, and the frames.pdf beside it.

    :param connection: sends the Grade. If the other end is closed, this process ends.
    :param file: the path of the program, or of a folder in which it lies.
    :param seconds: how long to observe the arm (s).
    :param directory: a directory for what the program writes.
    :param domain: the ROS domain of the program.
    """
    warnings.simplefilter('ignore')  # of the compiler about the program
    processes.become_subreaper()
    with TemporaryDirectory(dir=directory, ignore_cleanup_errors=True) as directory:
        path = Path(file)
        try:
            path = program_in(path)
            program = Program(path, domain, directory)
            report, fault = _Supervisor(connection, program, seconds).run(domain)
            line = report.first_failure
            grade = Grade(file, report, fault or report.reason, Verdict.NOT_OK if fault else
                          line.verdict if line else Verdict.OK)
        except CommandError as error:
            is_wrong = isinstance(error, ProgramError)
            grade = Grade(file, None, str(error),
                          Verdict.NOT_OK if is_wrong else Verdict.NOT_JUDGED)
    with suppress(OSError):  # the command has ended
        connection.send(grade._replace(drawing=_drawing(Path(file), path.parent)))


def _drawing(*folders: Path) -> str:
    """Judge the frames.pdf beside a program."""
    for path in (folder / 'frames.pdf' for folder in folders):
        if os.path.exists(path):
            try:
                fault = fault_of_drawing(path)
            except CommandError as error:
                return f'{Verdict.NOT_JUDGED}: {error}'
            return f'{Verdict.NOT_OK}: {fault}' if fault else Verdict.OK
    return ''


class _Supervisor:
    def __init__(self, connection: Connection, program: Program, seconds: float) -> None:
        self._connection, self._program, self._seconds = connection, program, seconds
        self._deadline = time.monotonic() + longest(seconds)
        self._next_scan = 0.0
        #: The number of all processes of the machine at the beginning.
        self._usual = _count()

    def run(self, domain: int) -> tuple[Report, str]:
        """Return the report of the program, and what is wrong with its publishers."""
        self._observer = processes.Worker(observe, self._seconds, domain, self._program.int_line)
        try:
            self._answer()
            self._program.start()
            self._observer.send('begin')
            report, fault, has_publishers = self._answer()
            self._program.check()
            return report, (not has_publishers and self._elsewhere(domain)) or fault
        finally:
            self._program.end()
            self._observer.end()
            processes.end_descendants()

    def _answer(self) -> Any:
        """Wait for what the observer sends; raise it if it is an error."""
        while not self._observer.connection.poll():
            self._watch()
        answer = self._observer.answer('observes')
        if isinstance(answer, CommandError):
            raise answer
        return answer

    def _elsewhere(self, domain: int) -> str:
        """Return in which other ROS domain the program publishes; '' if in none."""
        found = ros_domains([each.pid for each in self._processes()])
        others = [each for each in sorted(found) if each != domain]
        return (f'It uses the ROS domain {others[0]}: leave out ROS_DOMAIN_ID and domain_id; the '
                'user sets the domain.') if others else ''

    def _processes(self) -> list[Any]:
        """Return the processes of the hand-in."""
        return processes.descendants([self._observer.pid])

    def _watch(self) -> None:
        """
        Wait for a short time; watch the deadline, the program and the processes.

        :raises ProgramError: if the program has failed, or exceeds a limit.
        :raises CommandError: if the deadline is over.
        :raises SystemExit: if the command has ended.
        """
        if self._connection.poll(_STEP):
            raise SystemExit
        if time.monotonic() > self._deadline:
            raise CommandError('The process that observes it has said nothing for '
                               f'{longest(self._seconds):g} s: probably the middleware hangs.')
        self._program.check()
        # Among thousands of running processes, this one would hardly run.
        is_crowd = _count() > self._usual + _MOST_PROCESSES
        if time.monotonic() < self._next_scan and not is_crowd:
            return
        found = self._processes()
        if len(found) > _MOST_PROCESSES:
            processes.end_descendants()
            raise ProgramError(f'It starts more than {_MOST_PROCESSES} processes.')
        if sum(each.info['memory_info'].rss for each in found) > _MOST_MEMORY:
            raise ProgramError(f'It uses more than {_MOST_MEMORY // 2**30} GiB of memory.')
        self._next_scan = time.monotonic() + _SCAN_INTERVAL


def _count() -> int:
    """Return the number of the processes of this machine, and a constant."""
    return os.stat('/proc').st_nlink
