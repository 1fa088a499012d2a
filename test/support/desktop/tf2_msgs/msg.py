"""A TFMessage as rosidl generates it; compiled code converts its transforms."""

from collections.abc import Collection
from os import getenv

from geometry_msgs.msg import TransformStamped
from rosidl_parser.definition import NamespacedType, UnboundedSequence


class Metaclass_TFMessage(type):  # noqa: N801
    """Metaclass of message 'TFMessage'."""

    _CREATE_ROS_MESSAGE = None
    _CONVERT_FROM_PY = None
    _CONVERT_TO_PY = None
    _DESTROY_ROS_MESSAGE = None
    _TYPE_SUPPORT = None

    @classmethod
    def __import_type_support__(cls):
        """Load the type support; rclpy calls this on demand."""
        from puretf._ros import rclpy_private
        from puretf._tf2_msgs import type_support
        if cls._TYPE_SUPPORT is None:
            rclpy_private.serialize = _serialize
            rclpy_private.install(TFMessage)
        cls._CREATE_ROS_MESSAGE = type_support.CREATE_ROS_MESSAGE
        cls._CONVERT_FROM_PY = type_support.CONVERT_FROM_PY
        cls._CONVERT_TO_PY = type_support.CONVERT_TO_PY
        cls._DESTROY_ROS_MESSAGE = type_support.DESTROY_ROS_MESSAGE
        cls._TYPE_SUPPORT = type_support.TYPE_SUPPORT


class TFMessage(metaclass=Metaclass_TFMessage):
    """Message class 'TFMessage'."""

    __slots__ = ['_transforms', '_check_fields']

    _fields_and_field_types = {'transforms': 'sequence<geometry_msgs/TransformStamped>'}

    SLOT_TYPES = (
        UnboundedSequence(NamespacedType(['geometry_msgs', 'msg'], 'TransformStamped')),)

    def __init__(self, **kwargs):
        """Create a message."""
        self._check_fields = kwargs.pop(
            'check_fields', getenv('ROS_PYTHON_CHECK_FIELDS', default='') == '1')
        self.transforms = kwargs.get('transforms', [])

    def __repr__(self):
        return f'tf2_msgs.msg.TFMessage(transforms={self.transforms!r})'

    def __eq__(self, other):
        return isinstance(other, TFMessage) and self.transforms == other.transforms

    @classmethod
    def get_fields_and_field_types(cls):
        """Get the fields' names and their types."""
        return cls._fields_and_field_types.copy()

    @property
    def transforms(self):
        """Message field 'transforms'."""
        return self._transforms

    @transforms.setter
    def transforms(self, value):
        if self._check_fields:
            assert isinstance(value, Collection)
            assert all(isinstance(element, TransformStamped) for element in value)
        self._transforms = value


def _serialize(transforms):
    """Serialize transforms, whose fields compiled code converts without a check."""
    from rclpy.serialization import deserialize_message, serialize_message

    from puretf._ros.transform_stamped import fields_of
    from puretf._wire import cdr
    return cdr.pack_fields(
        fields_of(deserialize_message(serialize_message(transform), TransformStamped))
        for transform in transforms)
