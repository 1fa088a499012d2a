"""The rules that the error of a lookup can reach; the most certain ones come first."""

from collections.abc import Iterator, Mapping, Sequence
from math import ceil
from typing import Optional

from puretf._causes.clocks import apart, is_off, known_offset, SINCE_START
from puretf._causes.facts import (
    CLEARED,
    Facts,
    FUTURE,
    Heard,
    MISSING,
    NONE,
    ONE_TIME,
    OTHER_CLOCK,
    PAST,
    RECENT,
    SILENCE,
    UNCONNECTED,
    UNKNOWN,
)
from puretf._causes.rules import Evidence, registry, Rule
from puretf._text.names import (
    comma_list,
    MAX_TOPICS,
    namespace_distance,
    quoted,
    shortened,
    TF_MESSAGE,
)
from puretf._text.similar_names import difference, is_slip, may_be_one_robot, without_prefix
from puretf._text.times import exact_time, SECOND

#: The rules, by their codes.
RULES: dict[str, Rule] = {}
_rule = registry(RULES)
_NOT_THERE = MISSING, UNCONNECTED
_NO_DATA = MISSING, UNCONNECTED, SILENCE
_TIMES = PAST, FUTURE, ONE_TIME
_SEND_AGAIN = ('Send it again and again with new stamps or, if it does not move, with a '
               'StaticTransformBroadcaster.')
PLAYER = 'rosbag2_player'  #: in the names of nodes that play a bag
#: No cache time that is longer than this (ns) is proposed.
LONGEST_CACHE = 600 * SECOND
#: A transform was sent once if no other one has followed for this time (ns).
_ONCE = 5 * SECOND
#: The largest number of names that are compared with the root of another tree.
_MAX_COMPARED = 5000


def _listed(nodes: Sequence[str]) -> str:
    return comma_list(nodes, MAX_TOPICS, shortened)


def _have(nodes: list[str]) -> str:
    return 'have' if len(nodes) > 1 else 'has'


# In this process


@_rule('time_is_duration', 'Pass a Duration as timeout=.', 'Other faults',
       symptoms=(MISSING, UNCONNECTED, *_TIMES), is_on_wire=False)
def _time_is_duration(facts: Facts) -> Iterator[Evidence]:
    if facts.is_duration:
        yield Evidence('The time is a Duration')


@_rule('time_in_seconds', 'Pass times in ns.', 'Extrapolation into the past', symptoms=(PAST,),
       is_on_wire=False)
def _time_in_seconds(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if edge and facts.buffer.takes_ns and edge.oldest <= facts.time * SECOND <= edge.latest:
        yield Evidence(f'{facts.time} s is within the data, {facts.time} ns is not')


@_rule('no_listener', 'Create a TransformListener with this buffer.', 'A frame does not exist',
       symptoms=(MISSING,), is_on_wire=False)
def _no_listener(facts: Facts) -> Iterator[Evidence]:
    if facts.buffer.needs_listener and not facts.around.topics and not facts.buffer.names:
        yield Evidence('No TransformListener fills this buffer')


@_rule('executor_blocked', '{remedy}', 'A lookup that waits for its own node',
       symptoms=(FUTURE, *_NOT_THERE), needs=('publishers',), is_on_wire=False)
def _executor_blocked(facts: Facts) -> Iterator[Evidence]:
    around, waited, edge = facts.around, facts.waited, facts.edge
    if waited is None:
        return
    if edge is None:
        nodes = {each.node for each in around.publishers or () if each.type == TF_MESSAGE}
        if nodes and waited.blocked.keys() >= nodes and not facts.has_near_name:
            node = min(nodes)
            what = (f'send {quoted(facts.names[0])}' if facts.symptom == MISSING else
                    'connect them')
            yield Evidence(
                f'Only {_who(facts, node)} publishes on {around.topics[-1]}; if it is to {what}, '
                f'it {waited.blocked[node].why}', waited.blocked[node]._asdict())
    elif edge.silence >= waited.seconds * SECOND:
        of_edge = around.node_of(edge.authority)
        for node, blocked in waited.blocked.items():
            if node == of_edge or (not of_edge and edge.child in blocked.children):
                who = _who(facts, node)
                yield Evidence(f'{who[0].upper()}{who[1:]} publishes it, and {blocked.why}',
                               blocked._asdict())
                return


def _who(facts: Facts, node: str) -> str:
    return 'this node' if node == facts.around.node else shortened(node)


# Names and parents


@_rule('missing_part', '{remedy}', 'No static transforms from a bag', symptoms=_NOT_THERE)
def _missing_part(facts: Facts) -> Iterator[Evidence]:
    text, remedy = facts.buffer.missing_part
    if text:
        yield Evidence(text, {'remedy': remedy})


@_rule('changing_parent', 'Let only one parent be published for {frame}.',
       'A frame jumps or flickers', symptoms=(UNCONNECTED, *_TIMES),
       explains=('similar_name', 'part_prefix', 'gap', 'one_shot'))
def _changing_parent(facts: Facts) -> Iterator[Evidence]:
    for frame in facts.buffer.changed:
        parents = facts.buffer.parents(frame)
        roots = {facts.buffer.chain(each.name)[-1] for each in parents}
        if len(parents) < 2 or not (frame == facts.edge.child if facts.edge else
                                    roots.issuperset(facts.roots)):
            continue
        # A single node may send a static transform anew, in another frame.
        if not all(each.is_static for each in parents) or len(_senders(facts, frame, '')) > 1:
            yield Evidence(f'{quoted(frame)} has {len(parents)} parents: ' + ', '.join(
                f'{quoted(each.name)}{" (static)" * each.is_static}'
                f'{_by(facts, each.name, frame, each.authority)}' for each in parents[-4:]),
                {'frame': quoted(frame)})
            return


@_rule('similar_name', '{remedy}', 'Two unconnected trees',
       symptoms=(UNCONNECTED,))
def _similar_name(facts: Facts) -> Iterator[Evidence]:
    for root, other in _pairs(facts):
        for name in facts.buffer.names[:_MAX_COMPARED]:
            if is_slip(root, name) and facts.buffer.chain(name)[-1] == other:
                how = difference(name, root)
                yield Evidence(
                    f'{quoted(name)} in the one tree and {quoted(root)} in the other differ by '
                    f'{how}', {'remedy': 'If they are one frame, use one name.'
                               if how == 'a letter' else 'Use one name.'})
                return


def _pairs(facts: Facts) -> list[tuple[str, str]]:
    """Return the roots of the two trees, in both orders."""
    target, source = facts.roots
    return [(source, target), (target, source)]


@_rule('part_prefix', 'If they are, give all frames of the robot the same prefix, or none.',
       'Two unconnected trees', symptoms=(UNCONNECTED,))
def _part_prefix(facts: Facts) -> Iterator[Evidence]:
    trees: dict[str, list[str]] = {}
    for name in facts.buffer.names[:_MAX_COMPARED]:
        trees.setdefault(facts.buffer.chain(name)[-1], []).append(name)
    # The trees of the lookup, and those between them.
    for root in facts.roots:
        for other, names in trees.items():
            if other != root and (found := part_prefix(
                    trees.get(root, ()), names, facts.buffer.newest)):
                yield Evidence(part_prefix_text(found))
                return


def part_prefix(tree: Sequence[str], other: Sequence[str], parents: Mapping[str, str]
                ) -> Optional[tuple[str, str]]:
    """
    Return two names that may be one frame, which only some nodes give a prefix.

    They are the only ones in the two trees that differ by a prefix: two robots have more. One of
    them is the root of its tree, and the other one has no child: so the trees would be one.

    :param parents: by child: the parent.
    """
    names, others = {*tree}, {*other}
    pairs = [(a, b) for a in tree for b in without_prefix(a) & others] + [
        (b, a) for a in other for b in without_prefix(a) & names]
    if len(pairs) == 1 and any(a not in parents and b not in parents.values()
                               for a, b in (pairs[0], pairs[0][::-1])):
        return pairs[0]
    return None


def part_prefix_text(names: Sequence[str]) -> str:
    return (f'{" and ".join(map(quoted, names))} may be one frame: only a part of the frames has '
            'the prefix or suffix')


def _by(facts: Facts, parent: str, child: str, authority: str) -> str:
    """Return who publishes an edge."""
    nodes = _senders(facts, child, authority, parent)
    return f' by {comma_list(nodes, 2, shortened)}' if nodes else ''


def _senders(facts: Facts, child: str, authority: str, parent: str = '') -> list[str]:
    """Return the node of a publisher, or those that are heard to send a child."""
    if node := facts.around.node_of(authority):
        return [node]
    return sorted({node for each in facts.heard if each.topic in facts.around.topics
                   and child in each.parents and parent in ('', each.parents[child])
                   for node in each.nodes})


# Transforms that are refused


def _of_refusals(code: str, what: str, remedy: str) -> None:
    @_rule(code, remedy, 'Other faults', symptoms=(*_NOT_THERE, FUTURE))
    def find(facts: Facts) -> Iterator[Evidence]:
        if facts.edge and (arrives(facts) or not facts.around.topics):
            return
        for name in [facts.edge.child] if facts.edge else dict.fromkeys(
                (*facts.names, *facts.roots)):
            for refusal in facts.buffer.refusals(name):
                if refusal.reason == code:
                    nodes = _senders(facts, name, refusal.authority)
                    yield Evidence(
                        f'{_transforms(refusal.count)} of {quoted(name)}'
                        f'{f" from {_listed(nodes)}" if nodes else ""} {_was(refusal.count)} '
                        f'refused: {what}')
                    return


def _transforms(count: int) -> str:
    return f'{count} transform{"s" * (count != 1)}'


def _was(count: int) -> str:
    return 'was' if count == 1 else 'were'


def _of_node(facts: Facts, authority: str) -> str:
    node = facts.around.node_of(authority) if facts.around.topics else authority
    is_known = node not in ('', 'default_authority', 'not recorded')
    return f' from {shortened(node)}' if is_known else ''


for _arguments in (
        ('not_a_number', 'a number is NaN or infinite',
         'Find out where the program computes it: often a division by zero, or a missing '
         'measurement.'),
        ('unnormalized', 'the quaternion is zero', 'Set its rotation; w = 1 is none.'),
        ('loop', 'the frame is its own parent', 'Publish it with another parent.'),
        ('empty_name', 'the other name is empty', 'Set frame_id and child_frame_id.')):
    _of_refusals(*_arguments)


@_rule('zero_stamp', 'Set header.stamp to the time of the transform.',
       'use_sim_time and the wall clock', symptoms=_TIMES,
       explains=('other_clock', 'message_other_clock', 'use_sim_time_differs', 'one_shot',
                 'too_soon', 'cache_too_short', 'gap'))
def _zero_stamp(facts: Facts) -> Iterator[Evidence]:
    if facts.edge and facts.edge.oldest == facts.edge.latest == 0:
        yield Evidence('All its stamps are 0')


@_rule('use_sim_time_differs', 'Set use_sim_time in all nodes, or in none.',
       'use_sim_time and the wall clock', symptoms=_TIMES, needs=('now', 'clock_nodes'),
       explains=('other_clock', 'message_other_clock', 'too_soon', 'cache_too_short',
                 'time_goes_back'))
def _use_sim_time_differs(facts: Facts) -> Iterator[Evidence]:
    if facts.around.clock_nodes and (which := _which_is_off(facts)):
        nodes = facts.around.clock_nodes
        yield Evidence(f'{which}, and {_listed(nodes)} publish{"es" * (len(nodes) == 1)} '
                       '/clock')


@_rule('time_goes_back', '{remedy}', 'TF_OLD_DATA', symptoms=_TIMES,
       explains=('frozen_stamp', 'one_shot', 'gap'))
def _time_goes_back(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if edge and edge.refused and (
            edge.is_refusing and facts.time <= edge.latest + OTHER_CLOCK
            if facts.symptom == FUTURE else facts.time <= edge.refused_stamp + RECENT):
        both = {edge.refused_authority, edge.authority}
        is_shared = len(both) == 2 and both.isdisjoint(facts.around.ended) and all(
            map(facts.around.node_of, both))
        yield Evidence(
            f'{_transforms(edge.refused)} of {quoted(edge.child)}'
            f'{_of_node(facts, edge.refused_authority)} {_was(edge.refused)} refused, since one '
            f'at {exact_time(edge.latest)}{_of_node(facts, edge.authority)} is newer by more than '
            'the cache time', {'remedy': PLAY if _is_played(facts) else (
                f'Let only one node send {quoted(edge.child)}.' if is_shared else
                'Clear the buffer; if it happens again, stop the node with the later clock.')})


@_rule('nanosec', 'Split the time into sec and nanosec, as rclpy.time.Time.to_msg() does.',
       'use_sim_time and the wall clock', symptoms=_TIMES,
       explains=('other_clock', 'message_other_clock', 'too_soon', 'cache_too_short', 'gap'))
def _nanosec(facts: Facts) -> Iterator[Evidence]:
    if facts.edge and facts.edge.nanosec:
        yield Evidence(f'nanosec of its stamps is {facts.edge.nanosec}; it must be below '
                       f'{SECOND}')


# What the ROS graph shows


@_rule('wrong_type', 'Send transforms with a TransformBroadcaster or a '
       'StaticTransformBroadcaster.', 'A frame does not exist', symptoms=_NO_DATA,
       needs=('publishers',), explains=('no_transforms',))
def _wrong_type(facts: Facts) -> Iterator[Evidence]:
    """Find messages of another type on /tf and /tf_static; no listener receives them."""
    wrong = [each for each in facts.around.publishers or () if each.type != TF_MESSAGE]
    texts = dict.fromkeys(f'{shortened(each.node) or "a node"} publishes {shortened(each.type)} '
                          f'on {each.topic}' for each in wrong)
    if wrong and not facts.has_near_name:
        yield Evidence(f'{comma_list([*texts], MAX_TOPICS)}, not {TF_MESSAGE}',
                       nodes=[each.node for each in wrong], topics=[each.topic for each in wrong])


@_rule('volatile_listener', 'Omit static_qos, or make it transient local.',
       'The QoS of /tf_static', symptoms=_NO_DATA, needs=('publishers',),
       explains=('static_not_latched',))
def _volatile_listener(facts: Facts) -> Iterator[Evidence]:
    if facts.around.is_volatile and not facts.has_near_name:
        yield Evidence(f'This listener of {facts.around.topics[0]} is not transient local, so it '
                       'misses what was sent before its start')


def _of_qos(code: str, lack: str, remedy: str) -> None:
    @_rule(code, remedy, 'The QoS of /tf_static', symptoms=_NO_DATA, needs=('publishers',),
           explains=('no_transforms',))
    def find(facts: Facts) -> Iterator[Evidence]:
        """Find publishers that do not offer what listeners require."""
        topics: dict[str, list[str]] = {}
        for each in () if facts.has_near_name else facts.around.publishers or ():
            if each.type == TF_MESSAGE and each.lacks == lack and _may_send(facts, each.node):
                topics.setdefault(each.topic, []).append(each.node)
        for topic, found in topics.items():
            nodes = sorted({*found} - {''})
            yield Evidence(
                f'{len(found)} publisher{"s" * (len(found) > 1)} on {topic}'
                f'{f" ({_listed(nodes)})" if nodes else ""} {"are" if len(found) > 1 else "is"} '
                f'not {lack}: listeners that require it receive nothing', nodes=nodes,
                topics=[topic])


def _may_send(facts: Facts, node: str) -> bool:
    """Return whether a node may send what a lookup lacks: no other frames are heard from it."""
    wanted = {*(facts.names if facts.symptom == MISSING else facts.roots)}
    heard = {name for each in facts.heard if node in each.nodes
             for names in each.parents.items() for name in names} if wanted else ()
    return not heard or not wanted.isdisjoint(heard)


_of_qos('static_not_latched', 'transient local', 'Send with a StaticTransformBroadcaster.')
_of_qos('incompatible_qos', 'reliable', 'Send with a TransformBroadcaster, or pass a best-effort '
        'qos to the TransformListener.')


@_rule('other_namespace', 'To listen to {topic}, pass {options}.',
       'A leading slash, or a namespace', symptoms=_NO_DATA, needs=('listener',),
       explains=('no_transforms',), severity='warning')
def _other_namespace(facts: Facts) -> Iterator[Evidence]:
    """Find transforms on the topic tf of a namespace, while /tf has none."""
    around = facts.around
    if around.is_fed or not around.other_topics or len(around.topics) == 1 or (
            facts.has_near_name):
        return
    first = shortened(around.other_topics[0])
    yield Evidence(f'No transform has arrived on {around.topics[-1]}, but transforms are '
                   f'published on {_listed(around.other_topics)}',
                   {'topic': first, 'options': _listening_to(first)}, topics=around.topics[-1:])


def _listening_to(topic: str) -> str:
    namespace, _, name = topic.rpartition('/')
    option = (f'pass --ros-args -r /tf:={topic} -r /tf_static:={topic}_static' if name != 'tf' else
              f'pass --namespace {namespace[1:]}' if namespace else 'omit --namespace')
    return (f"tf_topic='{topic}', tf_static_topic='{topic}_static' to the TransformListener; in "
            f'commands, {option}')


@_rule('half_namespace', '{remedy}', 'Half of a robot is in a namespace', symptoms=_NOT_THERE,
       needs=('listener',), is_costly=True,
       explains=('silent_publisher', 'several_trees', 'disconnected', 'other_namespace'))
def _half_namespace(facts: Facts) -> Iterator[Evidence]:
    topics, parents = facts.around.topics, facts.buffer.newest
    with_children = {*parents.values()}
    own = topics[-1].removesuffix('_static')
    trees: dict[str, dict[str, Heard]] = {}  # by the other topics: who sends which child
    for heard in facts.heard:
        if heard.topic not in topics:
            trees.setdefault(heard.base, {}).update(dict.fromkeys(heard.parents, heard))
    # If a frame is the root in several namespaces, these are robots that share it, such as a map.
    roots = [with_children - parents.keys(), *(
        {each.parents[child] for child, each in tree.items()} - tree.keys()
        for tree in trees.values())]
    for base in sorted(trees, key=lambda base: (_namespaces_between(base, own), base)):
        edges = [(each.parents[child], child, each) for child, each in trees[base].items()]
        # The whole tree of another robot has the same children, or no frame in common.
        is_another = not trees[base].keys().isdisjoint(parents)
        joints = {frame for parent, child, _ in edges for frame, others in (
            (parent, parents.keys()), (child, with_children)) if frame in others
            and not is_another and sum(frame in each for each in roots) < 2}
        wanted = ({*facts.names[:1]} if facts.symptom == MISSING else joints & {*facts.roots}
                  if facts.symptom == UNCONNECTED else {*sorted(joints)[:1]})
        found = next((edge for edge in edges if not wanted.isdisjoint(
            edge[facts.symptom == UNCONNECTED:2])), None)
        if found and may_be_one_robot(base, own):
            parent, child, heard = found
            nodes = f' by {_listed(heard.nodes)}' if heard.nodes else ''
            yield Evidence(
                f'{quoted(parent)} -> {quoted(child)} is published on {shortened(heard.topic)}'
                f'{nodes}, not on {" and ".join(topics[::-1])}', {
                    'remedy': 'Use a TransformListener.' if own == base else
                    remap_both(max(own, base, key=lambda topic: (topic.count('/'), topic)))
                    if joints else '' if is_another else f'To listen to {shortened(base)}, pass '
                    f'{_listening_to(shortened(base))}.'},
                heard.nodes, [heard.topic], [parent, child])
            if facts.symptom != NONE:
                return


def _namespaces_between(topic: str, other: str) -> int:
    return namespace_distance(*(each.rpartition('/')[0] for each in (topic, other)))


def remap_both(topic: str) -> str:
    base = shortened(topic)
    return (f'Remap both /tf and /tf_static in all nodes of the robot (--ros-args -r /tf:={base} '
            f'-r /tf_static:={base}_static), or in none of them.')


@_rule('no_clock', 'Start what publishes /clock, or set use_sim_time to false.',
       'use_sim_time and the wall clock', symptoms=(*_NO_DATA, *_TIMES, CLEARED),
       needs=('clock_nodes',), explains=('gap', 'other_clock', 'no_transforms'))
def _no_clock(facts: Facts) -> Iterator[Evidence]:
    """Find nodes that wait for /clock, which nothing publishes."""
    around = facts.around
    if around.clock_nodes:
        return
    nodes = around.waits_for if facts.symptom == NONE else {
        each.node for each in around.publishers or ()}
    waiting = sorted(node for node in nodes
                     if around.waits_for.get(node) == '/clock' and node != around.node)
    is_possible = facts.symptom not in _NOT_THERE or not around.has_data
    if around.is_simulated and is_possible and (around.now == 0 or (
            facts.symptom == FUTURE and not arrives(facts))):
        yield Evidence('use_sim_time is set in this node, but nothing publishes /clock'
                       f'{" any more" if around.now else ""}')
    if waiting and facts.symptom in (NONE, *_NO_DATA) and not facts.has_near_name and (
            silent := [node for node in waiting if not facts.has_sent(node)]):
        yield Evidence(f'{_listed(silent)} wait{"s" * (len(silent) == 1)} for /clock, which '
                       'nothing publishes', nodes=silent)


@_rule('joint_without_state', '{remedy}', 'A frame does not exist', symptoms=_NO_DATA,
       needs=('publishers',), explains=('no_transforms', 'link_without_transform'))
def _joint_without_state(facts: Facts) -> Iterator[Evidence]:
    for each in facts.around.publishers or ():
        topic = facts.around.waits_for.get(each.node, '/clock')
        # An arm that moves may listen to positions to be set.
        if topic != '/clock' and not facts.has_near_name and not (
                facts.symptom == NONE and facts.has_sent(each.node)):
            others = [name for name, nodes in facts.around.joint_states.items()
                      if name != topic and each.node not in nodes]
            where = (f'; joint states are on {_listed(others)} of '
                     f'{_listed(facts.around.joint_states[others[0]])}' if others else '')
            yield Evidence(
                f'{shortened(each.node)} waits for {topic}, which nothing publishes{where}',
                {'remedy': remap(topic, others[0]) if others else
                 f'If a joint moves the frame, start a program that publishes {topic}.'},
                [each.node], [topic])
            return


def remap(topic: str, other: str) -> str:
    return f'Remap one of them: -r {topic}:={shortened(other)}.'


@_rule('no_robot_state_publisher', 'Start robot_state_publisher FILE.', 'A frame does not exist',
       symptoms=(SILENCE, MISSING), needs=('publishers',), explains=('no_transforms',))
def _no_robot_state_publisher(facts: Facts) -> Iterator[Evidence]:
    """Find joint states while nothing publishes transforms."""
    around = facts.around
    own = f'{around.topics[-1].rpartition("/")[0]}/joint_states' if around.topics else ''
    topics = [own] if own in around.joint_states else (
        [] if around.other_topics else [*around.joint_states][:1])
    if topics and not (around.has_data or around.publishers or around.is_new):
        yield Evidence(f'{topics[0]} has a publisher, but nothing publishes transforms',
                       nodes=around.joint_states[topics[0]], topics=topics)


@_rule('no_transforms', 'Start a program that publishes, with the same ROS_DOMAIN_ID.',
       'A frame does not exist', symptoms=(SILENCE, MISSING), needs=('publishers',),
       is_costly=True)
def _no_transforms(facts: Facts) -> Iterator[Evidence]:
    around = facts.around
    if around.has_data or around.publishers or around.is_new:
        return
    hidden = f'. {around.hides_others} hides other machines' if around.hides_others else ''
    others = around.other_domains().strip(' .')
    yield Evidence(f'0 publishers on {" and ".join(around.topics[::-1])} were found in ROS domain '
                   f'{around.domain}{f". {others}" if others else ""}{hidden}')


@_rule('other_user', 'Run all nodes as one user.', 'A frame does not exist',
       symptoms=(SILENCE, MISSING), needs=('publishers',), is_costly=True,
       explains=('no_transforms', 'silent_publisher'))
def _other_user(facts: Facts) -> Iterator[Evidence]:
    """Find nodes of another user, from which Fast DDS brings nothing."""
    around = facts.around
    nodes = {each.node for each in around.publishers or ()}
    # The names of nodes are received by the way on which nothing arrives.
    if nodes == {UNKNOWN} and not (around.has_data or around.is_new) and (
            user := around.other_user()):
        yield Evidence(f'{user} runs nodes in this domain on this computer, and Fast DDS shares '
                       'no memory with other users', topics=around.topics[::-1])


@_rule('silent_publisher', '', 'A frame does not exist', symptoms=_NOT_THERE,
       needs=('publishers',), is_costly=True, severity='info')
def _silent_publisher(facts: Facts) -> Iterator[Evidence]:
    """Find publishers on /tf and /tf_static from which nothing arrives."""
    around = facts.around
    sent = {each.gid for each in facts.heard if each.topic in around.topics}
    heard = {child for each in facts.heard for child in each.parents}
    # Who sends what the buffer has, and was not heard now, is not known.
    # A frame may have been handed over by a node that sends nothing now.
    if not around.has_data or not facts.buffer.newest.keys() <= heard or '' in sent or (
            facts.has_near_name or any(
                not {*facts.buffer.changed}.isdisjoint(facts.buffer.chain(name))
                for name in facts.names)):
        return
    silent = {each.node: each.topic for each in around.publishers or ()
              if each.type == TF_MESSAGE and each.gid not in sent and each.node != around.node
              and not each.lacks}
    players = [node for node, topic in silent.items()
               if PLAYER in node and topic.endswith('_static')]
    # A robot_state_publisher may have fixed joints only.
    silent = {node: topic for node, topic in silent.items() if not facts.has_sent(node) and not (
        facts.symptom == NONE and node in around.waits_for)}
    if players:
        yield Evidence(f'{_listed(players)} has sent nothing on {around.topics[0]}: a start '
                       'offset leaves out the static transforms before it',
                       nodes=players, topics=around.topics[:1])
    elif silent:
        topics = [*dict.fromkeys(silent.values())]
        yield Evidence(f'{_listed([*silent])} {_have([*silent])} a publisher on '
                       f'{", ".join(topics)}, but nothing arrives from '
                       f'{"them" if len(silent) > 1 else "it"}',
                       nodes=[*silent], topics=topics)


# Times without data


@_rule('two_clocks', 'Stop all but one.', 'Two nodes on /joint_states or /clock',
       symptoms=(CLEARED, *_TIMES), needs=('clock_nodes',))
def _two_clocks(facts: Facts) -> Iterator[Evidence]:
    nodes = facts.around.clock_nodes or ()
    if facts.around.is_simulated and len(nodes) > 1:
        yield Evidence(f'{len(nodes)} nodes publish /clock, so that the time jumps between them: '
                       f'{_listed(nodes)}')


@_rule('frozen_stamp', _SEND_AGAIN, 'Only one time is in the buffer', symptoms=_TIMES,
       explains=('gap', 'one_shot', 'other_clock', 'too_soon'))
def _frozen_stamp(facts: Facts) -> Iterator[Evidence]:
    if facts.edge and facts.edge.is_frozen and not facts.edge.refused:
        yield Evidence('All that have arrived have this stamp')


@_rule('one_shot', _SEND_AGAIN, 'Only one time is in the buffer', symptoms=_TIMES,
       needs=('listener',), explains=('gap', 'too_soon'))
def _one_shot(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if edge and edge.samples == 1 and not edge.has_dropped and not edge.refused and (
            edge.silence > _ONCE):
        yield Evidence(f'Only one has arrived, {edge.silence / SECOND:.1f} s ago')


def arrives(facts: Facts) -> bool:
    """Return whether transforms of the edge arrive, as often as before."""
    edge, around = facts.edge, facts.around
    return bool(edge and edge.still_arrives and edge.authority not in around.ended
                and around.topics and around.nodes(around.topics[-1]))


@_rule('message_other_clock', 'If a message has it, correct the clock of its sender.',
       'use_sim_time and the wall clock', symptoms=_TIMES, needs=('now', 'listener'),
       explains=('too_soon', 'cache_too_short', 'other_clock'))
def _message_other_clock(facts: Facts) -> Iterator[Evidence]:
    edge, now = facts.edge, facts.around.now
    if not edge or not now or not arrives(facts) or not _is_in_time(facts):
        return
    offset = facts.time - now + round(facts.waited.seconds * SECOND if facts.waited else 0)
    if is_off(offset, facts.time, now) and (offset < 0 or (
            facts.time > edge.latest + RECENT
            and (offset > _LATE or not facts.around.is_simulated))):
        yield Evidence(f'That time is {apart(offset, facts.time)} the clock of this node, and '
                       'the data are in time')


@_rule('other_clock', '{remedy}',
       'use_sim_time and the wall clock', symptoms=_TIMES, needs=('now', 'listener'),
       explains=('too_soon', 'cache_too_short'))
def _other_clock(facts: Facts) -> Iterator[Evidence]:
    edge, around = facts.edge, facts.around
    offset = data_offset(facts)
    # A network that is late for a while delays some of the data, not all.
    is_steady = abs(offset) > _LARGE or (edge is not None and edge.spread <= RECENT)
    if edge and around.now and arrives(facts) and is_steady and not _is_in_time(facts) and (
            abs(facts.time - around.now) <= OTHER_CLOCK):
        remedy = 'Correct the clock that stamps them: synchronise the computers.'
        yield Evidence(
            'The data are on another clock than that of this node: '
            f'{apart(offset, edge.latest)} it',
            {'remedy': RULES['use_sim_time_differs'].remedy if around.clock_nodes else
             PLAY if _is_played(facts) else
             'If they are simulated, publish /clock and set use_sim_time; else stamp them with '
             'the present time.' if edge.latest < SINCE_START else remedy
             if abs(offset) > _LARGE or known_offset(offset) else
             f'If this is not on purpose, c{remedy[1:]}'})


PLAY = 'Play the bag with --clock, and set use_sim_time.'
#: No program dates its transforms so far (ns) ahead or behind.
_LARGE = 10 * SECOND


def _is_played(facts: Facts) -> bool:
    """Return whether a bag is played."""
    return any(PLAYER in each.node for each in facts.around.publishers or ())


def data_offset(facts: Facts) -> int:
    """Return the newest stamp at its arrival minus the clock of the node (ns); 0: not known."""
    edge, around = facts.edge, facts.around
    if not edge or not around.now or around.is_simulated:  # its rate is not that of `silence`
        return 0
    return (edge.refused_stamp if edge.is_refusing else edge.latest + edge.stalled
            ) + edge.silence - around.now


#: Stamps may be so far (ns) behind the clock, since they are computed late, or ahead on purpose.
_LATE, _ON_PURPOSE = 3 * SECOND, 5 * SECOND


def _is_in_time(facts: Facts) -> bool:
    return -_LATE <= data_offset(facts) <= _ON_PURPOSE


def _which_is_off(facts: Facts) -> str:
    """Return which of time and data is not on the clock of the node; '' if it is not known."""
    edge, now = facts.edge, facts.around.now
    if not edge or not now or abs(facts.time - edge.latest) <= OTHER_CLOCK:
        return ''
    clock = f"the {'simulated' if facts.around.is_simulated else 'system'} clock of this node"
    is_time = abs(facts.time - now) <= OTHER_CLOCK
    is_data = edge.oldest - OTHER_CLOCK <= now <= edge.latest + edge.silence + OTHER_CLOCK or (
        bool(edge.refused) and abs(edge.refused_stamp - now) <= OTHER_CLOCK
        < abs(edge.latest - facts.around.system_now))
    # An old time is on no other clock, unless it fits one.
    is_other = (facts.time < SINCE_START if not facts.around.is_simulated else
                abs(facts.time - facts.around.system_now) <= OTHER_CLOCK)
    return (f'The requested time is on {clock}, the data are not' if is_time and not is_data else
            f'The data are on {clock}, the requested time is not' if is_data and is_other else '')


@_rule('gap', 'Start {node} again.', 'Extrapolation into the future', symptoms=(FUTURE,),
       needs=('publishers',), explains=('too_soon',))
def _gap(facts: Facts) -> Iterator[Evidence]:
    edge, around = facts.edge, facts.around
    if edge and not arrives(facts) and edge.authority in around.ended and (
            around.ended[edge.authority] not in around.nodes(around.topics[-1])):
        node = shortened(around.ended[edge.authority])
        yield Evidence(f'{node}, which has published it, has ended', {'node': node})


@_rule('too_soon', '{remedy}.',
       'Extrapolation into the future', symptoms=(FUTURE,), needs=('publishers',),
       is_on_wire=False)
def _too_soon(facts: Facts) -> Iterator[Evidence]:
    edge, waited = facts.edge, facts.waited
    if not edge or not arrives(facts):
        return
    ahead = facts.time - edge.latest
    if ahead > OTHER_CLOCK or edge.stalled > RECENT:
        return
    if facts.around.is_simulated:
        ahead = 0  # how long this takes is not known
    elif edge.period:  # the next one with a later stamp
        ahead = max(-(-ahead // edge.period) * edge.period - edge.silence, 1)
    how = (f'Data arrive every {edge.period / SECOND:.1f} s' if edge.period > RECENT and ahead else
           'Data still arrive')
    yield Evidence(f'{how}, so this transform is on its way', {'remedy': (
        f'It has not come within {waited.seconds:g} s: pass a longer timeout=' if waited else
        'Pass timeout= to wait for it' if ahead <= RECENT else
        f'Pass a timeout= of more than {ceil(ahead / SECOND * 10) / 10} s') + (
            ', or look up Time() for the latest' if facts.time > edge.latest else '')})


@_rule('cache_too_short', '{remedy}',
       'Extrapolation into the past', symptoms=(PAST,), is_on_wire=False)
def _cache_too_short(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if not edge or not edge.has_dropped:
        return
    age = edge.latest - facts.time
    if edge.cache_time < age <= LONGEST_CACHE and _is_in_time(facts):
        remedy = f'pass cache_time={ceil(age / SECOND) + 1} s to the buffer, or look up sooner'
        yield Evidence(
            f'The buffer keeps the last {edge.cache_time / SECOND:g} s of each frame',
            {'remedy': f'If that stamp is so old, {remedy}; else correct its clock.'
             if facts.around.now else f'P{remedy[1:]}.'})


@_rule('too_many_samples', 'Pass a larger max_samples to the buffer.',
       'Extrapolation into the past', symptoms=(PAST,), is_on_wire=False)
def _too_many_samples(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if edge and edge.is_full and edge.latest - facts.time <= edge.cache_time:
        yield Evidence('Its earlier transforms have been dropped before the cache time was over')


@_rule('cleared', 'Pass timeout= to wait for the next one.', 'A jump back in time',
       symptoms=(CLEARED,), needs=('listener',), is_on_wire=False)
def _cleared(facts: Facts) -> Iterator[Evidence]:
    nodes = facts.around.clock_nodes or ()
    if facts.around.is_simulated and len(nodes) == 1 and any(nodes):
        yield Evidence(f'{shortened(nodes[0])} publishes /clock')
