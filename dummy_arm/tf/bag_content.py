"""What a bag has of TF, as reading it shows."""

from collections.abc import Callable
from pathlib import Path
import re
from typing import NamedTuple, Optional

from dummy_arm.interruption import heed
from dummy_arm.tf.hints import some
from dummy_arm.tf.message_reader import Form

#: In place of the sender, which only bags of ROS 1 have.
NOT_RECORDED = 'not recorded'
_TYPES = 'tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'
_SHOWN = 10


class BagError(Exception):
    """A bag cannot be read, or has no TF; the text says why, and what to do."""


class Stream(NamedTuple):
    """Where messages come from, and how they are written."""

    is_static: bool
    sender: str
    form: Form


class Content:
    """The topics of a bag, what is wrong with it, and how far it has been read."""

    def __init__(self, namespace: str, partial: bool, show: Callable[[float], object]) -> None:
        """
        Begin to read.

        :param namespace: of the topics.
        :param partial: what is wrong is noted, not raised.
        :param show: is called with how much has been read, from 0 to 1.
        """
        self._namespace = ''.join(f'/{part}' for part in namespace.split('/') if part)
        self._is_static = {f'{self._namespace}/tf': False, f'{self._namespace}/tf_static': True}
        self._types: dict[str, str] = {}
        self._show = show
        self.partial = partial
        #: What is wrong with its files; of many things, the first.
        self.damage: list[str] = []

    def stream(self, topic: str, msgtype: str, sender: str, form: Form) -> Optional[Stream]:
        """Tell what the messages of a topic are; None: not TF of this namespace."""
        topic = f'/{topic.strip("/")}'
        self._types[topic] = msgtype
        is_static = self._is_static.get(topic)
        return None if is_static is None or msgtype not in _TYPES else Stream(
            is_static, sender, form)

    def advance(self, part: float) -> None:
        """Show how far it has been read; raise KeyboardInterrupt when a signal has come."""
        heed()
        self._show(part)

    def meet(self, path: Path, error: Exception) -> None:
        """
        Note what is wrong with a file.

        :raises BagError: unless it is read as partial.
        """
        heed()  # what reads may have been interrupted, and raised an error of its own
        if not self.partial:
            raise BagError(f'{path} cannot be read: {described(error)} If it is damaged or cut '
                           'off, partial (--partial) reads what is there') from None
        if len(self.damage) < _SHOWN:
            self.damage.append(f'{path}: {described(error)}')

    def why_none(self) -> str:
        """Tell what there is instead of TF."""
        asked = ' or '.join(self._is_static)
        namespaces = {topic.rpartition('/')[0] for topic, msgtype in self._types.items()
                      if msgtype in _TYPES and re.search('/tf(_static)?$', topic)}
        others = sorted(namespaces - {self._namespace})
        if others == ['']:
            return f'no TFMessage on {asked}, but without a namespace: leave it out'
        if others:
            return (f'no TFMessage on {asked}, but in the namespace '
                    f'{", ".join(name or "/" for name in others)}: give it (--namespace)')
        topics = sorted(f'{topic} ({msgtype})' for topic, msgtype in self._types.items())
        return (f'no tf2_msgs/msg/TFMessage on {asked}; its topics: '
                f'{some(topics, _SHOWN) or "none"}')


def described(error: Exception) -> str:
    """Write an error in one line."""
    text = ' '.join(str(error).split()) or type(error).__name__
    return f'{text.rstrip(".")}.'
