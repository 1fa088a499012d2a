"""The command `tf_doctor`: find faults in transforms, or explain the path between two frames."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from itertools import takewhile
import json
import time
from typing import Any, NamedTuple, Optional, TYPE_CHECKING

from dummy_arm.cli.bag_options import add_bag_options, bag_progress, check_partial, read_bag
from dummy_arm.cli.parser import (
    DEFAULT_TIME,
    listening_time,
    number,
    Parser,
    run,
    seconds,
    UsageError,
)
from dummy_arm.cli.progress import listen
from dummy_arm.inspection.diagnosis import (
    CHECKS,
    diagnose,
    Endpoint,
    ERROR,
    Finding,
    Headers,
    headers_of,
    not_checked,
    SEVERITIES,
    Snapshot,
)
from dummy_arm.inspection.forest import frequency
from dummy_arm.inspection.terminal import column_width, padded, width, wrapped
from dummy_arm.inspection.tf_statistics import Statistics, Track
from dummy_arm.tf import BufferCore, Frame
from dummy_arm.tf.bag import HEADERS, messages, NOT_RECORDED, TopicHeaders
from dummy_arm.tf.formatting import (
    comma_list,
    display_time,
    full_name,
    in_seconds,
    namespace_path,
    SECOND,
    shortened,
    suggest_names,
    TF_MESSAGE,
    visible,
)
from dummy_arm.tf.transform_table import header_frame, transform_tables

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.qos import QoSProfile

    from dummy_arm.tf import MessageBufferCore

#: For the path between two frames, the buffer keeps transforms for this time more than the command
#: listens (s).
_MARGIN = 5.0
#: The delays of the first messages of a publisher are not counted for this time (ns).
_SETTLING = SECOND // 5
#: The time between two searches for other topics (s).
_SCAN_INTERVAL = 0.5
#: The largest number of names or topics in a line.
_SHOWN = 5


class Observation(NamedTuple):
    """What was observed, and what was not."""

    snapshot: Snapshot
    where: str  #: where the transforms are from, such as 'in 5 s'
    total: int  #: the number of transforms
    publishers: dict[str, str]  #: by child: the names of the nodes that publish it
    not_checked: list[str]  #: what cannot be checked, and why


class Edge(NamedTuple):
    """An edge of a path between two frames."""

    frame: Frame  #: the child of the edge
    refusal: str  #: why the edge has no pose at the time of the path; '': it has one


class Explanation(NamedTuple):
    """A path between two frames, and why it gives no transform."""

    ends: tuple[str, str]
    stamp: int  #: the time of the transform (ns); 0: the path is static
    edges: list[Edge]
    roots: tuple[str, str]  #: the roots of the trees of the two frames
    why_not: str  #: why there is no transform; '': there is one
    age: str = ''  #: how old the transform is, in words; '': not known


def command(frame_a: Optional[str] = None, frame_b: Optional[str] = None, t: int = 0,
            duration: Optional[float] = None, as_json: bool = False,
            ignore: Sequence[str] = (), list_codes: bool = False, bag: Optional[str] = None,
            namespace: str = '', partial: bool = False, *, ros_args: Sequence[str] = ()) -> int:
    """
    Print what is wrong with the transforms, or explain the path between two frames.

    :param frame_a: the frame in which the pose of `frame_b` is wanted; None: check everything.
    :param frame_b: the other frame; None if `frame_a` is None.
    :param t: the time for which the path is explained (ns); 0: the latest time for which every
        edge has data.
    :param duration: how long to listen (s); None: 5 s.
    :param as_json: True: print JSON.
    :param ignore: the codes of findings that are not wanted.
    :param list_codes: True: print the codes of all findings, and do nothing else.
    :param bag: path of the bag to read; None: listen.
    :param namespace: the namespace of the topics `tf` and `tf_static`; '': none.
    :param partial: True: if the bag is damaged, read its undamaged parts.
    :param ros_args: the command line, with the name of the command; ROS reads what follows
        `--ros-args`.
    :returns: the exit code: 1 if there is an error, or no transform between the two frames.
    :raises UsageError: if an argument is wrong.
    :raises CommandError: if the bag cannot be read, or if ROS cannot be initialised.
    """
    ends = [name.removeprefix('/') for name in (frame_a, frame_b) if name is not None]
    if len(ends) == 1 or not all(ends):
        raise UsageError('give two frames to explain the path between them, or none to check '
                         'everything')
    if t and not ends:
        raise UsageError('-t needs two frames')
    for code in ignore:
        if code not in CHECKS:
            raise UsageError(
                f'unknown code {code!r}. {suggest_names(code, tuple(CHECKS), "codes")}')
    if bag is not None and duration is not None:
        raise UsageError('--time is for listening: leave it out with --bag')
    check_partial(bag, partial)
    duration = listening_time(duration)
    if list_codes:
        print('\n'.join(format_codes()))
        return 0
    if ends:
        a, b = ends
        if bag is not None and (buffer := read_bag(bag, namespace, partial)):
            explanation = explain(
                buffer, (a, b), t, _publishers_in(bag, namespace, partial, buffer))
        else:
            explanation = _explain_live((a, b), t, duration, ros_args, namespace)
        text, has_error = format_explanation(explanation), bool(explanation.why_not)
        data: Any = {
            'frames': explanation.ends, 'time': explanation.stamp, 'roots': explanation.roots,
            'why_not': explanation.why_not,
            'path': [{**edge.frame._asdict(), 'refusal': edge.refusal}
                     for edge in explanation.edges]}
    else:
        observation = (_observe_live(duration, ros_args, namespace) if bag is None else
                       _observe_bag(bag, namespace, partial))
        findings = diagnose(observation.snapshot, ignore)
        left_out = [*not_checked(observation.snapshot, ignore), *observation.not_checked]
        text = format_findings(observation, findings, left_out)
        has_error = any(finding.severity == ERROR for finding in findings)
        data = {'findings': [finding._asdict() for finding in findings],
                'not_checked': left_out, 'verdict': text[-1]}
    print(json.dumps(data, indent=2) if as_json else '\n'.join(text))
    return int(has_error)


# What is observed


class _HeaderSampler:
    """Subscriptions to other topics, which read the headers of a few messages each."""

    def __init__(self, node: 'Node') -> None:
        """
        Create the sampler, without a subscription.

        :param node: the node that subscribes.
        """
        self._node = node
        self._next_scan = 0.0
        #: By topic: the frames in the headers that were read.
        self.frames: dict[str, set[str]] = {}
        #: By topic: why its headers are not read.
        self.not_read: dict[str, str] = {}

    def scan_if_due(self) -> None:
        """
        Subscribe to new topics whose messages begin with a header, but twice a second only.

        A node cannot subscribe to a topic with two types: topics of transforms are left out.
        """
        if time.monotonic() < self._next_scan:
            return
        self._next_scan = time.monotonic() + _SCAN_INTERVAL
        for topic, types in self._node.get_topic_names_and_types():
            if TF_MESSAGE in types or (topic in self.frames and len(types) == 1):
                continue
            published = sorted({
                info.topic_type for info in self._node.get_publishers_info_by_topic(topic)})
            if published and topic not in self.frames:
                self.frames[topic] = set()
                self._examine(topic, published[0])
            if len(published) > 1:
                self.not_read[topic] = (
                    f'only one type is read; its publishers have the types {", ".join(published)}')

    def _examine(self, topic: str, type_name: str) -> None:
        """Subscribe to a topic if its messages begin with a header."""
        package, is_message, name = type_name.partition('/msg/')
        if not is_message:  # the topics of services and actions have no header
            return
        try:
            message_type: Any = getattr(import_module(f'{package}.msg'), name)
            fields = message_type.get_fields_and_field_types()
            if next(iter(fields.values()), '') == 'std_msgs/Header':
                self._subscribe(topic, message_type)
        except (ImportError, AttributeError):
            self.not_read[topic] = f'its type {type_name} cannot be imported'
        except Exception as error:  # the code of another package can raise any error
            self.not_read[topic] = f'{type_name}: {type(error).__name__}: {error}'

    def _subscribe(self, topic: str, message_type: Any) -> None:
        """Subscribe to a topic until the headers of some messages are read."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
        # A best-effort, volatile subscription matches all publishers. But latched messages of the
        # past are sent only to a reliable, transient-local one.
        latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
        other = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE
        offered = [(info.qos_profile.reliability, info.qos_profile.durability)
                   for info in self._node.get_publishers_info_by_topic(topic)]
        for reliability, durability in {
                latched if each == latched else other for each in offered} or {other}:
            self._read_headers(topic, message_type, QoSProfile(
                depth=HEADERS, reliability=reliability, durability=durability))

    def _read_headers(self, topic: str, message_type: Any, profile: 'QoSProfile') -> None:
        """Read the headers of some messages, then unsubscribe."""
        from rclpy.event_handler import SubscriptionEventCallbacks
        count = 0
        subscription: Any = None

        def read(data: bytes) -> None:
            """
            Read the header at the beginning of a message.

            :param data: the message.
            """
            nonlocal count
            count += 1
            if count <= HEADERS:
                with suppress(ValueError):  # a malformed message
                    self.frames[topic].add(header_frame(data))
            elif subscription is not None:
                self._node.destroy_subscription(subscription)

        subscription = self._node.create_subscription(
            message_type, topic, read, profile, raw=True,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))


def _observe_live(duration: float, ros_args: Sequence[str], namespace: str) -> Observation:
    """Listen to transforms, and to the headers on other topics."""
    from dummy_arm.cli.node import spinning_node
    from dummy_arm.inspection.frame_listener import FrameListener
    statistics, malformed, dropped, end = Statistics(_SETTLING), Counter[str](), 0, 0
    with spinning_node('tf_doctor', ros_args, namespace) as node:
        frame_listener = FrameListener(node)
        listener, sampler = frame_listener.publisher_listener, _HeaderSampler(node)

        def poll() -> None:
            """Count what has arrived."""
            nonlocal dropped, end
            end = frame_listener.now()
            offset = end - time.time_ns() if end else None
            received, newly_dropped = listener.received()
            dropped += newly_dropped
            for table in transform_tables(received, lambda error: malformed.update([str(error)])):
                statistics.add(table, offset)
            sampler.scan_if_due()

        elapsed = listen(duration, frame_listener.buffer.frame_names, poll)
        tracks = statistics.tracks()
        nodes = listener.names_of([*(track.publisher for track in tracks),
                                   *(publisher for publisher, _ in statistics.empty_names)])
        static, dynamic = frame_listener.topics
        not_known = _not_known(statistics)
        if tracks and all(listener.is_present(track.publisher) is None for track in tracks):
            not_known['nodes'] = 'the ROS graph does not know the publishers of the transforms'
        if not end:
            not_known['arrivals'] = 'use_sim_time is set, but no message has arrived on /clock'
        hint = ''
        if node.count_publishers('/clock') and not node.get_parameter('use_sim_time').value:
            hint = ('. /clock is published: with --ros-args -p use_sim_time:=true, stamps are '
                    'compared with it')
        snapshot = Snapshot(
            tracks, (dynamic, static), nodes=nodes, present=listener.present,
            endpoints=[*_endpoints(node, (dynamic, static))],
            headers=headers_of(
                dynamic.rpartition('/')[0],
                [Headers(topic, frozenset(frames)) for topic, frames in sampler.frames.items()],
                [topic for topic, types in node.get_topic_names_and_types()
                 if TF_MESSAGE in types and node.count_publishers(topic)]),
            empty_names=statistics.empty_names, not_known=not_known,
            why_no_transforms='' if tracks else frame_listener.why_no_frames(),
            other_namespaces=frame_listener.other_topics_hint(), end=end, clock_hint=hint)
    left_out = [f'headers on {topic}: {why}' for topic, why in sorted(sampler.not_read.items())]
    if dropped:
        left_out.append(f'{dropped} messages: they arrived too fast')
    return Observation(
        snapshot, f'in {elapsed:.1f} s', statistics.count, _publishers(tracks, nodes),
        [*left_out, *_not_counted(statistics, malformed)])


def _publishers(tracks: Iterable[Track], nodes: Mapping[str, str]) -> dict[str, str]:
    """Return the names of the nodes that publish each child."""
    names: dict[str, dict[str, None]] = {}
    for track in tracks:
        names.setdefault(track.child, {})[nodes.get(track.publisher, track.publisher)] = None
    return {child: ', '.join(map(shortened, each)) for child, each in names.items()}


def _not_known(statistics: Statistics) -> dict[str, str]:
    """Return what is not known; see `Snapshot`."""
    return {'headers': 'there are too many frames'} if statistics.not_counted else {}


def _not_counted(statistics: Statistics, malformed: Counter[str]) -> Iterator[str]:
    """Yield a text for what `statistics` does not count."""
    if statistics.not_counted:
        yield f'{statistics.not_counted} transforms: there are too many frames'
    for error, count in malformed.most_common(_SHOWN):
        yield f'{count} message{"s" if count > 1 else ""} of this kind: {error}'


def _endpoints(node: 'Node', topics: Sequence[str]) -> Iterator[Endpoint]:
    """Yield the publishers on the topics, with the first listener that each does not match."""
    from rclpy.qos import DurabilityPolicy, qos_check_compatible, QoSCompatibility

    from dummy_arm.tf.publisher_listener import gid_of
    own_name = node.get_fully_qualified_name()
    for topic in topics:
        # The subscription of this node has the QoS of tf2's TransformListener; it comes first.
        listeners = sorted((info for info in node.get_subscriptions_info_by_topic(topic)
                            if info.topic_type == TF_MESSAGE),
                           key=lambda info: _full_name(info) != own_name)
        for publisher in node.get_publishers_info_by_topic(topic):
            if publisher.topic_type != TF_MESSAGE:
                yield Endpoint(topic, _full_name(publisher), False, '', publisher.topic_type)
                continue
            mismatch = ''
            for listener in listeners:
                compatibility, reason = qos_check_compatible(
                    publisher.qos_profile, listener.qos_profile)
                if compatibility == QoSCompatibility.ERROR:
                    name = _full_name(listener)
                    mismatch = (f'{"a TransformListener" if name == own_name else name} '
                                f'({reason.replace("ERROR: ", "").rstrip(";. ")})')
                    break
            yield Endpoint(
                topic, _full_name(publisher), topic == topics[1]
                and publisher.qos_profile.durability == DurabilityPolicy.VOLATILE, mismatch,
                publisher=gid_of(publisher))


def _full_name(info: Any) -> str:
    return full_name(info.node_namespace, info.node_name)


def _observe_bag(bag: str, namespace: str, partial: bool) -> Observation:
    """
    Read the transforms of a bag, and the headers on its other topics.

    :raises UsageError: if the path is empty.
    :raises CommandError: if the bag cannot be read.
    """
    malformed = Counter[str]()
    topics: list[TopicHeaders] = []
    statistics = _count_bag(bag, namespace, partial, topics.extend,
                            lambda error: malformed.update([str(error)]))
    tracks = statistics.tracks()
    publishers = {*(track.publisher for track in tracks),
                  *(publisher for publisher, _ in statistics.empty_names)} - {NOT_RECORDED}
    nodes = {name: name for name in publishers}
    not_known = _not_known(statistics)
    not_known['qos'] = 'the QoS of the publishers is not read from a bag'
    if not publishers:
        not_known['nodes'] = 'the bag does not record which node has sent a message'
    if not any(track['delays'] for track in tracks):
        not_known['arrivals'] = 'there are no dynamic transforms with a time of the recording'
    path = namespace_path(namespace)
    own_topics = f'{path}/tf', f'{path}/tf_static'
    tf_topics = [topic.topic for topic in topics if topic.frames == frozenset()
                 and topic.topic.removesuffix('_static').endswith('/tf')
                 and topic.topic not in own_topics]
    others = [topic for topic in tf_topics if topic.endswith('/tf')]
    is_static = all(track.is_static for track in tracks)
    snapshot = Snapshot(
        tracks, own_topics, nodes=nodes,
        endpoints=[Endpoint(topic.topic, '', False, '', topic.msgtype) for topic in topics
                   if topic.topic in own_topics],
        headers=headers_of(path, [Headers(topic.topic, topic.frames) for topic in topics
                                  if topic.frames], tf_topics),
        empty_names=statistics.empty_names, not_known=not_known, has_record_times=True,
        other_namespaces='' if not others or not is_static else (
            f'there is no dynamic transform on {path}/tf, but there are transforms on '
            f'{comma_list(others, _SHOWN)}: use --namespace'))
    left_out = [
        f'headers on {topic.topic}: the definition of its type {topic.msgtype} is not known'
        for topic in topics if topic.frames is None]
    return Observation(snapshot, f'in {bag}', statistics.count, _publishers(tracks, nodes),
                       [*left_out, *_not_counted(statistics, malformed)])


def _count_bag(bag: str, namespace: str, partial: bool,
               on_headers: Optional[Callable[[list[TopicHeaders]], object]] = None,
               on_malformed: Callable[[ValueError], object] = lambda error: None) -> Statistics:
    """Count the transforms of a bag; the last two arguments are those of the functions called."""
    statistics = Statistics()
    with bag_progress(bag) as on_progress:
        for table in transform_tables(
                messages(bag, namespace=namespace, partial=partial, on_progress=on_progress,
                         on_headers=on_headers), on_malformed):
            statistics.add(table)
    return statistics


# The path between two frames


def _publishers_in(bag: str, namespace: str, partial: bool, buffer: BufferCore) -> dict[str, str]:
    """
    Return the names of the nodes that publish each child, if the bag records them.

    The buffer of the bag knows only the last publisher of a frame, so the bag is read once more.
    """
    if all(frame.authority == NOT_RECORDED for frame in buffer.frames()):
        return {}
    return _publishers(_count_bag(bag, namespace, partial).tracks(), {})


def _explain_live(ends: tuple[str, str], stamp: int, duration: float, ros_args: Sequence[str],
                  namespace: str) -> Explanation:
    """Listen to transforms; then explain the path between two frames."""
    from dummy_arm.cli.node import spinning_node
    from dummy_arm.inspection.frame_listener import FrameListener
    statistics = Statistics()
    with spinning_node('tf_doctor', ros_args, namespace) as node:
        frame_listener = FrameListener(node, max(10.0, duration) + _MARGIN)
        buffer, listener = frame_listener.buffer, frame_listener.publisher_listener

        def poll() -> None:
            """Count what has arrived."""
            for table in transform_tables(listener.received().messages):
                statistics.add(table)

        listen(duration, buffer.frame_names, poll)
        tracks = statistics.tracks()
        explanation = explain(buffer, ends, stamp, _publishers(
            tracks, listener.names_of(track.publisher for track in tracks)))
        if not buffer.frame_names():
            return explanation._replace(
                why_not=f'No transform has been received. {frame_listener.why_no_frames()}')
        if explanation.why_not and (hint := frame_listener.topics_hint()):
            return explanation._replace(why_not=f'{explanation.why_not} {hint}')
        now = frame_listener.now()
    if not now or not explanation.stamp or stamp:
        return explanation
    return explanation._replace(
        age=f', {in_seconds(max(0, now - explanation.stamp)):.3f} s before the end of listening')


def explain(buffer: 'BufferCore | MessageBufferCore', ends: tuple[str, str], stamp: int,
            publishers: Mapping[str, str]) -> Explanation:
    """
    Explain the path between two frames.

    :param buffer: the buffer with the transforms.
    :param ends: the two frames.
    :param stamp: time of the transform (ns); 0: the latest time for which every edge has data.
    :param publishers: by child: the names of the nodes that publish it.
    :returns: the path: from the first frame up to the frame where the two meet, then down to the
        second frame. If the two frames are in different trees, the path goes up to both roots.
    """
    why_not = buffer.why_not(*ends, stamp)
    frames = {frame.name: frame._replace(authority=publishers.get(frame.name, frame.authority))
              for frame in buffer.frames()}
    path, roots = _path(frames, ends)
    stamp = stamp or min((frame.latest for frame in path if frame.latest), default=0)
    # The parents at this time, which may have been others.
    for frame in buffer.frames(stamp):
        frames[frame.name] = frames[frame.name]._replace(parent=frame.parent)
    path, roots = _path(frames, ends)
    return Explanation(ends, stamp, [Edge(frame, _refusal(frame, stamp)) for frame in path], roots,
                       why_not)


def _path(frames: Mapping[str, Frame], ends: tuple[str, str]
          ) -> tuple[list[Frame], tuple[str, str]]:
    """
    Return the path between two frames, and its roots.

    :returns: the edges, as in `explain`; and the roots above the two frames. If the frames meet,
        both are the frame where they meet.
    """
    chains: list[dict[str, None]] = []
    for name in ends:
        chain = {name: None}
        while name in frames and (name := frames[name].parent) not in chain:
            chain[name] = None
        chains.append(chain)
    first, second = ({name: i for i, name in enumerate(chain)} for chain in chains)
    # If there is a loop, several frames are in both chains.
    meeting = min(first.keys() & second.keys(), key=lambda name: first[name] + second[name],
                  default='')
    edges = [[frames[name] for name in takewhile(meeting.__ne__, chain) if name in frames]
             for chain in chains]
    return [*edges[0], *edges[1][::-1]], (
        meeting or [*first][-1], meeting or [*second][-1])


def _refusal(frame: Frame, stamp: int) -> str:
    """Return why an edge has no pose at a time; '' if it has one."""
    if frame.is_static or frame.oldest <= stamp <= frame.latest:
        return ''
    if stamp > frame.latest:
        return (f'its newest transform is {in_seconds(stamp - frame.latest):.3f} s older than '
                f'{display_time(stamp)}: the pose at that time has not arrived yet, or its '
                'publisher has stopped')
    return (f'its oldest transform is {in_seconds(frame.oldest - stamp):.3f} s newer than '
            f'{display_time(stamp)}: the pose at that time was never received, or is no longer '
            'kept')


# What is printed


def format_explanation(explanation: Explanation) -> list[str]:
    """
    Format the path between two frames.

    :param explanation: the path.
    :returns: the lines; the last one says whether there is a transform.
    """
    first, second = map(shortened, explanation.ends)
    rows = [[f'{shortened(frame.parent)} -> {shortened(frame.name)}',
             'static' if frame.is_static else
             '?' if (rate := frequency(frame)) is None else f'{rate:.1f} Hz',
             '' if frame.is_static else
             f'{display_time(frame.oldest)} to {display_time(frame.latest)}',
             shortened(frame.authority)] for frame, _ in explanation.edges]
    widths = [column_width(map(width, column)) for column in zip(*rows)]
    lines = []
    for row, edge in zip(rows, explanation.edges):
        lines.append('  '.join(map(padded, row, widths)).rstrip())
        if edge.refusal:
            lines += wrapped(f'No pose at that time: {edge.refusal}.', '    ')
    if lines:
        what = f'The path from {first} to {second}'
        if explanation.roots[0] != explanation.roots[1]:
            what = f'The edges above {first} and {second}'
            lines += ['', f'No edge connects {" and ".join(map(shortened, explanation.roots))}.']
        lines = [*wrapped(f'{what}, with the rate, the oldest and the newest stamp, and the '
                          'publisher of each edge:'), '', *lines, '']
    when = f'at {display_time(explanation.stamp)}' if explanation.stamp else 'at all times'
    if not explanation.why_not:
        return [*lines, f'The transform from {second} to {first} exists {when}{explanation.age}.']
    return [*lines, *wrapped(visible(
        f'There is no transform from {second} to {first}: {explanation.why_not}'))]


def format_codes() -> list[str]:
    """
    Format the list of all codes.

    :returns: the lines.
    """
    lines = []
    for check in CHECKS.values():
        lines += [f'{check.code} ({check.severity})',
                  *wrapped(f'{check.meaning} {check.remedy}', '    ')]
    return lines


def format_findings(observation: Observation, findings: Sequence[Finding],
                    left_out: Sequence[str]) -> list[str]:
    """
    Format what was found.

    :param observation: what was observed.
    :param findings: what was found.
    :param left_out: what was not checked, and why.
    :returns: the lines; the last one is the verdict.
    """
    lines = []
    for finding in findings:
        names = comma_list(finding.frames or finding.topics, _SHOWN, shortened)
        topics, nodes = (comma_list(each, _SHOWN) for each in (finding.topics, finding.nodes))
        where = ', '.join(filter(None, [topics and f'on {topics}', nodes and f'by {nodes}']))
        lines += [visible(f'{finding.severity} {finding.code}: {names}'),
                  *wrapped(visible(f'{finding.evidence.rstrip(".")}.'), '    '),
                  *(wrapped(visible(f'{where[0].upper()}{where[1:]}.'), '    ') if where else ()),
                  *wrapped(finding.remedy, '    '), '']
    for text in left_out:
        lines += wrapped(visible(f'not checked: {text}'))
    counts = {severity: sum(finding.severity == severity for finding in findings)
              for severity in SEVERITIES}
    found = ', '.join(f'{count} {severity}{"s" if count > 1 else ""}'
                      for severity, count in counts.items() if count)
    snapshot = observation.snapshot
    return [*lines, *([''] if left_out else []), visible(
        f'{found or "healthy"}: {_count(observation.total, "transform")} of '
        f'{_count(len(snapshot.tree_of), "frame")} {observation.where}')]


def _count(number: int, noun: str) -> str:
    return f'{number} {noun}{"s" if number != 1 else ""}'


def main(args: Optional[Sequence[str]] = None) -> int:
    """
    Run the command; see `--help`.

    :param args: the command line without the name of the command; None: `sys.argv[1:]`.
    :returns: the exit code.
    """
    parser = Parser(
        'tf_doctor', 'Find faults in the transforms, and say what to do. If two frames are named, '
        'explain the path between them instead. The exit code is 1 if there is an error, or no '
        'transform between the two frames.',
        'examples: tf_doctor\n          tf_doctor --bag robot.mcap\n'
        '          tf_doctor map end_effector')
    parser.add_argument('frame_a', nargs='?')
    parser.add_argument('frame_b', nargs='?')
    parser.add_argument('-t', type=seconds, default=0, metavar='TIME',
                        help='with two frames: the time of the transform (s; default: 0, the '
                        'latest)')
    parser.add_argument('--time', dest='duration', type=number, metavar='SECONDS',
                        help=f'how long to listen (s; default: {DEFAULT_TIME:g})')
    parser.add_argument('--json', dest='as_json', action='store_true', help='print JSON')
    parser.add_argument('--ignore', action='append', default=[], metavar='CODE',
                        help='leave out findings with this code; can be given several times')
    parser.add_argument('--list', dest='list_codes', action='store_true',
                        help='print the codes of all findings with their meanings, then exit')
    add_bag_options(parser)
    return run(parser, command, args)
