"""Subscriptions to the topics with the descriptions of robots."""

from functools import partial
from threading import Lock, Thread
from time import monotonic
from typing import Any, Optional

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from puretf_tools.robot.descriptions import DescriptionOrWhy, MOST_TOPICS, parsed, STRING, TOPIC

#: The time between two searches for topics (s).
_SCAN_INTERVAL = 1.0
#: The longest time that `wait` takes (s).
_PATIENCE = 20.0
_LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)


class DescriptionListener:
    """Subscribes to all topics whose names end with `TOPIC` while they have publishers."""

    def __init__(self, node: Node, namespace: str = '') -> None:
        """Listen to the topics below a namespace, such as '/left'."""
        self._node, self._next_scan, self._namespace = node, 0.0, namespace
        self._subscriptions: dict[str, Any] = {}
        self._texts: dict[str, str] = {}
        self._lock = Lock()
        self._waiting: dict[str, str] = {}  # texts to be parsed, by topic
        self._parser: Optional[Thread] = None
        self._descriptions: dict[str, DescriptionOrWhy] = {}

    def descriptions(self) -> dict[str, DescriptionOrWhy]:
        """Return the newest descriptions by topic; search for topics once a second."""
        if monotonic() >= self._next_scan:
            self._next_scan = monotonic() + _SCAN_INTERVAL
            self._scan()
        return self._descriptions

    def wait(self) -> None:
        """Wait until all that has arrived is parsed, at most for some seconds."""
        if parser := self._parser:
            parser.join(_PATIENCE)

    def _scan(self) -> None:
        for topic in [*self._subscriptions]:
            if not self._node.count_publishers(topic):
                self._node.destroy_subscription(self._subscriptions.pop(topic))
                with self._lock:
                    self._texts.pop(topic, None)
                    self._descriptions = {name: each for name, each in self._descriptions.items()
                                          if name != topic}
        for topic, types in self._node.get_topic_names_and_types():
            if (topic.startswith(f'{self._namespace}/') and topic.endswith(f'/{TOPIC}')
                    and types == [STRING]
                    and topic not in self._subscriptions
                    and len(self._subscriptions) < MOST_TOPICS):
                self._subscriptions[topic] = self._node.create_subscription(
                    String, topic, partial(self._receive, topic), _LATCHED,
                    event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))

    def _receive(self, topic: str, message: String) -> None:
        with self._lock:
            if topic in self._subscriptions and message.data != self._texts.get(topic):
                self._texts[topic] = self._waiting[topic] = message.data
                if self._parser is None:
                    # The executor goes on, and so does the end of the process.
                    self._parser = Thread(target=self._parse, daemon=True)
                    self._parser.start()

    def _parse(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._parser = None
                    return
                topic, text = self._waiting.popitem()
            description = parsed(text)  # slow: meanwhile the topic may have left
            with self._lock:
                if self._texts.get(topic) is text:
                    # Replaced, since another thread may be iterating over it.
                    self._descriptions = {**self._descriptions, topic: description}
