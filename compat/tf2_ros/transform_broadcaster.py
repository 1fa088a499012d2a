"""The module of tf2_ros with the broadcaster of dynamic transforms."""

from geometry_msgs.msg import TransformStamped as TransformStamped
from rclpy.node import Node as Node
from rclpy.qos import QoSProfile as QoSProfile

from puretf import TFMessage as TFMessage
from puretf import TransformBroadcaster as TransformBroadcaster
