"""The descriptions and joint states of robots, as `tf_doctor` examines them."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial as bound
from typing import Any, Optional, TYPE_CHECKING

from dummy_arm.inspection.robots import joint_states_of, Robot
from dummy_arm.robot.descriptions import DescriptionOrWhy, in_bag
from dummy_arm.robot.joint_positions import JointPositions
from dummy_arm.tf.bag import decoded, Paths

if TYPE_CHECKING:
    from rclpy.node import Node

#: The largest number of names of joints that are kept of a topic.
_MOST_NAMES = 10_000


def robots_in_bag(bag: Paths, partial: bool = False,
                  on_progress: Optional[Callable[[float], object]] = None) -> list[Robot]:
    """Return the robots of a bag; the arguments and errors are those of `bag.read`."""
    descriptions = in_bag(bag, partial, on_progress)
    states: dict[str, dict[str, str]] = {}
    if descriptions:
        for topic, message in decoded(bag, 'sensor_msgs/msg/JointState', 'joint_states',
                                      partial=partial, on_progress=on_progress):
            _receive(states.setdefault(topic, {}), message)
    return [_robot(topic, each, states.get(joint_states_of(topic), {}))
            for topic, each in descriptions.items()]


class RobotListener:
    """Listens to the descriptions of robots, and to their joint states."""

    def __init__(self, node: 'Node') -> None:
        from dummy_arm.robot.description_listener import DescriptionListener
        self._node, self._descriptions = node, DescriptionListener(node)
        self._states: dict[str, dict[str, str]] = {}

    def poll(self) -> None:
        """Search for descriptions, and listen to the joint states of those that are found."""
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import JointState
        for topic in map(joint_states_of, self._descriptions.descriptions()):
            if topic not in self._states:
                states = self._states[topic] = {}
                with suppress(RuntimeError):  # this node listens to another type on the topic
                    self._node.create_subscription(
                        JointState, topic, bound(_receive, states), qos_profile_sensor_data)

    def robots(self) -> list[Robot]:
        """Return what was received of each robot."""
        self._descriptions.wait()
        return [_robot(topic, each, self._states.get(joint_states_of(topic), {}))
                for topic, each in self._descriptions.descriptions().items()]


def _receive(states: dict[str, str], message: Any) -> None:
    stamp = message.header.stamp
    why = ('have the stamp 0' if not (stamp.sec or stamp.nanosec) else
           'do not have a position for each name'
           if len(message.name) != len(message.position) else '')
    if len(states) < _MOST_NAMES:
        for name in message.name:
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
