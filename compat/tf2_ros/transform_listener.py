"""The module of tf2_ros with the listener."""

import _dummy_arm_tf2.ros  # noqa: F401
from rclpy.node import Node as Node
from rclpy.qos import QoSProfile as QoSProfile

from dummy_arm.tf import Buffer as Buffer
from dummy_arm.tf import TFMessage as TFMessage
from dummy_arm.tf import TransformListener as TransformListener
