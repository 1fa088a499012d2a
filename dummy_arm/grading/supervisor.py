"""
The process that runs a hand-in, and ends all that it has started.

It observes the arm by another process, since the middleware can hang or crash; so this process has
no library of ROS.
"""

from contextlib import suppress
from multiprocessing.connection import Connection
import os
from pathlib import Path
import shutil
import signal
import time
from typing import Any, Optional
import warnings

from dummy_arm.grading.drawing import fault_of_drawing
from dummy_arm.grading.observer import Observation, observe
from dummy_arm.grading.processes import (
    become_subreaper,
    descendants,
    end_descendants,
    Worker,
)
from dummy_arm.grading.program import Program, program_in, ProgramError
from dummy_arm.grading.records import Grade, START, Verdict
from puretf.domains import ros_domains
from puretf_tools.cli.parser import CommandError

#: How much longer than the start and the observation a hand-in may take, and how long to read a
#: drawing (s).
_MARGIN, _DRAWING = 20.0, 10
#: How long to wait before the next look at all (s), and at the processes (s).
_STEP, _SCAN_INTERVAL = 0.05, 0.25
#: The limits of all processes of a hand-in together.
_MOST_PROCESSES, _MOST_MEMORY = 128, 2 * 2**30


def longest(seconds: float) -> float:
    """Return how long a hand-in may take (s) whose arm is observed for some time (s)."""
    return START + seconds + _MARGIN


def supervise(connection: Connection, file: str, seconds: float, domain: int,
              directory: str) -> None:
    """
    Run and judge a hand-in, and the frames.pdf beside it.

    :param connection: sends the Grade, and whether a signal may have ended the program. If the
        other end is closed, this process ends.
    :param file: the path of the program, or of a folder in which it lies.
    :param seconds: how long to observe the arm (s).
    :param domain: the ROS domain of the program.
    :param directory: a directory for what the program writes.
    """
    warnings.simplefilter('ignore')  # of the compiler about the program
    become_subreaper()
    supervisor = _Supervisor(connection, file, seconds)
    try:
        result = supervisor.judge(domain, directory)
    except Exception as error:  # the other hand-ins are judged all the same
        result = Grade(file, None, f'check_arm failed: {type(error).__name__}: {error}',
                       Verdict.NOT_JUDGED), False
    finally:
        end_descendants()
        with suppress(RecursionError):  # of too many directories in each other
            shutil.rmtree(directory, ignore_errors=True)  # also if check_arm was killed
    with suppress(OSError):
        connection.send(result)


class _Supervisor:
    def __init__(self, connection: Connection, file: str, seconds: float) -> None:
        self._connection, self._file, self._seconds = connection, file, seconds
        self._deadline = time.monotonic() + longest(seconds)
        self._next_scan = 0.0
        self._program: Optional[Program] = None
        #: The number of all processes of the machine at the beginning.
        self._usual = _count()

    def judge(self, domain: int, directory: str) -> tuple[Grade, bool]:
        """Return the grade of the program, and whether a signal may have ended the program."""
        path, may_be_killed = Path(self._file), False
        try:
            path = program_in(path)
            self._program = program = Program(path, domain, directory)
            grade = self._run(program, domain)
            may_be_killed = program.may_be_killed
        except CommandError as error:
            is_wrong = isinstance(error, ProgramError)
            grade = Grade(self._file, None, str(error),
                          Verdict.NOT_OK if is_wrong else Verdict.NOT_JUDGED)
        return grade._replace(drawing=self._drawing(path)), may_be_killed

    def _run(self, program: Program, domain: int) -> Grade:
        observer = self._observer = Worker(observe, self._seconds, domain, program.int_line)
        try:
            self._answer()
            program.start()
            observer.send('begin')
            while not observer.connection.poll():
                self._watch()
                if program.fault():
                    observer.send('end')
            found: Observation = self._answer()
            fault = program.fault() or ('' if found.report.passed else found.wrong_type) or (
                '' if found.has_broadcaster else self._elsewhere(domain))
        finally:
            program.end()
            observer.end()
            end_descendants()
        return self._grade(found, fault)

    def _answer(self) -> Any:
        """Wait for what the observer sends; raise it if it is an error."""
        while not self._observer.connection.poll():
            self._watch()
        try:
            answer = self._observer.answer()
        except EOFError:
            raise CommandError(f'The process that observes it ended {self._observer.end()}.'
                               ) from None
        if isinstance(answer, CommandError):
            raise answer
        return answer

    def _grade(self, found: Observation, fault: str) -> Grade:
        if not fault and not found.has_messages:
            has = ' It has a broadcaster, but sends nothing with it.' * found.has_broadcaster
            fault = (f'It publishes nothing on /tf and /tf_static within {START:g} s.{has} Is the '
                     'timer created, with its period in seconds, and does rclpy.spin run?')
        if fault:
            return Grade(self._file, found.report, fault, Verdict.NOT_OK)
        line = found.report.first_failure
        return Grade(self._file, found.report, found.report.reason,
                     line.verdict if line else Verdict.OK)

    def _elsewhere(self, domain: int) -> str:
        """Return in which other ROS domain the program publishes; '' if in none."""
        others = [each for each in sorted(ros_domains(self._processes())) if each != domain]
        return (f'It uses the ROS domain {others[0]}: leave out ROS_DOMAIN_ID and domain_id; the '
                'user sets the domain.') if others else ''

    def _drawing(self, program: Path) -> str:
        """Judge the frames.pdf beside a program, for a limited time."""
        paths = (folder / 'frames.pdf' for folder in (Path(self._file), program.parent))
        if not (path := next((path for path in paths if os.path.exists(path)), None)):
            return ''
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        signal.alarm(_DRAWING)
        try:
            fault = fault_of_drawing(path)
        except CommandError as error:
            return f'{Verdict.NOT_JUDGED}: {error}'
        except KeyboardInterrupt:
            fault = f'It cannot be read within {_DRAWING} s.'
        finally:
            signal.alarm(0)
        return f'{Verdict.NOT_OK}: {fault}' if fault else Verdict.OK

    def _processes(self) -> dict[int, int]:
        """Return the memory (bytes) of the processes of the hand-in, by process id."""
        return {pid: memory for pid, memory in descendants().items() if pid != self._observer.pid}

    def _watch(self) -> None:
        """
        Wait for a short time; watch the deadline and the processes.

        :raises ProgramError: if the hand-in exceeds a limit.
        :raises CommandError: if the deadline is over.
        :raises SystemExit: if the command has ended.
        """
        if self._connection.poll(_STEP):
            raise SystemExit
        if time.monotonic() > self._deadline:
            raise CommandError('The process that observes it has said nothing for '
                               f'{longest(self._seconds):g} s: probably the middleware hangs.')
        # Among thousands of running processes, this one would hardly run: first, stop them.
        crowd = self._program if _count() > self._usual + _MOST_PROCESSES else None
        if time.monotonic() < self._next_scan and not crowd:
            return
        if crowd:
            crowd.send(signal.SIGSTOP)
        found = self._processes()
        if len(found) > _MOST_PROCESSES:
            raise ProgramError(f'It starts more than {_MOST_PROCESSES} processes.')
        if sum(found.values()) > _MOST_MEMORY:
            raise ProgramError(f'It uses more than {_MOST_MEMORY // 2**30} GiB of memory.')
        if crowd:
            crowd.send(signal.SIGCONT)
        self._next_scan = time.monotonic() + _SCAN_INTERVAL


def _count() -> int:
    """Return the number of the processes of this machine, and a constant."""
    return os.stat('/proc').st_nlink
