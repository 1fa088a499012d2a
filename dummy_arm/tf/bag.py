"""The transforms of a bag, read without ROS: into a BufferCore, or message by message."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
import logging
from operator import index
import os
from pathlib import Path
from typing import Any, NamedTuple, Optional, Union

from dummy_arm.tf._bag.context import (
    BagContext,
    BagError,
    HEADERS,
    kind_of,
    NOT_RECORDED,
    Stream,
)
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._wire.cdr import MalformedMessage
from dummy_arm.tf._wire.streams import Encoding, MessageReader
from dummy_arm.tf.buffer_core import BufferCore

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

    #: Private; see the properties below.
    #:
    #: :meta private:
    stream: Stream
    time: int  #: the time at which the message was recorded (ns); 0 if it was not recorded
    data: bytes  #: the bytes of the message

    @property
    def encoding(self) -> Encoding:
        """
        The encoding of the bytes.

        :meta private:
        """
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

        :returns: for each transform, a tuple of `stamp_ns`, `frame_id`, `child_frame_id` and
            `pose`. The pose is x, y, z (m) and the quaternion x, y, z, w, which may have any norm.
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

    :param path: as for `read`.
    :param namespace: as for `read`.
    :param partial: as for `read`.
    :param max_bytes: as for `read`.
    :param on_progress: as for `read`.
    :param on_headers: called at the end, with a list of the other topics whose messages begin with
        a std_msgs/Header, or may do so, of the other topics with TF messages, and of the topics
        `tf` and `tf_static` if their messages are of another type. Of each topic, the headers of
        the first 10 messages are read. None: no headers are read, and parts of the bag without TF
        are skipped.
    :returns: an iterator over the messages. The messages of a bag of ROS 1 are in the order of the
        file; those of each file of a bag of rosbag2 are in the order of their times.
    :raises BagError: as `read`; but a bag whose messages have no valid transform is no error, and
        with `on_headers`, neither is a bag whose topic `tf` or `tf_static` has another type.
    :raises ValueError: if max_bytes is out of range.
    :raises OSError: as `read`.
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
         on_progress: Optional[Callable[[float], object]] = None) -> BufferCore:
    """
    Read the transforms of a bag.

    :param path: the path of a bag: a directory of rosbag2, a .mcap or .db3 file of rosbag2, or a
        .bag file of ROS 1.
    :param cache_time: how long transforms are kept (ns); see `BufferCore`. If it is None, there is
        no time limit.
    :param namespace: the namespace of the topics `tf` and `tf_static`. If it is '', the topics are
        `/tf` and `/tf_static`.
    :param partial: what to do if the bag is cut off or damaged. True: read the undamaged parts and
        log a warning. False: raise a BagError.
    :param max_bytes: the largest decompressed size (bytes) that is allowed for a chunk or a
        message. This argument limits the memory that decompression can take.
    :param max_samples: the largest number of dynamic transforms that are kept; see `BufferCore`.
        If it is None, the number is not limited.
    :param on_progress: called repeatedly with the fraction of the bag that has been read, from 0
        to 1. If on_progress raises an exception, `read` ends and raises the same exception.
    :returns: a buffer with the transforms of the bag. The authority of a transform from a bag of
        ROS 1 is the name of the node that published the transform. The authority of a transform
        from a bag of rosbag2 is 'not recorded'.
    :raises BagError: if the path is not a bag, if the bag has no transforms, or if a library that
        is needed to read the bag is not installed. If `partial` is False, a BagError is also
        raised if the bag is cut off or damaged, or has a chunk or a message that is larger than
        max_bytes.
    :raises ValueError: if max_bytes, cache_time or max_samples is out of range.
    :raises OSError: if the path does not exist, or is a file that cannot be opened.
    """
    path, context = _open(path, namespace, partial, max_bytes, on_progress)
    buffer = BufferCore(_ALL_TIME if cache_time is None else cache_time, max_samples=max_samples)
    faults: Counter[str] = Counter()

    def on_malformed(error: MalformedMessage) -> None:
        """
        Count a message that cannot be decoded.

        :param error: the error, whose text begins with the kind of fault and a colon.
        """
        faults[str(error).partition(':')[0]] += 1

    readers: dict[tuple[bool, Encoding], MessageReader] = {}
    count = 0
    for groups in _grouped_by_stream(_records(path, context), cache_time is not None):
        for stream, messages in groups.items():
            key = stream.is_static, stream.encoding
            reader = readers.setdefault(key, MessageReader(on_malformed, stream.encoding))
            for is_long, group in groupby(messages, lambda message: len(message) > _LONG):
                if is_long:
                    _insert_long(buffer, group, stream, on_malformed, context.tick)
                else:
                    buffer.insert_batches(reader.read(group, stream.publisher, stream.is_static))
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
    """
    Return the path of a bag, and the context in which it is read.

    :raises ValueError: if max_bytes is out of range.
    """
    if index(max_bytes) < 1:
        raise ValueError(f'max_bytes must be a positive number of bytes, got {max_bytes}')
    path = Path(path)
    return path, BagContext(
        path, namespace, partial, max_bytes, on_progress or (lambda done: None), with_headers)


def _finish(path: Path, context: BagContext, count: int) -> None:
    """
    Report that the whole bag has been read; log its damage.

    :param count: the number of TF messages that were read.
    :raises BagError: if there was no TF message, and `messages` does not report a wrong type.
    """
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


def _insert_long(buffer: BufferCore, messages: Iterable[bytes], stream: Stream,
                 on_malformed: Callable[[MalformedMessage], None], tick: Callable[[], None]
                 ) -> None:
    """
    Insert the transforms of long messages, one transform at a time.

    No transform of a malformed message is inserted.
    """
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
    """
    Yield the records of the TF messages of a bag; pass other messages to their HeaderStream.

    :raises BagError: if the path is not a bag, if a library that reads bags cannot be imported,
        or if the bag is damaged and `context.partial` is False.
    :raises OSError: if the path does not exist, or is a file that cannot be opened.
    """
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
    Yield groups of messages; a group is a dict that maps streams to lists of messages.

    A group ends at the latest when its messages take more than `_BATCH_BYTES` bytes.

    The messages of one stream keep their order. Static messages also keep their order relative to
    the messages of other streams.

    :param in_order: True: dynamic messages also keep their order relative to the messages of other
        streams. False: they may lose this order within a group.
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
