"""
The types TFMessage and FrameGraph of tf2_msgs.

If tf2_msgs is not installed, TFMessage is created at run time, and FrameGraph is None.
"""

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
