"""Robots as their descriptions and joint states show them: the frames of their links."""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

#: The largest number of links that find the prefix, and of prefixes that are tried.
_MOST_LINKS, _MOST_PREFIXES = 1000, 10


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
    #: The links of floating and planar joints, which robot_state_publisher does not send; also
    #: the root, if it has no other joints.
    floating: Collection[str] = ()


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
