"""The transforms of a bag, read without ROS: into a TransformBuffer, or message by message."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
import logging
from operator import index
import os
from pathlib import Path
from typing import Any, NamedTuple, Optional, Union

from dummy_arm.tf._bag.context import BagContext, HEADERS, NOT_RECORDED, Stream
from dummy_arm.tf._bag.formats import BagError, kind_of
from dummy_arm.tf._core.engine import engine_of
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._wire.cdr import MalformedMessage
from dummy_arm.tf._wire.message_reader import Encoding, MessageReader
from dummy_arm.tf.transform_buffer import TransformBuffer

__all__ = ['HEADERS', 'NOT_RECORDED', 'BagError', 'BagMessage', 'TopicHeaders', 'messages', 'read']

_ALL_TIME = 2**63 - 1  # ns
#: A TF message of a bag: its stream, the time at which it was recorded (ns), and its bytes.
_TFRecord = tuple[Stream, int, bytes]
#: Messages are inserted in groups. A group ends when its messages take more memory than this
#: (bytes).
_BATCH_BYTES = 500_000
#: The memory that a message takes in addition to its data (bytes).
_OVERHEAD = 100
#: The transforms of a message that is longer than this (bytes) are inserted one at a time, because
#: a list of all these transforms could fill the memory.
_LONG = 2**22


class BagMessage(NamedTuple):
    """A message of a bag on the topic `/tf` or `/tf_static`."""

    stream: Stream
    time: int  #: the time at which the message was recorded (ns); 0 if it was not recorded
    data: bytes  #: the bytes of the message

    @property
    def encoding(self) -> Encoding:
        """The encoding of the bytes."""
        return self.stream.encoding

    @property
    def is_static(self) -> bool:
        """True if the message is from `/tf_static`."""
        return self.stream.is_static

    @property
    def publisher(self) -> str:
        """The name of the node that published the message; 'not recorded' in rosbag2."""
        return self.stream.publisher

    def rows(self) -> list[Row]:
        """
        Return the transforms of the message, unchanged: names may have a leading slash.

        :returns: tuples of `stamp_ns`, `frame_id`, `child_frame_id` and `pose`: x, y, z (m) and
            the quaternion x, y, z, w, which may have any norm.
        :raises ValueError: if the bytes are not those of a TFMessage.
        """
        return self.stream.encoding.unpack(self.data)


class TopicHeaders(NamedTuple):
    """The headers on a topic of a bag that is not read, or the wrong type of one that is."""

    topic: str  #: the name of the topic
    msgtype: str  #: the type of its messages, such as 'sensor_msgs/msg/LaserScan'
    #: The `frame_id` of the headers of its first messages; empty for TF messages, or a wrong type;
    #: None if it is not known whether the messages begin with a header.
    frames: Optional[frozenset[str]]


def messages(path: Union[str, 'os.PathLike[str]'], *, namespace: str = '', partial: bool = False,
             max_bytes: int = 2**30, on_progress: Optional[Callable[[float], object]] = None,
             on_headers: Optional[Callable[[list[TopicHeaders]], object]] = None
             ) -> Iterator[BagMessage]:
    """
    Yield the TF messages of a bag.

    The other arguments are those of `read`.

    :param on_headers: called at the end, with a list of the other topics whose messages begin with
        a std_msgs/Header, or may do so, of the other topics with TF messages, and of the topics
        `tf` and `tf_static` if their messages are of another type. Of each topic, the headers of
        the first 10 messages are read. None: no headers are read, and parts of the bag without TF
        are skipped.
    :returns: an iterator over the messages. The messages of a bag of ROS 1 are in the order of the
        file; those of each file of a bag of rosbag2 are in the order of their times.
    :raises: the errors of `read`; but a bag whose messages have no valid transform is no error,
        and with `on_headers`, neither is a bag whose topic `tf` or `tf_static` has another type.
    """
    path, context = _open(path, namespace, partial, max_bytes, on_progress, on_headers is not None)
    count = 0
    for record in _records(path, context):
        count += 1
        yield BagMessage(*record)
    _finish(path, context, count)
    if on_headers:
        on_headers([
            *(TopicHeaders(stream.topic, stream.msgtype, frozenset(stream.frames))
              for stream in context.header_streams.values()),
            *(TopicHeaders(topic, msgtype, None)
              for topic, msgtype in context.unknown_types.items()),
            *(TopicHeaders(topic, msgtype, frozenset())
              for topic, msgtype in (*context.other_tf.items(), *context.wrong_types.items()))])


def read(path: Union[str, 'os.PathLike[str]'], *, cache_time: Any = None, namespace: str = '',
         partial: bool = False, max_bytes: int = 2**30, max_samples: Optional[int] = None,
         on_progress: Optional[Callable[[float], object]] = None) -> TransformBuffer:
    """
    Read the transforms of a bag.

    :param path: a directory, a .mcap or a .db3 file of rosbag2, or a .bag file of ROS 1.
    :param cache_time: how long transforms are kept (ns); None: there is no limit.
    :param namespace: the namespace of the topics `tf` and `tf_static`; '': none.
    :param partial: if the bag is cut off or damaged, read the undamaged parts and log a warning,
        instead of raising a BagError.
    :param max_bytes: the largest decompressed size (bytes) that is allowed for a chunk or a
        message. This limits the memory that decompression can take.
    :param max_samples: the largest number of dynamic transforms that are kept; None: there is no
        limit.
    :param on_progress: called repeatedly with the fraction of the bag that has been read, from 0
        to 1. What it raises ends `read`.
    :returns: a buffer. The authority of a transform is the name of the node that published it in
        a bag of ROS 1, and 'not recorded' in rosbag2.
    :raises BagError: if the path is not a bag, if the bag has no transforms, or if a library that
        is needed to read it is not installed. Unless `partial` is True, also if the bag is cut
        off or damaged, or has a chunk or a message that is larger than max_bytes.
    :raises ValueError: if max_bytes, cache_time or max_samples is out of range.
    :raises OSError: if the path does not exist, or is a file that cannot be opened.
    """
    path, context = _open(path, namespace, partial, max_bytes, on_progress)
    buffer = TransformBuffer(
        _ALL_TIME if cache_time is None else cache_time, max_samples=max_samples)
    insert = engine_of(buffer).insert_batches
    faults: Counter[str] = Counter()

    def count_fault(error: MalformedMessage) -> None:
        """Count a fault by its kind, which precedes the colon."""
        faults[str(error).partition(':')[0]] += 1

    readers: dict[tuple[bool, Encoding], MessageReader] = {}
    count = 0
    for groups in _grouped_by_stream(_records(path, context), cache_time is not None):
        for stream, messages in groups.items():
            key = stream.is_static, stream.encoding
            reader = readers.setdefault(key, MessageReader(count_fault, stream.encoding))
            for is_long, group in groupby(messages, lambda message: len(message) > _LONG):
                if is_long:
                    _insert_long(buffer, group, stream, count_fault, context.tick)
                else:
                    insert(reader.read(group, stream.publisher, stream.is_static))
            count += len(messages)
    for fault, times in faults.items():
        logging.getLogger('dummy_arm.tf').warning(
            '%s: skipped %d of %d TF messages, which cannot be decoded: %s',
            path, times, count, fault)
    _finish(path, context, count)
    if not buffer.frames():
        raise BagError(f'{path} has TF messages ({count}), but no valid transform in them')
    return buffer


def _open(path: Union[str, 'os.PathLike[str]'], namespace: str, partial: bool, max_bytes: int,
          on_progress: Optional[Callable[[float], object]], with_headers: bool = False
          ) -> tuple[Path, BagContext]:
    if index(max_bytes) < 1:
        raise ValueError(f'max_bytes must be a positive number of bytes, got {max_bytes}')
    path = Path(path)
    return path, BagContext(
        path, namespace, partial, max_bytes, on_progress or (lambda done: None), with_headers)


def _finish(path: Path, context: BagContext, count: int) -> None:
    """Report that the bag, with `count` TF messages, has been read; log its damage."""
    context.finish()
    is_wrong = bool(context.wrong_types)
    if not count and not (is_wrong and context.with_headers):
        raise BagError(
            f'no TF message can be read from {" ".join(context.damage)}' if context.damage else
            f'{path} has no TF: {context.why_no_tf()}')
    if is_wrong and not context.with_headers:
        logging.getLogger('dummy_arm.tf').warning('%s: %s', path, context.wrong_types_text())
    if context.damage:
        logging.getLogger('dummy_arm.tf').warning(
            '%s Read %d TF messages', ' '.join(context.damage), count)


def _insert_long(buffer: TransformBuffer, messages: Iterable[bytes], stream: Stream,
                 on_malformed: Callable[[MalformedMessage], None], tick: Callable[[], None]
                 ) -> None:
    """Insert the transforms of long messages one at a time, but none of a malformed one."""
    for data in messages:
        try:
            for _ in stream.encoding.rows(data):
                tick()
        except MalformedMessage as error:
            on_malformed(error)
            continue
        for row in stream.encoding.rows(data):
            tick()
            buffer.insert(*row, stream.publisher, stream.is_static)


def _records(path: Path, context: BagContext) -> Iterator[_TFRecord]:
    """Yield the records of the TF messages of a bag; pass other messages to their HeaderStream."""
    kind = kind_of(path)
    try:
        if kind == '.bag':
            from dummy_arm.tf._bag.rosbag1 import records
        else:
            from dummy_arm.tf._bag.rosbag2 import records
        for stream, time, data in records(path, context):
            if isinstance(stream, Stream):
                yield stream, time if time < 2**63 else 0, data
            else:
                stream.add(data)
    except Exception as error:  # a damaged file causes errors of many types
        context.tick()  # if on_progress has raised an exception, this raises it again
        if isinstance(error, ImportError):
            raise BagError(f'a library that reads bags cannot be imported ({error}): '
                           'pip install mcap lz4 ruamel.yaml backports.zstd') from None
        if isinstance(error, BagError):
            raise
        context.handle_error(path, error)


def _grouped_by_stream(records: Iterable[_TFRecord], in_order: bool
                       ) -> Iterator[dict[Stream, list[bytes]]]:
    """
    Yield groups of about `_BATCH_BYTES` bytes: the messages of each stream.

    Static messages keep their order relative to those of other streams; if `in_order` is True,
    dynamic messages do, too.
    """
    groups: defaultdict[Stream, list[bytes]] = defaultdict(list)
    messages: list[bytes] = []
    last: Optional[Stream] = None
    size = 0
    for stream, _, data in records:
        if size > _BATCH_BYTES or (last and stream is not last and (
                in_order or last.is_static or stream.is_static)):
            yield groups
            groups, last, size = defaultdict(list), None, 0
        if stream is not last:
            last, messages = stream, groups[stream]
        messages.append(data)
        size += len(data) + _OVERHEAD
    yield groups
