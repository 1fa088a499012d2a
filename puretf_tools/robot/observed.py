"""The descriptions and joint states of robots, as `tf_doctor` examines them."""

from collections.abc import Callable, Mapping
from typing import Any, Optional

from puretf.bag import decoded, Paths
from puretf_tools.inspection.robots import joint_states_of, Robot
from puretf_tools.robot.descriptions import DescriptionOrWhy, in_bag
from puretf_tools.robot.joint_positions import JointPositions

JOINT_STATE = 'sensor_msgs/msg/JointState'
#: The largest number of names of joints that are kept of a topic.
_MOST_NAMES = 10_000


def robots_in_bag(bag: Paths, partial: bool = False,
                  on_progress: Optional[Callable[[float], object]] = None) -> list[Robot]:
    """Return the robots of a bag; the arguments and errors are those of `bag.read`."""
    descriptions = in_bag(bag, partial, on_progress)
    states: dict[str, dict[str, str]] = {joint_states_of(topic): {} for topic in descriptions}
    for topic, message in decoded(bag, JOINT_STATE, 'joint_states', partial=partial,
                                  on_progress=on_progress) if descriptions else ():
        if topic in states:
            receive(states[topic], message)
    return [robot_of(topic, each, states[joint_states_of(topic)])
            for topic, each in descriptions.items()]


def receive(states: dict[str, str], message: Any) -> None:
    """Note which joints are in a JointState, and whether robot_state_publisher ignores it."""
    stamp = message.header.stamp
    why = ('have the stamp 0' if not (stamp.sec or stamp.nanosec) else
           'do not have a position for each name'
           if len(message.name) != len(message.position) else '')
    if len(states) < _MOST_NAMES:
        for name in message.name[:_MOST_NAMES]:
            states[name] = why and states.get(name, why)


def robot_of(topic: str, description: DescriptionOrWhy, states: Mapping[str, str]) -> Robot:
    """Return what a description, or why it is refused, and joint states say of a robot."""
    if isinstance(description, str):
        return Robot(topic, problem=description)
    joints: dict[str, list[str]] = {}
    masters = JointPositions(description).masters
    for joint in description.joints:
        if joint.name in masters:
            joints.setdefault(masters[joint.name], []).append(joint.child)
    return Robot(topic, '', description.root, description.links, joints, dict(states))
