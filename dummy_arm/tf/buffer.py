"""The buffer of tf2_ros: it waits for transforms, and has a node."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
import logging
from typing import Any, Optional, Union
from weakref import finalize, ref

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, JumpHandle, JumpThreshold, TimeJump
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from rclpy.utilities import get_default_context

from dummy_arm.tf._core.engine import debug_tuple
from dummy_arm.tf._core.times import nanoseconds, SECOND
from dummy_arm.tf._ros.futures import PendingFutures
from dummy_arm.tf._ros.messages import FrameGraph
from dummy_arm.tf.buffer_interface import BufferInterface, NO_WAIT
from dummy_arm.tf.message_buffer import message, MessageBufferCore


class Buffer(MessageBufferCore, BufferInterface):
    """
    A MessageBufferCore with a node, that can wait for transforms and transform objects.

    PendingFutures are on wall time.
    """

    def __init__(self, cache_time: Optional[Duration] = None, node: Optional[Node] = None, *,
                 max_frames: int = 100_000, max_samples: Optional[int] = 10_000_000) -> None:
        """
        Create an empty buffer.

        :param cache_time: how long transforms are kept; None: 10 s.
        :param node: its executor is woken when an async wait is over; a jump of its clock back by
            a second or more, or a change of its clock, clears the buffer; where tf2_msgs is
            installed, its service `tf2_frames` returns all frames.
        :param max_frames: as BufferCore has it.
        :param max_samples: as BufferCore has it.
        """
        MessageBufferCore.__init__(
            self, cache_time, max_frames=max_frames, max_samples=max_samples)
        BufferInterface.__init__(self)
        self._futures: PendingFutures = PendingFutures(node)
        self._insertion.log.write = get_logger('tf2_buffer').warning
        self._context: Optional[Context] = (
            get_default_context() if node is None else node.context)
        self.clock = Clock() if node is None else node.get_clock()
        if node is not None:
            self.srv = _serve_frames(node, self)
        self.jump_handle = _call_on_jump(self.clock, self)

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Clear the buffer."""
        get_logger('tf2_buffer').warning('Detected jump back in time. Clearing tf buffer.')
        self.clear()

    def after_insertion(self) -> bool:
        """Log what was refused, and complete futures; return whether there was one."""
        super().after_insertion()
        return len(self._futures) > 0 and self._futures.check()

    def _is_alive(self) -> tuple[bool, ...]:
        return (*super()._is_alive(), self._context is not None and bool(self._context.ok()))

    def after_fork_in_child(self, was_held: bool) -> None:
        """Drop what works in the parent process only: this one was forked."""
        super().after_fork_in_child(was_held)
        self._context = None  # and no logger of rclpy: other threads may have held their locks
        self._insertion.log.write = logging.getLogger('dummy_arm.tf').warning
        self._futures = PendingFutures(None)

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time,
                         timeout: Duration = NO_WAIT) -> TransformStamped:
        """
        Look up the pose of the source frame in the target frame.

        :param time: when; 0: the latest time that all frames on the path know of.
        :param timeout: how long to wait for it at most.
        """
        if timeout is NO_WAIT:
            return self.lookup_transform_core(target_frame, source_frame, time)
        return message(target_frame, source_frame, self._wait(
            _seconds(timeout), self._lookups.pose, target_frame, source_frame, nanoseconds(time)))

    def lookup_transform_full(
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Duration = NO_WAIT) -> TransformStamped:
        """
        Look up the pose that the source frame had at its time, in the target frame at its own.

        :param fixed_frame: the frame in which things stay where they are between the two times.
        """
        return message(target_frame, source_frame, self._wait(
            _seconds(timeout), self._lookups.pose_full, target_frame, nanoseconds(target_time),
            source_frame, nanoseconds(source_time), fixed_frame))

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

    def can_transform(
            self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_WAIT,
            return_debug_tuple: bool = False) -> Union[bool, tuple[bool, str]]:
        """
        Return whether `lookup_transform` would return an answer.

        :param timeout: how long to wait for it at most.
        :returns: that; or, with `return_debug_tuple`, that and why not.
        """
        error = self._why_not(_seconds(timeout), self._lookups.check, target_frame, source_frame,
                              nanoseconds(time))
        return debug_tuple(error) if return_debug_tuple else error is None

    def can_transform_full(
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Duration = NO_WAIT, return_debug_tuple: bool = False
            ) -> Union[bool, tuple[bool, str]]:
        """Return whether `lookup_transform_full` would return an answer; as `can_transform`."""
        error = self._why_not(
            _seconds(timeout), self._lookups.check_full, target_frame, nanoseconds(target_time),
            source_frame, nanoseconds(source_time), fixed_frame)
        return debug_tuple(error) if return_debug_tuple else error is None

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Time,
                                 timeout: Optional[Duration] = None) -> Future:
        """
        Return a future whose result will be the transform.

        To stop waiting, cancel it, or drop the last reference to it if it has no done callback.

        :param timeout: after how long it gets a TimeoutException; None: never.
        """
        return self._future(partial(self.lookup_transform_core, target_frame, source_frame, time),
                            timeout, source_frame, target_frame)

    def wait_for_transform_full_async(
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Optional[Duration] = None) -> Future:
        """Return a future as `wait_for_transform_async`, for a transform between two times."""
        return self._future(partial(self.lookup_transform_full_core, target_frame, target_time,
                                    source_frame, source_time, fixed_frame),
                            timeout, source_frame, target_frame)

    def _future(self, lookup: Callable[[], TransformStamped], timeout: Optional[Duration],
                source_frame: str, target_frame: str) -> Future:
        future = self._futures.add(
            lookup, None if timeout is None else _seconds(timeout),
            f"the transform from '{source_frame}' to '{target_frame}'")
        if not future.done():
            self._wake_sources()
        return future


def _seconds(timeout: Duration) -> float:
    return nanoseconds(timeout, 'timeout') / SECOND


# What a node and its clock call a buffer for; neither keeps the buffer alive.


def _call_on_jump(clock: Clock, buffer: Buffer) -> JumpHandle:
    """Have `time_jump_callback` called when a clock jumps back by 1 s or more, or is changed."""
    handle = clock.create_jump_callback(
        JumpThreshold(min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True),
        post_callback=partial(_jumped, ref(buffer)))
    # The clock knows the handle by its address only.
    finalize(buffer, _unregister, handle).atexit = False
    return handle


def _serve_frames(node: Node, buffer: Buffer) -> Any:
    """Offer the service `tf2_frames`; None where tf2_msgs is not installed."""
    if FrameGraph is None:
        return None
    return node.create_service(FrameGraph, 'tf2_frames', partial(_tell, ref(buffer)))


def _jumped(buffer_ref: ref[Buffer], time_jump: TimeJump) -> None:
    if (buffer := buffer_ref()) is not None:
        buffer.time_jump_callback(time_jump)


def _tell(buffer_ref: ref[Buffer], _: Any, response: Any) -> Any:
    if (buffer := buffer_ref()) is not None:
        response.frame_yaml = buffer.all_frames_as_yaml()
    return response


def _unregister(handle: JumpHandle) -> None:
    with suppress(InvalidHandle):  # when the clock is gone already
        handle.unregister()
