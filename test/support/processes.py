"""Processes that tests start and end, each in a ROS domain; terminals."""

from collections.abc import Callable, Iterable, Iterator, Mapping
import contextlib
from functools import cache
import os
from pathlib import Path
import queue
import random
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from typing import Any

from environment import code_without, COMMANDS, ROS
import pytest

from puretf._causes.domains import used_domains

TIMEOUT = 60.0  # s; most waits take well under a second, unless the machine is overloaded
_GRACE = 10.0  # s; a process normally ends within 0.2 s
#: Variables with which a process uses the libraries of the environment of the tests.
OF_THIS_ENVIRONMENT = 'LD_LIBRARY_PATH', 'PYTHONPATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE'
#: The ids of the processes that belong to these tests.
own_pids = {os.getpid()}
#: Reads the ids of process groups, one in each line, negative ones of those that have ended; at
#: the end of the lines, also when the process of the tests has died, it kills those that are left.
_WATCHDOG = """
import os, signal, sys
groups = set()
for line in sys.stdin:
    group = int(line)
    groups.add(group) if group > 0 else groups.discard(-group)
for group in groups:
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        pass
"""


def tool(name: str, *arguments: str) -> tuple[str, ...]:
    """Return the arguments with which python runs a command of the package."""
    package = COMMANDS[name].partition('.')[0]
    return '-c', f'import sys, {package}.entry_points as e; sys.exit(e.{name}())', *arguments


ARM = tool('dummy_arm')
#: Code that loads a core, for a limited time, and prints 'busy'.
BUSY = """if True:
    import time
    end = time.monotonic() + 1500.0
    print('busy', flush=True)
    while time.monotonic() < end:
        pass
"""
#: Code before that of `tool`: from the line `begun` on, signals are handled as in a command.
BEGUN = ('from puretf_tools.cli.signals import record_signals; record_signals(); '
         'print("begun", flush=True); ')


def tool_without(modules: Iterable[str], name: str, *arguments: str) -> tuple[str, ...]:
    """Return the arguments with which python runs a command where modules are not installed."""
    _, code, *rest = tool(name, *arguments)
    return '-c', code_without(modules) + code, *rest


def tool_without_ros(name: str, *arguments: str) -> tuple[str, ...]:
    """Return the arguments with which python runs a command where there is no ROS."""
    return tool_without(ROS, name, *arguments)


def reserved_domain() -> Iterator[int]:
    """
    Reserve a ROS domain id, so that tests that run at the same time are separated.

    Other programs do not reserve theirs. A domain that one of them uses is left to it; if one
    starts later, `Ros.foreign_publishers` names it.
    """
    # Each worker of pytest-xdist has its own share of the domains. Domain 0 is left to other
    # programs, since it is their default.
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
    share = range(1 + worker, 101, int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1')))
    used = used_domains()
    for domain in random.sample(share, len(share)):
        if domain in used:
            continue
        with socket.socket() as reservation:
            try:
                reservation.bind(('127.0.0.1', 23400 + domain))
            except OSError:
                continue
            yield domain
            return
    pytest.fail('no free ROS domain id')


@pytest.fixture
def domain_id() -> Iterator[int]:
    """The ROS domain id of a test."""
    yield from reserved_domain()


@cache
def _watchdog() -> Any:
    """Start the process that ends the others if this one dies; return the pipe to it."""
    process = subprocess.Popen(
        [sys.executable, '-S', '-c', _WATCHDOG], stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL, text=True, bufsize=1, start_new_session=True)
    own_pids.add(process.pid)
    return process.stdin


class Process:
    """A program that a test runs in a ROS domain, and whose output is read line by line."""

    def __init__(self, domain: int, *arguments: str, environment: Mapping[str, str] = {},
                 **kwargs: Any) -> None:
        """
        Start python, as the leader of a process group.

        The environment variable TEST_PYTHON names another python than that of the tests.

        :param domain: the ROS domain id of the process.
        :param arguments: the arguments of python.
        :param environment: environment variables to set.
        :param kwargs: further arguments of `subprocess.Popen`.
        """
        variables = {**os.environ, 'ROS_DOMAIN_ID': str(domain), **environment}
        python = variables.pop('TEST_PYTHON', sys.executable)
        if python != sys.executable:  # it must not use the libraries of this environment
            for name in OF_THIS_ENVIRONMENT:
                variables.pop(name, None)
        self._popen = subprocess.Popen(
            [python, '-u', *arguments], text=True, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, start_new_session=True, env=variables, **kwargs)
        _watchdog().write(f'{self._popen.pid}\n')
        own_pids.add(self._popen.pid)
        assert self._popen.stdout is not None
        self._stdout = self._popen.stdout
        self.output = ''
        self._lines: queue.Queue[str] = queue.Queue()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        for line in self._stdout:
            self.output += line
            self._lines.put(line)
        self._lines.put('')

    @property
    def pid(self) -> int:
        """The id of the process."""
        return self._popen.pid

    def line(self) -> str:
        """Wait for the next line of output and return it; '' means the end of the output."""
        return self._lines.get(timeout=TIMEOUT)

    def line_with(self, text: str) -> str:
        """Wait for a line of output that contains the text, and return it."""
        while text not in (line := self.line()):
            assert line, f'the process ended without printing {text!r}:\n{self.output}'
        return line

    def url(self) -> str:
        """Wait for the address of the page that the process serves, and return it."""
        return self.line_with('look at http').split()[-1]

    def port(self) -> int:
        """Wait for the address as `url` does, and return its port."""
        return int(self.url().rpartition(':')[2])

    def end(self, signal_number: int, timeout: float = TIMEOUT) -> float:
        """Send a signal and wait until the process ends; return the time that this took (s)."""
        start = time.monotonic()
        self._popen.send_signal(signal_number)
        self._popen.wait(timeout)
        return time.monotonic() - start

    def end_normally(self, signal_number: int = signal.SIGINT) -> None:
        """Send a signal; the process must end with exit code 0 and without a traceback."""
        self.end(signal_number)
        assert self.exit_code() == 0, self.output
        assert 'Traceback' not in self.output

    def press_ctrl_c(self) -> None:
        """Send SIGINT to the process and to all that it has started, as a terminal does."""
        os.killpg(self._popen.pid, signal.SIGINT)

    def descendants(self) -> list[int]:
        """Return the ids of the processes that it has started, directly or indirectly."""
        children = children_of_all()
        found = [self._popen.pid]
        for pid in found:
            found += children.get(pid, [])
        return found[1:]

    def has_ended(self) -> bool:
        """Return whether the process has ended."""
        return self._popen.poll() is not None

    def exit_code(self, timeout: float = TIMEOUT) -> int:
        """Wait until the process ends, and return its exit code."""
        code = self._popen.wait(timeout)
        self._reader.join(timeout)
        assert not self._reader.is_alive(), 'its output is held open by processes it left behind'
        return code

    def close(self) -> None:
        """End the process by SIGINT, or by SIGKILL if it does not react."""
        try:
            self.end(signal.SIGINT, _GRACE)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            self._popen.wait()
        self._end_group()
        _watchdog().write(f'-{self._popen.pid}\n')
        self._reader.join()
        self._stdout.close()

    def has_left_processes(self) -> bool:
        """Return whether processes that it has started are still running."""
        try:
            os.killpg(self._popen.pid, 0)
        except ProcessLookupError:
            return False
        return True

    def _end_group(self) -> None:
        """End the processes that it has started and left behind."""
        for number in signal.SIGINT, signal.SIGKILL:
            deadline = time.monotonic() + _GRACE
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._popen.pid, number)
            while self.has_left_processes() and time.monotonic() < deadline:
                time.sleep(0.01)


def children_of_all() -> dict[int, list[int]]:
    """Return the ids of the children of each process that has some."""
    children: dict[int, list[int]] = {}
    for path in Path('/proc').glob('[0-9]*/stat'):
        with contextlib.suppress(OSError):  # the process has ended meanwhile
            parent = path.read_text().rpartition(')')[2].split()[1]
            children.setdefault(int(parent), []).append(int(path.parent.name))
    return children


def is_running(pid: int) -> bool:
    """Return whether a process exists and has not ended."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] not in 'XZ'
    except OSError:
        return False


def cpu_seconds(pid: int) -> float:
    """Return the CPU time that a process has used (s)."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return int(fields[11]) / os.sysconf('SC_CLK_TCK')


def open_terminal(columns: int) -> tuple[int, int]:
    """Open a terminal of 24 lines; return the descriptors that read and write its text."""
    import fcntl  # Windows has none of these
    import pty
    import termios
    reading, writing = pty.openpty()
    fcntl.ioctl(writing, termios.TIOCSWINSZ, struct.pack('4H', 24, columns, 0, 0))
    return reading, writing


@pytest.fixture
def start(domain_id: int) -> Iterator[Callable[..., Process]]:
    """Start programs by `start('-m', 'module', …, domain=…)`, and end them after the test."""
    processes = []

    def start_process(*arguments: str, domain: int = domain_id, **kwargs: Any) -> Process:
        processes.append(Process(domain, *arguments, **kwargs))
        return processes[-1]

    yield start_process
    for process in processes:
        process.close()
        print(process.output)  # pytest shows it if the test failed


@pytest.fixture
def browse() -> Iterator[Callable[..., Any]]:
    """
    A function that opens the page of a process, or an address, in a browser.

    The page must have no faults. No other test has a browser meanwhile.
    """
    from browser import pages
    with pages() as open_page:
        yield lambda page, *size: open_page(
            page if isinstance(page, str) else page.url(), *size)
