"""JointStates from bytes: the middleware would print a line for each that is malformed."""

import struct
from typing import Any, Optional

from rclpy.node import Node
from sensor_msgs.msg import JointState

from puretf._causes.facts import listed, UNKNOWN
from puretf._text.names import shortened
from puretf.publisher_listener import nodes_on


class JointStateReader:
    """Reads the JointStates on a topic, and logs once that some are malformed."""

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic, self._has_warned = node, topic, False

    def read(self, data: bytes) -> Optional[JointState]:
        """Return a message; None if its bytes cannot be decoded."""
        try:
            return deserialize(data)
        except ValueError as error:
            if not self._has_warned:
                self._has_warned = True
                nodes = nodes_on(self._node, self._topic)
                self._node.get_logger().warning(
                    f'dropped a message on {shortened(self._topic)} that cannot be decoded: '
                    f'{error}; published by {"one of " * (len(nodes) > 1)}'
                    f'{listed(nodes) or UNKNOWN}. Further ones are dropped silently.')
            return None


def deserialize(data: bytes) -> JointState:
    """Deserialize plain CDR, see `puretf._wire.cdr`; raise a ValueError if it is malformed."""
    if data[:2] not in (b'\0\0', b'\0\1'):
        raise ValueError('a JointState begins with 00 00 or 00 01 (plain CDR), not with '
                         f'{data[:2].hex(" ")!r}')
    fields = _Fields(data)
    try:
        sec, nanosec = *fields.numbers('i', 1), *fields.numbers('I', 1)
        frame_id = fields.text()
        names = [fields.text() for _ in range(*fields.numbers('I', 1))]
        position, velocity, effort = (
            fields.numbers('d', *fields.numbers('I', 1)) for _ in range(3))
    except struct.error:
        raise ValueError(
            f'a JointState of {len(data)} bytes ends in the middle of a field') from None
    message = JointState(name=names, position=position, velocity=velocity, effort=effort)
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    return message


class _Fields:
    """The fields of a message in plain CDR, one after another; struct.error: they end early."""

    def __init__(self, data: bytes) -> None:
        self._data, self._order, self._at = data, '<' if data[1] else '>', 4

    def numbers(self, kind: str, count: int) -> tuple[Any, ...]:
        size = struct.calcsize(f'={kind}')
        if count:
            self._at += -(self._at - 4) % size
        values = struct.unpack_from(f'{self._order}{count}{kind}', self._data, self._at)
        self._at += count * size
        return values

    def text(self) -> str:
        (field,) = self.numbers('s', *self.numbers('I', 1))
        return str(field.partition(b'\0')[0], 'utf-8', 'replace')
