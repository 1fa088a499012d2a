"""The descriptions and joint states of robots, as `tf_doctor` examines them."""

from collections.abc import Collection
from functools import partial
from typing import Any, TYPE_CHECKING

from dummy_arm.inspection.robots import joint_states_of, Robot
from dummy_arm.robot.descriptions import DescriptionOrWhy, in_bag
from dummy_arm.tf.bag import decoded, Paths

if TYPE_CHECKING:
    from rclpy.node import Node

#: The largest number of names of joints that are kept of a topic.
_MOST_NAMES = 10_000


def robots_in_bag(bag: Paths, is_partial: bool = False) -> list[Robot]:
    """Return the robots of a bag; the errors are those of `bag.read`."""
    descriptions = in_bag(bag, is_partial)
    names: dict[str, set[str]] = {}
    if descriptions:
        for topic, message in decoded(
                bag, 'sensor_msgs/msg/JointState', 'joint_states', partial=is_partial):
            _receive(names.setdefault(topic, set()), message)
    return [_robot(topic, each, names.get(joint_states_of(topic), ()))
            for topic, each in descriptions.items()]


class RobotListener:
    """Listens to the descriptions of robots, and to their joint states."""

    def __init__(self, node: 'Node') -> None:
        from dummy_arm.robot.description_listener import DescriptionListener
        self._node, self._descriptions = node, DescriptionListener(node)
        self._names: dict[str, set[str]] = {}

    def poll(self) -> None:
        """Search for descriptions, and listen to the joint states of those that are found."""
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import JointState
        for topic in map(joint_states_of, self._descriptions.descriptions()):
            if topic not in self._names:
                names = self._names[topic] = set()
                self._node.create_subscription(
                    JointState, topic, partial(_receive, names), qos_profile_sensor_data)
                if self._node.executor is not None:
                    self._node.executor.wake()

    def robots(self) -> list[Robot]:
        """Return what was received of each robot."""
        return [_robot(topic, each, self._names.get(joint_states_of(topic), ()))
                for topic, each in self._descriptions.descriptions().items()]


def _receive(names: set[str], message: Any) -> None:
    if len(names) < _MOST_NAMES:
        names.update(message.name)


def _robot(topic: str, description: DescriptionOrWhy, states: Collection[str]) -> Robot:
    if isinstance(description, str):
        return Robot(topic, problem=description)
    joints: dict[str, Any] = {joint.name: [joint.child] for joint in description.joints
                              if joint.is_movable and joint.mimic is None}
    for joint in description.joints:
        if joint.is_movable and joint.mimic and joint.mimic.joint in joints:
            joints[joint.mimic.joint].append(joint.child)
    return Robot(topic, '', description.root, description.links, joints, frozenset(states))
