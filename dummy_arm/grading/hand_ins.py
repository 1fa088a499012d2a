"""Run hand-ins, several at the same time, each under a process of its own."""

from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
import os
import random
import signal
import socket
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Optional

from dummy_arm.grading import processes
from dummy_arm.grading.program import how_it_ended
from dummy_arm.grading.records import DOMAINS, Grade, START, Verdict
from puretf._causes.domains import used_domains
from puretf._text.names import shortened

_SIGNALS = signal.SIGINT, signal.SIGTERM
#: How long to wait for a signal before the next look at the processes (s).
_STEP = 0.05
#: How much longer than the start and the observation a hand-in may take (s), and how long its
#: process may take to end what it has started.
_MARGIN, _LONGEST_END = 30.0, 15.0
#: The program of the process.
_MAIN = """
import sys
from multiprocessing.connection import Connection
connection = Connection(int(sys.argv[1]))
sys.path[:], *arguments = connection.recv()
from dummy_arm.grading.supervisor import supervise
supervise(connection, *arguments)
"""


def graded(files: Sequence[str], seconds: float, jobs: int,
           on_wait: Callable[[int, str], object]) -> Generator[Grade, None, None]:
    """Yield what `dummy_arm.grading.grade` returns; block signals and adopt orphans meanwhile."""
    running: list[_Run] = []
    waiting, count = deque(files), 0
    older = {child.pid for child in processes.descendants()}

    def end_orphans() -> None:
        processes.end_descendants({*older, *(run.pid for run in running)})

    directory = TemporaryDirectory(prefix='check_arm_', ignore_cleanup_errors=True)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    # Threads of numpy do not block it, and may be the first to receive it.
    handler = signal.signal(signal.SIGTERM, lambda *_: None)
    processes.become_subreaper()
    try:
        while waiting or running:
            if waiting and len(running) < jobs and (reservation := _reserved_domain()):
                with suppress(OSError):  # there are too many processes: try again
                    running.append(_Run(waiting[0], seconds, directory.name, reservation))
                    waiting.popleft()
            _wait_for_signal()
            names = ', '.join(run.file for run in running)
            on_wait(count, f'observing {shortened(names)}' if names else
                    'waiting for a ROS domain')
            for run in [each for each in running if each.is_over()]:
                running.remove(run)
                grade = run.grade()
                end_orphans()
                count += 1
                yield grade
    finally:
        for run in running:
            run.connection.close()  # it ends what it has started
        while running:
            with suppress(subprocess.TimeoutExpired):
                running.pop().wait(_LONGEST_END)
        end_orphans()
        directory.cleanup()
        processes.become_subreaper(False)
        signal.signal(signal.SIGTERM, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _reserved_domain() -> Optional[tuple[int, socket.socket]]:
    """Reserve a ROS domain that nobody uses, by a socket that other calls respect."""
    free = sorted({*DOMAINS} - used_domains())
    for domain in random.sample(free, len(free)):
        reservation = socket.socket(socket.AF_UNIX)
        with suppress(OSError):
            reservation.bind(f'\0dummy_arm.check_arm.{domain}')
            return domain, reservation
        reservation.close()
    return None


def _wait_for_signal() -> None:
    """Wait for a moment; raise KeyboardInterrupt at a signal that comes from no program."""
    if not (received := signal.sigtimedwait(_SIGNALS, _STEP)):
        return
    # A terminal has no process id. A process that has ended, also just now, may have been `pkill`.
    sender = received.si_pid
    if not sender or (sender not in [each.pid for each in processes.descendants()]
                      and os.path.exists(f'/proc/{sender}')):
        raise KeyboardInterrupt
    print(f'check_arm: warning: {signal.Signals(received.si_signo).name} is ignored, since '
          'a program may have sent it; Ctrl-C ends check_arm', file=sys.stderr)


class _Run(subprocess.Popen[bytes]):
    """A process in a session of its own that runs a hand-in, on loopback."""

    def __init__(self, file: str, seconds: float, directory: str,
                 reservation: tuple[int, socket.socket]) -> None:
        self.file, self._reservation = file, reservation
        self._longest = START + seconds + _MARGIN
        self._deadline = time.monotonic() + self._longest
        # A pair of sockets: unlike a pipe, no other process can open it by /proc.
        ours, theirs = socket.socketpair()
        self.connection = Connection(ours.detach())
        # `-I` and this `sys.path` keep it from importing files of the working directory, where
        # hand-ins may lie. Its command line names no hand-in: `pkill -f` of one does not match it.
        environment = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        environment.pop('ROS_STATIC_PEERS', None)
        with theirs:
            super().__init__(
                [sys.executable, '-I', '-S', '-c', _MAIN, str(theirs.fileno())], env=environment,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=[theirs.fileno()],
                start_new_session=True)
        with suppress(OSError):  # it has ended, which `grade` will tell
            self.connection.send((
                [*filter(None, sys.path)], file, seconds, directory, reservation[0]))

    def is_over(self) -> bool:
        """Return whether the process has ended, or takes too long."""
        return self.poll() is not None or time.monotonic() > self._deadline

    def grade(self) -> Grade:
        """End the process, and return the grade."""
        is_late = self.poll() is None
        self.kill()
        end = how_it_ended(self.wait())
        try:
            grade: Grade = self.connection.recv()
        except (EOFError, OSError):
            grade = Grade(self.file, None, 'The process that runs and observes it ' + (
                f'has said nothing for {self._longest:g} s: probably the middleware hangs.'
                if is_late else f'ended {end}.'), Verdict.NOT_JUDGED)
        self.connection.close()
        self._reservation[1].close()
        return grade
