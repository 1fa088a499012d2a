"""The names of tf2_ros, from `dummy_arm.tf`."""

import _dummy_arm_tf2.ros
import _dummy_arm_tf2.submodules
from _dummy_arm_tf2.unavailable import BufferClient as BufferClient
from _dummy_arm_tf2.unavailable import FrameGraph as FrameGraph
from _dummy_arm_tf2.unavailable import FrameGraphSrvRequest as FrameGraphSrvRequest
from _dummy_arm_tf2.unavailable import FrameGraphSrvResponse as FrameGraphSrvResponse
from _dummy_arm_tf2.unavailable import LookupTransform as LookupTransform
from _dummy_arm_tf2.unavailable import LookupTransformGoal as LookupTransformGoal
from _dummy_arm_tf2.unavailable import LookupTransformResult as LookupTransformResult
from geometry_msgs.msg import PointStamped as PointStamped
from geometry_msgs.msg import PoseStamped as PoseStamped
from geometry_msgs.msg import PoseWithCovarianceStamped as PoseWithCovarianceStamped
from geometry_msgs.msg import TransformStamped as TransformStamped
from geometry_msgs.msg import Vector3Stamped as Vector3Stamped
from rclpy.duration import Duration as Duration
from rclpy.node import Node as Node
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.time import Time as Time
from std_msgs.msg import Header as Header
from tf2_py import BufferCore as BufferCore
from tf2_py import ConnectivityException as ConnectivityException
from tf2_py import ExtrapolationException as ExtrapolationException
from tf2_py import InvalidArgumentException as InvalidArgumentException
from tf2_py import LookupException as LookupException
from tf2_py import TimeoutException as TimeoutException
from tf2_py import TransformException as TransformException

from dummy_arm.tf import Buffer as Buffer
from dummy_arm.tf import BufferInterface as BufferInterface
from dummy_arm.tf import convert as convert
from dummy_arm.tf import ConvertRegistration as ConvertRegistration
from dummy_arm.tf import MsgStamped as MsgStamped
from dummy_arm.tf import NotImplementedException as NotImplementedException
from dummy_arm.tf import PyKDLType as PyKDLType
from dummy_arm.tf import Stamped as Stamped
from dummy_arm.tf import StaticTransformBroadcaster as StaticTransformBroadcaster
from dummy_arm.tf import TFMessage as TFMessage
from dummy_arm.tf import TransformableObject as TransformableObject
from dummy_arm.tf import TransformableObjectType as TransformableObjectType
from dummy_arm.tf import TransformBroadcaster as TransformBroadcaster
from dummy_arm.tf import TransformListener as TransformListener
from dummy_arm.tf import TransformRegistration as TransformRegistration
from dummy_arm.tf import TypeException as TypeException

_dummy_arm_tf2.submodules.import_on_use(
    __name__, 'buffer', 'buffer_client', 'buffer_interface', 'static_transform_broadcaster',
    'transform_broadcaster', 'transform_listener')
