"""The rules that the error of a lookup can reach; the most certain ones come first."""

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from math import ceil

from puretf._causes.clocks import apart, is_off, SINCE_START
from puretf._causes.facts import Facts, listed, OTHER_CLOCK, RECENT, UNKNOWN
from puretf._causes.rules import Evidence, registry, Rule
from puretf._text.names import namespace_distance, quoted, shortened, TF_MESSAGE
from puretf._text.similar_names import is_slip, may_be_one_robot, without_prefix
from puretf._text.times import exact_time, SECOND

#: The rules, by their codes.
RULES: dict[str, Rule] = {}
_rule = registry(RULES)
_NOT_THERE = 'missing', 'unconnected'
_NAMES = *_NOT_THERE, 'typo'
_NO_DATA = *_NOT_THERE, 'silence'
_NOTHING = 'missing', 'silence'
_TIMES = 'past', 'future'
_SEND_AGAIN = ('Send it again and again with new stamps or, if it does not move, with a '
               'StaticTransformBroadcaster.')
PLAYER = 'rosbag2_player'  #: in the names of nodes that play a bag
PLAY = 'Play the bag with --clock, and set use_sim_time.'
#: No cache time that is longer than this (ns) is proposed.
LONGEST_CACHE = 600 * SECOND
#: A transform was sent once if no other one has followed for this time (ns).
_ONCE = 5 * SECOND
#: The largest number of names, and of roots, that are compared with those of other trees.
_MAX_COMPARED, _MAX_ROOTS = 5000, 100
#: Stamps may be so far (ns) behind the clock, since they are computed late, or ahead on purpose.
_LATE, _ON_PURPOSE = 3 * SECOND, 5 * SECOND
#: No program dates its transforms so far (ns) ahead or behind.
_LARGE = 10 * SECOND


def _is_played(facts: Facts) -> bool:
    """Return whether the edge is from a bag that is played."""
    around = facts.around
    node = around.node_of(facts.edge.authority)
    nodes = [node] if node else around.nodes(around.topics[-1]) if around.topics else ()
    return bool(nodes) and all(PLAYER in node for node in nodes)


def _is_in_time(facts: Facts) -> bool:
    return -_LATE <= facts.offset <= _ON_PURPOSE


def _senders(facts: Facts, child: str, authority: str, parent: str = '') -> list[str]:
    """Return the node of a publisher, or those that are heard to send a child."""
    if node := facts.around.node_of(authority):
        return [node]
    return sorted({node for each in facts.heard if each.topic in facts.around.topics
                   and child in each.parents and parent in ('', each.parents[child])
                   for node in each.nodes})


def _of(word: str, nodes: Sequence[str]) -> str:
    """Name nodes after 'by' or 'from'; '' if none is known."""
    return f' {word} {listed(nodes)}' if any(nodes) else ''


# In this process


@_rule('time_is_duration', 'Pass a Duration as timeout=.', 'other', symptoms=(*_NAMES, *_TIMES),
       is_on_wire=False)
def _time_is_duration(facts: Facts) -> Iterator[Evidence]:
    if facts.is_duration:
        yield Evidence('The time is a Duration')


@_rule('time_in_seconds', 'Pass times in ns.', 'past', symptoms=['past'], is_on_wire=False)
def _time_in_seconds(facts: Facts) -> Iterator[Evidence]:
    if facts.buffer.takes_ns and facts.edge.oldest <= facts.time * SECOND <= facts.edge.latest:
        yield Evidence(f'{facts.time} s is within the data, {facts.time} ns is not')


@_rule('no_listener', 'Create a TransformListener with this buffer.', 'missing_frame',
       symptoms=['missing'], is_on_wire=False)
def _no_listener(facts: Facts) -> Iterator[Evidence]:
    if facts.buffer.needs_listener and not facts.around.topics and not facts.buffer.names:
        yield Evidence('No TransformListener fills this buffer')


@_rule('executor_blocked', '{remedy}', 'own_node', symptoms=('future', *_NOT_THERE),
       needs=['listener'], is_on_wire=False)
def _executor_blocked(facts: Facts) -> Iterator[Evidence]:
    around, waited, edge = facts.around, facts.waited, facts.edge
    found = {each.node for each in around.publishers or () if each.type == TF_MESSAGE}
    what = f'Nobody publishes on {around.topics[-1]} but'
    if edge.child:
        what, of_edge = 'It is published by', around.node_of(edge.authority)
        found = {node for node, each in waited.blocked.items()
                 if edge.silence >= waited.seconds * SECOND and (
                     node == of_edge or (not of_edge and edge.child in each.children))}
    if found and found <= waited.blocked.keys():
        node = min(found)
        who = 'this node' if node == around.node else shortened(node)
        yield Evidence(f'{what} {who}, which {waited.blocked[node].why}',
                       waited.blocked[node]._asdict())


# Names and parents


@_rule('missing_part', '{remedy}', 'split_bag', symptoms=_NAMES)
def _missing_part(facts: Facts) -> Iterator[Evidence]:
    text, remedy = facts.buffer.missing_part
    if text:
        yield Evidence(text, {'remedy': remedy})


@_rule('changing_parent', 'Let only one parent be published for {frame}.', 'jump',
       symptoms=('unconnected', *_TIMES))
def _changing_parent(facts: Facts) -> Iterator[Evidence]:
    edge, buffer = facts.edge, facts.buffer
    for frame in buffer.changed:
        parents = buffer.parents(frame)
        roots = {buffer.chain(each.name)[-1] for each in parents}
        is_on_path = frame == edge.child if edge.child else roots.issuperset(facts.roots)
        # A single node may send a static transform anew, in another frame.
        if is_on_path and len(parents) > 1 and (not all(each.is_static for each in parents)
                                                or len(_senders(facts, frame, '')) > 1):
            yield Evidence(f'{quoted(frame)} has {len(parents)} parents: ' + ', '.join(
                f'{quoted(each.name)}{" (static)" * each.is_static}'
                f'{_of("by", _senders(facts, frame, each.authority, each.name))}'
                for each in parents[-4:]), {'frame': quoted(frame)}, frames=[frame])


def _pairs(facts: Facts) -> Iterator[tuple[str, list[str], str, list[str]]]:
    """Yield pairs of trees, with their roots: those of the lookup with others; without it, all."""
    trees: dict[str, list[str]] = {}
    for name in facts.buffer.names[:_MAX_COMPARED]:
        trees.setdefault(facts.buffer.chain(name)[-1], []).append(name)
    for root in facts.roots or [*trees][:_MAX_ROOTS]:
        for other, names in trees.items():
            if root != other and (facts.roots or root < other):
                yield root, trees.get(root, []), other, names


@_rule('similar_name', 'If they are one frame, use one name.', 'two_trees',
       symptoms=['unconnected'], severity='warning')
def _similar_name(facts: Facts) -> Iterator[Evidence]:
    """Find roots with almost the name of a frame in another tree."""
    for root, tree, other, names in _pairs(facts):
        are_robots = len(tree) == len(names) and all(map(is_slip, sorted(tree), sorted(names)))
        slips = [(a, name) for a, others in ((root, names), (other, tree)) for name in others
                 if is_slip(a, name)]
        if slips and not are_robots and other in (facts.roots or [other]):
            yield Evidence('{} and {} are almost the same name'.format(*map(quoted, slips[0])),
                           frames=slips[0])


@_rule('part_prefix', 'If they are, give all frames of the robot the same prefix, or none.',
       'two_trees', symptoms=['unconnected'], explains=('several_trees', 'disconnected'))
def _part_prefix(facts: Facts) -> Iterator[Evidence]:
    """Find robots of whose frames only a part has a prefix."""
    parents = facts.buffer.newest
    for _, tree, _, other in _pairs(facts):
        pairs = [(a, b) for names, others in ((tree, other), (other, tree))
                 for a in names for b in without_prefix(a).intersection(others)]
        # Two robots have more such pairs. One of the two is the root of its tree, and the other
        # one has no child: so the trees would be one.
        if len(pairs) == 1 and any(a not in parents and b not in parents.values()
                                   for a, b in (pairs[0], pairs[0][::-1])):
            yield Evidence(f'{" and ".join(map(quoted, pairs[0]))} may be one frame: only a part '
                           'of the frames has the prefix or suffix', frames=pairs[0])


# Transforms that are refused


def _refusals(code: str, what: str, facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if edge.child and (facts.arrives or not facts.around.topics):
        return
    for name in [edge.child] if edge.child else dict.fromkeys((*facts.names, *facts.roots)):
        if code in (refusals := facts.buffer.refusals(name)):
            count, authority = refusals[code]
            yield Evidence(f'{_refused(count, name, _senders(facts, name, authority))}: {what}')


for _code, _what, _remedy in (
        ('not_a_number', 'a number is NaN or infinite',
         'Find out where the program computes it: often a division by zero, or a missing '
         'measurement.'),
        ('unnormalized', 'the quaternion is zero', 'Set its rotation; w = 1 is none.'),
        ('loop', 'the frame is its own parent', 'Publish it with another parent.'),
        ('empty_name', 'the other name is empty', 'Set frame_id and child_frame_id.')):
    _rule(_code, _remedy, 'other', symptoms=(*_NAMES, 'future'))(
        partial(_refusals, _code, _what))


def _refused(count: int, child: str, nodes: Sequence[str]) -> str:
    return (f'{count} transform{"s" * (count != 1)} of {quoted(child)}{_of("from", nodes)} '
            f'{"was" if count == 1 else "were"} refused')


@_rule('zero_stamp', 'Set header.stamp to the time of the transform.', 'clock', symptoms=_TIMES)
def _zero_stamp(facts: Facts) -> Iterator[Evidence]:
    if facts.edge.oldest == facts.edge.latest == 0:
        yield Evidence('All its stamps are 0')


@_rule('use_sim_time_differs', 'Set use_sim_time in all nodes, or in none.', 'clock',
       symptoms=_TIMES, needs=('now', 'clock_nodes'))
def _use_sim_time_differs(facts: Facts) -> Iterator[Evidence]:
    """One of time and data is on the clock of the node, the other one is not."""
    edge, around, now = facts.edge, facts.around, facts.around.now
    if not around.clock_nodes or not now or abs(facts.time - edge.latest) <= OTHER_CLOCK:
        return
    is_time = abs(facts.time - now) <= OTHER_CLOCK
    is_data = edge.oldest - OTHER_CLOCK <= now <= edge.latest + edge.silence + OTHER_CLOCK or (
        bool(edge.refused) and abs(edge.refused_stamp - now) <= OTHER_CLOCK
        < abs(edge.latest - around.system_now))
    # An old time is on no other clock, unless it fits one.
    is_other = (abs(facts.time - around.system_now) <= OTHER_CLOCK if around.is_simulated else
                facts.time < SINCE_START)
    if is_time != is_data and (is_time or is_other):
        on, off = ('requested time is', 'data are') if is_time else (
            'data are', 'requested time is')
        yield Evidence(
            f'The {on} on the clock of this node, the {off} not, and '
            f'{listed(around.clock_nodes)} publish{"es" * (len(around.clock_nodes) == 1)} /clock')


@_rule('time_goes_back', '{remedy}', 'old_data', symptoms=_TIMES)
def _time_goes_back(facts: Facts) -> Iterator[Evidence]:
    edge, around = facts.edge, facts.around
    is_cause = (edge.is_refusing and facts.time <= edge.latest + OTHER_CLOCK
                if facts.symptom == 'future' else facts.time <= edge.refused_stamp + RECENT)
    if edge.refused and is_cause:
        both = edge.refused_authority, edge.authority
        old, new = map(around.node_of, both)
        is_shared = old and new and old != new and around.ended.keys().isdisjoint(both)
        yield Evidence(
            f'{_refused(edge.refused, edge.child, [old])}, since one at {exact_time(edge.latest)}'
            f'{_of("from", [new])} is newer by more than the cache time',
            {'remedy': PLAY if _is_played(facts) else
             f'Let only one node send {quoted(edge.child)}.' if is_shared else
             'Clear the buffer; if it happens again, stop the node with the later clock.'})


@_rule('nanosec', 'Split the time into sec and nanosec, as rclpy.time.Time.to_msg() does.',
       'clock', symptoms=_TIMES)
def _nanosec(facts: Facts) -> Iterator[Evidence]:
    if facts.edge.nanosec:
        yield Evidence(f'nanosec of its stamps is {facts.edge.nanosec}, not below {SECOND}')


# What the ROS graph shows


@_rule('wrong_type', 'Send transforms with a TransformBroadcaster or a '
       'StaticTransformBroadcaster.', 'missing_frame', symptoms=_NO_DATA,
       explains=['no_transforms'])
def _wrong_type(facts: Facts) -> Iterator[Evidence]:
    """Find messages of another type on /tf and /tf_static; no listener receives them."""
    for node, topic, kind in dict.fromkeys(each[:3] for each in facts.around.publishers or ()):
        if kind != TF_MESSAGE:
            yield Evidence(f'{shortened(node) or "a node"} publishes {shortened(kind)} on '
                           f'{topic}, not {TF_MESSAGE}', nodes=[node], topics=[topic])


@_rule('volatile_listener', 'Omit static_qos, or make it transient local.', 'tf_static',
       symptoms=_NO_DATA, needs=['publishers'])
def _volatile_listener(facts: Facts) -> Iterator[Evidence]:
    if facts.around.is_volatile:
        yield Evidence(f'This listener of {facts.around.topics[0]} is not transient local, so it '
                       'misses what was sent before its start')


def _unmatched(lack: str, facts: Facts) -> Iterator[Evidence]:
    """Find publishers that do not offer what listeners require."""
    for topic in facts.around.topics:
        nodes = [each.node for each in facts.around.publishers or () if each.topic == topic and (
            each.type == TF_MESSAGE and each.lacks == lack and _may_send(facts, each.node))]
        if nodes:
            names = sorted({*nodes} - {''})
            yield Evidence(
                f'{len(nodes)} publisher{"s" * (len(nodes) > 1)} on {topic}'
                f'{f" ({listed(names)})" if names else ""} {"are" if len(nodes) > 1 else "is"} '
                f'not {lack}: listeners that require it receive nothing', nodes=names,
                topics=[topic])


def _may_send(facts: Facts, node: str) -> bool:
    """Return whether a node may send what a lookup lacks: no other frames are heard from it."""
    wanted = facts.roots or facts.names
    heard = {name for each in facts.heard if node in each.nodes
             for names in each.parents.items() for name in names} if wanted else ()
    return not heard or not heard.isdisjoint(wanted)


for _code, _lack, _remedy in (
        ('static_not_latched', 'transient local', 'Send with a StaticTransformBroadcaster.'),
        ('incompatible_qos', 'reliable', 'Send with a TransformBroadcaster, or pass a best-effort '
         'qos to the TransformListener.')):
    _rule(_code, _remedy, 'tf_static', symptoms=_NO_DATA, needs=['publishers'],
          explains=['no_transforms'], meaning=_unmatched.__doc__)(partial(_unmatched, _lack))


@_rule('other_namespace', 'To listen to {topic}, pass {options}.', 'namespace', symptoms=_NO_DATA,
       explains=['no_transforms'], severity='warning')
def _other_namespace(facts: Facts) -> Iterator[Evidence]:
    """Find transforms on the topic tf of a namespace, while /tf has none."""
    around = facts.around
    if around.other_topics and len(around.topics) > 1 and not around.is_fed:
        first = shortened(around.other_topics[0])
        yield Evidence(f'No transform has arrived on {around.topics[-1]}, but transforms are '
                       f'published on {listed(around.other_topics)}',
                       {'topic': first, 'options': _listening_to(first)},
                       topics=around.topics[-1:])


def _listening_to(topic: str) -> str:
    namespace, _, name = topic.rpartition('/')
    option = (f'pass --ros-args -r /tf:={topic} -r /tf_static:={topic}_static' if name != 'tf' else
              f'pass --namespace {namespace[1:]}' if namespace else 'omit --namespace')
    return (f"tf_topic='{topic}', tf_static_topic='{topic}_static' to the TransformListener; in "
            f'commands, {option}')


@_rule('half_namespace', '{remedy}', 'half_namespace', symptoms=_NAMES, needs=['listener'],
       is_costly=True,
       explains=('silent_publisher', 'several_trees', 'disconnected', 'other_namespace'))
def _half_namespace(facts: Facts) -> Iterator[Evidence]:
    topics, parents = facts.around.topics, facts.buffer.newest
    own = topics[-1].removesuffix('_static')
    others = [each for each in facts.heard if each.topic not in topics]
    trees: dict[str, dict[str, str]] = {}  # by the other topics: by child, the parent
    for each in others:
        trees.setdefault(each.topic.removesuffix('_static'), {}).update(each.parents)
    # If a frame is the root in several namespaces, these are robots that share it, such as a map.
    roots = Counter(root for tree in (parents, *trees.values())
                    for root in {*tree.values()} - tree.keys())
    for base in sorted(trees, key=lambda base: (namespace_distance(base, own), base)):
        tree = trees[base]
        joints = {frame for frame in (
            *(tree.keys() & parents.values()), *(parents.keys() & tree.values()))
            # The whole tree of another robot has the same children, or no frame in common.
            if roots[frame] < 2 and tree.keys().isdisjoint(parents)}
        wanted = ([root for root in facts.roots if root in joints] if facts.roots else
                  facts.names or sorted(joints)[:1])
        found = [child for child in tree if child in wanted] or [
            child for child in tree if tree[child] in wanted]
        for child in found[:1] if may_be_one_robot(base, own) else ():
            sender = next(each for each in others if each.topic.removesuffix('_static') == base
                          and each.parents.get(child) == tree[child])
            longest = shortened(max(own, base, key=len))
            yield Evidence(
                f'{quoted(tree[child])} -> {quoted(child)} is published on '
                f'{shortened(sender.topic)}{_of("by", sender.nodes)}, not on '
                f'{" and ".join(topics[::-1])}',
                {'remedy': 'Use a TransformListener.' if own == base else
                 'Remap both /tf and /tf_static in all nodes of the robot (--ros-args '
                 f'-r /tf:={longest} -r /tf_static:={longest}_static), or in none of them.'
                 if joints else ''}, sender.nodes, [sender.topic], [tree[child], child])


@_rule('no_clock', 'Start what publishes /clock, or set use_sim_time to false.', 'clock',
       symptoms=(*_NO_DATA, *_TIMES, 'cleared'), needs=['clock_nodes'],
       explains=('gap', 'other_clock', 'no_transforms'))
def _no_clock(facts: Facts) -> Iterator[Evidence]:
    """Find nodes that wait for /clock, which nothing publishes."""
    around, symptom = facts.around, facts.symptom
    if around.clock_nodes:
        return
    has_stopped = symptom == 'future' and not facts.arrives
    keeps_nothing_away = symptom in _NOT_THERE and around.has_data
    if around.is_simulated and (around.now == 0 or has_stopped) and not keeps_nothing_away:
        yield Evidence('use_sim_time is set in this node, but nothing publishes /clock')
    if symptom in ('none', *_NO_DATA):
        publishers = {each.node for each in around.publishers or ()}
        waiting = sorted(
            node for node, topic in around.waits_for.items() if topic == '/clock'
            and node != around.node and (symptom == 'none' or node in publishers)
            and not facts.has_sent(node))
        if waiting:
            yield Evidence(f'{listed(waiting)} wait{"s" * (len(waiting) == 1)} for /clock, which '
                           'nothing publishes', nodes=waiting)


@_rule('joint_without_state', '{remedy}', 'missing_frame', symptoms=_NO_DATA, needs=['publishers'],
       explains=('no_transforms', 'link_without_transform'))
def _joint_without_state(facts: Facts) -> Iterator[Evidence]:
    states = facts.around.joint_states
    for node in dict.fromkeys(each.node for each in facts.around.publishers or ()):
        topic = facts.around.waits_for.get(node, '/clock')
        # An arm may listen to positions to be set, as on joint_command, without need.
        if 'joint_state' in topic and not (facts.symptom == 'none' and facts.has_sent(node)):
            other = next((name for name in states if node not in states[name]), '')
            where = f'; {listed(states[other])} publishes {other}' if other else ''
            yield Evidence(
                f'{shortened(node)} waits for {topic}, which nothing publishes{where}',
                {'remedy': remap(topic, other) if other else
                 f'If a joint moves the frame, start a program that publishes {topic}.'},
                [node], [topic])
            return


def remap(topic: str, other: str) -> str:
    return f'Remap one of them: -r {topic}:={shortened(other)}.'


@_rule('no_robot_state_publisher', 'Start robot_state_publisher FILE.', 'missing_frame',
       symptoms=_NOTHING, needs=['publishers'], explains=['no_transforms'])
def _no_robot_state_publisher(facts: Facts) -> Iterator[Evidence]:
    """Find joint states while nothing publishes transforms."""
    around = facts.around
    topics = [] if around.other_topics else [*around.joint_states][:1]
    if topics and not (around.has_data or around.publishers or around.is_new):
        yield Evidence(f'{topics[0]} has a publisher, but nothing publishes transforms',
                       nodes=around.joint_states[topics[0]], topics=topics)


@_rule('no_transforms', 'Start a program that publishes, with the same ROS_DOMAIN_ID.',
       'missing_frame', symptoms=_NOTHING, needs=['publishers'], is_costly=True)
def _no_transforms(facts: Facts) -> Iterator[Evidence]:
    around = facts.around
    if not (around.has_data or around.publishers or around.is_new):
        yield Evidence('. '.join(filter(None, (
            f'0 publishers on {" and ".join(around.topics[::-1])} were found in ROS domain '
            f'{around.domain}', around.other_domains().strip(' .'),
            around.hides_others and f'{around.hides_others} hides other machines'))))


@_rule('other_user', 'Run all nodes as one user.', 'missing_frame', symptoms=_NOTHING,
       is_costly=True, explains=('no_transforms', 'silent_publisher'))
def _other_user(facts: Facts) -> Iterator[Evidence]:
    """Find nodes of another user, from which Fast DDS brings nothing."""
    around = facts.around
    # The names of nodes are received by the way on which nothing arrives.
    if {each.node for each in around.publishers or ()} == {UNKNOWN} and not (
            around.has_data or around.is_new) and (user := around.other_user()):
        yield Evidence(f'{user} runs nodes in this domain on this computer, and Fast DDS shares '
                       'no memory with other users', topics=around.topics[::-1])


@_rule('silent_publisher', '', 'missing_frame', symptoms=_NOT_THERE, is_costly=True,
       severity='info')
def _silent_publisher(facts: Facts) -> Iterator[Evidence]:
    """Find publishers on /tf and /tf_static from which nothing arrives."""
    around, buffer = facts.around, facts.buffer
    sent = {each.gid for each in facts.heard if each.topic in around.topics}
    heard = {child for each in facts.heard for child in each.parents}
    # Who sends what the buffer has, and was not heard now, is not known.
    if not around.has_data or not buffer.newest.keys() <= heard or '' in sent:
        return
    # A frame may have been handed over by a node that sends nothing now.
    if any(frame in buffer.changed for name in facts.names for frame in buffer.chain(name)):
        return
    silent = {each.node: each.topic for each in around.publishers or ()
              if each.type == TF_MESSAGE and each.gid not in sent and each.node != around.node
              and not each.lacks}
    players = [node for node, topic in silent.items()
               if PLAYER in node and topic.endswith('_static')]
    # A robot_state_publisher may have fixed joints only.
    nodes = players or [node for node in silent if not facts.has_sent(node) and not (
        facts.symptom == 'none' and node in around.waits_for)]
    if nodes:
        topics = [*dict.fromkeys(silent[node] for node in nodes)]
        offset = ': a start offset leaves out the static transforms before it' if players else ''
        yield Evidence(f'{listed(nodes)} ha{"ve" if len(nodes) > 1 else "s"} a publisher on '
                       f'{", ".join(topics)}, but nothing arrives from there{offset}',
                       nodes=nodes, topics=topics)


# Times without data


@_rule('two_clocks', 'Stop all but one.', 'two_nodes', symptoms=('cleared', *_TIMES),
       needs=['clock_nodes'])
def _two_clocks(facts: Facts) -> Iterator[Evidence]:
    nodes = facts.around.clock_nodes or ()
    if facts.around.is_simulated and len(nodes) > 1:
        yield Evidence(f'{len(nodes)} nodes publish /clock, so that the time jumps between them: '
                       f'{listed(nodes)}')


@_rule('frozen_stamp', _SEND_AGAIN, 'one_time', symptoms=_TIMES)
def _frozen_stamp(facts: Facts) -> Iterator[Evidence]:
    if facts.edge.is_frozen and not facts.edge.refused:
        yield Evidence('All that have arrived have this stamp')


@_rule('one_shot', _SEND_AGAIN, 'one_time', symptoms=_TIMES, needs=['listener'])
def _one_shot(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if edge.samples == 1 and edge.silence > _ONCE and not (edge.has_dropped or edge.refused):
        yield Evidence(f'Only one has arrived, {edge.silence / SECOND:.1f} s ago')


@_rule('message_other_clock', 'If a message has it, correct the clock of its sender.', 'clock',
       symptoms=_TIMES, needs=('now', 'listener'))
def _message_other_clock(facts: Facts) -> Iterator[Evidence]:
    now = facts.around.now
    if not now or not facts.arrives or not _is_in_time(facts):
        return
    offset = facts.time - now + round(facts.waited.seconds * SECOND)
    if is_off(offset, facts.time, now) and (offset < 0 or (
            facts.time > facts.edge.latest + RECENT
            and (offset > _LATE or not facts.around.is_simulated))):
        yield Evidence(f'That time is {apart(offset, facts.time)} the clock of this node, and '
                       'the data are in time')


@_rule('other_clock', '{remedy}', 'clock', symptoms=_TIMES)
def _other_clock(facts: Facts) -> Iterator[Evidence]:
    edge, offset, now = facts.edge, facts.offset, facts.around.now or 0
    # A network that is late for a while delays some of the data, not all.
    is_steady = abs(offset) > _LARGE or not edge.offsets or (
        max(edge.offsets) - min(edge.offsets) <= RECENT)
    if facts.arrives and is_steady and not _is_in_time(facts) and (
            abs(facts.time - now) <= OTHER_CLOCK):
        yield Evidence(
            f'The data are {apart(offset, edge.latest)} the clock of this node',
            {'remedy': RULES['use_sim_time_differs'].remedy if facts.around.clock_nodes else
             PLAY if _is_played(facts) else
             'If they are simulated, publish /clock and set use_sim_time; else stamp them with '
             'the present time.' if edge.latest < SINCE_START else
             'If this is not on purpose, synchronise the clocks of the computers.'})


@_rule('gap', 'Start {node} again.', 'future', symptoms=['future'])
def _gap(facts: Facts) -> Iterator[Evidence]:
    around = facts.around
    node = around.ended.get(facts.edge.authority, '')
    if node and node not in around.nodes(around.topics[-1]):
        yield Evidence(f'{shortened(node)}, which has published it, has ended',
                       {'node': shortened(node)})


@_rule('too_soon', '{remedy}.', 'future', symptoms=['future'], is_on_wire=False)
def _too_soon(facts: Facts) -> Iterator[Evidence]:
    edge, waited = facts.edge, facts.waited
    ahead = facts.time - edge.latest
    if not facts.arrives or ahead > OTHER_CLOCK or edge.stalled > RECENT:
        return
    # Until the next one with a later stamp; in a simulation, how long this takes is not known.
    wait = 0 if facts.around.is_simulated else (
        -(-ahead // edge.period) * edge.period - edge.silence)
    yield Evidence('Data still arrive, so this transform is on its way', {'remedy': (
        f'It has not come within {waited.seconds:g} s: pass a longer timeout=' if waited.seconds
        else 'Pass timeout= to wait for it' if wait <= RECENT else
        f'Pass a timeout= of more than {ceil(wait / SECOND * 10) / 10} s') + (
            ', or look up Time() for the latest' if ahead > 0 else '')})


@_rule('cache_too_short', 'If that time is right, pass cache_time={cache} to the buffer, or look '
       'up sooner.', 'past', symptoms=['past'], is_on_wire=False)
def _cache_too_short(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    age = edge.latest - facts.time
    if edge.has_dropped and edge.cache_time < age <= LONGEST_CACHE and _is_in_time(facts):
        yield Evidence(
            f'The buffer keeps the last {edge.cache_time / SECOND:g} s of each frame',
            {'cache': f'{ceil(age / SECOND) + 1} s'})


@_rule('too_many_samples', 'Pass a larger max_samples to the buffer.', 'past', symptoms=['past'],
       is_on_wire=False)
def _too_many_samples(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if edge.is_full and edge.latest - facts.time <= edge.cache_time:
        yield Evidence('Its earlier transforms have been dropped before the cache time was over')


@_rule('cleared', 'Pass timeout= to wait for the next one.', 'jump_back', symptoms=['cleared'],
       needs=['listener'], is_on_wire=False)
def _cleared(facts: Facts) -> Iterator[Evidence]:
    nodes = facts.around.clock_nodes or ()
    if facts.around.is_simulated and len(nodes) == 1 and any(nodes):
        yield Evidence(f'{shortened(nodes[0])} publishes /clock')
