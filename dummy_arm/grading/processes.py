"""Processes on Linux: what a process has started, what it uses, and its signals."""

from collections import defaultdict
from collections.abc import Collection
from contextlib import suppress
import ctypes
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any, NamedTuple, Optional

from puretf.domains import ros_domains

#: prctl(2)
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
#: sigaction(2)
_SI_USER, _SI_TKILL, _SI_KERNEL = 0, -6, 128
#: How long to kill processes, until those that are left are given up (s).
_LONGEST_END = 20.0
#: The program of a Worker.
_MAIN = """
import json, os, sys
sys.path[:], module, pipe, arguments = json.loads(sys.stdin.buffer.raw.readline())
from importlib import import_module
import_module(module).main(lambda line: os.write(pipe, line.encode() + b'\\n'), *arguments)
"""


class Process(NamedTuple):
    """What /proc shows of a process."""

    parent: int  #: the process id
    start: int  #: the time of its start (ticks of the clock since boot)
    resident: int  #: memory (bytes)
    has_ended: bool  #: True if its main thread has ended
    threads: int  #: the number of threads that have not ended


def _process(pid: int) -> Optional[Process]:
    try:
        with open(f'/proc/{pid}/stat', 'rb') as file:
            # The name of the program is in parentheses, and may contain any character.
            fields = file.read().rpartition(b')')[2].split()
    except OSError:
        return None
    return Process(int(fields[1]), int(fields[19]),
                   int(fields[21]) * os.sysconf('SC_PAGE_SIZE'), fields[0] in b'ZX',
                   int(fields[17]))


def processes() -> dict[int, Process]:
    """Return all processes, by process id; none if this is not Linux."""
    pids = [int(path.name) for path in Path('/proc').glob('[0-9]*')]
    return {pid: process for pid in pids if (process := _process(pid))}


def descendants(pid: int, leave_out: Collection[int] = ()) -> dict[int, Process]:
    """Return what a process has started, directly or not, but for some with what they started."""
    found = processes()
    children = defaultdict(list)
    for child, process in found.items():
        children[process.parent].append(child)
    result: dict[int, Process] = {}
    parents = [pid]
    while parents:
        for child in children[parents.pop()]:
            if child not in leave_out and child not in result:
                result[child] = found[child]
                parents.append(child)
    return result


def ancestors(pid: int) -> list[int]:
    """Return the ids of a process, its parent, and so on; empty if the process does not exist."""
    result = []  # a process that has sent a signal may end at once, so each is read when needed
    while process := _process(pid):
        result.append(pid)
        pid = process.parent
    return result


def end_descendants(leave_out: Collection[int] = ()) -> set[int]:
    """
    Kill and reap what this subreaper has started, but for some children with their descendants.

    The children of a process that ends become children of this one. A chain of processes, each of
    which starts another one and ends, is outrun, since only children are read, and killed at once.

    :returns: the ids of the children that could not be ended: another user owns them.
    """
    left = {*leave_out}
    deadline = time.monotonic() + _LONGEST_END
    while (found := _children() - left) and time.monotonic() < deadline:
        for pid in found:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            except PermissionError:
                left.add(pid)
        for pid in found - left:
            with suppress(ChildProcessError):
                os.waitpid(pid, os.WNOHANG)
    return (left | found) - {*leave_out}


def _children() -> set[int]:
    try:
        return {int(pid) for thread in Path('/proc/self/task').iterdir()
                for pid in (thread / 'children').read_text().split()}
    except OSError:  # a thread has ended, or the kernel does not write this file
        return {pid for pid, process in processes().items() if process.parent == os.getpid()}


def become_subreaper(is_subreaper: bool = True) -> None:
    """Become the parent of all descendants that lose theirs."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, is_subreaper, 0, 0, 0)


def end_with_parent() -> None:
    """Let the kernel end this process by SIGKILL when its parent has ended."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))


class Signal(NamedTuple):
    """A signal that was sent to this process."""

    number: int
    is_of_kernel: bool  #: True if a terminal has sent it, or a process outside of the container
    pid: int  #: the id of the process that has sent it
    #: The process that has sent it, its parent, and so on; empty if it has ended, or hides.
    origin: list[int]

    @property
    def name(self) -> str:
        try:
            return signal.Signals(self.number).name
        except ValueError:  # a signal for real time
            return f'signal {self.number}'


def next_signal(seconds: float) -> Optional[Signal]:
    """Wait for a blocked signal that is not ignored for some time."""
    found = signal.sigtimedwait({
        number for number in signal.valid_signals() - {
            signal.SIGKILL, signal.SIGSTOP, signal.SIGCHLD, signal.SIGCONT, signal.SIGURG,
            signal.SIGWINCH} if signal.getsignal(number) is not signal.SIG_IGN}, seconds)
    if found is None:
        return None
    # With other codes, the sender chooses what seems to be its process id (rt_sigqueueinfo(2)).
    is_pid = found.si_code in (_SI_USER, _SI_TKILL) and found.si_pid > 0
    is_of_kernel = found.si_code in (_SI_USER, _SI_KERNEL) and found.si_pid == 0
    return Signal(found.si_signo, is_of_kernel, found.si_pid,
                  ancestors(found.si_pid) if is_pid else [])


class Worker:
    """
    A process in a session of its own that runs main() of a module of this package, on loopback.

    The first argument of main() is a function that writes a line, which this process can read; the
    others are sent as JSON. The standard input of the worker ends when this process does.
    """

    def __init__(self, module: str, *arguments: Any) -> None:
        self._output, output = os.pipe()
        os.set_blocking(self._output, False)
        reading, self._input = os.pipe()
        # `-I` and this `sys.path` keep it from importing files of the working directory, where
        # hand-ins may lie. Its command line names no hand-in: `pkill -f` of one does not match it.
        environment = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        environment.pop('ROS_STATIC_PEERS', None)
        self._process = subprocess.Popen(
            [sys.executable, '-I', '-S', '-c', _MAIN], stdin=reading, stdout=subprocess.DEVNULL,
            env=environment, pass_fds=[output], start_new_session=True)
        os.close(reading)
        os.close(output)
        self.pid = self._process.pid
        self._last = time.monotonic()
        #: What the worker has written.
        self.written = b''
        self.send(json.dumps([[*filter(None, sys.path)], f'dummy_arm.grading.{module}', output,
                              arguments]))

    def send(self, line: str = '') -> None:
        with suppress(BrokenPipeError):
            os.write(self._input, f'{line}\n'.encode())

    def finish(self) -> None:
        """End the standard input of the worker."""
        if self._input >= 0:
            os.close(self._input)
            self._input = -1

    def read(self) -> bool:
        """Read what the worker has written, into `written`; return whether this is all."""
        with suppress(BlockingIOError):
            while data := os.read(self._output, 2**16):
                self.written += data
                self._last = time.monotonic()
            return True
        return False

    @property
    def silence(self) -> float:
        """The time (s) since the worker has written something."""
        return time.monotonic() - self._last

    @property
    def last_line(self) -> bytes:
        """The last line that is not empty."""
        return self.written.strip().rpartition(b'\n')[2]

    def end(self, seconds: float = 0.0) -> int:
        """Wait some time for the end of the process, then kill it; return its exit code."""
        self.finish()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(max(0.0, seconds))
        self._process.kill()
        self.read()
        os.close(self._output)
        return self._process.wait()


def how_it_ended(code: int) -> str:
    """Return how a process has ended: by a signal (negative), or with an exit code."""
    return f'by signal {-code}' if code < 0 else f'with exit code {code}'


# ROS


def pid_of_publisher(gid: str) -> int:
    """Return the process id of a publisher, from its gid in hex; 0 if it is not known."""
    # Several processes may have these bits; one that takes part in a ROS domain is probably it.
    found = [pid for pid in processes() if pid & 0xffff == low_pid(gid)]
    return min(found, key=lambda pid: not ros_domains([pid]), default=0)


def low_pid(gid: str) -> int:
    """Return the lower 16 bits of the process id, which Fast DDS writes into a gid, or -1."""
    prefix = bytes.fromhex(gid[:16])
    return int.from_bytes(prefix[4:6], 'little') if prefix[:2] == b'\x01\x0f' else -1
