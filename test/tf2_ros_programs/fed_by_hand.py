"""A node with a buffer that it feeds itself from /tf and /tf_static; written for tf2_ros."""

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage
from tf2_ros.buffer import Buffer


class FedByHand(Node):
    """A node with a buffer."""

    def __init__(self, name):
        """Subscribe as a listener does."""
        super().__init__(name)
        self.buffer = Buffer(node=self)
        group = ReentrantCallbackGroup()
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(TFMessage, '/tf', self.on_tf, 100, callback_group=group)
        self.create_subscription(
            TFMessage, '/tf_static', self.on_static, latched, callback_group=group)

    def on_tf(self, message):
        """Insert what moves."""
        for transform in message.transforms:
            self.buffer.set_transform(transform, 'default_authority')

    def on_static(self, message):
        """Insert what is static."""
        for transform in message.transforms:
            self.buffer.set_transform_static(transform, 'default_authority')
