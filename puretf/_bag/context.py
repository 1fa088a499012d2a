"""The context in which a bag is read: its topics and damage, limits, progress."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
import re
from typing import NamedTuple, Optional, Union

from puretf._bag.formats import BagError
from puretf._bag.recordings import Recording
from puretf._core import texts
from puretf._wire import cdr, ros1
from puretf._wire.definitions import begins_with_header
from puretf._wire.headers import Headers
from puretf._wire.message_reader import Encoding

#: The publisher of a stream if the bag does not record it; rosbag2 never does.
NOT_RECORDED = 'not recorded'
TF_TYPES = texts.TF_MESSAGE, 'tf/msg/tfMessage'
#: Progress is reported once for this many messages.
ADVANCE = 100
#: The largest number of faults that a text lists.
_SHOWN = 10
#: The largest number of topics that are remembered.
_MAX_TOPICS = 10_000
_REMEDIES = {
    '.mcap': 'If it is damaged or cut off, partial=True (--partial) reads what is left',
    '.db3': 'If it is damaged, the command .recover of the program sqlite3 may help',
    '.bag': 'If it is damaged or cut off, rosbag reindex of ROS 1 may help'}


class Stream(NamedTuple):
    """The common properties of the messages of a topic or, in ROS 1, of one of its publishers."""

    is_static: bool
    publisher: str
    encoding: Encoding


@dataclass
class BagTopic:
    """A topic of a bag."""

    name: str
    msgtype: str
    encoding: Encoding
    headers: Headers
    #: How many publishers have which recorded durability; of ROS 1 and of other topics: none.
    durabilities: Counter[str] = field(default_factory=Counter)
    #: Whether its messages begin with a header; None: it is not known.
    has_header: Optional[bool] = False


#: A TF message of a bag: its stream, the time at which it was recorded (ns), and its bytes.
Record = tuple[Stream, int, bytes]


class BagContext:
    """The topics and the damage of a recording, and the progress of reading it."""

    def __init__(self, recording: Recording, namespace: str, partial: bool, max_bytes: int,
                 on_progress: Callable[[float], object], with_headers: bool = False,
                 other: tuple[str, str] = ('', '')) -> None:
        self._path = recording.path
        self._with_headers, self._other = with_headers, other
        self._namespace = texts.namespace_path(namespace)
        self._is_static = {f'{self._namespace}/tf': False, f'{self._namespace}/tf_static': True}
        self.topics: dict[tuple[str, str], BagTopic] = {}  #: by name and type
        self._on_progress = on_progress
        self._start, self._share, self._done = 0.0, 1.0, 0.0
        #: What on_progress has raised; not to be taken for damage of the bag.
        self._raised: Optional[BaseException] = None
        self.partial = partial
        self.max_bytes = max_bytes
        #: Descriptions of the first `_SHOWN` faults in the files of the bag.
        self.damage: list[str] = []

    def add_topic(self, name: str, msgtype: str, definition: str, encoding: str,
                  durabilities: Sequence[str] = (), publisher: str = ''
                  ) -> Union[Stream, BagTopic, None]:
        """Remember a topic; return its stream, or the topic if its headers are to be read."""
        name = f'/{name.strip("/")}'
        msgtype = re.sub('^([^/]+)/([^/]+)$', r'\1/msg/\2', msgtype)  # as in ROS 2
        if encoding not in ('cdr', 'ros1', ''):
            msgtype = f'{msgtype} in {encoding}'  # which is not a known type
        if self._other[0]:  # in place of TF, messages of this type on topics of this name are read
            is_wanted = self._other == (msgtype, name.rpartition('/')[2])
            return Stream(False, name, ros1 if encoding == 'ros1' else cdr) if is_wanted else None
        is_static = self._is_static.get(name)
        topic = self.topics.get((name, msgtype))
        if topic is None:
            module = ros1 if encoding == 'ros1' else cdr
            topic = BagTopic(name, msgtype, module, Headers(module))
            if len(self.topics) < _MAX_TOPICS or is_static is not None:
                self.topics[name, msgtype] = topic
            if self._with_headers and is_static is None and msgtype not in TF_TYPES:
                topic.has_header = begins_with_header(msgtype, definition)
        if is_static is None or msgtype not in TF_TYPES:
            return topic if topic.has_header else None
        topic.durabilities |= Counter(durabilities)  # the largest numbers of all files
        return Stream(is_static, publisher or NOT_RECORDED, topic.encoding)

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
