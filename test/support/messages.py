"""TFMessages for tests: recorded ones, and a source that has them."""

from functools import cache
import json
import struct
from typing import Any, NoReturn, Optional

from environment import DATA
import pytest

from puretf._core.pose import BatchOrRows, Row
from puretf._text.names import TF_MESSAGE
from puretf._wire.encoding import CDR, Fields, ROS1
from puretf._wire.message_reader import MessageReader
from puretf.bag import BagMessage, Headers, Topic


@cache
def golden_messages() -> list[dict[str, Any]]:
    """Return TFMessages, with the bytes into which the type support of tf2_msgs packs them."""
    cases: list[dict[str, Any]] = json.loads((DATA / 'tf_message_cdr.json').read_text())['cases']
    return cases


def ignore(_message: object = None) -> None:
    """Do nothing; a callback with a signature, which `print` lacks on Python 3.10."""


def fail_on_error(error: Exception) -> NoReturn:
    """Fail the test: the error callback of readers and sources that must not report any."""
    pytest.fail(repr(error))


class ArrivedMessages:
    """A source of a buffer whose messages have all arrived on /tf."""

    def __init__(self, *messages: bytes) -> None:
        self._batches = MessageReader(fail_on_error).read(messages, 'sent', False)

    def take(self) -> list[BatchOrRows]:
        """Return the decoded messages once."""
        batches, self._batches = self._batches, []
        return batches

    def wake(self) -> None:
        """Do nothing, since no thread waits for messages."""

    def is_alive(self) -> bool:
        """Return True: the source stays."""
        return True


def recorded(time: int, data: bytes, is_static: bool = False, publisher: str = '',
             encoding: Any = CDR) -> BagMessage:
    """Return a message as `Bag.messages` returns it; the time in ns."""
    topic = Topic('/tf', TF_MESSAGE, encoding, publisher, is_static, False, Headers(), True, True,
                  True)
    return BagMessage(topic, time, data)


def golden_fields(case: dict[str, Any]) -> list[Fields]:
    """Return the transforms of a golden case with their fields as on the wire."""
    return [(t['sec'], t['nanosec'], t['frame_id'], t['child_frame_id'], (*t['xyz'], *t['xyzw']))
            for t in case['transforms']]


def golden_rows(case: dict[str, Any]) -> list[Row]:
    """Return the transforms of a golden case as rows."""
    return [Row(sec * 10**9 + nanosec, parent, child, pose)
            for sec, nanosec, parent, child, pose in golden_fields(case)]


def written(rows: list[Row], order: str = '<', encoding: Any = CDR,
            stamps: Optional[list[tuple[int, int]]] = None) -> bytes:
    """Serialize transforms in a byte order, by the struct module only; `stamps`: sec, nanosec."""
    is_ros1, body = encoding is ROS1, struct.pack(f'{order}I', len(rows))
    for (sec, nanosec), (_, *names, pose) in zip(
            stamps or [divmod(row.stamp_ns, 10**9) for row in rows], rows):
        body += bytes(4) if is_ros1 else bytes(-len(body) % 4)
        body += struct.pack(f'{order}II', sec % 2**32, nanosec)
        for name in names:
            text = name.encode('utf-8', 'surrogateescape') + (b'' if is_ros1 else b'\0')
            body += b'' if is_ros1 else bytes(-len(body) % 4)
            body += struct.pack(f'{order}I', len(text)) + text
        body += b'' if is_ros1 else bytes(-len(body) % 8)
        body += struct.pack(f'{order}7d', *pose)
    return body if is_ros1 else bytes([0, order == '<', 0, 0]) + body
