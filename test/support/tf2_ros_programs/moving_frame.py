"""Add a frame that moves around another frame; written for tf2_ros."""

import math

from geometry_msgs.msg import TransformStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros import TransformBroadcaster


class DynamicFrameBroadcaster(Node):
    """A node that publishes turtle1 -> carrot1, moving on a circle of radius 10 m."""

    def __init__(self):
        """Create the broadcaster and the timer."""
        super().__init__('dynamic_frame_tf2_broadcaster')
        self.tf_broadcaster = TransformBroadcaster(self)
        self.timer = self.create_timer(0.1, self.broadcast_timer_callback)

    def broadcast_timer_callback(self):
        """Publish the pose of now."""
        seconds, _ = self.get_clock().now().seconds_nanoseconds()
        x = seconds * math.pi
        t = TransformStamped()
        t.header.stamp = self.get_clock().now().to_msg()
        t.header.frame_id = 'turtle1'
        t.child_frame_id = 'carrot1'
        t.transform.translation.x = 10 * math.sin(x)
        t.transform.translation.y = 10 * math.cos(x)
        t.transform.translation.z = 0.0
        t.transform.rotation.x = 0.0
        t.transform.rotation.y = 0.0
        t.transform.rotation.z = 0.0
        t.transform.rotation.w = 1.0
        self.tf_broadcaster.sendTransform(t)


rclpy.init()
try:
    rclpy.spin(DynamicFrameBroadcaster())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
