"""The messages that several modules of tf2 import, so that programs import them from there."""

import _dummy_arm_tf2.ros  # noqa: F401

# isort: split
from geometry_msgs.msg import PointStamped as PointStamped
from geometry_msgs.msg import PoseStamped as PoseStamped
from geometry_msgs.msg import PoseWithCovarianceStamped as PoseWithCovarianceStamped
from geometry_msgs.msg import TransformStamped as TransformStamped
from geometry_msgs.msg import Vector3Stamped as Vector3Stamped
