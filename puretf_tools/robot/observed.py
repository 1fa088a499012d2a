"""The descriptions and joint states of robots, as `tf_doctor` examines them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from time import monotonic
from typing import Any, Optional, TYPE_CHECKING

from puretf.bag import decoded, Paths
from puretf.formatting import SECOND
from puretf_tools.inspection.feeds import Sender, Senders
from puretf_tools.inspection.robots import joint_states_of, Robot
from puretf_tools.robot.descriptions import DescriptionOrWhy, in_bag
from puretf_tools.robot.joint_positions import JointPositions

if TYPE_CHECKING:
    from rclpy.node import Node

    from puretf.publisher_listener import TopicReader

_JOINT_STATE = 'sensor_msgs/msg/JointState'
#: The largest number of names of joints that are kept of a topic, and of these topics.
_MOST_NAMES, _MOST_TOPICS = 10_000, 20
#: The time between two searches for topics (s), and how many messages each `poll` reads.
_SCAN_INTERVAL, _DEPTH = 0.5, 50


def robots_in_bag(bag: Paths, partial: bool = False,
                  on_progress: Optional[Callable[[float], object]] = None) -> list[Robot]:
    """Return the robots of a bag; the arguments and errors are those of `bag.read`."""
    descriptions = in_bag(bag, partial, on_progress)
    states: dict[str, dict[str, str]] = {joint_states_of(topic): {} for topic in descriptions}
    for topic, message in decoded(bag, _JOINT_STATE, 'joint_states', partial=partial,
                                  on_progress=on_progress) if descriptions else ():
        if topic in states:
            _receive(states[topic], message)
    return [_robot(topic, each, states[joint_states_of(topic)])
            for topic, each in descriptions.items()]


class RobotListener:
    """Listens to the descriptions of robots, and to the joint states that feed transforms."""

    def __init__(self, node: 'Node', tf_topic: str = '/tf') -> None:
        from puretf_tools.robot.description_listener import DescriptionListener
        self._node, self._descriptions = node, DescriptionListener(node)
        self._tf_topic, self._next_scan = tf_topic, 0.0
        #: By topic of joint states; None: this node listens to another type on the topic.
        self._readers: dict[str, Optional[TopicReader]] = {}
        self._states: dict[str, dict[str, str]] = {}
        self._senders: dict[str, Senders] = {}

    def poll(self) -> None:
        """Search for descriptions and joint states, and read the joint states."""
        from rclpy.serialization import deserialize_message
        from sensor_msgs.msg import JointState
        for topic in map(joint_states_of, self._descriptions.descriptions()):
            self._listen(topic)
        if monotonic() >= self._next_scan:
            self._next_scan = monotonic() + _SCAN_INTERVAL
            for topic, types in self._node.get_topic_names_and_types():
                if _JOINT_STATE in types and topic not in self._readers and self._feeds_tf(topic):
                    self._listen(topic)
        for topic, reader in self._readers.items():
            for data in reader.take() if reader else ():
                try:
                    message = deserialize_message(data, JointState)
                except Exception:  # malformed; the middleware raises errors of many types
                    continue
                _receive(self._states[topic], message)
                stamp = message.header.stamp
                self._senders[topic].add(
                    data.publisher, data.time, stamp.sec * SECOND + stamp.nanosec, message.name)

    def _listen(self, topic: str) -> None:
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import JointState

        from puretf.publisher_listener import TopicReader
        if topic in self._readers or len(self._readers) >= _MOST_TOPICS:
            return
        self._states[topic], self._senders[topic], self._readers[topic] = {}, Senders(), None
        with suppress(RuntimeError):  # this node listens to another type on the topic
            self._readers[topic] = TopicReader(self._node, JointState, topic, QoSProfile(
                depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT))

    def _feeds_tf(self, topic: str) -> bool:
        """Return whether joint states are of a robot, or a node reads them that sends TF."""
        from puretf.publisher_listener import node_of
        return topic.endswith('/joint_states') or not {*self.subscribers(topic)}.isdisjoint(
            map(node_of, self._node.get_publishers_info_by_topic(self._tf_topic)))

    def subscribers(self, topic: str) -> list[str]:
        """Return the full names of the nodes that read a topic."""
        from puretf.publisher_listener import node_of
        return [*map(node_of, self._node.get_subscriptions_info_by_topic(topic))]

    def robots(self) -> list[Robot]:
        """Return what was received of each robot."""
        self._descriptions.wait()
        return [_robot(topic, each, self._states.get(joint_states_of(topic), {}))
                for topic, each in self._descriptions.descriptions().items()]

    def senders(self) -> dict[str, Sequence[Sender]]:
        """Return the senders of joint states by topic; none if it is not known who sends what."""
        return {topic: self._senders[topic].named(reader.names_of)
                for topic, reader in self._readers.items() if reader and reader.has_gids}

    def close(self) -> None:
        for reader in self._readers.values():
            if reader:
                reader.close()


def _receive(states: dict[str, str], message: Any) -> None:
    stamp = message.header.stamp
    why = ('have the stamp 0' if not (stamp.sec or stamp.nanosec) else
           'do not have a position for each name'
           if len(message.name) != len(message.position) else '')
    if len(states) < _MOST_NAMES:
        for name in message.name[:_MOST_NAMES]:
            states[name] = why and states.get(name, why)


def _robot(topic: str, description: DescriptionOrWhy, states: Mapping[str, str]) -> Robot:
    if isinstance(description, str):
        return Robot(topic, problem=description)
    joints: dict[str, list[str]] = {}
    masters = JointPositions(description).masters
    for joint in description.joints:
        if joint.name in masters:
            joints.setdefault(masters[joint.name], []).append(joint.child)
    return Robot(topic, '', description.root, description.links, joints, dict(states))
