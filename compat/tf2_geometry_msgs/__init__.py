"""
The names of tf2_geometry_msgs, from `puretf.geometry`, and the messages that they take.

`Buffer.transform` works for these messages even if this module is not imported, unlike in tf2.
"""

from _dummy_arm_tf2.stamped import *  # noqa: F403
import _dummy_arm_tf2.submodules
from geometry_msgs.msg import Point as Point
from geometry_msgs.msg import PolygonStamped as PolygonStamped
from geometry_msgs.msg import Pose as Pose

from puretf.geometry import do_transform_point as do_transform_point
from puretf.geometry import do_transform_polygon_stamped as do_transform_polygon_stamped
from puretf.geometry import do_transform_pose as do_transform_pose
from puretf.geometry import do_transform_pose_stamped as do_transform_pose_stamped
from puretf.geometry import (
    do_transform_pose_with_covariance_stamped as do_transform_pose_with_covariance_stamped,
)
from puretf.geometry import do_transform_vector3 as do_transform_vector3
from puretf.geometry import from_msg_msg as from_msg_msg
from puretf.geometry import to_msg_msg as to_msg_msg
from puretf.geometry import transform_covariance as transform_covariance

_dummy_arm_tf2.submodules.import_on_use(__name__, 'tf2_geometry_msgs')
