"""Grade hand-ins, several at the same time."""

from collections import deque
from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import ExitStack
import json
import os
import signal
import sys
from tempfile import mkdtemp
import time

from dummy_arm.grading.processes import (
    become_subreaper,
    descendants,
    end_descendants,
    how_it_ended,
    next_signal,
    Signal,
    Worker,
)
from dummy_arm.grading.records import Grade, NOT_JUDGED, NOT_OK, Report
from dummy_arm.grading.supervisor import remove, SIGNAL
from puretf import visible
from puretf_tools.cli.parser import CommandError
from puretf_tools.cli.signals import signals_blocked

#: A process is given up if it writes nothing for this time (s).
_SILENCE = 60.0
#: How long to wait for a signal before the next look at the processes (s).
_STEP = 0.05
#: How many signals are handled before the next look: a program may send them without end.
_MOST_SIGNALS = 100
#: How long to wait for the end of the processes that run programs (s).
_LONGEST_END = 30.0
#: The signals of a terminal, and of a machine that is shut down.
_ENDING = (signal.SIGINT, signal.SIGTERM) if sys.platform == 'win32' else (
    signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM, signal.SIGTSTP)


def grade(files: Sequence[str], seconds: float = 25.0, jobs: int = 1,
          silence: float = _SILENCE) -> Generator[Grade, None, None]:
    """
    Run each program in a ROS domain of its own, and judge the arm that it publishes.

    Each program runs under a process of its own, which ends all that the program starts. A signal
    that a program sends to this process only makes it fail. In the end, programs whose grade is
    not certain run again, one after the other: those that another process may have disturbed, and
    those that may have sent a signal, since the process that has sent it has ended. This function
    must be called in the main thread, and nothing else may start processes meanwhile.

    :param files: the paths of the programs, or of the folders in which they lie.
    :param seconds: how long to observe each arm (s).
    :param jobs: how many programs run at the same time, at most 17.
    :param silence: how long to wait for a sign of life of the processes that observe (s).
    :returns: an iterator of the grades, in the order in which the programs end; closing it ends
        the programs.
    :raises CommandError: if this is not Linux.
    :raises KeyboardInterrupt: if Ctrl-C, SIGTERM or another signal was received that no program
        has sent.
    """
    if sys.platform != 'linux':
        raise CommandError('programs can be run on Linux only; record a bag, and use --bag')
    older = descendants(os.getpid()).keys()
    running: list[_Run] = []
    uncertain: dict[str, bool] = {}  # by file: whether it may have sent a signal
    with ExitStack() as stack:
        stack.enter_context(signals_blocked())
        stack.callback(_forget_signals)
        become_subreaper()
        stack.callback(become_subreaper, False)
        stack.callback(_end, running, older)
        for is_again in False, True:
            waiting = deque(uncertain if is_again else files)
            while waiting or running:
                while waiting and len(running) < (1 if is_again else jobs):
                    file = waiting.popleft()
                    try:
                        running.append(_Run(file, seconds, silence))
                    except OSError as error:  # for example, the disk is full
                        yield Grade(file, None, f'check_arm failed: {error}', NOT_JUDGED)
                _note_signals(running, _STEP)
                for run in [*running]:
                    if not run.is_over():
                        continue
                    _note_signals(running, 0.0)
                    running.remove(run)
                    result, is_certain = run.grade()
                    end_descendants({*older, *(other.worker.pid for other in running)})
                    if not is_certain and not is_again:
                        uncertain[run.file] = bool(run.suspicion)
                    elif run.suspicion and uncertain.get(run.file):
                        yield result._replace(reason=run.suspicion, verdict=NOT_OK)
                    else:
                        yield result


def _note_signals(running: 'Sequence[_Run]', seconds: float) -> None:
    """
    Wait for signals for some time, and note which programs have sent them, or may have.

    :raises KeyboardInterrupt: if none of the programs has sent a signal.
    """
    for _ in range(_MOST_SIGNALS):
        if not (received := next_signal(seconds)):
            break
        seconds = 0.0
        if _is_from_program(received, running):
            continue
        if received.origin or (received.is_of_kernel and received.number in _ENDING):
            if received.number != signal.SIGTSTP:
                raise KeyboardInterrupt
            os.kill(os.getpid(), signal.SIGSTOP)  # Ctrl-Z
            continue
        for run in running:
            run.suspicion = f'It sent {received.name} to check_arm.'
        print(f'check_arm: warning: {received.name} is ignored: process {received.pid}, which has '
              'sent it, has ended, and may belong to a hand-in. Ctrl-C ends check_arm.',
              file=sys.stderr)
    for run in running:
        for received in run.signals():
            if not _is_from_program(received, running) and not received.origin:
                run.suspicion = f'It sent {received.name} to check_arm.'


def _is_from_program(received: Signal, running: 'Sequence[_Run]') -> bool:
    """Return whether a program has sent a signal; if so, end the program."""
    for run in running:
        if run.worker.pid in received.origin:
            run.fault = f'It sent {received.name} to check_arm.'
            run.worker.finish()
            return True
    return os.getpid() in received.origin  # the process that ran the program was killed


def _end(running: 'Sequence[_Run]', older: Collection[int]) -> None:
    """End all processes that run programs, and the processes that these have left."""
    for run in running:
        run.worker.finish()
    deadline = time.monotonic() + _LONGEST_END
    for run in running:
        run.end(deadline - time.monotonic())
    end_descendants(older)


def _forget_signals() -> None:
    """Forget the signals that were sent meanwhile, but not without end."""
    for _ in range(_MOST_SIGNALS):
        if not next_signal(0.0):
            break


class _Run:
    """A process that runs a program; see `dummy_arm.grading.supervisor`."""

    def __init__(self, file: str, seconds: float, silence: float) -> None:
        self.file = file
        #: A signal that the program has sent, and one that it may have sent.
        self.fault = self.suspicion = ''
        self._directory = mkdtemp(prefix='check_arm_')
        self.worker = Worker('supervisor', file, seconds, silence, self._directory)
        self._read = 0  # how much of what the worker has written was looked at (bytes)

    def signals(self) -> Iterator[Signal]:
        """Yield the signals that the process has received since the last call."""
        end = self.worker.written.rfind(b'\n') + 1
        for line in self.worker.written[self._read:end].splitlines():
            if line.startswith(SIGNAL.encode()):
                yield Signal(*json.loads(line[len(SIGNAL):]))
        self._read = end

    def is_over(self) -> bool:
        """Return whether the process has ended or is silent."""
        return self.worker.read() or self.worker.silence > _SILENCE

    def end(self, seconds: float) -> int:
        """Wait some time for the end of the process, then kill it; return its exit code."""
        code = self.worker.end(seconds)
        remove(self._directory)
        return code

    def grade(self) -> tuple[Grade, bool]:
        """End the process; return the grade, and whether it is certain."""
        is_silent = self.worker.silence > _SILENCE
        code = self.end(0.0 if is_silent else _LONGEST_END)
        if self.fault:
            return Grade(self.file, None, self.fault, NOT_OK), True
        if code:
            how = (f'has said nothing for {_SILENCE:g} s: it was stopped, or hangs.' if is_silent
                   else f'ended {how_it_ended(code)}.')
            return Grade(self.file, None, f'The process that runs it {how}', NOT_JUDGED), True
        (file, report, reason, *rest), is_certain = json.loads(self.worker.last_line)
        result = Grade(file, report and Report.from_json(*report), visible(reason), *rest)
        return result, is_certain and not self.suspicion
