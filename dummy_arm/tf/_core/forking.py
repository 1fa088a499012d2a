"""
Forks of a process that has buffers.

The locks of all buffers are taken before a fork. After the fork, these locks are released in the
parent process and in the child process. If another thread instead held a lock during the fork, the
lock would never be released in the child process, because that process lacks the other thread.

A fork waits at most about 5 s for the locks of all buffers. Then the fork goes on, even if some
locks could not be taken. In the child process, a buffer whose lock was not taken drops its dynamic
transforms, because another thread may have been changing these transforms during the fork.
"""

from _thread import interrupt_main
from contextlib import suppress
import os
from threading import RLock, Timer
from time import monotonic
from typing import Protocol
from weakref import WeakValueDictionary

#: A fork waits at most about this time (s) for the locks of all buffers together.
_PATIENCE = 5.0
#: One attempt waits at most this time (s) for the lock of one buffer.
_PATIENCE_PER_LOCK = 0.02


class _Buffer(Protocol):
    """The methods of an `Engine` that a fork needs."""

    def hold_for_fork(self, timeout: float) -> bool:
        """
        Take the lock.

        :param timeout: how long to wait for the lock at most (s).
        :returns: False if another thread still holds the lock.
        """

    def is_held(self) -> bool:
        """
        Return whether this thread holds the lock.

        :returns: True if this thread holds the lock.
        """

    def pull(self) -> None:
        """Insert the transforms that the sources have received; the lock must be held."""

    def release_after_fork(self) -> None:
        """Release the lock."""

    def after_fork_in_child(self, was_held: bool) -> None:
        """
        Drop the objects that work in the parent process only, such as sources.

        :param was_held: True if the lock was taken before the fork, so that no other thread was
            changing the data.
        """


#: All buffers; the keys are the ids of the buffer objects.
_buffers: 'WeakValueDictionary[int, _Buffer]' = WeakValueDictionary()
#: The lock that is held while the process forks.
_forking = RLock()
#: The forks that are under way, in the order in which they began. There is more than one only if
#: a signal handler forks the process during a fork.
_forks: list['_Fork'] = []


def register(buffer: _Buffer) -> None:
    """
    Hold the lock of a buffer during all forks from now on.

    :param buffer: the buffer; only a weak reference to it is kept.
    """
    _buffers[id(buffer)] = buffer


class _Fork:
    """One fork of the process, with the buffers that exist when the fork begins."""

    def __init__(self) -> None:
        """Collect the buffers; no lock is taken yet."""
        self._buffers = [buffer for reference in _buffers.valuerefs()
                         if (buffer := reference()) is not None]
        self._held: list[_Buffer] = []
        self.is_interrupted = False

    def prepare(self) -> None:
        """
        Take the locks of all buffers, except locks that other threads do not release in time.

        A KeyboardInterrupt is not raised here, because Python would only print it, and would fork
        anyway. The parent process raises it after the fork.
        """
        deadline = monotonic() + _PATIENCE
        is_done = False
        while not is_done:
            try:
                self.release()
                is_last = monotonic() > deadline
                is_done = self._take(is_last)
            except KeyboardInterrupt:
                self.is_interrupted = True

    def _take(self, is_last: bool) -> bool:
        """
        Take the locks one after the other, and insert the messages that have arrived.

        If a lock cannot be taken, the caller must release the locks that were taken, and only then
        try again. Otherwise there could be a deadlock, because the thread that holds the missing
        lock may be waiting for one of the locks that were taken.

        :param is_last: True to go on without the locks that cannot be taken.
        :returns: False if a lock could not be taken and `is_last` is False.
        """
        for i, buffer in enumerate(self._buffers):
            # If this thread holds the lock already, it may be in the middle of an insertion. In
            # this case no messages are inserted.
            is_nested = buffer.is_held()
            if buffer.hold_for_fork(_PATIENCE_PER_LOCK):
                self._held.append(buffer)
                if not is_nested:
                    with suppress(Exception):
                        buffer.pull()  # the child process has no sources to pull from
            elif not is_last:
                # The next attempt begins with this lock, so that no other lock is held while this
                # thread waits for this lock.
                self._buffers.insert(0, self._buffers.pop(i))
                return False
        return True

    def release(self) -> None:
        """Release the locks that were taken."""
        while self._held:
            self._held.pop().release_after_fork()

    def after_fork_in_child(self) -> None:
        """Make all buffers drop the objects that do not work in the child process."""
        held = set(map(id, self._held))
        for buffer in self._buffers:
            buffer.after_fork_in_child(id(buffer) in held)


def _before_fork() -> None:
    _forking.acquire()
    fork = _Fork()
    _forks.append(fork)
    fork.prepare()


def _after_fork_in_parent() -> None:
    fork = _forks.pop()
    fork.release()
    _forking.release()
    if fork.is_interrupted:
        # Python would only print an exception that is raised in this function. So the
        # KeyboardInterrupt is raised in the main thread a moment later.
        Timer(0.05, interrupt_main).start()


def _after_fork_in_child() -> None:
    fork = _forks.pop()
    fork.after_fork_in_child()
    fork.release()
    _forking.release()


if hasattr(os, 'register_at_fork'):  # not on Windows
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork_in_parent,
                        after_in_child=_after_fork_in_child)
