"""The names of tf2_ros, from `puretf`, and those that it imports, as programs use them."""

from _dummy_arm_tf2.stamped import *  # noqa: F403
import _dummy_arm_tf2.submodules
from _dummy_arm_tf2.unavailable import *  # noqa: F403
import rclpy as rclpy
from rclpy.callback_groups import ReentrantCallbackGroup as ReentrantCallbackGroup
from rclpy.clock import Clock as Clock
from rclpy.clock import JumpThreshold as JumpThreshold
from rclpy.clock import TimeJump as TimeJump
from rclpy.duration import Duration as Duration
from rclpy.executors import SingleThreadedExecutor as SingleThreadedExecutor
from rclpy.node import Node as Node
from rclpy.qos import DurabilityPolicy as DurabilityPolicy
from rclpy.qos import HistoryPolicy as HistoryPolicy
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.task import Future as Future
from rclpy.time import Time as Time
from std_msgs.msg import Header as Header
from tf2_py import *  # noqa: F403

from puretf import Buffer as Buffer
from puretf import StaticTransformBroadcaster as StaticTransformBroadcaster
from puretf import TFMessage as TFMessage
from puretf import TransformBroadcaster as TransformBroadcaster
from puretf import TransformListener as TransformListener
from puretf.buffer_interface import *  # noqa: F403

_dummy_arm_tf2.submodules.import_on_use(
    __name__, 'buffer', 'buffer_client', 'buffer_interface', 'static_transform_broadcaster',
    'transform_broadcaster', 'transform_listener')
