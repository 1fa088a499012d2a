"""What `tf_doctor` observes beside transforms: who feeds them, and what other topics have."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

from puretf import comma_list, may_be_one_robot, namespace_distance, quoted

#: The largest number of nodes in a text, of publishers of a topic, and of joints of one of them.
_SHOWN, _MOST_PUBLISHERS, _MOST_NAMES = 5, 1000, 10_000


class Sender:
    """The messages of one publisher on a topic."""

    def __init__(self, node: str = '') -> None:
        self.node = node  #: the full name of its node
        self.names: set[str] = set()  #: of joint states: the joints that it sends
        self.count = 0
        self.first = self.last = 0  #: the times of arrival of the first and the last message (ns)
        self.stamp = 0  #: the last stamp (ns)

    def add(self, arrival: int, stamp: int, names: Collection[str] = ()) -> None:
        self.first, self.last, self.stamp = self.first or arrival, arrival, stamp
        self.count += 1
        if len(self.names) < _MOST_NAMES:
            self.names.update(names)

    @property
    def offset(self) -> int:
        """The last stamp minus its time of arrival (ns)."""
        return self.stamp - self.last


class Senders(dict[str, Sender]):
    """The publishers of a topic, by their gids."""

    def add(self, gid: str, arrival: int, stamp: int, names: Collection[str] = ()) -> None:
        """Count a message, unless there are too many publishers."""
        if gid in self or len(self) < _MOST_PUBLISHERS:
            self.setdefault(gid, Sender()).add(arrival, stamp, names)

    def named(self, names_of: Callable[[Collection[str]], Mapping[str, str]]) -> list[Sender]:
        """Return the senders; `names_of` returns by gid the full names of their nodes."""
        for gid, name in names_of(self).items():
            self[gid].node = name
        return [*self.values()]


def rivals(senders: Sequence[Sender]) -> list[Sender]:
    """Return the senders that send at the same time as another one, not after it."""
    return [a for a in senders if any(
        a is not b and max(a.first, b.first) <= min(a.last, b.last) for b in senders)]


class OtherTopic(NamedTuple):
    """The transforms on another topic than those that are observed."""

    topic: str
    parents: Mapping[str, str]  #: by child: the newest parent
    nodes: Sequence[str]  #: the full names of the nodes that have sent them


class Half(NamedTuple):
    """Topics whose transforms continue the tree on others."""

    base: str  #: the topic of the dynamic transforms among these topics
    topics: list[str]
    nodes: list[str]
    frames: set[str]
    #: The frame that both have: a child on the one side, and a root on the other.
    joint: str
    is_root_here: bool


def halves(parents: Mapping[str, str], base: str, others: Sequence[OtherTopic]) -> list[Half]:
    """
    Return the topics that have a part of the same tree, since not all nodes are remapped alike.

    The whole tree of another robot has the same children, or no frame in common, or the same root.
    Neither do two namespaces beside each other belong to one robot, unless one is misspelt. If a
    frame is the root in several namespaces, these are robots that share it, such as a map.

    :param parents: by child on the topics that are observed: the parent.
    :param base: the topic of the dynamic ones of these.
    """
    groups = [(name, group, {child: parent for other in group
                             for child, parent in other.parents.items()})
              for name, group in _by_distance(others, base)]
    trees = [parents, *(merged for _, _, merged in groups)]
    roots = [frame for tree in trees for frame in {*tree.values()} - tree.keys()]
    found = []
    for name, group, merged in groups:
        if merged.keys() & parents.keys() or not may_be_one_robot(name, base):
            continue
        here = {*parents.values()} & merged.keys()
        joints = sorted(joint for joint in here | {*merged.values()} & parents.keys()
                        if roots.count(joint) < 2)
        if joints:
            found.append(Half(
                name, sorted(other.topic for other in group),
                sorted({node for other in group for node in other.nodes}),
                {*merged, *merged.values()}, joints[0], joints[0] in here))
    return found


def _by_distance(others: Sequence[OtherTopic], base: str) -> list[tuple[str, list[OtherTopic]]]:
    """Group topics by that of the dynamic transforms, the nearest ones first."""
    groups: dict[str, list[OtherTopic]] = {}
    for other in others:
        groups.setdefault(other.topic.removesuffix('_static'), []).append(other)
    return sorted(groups.items(), key=lambda item: (
        namespace_distance(*(name.rpartition('/')[0] for name in (item[0], base))), item[0]))


def half_text(half: Half, topics: Sequence[str], nodes: Sequence[str]) -> str:
    """Say which frame connects two halves; `topics`, `nodes`: where it is on this side."""
    here, there = (
        f'{" and ".join(each)}{f" ({comma_list(names, _SHOWN)})" if names else ""}'
        for each, names in ((topics, nodes), (half.topics, half.nodes)))
    root, child = (here, there) if half.is_root_here else (there, here)
    return (f'{quoted(half.joint)} is a root on {root}, and has a parent on {child}: each has a '
            'part of one tree')
