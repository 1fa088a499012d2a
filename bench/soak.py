"""
Run everything at once for hours, and report failed lookups, CPU time and the growth of memory.

    soak.py HOURS        run the processes, then print the report
    soak.py listen T0    one of these processes: look up transforms 200 times a second

The processes are the arm, a publisher of 500 frames at 100 Hz, a listener with 200 lookups a
second, tf2_monitor, and web_view with a browser. The exit code is 1 if a process ended, if a
lookup failed or was wrong, or if the memory of the arm, the listener or tf2_monitor grew by 4 MiB
an hour or more over the second half; growth is judged only if this half lasts for 10 minutes or
more. Ctrl-C ends the soak early, with its report.
"""

from contextlib import ExitStack, suppress
import json
import math
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any, NoReturn

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '97')

from measure import cpu_seconds, resident
import numpy as np

S = 10**9
#: Lookups per second.
LOOKUPS = 200
FRAMES, RATE = 500, 100
#: Interval of the samples of memory, and of the listener's lines (s).
INTERVAL = 10.0
#: The largest growth of memory (MiB per hour), of what, and the time over which it is judged (s).
GROWTH, JUDGED, JUDGED_FROM = 4.0, ('arm', 'listener', 'tf2_monitor'), 600.0
#: The bounds of the durations that the listener counts (s).
SLOW = 0.001, 0.01, 0.1, 0.5


def hand(t: float) -> tuple[float, float, float]:
    """
    Compute the position of the hand in map: three revolute joints in a plane.

    :param t: time since the arm's first message (s).
    :returns: x, y, z (m).
    """
    angle, x, y = 0.0, 0.0, 0.0
    for limit, speed, length in ((45, 0.3, 0.4), (30, 0.5, 0.3), (60, 0.7, 0.2)):
        angle += math.radians(limit) * math.sin(speed * t)
        x += length * math.cos(angle)
        y += length * math.sin(angle)
    return x, y, 0.3


class Lookups:
    """The lookups of the listener, and what they found."""

    def __init__(self, begin: int) -> None:
        """
        Start the listener.

        :param begin: the time of the arm's first message (ns).
        """
        import rclpy

        from puretf import Buffer, TransformListener

        rclpy.init()
        node = rclpy.create_node('soak')
        self._begin = begin
        self._buffer = Buffer(node=node)
        self._listener = TransformListener(self._buffer, node)
        self._slow = [0] * len(SLOW)
        self._faults: list[str] = []
        self._number = self._fault_number = 0
        self._slowest = 0.0

    def _position(self, stamp: int, source: str = 'end_effector', timeout: float = 0.0
                  ) -> tuple[int, tuple[float, float, float]]:
        from rclpy.duration import Duration
        from rclpy.time import Time
        target = 'map' if source == 'end_effector' else 'frame_0'
        found = self._buffer.lookup_transform(
            target, source, Time(nanoseconds=stamp), Duration(seconds=timeout))
        place, when = found.transform.translation, found.header.stamp
        return when.sec * S + when.nanosec, (place.x, place.y, place.z)

    def _look(self, now: int) -> str:
        """Do one lookup at a time (ns); return what is wrong with it, or ''."""
        from puretf import LookupException, TransformException
        kind = self._number % 20
        try:
            if kind == 0:  # not there yet: wait for it
                stamp, place = self._position(now, timeout=5.0)
            elif kind == 1:  # a chain of 500 edges
                self._position(0, f'frame_{FRAMES}')
                return ''
            elif kind == 2:
                with suppress(LookupException):
                    self._position(0, 'nowhere')
                    return 'an unknown frame was found'
                return ''
            else:  # the newest, or between two messages
                stamp, place = self._position(0 if kind < 12 else now - 3 * S)
        except TransformException as error:
            return str(error)
        wanted = hand((stamp - self._begin) / S)
        off = math.dist(place, wanted)
        # Between two messages, h apart, linear interpolation is off by up to h² / 8 times the
        # acceleration, which is below 0.7 m/s².
        stamps = self._buffer.path_stamps('map', 'end_effector')
        after = int(stamps.searchsorted(stamp))
        h = float(stamps[after] - stamps[after - 1]) / S if stamp != stamps[after] else 0.0
        return '' if off < 1e-6 + 0.7 / 8 * h**2 else f'the hand is {off} m off, at {stamp} ns'

    def run(self) -> NoReturn:
        """Look up transforms until SIGTERM, and print what was found every ten seconds."""
        self._position(0, timeout=30.0)
        self._position(0, f'frame_{FRAMES}', 30.0)
        time.sleep(5.0)  # so that there is a past
        report = due = time.monotonic()
        while True:
            begin = time.perf_counter()
            fault = self._look(time.time_ns())
            taken = time.perf_counter() - begin
            if self._number % 20:
                self._slowest = max(self._slowest, taken)
                self._slow = [n + (taken > bound) for n, bound in zip(self._slow, SLOW)]
            self._number += 1
            if fault:
                self._fault_number += 1
                self._faults = [*self._faults, fault][:10]
            due += 1.0 / LOOKUPS
            now = time.monotonic()
            if now > report + INTERVAL:
                report = now
                print(json.dumps({
                    'number': self._number, 'faults': self._fault_number, 'texts': self._faults,
                    'slowest': self._slowest, 'slow': self._slow}), flush=True)
            due = max(due, now - 1.0)
            time.sleep(max(0.0, due - now))


def descendants(pid: int) -> list[int]:
    """Return the ids of the processes that a process has started, directly or not."""
    found = [pid]
    for parent in found:
        for path in Path(f'/proc/{parent}/task').glob('*/children'):
            with suppress(OSError):  # the thread has ended
                found += map(int, path.read_text().split())
    return found[1:]


class Soak:
    """The processes, their output in files, and the samples of their CPU time and memory."""

    def __init__(self, folder: Path) -> None:
        """
        Start nothing yet.

        :param folder: where to write the output of the processes.
        """
        self._folder = folder
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        #: By name: lists of times (s), CPU times (s) and memory (MiB).
        self.samples: dict[str, list[tuple[float, float, float]]] = {}

    def start(self, name: str, *arguments: str) -> None:
        """Start a process."""
        with open(self._folder / name, 'wb') as output:
            self._processes[name] = subprocess.Popen(
                arguments, stdout=output, stderr=subprocess.STDOUT)

    def command(self, name: str, command: str) -> None:
        """Start a command of the package."""
        package = 'dummy_arm' if command == 'dummy_arm' else 'puretf_tools'
        self.start(name, sys.executable, '-u', '-c',
                   f'import sys, {package}.entry_points as e; sys.exit(e.{command}())')

    def output(self, name: str) -> str:
        """Return what a process has printed."""
        return (self._folder / name).read_text(errors='replace')

    def word_after(self, name: str, text: str) -> str:
        """Wait until a process prints a text, and return the word that follows it."""
        deadline = time.monotonic() + 60.0
        while text not in (output := self.output(name)) or not output.endswith('\n'):
            if time.monotonic() > deadline or self._processes[name].poll() is not None:
                sys.exit(f'{name} did not start:\n{output}')
            time.sleep(0.1)
        return output.partition(text)[2].split()[0]

    def sample(self) -> None:
        """Note the CPU time and the memory of each process and of those that it has started."""
        now = time.monotonic()
        for name, process in self._processes.items():
            cpu = size = 0.0
            for pid in (process.pid, *descendants(process.pid)):
                with suppress(OSError, IndexError):  # it has ended
                    cpu, size = cpu + cpu_seconds(pid), size + resident(pid)
            self.samples.setdefault(name, []).append((now, cpu, size))

    def ended(self) -> list[str]:
        """Return the names of the processes that have ended."""
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def end(self) -> None:
        """End all processes."""
        for process in self._processes.values():
            process.terminate()
        for process in self._processes.values():
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def report(soak: Soak) -> bool:
    """Print the tables of a soak; return whether all went well."""
    names = [name for name, samples in soak.samples.items() if len(samples) > 3]
    if not names:
        print('there are too few samples for a report')
        return False
    problems = [f'{name} ended:\n{soak.output(name)[-2000:]}' for name in soak.ended()]
    table = np.array([soak.samples[name] for name in names])  # (processes, samples, 3)
    times = table[0, :, 0] - table[0, 0, 0]
    half = times > times[-1] / 2
    print(f'\nAfter {times[-1] / 60:.0f} minutes:\n\n| process | CPU (% of a core) | memory (MiB) '
          '| growth in the second half (MiB/h) |\n|---|---|---|---|')
    for name, (_, cpu, sizes) in zip(names, table.transpose(0, 2, 1)):
        growth = np.polyfit(times[half] / 3600.0, sizes[half], 1)[0]
        print(f'| {name} | {100 * (cpu[-1] - cpu[0]) / times[-1]:.1f} | {sizes[-1]:.0f} '
              f'| {growth:+.2f} |')
        if name in JUDGED and times[-1] / 2 >= JUDGED_FROM and growth >= GROWTH:
            problems.append(f'the memory of {name} grows by {growth:.1f} MiB/h; {GROWTH:g} is the '
                            'limit')
    lines = [line for line in soak.output('listener').splitlines() if line.startswith('{')]
    found: dict[str, Any] = json.loads(lines[-1]) if lines else {}
    if not found:
        problems.append(f'the listener has not looked up anything:\n{soak.output("listener")}')
    else:
        slow = ', '.join(f'{number} above {bound * 1e3:g} ms'
                         for number, bound in zip(found['slow'], SLOW))
        print(f'\n{found["number"]} lookups, {found["faults"]} of them failed or wrong; apart '
              'from those that waited for their transform, the slowest took '
              f'{found["slowest"] * 1e3:.1f} ms ({slow}).')
        problems += found['texts']
    print('\n'.join(['', *problems]) if problems else '\nNo problem was found.')
    return not problems


def main(hours: float) -> int:
    """
    Run the soak.

    :param hours: how long.
    :returns: the exit code.
    """
    def end(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    chromium = shutil.which('chromium')
    if chromium is None:
        sys.exit('there is no chromium: apt install chromium')
    signal.signal(signal.SIGTERM, end)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        soak = Soak(folder)
        stack.callback(soak.end)
        try:
            soak.command('arm', 'dummy_arm')
            begin = soak.word_after('arm', 't = 0 at ')
            soak.start('listener', sys.executable, '-u', __file__, 'listen', begin)
            soak.start('publisher', sys.executable, str(Path(__file__).with_name('roles.py')),
                       'send', 'tf', str(RATE), str(FRAMES), str(hours * 3600.0 + 600.0))
            soak.command('tf2_monitor', 'tf2_monitor')
            soak.command('web_view', 'web_view')
            # Without a GPU, the browser would take all of the CPU time that is left. Playwright
            # keeps what the page receives, so it is connected only for a moment.
            soak.start(
                'browser', 'nice', '-n', '19', chromium, '--headless', '--no-sandbox',
                '--disable-background-networking', '--disable-component-update', '--disable-sync',
                '--no-first-run', '--use-gl=angle', '--use-angle=swiftshader',
                '--enable-unsafe-swiftshader', '--window-size=640,480',
                '--remote-debugging-port=0', f'--user-data-dir={folder / "profile"}',
                soak.word_after('web_view', ' at '))
            address = soak.word_after('browser', 'listening on ')
            shown(address)
            last = time.monotonic() + hours * 3600.0
            while time.monotonic() < last and not soak.ended():
                soak.sample()
                time.sleep(INTERVAL)
            print(f'The page shows: {shown(address)}')
        except KeyboardInterrupt:
            print('ended early')
        return not report(soak)


def shown(address: str) -> str:
    """
    Wait until the page shows the rate of a frame, and return the overview of all frames.

    :param address: where the browser is controlled.
    :raises playwright.sync_api.Error: if the page shows none within a minute.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        (page,) = playwright.chromium.connect_over_cdp(address).contexts[0].pages
        page.wait_for_selector('[data-value=rate]:not(:empty)', timeout=60e3)
        text: str = page.inner_text('[data-text=overview]')
        return ' '.join(text.split())


if __name__ == '__main__':
    if sys.argv[1] == 'listen':
        signal.signal(signal.SIGTERM, lambda *_: sys.exit())
        Lookups(int(sys.argv[2])).run()
    sys.exit(main(float(sys.argv[1])))
