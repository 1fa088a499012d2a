"""The buffer without ROS: transforms by frame and by time, with tf2's answers."""

from typing import Any, Optional, Union

from dummy_arm.tf._core.engine import debug_tuple, Engine
from dummy_arm.tf._core.times import nanoseconds_or_int, SECOND
from dummy_arm.tf.transform import Transform


class BufferCore(Engine):
    """
    Transforms as they came in, for as long as the cache time, and lookups among them.

    Frames are names without a leading slash. A time is an int of ns, or what has `sec` and
    `nanosec`, or `nanoseconds`; 0 stands for the latest time that all frames on the path know of.
    Any number of threads may look up and insert; each sees a transform whole or not at all.

    A lookup raises a TransformException: LookupException for an unknown frame or a loop,
    InvalidArgumentException for an empty name or one with a leading slash, ConnectivityException
    for frames of two trees, ExtrapolationException where an edge on the path has no data for the
    time. A frame in itself is the identity, even if it is unknown.
    """

    def __init__(self, cache_time: Any = 10 * SECOND, *, max_frames: int = 100_000,
                 max_samples: Optional[int] = 10_000_000) -> None:
        """
        Create an empty buffer.

        :param cache_time: how long transforms are kept, before the newest of their frame.
        :param max_frames: how many frames there may be; transforms with more are refused.
        :param max_samples: how many transforms of moving frames are kept at most, 60 to 100 bytes
            each. When there are more, a frame that gets one drops its oldest. Of one frame, at
            most 10 000 are kept per second of cache time. None: neither limit holds.
        :raises ValueError: when the cache time is negative, or max_samples is less than 1.
        """
        super().__init__(cache_time, max_frames, max_samples)

    def set_transform(self, transform: Transform, authority: str = 'default_authority') -> bool:
        """
        Insert the pose that a frame has at the transform's stamp.

        :param authority: the publisher; shown by `frames`.
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

    def lookup_transform(self, target_frame: str, source_frame: str, time: Any = 0,
                         timeout: Any = 0) -> Transform:
        """
        Look up the pose of the source frame in the target frame.

        :param timeout: how long to wait for it at most, as times are given, on wall time.
        :returns: the transform from the source frame to the target frame.
        :raises TransformException: see the class.
        """
        stamp, pose = self._wait(_seconds(timeout), self._lookups.pose, target_frame, source_frame,
                                 nanoseconds_or_int(time))
        return Transform(stamp, target_frame, source_frame, pose[:3], pose[3:])

    def lookup_transform_full(self, target_frame: str, target_time: Any, source_frame: str,
                              source_time: Any, fixed_frame: str, timeout: Any = 0) -> Transform:
        """
        Look up the pose that the source frame had at its time, in the target frame at its own.

        :param fixed_frame: the frame in which things stay where they are between the two times.
        """
        stamp, pose = self._wait(
            _seconds(timeout), self._lookups.pose_full, target_frame,
            nanoseconds_or_int(target_time), source_frame, nanoseconds_or_int(source_time),
            fixed_frame)
        return Transform(stamp, target_frame, source_frame, pose[:3], pose[3:])

    def can_transform(self, target_frame: str, source_frame: str, time: Any = 0,
                      timeout: Any = 0, return_debug_tuple: bool = False
                      ) -> Union[bool, tuple[bool, str]]:
        """
        Return whether `lookup_transform` would return an answer.

        :param timeout: how long to wait for it at most, as times are given, on wall time.
        :returns: that; or, with `return_debug_tuple`, that and why not.
        """
        error = self._why_not(_seconds(timeout), self._lookups.check, target_frame, source_frame,
                              nanoseconds_or_int(time))
        return debug_tuple(error) if return_debug_tuple else error is None

    def can_transform_full(self, target_frame: str, target_time: Any, source_frame: str,
                           source_time: Any, fixed_frame: str, timeout: Any = 0,
                           return_debug_tuple: bool = False) -> Union[bool, tuple[bool, str]]:
        """Return whether `lookup_transform_full` would return an answer; as `can_transform`."""
        error = self._why_not(
            _seconds(timeout), self._lookups.check_full, target_frame,
            nanoseconds_or_int(target_time), source_frame, nanoseconds_or_int(source_time),
            fixed_frame)
        return debug_tuple(error) if return_debug_tuple else error is None

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> int:
        """
        Return the latest time (ns) that all frames between two know of; 0 when nothing moves.

        :raises TransformException: see the class.
        """
        return self._look(self._lookups.latest_common_time, target_frame, source_frame)


def _seconds(timeout: Any) -> float:
    return nanoseconds_or_int(timeout, 'timeout') / SECOND
