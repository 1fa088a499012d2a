"""A buffer like that of tf2_py: it uses the messages of ROS, and has no node."""

# Before the packages of ROS, to say how to install them.
from puretf._ros.transform_stamped import explain_bad_fields, message_of_fields, row_of

# isort: split
from typing import Optional

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time

from puretf._core.buffer_base import BufferBase
from puretf._core.frames import as_dot
from puretf._core.pose import Pose
from puretf._core.times import nanoseconds, split
from puretf._core.velocity import tf2_velocity
from puretf.transform import Vector
from puretf.transform_buffer import CACHE_TIME

_LATEST = Time()


class BufferCore(BufferBase[Time, Duration, TransformStamped]):
    """
    A buffer with the API of tf2_py.BufferCore, for TransformStamped messages and rclpy's times.

    A time may be a Time of rclpy or a Time message. `BufferBase` says what all buffers have in
    common.
    """

    def __init__(self, cache_time: Optional[Duration] = None, *, max_frames: int = 100_000,
                 max_samples: Optional[int] = 10_000_000) -> None:
        """
        Create an empty buffer.

        :param cache_time: how long samples are kept, as in `TransformBuffer`; None: 10 s.
        :param max_frames: the largest number of frames; see `TransformBuffer`.
        :param max_samples: the largest number of samples; see `TransformBuffer`.
        :raises TypeError: if the cache time is not a duration.
        :raises ValueError: if the cache time is negative, or `max_samples` is less than 1.
        """
        super().__init__(CACHE_TIME if cache_time is None else nanoseconds(
            cache_time, 'cache_time'), max_frames, max_samples)

    def set_transform(self, transform: TransformStamped, authority: str = 'default_authority'
                      ) -> None:
        """
        Insert a dynamic transform: the pose of a frame at the transform's stamp.

        A transform that tf2 refuses is refused here, too; the log says why.

        :param transform: the transform; its rotation is normalised.
        :param authority: the name of the publisher, shown by `all_frames_as_yaml`.
        :raises TypeError: if `transform` is not a TransformStamped.
        :raises ValueError: if a field of the transform has a value of a wrong type, or a number
            that does not fit the field.
        """
        with explain_bad_fields([transform], accepts_clock_time=True):
            self._engine.insert(*row_of(transform), authority, False)

    def set_transform_static(self, transform: TransformStamped,
                             authority: str = 'default_authority') -> None:
        """
        Insert a static transform: the pose of a frame at all times.

        The stamp of the transform is not used.
        """
        with explain_bad_fields([transform], accepts_clock_time=True):
            self._engine.insert(*row_of(transform), authority, True)

    _ns = staticmethod(nanoseconds)

    def _answer(self, target: str, source: str, stamp: int, pose: Pose) -> TransformStamped:
        return message_of_fields((*split(stamp), target, source, pose))

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Time
                              ) -> TransformStamped:
        """
        Return the pose of the source frame in the target frame, without waiting.

        :param time: time of the transform; a zero Time: the latest time for which every edge on
            the path has data.
        :returns: the transform from the source frame to the target frame.
        :raises TransformException: if there is no such transform.
        :raises TypeError: if a frame or the time has a wrong type.
        """
        return super().lookup_transform(target_frame, source_frame, time)

    def lookup_transform_full_core(self, target_frame: str, target_time: Time, source_frame: str,
                                   source_time: Time, fixed_frame: str) -> TransformStamped:
        """
        Return the pose of the source frame at one time, in the target frame at another time.

        This method does not wait. The source frame is located in the fixed frame at `source_time`,
        and the target frame is located in the fixed frame at `target_time`.

        :param target_time: time of the target frame; a zero Time: the latest time for
            which every edge between the target frame and the fixed frame has data.
        :param source_time: time of the source frame; a zero Time: the latest time for
            which every edge between the source frame and the fixed frame has data.
        :param fixed_frame: a frame that does not move between the two times.
        :returns: the transform from the source frame to the target frame. Its stamp is the time of
            the target frame.
        :raises TransformException: if there is no such transform.
        :raises TypeError: if a frame or a time has a wrong type.
        """
        return super().lookup_transform_full(
            target_frame, target_time, source_frame, source_time, fixed_frame)

    def can_transform_core(self, target_frame: str, source_frame: str, time: Time
                           ) -> tuple[bool, str]:
        """
        Return whether `lookup_transform_core` would return a transform.

        :param time: time of the transform; a zero Time: the latest time for which every edge on
            the path has data.
        :returns: a tuple: whether the transform is available, and the text of the error ('' if
            there is no error).
        :raises TypeError: if a frame or the time has a wrong type.
        """
        answer: tuple[bool, str] = super().can_transform(
            target_frame, source_frame, time, return_debug_tuple=True)
        return answer

    def can_transform_full_core(self, target_frame: str, target_time: Time, source_frame: str,
                                source_time: Time, fixed_frame: str) -> tuple[bool, str]:
        """
        Return whether `lookup_transform_full_core` would return a transform.

        :param target_time: time of the target frame; a zero Time: the latest time for
            which every edge between the target frame and the fixed frame has data.
        :param source_time: time of the source frame; a zero Time: the latest time for
            which every edge between the source frame and the fixed frame has data.
        :param fixed_frame: a frame that does not move between the two times.
        :returns: a tuple: whether the transform is available, and the text of the error ('' if
            there is no error).
        :raises TypeError: if a frame or a time has a wrong type.
        """
        answer: tuple[bool, str] = super().can_transform_full(
            target_frame, target_time, source_frame, source_time, fixed_frame,
            return_debug_tuple=True)
        return answer

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """
        Return the latest time for which every edge on the path between two frames has data.

        :returns: the latest time; a zero Time if all edges are static. If both frames are the
            same: the stamp of the newest sample of this frame, or a zero Time if the frame has no
            dynamic samples.
        :raises TransformException: if there is no path.
        :raises TypeError: if a frame is not a str.
        """
        with self._engine.reading():
            return Time(nanoseconds=self._engine.lookups.latest_common_time(
                target_frame, source_frame))

    def lookupVelocityCore(  # noqa: N802
            self, tracking_frame: str, observation_frame: str, time: Time,
            averaging_interval: Duration) -> tuple[Vector, Vector]:
        """
        Return what lookupVelocityCore of tf2_py returns; use `lookup_twist` in new programs.

        tf2 computes the velocity of the tracking frame as seen in the observation frame. But tf2
        then rotates the velocity by the rotation of the tracking frame, and adds a cross product.
        So the result is the velocity only if the tracking frame does not rotate and has the
        orientation of the observation frame.

        :param tracking_frame: the frame that moves.
        :param observation_frame: the frame in which its poses are looked up.
        :param time: the middle of the averaging interval.
        :param averaging_interval: the length of the interval. If the data end within the interval,
            an interval of the same length that ends with the data is used instead.
        :returns: two vectors x, y, z: the linear velocity (m/s) and the angular velocity (rad/s).
        :raises TransformException: if there is no transform; the class of the error says why.
        :raises TypeError: if a frame is not a str, or the time or the interval has a wrong type.
        :raises ValueError: if the interval is too short.
        """
        return self.lookupVelocityFullCore(
            tracking_frame, observation_frame, observation_frame, (0.0, 0.0, 0.0), tracking_frame,
            time, averaging_interval)

    def lookupVelocityFullCore(  # noqa: N802
            self, tracking_frame: str, observation_frame: str, reference_frame: str,
            reference_point: Vector, reference_point_frame: str, time: Time,
            averaging_interval: Duration) -> tuple[Vector, Vector]:
        """
        Return what lookupVelocityFullCore of tf2_py returns; see `lookupVelocityCore`.

        Where tf2 moves the velocity to the reference point, it multiplies two vectors element by
        element; a cross product would be right.

        :param tracking_frame: the frame that moves.
        :param observation_frame: the frame in which its poses are looked up.
        :param reference_frame: the frame in which the result is expressed.
        :param reference_point: x, y, z (m) of the reference point, in `reference_point_frame`.
        :param reference_point_frame: the frame of the reference point.
        :returns: as `lookupVelocityCore`.
        """
        x, y, z = map(float, reference_point)
        with self._engine.reading():
            return tf2_velocity(
                self._engine.lookups, tracking_frame, observation_frame, reference_frame,
                (x, y, z), reference_point_frame, nanoseconds(time),
                nanoseconds(averaging_interval, 'averaging_interval'))

    def _chain(self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
               fixed_frame: str) -> list[str]:
        """Return the frames on the path from the source via the fixed to the target frame."""
        with self._engine.reading():
            return self._engine.lookups.chain(
                target_frame, nanoseconds(target_time), source_frame, nanoseconds(source_time),
                fixed_frame)

    def _allFramesAsDot(self, time: Time = _LATEST) -> str:  # noqa: N802
        """Return tf2's DOT graph of all frames; if `time` is not zero, it shows transform ages."""
        return as_dot(self.frames(), self.frame_names(), nanoseconds(time))

    def _frameExists(self, frame_id: str) -> bool:  # noqa: N802
        return frame_id in self.frame_names()

    def _getFrameStrings(self) -> list[str]:  # noqa: N802
        return self.frame_names()
