"""The messages of TF in a bag, as they were recorded, by rosbags."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
import re
from typing import Any, NamedTuple, Optional

from dummy_arm.tf import wire, wire_ros1
from dummy_arm.tf.message_reader import Form

#: In place of the sender, which only bags of ROS 1 have.
NOT_RECORDED = 'not recorded'
_TYPES = 'tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'
_KINDS = {b'\x89MCAP0\r\n': '.mcap', b'SQLite format 3\0': '.db3', b'#ROSBAG V': '.bag'}
_ZSTD = b'\x28\xb5\x2f\xfd'
_WHAT = ('a bag is the directory that ros2 bag record makes, a file .mcap or .db3 in it, or a '
         '.bag of ROS 1')
_SHOWN = 10


class BagError(Exception):
    """A bag cannot be read, or has no TF; the text says why, and what to do."""


class Stream(NamedTuple):
    """Where messages come from, and how they are written."""

    is_static: bool
    sender: str
    form: Form


class Content:
    """What a bag has of TF, as far as it was read."""

    def __init__(self, namespace: str) -> None:
        """
        Begin to read.

        :param namespace: of the topics.
        """
        self._namespace = ''.join(f'/{part}' for part in namespace.split('/') if part)
        self._is_static = {f'{self._namespace}/tf': False, f'{self._namespace}/tf_static': True}
        self._types: dict[str, str] = {}
        #: How many messages of TF there are, where that can be told beforehand.
        self.total: Optional[int] = None
        #: What is wrong with its files.
        self.damage: list[str] = []

    def stream(self, topic: str, msgtype: str, sender: str, form: Form) -> Optional[Stream]:
        """Tell what the messages of a topic are; None: not TF of this namespace."""
        topic = f'/{topic.strip("/")}'
        self._types[topic] = msgtype
        is_static = self._is_static.get(topic)
        return None if is_static is None or msgtype not in _TYPES else Stream(
            is_static, sender, form)

    def why_none(self) -> str:
        """Tell what there is instead of TF."""
        asked = ' or '.join(self._is_static)
        namespaces = {topic.rpartition('/')[0] for topic, msgtype in self._types.items()
                      if msgtype in _TYPES and re.search('/tf(_static)?$', topic)}
        if others := sorted(namespaces - {self._namespace}):
            return (f'no messages on {asked}, but in the namespace '
                    f'{", ".join(name or "/" for name in others)}: give it as namespace')
        topics = sorted(f'{topic} ({msgtype})' for topic, msgtype in self._types.items())
        more = f' and {len(topics) - _SHOWN} more' if len(topics) > _SHOWN else ''
        return (f'no messages on {asked}; its topics: '
                f'{", ".join(topics[:_SHOWN]) or "none"}{more}')


def records(path: Path, content: Content) -> Iterator[tuple[Stream, bytes]]:
    """
    Read the messages of TF, in the order in which they were recorded.

    :param content: learns what there is.
    :raises BagError: when it is no bag, or is damaged.
    :raises OSError: when it is not there, or may not be read.
    """
    kind = kind_of(path)
    form: Form = wire_ros1 if kind == '.bag' else wire
    reader = _reader(path, kind)
    try:
        reader.open()
        with closing(reader):
            streams: dict[int, Stream] = {}
            chosen = []
            for connection in reader.connections:
                sender = getattr(connection.ext, 'callerid', None) or NOT_RECORDED
                if stream := content.stream(connection.topic, connection.msgtype, sender, form):
                    streams[connection.id] = stream
                    chosen.append(connection)
            content.total = sum(connection.msgcount for connection in chosen)
            # Asked for none, rosbags would give the messages of all.
            for connection, _, data in reader.messages(chosen) if chosen else ():
                yield streams[connection.id], decompressed(data)
    except Exception as error:  # of rosbags: a damaged file is met by errors of many types
        raise BagError(f'{path} cannot be read: {described(error)} If it is damaged or cut off, '
                       'partial (--partial) reads what is there') from None


def kind_of(path: Path) -> str:
    """
    Tell what a bag is: 'dir', '.mcap', '.db3' or '.bag'; by its first bytes.

    :raises BagError: when it is none of these.
    :raises OSError: when it is not there, or not readable.
    """
    if path.is_dir():
        return 'dir'
    with path.open('rb') as file:
        beginning = file.read(16)
    for magic, kind in _KINDS.items():
        if beginning.startswith(magic):
            return kind
    if beginning.startswith(_ZSTD):
        raise BagError(f'{path} is compressed as a file: give the directory that it lies in')
    raise BagError(f'{path} is no bag: ' + (_WHAT if beginning else 'it is empty'))


def storage_files(directory: Path) -> list[Path]:
    """
    List the files with messages in the directory of a bag, in the order of their numbers.

    :raises BagError: when there is none.
    """
    files = [path for path in directory.iterdir() if {'.mcap', '.db3'} & {*path.suffixes[-2:]}]
    if not files:
        raise BagError(f'{directory} is no bag: {_WHAT}')
    return sorted(files, key=lambda path: [
        part.zfill(20) if part.isdigit() else part for part in re.split(r'(\d+)', path.name)])


def _reader(path: Path, kind: str) -> Any:
    """Choose a reader of rosbags; the one that it has for any bag goes by the file's name."""
    if kind == 'dir' and not (path / 'metadata.yaml').exists() and storage_files(path):
        raise BagError(f'{path} has no metadata.yaml, which is written when a recording ends: '
                       'mend it by ros2 bag reindex, or read it as partial (--partial)')
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError as error:
        raise BagError(f'rosbags, which reads bags, cannot be imported ({error}): '
                       'pip install rosbags') from None
    return Reader1(path) if kind == '.bag' else Reader2.STORAGE_PLUGINS[kind](path)


def decompressed(data: bytes) -> bytes:
    """Decompress a message, if it was compressed by itself, which is told beside the file."""
    if data[:4] != _ZSTD:
        return data
    return bytes(zstd().decompress(data))


def zstd() -> Any:
    """Find the module that rosbags uses."""
    try:
        from compression import zstd  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        from backports import zstd
    return zstd


def described(error: Exception) -> str:
    """Write an error in one line."""
    text = ' '.join(str(error).split()) or type(error).__name__
    return f'{text.rstrip(".")}.'
