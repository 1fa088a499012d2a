"""What a node and its clock call a buffer for; neither keeps the buffer alive."""

from contextlib import suppress
from functools import partial
from typing import Any, Protocol
from weakref import finalize, ref

from rclpy.clock import Clock, JumpHandle, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from dummy_arm.tf.message import FrameGraph


class _Buffer(Protocol):

    def time_jump_callback(self, time_jump: TimeJump) -> None: ...

    def all_frames_as_yaml(self) -> str: ...


def call_on_jump(clock: Clock, buffer: _Buffer) -> JumpHandle:
    """Have `time_jump_callback` called when a clock jumps back by 1 s or more, or is changed."""
    handle = clock.create_jump_callback(
        JumpThreshold(min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True),
        post_callback=partial(_jumped, ref(buffer)))
    # The clock knows the handle by its address only.
    finalize(buffer, _unregister, handle).atexit = False
    return handle


def serve_frames(node: Node, buffer: _Buffer) -> Any:
    """Offer the service `tf2_frames`; None where tf2_msgs is not installed."""
    if FrameGraph is None:
        return None
    return node.create_service(FrameGraph, 'tf2_frames', partial(_tell, ref(buffer)))


def _jumped(buffer_ref: 'ref[_Buffer]', time_jump: TimeJump) -> None:
    if (buffer := buffer_ref()) is not None:
        buffer.time_jump_callback(time_jump)


def _tell(buffer_ref: 'ref[_Buffer]', _: Any, response: Any) -> Any:
    if (buffer := buffer_ref()) is not None:
        response.frame_yaml = buffer.all_frames_as_yaml()
    return response


def _unregister(handle: JumpHandle) -> None:
    with suppress(InvalidHandle):  # when the clock is gone already
        handle.unregister()
