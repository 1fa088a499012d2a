"""
What all buffers share: the lock, the sources, the data, and the threads that wait for data.

Theory of operation
===================

Nothing pushes transforms into a buffer. A buffer has sources, and it pulls what has arrived out of
them: whenever somebody looks up, and whenever a listener's thread calls `update`. So a lookup sees
every message that has arrived, although the thread may pause while messages come in fast.

    source.take() -> pieces -> Intake -> History         under the lock, by any thread
    lookup -> Lookups -> FrameTree -> Path -> pose       under the lock, by any thread

Threads. A listener has one thread. It waits in a wait set of the middleware; when it is woken it
calls `update` and then `after_insertion`, which needs no lock. Users' threads look up, insert and
wait. A thread in `waits` ends futures whose time is up. No thread waits for another but in
`TransformListener.unregister`, which joins the listener's thread for half a second at most.

The lock. A buffer has one lock, which is reentrant and only ever taken by `with`. While it is
held, no code of users runs, nothing is logged or joined, and no other lock of this package is
taken; only a block of `with buffer.fetched()` may do all that, and is the user's affair.
`_is_nested` is True while this thread is inside of the buffer: in a block of `fetched`, or in a
call that a signal handler or a weakref callback has interrupted. A nested call answers from the
data as they are: it does not update, and it does not wait.

What a lookup sees. `_look` takes the lock, takes from all sources (/tf_static first, as the
broadcaster of a static transform sends it before those that build on it), inserts, and looks up.
All of that is one step for other threads, so a lookup never sees half of a message.

Nothing is lost. `Source.take` returns a list that the source keeps. `update` empties it after the
insertion, so that after a KeyboardInterrupt in between, the next update inserts it once more; a
sample that is there already is not inserted again. `History` keeps its lists in step.

Who wakes whom. Each insertion increments `generation`.
- A blocked lookup has a queue, into which each insertion puts the generation. It takes one out,
  ignores it unless it is newer than the data that it has looked at, and looks again. It is a
  `SimpleQueue`, since a KeyboardInterrupt inside of a `Condition` can leave a lock held. Before it
  blocks, it is registered first, then wakes the sources, which ends a pause of the listener's
  thread, and then looks up. In this order it cannot miss anything: either the thread sees that
  somebody waits and pauses no more, or the lookup has the data. It looks again after 0.2 s in any
  case, since nobody tells it that ROS was shut down.
- Futures are finished by `after_insertion`, without the lock since their callbacks are users':
  by the thread that has called `set_transform`, or by a listener's thread if the generation has
  changed. A lookup that inserts messages while futures wait does not finish them; it wakes the
  sources, so that a listener's thread does.
- The executor that spins the node is woken by the listener's thread: at once when a future was
  finished, for new data at most ten times a second, since that costs it 0.1 to 0.3 ms.

Shutdown. `remove_source` takes from the source once more, and drops it. A lookup that has begun to
wait while there was a source ends with its last error when there is none any more. The listener's
thread ends when its listener is unregistered, its node destroyed or its context shut down. Ctrl-C
raises KeyboardInterrupt in the main thread only; locks are released by `with`, a waiting lookup
removes its queue in `finally`, and what was taken stays in the list of its source.

Fork. As in the module `logging`, the locks of all buffers are held while the process forks, so
that no thread that is not there in the child holds them. The child has the data, but no sources,
no threads and no futures; see `forking`.
"""

from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from threading import RLock
from time import monotonic
from typing import Any, Optional, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dummy_arm.tf import forking, frames
from dummy_arm.tf.exceptions import TransformException
from dummy_arm.tf.frame_tree import FrameTree
from dummy_arm.tf.frames import Frame
from dummy_arm.tf.intake import Intake
from dummy_arm.tf.lookup import Lookups
from dummy_arm.tf.message_reader import MessageReader, Piece
from dummy_arm.tf.pose import Pose
from dummy_arm.tf.times import int64_times, nanoseconds_or_int
from dummy_arm.tf.transform import Transform

_Answer = TypeVar('_Answer')

#: A blocked lookup looks again after so long (s) without news.
_STEP = 0.2
#: So many poses are looked up at once, so that nobody waits long for the lock.
_CHUNK = 2048


class Source(Protocol):
    """What a buffer pulls transforms from."""

    def take(self) -> list[Piece]:
        """
        Return what has arrived, in a list that is kept; who has inserted it empties it.

        It is called with the lock of the buffer held. It does not block and calls nobody back.
        """

    def wake(self) -> None:
        """Have the thread of the source, if there is one, update the buffer now."""


class Engine:
    """The data of a buffer, with what is common to all kinds of buffers."""

    def __init__(self, cache_time: Any, max_frames: int, max_samples: Optional[int]) -> None:
        """
        Create an empty buffer.

        :param cache_time: as `BufferCore` has it, and so are the others.
        """
        cache_time = nanoseconds_or_int(cache_time, 'cache_time')
        if cache_time < 0:
            raise ValueError(f'cache_time must not be negative, got {cache_time} ns')
        if max_samples is not None and max_samples < 1:
            raise ValueError(f'max_samples must be at least 1, or None, got {max_samples}')
        self._lock = RLock()
        self._is_nested = False
        self._tree = FrameTree(cache_time)
        self._lookups = Lookups(self._tree)
        self._intake = Intake(self._tree, self._lookups, max_frames, max_samples)
        self._sources: tuple[Source, ...] = ()
        self._generation = 0
        #: One of each blocked lookup, for the generations.
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
        with self._lock:
            if source in self._sources:
                if not self._is_nested:  # a block sees nothing that comes in during it
                    self.update()
                self._sources = tuple(other for other in self._sources if other is not source)
                self._announce()  # blocked lookups, if it was the last one

    def update(self) -> int:
        """
        Insert what has arrived, unless this thread is inside of the buffer.

        :returns: a number that is larger after each insertion than before.
        """
        with self._lock:
            if not self._is_nested:
                self._is_nested = True
                try:
                    for source in self._sources:
                        pieces = source.take()
                        if pieces:
                            self._intake.insert_pieces(pieces)
                            pieces.clear()
                            self._announce()
                finally:
                    self._is_nested = False
            return self._generation

    def _announce(self) -> None:
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
        :raises TypeError: when a name is no str, or a number none.
        :raises ValueError: when the pose is of another length.
        :raises OverflowError: when a stamp is no int64.
        """
        with self._lock:
            if self._sources:
                self.update()  # what was sent before comes in before
            taken = self._intake.insert(stamp, frame_id, child_frame_id, pose, authority,
                                        is_static)
            if taken:
                self._announce()
        self.after_insertion()
        return taken

    def insert_messages(self, messages: Iterable[bytes], reader: MessageReader,
                        authority: str = 'default_authority', is_static: bool = False) -> None:
        """
        Insert the transforms of TFMessages as they are on the wire, at a fraction of the cost.

        :param reader: one for each topic; it reports malformed messages.
        :param authority: the publisher; shown by `frames`.
        :param is_static: whether the poses hold at all times.
        """
        pieces = reader.read(messages, authority, is_static)
        with self._lock:
            self._intake.insert_pieces(pieces)
            self._announce()
        self.after_insertion()

    def after_insertion(self) -> bool:
        """
        Log what was refused; a Buffer finishes its futures, too. The lock must not be held.

        :returns: whether a future was finished.
        """
        self._intake.refusals.log_all()
        return False

    def clear(self) -> None:
        """Forget all but the names of the frames and what is static."""
        with self._lock:
            self.update()  # so that nothing that was sent before comes in after this
            try:
                self._tree.clear()
            finally:
                self._lookups.forget_paths()

    # Looking and waiting

    def _look(self, lookup: Callable[..., _Answer], *arguments: Any) -> _Answer:
        """Insert what has arrived, unless this is nested, and look up."""
        with self._lock:
            if self._is_nested or not self._sources:
                return lookup(*arguments)
            before = self._generation
            if self.update() > before and len(self._futures):
                self._wake_sources()
            self._is_nested = True
            try:
                return lookup(*arguments)
            finally:
                self._is_nested = False

    @contextmanager
    def fetched(self) -> Iterator[None]:
        """Context manager: insert what has arrived, then hold the lock for one consistent view."""
        with self._lock:
            was_nested = self._is_nested
            self.update()
            self._is_nested = True
            try:
                yield
            finally:
                self._is_nested = was_nested

    def is_in_block(self) -> bool:
        """Return whether this thread is inside of the buffer, as in a `fetched` block."""
        with self._lock:
            return self._is_nested

    @property
    def is_waited_for(self) -> bool:
        """Whether a blocked lookup or a future waits for a transform."""
        return bool(self._queues) or len(self._futures) > 0

    def _wake_sources(self) -> None:
        for source in self._sources:
            source.wake()

    def _can_come(self) -> tuple[bool, ...]:
        """Return conditions; a wait ends when one held at its begin and holds no longer."""
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
            if timeout <= 0.0 or self.is_in_block():
                raise
        deadline, before = monotonic() + timeout, self._can_come()
        queue: SimpleQueue[int] = SimpleQueue()
        try:
            self._queues.add(queue)
            while True:
                now = self._can_come()  # before the lookup, which then sees the last data
                self._wake_sources()
                with self._lock:
                    try:
                        return self._look(lookup, *arguments)
                    except TransformException:
                        if monotonic() >= deadline or any(
                                held and not holds for held, holds in zip(before, now)):
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
        times = int64_times(times)
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
        """
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
        """Return all frames, also those without parent, in the order of their naming."""
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
        return self._lock.acquire(timeout=timeout)

    def release_after_fork(self) -> None:
        """Release the lock."""
        self._lock.release()

    def leave_parent(self, is_whole: bool) -> None:
        """
        Drop what works in the parent process only: this one was forked.

        It has one thread, and the middleware does not work in it. So lookups answer from the data
        as of the fork.

        :param is_whole: whether the lock was held; if not, another thread was changing the data,
            and everything that moves is dropped.
        """
        self._sources = ()
        self._queues.clear()
        if not is_whole:
            self._lock = RLock()
            self._is_nested = False
            self._tree.clear()
            self._lookups.forget_paths()


def debug_tuple(error: Optional[TransformException]) -> tuple[bool, str]:
    """Return whether there is no error, and its text."""
    return error is None, '' if error is None else str(error)
