"""The module of tf2_ros with the listener."""

from rclpy.callback_groups import ReentrantCallbackGroup as ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor as SingleThreadedExecutor
from rclpy.node import Node as Node
from rclpy.qos import DurabilityPolicy as DurabilityPolicy
from rclpy.qos import HistoryPolicy as HistoryPolicy
from rclpy.qos import QoSProfile as QoSProfile

from puretf import Buffer as Buffer
from puretf import TFMessage as TFMessage
from puretf import TransformListener as TransformListener
