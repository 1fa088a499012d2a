"""The base class of all buffers, with the methods that they share."""

from bisect import bisect_left
from collections.abc import Container, Iterable, Sequence
from contextlib import AbstractContextManager
from typing import Any, Generic, Literal, NoReturn, Optional, overload, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from puretf._core import frames, search, texts
from puretf._core.engine import Engine
from puretf._core.frames import Frame
from puretf._core.pose import matrices, Pose
from puretf._core.times import int64_times, nanoseconds_or_int
from puretf._core.velocity import twist
from puretf._text.times import longer_cache, SECOND
from puretf.exceptions import described, tf2_words, TransformException
from puretf.transform import Transform, Twist

#: The largest number of poses that are inserted or computed before the lock is released.
_CHUNK = 2500
_LATEST: Any = 0
_NO_WAIT: Any = 0
#: The types of a buffer: of the times and durations of its lookups, and what a lookup returns.
TimeT = TypeVar('TimeT')
DurationT = TypeVar('DurationT')
TransformT = TypeVar('TransformT')


class BufferBase(Generic[TimeT, DurationT, TransformT]):
    """
    The methods that all buffers share.

    Frame ids have no leading slash. An edge connects a frame with its parent; a path is the edges
    between two frames. In a lookup, time 0 means the latest time for which every edge on the path
    has data. All methods may be called in any thread.

    A lookup that fails raises a subclass of TransformException:

    - LookupException: a frame does not exist, its ancestors form a loop, or it has more than 1000
      ancestors.
    - InvalidArgumentException: a frame id is empty or has a leading slash.
    - ConnectivityException: the frames are in different trees.
    - ExtrapolationException: an edge on the path has no data for the requested time.

    If the target frame and the source frame are the same, `lookup_transform` returns the identity,
    even if the frame does not exist.
    """

    def __init__(self, cache_time: Any, max_frames: int, max_samples: Optional[int]) -> None:
        self._engine = Engine(cache_time, max_frames, max_samples)

    def insert(self, stamp: Any, frame_id: str, child_frame_id: str, pose: Pose,
               authority: str = 'default_authority', is_static: bool = False) -> bool:
        """
        Insert the pose of a frame in its parent, without an object for the transform.

        One leading slash is removed from each name, and the rotation is normalised.

        :param stamp: time of the pose (ns, or a time of ROS or numpy).
        :param frame_id: the parent.
        :param child_frame_id: the frame.
        :param pose: x, y, z (m) and the quaternion x, y, z, w.
        :param authority: the publisher, which `frames` returns.
        :param is_static: True if the pose holds at all times.
        :returns: False if the transform was refused; the log says why.
        :raises TypeError: if an argument has a wrong type.
        :raises ValueError: if the pose does not have seven numbers.
        :raises OverflowError: if the stamp does not fit in an int64.
        """
        return self._engine.insert(stamp, frame_id, child_frame_id, pose, authority, is_static)

    def insert_many(self, stamps: 'ArrayLike | Sequence[Any]', frame_id: str, child_frame_id: str,
                    poses: 'ArrayLike', authority: str = 'default_authority') -> bool:
        """
        Insert many poses of a frame in its parent; those within the cache time of the newest stay.

        The cache time is a parameter of the constructor: by default, only 10 s before the newest
        pose are kept; `TransformBuffer(cache_time=None)` keeps all. A call with poses that are
        older than that returns False; the log says once per frame how many they are.

        The poses are inserted in the order of their stamps, up to 2500 at once. This is much
        faster than one `insert` for each if they are newer than the poses that the buffer has of
        the frame, and if their stamps differ. Names and rotations are treated as in `insert`.

        :param stamps: (n,) times of the poses, as in `lookup_transforms`; not from 0 on.
        :param poses: (n, 7): x, y, z (m) and the quaternion x, y, z, w.
        :returns: False if some of them were refused or are not kept; the log says why.
        :raises TypeError: if an argument has a wrong type.
        :raises ValueError: if an array has a wrong shape, or a stamp is NaT.
        :raises OverflowError: if a stamp does not fit in an int64.
        """
        times = int64_times(stamps, 'stamps')
        try:
            rows = np.asarray(poses)
        except ValueError:  # rows of several lengths
            rows = np.empty(0, np.object_)
        if rows.dtype.kind not in 'fiu':
            raise TypeError(f'poses must be numbers, of shape ({len(times)}, 7), got '
                            f'{described(poses)}')
        if rows.shape != (len(times), 7) and len(times) + rows.size:
            raise ValueError(f'poses must be of shape ({len(times)}, 7), one for each stamp, got '
                             f'{rows.shape}')
        order, is_accepted = np.argsort(times, kind='stable'), True
        for begin in range(0, len(times), _CHUNK):
            part = order[begin:begin + _CHUNK]
            is_accepted &= self._engine.insert_many(
                times[part], frame_id, child_frame_id, rows[part].astype(np.float64), authority)
        tree, log = self._engine.tree, self._engine.insertion.log
        expired = len(order) > 1 and bisect_left(
            order, times.item(order[-2]) - tree.cache_time, key=times.item)
        left = 0  # how many do not fit
        with self._engine.lock:
            history = tree.histories.get(child_frame_id.removeprefix('/'))
            if is_accepted and history is not None and history.is_full:
                left = bisect_left(order, history.oldest, key=times.item)
        if lost := max(expired, left):
            log.warn('TF_EXPIRED', texts.expired(
                child_frame_id, lost, len(order), left > expired, tree.cache_time, longer_cache(
                    times.item(order[-1]) - times.item(order[0]), tree.takes_ns)), child_frame_id)
            log.flush(0.0)
        return is_accepted and not lost

    def remove(self, frame: str) -> None:
        """
        Remove all poses of a frame in its parents; its name stays while it is a parent itself.

        A frame that is only a parent stays as it is. A later transform brings a frame back.

        :raises TransformException: if the frame does not exist.
        :raises TypeError: if the frame is not a str.
        """
        self._engine.remove(frame)

    def clear(self) -> None:
        """Remove all dynamic transforms; static ones and the names of all frames stay."""
        self._engine.clear()

    def updated(self) -> AbstractContextManager[Any]:
        """
        Insert the messages that have arrived, and return a context manager that holds the lock.

        So all lookups in a block of `with buffer.updated():` see the same state of the buffer.
        They do not wait, even if they have a timeout.
        """
        return self._engine.reading()

    def lookup_transform(self, target_frame: str, source_frame: str, time: TimeT = _LATEST,
                         timeout: DurationT = _NO_WAIT) -> TransformT:
        """
        Return the pose of the source frame in the target frame.

        :param time: time of the transform; 0 or a zero Time: the latest time for which every edge
            on the path has data. The docstring of each class has the types of times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :returns: the transform from the source frame to the target frame, stamped with its time: a
            Transform of a `TransformBuffer`, a TransformStamped of the other buffers.
        :raises TransformException: if there is no such transform.
        :raises TypeError: if a frame, a time or the timeout has a wrong type.
        """
        stamp, pose = self._engine.wait(
            [time], self._seconds(timeout), self._engine.lookups.pose, target_frame, source_frame,
            0 if time is _LATEST else self._ns(time))
        return self._answer(target_frame, source_frame, stamp, pose)

    def lookup_transform_full(
            self, target_frame: str, target_time: TimeT, source_frame: str, source_time: TimeT,
            fixed_frame: str, timeout: DurationT = _NO_WAIT) -> TransformT:
        """
        Return the pose of the source frame at one time, in the target frame at another time.

        The source frame is located in the fixed frame at `source_time`, and the target frame is
        located in the fixed frame at `target_time`.

        :param target_time: time of the target frame; 0 or a zero Time: the latest time for
            which every edge between the target frame and the fixed frame has data.
        :param source_time: time of the source frame; 0 or a zero Time: the latest time for
            which every edge between the source frame and the fixed frame has data.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :returns: the transform from the source frame to the target frame, as `lookup_transform`
            returns it. Its stamp is the time of the target frame.
        :raises TransformException: if there is no such transform.
        :raises TypeError: if a frame, a time or the timeout has a wrong type.
        """
        stamp, pose = self._engine.wait(
            [target_time, source_time], self._seconds(timeout), self._engine.lookups.pose_full,
            target_frame, self._ns(target_time), source_frame, self._ns(source_time), fixed_frame)
        return self._answer(target_frame, source_frame, stamp, pose)

    @overload
    def can_transform(
            self, target_frame: str, source_frame: str, time: TimeT = _LATEST,
            timeout: DurationT = _NO_WAIT, return_debug_tuple: Literal[False] = False
            ) -> bool: ...

    @overload
    def can_transform(
            self, target_frame: str, source_frame: str, time: TimeT = _LATEST,
            timeout: DurationT = _NO_WAIT, return_debug_tuple: bool = False) -> Any: ...

    def can_transform(
            self, target_frame: str, source_frame: str, time: TimeT = _LATEST,
            timeout: DurationT = _NO_WAIT, return_debug_tuple: bool = False
            ) -> Union[bool, tuple[bool, str]]:
        """
        Return whether `lookup_transform` would return a transform.

        :param time: time of the transform; 0 or a zero Time: the latest time for which every edge
            on the path has data.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :param return_debug_tuple: True: return the text of the error, too.
        :returns: whether the transform is available. If `return_debug_tuple` is True: a tuple of
            this bool and the text of the error ('' if there is no error).
        :raises TypeError: if a frame, a time or the timeout has a wrong type.
        """
        error = self._error_of(
            [time], self._seconds(timeout), self._engine.lookups.check, target_frame,
            source_frame, 0 if time is _LATEST else self._ns(time))
        return _debug_tuple(error) if return_debug_tuple else error is None

    @overload
    def can_transform_full(
            self, target_frame: str, target_time: TimeT, source_frame: str, source_time: TimeT,
            fixed_frame: str, timeout: DurationT = _NO_WAIT,
            return_debug_tuple: Literal[False] = False) -> bool: ...

    @overload
    def can_transform_full(
            self, target_frame: str, target_time: TimeT, source_frame: str, source_time: TimeT,
            fixed_frame: str, timeout: DurationT = _NO_WAIT, return_debug_tuple: bool = False
            ) -> Any: ...

    def can_transform_full(
            self, target_frame: str, target_time: TimeT, source_frame: str, source_time: TimeT,
            fixed_frame: str, timeout: DurationT = _NO_WAIT, return_debug_tuple: bool = False
            ) -> Union[bool, tuple[bool, str]]:
        """
        Return whether `lookup_transform_full` would return a transform.

        :param target_time: time of the target frame; 0 or a zero Time: the latest time for
            which every edge between the target frame and the fixed frame has data.
        :param source_time: time of the source frame; 0 or a zero Time: the latest time for
            which every edge between the source frame and the fixed frame has data.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :param return_debug_tuple: True: return the text of the error, too.
        :returns: whether the transform is available. If `return_debug_tuple` is True: a tuple of
            this bool and the text of the error ('' if there is no error).
        :raises TypeError: if a frame, a time or the timeout has a wrong type.
        """
        error = self._error_of(
            [target_time, source_time], self._seconds(timeout), self._engine.lookups.check_full,
            target_frame, self._ns(target_time), source_frame, self._ns(source_time), fixed_frame)
        return _debug_tuple(error) if return_debug_tuple else error is None

    def why_not(self, target_frame: str, source_frame: str, time: Any, has_hint: bool = True
                ) -> str:
        """
        Return why there is no transform.

        :param time: time of the transform (ns, or a time of ROS or numpy), or 0.
        :param has_hint: False: return tf2's words only.
        :returns: the text of the error; '' if there is a transform.
        :raises TypeError: if a frame is not a str.
        """
        error = self._error_of(
            [time], 0.0, self._engine.lookups.check, target_frame, source_frame,
            nanoseconds_or_int(time))
        return '' if error is None else str(error) if has_hint else tf2_words(error)

    @overload
    def lookup_transforms(
            self, target_frame: str, source_frame: str, times: 'ArrayLike | Sequence[Any]',
            as_matrices: Literal[False] = False
            ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]: ...

    @overload
    def lookup_transforms(
            self, target_frame: str, source_frame: str, times: 'ArrayLike | Sequence[Any]',
            as_matrices: bool) -> Any: ...

    def lookup_transforms(
            self, target_frame: str, source_frame: str, times: 'ArrayLike | Sequence[Any]',
            as_matrices: bool = False) -> Any:
        """
        Return the poses of the source frame in the target frame at many times.

        More than 2500 times are looked up in parts; between two parts, new data may be inserted.

        :param times: (n,) integers (ns), datetime64, or times of ROS. 0 means the latest time, so
            data must not begin at 0: add a start time to their stamps.
        :param as_matrices: True: return homogeneous matrices.
        :returns: three arrays: (n, 3) float64 translations x, y, z (m), (n, 4) float64 quaternions
            x, y, z, w, and (n,) bool: True where there is a transform. Where it is False,
            `lookup_transform` would raise a TransformException, and the numbers are NaN. If
            `as_matrices` is True: (n, 4, 4) float64, for column vectors x, y, z, 1 (m); all 16
            numbers are NaN where there is no transform.
        :raises TypeError: if the times have a wrong type, or if a frame is not a str.
        :raises OverflowError: if a time does not fit in an int64 (ns).
        :raises ValueError: if the shape of `times` is not (n,), or a time is NaT.
        """
        times = int64_times(times, 'times')
        columns, known = np.empty((7, len(times))), np.empty(len(times), np.bool_)
        # Sorted times are found faster.
        order = None if (times[1:] >= times[:-1]).all() else np.argsort(times)
        for begin in range(0, len(times), _CHUNK):
            part: Any = slice(begin, begin + _CHUNK)
            part = part if order is None else order[part]
            with self._engine.reading():
                columns[:, part], known[part] = self._engine.lookups.poses(
                    target_frame, source_frame, times[part])
        if as_matrices:
            result = matrices(columns)
            result[~known] = np.nan
            return result
        return columns[:3].T, columns[3:].T, known

    def lookup_twist(self, target_frame: str, source_frame: str, time: Any, interval: Any
                     ) -> Twist:
        """
        Return the velocity of the source frame as seen in the target frame.

        The result is the average over an interval around `time`. If the data end within this
        interval, the interval of the same length that ends with the data is used instead. During
        the interval, the source frame must turn by less than 180 degrees.

        :param source_frame: the frame that moves. Its origin is the reference point of the linear
            velocity.
        :param time: the middle of the interval (ns, or a time of ROS or numpy); 0: the interval
            ends at the latest time for which every edge on the path has data.
        :param interval: the length of the interval (ns, or a duration of ROS or numpy).
        :returns: the linear velocity of the origin of the source frame (m/s) and the angular
            velocity of the source frame (rad/s), both in the axes of the target frame.
        :raises TransformException: if there is no transform at the beginning or the end of the
            interval.
        :raises TypeError: if a frame is not a str, or the time or the interval has a wrong type.
        :raises ValueError: if the interval is not longer than 0.
        """
        with self._engine.reading():
            return twist(self._engine.lookups, target_frame, source_frame,
                         nanoseconds_or_int(time), nanoseconds_or_int(interval, 'interval'))

    def lookup_all(self, target_frames: Iterable[str], until: Any = 0,
                   children: Optional[Container[str]] = None) -> list[dict[str, Transform]]:
        """
        Return, for each target frame, the poses of all frames that are connected to it.

        Each pose is valid at the latest time for which every edge on its path has data. If the
        transforms on the paths have the same stamps, this is much faster than single lookups.

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
                            f'{described(target_frames)}')
        targets = list(target_frames)
        with self._engine.reading():
            found = self._engine.lookups.all_poses(
                targets, nanoseconds_or_int(until, 'until'), children)
        return [{name: Transform(time, target, name, pose[:3], pose[3:])
                 for name, (time, pose) in placed.items()}
                for target, placed in zip(targets, found)]

    def chain(self, target_frame: str, source_frame: str) -> list[str]:
        """
        Return the names of the frames on the path from the source frame to the target frame.

        The path follows the parents that the frames had at the latest time for which every edge on
        the path has data.

        :raises TransformException: if there is no such path.
        """
        with self._engine.reading():
            return self._engine.lookups.chain(target_frame, 0, source_frame, 0, source_frame)

    def path_stamps(self, target_frame: str, source_frame: str) -> NDArray[np.int64]:
        """
        Return the stamps of the samples of all edges on the path between two frames.

        If frames have changed their parents, the path at each time is the one that followed the
        parents of this time. There need not be a transform at each of the stamps: an edge may have
        data before another edge has any. Note that a lookup for time 0 returns the latest
        transform, and not the one of a stamp 0.

        :returns: (n,) int64: the stamps (ns), in increasing order, each of them once; empty if all
            edges are static, or if both frames are the same.
        :raises TransformException: if a frame does not exist, or if there is no path at any time.
        :raises TypeError: if a frame is not a str.
        """
        with self._engine.reading():
            return search.stamps(self._engine.tree, target_frame, source_frame)

    def path_edges(self, target_frame: str, source_frame: str) -> list[search.PathEdge]:
        """
        Return the dynamic edges on the path between two frames, each with its stamps.

        If frames have changed their parents, an edge is returned once for each period in which it
        is on the path and no frame changes its parent. See `path_stamps`.

        :returns: tuples of the names `parent` and `child`, the times `begin` and `end` of the
            period (ns), and `stamps`, (n,) int64 (ns): those in the period, and one before and
            after it.
        :raises TransformException: if a frame does not exist, or if there is no path at any time.
        :raises TypeError: if a frame is not a str.
        """
        with self._engine.reading():
            return search.path_edges(self._engine.tree, target_frame, source_frame)

    def frame_names(self) -> list[str]:
        """Return the names of all frames, roots included, in the order of their first use."""
        with self._engine.reading():
            return [*self._engine.tree.histories]

    def frames(self, until: Any = 0) -> list[Frame]:
        """
        Return the parent, publisher and stamps of every frame that has a parent.

        :param until: use only samples up to this time (ns); 0: use all samples.
        :returns: one `Frame` for each frame with such samples, in the order of `frame_names`.
        """
        until = nanoseconds_or_int(until, 'until')
        with self._engine.reading():
            found = self._engine.tree.frames(until)
        return [frame for frame, _ in found]

    def all_frames_as_yaml(self) -> str:
        """Return all frames with a parent as YAML in tf2's format; '[]' if there is no frame."""
        listed = self.frames()
        return frames.as_yaml(listed) if self._engine.tree.histories else '[]'

    def all_frames_as_string(self) -> str:
        """Return one line of tf2's text for each frame that has had a parent."""
        with self._engine.reading():
            edges = self._engine.tree.newest_edges()
        return frames.as_string(edges)

    def dump(self) -> dict[str, dict[str, Any]]:
        """
        Return all data of the buffer, as lists and dicts that `json` can write.

        :returns: a dict from the name of each frame to a dict with six keys. Three keys have a
            list with one item for each sample, in the order of the stamps: an item of `parents` is
            a name, an item of `stamps` is an int (ns), and an item of `poses` is a list of 7
            float: x, y, z (m) and the quaternion x, y, z, w. `authority` is the publisher of the
            sample that was inserted last, `is_static` is a bool, and `arrived` the stamp (ns) of
            the transform that arrived last. A static frame has one sample, with stamp 0. A frame
            that has occurred only as a parent has no samples, and `arrived` is None. A frame whose
            samples `clear` has removed has none, either, and `arrived` is 0.
        """
        with self._engine.reading():
            return self._engine.tree.dump()

    def __getstate__(self) -> NoReturn:
        """Raise a TypeError: a buffer has a lock, and perhaps a listener."""
        raise TypeError(
            f'a {type(self).__name__} can be neither pickled nor copied: use its dump() and '
            'TransformBuffer.load(), or TransformBuffer.copy_of()')

    # A subclass says how a time is converted, and what a lookup returns.

    _ns: Any = staticmethod(nanoseconds_or_int)

    def _answer(self, target: str, source: str, stamp: int, pose: Pose) -> TransformT:
        raise NotImplementedError

    def _seconds(self, timeout: Any) -> float:
        return 0.0 if timeout is _NO_WAIT else float(self._ns(timeout, 'timeout') / SECOND)

    def _error_of(self, *arguments: Any) -> Optional[TransformException]:
        try:
            self._engine.wait(*arguments)
        except TransformException as error:
            return error
        return None


def _debug_tuple(error: Optional[TransformException]) -> tuple[bool, str]:
    """Return the debug tuple of can_transform: (True, ''), or False and the text of the error."""
    return error is None, '' if error is None else str(error)
