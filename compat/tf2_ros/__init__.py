"""The names of tf2_ros, from `puretf`."""

from _dummy_arm_tf2.stamped import *  # noqa: F403
import _dummy_arm_tf2.submodules
from _dummy_arm_tf2.unavailable import *  # noqa: F403
from rclpy.duration import Duration as Duration
from rclpy.node import Node as Node
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.time import Time as Time
from std_msgs.msg import Header as Header
from tf2_py import *  # noqa: F403

from puretf import Buffer as Buffer
from puretf import StaticTransformBroadcaster as StaticTransformBroadcaster
from puretf import TFMessage as TFMessage
from puretf import TransformBroadcaster as TransformBroadcaster
from puretf import TransformListener as TransformListener
from puretf.buffer_interface import *  # noqa: F403

_dummy_arm_tf2.submodules.import_on_use(
    __name__, 'buffer', 'buffer_client', 'buffer_interface', 'static_transform_broadcaster',
    'transform_broadcaster', 'transform_listener')
