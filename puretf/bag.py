"""The transforms and other messages of a bag, read without ROS."""

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator
from itertools import groupby
import logging
from operator import index
from pathlib import Path
import shutil
from time import monotonic
from typing import Any, NamedTuple, Optional

from puretf._bag.context import BagContext, NOT_RECORDED, Other, Record, Topic
from puretf._bag.formats import BagError
from puretf._bag.recordings import is_bag, Paths, resolved
from puretf._bag.recordings import recordings as find_recordings
from puretf._core.engine import engine_of
from puretf._core.pose import Row
from puretf._core.texts import comma_list
from puretf._wire.cdr import MalformedMessage
from puretf._wire.headers import Headers
from puretf._wire.message_reader import Encoding, MessageReader
from puretf.transform_buffer import TransformBuffer

__all__ = ['NOT_RECORDED', 'Bag', 'BagError', 'BagMessage', 'Headers', 'Paths', 'Topic', 'is_bag',
           'open', 'read', 'recordings']

_ALL_TIME = 2**63 - 1  # ns
#: Messages are inserted in groups. A group ends when its messages take more memory than this
#: (bytes).
_BATCH_BYTES = 500_000
#: If others see the buffer while it is filled, a group ends after this time, too (s).
_BATCH_TIME = 0.1
#: The memory that a message takes in addition to its data (bytes).
_OVERHEAD = 100
#: The transforms of a message that is longer than this (bytes) are inserted one at a time, because
#: a list of all these transforms could fill the memory.
_LONG = 2**22
#: The largest number of recordings that the text of an error lists.
_SHOWN = 5


class BagMessage(NamedTuple):
    """A message of a bag."""

    topic: Topic
    time: int  #: the time at which the message was recorded (ns); 0 if it was not recorded
    data: bytes  #: the bytes of the message

    @property
    def encoding(self) -> Encoding:
        """The encoding of the bytes."""
        return self.topic.encoding

    @property
    def is_static(self) -> bool:
        """True if the message is from `/tf_static`."""
        return bool(self.topic.is_static)

    @property
    def publisher(self) -> str:
        """The name of the node that published the message; 'not recorded' in rosbag2."""
        return self.topic.publisher

    def rows(self) -> list[Row]:
        """
        Return the transforms of a TF message, unchanged: names may have a leading slash.

        :returns: tuples of `stamp_ns`, `frame_id`, `child_frame_id` and `pose`: x, y, z (m) and
            the quaternion x, y, z, w, which may have any norm.
        :raises ValueError: if the bytes are not those of a TFMessage.
        """
        return self.topic.encoding.unpack(self.data)

    def decoded(self) -> Any:
        """Return a message of a standard type as rosbags decodes it; None if it cannot."""
        from puretf._bag.decoding import decoded
        return decoded(self.data, self.topic.msgtype, self.topic.encoding)


class Bag:
    """
    A recording, opened once; a context manager. See `open`.

    `topics`, `begin` and `end` are those of the files that have been read; if none has been, they
    are looked up.
    """

    def __init__(self, paths: Paths, partial: bool, namespace: str, max_bytes: int,
                 on_progress: Optional[Callable[[float], object]]) -> None:
        if index(max_bytes) < 1:
            raise ValueError(f'max_bytes must be a positive number of bytes, got {max_bytes}')
        found = find_recordings(paths)
        if not found:
            raise BagError('no path of a bag is given')
        if len(found) > 1:
            names = comma_list([str(each.path) for each in found], _SHOWN)
            first = next((str(each.first) for each in found if each.first), '')
            part = f'; or, if they are parts of one, also its first part, {first}' if first else ''
            raise BagError(f'these are {len(found)} recordings ({names}): give the files of one'
                           f'{part}')
        try:
            recording = resolved(found[0], partial)
            recording.files[0].stat()  # a missing file is reported before a missing library
        except ImportError as error:
            raise _library_missing(error) from None
        if recording.warning:
            logging.getLogger('puretf').warning(recording.warning)
        self.path = recording.path  #: the directory, or the first file that was given
        self.files = recording.files  #: the parts of the recording, in order
        #: A sentence that names the first part, if only later parts are given; else ''.
        self.missing_part = recording.missing_part
        self.namespace = namespace  #: the namespace of the topics `tf` and `tf_static`
        self._context = BagContext(
            recording, namespace, partial, max_bytes, on_progress or (lambda done: None))
        self._was_read = False

    def __enter__(self) -> 'Bag':
        """Return the bag."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bag."""
        self.close()

    def close(self) -> None:
        """Remove the decompressed copies of compressed files."""
        for copy in self._context.copies.values():
            shutil.rmtree(copy.parent, ignore_errors=True)
        self._context.copies.clear()

    @property
    def topics(self) -> list[Topic]:
        """The topics, at most 10 000, each once for each type that it has."""
        return [*self._looked_up().topics.values()]

    @property
    def begin(self) -> int:
        """The time at which the first message was recorded (ns); 0: it is not known."""
        return self._looked_up().begin_ns

    @property
    def end(self) -> int:
        """The time at which the last message was recorded (ns); 0: it is not known."""
        return self._looked_up().end_ns

    def _looked_up(self) -> BagContext:
        if not self._was_read:
            for _ in self._records(False, False, (), 0, 0):
                pass
        return self._context

    def messages(self, *, tf: bool = True, headers: bool = False,
                 others: Collection[Other] = (), start: int = 0, stop: int = 2**63
                 ) -> Iterator[BagMessage]:
        """
        Yield messages, all kinds in one pass.

        Those of each file are in the order of the times at which they were recorded, unless the
        file is cut off or has no index.

        :param tf: whether to yield the TF messages.
        :param headers: whether to read the headers of messages on other topics into `topics`. Then
            it is no error if the topic `tf` or `tf_static` has another type.
        :param others: other messages to be yielded: the type, as 'sensor_msgs/msg/JointState',
            and the last part of the name of the topics, such as 'joint_states'; or the whole name
            of a topic, such as '/scan'. Of such a topic, `has_header` is known.
        :param start: messages before this time of the recording (ns) are left out, except static
            transforms.
        :param stop: so are messages from this time on.
        :raises BagError: if the bag cannot be read, see `read`; or if it has no TF messages,
            although `tf` is True.
        """
        count = 0
        for topic, time, data in self._records(tf, headers, others, start, stop):
            count += topic.is_static is not None
            yield _message(topic, time, data)
        if tf:
            self._finish(count, accepts_wrong_types=headers)
        elif damage := self._context.damage:
            logging.getLogger('puretf').warning(' '.join(damage))

    def read(self, *, cache_time: Any = None, max_samples: Optional[int] = None,
             headers: bool = False, others: Collection[Other] = (),
             on_message: Optional[Callable[[BagMessage], object]] = None,
             buffer: Optional[TransformBuffer] = None) -> TransformBuffer:
        """
        Read the transforms into a buffer; the other arguments are those of `messages`.

        :param cache_time: how long transforms are kept (ns); None: there is no limit.
        :param max_samples: the largest number of dynamic transforms that are kept; None: there is
            no limit.
        :param on_message: called with each message, those of TF included, before it is inserted.
        :param buffer: the buffer to fill, which other threads can use meanwhile; None: a new one,
            with the given cache_time and max_samples.
        :returns: the buffer. The authority of a transform is the name of the node that published
            it in a bag of ROS 1, and 'not recorded' in rosbag2. Without a cache_time, transforms
            of one frame by several nodes of ROS 1 may be inserted in another order.
        :raises BagError: if the bag has no valid transforms, or cannot be read.
        :raises ValueError: if cache_time or max_samples is out of range.
        """
        batch_time = 0.0 if buffer is None else _BATCH_TIME
        if buffer is None:
            buffer = TransformBuffer(
                _ALL_TIME if cache_time is None else cache_time, max_samples=max_samples)
        engine, tick = engine_of(buffer), self._context.tick
        faults: Counter[str] = Counter()

        def count_fault(error: MalformedMessage) -> None:
            """Count a fault by its kind, which precedes the colon."""
            faults[str(error).partition(':')[0]] += 1

        readers: dict[tuple[bool, Encoding], MessageReader] = {}
        records = self._records(True, headers, others, 0, 2**63)
        if on_message or others:
            records = _passed_on(records, on_message)
        count = 0
        for groups in _grouped_by_topic(
                records, engine.tree.cache_time < _ALL_TIME, batch_time):
            for topic, messages in groups.items():
                is_static = bool(topic.is_static)
                reader = readers.setdefault(
                    (is_static, topic.encoding), MessageReader(count_fault, topic.encoding))
                for is_long, group in groupby(messages, lambda message: len(message) > _LONG):
                    if is_long:
                        _insert_long(buffer, group, topic, count_fault, tick)
                    else:
                        engine.insert_batches(reader.read(group, topic.publisher, is_static))
                count += len(messages)
        for fault, times in faults.items():
            logging.getLogger('puretf').warning(
                '%s: skipped %d of %d TF messages, which cannot be decoded: %s',
                self.path, times, count, fault)
        self._finish(count)
        frames = buffer.frames()
        if not frames:
            raise BagError(
                f'{self.path} has TF messages ({count}), but no valid transform in them')
        if self.missing_part and not any(frame.is_static for frame in frames):
            engine.tree.advice = f' {self.missing_part}'
        return buffer

    def _records(self, tf: bool, headers: bool, others: Collection[Other], start: int, stop: int
                 ) -> Iterator[Record]:
        """Yield the messages that are wanted; read the headers of others."""
        self._context.select(tf, headers, others, start, stop)
        try:
            from puretf._bag.whole_files import records
            yield from records(self._context)
        except ImportError as error:
            self._context.tick()  # if on_progress has raised an exception, this raises it again
            raise _library_missing(error) from None
        self._context.begin(1.0, 0.0)
        self._was_read = True

    def _finish(self, count: int, accepts_wrong_types: bool = False) -> None:
        """Report that the bag, with `count` TF messages, has been read; log its damage."""
        context, wrong_types = self._context, self._context.wrong_types()
        if not count and not (wrong_types and accepts_wrong_types):
            if context.damage:
                raise BagError(f'no TF message can be read: {" ".join(context.damage)}')
            part = f'. {self.missing_part}' if self.missing_part else ''
            raise BagError(f'{self.path} has no TF: {context.why_no_tf()}{part}')
        if wrong_types and not accepts_wrong_types:
            logging.getLogger('puretf').warning('%s: %s', self.path, wrong_types)
        if context.damage:
            logging.getLogger('puretf').warning(
                '%s Read %d TF messages', ' '.join(context.damage), count)


def open(  # noqa: A001
        paths: Paths, *, partial: bool = False, namespace: str = '', max_bytes: int = 2**30,
        on_progress: Optional[Callable[[float], object]] = None) -> Bag:
    """
    Open a bag.

    :param paths: a directory, a .mcap or a .db3 file of rosbag2, or a .bag file of ROS 1; or
        several paths, or a pattern like `name_*.mcap`, if these are the parts of one recording.
    :param partial: if a .mcap file is cut off or damaged, read the undamaged parts and log a
        warning, instead of raising a BagError.
    :param namespace: the namespace of the topics `tf` and `tf_static`; '': none.
    :param max_bytes: the largest size (bytes) that is allowed for a message, and that a chunk of
        a .mcap file may declare.
    :param on_progress: called repeatedly with the fraction of the bag that has been read, from 0
        to 1. What it raises ends the reading.
    :raises BagError: if the path is not a bag, if there are several recordings, or if a library
        that is needed to read it is not installed. While it is read: if the bag is cut off or
        damaged, or has a chunk or a message that is larger than max_bytes, unless `partial` is
        True.
    :raises ValueError: if max_bytes is out of range.
    :raises OSError: if the path does not exist, or is a file that cannot be opened.
    """
    return Bag(paths, partial, namespace, max_bytes, on_progress)


def read(path: Paths, *, cache_time: Any = None, max_samples: Optional[int] = None, **kwargs: Any
         ) -> TransformBuffer:
    """Read the transforms of a bag: `open(path, **kwargs).read(...)`."""
    with open(path, **kwargs) as bag:
        return bag.read(cache_time=cache_time, max_samples=max_samples)


def recordings(paths: Paths) -> list[list[Path]]:
    """
    Sort the files that some paths name into recordings, in the order of the paths.

    Files belong to one recording if a metadata.yaml lists them, or if rosbag2 has named them as
    parts of a split recording: `name_0.mcap`, `name_1.mcap` and so on.

    :param paths: files, directories of rosbag2, directories of bags, and patterns like `*.mcap`.
    :returns: for each recording, the paths to pass to `open`: its directory, or its files.
    """
    return [each.files or [each.path] for each in find_recordings(paths)]


def _message(topic: Topic, time: int, data: bytes) -> BagMessage:
    return BagMessage(topic, time if time < 2**63 else 0, data)


def _passed_on(records: Iterable[Record], on_message: Optional[Callable[[BagMessage], object]]
               ) -> Iterator[Record]:
    """Pass messages on to a function; yield those of TF."""
    for record in records:
        if on_message:
            on_message(_message(*record))
        if record[0].is_static is not None:
            yield record


def _insert_long(buffer: TransformBuffer, messages: Iterable[bytes], topic: Topic,
                 on_malformed: Callable[[MalformedMessage], None], tick: Callable[[], None]
                 ) -> None:
    """Insert the transforms of long messages one at a time, but none of a malformed one."""
    for data in messages:
        try:
            for _ in topic.encoding.rows(data):
                tick()
        except MalformedMessage as error:
            on_malformed(error)
            continue
        for row in topic.encoding.rows(data):
            tick()
            buffer.insert(*row, topic.publisher, bool(topic.is_static))


def _library_missing(error: ImportError) -> BagError:
    return BagError(f'a library that reads bags cannot be imported ({error}): '
                    'pip install rosbags mcap')


def _grouped_by_topic(records: Iterable[Record], in_order: bool, batch_time: float
                       ) -> Iterator[dict[Topic, list[bytes]]]:
    """
    Yield groups of about `_BATCH_BYTES` bytes: the messages of each topic.

    Static messages keep their order relative to those of other topics; if `in_order` is True,
    dynamic messages do, too. A group takes about `batch_time` at most (s); 0.0: any time.
    """
    groups: defaultdict[Topic, list[bytes]] = defaultdict(list)
    messages: list[bytes] = []
    last: Optional[Topic] = None
    size, end = 0, monotonic() + batch_time
    for topic, _, data in records:
        if size > _BATCH_BYTES or (batch_time and monotonic() > end) or (
                last and topic is not last and (in_order or last.is_static or topic.is_static)):
            yield groups
            groups, last, size, end = defaultdict(list), None, 0, monotonic() + batch_time
        if topic is not last:
            last, messages = topic, groups[topic]
        messages.append(data)
        size += len(data) + _OVERHEAD
    yield groups
