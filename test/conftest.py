"""Fixtures: ROS on loopback only, a domain of its own for every test, processes that end."""

import os

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'  # before rclpy starts

from collections.abc import Callable, Iterable, Iterator, Mapping
import contextlib
import fcntl
from functools import cache
from importlib.util import find_spec
import json
import logging
from pathlib import Path
import pty
import queue
import random
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
from typing import Any, NoReturn, Optional

from hypothesis import HealthCheck, settings
from imports import of_ros, reached, ROS
import pytest

from dummy_arm.tf._core.pose import BatchOrRows, Row
from dummy_arm.tf._wire.cdr import Fields
from dummy_arm.tf._wire.streams import MessageReader

TIMEOUT = 20.0  # s; for what takes well under a second on a machine that is not overloaded
_GRACE = 3.0  # s; for what ends in 0.2 s
_GIVEN_UP = 3.0  # s; after 1 s Fast DDS gives up a lock of one that was killed

#: The environment of programs as on a Jazzy desktop, with tf2_msgs or a stand-in.
DESKTOP = {} if find_spec('tf2_msgs') else {'PYTHONPATH': os.pathsep.join(filter(None, (
    str(Path(__file__).parent / 'desktop'), os.environ.get('PYTHONPATH'))))}
#: The processes of these tests.
_pids = {os.getpid()}
_HAS_ROS = find_spec('rclpy') is not None

# How long an example takes is no matter: the machine may be busy.
settings.register_profile('unhurried', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('unhurried')


@cache
def needs_ros(path: Path) -> bool:
    """Return whether a module of tests needs ROS to be imported."""
    return bool(of_ros(reached(path, is_late=False)))


def pytest_ignore_collect(collection_path: Path) -> Optional[bool]:
    """Leave out the modules that cannot be imported, where there is no ROS."""
    is_out = not _HAS_ROS and collection_path.suffix == '.py' and needs_ros(collection_path)
    return True if is_out else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests that need no ROS, and leave out the others where there is none."""
    fixtures = {item: {*getattr(item, 'fixturenames', ())} for item in items}
    for item in items:
        if not needs_ros(item.path) and not {'domain_id', 'ros'} & fixtures[item]:
            item.add_marker('no_ros')
    if not _HAS_ROS:
        left_out = [item for item in items if 'no_ros' not in item.keywords]
        items[:] = [item for item in items if 'no_ros' in item.keywords]
        config.hook.pytest_deselected(items=left_out)
    # Those of the page take the longest: last, one worker would go on with them alone.
    items.sort(key=lambda item: 'browser' not in fixtures[item])


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say that tests were left out: pytest-xdist does not report what its workers leave out."""
    if not _HAS_ROS:
        terminalreporter.write_line('rclpy is not installed: tests that need ROS were left out')


def tool(name: str, *arguments: str) -> tuple[str, ...]:
    """Give the arguments of python that run a command."""
    return '-c', f'import sys, dummy_arm.cli.entry_points as e; sys.exit(e.{name}())', *arguments


ARM = tool('dummy_arm')


def without(modules: Iterable[str]) -> str:
    """
    Give code by which a program does not find modules, as if they were not installed.

    :param modules: the beginnings of their names.
    """
    return (
        'import sys\n'
        'class Blocked:\n'
        '    def find_spec(self, name, *_):\n'
        f'        if name.startswith({tuple(modules)!r}):\n'
        '            raise ModuleNotFoundError(f"No module named {name!r}", name=name)\n'
        'sys.meta_path.insert(0, Blocked())\n')


WITHOUT_ROS = without(ROS)


def tool_without(modules: Iterable[str], name: str, *arguments: str) -> tuple[str, ...]:
    """Give the arguments of python that run a command where modules are not installed."""
    _, code, *rest = tool(name, *arguments)
    return '-c', without(modules) + code, *rest


def tool_without_ros(name: str, *arguments: str) -> tuple[str, ...]:
    """Give the arguments of python that run a command where there is no ROS."""
    return tool_without(ROS, name, *arguments)


made_at_run_time = pytest.mark.skipif(
    find_spec('tf2_msgs') is not None,
    reason='about the TFMessage made where tf2_msgs is not installed')


@pytest.fixture(scope='session')
def golden_messages() -> list[dict[str, Any]]:
    """TFMessages with the bytes that tf2_msgs' own type support makes of them."""
    path = Path(__file__).parent / 'data' / 'tf_message_cdr.json'
    cases: list[dict[str, Any]] = json.loads(path.read_text())['cases']
    return cases


def unexpected(error: Exception) -> NoReturn:
    """Fail, since there was an error: what a reader or a source is given to tell of them."""
    pytest.fail(repr(error))


class Arrived:
    """A source of a buffer, with messages that have arrived on /tf."""

    def __init__(self, *messages: bytes) -> None:
        self._batches = MessageReader(unexpected).read(messages, 'sent', False)

    def take(self) -> list[BatchOrRows]:
        """Return them, as long as nobody has inserted them."""
        return self._batches

    def wake(self) -> None:
        """Do nothing: there is no thread."""


def golden_fields(case: dict[str, Any]) -> list[Fields]:
    """Read the transforms of a golden case as they are on the wire."""
    return [(t['sec'], t['nanosec'], t['frame_id'], t['child_frame_id'], (*t['xyz'], *t['xyzw']))
            for t in case['transforms']]


def golden_rows(case: dict[str, Any]) -> list[Row]:
    """Read the transforms of a golden case as rows."""
    return [Row(sec * 10**9 + nanosec, parent, child, pose)
            for sec, nanosec, parent, child, pose in golden_fields(case)]


@pytest.fixture
def domain_id() -> Iterator[int]:
    """
    Reserve a ROS domain id, so that test runs side by side do not hear each other.

    Others than tests reserve none: see `Ros.strangers`.
    """
    # Each worker of pytest-xdist has a share of its own; in 0 there are others, too.
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
    share = range(1 + worker, 101, int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1')))
    for domain in random.sample(share, len(share)):
        with socket.socket() as reservation:
            try:
                reservation.bind(('127.0.0.1', 23400 + domain))
            except OSError:
                continue
            yield domain
            return
    pytest.fail('no free ROS domain id')


class Process:
    """A program that is run by a test, in a domain; its output comes line by line."""

    def __init__(self, domain: int, *arguments: str, environment: Mapping[str, str] = {},
                 **how: Any) -> None:
        """
        Start python with the arguments, as the leader of a process group.

        :param environment: variables to set.
        """
        self._popen = subprocess.Popen(
            [sys.executable, '-u', *arguments], text=True, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, start_new_session=True,
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain), **environment}, **how)
        _pids.add(self._popen.pid)
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

    def line(self) -> str:
        """Wait for the next line of output; '' at its end."""
        return self._lines.get(timeout=TIMEOUT)

    def line_with(self, text: str) -> str:
        """Wait for a line that has the text in it."""
        while text not in (line := self.line()):
            assert line, f'ended without {text!r}:\n{self.output}'
        return line

    def end(self, signal_number: int, timeout: float = TIMEOUT) -> float:
        """Send a signal and wait for the end; return the time that it took (s)."""
        start = time.monotonic()
        self._popen.send_signal(signal_number)
        self._popen.wait(timeout)
        return time.monotonic() - start

    def press_ctrl_c(self) -> None:
        """Send SIGINT to the process and all that it has started, as a terminal does."""
        os.killpg(self._popen.pid, signal.SIGINT)

    def descendants(self) -> list[int]:
        """List the ids of the processes that it has started, and of those that these have."""
        children: dict[int, list[int]] = {}
        for path in Path('/proc').glob('[0-9]*/stat'):
            with contextlib.suppress(OSError):  # it has ended by now
                parent = path.read_text().rpartition(')')[2].split()[1]
                children.setdefault(int(parent), []).append(int(path.parent.name))
        found = [self._popen.pid]
        for pid in found:
            found += children.get(pid, [])
        return found[1:]

    def ended(self) -> bool:
        """Tell whether it has ended."""
        return self._popen.poll() is not None

    def exit_code(self, timeout: float = TIMEOUT) -> int:
        """Wait for the end."""
        code = self._popen.wait(timeout)
        self._reader.join(timeout)
        assert not self._reader.is_alive(), 'it has left others behind, who hold its output'
        return code

    def close(self) -> None:
        """End the process, by Ctrl-C if it heeds that: see `kill` for what is left otherwise."""
        try:
            self.end(signal.SIGINT, _GRACE)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            self._popen.wait()
        self._end_group()
        self._reader.join()
        self._stdout.close()

    def has_left_others(self) -> bool:
        """Tell whether something that the process has started goes on."""
        try:
            os.killpg(self._popen.pid, 0)
        except ProcessLookupError:
            return False
        return True

    def _end_group(self) -> None:
        """End what the process has started, and left behind."""
        for number in signal.SIGINT, signal.SIGKILL:
            deadline = time.monotonic() + _GRACE
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._popen.pid, number)
            while self.has_left_others() and time.monotonic() < deadline:
                time.sleep(0.01)


def is_running(pid: int) -> bool:
    """Tell whether there is a process that has not ended."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] not in 'XZ'
    except OSError:
        return False


def in_a_terminal(domain, *arguments, until):
    """
    Run python in a terminal of 80 columns until what it wrote has something; give that.

    :param arguments: of python, as `tool` gives them.
    """
    reading, writing = pty.openpty()
    fcntl.ioctl(writing, termios.TIOCSWINSZ, struct.pack('4H', 24, 80, 0, 0))
    process = subprocess.Popen(
        [sys.executable, *arguments], stdout=writing, stderr=writing, stdin=writing,
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)})
    os.close(writing)
    deadline = time.monotonic() + 2 * TIMEOUT
    written = ''
    has_ended = False
    try:
        while True:
            written += os.read(reading, 10_000).decode(errors='replace')
            if not has_ended and (until(written) or time.monotonic() > deadline):
                process.send_signal(signal.SIGINT)
                has_ended = True
    except OSError:  # the terminal is gone: the process has ended
        pass
    assert process.wait(TIMEOUT) == 0
    os.close(reading)
    return written


@pytest.fixture
def start(domain_id: int) -> Iterator[Callable[..., Process]]:
    """Start programs: `start('-m', 'module', …)`."""
    processes = []

    def start_process(*arguments: str, **how: Any) -> Process:
        processes.append(Process(domain_id, *arguments, **how))
        return processes[-1]

    yield start_process
    for process in processes:
        process.close()
        print(process.output)  # shown where the test failed


@pytest.fixture
def kill(ros: 'Ros') -> Iterator[Callable[[Process], object]]:
    """
    Kill a process without a word: `kill(process)`.

    It leaves half a megabyte in shared memory, and may have held the lock of a port there, by
    which it sent. The port's owner gives that up after a second; a participant that is ended
    meanwhile, as that of the test itself, crashes in Fast DDS (2.14.5, in
    SharedMemChannelResource::release).
    """
    yield lambda process: process.end(signal.SIGKILL)
    time.sleep(_GIVEN_UP)


@pytest.fixture
def logs() -> Iterator[list[logging.LogRecord]]:
    """
    List the warnings that the package logs where there is no ROS.

    By a handler of its own: with the pytest plugins of launch, `caplog` records nothing, since
    launch replaces the class of loggers by one whose loggers do not propagate.
    """
    records: list[logging.LogRecord] = []

    class Recorder(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            records.append(record)

    handler = Recorder(logging.WARNING)
    logger = logging.getLogger('dummy_arm.tf')
    logger.addHandler(handler)
    yield records
    logger.removeHandler(handler)


@pytest.fixture
def failed(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Call a `main` that fails: `failed(main, 'argument', …)`; give its exit code and stderr."""
    def call(main: Callable[[list[str]], int], *arguments: str) -> tuple[int, str]:
        code: object
        try:
            code = main([*arguments])
        except SystemExit as end:
            code = end.code
        output, error = capsys.readouterr()
        assert not output
        assert isinstance(code, int)
        return code, error

    return call


class Ros:
    """A node of the test's own, and the executor that spins it."""

    def __init__(self, domain: int) -> None:
        """Make a context in the domain and a node in it."""
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node

        self.context = Context()
        self.context.init(domain_id=domain)
        self.node = Node('test', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def until(self, condition: Callable[[], object], timeout: float = TIMEOUT) -> None:
        """Spin until the condition holds."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f'waited in vain{self.told_of_strangers()}'
            self.executor.spin_once(timeout_sec=0.05)

    def strangers(self) -> list[str]:
        """
        List what publishes TF in this domain, and is of no process that the tests have started.

        Fast DDS writes the lower half of the process id into the fifth and sixth byte of a gid.
        """
        from rclpy.utilities import get_rmw_implementation_identifier
        if not self.context.ok() or 'fastrtps' not in get_rmw_implementation_identifier():
            return []
        ours = {pid & 0xffff for pid in _pids}
        return sorted({
            f'{info.node_namespace.rstrip("/")}/{info.node_name} of process {pid}'
            for topic in ('/tf', '/tf_static')
            for info in self.node.get_publishers_info_by_topic(topic)
            if (pid := int.from_bytes(bytes(info.endpoint_gid[4:6]), 'little')) not in ours})

    def told_of_strangers(self) -> str:
        """Tell of those, and what to do; '' where there is none."""
        if strangers := self.strangers():
            return (f'; in the domain {self.context.get_domain_id()} of this test, others publish '
                    f'TF that it receives: {", ".join(strangers)}. End them')
        return ''

    def close(self) -> None:
        """Destroy it all."""
        from dummy_arm.cli.fast_dds import destroy
        self.executor.shutdown()
        destroy(self.node)
        self.context.try_shutdown()


@pytest.fixture
def ros(domain_id: int) -> Iterator[Ros]:
    """A node in the domain of the test."""
    node = Ros(domain_id)
    yield node
    told = node.told_of_strangers()
    node.close()
    assert not told, told
