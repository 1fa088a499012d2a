"""A robot arm with one joint, in a program with the name of the course's task; for tf2_ros."""

import math

from geometry_msgs.msg import TransformStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster
from tf_transformations import quaternion_from_euler


class DummyArm(Node):
    """A node that publishes map -> base_link -> joint_1."""

    def __init__(self):
        """Publish the static transform, and create the timer."""
        super().__init__('dummy_arm')
        self.static_broadcaster = StaticTransformBroadcaster(self)
        self.broadcaster = TransformBroadcaster(self)
        self.static_broadcaster.sendTransform(self.transform('map', 'base_link', 0.0, 0.0))
        self.start = self.get_clock().now()
        self.create_timer(0.02, self.on_timer)

    def transform(self, parent, child, z, yaw):
        """Return a transform that is stamped now."""
        t = TransformStamped()
        t.header.stamp = self.get_clock().now().to_msg()
        t.header.frame_id = parent
        t.child_frame_id = child
        t.transform.translation.z = z
        q = quaternion_from_euler(0.0, 0.0, yaw)
        t.transform.rotation.x = q[0]
        t.transform.rotation.y = q[1]
        t.transform.rotation.z = q[2]
        t.transform.rotation.w = q[3]
        return t

    def on_timer(self):
        """Publish the joint."""
        t = (self.get_clock().now() - self.start).nanoseconds / 1e9
        self.broadcaster.sendTransform(
            self.transform('base_link', 'joint_1', 0.3, math.pi / 4 * math.sin(0.3 * t)))


def main():
    """Run the node until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(DummyArm())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
