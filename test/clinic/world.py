"""A small world: who sends what when, and what a lookup and `tf_doctor` say of it."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Optional
from unittest.mock import patch

from messages import recorded
from recorded import header_of

from puretf import TransformBuffer, TransformException
from puretf._causes.facts import Blocked, Heard, Publisher, Surroundings
from puretf._core.engine import engine_of
from puretf._core.pose import Pose
from puretf._wire import cdr
from puretf._wire.message_reader import MessageReader
from puretf.bag import BagMessage, Headers
from puretf_tools.doctor.observation import Observation
from puretf_tools.doctor.tf_statistics import Statistics
from puretf_tools.inspection import feeds
from puretf_tools.inspection.stamp_clock import StampClock
from puretf_tools.robot.observed import Robot

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
    stamp: Callable[[int], int] = lambda stamp: stamp  #: converts a stamp (ns)
    nanosec: Callable[[int], int] = lambda stamp: stamp % S  #: the field of a stamp (ns)
    pose: Callable[[int], Pose] = lambda number: STILL  #: by message
    type: str = TF
    lacks: str = ''  #: as `Publisher.lacks`; then nothing arrives
    has_ended: bool = False
    waits_for: str = ''  #: a topic that it reads, and nothing publishes
    takes: Callable[[int], float] = lambda number: 0.0  #: by message: from sending to arrival (s)
    is_lost: Callable[[int], object] = lambda number: False  #: by message

    @property
    def is_static(self) -> bool:
        return self.topic.endswith('_static')

    @property
    def parents(self) -> dict[str, str]:
        """By child: the parent."""
        return {child: parent for parent, _, child in (edge.partition(' ') for edge in self.edges)}

    def messages(self, publisher: str) -> list[BagMessage]:
        """Return what arrives."""
        count = round((self.end - self.begin) * self.rate) + 1 if self.rate else 1
        found = []
        for i in range(count) if self.edges else ():
            time = NOW + round((self.begin + (i / self.rate if self.rate else 0.0)) * S)
            stamp = self.stamp(time + round(self.offset * S))
            if not self.is_lost(i):
                data = cdr.pack_fields(
                    (stamp // S, self.nanosec(stamp), parent, child, self.pose(i))
                    for child, parent in self.parents.items())
                found.append(recorded(
                    time + round(self.takes(i) * S), data, self.is_static, publisher))
        return found


class Sensor(NamedTuple):
    """A publisher of other messages, such as scans."""

    node: str = '/lidar'
    topic: str = '/scan'
    frame: str = 'laser'
    rate: float = 10.0
    offset: float = 0.0
    begin: float = -20.0
    takes: float = 0.02  #: from the stamp to the arrival (s)
    stamp: Callable[[int], int] = lambda stamp: stamp

    def headers(self, clock: Callable[[int], int]) -> Headers:
        found = Headers()
        for i in range(round(-self.begin * self.rate)):
            time = NOW + round((self.begin + i / self.rate) * S)
            found.wants_next()
            found.add(time + round(self.takes * S), header_of(
                self.stamp(clock(time) + round(self.offset * S)), self.frame))
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


def joints(node: str) -> feeds.Sender:
    """Return a node that sends the joint turn."""
    sender = feeds.Sender(node)
    for time in NOW - 20 * S, NOW:
        sender.add(time, time, ['turn'])
    return sender


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
    sensors: Sequence[Sensor] = ()
    robots: Sequence[Robot] = ()
    use_sim_time: Mapping[str, bool] = {}  #: by node
    speed: float = 1.0  #: of the time on /clock
    other_user: str = ''  #: with processes in this domain
    clock_rate: float = 20.0  #: of /clock (Hz)
    cache_time: int = 10 * S
    late: Sequence[tuple[int, int]] = ()  #: when the program ran late, and by how much (ns)

    def messages(self) -> list[BagMessage]:
        """Return what arrives at a listener, in order."""
        return sorted((message for number, each in enumerate(self.senders)
                       if each.topic in self.topics and each.type == TF and not each.lacks
                       for message in each.messages(str(number)) if message.time <= NOW),
                      key=lambda each: each.time)

    def buffer(self, monotonic: Callable[[], int]) -> TransformBuffer:
        """Return the buffer of a program that has received what was sent."""
        buffer = TransformBuffer(self.cache_time)
        engine, reader = engine_of(buffer), MessageReader(print)
        engine.tree.takes_ns, engine.tree.needs_listener = False, True  # as a Buffer
        if self.has_listener:
            messages = self.messages()
            for each in messages:
                monotonic.return_value = each.time  # type: ignore[attr-defined]
                engine.insert_batches(reader.read([each.data], each.publisher if self.has_gids else
                                                  'default_authority', each.is_static))
            engine.look = lambda: self.surroundings(bool(messages))
            engine.find_blocked = lambda: self.blocked
        monotonic.return_value = NOW  # type: ignore[attr-defined]
        return buffer

    def time(self, arrival: int) -> int:
        """Return the time of nodes when it is `arrival` on the clock of the computer (ns)."""
        return arrival if self.clock is None else round(
            self.clock * S + (arrival - NOW) * self.speed)

    def observation(self) -> Observation:
        """Return what `tf_doctor` observes."""
        clock = StampClock(lambda: NOW)
        clock.is_simulated = self.clock is not None
        ticks = [NOW - round(i / self.clock_rate * S) for i in range(round(20 * self.clock_rate))]
        for time in ticks[::-1] if self.clock else ():
            clock.add(time, self.time(time))
        statistics = Statistics(clock=clock)
        statistics.add_messages(self.messages())
        others = [Heard(each.topic, str(number), [each.node], each.parents)
                  for number, each in enumerate(self.senders)
                  if each.edges and each.topic not in self.topics]
        nodes = {str(i): each.node for i, each in enumerate(self.senders)}
        clocks = [feeds.Sender(node) for node in self.clock_nodes]
        for each in clocks:
            for time in ticks[::-1]:
                each.add(time, self.time(time))
        static, dynamic = self.topics
        around = self.surroundings(statistics.count > 0)
        return Observation(
            statistics, 'in 20 s', (dynamic, static), nodes,
            {gid for gid, each in zip(nodes, self.senders) if not each.has_ended},
            headers={each.topic: each.headers(self.time) for each in self.sensors},
            senders={each.topic: [each.node] for each in self.sensors},
            volatile_listeners=[self.node] * self.is_volatile,
            robots=self.robots, joint_senders={
                topic: [joints(node) for node in nodes]
                for topic, nodes in self.joint_states.items()},
            joint_readers={topic: [each.node for each in self.senders]
                           for topic in self.joint_states},
            clocks=clocks, clock_stands=0.0 if self.speed else 20.0,
            use_sim_time=self.use_sim_time,
            other_transforms=others, around=around,
            end=self.time(NOW), ahead={
                gid: 0 for gid, each in zip(nodes, self.senders) if 0.1 < each.offset <= 1.0},
            not_known={} if self.clock != 0.0 else {'arrivals': 'nothing is on /clock'},
            tf_topics=[each.topic for each in others], late=self.late)

    def surroundings(self, has_data: bool) -> Surroundings:
        present = [(str(i), each) for i, each in enumerate(self.senders) if not each.has_ended]
        publishers = [Publisher(each.node, each.topic, each.type, gid, each.lacks)
                      for gid, each in present if each.topic in self.topics]
        return Surroundings(
            NOW if self.clock is None else round(self.clock * S), self.clock is not None,
            self.clock_nodes, self.topics, publishers,
            {str(i): each.node for i, each in enumerate(self.senders) if each.has_ended},
            self.is_volatile, has_data, self.is_new,
            [] if any(each.topic == self.topics[-1] for each in publishers) else [
                *dict.fromkeys(each.topic.removesuffix('_static') for _, each in present
                               if each.topic not in self.topics)],
            lambda: [Heard(each.topic, gid, [each.node], each.parents) for gid, each in present
                     if each.edges and each.type == TF and (each.is_static or each.end > -0.5)],
            {each.node: each.waits_for for _, each in present if each.waits_for},
            self.joint_states, lambda: 'ROS domain 7', lambda: self.other_user, self.node)

    def error_of(self, lookup: Lookup) -> Optional[TransformException]:
        """Return the error of a lookup, whose text was read; None: there is none."""
        with patch('puretf._core.failures.monotonic_ns') as monotonic, patch(
                'puretf._core.insertion.monotonic_ns', monotonic):
            buffer = self.buffer(monotonic)
            now = 0 if self.clock is None else round(self.clock * S) - NOW
            time = 0 if lookup.at is None else NOW + now + round(lookup.at * S)
            try:
                buffer.lookup_transform(lookup.target, lookup.source, time,
                                        timeout=round(lookup.waited * S))
            except TransformException as error:
                str(error)
                return error
        return None
