"""
A `tf2_msgs/msg/TFMessage` made at run time, where tf2_msgs is not installed.

rclpy converts a message between Python and C, and the middleware between C and bytes, by functions
that a compiler made. Python functions cannot stand in for them: Fast DDS calls them with its own
lock held, where waiting for the interpreter's lock is a deadlock as soon as two threads publish;
and a KeyboardInterrupt that hits a ctypes callback leaves its result undefined. So this message
takes the way that is open to every type: rclpy sends and takes bytes, and they are packed and
unpacked outside of the middleware (`wire.py`).
"""

from collections.abc import Collection
from functools import wraps
from typing import Any, Optional

from geometry_msgs.msg import TransformStamped
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import get_logger
from rosidl_parser.definition import NamespacedType, UnboundedSequence

from dummy_arm.tf import type_support, wire
from dummy_arm.tf.transform_stamped import (
    bad_fields_named,
    CHECK_FIELDS,
    fields_of,
    message_of_fields,
)


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
        self._check_fields = kwargs.pop('check_fields', CHECK_FIELDS)
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


def _serialize(message: TFMessage) -> bytes:
    transforms = list(message.transforms)
    with bad_fields_named(transforms):
        return wire.pack_fields(map(fields_of, transforms))


def _deserialize(data: bytes) -> TFMessage:
    return TFMessage(transforms=[*map(message_of_fields, wire.fields(data))])


def _teach_rclpy() -> None:
    """Have rclpy's compiled part hand every TFMessage over as bytes."""
    publish = _rclpy.Publisher.publish
    take_message = _rclpy.Subscription.take_message
    serialize = _rclpy.rclpy_serialize
    deserialize = _rclpy.rclpy_deserialize
    topics_complained_of = set()

    def publish_as_bytes(self: Any, message: Any) -> None:
        if isinstance(message, TFMessage):
            self.publish_raw(_serialize(message))
        else:
            publish(self, message)

    @wraps(take_message)
    def take_as_bytes(self: Any, message_type: type, raw: bool) -> Optional[tuple[Any, Any]]:
        if raw or not issubclass(message_type, TFMessage):
            return take_message(self, message_type, raw)  # type: ignore[no-any-return]
        taken = take_message(self, message_type, True)
        if taken is None:
            return None
        try:
            return _deserialize(taken[0]), taken[1]
        except wire.MalformedMessage as error:
            topic = self.get_topic_name()
            if topic not in topics_complained_of:
                topics_complained_of.add(topic)
                get_logger('tf').warning(f'dropped a message on {topic}: {error}')
            return None

    def serialize_as_bytes(message: Any, message_type: type) -> bytes:
        if isinstance(message, TFMessage):
            return _serialize(message)
        return serialize(message, message_type)  # type: ignore[no-any-return]

    def deserialize_as_bytes(data: bytes, message_type: type) -> Any:
        if issubclass(message_type, TFMessage):
            return _deserialize(data)
        return deserialize(data, message_type)

    _rclpy.Publisher.publish = publish_as_bytes
    _rclpy.Subscription.take_message = take_as_bytes
    _rclpy.rclpy_serialize = serialize_as_bytes
    _rclpy.rclpy_deserialize = deserialize_as_bytes


_teach_rclpy()
