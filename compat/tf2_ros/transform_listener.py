"""The module of tf2_ros with the listener."""

from rclpy.node import Node as Node
from rclpy.qos import QoSProfile as QoSProfile

from puretf import Buffer as Buffer
from puretf import TFMessage as TFMessage
from puretf import TransformListener as TransformListener
