"""
The hints that follow tf2's words: one sentence on the cause of an error, and one on the remedy.

A hint is written when the text of an error is first read, without the lock of the buffer. It uses
the facts of the failed lookup, and the surroundings as they are when the text is read.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Optional

from puretf._text.names import comma_list, MAX_TOPICS, quoted, see, shortened, TF_MESSAGE
from puretf._text.similar_names import difference, may_be_one_robot, suggest_names
from puretf._text.times import exact_time, is_frozen, SECOND
from puretf.exceptions import ExtrapolationException, TransformException, with_hint

#: Times that are farther apart (ns) are probably, or certainly, not from one clock.
_OTHER_CLOCK, _DAY = 60 * SECOND, 24 * 3600 * SECOND
#: Data still arrive if this time (ns), or three periods of the edge, is not over. Up to this time
#: after the newest stamp, a transform is on its way.
_RECENT = SECOND
_LATEST = 'time 0 (Time()) for the latest transform'
_CLOCKS = ('Set use_sim_time in all nodes, or in none; if it is set alike, synchronise the clocks '
           'of the computers.')


class Publisher(NamedTuple):
    """A publisher on a topic of a listener."""

    node: str  #: the full name of its node
    topic: str
    type: str  #: such as TF_MESSAGE
    gid: str  #: in hex
    lacks: str = ''  #: what the listener's QoS requires: 'reliable' or 'transient local'


class Elsewhere(NamedTuple):
    """An edge that was received on a topic to which the listener does not listen."""

    parent: str
    child: str
    topic: str
    nodes: Sequence[str]  #: the nodes that publish on the topic
    siblings: Collection[str] = ()  #: all child frames on the topic

    @property
    def base(self) -> str:
        """The topic of the dynamic transforms that belongs to this one."""
        return self.topic.removesuffix('_static')


class Blocked(NamedTuple):
    """A node that cannot call back while a lookup waits."""

    why: str  #: the reason, and the remedy
    children: Collection[str]  #: the frames that it has broadcast


class Waited(NamedTuple):
    """How a lookup has waited in vain."""

    seconds: float
    blocked: Mapping[str, Blocked] = MappingProxyType({})  #: by the full name of the node


class Surroundings(NamedTuple):
    """What is known outside of a buffer; the defaults mean that nothing is."""

    now: int = 0  #: the time of the node (ns); 0: not known
    is_simulated: bool = False  #: True if the clock of the node is simulated
    clock_nodes: Sequence[str] = ()  #: the nodes that publish on /clock
    #: The topics of the listener: of static transforms, and of dynamic ones. Empty: there is no
    #: listener, so nothing is known of publishers, and nothing will arrive.
    topics: Sequence[str] = ()
    publishers: Sequence[Publisher] = ()  #: all publishers on these topics
    ended: Mapping[str, str] = MappingProxyType({})  #: by gid: the nodes of ended publishers
    is_volatile: bool = False  #: True if the subscription to static transforms is volatile
    is_fed: bool = False  #: whether the topic of dynamic transforms has data or a publisher
    has_data: bool = False  #: whether any transform was received
    is_new: bool = False  #: whether the listener may not have discovered all publishers yet
    #: Other topics with publishers of transforms, without the ending '_static', the nearest first.
    other_topics: Sequence[str] = ()
    #: Returns the first edge on these topics that is wanted; may listen to them for a moment.
    elsewhere: Callable[[Callable[[Elsewhere], bool]], Optional[Elsewhere]] = lambda _: None
    joint_states: str = ''  #: the topic of joint states if it has a publisher
    domain: int = 0  #: the ROS domain
    #: Returns a sentence on other ROS domains with processes of this machine; '' if there is none.
    other_domains: Callable[[], str] = str
    hides_others: str = ''  #: the environment variable that hides other machines, and its value
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


# Frames that are missing


def unknown_frame(look: Look, name: str, known: tuple[str, ...],
                  find_children: Callable[[], set[str]], advice: str, waited: Optional[Waited]
                  ) -> str:
    around = look()
    if not known and not around.topics:
        return f'The buffer is empty.{_missing_part(advice) if advice else ""}'
    if advice:
        cause = _missing_part(advice)
    elif cause := (_elsewhere(around, name, (), known, find_children) or topics(around)
                   or nothing(around)):
        cause = f' {cause}'
    else:
        cause = see('A frame does not exist')
    hint = suggest_names(name, known)
    if waited and not hint.startswith('Nearest') and (
            blocked := _only_blocked(around, waited, f'If it is to send {quoted(name)}, it')):
        return f'{hint} {blocked}'
    return hint + cause


def unconnected(look: Look, target: str, target_root: str, source: str, source_root: str,
                advice: str, find_slip: Callable[[], str], find_children: Callable[[], set[str]],
                waited: Optional[Waited]) -> str:
    around = look()
    if advice:
        remedy = _missing_part(advice)
    elif remedy := find_slip():
        remedy = f' {remedy}'
    elif not around.topics:
        remedy = see('Two unconnected trees')
    else:
        remedy = ' ' + (
            _elsewhere(around, '', (target_root, source_root), (), find_children)
            or topics(around)
            or (_only_blocked(around, waited, 'If it is to connect them, it') if waited else '')
            or f'Publish a transform between the two trees.{see("Two unconnected trees")}')
    return (f' {quoted(target)} is in the tree with root {quoted(target_root)}, '
            f'{quoted(source)} in the tree with root {quoted(source_root)}.{remedy}')


def slip(name: str, other: str) -> str:
    """Say that two names, each in one of two trees, are probably meant to be one."""
    how = difference(name, other)
    remedy = ('' if how != 'a letter' else 'if they are one frame, ') + 'use one name'
    return (f'{quoted(name)} in the one tree and {quoted(other)} in the other differ by {how}: '
            f'{remedy}.{see("Two unconnected trees")}')


def _missing_part(advice: str) -> str:
    return advice + see('No static transforms from a bag')


def _elsewhere(around: Surroundings, name: str, roots: Collection[str], known: Collection[str],
               find_children: Callable[[], set[str]]) -> str:
    """Say that a missing frame, or the parent of a root, is published on another topic."""
    if not around.other_topics:
        return ''
    own = around.topics[-1].removesuffix('_static')
    edge = around.elsewhere(lambda each: (
        name in each[:2] or each.child in roots) and may_be_one_robot(own, each.base))
    if edge is None:
        return ''
    text = (f'{quoted(edge.parent)} -> {quoted(edge.child)} is published on '
            f'{shortened(edge.topic)} by {comma_list(edge.nodes, MAX_TOPICS, shortened)}, but '
            f'this listener is on {" and ".join(around.topics[::-1])}.')
    if len(around.topics) == 1 and own == edge.base:
        return f'{text} Use a TransformListener.{see("A frame does not exist")}'
    # Another robot has frames of the same names.
    is_another = not find_children().isdisjoint(edge.siblings)
    if is_another and roots:
        return ''
    if is_another or (edge.child not in roots and edge.parent not in known
                      and edge.child not in known):
        base = shortened(edge.base)
        return (f'{text} To listen to {base}, pass {_listening_to(base)}'
                f'{see("A leading slash, or a namespace")}')
    base = shortened(max(own, edge.base, key=lambda topic: topic.count('/')))
    return (f'{text} Remap both /tf and /tf_static in all nodes of the robot (--ros-args -r '
            f'/tf:={base} -r /tf_static:={base}_static), or in none of them.'
            f'{see("Half of a robot is in a namespace")}')


def topics(around: Surroundings) -> str:
    """Say why transforms may not arrive on the topics; '' if there is no sign of it."""
    for find, section in ((wrong_type, 'A frame does not exist'),
                          (_qos, 'The QoS of /tf_static'),
                          (other_topics, 'A leading slash, or a namespace')):
        if hint := find(around):
            return hint + see(section)
    return ''


def wrong_type(around: Surroundings) -> str:
    """Say who publishes another type than TFMessage on the topics of transforms."""
    wrong = dict.fromkeys(
        f'{shortened(each.node)} publishes {shortened(each.type)} on {each.topic}'
        for each in around.publishers if each.type != TF_MESSAGE)
    if not wrong:
        return ''
    return (f'{comma_list([*wrong], MAX_TOPICS)}. The type must be {TF_MESSAGE}: send transforms '
            'with a TransformBroadcaster or a StaticTransformBroadcaster.')


def _qos(around: Surroundings) -> str:
    """Say which transforms are lost, since the QoS of publisher and listener do not match."""
    if around.is_volatile:
        return (f'This listener of {around.topics[0]} is not transient local, so it misses what '
                'was sent before its start. Omit static_qos, or make it transient local.')
    found = []
    for lack, remedy in (
            ('reliable', 'Send with a TransformBroadcaster, or pass a best-effort qos to the '
             'TransformListener.'),
            ('transient local', 'Send with a StaticTransformBroadcaster.')):
        nodes: dict[str, set[str]] = {}
        for each in around.publishers:
            if each.type == TF_MESSAGE and each.lacks == lack:
                nodes.setdefault(each.topic, set()).add(shortened(each.node))
        found += [f'Nothing arrives on {topic} from {comma_list(sorted(names), MAX_TOPICS)}, '
                  f'whose publisher is not {lack}. {remedy}' for topic, names in nodes.items()]
    return ' '.join(found)


def other_topics(around: Surroundings) -> str:
    """Say which other topics have transforms, and how to receive them."""
    if around.is_fed or not around.other_topics or len(around.topics) == 1:
        return ''
    first = shortened(around.other_topics[0])
    others = comma_list(around.other_topics, MAX_TOPICS, shortened)
    return (f'No transform has arrived on {around.topics[-1]}, but transforms are published on '
            f'{others}. To listen to {first}, pass {_listening_to(first)}')


def _listening_to(topic: str) -> str:
    namespace, _, name = topic.rpartition('/')
    option = (f'pass --ros-args -r /tf:={topic} -r /tf_static:={topic}_static' if name != 'tf' else
              f'pass --namespace {namespace[1:]}' if namespace else 'omit --namespace')
    return (f"tf_topic='{topic}', tf_static_topic='{topic}_static' to the TransformListener; in "
            f'commands, {option}.')


def nothing(around: Surroundings) -> str:
    """Say why nothing at all has been received; '' if something has, or without a listener."""
    if around.has_data or not around.topics:
        return ''
    if around.is_new:
        text = 'The listener has just started; discovery can take some seconds.'
    elif around.publishers:
        nodes = sorted({shortened(each.node) for each in around.publishers})
        text = f'Nothing has arrived yet from {comma_list(nodes, MAX_TOPICS)}.'
    elif around.joint_states:
        text = (f'{around.joint_states} has a publisher, but nothing publishes transforms: start '
                'robot_state_publisher FILE.')
    else:
        hidden = f' {around.hides_others} hides other machines.' if around.hides_others else ''
        text = (f'0 publishers on {" and ".join(around.topics[::-1])} were found in ROS domain '
                f'{around.domain}.{around.other_domains()}{hidden} '
                'Start a program that publishes, with the same ROS_DOMAIN_ID.')
    return text + see('A frame does not exist')


def _only_blocked(around: Surroundings, waited: Waited, condition: str) -> str:
    """Say that no publisher could send while the lookup waited; '' if one could."""
    nodes = {each.node for each in around.publishers if each.type == TF_MESSAGE}
    if not nodes or not waited.blocked.keys() >= nodes:
        return ''
    node = min(nodes)
    who = 'this node' if node == around.node else shortened(node)
    return (f'Only {who} publishes on {around.topics[-1]}. {condition} {waited.blocked[node].why}'
            f'{see("A lookup that waits for its own node")}')


def _blocked(edge: 'Edge', around: Surroundings, waited: Waited) -> str:
    """Say that the publisher of an edge could not send while the lookup waited."""
    if edge.silence < waited.seconds * SECOND:
        return ''
    of_edge = around.node_of(edge.authority)
    for node, blocked in waited.blocked.items():
        if node == of_edge or (not of_edge and edge.child in blocked.children):
            who = 'This node' if node == around.node else shortened(node)
            return (f' {who} publishes it, and {blocked.why}'
                    f'{see("A lookup that waits for its own node")}')
    return ''


def loop(chain: Sequence[str]) -> str:
    """Name the frames of the loop at the upper end of a chain, or say that the chain is long."""
    last = chain[-1]
    earlier = [i for i, frame in enumerate(chain[:-1]) if frame == last]
    if not earlier:
        return f'There is no loop, but a chain of more than {len(chain) - 1} edges.'
    return (f'The loop: {" -> ".join(map(quoted, reversed(chain[earlier[-1]:])))}. Remove one of '
            f'these transforms.{see("Other faults")}')


# Times without data


class Edge(NamedTuple):
    """The edge that has no data for the time of a lookup; all times are in ns."""

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
    takes_ns: bool  #: True if the times of the buffer are integers

    @property
    def period(self) -> int:
        return min((self.latest - self.oldest) // max(self.samples - 1, 1), _OTHER_CLOCK)

    @property
    def still_arrives(self) -> bool:
        """Whether transforms arrive, as often as before; stamps may be from another clock."""
        return self.silence <= max(_RECENT, 3 * self.period)

    @property
    def is_frozen(self) -> bool:
        """Whether several transforms have arrived, all with the same stamp."""
        return is_frozen(self.oldest, self.latest, self.samples + self.repeated)


def cleared(look: Look, frame: str, waited: Optional[Waited]) -> str:
    around = look()
    text = (f' No transform of {quoted(frame)} has been received since the buffer was cleared, or '
            'mended after an interrupted insertion.')
    section = see('A jump back in time')
    if not around.topics:
        return text + section
    clocks = clock_publishers(around.clock_nodes) if around.is_simulated else ''
    if clocks and len(around.clock_nodes) > 1:
        section = see('Two nodes on /joint_states or /clock')
    return f'{text}{clocks} Pass timeout= to wait for the next one.{section}'


def clock_publishers(nodes: Sequence[str]) -> str:
    """Name the publishers of /clock; several make the time jump."""
    if len(nodes) < 2:
        return f' Publisher of /clock: {shortened(nodes[0])}.' if any(nodes) else ''
    return (f' {len(nodes)} nodes publish /clock, so that the time jumps between them: '
            f'{comma_list(nodes, MAX_TOPICS, shortened)}. Stop all but one.')


def extrapolation(look: Look, edge: Edge, time: int, waited: Optional[Waited]) -> str:
    """Say how far a time is from the samples of an edge, why, and what to do."""
    name = f'{quoted(edge.parent)} -> {quoted(edge.child)}'
    is_late = time > edge.latest
    where = (f' and end {exact_time(time - edge.latest)} s before that time' if is_late else
             f' and begin {exact_time(edge.oldest - time)} s after that time'
             if time < edge.oldest else '')
    span = (f'are from {exact_time(edge.oldest)} to {exact_time(edge.latest)}'
            if edge.oldest != edge.latest else f'are all at {exact_time(edge.latest)}')
    around = look()
    if edge.is_frozen and not edge.refused:
        cause = _one_time(edge)
    elif not around.topics:
        cause = _without_listener(edge, time)
    elif is_late:
        cause = _late(edge, time, around, waited)
    else:
        cause = _early(edge, time, around)
    return f' The data of edge {name} {span}{where}.{cause}'


def _without_listener(edge: Edge, time: int) -> str:
    """Say what is known of a buffer that a program has filled, or a bag."""
    if edge.oldest == edge.latest and not edge.has_dropped and not edge.refused:
        return see('Only one time is in the buffer')
    if time > edge.latest:
        return see('Extrapolation into the future')
    if edge.takes_ns and edge.oldest <= time * SECOND <= edge.latest:
        return f' Times are in ns: {time} s is within the data, {time} ns is not.'
    around = Surroundings()
    return (_refused(edge, around, time) or _dropped(edge, time, around)
            or see('Extrapolation into the past'))


def _late(edge: Edge, time: int, around: Surroundings, waited: Optional[Waited]) -> str:
    ahead = time - edge.latest
    section = see('Extrapolation into the future')
    arrives = (edge.still_arrives and edge.authority not in around.ended
               and bool(around.nodes(around.topics[-1])))
    if edge.is_refusing:
        return _refused(edge, around, edge.refused_stamp)
    if edge.samples == 1 and not arrives and not edge.has_dropped:
        return _one_time(edge)
    if waited and (blocked := _blocked(edge, around, waited)):
        return blocked
    if not arrives:
        clocks = ('' if ahead - edge.silence <= _OTHER_CLOCK else
                  f' And {_which_clocks(edge, time, around)} {_CLOCKS}')
        return (f' None has arrived for {edge.silence / SECOND:.1f} s: '
                f'{_why_silent(edge, around)}, or look up {_LATEST}.{clocks}{section}')
    how = (f'Data arrive every {edge.period / SECOND:.1f} s' if edge.period > _RECENT else
           'Data still arrive')
    if ahead > _OTHER_CLOCK:
        return (f' {how}, but {_which_clocks(edge, time, around)} {_CLOCKS}'
                f'{see("use_sim_time and the wall clock")}')
    wait = (f'it has not come within {waited.seconds:g} s, pass a longer timeout=' if waited else
            'pass timeout= to wait for it' if ahead <= _RECENT else
            f'pass a timeout= of more than {ahead / SECOND:.1f} s')
    # At its arrival, the newest was so much behind the clock.
    behind = around.now - edge.latest - edge.silence if around.now else 0
    if behind > _RECENT:
        clocks = f' {_CLOCKS}' if behind >= _OTHER_CLOCK else ''
        return (f' {how}, {behind / SECOND:.1f} s behind the clock of this node (a recording, or '
                f'clocks that differ); this transform is on its way: {wait}, or {_LATEST}.'
                f'{clocks}{section}')
    if around.now and min(ahead, time - around.now) > _RECENT:
        return (f' That time is {(time - around.now) / SECOND:.1f} s later than the clock of this '
                'node, and data still arrive. Check the clock that has stamped it, or '
                f'look up {_LATEST}.{section}')
    return f' {how}, so this transform is on its way: {wait}, or {_LATEST}.{section}'


def _one_time(edge: Edge) -> str:
    how = ('All that have arrived have this stamp' if edge.is_frozen else
           f'Only one has arrived, {edge.silence / SECOND:.1f} s ago')
    return (f' {how}. Send it again and again with new stamps or, if it does not move, with a '
            f'StaticTransformBroadcaster.{see("Only one time is in the buffer")}')


def _which_clocks(edge: Edge, time: int, around: Surroundings) -> str:
    """Say which of the two times is on the clock of the node."""
    if around.is_simulated and not around.now:
        return ('use_sim_time is set in this node, but nothing has arrived on /clock'
                f'{"" if around.clock_nodes else ", which nothing publishes"}.')
    clock = f"the {'simulated' if around.is_simulated else 'system'} clock of this node"
    is_time = abs(time - around.now) <= _OTHER_CLOCK
    is_data = edge.oldest - _OTHER_CLOCK <= around.now <= edge.latest + _OTHER_CLOCK
    if not around.now or is_time == is_data:
        return 'the requested time and the data are from different clocks, or from a recording.'
    return (f'the requested time is on {clock}, the data are not.' if is_time else
            f'the data are on {clock}, the requested time is not.')


def _why_silent(edge: Edge, around: Surroundings) -> str:
    """Say what has become of the publisher, and what to check."""
    if node := shortened(around.node_of(edge.authority)):
        return (f'{node}, which has published it, has ended. Start {node} again'
                if edge.authority in around.ended else
                f'{node}, which has published it, still exists, but is silent. Check {node}')
    nodes = comma_list(around.nodes(around.topics[-1]), MAX_TOPICS, shortened)
    if not nodes:
        return f'nothing publishes on {around.topics[-1]} any more. Start the publisher again'
    return (f'its publisher is silent or gone (on {around.topics[-1]} now: {nodes}). Check the '
            'publisher')


def _early(edge: Edge, time: int, around: Surroundings) -> str:
    if refused := _refused(edge, around, time):
        return refused
    if edge.samples == 1 and not edge.still_arrives and not edge.has_dropped:
        return _one_time(edge)
    ahead = edge.latest - around.now
    if edge.oldest - time > _DAY:
        return _other_clock(edge, time, around)
    if around.now and ahead > _RECENT and edge.still_arrives:
        return (f' Data still arrive, {ahead / SECOND:.1f} s ahead of the clock of this node '
                f'(clocks that differ). {_CLOCKS}{see("use_sim_time and the wall clock")}')
    return _dropped(edge, time, around) or (
        ' That time is before the first transform that was received. Skip such times, or start '
        f'the listener before its data come.{see("Extrapolation into the past")}')


def _other_clock(edge: Edge, time: int, around: Surroundings) -> str:
    clocks = _which_clocks(edge, time, around)
    return f' {clocks[0].upper()}{clocks[1:]} {_CLOCKS}{see("use_sim_time and the wall clock")}'


def _dropped(edge: Edge, time: int, around: Surroundings) -> str:
    """Say that earlier transforms have been dropped; '' if none has."""
    if not edge.has_dropped:
        return ''
    if (distance := edge.oldest - time) > _DAY:
        return _other_clock(edge, time, around)
    clocks = ('' if distance <= _OTHER_CLOCK else
              f' If that stamp is not so old, the clocks differ. {_CLOCKS}')
    section = see('Extrapolation into the past')
    if time < edge.latest - edge.cache_time:
        return (f'{clocks} The buffer keeps the last {edge.cache_time / SECOND:g} s of each '
                f'frame. Pass a longer cache_time to the buffer, or look up sooner.{section}')
    return (f'{clocks} Its earlier transforms have been dropped. Pass a longer cache_time, or a '
            f'larger max_samples, to the buffer.{section}')


def _refused(edge: Edge, around: Surroundings, time: int) -> str:
    """Say that the transforms of that time were refused; '' if they were not."""
    if not edge.refused or time > edge.refused_stamp + _RECENT:
        return ''
    refused_by, newer_by = (
        f' from {shortened(node)}' if (node := around.node_of(authority) if around.topics else
                                    authority) not in ('', 'default_authority') else ''
        for authority in (edge.refused_authority, edge.authority))
    return (f' {edge.refused} transforms of {quoted(edge.child)}{refused_by} were refused, since '
            f'one at {exact_time(edge.latest)}{newer_by} is newer by more than the cache time. '
            'Clear the buffer; if it happens again, stop the node with the later clock.'
            f'{see("TF_OLD_DATA")}')


# Transforms that are refused


def refused(look: Look, authority: str, is_static: bool) -> str:
    """Name the publisher of a transform, or all of its topic; '' if none is known."""
    publisher = _publisher(look(), authority, is_static)
    return f'.{publisher}' if publisher else ''


def old_data(look: Look, authority: str) -> str:
    return f'{_publisher(look(), authority, False)}{see("TF_OLD_DATA")}'


def _publisher(around: Surroundings, authority: str, is_static: bool) -> str:
    if node := around.node_of(authority):
        return f' Publisher: {shortened(node)}.'
    if not around.topics:
        return ''
    topic = around.topics[0 if is_static else -1]
    nodes = around.nodes(topic)
    return f' Publishers on {topic}: {comma_list(nodes, MAX_TOPICS, shortened)}.' if nodes else ''


# Arguments


def hint_at_duration(error: TransformException, *times: Any) -> TransformException:
    """Say in the hint of an error if a time of the failed lookup is a Duration; return it."""
    if error._parts and any(type(time).__name__ == 'Duration' for time in times):
        # The hint of an ExtrapolationException would look for causes in the clocks.
        before = None if isinstance(error, ExtrapolationException) else error._parts[1]

        def hint(waited: Optional[Waited]) -> str:
            text, see_more, section = (before(waited) if before else '').partition(' More: ')
            return (f'{text} Note that the time is a Duration: did you mean timeout=?'
                    f'{see_more}{section}')

        with_hint(error, hint)
    return error
