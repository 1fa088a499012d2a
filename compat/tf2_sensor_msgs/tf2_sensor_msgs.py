"""
The functions of tf2_sensor_msgs, from `puretf.geometry`.

`Buffer.transform` works for a PointCloud2 even if this module is not imported, unlike in tf2.
"""

import _dummy_arm_tf2.ros  # noqa: F401

from puretf.geometry import do_transform_cloud as do_transform_cloud
from puretf.geometry import from_msg_msg as from_msg_msg
from puretf.geometry import to_msg_msg as to_msg_msg
from puretf.geometry import transform_points as transform_points
