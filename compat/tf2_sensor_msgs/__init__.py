"""The names of tf2_sensor_msgs, from `dummy_arm.tf.geometry`."""

from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud as do_transform_cloud
from tf2_sensor_msgs.tf2_sensor_msgs import transform_points as transform_points
