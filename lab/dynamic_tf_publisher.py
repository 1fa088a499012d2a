"""Task 2 of the lab: a frame that moves on a circle and keeps its orientation."""

from math import cos, sin

from geometry_msgs.msg import TransformStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros import TransformBroadcaster


class DynamicFramePublisher(Node):
    """A node that publishes map -> moving_frame ten times a second."""

    def __init__(self):
        """Start the timer."""
        super().__init__('dynamic_frame_publisher')
        self.broadcaster = TransformBroadcaster(self)
        self.angle = 0.0
        self.timer = self.create_timer(0.1, self.send)
        self.get_logger().info('publishing map -> moving_frame')

    def send(self):
        """Send the transform, and go on to the next angle."""
        message = TransformStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = 'map'
        message.child_frame_id = 'moving_frame'
        message.transform.translation.x = cos(self.angle)
        message.transform.translation.y = sin(self.angle)
        message.transform.rotation.w = 1.0
        self.broadcaster.sendTransform(message)
        self.angle += 0.1


def main():
    """Run the node until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(DynamicFramePublisher())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
