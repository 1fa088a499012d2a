"""
A `tf2_msgs/msg/TFMessage` made at run time, where tf2_msgs is not installed.

rclpy converts a message between Python and C, and the middleware between C and bytes, by functions
that a compiler made. Python functions cannot stand in for them: Fast DDS calls them with its own
lock held, where waiting for the interpreter's lock is a deadlock as soon as two threads publish;
and a KeyboardInterrupt that hits a ctypes callback leaves its result undefined. So this message
takes the way that is open to every type: rclpy sends and takes bytes, and they are packed and
unpacked outside of the middleware (`install` in `_ros/rclpy_private.py`).
"""

from collections.abc import Collection
from typing import Any

from geometry_msgs.msg import TransformStamped
from rosidl_parser.definition import NamespacedType, UnboundedSequence

from dummy_arm.tf._tf2_msgs import type_support

#: Whether messages check what they are assigned, as generated message modules decide it.
_CHECK_FIELDS: bool = TransformStamped()._check_fields


class Metaclass_TFMessage(type):  # noqa: N801
    """What rclpy asks of the class of a message class."""

    _CREATE_ROS_MESSAGE = type_support.CREATE_ROS_MESSAGE
    _CONVERT_FROM_PY = type_support.CONVERT_FROM_PY
    _CONVERT_TO_PY = type_support.CONVERT_TO_PY
    _DESTROY_ROS_MESSAGE = type_support.DESTROY_ROS_MESSAGE
    _TYPE_SUPPORT = type_support.TYPE_SUPPORT

    @classmethod
    def __import_type_support__(cls) -> None:
        """Do nothing: the type support was made on import."""


class TFMessage(metaclass=Metaclass_TFMessage):
    """Message class 'TFMessage'."""

    __slots__ = ['_transforms', '_check_fields']

    _fields_and_field_types = {'transforms': 'sequence<geometry_msgs/TransformStamped>'}

    SLOT_TYPES = (
        UnboundedSequence(NamespacedType(['geometry_msgs', 'msg'], 'TransformStamped')),)

    def __init__(self, **kwargs: Any) -> None:
        self._check_fields = kwargs.pop('check_fields', _CHECK_FIELDS)
        if self._check_fields:
            unknown = sorted(kwargs.keys() - self._fields_and_field_types.keys())
            assert not unknown, f'Invalid arguments passed to constructor: {", ".join(unknown)}'
        self.transforms = kwargs.get('transforms', [])

    def __repr__(self) -> str:
        return f'tf2_msgs.msg.TFMessage(transforms={self.transforms!r})'

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TFMessage) and self.transforms == other.transforms

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Get the fields' names and their types."""
        return cls._fields_and_field_types.copy()

    @property
    def transforms(self) -> Any:
        """Message field 'transforms'."""
        return self._transforms

    @transforms.setter
    def transforms(self, value: Any) -> None:
        if self._check_fields:
            assert (isinstance(value, Collection) and not isinstance(value, (str, dict))
                    and all(isinstance(element, TransformStamped) for element in value)), \
                "The 'transforms' field must be a set or sequence of 'TransformStamped'"
        self._transforms = value
