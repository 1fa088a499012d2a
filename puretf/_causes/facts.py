"""What is known of a lookup that has failed: of its buffer, and of what surrounds it."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
import re
from types import MappingProxyType
from typing import NamedTuple, Optional

from puretf._text.names import TF_MESSAGE
from puretf._text.similar_names import near_names
from puretf._text.times import is_frozen, SECOND

#: The symptoms of a lookup: a frame does not exist; two trees; a time before or after the data, or
#: beside the only stamp; an edge without data, since the buffer was cleared; and, without a
#: lookup, that nothing arrives; or none, since `tf_doctor` asks.
MISSING, UNCONNECTED, PAST, FUTURE, ONE_TIME, CLEARED, SILENCE, NONE = (
    'missing', 'unconnected', 'past', 'future', 'one_time', 'cleared', 'silence', 'none')
#: Times that are farther apart (ns) are from two clocks.
OTHER_CLOCK = 60 * SECOND
#: The name of a publisher whose node is not known.
UNKNOWN = 'unknown publisher'
#: Data still arrive if this time (ns), or one and a half periods of the edge, is not over. Up to
#: this time after the newest stamp, a transform is on its way.
RECENT = SECOND


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

    @property
    def base(self) -> str:
        """The topic of the dynamic transforms that belongs to this one."""
        return self.topic.removesuffix('_static')


class Blocked(NamedTuple):
    """A node that cannot call back while a lookup waits."""

    why: str  #: the reason
    remedy: str
    children: Collection[str]  #: the frames that it has broadcast


class Waited(NamedTuple):
    """How a lookup has waited in vain."""

    seconds: float
    blocked: Mapping[str, Blocked] = MappingProxyType({})  #: by the full name of the node


class Surroundings(NamedTuple):
    """What the listener and its node know, as of when the text is read; None: not known."""

    now: Optional[int] = None  #: the time of the node (ns); 0: /clock has not arrived
    is_simulated: bool = False  #: whether the clock of the node is simulated
    system_now: int = 0  #: the time of the system clock (ns)
    clock_nodes: Optional[Sequence[str]] = None  #: the nodes that publish on /clock
    #: The topics of the listener: of static transforms, and of dynamic ones. Empty: there is no
    #: listener, so nothing is known of publishers.
    topics: Sequence[str] = ()
    publishers: Optional[Sequence[Publisher]] = None  #: all publishers on these topics
    ended: Mapping[str, str] = MappingProxyType({})  #: by gid: the nodes of ended publishers
    is_volatile: bool = False  #: True if the subscription to static transforms is volatile
    is_fed: bool = False  #: whether the topic of dynamic transforms has data or a publisher
    has_data: bool = False  #: whether any transform was received
    is_new: bool = False  #: whether the listener may not have discovered all publishers yet
    #: Other topics with publishers of transforms, without the ending '_static', the nearest first.
    other_topics: Sequence[str] = ()
    #: Listens for a moment to all topics of transforms; None: it cannot.
    listen: Optional[Callable[[], Sequence[Heard]]] = None
    #: By node: a topic that it reads, /clock or that of joint states, and nothing publishes.
    waits_for: Mapping[str, str] = MappingProxyType({})
    joint_states: Mapping[str, Sequence[str]] = MappingProxyType({})  #: by topic: its publishers
    domain: int = 0  #: the ROS domain
    #: Returns a sentence on other ROS domains with processes of this machine; '' if there is none.
    other_domains: Callable[[], str] = str
    #: Returns another user whose processes are in this domain, on this machine, with Fast DDS.
    other_user: Callable[[], str] = str
    hides_others: str = ''  #: the environment variable that hides other machines, and its value
    node: str = ''  #: the full name of the listener's node

    def nodes(self, topic: str) -> list[str]:
        """Return the nodes that publish transforms on a topic."""
        return sorted({each.node for each in self.publishers or ()
                       if each.topic == topic and each.type == TF_MESSAGE})

    def node_of(self, authority: str) -> str:
        """Return the node of a publisher, by its gid; '' if it is not known."""
        return next((each.node for each in self.publishers or () if each.gid == authority),
                    self.ended.get(authority, ''))


#: Returns the surroundings; does not raise, and may take long.
Look = Callable[[], Surroundings]


class Parent(NamedTuple):
    """A parent that a frame has, or had."""

    name: str
    authority: str  #: the publisher
    is_static: bool


@dataclass(frozen=True)
class Refusal:
    """The transforms of a frame that were refused for one reason."""

    reason: str  #: the code of the cause, such as 'not_a_number'
    count: int
    authority: str  #: the publisher of the last one


class Edge(NamedTuple):
    """The edge without data for the time of a lookup, as of the failure; times are in ns."""

    parent: str
    child: str
    samples: int  #: their number
    oldest: int
    latest: int
    cache_time: int
    has_dropped: bool  #: True if it may have had older samples
    authority: str  #: the publisher
    silence: int  #: since the last transform of the child has arrived
    repeated: int  #: the number of transforms that have arrived again
    refused: int  #: the number of transforms that were older than the cache
    refused_stamp: int  #: the stamp of the last one
    refused_authority: str  #: its publisher
    is_refusing: bool  #: True if the last one was refused
    nanosec: int = 0  #: a `nanosec` of its stamps that is 10**9 or more; 0: there is none
    is_full: bool = False  #: True if samples were dropped since there were too many
    stalled: int = 0  #: from the arrival of the newest stamp to that of the last transform
    offsets: Sequence[int] = ()  #: the newest stamp minus its arrival, in each of some seconds

    @property
    def period(self) -> int:
        return min((self.latest - self.oldest) // max(self.samples - 1, 1), OTHER_CLOCK)

    @property
    def spread(self) -> int:
        """By how much stamps minus arrivals have varied in the last seconds."""
        return max(self.offsets) - min(self.offsets) if self.offsets else 0

    @property
    def still_arrives(self) -> bool:
        """Whether transforms arrive, as often as before; stamps may be from another clock."""
        is_regular = self.samples > 2 or self.has_dropped
        return self.silence <= max(RECENT, 3 * self.period // 2 * is_regular)

    @property
    def is_frozen(self) -> bool:
        """Whether several transforms have arrived, all with the same stamp."""
        return is_frozen(self.oldest, self.latest, self.samples + self.repeated)


class Frames(NamedTuple):
    """What a buffer knows of its frames, as of when the text is read; needs no lock."""

    names: Sequence[str] = ()
    newest: Mapping[str, str] = MappingProxyType({})  #: by child: the newest parent
    changed: Sequence[str] = ()  #: the frames that have had several parents
    #: Returns the parent of a frame, and before it those that it has, too.
    parents: Callable[[str], Sequence[Parent]] = lambda name: ()
    #: Returns what was refused of a frame.
    refusals: Callable[[str], Sequence[Refusal]] = lambda name: ()
    missing_part: tuple[str, str] = '', ''  #: which part of a bag is missing, and the remedy
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

    symptom: str
    around: Surroundings
    buffer: Frames = field(default_factory=Frames)
    names: tuple[str, ...] = ()  #: the frames of the lookup: target and source, or a missing one
    roots: tuple[str, ...] = ()  #: those of two trees
    time: int = 0  #: that of the lookup (ns)
    edge: Optional[Edge] = None
    waited: Optional[Waited] = None
    is_duration: bool = False  #: True if a Duration was passed as a time

    @cached_property
    def not_known(self) -> set[str]:
        """What no rule may need."""
        found = {name for name, value in self.around._asdict().items() if value is None}
        return found | {'listener'} if not self.around.topics else found

    @cached_property
    def has_near_name(self) -> bool:
        """Whether the missing frame has almost the name of another one."""
        return self.symptom == MISSING and any(
            re.findall(r'\d+', name) == re.findall(r'\d+', self.names[0])
            for name in near_names(self.names[0], self.buffer.names, cutoff=0.8))

    @cached_property
    def heard(self) -> Sequence[Heard]:
        """What publishers have sent while one listened for a moment, once."""
        return self.around.listen() if self.around.listen else ()

    def has_sent(self, node: str) -> bool:
        return any(node in each.nodes for each in self.heard)
