"""A buffer that needs no ROS: it stores and looks up transforms, with the results of tf2."""

from collections.abc import Mapping
import sys
from typing import Any, Optional

from puretf._core.buffer_base import BufferBase
from puretf._core.engine import engine_of
from puretf._core.history import load
from puretf._core.pose import Pose
from puretf._text.times import SECOND
from puretf.exceptions import described
from puretf.transform import Transform

#: How long buffers keep transforms by default (ns), as tf2 does.
CACHE_TIME = 10 * SECOND


class TransformBuffer(BufferBase[Any, Any, Transform]):
    """
    A buffer that keeps transforms for the cache time, and looks up the poses of frames.

    A time or a duration is an int (ns), a datetime64 or timedelta64 of numpy, or an object that
    has either the attribute `nanoseconds` or the attributes `sec` and `nanosec`. `BufferBase` says
    what all buffers have in common.
    """

    def __init__(self, cache_time: Any = CACHE_TIME, *, max_frames: int = 100_000,
                 max_samples: Optional[int] = 10_000_000) -> None:
        """
        Create an empty buffer.

        :param cache_time: how long samples are kept (ns); None: for ever. A sample is the pose of
            a frame in its parent at one stamp. A sample is dropped when it is older than the
            newest sample of the same frame by more than `cache_time`.
        :param max_frames: the largest number of frames; a transform that would add another frame
            is refused.
        :param max_samples: the largest number of dynamic samples of all frames together; a sample
            takes 60 to 100 bytes. At this limit, a new sample replaces the oldest sample of the
            same frame. There is also a limit for each single frame: 10 000 samples for each second
            of the cache time. None: neither of these two limits applies.
        :raises TypeError: if the cache time is not a duration.
        :raises ValueError: if the cache time is negative, or `max_samples` is less than 1.
        """
        super().__init__(2**64 if cache_time is None else cache_time, max_frames, max_samples)
        self._engine.tree.takes_ns = True

    @classmethod
    def copy_of(cls, buffer: BufferBase[Any, Any, Any]) -> 'TransformBuffer':
        """
        Return a copy of a buffer, without limits of the number of frames and samples.

        :raises TypeError: if the buffer is none of puretf.
        """
        engine = engine_of(buffer)
        copy = cls(engine.tree.cache_time, max_frames=sys.maxsize, max_samples=None)
        with engine.reading():
            copy._engine.tree.copy(engine.tree)
        return copy

    @classmethod
    def load(cls, dump: Mapping[str, Mapping[str, Any]]) -> 'TransformBuffer':
        """
        Return a buffer with the data that `dump` has returned, perhaps read from JSON.

        It keeps all samples.

        :raises TypeError: if `dump` is not a dict.
        :raises ValueError: if the data are not those of `dump`.
        """
        if not isinstance(dump, Mapping):
            raise TypeError(f'dump must be what dump() has returned, got {described(dump)}')
        buffer = cls(None, max_frames=sys.maxsize, max_samples=None)
        for name, frame in dump.items():
            try:
                buffer._engine.tree.histories[name] = history = load(
                    frame, buffer._engine.tree.cache_time)
                parents = () if history is None else history.all_parents
                if not isinstance(name, str) or name in ('', *parents) or any(
                        parent not in dump for parent in parents):
                    raise ValueError('a wrong name of the frame, or of a parent')
            except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
                raise ValueError(f'the data of the frame {name!r} are not those that dump() '
                                 f'returns: {error!r}') from None
        return buffer

    def set_transform(self, transform: Transform, authority: str = 'default_authority') -> bool:
        """
        Insert a dynamic transform: the pose of a frame at the transform's stamp.

        One leading slash is removed from each frame id.

        :param transform: the transform; its rotation is normalised.
        :param authority: the name of the publisher, shown by `frames`.
        :returns: False if the transform was refused, otherwise True. The log says why a transform
            was refused.
        :raises TypeError: if `transform` is not a Transform, or if a field of it has a wrong type.
        :raises ValueError: if the translation and the rotation do not have seven numbers in total.
        :raises OverflowError: if the stamp does not fit an int64.
        """
        return self._set(transform, authority, False)

    def set_transform_static(self, transform: Transform, authority: str = 'default_authority'
                             ) -> bool:
        """
        Insert a static transform: the pose of a frame at all times.

        The stamp of the transform is not used. See `set_transform` for the parameters.

        :returns: False if the transform was refused, otherwise True. The log says why a transform
            was refused.
        """
        return self._set(transform, authority, True)

    def _set(self, transform: Transform, authority: str, is_static: bool) -> bool:
        if not isinstance(transform, Transform):
            remedy = ': write Transform.from_message() around it' * hasattr(transform, 'header')
            raise TypeError('a TransformBuffer takes a Transform (a Buffer a TransformStamped), '
                            f'got {described(transform)}{remedy}')
        return self._engine.insert(
            transform.stamp, transform.frame_id, transform.child_frame_id,
            (*transform.translation, *transform.rotation), authority, is_static)

    def _answer(self, target: str, source: str, stamp: int, pose: Pose) -> Transform:
        return Transform(stamp, target, source, pose[:3], pose[3:])

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> int:
        """
        Return the latest time for which every edge on the path between two frames has data.

        :returns: the latest time (ns); 0 if all edges are static. If both frames are the same:
            the stamp of the newest sample of this frame, or 0 if the frame has no dynamic samples.
        :raises TransformException: if there is no path.
        :raises TypeError: if a frame is not a str.
        """
        with self._engine.reading():
            return self._engine.lookups.latest_common_time(target_frame, source_frame)
