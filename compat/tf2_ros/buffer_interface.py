"""The module of tf2_ros with the base class of buffers."""

from geometry_msgs.msg import PointStamped as PointStamped
from geometry_msgs.msg import PoseStamped as PoseStamped
from geometry_msgs.msg import PoseWithCovarianceStamped as PoseWithCovarianceStamped
from geometry_msgs.msg import TransformStamped as TransformStamped
from geometry_msgs.msg import Vector3Stamped as Vector3Stamped
from rclpy.duration import Duration as Duration
from rclpy.time import Time as Time
from std_msgs.msg import Header as Header

from puretf.buffer_interface import *  # noqa: F403
