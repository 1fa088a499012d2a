"""The transforms of a bag, read without ROS: into a TransformBuffer, or message by message."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
import logging
from operator import index
from pathlib import Path
from typing import Any, NamedTuple, Optional

from puretf._bag.context import BagContext, NOT_RECORDED, Record, Stream, TF_TYPES
from puretf._bag.formats import BagError
from puretf._bag.recordings import is_bag, Paths, Recording, resolved
from puretf._bag.recordings import recordings as find_recordings
from puretf._core.engine import engine_of
from puretf._core.pose import Row
from puretf._core.texts import comma_list
from puretf._wire import ros1
from puretf._wire.cdr import MalformedMessage
from puretf._wire.headers import Headers
from puretf._wire.message_reader import Encoding, MessageReader
from puretf.transform_buffer import TransformBuffer

__all__ = ['NOT_RECORDED', 'BagError', 'BagMessage', 'Headers', 'Paths', 'Topic', 'decoded',
           'is_bag', 'messages', 'missing_part', 'read', 'recordings']

_ALL_TIME = 2**63 - 1  # ns
#: Messages are inserted in groups. A group ends when its messages take more memory than this
#: (bytes).
_BATCH_BYTES = 500_000
#: The memory that a message takes in addition to its data (bytes).
_OVERHEAD = 100
#: The transforms of a message that is longer than this (bytes) are inserted one at a time, because
#: a list of all these transforms could fill the memory.
_LONG = 2**22
#: The largest number of recordings that the text of an error lists.
_SHOWN = 5


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


class Topic(NamedTuple):
    """A topic of a bag."""

    name: str
    msgtype: str  #: the type of its messages, such as 'sensor_msgs/msg/LaserScan'
    #: The headers of its messages: of all, or of an even sample of at most 20 000. It is empty for
    #: TF messages, and others without a header; None if it is not known whether they have one.
    headers: Optional[Headers]
    #: The recorded durability of each publisher of TF messages, such as 'TRANSIENT_LOCAL'; empty
    #: if it was not recorded.
    durabilities: tuple[str, ...]

    @property
    def is_tf(self) -> bool:
        """True if its messages are TF messages."""
        return self.msgtype in TF_TYPES


def recordings(paths: Paths) -> list[list[Path]]:
    """
    Sort the files that some paths name into recordings, in the order of the paths.

    Files belong to one recording if a metadata.yaml lists them, or if rosbag2 has named them as
    parts of a split recording: `name_0.mcap`, `name_1.mcap` and so on.

    :param paths: files, directories of rosbag2, directories of bags, and patterns like `*.mcap`.
    :returns: for each recording, the paths to pass to `read`: its directory, or its files.
    """
    return [each.files or [each.path] for each in find_recordings(paths)]


def missing_part(path: Paths) -> str:
    """Return a sentence that names the first part, if only later parts are given; else ''."""
    found = find_recordings(path)
    return resolved(found[0], True).missing_part if found else ''


def messages(path: Paths, *, namespace: str = '', partial: bool = False,
             max_bytes: int = 2**30, on_progress: Optional[Callable[[float], object]] = None,
             on_topics: Optional[Callable[[list[Topic]], object]] = None
             ) -> Iterator[BagMessage]:
    """
    Yield the TF messages of a bag.

    The other arguments are those of `read`.

    :param on_topics: called at the end, with a list of the topics of the bag and the headers of
        their messages. None: no headers are read, and parts of the bag without TF are skipped.
    :returns: an iterator over the messages. Those of each file are in the order of the times at
        which they were recorded, unless the file is cut off or has no index.
    :raises: the errors of `read`; but a bag whose messages have no valid transform is no error,
        and with `on_topics`, neither is a bag whose topic `tf` or `tf_static` has another type.
    """
    recording, context = _open(path, namespace, partial, max_bytes, on_progress,
                               on_topics is not None)
    count = 0
    for stream, time, data in _records(recording, context):
        count += 1
        yield BagMessage(stream, time if time < 2**63 else 0, data)
    _finish(recording, context, count, accepts_wrong_types=on_topics is not None)
    if on_topics:
        on_topics([Topic(
            topic.name, topic.msgtype,
            None if topic.has_header is None else topic.headers,
            tuple(topic.durabilities.elements())) for topic in context.topics.values()])


def decoded(path: Paths, msgtype: str, name: str, *, partial: bool = False,
            max_bytes: int = 2**30, on_progress: Optional[Callable[[float], object]] = None
            ) -> Iterator[tuple[str, Any]]:
    """
    Yield the messages of a standard type on topics that are not of TF, decoded by rosbags.

    The other arguments are those of `read`; damage is not logged.

    :param msgtype: the type, such as 'sensor_msgs/msg/JointState'.
    :param name: the last part of the names of the topics, such as 'joint_states'.
    :returns: an iterator over the topic and the message, without those that cannot be decoded.
    :raises: the errors of `read`; but a bag without such a topic is no error.
    """
    recording, context = _open(path, '', partial, max_bytes, on_progress, other=(msgtype, name))
    from rosbags.typesys import get_typestore, Stores
    ros_1, ros_2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.LATEST)
    for stream, _, data in _records(recording, context):
        decode = ros_1.deserialize_ros1 if stream.encoding is ros1 else ros_2.deserialize_cdr
        try:
            message = decode(data, msgtype)
        except Exception:  # the decoder raises errors of many types
            continue
        yield stream.publisher, message


def read(path: Paths, *, cache_time: Any = None, namespace: str = '',
         partial: bool = False, max_bytes: int = 2**30, max_samples: Optional[int] = None,
         on_progress: Optional[Callable[[float], object]] = None) -> TransformBuffer:
    """
    Read the transforms of a bag.

    :param path: a directory, a .mcap or a .db3 file of rosbag2, or a .bag file of ROS 1; or
        several paths, or a pattern like `name_*.mcap`, if these are the parts of one recording.
    :param cache_time: how long transforms are kept (ns); None: there is no limit.
    :param namespace: the namespace of the topics `tf` and `tf_static`; '': none.
    :param partial: if a .mcap file is cut off or damaged, read the undamaged parts and log a
        warning, instead of raising a BagError.
    :param max_bytes: the largest size (bytes) that is allowed for a message, and that a chunk of
        a .mcap file may declare.
    :param max_samples: the largest number of dynamic transforms that are kept; None: there is no
        limit.
    :param on_progress: called repeatedly with the fraction of the bag that has been read, from 0
        to 1. What it raises ends `read`.
    :returns: a buffer. The authority of a transform is the name of the node that published it in
        a bag of ROS 1, and 'not recorded' in rosbag2. Without a cache_time, transforms of one
        frame by several nodes of ROS 1 may be inserted in another order.
    :raises BagError: if the path is not a bag, if there are several recordings, if the bag has no
        transforms, or if a library that is needed to read it is not installed. Unless `partial` is
        True, also if the bag is cut off or damaged, or has a chunk or a message that is larger
        than max_bytes.
    :raises ValueError: if max_bytes, cache_time or max_samples is out of range.
    :raises OSError: if the path does not exist, or is a file that cannot be opened.
    """
    recording, context = _open(path, namespace, partial, max_bytes, on_progress)
    buffer = TransformBuffer(
        _ALL_TIME if cache_time is None else cache_time, max_samples=max_samples)
    engine = engine_of(buffer)
    faults: Counter[str] = Counter()

    def count_fault(error: MalformedMessage) -> None:
        """Count a fault by its kind, which precedes the colon."""
        faults[str(error).partition(':')[0]] += 1

    readers: dict[tuple[bool, Encoding], MessageReader] = {}
    count = 0
    for groups in _grouped_by_stream(_records(recording, context), cache_time is not None):
        for stream, messages in groups.items():
            key = stream.is_static, stream.encoding
            reader = readers.setdefault(key, MessageReader(count_fault, stream.encoding))
            for is_long, group in groupby(messages, lambda message: len(message) > _LONG):
                if is_long:
                    _insert_long(buffer, group, stream, count_fault, context.tick)
                else:
                    engine.insert_batches(
                        reader.read(group, stream.publisher, stream.is_static))
            count += len(messages)
    for fault, times in faults.items():
        logging.getLogger('puretf').warning(
            '%s: skipped %d of %d TF messages, which cannot be decoded: %s',
            recording.path, times, count, fault)
    _finish(recording, context, count)
    frames = buffer.frames()
    if not frames:
        raise BagError(
            f'{recording.path} has TF messages ({count}), but no valid transform in them')
    if recording.missing_part and not any(frame.is_static for frame in frames):
        engine.tree.advice = f' {recording.missing_part}'
    return buffer


def _open(paths: Paths, namespace: str, partial: bool, max_bytes: int,
          on_progress: Optional[Callable[[float], object]], with_headers: bool = False,
          other: tuple[str, str] = ('', '')
          ) -> tuple[Recording, BagContext]:
    if index(max_bytes) < 1:
        raise ValueError(f'max_bytes must be a positive number of bytes, got {max_bytes}')
    found = find_recordings(paths)
    if not found:
        raise BagError('no path of a bag is given')
    if len(found) > 1:
        names = comma_list([str(each.path) for each in found], _SHOWN)
        first = next((str(each.first) for each in found if each.first), '')
        raise BagError(f'these are {len(found)} recordings ({names}): give the files of one' + (
            f'; or, if they are parts of one, also its first part, {first}' if first else ''))
    try:
        recording = resolved(found[0], partial)
        recording.files[0].stat()  # a missing file is reported before a missing library
    except ImportError as error:
        raise _library_missing(error) from None
    if recording.warning:
        logging.getLogger('puretf').warning(recording.warning)
    return recording, BagContext(
        recording, namespace, partial, max_bytes, on_progress or (lambda done: None), with_headers,
        other)


def _finish(recording: Recording, context: BagContext, count: int,
            accepts_wrong_types: bool = False) -> None:
    """Report that the bag, with `count` TF messages, has been read; log its damage."""
    wrong_types = context.wrong_types()
    if not count and not (wrong_types and accepts_wrong_types):
        if context.damage:
            raise BagError(f'no TF message can be read: {" ".join(context.damage)}')
        part = f'. {recording.missing_part}' if recording.missing_part else ''
        raise BagError(f'{recording.path} has no TF: {context.why_no_tf()}{part}')
    if wrong_types and not accepts_wrong_types:
        logging.getLogger('puretf').warning('%s: %s', recording.path, wrong_types)
    if context.damage:
        logging.getLogger('puretf').warning(
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


def _records(recording: Recording, context: BagContext) -> Iterator[Record]:
    """Yield the TF messages of a recording; read the headers of others."""
    try:
        from puretf._bag.whole_files import records
        yield from records(recording, context)
    except ImportError as error:
        context.tick()  # if on_progress has raised an exception, this raises it again
        raise _library_missing(error) from None
    context.begin(1.0, 0.0)


def _library_missing(error: ImportError) -> BagError:
    return BagError(f'a library that reads bags cannot be imported ({error}): '
                    'pip install rosbags mcap')


def _grouped_by_stream(records: Iterable[Record], in_order: bool
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
