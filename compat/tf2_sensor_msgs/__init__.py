"""The names of tf2_sensor_msgs, from `puretf.geometry`."""

import _dummy_arm_tf2.submodules

from puretf.geometry import do_transform_cloud as do_transform_cloud
from puretf.geometry import transform_points as transform_points

_dummy_arm_tf2.submodules.import_on_use(__name__, 'tf2_sensor_msgs')
