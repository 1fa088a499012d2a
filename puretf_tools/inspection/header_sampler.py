"""The headers of messages on topics without transforms."""

from collections.abc import Iterator
from importlib import import_module
from time import monotonic
from typing import Any, Optional

from rclpy.node import Node

from puretf import TF_MESSAGE
from puretf.bag import Headers
from puretf.publisher_listener import nodes_on, ReceivedMessage, TopicWatch

#: How many messages of a topic are read within a second, and at once, and after how many bytes
#: within a second the topic is left for the rest of it.
_RATE, _AT_ONCE, _MOST_BYTES = 50.0, 5, 10_000_000
#: The largest number of topics.
_MOST_TOPICS = 10_000


class HeaderSampler:
    """Reads all topics whose messages begin with a header."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._watch = TopicWatch(node, self._wanted, _MOST_TOPICS, _AT_ONCE)
        self._topics: dict[str, Optional[_Topic]] = {}  #: None: its headers are not read
        self.not_read: dict[str, str] = {}  #: by topic: why its headers are not read

    def headers(self) -> dict[str, Headers]:
        """Return the headers that were read, by topic."""
        return {name: topic.sample(self._node.count_publishers(name))
                for name, topic in self._topics.items() if topic}

    def senders(self) -> dict[str, list[str]]:
        """Return the nodes that publish these topics, by topic."""
        return {name: nodes_on(self._node, name) for name, topic in self._topics.items() if topic}

    def poll(self) -> None:
        """Read messages, and twice a second search for topics."""
        self._watch.poll()
        for name, topic in self._topics.items():
            if topic:
                for message, is_new in self._watch.take(name, topic.allowed()):
                    topic.add(message, is_new)
                if topic.is_paused():
                    self._watch.leave(name)

    def close(self) -> None:
        self._watch.close()

    def _wanted(self) -> Iterator[tuple[str, Any]]:
        for name, types in self._node.get_topic_names_and_types():
            # A node cannot subscribe to a topic with two types, such as one with transforms.
            if TF_MESSAGE in types:
                continue
            if name not in self._topics or len(types) > 1:
                published = sorted({
                    info.topic_type for info in self._node.get_publishers_info_by_topic(name)})
                if published and name not in self._topics:
                    self._topics[name] = self._topic(name, published[0])
                if len(published) > 1:
                    self.not_read[name] = ('only one type is read; its publishers have the types '
                                           f'{", ".join(published)}')
            topic = self._topics.get(name)
            if topic and name not in self._watch.readers and not topic.is_paused():
                yield name, topic.message_type

    def _topic(self, name: str, type_name: str) -> 'Optional[_Topic]':
        package, is_message, type_of_package = type_name.partition('/msg/')
        if not is_message:  # the topics of services and actions have no header
            return None
        try:
            message_type: Any = getattr(import_module(f'{package}.msg'), type_of_package)
            fields = message_type.get_fields_and_field_types()
            if next(iter(fields.values()), '') == 'std_msgs/Header':
                return _Topic(message_type)
        except (ImportError, AttributeError):
            self.not_read[name] = f'its type {type_name} cannot be imported'
        except Exception as error:  # the code of another package can raise any error
            self.not_read[name] = f'{type_name}: {type(error).__name__}: {error}'
        return None


class _Topic:
    """What was read of a topic, and how much more may be read."""

    def __init__(self, message_type: Any) -> None:
        self.message_type = message_type
        self._headers = Headers()
        # The beginning of this second, and how many messages and bytes were read within it.
        self._since, self._count, self._bytes = monotonic(), 0, 0
        self._first = self._last = 0  # the numbers that the publisher has given to messages

    def sample(self, publishers: int) -> Headers:
        """Return the headers, with the number of all messages if there is only one publisher."""
        headers, published = self._headers, self._last - self._first + 1
        if headers.count and publishers == 1 and published > headers.count:
            headers.step *= round(published / headers.count)
            headers.count = published
        return headers

    def allowed(self) -> int:
        """Return how many messages may be read now."""
        now = monotonic()
        if now >= self._since + 1.0:
            self._since, self._count, self._bytes = now, 0, 0
        return max(0, min(int((now - self._since) * _RATE) - self._count, _AT_ONCE))

    def is_paused(self) -> bool:
        return self._bytes > _MOST_BYTES

    def add(self, message: ReceivedMessage, is_new: bool) -> None:
        self._count += 1
        self._bytes += len(message)
        if not is_new:
            self._headers.add_frame(message)
            return
        self._last = message.number
        self._first = self._first or self._last
        if self._headers.wants_next():
            self._headers.add(message.time, message)
