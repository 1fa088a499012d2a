"""Task 4 of the lab: a frame that moves on a circle and turns, by Euler angles."""

from math import cos, sin

from geometry_msgs.msg import TransformStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros import TransformBroadcaster
from tf_transformations import quaternion_from_euler


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
        roll, pitch, yaw = 0.0, 0.0, self.angle
        x, y, z, w = quaternion_from_euler(roll, pitch, yaw)
        message.transform.rotation.x = x
        message.transform.rotation.y = y
        message.transform.rotation.z = z
        message.transform.rotation.w = w
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
