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

from collections.abc import Iterator, Sequence
import struct

from dummy_arm.tf._core.pose import POSE_BYTES, Row
from dummy_arm.tf._core.times import SECOND
from dummy_arm.tf._wire.cdr import MalformedMessage

#: The position of the first frame_id.
_FIRST_NAME = 16
_SMALLEST_TRANSFORM = 4 + 4 + 4 + 4 + 4 + POSE_BYTES
_unpack_length = struct.Struct('<I').unpack_from
_unpack_head = struct.Struct('<4xII').unpack_from
_unpack_pose = struct.Struct('<7d').unpack_from


def unpack(data: bytes) -> list[Row]:
    """
    Deserialise a message.

    :param data: the message.
    :returns: the transforms.
    :raises MalformedMessage: if the bytes end too early.
    """
    return list(rows(data))


def rows(data: bytes) -> Iterator[Row]:
    """
    Deserialise a message, one transform after the other.

    :param data: the message.
    :returns: an iterator over the transforms.
    :raises MalformedMessage: if the bytes end too early.
    """
    try:
        (count,) = _unpack_length(data)
        if count * _SMALLEST_TRANSFORM > len(data) - 4:
            raise MalformedMessage(
                f'impossible count: {len(data)} bytes cannot hold the {count} transforms that '
                'they announce')
        position = 4
        for _ in range(count):
            sec, nanosec = _unpack_head(data, position)
            frame_id, position = _name(data, position + 12)
            child_frame_id, position = _name(data, position)
            yield Row(sec * SECOND + nanosec, frame_id, child_frame_id,
                      _unpack_pose(data, position))
            position += POSE_BYTES
    except struct.error:
        raise MalformedMessage(
            f'truncated: a TFMessage of {len(data)} bytes ends in the middle of a field') from None


def _name(data: bytes, position: int) -> tuple[str, int]:
    """Return the name at a position, and the position of the first byte after the name."""
    (length,) = _unpack_length(data, position)
    end = position + 4 + length
    return data[position + 4:end].decode('utf-8', 'replace'), end


def key(data: bytes) -> bytes:
    """
    Return a key that depends only on the two names of the first transform.

    So messages with the same frames have the same key. Two messages with different frames may have
    the same key, too.

    :param data: a message.
    :returns: the bytes of these two names. If a name is longer than 255 bytes, the key is only a
        part of these bytes. If the message is too short, the key is b''.
    """
    try:
        end = _FIRST_NAME + 4 + data[_FIRST_NAME]
        return data[_FIRST_NAME:end + 4 + data[end]]
    except IndexError:
        return b''


def header_frame(data: bytes) -> str:
    """
    Return the frame_id of a message that begins with a std_msgs/Header.

    :param data: the message.
    :returns: the frame_id.
    :raises struct.error: if the bytes end too early.
    """
    name, end = _name(data, 12)
    if end > len(data):
        raise struct.error('the bytes end in the middle of the frame_id')
    return name


#: The type of the seconds of a stamp, for numpy.
SECONDS = '<u4'
#: Unpack the eight bytes of a stamp to seconds and nanoseconds.
unpack_stamp = struct.Struct('<II').unpack
#: A message has no bytes before the number of transforms.
HEAD = b''


def layout(edges: Sequence[tuple[str, str]]) -> tuple[str, list[bytes]]:
    """
    Return the layout of messages with certain frames.

    :param edges: (frame_id, child_frame_id) of each of the n transforms.
    :returns: a format and a list, as `cdr.layout`. The names in the list do not end with a NUL.
    """
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
