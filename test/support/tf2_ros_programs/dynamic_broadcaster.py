"""Publish the pose of a turtle that drives on a circle; written for tf2_ros."""

from math import cos, sin

from geometry_msgs.msg import TransformStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
import tf2_ros
import tf_transformations


class TurtleBroadcaster(Node):
    """A node that publishes world -> turtle1 on a circle of radius 2 m."""

    def __init__(self):
        """Create the broadcaster and the timer."""
        super().__init__('turtle_tf2_frame_publisher')
        self.tf_broadcaster = tf2_ros.TransformBroadcaster(self)
        self.start = self.get_clock().now()
        self.timer = self.create_timer(0.02, self.broadcast)

    def broadcast(self):
        """Publish the pose of now."""
        now = self.get_clock().now()
        angle = (now - self.start).nanoseconds / 1e9
        t = TransformStamped()
        t.header.stamp = now.to_msg()
        t.header.frame_id = 'world'
        t.child_frame_id = 'turtle1'
        t.transform.translation.x = 2.0 * cos(angle)
        t.transform.translation.y = 2.0 * sin(angle)
        q = tf_transformations.quaternion_from_euler(0, 0, angle + 1.5707963267948966)
        t.transform.rotation.x, t.transform.rotation.y = q[0], q[1]
        t.transform.rotation.z, t.transform.rotation.w = q[2], q[3]
        self.tf_broadcaster.sendTransform(t)


rclpy.init()
try:
    rclpy.spin(TurtleBroadcaster())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
