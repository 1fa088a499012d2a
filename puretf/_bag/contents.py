"""What a bag has, as far as it has been read: its topics, begin and end, and damage."""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
import re
from typing import Optional, Union

from puretf._bag.recordings import BagError, error_line
from puretf._text.names import comma_list, namespace_path, shortened, TF_MESSAGE, visible
from puretf._wire.encoding import CDR, Encoding, ROS1
from puretf._wire.headers import Headers

#: The publisher of a stream if the bag does not record it; rosbag2 never does.
NOT_RECORDED = 'not recorded'
#: Topics whose messages are read: the type and the last part of the name, or the whole name.
Other = Union[tuple[str, str], str]
_TF_TYPES = TF_MESSAGE, 'tf/msg/tfMessage'
#: The durabilities to which old versions of rosbag2 give numbers.
_DURABILITIES = {'0': 'SYSTEM_DEFAULT', '1': 'TRANSIENT_LOCAL', '2': 'VOLATILE', '3': 'UNKNOWN'}


@dataclass(eq=False)
class Topic:
    """
    A topic of a bag; in ROS 1, what one node has published on it.

    :param msgtype: the type of its messages, such as 'sensor_msgs/msg/LaserScan'
    :param publisher: the name of the node that published it, of several the first one; that of a
        message has its own; 'not recorded' in rosbag2
    :param is_static: whether it is /tf_static of the namespace; None: it is neither
    :param has_header: whether its messages begin with a header; None: it is not known. False if
        neither headers nor messages of this name are read
    :param headers: the headers of all messages, or of evenly spaced ones, at most 20 000
    :param is_tf: True if its messages are TF messages
    :param durabilities: how many publishers have which recorded durability, such as
        'TRANSIENT_LOCAL'
    :param count: the number of its messages in the files that have been read
    """

    name: str
    msgtype: str
    encoding: Encoding
    publisher: str
    is_static: Optional[bool]
    has_header: Optional[bool]
    headers: Headers
    is_tf: bool
    is_wanted: bool  #: True if its messages are read
    is_read: bool  #: True if its messages, or their headers, are read
    durabilities: Counter[str] = field(default_factory=Counter)
    count: int = 0


#: A message of a bag: its topic, the time at which it was recorded (ns), and its bytes.
Record = tuple[Topic, int, bytes]


class Contents:
    """The topics and the damage of a recording, and which of its messages are read."""

    def __init__(self, path: Path, namespace: str, partial: bool, max_bytes: int, tf: bool = False,
                 headers: bool = False, others: Collection[Other] = ()) -> None:
        """Find nothing yet; see `Bag.messages`."""
        if isinstance(others, str):
            raise TypeError(f"others must be a list, such as ['/scan'], got {others!r}")
        self._path, self._partial, self.max_bytes = path, partial, max_bytes
        self.file = path  #: what is being read
        self._namespace = namespace_path(namespace)
        self._is_static = {f'{self._namespace}/tf': False, f'{self._namespace}/tf_static': True}
        self._tf, self._headers, self.others = tf, headers, others
        self.topics: dict[tuple[str, str], Topic] = {}  #: by name and type
        self._of_node: dict[tuple[Topic, str], Topic] = {}
        #: When the first and the last message were recorded (ns); (0, 0): there is none.
        self.begin, self.end = 0, 0
        self.tf_count = 0  #: the number of TF messages that can be read, in the window or not
        self.damage: list[str] = []  #: descriptions of the faults in its files
        self.has_lost = False  #: whether messages may be missing since the last one
        #: Within which times of the recording they may be (ns), but at its begin and its end.
        self.missing_spans: list[tuple[int, int]] = []

    def topic(self, name: str, msgtype: str, definition: str, encoding: str, qos: str = '',
              publisher: str = NOT_RECORDED, count: int = 0) -> Topic:
        """Return a topic with further messages; `qos`: its profiles, in the YAML of rosbag2."""
        name = f'/{name.strip("/")}'
        msgtype = re.sub('^([^/]+)/([^/]+)$', r'\1/msg/\2', msgtype)  # as in ROS 2
        if encoding not in ('cdr', 'ros1', ''):
            msgtype = f'{msgtype} in {encoding}'  # which is not a known type
        topic = self.topics.get((name, msgtype))
        if topic is None:
            form = ROS1 if encoding == 'ros1' else CDR
            is_tf, is_named = msgtype in _TF_TYPES, name in self.others
            is_static = self._is_static.get(name) if is_tf else None
            has_header = (self._headers or is_named) and not is_tf and (
                name not in self._is_static and _begins_with_header(msgtype, definition))
            is_wanted = (self._tf and is_static is not None) or is_named or (
                msgtype, name.rpartition('/')[2]) in self.others
            topic = self.topics[name, msgtype] = Topic(
                name, msgtype, form, publisher, is_static, has_header, Headers(form), is_tf,
                is_wanted, is_wanted or bool(has_header))
        topic.count += count
        topic.durabilities |= Counter(  # the largest numbers of all files
            _DURABILITIES.get(each, each.upper())
            for each in re.findall(r'durability: (\w+)', qos))
        return topic if publisher == topic.publisher else self._of_node.setdefault(
            (topic, publisher), replace(topic, publisher=publisher))

    def add_span(self, begin: int, end: int) -> None:
        """Note when the first and the last message of a part were recorded (ns); 0: none."""
        if end > 0:
            self.begin, self.end = min(self.begin or begin, begin), max(self.end, end)

    def add_damage(self, error: Exception, span: Optional[tuple[int, int]] = None) -> None:
        """
        Note an error in the file if `partial` is True; else, raise a BagError.

        `span` is the first and the last time of what is lost, where the file says it.
        """
        if isinstance(error, BagError):
            raise error
        text = error_line(error)
        self.damage.append(f'{visible(str(self.file))}: {text}')
        if not self._partial:
            name = '' if self.file == self._path else f'{visible(self.file.name)}: '
            raise BagError(f'{self._path} cannot be read: {name}{text}') from None
        if span:
            self.missing_spans.append(span)
        else:
            self.has_lost = True

    def wrong_types(self) -> str:
        """Name the topics of TF that have another type; return '' if there are none."""
        found = [f'{shortened(name)} has the type {shortened(msgtype)}'
                 for (name, msgtype), topic in sorted(self.topics.items())
                 if name in self._is_static and not topic.is_tf]
        return '' if not found else (
            f'{" and ".join(found)}, not {TF_MESSAGE}: send transforms with a '
            'TransformBroadcaster or a StaticTransformBroadcaster')

    def why_no_tf(self) -> str:
        expected = ' or '.join(self._is_static)
        namespaces = {topic.name.rpartition('/')[0] for topic in self.topics.values()
                      if topic.is_tf and re.search('/tf(_static)?$', topic.name)}
        if others := sorted(namespaces - {self._namespace}):
            names = comma_list([shortened(name) or '/' for name in others])
            return f'no TFMessage on {expected}, but ' + (
                'on topics without a namespace: omit the namespace' if others == [''] else
                f'in the namespace {names}: pass namespace=')
        topics = [f'{shortened(name)} ({shortened(msgtype)})'
                  for name, msgtype in sorted(self.topics)]
        return self.wrong_types() or (f'no {TF_MESSAGE} on {expected}; its topics: '
                                      f'{comma_list(topics) or "none"}')


@lru_cache(maxsize=1000)
def _begins_with_header(msgtype: str, definition: str) -> Optional[bool]:
    """Return whether messages begin with a header; None: the definition is not understood."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores
    try:
        if not definition:
            types = get_typestore(Stores.LATEST).fielddefs
        elif re.search(r'\bmodule\s+\w+\s*{', definition):
            types = get_types_from_idl(definition)
        else:
            types = get_types_from_msg(definition, msgtype)
        fields = types[msgtype][1]
    except Exception:  # the parser raises errors of many types
        return None
    return bool(fields) and fields[0][1][1] == 'std_msgs/msg/Header'
