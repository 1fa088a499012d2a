"""Conversions and checks of messages of the type `geometry_msgs/msg/TransformStamped`."""

from collections.abc import Iterable, Sequence
from copy import copy
from functools import lru_cache
import math
from numbers import Real
import struct
from typing import Any, Optional, Union

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
import numpy as np
from numpy.typing import NDArray
from rclpy.time import Time as ClockTime
from std_msgs.msg import Header

from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._core.times import SECOND
from dummy_arm.tf._wire import cdr

#: True if the environment variable ROS_PYTHON_CHECK_FIELDS is '1'. Then messages check the values
#: that are assigned to their fields.
_CHECK_FIELDS: bool = TransformStamped()._check_fields

#: The path and the kind of each field of a TransformStamped. The kind of a number is its `struct`
#: format. The kind of any other field is its class.
_FIELDS: tuple[tuple[str, Union[type, str]], ...] = (
    ('header', Header), ('header.stamp', Time),
    ('header.stamp.sec', 'i'), ('header.stamp.nanosec', 'I'), ('header.frame_id', str),
    ('child_frame_id', str), ('transform', Transform), ('transform.translation', Vector3),
    *((f'transform.translation.{axis}', 'd') for axis in 'xyz'),
    ('transform.rotation', Quaternion), *((f'transform.rotation.{axis}', 'd') for axis in 'xyzw'))
#: The errors that can be raised when a message with a wrong value in a field is read or packed.
_FIELD_ERRORS = (ArithmeticError, AttributeError, TypeError, struct.error)
_KINDS = {'i': 'an int32', 'I': 'a uint32', 'd': 'a number'}


def serialize(transforms: Iterable[TransformStamped]) -> bytes:
    """
    Pack transforms into the bytes of a TFMessage.

    :param transforms: the transforms of the message.
    :returns: the bytes.
    :raises TypeError: if an element is not a TransformStamped.
    :raises ValueError: if the value of a field does not fit the type of the field.
    """
    messages = list(transforms)
    with explain_bad_fields(messages):
        return cdr.pack_fields(map(fields_of, messages))


def deserialize(data: bytes) -> list[TransformStamped]:
    """
    Unpack the bytes of a TFMessage into transforms.

    :param data: the bytes.
    :returns: the transforms of the message.
    :raises MalformedMessage: if the bytes are not those of a TFMessage.
    """
    return [*map(message_of_fields, cdr.fields(data))]


def row_of(message: TransformStamped) -> Row:
    """
    Read a TransformStamped, without checks of its values.

    :param message: the message.
    :returns: the stamp (ns), frame_id, child_frame_id and pose of the message.
    :raises TypeError: if `message` is not a TransformStamped.
    """
    try:
        sec, nanosec, frame_id, child_frame_id, pose = fields_of(message)
    except AttributeError:
        stamp = getattr(message.header, 'stamp', None)
        if not isinstance(stamp, ClockTime):
            raise
        # As in tf2_py, the stamp may be a Time of rclpy.
        message = copy(message)
        message.header = Header(stamp=stamp.to_msg(), frame_id=message.header.frame_id)
        return row_of(message)
    return Row(sec * SECOND + nanosec, frame_id, child_frame_id, pose)


def fields_of(message: TransformStamped) -> cdr.Fields:
    """
    Read the fields of a TransformStamped, without checks of their values.

    :param message: the message.
    :returns: sec, nanosec, frame_id, child_frame_id and pose. The pose is a tuple of x, y, z (m)
        and the quaternion x, y, z, w.
    :raises TypeError: if `message` is not a TransformStamped.
    """
    if not isinstance(message, TransformStamped):
        raise TypeError(
            f'expected a TransformStamped, got {message!r} of type {type(message).__name__}')
    # The slots (`_header`) are read instead of the properties (`header`), because the properties
    # would double the time of a conversion.
    header, transform = message._header, message._transform
    stamp, translation, rotation = header._stamp, transform._translation, transform._rotation
    return (stamp._sec, stamp._nanosec, header._frame_id, message._child_frame_id,
            (translation._x, translation._y, translation._z,
             rotation._x, rotation._y, rotation._z, rotation._w))


def message_of(row: Row) -> TransformStamped:
    """
    Create a TransformStamped from a row; see `message_of_fields`.

    :param row: stamp (ns), frame_id, child_frame_id and pose.
    :returns: the message.
    :raises TypeError: as in `message_of_fields`.
    :raises ValueError: as in `message_of_fields`.
    :raises OverflowError: as in `message_of_fields`.
    """
    stamp_ns, frame_id, child_frame_id, pose = row
    return message_of_fields((*divmod(stamp_ns, SECOND), frame_id, child_frame_id, pose))


def message_of_fields(fields: cdr.Fields) -> TransformStamped:
    """
    Create a TransformStamped from its fields.

    The values are assigned to the slots of the messages, because the constructors would take ten
    times as long. The numbers of the pose are converted to float, because rclpy's compiled code
    does not check what is in a slot. If the slot of a float64 field contained an int, the compiled
    code would send a wrong value.

    :param fields: sec, nanosec, frame_id, child_frame_id and pose. The pose is a tuple of x, y, z
        (m) and the quaternion x, y, z, w.
    :returns: the message.
    :raises TypeError: if a value in the pose is of a type that `float` does not accept.
    :raises ValueError: if a value in the pose is a str that `float` cannot parse.
    :raises OverflowError: if an integer in the pose is too large for a float.
    """
    message, header, stamp = _new(TransformStamped), _new(Header), _new(Time)
    transform, translation, rotation = _new(Transform), _new(Vector3), _new(Quaternion)
    message._header, message._transform = header, transform
    header._stamp = stamp
    transform._translation, transform._rotation = translation, rotation
    (stamp._sec, stamp._nanosec, header._frame_id, message._child_frame_id,
     (x, y, z, qx, qy, qz, qw)) = fields
    # The assignments are written out, because a loop would take ten times as long.
    translation._x, translation._y, translation._z = float(x), float(y), float(z)
    rotation._x, rotation._y, rotation._z = float(qx), float(qy), float(qz)
    rotation._w = float(qw)
    return message


def _new(message_type: type) -> Any:
    """Create a message without calling its constructor."""
    message: Any = object.__new__(message_type)
    message._check_fields = _CHECK_FIELDS
    return message


class explain_bad_fields:  # noqa: N801
    """
    A context manager that names the field that has caused an error.

    If a field with a wrong value has caused an error in the `with` block, the error is replaced by
    a ValueError that names the field and its value. Other errors are not changed.
    """

    def __init__(self, messages: Sequence[TransformStamped], accepts_clock_time: bool = False
                 ) -> None:
        """
        Create the context manager.

        :param messages: the transforms that are read or packed in the `with` block.
        :param accepts_clock_time: whether a stamp may be a Time of rclpy, as in `row_of`.
        """
        self._messages, self._accepts_clock_time = messages, accepts_clock_time

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Optional[type], *_: object) -> None:
        if kind is not None and issubclass(kind, _FIELD_ERRORS):
            for i, message in enumerate(self._messages):
                if isinstance(message, TransformStamped) and (
                        problem := _bad_field(message, self._accepts_clock_time)):
                    raise ValueError(
                        f'transform {i + 1} of {len(self._messages)}, to child '
                        f'{message.child_frame_id!r}: {problem}') from None


def _bad_field(message: TransformStamped, accepts_clock_time: bool) -> Optional[str]:
    """Describe the first field with a wrong value; return None if there is no such field."""
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
            return f'{path} must be {expected}, got {value!r} of type {type(value).__name__}'
    return None


def _fits(value: object, kind: Union[type, str]) -> bool:
    """Return True if a field of this kind may have this value; see `_FIELDS` for the kinds."""
    if isinstance(kind, type):
        return isinstance(value, kind)
    try:
        struct.pack(kind, value)
    except (ArithmeticError, TypeError, struct.error):
        return False
    return isinstance(value, Real)


def as_list(transform: Union[TransformStamped, Iterable[TransformStamped]]
            ) -> list[TransformStamped]:
    """
    Return one transform, or the transforms of an iterable, as a list.

    :param transform: a transform, or an iterable of transforms.
    :returns: the list.
    """
    return list(transform) if isinstance(transform, Iterable) else [transform]


def fields_to_send(messages: Iterable[TransformStamped]) -> list[cdr.Fields]:
    """
    Read and check transforms that are to be broadcast.

    :param messages: the transforms.
    :returns: the fields of each transform, as `fields_of` returns them.
    :raises TypeError: if an element is not a TransformStamped.
    :raises ValueError: if a name or a pose is not valid; see `check_edge` and `check_pose`.
    """
    transforms = []
    for message in messages:
        fields = fields_of(message)
        check_edge(*fields[2:4])
        check_pose(*fields[2:])
        transforms.append(fields)
    return transforms


@lru_cache(maxsize=4096)
def check_edge(frame_id: str, child_frame_id: str) -> None:
    """
    Check the frame names of a transform before it is broadcast; leading slashes are ignored.

    :param frame_id: the name of the parent.
    :param child_frame_id: the name of the child.
    :raises ValueError: if a name is empty, or both names are the same.
    """
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
    """
    Check a pose that is to be broadcast.

    :param frame_id: the name of the parent, for the text of the error.
    :param child_frame_id: the name of the child, for the text of the error.
    :param pose: x, y, z (m) and the quaternion x, y, z, w.
    :raises ValueError: if a number is not finite, or the quaternion cannot be normalised.
    """
    x, y, z, qx, qy, qz, qw = pose
    norm_squared = qx * qx + qy * qy + qz * qz + qw * qw
    is_rotation = 0.0 < norm_squared < math.inf
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


def check_poses(edges: Sequence[tuple[str, str]], poses: NDArray[np.float64]) -> None:
    """
    Check many poses at once, each as `check_pose` does.

    :param edges: the pair (frame_id, child_frame_id) of each of the n poses.
    :param poses: (n, 7) float64, n > 0: x, y, z (m) and the quaternion x, y, z, w of each pose.
    :raises ValueError: if a pose is not valid; the text names the first such pose.
    """
    rotations = poses[:, 3:]
    with np.errstate(over='ignore', invalid='ignore'):
        norms_squared = np.einsum('ij,ij->i', rotations, rotations)
        if norms_squared.min() > 0.0 and math.isfinite(poses.sum() + norms_squared.sum()):
            return
    for edge, pose in zip(edges, poses.tolist()):
        check_pose(*edge, pose)
