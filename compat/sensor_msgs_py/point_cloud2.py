"""The names of sensor_msgs_py.point_cloud2, from `puretf.point_cloud2`."""

import _dummy_arm_tf2.ros  # noqa: F401
from sensor_msgs.msg import PointCloud2 as PointCloud2
from sensor_msgs.msg import PointField as PointField
from std_msgs.msg import Header as Header

from puretf.point_cloud2 import create_cloud as create_cloud
from puretf.point_cloud2 import create_cloud_xyz32 as create_cloud_xyz32
from puretf.point_cloud2 import dtype_from_fields as dtype_from_fields
from puretf.point_cloud2 import DUMMY_FIELD_PREFIX as DUMMY_FIELD_PREFIX
from puretf.point_cloud2 import read_points as read_points
from puretf.point_cloud2 import read_points_list as read_points_list
from puretf.point_cloud2 import read_points_numpy as read_points_numpy
