"""The context in which a bag is read: topics, damage, limits, progress."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
import re
import struct
from typing import NamedTuple, Optional, Union

from dummy_arm.tf._bag.formats import BagError
from dummy_arm.tf._core.texts import (
    abbreviated,
    comma_list,
    in_log,
    namespace_path,
    TF_MESSAGE,
    visible,
)
from dummy_arm.tf._wire.message_reader import Encoding

#: The publisher of a stream if the bag does not record it; rosbag2 never does.
NOT_RECORDED = 'not recorded'
_TYPES = TF_MESSAGE, 'tf/msg/tfMessage'
#: The largest number of topics, of namespaces or of faults that a text lists.
_SHOWN = 10
#: The largest number of topics that are remembered for the text of an error.
_MAX_TOPICS = 10_000
#: An error text that is longer than this (characters) is abbreviated.
_LONGEST_ERROR = 500
#: An annotation in an .idl file, which may have texts in parentheses.
_ANNOTATION = re.compile(r'@\w+\s*(\((?:[^()"]|"(?:\\.|[^"\\])*")*\))?')
#: The beginning of a constant in a .msg file.
_CONSTANT = re.compile(r'\S+\s+\w+\s*=')
#: The number of messages of a topic other than TF whose headers are read.
HEADERS = 10


class Stream(NamedTuple):
    """What all messages of a topic of rosbag2, or of a publisher on a topic of ROS 1, share."""

    is_static: bool
    publisher: str
    encoding: Encoding

    @property
    def is_wanted(self) -> bool:
        return True


class HeaderStream:
    """The first messages of a topic that is not TF, and whose messages begin with a header."""

    def __init__(self, topic: str, msgtype: str, encoding: Encoding) -> None:
        self.topic, self.msgtype, self._encoding = topic, msgtype, encoding
        self._count = 0
        self.frames: set[str] = set()

    @property
    def is_wanted(self) -> bool:
        return self._count < HEADERS

    def add(self, data: bytes) -> None:
        if self.is_wanted:
            self._count += 1
            with suppress(struct.error):  # a damaged message
                self.frames.add(self._encoding.header_frame(data))


#: A message of a bag: its stream, the time at which it was recorded (ns), and its bytes.
Record = tuple[Union[Stream, HeaderStream], int, bytes]


class BagContext:
    """The topics and the damage of a bag, and the progress of reading the bag."""

    def __init__(self, path: Path, namespace: str, partial: bool, max_bytes: int,
                 on_progress: Callable[[float], object], with_headers: bool = False) -> None:
        self._path = path
        self.with_headers = with_headers
        #: By the name of the topic: topics whose messages begin with a header; the types of other
        #: topics with TF messages, of `tf` and `tf_static` if they have none, and unknown types.
        self.header_streams: dict[str, HeaderStream] = {}
        self.other_tf: dict[str, str] = {}
        self.wrong_types: dict[str, str] = {}
        self.unknown_types: dict[str, str] = {}
        self._namespace = namespace_path(namespace)
        self._is_static = {f'{self._namespace}/tf': False, f'{self._namespace}/tf_static': True}
        self._types: dict[str, str] = {}
        self._on_progress = on_progress
        self._start, self._share, self._done = 0.0, 1.0, 0.0
        #: What on_progress has raised; not to be taken for damage of the bag.
        self._raised: Optional[BaseException] = None
        self.partial = partial
        self.max_bytes = max_bytes
        #: Descriptions of the first `_SHOWN` faults in the files of the bag.
        self.damage: list[str] = []

    def stream(self, topic: str, msgtype: str, publisher: str, encoding: Encoding,
               definition: str = '') -> Optional[Union[Stream, HeaderStream]]:
        """Return the stream of a topic, and remember the topic."""
        topic = f'/{topic.strip("/")}'
        is_static = self._is_static.get(topic)
        if len(self._types) < _MAX_TOPICS or is_static is not None:
            self._types[topic] = msgtype
        if msgtype in _TYPES:
            if is_static is not None:
                return Stream(is_static, publisher, encoding)
            self.other_tf[topic] = msgtype
            return None
        if is_static is not None:
            self.wrong_types[topic] = msgtype
            return None
        if not self.with_headers or len(self.header_streams) >= _MAX_TOPICS:
            return None
        has_header = _begins_with_header(msgtype, definition)
        if has_header is None:
            self.unknown_types[topic] = msgtype
        return self.header_streams.setdefault(
            topic, HeaderStream(topic, msgtype, encoding)) if has_header else None

    def start_file(self, number: int, count: int) -> None:
        self._start, self._share = number / count, 1 / count
        self.advance(0.0)

    def advance(self, part: float) -> None:
        """Report which fraction of the current file has been read."""
        self._done = self._start + part * self._share
        self.tick()

    def finish(self) -> None:
        self._done = 1.0
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

    def handle_error(self, path: Path, error: Exception) -> None:
        """Append an error to `damage` if `partial` is True; else, raise a BagError."""
        self.tick()  # if on_progress has raised an exception, this raises it again
        if isinstance(error, ImportError):
            raise error
        if not self.partial:
            if isinstance(error, BagError):  # the text of a BagError already names the file
                raise error
            name = '' if path == self._path else f'{visible(path.name)}: '
            raise BagError(
                f'{self._path} cannot be read: {name}{error_line(error)} If it is damaged or cut '
                'off, partial=True (--partial) reads what is left') from None
        if len(self.damage) < _SHOWN:
            self.damage.append(f'{visible(str(path))}: {error_line(error)}')

    def why_no_tf(self) -> str:
        expected = ' or '.join(self._is_static)
        namespaces = {topic.rpartition('/')[0] for topic, msgtype in self._types.items()
                      if msgtype in _TYPES and re.search('/tf(_static)?$', topic)}
        others = sorted(namespaces - {self._namespace})
        if others == ['']:
            return (f'no TFMessage on {expected}, but on topics without a namespace: omit the '
                    'namespace')
        if others:
            return (f'no TFMessage on {expected}, but in the namespace '
                    f'{comma_list([in_log(name) or "/" for name in others], _SHOWN)}: pass it as '
                    'namespace (--namespace)')
        if self.wrong_types:
            return self.wrong_types_text()
        topics = sorted(f'{in_log(topic)} ({in_log(msgtype)})'
                        for topic, msgtype in self._types.items())
        return (f'no {TF_MESSAGE} on {expected}; its topics: '
                f'{comma_list(topics, _SHOWN) or "none"}')

    def wrong_types_text(self) -> str:
        types = ' and '.join(f'{in_log(topic)} has the type {in_log(msgtype)}'
                             for topic, msgtype in sorted(self.wrong_types.items()))
        return (f'{types}, not {TF_MESSAGE}: send transforms with a TransformBroadcaster or a '
                'StaticTransformBroadcaster')


def _begins_with_header(msgtype: str, definition: str) -> Optional[bool]:
    """Return whether messages begin with a header; None: neither the bag nor rosbags knows."""
    if not definition:
        try:
            from rosbags.typesys import get_typestore, Stores
            fields = get_typestore(Stores.LATEST).fielddefs[msgtype][1]
        except (ImportError, KeyError):
            return None
        return bool(fields) and fields[0][1][1] == 'std_msgs/msg/Header'
    idl = _ANNOTATION.sub('', definition)
    if match := re.search(
            rf'\bstruct\s+{re.escape(msgtype.rpartition("/")[2])}\s*{{\s*([\w:]+)', idl):
        return match[1] == 'std_msgs::msg::Header'
    if re.search(r'\bmodule\s+\w+\s*{', idl):
        return None
    for line in definition.splitlines():
        line = line.partition('#')[0].strip()
        if line.startswith('==='):  # the definitions of other types follow
            return False
        if line and not _CONSTANT.match(line):  # a constant is not sent
            return line.split()[0] in ('std_msgs/Header', 'std_msgs/msg/Header', 'Header',
                                       'roslib/Header')
    return False


def error_line(error: Exception) -> str:
    r"""
    Return the text of an error in one line that ends with one period.

    >>> error_line(ValueError('a record\n  ends too early'))
    'a record ends too early.'
    >>> error_line(ValueError('no topic \x1b[2J.'))
    'no topic \\x1b[2J.'
    >>> error_line(KeyError())
    'KeyError.'
    """
    text = visible(' '.join(str(error).split())) or type(error).__name__
    return f'{abbreviated(text, _LONGEST_ERROR).rstrip(".")}.'
