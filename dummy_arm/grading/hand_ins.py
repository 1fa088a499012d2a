"""Run hand-ins, several at the same time, each under a process of its own."""

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
import random
import signal
import socket
from subprocess import TimeoutExpired
import sys
from tempfile import TemporaryDirectory
import time
from typing import Optional

from dummy_arm.grading.processes import (
    become_subreaper,
    children,
    end_descendants,
    is_descendant,
    Worker,
)
from dummy_arm.grading.records import DOMAINS, Grade, Verdict
from dummy_arm.grading.supervisor import longest, supervise
from puretf import shortened
from puretf.domains import used_domains

_SIGNALS = signal.SIGINT, signal.SIGTERM
#: How long to wait for a signal before the next look at the processes (s).
_STEP = 0.05
#: A process that runs a program is stopped if it takes so much longer than it may (s).
_MARGIN = 30.0


def graded(files: Sequence[str], seconds: float, jobs: int,
           on_wait: Callable[[int, str], object]) -> Generator[Grade, None, None]:
    """Yield what `dummy_arm.grading.grade` returns."""
    running: list[_Run] = []
    again: list[str] = []  # what another program may have ended, alone
    count = 0
    with _cleanup(running) as end_orphans:
        for to_run, most in (files, jobs), (again, 1):
            waiting = deque(to_run)
            while waiting or running:
                ended = []
                if waiting and len(running) < most and (reservation := _reserved_domain()):
                    file = waiting.popleft()
                    try:
                        running.append(_Run(file, seconds, reservation))
                    except OSError as error:  # there are too many processes, or the disk is full
                        ended.append((Grade(file, None, f'It cannot be run: {error.strerror}.',
                                            Verdict.NOT_JUDGED), True))
                _wait_for_signal()
                names = ', '.join(run.file for run in running)
                on_wait(count, f'observing {shortened(names)}' if names else
                        'waiting for a ROS domain')
                for run in [each for each in running if each.is_over()]:
                    running.remove(run)
                    ended.append(run.result())
                    end_orphans()
                for result, may_be_disturbed in ended:
                    if may_be_disturbed and to_run is files:
                        again.append(result.file)
                    else:
                        count += 1
                        yield result


@contextmanager
def _cleanup(running: 'list[_Run]') -> Iterator[Callable[[], None]]:
    """Block signals, and adopt orphans; yield what ends those that belong to none that runs."""
    older = {child.pid for child in children()}

    def end_orphans() -> None:
        end_descendants({*older, *(run.worker.pid for run in running)})

    before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    # Threads of numpy do not block it, and may be the first to receive it.
    handler = signal.signal(signal.SIGTERM, lambda *_: None)
    become_subreaper()
    try:
        yield end_orphans
    finally:
        for run in running:
            run.worker.connection.close()  # it ends what it has started
        deadline = time.monotonic() + _MARGIN
        while running:
            run = running.pop()
            with suppress(TimeoutExpired):
                run.worker.wait(max(0.0, deadline - time.monotonic()))
        end_orphans()
        become_subreaper(False)
        signal.signal(signal.SIGTERM, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _reserved_domain() -> Optional[tuple[int, socket.socket]]:
    """Reserve a ROS domain that nobody uses, by a socket that other calls respect."""
    used = used_domains()
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        reservation = socket.socket(socket.AF_UNIX)
        with suppress(OSError):
            if domain not in used:
                reservation.bind(f'\0dummy_arm.check_arm.{domain}')
                return domain, reservation
        reservation.close()
    return None


def _wait_for_signal() -> None:
    """Wait for a moment; raise KeyboardInterrupt at a signal that comes from no program."""
    if not (received := signal.sigtimedwait(_SIGNALS, _STEP)):
        return
    if not (received.si_pid and is_descendant(received.si_pid)):  # a terminal has no process id
        raise KeyboardInterrupt
    print(f'check_arm: warning: {signal.Signals(received.si_signo).name} is ignored, since '
          'a program may have sent it; Ctrl-C ends check_arm', file=sys.stderr)


class _Run:
    """A process that runs a hand-in."""

    def __init__(self, file: str, seconds: float, reservation: tuple[int, socket.socket]) -> None:
        self.file, self._reservation = file, reservation
        self._directory = TemporaryDirectory(prefix='check_arm_', ignore_cleanup_errors=True)
        self.worker = Worker(supervise, file, seconds, reservation[0], self._directory.name)
        self._deadline = time.monotonic() + longest(seconds) + _MARGIN

    def is_over(self) -> bool:
        """Return whether the process has answered, has ended or takes too long."""
        return self.worker.connection.poll() or time.monotonic() > self._deadline

    def result(self) -> tuple[Grade, bool]:
        """End the process; return the grade, and whether a signal has ended the program."""
        result = None
        with suppress(EOFError):
            if self.worker.connection.poll():
                result = self.worker.answer()
        how = self.worker.end()
        self._reservation[1].close()
        with suppress(RecursionError):  # of too many directories in each other
            self._directory.cleanup()
        return result or (Grade(self.file, None, f'The process that runs it ended {how}.',
                                Verdict.NOT_JUDGED), False)
