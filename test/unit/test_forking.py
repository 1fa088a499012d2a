"""Forks: the child process looks up in the buffers that it has inherited."""

import os
import signal
import sys
from threading import Event, Thread
import traceback

import pytest

from puretf import LookupException, TransformBuffer
from puretf._core.engine import engine_of
from puretf._core.history import History

pytestmark = [
    pytest.mark.skipif(not hasattr(os, 'fork'), reason='there is no os.fork here'),
    pytest.mark.filterwarnings('ignore:.*multi-threaded:DeprecationWarning')]
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
S = 10**9


def in_child(work):
    """Call a function in a child process, which must end without an error."""
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
    _, status = os.waitpid(pid, 0)
    assert status == 0


def put(buffer, number):
    """Insert a transform whose x (m) is its stamp (ns)."""
    buffer.insert(number, 'map', 'tool', (float(number), *STILL[1:]))


def x(buffer):
    """Return the newest x (m), after a check that it belongs to its stamp."""
    newest = buffer.lookup_transform('map', 'tool')
    assert newest.translation[0] == newest.stamp
    return newest.stamp


def test_a_fork_while_another_thread_inserts():
    """The child has what was there before, and can insert more."""
    buffer, is_over = TransformBuffer(S), Event()
    put(buffer, 1)

    def insert():
        number = 1
        while not is_over.is_set():
            number += 1
            put(buffer, number)

    def look():
        stamps = buffer.path_stamps('map', 'tool').tolist()
        assert stamps == sorted(stamps)
        if stamps:  # there are none if the frame was just being changed
            assert x(buffer) == stamps[-1]
        put(buffer, 10**8)
        assert x(buffer) == 10**8
        with pytest.raises(LookupException):
            buffer.lookup_transform('map', 'nobody', timeout=S // 100)

    thread = Thread(target=insert)
    thread.start()
    try:
        for _ in range(20):
            in_child(look)
    finally:
        is_over.set()
        thread.join()


@pytest.mark.parametrize('is_own', [True, False])
def test_a_fork_while_the_lock_is_held(is_own):
    """By the thread that forks, or by another; the child has its own lock."""
    buffer, is_held, is_over = TransformBuffer(), Event(), Event()
    put(buffer, 5)

    def hold():
        with buffer.updated():
            is_held.set()
            is_over.wait(60.0)

    def look():
        found = []
        thread = Thread(target=lambda: found.append(x(buffer)), daemon=True)
        thread.start()
        thread.join(50.0)
        assert found == [5]

    if is_own:
        with buffer.updated():
            in_child(look)
    else:
        thread = Thread(target=hold)
        thread.start()
        assert is_held.wait(60.0)
        in_child(look)
        is_over.set()
        thread.join()
    put(buffer, 6)
    assert x(buffer) == 6


def test_a_fork_while_another_thread_looks_up():
    """The child can insert, although numpy arrays of that thread use the memory for ever."""
    buffer = TransformBuffer()
    put(buffer, 5)
    history = engine_of(buffer).tree.histories['tool']
    assert isinstance(history, History)
    views = [memoryview(history.stamps), memoryview(history.poses)]

    def look():
        put(buffer, 6)
        assert x(buffer) == 6
        assert buffer.path_stamps('map', 'tool').tolist() == [5, 6]

    in_child(look)
    assert len(views) == 2
