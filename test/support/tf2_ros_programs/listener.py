"""Follow a frame by lookups with a timeout in a timer; written for tf2_ros."""

import math

from geometry_msgs.msg import Twist
import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
import rclpy.time
from tf2_ros import TransformException
from tf2_ros.buffer import Buffer
from tf2_ros.transform_listener import TransformListener


class FrameListener(Node):
    """A node that computes the command with which a second turtle follows the first one."""

    def __init__(self):
        """Create the buffer, the listener, the publisher and the timer."""
        super().__init__('turtle_tf2_frame_listener')
        self.target_frame = self.declare_parameter(
            'target_frame', 'turtle1').get_parameter_value().string_value
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.publisher = self.create_publisher(Twist, 'turtle2/cmd_vel', 1)
        self.timer = self.create_timer(0.1, self.on_timer)

    def on_timer(self):
        """Look up the target, and publish a command."""
        try:
            t = self.tf_buffer.lookup_transform(
                'turtle2', self.target_frame, rclpy.time.Time(), timeout=Duration(seconds=1.0))
        except TransformException as ex:
            self.get_logger().info(f'Could not transform turtle2 to {self.target_frame}: {ex}')
            return
        msg = Twist()
        msg.angular.z = 1.0 * math.atan2(t.transform.translation.y, t.transform.translation.x)
        msg.linear.x = 0.5 * math.sqrt(
            t.transform.translation.x ** 2 + t.transform.translation.y ** 2)
        self.publisher.publish(msg)
        print(f'distance {2.0 * msg.linear.x:.3f}', flush=True)


rclpy.init()
try:
    rclpy.spin(FrameListener())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
