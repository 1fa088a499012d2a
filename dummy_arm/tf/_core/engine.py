"""
The engine of all buffers: the lock, the sources, the data, and the threads that wait for data.

Theory of operation
===================

Terms. An *edge* connects a child frame with its parent; a *path* is the edges between two frames.
A *sample* is the pose of a child frame in its parent at one stamp. The *history* of a frame holds
its samples in the order of their stamps. Stamps and times are integers, in nanoseconds. In a
lookup, time 0 means the latest time for which every edge on the path has data. The *layout* of a
message says at which byte each field begins. All messages with the same frames have the same
layout.

Pulling. A buffer has *sources*, such as the subscriptions of a TransformListener. To *pull* means
to take from the sources the messages that have arrived, and to insert their transforms.
`Engine.update` pulls. Each lookup begins with a call of `update`, and the thread of each listener
calls `update`, too. While messages arrive fast, the listener's thread *pauses*: for up to 0.1 s,
it leaves the messages of /tf in their queue. A lookup during the pause uses these messages,
because the lookup pulls. `insert` and `set_transform` also pull first, so that messages that
arrived before the call are inserted before the call's transform.

    source.take() -> batches -> Insertion -> History     under the lock, in any thread
    lookup -> Lookups -> FrameTree -> Path -> pose       under the lock, in any thread

A `Batch` has the poses of several messages with the same frames. Its poses are inserted frame by
frame. `Rows` are transforms that are inserted one by one. They come mainly from static messages,
from messages whose combination of frames is new, and from messages with several stamps.

The trip of one message. Suppose that a message arrives on /tf, and that an earlier message had the
same frames. The listener's thread then makes the calls below. If a lookup begins before the thread
has taken the message, the lookup makes the same calls, from `Engine.update` on.

    TransformListener._work     transform_listener.py   does one round of the listener's thread
    Engine.update               _core/engine.py         takes the lock
    Engine.pull                 _core/engine.py         inserts what each source has received
    SubscriptionSource.take     _ros/subscription.py    takes the messages of /tf and /tf_static
    Topic.take                  _ros/subscription.py    takes the messages of one topic, as bytes
    MessageReader.read          _wire/streams.py        reads messages into a `Batch`, or `Rows`
    key                         _wire/cdr.py            returns a key, which selects a layout
    _Layout.read                _wire/streams.py        reads the stamp and the poses
    Insertion.insert_batches    _core/insertion.py      inserts the batch, frame by frame
    normalize_poses             _core/insertion.py      normalises all rotations at once
    History.append              _core/history.py        appends stamps and poses of one frame

The calls are different in three cases: the user has overridden a callback of the listener; the
user has overridden `insert`, `set_transform` or `set_transform_static` of the buffer; or the
buffer is not an `Engine`. In these cases, the listener's thread takes and decodes the messages
without the lock, and calls a callback of the listener for each message. A lookup then pulls no
messages from the listener: the lookup uses only what the callbacks have inserted.

Threads. Each listener has one thread, which waits in a wait set of rcl. When this thread wakes up,
it calls `update`; if there are new data, it also calls `after_insertion`. The users' threads look
up, insert and wait. A thread of `_ros/futures` ends the futures whose timeout is over. A call that
ends a listener, such as `unregister`, waits at most half a second for the end of the listener's
thread. The call does not wait if it is made in the listener's thread itself, or in a thread that
holds the lock.

The lock. A buffer has one lock, which is reentrant. The lock is taken by a `with` statement,
except before a fork. While a thread holds the lock, it must not run a user's callback, write to a
log, join a thread, or wait for another lock of this package. The only exception is a fork, which
takes the locks of all buffers. In a block of `with buffer.fetched()`, the user's code holds the
lock, and must keep these rules, too. An insertion in such a block breaks the rules, because it
logs refused transforms and calls the callbacks of completed futures.

A call is *nested* if its thread holds the lock already. Nested calls are the calls in a block of
`with buffer.fetched()`, and the calls in a signal handler or weakref callback that has interrupted
another call of the same buffer. A nested call uses the data as they are: it does not pull, and it
does not wait. A signal handler may look up, but must not insert, since the handler may have
interrupted an insertion.

Ctrl-C. CPython raises KeyboardInterrupt in the main thread only, and there only after a call, at
the start of a function, and when a loop jumps back. There is one exception: up to Python 3.13,
nothing is raised after `with` has called `__enter__`. (Later versions must be checked.) The
`__enter__` of an `RLock` is written in C, so that nothing is raised inside it, either. Therefore,
a KeyboardInterrupt cannot leave the lock held. In `History`, several lists must change together,
so there is no call between their changes. `Source.take` returns a list that the source keeps, and
`Engine.pull` clears this list after the insertion. If the insertion is interrupted, the list is
not cleared, and the next pull inserts the same batches again. A sample that is in the history
already is not inserted again.

Who wakes whom. The *generation* of a buffer is a number that grows with each insertion. Three
kinds of waiters are woken after an insertion:

- A *blocked lookup* is a call that waits for a transform. The lookup has a queue, into which each
  insertion puts the new generation. The lookup reads generations from the queue, and tries again
  when it reads a larger generation than that of its last attempt. The queue is a `SimpleQueue`,
  because a KeyboardInterrupt inside a `Condition` can leave a lock held. When a source is woken,
  the pause of its listener's thread ends. After the first attempt, the lookup registers its queue,
  then wakes the sources, and then tries again. Because of this order, the lookup misses no data:
  the second attempt pulls what has arrived by then, and the listener's thread does not pause
  afterwards, because the queue is registered. The lookup also tries again every 0.2 s, because
  nothing wakes the lookup when ROS is shut down.
- A `Waiter` waits without blocking a thread. The futures that `wait_for_transform_async` returns
  are one waiter, and each message filter is another. `after_insertion` makes the waiters check
  what is available. This method is called without the lock, because the callbacks of a future are
  users' code. `set_transform` calls this method after the insertion, and the listener's thread
  calls it whenever the generation has changed. A lookup does not call it. If a lookup pulls
  messages while a waiter waits, the lookup wakes the sources, so that the listener's thread calls
  `after_insertion`.
- The *executor* that spins the node of a listener is woken by the listener's thread. The executor
  then runs the coroutines that await a completed future, and `rclpy.spin_once` returns. When the
  listener's thread has completed a future, it wakes the executor at once. For other new data, it
  wakes the executor at most ten times a second, because each wake-up costs 0.1 to 0.3 ms. If the
  buffer has a node, each completed future also wakes the executor of that node.

Shutdown. `remove_source` pulls for the last time, and removes the source. A blocked lookup gives
up and raises the error of its last attempt in two cases: the context of the buffer is shut down;
or the buffer had sources when the lookup began, and has none any more. A shutdown of ROS does not
end futures: a future without a timeout stays pending, as in tf2_ros. The listener's thread ends
when the listener is unregistered, when the listener's node is destroyed, when the context of this
node is shut down, or when Python exits. Before the thread ends, it removes the listener's source
from the buffer and destroys the subscriptions.

Fork. The locks of all buffers are taken before the process forks. Otherwise a lock in the child
process could stay held forever, by a thread that exists in the parent process only. The child
process has the data, but no sources, threads or waiters. If the lock of a buffer could not be
taken in time, the child process drops the dynamic transforms of that buffer; see `forking`.
"""

from array import array
from collections.abc import Callable, Container, Iterable, Sequence
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
from dummy_arm.tf._core.velocity import twist
from dummy_arm.tf.exceptions import TransformException
from dummy_arm.tf.transform import Transform, Twist

_Result = TypeVar('_Result')

_INT64 = 1 << 63

#: The longest time between two attempts of a blocked lookup (s).
_RETRY_INTERVAL = 0.2
#: The largest number of poses that `lookup_transforms` computes before it releases the lock.
_CHUNK = 2048


class Source(Protocol):
    """A source of transforms, from which a buffer pulls."""

    def take(self) -> list[BatchOrRows]:
        """
        Return the transforms that have arrived; do not block.

        The caller holds the lock of the buffer.

        :returns: a list that the source keeps. The buffer clears this list after it has inserted
            the items. Until then, each call returns these items again, followed by new ones.
        """

    def wake(self) -> None:
        """Make the thread of the source, if there is one, call `Engine.update` now."""


class Waiter(Protocol):
    """An object that waits for transforms without blocking a thread."""

    @property
    def is_waiting(self) -> bool:
        """True if a future or a message waits."""

    def check(self) -> bool:
        """
        Complete what waits for transforms that are available now.

        The caller does not hold the lock of the buffer, if possible.

        :returns: True if the executor that spins the node of a listener must be woken.
        """


class Engine:
    """The base class of all buffers, with the data and the methods that do not depend on ROS."""

    def __init__(self, cache_time: Any, max_frames: int, max_samples: Optional[int]) -> None:
        """
        Create an empty buffer.

        :param cache_time: how long samples are kept: an int (ns) or a duration; see `BufferCore`.
        :param max_frames: the largest number of frames; see `BufferCore`.
        :param max_samples: the largest number of samples, or None; see `BufferCore`.
        :raises TypeError: if `cache_time` is neither an int nor a duration.
        :raises ValueError: if `cache_time` is negative, or `max_samples` is less than 1.
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
        #: The queues of the blocked lookups. Each insertion puts the new generation into them.
        self._queues: set[SimpleQueue[int]] = set()
        self._waiters: tuple[Waiter, ...] = ()
        forking.register(self)

    # Sources and insertion

    def add_source(self, source: Source) -> None:
        """
        Add a source, so that the buffer pulls from it.

        :param source: the source to be added.

        :meta private:
        """
        with self._lock:
            self._sources += (source,)

    def remove_source(self, source: Source) -> None:
        """
        Pull from all sources, then remove a source.

        :param source: the source to be removed. If it was removed before, this method only pulls.

        :meta private:
        """
        try:
            self.update()
        finally:
            with self._lock:
                if source in self._sources:
                    i = self._sources.index(source)
                    self._sources = self._sources[:i] + self._sources[i + 1:]
                    self._notify_waiters()  # blocked lookups end if no source is left

    def update(self) -> int:
        """
        Pull: insert what the sources have received, unless this thread already holds the lock.

        :returns: the generation, a number that grows with each insertion.
        """
        is_nested = self._lock._is_owned()
        with self._lock:
            if not is_nested:
                self.pull()
            return self._generation

    def pull(self) -> None:
        """
        Insert what the sources have received.

        The caller must have taken the lock, and its thread must not have held the lock before.

        :meta private:
        """
        for source in self._sources:
            batches = source.take()
            if batches:
                self._insertion.insert_batches(batches)
                self._notify_waiters()
                batches.clear()

    def _notify_waiters(self) -> None:
        """Increment the generation, and wake the blocked lookups."""
        self._generation += 1
        for queue in tuple(self._queues):
            queue.put(self._generation)

    def insert(self, stamp: int, frame_id: str, child_frame_id: str, pose: Pose,
               authority: str = 'default_authority', is_static: bool = False) -> bool:
        """
        Insert the pose of a frame in its parent.

        One leading slash is removed from each name, and the rotation is normalised.

        :param stamp: time of the pose (ns).
        :param frame_id: the name of the parent.
        :param child_frame_id: the name of the frame.
        :param pose: x, y, z (m) and the quaternion x, y, z, w.
        :param authority: the name of the publisher; `frames` returns this name.
        :param is_static: True if the pose holds at all times.
        :returns: False if the transform was refused; the log says why.
        :raises TypeError: if a name is not a str, the stamp is not an integer, or the pose is
            not a sequence of numbers.
        :raises ValueError: if the pose does not have seven numbers.
        :raises OverflowError: if the stamp does not fit in an int64.
        """
        if not (isinstance(frame_id, str) and isinstance(child_frame_id, str)):
            raise TypeError(f'a frame id must be a str, got {frame_id!r} and {child_frame_id!r}')
        stamp = index(stamp)
        if not -_INT64 <= stamp < _INT64:
            raise OverflowError(f'a stamp must be an int64 (ns), got {stamp}')
        x, y, z, qx, qy, qz, qw = array('d', pose)
        pose = x, y, z, qx, qy, qz, qw
        if self._sources:
            self.update()  # messages that arrived before this call are inserted first
        with self._lock:
            is_accepted = self._insertion.insert(stamp, frame_id, child_frame_id, pose, authority,
                                                 is_static)
            if is_accepted:
                self._notify_waiters()
        self.after_insertion()
        return is_accepted

    def insert_batches(self, batches: Iterable[BatchOrRows]) -> None:
        """
        Insert the transforms of many messages, much faster than by one `insert` per transform.

        :param batches: objects of the types `Batch` and `Rows`, as `MessageReader.read` returns
            them.

        :meta private:
        """
        self.update()
        with self._lock:
            self._insertion.insert_batches(batches)
            self._notify_waiters()
        self.after_insertion()

    def after_insertion(self) -> bool:
        """
        Log why transforms were refused, and make the waiters check what is available.

        Call this without holding the lock of the buffer, if possible.

        :returns: True if the executor that spins the node of a listener must be woken.

        :meta private:
        """
        self._insertion.log.flush()
        is_urgent, error = False, None
        for waiter in self._waiters:
            try:
                is_urgent |= waiter.is_waiting and waiter.check()
            except BaseException as raised:  # raised by a done callback of a future
                error = raised
        if error is not None:
            raise error
        return is_urgent

    def add_waiter(self, waiter: Waiter) -> None:
        """
        Add a waiter, which `after_insertion` then checks.

        :param waiter: the waiter.

        :meta private:
        """
        with self._lock:
            self._waiters += (waiter,)

    def remove_waiter(self, waiter: Waiter) -> None:
        """
        Remove a waiter.

        :param waiter: the waiter; if it was removed before, nothing happens.

        :meta private:
        """
        with self._lock:
            self._waiters = tuple(each for each in self._waiters if each is not waiter)

    def clear(self) -> None:
        """Remove all dynamic transforms; static ones and the names of all frames stay."""
        self._update_for_user()  # so that messages that have arrived are removed, too
        with self._lock:
            try:
                self._tree.clear()
            finally:
                self._lookups.paths.clear()

    # Lookups, and waiting for transforms

    def _pull_and_call(self, lookup: Callable[..., _Result], *arguments: Any) -> _Result:
        """Pull, unless this call is nested; then take the lock, and call a lookup."""
        if self._sources:
            self._update_for_user()
        with self._lock:
            return lookup(*arguments)

    def _update_for_user(self) -> None:
        """
        Pull in a user's thread.

        If there are new data while a waiter waits, wake the sources, so that the threads of the
        listeners call `after_insertion`.
        """
        before = self._generation
        if self.update() > before and any(waiter.is_waiting for waiter in self._waiters):
            self.wake_sources()

    def fetched(self) -> AbstractContextManager[Any]:
        """
        Insert the messages that have arrived, and return a context manager that holds the lock.

        So all lookups in the block of `with buffer.fetched():` see the same state of the buffer.

        :returns: a context manager; use it without `as`.
        """
        self._update_for_user()
        lock: AbstractContextManager[Any] = self._lock
        return lock

    def is_held(self) -> bool:
        """
        Return whether this thread holds the lock, as in a block of `fetched`.

        :returns: True if this thread holds the lock.

        :meta private:
        """
        return bool(self._lock._is_owned())

    @property
    def has_waiters(self) -> bool:
        """
        True if a blocked lookup or a waiter waits for a transform.

        :meta private:
        """
        return bool(self._queues) or any(waiter.is_waiting for waiter in self._waiters)

    def wake_sources(self) -> None:
        """
        Wake the sources, so that their threads update the buffer now, and do not pause.

        :meta private:
        """
        for source in self._sources:
            source.wake()

    def _liveness(self) -> tuple[bool, ...]:
        """Return flags; a blocked lookup ends when one of the flags changes from True to False."""
        return (bool(self._sources),)

    def _wait(self, timeout: float, lookup: Callable[..., _Result], *arguments: Any) -> _Result:
        """
        Repeat a lookup whenever data arrive, until the lookup succeeds or the timeout is over.

        A nested call does not wait.

        :param timeout: how long to wait at most (s), on the wall clock.
        :raises TransformException: the last error of the lookup, if the timeout is over or a flag
            of `_liveness` has changed to False.
        """
        try:
            return self._pull_and_call(lookup, *arguments)
        except TransformException:
            if timeout <= 0.0 or self.is_held():
                raise
        deadline, before = monotonic() + timeout, self._liveness()
        queue: SimpleQueue[int] = SimpleQueue()
        try:
            self._queues.add(queue)
            self.wake_sources()
            while True:
                # Read the flags before the attempt. If no source is left at this moment, all data
                # of the removed sources are in the buffer. The attempt uses these data, so it can
                # be the last one.
                flags = self._liveness()
                self._update_for_user()
                with self._lock:
                    try:
                        return lookup(*arguments)
                    except TransformException:
                        if monotonic() >= deadline or any(
                                was and not is_now for was, is_now in zip(before, flags)):
                            raise
                        seen = self._generation
                next_attempt = min(deadline, monotonic() + _RETRY_INTERVAL)
                with suppress(Empty):
                    while queue.get(timeout=max(0.0, next_attempt - monotonic())) <= seen:
                        pass
        finally:
            self._queues.discard(queue)

    def _why_not(self, timeout: float, check: Callable[..., None], *arguments: Any
                 ) -> Optional[TransformException]:
        """
        Wait until a check passes, that is, raises no TransformException.

        :param timeout: how long to wait at most (s), on the wall clock.
        :returns: the last error, or None if the check has passed.
        """
        try:
            self._wait(timeout, check, *arguments)
        except TransformException as error:
            return error
        return None

    # Queries

    def why_not(self, target_frame: str, source_frame: str, time: int) -> str:
        """
        Return why there is no transform.

        :param target_frame: the target frame.
        :param source_frame: the source frame.
        :param time: time of the transform (ns); 0: the latest time for which every edge on the
            path has data.
        :returns: the text of the error; '' if there is a transform.
        :raises TypeError: if a frame is not a str.
        """
        return str(self._why_not(
            0.0, self._lookups.check, target_frame, source_frame, time) or '')

    def lookup_transforms(self, target_frame: str, source_frame: str, times: ArrayLike
                          ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """
        Return the poses of the source frame in the target frame at many times.

        If `times` has more than 2048 elements, it is looked up in parts. Between two parts, new
        data may be inserted.

        :param target_frame: the frame in which the results are expressed.
        :param source_frame: the frame whose poses are looked up.
        :param times: (n,) integers: the times (ns); 0: the latest time for which every edge on the
            path has data.
        :returns: three arrays. The first is (n, 3) float64: the translations x, y, z (m). The
            second is (n, 4) float64: the quaternions x, y, z, w. The third is (n,) bool: True
            where there is a transform. Where the third array is False, `lookup_transform` would
            raise a TransformException, and the first two arrays contain NaN.
        :raises TypeError: if the times are not integers, or if a frame is not a str.
        :raises OverflowError: if a time is too large for an int64.
        :raises ValueError: if the shape of `times` is not (n,).
        """
        times = _int64_times(times)
        order = np.argsort(times, kind='stable')  # sorted times are found faster in a history
        poses, known = np.empty((len(times), 7)), np.empty(len(times), np.bool_)
        for begin in range(0, len(times), _CHUNK):
            part = order[begin:begin + _CHUNK]
            poses[part], known[part] = self._pull_and_call(
                self._lookups.poses, target_frame, source_frame, times[part])
        return poses[:, :3], poses[:, 3:], known

    def availability(self, target_frame: str, source_frame: str, times: Sequence[int]
                     ) -> tuple[list[bool], int]:
        """
        Return at which times there is a transform; much faster than one `can_transform` per time.

        :param target_frame: the target frame.
        :param source_frame: the source frame.
        :param times: the times (ns); 0: the latest time for which every edge on the path has data.
        :returns: two values. The first is a list with one bool for each time: True if
            `lookup_transform` would return a transform. The second is a time (ns): a transform for
            an earlier time, other than 0, that is not available now will never be available. Such
            a time is older than the latest common time by more than the cache time.
        :raises TypeError: if a frame is not a str.
        """
        available, latest = self._pull_and_call(
            self._lookups.available, target_frame, source_frame, times)
        return available, latest - self._tree.cache_time if latest else -_INT64

    def lookup_twist(self, target_frame: str, source_frame: str, time: Any, interval: Any
                     ) -> Twist:
        """
        Return the velocity of the source frame as seen in the target frame.

        The result is the average over an interval around `time`. If the data end within this
        interval, the interval of the same length that ends with the data is used instead. During
        the interval, the source frame must turn by less than 180 degrees.

        :param target_frame: the frame in which the velocity is measured and expressed.
        :param source_frame: the frame that moves. Its origin is the reference point of the linear
            velocity.
        :param time: the middle of the interval (ns, or a time of ROS); 0: the interval ends at the
            latest time for which every edge on the path has data.
        :param interval: the length of the interval (ns, or a duration of ROS).
        :returns: the linear velocity of the origin of the source frame (m/s) and the angular
            velocity of the source frame (rad/s), both in the axes of the target frame.
        :raises TransformException: if there is no transform at the beginning or the end of the
            interval; the type of the exception says why.
        :raises TypeError: if a frame is not a str, or the time or the interval has a wrong type.
        :raises ValueError: if the interval is not longer than 0.
        """
        return self._pull_and_call(
            twist, self._lookups, target_frame, source_frame, nanoseconds_or_int(time),
            nanoseconds_or_int(interval, 'interval'))

    def lookup_all(self, target_frames: Iterable[str], until: int = 0,
                   children: Optional[Container[str]] = None) -> list[dict[str, Transform]]:
        """
        Return, for each target frame, the poses of all frames that are connected to it.

        Each pose is valid at the latest time for which every edge on its path has data. Except for
        rounding, `lookup_transform` at that time returns the same pose. If the transforms on the
        paths have the same stamps, this method is much faster than one lookup for each frame.

        :param target_frames: the frames in which the results are expressed.
        :param until: the latest time (ns) at which a pose may be valid. The paths follow the
            parents that the frames had at this time. 0: there is no limit, and the paths follow
            the newest parents.
        :param children: the paths use only the transforms of these frames from their parents;
            None: of all frames.
        :returns: for each target frame, a dict from the name of each connected frame to its
            transform. The nearest frames, counted in edges, come first. Frames without a transform
            are left out.
        :raises TransformException: if a target frame does not exist.
        :raises TypeError: if `target_frames` is a str.
        """
        if isinstance(target_frames, str):
            raise TypeError('target_frames must be names in a list or another iterable, got '
                            f'{target_frames!r}')
        targets = list(target_frames)
        return [{name: Transform(time, target, name, pose[:3], pose[3:])
                 for name, (time, pose) in placed.items()}
                for target, placed in zip(targets, self._pull_and_call(
                    self._lookups.all_poses, targets, until, children))]

    def chain(self, target_frame: str, source_frame: str) -> list[str]:
        """
        Return the names of the frames on the path between two frames.

        The path follows the parents that the frames had at the latest time for which every edge on
        the path has data.

        :param target_frame: the last frame of the chain.
        :param source_frame: the first frame of the chain.
        :returns: the names, from the source frame to the target frame.
        :raises TransformException: if there is no such path; the type of the exception says why.
        """
        return self._pull_and_call(
            self._lookups.chain, target_frame, 0, source_frame, 0, source_frame)

    def path_stamps(self, target_frame: str, source_frame: str) -> NDArray[np.int64]:
        """
        Return the stamps of the samples of all edges on the path between two frames.

        If frames have changed their parents, the path at each time is the one that followed the
        parents of this time. There need not be a transform at each of the stamps: an edge may have
        data before another edge has any. Note that a lookup for time 0 returns the latest
        transform, and not the one of a stamp 0.

        :param target_frame: the frame at one end of the path.
        :param source_frame: the frame at the other end.
        :returns: (n,) int64: the stamps (ns), in increasing order, each of them once; empty if all
            edges are static, or if both frames are the same.
        :raises TransformException: if a frame does not exist, or if there is no path at any time;
            the class of the error says which.
        :raises TypeError: if a frame is not a str.
        """
        return self._pull_and_call(self._lookups.stamps, target_frame, source_frame)

    def frame_names(self) -> list[str]:
        """
        Return the names of all frames, roots included.

        :returns: the names, in the order in which they first appeared.
        """
        return self._pull_and_call(list, self._tree.histories)

    def frames(self, until: int = 0) -> list[Frame]:
        """
        Return the parent, publisher and stamps of every frame that has a parent.

        :param until: use only samples up to this time (ns); 0: use all samples.
        :returns: one `Frame` for each frame with such samples, in the order of `frame_names`.
        """
        states = self._pull_and_call(self._tree.states, until)
        return [Frame(name, *state) for name, state in states]

    def all_frames_as_yaml(self) -> str:
        """
        Return, as YAML in tf2's format, all frames that have a parent.

        :returns: the YAML; '[]' if there has never been a frame.
        """
        listed = self.frames()
        return frames.as_yaml(listed) if self._tree.histories else '[]'

    def all_frames_as_string(self) -> str:
        """
        Return, as text in tf2's format, the frames and their parents.

        :returns: one line for each frame that has had a parent.
        """
        return frames.as_string(self._pull_and_call(self._tree.newest_edges))

    def dump(self) -> dict[str, dict[str, Any]]:
        """
        Return all data of the buffer, as lists and dicts that `json` can write.

        :returns: a dict from the name of each frame to a dict with five keys. Three keys have a
            list with one item for each sample, in the order of the stamps: an item of `parents` is
            a name, an item of `stamps` is an int (ns), and an item of `poses` is a list of 7
            float: x, y, z (m) and the quaternion x, y, z, w. `authority` is the publisher of the
            sample that was inserted last, and `is_static` is a bool. A static frame has one
            sample, with stamp 0. A frame that has occurred only as a parent has no samples.
        """
        return self._pull_and_call(self._tree.dump)

    # Forks

    def hold_for_fork(self, timeout: float) -> bool:
        """
        Take the lock, so that no other thread changes the data while the process forks.

        :param timeout: how long to wait for the lock at most (s).
        :returns: False if another thread still holds the lock.

        :meta private:
        """
        return bool(self._lock.acquire(timeout=timeout))

    def release_after_fork(self) -> None:
        """
        Release the lock that `hold_for_fork` has taken.

        :meta private:
        """
        self._lock.release()

    def after_fork_in_child(self, was_held: bool) -> None:
        """
        Drop the sources, the waiters and the queues of blocked lookups.

        They work in the parent process only.

        In the child process, there is only one thread, and the middleware does not work. So
        lookups use the data that the buffer had when the process forked.

        :param was_held: True if the lock was taken before the fork. If it is False, another thread
            may have been changing the data, so all dynamic transforms are dropped.

        :meta private:
        """
        self._sources, self._waiters = (), ()
        self._queues.clear()
        if not was_held:
            self._lock = RLock()
            self._tree.clear()
            self._lookups.paths.clear()


def debug_tuple(error: Optional[TransformException]) -> tuple[bool, str]:
    """
    Return the debug tuple of can_transform.

    :param error: the error of the check, or None if there is a transform.
    :returns: (True, '') if there is no error; otherwise False and the text of the error.
    """
    return error is None, '' if error is None else str(error)


def _int64_times(times: ArrayLike) -> NDArray[np.int64]:
    """
    Convert times to an array of int64.

    :param times: (n,) integers (ns).
    :raises TypeError: if the times are not integers.
    :raises OverflowError: if a time is too large for an int64.
    :raises ValueError: if the shape is not (n,).
    """
    times = np.asarray(times)
    if times.ndim != 1:
        raise ValueError(f'times must be of shape (n,), got {times.shape}')
    if times.size and times.dtype.kind not in 'iu':
        raise TypeError(f'times must be integers (ns), got {times.dtype}')
    if times.size and times.max() > np.iinfo(np.int64).max:
        raise OverflowError(f'times must be int64 (ns), got {times.max()}')
    return times.astype(np.int64)
