"""Subscriptions to other topics, of whose messages the headers are read."""

from importlib import import_module
from time import monotonic, time_ns
from typing import Any, Optional

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from puretf import TF_MESSAGE
from puretf.bag import Headers
from puretf.publisher_listener import node_of

#: The time between two searches for topics (s).
_SCAN_INTERVAL = 0.5
#: How many messages of a topic are read within a second, and at once, and after how many bytes
#: within a second its subscriptions pause.
_RATE, _AT_ONCE, _MOST_BYTES = 50.0, 5, 10_000_000
_LATCHED = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
_OTHER = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE


class HeaderSampler:
    """Subscriptions to all topics whose messages begin with a header."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._next_scan = 0.0
        self._topics: dict[str, Optional[_Topic]] = {}  #: None: its headers are not read
        self.not_read: dict[str, str] = {}  #: by topic: why its headers are not read

    def headers(self) -> dict[str, Headers]:
        """Return the headers that were read, by topic."""
        return {name: topic.sample() for name, topic in self._topics.items() if topic}

    def senders(self) -> dict[str, list[str]]:
        """Return the nodes that publish these topics, by topic."""
        return {name: sorted(map(node_of, self._node.get_publishers_info_by_topic(name)))
                for name, topic in self._topics.items() if topic}

    def poll(self) -> None:
        """Let more messages be read, and twice a second search for topics."""
        for topic in self._topics.values():
            if topic:
                topic.poll()
        if self._node.executor is not None:
            self._node.executor.wake()  # it waits for those topics only that may be read
        if monotonic() >= self._next_scan:
            self._next_scan = monotonic() + _SCAN_INTERVAL
            self._scan()

    def _scan(self) -> None:
        for name, types in self._node.get_topic_names_and_types():
            # A node cannot subscribe to a topic with two types, such as one with transforms.
            if TF_MESSAGE in types or (name in self._topics and len(types) == 1):
                continue
            published = sorted({
                info.topic_type for info in self._node.get_publishers_info_by_topic(name)})
            if published and name not in self._topics:
                self._topics[name] = self._topic(name, published[0])
            if len(published) > 1:
                self.not_read[name] = (
                    f'only one type is read; its publishers have the types {", ".join(published)}')

    def _topic(self, name: str, type_name: str) -> 'Optional[_Topic]':
        package, is_message, type_of_package = type_name.partition('/msg/')
        if not is_message:  # the topics of services and actions have no header
            return None
        try:
            message_type: Any = getattr(import_module(f'{package}.msg'), type_of_package)
            fields = message_type.get_fields_and_field_types()
            if next(iter(fields.values()), '') == 'std_msgs/Header':
                return _Topic(self._node, name, message_type)
        except (ImportError, AttributeError):
            self.not_read[name] = f'its type {type_name} cannot be imported'
        except Exception as error:  # the code of another package can raise any error
            self.not_read[name] = f'{type_name}: {type(error).__name__}: {error}'
        return None


class _Pace(CallbackGroup):
    """Lets the executor read as many messages as are allowed."""

    allowed = 0.0

    def can_execute(self, entity: object) -> bool:
        return self.allowed >= 1.0

    def beginning_execution(self, entity: object) -> bool:
        return True

    def ending_execution(self, entity: object) -> None:
        """Do nothing: the callback counts the messages."""


class _Topic:
    """The subscriptions to a topic; the executor and the thread that polls share it."""

    def __init__(self, node: Node, name: str, message_type: Any) -> None:
        self._node, self._name, self._message_type = node, name, message_type
        self._pace = _Pace()
        self._headers = Headers()
        self._subscriptions: list[Any] = []
        self._since = self._polled = monotonic()  # the beginning of this second, the last poll
        self._bytes = 0  # within this second
        self._begin = 0  # latched messages that were sent earlier (ns) are of the past
        self._first = self._last = 0  # the numbers that the publisher has given to messages
        self._subscribe()

    def sample(self) -> Headers:
        """Return the headers, with the number of all messages if there is only one publisher."""
        headers, published = self._headers, self._last - self._first + 1
        if headers.count and self._node.count_publishers(self._name) == 1 and (
                published > headers.count):
            headers.step *= round(published / headers.count)
            headers.count = published
        return headers

    def poll(self) -> None:
        """Let more messages be read; after too many bytes, pause until the second is over."""
        now = monotonic()
        self._pace.allowed = min(
            self._pace.allowed + (now - self._polled) * _RATE, float(_AT_ONCE))
        self._polled = now
        if self._bytes > _MOST_BYTES:
            self._pace.allowed = 0.0
            while self._subscriptions:
                self._node.destroy_subscription(self._subscriptions.pop())
        if now >= self._since + 1.0:
            self._since, self._bytes = now, 0
            if not self._subscriptions:
                self._subscribe()

    def _subscribe(self) -> None:
        # A best-effort, volatile subscription matches all publishers. But latched messages of the
        # past are sent only to a reliable, transient-local one.
        offered = {(info.qos_profile.reliability, info.qos_profile.durability)
                   for info in self._node.get_publishers_info_by_topic(self._name)}
        self._begin = time_ns()
        if has_others := offered != {_LATCHED}:
            self._add_subscription(self._read, *_OTHER)
        if _LATCHED in offered:
            self._add_subscription(
                self._read_frame if has_others else self._read_latched, *_LATCHED)

    def _add_subscription(self, callback: Any, reliability: ReliabilityPolicy,
                          durability: DurabilityPolicy) -> None:
        self._subscriptions.append(self._node.create_subscription(
            self._message_type, self._name, callback,
            QoSProfile(depth=_AT_ONCE, reliability=reliability, durability=durability),
            callback_group=self._pace, raw=True,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False)))

    def _read(self, data: bytes, info: dict[str, Any]) -> None:
        self._pace.allowed -= 1.0
        self._bytes += len(data)
        self._last = info['publication_sequence_number'] or 0
        self._first = self._first or self._last
        if self._headers.wants_next():
            self._headers.add(info['received_timestamp'] or time_ns(), data)

    def _read_latched(self, data: bytes, info: dict[str, Any]) -> None:
        if info['source_timestamp'] > self._begin:
            self._read(data, info)
        else:
            self._read_frame(data)

    def _read_frame(self, data: bytes) -> None:
        self._pace.allowed -= 1.0
        self._bytes += len(data)
        self._headers.add_frame(data)
