"""`geometry_msgs/msg/TransformStamped` objects to rows of the wire, checked, and back."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
import math
from numbers import Real
import struct
from typing import Any, Optional, Union

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._core.times import SECOND
from dummy_arm.tf._wire import cdr

#: Whether messages check what they are assigned, as generated message modules decide it.
_CHECK_FIELDS: bool = TransformStamped()._check_fields

_FIELDS: tuple[tuple[str, Union[type, str]], ...] = (
    ('header', Header), ('header.stamp', Time),
    ('header.stamp.sec', 'i'), ('header.stamp.nanosec', 'I'), ('header.frame_id', str),
    ('child_frame_id', str), ('transform', Transform), ('transform.translation', Vector3),
    *((f'transform.translation.{axis}', 'd') for axis in 'xyz'),
    ('transform.rotation', Quaternion), *((f'transform.rotation.{axis}', 'd') for axis in 'xyzw'))
_FIELD_ERRORS = (ArithmeticError, AttributeError, TypeError, struct.error)
_KINDS = {'i': 'an int32', 'I': 'a uint32', 'd': 'a number'}


def serialize(transforms: Iterable[TransformStamped]) -> bytes:
    """
    Pack transforms into the bytes of a TFMessage.

    :raises ValueError: on a field whose value cannot be sent.
    """
    messages = list(transforms)
    with explain_bad_fields(messages):
        return cdr.pack_fields(map(fields_of, messages))


def deserialize(data: bytes) -> list[TransformStamped]:
    """
    Unpack the bytes of a TFMessage into transforms.

    :raises MalformedMessage: when they are none.
    """
    return [*map(message_of_fields, cdr.fields(data))]


def row_of(message: TransformStamped) -> Row:
    """
    Read a TransformStamped, without a check of its values.

    :raises TypeError: when it is none.
    """
    sec, nanosec, frame_id, child_frame_id, pose = fields_of(message)
    return Row(sec * SECOND + nanosec, frame_id, child_frame_id, pose)


def fields_of(message: TransformStamped) -> cdr.Fields:
    """
    Read the fields of a TransformStamped as they are, without a check of their values.

    :raises TypeError: when it is none.
    """
    if not isinstance(message, TransformStamped):
        raise TypeError(
            f'expected a TransformStamped, got {message!r} of type {type(message).__name__}')
    # By their slots: the properties of these sixteen fields cost as much as all the rest.
    header, transform = message._header, message._transform
    stamp, translation, rotation = header._stamp, transform._translation, transform._rotation
    return (stamp._sec, stamp._nanosec, header._frame_id, message._child_frame_id,
            (translation._x, translation._y, translation._z,
             rotation._x, rotation._y, rotation._z, rotation._w))


def message_of(row: Row) -> TransformStamped:
    """Build the TransformStamped of a row; as `message_of_fields`."""
    stamp_ns, frame_id, child_frame_id, pose = row
    return message_of_fields((*divmod(stamp_ns, SECOND), frame_id, child_frame_id, pose))


def message_of_fields(fields: cdr.Fields) -> TransformStamped:
    """
    Build the TransformStamped of its fields; by slots, at a tenth of what its constructors cost.

    The compiled conversion of generated messages takes what is in the slot of a float64 for a
    float, unchecked: an int there would become another number on the wire.

    :raises TypeError: or ValueError, when a value of the pose cannot become a float.
    """
    message, header, stamp = _new(TransformStamped), _new(Header), _new(Time)
    transform, translation, rotation = _new(Transform), _new(Vector3), _new(Quaternion)
    message._header, message._transform = header, transform
    header._stamp = stamp
    transform._translation, transform._rotation = translation, rotation
    (stamp._sec, stamp._nanosec, header._frame_id, message._child_frame_id,
     (x, y, z, qx, qy, qz, qw)) = fields
    # One by one: that takes a tenth of the time of any loop.
    translation._x, translation._y, translation._z = float(x), float(y), float(z)
    rotation._x, rotation._y, rotation._z = float(qx), float(qy), float(qz)
    rotation._w = float(qw)
    return message


def _new(message_type: type) -> Any:
    message: Any = object.__new__(message_type)
    message._check_fields = _CHECK_FIELDS
    return message


class explain_bad_fields:  # noqa: N801
    """Context that turns what goes wrong over a field of messages into a ValueError naming it."""

    def __init__(self, messages: Sequence[TransformStamped]) -> None:
        self._messages = messages

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Optional[type], *_: object) -> None:
        if kind is not None and issubclass(kind, _FIELD_ERRORS):
            for i, message in enumerate(self._messages):
                if isinstance(message, TransformStamped) and (problem := _bad_field(message)):
                    raise ValueError(
                        f'transform {i + 1} of {len(self._messages)}, to child '
                        f'{message.child_frame_id!r}: {problem}') from None


def _bad_field(message: TransformStamped) -> Optional[str]:
    """Tell of the first field whose value cannot be sent."""
    for path, kind in _FIELDS:
        value: Any = message
        for name in path.split('.'):
            value = getattr(value, name)
        if not _fits(value, kind):
            expected = _KINDS[kind] if isinstance(kind, str) else f'a {kind.__name__}'
            return f'{path} must be {expected}, got {value!r} of type {type(value).__name__}'
    return None


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
    """List one transform, or any iterable of them."""
    return list(transform) if isinstance(transform, Iterable) else [transform]


def fields_to_send(messages: Iterable[TransformStamped]) -> list[cdr.Fields]:
    """
    Read transforms that are to be broadcast.

    :raises TypeError: on an element that is no TransformStamped.
    :raises ValueError: on a transform that no buffer would take.
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
    Check the names of a transform that is to be broadcast.

    :raises ValueError: when one is empty or both are the same, a leading slash aside.
    """
    parent, child = frame_id.removeprefix('/'), child_frame_id.removeprefix('/')
    if not parent or not child:
        field = 'child_frame_id' if parent else 'header.frame_id'
        raise ValueError(
            f"transform '{frame_id}' -> '{child_frame_id}': {field} is empty; name the frame")
    if parent == child:
        raise ValueError(
            f"transform '{frame_id}' -> '{child_frame_id}': a frame cannot be its own parent; "
            'name two frames')


def check_pose(frame_id: str, child_frame_id: str, pose: Sequence[float]) -> None:
    """
    Check a pose x, y, z (m), qx, qy, qz, qw that is to be broadcast.

    :raises ValueError: when a number is not finite, or the quaternion cannot be normalised.
    """
    x, y, z, qx, qy, qz, qw = pose
    norm_squared = qx * qx + qy * qy + qz * qz + qw * qw
    rotates = 0.0 < norm_squared < math.inf
    if rotates and math.isfinite(x + y + z):
        return
    if not all(map(math.isfinite, pose)):
        raise ValueError(
            f"transform '{frame_id}' -> '{child_frame_id}': every number must be finite, got "
            f'translation ({x}, {y}, {z}), rotation ({qx}, {qy}, {qz}, {qw})')
    if not rotates:
        raise ValueError(
            f"transform '{frame_id}' -> '{child_frame_id}': the quaternion x, y, z, w = "
            f'({qx}, {qy}, {qz}, {qw}) cannot be normalised; no rotation is (0, 0, 0, 1)')


def check_poses(edges: Sequence[tuple[str, str]], poses: NDArray[np.float64]) -> None:
    """
    Check (n, 7) poses at once, as `check_pose` does, one for each (frame_id, child_frame_id).

    :raises ValueError: for the first pose that is bad.
    """
    rotations = poses[:, 3:]
    with np.errstate(over='ignore', invalid='ignore'):
        norms_squared = np.einsum('ij,ij->i', rotations, rotations)
        if norms_squared.min() > 0.0 and math.isfinite(poses.sum() + norms_squared.sum()):
            return
    for edge, pose in zip(edges, poses.tolist()):
        check_pose(*edge, pose)
