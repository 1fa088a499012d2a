"""The buffer of tf2_ros: BufferCore for users of rclpy and of messages."""

from collections.abc import Callable
from functools import partial
import logging
from typing import Optional, Union

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, TimeJump
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from rclpy.utilities import get_default_context

from dummy_arm.tf.buffer_core import BufferCore, debug_tuple
from dummy_arm.tf.buffer_interface import BufferInterface, NO_WAIT
from dummy_arm.tf.frames import as_dot
from dummy_arm.tf.history import Pose
from dummy_arm.tf.node_hooks import call_on_jump, serve_frames
from dummy_arm.tf.times import nanoseconds, SECOND
from dummy_arm.tf.transform_stamped import bad_fields_named, message_of, row_of
from dummy_arm.tf.waits import Waits

_LATEST = Time()


class Buffer(BufferCore, BufferInterface):
    """
    A BufferCore whose times and transforms are rclpy's and geometry_msgs', as that of tf2_ros.

    Times have `sec` and `nanosec`, or `nanoseconds`. Waits are on wall time. Errors: BufferCore's.
    """

    _nanoseconds = staticmethod(nanoseconds)

    def __init__(self, cache_time: Optional[Duration] = None, node: Optional[Node] = None, *,
                 max_frames: int = 100_000, max_samples: Optional[int] = 10_000_000) -> None:
        """
        Begin empty.

        :param cache_time: how long transforms are kept; None: 10 s.
        :param node: its executor is woken when an async wait is over; a jump of its clock back by
            a second or more, or a change of its clock, clears the buffer; where tf2_msgs is
            installed, its service `tf2_frames` tells all frames.
        :param max_frames: as BufferCore has it.
        :param max_samples: as BufferCore has it.
        """
        self._waits = Waits(node)
        BufferCore.__init__(self, 10 * SECOND if cache_time is None else cache_time,
                            max_frames=max_frames, max_samples=max_samples)
        BufferInterface.__init__(self)
        self._intake.refusals.log = get_logger('tf2_buffer').warning
        self._context: Optional[Context] = (
            get_default_context() if node is None else node.context)
        self.clock = Clock() if node is None else node.get_clock()
        if node is not None:
            self.srv = serve_frames(node, self)
        self.jump_handle = call_on_jump(self.clock, self)

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Clear the buffer."""
        get_logger('tf2_buffer').warning('Detected jump back in time. Clearing tf buffer.')
        self.clear()

    def set_transform(self, transform: TransformStamped,  # type: ignore[override]
                      authority: str = 'default_authority') -> None:
        """
        Insert the pose that a frame has at the transform's stamp.

        What tf2 refuses is refused: the log says why.

        :param authority: who says so; shown by `all_frames_as_yaml`.
        :raises TypeError: when it is no TransformStamped.
        :raises ValueError: when one of its fields has a value that does not belong there.
        """
        self._insert(transform, authority, False)

    def set_transform_static(self, transform: TransformStamped,  # type: ignore[override]
                             authority: str = 'default_authority') -> None:
        """Insert the pose that a frame has at all times; else as `set_transform`."""
        self._insert(transform, authority, True)

    def _insert(self, transform: TransformStamped, authority: str, is_static: bool) -> None:
        with bad_fields_named([transform]):
            row = row_of(transform)
            self.insert(row[0] * SECOND + row[1], row[2], row[3], row[4:], authority, is_static)

    def _conditions(self) -> tuple[bool, ...]:
        return (*super()._conditions(), self._context is not None and bool(self._context.ok()))

    def _hold(self, timeout: float) -> bool:
        if not super()._hold(timeout):
            return False
        if self._waits.lock.acquire(timeout=timeout):
            return True
        super()._release()
        return False

    def _release(self) -> None:
        self._waits.lock.release()
        super()._release()

    def _detach(self) -> None:
        super()._detach()
        self._context = None  # and no logger of rclpy: other threads may have held their locks
        self._intake.refusals.log = logging.getLogger('dummy_arm.tf').warning
        self._waits.forget_all()

    def _reset(self) -> None:
        self._waits = Waits(None)
        super()._reset()

    def on_new_data(self) -> bool:
        """Wake those who wait for a transform; tell whether a future is done now."""
        super().on_new_data()
        return bool(self._waits) and self._waits.check()

    @property
    def is_waited_for(self) -> bool:
        """Whether somebody waits for a transform."""
        return super().is_waited_for or bool(self._waits)

    def lookup_transform(self, target_frame: str, source_frame: str,  # type: ignore[override]
                         time: Time, timeout: Duration = NO_WAIT) -> TransformStamped:
        """
        Look up the pose of the source frame in the target frame.

        :param time: when; 0: the latest time that all frames on the way know of.
        :param timeout: how long to wait for it at most.
        """
        if timeout is NO_WAIT:
            return self.lookup_transform_core(target_frame, source_frame, time)
        stamp, pose = self._waited(timeout, self._lookups.pose, target_frame, source_frame,
                                   nanoseconds(time))
        return _message(stamp, target_frame, source_frame, pose)

    def lookup_transform_full(
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Duration = NO_WAIT) -> TransformStamped:
        """
        Look up the pose that the source frame had at its time, in the target frame at its own.

        :param fixed_frame: the frame in which things stay where they are between the two times.
        """
        stamp, pose = self._waited(
            timeout, self._lookups.pose_full, target_frame, nanoseconds(target_time),
            source_frame, nanoseconds(source_time), fixed_frame)
        return _message(stamp, target_frame, source_frame, pose)

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Time
                              ) -> TransformStamped:
        """Look up a transform without waiting."""
        stamp, pose = self._lookups.pose(target_frame, source_frame, nanoseconds(time))
        return _message(stamp, target_frame, source_frame, pose)

    def lookup_transform_full_core(self, target_frame: str, target_time: Time, source_frame: str,
                                   source_time: Time, fixed_frame: str) -> TransformStamped:
        """Look up a transform between two times without waiting."""
        stamp, pose = self._lookups.pose_full(
            target_frame, nanoseconds(target_time), source_frame, nanoseconds(source_time),
            fixed_frame)
        return _message(stamp, target_frame, source_frame, pose)

    async def lookup_transform_async(self, target_frame: str, source_frame: str, time: Time,
                                     timeout: Optional[Duration] = None) -> TransformStamped:
        """Look up a transform in a coroutine; as `wait_for_transform_async`."""
        return await self.wait_for_transform_async(target_frame, source_frame, time, timeout)

    async def lookup_transform_full_async(
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Optional[Duration] = None) -> TransformStamped:
        """Look up a transform between two times; as `wait_for_transform_full_async`."""
        return await self.wait_for_transform_full_async(
            target_frame, target_time, source_frame, source_time, fixed_frame, timeout)

    def can_transform(  # type: ignore[override]
            self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_WAIT,
            return_debug_tuple: bool = False) -> Union[bool, tuple[bool, str]]:
        """
        Tell whether `lookup_transform` would give an answer.

        :param timeout: how long to wait for it at most.
        :returns: that; or, with `return_debug_tuple`, that and why not.
        """
        return super().can_transform(
            target_frame, source_frame, time, timeout, return_debug_tuple)

    def can_transform_full(  # type: ignore[override]
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Duration = NO_WAIT, return_debug_tuple: bool = False
            ) -> Union[bool, tuple[bool, str]]:
        """Tell whether `lookup_transform_full` would give an answer; as `can_transform`."""
        return super().can_transform_full(
            target_frame, target_time, source_frame, source_time, fixed_frame, timeout,
            return_debug_tuple)

    def can_transform_core(self, target_frame: str, source_frame: str, time: Time
                           ) -> tuple[bool, str]:
        """Tell whether there is a transform, and why not."""
        return debug_tuple(self._why_not(
            NO_WAIT, self._lookups.check, target_frame, source_frame, nanoseconds(time)))

    def can_transform_full_core(self, target_frame: str, target_time: Time, source_frame: str,
                                source_time: Time, fixed_frame: str) -> tuple[bool, str]:
        """Tell whether there is a transform between two times, and why not."""
        return debug_tuple(self._why_not(
            NO_WAIT, self._lookups.check_full, target_frame, nanoseconds(target_time),
            source_frame, nanoseconds(source_time), fixed_frame))

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Time,
                                 timeout: Optional[Duration] = None) -> Future:
        """
        Make a future whose result will be the transform.

        The wait ends when it is cancelled, or dropped and has no done callbacks.

        :param timeout: after how long it gets a TimeoutException; None: never.
        """
        return self._wait(partial(self.lookup_transform_core, target_frame, source_frame, time),
                          timeout, source_frame, target_frame)

    def wait_for_transform_full_async(
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Optional[Duration] = None) -> Future:
        """Make a future as `wait_for_transform_async`, for a transform between two times."""
        return self._wait(partial(self.lookup_transform_full_core, target_frame, target_time,
                                  source_frame, source_time, fixed_frame),
                          timeout, source_frame, target_frame)

    def _wait(self, lookup: Callable[[], TransformStamped], timeout: Optional[Duration],
              source_frame: str, target_frame: str) -> Future:
        future = self._waits.add(
            lookup, None if timeout is None else nanoseconds(timeout, 'timeout') / SECOND,
            f"the transform from '{source_frame}' to '{target_frame}'")
        if not future.done():
            self._lookups.hurry()
        return future

    def get_latest_common_time(self, target_frame: str, source_frame: str
                               ) -> Time:
        """Find the latest time that all frames between two know of; 0 when nothing moves."""
        return Time(nanoseconds=super().get_latest_common_time(target_frame, source_frame))

    def _chain(self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
               fixed_frame: str) -> list[str]:
        return self._lookups.chain(target_frame, nanoseconds(target_time), source_frame,
                                   nanoseconds(source_time), fixed_frame)

    def _allFramesAsDot(self, time: Time = _LATEST) -> str:  # noqa: N802
        return as_dot(self.frames(), self._getFrameStrings(), nanoseconds(time))

    def _frameExists(self, frame_id: str) -> bool:  # noqa: N802
        with self._lookups.fetched():
            return frame_id in self._lookups.tree.histories

    def _getFrameStrings(self) -> list[str]:  # noqa: N802
        with self._lookups.fetched():
            return list(self._lookups.tree.histories)


def _message(stamp: int, target_frame: str, source_frame: str, pose: Pose) -> TransformStamped:
    return message_of((*divmod(stamp, SECOND), target_frame, source_frame, *pose))
