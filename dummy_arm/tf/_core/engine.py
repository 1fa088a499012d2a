"""
What all buffers share: the lock, the sources, the data, and the threads that wait for data.

Theory of operation
===================

A buffer pulls. It has sources, such as the subscriptions of a listener, and takes what has arrived
out of them whenever somebody looks up, and whenever a listener's thread calls `update`. So a
lookup sees every message that has arrived, although the thread pauses while messages come in fast.
`insert` and `set_transform` first pull, too, so that nothing overtakes what was sent before.

    source.take() -> batches -> Insertion -> History     under the lock, in any thread
    lookup -> Lookups -> FrameTree -> Path -> pose      under the lock, in any thread

The trip of a message that has arrived on /tf, whose frames have come together before; a lookup
that comes before the thread makes the same trip, from `Engine.update` on:

    TransformListener._work     transform_listener.py   one round of the listener's thread
    Engine.update               _core/engine.py         takes the lock, and asks the sources
    SubscriptionSource.take     _ros/subscription.py    what has arrived on both topics
    Topic.take                  _ros/subscription.py    the bytes of all messages in the queue
    MessageReader.read          _wire/streams.py        messages to a `Batch`, or to `Rows`
    key                         _wire/cdr.py            what the layout of a message is found by
    _Layout.read                _wire/streams.py        the stamp and the poses
    Insertion.insert_batches     _core/insertion.py      the batch, frame by frame
    normalize_poses             _core/insertion.py      all rotations at once
    History.append              _core/history.py        stamps and poses of one frame

Only if a user has overridden a callback of the listener or a setter of the buffer, the listener's
thread takes and decodes the messages, without the lock, and calls what is overridden.

Threads. Each listener has one thread. It waits in a wait set of the middleware; when it wakes up,
it calls `update`, and `after_insertion` if there is something new. Users' threads look up, insert
and wait. A thread of `_ros/futures` ends futures whose time is up. Whoever ends a listener joins
its thread for half a second at most, but not if it is that thread itself or holds the lock.

The lock. A buffer has one lock, which is reentrant and, but for a fork, only taken by `with`.
While it is held, no callback runs, nothing is logged or joined, and no other lock of this package
is taken; in a block of `with buffer.fetched()`, that is the user's responsibility. A call in a
thread that holds the lock already is nested: in such a block, or in a signal handler or weakref
callback that interrupted a call of this buffer. It answers from the data as they are: it does not
pull, and it does not wait. A signal handler may look up, but must not insert: it may have
interrupted an insertion.

Ctrl-C. CPython raises KeyboardInterrupt in the main thread only, and there only after a call, at
the start of a function and when a loop jumps back. `with` on a lock of C code is safe then. The
statements of `History` that change several lists stand next to each other, with one call at most,
the last. `Source.take` returns a list that the source keeps; `update` clears it after the
insertion, so that what was interrupted is inserted once more by the next update. A sample that is
there already is not inserted again.

Who wakes whom. Each insertion increments the generation.
- A blocked lookup has a queue, into which each insertion puts the new generation. The lookup reads
  generations and looks again only for one that is newer than its last look. It is a `SimpleQueue`,
  since a KeyboardInterrupt inside a `Condition` can leave a lock held. It registers the queue
  first, then wakes the sources, which ends a pause of the listener's thread, and then looks. In
  this order it cannot miss anything: either the thread sees that somebody waits and does not
  pause, or the look sees the data. It looks again every 0.2 s, since a shutdown of ROS wakes
  nobody.
- `after_insertion` completes futures, without the lock, since their callbacks are users' code. It
  is called by the thread that has inserted by `set_transform`, and by the listener's thread
  whenever the generation has changed. A lookup that pulls messages while futures wait wakes the
  sources, so that the listener's thread does it.
- The listener's thread wakes the executor that spins its node: at once when it has completed a
  future, for new data at most ten times a second, since that costs 0.1 to 0.3 ms. The executor
  of the buffer's node is woken for each future.

Shutdown. `remove_source` pulls once more, and drops the source. A blocked lookup that began while
there was a source ends with its last error when there is none left, and when its context is shut
down. Futures end by their timeout only, as in tf2_ros. The listener's thread ends when the
listener is unregistered, its node is destroyed, its context is shut down or Python exits; at its
end it removes its source and destroys the subscriptions.

Fork. As in the module `logging`, the locks of all buffers are held while the process forks, so
that no lock of the child is held by a thread that it does not have. The child has the data, but no
sources, threads or futures; see `forking`.
"""

from array import array
from collections.abc import Callable, Iterable, Sized
from contextlib import AbstractContextManager, suppress
from operator import index
from queue import Empty, SimpleQueue
from threading import RLock
from time import monotonic
from typing import Any, Optional, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dummy_arm.tf._core import forking, frames
from dummy_arm.tf._core.frames import Frame
from dummy_arm.tf._core.insertion import Insertion
from dummy_arm.tf._core.lookup import Lookups
from dummy_arm.tf._core.pose import BatchOrRows, Pose
from dummy_arm.tf._core.times import nanoseconds_or_int
from dummy_arm.tf._core.tree import FrameTree
from dummy_arm.tf.exceptions import TransformException
from dummy_arm.tf.transform import Transform

_Answer = TypeVar('_Answer')

_INT64 = 1 << 63

#: A blocked lookup looks again after so long (s) without news.
_STEP = 0.2
#: The number of poses that are looked up before the lock is released.
_CHUNK = 2048


class Source(Protocol):
    """What a buffer pulls transforms from."""

    def take(self) -> list[BatchOrRows]:
        """
        Return what has arrived, in a list that the source keeps; whoever inserts it clears it.

        It is called with the lock of the buffer held. It does not block.
        """

    def wake(self) -> None:
        """Have the thread of the source, if there is one, update the buffer now."""


class Engine:
    """The data of a buffer, with what is common to all kinds of buffers."""

    def __init__(self, cache_time: Any, max_frames: int, max_samples: Optional[int]) -> None:
        """
        Create an empty buffer.

        :param cache_time: this and the others: see `BufferCore`.
        """
        cache_time = nanoseconds_or_int(cache_time, 'cache_time')
        if cache_time < 0:
            raise ValueError(f'cache_time must not be negative, got {cache_time} ns')
        if max_samples is not None and max_samples < 1:
            raise ValueError(f'max_samples must be at least 1, or None, got {max_samples}')
        self._lock: Any = RLock()
        self._tree = FrameTree(cache_time)
        self._lookups = Lookups(self._tree)
        self._insertion = Insertion(self._lookups, max_frames, max_samples)
        self._sources: tuple[Source, ...] = ()
        self._generation = 0
        #: One for each blocked lookup, which gets the new generations.
        self._queues: set[SimpleQueue[int]] = set()
        self._futures: Sized = ()
        forking.register(self)

    # Sources and insertion

    def add_source(self, source: Source) -> None:
        """Pull transforms from a source, from now on."""
        with self._lock:
            self._sources += (source,)

    def remove_source(self, source: Source) -> None:
        """Insert what has arrived, and pull nothing more from a source."""
        try:
            self.update()
        finally:
            with self._lock:
                if source in self._sources:
                    i = self._sources.index(source)
                    self._sources = self._sources[:i] + self._sources[i + 1:]
                    self._notify_waiters()  # blocked lookups end, if it was the last one

    def update(self) -> int:
        """
        Insert what has arrived, unless this thread holds the lock.

        :returns: the generation: a number that is larger after each insertion than before.
        """
        is_nested = self._lock._is_owned()
        with self._lock:
            if not is_nested:
                for source in self._sources:
                    batches = source.take()
                    if batches:
                        self._insertion.insert_batches(batches)
                        self._notify_waiters()
                        batches.clear()
            return self._generation

    def _notify_waiters(self) -> None:
        """Wake the blocked lookups: there is something new."""
        self._generation += 1
        for queue in tuple(self._queues):
            queue.put(self._generation)

    def insert(self, stamp: int, frame_id: str, child_frame_id: str, pose: Pose,
               authority: str = 'default_authority', is_static: bool = False) -> bool:
        """
        Insert the pose of a frame in its parent; one leading slash is removed from both names.

        :param stamp: ns.
        :param frame_id: the parent.
        :param child_frame_id: the frame.
        :param pose: x, y, z (m) and the rotation's x, y, z, w, which is normalised.
        :param authority: the publisher; shown by `frames`.
        :param is_static: whether the pose holds at all times.
        :returns: False when it was refused, as tf2 refuses it; the log says why.
        :raises TypeError: when a name is no str, or something is no number.
        :raises ValueError: when the pose is of another length.
        :raises OverflowError: when a stamp is no int64.
        """
        if not (isinstance(frame_id, str) and isinstance(child_frame_id, str)):
            raise TypeError(f'a frame id must be a str, got {frame_id!r} and {child_frame_id!r}')
        stamp = index(stamp)
        if not -_INT64 <= stamp < _INT64:
            raise OverflowError(f'a stamp must be an int64 of ns, got {stamp}')
        x, y, z, qx, qy, qz, qw = array('d', pose)
        pose = x, y, z, qx, qy, qz, qw
        if self._sources:
            self.update()  # so that this does not overtake what was sent before
        with self._lock:
            is_accepted = self._insertion.insert(stamp, frame_id, child_frame_id, pose, authority,
                                              is_static)
            if is_accepted:
                self._notify_waiters()
        self.after_insertion()
        return is_accepted

    def insert_batches(self, batches: Iterable[BatchOrRows]) -> None:
        """
        Insert the transforms of many messages; much faster than `insert`.

        :param batches: batches and rows, as a `MessageReader` reads them from bytes.
        """
        self.update()
        with self._lock:
            self._insertion.insert_batches(batches)
            self._notify_waiters()
        self.after_insertion()

    def after_insertion(self) -> bool:
        """
        Log what was refused; a Buffer completes its futures, too. The lock must not be held.

        :returns: whether a future was completed.
        """
        self._insertion.log.flush()
        return False

    def clear(self) -> None:
        """Forget all but the names of the frames and what is static."""
        self._update_for_user()  # so that nothing that was sent before comes in after this
        with self._lock:
            try:
                self._tree.clear()
            finally:
                self._lookups.paths.clear()

    # Looking and waiting

    def _look(self, lookup: Callable[..., _Answer], *arguments: Any) -> _Answer:
        """Insert what has arrived, unless this thread holds the lock, and look up."""
        if self._sources:
            self._update_for_user()
        with self._lock:
            return lookup(*arguments)

    def _update_for_user(self) -> None:
        """Insert what has arrived, in a thread that does not complete futures."""
        before = self._generation
        if self.update() > before and len(self._futures):
            self._wake_sources()

    def fetched(self) -> AbstractContextManager[Any]:
        """
        Insert what has arrived, and return a context manager that holds the lock.

        So a block `with buffer.fetched():` sees one consistent state.
        """
        self._update_for_user()
        lock: AbstractContextManager[Any] = self._lock
        return lock

    def is_held(self) -> bool:
        """Return whether this thread holds the lock, as in a block of `fetched`."""
        return bool(self._lock._is_owned())

    @property
    def has_waiters(self) -> bool:
        """Whether a blocked lookup or a future waits for a transform."""
        return bool(self._queues) or len(self._futures) > 0

    def _wake_sources(self) -> None:
        for source in self._sources:
            source.wake()

    def _is_alive(self) -> tuple[bool, ...]:
        """Return flags; a wait ends early when one that was True at its start becomes False."""
        return (bool(self._sources),)

    def _wait(self, timeout: float, lookup: Callable[..., _Answer], *arguments: Any) -> _Answer:
        """
        Look up again and again, as data come in, until there is an answer or time is up.

        :param timeout: s.
        :raises TransformException: the last that the lookup raised.
        """
        try:
            return self._look(lookup, *arguments)
        except TransformException:
            if timeout <= 0.0 or self.is_held():
                raise
        deadline, before = monotonic() + timeout, self._is_alive()
        queue: SimpleQueue[int] = SimpleQueue()
        try:
            self._queues.add(queue)
            self._wake_sources()
            while True:
                now = self._is_alive()  # before the lookup, which then sees the last data
                self.update()
                with self._lock:
                    try:
                        return lookup(*arguments)
                    except TransformException:
                        if monotonic() >= deadline or any(
                                was and not is_ for was, is_ in zip(before, now)):
                            raise
                        seen = self._generation
                look_again = min(deadline, monotonic() + _STEP)
                with suppress(Empty):
                    while queue.get(timeout=max(0.0, look_again - monotonic())) <= seen:
                        pass
        finally:
            self._queues.discard(queue)

    def _why_not(self, timeout: float, check: Callable[..., None], *arguments: Any
                 ) -> Optional[TransformException]:
        """
        Wait until a check passes.

        :param timeout: s.
        :returns: the last error; None: it has passed.
        """
        try:
            self._wait(timeout, check, *arguments)
        except TransformException as error:
            return error
        return None

    # What is known

    def lookup_transforms(self, target_frame: str, source_frame: str, times: ArrayLike
                          ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """
        Look up the poses of the source frame in the target frame at many times at once.

        :param target_frame: the frame in which the poses are.
        :param source_frame: the frame whose poses they are.
        :param times: (n,) integers, ns; 0: the latest common time.
        :returns: translations x, y, z (m), (n, 3); rotations x, y, z, w, (n, 4); and which of
            them are answers, (n,). Where `lookup_transform` would raise, the numbers are NaN.
        :raises TypeError: on times that are no integers.
        :raises OverflowError: on a time that is no int64.
        :raises ValueError: on another shape.
        """
        times = _int64_times(times)
        order = np.argsort(times, kind='stable')  # which makes searching in histories fast
        poses, known = np.empty((len(times), 7)), np.empty(len(times), np.bool_)
        for begin in range(0, len(times), _CHUNK):
            part = order[begin:begin + _CHUNK]
            poses[part], known[part] = self._look(
                self._lookups.poses, target_frame, source_frame, times[part])
        return poses[:, :3], poses[:, 3:], known

    def lookup_all(self, target_frames: Iterable[str], until: int = 0
                   ) -> list[dict[str, Transform]]:
        """
        Look up every frame that is connected to a frame, at the latest common time of each.

        That is what a lookup of each would return, up to rounding. It takes a fraction of the time
        where the transforms on the path have their stamps in common.

        :param target_frames: the frames in which the others are looked up.
        :param until: no later than this time (ns), by the parents that the frames have then; 0:
            without a limit.
        :returns: for each target frame, the transforms by the names of the frames, the nearest
            first; without frames of which nothing is known at that time.
        :raises TransformException: when a target frame does not exist.
        :raises TypeError: on a single name.
        """
        if isinstance(target_frames, str):
            raise TypeError(f'target_frames must be several names, got {target_frames!r}')
        targets = list(target_frames)
        return [{name: Transform(time, target, name, pose[:3], pose[3:])
                 for name, (time, pose) in placed.items()}
                for target, placed in zip(targets, self._look(
                    self._lookups.all_poses, targets, until))]

    def chain(self, target_frame: str, source_frame: str) -> list[str]:
        """
        Return the frames on the path from one frame to another, as they are connected now.

        :param target_frame: the last of them.
        :param source_frame: the first of them.
        :raises TransformException: when there is no path.
        """
        return self._look(self._lookups.chain, target_frame, 0, source_frame, 0, source_frame)

    def frame_names(self) -> list[str]:
        """Return all frames, also those without parent, in the order in which they were named."""
        return self._look(list, self._tree.histories)

    def frames(self, until: int = 0) -> list[Frame]:
        """
        Return what is known of the frames with a parent, in the order of their naming.

        :param until: at this time (ns); 0: now.
        """
        return [Frame(name, *state) for name, state in self._look(self._tree.states, until)]

    def all_frames_as_yaml(self) -> str:
        """Return tf2's YAML of all frames; '[]' when no frame was ever named."""
        listed = self.frames()
        return frames.as_yaml(listed) if self._tree.histories else '[]'

    def all_frames_as_string(self) -> str:
        """Return a line for every frame, with its parent."""
        return frames.as_string(self._look(self._tree.newest_edges))

    def dump(self) -> dict[str, dict[str, Any]]:
        """
        Return all data of the buffer, as lists and dicts that `json` can write.

        :returns: by the name of each frame, a dict with n samples in the order of their stamps:
            `parents`, n names; `stamps`, n int (ns); `poses`, n lists of 7 float: x, y, z (m) and
            the rotation's x, y, z, w; `authority`, the publisher of the last one; `is_static`. A
            static frame has one sample, of stamp 0; a frame that was only named as a parent, none.
        """
        return self._look(self._tree.dump)

    # Forks

    def hold_for_fork(self, timeout: float) -> bool:
        """
        Take the lock, so that no other thread changes the data while the process forks.

        :param timeout: how long to wait for the lock at most (s).
        :returns: False when another thread holds it still.
        """
        return bool(self._lock.acquire(timeout=timeout))

    def release_after_fork(self) -> None:
        """Release the lock."""
        self._lock.release()

    def after_fork_in_child(self, was_held: bool) -> None:
        """
        Drop what works in the parent process only: this one was forked.

        It has one thread, and the middleware does not work in it. So lookups answer from the data
        as of the fork.

        :param was_held: whether the lock was held; if not, another thread may have been changing
            the data, and everything that moves is dropped.
        """
        self._sources = ()
        self._queues.clear()
        if not was_held:
            self._lock = RLock()
            self._tree.clear()
            self._lookups.paths.clear()


def debug_tuple(error: Optional[TransformException]) -> tuple[bool, str]:
    """Return whether there is no error, and its text."""
    return error is None, '' if error is None else str(error)


def _int64_times(times: ArrayLike) -> NDArray[np.int64]:
    """
    Read a row of times (ns).

    :param times: (n,) integers.
    :raises TypeError: on other numbers.
    :raises OverflowError: on a time that is no int64.
    :raises ValueError: on another shape.
    """
    times = np.asarray(times)
    if times.ndim != 1:
        raise ValueError(f'times must be of shape (n,), got {times.shape}')
    if times.size and times.dtype.kind not in 'iu':
        raise TypeError(f'times must be integers of ns, got {times.dtype}')
    if times.size and times.max() > np.iinfo(np.int64).max:
        raise OverflowError(f'times must be int64 of ns, got {times.max()}')
    return times.astype(np.int64)
