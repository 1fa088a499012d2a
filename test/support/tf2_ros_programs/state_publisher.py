"""Publish the joints and the pose of a robot, as in the tutorials about URDF; for tf2_ros."""

from math import cos, pi, sin

from geometry_msgs.msg import Quaternion
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState
from tf2_ros import TransformBroadcaster, TransformStamped


def euler_to_quaternion(roll, pitch, yaw):
    """Return the quaternion of three angles."""
    cr, sr, cp, sp = cos(roll / 2), sin(roll / 2), cos(pitch / 2), sin(pitch / 2)
    cy, sy = cos(yaw / 2), sin(yaw / 2)
    return Quaternion(
        x=sr * cp * cy - cr * sp * sy, y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy, w=cr * cp * cy + sr * sp * sy)


class StatePublisher(Node):
    """A node that publishes joint states, and odom -> axis on a circle of radius 2 m."""

    def __init__(self):
        """Create the publishers and the timer."""
        super().__init__('state_publisher')
        self.joint_pub = self.create_publisher(JointState, 'joint_states', 10)
        self.broadcaster = TransformBroadcaster(self)
        self.angle = 0.0
        self.odom_trans = TransformStamped()
        self.odom_trans.header.frame_id = 'odom'
        self.odom_trans.child_frame_id = 'axis'
        self.create_timer(1 / 30, self.on_timer)

    def on_timer(self):
        """Publish the joints and the transform."""
        now = self.get_clock().now()
        joint_state = JointState()
        joint_state.header.stamp = now.to_msg()
        joint_state.name = ['swivel']
        joint_state.position = [self.angle]
        self.odom_trans.header.stamp = now.to_msg()
        self.odom_trans.transform.translation.x = cos(self.angle) * 2
        self.odom_trans.transform.translation.y = sin(self.angle) * 2
        self.odom_trans.transform.translation.z = 0.7
        self.odom_trans.transform.rotation = euler_to_quaternion(0, 0, self.angle + pi / 2)
        self.joint_pub.publish(joint_state)
        self.broadcaster.sendTransform(self.odom_trans)
        self.angle += pi / 180 / 4


rclpy.init()
try:
    rclpy.spin(StatePublisher())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
