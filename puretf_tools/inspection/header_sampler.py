"""The headers of messages on topics without transforms."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from rclpy.node import Node

from puretf._text.names import TF_MESSAGE
from puretf.bag import Headers
from puretf.publisher_listener import nodes_on, TopicWatch

#: How many messages of a topic are read at once, and after how many bytes at once the topic is
#: left until the next search for topics.
_AT_ONCE, _MOST_BYTES = 20, 1_000_000
#: The largest number of topics.
_MOST_TOPICS = 10_000


class HeaderSampler(TopicWatch):
    """Reads all topics whose messages begin with a header."""

    def __init__(self, node: Node) -> None:
        super().__init__(node, self._wanted, _MOST_TOPICS, _AT_ONCE)
        self._types: dict[str, Any] = {}  #: by topic; None: its headers are not read
        self.headers: dict[str, Headers] = {}  #: by topic: what was read
        self.not_read: dict[str, str] = {}  #: by topic: why its headers are not read

    def senders(self) -> dict[str, list[str]]:
        return {name: nodes_on(self._node, name) for name in self.headers}

    def poll(self) -> None:
        super().poll()
        for name, headers in self.headers.items():
            size = 0
            for message, is_new in self.take(name):
                size += len(message)
                if not is_new:
                    headers.add_frame(message)
                elif headers.wants_next():
                    headers.add(message.time, message)
            if size > _MOST_BYTES:
                self.leave(name)

    def _wanted(self) -> Iterator[tuple[str, Any]]:
        for name, types in self._node.get_topic_names_and_types():
            # A node cannot subscribe to a topic with two types, such as one with transforms.
            if name not in self._types and TF_MESSAGE not in types:
                for info in self._node.get_publishers_info_by_topic(name)[:1]:
                    self._types[name] = self._type_with_header(name, info.topic_type)
            if self._types.get(name) and name not in self.readers:
                self.headers.setdefault(name, Headers())
                yield name, self._types[name]

    def _type_with_header(self, name: str, type_name: str) -> Any:
        package, is_message, type_of_package = type_name.partition('/msg/')
        if is_message:  # the topics of services and actions have no header
            try:
                message_type: Any = getattr(import_module(f'{package}.msg'), type_of_package)
                fields = message_type.get_fields_and_field_types()
                if next(iter(fields.values()), '') == 'std_msgs/Header':
                    return message_type
            except Exception as error:  # the code of another package can raise any error
                self.not_read[name] = (f'its type {type_name} cannot be imported '
                                       f'({type(error).__name__}: {error})')
        return None
