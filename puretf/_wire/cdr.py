"""Serialisation of `tf2_msgs/msg/TFMessage` in CDR; `encoding` describes the bytes."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from puretf._core.pose import POSE_BYTES, Row
from puretf._core.times import split
from puretf._wire.encoding import CDR, Fields

_pack_stamp = struct.Struct('<iI').pack
_pack_pose = struct.Struct('<7d').pack


class MessageTemplate:
    """A template of messages with the same frames."""

    def __init__(self, edges: Sequence[tuple[str, str]]) -> None:
        struct_format, names = CDR.layout(edges)
        self._struct, self._shape = struct.Struct(struct_format), (len(edges), 7)
        self._fields: list[Any] = [CDR.head, len(edges), *[None] * (4 * len(edges))]
        self._fields[3::4], self._fields[4::4] = names[::2], names[1::2]

    def pack(self, stamp_ns: int, poses: ArrayLike) -> bytes:
        """Serialise n poses, (n, 7) float64, with one stamp; a ValueError names what is wrong."""
        values = np.asarray(poses, '<f8')
        if values.shape != self._shape:
            raise ValueError(f'poses must be of shape {self._shape}, got {values.shape}')
        data = values.tobytes()
        return self.fill([_pack_stamp(*split(stamp_ns))] * len(values),
                         [data[at:at + POSE_BYTES] for at in range(0, len(data), POSE_BYTES)])

    def fill(self, stamps: list[bytes], poses: list[bytes]) -> bytes:
        fields = self._fields.copy()
        fields[2::4], fields[5::4] = stamps, poses
        return self._struct.pack(*fields)


#: A template of 10 000 frames takes megabytes.
_template = lru_cache(maxsize=32)(MessageTemplate)


def pack(rows: Iterable[Row]) -> bytes:
    return pack_fields((*split(row.stamp_ns), *row[1:]) for row in map(Row._make, rows))


def pack_fields(transforms: Iterable[Fields]) -> bytes:
    """Serialise transforms; raise a ValueError for a bad name, a struct.error for a bad value."""
    edges, stamps, poses = [], [], []
    for sec, nanosec, frame_id, child_frame_id, pose in transforms:
        edges.append((frame_id, child_frame_id))
        stamps.append(_pack_stamp(sec, nanosec))
        poses.append(_pack_pose(*pose))
    return _template(tuple(edges)).fill(stamps, poses)
