"""The checks: each is a function that looks for one kind of fault in an `Observation`."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from itertools import chain, combinations
from math import ceil
from operator import attrgetter, itemgetter
import re
from typing import NamedTuple, Optional, Union

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND
from puretf._causes.clocks import apart, known_offset
from puretf._causes.explanation import explain
from puretf._causes.facts import Facts, listed, OTHER_CLOCK
from puretf._causes.lookups import LONGEST_CACHE, PLAY, PLAYER, remap, RULES, SIM_TIME
from puretf._causes.rules import known, registry, Rule
from puretf._text.names import comma_list, quoted, shortened, SHOWN
from puretf._text.similar_names import near_names, suggest_names
from puretf._text.times import exact_time, longer_cache
from puretf.transform_buffer import CACHE_TIME
from puretf_tools.doctor.message_times import LONG_WAIT, MessageTimes, Verdict
from puretf_tools.doctor.observation import is_in_time, Observation, total
from puretf_tools.doctor.stream import FEWEST, FUTURE, GAP, LATE, SHARE, SHORTEST_GAP, Step
from puretf_tools.doctor.tf_statistics import distances, JUMP, SMALLEST_JUMP, Track
from puretf_tools.inspection.feeds import rivals, Sender
from puretf_tools.inspection.forest import loops
from puretf_tools.inspection.gaps import in_words
from puretf_tools.robot.observed import joint_states_of

SEVERITIES = ERROR, WARNING, INFO = 'error', 'warning', 'info'
#: Transforms that differ by less (m plus rad) are equal.
_EQUAL = 1e-5
#: A transform of /tf was sent once if none follows within this time (ns).
_ONCE = 2 * SECOND
#: Stamps have a constant lead if its mean is at least this part of the largest; localisation dates
#: its transforms ahead by less than this (ns).
_CONSTANT, _MOST_LEAD = 0.8, 5 * SECOND
#: /clock is slow if the time from one message to the next one is longer (ns).
_SLOW_CLOCK = 0.11 * SECOND
#: A frame is handed over if its parent or its publisher changes at most so often, or its parent
#: for at most this part of its transforms.
_FEW_SWITCHES, _SWITCHES = 2, 0.02
#: Before this time (s), static transforms may be on their way.
_SETTLED = 2.0
#: No timeout that is longer than this (s) is proposed.
_LONGEST_TIMEOUT = 10.0
#: The codes of what is judged of stamps, and of the times of other messages.
_OF_STAMPS = 'late', 'future', 'gap', 'jump', 'same_stamp', 'time_goes_back'
_WAITING = 'message_too_old', 'message_never', 'message_early'
#: The scope of a fault that explains those of all frames and nodes.
_ALL = frozenset([''])
_child_of = attrgetter('child')


class Finding(NamedTuple):
    """A fault, or something remarkable."""

    code: str  #: the name of the check, such as 'two_publishers'
    severity: str  #: ERROR, WARNING or INFO
    frames: tuple[str, ...]  #: the frames with the fault
    topics: tuple[str, ...]  #: the topics of their transforms
    nodes: tuple[str, ...]  #: the full names of the nodes that publish them, if known
    evidence: str  #: what was observed, in numbers
    remedy: str  #: what to do, in one sentence
    section: str  #: the short name of one in docs/troubleshooting.md
    time: int  #: when it was, by the stamps (ns); 0: at no single time
    #: On the page: when it was first and last seen (s, monotonic clock); `over` 0.0: it is there.
    since: float = 0.0
    over: float = 0.0


class _Fault(NamedTuple):
    evidence: str
    tracks: Sequence[Track] = ()  #: the tracks whose frames, topics and nodes are named
    frames: Optional[Iterable[str]] = None  #: None: those of the tracks
    topics: Sequence[str] = ()  #: further topics
    nodes: Sequence[str] = ()  #: further nodes
    remedy: Optional[str] = ''  #: '': that of the check; None: nothing
    severity: str = ''  #: '': that of the check
    time: int = 0  #: as `Finding.time`
    #: The frames or nodes whose faults it explains, if its rule explains any; None: those of the
    #: finding or, if it names none, all.
    scope: Optional[Collection[str]] = None
    code: str = ''  #: '': that of the check


#: All checks, by their codes; their rules find `_Fault`s in an `Observation`.
CHECKS: dict[str, Rule] = {}
_check = registry(CHECKS)


def _same(code: str) -> tuple[str, str, str]:
    """Return the code, the remedy and the section of a rule that errors have, too."""
    return code, RULES[code].remedy, RULES[code].section


def diagnose(observation: Observation, ignored: Collection[str] = ()) -> list[Finding]:
    """Run all checks but the ignored ones; return errors first, then warnings, then infos."""
    findings: list[Finding] = []
    named: dict[str, set[str]] = {}  # by code: the names of its faults
    for check in known(CHECKS.values(), observation.not_known):
        for fault in check.find(observation) if check.code not in ignored else ():
            rule = CHECKS[fault.code or check.code]
            if rule.code in ignored:
                continue
            frames, topics, nodes = (tuple(dict.fromkeys(filter(None, names))) for names in (
                map(_child_of, fault.tracks) if fault.frames is None else fault.frames,
                (*fault.topics, *(observation.topics[track.is_static] for track in fault.tracks)),
                (*fault.nodes, *map(observation.node_of, fault.tracks))))
            findings.append(Finding(
                rule.code, fault.severity or rule.severity, frames, topics, nodes, fault.evidence,
                rule.remedy if fault.remedy == '' else fault.remedy or '', rule.section,
                fault.time))
            named.setdefault(rule.code, set()).update(
                frames or nodes or _ALL if fault.scope is None else fault.scope)
    return sorted((finding for finding in findings if not any(
        finding.code in CHECKS[code].explains and _is_among(finding, names, observation)
        for code, names in named.items())),
        key=lambda finding: SEVERITIES.index(finding.severity))


def _is_among(finding: Finding, names: set[str], observation: Observation) -> bool:
    if finding.code.startswith('message_'):
        names = observation.below(names)
    return names >= _ALL or not (finding.frames or finding.nodes) or any(
        each and {*each}.issubset(names) for each in (finding.frames, finding.nodes))


def not_checked(observation: Observation, ignored: Collection[str] = ()) -> list[str]:
    """Return a text for each thing that is not known: the checks that need it, and why."""
    return [f'{", ".join(codes)}: {reason}' for need, reason in observation.not_known.items()
            if (codes := [check.code for check in CHECKS.values()
                          if need in check.needs and check.code not in ignored])]


# Errors


@_check('no_transforms', 'Start the nodes that publish transforms, in the same ROS domain.',
        'missing_frame')
def _no_transforms(observation: Observation) -> Iterator[_Fault]:
    """Find that nothing was received on /tf and /tf_static."""
    if not observation.tracks:
        # It has its remedy.
        text = explain(Facts('silence', observation.around))[0].partition(' More: ')[0]
        yield _Fault(text or '0 transforms', topics=observation.topics,
                     remedy=None if text else '')


def _found_by(code: str, observation: Observation) -> Iterator[_Fault]:
    for evidence in RULES[code].find(observation.facts):
        frames = {*evidence.frames}
        if len(frames) > 1 and len({observation.tree_of.get(name, name) for name in frames}) == 1:
            continue  # they were connected before; see changing_parent
        tracks = [track for track in observation.tracks
                  if not frames.isdisjoint((track.child, *track.parents))]
        yield _Fault(evidence.text, tracks, evidence.frames, evidence.topics, evidence.nodes,
                     RULES[code].remedy.format(**evidence.values) or None, scope=_ALL)


for _code, _need in (('no_clock', 'listeners'), ('other_user', 'listeners'),
                     ('wrong_type', ''), ('missing_part', ''), ('static_not_latched', 'qos'),
                     ('incompatible_qos', 'listeners'), ('other_namespace', ''),
                     ('silent_publisher', 'listeners'), ('similar_name', ''), ('part_prefix', '')):
    CHECKS[_code] = RULES[_code]._replace(find=partial(_found_by, _code), needs=(_need,))


@_check('two_publishers', 'Stop one of the publishers, or give its frame another name.', 'jump',
        needs=('nodes',))
def _two_publishers(observation: Observation) -> Iterator[_Fault]:
    """Find two publishers that send a frame at the same time, so that it jumps."""
    pairs: dict[tuple[str, str, bool], list[tuple[Track, Track]]] = {}
    again = {*chain.from_iterable(observation.recreated.values())}
    for tracks in observation.by_child.values():
        for a, b in combinations(tracks, 2):
            if (a.is_static == b.is_static and not {a.publisher, b.publisher} <= again
                    and _exist_together(observation, a, b)):
                pairs.setdefault((a.publisher, b.publisher, a.is_static), []).append((a, b))
    for group in pairs.values():
        a, b = group[0]
        first, second = (observation.node_of(track) or 'a publisher' for track in (a, b))
        who = f'{first} and {second} both publish' if first != second else (
            f'two publishers of {first} publish' if first[:1] == '/' else 'two publishers publish')
        what = (f'they differ by {max(_distance(*pair) for pair in group):.3g} (m plus rad)'
                if a.is_static else f'{a["count"]} and {b["count"]} transforms')
        children = [a.child for a, _ in group]
        yield _Fault(f'{who} {listed(children)}: {what}', [a, b], children)


def _distance(a: Track, b: Track) -> float:
    return float(distances(a['pose'][None, None], b['pose'][None, None])[0, 0])


def _exist_together(observation: Observation, a: Track, b: Track) -> bool:
    """Return False if two are equal, or one has replaced the other, as when a node restarts."""
    if a.is_static:
        is_same = _distance(a, b) < _EQUAL and [*a.parents][-1] == [*b.parents][-1]
        return not is_same and (observation.present is None or {
            a.publisher, b.publisher} <= {*observation.present})
    return bool(max(a['first_time'], b['first_time']) <= min(a['last_time'], b['last_time']))


@_check('many_publishers', 'Create the broadcaster once, with the node, and not in the callback '
        'of a timer; if the node ends and is started again, look at its log.', 'other',
        needs=('nodes',), explains=('no_transforms', 'gap'))
def _many_publishers(observation: Observation) -> Iterator[_Fault]:
    """Find nodes that create publishers again and again: what they send first can be lost."""
    for (node, topic), publishers in observation.recreated.items():
        frames = [track.child for track in observation.tracks if track.publisher in publishers]
        yield _Fault(f'{len(publishers)} publishers, one after another', (), frames, [topic],
                     [node])


@_check(*_same('changing_parent'),
        explains=('static_and_dynamic', 'two_publishers', 'jump', 'same_stamp', 'gap'))
def _changing_parent(observation: Observation) -> Iterator[_Fault]:
    """Find frames whose parent changes, and with it the shape of the tree."""
    for fault in _found_by('changing_parent', observation):
        tracks = [track for child in fault.frames or () for track in observation.by_child[child]]
        fault = fault._replace(tracks=tracks, scope=None)
        if _is_handed_over(observation, tracks):
            # Only of several publishers, one is silent while it does not have the frame.
            fault = fault._replace(severity=INFO, remedy=None, scope=None if tracks[1:] else ())
        yield fault


def _is_handed_over(observation: Observation, tracks: Sequence[Track]) -> bool:
    """Return whether a frame seldom gets another parent, as when a gripper takes an object."""
    return (len({track.is_static for track in tracks}) == 1
            and sum(track.switches for track in tracks) <= max(
                _FEW_SWITCHES, _SWITCHES * total(tracks, 'count'))
            and all(_take_turns(observation, a, b) for a, b in combinations(tracks, 2)))


def _take_turns(observation: Observation, a: Track, b: Track) -> bool:
    """Return whether one publisher is silent while the other one sends several transforms."""
    arrivals = [track.stream.arrivals for track in (a, b)]
    if a.is_static or min(map(len, arrivals)) <= _FEW_SWITCHES:
        return not _exist_together(observation, a, b)
    senders = np.repeat([0, 1], [*map(len, arrivals)])[
        np.argsort(np.concatenate(arrivals), kind='stable')]
    return bool(np.count_nonzero(np.diff(senders)) <= _FEW_SWITCHES)


@_check('static_and_dynamic', 'Let only one of the two topics have the frame.', 'jump')
def _static_and_dynamic(observation: Observation) -> Iterator[_Fault]:
    """Find frames on both /tf and /tf_static; listeners use now one, now the other."""
    for child, tracks in observation.by_child.items():
        counts = [total([track for track in tracks if track.is_static == is_static], 'count')
                  for is_static in (False, True)]
        if all(counts):
            texts = [f'{count} on {topic}' for count, topic in zip(counts, observation.topics)]
            yield _Fault(f'transforms of {quoted(child)}: {", ".join(texts)}', tracks)


@_check('loop', 'Remove one of them: the frame at the top, such as map, has no parent.', 'other')
def _loop(observation: Observation) -> Iterator[_Fault]:
    """Find frames that are parents of each other in a circle; lookups through them fail."""
    for loop in loops(observation.parents):
        tracks = [track for name in loop for track in observation.by_child[name]]
        names = [*loop[:SHOWN], *['...'] * (len(loop) > SHOWN), loop[0]]
        yield _Fault(f'{len(loop)} frame{"s" * (len(loop) > 1)} in a loop: '
                     f'{" -> ".join(map(shortened, names))}', tracks)


@_check('unknown_frame', 'Publish a transform to this frame, or correct the name in the program '
        'that sends the messages.', 'missing_frame', needs=('headers', 'messages'))
def _unknown_frame(observation: Observation) -> Iterator[_Fault]:
    """Find frames in the headers of messages that no transform leads to."""
    known = tuple(observation.tree_of)
    for frame, topics in observation.topics_of.items():
        if frame.strip('/') and frame.removeprefix('/') not in observation.tree_of:
            fault = _Fault(f'{quoted(frame)} is in the headers on {listed(topics)}, but not among '
                           f'the {len(known)} frames of the transforms. '
                           f'{suggest_names(frame, known)}', frames=[frame], topics=topics)
            if _is_no_place(observation, frame):
                yield fault._replace(severity=INFO, remedy='This is right if it is no place, as '
                                     'that of a joystick; otherwise, publish a transform to it.')
            else:
                yield _if_recorded(observation, fault, 'lead to it', 'to it, or correct the name.')


def _if_recorded(observation: Observation, fault: _Fault, what: str, instead: str) -> _Fault:
    """Make a warning of a fault that static transforms mend, if a bag has none of them."""
    if not observation.has_record_times or any(track.is_static for track in observation.tracks):
        return fault
    return fault._replace(
        evidence=f'{fault.evidence.rstrip(".")}; the bag has no static transforms',
        severity=WARNING, remedy=f'If static transforms {what}, record {observation.topics[1]}, '
        'too, or read the part of the recording that has them; otherwise, publish a transform '
        f'{instead}')


def _is_no_place(observation: Observation, frame: str) -> bool:
    """Return whether a frame has the name of its topics, and no sign of TF, as 'joy' on /joy."""
    names = {topic.rpartition('/')[2] for topic in observation.topics_of[frame]}
    links = {start + link for robot, start in observation.own_robots for link in robot.links}
    return names == {frame} and frame not in links and not near_names(frame, observation.tree_of)


@_check('joint_without_state', 'Send its position on the topic joint_states, with the time, and '
        'under the name that the description gives it; joint_state_publisher does this.',
        'missing_frame', explains=('link_without_transform', 'no_transforms'))
def _joint_without_state(observation: Observation) -> Iterator[_Fault]:
    """Find movable joints without joint states; the links below them are cut off."""
    if found := [*_found_by('joint_without_state', observation)]:
        yield from found
        return
    for robot, start in observation.own_robots:
        topic = joint_states_of(robot.topic)
        others = [] if robot.states else [each for each in robot.elsewhere if each not in {
            joint_states_of(other.topic) for other in observation.robots}]
        known = (f'which names {listed(sorted(robot.states))}' if robot.states else
                 f'but on {listed(others)}' if others else 'where nothing was received')
        silent: dict[str, list[str]] = {}  # by the reason why its states are ignored
        for joint, links in robot.joints.items():
            # The name of a link can be known without a transform to it, from a child of the link.
            if robot.states.get(joint) != '' and not all(
                    start + link in observation.parents for link in links):
                silent.setdefault(robot.states.get(joint, ''), []).append(joint)
        for why, joints in silent.items():
            where = (f'on {topic} only in messages that {why}, which robot_state_publisher ignores'
                     if why else f'not on {topic}, {known}')
            frames = [start + link for joint in joints for link in robot.joints[joint]]
            yield _Fault(f'{len(joints)} of {len(robot.joints)} movable joints are {where}: '
                         f'{listed(joints)}', (), frames, [topic],
                         remedy=remap(topic, others[0]) if others else '',
                         scope=[start + link for link in robot.links] if others else None)


@_check('disconnected', 'Publish a transform between the trees.', 'two_trees',
        needs=('headers', 'messages'))
def _disconnected(observation: Observation) -> Iterator[_Fault]:
    """Find headers of messages with frames of different trees."""
    # By robot and tree: the frames that headers name, and the topics of these headers. Robots with
    # a namespace for their topics and their frames may have trees of their own, and those whose
    # frames differ by numbers only.
    robots: dict[str, dict[int, tuple[dict[str, None], dict[str, None]]]] = {}
    first: dict[tuple[str, ...], int] = {}
    kinds = [first.setdefault(tuple(sorted(re.sub(r'\d+', '', name) for name in tree)), i)
             for i, tree in enumerate(observation.trees)]
    for frame, topics in observation.topics_of.items():
        name = frame.removeprefix('/')
        for topic in topics if name in observation.tree_of else ():
            namespace = topic.split('/')[1]
            trees = robots.setdefault(namespace if name.startswith(f'{namespace}/') else '', {})
            names, on = trees.setdefault(kinds[observation.tree_of[name]], ({}, {}))
            names[name] = on[topic] = None
    for parts in ([*trees.values()] for trees in robots.values() if len(trees) > 1):
        texts = [f'{listed(names)} on {listed(on)}' for names, on in parts[:SHOWN]]
        fault = _Fault(f'headers use frames of {len(parts)} trees: {"; ".join(texts)}', (), [
            *chain(*(names for names, _ in parts))], [*chain(*(on for _, on in parts))])
        yield _if_recorded(observation, fault, 'connect them', 'between the trees.')


@_check('volatile_listener', 'Use a TransformListener, or give the subscription the durability '
        'TRANSIENT_LOCAL.', 'tf_static', severity=WARNING, needs=('listeners',))
def _volatile_listener(observation: Observation) -> Iterator[_Fault]:
    """Find listeners of /tf_static that miss what was sent before their start."""
    for node in observation.volatile_listeners:
        yield _Fault(f'1 subscription of {node or "a node"} to {observation.topics[1]} has the '
                     'durability VOLATILE', topics=observation.topics[1:], nodes=[node])


@_check(*_same('not_a_number'))
def _not_a_number(observation: Observation) -> Iterator[_Fault]:
    """Find transforms with NaN or an infinite number, which listeners refuse."""
    yield from _counted(observation, 'invalid', 'with NaN or an infinite number')


@_check('unnormalized', 'Normalise it; if it was never set, set w = 1.', 'other')
def _unnormalized(observation: Observation) -> Iterator[_Fault]:
    """Find quaternions whose norm is not 1 (within 0.001), so that they are no rotations."""
    for tracks in observation.by_publisher(itemgetter('unnormalized')):
        yield _Fault(f'{_share(tracks, "unnormalized")} with a quaternion whose norm differs from '
                     f'1 by up to {max(track["norm_error"] for track in tracks):.3g}', tracks)


def _counted(observation: Observation, field: str, what: str,
             is_fault: Callable[[Track], object] = lambda track: True) -> Iterator[_Fault]:
    for tracks in observation.by_publisher(lambda track: track[field] and is_fault(track)):
        yield _Fault(f'{_share(tracks, field)} {what}', tracks)


def _share(tracks: Sequence[Track], field: str) -> str:
    return (f'{total(tracks, field)} of {total(tracks, "count")} transforms of '
            f'{listed(map(_child_of, tracks))}')


@_check('other_clock', 'Look at the clock that stamps them.', 'clock',
        explains=('late', 'future', 'gap', *_WAITING))
def _other_clock(observation: Observation) -> Iterator[_Fault]:
    """Find stamps of another clock: far from the arrival, or off while others are in time."""
    stepped = {track for track in observation.tracks if track.stream.clock_step}
    for tracks in observation.by_publisher(stepped.__contains__):
        stream = max(tracks, key=itemgetter('largest_step')).stream
        step, (_, delay) = stream.largest_step, stream.clock_step or (0, 0)
        yield _Fault(f'the stamps of {listed(map(_child_of, tracks))} step forward by '
                     f'{_known(step.length)} after {exact_time(step.begin)}, while transforms '
                     'arrive as before', tracks, time=step.begin,
                     severity=WARNING if -FUTURE <= delay <= LATE else '')
    # If few such stamps make many others old, `time_goes_back` says it.
    told = stepped | {track for track in observation.tracks
                      if observation.refused[track.child] > track['foreign'] > 0}
    if clock := observation.clock:
        # The delays are not compared, because a simulation can be slow, or pause.
        for track in observation.tracks:
            before, after = clock['oldest'] - track['latest'], track['oldest'] - clock['latest']
            if track['delays'] and max(before, after) > OTHER_CLOCK and not (
                    track in told or track.stream.is_frozen):
                side = 'before' if before > 0 else 'after'
                yield _Fault(f'all stamps of {shortened(track.child)} are at least '
                             f'{in_words(max(before, after))} {side} those of '
                             f'{shortened(clock.child)}', [track])
        return
    others = '; others are in time' * is_in_time(
        [*observation.tracks, *observation.message_times])
    for tracks in observation.by_publisher(lambda track: track not in told and (
            track['foreign'] > track['stalled'] or (others and _is_off(track)))):
        field, stamp = 'foreign' if total(tracks, 'foreign') else 'delays', tracks[-1]['stamp']
        yield _Fault(f'{_off_text(tracks, field, "least_delay", "greatest_delay")}; the last '
                     f'stamp is {exact_time(stamp)}{others}', tracks,
                     remedy=_clock_remedy(observation, stamp, tracks))


def _is_off(track: Track) -> bool:
    offset = 0 if track['foreign'] else track.stream.offset or 0
    return offset > CACHE_TIME or bool(known_offset(offset))


def _known(offset: float) -> str:
    """Say how long an offset is (ns), and what it is known for."""
    name = known_offset(round(offset))
    return f'{in_words(offset)}{f" ({name})" if name else ""}'


def _clock_remedy(observation: Observation, stamp: int, tracks: Iterable[Track] = ()) -> str:
    """Return what to do about stamps of another clock; '': that of the check."""
    if any(abs(stamp - time) <= OTHER_CLOCK for sender in observation.clocks
           for time in (sender.stamp, sender.last)):
        return ('Let all nodes, and this command, use one clock: set use_sim_time in all of them, '
                'or in none.')
    return _play(observation, tracks) or _by_dates(observation, tracks)


def _play(observation: Observation, tracks: Iterable[Track]) -> str:
    return PLAY if any(PLAYER in observation.node_of(track) for track in tracks) else ''


def _by_dates(observation: Observation, tracks: Iterable[Track]) -> str:
    """Return what to do about stamps, by the dates of their messages; '': not known."""
    ahead = next((observation.ahead.get(track.publisher) for track in tracks), None)
    if ahead is None:
        return ''
    if abs(ahead) <= FUTURE:
        return 'Look at how the node dates its transforms: the clock of its computer is right.'
    return (f'Synchronise the clocks of the computers: that of the sender is {in_words(ahead)} '
            f'{"ahead" if ahead > 0 else "behind"}, by the dates of its messages.')


@_check(*_same('nanosec'),
        explains=(*_OF_STAMPS, 'two_publishers', 'message_other_clock', *_WAITING))
def _nanosec(observation: Observation) -> Iterator[_Fault]:
    """Find stamps whose nanosec is not the nanoseconds within the second."""
    odd = {track: text for track in observation.tracks
           if (text := _odd_nanosec(track['nanosec'], track))}
    for tracks in observation.by_publisher(odd.__contains__):
        yield _Fault(f'{odd[tracks[0]]} in stamps of {listed(map(_child_of, tracks))}', tracks)
    for each in observation.message_times:
        if text := _odd_nanosec(observation.headers[each.topic].nanosec, each):
            yield _Fault(f'{text} in stamps of {listed(each.frames)}', (), each.frames,
                         [each.topic], observation.senders.get(each.topic, ()))


def _odd_nanosec(largest: int, timed: Union[Track, MessageTimes]) -> str:
    return f'nanosec is up to {largest}' if largest >= SECOND else timed.stream.odd_nanoseconds


@_check(*_same('frozen_stamp'),
        explains=('same_stamp', 'jump', 'time_goes_back', 'message_other_clock', *_WAITING))
def _frozen_stamp(observation: Observation) -> Iterator[_Fault]:
    """Find stamps that do not advance; lookups at any other time fail."""
    for tracks in observation.by_publisher(itemgetter('stalled')):
        stamps = comma_list([*map(exact_time, sorted({each['stall_stamp'] for each in tracks}))])
        yield _Fault(f'{_share(tracks, "stalled")} with a stamp that stands, at {stamps} for '
                     f'{in_words(max(each["stall_span"] for each in tracks))}', tracks,
                     severity='' if any(each['stands'] for each in tracks) else WARNING)


@_check(*_same('zero_stamp'))
def _zero_stamp(observation: Observation) -> Iterator[_Fault]:
    """Find transforms on /tf with the stamp 0; lookups at any other time fail."""
    # Each run of a simulation may begin with a single stamp 0.
    yield from _counted(observation, 'zero_stamps', 'with the stamp 0', lambda track: (
        track['zero_stamps'] > 1 + track['backwards'] or not 0 < track['oldest'] < OTHER_CLOCK))


@_check('message_other_clock', 'Look at the clock that stamps the messages.', 'clock',
        needs=('headers',))
def _message_other_clock(observation: Observation) -> Iterator[_Fault]:
    """Find messages whose stamps are of another clock than those of the transforms."""
    newest = max((track['latest'] for track in observation.tracks), default=0)
    found = [(topic, is_found, int(topic.stamps[is_found][-1]) - newest, 'the newest transform')
             for topic, is_found in _found(observation, Verdict.OTHER_CLOCK)]
    off = observation.off_clock
    found += [(topic, topic.stamps != 0, off[topic.topic], 'the arrival; frames are in time')
              for topic in observation.message_times if topic.topic in off]
    for topic, is_found, offset, what in found:
        stamp = int(topic.stamps[is_found][-1])
        yield _of_messages(
            observation, [(topic, is_found)], f'have stamps {apart(offset, stamp)} {what}',
            _clock_remedy(observation, stamp))


@_check('message_too_old', 'Send the messages sooner, or give the listener a longer cache_time.',
        'old_messages', needs=('headers', 'messages'))
def _message_too_old(observation: Observation) -> Iterator[_Fault]:
    """Find messages that arrive when a cache of 10 s has dropped their transforms."""
    for topic, found in _found(observation, Verdict.TOO_OLD):
        cache, stream = int(topic.waits[found].max()), topic.stream
        # The transforms are ahead, or of another clock: see future, and other_clock.
        if (stream.delays and -FUTURE <= stream.greatest_delay < cache / 2) or (
                cache > LONGEST_CACHE and any(track['foreign'] for track in observation.tracks)):
            continue
        yield _of_messages(
            observation, [(topic, found)], 'are too old: when they arrive, their transforms are '
            f'up to {_known(-cache)} older than the newest ones',
            f'Send the messages sooner, or give the listener {longer_cache(cache, False)}.'
            if cache <= LONGEST_CACHE and not stream.stalled else None)


@_check('message_never', 'Look at the node that publishes the frame: has it stopped, is its clock '
        'slow, or must --time be longer?', 'full_queue', needs=('headers', 'messages'))
def _message_never(observation: Observation) -> Iterator[_Fault]:
    """Find messages that wait in vain: the transforms never reach their stamps."""
    for child, topics in _by_edge(observation, Verdict.NEVER):
        end = observation.stream(child).edge.end
        late = max(int(topic.stamps.max()) for topic, _ in topics) - end
        node = _ended_node(observation, observation.newest[child])
        yield _of_messages(
            observation, topics, f'wait in vain for the edge {_edge_text(observation, child)}, '
            f'whose data end at {exact_time(end)}', _start_again(node) or (
                'Correct the clock that stamps the messages.'
                if 0 < late < 2 * _lead(topics) else ''), child)._replace(time=end)


#: Topics, and which of their messages were found.
_Messages = list[tuple[MessageTimes, NDArray[np.bool_]]]


def _found(observation: Observation, verdict: Verdict
           ) -> Iterator[tuple[MessageTimes, NDArray[np.bool_]]]:
    """Yield the topics with many messages of a verdict, those that wait long; and which."""
    for topic in observation.message_times:
        if topic.topic in observation.off_clock:
            continue  # see message_other_clock
        found = topic.verdicts == verdict
        if verdict == Verdict.WAITS:
            found &= (topic.waits >= LONG_WAIT) & ~_await_gaps(observation, topic)
        if found.any() and found.sum() >= SHARE * topic.number_of(verdict):
            yield topic, found


def _await_gaps(observation: Observation, topic: MessageTimes) -> NDArray[np.bool_]:
    """Return which messages wait for the end of a gap, which is reported."""
    found = np.zeros(len(topic.stamps), np.bool_)
    for track, gaps, _ in observation.gaps:
        edges = [i for i, child in enumerate(topic.children) if child == track.child]
        before = np.maximum.accumulate(track.stream.stamps).searchsorted(topic.stamps) - 1
        found |= np.isin(topic.edge_numbers, edges) & np.isin(before, gaps)
    return found


def _by_edge(observation: Observation, verdict: Verdict) -> Iterable[tuple[str, _Messages]]:
    """Group what `_found` yields by the child of the edge for which most messages wait."""
    groups: dict[str, _Messages] = {}
    for topic, found in _found(observation, verdict):
        number = np.bincount(topic.edge_numbers[found], topic.waits[found] + 1).argmax()
        groups.setdefault(topic.children[number], []).append(
            (topic, found & (topic.edge_numbers == number)))
    return groups.items()


def _of_messages(observation: Observation, topics: _Messages, what: str,
                 remedy: Optional[str] = '', child: str = '') -> _Fault:
    """Return a fault of messages; `child`: that of the edge for which they wait."""
    names = [topic.topic for topic, _ in topics]
    count = sum(int(found.sum()) for _, found in topics)
    number = sum(topic.number_of(Verdict(int(topic.verdicts[found].min())))
                 for topic, found in topics)
    sample = ' of a sample' if any(topic.step > 1 for topic, _ in topics) else ''
    ahead = _lead(topics) if child else 0
    clock = f'; stamps are up to {in_words(ahead)} later than the arrivals' if ahead else ''
    frames = [topic.frames[i] for topic, found in topics
              for i in np.unique(topic.frame_numbers[found]).tolist()]
    nodes = [*chain(*(observation.senders.get(name, ()) for name in names)),
             *map(observation.node_of, observation.by_child.get(child, ()))]
    return _Fault(f'{count} of {number} messages{sample} on {listed(names)} {what}{clock}', (),
                  frames, names, nodes, remedy)


def _lead(topics: _Messages) -> int:
    """Return by how much stamps of messages are later than their arrivals (ns); 0: not."""
    ahead = max(-topic.stream.least_delay for topic, _ in topics)
    return ahead if ahead > FUTURE else 0


def _edge_text(observation: Observation, child: str) -> str:
    node = observation.node_of(observation.newest[child])
    return (f'{shortened(observation.parents[child])} -> {shortened(child)}'
            f'{f" of {node}" if node else ""}')


@_check('half_namespace', 'Remap both /tf and /tf_static in all nodes of the robot, or in none of '
        'them.', 'half_namespace', explains=(*RULES['half_namespace'].explains, 'unknown_frame'))
def _half_namespace(observation: Observation) -> Iterator[_Fault]:
    """Find transforms in another namespace that continue the tree."""
    there = {name for each in observation.other_transforms
             for names in each.parents.items() for name in names}
    for fault in _found_by('half_namespace', observation):
        yield fault._replace(scope=there | observation.tree_of.keys())


@_check('two_joint_publishers', 'Stop one of the two nodes, or remap its topic.', 'two_nodes',
        explains=(*_OF_STAMPS, 'other_clock'))
def _two_joint_publishers(observation: Observation) -> Iterator[_Fault]:
    """Find nodes that send the position of the same joint, which jumps."""
    for topic, senders in observation.joint_senders.items():
        if not observation.is_own(topic):
            continue
        readers = observation.joint_readers.get(topic, ())
        frames = [track.child for track in observation.tracks
                  if not track.is_static and observation.node_of(track) in readers]
        groups: dict[tuple[Sender, ...], list[str]] = {}
        for name in sorted({*chain(*(sender.names for sender in senders))}):
            if found := rivals([sender for sender in senders if name in sender.names]):
                groups.setdefault((*found,), []).append(name)
        for group, joints in groups.items():
            yield _Fault(f'{_counts(group)} send {listed(joints)} on {topic}', (), frames,
                         [topic], [sender.node for sender in group])


def _counts(senders: Sequence[Sender]) -> str:
    return comma_list([f'{shortened(each.node)} ({each.count} messages)' for each in senders])


@_check(*_same('two_clocks'), explains=(
    *_OF_STAMPS, 'other_clock', 'one_shot', 'slow_clock', 'message_other_clock', *_WAITING))
def _two_clocks(observation: Observation) -> Iterator[_Fault]:
    """Find two nodes that publish /clock, so that the time jumps back and forth."""
    if senders := rivals(observation.clocks):
        times = ' and '.join(f'{exact_time(sender.stamp)} s' for sender in senders)
        yield _Fault(
            f'{_counts(senders)} publish /clock, with the last times {times}', (), (), ['/clock'],
            [sender.node for sender in senders], scope=_ALL)


@_check('clock_stands', 'Let the simulation or the bag go on.', 'clock', severity=WARNING,
        explains=(*_OF_STAMPS, 'frozen_stamp', 'zero_stamp', 'one_shot', *_WAITING))
def _clock_stands(observation: Observation) -> Iterator[_Fault]:
    """Find that the time on /clock stands, so that nodes send no new stamps."""
    if observation.clock_stands:
        nodes = observation.around.clock_nodes
        yield _Fault(f'the time on /clock of {listed(nodes)} has stood for '
                     f'{observation.clock_stands:.1f} s', (), (), ['/clock'], nodes, scope=_ALL)


@_check('use_sim_time_differs', SIM_TIME, 'clock', severity=WARNING,
        explains=('other_clock', 'message_other_clock'))
def _use_sim_time_differs(observation: Observation) -> Iterator[_Fault]:
    """Find nodes on different clocks: use_sim_time is true in some only."""
    answers, stamps = observation.use_sim_time, _last_stamps(observation)
    clocks, using = {sender.node for sender in observation.clocks}, {*filter(answers.get, answers)}
    needy = {*stamps, *observation.tf_listeners}
    # What publishes /clock needs no use_sim_time.
    others = [node for node in answers if node in needy - using - clocks]
    # A simulation beside a robot may use its own clock.
    if not others or not clocks or using <= clocks - needy:
        return
    foreign = [node for node in others for stamp in stamps.get(node, ())
               if abs(stamp - observation.clocks[0].stamp) > OTHER_CLOCK]
    yield _Fault(
        f'use_sim_time is false in {listed(others)}, and true in {listed(sorted(using))}, while '
        f'{listed(sorted(clocks))} {"publish" if len(clocks) > 1 else "publishes"} /clock', (), (),
        (), others, severity=ERROR if foreign else
        INFO if {*others}.isdisjoint(observation.tf_listeners) else '',
        # Those with the simulated clock are found if this node does not use it.
        scope=[*foreign, *using] if foreign else others)


def _last_stamps(observation: Observation) -> dict[str, list[int]]:
    stamps: dict[str, list[int]] = {}
    for track in observation.tracks:
        if track['stamp'] and not (track.is_static or track.stream.is_frozen):
            stamps.setdefault(observation.node_of(track), []).append(track['stamp'])
    for topic, headers in observation.headers.items():
        for node in observation.senders.get(topic, ()):
            stamps.setdefault(node, []).extend(filter(None, headers.stamps[-1:]))
    return stamps


# Warnings


@_check('gap', 'Look at the node that publishes the frame: has it stopped, is it busy, does it '
        'lose input, or does it publish only when something happens?', 'gap', severity=WARNING)
def _gap(observation: Observation) -> Iterator[_Fault]:
    """Find gaps between stamps (more than 3 periods), and frames that have ended."""
    gaps = {track: found for track, found, is_busy in observation.gaps if not is_busy}
    for tracks in observation.by_publisher(gaps.__contains__):
        holes = {track: track.stream.longest(gaps[track]) for track in tracks}
        while holes:  # each hole is named, with all frames that have it
            worst = max(holes, key=lambda track: holes[track].length)
            hole = holes[worst]
            group = [track for track, each in holes.items()
                     if -each.length < each.begin - hole.begin < hole.length]
            for track in group:
                del holes[track]
            yield _Fault(
                f'{_hole_text(worst, hole)}; {len(gaps[worst])} of {worst.stream.steps} steps '
                f'from stamp to stamp are longer than {GAP} periods of '
                f'{worst.stream.period / SECOND:.2g} s', group, time=hole.begin)
    ended = observation.ended
    for tracks in observation.by_publisher(ended.__contains__):
        silence = observation.until - min(track['last_time'] for track in tracks)
        node, name = _ended_node(observation, tracks[0]), observation.node_of(tracks[0])
        own = [each for each in observation.newest.values() if observation.node_of(each) == name]
        # A node may send the frames of what it sees, which comes and goes.
        goes_on = name and tracks[0].publisher in (observation.present or ()) and (
            min(each['last_time'] for each in own) < max(each['first_time'] for each in own))
        yield _Fault(f'nothing was received of {listed(map(_child_of, tracks))} in the '
                     f'last {in_words(silence)}, and {SECOND / tracks[0]["period"]:.1f} Hz before'
                     f'{f"; {node} has ended" if node else ""}', tracks,
                     remedy=_start_again(node), severity=INFO if goes_on else '',
                     time=min(track['latest'] for track in tracks))


def _hole_text(track: Track, step: Step) -> str:
    return (f'no transform of {shortened(track.child)} for {in_words(step.length)} after '
            f'{exact_time(step.begin)}')


@_check('listener_busy', 'If nobody has paused it, look at the load and at the network of the '
        'computer that listens.', 'gap', severity=INFO, explains=('gap',))
def _listener_busy(observation: Observation) -> Iterator[_Fault]:
    """Find that this program ran late, or that all nodes were silent at the same time."""
    paused = {track: track.stream.longest(gaps)
              for track, gaps, is_busy in observation.gaps if is_busy}
    late = [track for track in observation.tracks if observation.has_late(track, is_busy=True)]
    if paused or late:
        worst = max(paused, key=paused.__getitem__, default=None)
        silence = max((end - begin for begin, end in observation.silences), default=0)
        lateness = max((length for _, length in observation.late), default=0)
        text = _hole_text(worst, paused[worst]) if worst else _off_text(
            late, 'late', 'greatest_delay')
        yield _Fault(f'{text}: ' + (
            f'nothing has arrived on any topic for {in_words(silence)}' if silence else
            f'this program was up to {in_words(lateness)} late'),
            frames=map(_child_of, [*paused, *late]), topics=observation.topics[:1],
            time=paused[worst].begin if worst else 0, scope=())
    ended, often = observation.ended, [
        track for track in observation.tracks if track.stream.steps >= FEWEST]
    times, nodes = [track['last_time'] for track in often], {*map(observation.node_of, ended)}
    if {*often} == ended and len(nodes) > 1 and np.ptp(times) < SECOND and {
            track.publisher for track in often} <= {*(observation.present or ())}:
        yield _Fault(f'nothing has arrived from any of {len(nodes)} nodes in the last '
                     f'{in_words(observation.until - max(times))}', often, severity=WARNING)


def _ended_node(observation: Observation, track: Track) -> str:
    """Return the node of a track if it does not publish any more; '': it does, or may."""
    node = observation.node_of(track)
    if observation.present is None or track.publisher in observation.present or node in {
            *(observation.nodes.get(each, '') for each in observation.present),
            *(each.node for each in observation.around.publishers)}:
        return ''
    return shortened(node)


def _start_again(node: str) -> str:
    return RULES['gap'].remedy.format(node=node) if node else ''


@_check('message_early', 'Wait for the transforms, or make the publisher send them sooner, or '
        'more often.', 'future', severity=WARNING, needs=('headers', 'messages'))
def _message_early(observation: Observation) -> Iterator[_Fault]:
    """Find messages that arrive 0.1 s or more before the transforms of their stamps."""
    for child, topics in _by_edge(observation, Verdict.WAITS):
        first = min(int(topic.stamps[found].min()) for topic, found in topics)
        largest = max(int(topic.waits[found].max()) for topic, found in topics) / SECOND
        size = max(topic.queue() for topic, _ in topics)
        instead = ('correct the clock that stamps the messages' if _lead(topics) else
                   'make the publisher send the transforms sooner, or more often')
        yield _of_messages(
            observation, topics, f'wait {LONG_WAIT / SECOND} s or more for the edge '
            f'{_edge_text(observation, child)}, up to {_known(largest * SECOND)}, the first at '
            f'{exact_time(first)}', None if largest > _LONGEST_TIMEOUT else
            f'Wait: timeout=Duration(seconds={ceil(largest * 10) / 10:g}) in the lookup; queue of '
            f'a filter: MessageFilter(..., queue_size={size}, ...). Or {instead}.',
            child)._replace(time=first)


@_check('message_zero_stamp', 'Set the stamp to the time of the measurement; with use_sim_time, '
        'wait until /clock is received.', 'clock', severity=WARNING, needs=('headers',))
def _message_zero_stamp(observation: Observation) -> Iterator[_Fault]:
    """Find messages with the stamp 0; lookups for them take the latest transform."""
    for topic, found in _found(observation, Verdict.ZERO_STAMP):
        fault = _of_messages(observation, [(topic, found)], 'have the stamp 0')
        yield fault if topic.children else fault._replace(
            severity=INFO, remedy='This is right if the latest transform is meant.')


@_check('jump', 'If two nodes publish the frame, stop one of them; otherwise, look at the node '
        'that computes its pose.', 'jump', severity=WARNING)
def _jump(observation: Observation) -> Iterator[_Fault]:
    """Find frames that move ten times as fast from one pose to the next as they do otherwise."""
    for track in observation.tracks:
        if track.stream.steps >= FEWEST and not track.stream.alternates and (
                track['jump'] >= SMALLEST_JUMP
                and track['largest_speed'] > JUMP * track['usual_speed']
                and track['jump_at'] not in track.stream.stamps[track.stream.gaps + 1]):
            is_corrected = _is_localisation(track) and track['jumps'] <= SHARE * track['count']
            yield _Fault(
                f'{track["jumps"]} of {track["count"]} transforms of {shortened(track.child)} '
                f'jump, as by {track["jump"]:.3g} (m plus rad) at {exact_time(track["jump_at"])}; '
                f'otherwise, it moves by at most {track["usual_speed"]:.3g} per second', [track],
                severity=INFO if is_corrected else '', time=track['jump_at'])


def _is_localisation(track: Track) -> bool:
    """Return whether the transforms are those of odom in map (REP 105), which may jump."""
    return track.child.rpartition('/')[2] == 'odom' and all(
        parent.rpartition('/')[2] == 'map' for parent in track.parents)


@_check(*_same('one_shot'), severity=WARNING, explains=('message_never',))
def _one_shot(observation: Observation) -> Iterator[_Fault]:
    """Find frames that were sent once on /tf, so that they are in the past of all others."""
    end = observation.until
    once = {track for tracks in observation.by_child.values()
            if len(tracks) == 1 and not (track := tracks[0]).is_static and track['count'] == 1
            and track['last_time'] and end - track['last_time'] > _ONCE}
    for tracks in observation.by_publisher(once.__contains__):
        yield _Fault(f'one transform of {listed(map(_child_of, tracks))} in '
                     f'{in_words(end - tracks[0]["last_time"])}', tracks)


@_check('late', 'Look at the node and the network: one of them is too slow, or two clocks differ.',
        'future', severity=WARNING, needs=('arrivals',))
def _late(observation: Observation) -> Iterator[_Fault]:
    """Find transforms that arrive more than 0.5 s after their stamp."""
    for tracks in observation.by_publisher(observation.has_late):
        yield _off_by_many(
            observation, tracks, 'late', 'greatest_delay', _play(observation, tracks))


@_check('future', 'Compare the clocks of the computers.', 'clock', severity=WARNING,
        needs=('arrivals',))
def _future(observation: Observation) -> Iterator[_Fault]:
    """Find stamps that are more than 0.1 s later than their arrival."""
    for tracks in observation.by_publisher(lambda track: track.stream.has_many('future')):
        worst, ahead = min(tracks, key=itemgetter('least_delay')), observation.ahead.get(
            tracks[0].publisher)
        is_constant = worst.stream.mean_delay < _CONSTANT * worst['least_delay']
        fault = _off_by_many(
            observation, tracks, 'future', 'least_delay', _by_dates(observation, tracks))
        if is_constant and is_in_time(observation.tracks) and (
                observation.has_record_times and _is_localisation(worst)
                and worst['least_delay'] > -_MOST_LEAD if ahead is None else abs(ahead) <= FUTURE):
            fault = fault._replace(severity=INFO, remedy=(
                'This is right if the node dates its transforms into the future on purpose, as '
                'localisation does (transform_tolerance); else compare the clocks.'))
        yield fault


def _off_by_many(observation: Observation, tracks: Sequence[Track], field: str, extreme: str,
                 remedy: str) -> _Fault:
    """Return a fault of many delays: of the clock of the arrivals, if all messages have them."""
    text = _off_text(tracks, field, extreme)
    timed = [topic.stream for topic in observation.message_times if topic.stream.delays]
    means = [stream.mean_delay for stream in (*timed, *(track.stream for track in tracks))]
    if not timed or not np.ptp(means) <= LATE or is_in_time(
            [*observation.tracks, *observation.message_times]):
        return _Fault(text, tracks, remedy=remedy)
    is_bag = observation.has_record_times
    return _Fault(
        f'{text}; it is the same for other messages', tracks, severity=INFO if is_bag else '',
        remedy=_play(observation, tracks) or 'Compare the clock of the computer '
        f'{"that has recorded" if is_bag else "of tf_doctor"} with those of the nodes.')


def _off_text(tracks: Sequence[Track], field: str, *extremes: str) -> str:
    """Say how far stamps are from the arrivals; `extremes`: the items with the delays."""
    offset, stamp = max(((-track[extreme], track['stamp']) for track in tracks
                         for extreme in extremes), key=lambda each: abs(each[0]))
    return f'{_share(tracks, field)} with stamps up to {apart(offset, stamp)} the arrival'


@_check('time_goes_back', 'Send the transforms of a frame in the order of their stamps; if a '
        'simulation or a bag was started again, end the nodes of the run before, and restart the '
        'listeners, or call clear() of their buffers.', 'old_data', severity=WARNING,
        explains=('late',))
def _time_goes_back(observation: Observation) -> Iterator[_Fault]:
    """Find stamps that are earlier than those before; listeners may refuse them."""
    groups: dict[frozenset[str], list[str]] = {}  # by the publishers: the frames
    for child, tracks in observation.by_child.items():
        stream = observation.stream(child)
        if stream.alternates and len(tracks) == 1:
            yield _Fault(f'the stamps of {quoted(child)} alternate between two clocks, '
                         f'{in_words(stream.step_back)} apart', tracks, code='two_publishers')
        elif not stream.alternates and (observation.refused[child] or total(tracks, 'backwards')):
            groups.setdefault(frozenset(track.publisher for track in tracks), []).append(child)
    for children in groups.values():
        streams = [*map(observation.stream, children)]
        worst = max(streams, key=attrgetter('step_back'))
        refused = sum(observation.refused[child] for child in children)
        back, count = (sum(each) for each in zip(*(
            (stream.backwards, len(stream.stamps)) for stream in streams)))
        is_large = worst.step_back > SHORTEST_GAP  # a clock that is adjusted may go back a little
        consequence = (f'; a buffer with the default cache of {CACHE_TIME // SECOND} s refuses '
                       f'{refused} transforms' if refused else '')
        yield _Fault(f'{back} of {count} transforms of {listed(children)} with an earlier stamp '
                     f'than the one before; the largest step back is {in_words(worst.step_back)}, '
                     f'from {exact_time(worst.step_back_at)}{consequence}',
                     [track for child in children for track in observation.by_child[child]],
                     severity='' if is_large else INFO, time=worst.step_back_at,
                     # A network that mixes them up makes them late.
                     scope=None if is_large and back <= SHARE * count else ())


@_check('same_stamp', 'Give each transform its own time.', 'repeated_data', severity=WARNING)
def _same_stamp(observation: Observation) -> Iterator[_Fault]:
    """Find different poses of a frame with the same stamp."""
    yield from _counted(observation, 'changes', 'with the stamp of the one before, and another '
                        'pose', lambda track: not track.is_static)


@_check('leading_slash', 'Leave out the slash.', 'namespace', severity=WARNING)
def _leading_slash(observation: Observation) -> Iterator[_Fault]:
    """Find frames whose names begin with a slash; tf2 refuses lookups of them."""
    for tracks in observation.by_publisher(attrgetter('slashed')):
        names = sorted({name for track in tracks for name in track.slashed})
        yield _Fault(f'names in transforms begin with a slash: {listed(names)}', tracks, names)
    for frame, topics in observation.topics_of.items():
        if frame.startswith('/'):
            yield _Fault(f'the headers on {listed(topics)} name {quoted(frame)}',
                         frames=[frame], topics=topics)


@_check(*_same('empty_name'), severity=WARNING)
def _empty_name(observation: Observation) -> Iterator[_Fault]:
    """Find frames without a name, whose transforms listeners refuse."""
    for (publisher, is_static), names in observation.statistics.empty_names.items():
        others = sorted(filter(None, names))
        count = sum(names.values())
        yield _Fault(f'{count} transform{"s" if count > 1 else ""} with an empty frame_id or '
                     'child_frame_id', (), others, [observation.topics[is_static]],
                     [observation.nodes.get(publisher, '')])


@_check('link_without_transform', 'Start robot_state_publisher with this description; if it runs, '
        'compare its frame_prefix with the names of the frames.', 'other', severity=WARNING,
        needs=('messages',))
def _link_without_transform(observation: Observation) -> Iterator[_Fault]:
    """Find links of robot descriptions that no transform leads to."""
    for robot, start in observation.own_robots:
        silent = {link for joint, links in robot.joints.items() for link in links
                  if robot.states.get(joint) != ''}  # see joint_without_state
        # Only the root can be known by its children alone.
        known = observation.parents.keys() | ({start + robot.root} & observation.tree_of.keys())
        missing = [link for link in robot.links
                   if link not in silent and start + link not in known]
        frames = [start + link for link in missing]
        if frames:
            yield _Fault(
                f'{len(frames)} of {len(robot.links)} links have no transform: {listed(frames)}',
                (), frames, [robot.topic], remedy='Publish it: robot_state_publisher does not '
                'send floating joints.' if {*missing} <= {*robot.floating} else '')


# Infos


@_check('slow_clock', 'Raise the rate of /clock.', 'clock', severity=INFO)
def _slow_clock(observation: Observation) -> Iterator[_Fault]:
    """Find that the time on /clock comes rarely, so that it is behind the stamps."""
    for sender in observation.clocks:
        period = (sender.last - sender.first) / max(1, sender.count - 1)
        if sender.count > 2 and period > _SLOW_CLOCK:
            yield _Fault(f'{sender.node} publishes /clock at {SECOND / period:.1f} Hz: stamps are '
                         f'up to {in_words(period)} ahead of it', (), (), ['/clock'],
                         [sender.node])


@_check('several_trees', 'If the trees belong to one robot, publish a transform between them.',
        'two_trees', severity=INFO, needs=('messages',))
def _several_trees(observation: Observation) -> Iterator[_Fault]:
    """Find several trees; lookups from one to another fail."""
    if len(observation.trees) > 1 and observation.seconds >= _SETTLED:
        roots = [next((name for name in tree if name not in observation.parents), tree[0])
                 for tree in observation.trees]
        yield _Fault(f'{len(roots)} trees, with the roots {listed(roots)}', frames=roots)


@_check('static_changes', 'Publish a transform that changes on /tf.', 'other', severity=INFO)
def _static_changes(observation: Observation) -> Iterator[_Fault]:
    """Find transforms on /tf_static that change; listeners know only the newest one."""
    yield from _counted(observation, 'changes', 'with another pose than the one before',
                        attrgetter('is_static'))
