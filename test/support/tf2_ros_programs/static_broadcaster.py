"""Publish a static transform from the arguments of the command line; written for tf2_ros."""

import sys

from geometry_msgs.msg import TransformStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
from tf_transformations import quaternion_from_euler


class StaticFramePublisher(Node):
    """A node that publishes one static transform."""

    def __init__(self, child, numbers):
        """Publish the transform from world to a child frame."""
        super().__init__('static_frame_publisher')
        self.tf_static_broadcaster = StaticTransformBroadcaster(self)
        t = TransformStamped()
        t.header.stamp = self.get_clock().now().to_msg()
        t.header.frame_id = 'world'
        t.child_frame_id = child
        t.transform.translation.x = numbers[0]
        t.transform.translation.y = numbers[1]
        t.transform.translation.z = numbers[2]
        quat = quaternion_from_euler(numbers[3], numbers[4], numbers[5])
        t.transform.rotation.x = quat[0]
        t.transform.rotation.y = quat[1]
        t.transform.rotation.z = quat[2]
        t.transform.rotation.w = quat[3]
        self.tf_static_broadcaster.sendTransform(t)


rclpy.init()
try:
    rclpy.spin(StaticFramePublisher(sys.argv[1], [float(text) for text in sys.argv[2:]]))
except (KeyboardInterrupt, ExternalShutdownException):
    pass
