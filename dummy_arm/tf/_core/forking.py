"""
Forking a process that has buffers.

As in the module `logging`, the locks of all buffers are taken before a fork and released after it
on both sides: in the child, nobody would release those that other threads hold.
"""

from _thread import interrupt_main
from contextlib import suppress
import os
from threading import RLock, Timer
from time import monotonic
from typing import Protocol
from weakref import WeakValueDictionary

#: How long a fork waits for the locks of buffers at most (s), and for one of them at a time.
_PATIENCE, _TRY = 5.0, 0.02


class _Buffer(Protocol):

    def hold_for_fork(self, timeout: float) -> bool: ...

    def update(self) -> int: ...

    def release_after_fork(self) -> None: ...

    def after_fork_in_child(self, was_held: bool) -> None: ...


#: Every buffer, by its id.
_buffers: 'WeakValueDictionary[int, _Buffer]' = WeakValueDictionary()
#: Held while the process forks; then, for each fork that is under way, the buffers that are held.
_forking = RLock()
_forks: list['_Fork'] = []


def register(buffer: _Buffer) -> None:
    """Hold a buffer during forks, for as long as it exists."""
    _buffers[id(buffer)] = buffer


class _Fork:
    """The buffers of a process that forks."""

    def __init__(self) -> None:
        """Create without a lock taken."""
        self._buffers = [buffer for reference in _buffers.valuerefs()
                         if (buffer := reference()) is not None]
        self._held: list[_Buffer] = []
        self.is_interrupted = False

    def prepare(self) -> None:
        """
        Take the locks.

        Ctrl-C is noted: it would be lost, because Python prints what is raised here, and forks.
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
        Take all locks and insert what has arrived, or take none.

        A thread that has one of the locks may be waiting for another, so to keep some of them
        would block both.

        :param is_last: go on where one cannot be had.
        :returns: whether all were taken.
        """
        for i, buffer in enumerate(self._buffers):
            if buffer.hold_for_fork(_TRY):
                self._held.append(buffer)
                with suppress(Exception):
                    buffer.update()  # since the child cannot
            elif not is_last:
                self._buffers.insert(0, self._buffers.pop(i))  # next time, wait for it with none
                return False
        return True

    def release(self) -> None:
        """Release the locks."""
        while self._held:
            self._held.pop().release_after_fork()

    def after_fork_in_child(self) -> None:
        """Leave to the child what works in it."""
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
    if fork.is_interrupted:  # what is raised before this returns would be printed, too
        Timer(0.05, interrupt_main).start()


def _after_fork_in_child() -> None:
    fork = _forks.pop()
    fork.after_fork_in_child()
    fork.release()
    _forking.release()


if hasattr(os, 'register_at_fork'):  # not on Windows
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork_in_parent,
                        after_in_child=_after_fork_in_child)
