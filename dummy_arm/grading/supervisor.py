"""
The process that runs a hand-in, and ends all that it has started.

It observes the arm by another process, since the middleware can hang or crash; so this process has
no library of ROS.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import json
import os
from pathlib import Path
import random
from select import select
import shutil
import socket
import time
from typing import Any, Optional
import warnings

from dummy_arm.grading.observer import Observation, READY, START
from dummy_arm.grading.processes import (
    become_subreaper,
    descendants,
    end_descendants,
    how_it_ended,
    low_pid,
    next_signal,
    Worker,
)
from dummy_arm.grading.program import (
    arguments_of,
    other_arm,
    Program,
    program_in,
    ProgramError,
)
from dummy_arm.grading.records import Grade, NOT_JUDGED, NOT_OK, OK
from puretf.domains import ros_domains, short_command, used_domains
from puretf_tools.cli.parser import CommandError

#: ROS domains whose ports are outside the range from which Linux takes ports for clients.
DOMAINS = range(215, 232)
#: How long to wait for a free ROS domain (s), and how long to read a drawing (s).
_PATIENCE, _DRAWING = 600.0, 20.0
#: How long to wait for a signal before the next look at all else (s), and the time between two
#: looks at the processes (s).
_STEP, _SCAN_INTERVAL = 0.05, 0.25
#: The limits of all processes of a hand-in together.
_MOST_PROCESSES, _MOST_MEMORY = 256, 2 * 2**30
#: The same for processes that have ended since the last look: more are a chain without end.
_MOST_ENDED = 1000
#: With this, a line that tells of a signal begins.
SIGNAL = 'signal '


class _Ended(BaseException):
    """The command has ended."""


def main(write: Callable[[str], object], file: str, seconds: float, silence: float,
         directory: str) -> None:
    """
    Run and judge a hand-in, and the frames.pdf beside it.

    :param write: writes empty lines, which are signs of life, the signals that are received, and
        in the end the Grade and whether it is certain, as JSON. If the command that reads them has
        ended, or the standard input ends, this function returns.
    :param file: the path of the program, or of a folder in which it lies.
    :param seconds: how long to observe the arm (s).
    :param silence: how long to wait for a sign of life of the observer (s).
    :param directory: a directory for what the program writes; it is deleted.
    """
    warnings.simplefilter('ignore')  # of the compiler about the program
    become_subreaper()
    supervisor = _Supervisor(write, file, seconds, silence, directory)
    with suppress(_Ended, BrokenPipeError):
        try:
            grade, is_certain = supervisor.judge()
            grade = grade._replace(drawing=supervisor.drawing())
        except Exception as error:  # the other hand-ins are judged all the same
            grade, is_certain = Grade(file, None, 'check_arm failed: '
                                      f'{type(error).__name__}: {error}', NOT_JUDGED), False
        finally:
            left = end_descendants()
        if left:
            grade = Grade(file, None, 'It has started what cannot be ended: '
                          f'{", ".join(map(_described, sorted(left)))}.', NOT_OK)
        write(json.dumps([grade, is_certain]))
    remove(directory)


class _Supervisor:
    def __init__(self, write: Callable[[str], object], file: str, seconds: float, silence: float,
                 directory: str) -> None:
        self._write, self._file, self._seconds = write, file, seconds
        self._silence, self._directory, self._path = silence, directory, Path(file)
        #: The processes that are not part of the hand-in, and all that were seen and are.
        self._workers: set[int] = set()
        self._seen: set[int] = set()
        self._hidden: set[int] = set()
        self._next_scan = 0.0
        self._program = 0  #: the id of the process that runs the program itself

    def judge(self) -> tuple[Grade, bool]:
        """
        Run the program, and judge its arm.

        :returns: the grade, and whether it is certain. It is not if another process publishes
            transforms, too, or may have ended the program.
        """
        try:
            self._path = program_in(self._path)
            arguments = arguments_of(self._path)
            with _free_domain(self._watch) as domain:
                try:
                    return self._run(arguments, domain)
                finally:
                    end_descendants()
        except ProgramError as error:
            return Grade(self._file, None, str(error), NOT_OK), True
        except CommandError as error:
            return Grade(self._file, None, str(error), NOT_JUDGED), True

    def _run(self, arguments: list[str], domain: int) -> tuple[Grade, bool]:
        observer = self._worker('observer', self._seconds, domain)
        while not self._observation(observer) and READY.encode() not in observer.written:
            self._watch()
        program = Program(self._path, arguments, domain, self._directory)
        self._program = program.pid
        try:
            observer.send()
            while not (found := self._observation(observer)):
                self._watch()
                if program.fault():
                    observer.finish()
            fault = program.fault() or ('' if found.report.passed else found.wrong_type)
            elsewhere = '' if found.publishers else self._elsewhere(domain)
        finally:
            program.end()
        observer.end()
        self._watch()  # for signals that it has sent
        if not fault and (strangers := self._strangers(found)):
            return Grade(self._file, None, 'Another program also publishes transforms in its ROS '
                         f'domain: {strangers}.', NOT_JUDGED), False
        return self._grade(found, fault or elsewhere), not program.may_be_killed

    def _worker(self, module: str, *arguments: Any) -> Worker:
        worker = Worker(module, *arguments)
        self._workers.add(worker.pid)
        return worker

    def _observation(self, observer: Worker) -> Optional[Observation]:
        """Return what the observer has found; None if it is not yet known."""
        if observer.read():
            if not observer.last_line.startswith((b'[', b'"')):
                how = how_it_ended(observer.end(self._silence))
                raise CommandError(f'The process that observes it ended {how}.')
            return Observation.from_json(observer.last_line)
        if observer.silence > self._silence:
            raise CommandError(f'The process that observes it has said nothing for '
                               f'{self._silence:g} s: probably the middleware hangs.')
        return None

    def _grade(self, found: Observation, fault: str) -> Grade:
        if not fault and not found.has_messages:
            has = ' It has a broadcaster, but sends nothing with it.' if found.publishers else ''
            fault = (f'It publishes nothing on /tf and /tf_static within {START:g} s.{has} Is the '
                     'timer created, with its period in seconds, and does rclpy.spin run?')
        if fault:
            return Grade(self._file, found.report, fault, NOT_OK)
        line = found.report.first_failure
        return Grade(self._file, found.report, found.report.reason, line.verdict if line else OK)

    def _strangers(self, found: Observation) -> str:
        """Return which processes publish transforms, and are not part of the hand-in."""
        own = {-1, *(pid & 0xffff for pid in self._seen)}
        others = {each.pid for each in found.publishers if low_pid(each.gid) not in own}
        return ', '.join(
            _described(pid) if pid else 'a process that has ended' for pid in sorted(others))

    def _elsewhere(self, domain: int) -> str:
        """Return in which other ROS domain the program publishes; '' if in none."""
        others = [each for each in sorted(ros_domains(self._seen)) if each != domain]
        return (f'It uses the ROS domain {others[0]}: leave out ROS_DOMAIN_ID and domain_id; the '
                'user sets the domain.') if others else ''

    def drawing(self) -> str:
        """Judge the frames.pdf beside the program, in a process of its own, since it may hang."""
        paths = (folder / 'frames.pdf' for folder in (Path(self._file), self._path.parent))
        if not (path := next((path for path in paths if os.path.exists(path)), None)):
            return ''
        reader = self._worker('drawing', str(path))
        end = time.monotonic() + _DRAWING
        while not reader.read():
            if time.monotonic() > end:
                return f'{NOT_JUDGED}: It cannot be read within {_DRAWING:g} s.'
            self._watch()
        how = how_it_ended(reader.end(_DRAWING))
        return reader.last_line.decode() or (
            f'{NOT_JUDGED}: The process that reads it ended {how}.')

    def _watch(self) -> None:
        """
        Wait for a short time; watch the signals and the processes.

        :raises ProgramError: if the hand-in exceeds a limit, or starts an arm that is not the
            student's.
        :raises _Ended: if the command has ended.
        """
        if received := next_signal(_STEP):
            self._write(SIGNAL + json.dumps(received))
        self._write('')
        if select([0], [], [], 0)[0]:
            raise _Ended
        if time.monotonic() < self._next_scan:
            return
        found = descendants(os.getpid(), self._workers)
        self._next_scan = time.monotonic() + _SCAN_INTERVAL
        self._seen |= found.keys()
        # Where the main thread has ended, /proc hides what the others use.
        hidden = {pid for pid, process in found.items()
                  if process.has_ended and process.threads > 1}
        if hidden & self._hidden:
            raise ProgramError('It runs a process whose main thread has ended.')
        self._hidden = hidden
        for pid, process in found.items():
            if process.has_ended and process.parent == os.getpid() and pid != self._program:
                os.waitpid(pid, os.WNOHANG)
        running = [pid for pid, process in found.items() if not process.has_ended]
        if len(running) > _MOST_PROCESSES or len(found) > _MOST_ENDED:
            raise ProgramError(f'It starts more than {_MOST_PROCESSES} processes.')
        if sum(each.resident for each in found.values()) > _MOST_MEMORY:
            raise ProgramError(f'It uses more than {_MOST_MEMORY // 2**30} GiB of memory.')
        for pid in running:
            if name := other_arm(pid, self._path):
                raise ProgramError(f'It starts {name}: the arm must be its own.')


def remove(directory: str) -> None:
    """Remove a directory, as far as possible."""
    with suppress(RecursionError):
        shutil.rmtree(directory, ignore_errors=True)


def _described(pid: int) -> str:
    return f'process {pid} ({short_command(pid) or "it has ended"})'


@contextmanager
def _free_domain(on_wait: Callable[[], object]) -> Iterator[int]:
    """
    Wait for a ROS domain that no other program on this machine uses, and reserve it.

    The reservation is a socket, which other processes that run this function respect. A domain is
    free if no UDP port of it is in use. If none is free in time, raise CommandError.
    """
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline:
        used = used_domains()
        for domain in random.sample(DOMAINS, len(DOMAINS)):
            if domain in used:
                continue
            with socket.socket(socket.AF_UNIX) as reservation:
                try:
                    reservation.bind(f'\0dummy_arm.check_arm.{domain}')
                except OSError:
                    continue
                yield domain
                return
        on_wait()
    raise CommandError(f'The ROS domains {DOMAINS[0]} to {DOMAINS[-1]} are all in use.')
