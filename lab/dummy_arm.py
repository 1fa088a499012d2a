"""The final task of the lab: an arm with three joints that wave."""

from math import cos, radians, sin

from geometry_msgs.msg import TransformStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

# Each joint: its parent, its name, its position in the parent (m), the speed of its phase (rad/s),
# and the largest angle in both directions (rad).
JOINTS = [
    ('base_link', 'joint_1', (0.0, 0.0, 0.3), 0.3, radians(45)),
    ('joint_1', 'joint_2', (0.4, 0.0, 0.0), 0.5, radians(30)),
    ('joint_2', 'joint_3', (0.3, 0.0, 0.0), 0.7, radians(60)),
    ('joint_3', 'end_effector', (0.2, 0.0, 0.0), 0.0, 0.0)]


class DummyArm(Node):
    """A node that publishes map -> base_link once, and the rest of the arm 50 times a second."""

    def __init__(self):
        """Send the static transform, and start the timer."""
        super().__init__('dummy_arm')
        self.static_broadcaster = StaticTransformBroadcaster(self)
        self.broadcaster = TransformBroadcaster(self)
        self.static_broadcaster.sendTransform(self.transform(
            self.get_clock().now(), 'map', 'base_link', (0.0, 0.0, 0.0), 0.0))
        self.start = self.get_clock().now()
        self.timer = self.create_timer(0.02, self.send)
        self.get_logger().info('publishing the arm')

    def transform(self, time, parent, child, position, angle):
        """Return the transform of a frame that is rotated about z by an angle (rad)."""
        message = TransformStamped()
        message.header.stamp = time.to_msg()
        message.header.frame_id = parent
        message.child_frame_id = child
        x, y, z = position
        message.transform.translation.x = x
        message.transform.translation.y = y
        message.transform.translation.z = z
        message.transform.rotation.z = sin(angle / 2)
        message.transform.rotation.w = cos(angle / 2)
        return message

    def send(self):
        """Send the transforms of all joints; they have the same stamp."""
        now = self.get_clock().now()
        t = (now - self.start).nanoseconds * 1e-9
        self.broadcaster.sendTransform([
            self.transform(now, parent, joint, position, limit * sin(speed * t))
            for parent, joint, position, speed, limit in JOINTS])


def main():
    """Run the node until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(DummyArm())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
