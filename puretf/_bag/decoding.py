"""Decoding of messages of standard types, by rosbags."""

from functools import cache
from typing import Any

from rosbags.typesys import get_typestore, Stores

from puretf._wire import ros1
from puretf._wire.message_reader import Encoding


def decoded(data: bytes, msgtype: str, encoding: Encoding) -> Any:
    """Return a message as an object with its fields; None if it cannot be decoded."""
    try:
        return (_ros1().deserialize_ros1 if encoding is ros1 else _ros2().deserialize_cdr)(
            data, msgtype)
    except Exception:  # the decoder raises errors of many types
        return None


@cache
def _ros1() -> Any:
    return get_typestore(Stores.ROS1_NOETIC)


@cache
def _ros2() -> Any:
    return get_typestore(Stores.LATEST)
