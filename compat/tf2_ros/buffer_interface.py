"""The module of tf2_ros with the base class of buffers."""

from _dummy_arm_tf2.stamped import *  # noqa: F403
from rclpy.duration import Duration as Duration
from rclpy.time import Time as Time
from std_msgs.msg import Header as Header

from puretf.buffer_interface import *  # noqa: F403
