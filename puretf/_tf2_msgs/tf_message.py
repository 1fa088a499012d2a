"""
The class `tf2_msgs/msg/TFMessage`, created at run time where tf2_msgs is not installed.

The functions with which the middleware converts a message to bytes cannot be written in Python.
Fast DDS holds a lock while it calls them, and they would wait for the GIL: a deadlock. And Ctrl-C
in a function that C calls through ctypes makes its result undefined. So rclpy exchanges a
TFMessage with the middleware as bytes; see `install` in `_ros/rclpy_private.py`.
"""

from collections.abc import Collection
from typing import Any

from geometry_msgs.msg import TransformStamped
from rosidl_parser.definition import NamespacedType, UnboundedSequence

from puretf._tf2_msgs import type_support

#: As in generated messages.
_CHECK_FIELDS: bool = TransformStamped()._check_fields


class Metaclass_TFMessage(type):  # noqa: N801
    """The metaclass of TFMessage, with the attributes that rclpy reads."""

    _CREATE_ROS_MESSAGE = type_support.CREATE_ROS_MESSAGE
    _CONVERT_FROM_PY = type_support.CONVERT_FROM_PY
    _CONVERT_TO_PY = type_support.CONVERT_TO_PY
    _DESTROY_ROS_MESSAGE = type_support.DESTROY_ROS_MESSAGE
    _TYPE_SUPPORT = type_support.TYPE_SUPPORT

    @classmethod
    def __import_type_support__(cls) -> None:
        """Do nothing, because the import of this module has created the type support."""


class TFMessage(metaclass=Metaclass_TFMessage):
    """The message, with the interface of a generated message class."""

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
        return cls._fields_and_field_types.copy()

    @property
    def transforms(self) -> Any:
        return self._transforms

    @transforms.setter
    def transforms(self, value: Any) -> None:
        if self._check_fields:
            assert (isinstance(value, Collection) and not isinstance(value, (str, dict))
                    and all(isinstance(element, TransformStamped) for element in value)), \
                "The 'transforms' field must be a set or sequence of 'TransformStamped'"
        self._transforms = value
