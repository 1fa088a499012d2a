"""A program beside dummy_arm.py that listens to it; written for tf2_ros."""

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time
import tf2_ros

rclpy.init()
node = rclpy.create_node('watch')
tf_buffer = tf2_ros.Buffer()
tf_listener = tf2_ros.TransformListener(tf_buffer, node)
t = tf_buffer.lookup_transform('map', 'joint_1', Time(), Duration(seconds=15))
print(f'joint_1 is {t.transform.translation.z:.1f} m above map', flush=True)
rclpy.try_shutdown()
