"""Forks: the child process looks up in the buffers that it has inherited."""

from contextlib import ExitStack
import os
import signal
import sys
from threading import Event, Thread
import time
import traceback

import pytest

from dummy_arm.tf import BufferCore, LookupException
from dummy_arm.tf._core import forking
from dummy_arm.tf._core.pose import Row, Rows

pytestmark = [
    pytest.mark.skipif(not hasattr(os, 'fork'), reason='there is no os.fork here'),
    pytest.mark.filterwarnings('ignore:.*multi-threaded:DeprecationWarning')]
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def in_child(work, meanwhile=lambda: None):
    """Call a function in a child process, which must end without an error, and one in this."""
    pid = os.fork()
    if not pid:
        signal.alarm(60)  # ends a child that hangs
        code = 1
        try:
            work()
            code = 0
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
        finally:
            os._exit(code)
    try:
        meanwhile()
    finally:
        _, status = os.waitpid(pid, 0)
        assert status == 0


def in_thread(work):
    """Call a function in a thread, which must end; return its result."""
    results = []
    thread = Thread(target=lambda: results.append(work()), daemon=True)
    thread.start()
    thread.join(50)
    (result,) = results
    return result


class Watched(BufferCore):
    """A buffer that tells when a fork has begun."""

    def __init__(self):
        """Create the buffer with one transform."""
        self.is_forking = Event()
        super().__init__()
        self.put(1)
        self.insert(0, 'map', 'fixed', STILL, is_static=True)

    def put(self, number):
        """Insert a transform with a stamp (ns), and an x (m)."""
        self.insert(number, 'map', 'tool', (float(number), *STILL[1:]))

    def x(self):
        """Look up the transform; return its x (m)."""
        return self.lookup_transform('map', 'tool').translation[0]

    def hold_for_fork(self, timeout):
        """Take the lock."""
        self.is_forking.set()
        return super().hold_for_fork(timeout)


@pytest.fixture
def buffer():
    """A buffer with one transform."""
    return Watched()


@pytest.fixture
def other():
    """Another buffer, whose lock a fork takes first."""
    return Watched()


@pytest.fixture
def held(buffer):
    """An event: until it is set, another thread holds the lock of the buffer."""
    is_held, is_over = Event(), Event()

    def hold():
        with buffer.fetched():
            is_held.set()
            is_over.wait()

    thread = Thread(target=hold)
    thread.start()
    is_held.wait()
    yield is_over
    is_over.set()
    thread.join()


class Source:
    """A source of transforms."""

    def __init__(self, take):
        """Create a source with its function `take`."""
        self.take = take

    def wake(self):
        """Do nothing, since no thread waits for messages."""


def test_a_child_has_the_data_of_the_fork(buffer):
    """Parent and child insert into their own copies; a timeout ends in the child, too."""
    reading, writing = os.pipe()

    def look():
        os.read(reading, 1)
        assert buffer.x() == 1.0
        buffer.put(3)
        assert buffer.x() == 3.0
        with pytest.raises(LookupException, match='does not exist'):
            buffer.lookup_transform('map', 'nobody', timeout=50_000_000)

    def insert():
        buffer.put(2)
        os.write(writing, b'.')

    in_child(look, insert)
    assert buffer.x() == 2.0


def test_a_child_has_what_had_arrived(buffer):
    """A transform in the queue of a source is inserted before the fork."""
    batches = [Rows([Row(2, 'map', 'tool', (2.0, *STILL[1:]))], 'sent', False)]
    buffer.add_source(Source(lambda: batches))

    def look():
        assert buffer.x() == 2.0

    in_child(look)


def test_a_child_has_no_sources(buffer):
    """They work in the parent only."""
    reading, writing = os.pipe()
    batches = []

    def look():
        os.read(reading, 1)
        batches.append(Rows([Row(2, 'map', 'tool', (2.0, *STILL[1:]))], 'sent', False))
        assert buffer.x() == 1.0
        assert not buffer.has_waiters

    buffer.add_source(Source(lambda: batches))
    waiting = Thread(target=buffer.can_transform, args=['map', 'late', 0, 60_000_000_000])
    waiting.start()
    while not buffer.has_waiters:
        time.sleep(0.001)
    in_child(look, lambda: os.write(writing, b'.'))
    buffer.insert(1, 'map', 'late', STILL)
    waiting.join()


def test_a_fork_in_a_block_that_holds_the_lock(buffer):
    """After the block, the lock is free in both processes."""
    def look():
        block.close()
        assert in_thread(buffer.x) == 1.0

    with ExitStack() as block:
        block.enter_context(buffer.fetched())
        in_child(look)
    assert in_thread(buffer.x) == 1.0


def test_a_fork_waits_for_a_lock(other, buffer, monkeypatch):
    """It holds no other lock meanwhile, since the thread may wait for that one."""
    monkeypatch.setattr(forking, '_PATIENCE', 60.0)
    is_held = Event()

    def hold():
        with buffer.fetched():
            is_held.set()
            buffer.is_forking.wait()
            other.put(2)

    def look():
        assert in_thread(buffer.x) == 1.0
        assert in_thread(other.x) == 2.0

    thread = Thread(target=hold)
    thread.start()
    is_held.wait()
    in_child(look)
    thread.join()
    assert in_thread(buffer.x) == 1.0


def test_a_fork_without_a_lock(buffer, held, monkeypatch):
    """If the lock is not free in time, the child drops the dynamic transforms."""
    monkeypatch.setattr(forking, '_PATIENCE', 0.05)

    def look():
        assert buffer.can_transform('map', 'fixed')
        assert not buffer.can_transform('map', 'tool')
        buffer.put(5)
        assert buffer.x() == 5.0

    in_child(look)
    held.set()
    assert buffer.x() == 1.0


def test_ctrl_c_during_a_fork_is_raised_after_it(buffer, held, monkeypatch):
    """Python would print it and go on, if it were raised before."""
    monkeypatch.setattr(forking, '_PATIENCE', 60.0)
    is_interrupted = Event()

    def handle(*_):
        is_interrupted.set()
        raise KeyboardInterrupt

    def interrupt():
        buffer.is_forking.wait()
        os.kill(os.getpid(), signal.SIGINT)
        is_interrupted.wait()
        held.set()

    def sleep():  # interrupt_main() does not end a long sleep
        for _ in range(6000):
            time.sleep(0.01)

    before = signal.signal(signal.SIGINT, handle)
    thread = Thread(target=interrupt)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            in_child(buffer.x, sleep)
    finally:
        thread.join()
        signal.signal(signal.SIGINT, before)
    assert buffer.x() == 1.0


def test_a_source_that_fails_does_not_disturb_a_fork(buffer, monkeypatch):
    """The lock is free in both processes, and Python prints no error."""
    errors: list[object] = []
    monkeypatch.setattr(sys, 'unraisablehook', errors.append)

    def take():
        if is_forking:
            raise ValueError
        return []

    is_forking = True
    buffer.add_source(Source(take))

    def look():
        assert in_thread(buffer.x) == 1.0

    in_child(look)
    is_forking = False
    assert in_thread(buffer.x) == 1.0
    assert not errors
