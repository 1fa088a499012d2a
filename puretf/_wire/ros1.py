"""
Deserialisation of the ROS 1 messages `tf2_msgs/TFMessage` and `tf/tfMessage`, as in ROS 1 bags.

All fields are little-endian, without alignment:

    uint32               number of transforms
    for each transform:
      uint32             sequence number
      uint32, uint32     stamp: seconds, nanoseconds
      string, string     frame_id, child_frame_id. Each begins with the length (uint32, in bytes).
                         The name in UTF-8 follows.
      float64 x 3        translation x y z (m)
      float64 x 4        rotation, quaternion x y z w
"""

from collections.abc import Sequence
import struct

from puretf._core.pose import POSE_BYTES, Row
from puretf._text.times import SECOND
from puretf._wire.cdr import check_count, stamp_and_name, truncated

_FIRST_NAME = 16  # where the first frame_id begins
_SMALLEST_TRANSFORM = 4 + 4 + 4 + 4 + 4 + POSE_BYTES
_unpack_length = struct.Struct('<I').unpack_from
_unpack_header = struct.Struct('<4xIII').unpack_from
_unpack_pose = struct.Struct('<7d').unpack_from


def unpack(data: bytes) -> list[Row]:
    rows, position = [], 4
    try:
        (count,) = _unpack_length(data)
        check_count(count, _SMALLEST_TRANSFORM, len(data))
        for _ in range(count):
            sec, nanosec, _ = _unpack_header(data, position)
            frame_id, position = _name(data, position + 12)
            child_frame_id, position = _name(data, position)
            rows.append(Row(sec * SECOND + nanosec, frame_id, child_frame_id,
                            _unpack_pose(data, position)))
            position += POSE_BYTES
    except struct.error:
        raise truncated(data) from None
    return rows


def _name(data: bytes, position: int) -> tuple[str, int]:
    (length,) = _unpack_length(data, position)
    end = position + 4 + length
    return data[position + 4:end].decode('utf-8', 'replace'), end


def key(data: bytes) -> bytes:
    """Return the bytes of the two names of the first transform, as `cdr.key` does."""
    try:
        end = _FIRST_NAME + 4 + data[_FIRST_NAME]
        return data[_FIRST_NAME:end + 4 + data[end]]
    except IndexError:
        return b''


def header(data: bytes) -> tuple[int, bytes, int]:
    """Return what `cdr.header` returns."""
    return stamp_and_name(data, *_unpack_header(data))


STAMP = '<II'
HEAD = b''  # a message begins with the number of transforms


def layout(edges: Sequence[tuple[str, str]]) -> tuple[str, list[bytes]]:
    """Return what `cdr.layout` returns; the names do not end with a NUL."""
    struct_format = '<0sI'
    names = []
    for edge in edges:
        struct_format += '4x8s'
        for name in edge:
            text = name.encode()
            names.append(struct.pack('<I', len(text)) + text)
            struct_format += f'{len(names[-1])}s'
        struct_format += f'{POSE_BYTES}s'
    return struct_format, names
