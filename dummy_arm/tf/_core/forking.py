"""
Forks of a process that has buffers.

The locks of all buffers are taken before a fork. After the fork, these locks are released in the
parent process and in the child process. Without this, a lock that another thread holds during the
fork would never be released in the child process, because that process does not have the thread.

A fork waits at most about 5 s for the locks of all buffers. Then it goes on, even if some locks
could not be taken. In the child process, a buffer whose lock was not taken drops its dynamic
transforms, because another thread may have been changing these transforms.
"""

from _thread import interrupt_main
from contextlib import suppress
import os
from threading import RLock, Timer
from time import monotonic
from typing import Protocol
from weakref import WeakValueDictionary

#: The longest time (s) that a fork waits, approximately, for the locks of all buffers together.
_PATIENCE = 5.0
#: The longest time (s) that one attempt waits for the lock of one buffer.
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
        """Insert what has arrived in the sources; the lock must be held."""

    def release_after_fork(self) -> None:
        """Release the lock."""

    def after_fork_in_child(self, was_held: bool) -> None:
        """
        Drop the objects that work in the parent process only, such as sources.

        :param was_held: True if the lock was taken before the fork, so that no other thread was
            changing the data.
        """


#: All buffers, by their ids.
_buffers: 'WeakValueDictionary[int, _Buffer]' = WeakValueDictionary()
#: Held while the process forks.
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
    """One fork of the process, with the buffers that exist at the time of the fork."""

    def __init__(self) -> None:
        """Collect the buffers; no lock is taken yet."""
        self._buffers = [buffer for reference in _buffers.valuerefs()
                         if (buffer := reference()) is not None]
        self._held: list[_Buffer] = []
        self.is_interrupted = False

    def prepare(self) -> None:
        """
        Take the locks of all buffers, except those that other threads do not release in time.

        A KeyboardInterrupt is remembered until after the fork. If it were raised here, Python
        would only print it, and would fork anyway.
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
            # If this thread holds the lock already, the thread may be in the middle of an
            # insertion. So no messages are inserted then.
            is_nested = buffer.is_held()
            if buffer.hold_for_fork(_PATIENCE_PER_LOCK):
                self._held.append(buffer)
                if not is_nested:
                    with suppress(Exception):
                        buffer.pull()  # the child process has no sources to pull from
            elif not is_last:
                # The next attempt begins with this lock, so that no other lock is held during the
                # wait.
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
