"""
Serialisation of `tf2_msgs/msg/TFMessage` in CDR.

A message is in plain CDR (XCDR1), as every RMW of Jazzy sends it:

    00 01 00 00          00 00 (big-endian) or 00 01 (little-endian), two bytes of options
    uint32               number of transforms. Positions are counted from the start of this field.
    for each transform:
      int32, uint32      stamp: seconds, nanoseconds; begins at the next multiple of 4
      string, string     frame_id, child_frame_id. Each begins at the next multiple of 4 with the
                         length (uint32, bytes with the NUL); the name in UTF-8 and a NUL follow
      float64 x 3        translation x y z (m); begins at the next multiple of 8
      float64 x 4        rotation, quaternion x y z w
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from puretf._core.pose import Pose, POSE_BYTES, Row
from puretf._core.times import split
from puretf._text.times import SECOND

_ENCAPSULATION = b'\x00\x01\x00\x00'
_BYTE_ORDER = {b'\x00\x00': '>', b'\x00\x01': '<'}
_FIRST_NAME = 16  # where the first frame_id begins
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


def _padded(names: Iterable[str], position: int) -> Iterator[tuple[bytes, int]]:
    """Yield both names, each with the size of its padding; frame_id begins at the position."""
    for name, alignment in zip(names, (4, 8)):
        packed = _pack_name(name)
        position += len(packed)
        padding = -position % alignment
        position += padding
        yield packed, padding


@lru_cache(maxsize=4096)
def _pack_names(frame_id: str, child_frame_id: str, position: int) -> bytes:
    return b''.join(name + bytes(padding)
                    for name, padding in _padded((frame_id, child_frame_id), position))


#: sec, nanosec (which may be received as 10**9 or more), frame_id, child_frame_id, pose.
Fields = tuple[int, int, str, str, Pose]


def pack(rows: Iterable[Row]) -> bytes:
    return pack_fields((*split(row.stamp_ns), *row[1:]) for row in map(Row._make, rows))


def pack_fields(transforms: Iterable[Fields]) -> bytes:
    """Serialise transforms; raise a ValueError for a bad name, a struct.error for a bad value."""
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
    return [Row(sec * SECOND + nanosec, frame_id, child_frame_id, pose)
            for sec, nanosec, frame_id, child_frame_id, pose in fields(data)]


def fields(data: bytes) -> Iterator[Fields]:
    """
    Deserialise a message of either byte order; the iteration may raise MalformedMessage.

    Bytes after the last transform are ignored, as in Fast DDS.
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
        check_count(count, _SMALLEST_TRANSFORM, len(data) - 4)
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
    except struct.error:
        raise truncated(data) from None


def check_count(count: int, smallest: int, size: int) -> None:
    """Check a number of transforms, with which a message of a size (bytes) begins."""
    if count * smallest > size - 4:
        raise MalformedMessage(f'impossible count: {size} bytes cannot hold the {count} '
                               'transforms that they announce')


def truncated(data: bytes) -> MalformedMessage:
    return MalformedMessage(
        f'truncated: a TFMessage of {len(data)} bytes ends in the middle of a field')


def _text(field: bytes) -> str:
    """Decode a string as rclpy does: stop at the first NUL, and replace invalid UTF-8."""
    return field.partition(b'\0')[0].decode('utf-8', 'replace')


class MessageTemplate:
    """A template of messages with the same frames."""

    def __init__(self, edges: Sequence[tuple[str, str]]) -> None:
        fields, names = layout(edges)
        self._struct, self._shape = struct.Struct(fields), (len(edges), 7)
        self._fields: list[Any] = [HEAD, len(edges), *[None] * (4 * len(edges))]
        self._fields[3::4], self._fields[4::4] = names[::2], names[1::2]

    def pack(self, stamp_ns: int, poses: ArrayLike) -> bytes:
        """Serialise n poses, (n, 7) float64, with one stamp; a ValueError names what is wrong."""
        values = np.asarray(poses, '<f8')
        if values.shape != self._shape:
            raise ValueError(f'poses must be of shape {self._shape}, got {values.shape}')
        data, fields = values.tobytes(), self._fields.copy()
        fields[2::4] = [_pack_stamp(*split(stamp_ns))] * len(values)
        fields[5::4] = [data[at:at + POSE_BYTES] for at in range(0, len(data), POSE_BYTES)]
        return self._struct.pack(*fields)


def key(data: bytes) -> bytes:
    """
    Return the bytes of the two names of the first transform.

    They are the same in messages with the same frames. If a name is longer than 254 bytes, they
    are a part of the names.
    """
    try:
        end = _FIRST_NAME + 7 + data[_FIRST_NAME] & ~3
        return data[_FIRST_NAME:end + 4 + data[end]]
    except IndexError:
        return b''


def header(data: bytes) -> tuple[int, bytes, int]:
    """
    Return the stamp (ns), the bytes of the frame_id and nanosec of a message with a Header.

    If the bytes end too early, raise a struct.error.
    """
    struct_format = '>iII' if data[:2] == b'\0\0' else '<iII'
    return stamp_and_name(data, *struct.unpack_from(struct_format, data, 4))


def stamp_and_name(data: bytes, sec: int, nanosec: int, length: int) -> tuple[int, bytes, int]:
    """Return what `header` returns, for a frame_id of `length` bytes."""
    name = data[16:16 + length]
    if len(name) < length:
        raise struct.error('the bytes end in the middle of the frame_id')
    return sec * SECOND + nanosec, name, nanosec


STAMP = '<iI'
HEAD = _ENCAPSULATION[:2]


def layout(edges: Sequence[tuple[str, str]]) -> tuple[str, list[bytes]]:
    """
    Return the format of little-endian messages, for `struct`, and the bytes of the 2 n names.

    The format has the head, the number of transforms, and four fields of bytes for each transform:
    the stamp, the two names and the pose.
    """
    struct_format, names, position = '<2s2xI', [], 12
    for edge in edges:
        struct_format += '8s'
        for name, padding in _padded(edge, position):
            names.append(name)
            struct_format += f'{len(name)}s{padding}x'
        struct_format += f'{POSE_BYTES}s'
        position = 8
    return struct_format, names
