"""Add a frame that is fixed to another frame; written for tf2_ros."""

from geometry_msgs.msg import TransformStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros import TransformBroadcaster


class FixedFrameBroadcaster(Node):
    """A node that publishes turtle1 -> carrot1 again and again."""

    def __init__(self):
        """Create the broadcaster and the timer."""
        super().__init__('fixed_frame_tf2_broadcaster')
        self.tf_broadcaster = TransformBroadcaster(self)
        self.timer = self.create_timer(0.1, self.broadcast_timer_callback)

    def broadcast_timer_callback(self):
        """Publish the frame, 2 m to the left of the turtle."""
        t = TransformStamped()
        t.header.stamp = self.get_clock().now().to_msg()
        t.header.frame_id = 'turtle1'
        t.child_frame_id = 'carrot1'
        t.transform.translation.x = 0.0
        t.transform.translation.y = 2.0
        t.transform.translation.z = 0.0
        t.transform.rotation.w = 1.0
        self.tf_broadcaster.sendTransform(t)


rclpy.init()
try:
    rclpy.spin(FixedFrameBroadcaster())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
