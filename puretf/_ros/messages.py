"""The types TFMessage and FrameGraph; without tf2_msgs, a class made at run time, and None."""

from importlib.util import find_spec
from pathlib import Path

from puretf._ros.rclpy_private import install

_spec = find_spec('tf2_msgs')
# The tf2_msgs of dummy-arm-tf2 has no type support.
if _spec is not None and any(any(Path(directory).glob('*_s__rosidl_typesupport_c*'))
                             for directory in _spec.submodule_search_locations or ()):
    from tf2_msgs.msg import TFMessage
    from tf2_msgs.srv import FrameGraph
else:
    from puretf._tf2_msgs.tf_message import TFMessage
    FrameGraph = None
    install(TFMessage)

__all__ = ['FrameGraph', 'TFMessage']
