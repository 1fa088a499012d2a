"""A small world: who sends which transforms when, and what a lookup in the middle of it says."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Optional
from unittest.mock import patch

from puretf import TransformBuffer, TransformException
from puretf._causes.facts import Blocked, Heard, Publisher, Surroundings
from puretf._core.engine import engine_of

S = 10**9
#: The present time, on the clock of this computer (ns).
NOW = 1_700_000_000 * S
TF = 'tf2_msgs/msg/TFMessage'
STILL = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0


class Sender(NamedTuple):
    """A publisher of transforms; times are in s, and count from now."""

    node: str
    edges: Sequence[str] = ()  #: such as 'odom base_link'; (): it has sent nothing
    rate: float = 20.0  #: (Hz); 0: it sends once, at the begin
    topic: str = '/tf'
    offset: float = 0.0  #: of the stamps from the time at which they are sent
    begin: float = -20.0
    end: float = 0.0
    stamp: Optional[Callable[[int], int]] = None  #: converts a stamp (ns)
    pose: tuple[float, ...] = STILL
    type: str = TF
    lacks: str = ''  #: as `Publisher.lacks`; then nothing arrives
    has_ended: bool = False
    waits_for: str = ''  #: a topic that it reads, and nothing publishes

    @property
    def is_static(self) -> bool:
        return self.topic.endswith('_static')

    def messages(self) -> list[tuple[int, int]]:
        """Return when messages arrive, and their stamps (ns)."""
        if not self.edges:
            return []
        count = round((self.end - self.begin) * self.rate) + 1 if self.rate else 1
        found = []
        for i in range(count):
            time = NOW + round((self.begin + (i / self.rate if self.rate else 0.0)) * S)
            stamp = time + round(self.offset * S)
            found.append((time, self.stamp(stamp) if self.stamp else stamp))
        return found


class Lookup(NamedTuple):
    """A lookup of a program, and what its error says."""

    target: str
    source: str
    causes: Optional[Sequence[str]] = ()  #: the codes; None: there is no error
    words: Sequence[str] = ()  #: what is in the text
    at: Optional[float] = None  #: the time, from now on (s); None: the latest one
    waited: float = 0.0  #: the timeout of the lookup (s)
    not_words: Sequence[str] = ()


class World(NamedTuple):
    """What is sent, and what surrounds the listener."""

    senders: Sequence[Sender]
    clock_nodes: Sequence[str] = ()
    clock: Optional[float] = None  #: the time on /clock now (s); None: use_sim_time is not set
    topics: Sequence[str] = ('/tf_static', '/tf')
    joint_states: Mapping[str, Sequence[str]] = {}  #: by topic: the nodes that publish it
    has_listener: bool = True
    has_gids: bool = False  #: whether the listener knows who has sent a transform
    is_new: bool = False
    is_volatile: bool = False
    node: str = '/laptop'
    blocked: Mapping[str, Blocked] = {}

    def buffer(self, monotonic: Callable[[], int], cache_time: int = 10 * S) -> TransformBuffer:
        """Return the buffer of a program that has received what was sent."""
        buffer = TransformBuffer(cache_time)
        engine = engine_of(buffer)
        engine.tree.needs_listener = True
        arrivals = sorted((time, number, stamp) for number, sender in enumerate(self.senders)
                          if sender.topic in self.topics and sender.type == TF
                          and not sender.lacks for time, stamp in sender.messages())
        for time, number, stamp in arrivals if self.has_listener else ():
            sender = self.senders[number]
            monotonic.return_value = time  # type: ignore[attr-defined]
            for edge in sender.edges:
                parent, child = edge.split(' ')
                pose: Any = sender.pose
                buffer.insert(stamp, parent, child, pose, str(number) if self.has_gids else
                              'default_authority', sender.is_static)
        monotonic.return_value = NOW  # type: ignore[attr-defined]
        if self.has_listener:
            engine.look = lambda: self.surroundings(bool(arrivals))
            engine.find_blocked = lambda: self.blocked
        return buffer

    def surroundings(self, has_data: bool) -> Surroundings:
        present = [(str(i), each) for i, each in enumerate(self.senders) if not each.has_ended]
        publishers = [Publisher(each.node, each.topic, each.type, gid, each.lacks)
                      for gid, each in present if each.topic in self.topics]
        return Surroundings(
            NOW if self.clock is None else round(self.clock * S), self.clock is not None,
            NOW, self.clock_nodes, self.topics, publishers,
            {str(i): each.node for i, each in enumerate(self.senders) if each.has_ended},
            self.is_volatile, any(each.topic == self.topics[-1] for each in publishers),
            has_data, self.is_new,
            [*dict.fromkeys(each.topic.removesuffix('_static') for _, each in present
                            if each.topic not in self.topics)],
            lambda: [Heard(each.topic, gid, [each.node], dict(
                edge.split(' ')[::-1] for edge in each.edges)) for gid, each in present
                if each.edges and each.type == TF and (each.is_static or each.end > -0.5)],
            {each.node: each.waits_for for _, each in present if each.waits_for},
            self.joint_states, 7, node=self.node)

    def error_of(self, lookup: Lookup, cache_time: int = 10 * S) -> Optional[TransformException]:
        """Return the error of a lookup, whose text was read; None: there is none."""
        with patch('puretf._core.failures.monotonic_ns') as monotonic, patch(
                'puretf._core.insertion.monotonic_ns', monotonic):
            buffer = self.buffer(monotonic, cache_time)
            now = 0 if self.clock is None else round(self.clock * S) - NOW
            time = 0 if lookup.at is None else NOW + now + round(lookup.at * S)
            try:
                buffer.lookup_transform(lookup.target, lookup.source, time,
                                        timeout=round(lookup.waited * S))
            except TransformException as error:
                str(error)
                return error
        return None
