"""The data that are checked: statistics of the transforms, and facts about their publishers."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from operator import itemgetter
from typing import Any, Optional, TYPE_CHECKING, Union

import numpy as np
from numpy.typing import NDArray

from puretf._causes.clocks import is_off
from puretf._causes.facts import Facts, Frames, Heard, Parent, Publisher, Surroundings
from puretf._text.names import comma_list, namespace_path, SHOWN, TF_MESSAGE
from puretf._text.times import exact_time, SECOND
from puretf.bag import Bag, BagMessage, Headers, NOT_RECORDED
from puretf.transform_buffer import CACHE_TIME
from puretf_tools.doctor.message_times import judge, MessageTimes
from puretf_tools.doctor.stream import Availability, FEWEST, GAP, NEVER, SHORTEST_GAP, Stream
from puretf_tools.doctor.tf_statistics import Statistics, Track
from puretf_tools.inspection.feeds import Sender
from puretf_tools.inspection.gaps import in_words
from puretf_tools.inspection.traffic import recreated
from puretf_tools.robot.observed import prefix, Robot, RobotsInBag

if TYPE_CHECKING:
    from puretf_tools.inspection.frame_listener import FrameListener

#: Messages of a bag are counted when this number of them, or of their bytes, has been read.
_MOST_WAITING, _MOST_BYTES = 2000, 1_000_000
#: The computer was busy in a gap of at most `_LONGEST_BUSY` (ns) if this program has lost this
#: part of it and of what is `_AROUND` it (ns).
_BUSY, _LONGEST_BUSY, _AROUND = 0.05, 3 * SECOND, 2 * SECOND


@dataclass
class Observation:
    """The transforms received or recorded within some time, and their publishers."""

    statistics: Statistics
    where: str  #: where the transforms are from, such as 'in 5 s'
    topics: tuple[str, str] = ('/tf', '/tf_static')  #: of dynamic and of static transforms
    #: By publisher: the full name of its node.
    nodes: Mapping[str, str] = field(default_factory=dict)
    present: Optional[Collection[str]] = None  #: the publishers that exist at the end; None: all
    volatile_listeners: Sequence[str] = ()  #: nodes that subscribe to /tf_static, volatile
    headers: Mapping[str, Headers] = field(default_factory=dict)  #: by topic
    #: By topic with headers: the full names of the nodes that publish it, if known.
    senders: Mapping[str, Sequence[str]] = field(default_factory=dict)
    robots: Sequence[Robot] = ()  #: those with a description
    #: By topic of joint states: the publishers that have sent some, and the nodes that read them.
    joint_senders: Mapping[str, Sequence[Sender]] = field(default_factory=dict)
    joint_readers: Mapping[str, Sequence[str]] = field(default_factory=dict)
    clocks: Sequence[Sender] = ()  #: the publishers on /clock
    #: When the time on /clock has jumped back, so that buffers of nodes that use it were cleared
    #: (ns, on the clock of the arrivals).
    clears: Sequence[int] = ()
    #: By node: whether it uses /clock, if it has answered. Tools are left out.
    use_sim_time: Mapping[str, bool] = field(default_factory=dict)
    tf_listeners: Collection[str] = ()  #: the nodes that subscribe to the dynamic transforms
    other_transforms: Sequence[Heard] = ()  #: what was received on the other topics
    tf_topics: Collection[str] = ()  #: the other topics with transforms
    #: What is not known, and why; see `Rule.needs`.
    not_known: dict[str, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)  #: what was not counted, and why
    missing_part: str = ''  #: which part of a recording is missing, with the static transforms
    #: Within which times (ns) a part of a recording is missing or damaged.
    missing_spans: Sequence[tuple[int, int]] = ()
    #: True if the arrivals are times of a recording, which may be on another clock than all stamps
    has_record_times: bool = False
    #: What the ROS graph shows; of a bag, its topics.
    around: Surroundings = field(default_factory=Surroundings)
    end: int = 0  #: the end of the observation (ns), on the clock of the stamps; 0: not known
    #: Of a live system, by publisher: by how much the clock of its computer is ahead of this one
    #: (ns), as far as the dates of its messages tell.
    ahead: Mapping[str, int] = field(default_factory=dict)
    clock_text: str = ''  #: that the clock of the stamps is /clock; '': it is not
    #: For how long (s) the time on /clock has stood at the end, if a node publishes it.
    clock_stands: float = 0.0
    #: The track with the most transforms, if a bag was recorded with another clock than that of
    #: most stamps.
    clock: Optional[Track] = None
    seconds: float = inf  #: how long a live observation took
    #: When this program ran late (ns, on the system clock), and by how much (ns), in order.
    late: Sequence[tuple[int, int]] = ()

    def __post_init__(self) -> None:
        self.tracks = self.statistics.tracks()
        #: By child: the tracks, the one whose last transform arrived last, and its newest parent.
        self.by_child: dict[str, list[Track]] = {}
        for track in self.tracks:
            self.by_child.setdefault(track.child, []).append(track)
        self.newest = {child: max(tracks, key=itemgetter('last_time'))
                       for child, tracks in self.by_child.items()}
        self.parents = {child: [*track.parents][-1] for child, track in self.newest.items()}
        #: The end of the observation, or the last arrival of a dynamic transform (ns).
        self.until = max(self.end, 0, *(
            int(track['last_time']) for track in self.tracks if not track.is_static))
        #: Those `headers` whose nearest namespace with transforms is that of `topics`.
        self.own_headers = {
            topic: headers for topic, headers in self.headers.items() if self.is_own(topic)}
        #: By the frame of headers, in alphabetical order: the topics with these headers.
        self.topics_of = {frame: [topic for topic, headers in self.own_headers.items()
                                  if frame in headers.frames] for frame in sorted(
            {frame for headers in self.own_headers.values() for frame in headers.frames})}
        trees: dict[str, list[str]] = {}
        for track in self.tracks:
            for parent in track.parents:
                small, large = sorted((trees.setdefault(name, [name])
                                       for name in (parent, track.child)), key=len)
                if small is not large:
                    large += small
                    trees.update(dict.fromkeys(small, large))
        #: The frames of each tree; earlier parents count, too.
        self.trees = [*{id(tree): tree for tree in trees.values()}.values()]
        #: By frame: the index of its tree in `trees`.
        self.tree_of = {name: i for i, tree in enumerate(self.trees) for name in tree}
        #: Those `robots` whose namespace is that of `topics`, and the prefix of their frames.
        self.own_robots = [(robot, prefix(robot.topic, robot.root, robot.links, self.tree_of)[0])
                           for robot in self.robots if self.is_own(robot.topic)]
        self._add_left_out()
        moving = [track for track in self.tracks if not track.stream.is_frozen]
        if self.has_record_times and 2 * total(moving, 'foreign') > total(
                moving, 'delays') and not any(track.stream.alternates for track in moving):
            self.clock = max(moving, key=itemgetter('delays'))
            self.not_known.setdefault(
                'arrivals', 'the bag was recorded with another clock than that of the stamps; '
                f'they are about {in_words(self.clock.stream.mean_delay)} apart')

    def _add_left_out(self) -> None:
        if self.statistics.not_counted:
            self.not_known['headers'] = 'there are too many frames'
            self.left_out.append(
                f'{self.statistics.not_counted} transforms: there are too many frames')
        for error, count in self.statistics.malformed.most_common(SHOWN):
            self.left_out.append(
                f'{count} message{"s" if count > 1 else ""} of this kind: {error}')
        self.left_out += [
            f'gap in the {in_words(end - begin)} after {exact_time(begin)}: a part of the '
            'recording is missing or damaged' for begin, end in self.missing_spans[:SHOWN]]
        self.left_out += [f'the robot description on {robot.topic}: {robot.problem}'
                          for robot in self.robots if robot.problem]

    def is_own(self, topic: str) -> bool:
        """Return True if the nearest namespace of a topic with transforms is that of `topics`."""
        own, *others = (name.rpartition('/')[0] for name in (self.topics[0], *self.tf_topics))
        return own == max((each for each in (own, *others) if topic.startswith(f'{each}/')),
                          key=len, default='')

    @cached_property
    def facts(self) -> Facts:
        """What the rules of errors are asked with."""
        parents: dict[str, dict[str, Parent]] = {child: {} for child in self.by_child}
        for track in self.tracks:
            parents[track.child].update({
                name: Parent(name, track.publisher, track.is_static) for name in track.parents})
        sent = [(track.publisher, track.is_static, {track.child: [*track.parents][-1]})
                for track in self.tracks]
        heard = [Heard(self.topics[is_static], '' if 'nodes' in self.not_known else publisher,
                       [self.nodes.get(publisher, '')], edges)
                 for publisher, is_static, edges in (
                     *sent, *((*key, {}) for key in self.statistics.empty_names))]
        return Facts('none', self.around._replace(
            topics=self.topics[::-1], listen=lambda: [*heard, *self.other_transforms]),
            Frames([*self.tree_of], self.parents,
                   [child for child, each in parents.items() if len(each) > 1],
                   lambda child: [*parents[child].values()], missing_part=self.missing_part))

    @cached_property
    def off_clock(self) -> dict[str, int]:
        """By topic: the offset of its stamps (ns), if it is off, while a frame is in time."""
        if not is_in_time(self.tracks):
            return {}
        streams = [(topic.topic, topic.stream) for topic in self.message_times if topic.children]
        return {topic: stream.offset for topic, stream in streams if stream.offset and is_off(
            stream.offset, stream.latest, stream.latest - stream.offset)}

    def stream(self, child: str) -> Stream:
        """Return the dynamic transforms of a child, of all publishers."""
        return self.statistics.stream(self.by_child.get(child, ()))

    @cached_property
    def refused(self) -> dict[str, int]:
        """By child: how many transforms a buffer with the default cache refuses."""
        found = {}
        for child in self.by_child:
            stream = self.stream(child)
            parts = np.split(stream.stamps, stream.arrivals.searchsorted(sorted(self.clears))
                             ) if stream.backwards else ()
            found[child] = sum(int(np.count_nonzero(
                part < np.maximum.accumulate(part) - CACHE_TIME)) for part in parts)
        return found

    @cached_property
    def silences(self) -> list[tuple[int, int]]:
        """When nothing has arrived on any topic, of at least two nodes that send often (ns)."""
        streams = [(self.node_of(track) or f'{id(track.stream)}', track.stream)
                   for track in self.tracks]
        streams += [(node, topic.stream) for topic in self.message_times
                    for node in self.senders.get(topic.topic) or [topic.topic]]
        arrivals = np.sort(np.concatenate([
            stream.arrivals for stream in {stream for _, stream in streams}]))
        at = np.flatnonzero(np.diff(arrivals) > SECOND)
        pauses = arrivals[at].tolist(), arrivals[at + 1].tolist()
        return [(begin, end) for begin, end in zip(*pauses) if len({
            node for node, stream in streams if stream.steps and end - begin > GAP * stream.period
            and stream.arrivals[0] < end <= stream.arrivals[-1]}) > 1]

    @cached_property
    def gaps(self) -> list[tuple[Track, NDArray[np.int64], bool]]:
        """By track with gaps: their indices but those when it was busy; or all of these, True."""
        found = []
        for track in self.tracks:
            stream, slack = track.stream, max(SHORTEST_GAP, track.stream.period)
            begins, ends = stream.arrivals[stream.gaps], stream.arrivals[stream.gaps + 1]
            gaps = stream.gaps[~_are_within(self.missing_spans, begins, ends, slack)]
            if not stream.has_gaps(gaps):
                continue
            is_own = ~self.were_busy(stream.arrivals[gaps], stream.arrivals[gaps + 1], slack)
            is_busy = not stream.has_gaps(gaps[is_own])
            found.append((track, gaps if is_busy else gaps[is_own], is_busy))
        return found

    @cached_property
    def ended(self) -> set[Track]:
        """The newest tracks of frames that were sent often, and are not any more."""
        found = set()
        for track in self.newest.values():
            stream, silence = track.stream, self.until - track['last_time']
            if stream.steps >= FEWEST and track['last_time'] and silence > max(
                    GAP * stream.period, SHORTEST_GAP) and not self.were_busy(
                        stream.arrivals[-1:], stream.arrivals[-1:] + silence).any():
                found.add(track)
        return found

    def were_busy(self, begins: NDArray[np.int64], ends: NDArray[np.int64],
                  slack: float = SHORTEST_GAP) -> NDArray[np.bool_]:
        """Return whether at some times (ns) this program was late, or all nodes were silent."""
        times, late = np.array([*self.late, (NEVER, 0)], np.int64).T
        sums, around = np.append(0, np.cumsum(late)), np.array([begins - _AROUND, ends + _AROUND])
        lost = np.diff(sums[times.searchsorted(around)], axis=0)[0]
        found = np.asarray((lost > _BUSY * np.diff(around, axis=0)[0]) & (
            ends - begins < _LONGEST_BUSY))
        return found | _are_within(self.silences if (ends - begins > SECOND).any() else (),
                                   begins, ends, slack)

    def has_late(self, track: Track, is_busy: bool = False) -> bool:
        """Return whether many transforms are late; `is_busy`: since the listener was busy."""
        stream = track.stream
        return stream.has_many('late') and is_busy != stream.has_many(
            'late', int(self.were_busy(*stream.late_spans()).sum()))

    @cached_property
    def message_times(self) -> list[MessageTimes]:
        """From when on the messages with `own_headers` can be transformed at their stamps."""
        if not self.own_headers:
            return []
        arrivals = np.concatenate([
            *(each.arrivals for each in {*map(self.stream, self.by_child)}),
            *(np.array(each.arrivals, np.int64) for each in self.own_headers.values())])
        span = int(arrivals.min(initial=NEVER)), int(arrivals.max(initial=0))
        clock = None if 'arrivals' in self.not_known else self.statistics.clock
        return [judge(topic, headers, self._edges_above, span, clock)
                for topic, headers in sorted(self.own_headers.items())]

    def _edges_above(self, frame: str) -> Optional[dict[Availability, str]]:
        """Return the dynamic edges from a frame to its root, and their children; None: no tree."""
        name = frame.removeprefix('/')
        path = self.facts.buffer.chain(name)
        if name not in self.tree_of or path[-1] in self.parents:  # or in a loop
            return None
        # Edges whose transforms always arrive together are judged once.
        edges: dict[Availability, str] = {}
        for child in path:
            stream = self.stream(child)
            if not all(track.is_static for track in self.by_child.get(child, ())):
                if not stream.arrivals.any():
                    return None
                edges.setdefault(stream.edge, child)
        return edges

    @cached_property
    def recreated(self) -> dict[tuple[str, str], list[str]]:
        """
        By node and topic: the publishers that the node creates one after another.

        A publisher that is destroyed at once has no known node: it is not found in the ROS graph.
        """
        groups: dict[tuple[str, str], dict[str, set[str]]] = {}
        for each in self.around.publishers:
            if each.gid and each.type == TF_MESSAGE:
                groups.setdefault((each.node, each.topic), {})[each.gid] = set()
        for track in self.tracks:
            key = self.node_of(track), self.topics[track.is_static]
            groups.setdefault(key, {}).setdefault(track.publisher, set()).add(track.child)
        return {key: found for key, group in groups.items() if (found := recreated(group))}

    def below(self, frames: Collection[str]) -> set[str]:
        """Return frames, and those below them."""
        chain = self.facts.buffer.chain
        return {*frames, *(name for name in self.parents if not {*chain(name)}.isdisjoint(frames))}

    def by_publisher(self, is_wanted: Callable[[Track], object]) -> list[list[Track]]:
        """Group the tracks that meet a condition by publisher and topic."""
        groups: dict[tuple[str, bool], list[Track]] = {}
        for track in filter(is_wanted, self.tracks):
            groups.setdefault((track.publisher, track.is_static), []).append(track)
        return [*groups.values()]

    def node_of(self, track: Track) -> str:
        """Return the full name of the node of a track; '' if it is not known."""
        return self.nodes.get(track.publisher, '')


def _are_within(spans: Iterable[tuple[int, int]], begins: NDArray[np.int64],
                ends: NDArray[np.int64], slack: float) -> NDArray[np.bool_]:
    """Return which times (ns) are within one of the spans, or longer by `slack` at each end."""
    found = np.zeros(len(begins), np.bool_)
    for begin, end in spans:
        found |= (begin <= begins + slack) & (end >= ends - slack)
    return found


def is_in_time(timed: Iterable[Union[Track, MessageTimes]]) -> bool:
    """Return whether the transforms of a track, or the messages of a topic, are in time."""
    return any(each.stream.is_in_time for each in timed)


def total(tracks: Iterable[Track], statistic: str) -> int:
    return sum(int(track[statistic]) for track in tracks)


def listened(listener: 'FrameListener', statistics: Statistics, where: str, seconds: float,
             not_known: dict[str, str], **fields: Any) -> Observation:
    """Return what a listener has received in some time (s), and what it knows of publishers."""
    static, dynamic = listener.topics
    publishers, end = statistics.publishers(), listener.now()
    if publishers and all(listener.is_present(each) is None for each in publishers):
        not_known['nodes'] = 'the ROS graph does not know the publishers of the transforms'
    if not end:
        not_known['arrivals'] = 'use_sim_time is set, but no message has arrived on /clock'
    return Observation(
        statistics, where, (dynamic, static), listener.names_of(publishers), listener.present,
        not_known=not_known, end=end, ahead=listener.ahead, seconds=seconds, **fields)


class BagObserver:
    """Observes a bag: pass `wanted` as `others` when it is read, and each message to `add`."""

    wanted = RobotsInBag.wanted

    def __init__(self) -> None:
        self._statistics, self.robots = Statistics(), RobotsInBag()
        self._waiting: list[BagMessage] = []
        self._size = 0

    def add(self, message: BagMessage) -> None:
        """Count the transforms of a message, or note what it says of a robot."""
        if message.topic.is_static is None:
            self.robots.add(message)
            return
        self._waiting.append(message)
        self._size += len(message.data)
        if self._size > _MOST_BYTES or len(self._waiting) >= _MOST_WAITING:
            self.counted()

    def counted(self) -> Statistics:
        self._statistics.add_messages(self._waiting)
        self._waiting, self._size = [], 0
        return self._statistics

    def observation(self, bag: Bag) -> Observation:
        """Return all that was observed, once the bag has been read with its headers."""
        statistics, topics = self.counted(), bag.topics
        nodes = {name: name for name in statistics.publishers() - {NOT_RECORDED}}
        tracks = statistics.tracks()
        path = namespace_path(bag.namespace)
        other_files = [file.name for file in bag.files[1:] if bag.path in bag.files]
        own_topics = dynamic, static = f'{path}/tf', f'{path}/tf_static'
        latched = [topic for topic in topics if topic.name == static and topic.is_tf]
        not_known = {'listeners': 'a bag does not record the listeners'}
        if any({*topic.durabilities} <= {'UNKNOWN'} for topic in latched):
            not_known['qos'] = 'the bag does not record the QoS of the publishers'
        if not bag.is_whole:
            not_known['messages'] = 'a part of the recording is missing or damaged'
        if not nodes:
            not_known['nodes'] = 'the bag does not record which node has sent a message'
        if not any(track['delays'] for track in tracks):
            not_known['arrivals'] = 'there are no dynamic transforms with a time of the recording'
        tf_topics = [topic.name for topic in topics if topic.is_tf and topic.name not in own_topics
                     and topic.name.removesuffix('_static').endswith('/tf')]
        others = [topic for topic in tf_topics if topic.endswith('/tf')]
        has_static = any(track.is_static for track in tracks)
        publishers = [Publisher('', topic.name, topic.msgtype, '') for topic in topics
                      if topic.name in own_topics and not topic.is_tf]
        publishers += [
            Publisher('', static, TF_MESSAGE, '', 'transient local') for topic in latched
            for durability in topic.durabilities.elements()
            if durability not in ('TRANSIENT_LOCAL', 'UNKNOWN')]
        return Observation(
            statistics, f'in {"" if bag.is_whole else "what is left of "}'
            f'{comma_list([str(bag.path), *other_files])}', own_topics, nodes=nodes,
            headers={topic.name: topic.headers for topic in topics if topic.headers.count},
            robots=self.robots.robots(), tf_topics=tf_topics, not_known=not_known,
            has_record_times=True, missing_spans=bag.missing_spans,
            missing_part='' if has_static else bag.missing_part,
            left_out=[f'headers on {topic.name}: the definition of its type {topic.msgtype} is '
                      'not known' for topic in topics if topic.has_header is None]
            + ['which waits of messages the missing or damaged part has caused'] * (
                not bag.is_whole and any(topic.headers.count for topic in topics)),
            around=Surroundings(
                topics=(static, dynamic), publishers=publishers, has_data=bool(tracks),
                other_topics=others if all(track.is_static for track in tracks) else ()))
