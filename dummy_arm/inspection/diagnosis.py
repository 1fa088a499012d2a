"""
Checks of the transforms that were received or recorded: what is wrong, and what to do about it.

Each check is a function that looks for one kind of fault in a `Snapshot`. The checks need no ROS.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import chain, combinations, pairwise
from operator import attrgetter, itemgetter
import re
from typing import NamedTuple, Optional

from dummy_arm.inspection.forest import Forest
from dummy_arm.inspection.tf_statistics import (
    FUTURE,
    LATE,
    NORM_TOLERANCE,
    OTHER_CLOCK,
    Track,
)
from dummy_arm.tf import Frame
from dummy_arm.tf.formatting import (
    comma_list,
    display_time,
    quoted,
    SECOND,
    shortened,
    suggest_names,
    TF_MESSAGE,
)

#: The severities.
SEVERITIES = ERROR, WARNING, INFO = 'error', 'warning', 'info'
#: A step from stamp to stamp is a gap if it is longer than this many periods. Shorter gaps than
#: `_SHORTEST_GAP` (ns) are jitter, which a busy computer causes. They are reported if they are
#: this part of all steps, and at least this many.
_GAP, _SHORTEST_GAP, _JITTER, _FEWEST_GAPS = 3, SECOND // 2, 0.02, 3
#: The smallest number of steps that are judged. A shorter period (ns) counts as this one, since
#: some programs send several transforms of a frame at once.
_FEWEST, _SHORTEST_PERIOD = 10, SECOND // 1000
#: Transforms are late or from the future if at least this part of them is.
_SHARE = 0.05
#: A program has fewer broadcasters than this without a frame of their own, unless it creates them
#: again and again.
_MANY, _MANY_SILENT = 6, 20
#: The frames of REP 105, from the root to the robot.
_REP_105 = 'earth', 'map', 'odom', 'base_link'
#: Names that are shorter than this are not compared letter by letter.
_SHORTEST_NAME = 3
#: The names of this many roots are compared with those of the other frames.
_MOST_ROOTS = 100
#: The largest number of names in a text.
_SHOWN = 5


class Endpoint(NamedTuple):
    """A publisher on /tf or /tf_static."""

    topic: str
    node: str  #: the full name of its node
    is_unlatched: bool  #: True if the topic is /tf_static and later listeners receive nothing
    mismatch: str  #: the listener whose QoS it does not match, and why; '': it matches all
    wrong_type: str = ''  #: its type, if it is not TFMessage
    publisher: str = ''  #: as `Track.publisher`; '': not known


def recreated(publishers: Mapping[str, Collection[str]]) -> list[str]:
    """
    Return the publishers that a node creates one after another, as in the callback of a timer.

    :param publishers: by publisher of one node on one topic: the frames that it has sent.
    :returns: the publishers that have no frame of their own, if there are at least 6; if none of
        them has sent anything, at least 20.
    """
    counts = Counter(chain.from_iterable(publishers.values()))
    found = [publisher for publisher, frames in publishers.items()
             if all(counts[frame] > 1 for frame in frames)]
    return found if len(found) >= (_MANY if counts else _MANY_SILENT) else []


class Headers(NamedTuple):
    """The headers of the messages on a topic that is not TF."""

    topic: str
    frames: frozenset[str]  #: the `frame_id` of the headers that were read


def headers_of(namespace: str, headers: Iterable[Headers], tf_topics: Iterable[str]
               ) -> list[Headers]:
    """
    Select the headers that the transforms in a namespace are for.

    :param namespace: the namespace, with a slash at its beginning; '': no namespace.
    :param headers: the headers on all topics.
    :param tf_topics: all topics with transforms. A topic belongs to the nearest namespace around
        it in which there are transforms.
    :returns: the headers on the topics that belong to the namespace.
    """
    namespaces = {namespace, *(topic.rpartition('/')[0] for topic in tf_topics)}

    def nearest(topic: str) -> str:
        """
        Return the namespace that a topic belongs to.

        :param topic: the topic.
        :returns: the namespace; '' if there are no transforms in any namespace around the topic.
        """
        while topic and topic not in namespaces:
            topic = topic.rpartition('/')[0]
        return topic

    return [each for each in headers if nearest(each.topic) == namespace]


class Finding(NamedTuple):
    """A fault, or something remarkable."""

    code: str
    severity: str  #: ERROR, WARNING or INFO
    frames: tuple[str, ...]
    topics: tuple[str, ...]
    nodes: tuple[str, ...]
    evidence: str  #: what was observed, in numbers
    remedy: str  #: what to do, in one sentence


class Snapshot:
    """What was received or recorded within the time of an observation."""

    def __init__(self, tracks: list[Track], topics: tuple[str, str] = ('/tf', '/tf_static'), *,
                 nodes: Optional[dict[str, str]] = None,
                 present: Optional[Collection[str]] = None,
                 endpoints: Sequence[Endpoint] = (), headers: Sequence[Headers] = (),
                 empty_names: Optional[dict[tuple[str, bool], Counter[str]]] = None,
                 not_known: Optional[dict[str, str]] = None,
                 why_no_transforms: str = '', other_namespaces: str = '',
                 has_record_times: bool = False, end: int = 0, clock_hint: str = '') -> None:
        """
        Create a snapshot.

        :param tracks: the statistics of the transforms.
        :param topics: the names of the topics of dynamic and of static transforms.
        :param nodes: the full names of the nodes, by publisher.
        :param present: the publishers that exist at the end of the observation; None: all.
        :param endpoints: the publishers on the two topics; of a bag, those of a wrong type.
        :param headers: the headers on other topics.
        :param empty_names: as in `Statistics`.
        :param not_known: what is not known, and why, for the checks that need it: 'nodes', 'qos',
            'arrivals' or 'headers'.
        :param why_no_transforms: where to look if there are no transforms.
        :param other_namespaces: which topics have transforms if /tf has none; '': no other topics.
        :param has_record_times: True if the arrivals are the times of a recording, which may be on
            another clock than all stamps.
        :param end: the end of the observation (ns), on the clock of the arrivals; 0: not known.
        :param clock_hint: a text about this computer's clock, for stamps from another clock.
        """
        self.end, self.clock_hint = end, clock_hint
        self.tracks, self.topics, self.nodes = tracks, topics, nodes or {}
        self.present, self.endpoints, self.headers = present, endpoints, headers
        self.empty_names, self.not_known = empty_names or {}, dict(not_known or {})
        self.why_no_transforms, self.other_namespaces = why_no_transforms, other_namespaces
        self.by_child: dict[str, list[Track]] = {}
        for track in tracks:
            self.by_child.setdefault(track.child, []).append(track)
        #: By child: the newest parent.
        self.parents = {child: [*max(tracks, key=itemgetter('last_time')).parents][-1]
                        for child, tracks in self.by_child.items()}
        #: The track with the most transforms, if a bag was recorded with another clock than that
        #: of most stamps; else None.
        self.clock: Optional[Track] = None
        if has_record_times and 2 * _sum(tracks, 'foreign') > _sum(tracks, 'delays'):
            self.clock = max(tracks, key=itemgetter('delays'))
            self.not_known.setdefault(
                'arrivals', 'the bag was recorded with another clock than that of the stamps; '
                f'they are about {_seconds(self.clock.mean_delay)} apart')

    @cached_property
    def trees(self) -> list[list[str]]:
        """
        The frames of each tree, in the order in which they appeared.

        All edges count, also those to an earlier parent.
        """
        neighbours: dict[str, list[str]] = {}
        for track in self.tracks:
            for parent in track.parents:
                neighbours.setdefault(parent, []).append(track.child)
                neighbours.setdefault(track.child, []).append(parent)
        trees: list[list[str]] = []
        seen: set[str] = set()
        for start in neighbours:
            if start not in seen:
                seen.add(start)
                tree = [start]
                for name in tree:
                    new = [other for other in neighbours[name] if other not in seen]
                    seen.update(new)
                    tree += dict.fromkeys(new)
                trees.append(tree)
        return trees

    @cached_property
    def tree_of(self) -> dict[str, int]:
        """By frame: the index of its tree in `trees`."""
        return {name: i for i, tree in enumerate(self.trees) for name in tree}

    @cached_property
    def topics_of(self) -> dict[str, list[str]]:
        """By the frame of headers, in alphabetical order: the topics with these headers."""
        topics: dict[str, list[str]] = {}
        for headers in self.headers:
            for frame in headers.frames:
                topics.setdefault(frame, []).append(headers.topic)
        return dict(sorted(topics.items()))

    @cached_property
    def recreated(self) -> dict[tuple[str, str], list[str]]:
        """
        By node and topic: the publishers that the node creates one after another.

        A publisher that is destroyed at once has no known node: it is not found in the ROS graph.
        """
        groups: dict[tuple[str, str], dict[str, set[str]]] = {}
        for endpoint in self.endpoints:
            if endpoint.publisher:
                group = groups.setdefault((endpoint.node, endpoint.topic), {})
                group[endpoint.publisher] = set()
        for track in self.tracks:
            key = self.node_of(track), self.topics[track.is_static]
            groups.setdefault(key, {}).setdefault(track.publisher, set()).add(track.child)
        return {key: found for key, group in groups.items() if (found := recreated(group))}

    def roots(self, tree: list[str]) -> list[str]:
        """
        Return the frames of a tree that have no parent.

        :param tree: the frames of the tree.
        :returns: the names; an empty list if the tree is a loop.
        """
        return [name for name in tree if name not in self.parents]

    def ancestors(self, name: str) -> list[str]:
        """
        Return the frames above a frame, up to the root; in a loop, each frame once.

        :param name: the name of the frame.
        :returns: the names, the parent first.
        """
        found: dict[str, None] = {}
        while (name := self.parents.get(name, '')) and name not in found:
            found[name] = None
        return [*found]

    def by_publisher(self, is_wanted: Callable[[Track], object]) -> list[list[Track]]:
        """
        Group the tracks that meet a condition.

        :param is_wanted: a function that returns whether a track meets the condition.
        :returns: the tracks of each publisher on each topic.
        """
        groups: dict[tuple[str, bool], list[Track]] = {}
        for track in filter(is_wanted, self.tracks):
            groups.setdefault((track.publisher, track.is_static), []).append(track)
        return [*groups.values()]

    def node_of(self, track: Track) -> str:
        """
        Return the name of a node.

        :param track: a track of the node.
        :returns: the full name; '' if it is not known.
        """
        return self.nodes.get(track.publisher, '')


class _Fault(NamedTuple):
    """A fault that a check has found."""

    frames: Iterable[str]
    evidence: str
    tracks: Sequence[Track] = ()  #: the tracks whose topics and nodes are named
    topics: Sequence[str] = ()  #: further topics
    nodes: Sequence[str] = ()  #: further nodes


#: A function that looks for one kind of fault.
_Find = Callable[[Snapshot], Iterator[_Fault]]


class Check(NamedTuple):
    """A check, which looks for one kind of fault."""

    code: str
    severity: str  #: ERROR, WARNING or INFO
    meaning: str  #: what the fault is
    remedy: str  #: what to do, in one sentence
    needs: str  #: what must be known: 'nodes', 'qos', 'arrivals', 'headers'; '': nothing special
    find: _Find


#: All checks, by their codes.
CHECKS: dict[str, Check] = {}


def _check(code: str, severity: str, meaning: str, remedy: str, needs: str = ''
           ) -> Callable[[_Find], _Find]:
    """Return a decorator that adds a function to `CHECKS`."""
    def add(find: _Find) -> _Find:
        """
        Add a check.

        :param find: the function.
        :returns: the same function.
        """
        CHECKS[code] = Check(code, severity, meaning, remedy, needs, find)
        return find

    return add


def diagnose(snapshot: Snapshot, ignored: Collection[str] = ()) -> list[Finding]:
    """
    Make all checks.

    :param snapshot: what was observed.
    :param ignored: the codes of checks that are not made.
    :returns: what was found: errors first, then warnings, then infos.
    """
    findings = []
    for check in CHECKS.values():
        if check.code in ignored or check.needs in snapshot.not_known:
            continue
        for fault in check.find(snapshot):
            topics = (snapshot.topics[track.is_static] for track in fault.tracks)
            nodes = filter(None, map(snapshot.node_of, fault.tracks))
            findings.append(Finding(
                check.code, check.severity, tuple(dict.fromkeys(fault.frames)),
                tuple(dict.fromkeys((*fault.topics, *topics))),
                tuple(dict.fromkeys((*fault.nodes, *nodes))), fault.evidence, check.remedy))
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))


def not_checked(snapshot: Snapshot, ignored: Collection[str] = ()) -> list[str]:
    """
    Return which checks cannot be made, and why.

    :param snapshot: what was observed.
    :param ignored: the codes of checks that are not wanted.
    :returns: a text for each reason.
    """
    return [f'{", ".join(codes)}: {reason}' for need, reason in snapshot.not_known.items()
            if (codes := [check.code for check in CHECKS.values()
                          if check.needs == need and check.code not in ignored])]


def _names(names: Iterable[str]) -> str:
    return comma_list([*names], _SHOWN, shortened)


def _hertz(track: Track) -> str:
    return 'once' if track.rate is None else f'{track.rate:.1f} Hz'


def _seconds(nanoseconds: float) -> str:
    """Return a time span in s, with three significant digits at least."""
    seconds = abs(nanoseconds) / SECOND
    return f'{seconds:.3g} s' if seconds < 1000 else f'{seconds:.0f} s'


# Errors


@_check('no_transforms', ERROR,
        'Nothing was received on /tf and /tf_static.',
        'Start the nodes that publish transforms, in the same ROS domain.')
def _no_transforms(snapshot: Snapshot) -> Iterator[_Fault]:
    is_explained = snapshot.other_namespaces or snapshot.recreated or any(
        endpoint.wrong_type for endpoint in snapshot.endpoints)
    if not snapshot.tracks and not is_explained:
        refused = [each for each in snapshot.endpoints if each.mismatch or each.is_unlatched]
        yield _Fault((), f'{len(snapshot.endpoints)} publishers exist, but {len(refused)} of them '
                     'do not match the QoS of a listener' if refused else
                     snapshot.why_no_transforms or '0 transforms', topics=snapshot.topics)


@_check('wrong_type', ERROR,
        f'Messages on /tf or /tf_static have another type than {TF_MESSAGE}; no listener '
        'receives them.',
        'Send transforms with a TransformBroadcaster or a StaticTransformBroadcaster '
        '(sendTransform), and other messages on another topic.')
def _wrong_type(snapshot: Snapshot) -> Iterator[_Fault]:
    for endpoint in snapshot.endpoints:
        if endpoint.wrong_type:
            yield _Fault((), f'{endpoint.node or "a node"} publishes {endpoint.wrong_type} on '
                         f'{endpoint.topic}, not {TF_MESSAGE}', topics=[endpoint.topic],
                         nodes=[*filter(None, [endpoint.node])])


@_check('two_publishers', ERROR,
        'Two publishers send the transform of one child at the same time, so the frame jumps '
        'between two poses.',
        'Stop one of the publishers, or give its frame another name.', 'nodes')
def _two_publishers(snapshot: Snapshot) -> Iterator[_Fault]:
    pairs: dict[tuple[str, str, bool], list[tuple[Track, Track]]] = {}
    again = {*chain.from_iterable(snapshot.recreated.values())}
    for tracks in snapshot.by_child.values():
        for a, b in combinations(tracks, 2):
            if (a.is_static == b.is_static and not {a.publisher, b.publisher} <= again
                    and _exist_together(snapshot, a, b)):
                pairs.setdefault((a.publisher, b.publisher, a.is_static), []).append((a, b))
    for group in pairs.values():
        a, b = group[0]
        names = [snapshot.node_of(track) or 'a publisher' for track in (a, b)]
        how_often = ('one transform each' if a.is_static else
                     f'{a["count"]} transforms ({_hertz(a)}) and {b["count"]} ({_hertz(b)})')
        children = [a.child for a, _ in group]
        yield _Fault(children, f'{names[0]} and {names[1]} both publish {_names(children)}: '
                     f'{how_often}', [a, b])


def _exist_together(snapshot: Snapshot, a: Track, b: Track) -> bool:
    """
    Return whether two publishers send at the same time.

    If a node is started again, its second publisher begins after the end of the first one.
    """
    if a.is_static:
        # The publisher of a node that was killed exists for some seconds more.
        is_same = (a['pose'] == b['pose']).all() and [*a.parents][-1] == [*b.parents][-1]
        if snapshot.present is None:
            return not is_same
        return {a.publisher, b.publisher} <= {*snapshot.present} and not (
            is_same and snapshot.node_of(a) == snapshot.node_of(b))
    return bool(max(a['first_time'], b['first_time']) <= min(a['last_time'], b['last_time']))


@_check('many_publishers', ERROR,
        'A node creates publishers on /tf or /tf_static again and again: what a new publisher '
        'sends can be lost, and each of them costs all listeners memory and time.',
        'Create the broadcaster once, with the node, and not in the callback of a timer.', 'nodes')
def _many_publishers(snapshot: Snapshot) -> Iterator[_Fault]:
    for (node, topic), publishers in snapshot.recreated.items():
        found = {*publishers}
        frames = [track.child for track in snapshot.tracks if track.publisher in found]
        where = ', from one node' if node.startswith('/') else ''
        yield _Fault(frames, f'{len(found)} publishers, one after another{where}',
                     topics=[topic], nodes=[node])


@_check('changing_parent', ERROR,
        'The parent of a frame changes, so the tree has another shape at each change.',
        'Let only one parent be published for the frame; if it has to be in two trees, publish '
        'the inverse of one transform, with parent and child exchanged.')
def _changing_parent(snapshot: Snapshot) -> Iterator[_Fault]:
    for child, tracks in snapshot.by_child.items():
        parents = [*dict.fromkeys(parent for track in tracks for parent in track.parents)]
        if len(parents) > 1:
            count = sum(track['count'] for track in tracks)
            yield _Fault([child], f'{shortened(child)} has {len(parents)} parents in {count} '
                         f'transforms: {_names(parents)}', tracks)


@_check('static_and_dynamic', ERROR,
        'A frame is published on /tf and on /tf_static; listeners use sometimes one of the two '
        'transforms, and sometimes the other.',
        'Publish the frame on one of the two topics only.')
def _static_and_dynamic(snapshot: Snapshot) -> Iterator[_Fault]:
    for child, tracks in snapshot.by_child.items():
        counts = [sum(track['count'] for track in tracks if track.is_static == is_static)
                  for is_static in (False, True)]
        if all(counts):
            yield _Fault([child], f'{shortened(child)}: {counts[0]} transforms on '
                         f'{snapshot.topics[0]}, {counts[1]} on {snapshot.topics[1]}', tracks)


@_check('loop', ERROR,
        'Frames are parents of each other in a circle, so a lookup through them fails, or its '
        'result depends on where it begins.',
        'Remove one of the transforms: the frame at the top, such as map, must have no parent.')
def _loop(snapshot: Snapshot) -> Iterator[_Fault]:
    forest = Forest(Frame(child, parent, '', False, 1, 0, 0)
                    for child, parent in snapshot.parents.items())
    for loop in forest.loops:
        tracks = [track for name in loop for track in snapshot.by_child[name]]
        more = ['...'] if len(loop) > _SHOWN else []
        yield _Fault(loop, f'{len(loop)} {"frames form" if len(loop) > 1 else "frame forms"} a '
                     f'loop: {" -> ".join(map(shortened, [*loop[:_SHOWN], *more, loop[0]]))}',
                     tracks)


@_check('unknown_frame', ERROR,
        'The headers of other messages name a frame that no transform leads to, so these '
        'messages cannot be transformed.',
        'Publish a transform to this frame, or correct the name in the program that sends the '
        'messages.', 'headers')
def _unknown_frame(snapshot: Snapshot) -> Iterator[_Fault]:
    known = tuple(snapshot.tree_of)
    static = '' if any(track.is_static for track in snapshot.tracks) else (
        f' (there are no transforms on {snapshot.topics[1]})')
    for frame, topics in snapshot.topics_of.items():
        if frame.strip('/') and frame.removeprefix('/') not in snapshot.tree_of:
            yield _Fault([frame], f'{quoted(frame)} is in the headers on {_names(topics)}, but '
                         f'not among the {len(known)} frames of the transforms{static}. '
                         f'{suggest_names(frame, known)}', topics=topics)


@_check('disconnected', ERROR,
        'The headers of other messages name frames of different trees, so these messages cannot '
        'be transformed into one frame.',
        'Publish a transform between the trees.', 'headers')
def _disconnected(snapshot: Snapshot) -> Iterator[_Fault]:
    #: By robot, and by tree: the frames that headers name, and the topics of these headers. Robots
    #: with a namespace for their topics and their frames may have trees of their own.
    robots: dict[str, dict[int, dict[str, list[str]]]] = {}
    for headers in snapshot.headers:
        namespace = headers.topic.split('/')[1]
        for frame in sorted(headers.frames):
            name = frame.removeprefix('/')
            if name in snapshot.tree_of:
                robot = namespace if name.startswith(f'{namespace}/') else ''
                trees = robots.setdefault(robot, {})
                names = trees.setdefault(snapshot.tree_of[name], {})
                names.setdefault(name, []).append(headers.topic)
    for trees in robots.values():
        if len(trees) > 1:
            yield _Fault(
                [name for names in trees.values() for name in names],
                f'headers use frames of {len(trees)} trees: ' + '; '.join(
                    f'{_names(names)} (root '
                    f'{_names(snapshot.roots(snapshot.trees[i])) or "none"}) on '
                    f'{_names(dict.fromkeys(chain(*names.values())))}'
                    for i, names in [*trees.items()][:_SHOWN]),
                topics=[topic for names in trees.values() for topic in chain(*names.values())])


@_check('static_not_latched', ERROR,
        'A publisher on /tf_static does not keep its messages for later listeners.',
        'Give the publisher the durability TRANSIENT_LOCAL, or use a StaticTransformBroadcaster.',
        'qos')
def _static_not_latched(snapshot: Snapshot) -> Iterator[_Fault]:
    for endpoint in snapshot.endpoints:
        if endpoint.is_unlatched:
            yield _Fault((), f'1 publisher of {endpoint.node} on {endpoint.topic} has the '
                         'durability VOLATILE', topics=[endpoint.topic], nodes=[endpoint.node])


@_check('incompatible_qos', ERROR,
        'A listener receives nothing from a publisher, because their QoS do not match.',
        'Give the publisher the QoS of a TransformBroadcaster (reliable), or correct that of the '
        'listener.', 'qos')
def _incompatible_qos(snapshot: Snapshot) -> Iterator[_Fault]:
    for endpoint in snapshot.endpoints:
        if endpoint.mismatch and not endpoint.is_unlatched:
            yield _Fault((), f'1 publisher of {endpoint.node} on {endpoint.topic} does not match '
                         f'{endpoint.mismatch}', topics=[endpoint.topic], nodes=[endpoint.node])


@_check('not_a_number', ERROR,
        'A transform contains NaN or an infinite number; listeners refuse it.',
        'Find out where the program computes the number: often a division by zero or a missing '
        'measurement.')
def _not_a_number(snapshot: Snapshot) -> Iterator[_Fault]:
    yield from _counted(snapshot, 'invalid', 'with NaN or an infinite number')


@_check('unnormalized', ERROR,
        f'The norm of a quaternion differs from 1 by more than {NORM_TOLERANCE:g}, so it is not '
        'a rotation.',
        'Normalise the quaternion before it is sent; all zeros often mean that it was never set: '
        'set w = 1.')
def _unnormalized(snapshot: Snapshot) -> Iterator[_Fault]:
    for tracks in snapshot.by_publisher(itemgetter('unnormalized')):
        worst = max(tracks, key=lambda track: abs(track['worst_norm'] - 1.0))
        yield _Fault([track.child for track in tracks],
                     f'{_share(tracks, "unnormalized")} with a quaternion of a wrong norm; the '
                     f'worst norm is {worst["worst_norm"]:.6g} ({shortened(worst.child)})', tracks)


def _counted(snapshot: Snapshot, field: str, what: str,
             is_fault: Callable[[Track], object] = lambda track: True) -> Iterator[_Fault]:
    """Yield a fault for each publisher with transforms that are counted in a field."""
    for tracks in snapshot.by_publisher(lambda track: track[field] and is_fault(track)):
        yield _Fault([track.child for track in tracks], f'{_share(tracks, field)} {what}', tracks)


def _share(tracks: Sequence[Track], field: str) -> str:
    """Return how many transforms of tracks are counted in a field, in words."""
    return (f'{_sum(tracks, field)} of {_sum(tracks, "count")} transforms of '
            f'{_names(track.child for track in tracks)}')


def _sum(tracks: Iterable[Track], field: str) -> int:
    return sum(int(track[field]) for track in tracks)


@_check('other_clock', ERROR,
        f'Stamps are more than {OTHER_CLOCK // SECOND} s away from the time of arrival: they are '
        'from another clock, so lookups at the present time fail.',
        'Let all nodes use the same clock: set use_sim_time on all of them or on none, and '
        'synchronise the clocks of the computers.')
def _other_clock(snapshot: Snapshot) -> Iterator[_Fault]:
    if snapshot.clock:
        yield from _other_clock_than(snapshot, snapshot.clock)
        return
    for tracks in snapshot.by_publisher(itemgetter('foreign')):
        worst = max(tracks, key=lambda track: max(-track['least_delay'], track['greatest_delay']))
        is_before = worst['greatest_delay'] > -worst['least_delay']
        delay = worst['greatest_delay' if is_before else 'least_delay']
        yield _Fault(
            [track.child for track in tracks],
            f'{_share(tracks, "foreign")} with stamps that are far from their arrival, up to '
            f'{_seconds(delay)} {"before" if is_before else "after"} it; the last stamp of '
            f'{shortened(worst.child)} is {display_time(int(worst["stamp"]))}'
            f'{snapshot.clock_hint}', tracks)


def _other_clock_than(snapshot: Snapshot, clock: Track) -> Iterator[_Fault]:
    """
    Compare the stamps of all tracks with those of one track.

    The delays are not compared, because a simulation can be slow, or pause.
    """
    for track in snapshot.tracks:
        before = int(clock['oldest'] - track['latest'])
        after = int(track['oldest'] - clock['latest'])
        if track['delays'] and max(before, after) > OTHER_CLOCK:
            yield _Fault([track.child], f'all stamps of {shortened(track.child)} are at least '
                         f'{_seconds(max(before, after))} {"before" if before > 0 else "after"} '
                         f'those of {shortened(clock.child)}', [track])


@_check('zero_stamp', ERROR,
        'Transforms on /tf have the stamp 0, so lookups at any other time fail.',
        'Set the stamp to the time for which the transform is valid; with use_sim_time, wait '
        'until /clock is received.')
def _zero_stamp(snapshot: Snapshot) -> Iterator[_Fault]:
    # A simulation may begin with a single stamp 0.
    yield from _counted(snapshot, 'zero_stamps', 'with the stamp 0', lambda track: (
        track['zero_stamps'] > 1 or not 0 < track['oldest'] < OTHER_CLOCK))


# Warnings


@_check('gap', WARNING,
        f'The time from one stamp to the next one is often longer than {_GAP} periods, or once '
        f'much longer (at least {_SHORTEST_GAP / SECOND:g} s), or the frame is not published any '
        'more; lookups in between interpolate over the gap or wait.',
        'Look at the node that publishes the frame: has it stopped, is it busy, does it lose '
        'input, or does it publish only when something happens?')
def _gap(snapshot: Snapshot) -> Iterator[_Fault]:
    for tracks in snapshot.by_publisher(_has_gap):
        worst = max(tracks, key=itemgetter('largest_step'))
        beyond = worst.steps_beyond(_GAP * max(worst.period, _SHORTEST_PERIOD))
        before = display_time(int(worst['largest_step_at']))
        yield _Fault(
            [track.child for track in tracks],
            f'no transform of {shortened(worst.child)} for {_seconds(worst["largest_step"])} '
            f'after {before}; the usual period is {worst.period / SECOND:.2g} s; {beyond} of '
            f'{worst["steps"].sum()} steps from stamp to stamp are longer than {_GAP} periods',
            tracks)
    end = max((track['last_time'] for track in snapshot.tracks if not track.is_static), default=0)
    end = max(end, snapshot.end)
    ended = {track for tracks in snapshot.by_child.values()
             if (track := max(tracks, key=itemgetter('last_time')))['steps'].sum() >= _FEWEST
             and end - track['last_time'] > max(_GAP * track.period, _SHORTEST_GAP)}
    for tracks in snapshot.by_publisher(ended.__contains__):
        silence = max(end - track['last_time'] for track in tracks)
        yield _Fault([track.child for track in tracks],
                     f'nothing was received of {_names(track.child for track in tracks)} in the '
                     f'last {_seconds(silence)}, and {_hertz(tracks[0])} before', tracks)


def _has_gap(track: Track) -> bool:
    """Return whether a track has a gap, or too much jitter."""
    steps, period = int(track['steps'].sum()), max(track.period, _SHORTEST_PERIOD)
    return steps >= _FEWEST and bool(
        track['largest_step'] > max(_GAP * period, _SHORTEST_GAP)
        or track.steps_beyond(_GAP * period) >= max(_FEWEST_GAPS, _JITTER * steps))


@_check('late', WARNING,
        f'Transforms arrive more than {LATE / SECOND:g} s after their stamp; lookups at the '
        'present time wait for them.',
        'Look at the node that publishes the frame and at the network: one of them is too slow, '
        'or the clocks of two computers differ.', 'arrivals')
def _late(snapshot: Snapshot) -> Iterator[_Fault]:
    for tracks in snapshot.by_publisher(lambda track: _is_frequent(track, 'late')):
        worst = max(tracks, key=itemgetter('greatest_delay'))
        yield _Fault([track.child for track in tracks],
                     f'{_share(tracks, "late")} arrived more than {LATE / SECOND:g} s after their '
                     f'stamp; the mean delay of {shortened(worst.child)} is '
                     f'{_seconds(worst.mean_delay)}, the largest '
                     f'{_seconds(worst["greatest_delay"])}', tracks)


def _is_frequent(track: Track, field: str) -> bool:
    """Return whether enough transforms are counted in a field."""
    return bool(track[field] > _SHARE * track['delays'])


@_check('future', WARNING,
        f'Stamps are more than {FUTURE / SECOND:g} s later than the arrival.',
        'Synchronise the clocks of the computers; some localisation nodes date their transforms '
        'into the future on purpose (transform_tolerance).', 'arrivals')
def _future(snapshot: Snapshot) -> Iterator[_Fault]:
    for tracks in snapshot.by_publisher(lambda track: _is_frequent(track, 'future')):
        worst = min(tracks, key=itemgetter('least_delay'))
        yield _Fault([track.child for track in tracks],
                     f'{_share(tracks, "future")} with a stamp more than {FUTURE / SECOND:g} s '
                     f'after their arrival; the farthest is {_seconds(worst["least_delay"])} '
                     f'ahead ({shortened(worst.child)})', tracks)


@_check('time_goes_back', WARNING,
        'A stamp is earlier than the one before it.',
        'Send the transforms of a frame in the order of their stamps; if a simulation or a bag '
        'was started again, restart the listeners, too.')
def _time_goes_back(snapshot: Snapshot) -> Iterator[_Fault]:
    for tracks in snapshot.by_publisher(itemgetter('backwards')):
        worst = max(tracks, key=itemgetter('step_back'))
        yield _Fault([track.child for track in tracks],
                     f'{_share(tracks, "backwards")} with an earlier stamp than the one before; '
                     f'the largest step back is {_seconds(worst["step_back"])} '
                     f'({shortened(worst.child)})', tracks)


@_check('same_stamp', WARNING,
        'Two transforms of a frame have the same stamp and different poses; which of them is '
        'used depends on the listener.',
        'Set the stamp of each transform to its own time; if two nodes publish the frame, stop '
        'one of them.')
def _same_stamp(snapshot: Snapshot) -> Iterator[_Fault]:
    yield from _counted(snapshot, 'changes', 'with the stamp of the one before, and another pose',
                        lambda track: not track.is_static)


@_check('leading_slash', WARNING,
        'The name of a frame begins with a slash, as in ROS 1; tf2 refuses lookups of such a '
        'name.',
        'Leave out the slash.')
def _leading_slash(snapshot: Snapshot) -> Iterator[_Fault]:
    for tracks in snapshot.by_publisher(attrgetter('slashed')):
        names = sorted({name for track in tracks for name in track.slashed})
        yield _Fault(names, f'{len(names)} {"names begin" if len(names) > 1 else "name begins"} '
                     f'with a slash in transforms: {_names(names)}', tracks)
    for frame, topics in snapshot.topics_of.items():
        if frame.startswith('/'):
            yield _Fault([frame], f'the headers on {_names(topics)} name {quoted(frame)}',
                         topics=topics)


@_check('empty_name', WARNING,
        'The name of a frame is empty; listeners refuse the transform.',
        'Set frame_id and child_frame_id of each transform.')
def _empty_name(snapshot: Snapshot) -> Iterator[_Fault]:
    for (publisher, is_static), names in snapshot.empty_names.items():
        others = sorted(filter(None, names))
        text = f'; the other name is {_names(others)}' if others else ''
        count = sum(names.values())
        yield _Fault(others, f'{count} transform{"s" if count > 1 else ""} with an empty frame_id '
                     f'or child_frame_id{text}', topics=[snapshot.topics[is_static]],
                     nodes=[*filter(None, [snapshot.nodes.get(publisher)])])


@_check('similar_name', WARNING,
        'The root of a tree has almost the same name as a frame of another tree; it may be a '
        'mistake in the name that separates the trees.',
        'If both are the same frame, use the same name.')
def _similar_name(snapshot: Snapshot) -> Iterator[_Fault]:
    plain = {name: re.sub(r'[\W_]', '', name.lower()) for name in snapshot.tree_of}
    roots = [root for tree in snapshot.trees for root in snapshot.roots(tree)]
    seen = set()
    for root in roots[:_MOST_ROOTS]:
        for name, tree in snapshot.tree_of.items():
            if (tree != snapshot.tree_of[root] and (name, root) not in seen
                    and _is_similar(plain[root], plain[name])
                    and not _are_alike(*([plain[each] for each in snapshot.trees[i]]
                                         for i in (tree, snapshot.tree_of[root])))):
                seen.add((root, name))
                yield _Fault([root, name], f'{quoted(root)} is a root, and {quoted(name)} is in '
                             'another tree',
                             [track for track in snapshot.tracks if root in track.parents])


def _is_similar(a: str, b: str) -> bool:
    """
    Return whether two names are equal or differ by one letter.

    Names that differ only in their digits are numbered on purpose.

    :param a: a name in lower case, without separators.
    :param b: another one.
    """
    if a == b or abs(len(a) - len(b)) > 1 or min(len(a), len(b)) < _SHORTEST_NAME:
        return a == b != ''
    if re.sub(r'\d', '', a) == re.sub(r'\d', '', b):
        return False
    same = next((i for i, (x, y) in enumerate(zip(a, b)) if x != y), min(len(a), len(b)))
    a, b = a[same:], b[same:]
    return a[1:] == b[1:] or a[1:] == b or a == b[1:]


def _are_alike(names: list[str], others: list[str]) -> bool:
    """
    Return whether each name of a tree is similar to one of another tree.

    Then the trees are those of two similar robots or legs, and the names differ on purpose.
    """
    return len(names) == len(others) and all(
        a != b and _is_similar(a, b) for a, b in zip(sorted(names), sorted(others)))


@_check('other_namespace', WARNING,
        'Nothing publishes on /tf, but there are transforms on the topic tf of a namespace.',
        'Use the option that is named above, or publish on /tf and /tf_static.')
def _other_namespace(snapshot: Snapshot) -> Iterator[_Fault]:
    if snapshot.other_namespaces:
        yield _Fault((), snapshot.other_namespaces, topics=snapshot.topics[:1])


# Infos


@_check('several_trees', INFO,
        'The transforms form several trees; lookups from one to another fail.',
        'If the trees belong to one robot, publish a transform between them.')
def _several_trees(snapshot: Snapshot) -> Iterator[_Fault]:
    if len(snapshot.trees) > 1:
        roots = [(snapshot.roots(tree) or tree)[0] for tree in snapshot.trees]
        yield _Fault(roots, f'{len(roots)} trees, with the roots {_names(roots)}')


@_check('static_changes', INFO,
        'A transform on /tf_static changes; late listeners know only the newest one, for all '
        'times.',
        'Publish a transform that changes on /tf.')
def _static_changes(snapshot: Snapshot) -> Iterator[_Fault]:
    yield from _counted(snapshot, 'changes', 'with another pose than the one before',
                        attrgetter('is_static'))


@_check('rep_105', INFO,
        'The order of earth, map, odom and base_link is not that of REP 105.',
        'Publish these frames as earth -> map -> odom -> base_link; leave out those that you do '
        'not need.')
def _rep_105(snapshot: Snapshot) -> Iterator[_Fault]:
    known = [name for name in _REP_105 if name in snapshot.tree_of]
    for upper, lower in pairwise(known):
        if (snapshot.tree_of[upper] == snapshot.tree_of[lower]
                and upper not in snapshot.ancestors(lower)):
            is_above = lower in snapshot.ancestors(upper)
            lowest = upper if is_above else lower
            path = [lowest, *snapshot.ancestors(lowest)][::-1]
            yield _Fault([upper, lower], f'{lower} is {"above" if is_above else "not below"} '
                         f'{upper}: {" -> ".join(map(shortened, path[-_SHOWN:]))}',
                         [track for name in (upper, lower)
                          for track in snapshot.by_child.get(name, ())])
