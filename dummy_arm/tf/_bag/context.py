"""What a bag is, and what it has of TF, as reading it shows."""

from collections.abc import Callable
from pathlib import Path
import re
from typing import NamedTuple, Optional

from dummy_arm.tf._bag.decompression import ZSTD
from dummy_arm.tf._core.texts import abbreviated, comma_list, logged, visible
from dummy_arm.tf._wire.streams import Encoding

#: In place of the publisher, which only bags of ROS 1 have.
NOT_RECORDED = 'not recorded'
_TYPES = 'tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'
_SHOWN = 10
#: So many topics are kept, to be named.
_MOST_TOPICS = 10_000
#: The longest description of an error (characters).
_LONGEST = 500

_KINDS = {b'\x89MCAP0\r\n': '.mcap', b'SQLite format 3\0': '.db3', b'#ROSBAG V': '.bag'}
#: What a bag is, for the texts of errors.
WHAT = ('a bag is the directory that ros2 bag record makes, a file .mcap or .db3 in it, or a '
        '.bag of ROS 1')


class BagError(Exception):
    """A bag cannot be read, or has no TF; the text says why, and what to do."""


def kind_of(path: Path) -> str:
    """
    Return what a bag is: 'dir', '.mcap', '.db3' or '.bag'; by its first bytes.

    :raises BagError: if it is none of these.
    :raises OSError: if it does not exist, or may not be read.
    """
    if path.is_dir():
        return 'dir'
    refuse_special(path)
    with path.open('rb') as file:
        beginning = file.read(16)
    for magic, kind in _KINDS.items():
        if beginning.startswith(magic):
            return kind
    if beginning.startswith(ZSTD):
        raise BagError(f'{path} is compressed as a file: give the directory that it lies in')
    raise BagError(f'{path} is no bag: ' + (WHAT if beginning else 'it is empty'))


def refuse_special(path: Path) -> None:
    """
    Refuse a pipe or a device, which might never end.

    :raises BagError: if it is one.
    """
    if path.exists() and not path.is_file():
        raise BagError(f'{path} is no bag: it is no regular file')


class Stream(NamedTuple):
    """Where messages come from, and how they are written."""

    is_static: bool
    publisher: str
    encoding: Encoding


class BagContext:
    """The topics of a bag, what is wrong with it, and how far it has been read."""

    def __init__(self, path: Path, namespace: str, partial: bool, max_bytes: int,
                 on_progress: Callable[[float], object]) -> None:
        """
        Keep what is given.

        :param path: the bag.
        :param namespace: of the topics.
        :param partial: what is wrong is noted, not raised.
        :param max_bytes: the largest size of a chunk or a message, decompressed (bytes).
        :param on_progress: as `dummy_arm.tf.bag.read` has it.
        """
        self._path = path
        self._namespace = ''.join(f'/{part}' for part in namespace.split('/') if part)
        self._is_static = {f'{self._namespace}/tf': False, f'{self._namespace}/tf_static': True}
        self._types: dict[str, str] = {}
        self._on_progress = on_progress
        self._before, self._share, self._done = 0.0, 1.0, 0.0
        #: What on_progress has raised; no handler of errors may take it for damage.
        self._stopped: Optional[BaseException] = None
        self.partial = partial
        self.max_bytes = max_bytes
        #: What is wrong with its files; of many things, the first.
        self.damage: list[str] = []

    def stream(self, topic: str, msgtype: str, publisher: str, encoding: Encoding
               ) -> Optional[Stream]:
        """Tell what the messages of a topic are; None: not TF of this namespace."""
        topic = f'/{topic.strip("/")}'
        is_static = self._is_static.get(topic)
        if len(self._types) < _MOST_TOPICS or is_static is not None:
            self._types[topic] = msgtype
        return None if is_static is None or msgtype not in _TYPES else Stream(
            is_static, publisher, encoding)

    def start_file(self, number: int, count: int) -> None:
        """
        Go on to one of the files.

        :param number: from 0 on.
        :param count: how many there are.
        """
        self._before, self._share = number / count, 1 / count
        self.advance(0.0)

    def advance(self, part: float) -> None:
        """
        Report how far the bag has been read.

        :param part: of the file, from 0 to 1.
        """
        self._done = self._before + part * self._share
        self.tick()

    def finish(self) -> None:
        """Report that the bag has been read."""
        self._done = 1.0
        self.tick()

    def tick(self) -> None:
        """Call on_progress; raise what it raises, and then again each time."""
        if self._stopped is None:
            try:
                self._on_progress(self._done)
                return
            except BaseException as error:
                self._stopped = error
        raise self._stopped

    def handle_error(self, path: Path, error: Exception) -> None:
        """
        Note what is wrong with a file.

        :raises BagError: unless the bag is read as partial.
        :raises ImportError: if that is the error: it is not the file's.
        """
        self.tick()  # the error may be what the callback has raised before
        if isinstance(error, ImportError):
            raise error
        if not self.partial:
            if isinstance(error, BagError):  # about a file of the bag
                raise error
            name = '' if path == self._path else f'{visible(path.name)}: '
            raise BagError(
                f'{self._path} cannot be read: {name}{described(error)} If it is damaged or cut '
                'off, partial (--partial) reads what is there') from None
        if len(self.damage) < _SHOWN:
            self.damage.append(f'{visible(str(path))}: {described(error)}')

    def why_no_tf(self) -> str:
        """Tell what there is instead of TF."""
        asked = ' or '.join(self._is_static)
        namespaces = {topic.rpartition('/')[0] for topic, msgtype in self._types.items()
                      if msgtype in _TYPES and re.search('/tf(_static)?$', topic)}
        others = sorted(namespaces - {self._namespace})
        if others == ['']:
            return f'no TFMessage on {asked}, but without a namespace: leave it out'
        if others:
            return (f'no TFMessage on {asked}, but in the namespace '
                    f'{comma_list([logged(name) or "/" for name in others], _SHOWN)}: give it '
                    '(--namespace)')
        topics = sorted(f'{logged(topic)} ({logged(msgtype)})'
                        for topic, msgtype in self._types.items())
        return (f'no tf2_msgs/msg/TFMessage on {asked}; its topics: '
                f'{comma_list(topics, _SHOWN) or "none"}')


def described(error: Exception) -> str:
    """Write an error in one line."""
    text = visible(' '.join(str(error).split())) or type(error).__name__
    return f'{abbreviated(text, _LONGEST).rstrip(".")}.'
