"""
Deserialisation of `tf2_msgs/msg/TFMessage`, in the encodings of ROS 2 and ROS 1.

ROS 2 has plain CDR (XCDR1), as every RMW of Jazzy sends it:

    00 01 00 00          00 00 (big-endian) or 00 01 (little-endian), two bytes of options
    uint32               number of transforms. Positions are counted from the start of this field.
    for each transform:
      int32, uint32      stamp: seconds, nanoseconds; begins at the next multiple of 4
      string, string     frame_id, child_frame_id. Each begins at the next multiple of 4 with the
                         length (uint32, bytes with the NUL); the name in UTF-8 and a NUL follow
      float64 x 3        translation x y z (m); begins at the next multiple of 8
      float64 x 4        rotation, quaternion x y z w

ROS 1, in `tf2_msgs/TFMessage` and `tf/tfMessage`, has the same fields, with these differences: all
are little-endian, without alignment; the number of transforms is the first field; a sequence
number (uint32) precedes each stamp, whose seconds are an uint32; and names do not end with a NUL.
"""

from collections.abc import Iterator, Sequence
import struct
from typing import NamedTuple

from puretf._core.pose import Pose, POSE_BYTES, Row
from puretf._text.times import SECOND

_FIRST_NAME = 16  # where the first frame_id begins
#: sec, nanosec (which may be received as 10**9 or more), frame_id, child_frame_id, pose.
Fields = tuple[int, int, str, str, Pose]


class MalformedMessage(ValueError):
    """The bytes are not a TFMessage; the error text before the colon names the kind of fault."""


class Encoding(NamedTuple):
    """The encoding of messages: `CDR` (ROS 2) or `ROS1`."""

    head: bytes  #: the beginning of little-endian messages; as many bytes of options follow
    sequence: int  #: the size of the sequence number before a stamp
    stamp: str  #: the format of seconds and nanoseconds, for `struct`
    end: bytes  #: of a name
    name_padding: int  #: the largest padding before a name: its alignment minus 1
    pose_padding: int  #: and before a pose

    def unpack(self, data: bytes) -> list[Row]:
        """Deserialise a message, or raise a MalformedMessage."""
        return [Row(sec * SECOND + nanosec, frame_id, child_frame_id, pose)
                for sec, nanosec, frame_id, child_frame_id, pose in self.fields(data)]

    def fields(self, data: bytes) -> Iterator[Fields]:
        """
        Deserialise a message of either byte order; the iteration may raise a MalformedMessage.

        Bytes after the last transform are ignored, as in Fast DDS.
        """
        if not isinstance(data, bytes):
            raise TypeError(f'expected bytes, got {type(data).__name__}')
        order, start = self._byte_order(data), 2 * len(self.head)
        if self.head and data[:2] not in (b'\0\0', self.head):
            raise MalformedMessage(
                f'unknown encoding: a TFMessage begins with 00 00 or 00 01 (plain CDR), not with '
                f'{data[:2].hex(" ")!r}')
        unpack_head = struct.Struct(f'{order}{self.sequence}x{self.stamp}I').unpack_from
        unpack_length = struct.Struct(f'{order}I').unpack_from
        unpack_pose = struct.Struct(f'{order}7d').unpack_from
        head, padding = self.sequence + 12, self.name_padding
        try:
            (count,) = unpack_length(data, start)
            if count * (head + 4 + POSE_BYTES) > (size := len(data) - start) - 4:
                raise MalformedMessage(f'impossible count: {size} bytes cannot hold the {count} '
                                       'transforms that they announce')
            start += 4
            for _ in range(count):
                sec, nanosec, length = unpack_head(data, start)
                start += head
                frame_id = data[start:start + length]
                start += length + (-length & padding)
                (length,) = unpack_length(data, start)
                start += 4
                child_frame_id = data[start:start + length]
                start += length
                start += 4 - start & self.pose_padding
                pose = unpack_pose(data, start)
                yield sec, nanosec, _text(frame_id), _text(child_frame_id), pose
                start += POSE_BYTES
        except struct.error:
            raise MalformedMessage(f'truncated: a TFMessage of {len(data)} bytes ends in the '
                                   'middle of a field') from None

    def key(self, data: bytes) -> bytes:
        """
        Return the bytes of the two names of the first transform.

        They are the same in messages with the same frames. If a name is longer than 254 bytes,
        they are a part of the names.
        """
        try:
            padding = self.name_padding
            end = _FIRST_NAME + 4 + padding + data[_FIRST_NAME] & ~padding
            return data[_FIRST_NAME:end + 4 + data[end]]
        except IndexError:
            return b''

    def header(self, data: bytes) -> tuple[int, bytes, int]:
        """
        Return the stamp (ns), the bytes of the frame_id and nanosec of a message with a Header.

        If the bytes end too early, raise a struct.error.
        """
        # The first 4 bytes are the encapsulation in ROS 2, and the sequence number in ROS 1.
        sec, nanosec, length = struct.unpack_from(
            f'{self._byte_order(data)}{self.stamp}I', data, 4)
        name = data[16:16 + length]
        if len(name) < length:
            raise struct.error('the bytes end in the middle of the frame_id')
        return sec * SECOND + nanosec, name, nanosec

    def _byte_order(self, data: bytes) -> str:
        return '>' if self.head and data[:2] == b'\0\0' else '<'

    def layout(self, edges: Sequence[tuple[str, str]]) -> tuple[str, list[bytes]]:
        """
        Return the format of little-endian messages, for `struct`, and the bytes of the 2 n names.

        The format has the head, the number of transforms, and four fields of bytes for each
        transform: the stamp, the two names and the pose.
        """
        size = len(self.head)
        # The position before a stamp modulo 8; poses begin at multiples of 8.
        struct_format, names, position = f'<{size}s{size}xI', [], 4
        for edge in edges:
            struct_format += f'{self.sequence}x8s'
            for name, most in zip(edge, (self.name_padding, self.pose_padding)):
                names.append(self._packed(name))
                position += len(names[-1])
                padding = -position & most
                position += padding
                struct_format += f'{len(names[-1])}s{padding}x'
            struct_format += f'{POSE_BYTES}s'
            position = 0
        return struct_format, names

    def _packed(self, name: str) -> bytes:
        try:
            text = name.encode()
        except UnicodeEncodeError as error:
            raise ValueError(f'frame id {name!r} must be valid Unicode: {error}') from None
        if b'\0' in text:
            raise ValueError(f'frame id {name!r} must not contain a NUL character')
        return struct.pack('<I', len(text) + len(self.end)) + text + self.end


CDR = Encoding(b'\x00\x01', 0, 'iI', b'\0', 3, 7)
ROS1 = Encoding(b'', 4, 'II', b'', 0, 0)


def _text(field: bytes) -> str:
    """Decode a string as rclpy does: stop at the first NUL, and replace invalid UTF-8."""
    return field.partition(b'\0')[0].decode('utf-8', 'replace')
