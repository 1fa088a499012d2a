"""Subscriptions to the topics with the descriptions of robots, and with their joint states."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from puretf import SECOND
from puretf.publisher_listener import node_of, nodes_on, TopicWatch
from puretf_tools.inspection.feeds import Sender, Senders
from puretf_tools.inspection.joint_states import JointStateReader
from puretf_tools.robot import observed
from puretf_tools.robot.observed import DescriptionOrWhy, JOINT_STATE, joint_states_of, Robot

#: The largest number of topics with joint states, and of messages of each that are read at a time.
_MOST_STATES, _DEPTH = 20, 50


class DescriptionListener(TopicWatch):
    """Reads all topics whose names end with `TOPIC` while they have publishers."""

    def __init__(self, node: Node, namespace: str = '') -> None:
        """Read the topics below a namespace, such as '/left'."""
        super().__init__(node, self._wanted, observed.MOST_TOPICS, 1)
        self._namespace = namespace
        #: By topic: the newest text, and what it says.
        self._read_texts: dict[str, tuple[str, DescriptionOrWhy]] = {}

    def descriptions(self) -> dict[str, DescriptionOrWhy]:
        """Return the newest descriptions by topic; search for topics twice a second."""
        self.poll()
        for topic, readers in self.readers.items():
            # Listeners of descriptions match latched ones only.
            for message in readers[True].take() if True in readers else ():
                text = str(message[8:].partition(b'\0')[0], 'utf-8', 'replace')  # after the length
                if topic not in self._read_texts or text != self._read_texts[topic][0]:
                    self._read_texts[topic] = text, observed.parsed(text)
        return {topic: each for topic, (_, each) in self._read_texts.items()}

    def _wanted(self) -> list[tuple[str, Any]]:
        for topic in [*self.readers]:
            if not self._node.count_publishers(topic):
                self.leave(topic)
                self._read_texts.pop(topic, None)
        return [(topic, String) for topic, types in self._node.get_topic_names_and_types()
                if topic.startswith(f'{self._namespace}/') and topic.endswith(f'/{observed.TOPIC}')
                and types == [observed.STRING] and self._node.count_publishers(topic)]


class RobotListener(TopicWatch):
    """Listens to the descriptions of robots, and to the joint states that feed transforms."""

    def __init__(self, node: Node, tf_topic: str = '/tf') -> None:
        super().__init__(node, self._wanted, _MOST_STATES, _DEPTH)
        self._descriptions, self._tf_topic = DescriptionListener(node), tf_topic
        #: By topic of joint states.
        self._decoders: dict[str, JointStateReader] = {}
        self._states: defaultdict[str, dict[str, str]] = defaultdict(dict)
        self._senders: defaultdict[str, Senders] = defaultdict(Senders)

    def poll(self) -> None:
        self._descriptions.descriptions()
        super().poll()
        for topic in self.readers:
            decoder = self._decoders.setdefault(topic, JointStateReader(self._node, topic))
            for data, is_new in self.take(topic):
                if is_new and (message := decoder.read(data)):
                    observed.receive(self._states[topic], message)
                    stamp = message.header.stamp
                    self._senders[topic].add(data.publisher, data.time, (
                        stamp.sec * SECOND + stamp.nanosec), message.name)

    def _wanted(self) -> Iterator[tuple[str, Any]]:
        """Yield the joint states of robots, and those that are read by nodes that send TF."""
        for topic in self._descriptions.descriptions():
            yield joint_states_of(topic), JointState
        senders = {*nodes_on(self._node, self._tf_topic)}
        for topic, types in self._node.get_topic_names_and_types():
            if JOINT_STATE in types and (topic.endswith('/joint_states')
                                         or not senders.isdisjoint(self.subscribers(topic))):
                yield topic, JointState

    def subscribers(self, topic: str) -> list[str]:
        """Return the full names of the nodes that read a topic."""
        return [*map(node_of, self._node.get_subscriptions_info_by_topic(topic))]

    def robots(self) -> list[Robot]:
        return [observed.robot_of(topic, each, self._states)
                for topic, each in self._descriptions.descriptions().items()]

    def senders(self) -> dict[str, Sequence[Sender]]:
        return {topic: self._senders[topic].named(reader.names_of)
                for topic, readers in self.readers.items() for reader in readers.values()}

    def close(self) -> None:
        self._descriptions.close()
        super().close()
