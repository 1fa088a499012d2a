"""
Faults around the programs: killed and stopped processes, full disks, Ctrl-C at any time.

These tests take 1.5 min. Those of disks need root.
"""

from functools import partial
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from urllib.request import urlopen

from arms import Arm, hand
import bags
from endings import without_library_lines
from processes import ARM, TIMEOUT, tool
import pytest
from watching import begin_of, PROGRAM, Watch

S = 10**9
#: How long a process is stopped (s): Fast DDS gives up the lock of another process after 1 s.
STOP = 1.5


# Processes that are killed, stopped and continued


class Page:
    """The page, seen by a client that connects to it anew each time."""

    def __init__(self, start, begins):
        """Start it."""
        self.process, self._begins = start(*tool('web_view')), begins
        self._port = self.process.port()

    def fresh(self, after):
        """
        Wait until it shows the pose of the hand at a time that is newer than another time (ns).

        :returns: how long after that time it was there (s).
        """
        from viewer import Viewer
        with urlopen(f'http://127.0.0.1:{self._port}', timeout=TIMEOUT) as answer:
            assert b'<html' in answer.read()
        viewer = Viewer(self._port)
        viewer.until(lambda: self._time(viewer) > after)
        viewer.close()
        stamp = self._time(viewer)
        begin = max(begin for begin in self._begins if begin <= stamp)
        x, y, z, *_ = hand([stamp], begin)[0]
        shown = [*map(float, viewer.detail('fixed-translation').split())]
        assert shown == pytest.approx([x, y, z], abs=6e-4)
        return (time.time_ns() - after) / S

    @staticmethod
    def _time(viewer):
        seconds, _, rest = viewer.detail('fixed-time').removesuffix(' s').partition('.')
        return int(seconds or 0) * S + int(rest or 0)


def test_rounds_of_stops_and_kills(start, show):
    """
    After each fault of one process, the listener and the page show right and fresh poses.

    No other process ends, and none of them prints anything about it.
    """
    arm = start(*ARM)
    begins = [begin_of(arm)]
    processes = {'arm': arm}
    listener, page = Watch(start, begins), Page(start, begins)

    def check(fault):
        after = time.time_ns()
        times = listener.fresh(after), page.fresh(after)
        processes.update(arm=arm, listener=listener.process, page=page.process)
        assert not [name for name, process in processes.items() if process.has_ended()]
        show(f'{fault}: fresh poses after {times[0]:.2f} s, on the page after {times[1]:.2f} s')

    check('start')
    for name in 'arm', 'listener', 'page':
        processes[name].end(signal.SIGKILL)
        if name == 'arm':
            arm = start(*ARM)
            begins.append(begin_of(arm))
        elif name == 'listener':
            listener = Watch(start, begins)
        else:
            page = Page(start, begins)
        check(f'SIGKILL of the {name}')
    for names in ('arm',), ('listener',), ('page',), ('page', 'listener', 'arm'):
        for number in signal.SIGSTOP, signal.SIGCONT:
            for name in names:
                os.kill(processes[name].pid, number)
            if number == signal.SIGSTOP:
                time.sleep(STOP)
        check(f'SIGSTOP and SIGCONT of the {" and the ".join(names)}')
    for process in processes.values():
        process.end(signal.SIGINT)
        assert process.exit_code() == 0
    for process in arm, page.process:  # the listener's output was read line by line
        assert len(without_library_lines(process.output).splitlines()) == 1, process.output


# Disks


@pytest.fixture
def disk(tmp_path):
    """An empty file system of 64 KiB in memory, mounted on a directory."""
    directory = tmp_path / 'disk'
    directory.mkdir()
    done = subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=64k', 'tmpfs', str(directory)],
                          capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f'a small file system cannot be mounted here: {done.stderr.strip()}')
    try:
        yield directory
    finally:
        subprocess.run(['umount', '--lazy', str(directory)], check=True)


def fill(directory):
    """Write a file until there is no space left."""
    free = os.statvfs(directory)
    (directory / 'fill').write_bytes(bytes(free.f_bavail * free.f_bsize))
    with pytest.raises(OSError, match='No space left'):
        (directory / 'one more').write_bytes(b'.')
    (directory / 'one more').unlink()


def make_read_only(directory):
    """Forbid to write to a file system, also to root."""
    subprocess.run(['mount', '-o', 'remount,ro', str(directory)], check=True)


@pytest.fixture
def arm_bag(tmp_path):
    """A bag of the arm."""
    return str(bags.make(tmp_path, 'db3', Arm().messages(5.0)))


#: Starts a program with a /dev/shm without room, in place of that of the machine.
NO_SHARED_MEMORY = 'mount -t tmpfs -o size=16k tmpfs /dev/shm && exec "$@"'
#: The command that writes a file, its arguments before the name of the file, and the name.
WRITERS = {
    'frames.pdf': ('view_frames', '--bag', 'BAG', '-o'),
    **{f'arm.{ending}': ('tf_trajectory', 'map', 'end_effector', '--bag', 'BAG', '-o')
       for ending in ('csv', 'npz', 'png', 'pdf')},
    'grades.csv': ('check_arm', 'a.py', '--csv')}


@pytest.mark.parametrize(('name', 'why'), [
    *((name, 'No space left on device') for name in WRITERS),
    ('arm.csv', 'Read-only file system')])
def test_a_file_that_cannot_be_written(disk, arm_bag, domain_id, name, why):
    """One line names the file and the reason; an old file stays, and there is no partial one."""
    if name in ('arm.png', 'arm.pdf'):
        pytest.importorskip('matplotlib.font_manager')  # this builds its cache of fonts
    if name.startswith('frames'):
        pytest.importorskip('pygraphviz')
    command, *arguments = WRITERS[name]

    def write():
        return subprocess.run(
            [sys.executable, *tool(command, *(arm_bag if argument == 'BAG' else argument
                                              for argument in arguments), name)],
            cwd=disk, env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id)}, text=True,
            capture_output=True, check=False)

    if command == 'check_arm':  # it only replaces a table of its own
        write()
    else:
        (disk / name).write_text('old')
    old = (disk / name).read_bytes()
    if why.startswith('No'):
        fill(disk)
    else:
        make_read_only(disk)
    before = sorted(os.listdir(disk))
    done = write()
    assert done.returncode == 1
    assert re.fullmatch(f'{command}: cannot write {name}: ({why}|. is not a writable directory)\n',
                        done.stderr), done.stderr
    assert sorted(os.listdir(disk)) == before
    assert (disk / name).read_bytes() == old


def test_a_log_directory_that_cannot_be_written(disk, start):
    """The arm ends with one line that names the directory."""
    make_read_only(disk)
    process = start(*ARM, environment={'ROS_LOG_DIR': str(disk / 'log')})
    assert process.exit_code() == 1
    assert re.fullmatch(f"dummy_arm: .*log directory '{disk}/log'.*\n", process.output)


def test_a_log_directory_that_is_full(disk, start):
    """The arm publishes, and a listener whose directory is full, too, receives it."""
    fill(disk)
    arm = start(*ARM, environment={'ROS_LOG_DIR': str(disk)})
    begins = [begin_of(arm)]
    Watch(partial(start, environment={'ROS_LOG_DIR': str(disk)}), begins).fresh(begins[0])
    assert not arm.has_ended()


@pytest.mark.usefixtures('disk')  # which is skipped where nothing can be mounted
def test_shared_memory_that_is_full(start):
    """Where Fast DDS finds no room in /dev/shm, a listener receives the arm by UDP."""
    def start_without_room(*arguments):
        code = f"""if True:
            import os, sys
            os.execvp('unshare', ['unshare', '--mount', 'sh', '-c', {NO_SHARED_MEMORY!r}, 'sh',
                                  sys.executable, '-u', *sys.argv[1:]])
        """
        return start('-c', code, *arguments)

    begins = [begin_of(start_without_room(*ARM))]
    listener = Watch(start_without_room, begins)
    listener.fresh(time.time_ns())
    assert 'Unable to Register SHM Transport' in listener.process.output


# Many listeners, and Ctrl-C at any time


def test_500_listeners(start, show):
    """Created and destroyed while messages arrive, they leave no thread, descriptor or memory."""
    arm = start(*ARM)
    arm.line_with('publishing')
    process = start(PROGRAM, 'create')
    assert process.exit_code(600.0) == 0, process.output
    *figures, left = json.loads(without_library_lines(process.output))
    for name, each in zip(('100 listeners', '400 more', '50 with a node each'), figures):
        show(f'{name}: {each}')
    assert left == 0
    for name in 'threads', 'descriptors':
        assert len({each[name] for each in figures}) == 1
    assert figures[1]['MiB'] - figures[0]['MiB'] < 4.0
    # Each node of rclpy, even without a listener, leaves 0.1 MiB.
    assert figures[2]['MiB'] - figures[1]['MiB'] < 50 * 0.1 + 4.0


def test_ctrl_c_at_random_times(start, show):
    """
    After thousands of KeyboardInterrupts, the buffer answers right, and its listener goes on.

    They hit lookups, waits, insertions, blocks of `updated` and futures.
    """
    seed = random.randrange(10**6)
    show(f'seed {seed}')
    process = start(PROGRAM, 'interrupt', str(seed))
    assert process.exit_code(600.0) == 0, process.output
    before, after, hits = json.loads(without_library_lines(process.output))
    show(f'{sum(hits.values())} interrupts: {hits}')
    show(f'before: {before}')
    show(f'after: {after}')
    for name in 'threads', 'descriptors':
        assert after[name] == before[name]
