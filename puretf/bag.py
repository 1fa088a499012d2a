"""The transforms and other messages of a bag, read without ROS."""

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager
import logging
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any, NamedTuple, Optional

from puretf._bag.contents import Contents, NOT_RECORDED, Other, Record, Topic
from puretf._bag.recordings import BagError, is_bag, Paths, resolved
from puretf._bag.recordings import recordings as find_recordings
from puretf._core.engine import engine_of
from puretf._core.pose import Row
from puretf._core.times import nanoseconds_or_int
from puretf._text.names import comma_list, see, SHOWN
from puretf._wire.encoding import Encoding
from puretf._wire.headers import Headers
from puretf._wire.message_reader import MessageReader
from puretf.transform_buffer import TransformBuffer

__all__ = ['NOT_RECORDED', 'Bag', 'BagError', 'BagMessage', 'Headers', 'Paths', 'Topic', 'is_bag',
           'open', 'read', 'recordings']

#: Messages are inserted in groups. A group ends when its messages take more memory than this
#: (bytes), or after this time (s), since other threads may see the buffer while it is filled.
_BATCH_BYTES, _BATCH_TIME = 500_000, 0.1
#: The memory that a message takes in addition to its data (bytes).
_OVERHEAD = 100
#: A std_msgs/Header with a frame_id of usual length takes no more than this (bytes).
_HEADER = 2000
_log = logging.getLogger('puretf')


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
        from puretf._bag.files import decoded
        return decoded(self.data, self.topic.msgtype, self.topic.encoding)


class Bag(AbstractContextManager['Bag']):
    """
    A recording, opened once; a context manager.

    `topics`, `begin` and `end` are those of the files that have been read; if none has been, they
    are looked up.
    """

    def __init__(self, paths: Paths, *, partial: bool = False, namespace: str = '',
                 max_bytes: int = 2**30,
                 on_progress: Optional[Callable[[float], object]] = None) -> None:
        """
        Open a bag.

        :param paths: a directory, a .mcap or a .db3 file of rosbag2, or a .bag file of ROS 1; or
            several paths, or a pattern like `name_*.mcap`, if these are the parts of one
            recording.
        :param partial: if a file is missing, cut off or damaged, read what can be read and log a
            warning, instead of raising a BagError. Of a .mcap file, only damaged chunks are left
            out; of other files, all from the damage on, which may be all.
        :param namespace: the namespace of the topics `tf` and `tf_static`; '': none.
        :param max_bytes: the largest size (bytes) that is allowed for a message, and for a record
            (such as a chunk) and the summary of a .mcap file.
        :param on_progress: called repeatedly with the fraction of the bag that has been read, from
            0 to 1. What it raises ends the reading.
        :raises BagError: if the path is not a bag, if there are several recordings, or if a
            library that is needed to read it is not installed. While it is read: if the bag is
            cut off or damaged, or has something that is larger than max_bytes, unless `partial` is
            True.
        :raises OSError: if the path does not exist.
        """
        found = find_recordings(paths)
        if len(found) != 1:
            names = comma_list([str(each.path) for each in found])
            raise BagError(f'these are {len(found)} recordings ({names}): give the files of one'
                           if found else 'no path of a bag is given')
        found[0].path.stat()  # a missing path is reported before a missing library
        try:
            import puretf._bag.files  # noqa: F401
            recording = self._recording = resolved(found[0])
        except ImportError as error:
            raise BagError(f'a library that reads bags cannot be imported ({error}): '
                           'pip install rosbags mcap') from None
        if recording.warning:
            _log.warning(recording.warning)
        self.path = recording.path  #: the directory, or the first file that was given
        self.files = recording.files  #: the parts of the recording, in order
        #: A sentence that names the first part, if only later parts are given; else ''.
        self.missing_part = recording.missing_part
        self.namespace = namespace  #: the namespace of the topics `tf` and `tf_static`
        self._about = self.path, namespace, partial, max_bytes
        self._on_progress = on_progress or (lambda done: None)
        self._copies: dict[Path, TemporaryDirectory[str]] = {}
        self._contents = Contents(*self._about)

    def __exit__(self, *_: object) -> None:
        """Close the bag."""
        self.close()

    def close(self) -> None:
        """Remove the decompressed copies of compressed files."""
        while self._copies:
            self._copies.popitem()[1].cleanup()

    @property
    def topics(self) -> list[Topic]:
        """The topics, each once for each type that it has."""
        return [*self._known().topics.values()]

    @property
    def begin(self) -> int:
        """The time at which the first message was recorded (ns); 0: it is not known."""
        return self._known().begin

    @property
    def end(self) -> int:
        """The time at which the last message was recorded (ns); 0: it is not known."""
        return self._known().end

    @property
    def missing_spans(self) -> list[tuple[int, int]]:
        """Within which times of the recording (ns) a part of it is missing or damaged."""
        return self._contents.missing_spans

    @property
    def is_whole(self) -> bool:
        """False if a part of the recording is missing, or damage was met while it was read."""
        return not (self.missing_part or self._recording.warning or self._contents.damage)

    def _known(self) -> Contents:
        if not self._contents.topics:
            self._contents = Contents(*self._about)
            deque(self._records(self._contents), 0)
        return self._contents

    def messages(self, *, tf: bool = True, headers: bool = False,
                 others: Collection[Other] = (), start: Any = 0, stop: Any = 2**63
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
        contents = self._contents = Contents(*self._about, tf, headers, others)
        for record in self._records(contents, nanoseconds_or_int(start, 'start'),
                                    nanoseconds_or_int(stop, 'stop')):
            yield BagMessage(*record)
        self._finish(contents, tf, headers)

    def read(self, *, cache_time: Any = None, max_samples: Optional[int] = None,
             headers: bool = False, others: Collection[Other] = (),
             on_message: Optional[Callable[[BagMessage], object]] = None,
             buffer: Optional[TransformBuffer] = None) -> TransformBuffer:
        """
        Read the transforms into a buffer; `headers` and `others` are those of `messages`.

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
        buffer = buffer or TransformBuffer(cache_time, max_samples=max_samples)
        engine = engine_of(buffer)
        faults: Counter[str] = Counter()  # by their kinds, which precede the colon
        readers: dict[Topic, MessageReader] = {}
        contents = self._contents = Contents(*self._about, True, headers, others)
        for groups in _grouped_by_topic(self._records(contents), on_message,
                                        engine.tree.cache_time < 2**63):
            for topic, messages in groups.items():
                reader = readers.setdefault(topic, MessageReader(
                    lambda error: faults.update([str(error).partition(':')[0]]), topic.encoding))
                engine.insert_batches(
                    reader.read(messages, topic.publisher, bool(topic.is_static)))
        for fault, times in faults.items():
            _log.warning('%s: skipped %d of %d TF messages, which cannot be decoded: %s',
                         self.path, times, contents.tf_count, fault)
        self._finish(contents)
        contents.damage += faults  # so that it is not whole
        frames = buffer.frames()
        if not frames:
            raise BagError(f'{self.path} has no valid transform in its TF messages '
                           f'({contents.tf_count})')
        if self.missing_part and not any(frame.is_static for frame in frames):
            engine.tree.missing_part = self.missing_part
        return buffer

    def _records(self, contents: Contents, start: int = 0, stop: int = 2**63) -> Iterator[Record]:
        """Yield the messages; what cannot be read is an error, with a remedy if one helps."""
        try:
            yield from self._found(contents, start, stop)
        except BagError as error:
            path, namespace, partial, limit = self._about
            if partial or not contents.damage:
                raise
            rest = Contents(path, namespace, True, limit, True, others=contents.others)
            has_rest = next(self._found(rest), None) is not None
            remedy = ' partial=True reads what is left.' if has_rest else ''
            raise BagError(f'{error}{remedy}{see("damaged_bag")}') from None

    def _found(self, contents: Contents, start: int = 0, stop: int = 2**63) -> Iterator[Record]:
        from puretf._bag.files import records
        from puretf._bag.unpacking import too_large, unpacked
        limit, last = contents.max_bytes, 0
        for number, path in enumerate(self.files):
            contents.has_lost |= path in self._recording.after_missing
            self._on_progress(number / len(self.files))
            for item in records(path, contents, self._copies):
                if isinstance(item, float):
                    self._on_progress((number + item) / len(self.files))
                    continue
                topic, time, data = item
                if contents.has_lost and 0 < last < time:
                    contents.missing_spans.append((last, time))
                contents.has_lost, last = False, time
                is_inside = topic.is_wanted and (start <= time < stop or topic.is_static)
                whole = unpacked(data, limit + 1) if is_inside else b''
                if len(whole) > limit:
                    contents.add_damage(too_large(
                        f'a message of {len(data)} bytes', f'more than {limit}', limit))
                elif topic.is_wanted:
                    contents.tf_count += topic.is_static is not None
                    if is_inside:
                        yield topic, time, whole
                elif topic.headers.wants_next():
                    topic.headers.add(time, unpacked(data, _HEADER))
        self._on_progress(1.0)

    def _finish(self, contents: Contents, tf: bool = True, accepts_wrong_types: bool = False
                ) -> None:
        """Report that the bag has been read; log its damage."""
        count = contents.tf_count
        damage, wrong_types = ' '.join(contents.damage[:SHOWN]), contents.wrong_types()
        if tf and not count and not (wrong_types and accepts_wrong_types):
            if damage:
                raise BagError(f'no TF message can be read: {damage}{see("damaged_bag")}')
            part = f'. {self.missing_part}' if self.missing_part else ''
            raise BagError(f'{self.path} has no TF: {contents.why_no_tf()}{part}')
        if tf and wrong_types and not accepts_wrong_types:
            _log.warning('%s: %s', self.path, wrong_types)
        if damage:
            _log.warning(damage + (f' Read {count} TF messages' if tf else ''))


open = Bag  # noqa: A001


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


def _grouped_by_topic(records: Iterable[Record],
                      on_message: Optional[Callable[[BagMessage], object]], in_order: bool
                      ) -> Iterator[dict[Topic, list[bytes]]]:
    """
    Yield groups: the TF messages of each topic.

    Static messages keep their order relative to those of other topics; if `in_order` is True,
    dynamic messages do, too.
    """
    groups: dict[Topic, list[bytes]] = {}
    last: Optional[Topic] = None
    size, end = 0, monotonic() + _BATCH_TIME
    for record in records:
        if on_message:
            on_message(BagMessage(*record))
        topic, _, data = record
        if topic.is_static is None:
            continue
        if size > _BATCH_BYTES or monotonic() > end or (
                last and topic is not last and (in_order or topic.is_static)):
            yield groups
            groups, size, end = {}, 0, monotonic() + _BATCH_TIME
        groups.setdefault(topic, []).append(data)
        last = topic
        size += len(data) + _OVERHEAD
    yield groups
