"""The command `check_arm`: judge the arm of the lab's final task, and its drawing frames.pdf."""

import ast
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, ExitStack, suppress
import csv
from itertools import pairwise
import json
import logging
from math import inf
import os
from pathlib import Path
import random
import re
from select import select
import signal
import socket
import subprocess
import sys
from tempfile import TemporaryDirectory
from threading import Thread
import time
from typing import NamedTuple, Optional, TYPE_CHECKING
from unicodedata import normalize
import warnings

from dummy_arm.cli.bag_options import add_bag_options, bag_progress, check_partial
from dummy_arm.cli.files import whole_file
from dummy_arm.cli.parser import CommandError, number, Parser, run, UsageError
from dummy_arm.cli.progress import wait
from dummy_arm.cli.signals import (
    begin_cleanup,
    check_signals,
    record_signals,
    sleep,
    wait_until,
)
from dummy_arm.grading.arm_check import (
    ADVICE,
    check,
    FRAMES,
    Line,
    Message,
    NOT_JUDGED,
    NOT_OK,
    OK,
    Report,
)
from dummy_arm.inspection.terminal import padded, wrapped
from dummy_arm.tf.bag import messages
from dummy_arm.tf.formatting import abbreviated, comma_list, quoted, shortened, visible

if TYPE_CHECKING:
    from rclpy.node import Node

#: The default and the largest time to observe an arm (s). The default is more than a period of the
#: slowest joint: 20.9 s if 0.3 rad/s is the speed of the phase, 16.4 s if it is that of the joint.
DEFAULT_TIME, _LONGEST = 25.0, 3600.0
#: How long to wait for the first transform on /tf (s).
_START = 20.0
#: How long a late listener waits for base_link (s).
_LATE = 10.0
#: How long to wait until a program has ended after SIGINT (s).
_GRACE = 3.0
#: A process that observes a program is given up if it writes nothing for this time (s). It can
#: hang, or crash, in the middleware.
_SILENCE = 60.0
#: How long to wait for a free ROS domain (s).
_PATIENCE = 600.0
#: The largest number of transforms that are judged.
_MOST = 1_000_000
#: The largest output of a program (bytes).
_LONGEST_OUTPUT = 1_000_000
#: ROS domains whose ports are outside the range from which Linux takes ports for clients.
_DOMAINS = range(215, 232)
#: The ports of a domain begin at `_FIRST_PORT + _PORTS * domain` (RTPS specification, 9.6.2).
_FIRST_PORT, _PORTS = 7400, 250
_TRACEBACK = 'Traceback (most recent call last):'
_NO_FILE = 'It is not a regular file.'
#: The lines of frames.pdf that are not the name of a frame, as this package and tf2 write them.
_LABEL = re.compile(r'Broadcaster: |Average rate: |Buffer length: |Most recent transform: |'
                    r'Oldest transform: |Recorded at time: |view_frames Result$|static$')
#: A token of the DOT language: a string, a comment, a name, an arrow, or another character.
_TOKEN = re.compile(r"""
    "(?: [^"\\] | \\.? )* (?: " | \Z)
    | //.* | \#.* | /\* [\s\S]*? (?: \*/ | \Z)
    | [\w.]+ | -> | \S
""", re.VERBOSE)
_LONGEST_GRAPH = 1_000_000  # characters
#: The largest number of names that a text lists.
_SHOWN = 6


#: A program that starts Python with other arguments. If its parent ends, even by SIGKILL, the
#: kernel ends the started process, too.
_LAUNCHER = """
import os, sys
if sys.platform == 'linux':
    import ctypes
    ctypes.CDLL(None).prctl(1, 9)  # PR_SET_PDEATHSIG: SIGKILL, when the parent has ended
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""
#: The program of the process that observes a program.
_OBSERVER = """
import sys
sys.path[:] = filter(None, sys.path)  # not the working directory, where the programs may lie
import json
arguments, sys.path[:] = json.loads(sys.argv[1])
from dummy_arm.tools.check_arm import observe
observe(*arguments)
"""


class ProgramError(CommandError):
    """A program or its arm cannot be judged; the text says why."""


class Observer:
    """A listener that collects the messages of an arm."""

    def __init__(self, node: 'Node', on_poll: Callable[[], object] = lambda: None) -> None:
        """
        Subscribe to /tf and /tf_static.

        :param node: the node that subscribes.
        :param on_poll: a function that each call of `poll` calls.
        """
        from dummy_arm.inspection.frame_listener import FrameListener
        self._node, self._on_poll = node, on_poll
        self._listener = FrameListener(node)
        self.messages: list[Message] = []
        #: True if a message of /tf has been received.
        self.has_started = False
        self._count = 0

    def poll(self) -> bool:
        """
        Collect the messages that have arrived since the last call.

        :returns: True if a message of /tf has been received, now or earlier.
        :raises ProgramError: if there are too many messages.
        """
        self._on_poll()
        received, dropped = self._listener.publisher_listener.received()
        for message in received:
            with suppress(ValueError):  # the listener logs this error
                rows = message.rows()
                self._count += len(rows)
                self.messages.append(Message(
                    message.time, message.is_static, message.publisher, rows))
                self.has_started |= not message.is_static
        if dropped or self._count > _MOST:
            raise ProgramError('More transforms arrive than can be judged.')
        return self.has_started

    def reaches_late_joiners(self) -> bool:
        """Return whether a listener that starts now receives base_link on /tf_static."""
        from dummy_arm.tf import BufferCore, StaticTransformListener
        buffer = BufferCore()
        listener = StaticTransformListener(buffer, self._node)
        try:
            return wait_until(_LATE, lambda: any(
                frame.name == 'base_link' for frame in buffer.frames()))
        finally:
            listener.unregister()

    def report(self) -> Report:
        """Judge the messages; before that, start a late listener."""
        self.poll()
        end = time.time_ns()
        is_sent = any(row.child_frame_id.removeprefix('/') == 'base_link'
                      for message in self.messages if message.is_static for row in message.rows)
        return check(self.messages, is_sent and self.reaches_late_joiners(), end)

    def why_no_frames(self) -> str:
        """Return the possible reasons why no transform has been received."""
        return self._listener.why_no_frames()

    def wrong_type_hint(self) -> str:
        """Return who publishes another type than TFMessage; '' if nobody does."""
        return self._listener.wrong_type_hint()


# Programs


class Program:
    """A student's program in a process group of its own; its output is limited."""

    def __init__(self, path: Path, arguments: Sequence[str], domain: int, directory: str) -> None:
        """
        Start the program.

        :param path: the file of the program.
        :param arguments: the arguments of Python; see `_arguments`.
        :param domain: the ROS domain of the program.
        :param directory: the working directory of the program, which no other process uses.
        """
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'ROS_LOG_DIR': directory,
                       'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'PYTHONUNBUFFERED': '1',
                       'PYTHONDONTWRITEBYTECODE': '1', 'PYTHONIOENCODING': 'utf-8'}
        self._process = subprocess.Popen(
            [sys.executable, '-I', '-S', '-c', _LAUNCHER, *arguments], cwd=directory,
            env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, start_new_session=True)
        self._path, self._start = path, time.monotonic()
        self._output = bytearray()
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        descriptor = self._process.stdout.fileno()
        with suppress(OSError):
            while len(self._output) <= _LONGEST_OUTPUT and (data := os.read(descriptor, 2**16)):
                self._output += data

    def fault(self) -> str:
        """
        Return why the program has failed.

        :returns: a sentence; '' if the program is running and has printed no traceback.
        """
        code = self._process.poll()
        if code is not None:
            self._reader.join(_GRACE)
        if len(self._output) > _LONGEST_OUTPUT:
            return f'It prints more than {_LONGEST_OUTPUT // 10**6} MB.'
        if code is None and _TRACEBACK.encode() not in self._output:
            return ''
        text = self._output.decode(errors='replace')
        if error := _error_of(text, self._path.name):
            return f'It fails: {error}'
        if code is None:
            return ''
        last = text.strip().splitlines()[-1:]
        seconds = time.monotonic() - self._start
        return (f'It ended by itself after {seconds:.1f} s, {_how(code)}' + (
            f'; its last line: {abbreviated(visible(last[0]))}' if last else '.'))

    def end(self) -> None:
        """End the program and the processes of its group."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE)
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._reader.join(_GRACE)
        if not self._reader.is_alive() and self._process.stdout:
            self._process.stdout.close()


def _how(code: int) -> str:
    """Return how a process has ended."""
    return f'by signal {-code}' if code < 0 else f'with exit code {code}'


def _arguments(path: Path) -> list[str]:
    """
    Return the arguments with which Python runs a program.

    A program that defines main(), but does not call it, is meant for `ros2 run`, which calls it.

    :raises ProgramError: if the file cannot be read or does not compile.
    """
    if path.exists() and not path.is_file():  # reading a pipe might never end
        raise ProgramError(_NO_FILE)
    try:
        tree = ast.parse(path.read_bytes(), str(path))
        compile(tree, str(path), 'exec')
    except OSError as error:
        raise ProgramError(f'It cannot be read: {error.strerror}.') from None
    except SyntaxError as error:
        line = f'line {error.lineno}: ' if error.lineno else ''
        raise ProgramError(f'It does not compile: {line}{error.msg}.') from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise ProgramError(f'It does not compile: {error or type(error).__name__}.') from None
    functions = ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef
    has_main = any(isinstance(node, ast.FunctionDef) and node.name == 'main' for node in tree.body)
    statements = [node for node in tree.body if not isinstance(node, functions)]
    calls_main = any('main' in _names(node) for node in statements)
    is_script = any('__name__' in _names(node.test) for node in statements
                    if isinstance(node, ast.If))
    path = path.absolute()
    if calls_main or is_script or not has_main:
        return [str(path)]
    return ['-c', f'import runpy, sys; sys.argv = [{str(path)!r}]; sys.path[0] = '
                  f'{str(path.parent)!r}; runpy.run_path(sys.argv[0])["main"]()']


def _names(node: ast.AST) -> set[str]:
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}


def _error_of(output: str, name: str) -> str:
    """
    Return the error of the first traceback in an output, and the line where it was raised.

    :param name: the name of the program's file, in which the line is looked for.
    :returns: the text; '' if there is no traceback, or if its last line has not been printed yet.
    """
    # The lines of a group of exceptions begin with "  + " or "  | ".
    printed = [re.sub(r'^ *[+|] ', '', line) for line in output.split('\n')[:-1]]
    begin = next((i for i, line in enumerate(printed) if line.endswith(_TRACEBACK)), len(printed))
    end = next((i for i, line in enumerate(printed) if i > begin and line[:1] not in ('', ' ')), 0)
    if not end:
        return ''
    lines = re.findall(rf'/{re.escape(name)}", line (\d+)', '\n'.join(printed[begin:end]))
    where = f' (line {lines[-1]})' if lines else ''
    return f'{abbreviated(visible(printed[end]), 300)}{where}'


class Grade(NamedTuple):
    """The result of a program, or of a drawing."""

    file: str
    report: Optional[Report]  #: None if the program could not be judged
    reason: str  #: why it did not pass; '' if it passed
    verdict: str  #: OK, NOT_OK or NOT_JUDGED

    @property
    def line(self) -> str:
        """The line that is printed."""
        advice = [f'{line.requirement} ({line.measured})' for line in self.report.advice
                  if line.verdict == ADVICE] if self.report else []
        verdict = f'{self.verdict}: {self.reason}' if self.reason else (
            f'{OK}; advice: {"; ".join(advice)}' if advice else OK)
        return f'{visible(self.file)}: {verdict}'


def _grade(file: str, report: Optional[Report], reason: str) -> Grade:
    return Grade(file, report, reason, NOT_OK if reason else OK)


def grade(file: str, seconds: float, ros_args: Sequence[str] = ('check_arm',),
          silence: float = _SILENCE) -> Grade:
    """
    Run a program in a ROS domain of its own, and judge the arm that it publishes.

    Another process observes the arm, since the middleware can hang or crash.

    :param file: the path of the program.
    :param seconds: how long to observe the arm (s).
    :param ros_args: the command line, with the name of the command, for the node that listens.
    :param silence: how long to wait for a sign of life of the other process (s).
    :returns: the grade.
    :raises CommandError: if no ROS domain is free.
    :raises KeyboardInterrupt: if Ctrl-C or SIGTERM was received.
    """
    try:
        return _grade_by_observer(file, seconds, ros_args, silence)
    except CommandError:
        raise
    except Exception as error:  # the other programs are judged all the same
        return Grade(file, None, f'check_arm failed: {type(error).__name__}: {error}', NOT_JUDGED)


def _grade_by_observer(file: str, seconds: float, ros_args: Sequence[str], silence: float
                       ) -> Grade:
    """Judge a program as `grade` does."""
    with _free_domain() as domain, TemporaryDirectory(ignore_cleanup_errors=True) as directory:
        reading, writing = os.pipe()
        arguments = [writing, file, seconds, domain, directory, [*ros_args]]
        observer = subprocess.Popen(
            [sys.executable, '-I', '-S', '-c', _LAUNCHER, '-c', _OBSERVER,
             json.dumps([arguments, sys.path])],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=[writing],
            start_new_session=True)
        os.close(writing)
        try:
            written = _read(reading, silence)
            if written is None:
                observer.kill()
                return Grade(file, None, f'The process that observes it has said nothing for '
                             f'{silence:g} s: probably the middleware hangs.', NOT_JUDGED)
            if not written.strip():
                how = _how(observer.wait(_GRACE))
                return Grade(file, None, f'The process that observes it ended {how}.', NOT_JUDGED)
            report, reason, verdict = json.loads(written)
            if report:
                lines, advice, passed = report
                report = Report([Line(*line) for line in lines],
                                [Line(*line) for line in advice], passed)
            return Grade(file, report, reason, verdict)
        finally:
            _end(observer, directory)
            os.close(reading)


def _read(pipe: int, silence: float) -> Optional[bytes]:
    """Read a pipe to its end; return None if nothing comes for some time (s)."""
    data, last = b'', time.monotonic()
    while time.monotonic() < last + silence:
        check_signals()
        if select([pipe], [], [], 0.1)[0]:
            new, last = os.read(pipe, 2**16), time.monotonic()
            if not new:
                return data
            data += new
    return None


def _end(observer: 'subprocess.Popen[bytes]', directory: str) -> None:
    """End an observer, its program, and the processes that this has started."""
    # If the observer is killed, the kernel kills the program, too.
    observer.terminate()
    try:
        observer.wait(2.0 * _GRACE)
    except subprocess.TimeoutExpired:
        observer.kill()
        observer.wait()
    mark = f'ROS_LOG_DIR={directory}'.encode()
    for path in Path('/proc').glob('[0-9]*/environ'):  # also processes that have left the group
        with suppress(OSError):
            if mark in path.read_bytes().split(b'\0'):
                os.kill(int(path.parent.name), signal.SIGKILL)


def observe(pipe: int, file: str, seconds: float, domain: int, directory: str,
            ros_args: Sequence[str]) -> None:
    """
    Run a program and judge its arm; write empty lines as signs of life, and then the grade.

    :param pipe: the file descriptor for the lines and the grade, which is JSON.
    :param file: the path of the program.
    :param seconds: how long to observe the arm (s).
    :param domain: the ROS domain.
    :param directory: the working directory of the program.
    :param ros_args: the ROS arguments of the node that listens.
    """
    record_signals()
    warnings.simplefilter('ignore')  # what the compiler thinks of the program
    with suppress(KeyboardInterrupt, BrokenPipeError), open(pipe, 'w') as output:
        result = _observe(file, seconds, domain, directory, ros_args,
                          lambda: print(file=output, flush=True))
        json.dump(result[1:], output)


def _observe(file: str, seconds: float, domain: int, directory: str, ros_args: Sequence[str],
             on_poll: Callable[[], object]) -> Grade:
    """Run a program and judge its arm."""
    try:
        with ExitStack() as stack:
            arguments = _arguments(Path(file))
            observer = Observer(stack.enter_context(_node_in(domain, ros_args)), on_poll)
            check_signals()
            program = Program(Path(file), arguments, domain, directory)
            stack.callback(program.end)
            wait_until(_START, lambda: observer.poll() or program.fault())
            if observer.has_started:
                wait_until(seconds, lambda: observer.poll() and program.fault())
            if fault := program.fault() or observer.wrong_type_hint():
                return _grade(file, check(observer.messages), fault)
            if not observer.has_started:
                static = 'on /tf' if observer.messages else 'on /tf and /tf_static'
                return _grade(file, check(observer.messages),
                              f'It publishes nothing {static} within {_START:.0f} s: is the timer '
                              'created, and does rclpy.spin run?')
            report = observer.report()
            if fault := program.fault():
                return _grade(file, report, fault)
            line = report.first_failure
            return Grade(file, report, _reason(report), line.verdict if line else OK)
    except ProgramError as error:
        return _grade(file, None, str(error))
    except (CommandError, UsageError) as error:
        return Grade(file, None, str(error), NOT_JUDGED)


def _reason(report: Report) -> str:
    """Return the first failure of a report, and the number of the others; '' if it passed."""
    line = report.first_failure
    if line is None:
        return ''
    others = sum(other.verdict == NOT_OK for other in report.lines) - (line.verdict == NOT_OK)
    more = f' ({others} more)' if others else ''
    measured = f' ({line.measured})' if line.measured else ''
    return f'{line.requirement}{measured}. {line.text}{more}'


@contextmanager
def _node_in(domain: int, ros_args: Sequence[str]) -> Iterator['Node']:
    """
    Create a node in a domain, and destroy it at the end of the `with` block.

    :raises CommandError: if rcl fails.
    :raises UsageError: if the node rejects a parameter.
    """
    from rclpy.context import Context
    from rclpy.logging import get_logging_severity_from_string, set_logger_level
    from rclpy.node import Node

    from dummy_arm.cli.fast_dds import destroy
    from dummy_arm.cli.node import clear_shared_memory, create
    clear_shared_memory(ros_args)
    context = Context()

    def make_node() -> 'Node':
        context.init(args=[*ros_args], domain_id=domain)
        return Node('check_arm', context=context, enable_rosout=False,
                    start_parameter_services=False)

    # The lines of all programs would be mixed, and the report has what matters.
    set_logger_level('tf2_buffer', get_logging_severity_from_string('FATAL'))
    try:
        node = create(make_node)
        try:
            yield node
        finally:
            destroy(node)
    finally:
        context.try_shutdown()


@contextmanager
def _free_domain() -> Iterator[int]:
    """
    Reserve a ROS domain that no other program on this machine uses.

    The reservation is a socket, which other processes that run this function respect. A domain is
    free if no UDP port of it is in use. If none is free, wait.

    :raises CommandError: if no domain becomes free in time.
    """
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline:
        for domain in random.sample(_DOMAINS, len(_DOMAINS)):
            first = _FIRST_PORT + _PORTS * domain
            with socket.socket(socket.AF_UNIX) as reservation:
                try:
                    reservation.bind(f'\0dummy_arm.check_arm.{domain}')
                except OSError:
                    continue
                if not any(first <= port < first + _PORTS for port in _used_ports()):
                    yield domain
                    return
        sleep(1.0)
    raise CommandError(f'the ROS domains {_DOMAINS[0]} to {_DOMAINS[-1]} are all in use')


def _used_ports() -> Iterator[int]:
    """Yield the UDP ports that are in use on this machine."""
    for path in '/proc/net/udp', '/proc/net/udp6':
        with suppress(OSError):
            for line in Path(path).read_text().splitlines()[1:]:
                yield int(line.split()[1].rpartition(':')[2], 16)


def _grade_all(files: Sequence[str], seconds: float, jobs: int, table: Optional[str],
               ros_args: Sequence[str]) -> int:
    """
    Grade programs, several at the same time; print a line for each, in the order of `files`.

    :param table: the path of the CSV file; None: write none.
    :returns: the exit code.
    :raises CommandError: if the table cannot be written, or if Ctrl-C or SIGTERM was received.
    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.pop('ROS_STATIC_PEERS', None)
    with ExitStack() as stack:
        add_row = _csv_file(table) if table else None
        pool = ThreadPoolExecutor(jobs)
        stack.callback(pool.shutdown, cancel_futures=True)
        futures = deque(pool.submit(grade, file, seconds, ros_args) for file in files)
        is_passed = True

        def report() -> None:
            """Report the next grade."""
            nonlocal is_passed
            result = futures[0].result()
            print(result.line)
            if add_row:
                add_row(result)
            is_passed &= not result.reason
            futures.popleft()

        try:
            while futures:
                wait_until(inf, futures[0].done)
                report()
        except KeyboardInterrupt:
            begin_cleanup()
            while futures:
                if futures[0].done() and not futures[0].exception():
                    report()
                else:
                    futures.popleft()
            raise CommandError('interrupted: the files without a line were not judged') from None
        finally:
            begin_cleanup()
    return 0 if is_passed else 1


def _csv_file(path: str) -> Callable[[Grade], None]:
    """
    Write a table in CSV, with a column for each requirement and each good practice.

    For each new row, the whole file is written again, so that it never has a part of a row.

    :param path: path of the file.
    :returns: a function that adds the row of a grade. It raises a CommandError, too.
    :raises CommandError: if the file cannot be written.
    """
    nothing = check([])
    rows = [['file', 'verdict', 'reason', *(
        line.requirement for line in (*nothing.lines, *nothing.advice))]]

    def write() -> None:
        """Write the file."""
        with whole_file(Path(path)) as part, part.open('w', newline='', encoding='utf-8') as file:
            csv.writer(file).writerows(rows)

    def add_row(grade: Grade) -> None:
        """
        Add the row of a grade.

        :param grade: the grade.
        """
        rows.append([grade.file, grade.verdict, grade.reason, *(
            (line.verdict for line in (*grade.report.lines, *grade.report.advice))
            if grade.report else ())])
        write()

    write()
    return add_row


# The arm that is running, and a bag


def _check_running(seconds: float, namespace: str, ros_args: Sequence[str]) -> Report:
    """
    Observe the arm that is running.

    :raises CommandError: if nothing is received, or if Ctrl-C or SIGTERM was received.
    """
    from dummy_arm.cli.node import spinning_node
    with spinning_node('check_arm', ros_args, namespace) as node:
        observer = Observer(node)
        try:
            if wait(_START, 'waiting for an arm', observer.poll):
                wait(seconds, 'observing the arm', lambda: observer.poll() and False)
            elif not observer.messages:
                raise CommandError(f'no transform was received within {_START:g} s. '
                                   f'{observer.why_no_frames()}')
            if hint := observer.wrong_type_hint():
                print(f'check_arm: warning: {visible(hint)}', file=sys.stderr)
            return observer.report()
        except KeyboardInterrupt:
            raise CommandError('interrupted: nothing was judged') from None


def _check_bag(bag: str, namespace: str, partial: bool) -> Report:
    """
    Judge the arm in a bag.

    :raises UsageError: if the path is empty.
    :raises CommandError: if the bag cannot be read, or if Ctrl-C or SIGTERM was received.
    """
    found: list[Message] = []
    count = 0
    try:
        with bag_progress(bag) as on_progress:
            for message in messages(bag, namespace=namespace, partial=partial,
                                    on_progress=on_progress):
                with suppress(ValueError):
                    rows = message.rows()
                    found.append(Message(message.time, message.is_static, message.publisher, rows))
                    count += len(rows)
                if count > _MOST:
                    raise CommandError(f'{bag} has more than {_MOST} transforms: record an arm '
                                       'for a minute only')
    except KeyboardInterrupt:
        raise CommandError('interrupted: nothing was judged') from None
    # The file of a ROS 1 bag may be in another order.
    return check(sorted(found, key=lambda message: message.time))


def format_report(report: Report) -> list[str]:
    """
    Return the table of a report.

    :param report: the report.
    :returns: the lines, with the verdict first.
    """
    rows = [*report.lines, *report.advice]
    widths = [max(len(row[i]) for row in rows) for i in (2, 0)]
    lines: list[str] = []
    for i, row in enumerate(rows):
        if i == len(report.lines):
            lines += ['', 'good practice (it does not change the result):']
        is_judged = row.verdict != NOT_JUDGED
        lines.append(f'{padded(row.verdict, widths[0])}  {padded(row.requirement, widths[1])}  '
                     f'{row.measured if is_judged else row.text}'.rstrip())
        if row.text and is_judged:
            lines += wrapped(row.text, '    ')
    counts = {verdict: sum(row.verdict == verdict for row in report.lines)
              for verdict in (OK, NOT_OK, NOT_JUDGED)}
    counted = ', '.join(f'{count} {verdict}' for verdict, count in counts.items() if count)
    return [*lines, '', f'{"passed" if report.passed else "not passed"}: {counted}']


# frames.pdf


def fault_of_drawing(path: Path) -> str:
    """
    Compare a drawing of view_frames with the tree of the arm.

    :param path: the path of a `.pdf` or `.gv` file.
    :returns: what is wrong; '' if the drawing shows the tree of the arm.
    :raises CommandError: if the library pypdf is missing.
    """
    if path.exists() and not path.is_file():  # reading a pipe might never end
        return _NO_FILE
    try:
        if path.suffix.lower() == '.pdf':
            return _fault_of_names(_names_in_pdf(path))
        return _fault_of_edges(_edges_in_dot(path))
    except OSError as error:
        return f'It cannot be read: {error.strerror}.'


def _names_in_pdf(path: Path) -> dict[str, float]:
    """
    Return the texts of a drawing that are names of frames, from top to bottom.

    :returns: a dict from each text to its distance from the top of the first page (points).
    :raises OSError: if the file cannot be read.
    :raises CommandError: if the library pypdf is missing.
    """
    try:
        from pypdf import PdfReader
    except ImportError:
        raise CommandError('pypdf is needed to read a PDF: apt install python3-pypdf, or pip '
                           'install pypdf; or check the .gv file') from None
    top = 0.0
    #: By the place on the paper. A text is in several parts if it has a ligature, such as "ff".
    texts: defaultdict[tuple[float, float], str] = defaultdict(str)

    def add(text: str, outer: list[float], inner: list[float], *_: object) -> None:
        """
        Append a part of a text.

        :param text: the part.
        :param outer: the matrix a, b, c, d, e, f, which maps (x, y) to (a x + c y + e,
            b x + d y + f).
        :param inner: the matrix that is applied before `outer`.
        """
        a, b, c, d, e, f = outer
        x, y = inner[4:]
        texts[top - (b * x + d * y + f), a * x + c * y + e] += normalize('NFKC', text)

    logging.getLogger('pypdf').setLevel(logging.CRITICAL)  # its warnings about damaged files
    try:
        for page in PdfReader(path).pages:
            top += float(page.mediabox.top)
            page.extract_text(visitor_text=add)
    except OSError:
        raise
    except Exception:  # a damaged file causes errors of many types
        return {}
    return {text.strip(): depth for (depth, _), text in sorted(texts.items())
            if text.strip() and not _LABEL.match(text.strip())}


def _fault_of_names(names: dict[str, float]) -> str:
    if not names:
        return 'It is not a PDF with text that can be read.'
    missing = [name for name in FRAMES if name not in names]
    others = [name for name in names if name not in FRAMES]
    if missing or others:
        return _differences(missing, 'frames', others, quoted)
    for upper, lower in pairwise(FRAMES):
        if names[lower] < names[upper] + 1.0:
            return f'{lower} is not below {upper}: the tree is not a chain in the right order.'
    return ''


def _edges_in_dot(path: Path) -> set[tuple[str, str]]:
    """
    Return the edges of a graph that view_frames has written, as parent and child.

    :raises OSError: if the file cannot be read.
    """
    with path.open(encoding='utf-8', errors='replace') as file:
        tokens = [token for token in _TOKEN.findall(file.read(_LONGEST_GRAPH))
                  if not token.startswith(('//', '/*', '#'))]
    return {(_frame(parent), _frame(child))
            for parent, arrow, child in zip(tokens, tokens[1:], tokens[2:])
            if arrow == '->' and _frame(parent) and _frame(child)}


def _frame(token: str) -> str:
    """Return the name that a token stands for; '' if it is not a name."""
    name = token[1:-1].replace(r'\"', '"') if token[0] == '"' else token
    return name.removeprefix('/') if token[0] == '"' or name[0].isalnum() or name[0] == '_' else ''


def _fault_of_edges(edges: set[tuple[str, str]]) -> str:
    if not edges:
        return 'It has no edges of a tree.'
    expected = {*pairwise(FRAMES)}
    missing, others = (sorted(f'{parent} -> {child}' for parent, child in found)
                       for found in (expected - edges, edges - expected))
    return _differences(missing, 'edges', others, shortened)


def _differences(missing: Sequence[str], what: str, others: Sequence[str],
                 write: Callable[[str], str]) -> str:
    return ' '.join(f'{label}: {comma_list(found, _SHOWN, write)}.' for label, found in (
        ('Missing', missing), (f'Other {what}', others)) if found)


def command(files: Sequence[str] = (), seconds: Optional[float] = None, bag: Optional[str] = None,
            namespace: str = '', partial: bool = False, frames: Sequence[str] = (),
            table: Optional[str] = None, jobs: Optional[int] = None, *,
            ros_args: Sequence[str] = ()) -> int:
    """
    Judge the arm that is running, an arm in a bag, programs, or a drawing.

    :param files: programs to run and to judge; none: see the other arguments.
    :param seconds: how long to observe each arm (s); None: 25 s.
    :param bag: path of a bag; None: no bag.
    :param namespace: namespace of the topics `tf` and `tf_static`; '': none.
    :param partial: with a bag: read as much as possible of a damaged bag.
    :param frames: paths of drawings (.pdf) or graphs (.gv) of view_frames.
    :param table: path of a table in CSV with a row for each program; None: no table.
    :param jobs: the number of programs that run at the same time; None: the number of cores.
    :param ros_args: the command line, with the name of the command; ROS reads what follows
        `--ros-args`.
    :returns: the exit code: 0 if everything is as required, otherwise 1.
    :raises UsageError: if an argument is out of range, or arguments do not go together.
    :raises CommandError: if nothing can be judged, if a file cannot be read or written, or if
        Ctrl-C or SIGTERM was received.
    """
    if sum((bool(files), bag is not None, bool(frames))) > 1:
        raise UsageError('give files of programs, or --bag, or --frames, or none of them to check '
                         'the arm that is running')
    if seconds is not None and (bag is not None or frames):
        raise UsageError('--time is for an arm that is running: leave it out with --bag and '
                         '--frames')
    if namespace and (files or frames):
        raise UsageError('--namespace is for --bag and for the arm that is running')
    check_partial(bag, partial)
    if (table is not None or jobs is not None) and not files:
        raise UsageError('--csv and --jobs need the files of programs')
    if jobs is not None and not 1 <= jobs <= len(_DOMAINS):
        raise UsageError(f'--jobs must be at least 1, and at most {len(_DOMAINS)}, got {jobs}')
    seconds = DEFAULT_TIME if seconds is None else seconds
    if not 1.0 <= seconds <= _LONGEST:
        raise UsageError(f'--time must be at least 1 s, and at most {_LONGEST:g} s, got '
                         f'{seconds:g}')
    if table is not None and (table in files or not table.endswith('.csv')):
        raise UsageError(f'--csv needs the name of a file that ends in .csv, got {table!r}')
    if frames:
        if others := [name for name in frames
                      if Path(name).suffix.lower() not in ('.pdf', '.gv')]:
            raise UsageError(f'{others[0]!r} must end in .pdf or .gv')
        grades = [_grade(name, None, fault_of_drawing(Path(name))) for name in frames]
        print('\n'.join(grade.line for grade in grades))
        return 1 if any(grade.reason for grade in grades) else 0
    if files:
        default = min(os.cpu_count() or 1, len(_DOMAINS))
        return _grade_all(files, seconds, jobs or default, table, ros_args)
    report = (_check_running(seconds, namespace, ros_args) if bag is None
              else _check_bag(bag, namespace, partial))
    print('\n'.join(format_report(report)))
    return 0 if report.passed else 1


def main(args: Optional[Sequence[str]] = None) -> int:
    """
    Run the command; see `--help`.

    :param args: the command line without the name of the command; None: `sys.argv[1:]`.
    :returns: the exit code.
    """
    parser = Parser(
        'check_arm', 'Check whether an arm meets the requirements of the final task of the lab. '
        'Without arguments, the arm that is running is observed. With files, each file is run as '
        'a program, with your own rights: run only programs that you trust, or use a container.',
        'exit code: 0: all requirements are met; 1: not all; 2: wrong arguments\n'
        'examples: check_arm\n          check_arm dummy_arm.py\n'
        '          check_arm --csv grades.csv handed_in/*/dummy_arm.py\n'
        '          check_arm --bag arm_bag\n          check_arm --frames frames.pdf')
    parser.add_argument('files', nargs='*', metavar='FILE', help='a program to run and to check')
    parser.add_argument('--time', type=number, dest='seconds', metavar='SECONDS',
                        help='how long to observe each arm (s; default: '
                             f'{DEFAULT_TIME:g}, more than a period of the slowest joint)')
    parser.add_argument('--frames', nargs='+', default=(), metavar='FILE',
                        help='check drawings of view_frames, .pdf or .gv')
    parser.add_argument('--csv', dest='table', metavar='OUT',
                        help='write a table with a row for each program')
    parser.add_argument('--jobs', type=int, metavar='N',
                        help='how many programs run at the same time (default: the number of '
                             'cores)')
    add_bag_options(parser)
    return run(parser, command, args, interrupted=1)
