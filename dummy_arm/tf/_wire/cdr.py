"""
Serialisation of `tf2_msgs/msg/TFMessage` in CDR.

A message is in plain CDR (XCDR1), as every RMW of Jazzy sends it:

    00 01 00 00          encapsulation: 00 00 (big-endian) or 00 01 (little-endian); then two bytes
                         of options
    uint32               number of transforms. Positions are counted from the start of this field.
    for each transform:
      int32, uint32      stamp: seconds, nanoseconds; begins at the next multiple of 4
      string, string     frame_id, child_frame_id. Each begins at the next multiple of 4 with the
                         length (uint32, in bytes, including the NUL). The name in UTF-8 and a NUL
                         follow.
      float64 x 3        translation x y z (m); begins at the next multiple of 8
      float64 x 4        rotation, quaternion x y z w
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
import struct

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dummy_arm.tf._core.pose import IDENTITY, Pose, POSE_BYTES, Row
from dummy_arm.tf._core.times import SECOND

_ENCAPSULATION = b'\x00\x01\x00\x00'
_BYTE_ORDER = {b'\x00\x00': '>', b'\x00\x01': '<'}
#: The position of the first frame_id, counted from the first byte of the message.
_FIRST_NAME = 16
_SMALLEST_TRANSFORM = 4 + 4 + 4 + 4 + POSE_BYTES
_pack_stamp = struct.Struct('<iI').pack
_pack_pose = struct.Struct('<7d').pack


class MalformedMessage(ValueError):
    """The bytes are not a TFMessage; the error text before the colon names the kind of fault."""


def _pack_name(name: str) -> bytes:
    try:
        text = name.encode()
    except UnicodeEncodeError as error:
        raise ValueError(f'frame id {name!r} must be valid Unicode: {error}') from None
    if b'\0' in text:
        raise ValueError(f'frame id {name!r} must not contain a NUL character')
    return struct.pack('<I', len(text) + 1) + text + b'\0'


@lru_cache(maxsize=4096)
def _pack_names(frame_id: str, child_frame_id: str, position: int) -> bytes:
    """Pack both names, each with its padding; `position` (modulo 8) is where frame_id begins."""
    packed = b''
    for name, alignment in ((frame_id, 4), (child_frame_id, 8)):
        packed += _pack_name(name)
        packed += bytes(-(position + len(packed)) % alignment)
    return packed


#: The fields of one transform: sec, nanosec, frame_id, child_frame_id, pose. In received messages,
#: nanosec may be 10**9 or more.
Fields = tuple[int, int, str, str, Pose]


def pack(rows: Iterable[Row]) -> bytes:
    """
    Serialise transforms to the bytes of one message.

    :param rows: the transforms.
    :returns: the message, little-endian.
    :raises ValueError: as `pack_fields`, and if the seconds of a stamp do not fit an int32.
    :raises struct.error: as `pack_fields`.
    """
    return pack_fields((*split_stamp(row.stamp_ns), *row[1:]) for row in map(Row._make, rows))


def pack_fields(transforms: Iterable[Fields]) -> bytes:
    """
    Serialise the fields of transforms to the bytes of one message.

    :param transforms: the fields of each transform.
    :returns: the message, little-endian.
    :raises ValueError: if a frame id contains a NUL or is not valid Unicode.
    :raises struct.error: if a value is not a number or does not fit its field.
    """
    parts = []
    position = 4
    for sec, nanosec, frame_id, child_frame_id, pose in transforms:
        parts.append(_pack_stamp(sec, nanosec))
        parts.append(_pack_names(frame_id, child_frame_id, position + 8 & 7))
        parts.append(_pack_pose(*pose))
        position = 0
    count = struct.pack('<I', len(parts) // 3)
    return b''.join((_ENCAPSULATION, count, *parts))


def unpack(data: bytes) -> list[Row]:
    """
    Deserialise a message.

    :param data: the message, of either byte order.
    :returns: the transforms.
    :raises MalformedMessage: as `fields`.
    :raises TypeError: as `fields`.
    """
    return list(rows(data))


def rows(data: bytes) -> Iterator[Row]:
    """
    Deserialise a message, one transform after the other.

    :param data: the message, of either byte order.
    :returns: an iterator over the transforms.
    :raises MalformedMessage: as `fields`.
    :raises TypeError: as `fields`.
    """
    for sec, nanosec, frame_id, child_frame_id, pose in fields(data):
        yield Row(sec * SECOND + nanosec, frame_id, child_frame_id, pose)


def fields(data: bytes) -> Iterator[Fields]:
    """
    Deserialise a message, one transform after the other.

    Bytes after the last transform are ignored, as in Fast DDS. Errors are raised during the
    iteration.

    :param data: the message, of either byte order.
    :returns: an iterator over the fields of each transform.
    :raises MalformedMessage: if the bytes end too early or are in another encoding.
    :raises TypeError: if `data` is not bytes.
    """
    if not isinstance(data, bytes):
        raise TypeError(f'expected bytes, got {type(data).__name__}')
    order = _BYTE_ORDER.get(data[:2])
    if order is None:
        raise MalformedMessage(
            f'unknown encoding: a TFMessage begins with 00 00 or 00 01 (plain CDR), not with '
            f'{data[:2].hex(" ")!r}')
    try:
        (count,) = struct.unpack_from(order + 'I', data, 4)
        if count * _SMALLEST_TRANSFORM > len(data) - 8:
            raise MalformedMessage(
                f'impossible count: {len(data)} bytes cannot hold the {count} transforms that '
                'they announce')
        yield from _unpack_fields(data, order, count)
    except struct.error:
        raise MalformedMessage(
            f'truncated: a TFMessage of {len(data)} bytes ends in the middle of a field') from None


def _unpack_fields(data: bytes, order: str, count: int) -> Iterator[Fields]:
    unpack_head = struct.Struct(order + 'iII').unpack_from
    unpack_length = struct.Struct(order + 'I').unpack_from
    unpack_pose = struct.Struct(order + '7d').unpack_from
    start = 8
    for _ in range(count):
        sec, nanosec, length = unpack_head(data, start)
        start += 12
        frame_id = data[start:start + length]
        start += length + (-length & 3)
        (length,) = unpack_length(data, start)
        start += 4
        child_frame_id = data[start:start + length]
        start += length
        start += 4 - start & 7
        yield sec, nanosec, _text(frame_id), _text(child_frame_id), unpack_pose(data, start)
        start += 56


def _text(field: bytes) -> str:
    """Decode a string as rclpy does: stop at the first NUL, and replace invalid UTF-8."""
    return field.partition(b'\0')[0].decode('utf-8', 'replace')


def split_stamp(stamp_ns: int) -> tuple[int, int]:
    """
    Split a time into seconds and nanoseconds.

    :param stamp_ns: time (ns).
    :returns: sec and nanosec, as in a ROS stamp.
    :raises ValueError: if the seconds do not fit the int32 of a ROS stamp.
    """
    sec, nanosec = divmod(stamp_ns, SECOND)
    if not -2**31 <= sec < 2**31:
        raise ValueError(f'a stamp must be from -2**31 to 2**31 - 1 seconds, got {stamp_ns} ns')
    return sec, nanosec


class MessageTemplate:
    """
    A template for the fast serialisation of messages with the same frames.

    Each transform ends at a multiple of 8 bytes, counted from the end of the encapsulation. So
    numpy can treat the bytes after the encapsulation as an array of float64.
    """

    def __init__(self, edges: Sequence[tuple[str, str]]) -> None:
        """
        Create the template.

        :param edges: (frame_id, child_frame_id) of each of the n transforms, n >= 1.
        :raises ValueError: if a frame id contains a NUL or is not valid Unicode.
        """
        lengths = [len(_pack_names(parent, child, 0 if i else 4)) + 8
                   for i, (parent, child) in enumerate(edges)]
        ends = 4 + np.cumsum(np.array(lengths) + 56)
        template = pack(Row(0, parent, child, IDENTITY) for parent, child in edges)
        self._body = np.frombuffer(template, '<f8', offset=4)
        self._poses_at = ((ends - 56) // 8)[:, np.newaxis] + np.arange(7)
        self._sec_at = (ends - 56 - lengths) // 4

    def pack(self, stamp_ns: int, poses: ArrayLike) -> bytes:
        """
        Serialise a message in which all transforms have the same stamp.

        :param stamp_ns: time (ns).
        :param poses: (n, 7) float64: x, y, z (m), quaternion x, y, z, w.
        :returns: the message, little-endian.
        :raises ValueError: if the shape of `poses` is not (n, 7), or if the seconds of the stamp
            do not fit an int32.
        """
        sec, nanosec = split_stamp(stamp_ns)
        values: NDArray[np.float64] = np.asarray(poses, np.float64)
        if values.shape != self._poses_at.shape:
            raise ValueError(
                f'poses must be of shape {self._poses_at.shape}, got {values.shape}')
        body: NDArray[np.float64] = self._body.copy()
        body[self._poses_at] = values
        words = body.view('<u4')
        words[self._sec_at] = sec & 0xFFFFFFFF
        words[self._sec_at + 1] = nanosec
        return _ENCAPSULATION + body.tobytes()


def key(data: bytes) -> bytes:
    """
    Return a key that depends only on the two names of the first transform.

    So messages with the same frames have the same key. Two messages with different frames may have
    the same key, too.

    :param data: a little-endian message.
    :returns: the bytes of these two names. If a name is longer than 254 bytes, the key is only a
        part of these bytes. If the message is too short, the key is b''.
    """
    try:
        end = _FIRST_NAME + 7 + data[_FIRST_NAME] & ~3
        return data[_FIRST_NAME:end + 4 + data[end]]
    except IndexError:
        return b''


def header_frame(data: bytes) -> str:
    """
    Return the frame_id of a message that begins with a std_msgs/Header.

    :param data: the message, of either byte order.
    :returns: the frame_id.
    :raises struct.error: if the bytes end too early.
    """
    # The header begins with the stamp (8 bytes), after the encapsulation (4 bytes).
    (length,) = struct.unpack_from(f'{_BYTE_ORDER.get(data[:2], "<")}I', data, 12)
    if 16 + length > len(data):
        raise struct.error('the bytes end in the middle of the frame_id')
    return _text(data[16:16 + length])


#: The type of the seconds of a stamp, for numpy.
SECONDS = '<i4'
#: Unpack the eight bytes of a stamp to sec and nanosec.
unpack_stamp = struct.Struct('<iI').unpack
#: The first two bytes of a little-endian message.
HEAD = _ENCAPSULATION[:2]


def layout(edges: Sequence[tuple[str, str]]) -> tuple[str, list[bytes]]:
    """
    Return the layout of little-endian messages with certain frames.

    :param edges: (frame_id, child_frame_id) of each of the n transforms.
    :returns: a format and a list. The format is for the module `struct`. Its fields are the head,
        the number of transforms, and four fields of bytes for each transform: the stamp, the two
        names and the pose. The list has the bytes of the 2 n names, as they are in the message:
        length, UTF-8 and NUL.
    :raises ValueError: if a frame id contains a NUL or is not valid Unicode.
    """
    struct_format = '<2s2xI'
    position = 4
    names = []
    for edge in edges:
        struct_format += '8s'
        position += 8
        for name, alignment in zip(edge, (4, 8)):
            names.append(_pack_name(name))
            padding = -(position + len(names[-1])) % alignment
            struct_format += f'{len(names[-1])}s{padding}x'
            position += len(names[-1]) + padding
        struct_format += f'{POSE_BYTES}s'
    return struct_format, names
