"""The types of tf2_msgs; if it is not installed, a TFMessage that is created at run time."""

from dummy_arm.tf._ros.rclpy_private import install

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    from dummy_arm.tf._tf2_msgs.tf_message import TFMessage

try:
    from tf2_msgs.srv import FrameGraph
except ImportError:
    FrameGraph = None

__all__ = ['FrameGraph', 'TFMessage']

install(TFMessage)
