"""The names of tf2_ros, from `dummy_arm.tf`."""

import _dummy_arm_tf2.ros  # noqa: F401
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

from tf2_ros.buffer import Buffer as Buffer
from tf2_ros.buffer import FrameGraph as FrameGraph
from tf2_ros.buffer import FrameGraphSrvRequest as FrameGraphSrvRequest
from tf2_ros.buffer import FrameGraphSrvResponse as FrameGraphSrvResponse
from tf2_ros.buffer_client import BufferClient as BufferClient
from tf2_ros.buffer_client import LookupTransform as LookupTransform
from tf2_ros.buffer_client import LookupTransformGoal as LookupTransformGoal
from tf2_ros.buffer_client import LookupTransformResult as LookupTransformResult
from tf2_ros.buffer_interface import BufferInterface as BufferInterface
from tf2_ros.buffer_interface import convert as convert
from tf2_ros.buffer_interface import ConvertRegistration as ConvertRegistration
from tf2_ros.buffer_interface import MsgStamped as MsgStamped
from tf2_ros.buffer_interface import NotImplementedException as NotImplementedException
from tf2_ros.buffer_interface import PyKDLType as PyKDLType
from tf2_ros.buffer_interface import Stamped as Stamped
from tf2_ros.buffer_interface import TransformableObject as TransformableObject
from tf2_ros.buffer_interface import TransformableObjectType as TransformableObjectType
from tf2_ros.buffer_interface import TransformRegistration as TransformRegistration
from tf2_ros.buffer_interface import TypeException as TypeException
from tf2_ros.static_transform_broadcaster import (
    StaticTransformBroadcaster as StaticTransformBroadcaster,
)
from tf2_ros.transform_broadcaster import TFMessage as TFMessage
from tf2_ros.transform_broadcaster import TransformBroadcaster as TransformBroadcaster
from tf2_ros.transform_listener import TransformListener as TransformListener
