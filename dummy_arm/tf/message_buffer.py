"""The buffer of tf2_py: rclpy's times and messages, without a node and without waiting."""

from typing import Optional

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time

from dummy_arm.tf._core.engine import debug_tuple, Engine
from dummy_arm.tf._core.frames import as_dot
from dummy_arm.tf._core.pose import Pose, Row
from dummy_arm.tf._core.times import nanoseconds, SECOND
from dummy_arm.tf._ros.transform_stamped import explain_bad_fields, message_of, row_of

_LATEST = Time()


class MessageBufferCore(Engine):
    """
    A buffer whose times and transforms are those of rclpy and geometry_msgs, as tf2_py.BufferCore.

    Times have `sec` and `nanosec`, or `nanoseconds`. Errors are those of `BufferCore`.
    """

    def __init__(self, cache_time: Optional[Duration] = None, *, max_frames: int = 100_000,
                 max_samples: Optional[int] = 10_000_000) -> None:
        """
        Create an empty buffer.

        :param cache_time: how long transforms are kept; None: 10 s.
        :param max_frames: as BufferCore has it.
        :param max_samples: as BufferCore has it.
        """
        super().__init__(10 * SECOND if cache_time is None else cache_time, max_frames,
                         max_samples)

    def set_transform(self, transform: TransformStamped, authority: str = 'default_authority'
                      ) -> None:
        """
        Insert the pose that a frame has at the transform's stamp.

        What tf2 refuses is refused: the log says why.

        :param authority: the publisher; shown by `all_frames_as_yaml`.
        :raises TypeError: when it is no TransformStamped.
        :raises ValueError: when one of its fields has a value that does not belong there.
        """
        self._set(transform, authority, False)

    def set_transform_static(self, transform: TransformStamped,
                             authority: str = 'default_authority') -> None:
        """Insert the pose that a frame has at all times; else as `set_transform`."""
        self._set(transform, authority, True)

    def _set(self, transform: TransformStamped, authority: str, is_static: bool) -> None:
        with explain_bad_fields([transform]):
            self.insert(*row_of(transform), authority, is_static)

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Time
                              ) -> TransformStamped:
        """Look up the pose of the source frame in the target frame, without waiting."""
        return message(target_frame, source_frame, self._look(
            self._lookups.pose, target_frame, source_frame, nanoseconds(time)))

    def lookup_transform_full_core(self, target_frame: str, target_time: Time, source_frame: str,
                                   source_time: Time, fixed_frame: str) -> TransformStamped:
        """Look up a transform between two times, without waiting."""
        return message(target_frame, source_frame, self._look(
            self._lookups.pose_full, target_frame, nanoseconds(target_time), source_frame,
            nanoseconds(source_time), fixed_frame))

    def can_transform_core(self, target_frame: str, source_frame: str, time: Time
                           ) -> tuple[bool, str]:
        """Return whether there is a transform, and why not."""
        return debug_tuple(self._why_not(
            0.0, self._lookups.check, target_frame, source_frame, nanoseconds(time)))

    def can_transform_full_core(self, target_frame: str, target_time: Time, source_frame: str,
                                source_time: Time, fixed_frame: str) -> tuple[bool, str]:
        """Return whether there is a transform between two times, and why not."""
        return debug_tuple(self._why_not(
            0.0, self._lookups.check_full, target_frame, nanoseconds(target_time), source_frame,
            nanoseconds(source_time), fixed_frame))

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """Return the latest time that all frames between two know of; 0 when nothing moves."""
        return Time(nanoseconds=self._look(
            self._lookups.latest_common_time, target_frame, source_frame))

    def _chain(self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
               fixed_frame: str) -> list[str]:
        return self._look(self._lookups.chain, target_frame, nanoseconds(target_time),
                          source_frame, nanoseconds(source_time), fixed_frame)

    def _allFramesAsDot(self, time: Time = _LATEST) -> str:  # noqa: N802
        return as_dot(self.frames(), self.frame_names(), nanoseconds(time))

    def _frameExists(self, frame_id: str) -> bool:  # noqa: N802
        return self._look(self._tree.histories.__contains__, frame_id)

    def _getFrameStrings(self) -> list[str]:  # noqa: N802
        return self.frame_names()


def message(target_frame: str, source_frame: str, answer: tuple[int, Pose]) -> TransformStamped:
    """
    Return the message of an answer.

    :param answer: the time (ns), and the pose of the source frame in the target frame.
    """
    return message_of(Row(answer[0], target_frame, source_frame, answer[1]))
