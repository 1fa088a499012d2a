"""
The functions of tf2_sensor_msgs, from `puretf.geometry`, and those that it imports.

`Buffer.transform` works for a PointCloud2 even if this module is not imported, unlike in tf2.
"""

from geometry_msgs.msg import Transform as Transform
from geometry_msgs.msg import TransformStamped as TransformStamped
from sensor_msgs.msg import PointCloud2 as PointCloud2
from sensor_msgs_py.point_cloud2 import create_cloud as create_cloud
from sensor_msgs_py.point_cloud2 import read_points as read_points

from puretf.geometry import do_transform_cloud as do_transform_cloud
from puretf.geometry import from_msg_msg as from_msg_msg
from puretf.geometry import to_msg_msg as to_msg_msg
from puretf.geometry import transform_points as transform_points
