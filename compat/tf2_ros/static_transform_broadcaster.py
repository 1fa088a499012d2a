"""The module of tf2_ros with the broadcaster of static transforms."""

from geometry_msgs.msg import TransformStamped as TransformStamped
from rclpy.node import Node as Node
from rclpy.qos import QoSProfile as QoSProfile

from puretf import StaticTransformBroadcaster as StaticTransformBroadcaster
from puretf import TFMessage as TFMessage
