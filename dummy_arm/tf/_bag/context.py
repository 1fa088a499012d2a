"""Kinds of bags, and the state while a bag is read: topics, damage, limits and progress."""

from collections.abc import Callable
from pathlib import Path
import re
from typing import NamedTuple, Optional

from dummy_arm.tf._bag.decompression import ZSTD
from dummy_arm.tf._core.texts import abbreviated, comma_list, logged, visible
from dummy_arm.tf._wire.streams import Encoding

#: The name of the publisher if the bag does not record it, as in all bags of rosbag2.
NOT_RECORDED = 'not recorded'
_TYPES = 'tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'
#: The number of topics, namespaces and damaged files that a text lists.
_SHOWN = 10
#: The number of topics that are remembered for the text of an error.
_MAX_TOPICS = 10_000
#: The longest description of an error (characters).
_LONGEST_ERROR = 500

_KINDS = {b'\x89MCAP0\r\n': '.mcap', b'SQLite format 3\0': '.db3', b'#ROSBAG V': '.bag'}
#: The definition of a bag in the texts of errors.
BAG_DEFINITION = ('a bag is a directory written by ros2 bag record, a .mcap or .db3 file in it, '
                  'or a .bag file of ROS 1')


class BagError(Exception):
    """A bag cannot be read or has no transforms; the text says why, and what to do."""


def kind_of(path: Path) -> str:
    """
    Return the kind of a bag, which for a file follows from its first bytes.

    :param path: the bag.
    :returns: 'dir', '.mcap', '.db3' or '.bag'.
    :raises BagError: if it is none of these.
    :raises OSError: if it does not exist or cannot be read.
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
        raise BagError(f'{path} is a compressed file: read the directory of its bag instead')
    raise BagError(f'{path} is not a bag: ' + (BAG_DEFINITION if beginning else 'it is empty'))


def refuse_special(path: Path) -> None:
    """
    Raise an error for a pipe or a device, which might never end.

    :param path: the file; it need not exist.
    :raises BagError: if it exists and is not a regular file.
    """
    if path.exists() and not path.is_file():
        raise BagError(f'{path} is not a bag: it is not a regular file')


class Stream(NamedTuple):
    """The common properties of the messages of a topic; in ROS 1, of one publisher on a topic."""

    is_static: bool
    publisher: str
    encoding: Encoding


class BagContext:
    """The topics and the damage of a bag, and the progress of reading it."""

    def __init__(self, path: Path, namespace: str, partial: bool, max_bytes: int,
                 on_progress: Callable[[float], object]) -> None:
        """
        Create the context of a bag of which nothing has been read yet.

        :param path: the bag.
        :param namespace: the namespace of the topics `tf` and `tf_static`.
        :param partial: whether damage is noted in `damage` instead of raised.
        :param max_bytes: the largest size of a chunk or a message after decompression (bytes).
        :param on_progress: as in `dummy_arm.tf.bag.read`.
        """
        self._path = path
        self._namespace = ''.join(f'/{part}' for part in namespace.split('/') if part)
        self._is_static = {f'{self._namespace}/tf': False, f'{self._namespace}/tf_static': True}
        self._types: dict[str, str] = {}
        self._on_progress = on_progress
        self._start, self._share, self._done = 0.0, 1.0, 0.0
        #: The exception that on_progress has raised. It is not taken for damage of the bag.
        self._raised: Optional[BaseException] = None
        self.partial = partial
        self.max_bytes = max_bytes
        #: Descriptions of the first `_SHOWN` faults in the files of the bag.
        self.damage: list[str] = []

    def stream(self, topic: str, msgtype: str, publisher: str, encoding: Encoding
               ) -> Optional[Stream]:
        """
        Return the stream of a topic, and remember the topic.

        :param topic: its name.
        :param msgtype: the type of its messages, such as 'tf2_msgs/msg/TFMessage'.
        :param publisher: the name of the node that published the messages.
        :param encoding: how the messages are encoded.
        :returns: the stream; None if these are not TF messages of the namespace.
        """
        topic = f'/{topic.strip("/")}'
        is_static = self._is_static.get(topic)
        if len(self._types) < _MAX_TOPICS or is_static is not None:
            self._types[topic] = msgtype
        return None if is_static is None or msgtype not in _TYPES else Stream(
            is_static, publisher, encoding)

    def start_file(self, number: int, count: int) -> None:
        """
        Report that reading of a file of the bag begins.

        :param number: the number of the file, from 0 on.
        :param count: the number of files.
        """
        self._start, self._share = number / count, 1 / count
        self.advance(0.0)

    def advance(self, part: float) -> None:
        """
        Report the progress of reading the current file.

        :param part: the fraction of the file that has been read, from 0 to 1.
        """
        self._done = self._start + part * self._share
        self.tick()

    def finish(self) -> None:
        """Report that the whole bag has been read."""
        self._done = 1.0
        self.tick()

    def tick(self) -> None:
        """Call on_progress; once it has raised, raise the same exception in each call."""
        if self._raised is None:
            try:
                self._on_progress(self._done)
                return
            except BaseException as error:
                self._raised = error
        raise self._raised

    def handle_error(self, path: Path, error: Exception) -> None:
        """
        Note that a file is damaged, or raise an error.

        :param path: the file.
        :param error: the error that reading the file has raised.
        :raises BagError: unless the bag is read as partial.
        :raises ImportError: if the error is an ImportError: then a library is missing, and the
            file is not damaged.
        """
        self.tick()  # if on_progress has raised, that is the cause: it is raised again
        if isinstance(error, ImportError):
            raise error
        if not self.partial:
            if isinstance(error, BagError):  # its text names the file
                raise error
            name = '' if path == self._path else f'{visible(path.name)}: '
            raise BagError(
                f'{self._path} cannot be read: {name}{error_line(error)} If it is damaged or cut '
                'off, partial=True (--partial) reads what is left') from None
        if len(self.damage) < _SHOWN:
            self.damage.append(f'{visible(str(path))}: {error_line(error)}')

    def why_no_tf(self) -> str:
        """Return why no TF message was found: the topics or namespaces that the bag has."""
        expected = ' or '.join(self._is_static)
        namespaces = {topic.rpartition('/')[0] for topic, msgtype in self._types.items()
                      if msgtype in _TYPES and re.search('/tf(_static)?$', topic)}
        others = sorted(namespaces - {self._namespace})
        if others == ['']:
            return f'no TFMessage on {expected}, but without a namespace: omit the namespace'
        if others:
            return (f'no TFMessage on {expected}, but in the namespace '
                    f'{comma_list([logged(name) or "/" for name in others], _SHOWN)}: pass it as '
                    'namespace (--namespace)')
        topics = sorted(f'{logged(topic)} ({logged(msgtype)})'
                        for topic, msgtype in self._types.items())
        return (f'no tf2_msgs/msg/TFMessage on {expected}; its topics: '
                f'{comma_list(topics, _SHOWN) or "none"}')


def error_line(error: Exception) -> str:
    r"""
    Return the text of an error in one line that ends with one period.

    :param error: the error.
    :returns: its text, abbreviated if it is long; white space is replaced by single spaces, and
        control characters are escaped. If it has no text, the name of its type.

    >>> error_line(ValueError('a record\n  ends too early'))
    'a record ends too early.'
    >>> error_line(ValueError('no topic \x1b[2J.'))
    'no topic \\x1b[2J.'
    >>> error_line(KeyError())
    'KeyError.'
    """
    text = visible(' '.join(str(error).split())) or type(error).__name__
    return f'{abbreviated(text, _LONGEST_ERROR).rstrip(".")}.'
