"""
The engine of a buffer: the lock, the sources, the data, and the threads that wait for data.

docs/architecture.md shows the threads and the data flow. While a thread holds the lock, it
must not run a user's callback, write to a log, join a thread or take another lock. A lookup by a
thread that holds the lock already neither updates nor waits. Such lookups are those in a block of
`with buffer.updated()`, and those of a signal handler that has interrupted another call.
"""

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from functools import partial
import logging
import os
from threading import RLock
from time import monotonic
from typing import Any, Optional, Protocol, TypeVar
from weakref import ref, WeakSet

import numpy as np
from numpy.typing import NDArray

from puretf._causes.facts import Blocked, Look, Surroundings, Waited
from puretf._core import failures
from puretf._core.insertion import Insertion
from puretf._core.lookup import Lookups
from puretf._core.pose import Batch, BatchOrRows, Pose, POSE_BYTES, Row, Rows
from puretf._core.times import nanoseconds_or_int
from puretf._core.tree import END, FrameTree
from puretf._core.wake import Wake
from puretf.exceptions import described, note_durations, TransformException

_Result = TypeVar('_Result')
#: The longest time between two attempts of a blocked lookup (s); nothing wakes it when ROS is shut
#: down.
_RETRY_INTERVAL = 0.2


class Source(Protocol):
    """A source of transforms, such as the subscriptions of a listener."""

    def take(self) -> list[BatchOrRows]:
        """Return the transforms that have arrived; do not block. The caller holds the lock."""

    def wake(self) -> None:
        """Make the thread of the source, if there is one, call `Engine.update` now."""

    def is_alive(self) -> bool:
        """Return False if nothing more will arrive."""


class Waiter(Protocol):
    """An object that waits for transforms without blocking a thread."""

    @property
    def is_waiting(self) -> bool:
        """True if a future or a message waits."""

    def check(self) -> bool:
        """
        Complete the futures or messages whose transforms are available; the lock is not held.

        Return True if the executor that spins the node of a listener must be woken.
        """


class Engine:
    """The data of one buffer, and how threads share them."""

    def __init__(self, cache_time: Any, max_frames: int, max_samples: Optional[int]) -> None:
        cache_time = nanoseconds_or_int(cache_time, 'cache_time')
        if cache_time < 0:
            raise ValueError(f'cache_time must not be negative, got {cache_time} ns')
        if max_samples is not None and max_samples < 1:
            raise ValueError(f'max_samples must be at least 1, or None, got {max_samples}')
        # A KeyboardInterrupt cannot leave this lock held: it is only taken by `with`, and its
        # `__enter__` is written in C.
        self.lock: AbstractContextManager[Any] = RLock()
        self.tree = FrameTree(cache_time)
        self.lookups = Lookups(self.tree)
        self.insertion = Insertion(self.lookups, max_frames, max_samples)
        #: Returns what the texts of errors use; a listener assigns it.
        self.look: Look = Surroundings
        #: Returns the nodes that cannot call back while this thread waits; a listener assigns it.
        self.find_blocked: Callable[[], Mapping[str, Blocked]] = dict
        # An error that nobody has read does not keep the data alive.
        self.tree.look = partial(_look, ref(self))
        #: Returns False when blocked lookups should give up, as when ROS is shut down.
        self.is_alive: Callable[[], bool] = lambda: True
        self._sources: tuple[Source, ...] = ()
        self._waiters: tuple[Waiter, ...] = ()
        #: A number that grows when blocked lookups should try again.
        self.generation = 0
        #: What wakes the blocked lookups.
        self.wakes: set[Wake] = set()
        #: True during a change of the data, and after a change that was interrupted.
        self._is_changing = False
        _engines.add(self)

    # Sources and insertion

    def add_source(self, source: Source) -> None:
        with self.lock:
            self._sources += (source,)

    def remove_source(self, source: Source) -> None:
        """Update, then remove a source; blocked lookups give up when the last one is removed."""
        try:
            self.update()
        finally:
            with self.lock:
                self._sources = tuple(each for each in self._sources if each is not source)
                self._notify_lookups()

    def is_held(self) -> bool:
        """Return whether this thread holds the lock."""
        return bool(self.lock._is_owned())  # type: ignore[attr-defined]

    def update(self) -> int:
        """
        Insert the messages that the sources have received, unless this thread holds the lock.

        Return the generation.
        """
        is_held = self.is_held()
        with self.lock:
            if not is_held:
                if self._is_changing:  # the change was interrupted
                    self.insertion.drop(self.tree.mend)
                    self._is_changing = False
                for source in self._sources:
                    if batches := source.take():
                        self._insert(batches)
            return self.generation

    def update_for_user(self) -> int:
        """Update in a user's thread; if waiters wait for the new data, a listener checks them."""
        before = self.generation
        after = self.update()
        if after > before and any(waiter.is_waiting for waiter in self._waiters):
            self.wake_sources()
        return after

    def insert(self, stamp: Any, frame_id: str, child_frame_id: str, pose: Pose, authority: str,
               is_static: bool) -> bool:
        """Insert a pose as `BufferBase.insert` does."""
        _check_names(frame_id, child_frame_id, authority)
        if type(stamp) is not int:  # most are
            stamp = nanoseconds_or_int(stamp, 'stamp')
        if not -END <= stamp < END:
            raise OverflowError(f'a stamp must be an int64 (ns), got {stamp}')
        numbers: Any = tuple(array('d', pose))
        if len(numbers) != 7:
            raise ValueError('a pose must be 7 numbers, x, y, z and the quaternion x, y, z, w, '
                             f'got {len(numbers)}')
        if self._sources or self._is_changing:
            self.update()  # messages that arrived before this call are inserted first
        with self.lock:
            is_accepted = self._change(
                self.insertion.insert, stamp, frame_id.removeprefix('/'),
                child_frame_id.removeprefix('/'), numbers, authority, is_static)
            if is_accepted:
                self._notify_lookups()
        self.after_insertion()
        return is_accepted

    def insert_many(self, stamps: NDArray[np.int64], frame_id: str, child_frame_id: str,
                    poses: NDArray[np.float64], authority: str) -> bool:
        """Insert (n, 7) poses in the order of their stamps, all at once."""
        _check_names(frame_id, child_frame_id, authority)
        if not (stamps[1:] > stamps[:-1]).all():
            rows = [Row(stamp, frame_id, child_frame_id, pose)
                    for stamp, pose in zip(stamps.tolist(), map(tuple, poses.tolist()))]
            return self.insert_batches([Rows(rows, authority, False)])
        batch = Batch([frame_id.removeprefix('/')], [child_frame_id.removeprefix('/')], authority)
        batch.stamps.frombytes(stamps.tobytes())
        data = poses.tobytes()
        batch.poses = [data[i:i + POSE_BYTES] for i in range(0, len(data), POSE_BYTES)]
        return self.insert_batches([batch])

    def insert_batches(self, batches: Iterable[BatchOrRows]) -> bool:
        """
        Insert the transforms of messages, much faster than by one `insert` per transform.

        Return False if a transform was refused.
        """
        self.update()
        with self.lock:
            is_accepted = self._insert(batches)
        self.after_insertion()
        return is_accepted

    def _insert(self, batches: Iterable[BatchOrRows]) -> bool:
        is_accepted = self._change(self.insertion.insert_batches, batches)
        self._notify_lookups()
        return is_accepted

    def remove(self, name: str) -> None:
        """Remove a frame as `BufferBase.remove` does."""
        self.update_for_user()  # so that messages that have arrived are removed, too
        with self.lock:
            failures.check(self.tree, name, 'remove')
            self._change(self.insertion.drop, self.tree.remove, name)

    def clear(self) -> None:
        self.update_for_user()  # so that messages that have arrived are removed, too
        with self.lock:
            self.insertion.log.forget()
            self._change(self.insertion.drop, self.tree.clear)

    def _change(self, change: Callable[..., _Result], *arguments: Any) -> _Result:
        """Call a function that changes the data; the lock is held."""
        # True before if this call has interrupted another one, as in a signal handler.
        before, self._is_changing = self._is_changing, True
        result = change(*arguments)
        self._is_changing = before
        return result

    def _notify_lookups(self) -> None:
        self.generation += 1
        for wake in tuple(self.wakes):
            wake.set()

    def after_insertion(self) -> bool:
        """
        Let the waiters check for available transforms, and log why transforms were refused.

        Call this without the lock. Return True if the executor that spins the node of a listener
        must be woken.
        """
        is_urgent, error = False, None
        for waiter in self._waiters:
            try:
                is_urgent |= waiter.is_waiting and waiter.check()
            except BaseException as raised:  # raised by a done callback of a future
                error = raised
        self.insertion.log.flush()
        if error is not None:
            raise error
        return is_urgent

    # Lookups

    def reading(self) -> AbstractContextManager[Any]:
        """
        Update, and return the lock, to be held while `lookups` and `tree` are used.

        The lock itself is returned, since its `__enter__` is written in C; see `lock`.
        """
        if self._sources:
            self.update_for_user()
        if self._is_changing:
            if self.is_held():
                raise TransformException('This lookup has interrupted an insertion, as in a '
                                         'signal handler; look up later')
            self.update()  # waits for the end of a change in another thread
        return self.lock

    def wait(self, times: Sequence[Any], timeout: float, lookup: Callable[..., _Result],
             *arguments: Any) -> _Result:
        """
        Repeat a lookup whenever data arrive, until it succeeds or the timeout (s) is over.

        Also give up if ROS is shut down, or if the last source is removed. A thread that holds the
        lock does not wait. `times` are those that the user has passed.

        :raises TransformException: the last error of the lookup.
        """
        try:
            with self.reading():
                return lookup(*arguments)
        except TransformException as error:
            note_durations(error, *times)
            if timeout <= 0.0 or self.is_held():
                raise
        deadline, before = monotonic() + timeout, self._liveness()
        # No `Condition`: a KeyboardInterrupt inside of it could leave its lock held.
        wake = Wake()
        try:
            # In this order, no data are missed: the next update takes what has arrived by then,
            # and the listeners' threads do not pause afterwards, because `wakes` is not empty.
            self.wakes.add(wake)
            self.wake_sources()
            while True:
                # If no source is left before the update, this attempt can be the last.
                is_over = any(was and not now for was, now in zip(before, self._liveness()))
                seen = self.update_for_user()
                try:
                    with self.lock:
                        return lookup(*arguments)
                except TransformException as error:
                    if is_over or monotonic() >= deadline:
                        note_durations(error, *times)
                        error._waited = Waited(timeout, self.find_blocked())
                        raise
                next_attempt = min(deadline, monotonic() + _RETRY_INTERVAL)
                while (wake.wait(max(0.0, next_attempt - monotonic()))
                       and self.generation <= seen):
                    pass
        finally:
            self.wakes.discard(wake)

    def _liveness(self) -> tuple[bool, bool]:
        """Return whether messages may arrive, and whether blocked lookups may go on."""
        return any(source.is_alive() for source in self._sources), self.is_alive()

    @property
    def is_awaited(self) -> bool:
        """True if a blocked lookup or a waiter waits for a transform."""
        return bool(self.wakes) or any(waiter.is_waiting for waiter in self._waiters)

    def add_waiter(self, waiter: Waiter) -> None:
        with self.lock:
            self._waiters += (waiter,)

    def remove_waiter(self, waiter: Waiter) -> None:
        with self.lock:
            self._waiters = tuple(each for each in self._waiters if each is not waiter)

    def wake_sources(self) -> None:
        """Let the threads of the sources update now, and not pause."""
        for source in self._sources:
            source.wake()

    def after_fork(self) -> None:
        """
        Keep the data in the child of a fork, where only the forking thread exists.

        If another thread was changing the data, the next use mends them.
        """
        self.lock = RLock()  # another thread may have held the old one
        self._sources, self._waiters, self.wakes = (), (), set()
        self.is_alive = lambda: True
        self.find_blocked = dict
        self.look = Surroundings  # locks of the ROS graph may be held for good
        self.insertion.log.write = logging.getLogger('puretf').warning
        self.tree.copy_samples()


def _check_names(frame_id: object, child_frame_id: object, authority: object) -> None:
    if not (isinstance(frame_id, str) and isinstance(child_frame_id, str)):
        raise TypeError(f'a frame id must be a str, got {described(frame_id)} and '
                        f'{described(child_frame_id)}')
    if not isinstance(authority, str):
        raise TypeError(f'an authority must be a str, got {described(authority)}')


def _look(reference: 'ref[Engine]') -> Surroundings:
    """Return the surroundings of a buffer; nothing is known while this thread holds its lock."""
    engine = reference()
    if engine is not None and not engine.is_held():
        with suppress(Exception):  # the listener has ended, the node is destroyed, ROS shut down
            return engine.look()
    return Surroundings()


#: All engines of this process.
_engines: WeakSet[Engine] = WeakSet()


if hasattr(os, 'register_at_fork'):  # not on Windows
    os.register_at_fork(after_in_child=lambda: [*map(Engine.after_fork, _engines)])


def engine_of(buffer: Any) -> Engine:
    """Return the engine of a buffer; raise a TypeError for anything else."""
    engine = getattr(buffer, '_engine', None)
    if not isinstance(engine, Engine):
        raise TypeError(f'buffer must be a buffer of puretf, got {described(buffer)}')
    return engine
