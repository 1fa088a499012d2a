"""The context in which a bag is read: its topics and damage, limits, progress."""

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
import re
from typing import Optional, Union

from puretf._bag.formats import BagError
from puretf._bag.recordings import Recording
from puretf._bag.unpacking import first_bytes, unpack_message
from puretf._core import texts
from puretf._wire import cdr, ros1
from puretf._wire.definitions import begins_with_header
from puretf._wire.headers import Headers
from puretf._wire.message_reader import Encoding

#: The publisher of a stream if the bag does not record it; rosbag2 never does.
NOT_RECORDED = 'not recorded'
#: Topics whose messages are read: the type and the last part of the name, or the whole name.
Other = Union[tuple[str, str], str]
TF_TYPES = texts.TF_MESSAGE, 'tf/msg/tfMessage'
#: Progress is reported once for this many messages.
ADVANCE = 100
#: The largest number of faults that a text lists.
_SHOWN = 10
#: The largest number of topics that are remembered.
_MAX_TOPICS = 10_000
_REMEDIES = {
    '.mcap': 'If it is damaged or cut off, partial=True reads what is left',
    '.db3': 'If it is damaged, the command .recover of the program sqlite3 may help',
    '.bag': 'If it is damaged or cut off, rosbag reindex of ROS 1 may help'}


@dataclass(eq=False)
class Topic:
    """A topic of a bag; in ROS 1, what one node has published on it."""

    name: str
    msgtype: str  #: the type of its messages, such as 'sensor_msgs/msg/LaserScan'
    encoding: Encoding
    publisher: str  #: the name of the node that published it; 'not recorded' in rosbag2
    is_static: Optional[bool]  #: whether it is /tf_static of the namespace; None: it is neither
    #: Whether its messages begin with a header; None: it is not known. False if neither headers
    #: nor messages of this name are read.
    has_header: Optional[bool]
    headers: Headers  #: of all messages, or of evenly spaced ones, at most 20 000
    is_wanted: bool  #: True if its messages are read
    #: How many publishers have which recorded durability, such as 'TRANSIENT_LOCAL'.
    durabilities: Counter[str] = field(default_factory=Counter)
    count: int = 0  #: the number of its messages, as far as the index of the bag says

    @property
    def is_tf(self) -> bool:
        """True if its messages are TF messages."""
        return self.msgtype in TF_TYPES

    @property
    def is_read(self) -> bool:
        """True if its messages, or their headers, are read."""
        return self.is_wanted or bool(self.has_header)

    def expect(self, count: int) -> None:
        """Count messages of the topic that are in a file."""
        self.count += count
        self.headers.expect(count)


#: A message of a bag: its topic, the time at which it was recorded (ns), and its bytes.
Record = tuple[Topic, int, bytes]


class BagContext:
    """The topics and the damage of a recording, what is read of it, and the progress."""

    def __init__(self, recording: Recording, namespace: str, partial: bool, max_bytes: int,
                 on_progress: Callable[[float], object]) -> None:
        self.recording, self._path = recording, recording.path
        self._namespace = texts.namespace_path(namespace)
        self._is_static = {f'{self._namespace}/tf': False, f'{self._namespace}/tf_static': True}
        self._on_progress = on_progress
        self._start, self._share, self._done = 0.0, 1.0, 0.0
        #: What on_progress has raised; not to be taken for damage of the bag.
        self._raised: Optional[BaseException] = None
        self.partial = partial
        self.max_bytes = max_bytes
        #: The decompressed copies of files.
        self.copies: dict[Path, Path] = {}
        self.select(False, False, (), -1, -1)

    def select(self, tf: bool, headers: bool, others: Collection[Other], start: int, stop: int
               ) -> None:
        """
        Begin to read anew.

        :param tf: whether TF messages are read.
        :param headers: whether the headers of other messages are read.
        :param others: other topics whose messages are read.
        :param start: messages before this time (ns) are left out, except static transforms.
        :param stop: so are messages from this time on.
        """
        self._tf, self._with_headers, self._others = tf, headers, others
        self._start_ns, self._stop_ns = start, stop
        self.topics: dict[tuple[str, str], Topic] = {}  #: by name and type
        self._of_node: dict[tuple[Topic, str], Topic] = {}
        #: When the first and the last message were recorded (ns); (0, 0): there is none.
        self.begin_ns, self.end_ns = 0, 0
        #: Descriptions of the first `_SHOWN` faults in the files of the bag.
        self.damage: list[str] = []

    def add_topic(self, name: str, msgtype: str, definition: str, encoding: str,
                  durabilities: Sequence[str] = (), publisher: str = NOT_RECORDED, count: int = 0
                  ) -> Topic:
        """Return a topic, and remember it; `count`: the number of its messages, if it is known."""
        name = f'/{name.strip("/")}'
        msgtype = re.sub('^([^/]+)/([^/]+)$', r'\1/msg/\2', msgtype)  # as in ROS 2
        if encoding not in ('cdr', 'ros1', ''):
            msgtype = f'{msgtype} in {encoding}'  # which is not a known type
        topic = self.topics.get((name, msgtype))
        if topic is None:
            module = ros1 if encoding == 'ros1' else cdr
            is_static = self._is_static.get(name)
            is_tf = is_static is not None and msgtype in TF_TYPES
            is_named = name in self._others
            is_wanted = (is_tf and self._tf) or is_named or (
                msgtype, name.rpartition('/')[2]) in self._others
            topic = Topic(
                name, msgtype, module, publisher, is_static if is_tf else None,
                (self._with_headers or is_named) and is_static is None
                and msgtype not in TF_TYPES and begins_with_header(msgtype, definition),
                Headers(module), is_wanted)
            if len(self.topics) < _MAX_TOPICS or is_static is not None:
                self.topics[name, msgtype] = topic
        topic.expect(count)
        if topic.is_static is not None:
            topic.durabilities |= Counter(durabilities)  # the largest numbers of all files
        if publisher == topic.publisher:
            return topic
        return self._of_node.setdefault((topic, publisher), replace(topic, publisher=publisher))

    def record(self, topic: Topic, time: int, data: bytes) -> Optional[Record]:
        """Return a message if it is wanted, else read its header."""
        if topic.is_wanted:
            if self._start_ns <= time < self._stop_ns or topic.is_static:
                return topic, time, unpack_message(data, self.max_bytes)
        elif topic.headers.wants_next():
            topic.headers.add(time, first_bytes(data))
        return None

    def add_span(self, begin: int, end: int) -> None:
        """Note when the first and the last message of a file were recorded (ns)."""
        self.begin_ns = min(self.begin_ns or begin, begin)
        self.end_ns = max(self.end_ns, end)

    def begin(self, start: float, share: float) -> None:
        """Begin a step, which is a share of the work, after another share."""
        self._start, self._share = start, share
        self.advance(0.0)

    def advance(self, part: float) -> None:
        """Report the fraction of the current step that is done."""
        self._done = self._start + part * self._share
        self.tick()

    def tick(self) -> None:
        """Call on_progress; once it has raised an exception, only raise the same exception."""
        if self._raised is None:
            try:
                self._on_progress(self._done)
                return
            except BaseException as error:
                self._raised = error
        raise self._raised

    def handle_error(self, path: Path, kind: str, error: Exception) -> None:
        """Append an error to `damage` if `partial` is True; else, raise a BagError."""
        if self._raised is not None:
            raise self._raised
        is_named = isinstance(error, BagError)  # its text already names the file
        if isinstance(error, ImportError) or (is_named and not self.partial):
            raise error
        text = texts.error_line(error)
        if not self.partial:
            name = '' if path == self._path else f'{texts.visible(path.name)}: '
            raise BagError(f'{self._path} cannot be read: {name}{text} '
                           f'{_REMEDIES.get(kind, "")}'.rstrip()) from None
        if len(self.damage) < _SHOWN:
            self.damage.append(text if is_named else f'{texts.visible(str(path))}: {text}')

    def wrong_types(self) -> str:
        """Name the topics of TF that have another type; return '' if there are none."""
        found = [(topic.name, topic.msgtype) for topic in self.topics.values()
                 if topic.name in self._is_static and topic.msgtype not in TF_TYPES]
        return texts.wrong_types(found) if found else ''

    def why_no_tf(self) -> str:
        namespaces = {topic.name.rpartition('/')[0] for topic in self.topics.values()
                      if topic.msgtype in TF_TYPES and re.search('/tf(_static)?$', topic.name)}
        if others := sorted(namespaces - {self._namespace}):
            return texts.no_tf_here([*self._is_static], others)
        return self.wrong_types() or texts.no_tf([*self._is_static], [
            (topic.name, topic.msgtype) for topic in self.topics.values()])
