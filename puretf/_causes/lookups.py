"""The rules that the error of a lookup can reach; the most certain ones come first."""

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from math import ceil

from puretf._causes.clocks import apart, DAY, is_off, SINCE_START, unit_of, UNITS
from puretf._causes.facts import Facts, listed, OTHER_CLOCK, Publisher, RECENT, UNKNOWN
from puretf._causes.rules import Evidence, registry, Rule
from puretf._text.names import namespace_distance, quoted, shortened, TF_MESSAGE
from puretf._text.similar_names import is_slip, may_be_one_robot, without_prefix
from puretf._text.times import cache_text, exact_time, longer_cache, SECOND

#: The rules, by their codes.
RULES: dict[str, Rule] = {}
_rule = registry(RULES)
_own_rule = partial(_rule, is_on_wire=False)  #: of a fault of the process that looks up
_NOT_THERE = 'missing', 'unconnected'
_NAMES = *_NOT_THERE, 'typo'
_NO_DATA = *_NOT_THERE, 'silence'
_NOTHING = 'missing', 'silence'
_TIMES = 'past', 'future'
_SEND_AGAIN = ('Send it again and again with new stamps or, if it does not move, as a static one '
               '(StaticTransformBroadcaster, or is_static=True).')
SIM_TIME = 'Set use_sim_time in all nodes, or in none.'
PLAYER = 'rosbag2_player'  #: in the names of nodes that play a bag
PLAY = 'Play the bag with --clock, and set use_sim_time.'
#: No cache time that is longer than this (ns) is proposed.
LONGEST_CACHE = 600 * SECOND
#: A transform was sent once if no other one has followed for this time (ns).
_ONCE = 5 * SECOND
#: The largest number of names, and of roots, that are compared with those of other trees.
_MAX_COMPARED, _MAX_ROOTS = 5000, 100
#: Stamps may be so far (ns) behind the clock, since they are computed late, or ahead on purpose;
#: no program dates its transforms so far ahead or behind.
_LATE, _ON_PURPOSE, _LARGE = 3 * SECOND, 5 * SECOND, 10 * SECOND


def _is_played(facts: Facts) -> bool:
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


@_own_rule('time_is_duration', 'Pass a Duration as timeout=.', 'other', (*_NAMES, *_TIMES))
def _time_is_duration(facts: Facts) -> Iterator[Evidence]:
    if facts.is_duration:
        yield Evidence('The time is a Duration')


def _takes_dates(facts: Facts, time: int) -> bool:
    """Return whether a user inserts stamps in ns, and a time (ns) is a date, not simulated."""
    return facts.buffer.takes_ns and time > SINCE_START


def _unit(facts: Facts) -> str:
    """Return the unit in which the time of a lookup is within the data; '' if it may be in ns."""
    if not facts.buffer.takes_ns or (facts.time >= SECOND and facts.edge.oldest < SINCE_START):
        return ''
    return next((unit for unit, size in UNITS.items()
                 if facts.edge.oldest <= facts.time * size <= facts.edge.latest), '')


@_own_rule('time_in_seconds', 'Pass times in ns.', 'past', ['past'])
def _time_in_seconds(facts: Facts) -> Iterator[Evidence]:
    if (unit := _unit(facts)) and not facts.edge.shorter:
        yield Evidence(f'{facts.time} {unit} are within the data, {facts.time} ns are not')


@_own_rule('stamps_in_seconds', 'Insert stamps in ns.', 'future', _TIMES)
def _stamps_in_seconds(facts: Facts) -> Iterator[Evidence]:
    if (unit := _unit(facts)) and facts.edge.shorter:
        yield Evidence(f'That time is the newest stamp of {quoted(facts.edge.shorter)}, and '
                       f'within these data if it is in {unit}')
    oldest, latest = facts.edge.oldest, facts.edge.latest
    for unit, size in UNITS.items() if _takes_dates(facts, facts.time) else ():
        # Stamps in ns that are read in another unit are years apart.
        if oldest * size <= facts.time < (latest + 1) * size and (latest - oldest) * size <= DAY:
            yield Evidence(f'That time is within the data if their stamps are in {unit}')


@_own_rule('no_listener', 'Create a TransformListener.', 'missing_frame', ['missing'])
def _no_listener(facts: Facts) -> Iterator[Evidence]:
    if facts.buffer.needs_listener and not facts.around.topics and not facts.buffer.names:
        yield Evidence('No TransformListener fills this buffer')


@_own_rule('executor_blocked', '{remedy}', 'own_node', ('future', *_NOT_THERE), needs=['listener'])
def _executor_blocked(facts: Facts) -> Iterator[Evidence]:
    around, waited, edge = facts.around, facts.waited, facts.edge
    found = {each.node for each in around.publishers if each.type == TF_MESSAGE}
    what = f'Nobody publishes on {around.topics[-1]} but'
    if edge.child:
        what, of_edge = 'It is published by', around.node_of(edge.authority)
        found = {node for node, each in waited.blocked.items()
                 if edge.silence >= waited.seconds * SECOND and (
                     node == of_edge or (not of_edge and edge.child in each.children))}
    if found and found <= waited.blocked.keys() and (
            edge.child or around.nodes(around.topics[-1])):  # a static transform was sent already
        node = min(found)
        who = 'this node' if node == around.node else shortened(node)
        yield Evidence(f'{what} {who}, which {waited.blocked[node].why}',
                       waited.blocked[node]._asdict())


# Names and parents


@_rule('missing_part', '', 'split_bag', _NAMES, severity='warning')
def _missing_part(facts: Facts) -> Iterator[Evidence]:
    """Find recordings without their first part, which has the static transforms."""
    if text := facts.buffer.missing_part.rstrip('.'):
        yield Evidence(text, topics=facts.around.topics[:1])


@_rule('changing_parent', 'Let only one parent be published for {frame}.', 'jump',
       ('unconnected', *_TIMES))
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


@_rule('similar_name', 'If they are one frame, use one name.', 'two_trees', ['unconnected'],
       severity='warning')
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
       'two_trees', ['unconnected'], explains=('several_trees', 'disconnected'))
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
        refusals = facts.buffer.refusals(name)
        if code == max((each for each in refusals if each != 'nanosec'),
                       key=lambda each: refusals[each][0], default=''):
            count, authority = refusals[code]
            yield Evidence(f'{_refused(count, name, _senders(facts, name, authority))}: {what}')


for _code, _what, _remedy in (
        ('not_a_number', 'a number is NaN or infinite',
         'Find out where it is computed: often a division by zero, or a missing measurement.'),
        ('unnormalized', 'the quaternion is zero', 'Set its rotation; w = 1 is none.'),
        ('loop', 'the frame is its own parent', 'Publish it with another parent.'),
        ('empty_name', 'the other name is empty', 'Set frame_id and child_frame_id.')):
    _rule(_code, _remedy, 'other', (*_NAMES, 'future'))(partial(_refusals, _code, _what))


def _refused(count: int, child: str, nodes: Sequence[str]) -> str:
    return f'Transforms of {quoted(child)}{_of("from", nodes)} were refused ({count})'


@_rule('zero_stamp', 'Set header.stamp, or stamp=, to the time of the transform.', 'clock', _TIMES)
def _zero_stamp(facts: Facts) -> Iterator[Evidence]:
    if facts.edge.oldest == facts.edge.latest == 0:
        yield Evidence('All its stamps are 0')


def _is_simulation(facts: Facts, time: int) -> bool:
    """Return whether a time or the clock of the node, but not both, is simulated."""
    around = facts.around
    return bool(around.clock_nodes) and (time < SINCE_START) != (around.now < SINCE_START)


@_rule('time_goes_back', '{remedy}', 'old_data', _TIMES)
def _time_goes_back(facts: Facts) -> Iterator[Evidence]:
    edge, around = facts.edge, facts.around
    is_cause = (edge.is_refusing and facts.time <= edge.latest + OTHER_CLOCK
                if facts.symptom == 'future' else facts.time <= edge.refused_stamp + RECENT)
    if edge.refused and is_cause:
        unit = (unit_of(edge.refused_stamp, edge.latest)
                if _takes_dates(facts, edge.latest) else '')
        old, new = map(around.node_of, (edge.refused_authority, edge.authority))
        yield Evidence(
            f'{_refused(edge.refused, edge.child, [old])}, since one at {exact_time(edge.latest)}'
            f'{_of("from", [new])} is newer by more than the cache time',
            {'remedy': f'Insert stamps in ns, not in {unit}.' if unit else
             PLAY if _is_played(facts) else SIM_TIME if _is_simulation(
                facts, edge.latest) else 'Clear the buffer; if it happens again, let only one '
             'node send it.' if around.topics else 'If data come again, or not in the order of '
             'their stamps, pass a longer cache_time to the buffer; else clear it.'})


@_rule('nanosec', 'Split the time into sec and nanosec, as Time.to_msg() does.', 'clock', _TIMES)
def _nanosec(facts: Facts) -> Iterator[Evidence]:
    nanosec, _ = facts.buffer.refusals(facts.edge.child).get('nanosec', (0, ''))
    if nanosec:
        yield Evidence(f'nanosec of its stamps is {nanosec}, not below {SECOND}')


# What the ROS graph shows


@_rule('wrong_type', 'Send with a TransformBroadcaster or a StaticTransformBroadcaster.',
       'missing_frame', _NO_DATA, explains=['no_transforms'])
def _wrong_type(facts: Facts) -> Iterator[Evidence]:
    """Find messages of another type on /tf and /tf_static; no listener receives them."""
    for node, topic, kind in dict.fromkeys(each[:3] for each in facts.around.publishers):
        if kind != TF_MESSAGE:
            yield Evidence(f'{shortened(node) or "a node"} publishes {shortened(kind)} on '
                           f'{topic}, not {TF_MESSAGE}', nodes=[node], topics=[topic])


@_rule('volatile_listener', 'Omit static_qos, or make it transient local.', 'tf_static', _NO_DATA)
def _volatile_listener(facts: Facts) -> Iterator[Evidence]:
    if facts.around.is_volatile:
        yield Evidence(f'This listener of {facts.around.topics[0]} is not transient local, so it '
                       'misses what was sent before its start')


def _unmatched(lack: str, facts: Facts) -> Iterator[Evidence]:
    """Find publishers that do not offer what listeners require."""
    for topic in facts.around.topics:
        nodes = [each.node for each in facts.around.publishers if each.topic == topic and (
            each.type == TF_MESSAGE and each.lacks == lack and _may_send(facts, each))]
        if nodes:
            names = sorted({*nodes} - {''})
            yield Evidence(
                f'Publishers on {topic} ({listed(names) or len(nodes)}) are not {lack}: '
                'listeners that require it receive nothing', nodes=names, topics=[topic])


def _may_send(facts: Facts, publisher: Publisher) -> bool:
    """Return whether one may send what a lookup lacks: it is not heard to send other frames."""
    wanted = facts.roots or facts.names
    heard = {name for each in facts.heard
             if each.topic == publisher.topic and publisher.node in each.nodes
             for names in each.parents.items() for name in names} if wanted else ()
    return not heard or not heard.isdisjoint(wanted)


for _code, _lack, _remedy in (
        ('static_not_latched', 'transient local', 'Send with a StaticTransformBroadcaster.'),
        ('incompatible_qos', 'reliable', 'Send with a TransformBroadcaster, or pass a best-effort '
         'qos to the TransformListener.')):
    _rule(_code, _remedy, 'tf_static', _NO_DATA, explains=['no_transforms'],
          meaning=_unmatched.__doc__)(partial(_unmatched, _lack))


@_rule('other_namespace', "To listen to {topic}, pass tf_topic='{topic}', tf_static_topic="
       "'{topic}_static' to the TransformListener, or to a command: --ros-args -r /tf:={topic} "
       '-r /tf_static:={topic}_static.', 'namespace', _NO_DATA, explains=['no_transforms'],
       severity='warning')
def _other_namespace(facts: Facts) -> Iterator[Evidence]:
    """Find transforms on the topic tf of a namespace, while /tf has none."""
    around = facts.around
    if around.other_topics:
        yield Evidence(f'No transform has arrived on {around.topics[-1]}, but transforms are '
                       f'published on {listed(around.other_topics)}',
                       {'topic': shortened(around.other_topics[0])}, topics=around.topics[-1:])


@_rule('half_namespace', '{remedy}', 'half_namespace', _NAMES, needs=['listener'], is_costly=True,
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
        # The whole tree of another robot has the same children, or no frame in common.
        joints = {frame for frame in {*tree, *tree.values()} & {*parents, *parents.values()}
                  if roots[frame] < 2 and tree.keys().isdisjoint(parents)}
        wanted = ([root for root in facts.roots if root in joints] if facts.roots else
                  facts.names or sorted(joints)[:1])
        found = [child for child in tree if child in wanted] or [
            child for child in tree if tree[child] in wanted]
        for child in found[:1] if may_be_one_robot(base, own) else ():
            sender = next(each for each in others if each.topic.removesuffix('_static') == base
                          and each.parents.get(child) == tree[child])
            yield Evidence(
                f'{quoted(tree[child])} -> {quoted(child)} is published on '
                f'{shortened(sender.topic)}{_of("by", sender.nodes)}, not on '
                f'{" and ".join(topics[::-1])}',
                {'remedy': 'Use a TransformListener.' if own == base else
                 'Remap both /tf and /tf_static in all nodes of the robot, or in none of them.'
                 if joints else ''}, sender.nodes, [sender.topic], [tree[child], child])


@_rule('no_clock', 'Start what publishes /clock, or set use_sim_time to false.', 'clock',
       (*_NO_DATA, *_TIMES, 'cleared'), explains=('gap', 'other_clock', 'no_transforms'))
def _no_clock(facts: Facts) -> Iterator[Evidence]:
    """Find nodes that wait for /clock, which nothing publishes."""
    around, symptom = facts.around, facts.symptom
    if around.clock_nodes:
        return
    has_stopped = symptom == 'future' and not facts.arrives
    if around.is_simulated and (around.now == 0 or has_stopped) and not (
            symptom in _NOT_THERE and around.has_data):
        yield Evidence('use_sim_time is set in this node, but nothing publishes /clock')
    if symptom in ('none', *_NO_DATA):
        publishers = {each.node for each in around.publishers}
        waiting = sorted(
            node for node, topic in around.waits_for.items() if topic == '/clock'
            and node != around.node and (symptom == 'none' or node in publishers)
            and not facts.has_sent(node))
        if waiting:
            yield Evidence(f'{listed(waiting)} wait{"s" * (len(waiting) == 1)} for /clock, which '
                           'nothing publishes', nodes=waiting)


@_rule('joint_without_state', '{remedy}', 'missing_frame', _NO_DATA,
       explains=('no_transforms', 'link_without_transform'))
def _joint_without_state(facts: Facts) -> Iterator[Evidence]:
    states = facts.around.joint_states
    for node in dict.fromkeys(each.node for each in facts.around.publishers):
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


def remap(topic: str, other: str) -> str:
    return f'Remap one of them: -r {topic}:={shortened(other)}.'


@_rule('no_transforms', 'Start {program}.', 'missing_frame', _NOTHING, needs=['listener'],
       is_costly=True)
def _no_transforms(facts: Facts) -> Iterator[Evidence]:
    around = facts.around
    if not (around.has_data or around.publishers or around.is_new):
        states = '' if around.other_topics else next(iter(around.joint_states), '')
        yield Evidence(
            f'0 publishers on {" and ".join(around.topics[::-1])} were found in '
            f'{around.domain()}{f". {states} has a publisher" if states else ""}',
            {'program': 'robot_state_publisher FILE' if states else
             'a program that publishes, with the same ROS_DOMAIN_ID'})


@_rule('other_user', 'Run all nodes as one user.', 'missing_frame', _NOTHING, is_costly=True,
       explains=('no_transforms', 'silent_publisher'))
def _other_user(facts: Facts) -> Iterator[Evidence]:
    """Find nodes of another user, from which Fast DDS brings nothing."""
    around = facts.around
    # The names of nodes are received by the way on which nothing arrives.
    if {each.node for each in around.publishers} == {UNKNOWN} and not (
            around.has_data or around.is_new) and (user := around.other_user()):
        yield Evidence(f'{user} runs nodes in this domain on this computer, and Fast DDS shares '
                       'no memory with other users', topics=around.topics[::-1])


@_rule('silent_publisher', '', 'missing_frame', _NOT_THERE, is_costly=True, severity='info')
def _silent_publisher(facts: Facts) -> Iterator[Evidence]:
    """Find publishers on /tf and /tf_static from which nothing arrives."""
    around, buffer = facts.around, facts.buffer
    sent = {each.gid for each in facts.heard if each.topic in around.topics}
    heard = {child for each in facts.heard for child in each.parents}
    # Who sends what the buffer has, and was not heard now, is not known; and a frame may have been
    # handed over by a node that sends nothing now.
    if not around.has_data or '' in sent or not buffer.newest.keys() <= heard or any(
            frame in buffer.changed for name in facts.names for frame in buffer.chain(name)):
        return
    silent = {each.node: each.topic for each in around.publishers
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
        yield Evidence(f'Nothing arrives from the publishers of {listed(nodes)} on '
                       f'{", ".join(topics)}{offset}', nodes=nodes, topics=topics)


# Times without data


@_rule('two_clocks', 'Stop all but one.', 'two_nodes', ('cleared', *_TIMES))
def _two_clocks(facts: Facts) -> Iterator[Evidence]:
    nodes = facts.around.clock_nodes
    if facts.around.is_simulated and len(nodes) > 1:
        yield Evidence(f'{len(nodes)} nodes publish /clock, and the time jumps: {listed(nodes)}')


@_rule('frozen_stamp', _SEND_AGAIN, 'one_time', _TIMES)
def _frozen_stamp(facts: Facts) -> Iterator[Evidence]:
    if facts.edge.is_frozen and not facts.edge.refused:
        yield Evidence('All that have arrived have this stamp')


@_rule('one_shot', _SEND_AGAIN, 'one_time', _TIMES, needs=['listener'])
def _one_shot(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    if edge.samples == 1 and edge.silence > _ONCE and not (edge.has_dropped or edge.refused):
        yield Evidence(f'Only one has arrived, {edge.silence / SECOND:.1f} s ago')


@_rule('message_other_clock', '{remedy}', 'clock', _TIMES)
def _message_other_clock(facts: Facts) -> Iterator[Evidence]:
    around, time = facts.around, facts.time
    offset = time - around.now + round(facts.waited.seconds * SECOND)
    is_other = is_off(offset, time, around.now) and (offset < 0 or (
        time > facts.edge.latest + RECENT and (offset > _LATE or not around.is_simulated)))
    if is_other and around.now and facts.arrives and _is_in_time(facts):
        yield Evidence(
            f'That time is {apart(offset, time)} the clock of this node, and the data are in time',
            {'remedy': SIM_TIME if _is_simulation(facts, time) else
             'If a message has it, correct the clock of its sender.'})


@_rule('other_clock', '{remedy}', 'clock', _TIMES)
def _other_clock(facts: Facts) -> Iterator[Evidence]:
    edge, offset, now = facts.edge, facts.offset, facts.around.now
    # A network that is late for a while delays some of the data, not all.
    is_steady = abs(offset) > _LARGE or not edge.offsets or (
        max(edge.offsets) - min(edge.offsets) <= RECENT)
    if facts.arrives and is_steady and not _is_in_time(facts) and (
            abs(facts.time - now) <= OTHER_CLOCK):
        yield Evidence(
            f'The data are {apart(offset, edge.latest)} the clock of this node',
            {'remedy': SIM_TIME if facts.around.clock_nodes else
             PLAY if _is_played(facts) else
             'If they are simulated, publish /clock and set use_sim_time; else stamp them with '
             'the present time.' if edge.latest < SINCE_START else
             'If this is not on purpose, synchronise the clocks of the computers.'})


@_rule('gap', 'Start {node} again.', 'gap', ['future'])
def _gap(facts: Facts) -> Iterator[Evidence]:
    around = facts.around
    node = around.ended.get(facts.edge.authority, '')
    if node and node not in around.nodes(around.topics[-1]):
        yield Evidence(f'{shortened(node)}, which has published it, has ended',
                       {'node': shortened(node)})


@_own_rule('too_soon', 'Pass a timeout= of more than {time} s{more}.', 'future', ['future'])
def _too_soon(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    ahead = facts.time - edge.latest
    if facts.arrives and ahead <= OTHER_CLOCK and edge.stalled <= RECENT:
        # Until the next one with a later stamp; in a simulation, how long this takes is not known.
        wait = 0 if facts.around.is_simulated else (
            -(-ahead // edge.period) * edge.period - edge.silence) / SECOND
        yield Evidence('Data still arrive, so this transform is on its way', {
            'time': ceil(max(wait, facts.waited.seconds, 0.1) * 10) / 10,
            'more': ', or look up Time() for the latest' * (ahead > 0)})


@_own_rule('cache_too_short', 'If that time is right, pass {argument} to the buffer, or look up '
           'sooner.', 'past', ['past'])
def _cache_too_short(facts: Facts) -> Iterator[Evidence]:
    edge = facts.edge
    age = edge.latest - facts.time
    if edge.is_full and age <= edge.cache_time:
        yield Evidence('Its earlier transforms have been dropped before the cache time was over',
                       {'argument': 'a larger max_samples'})
    if edge.has_dropped and edge.cache_time < age <= LONGEST_CACHE and _is_in_time(facts):
        yield Evidence(f'The buffer keeps the last {cache_text(edge.cache_time)} of each frame',
                       {'argument': longer_cache(age, facts.buffer.takes_ns)})
