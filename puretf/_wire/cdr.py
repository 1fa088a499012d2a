"""Serialisation of `tf2_msgs/msg/TFMessage` in CDR; `encoding` describes the bytes."""

from collections.abc import Iterable
from functools import lru_cache
import struct

from puretf._core.pose import Row
from puretf._core.times import split
from puretf._wire.encoding import CDR, Fields
from puretf._wire.message_reader import Layout, pack_stamp

_pack_pose = struct.Struct('<7d').pack
#: A layout of 10 000 frames takes megabytes.
_layout = lru_cache(maxsize=32)(Layout)


def pack(rows: Iterable[Row]) -> bytes:
    return pack_fields((*split(row.stamp_ns), *row[1:]) for row in map(Row._make, rows))


def pack_fields(transforms: Iterable[Fields]) -> bytes:
    """Serialise transforms; raise a ValueError for a bad name, a struct.error for a bad value."""
    edges, stamps, poses = [], [], []
    for sec, nanosec, frame_id, child_frame_id, pose in transforms:
        edges.append((frame_id, child_frame_id))
        stamps.append(pack_stamp(sec, nanosec))
        poses.append(_pack_pose(*pose))
    return _layout(CDR, tuple(edges)).fill(stamps, poses)
