"""The names of tf2_geometry_msgs, from `dummy_arm.tf.geometry`."""

from tf2_geometry_msgs.tf2_geometry_msgs import do_transform_point as do_transform_point
from tf2_geometry_msgs.tf2_geometry_msgs import (
    do_transform_polygon_stamped as do_transform_polygon_stamped,
)
from tf2_geometry_msgs.tf2_geometry_msgs import do_transform_pose as do_transform_pose
from tf2_geometry_msgs.tf2_geometry_msgs import (
    do_transform_pose_stamped as do_transform_pose_stamped,
)
from tf2_geometry_msgs.tf2_geometry_msgs import (
    do_transform_pose_with_covariance_stamped as do_transform_pose_with_covariance_stamped,
)
from tf2_geometry_msgs.tf2_geometry_msgs import do_transform_vector3 as do_transform_vector3
from tf2_geometry_msgs.tf2_geometry_msgs import from_msg_msg as from_msg_msg
from tf2_geometry_msgs.tf2_geometry_msgs import PointStamped as PointStamped
from tf2_geometry_msgs.tf2_geometry_msgs import PolygonStamped as PolygonStamped
from tf2_geometry_msgs.tf2_geometry_msgs import Pose as Pose
from tf2_geometry_msgs.tf2_geometry_msgs import PoseStamped as PoseStamped
from tf2_geometry_msgs.tf2_geometry_msgs import (
    PoseWithCovarianceStamped as PoseWithCovarianceStamped,
)
from tf2_geometry_msgs.tf2_geometry_msgs import to_msg_msg as to_msg_msg
from tf2_geometry_msgs.tf2_geometry_msgs import transform_covariance as transform_covariance
from tf2_geometry_msgs.tf2_geometry_msgs import TransformStamped as TransformStamped
from tf2_geometry_msgs.tf2_geometry_msgs import Vector3Stamped as Vector3Stamped
