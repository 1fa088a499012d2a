"""The QoS of /tf and /tf_static, and publishing."""

from typing import Any, Optional, Union

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from puretf._ros.rclpy_private import RCLError
from puretf.exceptions import described

#: The profile of dynamic transforms, as in tf2_ros: reliable and volatile.
TF = QoSProfile(depth=100)
#: The profile of static transforms, as in tf2_ros: reliable, and latched by DDS. A publisher has
#: the depth 1.
TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def profile(qos: Optional[Union[QoSProfile, int]], default: QoSProfile) -> QoSProfile:
    """Return the profile for an argument: a profile, or None or a depth for the default's rest."""
    return qos if isinstance(qos, QoSProfile) else QoSProfile(
        depth=default.depth if qos is None else qos, durability=default.durability)


def check_node(node: Any, call: str) -> None:
    """Raise a TypeError that shows the right call if an argument is not a node."""
    if not hasattr(node, 'create_publisher'):
        raise TypeError(f'node must be a Node of rclpy, got {described(node)}: write {call}')


def publish(node: Node, publisher: Publisher, data: bytes) -> None:
    """Publish the bytes of a message; after a shutdown, raise an ExternalShutdownException."""
    try:
        publisher.publish(data)
    except (InvalidHandle, RCLError) as error:
        # Ctrl-C or SIGTERM has shut ROS down while a callback was about to send.
        if node.context.ok():
            raise
        raise ExternalShutdownException from error
