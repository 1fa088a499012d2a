"""
The transforms of many messages as arrays.

The messages are those of `PublisherListener.received` or of `puretf.bag.Bag.messages`. For
statistics, arrays are much faster than the method `rows` of each message.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple, Union

import numpy as np
from numpy.typing import NDArray

from puretf._core.pose import Row
from puretf._wire.encoding import Encoding
from puretf._wire.message_reader import KnownLayouts, Layout
from puretf._wire.received_message import ReceivedMessage
from puretf.bag import BagMessage

#: Tables are created when the collected messages take more than `_MOST_BYTES`. A message takes the
#: size of its data and `_OVERHEAD` (bytes).
_MOST_BYTES, _OVERHEAD = 2**20, 100
#: A message that was received or recorded.
Message = Union[ReceivedMessage, BagMessage]


class TransformTable(NamedTuple):
    """The transforms of m messages of one publisher, each of n transforms of the same frames."""

    publisher: str  #: the publisher, as in the messages
    is_static: bool  #: True if the messages are from `/tf_static`
    edges: list[tuple[str, str]]  #: n pairs (frame_id, child_frame_id), unchanged
    times: NDArray[np.int64]  #: (m,) the times of arrival or of the recording (ns); 0: not known
    stamps: NDArray[np.int64]  #: (m, n) the stamps (ns)
    #: (m, n, 7) x, y, z (m), quaternion x, y, z, w of any norm
    poses: NDArray[np.float64]
    nanosec: int = 0  #: the largest one of these stamps, which should be less than a second


#: The messages that are not converted yet; those of a group become one table. By the publisher,
#: whether the messages are from /tf_static, and their layout: the times, the stamps and the poses.
_Groups = dict[tuple[str, bool, Layout], tuple[list[int], list[bytes], list[bytes]]]


def transform_tables(messages: Iterable[Message],
                     on_malformed: Callable[[ValueError], object] = lambda error: None
                     ) -> Iterator[TransformTable]:
    """
    Convert messages to tables.

    The transforms of each child from one publisher on one topic stay in order. The order of other
    transforms may change.

    :param messages: the messages, in the order of their arrival.
    :param on_malformed: called with the error of each message that cannot be decoded.
    :returns: an iterator over the tables. In a table, each frame is the child of one edge only.
    """
    layouts: dict[Encoding, KnownLayouts] = {}
    groups: _Groups = {}
    size = 0
    for message in messages:
        data, encoding = message.data, message.encoding
        known = layouts.get(encoding) or layouts.setdefault(encoding, KnownLayouts(encoding))
        parts, rows = known.read(data), list[Row]()
        if parts is None:
            try:
                rows = message.rows()
            except ValueError as error:
                on_malformed(error)
                continue
            parts = known.learn(data, rows)
        if parts is None or size > _MOST_BYTES:
            yield from _tables(groups, [*groups])
            size = 0
        if parts is None:
            for row in rows:
                yield TransformTable(
                    message.publisher, message.is_static, [(row.frame_id, row.child_frame_id)],
                    np.array([message.time]), np.array([[row.stamp_ns]]), np.array([[row.pose]]))
            continue
        layout, *content = parts
        key = message.publisher, message.is_static, layout
        if key not in groups:
            # Groups with a common child are closed, so that its transforms stay in order.
            yield from _tables(groups, [
                other for other in groups
                if other[:2] == key[:2] and not other[2].names.isdisjoint(layout.names)])
            groups[key] = [], [], []
        times, *lists = groups[key]
        times.append(message.time)
        for each, new in zip(lists, content):
            each.extend(new)
        size += len(data) + _OVERHEAD
    yield from _tables(groups, [*groups])


def _tables(groups: _Groups, keys: Iterable[tuple[str, bool, Layout]]) -> Iterator[TransformTable]:
    for key in keys:
        publisher, is_static, layout = key
        times, stamps, poses = groups.pop(key)
        yield TransformTable(
            publisher, is_static, [*layout.edges], np.array(times, np.int64),
            *layout.arrays(b''.join(stamps), bytearray().join(poses)))
