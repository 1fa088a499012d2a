"""The buffer: all that was published, looked up by frame and by time, as tf2 answers; no ROS."""

from _thread import interrupt_main
from collections.abc import Callable, Iterable
from contextlib import suppress
import os
from threading import RLock, Timer
from time import monotonic
from typing import Any, Optional, TypeVar, Union
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dummy_arm.tf import frames
from dummy_arm.tf.blocking_waits import BlockingWaits
from dummy_arm.tf.exceptions import TransformException
from dummy_arm.tf.frames import Frame
from dummy_arm.tf.history import Pose
from dummy_arm.tf.intake import Intake
from dummy_arm.tf.lookup import Lookups, Source
from dummy_arm.tf.message_reader import MessageReader, Run
from dummy_arm.tf.times import int64_times, nanoseconds_or_int, SECOND
from dummy_arm.tf.transform import Transform

_Answer = TypeVar('_Answer')

#: Every buffer, by its id.
_buffers: 'WeakValueDictionary[int, BufferCore]' = WeakValueDictionary()
#: Held while the process forks; then, for each fork that is under way, the buffers that are held.
_forking = RLock()
_forks: list['_Fork'] = []
#: How long a fork waits for the locks of buffers at most (s), and for one of them at a time.
_PATIENCE, _TRY = 5.0, 0.02


class BufferCore:
    """
    Transforms as they came in, for as long as the cache time, and lookups among them.

    Frames are names without a leading slash. A time is an int of ns, or what has `sec` and
    `nanosec`, or `nanoseconds`; 0 stands for the latest time that all frames on the way know of.
    Any number of threads may look up and insert; each sees a transform whole or not at all.

    A lookup raises a TransformException: LookupException for an unknown frame or a loop,
    InvalidArgumentException for an empty name or one with a leading slash, ConnectivityException
    for frames of two trees, ExtrapolationException where an edge on the way has no data for the
    time. A frame in itself is the identity, even if it is unknown.
    """

    _nanoseconds: Callable[..., int] = staticmethod(nanoseconds_or_int)

    def __init__(self, cache_time: Any = 10 * SECOND, *, max_frames: int = 100_000,
                 max_samples: Optional[int] = 10_000_000) -> None:
        """
        Begin empty.

        :param cache_time: a duration, as times are given; what is that much older than the
            newest transform of its frame is forgotten.
        :param max_frames: how many frames there may be; transforms with more are refused.
        :param max_samples: how many transforms of moving frames are kept at most, 60 to 100 bytes
            each. When there are more, a frame that gets one drops its oldest. Of one frame, at
            most 10 000 are kept per second of cache time. None: neither limit holds.
        :raises ValueError: when the cache time is negative, or max_samples is less than 1.
        """
        cache_time = nanoseconds_or_int(cache_time, 'cache_time')
        if cache_time < 0:
            raise ValueError(f'cache_time must not be negative, got {cache_time} ns')
        if max_samples is not None and max_samples < 1:
            raise ValueError(f'max_samples must be at least 1, or None, got {max_samples}')
        self._lookups = Lookups(cache_time)
        #: Held while the data are looked at or changed; reentrant.
        self.lock = self._lookups.lock
        #: By `with`: what has arrived by now is there, and nothing more to the end of the block.
        self.fetched = self._lookups.fetched
        self._waiting = BlockingWaits(self.lock)
        self._intake = Intake(self._lookups, max_frames, max_samples)
        _buffers[id(self)] = self

    def set_transform(self, transform: Transform, authority: str = 'default_authority') -> bool:
        """
        Insert the pose that a frame has at the transform's stamp.

        :param authority: who says so; shown by `frames`.
        :returns: False when it was refused, as tf2 refuses it; the log says why.
        """
        return self._set(transform, authority, False)

    def set_transform_static(self, transform: Transform, authority: str = 'default_authority'
                             ) -> bool:
        """Insert the pose that a frame has at all times; else as `set_transform`."""
        return self._set(transform, authority, True)

    def _set(self, transform: Transform, authority: str, is_static: bool) -> bool:
        if not isinstance(transform, Transform):
            raise TypeError('a BufferCore takes a Transform (and a Buffer a TransformStamped), '
                            f'got {type(transform).__name__}')
        return self.insert(transform.stamp, transform.frame_id, transform.child_frame_id,
                           (*transform.translation, *transform.rotation), authority, is_static)

    def insert(self, stamp: int, frame_id: str, child_frame_id: str, pose: Pose,
               authority: str = 'default_authority', is_static: bool = False) -> bool:
        """
        Insert the pose of a frame in its parent; one leading slash is removed from both names.

        :param stamp: ns.
        :param pose: x, y, z (m) and the rotation's x, y, z, w, which is normalised.
        :returns: False when it was refused, as tf2 refuses it; the log says why.
        :raises TypeError: when a name is no str, or a number none.
        :raises ValueError: when the pose is of another length.
        :raises OverflowError: when a stamp is no int64.
        """
        self._lookups.update()  # what was sent before comes in before
        taken = self._intake.insert(stamp, frame_id, child_frame_id, pose, authority, is_static)
        self._intake.refusals.log_all()
        if taken:
            self.on_new_data()
        return taken

    def insert_messages(self, messages: Iterable[bytes], reader: MessageReader,
                        authority: str = 'default_authority', is_static: bool = False) -> None:
        """
        Insert the transforms of TFMessages as they are on the wire, at a fraction of the cost.

        Afterwards, and without the lock, call `on_new_data`: it wakes those who wait for a
        transform, and logs what was refused, and why.

        :param reader: one for each topic; it tells of messages that are none.
        """
        for piece in reader.read(messages, only_rows=is_static):
            if isinstance(piece, Run):
                self._intake.insert_run(piece, authority)
                continue
            for row in piece:
                self._intake.insert(row[0] * SECOND + row[1], row[2], row[3], row[4:], authority,
                                    is_static)

    def on_new_data(self) -> bool:
        """Wake those who wait for a transform; tell whether a future is done now."""
        self._intake.refusals.log_all()
        self._waiting.notify()
        return False

    @property
    def is_waited_for(self) -> bool:
        """Whether somebody waits for a transform."""
        return bool(self._waiting)

    @property
    def is_held(self) -> bool:
        """Whether this thread holds the lock, as within a `fetched` block."""
        return self._lookups.is_held()

    def add_source(self, source: Source) -> None:
        """Fetch from a source before every lookup."""
        with self.lock:
            self._lookups.sources += (source,)

    def remove_source(self, source: Source) -> None:
        """Do not fetch from a source any more."""
        with self.lock:
            self._lookups.sources = tuple(
                other for other in self._lookups.sources if other is not source)
        self._waiting.notify()  # if it was the last, blocked lookups end

    def _hold(self, timeout: float) -> bool:
        """
        Take the lock, so that no other thread changes the data while the process forks.

        :param timeout: how long to wait for the lock at most (s).
        :returns: False when another thread has it still.
        """
        return self.lock.acquire(timeout=timeout)

    def _release(self) -> None:
        """Release the lock, so that other threads can change the data again."""
        self.lock.release()

    def _detach(self) -> None:
        """
        Drop what works in the parent process only: this one was forked.

        It has one thread, and the middleware does not work in it. So lookups answer from the data
        as of the fork.
        """
        for source in self._lookups.sources:
            with suppress(Exception):
                source.abandon()
        self._lookups.sources = ()
        self._waiting.forget()

    def _reset(self) -> None:
        """Forget what moves: in the parent, another thread was changing it during the fork."""
        self.lock._at_fork_reinit()  # type: ignore[attr-defined]
        self._lookups.clear()

    def clear(self) -> None:
        """Forget all but the names of the frames and what is static."""
        self._lookups.clear()

    def lookup_transform(self, target_frame: str, source_frame: str, time: Any = 0,
                         timeout: Any = 0) -> Transform:
        """
        Look up the pose of the source frame in the target frame.

        :param timeout: how long to wait for it at most, as times are given, on wall time.
        :returns: what takes points from the source frame to the target frame.
        :raises TransformException: see the class.
        """
        stamp, pose = self._waited(timeout, self._lookups.pose, target_frame, source_frame,
                                   self._nanoseconds(time))
        return Transform(stamp, target_frame, source_frame, pose[:3], pose[3:])

    def lookup_transform_full(self, target_frame: str, target_time: Any, source_frame: str,
                              source_time: Any, fixed_frame: str, timeout: Any = 0) -> Transform:
        """
        Look up the pose that the source frame had at its time, in the target frame at its own.

        :param fixed_frame: the frame in which things stay where they are between the two times.
        """
        stamp, pose = self._waited(
            timeout, self._lookups.pose_full, target_frame, self._nanoseconds(target_time),
            source_frame, self._nanoseconds(source_time), fixed_frame)
        return Transform(stamp, target_frame, source_frame, pose[:3], pose[3:])

    def lookup_transforms(self, target_frame: str, source_frame: str, times: ArrayLike
                          ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """
        Look up the poses of the source frame in the target frame at many times at once.

        :param times: (n,) integers, ns; 0: the latest common time.
        :returns: translations x, y, z (m), (n, 3); rotations x, y, z, w, (n, 4); and which of
            them are answers, (n,). Where `lookup_transform` would raise, the numbers are NaN.
        :raises TypeError: on times that are no integers.
        :raises OverflowError: on a time that is no int64.
        :raises ValueError: on another shape.
        """
        poses, known = self._lookups.poses(target_frame, source_frame, int64_times(times))
        return poses[:, :3], poses[:, 3:], known

    def can_transform(self, target_frame: str, source_frame: str, time: Any = 0,
                      timeout: Any = 0, return_debug_tuple: bool = False
                      ) -> Union[bool, tuple[bool, str]]:
        """
        Tell whether `lookup_transform` would give an answer.

        :param timeout: how long to wait for it at most, as times are given, on wall time.
        :returns: that; or, with `return_debug_tuple`, that and why not.
        """
        error = self._why_not(timeout, self._lookups.check, target_frame, source_frame,
                              self._nanoseconds(time))
        return debug_tuple(error) if return_debug_tuple else error is None

    def can_transform_full(self, target_frame: str, target_time: Any, source_frame: str,
                           source_time: Any, fixed_frame: str, timeout: Any = 0,
                           return_debug_tuple: bool = False) -> Union[bool, tuple[bool, str]]:
        """Tell whether `lookup_transform_full` would give an answer; as `can_transform`."""
        error = self._why_not(timeout, self._lookups.check_full, target_frame,
                              self._nanoseconds(target_time), source_frame,
                              self._nanoseconds(source_time), fixed_frame)
        return debug_tuple(error) if return_debug_tuple else error is None

    def _why_not(self, timeout: Any, check: Callable[..., None], *arguments: Any
                 ) -> Optional[TransformException]:
        try:
            self._waited(timeout, check, *arguments)
        except TransformException as error:
            return error
        return None

    def _waited(self, timeout: Any, lookup: Callable[..., _Answer], *arguments: Any) -> _Answer:
        return self._waiting.wait(self._nanoseconds(timeout, 'timeout') / SECOND,
                                  self._conditions, self._lookups.hurry, lookup, *arguments)

    def _conditions(self) -> tuple[bool, ...]:
        """Return conditions that end a wait when they held at its begin and hold no longer."""
        return (bool(self._lookups.sources),)

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> int:
        """
        Find the latest time (ns) that all frames between two know of; 0 when nothing moves.

        :raises TransformException: see the class.
        """
        return self._lookups.latest_common_time(target_frame, source_frame)

    def frames(self, until: int = 0) -> list[Frame]:
        """List the frames with a parent, in the order of their naming; of a time (ns), or now."""
        with self.fetched():
            states = self._lookups.tree.states(until)
        return [Frame(name, *state) for name, state in states]

    def all_frames_as_yaml(self) -> str:
        """Write tf2's YAML of all frames; '[]' when none was ever named."""
        listed = self.frames()
        return frames.as_yaml(listed) if self._lookups.tree.histories else '[]'

    def all_frames_as_string(self) -> str:
        """Write a line for every frame, with its parent."""
        with self.fetched():
            edges = self._lookups.tree.newest_edges()
        return frames.as_string(edges)


class _Fork:
    """
    The buffers of a process that forks.

    As `logging` does, their locks are taken before a fork and released after it on both sides: in
    the child, nobody would release those of other threads.
    """

    def __init__(self) -> None:
        """Create without a lock taken."""
        self._buffers = [buffer for reference in _buffers.valuerefs() if (buffer := reference())]
        self.held: list[BufferCore] = []
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
        Take the locks, and insert what has arrived, since the child cannot.

        A thread that has one of the locks may be waiting for another, so to keep some of them
        would block both.

        :param is_last: go on where one cannot be had.
        :returns: whether all were taken.
        """
        for i, buffer in enumerate(self._buffers):
            is_within_block = buffer.is_held
            if buffer._hold(_TRY):
                self.held.append(buffer)
                if not is_within_block:
                    with suppress(Exception):
                        buffer._lookups.fetch()
            elif not is_last:
                self._buffers.insert(0, self._buffers.pop(i))  # next time, wait for it with none
                return False
        return True

    def release(self) -> None:
        """Release the locks."""
        while self.held:
            self.held.pop()._release()

    def detach(self) -> None:
        """Leave to the child what works in it."""
        held = set(map(id, self.held))
        for buffer in self._buffers:
            buffer._detach()
            if id(buffer) not in held:
                buffer._reset()


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
    fork.detach()
    fork.release()
    _forking.release()


if hasattr(os, 'register_at_fork'):  # not on Windows
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork_in_parent,
                        after_in_child=_after_fork_in_child)


def debug_tuple(error: Optional[TransformException]) -> tuple[bool, str]:
    """Tell whether there is no error, and its text."""
    return error is None, '' if error is None else str(error)
