"""
The hints that follow tf2's words: one sentence on the cause of an error, and one on the remedy.

A hint is written when the text of an error is first read, without the lock of the buffer. It uses
the facts of the failed lookup, and the surroundings as they are when the text is read.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from dummy_arm.tf._core.texts import (
    comma_list,
    in_log,
    MAX_TOPICS,
    quoted,
    see,
    suggest_names,
    TF_MESSAGE,
)
from dummy_arm.tf._core.times import SECOND

#: Times that are farther apart (ns) are from different clocks, unless the frame was sent only
#: once, or its publisher is gone. Then only days are a sign of different clocks.
_OTHER_CLOCK, _DAY = 60 * SECOND, 24 * 3600 * SECOND
#: If the newest stamp is at most this old (ns), data still come. Up to this time into the future,
#: a transform is on its way.
_RECENT = SECOND
_LATEST = 'time 0 (Time()) for the latest transform'


class Publisher(NamedTuple):
    """A publisher on a topic of a listener."""

    node: str  #: the full name of its node
    topic: str
    type: str  #: such as TF_MESSAGE
    is_volatile: bool
    gid: str  #: in hex


class Surroundings(NamedTuple):
    """What is known outside of a buffer; the defaults mean that nothing is."""

    now: int = 0  #: the time of the node (ns); 0: not known
    is_simulated: bool = False  #: True if the clock of the node is simulated
    #: The topics of the listener: of static transforms, and of dynamic ones.
    topics: Sequence[str] = ()
    publishers: Sequence[Publisher] = ()  #: all publishers on these topics
    ended: Mapping[str, str] = MappingProxyType({})  #: by gid: the nodes of ended publishers
    is_volatile: bool = False  #: True if the subscription to static transforms is volatile
    #: While nothing arrives on the topic of dynamic transforms: other topics with publishers of
    #: transforms, without the ending '_static'.
    other_topics: Sequence[str] = ()

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


def unknown_frame(look: Look, name: str, known: tuple[str, ...], advice: str) -> str:
    hint = topics(look())
    return suggest_names(name, known) + (
        _missing_part(advice) if advice else
        f' {hint}' if hint else see('A frame does not exist'))


def unconnected(look: Look, target: str, target_root: str, source: str, source_root: str,
                advice: str) -> str:
    remedy = topics(look()) or (
        f'Publish a transform between the two trees.{see("Two unconnected trees")}')
    return (f' {quoted(target)} is in the tree with root {quoted(target_root)}, '
            f'{quoted(source)} in the tree with root {quoted(source_root)}.'
            f'{_missing_part(advice) if advice else f" {remedy}"}')


def _missing_part(advice: str) -> str:
    return advice + see('No static transforms from a bag')


def topics(around: Surroundings) -> str:
    """Say why transforms may not arrive on the topics; '' if there is no sign of it."""
    for find, section in ((wrong_type, 'A frame does not exist'),
                          (_static_qos, 'The QoS of /tf_static'),
                          (other_topics, 'A leading slash, or a namespace')):
        if hint := find(around):
            return hint + see(section)
    return ''


def wrong_type(around: Surroundings) -> str:
    """Say who publishes another type than TFMessage on the topics of transforms."""
    wrong = dict.fromkeys(
        f'{in_log(each.node)} publishes {in_log(each.type)} on {each.topic}'
        for each in around.publishers if each.type != TF_MESSAGE)
    if not wrong:
        return ''
    return (f'{comma_list([*wrong], MAX_TOPICS)}. The type must be {TF_MESSAGE}: send transforms '
            'with a TransformBroadcaster or a StaticTransformBroadcaster.')


def _static_qos(around: Surroundings) -> str:
    """Say why static transforms may be lost: an end of /tf_static is not transient local."""
    if not around.topics:
        return ''
    topic = around.topics[0]
    if around.is_volatile:
        return (f'This listener of {topic} is not transient local, so it misses what was sent '
                'before its start. Omit static_qos, or make it transient local.')
    nodes = sorted({in_log(each.node) for each in around.publishers
                    if each.topic == topic and each.type == TF_MESSAGE and each.is_volatile})
    if not nodes:
        return ''
    return (f'Nothing arrives on {topic} from {comma_list(nodes, MAX_TOPICS)}, whose publisher is '
            'not transient local. Send with a StaticTransformBroadcaster.')


def other_topics(around: Surroundings) -> str:
    """Say which other topics have transforms, and how to receive them."""
    if not around.other_topics:
        return ''
    first = in_log(around.other_topics[0])
    namespace, _, name = first.rpartition('/')
    option = (f'pass --ros-args -r /tf:={first} -r /tf_static:={first}_static' if name != 'tf' else
              f'pass --namespace {namespace[1:]}' if namespace else 'omit --namespace')
    return (f'No transform has arrived on {around.topics[-1]}, but transforms are published on '
            f'{comma_list(around.other_topics, MAX_TOPICS, in_log)}. To listen to {first}, pass '
            f"tf_topic='{first}', tf_static_topic='{first}_static' to the TransformListener; in "
            f'commands, {option}.')


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


def cleared(frame: str) -> str:
    return (f' No transform of {quoted(frame)} has been received since the buffer was cleared, or '
            'mended after an interrupted insertion. Pass timeout= to wait for the next one.'
            f'{see("A jump back in time")}')


def extrapolation(look: Look, edge: Edge, time: int) -> str:
    """Say how far a time is from the samples of an edge, why, and what to do."""
    name = f'{quoted(edge.parent)} -> {quoted(edge.child)}'
    is_late = time > edge.latest
    distance = time - edge.latest if is_late else edge.oldest - time
    words = (f'end {_exact_seconds(distance)} before' if is_late else
             f'begin {_exact_seconds(distance)} after')
    around = look()
    # A stamp in the future is recent, too.
    is_recent = bool(around.now) and around.now - edge.latest <= _RECENT
    if distance > _DAY:
        cause = _clock(edge, time, around)
    elif edge.samples == 1 and not edge.has_dropped and not is_recent:
        cause = _one_sample()
    elif distance > _OTHER_CLOCK and not (is_late and _is_gone(edge, around)):
        cause = _clock(edge, time, around)
    elif is_late:
        cause = _late(edge, time, around, is_recent)
    else:
        cause = _early(edge, time)
    return f' The data of edge {name} {words} that time. {cause}'


def _exact_seconds(duration: int) -> str:
    return f'{duration // SECOND}.{duration % SECOND:09d} s'


def _one_sample() -> str:
    return ('It was sent once as a dynamic transform, or always with the same stamp. Send it '
            'again and again with new stamps or, if it does not move, with a '
            'StaticTransformBroadcaster.'
            f'{see("Only one time is in the buffer")}')


def _clock(edge: Edge, time: int, around: Surroundings) -> str:
    which = ''
    if around.now:
        clock = f"the {'simulated' if around.is_simulated else 'system'} clock of this node"
        is_time = abs(time - around.now) <= _OTHER_CLOCK
        is_data = edge.oldest - _OTHER_CLOCK <= around.now <= edge.latest + _OTHER_CLOCK
        which = (f': the requested time is on {clock}, the data are not' if is_time and not is_data
                 else f': the data are on {clock}, the requested time is not' if is_data
                 else f': neither is on {clock}')
    stopped = ', or nothing has been sent since' if time > edge.latest else ''
    return (f'These times are probably from different clocks{which}{stopped}. Set use_sim_time in '
            f'all nodes, or in none.{see("use_sim_time and the wall clock")}')


def _late(edge: Edge, time: int, around: Surroundings, is_recent: bool) -> str:
    section = see('Extrapolation into the future')
    if not around.now:
        return ('If data still come, this transform is on its way, otherwise the publisher has '
                f'stopped. Pass timeout= to wait for it, or {_LATEST}.{section}')
    if not is_recent:
        node = in_log(around.node_of(edge.authority))
        check = f'Check {node}' if node else 'Check the publisher'
        return (f'The newest is {(around.now - edge.latest) / SECOND:.1f} s old: '
                f'{_why_silent(edge, around)}. {check}, or look up {_LATEST}.{section}')
    if time - edge.latest <= _RECENT:
        return ('Data still come, so this transform is on its way. Pass timeout= to wait for it, '
                f'or {_LATEST}.{section}')
    return (f'That time is {(time - around.now) / SECOND:.1f} s later than the clock of this '
            'node, and data still come. Check the clock that has stamped it, or '
            f'look up {_LATEST}.{section}')


def _is_gone(edge: Edge, around: Surroundings) -> bool:
    return edge.authority in around.ended or (
        len(around.topics) == 2 and not around.nodes(around.topics[1]))


def _why_silent(edge: Edge, around: Surroundings) -> str:
    if node := in_log(around.node_of(edge.authority)):
        return (f'{node}, which has published it, has ended' if edge.authority in around.ended else
                f'{node}, which has published it, still exists, but is silent')
    if _is_gone(edge, around):
        return f'nothing publishes on {around.topics[1]} any more'
    nodes = around.nodes(around.topics[-1]) if around.topics else []
    return 'the publisher is silent or gone' + (
        f'; the publishers on {around.topics[-1]} are {comma_list(nodes, MAX_TOPICS, in_log)}'
        if nodes else '')


def _early(edge: Edge, time: int) -> str:
    section = see('Extrapolation into the past')
    if time < edge.latest - edge.cache_time:
        return (f'The buffer keeps the last {edge.cache_time / SECOND:g} s of each frame. Pass a '
                f'longer cache_time to the buffer, or look up sooner.{section}')
    if edge.has_dropped:
        return ('Its earlier transforms have been dropped. Pass a longer cache_time, or a larger '
                f'max_samples, to the buffer.{section}')
    return ('That time is before the first transform that was received. Skip such times, or start '
            f'the listener before its data come.{section}')


# Transforms that are refused


def refused(look: Look, authority: str, is_static: bool) -> str:
    """Name the publisher of a transform, or all of its topic; '' if none is known."""
    publisher = _publisher(look(), authority, is_static)
    return f'.{publisher}' if publisher else ''


def old_data(look: Look, authority: str) -> str:
    return f'{_publisher(look(), authority, False)}{see("TF_OLD_DATA")}'


def _publisher(around: Surroundings, authority: str, is_static: bool) -> str:
    if node := around.node_of(authority):
        return f' Publisher: {in_log(node)}.'
    if not around.topics:
        return ''
    topic = around.topics[0 if is_static else -1]
    nodes = around.nodes(topic)
    return f' Publishers on {topic}: {comma_list(nodes, MAX_TOPICS, in_log)}.' if nodes else ''
