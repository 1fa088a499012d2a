"""Conversions and checks of messages of the type `geometry_msgs/msg/TransformStamped`."""

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from functools import lru_cache
import math
from numbers import Real
from operator import index
import struct
from typing import Any, Optional, Union

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy.time import Time as ClockTime
from std_msgs.msg import Header

from puretf._core.pose import Row
from puretf._core.times import written
from puretf._text.names import abbreviated
from puretf._text.times import SECOND
from puretf._wire import cdr
from puretf._wire.encoding import CDR, Fields
from puretf.exceptions import described, is_of_rosbags
from puretf.transform import Transform as OurTransform

#: True if ROS_PYTHON_CHECK_FIELDS is '1': messages check the values of their fields.
_CHECK_FIELDS: bool = TransformStamped()._check_fields

#: The path and the kind of each field: the `struct` format of a number, the class of others.
_FIELDS: tuple[tuple[str, Union[type, str]], ...] = (
    ('header', Header), ('header.stamp', Time),
    ('header.stamp.sec', 'i'), ('header.stamp.nanosec', 'I'), ('header.frame_id', str),
    ('child_frame_id', str), ('transform', Transform), ('transform.translation', Vector3),
    *((f'transform.translation.{axis}', 'd') for axis in 'xyz'),
    ('transform.rotation', Quaternion), *((f'transform.rotation.{axis}', 'd') for axis in 'xyzw'))
#: The errors that a wrong value in a field can raise.
_FIELD_ERRORS = (ArithmeticError, AttributeError, TypeError, struct.error)
_KINDS = {'i': 'an int32', 'I': 'a uint32', 'd': 'a number'}
#: Creates a message without calling its constructor.
_new: Any = object.__new__


def serialize(transforms: Iterable[TransformStamped]) -> bytes:
    """Pack transforms into the bytes of a TFMessage; raise a ValueError that names a bad field."""
    messages = list(transforms)
    with explain_bad_fields(messages):
        return cdr.pack_fields(map(fields_of, messages))


def deserialize(data: bytes) -> list[TransformStamped]:
    """Unpack the bytes of a TFMessage, or raise a MalformedMessage."""
    return [*map(message_of_fields, CDR.fields(data))]


def row_of(message: TransformStamped) -> Row:
    """Read a TransformStamped, without checks of its values; the stamp may be a Time of rclpy."""
    try:
        sec, nanosec, frame_id, child_frame_id, pose = fields_of(message)
    except AttributeError:
        stamp = getattr(message.header, 'stamp', None)
        if not isinstance(stamp, ClockTime):
            raise
        message = copy(message)
        message.header = Header(stamp=stamp.to_msg(), frame_id=message.header.frame_id)
        return row_of(message)
    # Integers of numpy would overflow.
    return Row(index(sec) * SECOND + index(nanosec), frame_id, child_frame_id, pose)


def fields_of(message: TransformStamped) -> Fields:
    """Read the fields of a TransformStamped, without checks of their values."""
    if not isinstance(message, TransformStamped):
        raise TypeError(f'expected a TransformStamped, got {described(message)}'
                        f'{_how_to_convert(message)}')
    # The slots are read, because the properties would double the time of a conversion.
    header, transform = message._header, message._transform
    stamp, translation, rotation = header._stamp, transform._translation, transform._rotation
    return (stamp._sec, stamp._nanosec, header._frame_id, message._child_frame_id,
            (translation._x, translation._y, translation._z,
             rotation._x, rotation._y, rotation._z, rotation._w))


def _how_to_convert(value: object) -> str:
    """Return the remedy if something else than a TransformStamped was given; '' if unknown."""
    if is_of_rosbags(value):
        return (': read the bag by puretf.bag.read, or insert '
                'Transform.from_message(message) into a TransformBuffer')
    if isinstance(value, OurTransform):
        return ': a TransformBuffer takes Transforms'
    if hasattr(value, 'transforms') or isinstance(value, (list, tuple)):
        return ': pass each of its transforms'
    return ''


def message_of_fields(fields: Fields) -> TransformStamped:
    """
    Create a TransformStamped from its fields.

    The values are assigned to slots, because the constructors would take ten times as long. The
    numbers must be float: rclpy's compiled code would send a wrong value for an int.
    """
    message, header, stamp = _new(TransformStamped), _new(Header), _new(Time)
    transform, translation, rotation = _new(Transform), _new(Vector3), _new(Quaternion)
    message._check_fields = header._check_fields = stamp._check_fields = _CHECK_FIELDS
    transform._check_fields = translation._check_fields = rotation._check_fields = _CHECK_FIELDS
    message._header, message._transform = header, transform
    header._stamp = stamp
    transform._translation, transform._rotation = translation, rotation
    (stamp._sec, stamp._nanosec, header._frame_id, message._child_frame_id,
     (translation._x, translation._y, translation._z,
      rotation._x, rotation._y, rotation._z, rotation._w)) = fields
    return message


class explain_bad_fields:  # noqa: N801
    """
    A context manager that replaces errors by a ValueError that names the bad field.

    Errors stay as they are if no field of the transforms has a wrong value. As a generator, it
    would cost as much as half of a message.
    """

    def __init__(self, messages: Sequence[TransformStamped], accepts_clock_time: bool = False
                 ) -> None:
        """Take the messages; `accepts_clock_time`: a stamp may be a Time of rclpy."""
        self._messages, self._accepts_clock_time = messages, accepts_clock_time

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Optional[type], *_: object) -> None:
        if kind is not None and issubclass(kind, _FIELD_ERRORS):
            for i, message in enumerate(self._messages, 1):
                if isinstance(message, TransformStamped) and (
                        problem := _bad_field(message, self._accepts_clock_time)):
                    raise ValueError(
                        f'transform {i} of {len(self._messages)}, to child '
                        f'{abbreviated(repr(message.child_frame_id))}: {problem}') from None


def _bad_field(message: TransformStamped, accepts_clock_time: bool) -> Optional[str]:
    """Describe the first field with a wrong value."""
    is_clock_time = accepts_clock_time and isinstance(
        getattr(message.header, 'stamp', None), ClockTime)
    for path, kind in _FIELDS:
        if is_clock_time and path.startswith('header.stamp'):
            continue
        value: Any = message
        for name in path.split('.'):
            value = getattr(value, name)
        if not _fits(value, kind):
            expected = _KINDS[kind] if isinstance(kind, str) else f'a {kind.__name__}'
            if kind is Time:
                expected += ' message'
            remedy = _remedy(path, kind, value)
            return (f'{path} must be {expected}, got {described(value)}'
                    f'{remedy and f": write {remedy}"}')
    return None


def _remedy(path: str, kind: Union[type, str], value: object) -> str:
    """Return what to write in place of a value of a wrong type; '' if that is not known."""
    time = written(value, 'rclpy.time.Time')
    if kind is Time:
        return ('.to_msg() after it' if isinstance(value, ClockTime) else
                f'{time}.to_msg(), or ' * bool(time) + 'clock.now().to_msg()')
    if path.startswith('header.stamp.') and time:
        return f'header.stamp = {time}.to_msg()'
    return ('Vector3(x=x, y=y, z=z)' if kind is Vector3 else
            'Quaternion(x=x, y=y, z=z, w=w)' if kind is Quaternion else '')


def _fits(value: object, kind: Union[type, str]) -> bool:
    if isinstance(kind, type):
        return isinstance(value, kind)
    try:
        struct.pack(kind, value)
    except (ArithmeticError, TypeError, struct.error):
        return False
    return isinstance(value, Real)


def as_list(transform: Union[TransformStamped, Iterable[TransformStamped]]
            ) -> list[TransformStamped]:
    is_several = isinstance(transform, Iterable) and not isinstance(transform, OurTransform)
    return list(transform) if is_several else [transform]


def fields_to_send(messages: Iterable[TransformStamped]) -> Iterator[Fields]:
    """Read and check transforms that are to be broadcast."""
    for fields in map(fields_of, messages):
        check_edge(*fields[2:4])
        check_pose(*fields[2:])
        yield fields


@lru_cache(maxsize=4096)
def check_edge(frame_id: str, child_frame_id: str) -> None:
    """Raise a ValueError if a name is empty or both are equal, apart from leading slashes."""
    parent, child = frame_id.removeprefix('/'), child_frame_id.removeprefix('/')
    if not parent or not child:
        field = 'child_frame_id' if parent else 'header.frame_id'
        raise ValueError(
            f"transform '{frame_id}' -> '{child_frame_id}': {field} is empty; name the frame")
    if parent == child:
        raise ValueError(
            f"transform '{frame_id}' -> '{child_frame_id}': a frame cannot be its own parent; "
            'use two different names')


def check_pose(frame_id: str, child_frame_id: str, pose: Sequence[float]) -> None:
    """Raise a ValueError if a number is not finite, or the quaternion cannot be normalised."""
    x, y, z, qx, qy, qz, qw = pose
    is_rotation = 0.0 < qx * qx + qy * qy + qz * qz + qw * qw < math.inf  # as `normalized`
    if is_rotation and math.isfinite(x + y + z):
        return
    if not all(map(math.isfinite, pose)):
        raise ValueError(
            f"transform '{frame_id}' -> '{child_frame_id}': every number must be finite, got "
            f'translation ({x}, {y}, {z}), rotation ({qx}, {qy}, {qz}, {qw})')
    if not is_rotation:
        raise ValueError(
            f"transform '{frame_id}' -> '{child_frame_id}': the quaternion x, y, z, w = "
            f'({qx}, {qy}, {qz}, {qw}) cannot be normalised; use (0, 0, 0, 1) for no rotation')

