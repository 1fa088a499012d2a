"""Fixtures: ROS on loopback only, a ROS domain for each test, processes that always end."""

import os

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'  # before rclpy starts

from collections.abc import Callable, Iterable, Iterator, Mapping
import contextlib
from functools import cache
from importlib.util import find_spec
import json
import logging
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
from typing import Any, NoReturn, Optional

from hypothesis import HealthCheck, settings
from imports import of_ros, reached, ROS
import pytest

from dummy_arm.tf._bag.context import Stream
from dummy_arm.tf._core.pose import BatchOrRows, Row
from dummy_arm.tf._wire import cdr
from dummy_arm.tf._wire.cdr import Fields
from dummy_arm.tf._wire.streams import MessageReader
from dummy_arm.tf.bag import BagMessage

TIMEOUT = 20.0  # s; most waits take well under a second, unless the machine is overloaded
_GRACE = 3.0  # s; a process normally ends within 0.2 s
_RECOVERY = 3.0  # s; Fast DDS gives up the lock of a killed process after 1 s

#: Whether the tf2_msgs of ROS or a stand-in for it is installed; that of `compat` does not count.
HAS_TF2_MSGS = find_spec('tf2_msgs') is not None and find_spec('tf2_msgs.srv') is not None
#: Variables with which programs find tf2_msgs, as on a Jazzy desktop, or else a stand-in for it.
DESKTOP = {} if HAS_TF2_MSGS else {'PYTHONPATH': os.pathsep.join(filter(None, (
    str(Path(__file__).parent / 'desktop'), os.environ.get('PYTHONPATH'))))}
#: Variables with which a process uses the libraries of the environment of the tests.
OF_THIS_ENVIRONMENT = 'LD_LIBRARY_PATH', 'PYTHONPATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE'
#: The ids of the processes that belong to these tests.
_pids = {os.getpid()}
_HAS_ROS = find_spec('rclpy') is not None
_HAS_COMPAT = find_spec('_dummy_arm_tf2') is not None
#: The tests of `compat`, which is not installed where the real tf2 is.
_OF_COMPAT = ('test_new_environment.py', 'test_tf2_names.py', 'test_tf2_py.py',
              'test_tf2_ros_programs.py', 'test_tf_transformations.py')

# Examples have no deadline, since the machine may be busy. They are the same in each run: a fault
# that was there before must not fail a later change. --hypothesis-profile=random draws others.
UNHURRIED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile('unhurried', UNHURRIED, derandomize=True)
settings.register_profile('random', UNHURRIED)
settings.load_profile('unhurried')


@cache
def needs_ros(path: Path) -> bool:
    """Return whether a test module cannot be imported without ROS."""
    return bool(of_ros(reached(path, is_late=False)))


def pytest_ignore_collect(collection_path: Path) -> Optional[bool]:
    """Ignore the modules that cannot be imported where there is no ROS, or no `compat`."""
    if collection_path.suffix != '.py':
        return None
    is_out = ((not _HAS_ROS and needs_ros(collection_path))
              or (not _HAS_COMPAT and collection_path.name in _OF_COMPAT))
    return True if is_out else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests that need no ROS, and deselect the others where there is no ROS."""
    fixtures = {item: {*getattr(item, 'fixturenames', ())} for item in items}
    for item in items:
        if not needs_ros(item.path) and not {'domain_id', 'ros'} & fixtures[item]:
            item.add_marker('no_ros')
    if not _HAS_ROS:
        left_out = [item for item in items if 'no_ros' not in item.keywords]
        items[:] = [item for item in items if 'no_ros' in item.keywords]
        config.hook.pytest_deselected(items=left_out)
    # Browser tests, and that of many programs, take the longest: if they came last, one worker
    # would run them alone.
    items.sort(key=lambda item: 'browser' not in fixtures[item] and (
        not item.name.startswith('test_programs[')))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Report deselected tests: pytest-xdist does not report what its workers deselect."""
    if not _HAS_ROS:
        terminalreporter.write_line('rclpy is not installed: tests that need ROS were deselected')
    if not _HAS_COMPAT:
        terminalreporter.write_line(
            f'compat is not installed: {", ".join(_OF_COMPAT)} were ignored')


def tool(name: str, *arguments: str) -> tuple[str, ...]:
    """Return the arguments with which python runs a command of the package."""
    return '-c', f'import sys, dummy_arm.cli.entry_points as e; sys.exit(e.{name}())', *arguments


ARM = tool('dummy_arm')
#: Code before that of `tool`: from the line `begun` on, signals are handled as in a command.
BEGUN = ('from dummy_arm.cli.signals import record_signals; record_signals(); '
         'print("begun", flush=True); ')


def code_without(modules: Iterable[str]) -> str:
    """
    Return code that makes modules impossible to import, as if they were not installed.

    :param modules: the beginnings of their names.
    """
    return (
        'import sys\n'
        'class Blocked:\n'
        '    def find_spec(self, name, *_):\n'
        f'        if name.startswith({tuple(modules)!r}):\n'
        '            raise ModuleNotFoundError(f"No module named {name!r}", name=name)\n'
        'sys.meta_path.insert(0, Blocked())\n')


def run_on_full_disk(name: str, largest: int, *arguments: str, directory: Path
                     ) -> 'subprocess.CompletedProcess[str]':
    """
    Run a command whose files cannot get large, as where a disk is full.

    :param name: the name of the command, and of its module.
    :param largest: the largest size of a file (bytes).
    :param arguments: the command line.
    :param directory: the working directory.
    """
    code = f"""if True:
        import resource, signal, sys
        from dummy_arm.tools.{name} import main
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, ({largest}, {largest}))
        sys.exit(main())
    """
    return subprocess.run([sys.executable, '-c', code, *arguments], cwd=directory, text=True,
                          capture_output=True, check=False)


WITHOUT_ROS = code_without(ROS)


def tool_without(modules: Iterable[str], name: str, *arguments: str) -> tuple[str, ...]:
    """Return the arguments with which python runs a command where modules are not installed."""
    _, code, *rest = tool(name, *arguments)
    return '-c', code_without(modules) + code, *rest


def tool_without_ros(name: str, *arguments: str) -> tuple[str, ...]:
    """Return the arguments with which python runs a command where there is no ROS."""
    return tool_without(ROS, name, *arguments)


made_at_run_time = pytest.mark.skipif(
    HAS_TF2_MSGS,
    reason='tf2_msgs is installed: its TFMessage is used, none is made at run time')


on_linux = pytest.mark.skipif(
    sys.platform != 'linux', reason='only Linux has /proc and /dev/full')
on_unix = pytest.mark.skipif(
    sys.platform == 'win32', reason='Windows has no such pipes, terminals, signals or names')


@pytest.fixture(scope='session')
def golden_messages() -> list[dict[str, Any]]:
    """TFMessages, with the bytes into which the type support of tf2_msgs serialises them."""
    path = Path(__file__).parent / 'data' / 'tf_message_cdr.json'
    cases: list[dict[str, Any]] = json.loads(path.read_text())['cases']
    return cases


def ignore(_message: object) -> None:
    """Do nothing; a callback with a signature, which `print` lacks on Python 3.10."""


def fail_on_error(error: Exception) -> NoReturn:
    """Fail the test: the error callback of readers and sources that must not report any."""
    pytest.fail(repr(error))


class ArrivedMessages:
    """A source of a buffer whose messages have all arrived on /tf."""

    def __init__(self, *messages: bytes) -> None:
        self._batches = MessageReader(fail_on_error).read(messages, 'sent', False)

    def take(self) -> list[BatchOrRows]:
        """Return the decoded messages; the buffer clears this list when it has inserted them."""
        return self._batches

    def wake(self) -> None:
        """Do nothing, since no thread waits for messages."""


def recorded(time: int, data: bytes, is_static: bool = False, publisher: str = '',
             encoding: Any = cdr) -> BagMessage:
    """Return a message as `bag.messages` returns it; the time in ns."""
    return BagMessage(Stream(is_static, publisher, encoding), time, data)


def golden_fields(case: dict[str, Any]) -> list[Fields]:
    """Return the transforms of a golden case with their fields as on the wire."""
    return [(t['sec'], t['nanosec'], t['frame_id'], t['child_frame_id'], (*t['xyz'], *t['xyzw']))
            for t in case['transforms']]


def golden_rows(case: dict[str, Any]) -> list[Row]:
    """Return the transforms of a golden case as rows."""
    return [Row(sec * 10**9 + nanosec, parent, child, pose)
            for sec, nanosec, parent, child, pose in golden_fields(case)]


def reserved_domain() -> Iterator[int]:
    """
    Reserve a ROS domain id, so that tests that run at the same time are separated.

    Other programs do not reserve theirs: see `Ros.foreign_publishers`.
    """
    # Each worker of pytest-xdist has its own share of the domains. Domain 0 is left to other
    # programs, since it is their default.
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


@pytest.fixture
def domain_id() -> Iterator[int]:
    """The ROS domain id of a test."""
    yield from reserved_domain()


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

    def end(self, signal_number: int, timeout: float = TIMEOUT) -> float:
        """Send a signal and wait until the process ends; return the time that this took (s)."""
        start = time.monotonic()
        self._popen.send_signal(signal_number)
        self._popen.wait(timeout)
        return time.monotonic() - start

    def press_ctrl_c(self) -> None:
        """Send SIGINT to the process and to all that it has started, as a terminal does."""
        os.killpg(self._popen.pid, signal.SIGINT)

    def descendants(self) -> list[int]:
        """Return the ids of the processes that it has started, directly or indirectly."""
        children: dict[int, list[int]] = {}
        for path in Path('/proc').glob('[0-9]*/stat'):
            with contextlib.suppress(OSError):  # the process has ended meanwhile
                parent = path.read_text().rpartition(')')[2].split()[1]
                children.setdefault(int(parent), []).append(int(path.parent.name))
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
        """End the process by SIGINT, or by SIGKILL if it does not react; see `kill`."""
        try:
            self.end(signal.SIGINT, _GRACE)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            self._popen.wait()
        self._end_group()
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


def is_running(pid: int) -> bool:
    """Return whether a process exists and has not ended."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] not in 'XZ'
    except OSError:
        return False


def open_terminal(columns: int) -> tuple[int, int]:
    """Open a terminal of 24 lines; return the descriptors that read and write its text."""
    import fcntl  # Windows has none of these
    import pty
    import termios
    reading, writing = pty.openpty()
    fcntl.ioctl(writing, termios.TIOCSWINSZ, struct.pack('4H', 24, columns, 0, 0))
    return reading, writing


def run_in_terminal(domain, *arguments, until):
    """
    Run python in a terminal of 80 columns, and return what it has written.

    :param domain: the ROS domain id of the process.
    :param arguments: the arguments of python, as `tool` returns them.
    :param until: called with the output so far; returns whether to end the process by SIGINT. A
        process that takes too long is ended, too.
    """
    reading, writing = open_terminal(80)
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
    """Start programs by `start('-m', 'module', …)`, and end them after the test."""
    processes = []

    def start_process(*arguments: str, **kwargs: Any) -> Process:
        processes.append(Process(domain_id, *arguments, **kwargs))
        return processes[-1]

    yield start_process
    for process in processes:
        process.close()
        print(process.output)  # pytest shows it if the test failed


@pytest.fixture
def kill(ros: 'Ros') -> Iterator[Callable[[Process], object]]:
    """
    Kill a process by `kill(process)`; after the test, wait until Fast DDS has recovered.

    The process leaves half a megabyte in shared memory, and it may have held the lock of a port
    there, through which it was sending. The owner of the port gives up this lock after a second. A
    participant that is destroyed before that, such as that of the test itself, crashes in Fast DDS
    (2.14.5, in SharedMemChannelResource::release).
    """
    yield lambda process: process.end(signal.SIGKILL)
    time.sleep(_RECOVERY)


@pytest.fixture
def logs() -> Iterator[list[logging.LogRecord]]:
    """
    The warnings that the package logs where there is no ROS.

    This fixture has its own handler: with the pytest plugins of launch, `caplog` records nothing,
    since launch replaces the class of loggers by one whose loggers do not propagate.
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
def show(capsys: pytest.CaptureFixture[str]) -> Callable[[str], None]:
    """Print a figure that a test has measured, by `show(text)`, also if the test passes."""
    def print_line(text: str) -> None:
        with capsys.disabled():
            print(f'\n    {text}', end=' ', flush=True)

    return print_line


@pytest.fixture
def failed(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Call a `main` that fails, by `failed(main, 'argument', …)`; return exit code, stderr."""
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
    """A node of the test itself, and the executor that spins it."""

    def __init__(self, domain: int) -> None:
        """Create a context in the domain, a node and its executor."""
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node

        self.context = Context()
        self.context.init(domain_id=domain)
        self.node = Node('test', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def until(self, condition: Callable[[], object], timeout: float = TIMEOUT) -> None:
        """Spin until the condition holds; fail if it does not within the timeout (s)."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f'waited in vain{self.foreign_publishers_text()}'
            self.executor.spin_once(timeout_sec=0.05)

    def foreign_publishers(self) -> list[str]:
        """
        Return the publishers of TF in this domain that no process of the tests has created.

        Fast DDS writes the lower half of the process id into the fifth and sixth byte of a gid.
        """
        from rclpy.utilities import get_rmw_implementation_identifier
        if not self.context.ok() or 'fastrtps' not in get_rmw_implementation_identifier():
            return []
        own = {pid & 0xffff for pid in _pids}
        return sorted({
            f'{info.node_namespace.rstrip("/")}/{info.node_name} of process {pid}'
            for topic in ('/tf', '/tf_static')
            for info in self.node.get_publishers_info_by_topic(topic)
            if (pid := int.from_bytes(bytes(info.endpoint_gid[4:6]), 'little')) not in own})

    def foreign_publishers_text(self) -> str:
        """Return a text that names the foreign publishers and the remedy; '' if there is none."""
        if publishers := self.foreign_publishers():
            return (f'; in the domain {self.context.get_domain_id()} of this test, other '
                    f'processes publish TF: {", ".join(publishers)}. End them')
        return ''

    def close(self) -> None:
        """Destroy the executor, the node and the context."""
        from dummy_arm.cli.fast_dds import destroy
        self.executor.shutdown()
        destroy(self.node)
        self.context.try_shutdown()


@pytest.fixture
def ros(domain_id: int) -> Iterator[Ros]:
    """A node in the ROS domain of the test."""
    node = Ros(domain_id)
    yield node
    text = node.foreign_publishers_text()
    node.close()
    assert not text, text
