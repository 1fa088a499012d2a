"""The module of tf2_ros with the buffer."""

from typing import TypeVar

import _dummy_arm_tf2.ros  # noqa: F401
from _dummy_arm_tf2.unavailable import Unavailable
from geometry_msgs.msg import TransformStamped as TransformStamped
from rclpy.duration import Duration as Duration
from rclpy.node import Node as Node
from rclpy.time import Time as Time

from dummy_arm.tf import Buffer as Buffer

__all__ = ['Buffer', 'Duration', 'FrameGraph', 'FrameGraphSrvRequest', 'FrameGraphSrvResponse',
           'Node', 'Time', 'TransformStamped']


class FrameGraph(metaclass=Unavailable):
    """The service that returns the frames of a buffer; not available."""


FrameGraphSrvRequest = TypeVar('FrameGraphSrvRequest')
FrameGraphSrvResponse = TypeVar('FrameGraphSrvResponse')
