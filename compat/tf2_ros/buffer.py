"""The module of tf2_ros with the buffer."""

from _dummy_arm_tf2.unavailable import FrameGraph as FrameGraph
from _dummy_arm_tf2.unavailable import FrameGraphSrvRequest as FrameGraphSrvRequest
from _dummy_arm_tf2.unavailable import FrameGraphSrvResponse as FrameGraphSrvResponse
from geometry_msgs.msg import TransformStamped as TransformStamped
import rclpy as rclpy
from rclpy.clock import JumpThreshold as JumpThreshold
from rclpy.clock import TimeJump as TimeJump
from rclpy.duration import Duration as Duration
from rclpy.node import Node as Node
from rclpy.task import Future as Future
from rclpy.time import Time as Time

from puretf import Buffer as Buffer
