"""
Fuzz the package by atheris: `fuzz.py SECONDS [TARGET...]`.

Each target runs for SECONDS in a process of its own, two of them at a time. It starts from its
seeds, and from the inputs in data/fuzz/TARGET. Each target gets a line with the number of its
inputs and the result. An input that finds a fault is minimised and written to data/fuzz/TARGET,
where test_fuzz.py uses it. `fuzz.py TARGET FILE` repeats what an input does.

The exit code is 0 if no target found a fault, 1 if one did, and 2 if nothing can be run.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
import ctypes
import hashlib
from importlib import import_module
import os
from pathlib import Path
import re
import shlex
import shutil
import signal
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
import traceback
from types import FrameType
from typing import NamedTuple, Optional

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')  # before rclpy starts

DATA = Path(__file__).parent.parent / 'data' / 'fuzz'
#: The module of each target.
MODULES = {
    'cdr': 'fuzz_messages', 'streams': 'fuzz_messages', 'ros1': 'fuzz_messages',
    'type': 'fuzz_messages', 'bags': 'fuzz_messages', 'db3': 'fuzz_messages',
    'description': 'fuzz_messages',
    'names': 'fuzz_surfaces', 'websocket': 'fuzz_surfaces', 'views': 'fuzz_surfaces',
    'commands': 'fuzz_surfaces', 'meshes': 'fuzz_shapes', 'clouds': 'fuzz_shapes'}
_AT_A_TIME = 2
#: One input may take this long (s), and the process may use this much memory (MB).
_LONGEST, _MOST_MEMORY = 20, 2048
_LONGEST_OF = {'db3': 5, 'views': 5, 'meshes': 5, 'clouds': 5}
#: An input that finds a fault is minimised for at most this long (s).
_MINIMISING = 30
_LONGEST_INPUT = 4096  # bytes
_STATISTICS = ('number_of_executed_units', 'average_exec_per_sec', 'new_units_added')
#: The signals that end the runner.
_received: list[int] = []


class Target(NamedTuple):
    """What is fuzzed."""

    check: Callable[[bytes], None]  #: raises an exception if it finds a fault
    seeds: Callable[[], Iterator[bytes]]


def target(name: str) -> Target:
    """Import a target."""
    module = import_module(MODULES[name])
    return Target(getattr(module, f'check_{name}'), getattr(module, f'seeds_of_{name}'))


def reproducers(name: str) -> list[Path]:
    """Return the files of the inputs that have found a fault of a target before."""
    return sorted((DATA / name).glob('*'))


# The process of a target


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def _fuzz(name: str, arguments: list[str]) -> None:
    """Run a target by libFuzzer; in a process of its own, which this function ends."""
    atheris = import_module('atheris')
    _end_with_parent()
    with atheris.instrument_imports(include=['puretf', 'puretf_tools', 'dummy_arm',
                                             'fuzz_messages', 'fuzz_surfaces', 'fuzz_shapes']):
        check, seeds = target(name)
        for folder in arguments:
            if not folder.startswith('-') and Path(folder).is_dir():
                for number, data in enumerate(seeds()):
                    Path(folder, f'seed_{number}').write_bytes(data)
        check(b'')  # finish the late imports, which are instrumented, too
        atheris.Setup([name, *arguments], check)
        atheris.Fuzz()


def minimise(check: Callable[[bytes], None], path: Path) -> None:
    """
    Shorten an input as long as it finds the same fault, then set bytes to zero.

    libFuzzer can do this, too, but starts a process for each step, which takes minutes.
    """
    data, end = path.read_bytes(), time.monotonic() + _MINIMISING
    fault = _fault(check, data)
    size = len(data)
    while fault and size:
        size //= 2
        at = 0
        while at < len(data) and time.monotonic() < end:
            other = data[:at] + (data[at + size:] if size else b'\0' + data[at + 1:])
            if other != data and _fault(check, other) == fault:
                data = other
                path.write_bytes(data)
                at += not size
            else:
                at += size or 1


def _fault(check: Callable[[bytes], None], data: bytes) -> Optional[tuple[object, ...]]:
    """Return the kind and the place of the fault that an input finds; None if there is none."""
    try:
        check(data)
    except BaseException as error:
        *_, place = traceback.extract_tb(error.__traceback__)
        return type(error), place.filename, place.lineno
    return None


# The runner


class _Run:
    """A target that is being fuzzed."""

    def __init__(self, name: str, seconds: float, folder: Path) -> None:
        """Start the process."""
        self.name, self.folder = name, folder
        self._begin = time.monotonic()
        self._log = folder / 'log'
        corpus = folder / 'corpus'
        corpus.mkdir(parents=True)
        for path in reproducers(name):
            shutil.copy(path, corpus)
        self.process = self._start(
            '--fuzz', f'-max_total_time={seconds:g}', f'-artifact_prefix={folder}/', str(corpus),
            f'-timeout={_LONGEST_OF.get(name, _LONGEST)}', f'-rss_limit_mb={_MOST_MEMORY}',
            f'-max_len={_LONGEST_INPUT}', '-print_final_stats=1')
        # libFuzzer ends after its time; a target that hangs outside of Python, never.
        self._deadline = self._begin + seconds + 2 * _LONGEST + 10

    def _start(self, what: str, *arguments: str) -> 'subprocess.Popen[bytes]':
        with self._log.open('ab') as log:
            return subprocess.Popen(
                [sys.executable, __file__, what, self.name, *arguments], stdout=log,
                stderr=log, start_new_session=True, env={**os.environ, 'TMPDIR': str(self.folder)})

    def has_ended(self) -> bool:
        """Return whether the process has ended; kill it if it is much too late."""
        if self.process.poll() is None and time.monotonic() > self._deadline:
            self.kill()
        return self.process.poll() is not None

    def kill(self) -> None:
        """Kill the process and all that it has started."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def report(self) -> bool:
        """Print the result; return whether a fault was found."""
        self.kill()  # what it has left behind
        log = self._log.read_text(errors='replace')
        found = [int(values[-1]) if (values := re.findall(rf'stat::{name}:\s+(\d+)', log)) else 0
                 for name in _STATISTICS]
        coverage = re.findall(r' cov: (\d+)', log)
        artifacts = [path for kind in ('crash', 'timeout', 'oom', 'slow-unit', 'leak')
                     for path in self.folder.glob(f'{kind}-*') if kind != 'slow-unit']
        code = self.process.returncode
        result = 'FAULT' if artifacts else 'passed' if code == 0 else f'FAILED, exit code {code}'
        print(f'{self.name:10}{found[0]:>10} runs {found[1]:>7}/s  coverage '
              f'{coverage[-1] if coverage else "?":>6}  {found[2]:>6} new inputs  {result}, in '
              f'{time.monotonic() - self._begin:.0f} s', flush=True)
        if artifacts:
            self._keep(artifacts[0], log)
        elif code:
            print(log[-5000:])
        return bool(artifacts or code)

    def _keep(self, artifact: Path, log: str) -> None:
        """Minimise an input that finds a fault, write it to the data, and print the fault."""
        smallest = self.folder / 'smallest'
        shutil.copy(artifact, smallest)
        if artifact.name.startswith('crash'):
            self.process = self._start('--minimise', str(smallest))
            self._deadline = time.monotonic() + 2 * _MINIMISING
            while not self.has_ended() and not _received:
                time.sleep(0.1)
            self.kill()
        data = smallest.read_bytes()
        path = DATA / self.name / hashlib.sha1(data).hexdigest()[:12]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        where = re.search('=== (Uncaught|Timeout)', log)
        print(log[where.start() if where else -3000:].partition('\n==')[0][:6000])
        print(f'{artifact.name.partition("-")[0]} of {self.name} by {len(data)} bytes, at first '
              f'{artifact.stat().st_size}; to repeat it:\n'
              f'{shlex.join([sys.executable, os.path.relpath(__file__), self.name])} '
              f'{os.path.relpath(path)}', flush=True)


def run(seconds: float, names: list[str]) -> int:
    """Fuzz targets; return the exit code."""
    waiting, running, has_fault = deque(names), list[_Run](), False
    memory = Path('/dev/shm')
    with TemporaryDirectory(
            prefix='fuzz', dir=memory if os.access(memory, os.W_OK) else None) as folder:
        try:
            while (waiting or running) and not _received:
                while waiting and len(running) < _AT_A_TIME:
                    name = waiting.popleft()
                    running.append(_Run(name, seconds, Path(folder, name)))
                for each in [each for each in running if each.has_ended()]:
                    has_fault |= each.report()
                    running.remove(each)
                time.sleep(0.1)
        finally:
            for each in running:
                each.kill()
    return 128 + _received[0] if _received else int(has_fault)


def repeat(name: str, path: str) -> int:
    """Pass an input to a target; return the exit code."""
    target(name).check(Path(path).read_bytes())
    print(f'{name}: {path} finds no fault')
    return 0


def _record(number: int, _: Optional[FrameType]) -> None:
    _received.append(number)


def main(arguments: list[str]) -> int:
    """Run what the command line says; return the exit code."""
    if arguments[:1] == ['--fuzz']:
        _fuzz(arguments[1], arguments[2:])
        return 0
    if arguments[:1] == ['--minimise']:
        _end_with_parent()
        minimise(target(arguments[1]).check, Path(arguments[2]))
        return 0
    if len(arguments) == 2 and arguments[0] in MODULES:
        return repeat(*arguments)
    try:
        seconds, names = float(arguments[0]), arguments[1:] or [*MODULES]
    except (IndexError, ValueError):
        seconds, names = 0.0, []
    if not seconds > 0.0 or not names or not {*names} <= MODULES.keys():
        print(f'fuzz.py: usage: fuzz.py SECONDS [TARGET...], or fuzz.py TARGET FILE; targets: '
              f'{", ".join(MODULES)}', file=sys.stderr)
        return 2
    try:
        import_module('atheris')
    except ImportError as error:
        print(f"fuzz.py: {error}: pip install 'atheris>=3,<4' (Linux x86-64, Python 3.11 to 3.13)",
              file=sys.stderr)
        return 2
    for number in signal.SIGINT, signal.SIGTERM:
        signal.signal(number, _record)
    return run(seconds, names)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
