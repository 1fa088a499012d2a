"""
The requirements of the lab's final task, and the check whether the transforms of an arm meet them.

The check needs no ROS: its input is a list of received or recorded messages. A requirement is
judged by a pure function of the transforms, and of the results of the requirements that it needs.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import degrees, log, pi, radians
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from dummy_arm.grading import causes
from dummy_arm.grading.causes import DIFFERENT, Fault, in_degrees, is_near, metres, SPEED_FACTOR
from dummy_arm.grading.records import Line, Report, Verdict
from dummy_arm.grading.samples import Arm, largest_angle
from dummy_arm.grading.sheet import BASE, FRAMES, HAND, JOINTS, SHEET, SheetFrame, Vector
from dummy_arm.grading.sine import FEWEST, fit_sine, Floats, Sine
from puretf import SECOND
from puretf._text.names import comma_list, shortened
from puretf.bag import NOT_RECORDED

#: How far a frame may be rotated about an axis about which it must not rotate (rad).
_ROTATION_TOLERANCE = radians(0.1)
#: How far an angle may exceed its limit (rad): the rounding of a program's own constants.
_LIMIT_TOLERANCE = radians(0.05)
#: A joint that turns by less than this angle (rad) does not move.
_SMALLEST_MOTION = radians(3.0)
#: The part of a period that must be observed; it leaves 8 of 25 s to the pauses of a busy machine.
_SHORTEST_WAVE = 0.8
#: A sine of the number of the message, and not of the time, fits the numbers so much better, and
#: fits the stamps worse than this: timers are not exact.
_BETTER, _EXACT = 0.1, 1e-6
#: A joint of which less than this part of a period is observed in a long time is too slow.
_SLOW = 0.3
#: If they deviate by less, the largest speeds are meant to be those of the sheet.
_MEANT = 0.1
#: Good practice: the lowest rate (Hz), the part of a limit that is used, the part of the ticks in
#: which all frames have the same stamp, and how often base_link is sent: the broadcaster sends it
#: again with each other static frame.
_LOWEST_RATE, _USED, _SAME_STAMP, _MOST_STATIC = 9.5, 0.49, 0.9, 5


def _not_judged(why: str, measured: str = '', value: Any = None) -> Line:
    return Line(measured, why, value=value, verdict=Verdict.NOT_JUDGED)


class Requirement(NamedTuple):
    """A requirement of the sheet, or a good practice."""

    text: str
    needs: tuple[str, ...]  #: the texts of other requirements
    judge: Callable[[Arm, SheetFrame, Mapping[str, Line]], Line]
    edge: SheetFrame = SheetFrame('', '', (0.0, 0.0, 0.0))  #: the one that is judged; else the arm


def check(arm: Arm) -> Report:
    """Check whether the transforms of an arm meet the requirements."""
    lines: dict[str, Line] = {}
    for each in (*REQUIREMENTS, *PRACTICES):
        needed = {text: lines[text] for text in each.needs}
        why = _why_not(each.edge.name, needed)
        line = _not_judged(why) if why else each.judge(arm, each.edge, needed)
        verdict = line.verdict or (Verdict.NOT_OK if line.text else Verdict.OK)
        if each in PRACTICES:
            verdict = (Verdict.NOT_JUDGED if not line.measured else
                       Verdict.ADVICE if line.text else Verdict.OK)
        follows = verdict == Verdict.NOT_JUDGED and bool(why or (not each.edge.name and any(
            other.verdict == Verdict.NOT_OK or other.follows for other in needed.values())))
        lines[each.text] = line._replace(requirement=each.text, verdict=verdict, follows=follows)
    found = [lines[each.text] for each in REQUIREMENTS]
    passed = all(line.verdict == Verdict.OK for line in found
                 if arm.reaches_late_joiners is not None or line.requirement != _LATE)
    return Report(found, [lines[each.text] for each in PRACTICES], passed)


def _why_not(name: str, needed: Mapping[str, Line]) -> str:
    """Return why nothing that needs some results can be judged for a frame; '' if it can be."""
    return next((f'It is not judged, since this is not met: {text}.'
                 for text, result in needed.items() if name in result.broken), '')


def _first(faults: Mapping[str, Fault], otherwise: str) -> Line:
    """Return the first fault as a result; what needs this is not judged for any of the frames."""
    return next((Line(*fault, [*faults]) for fault in faults.values()), Line(otherwise))


# Transforms and tree


def _validity(arm: Arm, *_: Any) -> Line:
    """Judge the numbers: tf2 ignores transforms with NaN, and with a quaternion of norm 0."""
    if not arm.samples:
        return Line('no transform', causes.recreation(arm) or (
            f'Nothing was received on /tf and /tf_static. {causes.of_nothing(arm)}'),
                    ['', *FRAMES])
    faults = {name: fault for name in FRAMES[1:] if name in arm.samples if (
        fault := causes.fault_of_numbers(name, arm.samples[name].poses))}
    return _first(faults, f'{sum(len(each.poses) for each in arm.samples.values())} transforms')


def _tree(arm: Arm, *_: Any) -> Line:
    faults = {edge.name: fault for edge in SHEET if (fault := causes.fault_of_edge(arm, edge))}
    if 'map' in arm.samples and not faults:
        parents = comma_list([*arm.samples['map'].parents], shortened)
        return Line(f'{parents} → map',
                      'map is the root of the tree: it must not have a parent.')
    return _first(faults, f'{len(FRAMES)} frames in a chain')


def _stamps(arm: Arm, *_: Any) -> Line:
    known = {name: samples for name, samples in arm.moving.items() if samples.times.all()}
    if not known:
        return _not_judged('The bag has no times.' if arm.moving else
                           'No transform of the arm is on /tf.')
    faults = {name: fault for name, samples in known.items()
              if (fault := causes.fault_of_stamps(arm, name, samples))}
    largest = max(abs(float(np.median(samples.delays))) for samples in known.values())
    return _first(faults, f'{largest * 1e3:.1f} ms from the time of arrival')


# base_link and end_effector


def _base_on_tf_static(arm: Arm, *_: Any) -> Line:
    is_static = arm.samples[BASE.name].is_static
    if is_static.all():
        return Line('/tf_static')
    if is_static.any():
        return Line('on both', 'map → base_link is sent on /tf, too: do not send it in the timer.',
                    [BASE.name])
    return Line('/tf', 'map → base_link is sent on /tf: use StaticTransformBroadcaster, which '
                'sends on /tf_static.', [BASE.name])


def _base_at_origin(arm: Arm, *_: Any) -> Line:
    samples = arm.samples[BASE.name]
    position = _farthest(samples.positions, BASE.position)
    measured = metres(position)
    if (angle := largest_angle(samples.rotations[:, :3])) > _ROTATION_TOLERANCE:
        return Line(f'{measured}, rotated by {in_degrees(angle)}', (
            causes.WRONG_ORDER if samples.has_wrong_order else
            'base_link must not be rotated in map: the quaternion is (0, 0, 0, 1).'))
    return Line(measured, '' if is_near(position, BASE.position) else
                  'The translation of base_link in map must be (0, 0, 0).')


def _late_joiner(arm: Arm, *_: Any) -> Line:
    if arm.reaches_late_joiners is None:
        return _not_judged('This was not observed.')
    return Line('received') if arm.reaches_late_joiners else Line(
        'not received', 'A listener that starts now does not receive base_link: keep the node and '
        'its StaticTransformBroadcaster as long as the program runs.')


def _hand(arm: Arm, *_: Any) -> Line:
    if HAND.name in arm.moving and (silence := causes.of_silence(arm, HAND.name)):
        return Line('', silence)
    rotations = arm.samples[HAND.name].rotations
    # The angle between two rotations is 2 acos(|q1 · q2|); the absolute value, because q and
    # -q are the same rotation.
    angle = 2 * float(np.arccos(min(1.0, abs(rotations @ rotations[0]).min())))
    if abs(rotations[:, 3]).max() < _ROTATION_TOLERANCE:
        return Line('rotated by 180.0°', causes.WRONG_ORDER)
    if angle < _ROTATION_TOLERANCE:
        return Line('fixed')
    return Line(f'turns by {in_degrees(angle)}',
                  'end_effector must not rotate in joint_3: always send (0, 0, 0, 1).')


# Positions and joints


def _position(arm: Arm, edge: SheetFrame, _: Any) -> Line:
    positions = arm.samples[edge.name].positions
    position = _farthest(positions, edge.position)
    return Line(metres(position), '' if is_near(position, edge.position) else
                  causes.of_position(edge, positions, position))


def _axis(arm: Arm, joint: SheetFrame, _: Any) -> Line:
    samples = arm.samples[joint.name]
    x, y, z = abs(samples.rotations[:, :3]).max(axis=0)
    if largest_angle(samples.rotations[:, :2]) <= _ROTATION_TOLERANCE:
        return Line('about z' if z > 1e-6 else 'no rotation')
    # The vector part of the quaternion is sin(angle / 2) times the axis.
    axes = ' and '.join(axis for axis, part in zip('xyz', (x, y, z))
                        if part > _ROTATION_TOLERANCE / 4)
    return Line(f'about {axes}', causes.WRONG_ORDER if samples.has_wrong_order else (
        f'{joint.name} turns about {axes}: in (x, y, z, w), z is sin(angle / 2), and in '
        'quaternion_from_euler(roll, pitch, yaw), yaw is the angle about z.'), [joint.name])


def _motion(arm: Arm, joint: SheetFrame, _: Any) -> Line:
    samples = arm.samples[joint.name]
    if samples.is_static.all():
        return Line('on /tf_static', causes.static_joints(arm), [joint.name])
    if silence := causes.of_silence(arm, joint.name):
        return Line('', silence, [joint.name])
    span = float(np.ptp(samples.angles))
    measured = f'by {in_degrees(span)}'
    return Line(measured) if span >= _SMALLEST_MOTION else Line(measured, (
        f'{joint.name} stands at its limit: write limit * sin(speed * t), which goes back.'
        if abs(samples.largest_angle - joint.limit) < _LIMIT_TOLERANCE else
        f'{joint.name} hardly moves: {causes.UNIT_OF_TIME} Or is a limit or a speed converted '
        'from degrees to radians twice?' if span > 0.0 else
        f'The angle of {joint.name} does not change: compute it in the callback of the timer, '
        'from the current time.'), [joint.name])


def _limit(arm: Arm, joint: SheetFrame, _: Any) -> Line:
    angles = arm.samples[joint.name].angles
    largest = arm.samples[joint.name].largest_angle
    measured = f'{in_degrees(float(angles.min()))} to {in_degrees(float(angles.max()))}'
    if largest <= joint.limit + _LIMIT_TOLERANCE:
        return Line(measured)
    if largest > radians(170) or np.ptp(np.unwrap(angles)) > 2 * pi:
        return Line(
            measured, 'The joint turns all the way round: the angle is in degrees where radians '
            'are needed, or it has no sine. Write radians(limit) * sin(speed * t).', [joint.name])
    if cause := causes.of_sum(arm, joint):
        return Line(measured, cause, [joint.name])
    return Line(measured, causes.of_excess(arm, joint))


def _sine(arm: Arm, joint: SheetFrame, _: Any) -> Line:
    samples = arm.samples[joint.name]
    usable = (samples.times == 0) | (abs(samples.delays) < causes.LARGEST_DELAY)
    stamps = samples.stamps[usable]
    if len(stamps) < FEWEST or np.ptp(stamps) < SECOND:
        return _not_judged(causes.recreation(arm) or (
            f'{len(stamps)} transforms are too few to see a wave.' if samples.interval < 1.0
            else causes.of_interval(joint.name, samples.interval)))
    order = np.argsort(stamps, kind='stable')
    times = (stamps[order] - stamps.min()) / SECOND
    angles = np.unwrap(samples.angles[usable][order])
    sine = fit_sine(times, angles)
    ticks = samples.ticks
    if sine.residual > _EXACT and ticks[-1] >= 1.0:
        fixed = fit_sine(ticks, np.unwrap(samples.angles))
        if fixed.residual < sine.residual * (_BETTER if sine.is_exact else 1.0):
            times, angles = ticks, np.unwrap(samples.angles)
            sine = fixed._replace(has_fixed_step=True)
    found = sine if sine.is_exact else None
    if (not found or sine.periods < _SHORTEST_WAVE) and (cause := causes.of_sum(arm, joint)):
        return Line(f'from {in_degrees(angles.min())} to {in_degrees(angles.max())}', cause)
    if sine.periods < _SHORTEST_WAVE:
        return _not_judged(causes.of_short_time(joint, sine), f'{sine.periods:.2f} periods', found)
    return Line(f'differs by {100 * sine.residual:.1f} % of the amplitude',
                  '' if found else causes.of_wave(joint, times, angles, sine), value=found)


def _speeds(_: Arm, __: SheetFrame, needed: Mapping[str, Line]) -> Line:
    sines: list[Sine] = [result.value for result in needed.values()]
    for joint, sine in zip(JOINTS, sines):
        if sine and sine.periods < _SLOW and sine.span >= causes.LONG_ENOUGH:
            return Line(f'{joint.name}: less than {sine.speed:.2g} rad/s', (
                f'{joint.name} is much too slow: {causes.UNIT_OF_TIME} Or is the speed converted? '
                f'About {joint.speed} rad/s is in radians already: do not convert it.'))
        if not sine or sine.periods < _SHORTEST_WAVE:
            return _not_judged(f'The speed of {joint.name} cannot be measured.')
    # The speed on the sheet can be that of the phase, or the largest one that a joint reaches.
    speeds, largest = [sine.speed for sine in sines], [sine.fastest for sine in sines]
    measured = f'{_in_words(speeds)} rad/s (phase)'
    if _are_in_order(largest) and _deviation(largest) < _deviation(speeds):
        return Line(f'{_in_words(largest)} rad/s (largest speed), {measured}',
                    value=largest if _deviation(largest) < _MEANT else speeds)
    return (Line(measured, value=speeds) if _are_in_order(speeds) else
            Line(measured, causes.of_speeds(speeds)))


def _in_words(speeds: Sequence[float]) -> str:
    return ', '.join(f'{speed:.2f}' for speed in speeds)


def _are_in_order(speeds: Sequence[float]) -> bool:
    """Return whether each speed is higher than the one before, and not nearly the same."""
    return all(speed * DIFFERENT <= following for speed, following in pairwise(speeds))


def _deviation(speeds: Sequence[float]) -> float:
    """Return how far the speeds of the joints are from the sheet, on a logarithmic scale."""
    # A common factor, as from a wrong unit of time, counts once: it does not change which reading
    # of the sheet fits.
    logarithms = [log(speed / joint.speed) for speed, joint in zip(speeds, JOINTS)]
    common = sorted(logarithms)[1]
    return abs(common) + sum(abs(each - common) for each in logarithms)


def _farthest(positions: Floats, expected: Vector) -> Vector:
    x, y, z = positions[np.linalg.norm(positions - expected, axis=1).argmax()].tolist()
    return x, y, z


_VALID, _TREE, _NOW = 'all transforms are valid', 'the tree', 'the stamps are the current time'
_STATIC, _LATE = 'base_link is on /tf_static', 'base_link reaches a late listener'
_SPEEDS = 'the joints have three different speeds'
_IN_TREE = _VALID, _TREE
#: By joint: the texts of what each needs, in this order.
_AXIS, _MOVES, _STAYS, _WAVES = (
    {joint: f'{joint.name} {text.format(degrees(joint.limit))}' for joint in JOINTS} for text in (
        'turns about z only', 'moves', 'stays within ±{:.0f}°', 'moves as a sine'))
REQUIREMENTS = (
    Requirement(_VALID, (), _validity),
    Requirement(_TREE, (_VALID,), _tree),
    Requirement(_NOW, (), _stamps),
    Requirement(_STATIC, _IN_TREE, _base_on_tf_static, BASE),
    Requirement('base_link is fixed at the origin of map', _IN_TREE, _base_at_origin, BASE),
    Requirement(_LATE, (*_IN_TREE, _STATIC), _late_joiner, BASE),
    *(Requirement(f'{edge.name} is {edge.place} from {edge.parent}', _IN_TREE, _position, edge)
      for edge in SHEET[1:]),
    *(Requirement(text, _IN_TREE, _axis, joint) for joint, text in _AXIS.items()),
    *(Requirement(text, (*_IN_TREE, _AXIS[joint]), _motion, joint)
      for joint, text in _MOVES.items()),
    *(Requirement(text, (*_IN_TREE, _AXIS[joint], _MOVES[joint]), _limit, joint)
      for joint, text in _STAYS.items()),
    *(Requirement(text, (*_IN_TREE, _AXIS[joint], _MOVES[joint], _STAYS[joint], _NOW), _sine,
                  joint) for joint, text in _WAVES.items()),
    Requirement(_SPEEDS, tuple(_WAVES.values()), _speeds),
    Requirement('end_effector does not move in joint_3', _IN_TREE, _hand, HAND))


# Good practice


def _rate(arm: Arm, *_: Any) -> Line:
    steps = {name: np.diff(samples.times) for name, samples in arm.moving.items()}
    # The usual rate: in a bag, a part may be missing.
    rates = {name: 1.0 / step for name, each in steps.items()
             if len(each) and (step := float(np.median(each))) > 0.0}
    name, rate = min(rates.items(), key=itemgetter(1), default=('', 0.0))
    return Line(f'{rate:.1f} Hz' if rates else '', '' if rate >= _LOWEST_RATE else
                  f'{name} is sent {rate:.1f} times a second: its motion does not look smooth.')


def _clock(_: Arm, __: SheetFrame, needed: Mapping[str, Line]) -> Line:
    sines: list[Sine] = [result.value for result in needed.values() if result.value]
    if any(sine.has_fixed_step for sine in sines):
        return Line('a sine of the number of the message',
                      'Use the clock: with a fixed step, the speed depends on the rate.')
    return Line('a sine of the time' if sines else '')


def _same_stamp(arm: Arm, _: SheetFrame, needed: Mapping[str, Line]) -> Line:
    stamps = [set(samples.stamps.tolist()) for samples in arm.moving.values()]
    same = len(set.intersection(*stamps)) / max(map(len, stamps)) if stamps else 0.0
    nodes = {each.gid: (each.node, each.pid) for each in arm.publishers}
    senders = {nodes.get(gid, gid) for samples in arm.moving.values()
               for gid in samples.publishers}
    # Several nodes cannot share a stamp; a wrong stamp is a fault of its own.
    can_share = len(senders - {NOT_RECORDED}) == 1 and not needed[_NOW].broken
    return Line(f'{100 * same:.0f} % of the ticks' if len(stamps) > 1 and (
                    same >= _SAME_STAMP or can_share) else '',
                '' if same >= _SAME_STAMP else
                'Call get_clock().now() once in each tick, and use it for all frames.')


def _use_of_limits(arm: Arm, _: SheetFrame, needed: Mapping[str, Line]) -> Line:
    used = {joint.name: arm.samples[joint.name].largest_angle / joint.limit
            for joint in JOINTS if not _why_not(joint.name, needed)}
    name, part = min(used.items(), key=itemgetter(1), default=('', 0.0))
    return Line(', '.join(f'{100 * each:.0f} %' for each in used.values()),
                  '' if part >= _USED else f'{name} uses only {100 * part:.0f} % of its limit.')


def _broadcasters(arm: Arm, *_: Any) -> Line:
    is_known = {gid for _, gid in arm.frames_of} - {NOT_RECORDED, ''}
    return Line(f'{len(arm.frames_of)} publishers' if is_known else '', causes.recreation(arm))


def _base_sent_once(arm: Arm, *_: Any) -> Line:
    samples = arm.samples.get(BASE.name)
    count = int(samples.is_static.sum()) if samples else 0
    return Line(f'messages: {count}' if count else '', '' if count <= _MOST_STATIC else
                  'Send map → base_link once, in __init__: a late listener also receives it.')


def _other_frames(arm: Arm, *_: Any) -> Line:
    return Line(f'{len(arm.others)} other frames' if arm.samples else '',
                  f'Other frames: {comma_list(arm.others)}.' if arm.others else '')


def _usual_speeds(_: Arm, __: SheetFrame, needed: Mapping[str, Line]) -> Line:
    speeds: Sequence[float] = needed[_SPEEDS].value or ()
    has_fixed_step = bool(needed[_CLOCK].text)
    cause = next((causes.of_speed(joint, speed, has_fixed_step)
                  for joint, speed in zip(JOINTS, speeds)
                  if not 1 / SPEED_FACTOR <= speed / joint.speed <= SPEED_FACTOR), '')
    return Line(_in_words(speeds), cause or (
        '' if _are_in_order(speeds) else causes.of_speeds(speeds)))


def _floats(arm: Arm, *_: Any) -> Line:
    if arm.int_line:
        return Line(f'an int in line {arm.int_line}', causes.USE_FLOATS)
    if any(causes.has_ints(samples.poses) for samples in arm.samples.values()):
        return Line('an int', causes.USE_FLOATS)
    return Line('no sign of an int' if arm.samples else '')


_CLOCK = 'the motion follows the clock'
PRACTICES = (
    Requirement('at least 10 messages per second', (), _rate),
    Requirement(_CLOCK, tuple(_WAVES.values()), _clock),
    Requirement('all frames have the same stamp', (_NOW,), _same_stamp),
    Requirement('the joints use at least half of their limits', (
        *_IN_TREE, *_AXIS.values(), *_MOVES.values(), *_STAYS.values()), _use_of_limits),
    Requirement('each broadcaster is created once', (), _broadcasters),
    Requirement('base_link is sent once', (), _base_sent_once),
    Requirement('no other frames on /tf and /tf_static', (), _other_frames),
    Requirement('speeds of about 0.3, 0.5 and 0.7 rad/s', (_SPEEDS, _CLOCK), _usual_speeds),
    Requirement('all numbers are floats', (), _floats))
