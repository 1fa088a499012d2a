"""A buffer like that of tf2_ros: it can wait for transforms, and can have a node."""

# Before the packages of ROS, to say how to install them.
from puretf._ros.futures import PendingFutures

# isort: split
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, Optional
from weakref import finalize, ref

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, ClockChange, JumpHandle, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from rclpy.utilities import get_default_context

from puretf._causes.explanation import clock_end
from puretf._ros.messages import FrameGraph
from puretf._ros.qos import check_node
from puretf.buffer_core import BufferCore
from puretf.buffer_interface import BufferInterface


class Buffer(BufferCore, BufferInterface):
    """
    A buffer with the API of tf2_ros.Buffer: it can wait for transforms and transform objects.

    Timeouts run on the wall clock, even if the node uses simulated time. `BufferBase` says what
    all buffers have in common.
    """

    def __init__(self, cache_time: Optional[Duration] = None, node: Optional[Node] = None, *,
                 max_frames: int = 100_000, max_samples: Optional[int] = 10_000_000) -> None:
        """
        Create an empty buffer.

        :param cache_time: how long samples are kept, as in `TransformBuffer`; None: 10 s.
        :param node: the node of the buffer. When a future of the buffer is done, the executor of
            the node is woken. When the clock of the node jumps back by 1 s or more, or switches
            between system time and simulated time, the buffer is cleared. If tf2_msgs is
            installed, the node gets the service `tf2_frames`, which returns all frames. None: the
            buffer has no node, and uses rclpy's default context.
        :param max_frames: the largest number of frames; see `TransformBuffer`.
        :param max_samples: the largest number of samples; see `TransformBuffer`.
        :raises TypeError: if the cache time is not a duration.
        :raises ValueError: if the cache time is negative, or `max_samples` is less than 1.
        """
        if isinstance(cache_time, Node):
            raise TypeError('cache_time must be a Duration, got a node: write Buffer(node=node)')
        if node is not None:
            check_node(node, 'Buffer(node=node)')
        BufferCore.__init__(self, cache_time, max_frames=max_frames, max_samples=max_samples)
        BufferInterface.__init__(self)
        self._node, self._futures = node, PendingFutures(node)
        self._engine.add_waiter(self._futures)
        self._engine.tree.needs_listener = True
        self._engine.insertion.log.write = get_logger('tf2_buffer').warning
        self._engine.is_alive = (get_default_context() if node is None else node.context).ok
        self.clock = Clock() if node is None else node.get_clock()
        if node is not None:
            self.srv = FrameGraph and node.create_service(
                FrameGraph, 'tf2_frames', partial(_on_frames_request, ref(self)))
        self.jump_handle = create_jump_handle(self.clock, self)

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Clear the buffer, and log a warning, at most once a second."""
        is_switch = time_jump.clock_change in (
            ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)
        self.clear()
        if (log := self._engine.insertion.log).is_due('jump'):
            log.write(f'Detected {"time source change" if is_switch else "jump back in time"}. '
                      f'Clearing tf buffer.{clock_end(self._engine.tree.look)}')

    async def lookup_transform_async(self, target_frame: str, source_frame: str, time: Time,
                                     timeout: Optional[Duration] = None) -> TransformStamped:
        """
        Wait for a transform, and return the transform.

        This method is a coroutine with the parameters of `lookup_transform`: it does not block the
        thread.

        :param timeout: how long to wait at most, on the wall clock; None: no limit.
        :returns: the transform from the source frame to the target frame.
        :raises TimeoutException: if the transform is still not available after the timeout.
        :raises TypeError: if a frame, a time or the timeout has a wrong type.
        """
        return await self.wait_for_transform_async(target_frame, source_frame, time, timeout)

    async def lookup_transform_full_async(
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Optional[Duration] = None) -> TransformStamped:
        """
        Wait for a transform between two times, and return the transform.

        This method is a coroutine with the parameters of `lookup_transform_full`: it does not
        block the thread.

        :param timeout: how long to wait at most, on the wall clock; None: no limit.
        :returns: the transform from the source frame to the target frame.
        :raises TimeoutException: if the transform is still not available after the timeout.
        :raises TypeError: if a frame, a time or the timeout has a wrong type.
        """
        return await self.wait_for_transform_full_async(
            target_frame, target_time, source_frame, source_time, fixed_frame, timeout)

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Time,
                                 timeout: Optional[Duration] = None) -> Future:
        """
        Return a future that is completed when a transform is available.

        To stop waiting, cancel the future. If the future has never had a done callback, it is
        enough to drop the last reference to the future.

        :param timeout: the time, on the wall clock, after which the future ends with a
            TimeoutException; None: no limit.
        :returns: a future whose result is the TransformStamped. If the transform is already
            available, the future is already done.
        :raises TypeError: if a frame, a time or the timeout has a wrong type.
        """
        return self._create_future(
            partial(self.lookup_transform_core, target_frame, source_frame, time), timeout,
            source_frame, target_frame)

    def wait_for_transform_full_async(
            self, target_frame: str, target_time: Time, source_frame: str, source_time: Time,
            fixed_frame: str, timeout: Optional[Duration] = None) -> Future:
        """
        Return a future that is completed when a transform between two times is available.

        :param timeout: as in `wait_for_transform_async`.
        :returns: a future, as in `wait_for_transform_async`.
        :raises TypeError: if a frame, a time or the timeout has a wrong type.
        """
        return self._create_future(
            partial(self.lookup_transform_full_core, target_frame, target_time, source_frame,
                    source_time, fixed_frame), timeout, source_frame, target_frame)

    def _create_future(self, lookup: Callable[[], TransformStamped], timeout: Optional[Duration],
                       source_frame: str, target_frame: str) -> Future:
        future = self._futures.add(
            lookup, None if timeout is None else self._seconds(timeout),
            f"the transform from '{source_frame}' to '{target_frame}'")
        if not future.done():
            self._engine.wake_sources()
        return future


# The callbacks of the node and of its clock. The callbacks hold weak references to the buffer, so
# that neither the node nor the clock keeps the buffer alive.


def create_jump_handle(clock: Clock, owner: Any) -> JumpHandle:
    """
    Register the method `time_jump_callback` of an object with a clock.

    It is called when the clock jumps back by 1 s or more, or switches between system time and
    simulated time. The clock does not keep the owner alive.
    """
    handle = clock.create_jump_callback(
        JumpThreshold(min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True),
        post_callback=partial(_on_time_jump, ref(owner)))
    # rcl stores the address of the handle, but does not keep the handle alive. Therefore the
    # handle must be unregistered before its memory is freed.
    finalize(owner, _unregister, handle).atexit = False
    return handle


def _on_time_jump(owner_ref: ref[Any], time_jump: TimeJump) -> None:
    if (owner := owner_ref()) is not None:
        owner.time_jump_callback(time_jump)


def _on_frames_request(buffer_ref: ref[Buffer], _: Any, response: Any) -> Any:
    if (buffer := buffer_ref()) is not None:
        response.frame_yaml = buffer.all_frames_as_yaml()
    return response


def _unregister(handle: JumpHandle) -> None:
    with suppress(InvalidHandle):  # if the clock is already destroyed
        handle.unregister()
