"""What is known of a lookup that has failed: of its buffer, and of what surrounds it."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple

from puretf._text.names import comma_list, shortened, TF_MESSAGE
from puretf._text.times import SECOND

#: The symptoms of a lookup: a frame does not exist, or has almost the name of another one; two
#: trees; a time before the data, or after them; an edge without data, since the buffer was
#: cleared; and, without a lookup, that nothing arrives; or none, since `tf_doctor` asks.
Symptom = Literal['missing', 'typo', 'unconnected', 'past', 'future', 'cleared', 'silence', 'none']
#: Times that are farther apart (ns) are from two clocks.
OTHER_CLOCK = 60 * SECOND
#: The name of a publisher whose node is not known.
UNKNOWN = 'unknown publisher'
#: Data still arrive if this time (ns), or one and a half periods of the edge, is not over. Up to
#: this time after the newest stamp, a transform is on its way.
RECENT = SECOND


def listed(names: Iterable[str]) -> str:
    """Join names, as many as a text has."""
    return comma_list([*names], shortened)


class Publisher(NamedTuple):
    """A publisher on a topic of a listener."""

    node: str  #: the full name of its node
    topic: str
    type: str  #: such as TF_MESSAGE
    gid: str  #: in hex
    lacks: str = ''  #: what the listener's QoS requires: 'reliable' or 'transient local'


class Heard(NamedTuple):
    """What one publisher of transforms has sent, while one listened for a moment."""

    topic: str
    gid: str  #: of the publisher, in hex; '' if it is not known
    nodes: Sequence[str]  #: its node; if that is not known: those that publish on the topic
    parents: Mapping[str, str]  #: by child: the parent


class Blocked(NamedTuple):
    """A node that cannot call back while a lookup waits."""

    why: str  #: the reason
    remedy: str
    children: Collection[str]  #: the frames that it has broadcast


class Waited(NamedTuple):
    """How a lookup has waited in vain."""

    seconds: float = 0.0  #: 0: it has not waited
    blocked: Mapping[str, Blocked] = MappingProxyType({})  #: by the full name of the node


class Surroundings(NamedTuple):
    """What the listener and its node know, as of when the text is read."""

    now: int = 0  #: the time of the node (ns); 0: it is not known, or /clock has not arrived
    is_simulated: bool = False  #: whether the clock of the node is simulated
    clock_nodes: Sequence[str] = ()  #: the nodes that publish on /clock
    #: The topics of the listener: of static transforms, and of dynamic ones. Empty: there is no
    #: listener, so nothing is known of publishers.
    topics: Sequence[str] = ()
    publishers: Sequence[Publisher] = ()  #: all publishers on these topics
    ended: Mapping[str, str] = MappingProxyType({})  #: by gid: the nodes of ended publishers
    is_volatile: bool = False  #: True if the subscription to static transforms is volatile
    has_data: bool = False  #: whether any transform was received
    is_new: bool = False  #: whether the listener may not have discovered all publishers yet
    #: Other topics with publishers of transforms, without the ending '_static', the nearest first;
    #: if neither data nor a publisher is on the topic of dynamic transforms.
    other_topics: Sequence[str] = ()
    #: Listens for a moment to all topics of transforms.
    listen: Callable[[], Sequence[Heard]] = tuple
    #: By node: a topic that it reads, /clock or that of joint states, and nothing publishes.
    waits_for: Mapping[str, str] = MappingProxyType({})
    joint_states: Mapping[str, Sequence[str]] = MappingProxyType({})  #: by topic: its publishers
    #: Names the ROS domain, other ones on this machine, and what hides other machines.
    domain: Callable[[], str] = str
    #: Returns another user whose processes are in this domain, on this machine, with Fast DDS.
    other_user: Callable[[], str] = str
    node: str = ''  #: the full name of the listener's node

    def nodes(self, topic: str) -> list[str]:
        """Return the nodes that publish transforms on a topic."""
        return sorted({each.node for each in self.publishers
                       if each.topic == topic and each.type == TF_MESSAGE})

    def node_of(self, authority: str) -> str:
        """Return the node of a publisher, by its gid; '' if it is not known."""
        return next((each.node for each in self.publishers if each.gid == authority),
                    self.ended.get(authority, ''))


#: Returns the surroundings; does not raise, and may take long.
Look = Callable[[], Surroundings]


class Parent(NamedTuple):
    """A parent that a frame has, or had."""

    name: str
    authority: str  #: the publisher
    is_static: bool


class Edge(NamedTuple):
    """The edge without data for the time of a lookup, as of the failure; times are in ns."""

    parent: str = ''
    child: str = ''  #: '': the lookup did not fail at an edge
    samples: int = 0  #: their number
    oldest: int = 0
    latest: int = 0
    cache_time: int = 0
    has_dropped: bool = False  #: True if it may have had older samples
    is_full: bool = False  #: True if samples were dropped since there were too many
    shorter: str = ''  #: the child of another edge, whose newest stamp is the time of the lookup
    is_frozen: bool = False  #: True if several transforms have arrived, all with the same stamp
    authority: str = ''  #: the publisher
    silence: int = 0  #: since the last transform of the child has arrived
    stalled: int = 0  #: from the arrival of the newest stamp to that of the last transform
    offsets: Sequence[int] = ()  #: the newest stamp minus its arrival, in some seconds
    refused: int = 0  #: the number of transforms that were older than the cache
    refused_stamp: int = 0  #: the stamp of the last one
    refused_authority: str = ''  #: its publisher
    is_refusing: bool = False  #: True if the last one was refused

    @property
    def period(self) -> int:
        """The mean time between samples (ns), at least 1."""
        mean = (self.latest - self.oldest) // max(self.samples - 1, 1)
        return max(min(mean, OTHER_CLOCK), 1)


NO_EDGE = Edge()


class Frames(NamedTuple):
    """What a buffer knows of its frames, as of when the text is read; needs no lock."""

    names: Sequence[str] = ()
    newest: Mapping[str, str] = MappingProxyType({})  #: by child: the newest parent
    changed: Sequence[str] = ()  #: the frames that have had several parents
    #: Returns the parent of a frame, and before it those that it has, too.
    parents: Callable[[str], Sequence[Parent]] = lambda name: ()
    #: Returns how many transforms of a frame were refused (of `nanosec`: its value), and the
    #: publisher of the last one, by the code of the cause.
    refusals: Callable[[str], Mapping[str, tuple[int, str]]] = lambda name: {}
    missing_part: str = ''  #: which part of a bag is missing, and what to do
    takes_ns: bool = False  #: True if the times of the buffer are integers
    needs_listener: bool = False  #: True if only a listener is expected to fill the buffer

    def chain(self, name: str) -> list[str]:
        """Return a frame and those above it, by their newest parents."""
        found = {name: None}
        while (name := self.newest.get(name, '')) and name not in found:
            found[name] = None
        return [*found]


@dataclass(frozen=True)
class Facts:
    """All that is known when the text of an error is read."""

    symptom: Symptom
    around: Surroundings
    buffer: Frames = field(default_factory=Frames)
    names: tuple[str, ...] = ()  #: the frames of the lookup: target and source, or a missing one
    roots: tuple[str, ...] = ()  #: those of two trees
    time: int = 0  #: that of the lookup (ns)
    edge: Edge = NO_EDGE
    waited: Waited = field(default_factory=Waited)
    is_duration: bool = False  #: True if a Duration was passed as a time

    @cached_property
    def heard(self) -> Sequence[Heard]:
        """What publishers have sent while one listened for a moment, once."""
        return self.around.listen()

    def has_sent(self, node: str) -> bool:
        return any(node in each.nodes for each in self.heard)

    @property
    def arrives(self) -> bool:
        """Whether transforms of the edge arrive, as often as before."""
        edge, around = self.edge, self.around
        is_regular = edge.samples > 2 or edge.has_dropped
        return bool(edge.silence <= max(RECENT, 3 * edge.period // 2 * is_regular)
                    and edge.child and edge.authority not in around.ended
                    and around.topics and around.nodes(around.topics[-1]))

    @property
    def offset(self) -> int:
        """The newest stamp at its arrival minus the clock of the node (ns); 0: not known."""
        edge, around = self.edge, self.around
        newest = edge.refused_stamp if edge.is_refusing else edge.latest + edge.stalled
        offset = newest + edge.silence - around.now if edge.child and around.now else 0
        # A simulated clock has not the rate of `silence`.
        return 0 if around.is_simulated and abs(offset) <= OTHER_CLOCK else offset
