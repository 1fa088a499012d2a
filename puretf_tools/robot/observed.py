"""Robots as their descriptions and joint states show them: the frames of their links."""

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Union

from puretf.bag import BagMessage
from puretf_tools.robot.description import Description, mimic_rules, parse
from puretf_tools.robot.urdf_text import DescriptionError, MAX_SIZE

#: The last part of the names of the topics with descriptions.
TOPIC = 'robot_description'
STRING = 'std_msgs/msg/String'
JOINT_STATE = 'sensor_msgs/msg/JointState'
#: The largest number of topics with descriptions at a time.
MOST_TOPICS = 20
#: The largest number of topics with joint states, of names of joints that are kept of a topic,
#: and of characters of a name.
_MOST_TOPICS, _MOST_NAMES, _LONGEST_NAME = 100, 10_000, 1000
#: The largest number of links that find the prefix, and of prefixes that are tried.
_MOST_LINKS, _MOST_PREFIXES = 1000, 10
#: A description, or why it is refused (one line).
DescriptionOrWhy = Union[Description, str]


class Robot(NamedTuple):
    """What `tf_doctor` must know of a robot."""

    topic: str  #: the topic of its description
    problem: str = ''  #: why the description is refused, and nothing else is known
    root: str = ''  #: the link at the root
    links: Sequence[str] = ()
    #: By movable joint, except those that mimic another one: the links that it moves, directly or
    #: by joints that mimic it.
    joints: Mapping[str, Sequence[str]] = {}
    #: By joint that was received: why robot_state_publisher ignores all messages with it, or ''.
    states: Mapping[str, str] = {}
    elsewhere: Sequence[str] = ()  #: other topics with states of these joints
    #: The links of floating joints, which robot_state_publisher does not send; also the root, if
    #: it has no other joints.
    floating: Collection[str] = ()


def parsed(text: str) -> DescriptionOrWhy:
    try:
        return parse(text)
    except DescriptionError as error:
        return str(error)


class RobotsInBag:
    """The robots of a bag, from the messages that `Bag.messages` yields for `wanted`."""

    wanted = (STRING, TOPIC), (JOINT_STATE, 'joint_states')

    def __init__(self) -> None:
        self._texts: dict[str, str] = {}
        self._states: dict[str, dict[str, str]] = {}
        self._is_full = ''  #: the first topic with a description that is left out

    def add(self, message: BagMessage) -> None:
        """Note what a message says of a robot; leave out what cannot be decoded."""
        topic, decoded = message.topic.name, message.decoded()
        if decoded is None:
            return
        if message.topic.msgtype == JOINT_STATE:
            if topic in self._states or len(self._states) < _MOST_TOPICS:
                receive(self._states.setdefault(topic, {}), decoded)
        elif topic in self._texts or len(self._texts) < MOST_TOPICS:
            self._texts[topic] = decoded.data[:MAX_SIZE + 1]  # which is refused as too long
        else:
            self._is_full = self._is_full or topic

    @cached_property
    def descriptions(self) -> dict[str, DescriptionOrWhy]:
        """The last description on each topic, or why it is refused; once all are added."""
        return {**{topic: parsed(text) for topic, text in self._texts.items()}, **(
            {self._is_full: f'left out, with any further ones: at most {MOST_TOPICS} are read'}
            if self._is_full else {})}

    def robots(self) -> list[Robot]:
        return [robot_of(topic, each, self._states)
                for topic, each in self.descriptions.items()]


def receive(states: dict[str, str], message: Any) -> None:
    """Note which joints are in a JointState, and whether robot_state_publisher ignores it."""
    stamp = message.header.stamp
    why = ('have the stamp 0' if not (stamp.sec or stamp.nanosec) else
           'do not have a position for each name'
           if len(message.name) != len(message.position) else '')
    if len(states) < _MOST_NAMES:
        for name in message.name[:_MOST_NAMES]:
            if len(name) <= _LONGEST_NAME:
                states[name] = why and states.get(name, why)


def robot_of(topic: str, description: DescriptionOrWhy, states: Mapping[str, Mapping[str, str]]
             ) -> Robot:
    """Return what a description, or why it is refused, and joint states say of a robot."""
    if isinstance(description, str):
        return Robot(topic, problem=description)
    joints: dict[str, list[str]] = {}
    rules = mimic_rules(description.joints)
    for joint in description.joints:
        if joint.name in rules:
            joints.setdefault(rules[joint.name].joint, []).append(joint.child)
    floating = {joint.child for joint in description.joints if joint.kind == 'floating'}
    if floating.issuperset(joint.child for joint in description.joints
                           if joint.parent == description.root):
        floating.add(description.root)
    own = joint_states_of(topic)
    return Robot(topic, '', description.root, description.links, joints, dict(states.get(own, {})),
                 [other for other, names in states.items()
                  if other != own and not joints.keys().isdisjoint(names)], floating)


def prefix(topic: str, root: str, links: Sequence[str], frames: Collection[str]
           ) -> tuple[str, int]:
    """
    Return what stands before the names of a robot's links in those of its frames.

    It is the namespace of the topic, if a link is found with it; else '', or what stands before
    the root in a frame: that with which most links are found, and of several, one that begins with
    the namespace. The second value is the number of the links that are found, at most
    `_MOST_LINKS`.
    """
    namespace = topic.rpartition('/')[0].strip('/')
    links = links[:_MOST_LINKS]
    found = sorted({'', *(frame.removesuffix(root) for frame in frames if frame.endswith(root))},
                   key=lambda each: (not each.startswith(namespace), each))
    counts = {each: sum(each + link in frames for link in links) for each in (
        f'{namespace}/' if namespace else '', *found[:_MOST_PREFIXES])}
    own, count = next(iter(counts.items()))
    return (own, count) if namespace and count else max(counts.items(), key=lambda item: item[1])


def joint_states_of(topic: str) -> str:
    """Return the topic of the joint states in the namespace of another topic of a robot."""
    return f'{topic.rpartition("/")[0]}/joint_states'
