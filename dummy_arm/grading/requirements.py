"""
The requirements of the lab's final task, and the check whether the transforms of an arm meet them.

The check needs no ROS: its input is a list of received or recorded messages. A requirement is
judged by a pure function of the transforms, if the requirements that it needs are met.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import degrees, log, pi, radians
from operator import itemgetter
from typing import Any, Optional

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
_LOWEST_RATE, _USED, _SAME_STAMP, _MOST_STATIC = 9.5, 0.51, 0.9, 5


def _not_judged(why: str, measured: str = '', value: Any = None) -> Line:
    return Line(measured, why, value=value, verdict=Verdict.NOT_JUDGED)


def check(arm: Arm) -> Report:
    """Check whether the transforms of an arm meet the requirements."""
    lines: list[Line] = []

    def judge(text: str, needs: Sequence[Line], judged: Callable[..., Line], *edge: SheetFrame
              ) -> Line:
        """Add the line of an edge, or of the arm, which may need that other lines are ok."""
        name = edge[0].name if edge else ''
        unmet = [each.requirement for each in needs if name in each.broken]
        line = _not_judged(f'It is not judged, since this is not met: {unmet[0]}.'
                           ) if unmet else judged(arm, *edge)
        verdict = line.verdict or (Verdict.NOT_OK if line.text else Verdict.OK)
        follows = verdict == Verdict.NOT_JUDGED and (bool(unmet) or (not edge and any(
            each.verdict == Verdict.NOT_OK or each.follows for each in needs)))
        lines.append(line._replace(requirement=text, verdict=verdict, follows=follows))
        return lines[-1]

    valid = judge('all transforms are valid', (), _validity)
    in_tree = valid, judge('the tree', (valid,), _tree)
    now = judge('the stamps are the current time', (), _stamps)
    static = judge('base_link is on /tf_static', in_tree, _base_on_tf_static, BASE)
    judge('base_link is fixed at the origin of map', in_tree, _base_at_origin, BASE)
    late = judge('base_link reaches a late listener', (*in_tree, static), _late_joiner, BASE)
    for edge in SHEET[1:]:
        judge(f'{edge.name} is {edge.place} from {edge.parent}', in_tree, _position, edge)
    needs = {joint: [*in_tree] for joint in JOINTS}
    for text, judged in (('turns about z only', _axis), ('moves', _motion),
                         ('stays within ±{:.0f}°', _limit)):
        for joint, needed in needs.items():
            needed.append(judge(
                f'{joint.name} {text.format(degrees(joint.limit))}', needed, judged, joint))
    waves = [judge(f'{joint.name} moves as a sine', [*needed, now], _sine, joint)
             for joint, needed in needs.items()]
    sines = [line.value for line in waves]
    speeds = judge('the joints have three different speeds', waves, lambda _: _speeds(sines))
    judge('end_effector does not move in joint_3', in_tree, _hand, HAND)
    passed = all(line.verdict == Verdict.OK for line in lines
                 if arm.reaches_late_joiners is not None or line is not late)

    is_fixed = any(sine.has_fixed_step for sine in sines if sine)
    practices = {
        'at least 10 messages per second': _rate(arm),
        'the motion follows the clock': _clock(sines, is_fixed),
        'all frames have the same stamp': _same_stamp(arm, has_wrong_stamps=bool(now.broken)),
        'the joints use more than half of their limit': _use_of_limits(arm, needs),
        'each broadcaster is created once': _broadcasters(arm),
        'base_link is sent once': _base_sent_once(arm),
        'no other frames on /tf and /tf_static': _other_frames(arm),
        'speeds of about 0.3, 0.5 and 0.7 rad/s': _usual_speeds(speeds.value or (), is_fixed),
        'all numbers are floats': _floats(arm)}
    return Report(lines, [line._replace(requirement=text, verdict=(
        Verdict.NOT_JUDGED if not line.measured else Verdict.ADVICE if line.text else Verdict.OK))
        for text, line in practices.items()], passed)


def _first(faults: Mapping[str, Fault], otherwise: str) -> Line:
    """Return the first fault as a result; what needs this is not judged for any of the frames."""
    return next((Line(*fault, [*faults]) for fault in faults.values()), Line(otherwise))


# Transforms and tree


def _validity(arm: Arm) -> Line:
    """Judge the numbers: tf2 ignores transforms with NaN, and with a quaternion of norm 0."""
    if not arm.samples:
        return Line('no transform', causes.recreation(arm) or (
            f'Nothing was received on /tf and /tf_static. {causes.of_nothing(arm)}'),
                    ['', *FRAMES])
    faults = {name: fault for name in FRAMES[1:] if name in arm.samples if (
        fault := causes.fault_of_numbers(name, arm.samples[name].poses))}
    return _first(faults, f'{sum(len(each.poses) for each in arm.samples.values())} transforms')


def _tree(arm: Arm) -> Line:
    faults = {edge.name: fault for edge in SHEET if (fault := causes.fault_of_edge(arm, edge))}
    if 'map' in arm.samples and not faults:
        parents = comma_list([*arm.samples['map'].parents], shortened)
        return Line(f'{parents} → map',
                      'map is the root of the tree: it must not have a parent.')
    return _first(faults, f'{len(FRAMES)} frames in a chain')


def _stamps(arm: Arm) -> Line:
    known = {name: samples for name, samples in arm.moving.items() if samples.times.all()}
    if not known:
        return _not_judged('The bag has no times.' if arm.moving else
                           'No transform of the arm is on /tf.')
    faults = {name: fault for name, samples in known.items()
              if (fault := causes.fault_of_stamps(arm, name, samples))}
    largest = max(abs(float(np.median(samples.delays))) for samples in known.values())
    return _first(faults, f'{largest * 1e3:.1f} ms from the time of arrival')


# base_link and end_effector


def _base_on_tf_static(arm: Arm, base: SheetFrame) -> Line:
    is_static = arm.samples[base.name].is_static
    if is_static.all():
        return Line('/tf_static')
    if is_static.any():
        return Line('on both', 'map → base_link is sent on /tf, too: do not send it in the timer.',
                    [base.name])
    return Line('/tf', 'map → base_link is sent on /tf: use StaticTransformBroadcaster, which '
                'sends on /tf_static.', [base.name])


def _base_at_origin(arm: Arm, base: SheetFrame) -> Line:
    samples = arm.samples[base.name]
    position = _farthest(samples.positions, base.position)
    measured = metres(position)
    if (angle := largest_angle(samples.rotations[:, :3])) > _ROTATION_TOLERANCE:
        return Line(f'{measured}, rotated by {in_degrees(angle)}', (
            causes.WRONG_ORDER if samples.has_wrong_order else
            'base_link must not be rotated in map: the quaternion is (0, 0, 0, 1).'))
    return Line(measured, '' if is_near(position, base.position) else
                  'The translation of base_link in map must be (0, 0, 0).')


def _late_joiner(arm: Arm, _: SheetFrame) -> Line:
    if arm.reaches_late_joiners is None:
        return _not_judged('This was not observed.')
    return Line('received') if arm.reaches_late_joiners else Line(
        'not received', 'A listener that starts now does not receive base_link: keep the node and '
        'its StaticTransformBroadcaster as long as the program runs.')


def _hand(arm: Arm, hand: SheetFrame) -> Line:
    if hand.name in arm.moving and (silence := causes.of_silence(arm, hand.name)):
        return Line('', silence)
    rotations = arm.samples[hand.name].rotations
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


def _position(arm: Arm, edge: SheetFrame) -> Line:
    positions = arm.samples[edge.name].positions
    position = _farthest(positions, edge.position)
    return Line(metres(position), '' if is_near(position, edge.position) else
                  causes.of_position(edge, positions, position))


def _axis(arm: Arm, joint: SheetFrame) -> Line:
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


def _motion(arm: Arm, joint: SheetFrame) -> Line:
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


def _limit(arm: Arm, joint: SheetFrame) -> Line:
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


def _sine(arm: Arm, joint: SheetFrame) -> Line:
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
    if found and sine.periods < _SHORTEST_WAVE:
        return _not_judged(causes.of_short_time(joint, sine),
                           f'{int(100 * sine.periods) / 100} periods', found)
    return Line(f'differs by {100 * sine.residual:.1f} % of the amplitude',
                  '' if found else causes.of_wave(joint, times, angles, sine), value=found)


def _speeds(found: Sequence[Optional[Sine]]) -> Line:
    for joint, sine in zip(JOINTS, found):
        if sine and sine.periods < _SLOW and sine.span >= causes.LONG_ENOUGH:
            return Line(f'{joint.name}: less than {sine.speed:.2g} rad/s', (
                f'{joint.name} is much too slow: {causes.UNIT_OF_TIME} Or is the speed converted? '
                f'About {joint.speed} rad/s is in radians already: do not convert it.'))
        if not sine or sine.periods < _SHORTEST_WAVE:
            return _not_judged(f'The speed of {joint.name} cannot be measured.')
    sines = [*filter(None, found)]
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


def _farthest(positions: Floats, expected: Vector) -> Floats:
    return np.asarray(positions[np.linalg.norm(positions - expected, axis=1).argmax()])


# Good practice


def _rate(arm: Arm) -> Line:
    steps = {name: np.diff(samples.times) for name, samples in arm.moving.items()}
    # The usual rate: in a bag, a part may be missing.
    rates = {name: 1.0 / step for name, each in steps.items()
             if len(each) and (step := float(np.median(each))) > 0.0}
    name, rate = min(rates.items(), key=itemgetter(1), default=('', 0.0))
    return Line(f'{rate:.1f} Hz' if rates else '', '' if rate >= _LOWEST_RATE else
                  f'{name} is sent {rate:.1f} times a second: its motion does not look smooth.')


def _clock(sines: Sequence[Optional[Sine]], has_fixed_step: bool) -> Line:
    if has_fixed_step:
        return Line('a sine of the number of the message',
                      'Use the clock: with a fixed step, the speed depends on the rate.')
    return Line('a sine of the time' if any(sines) else '')


def _same_stamp(arm: Arm, has_wrong_stamps: bool) -> Line:
    stamps = [set(samples.stamps.tolist()) for samples in arm.moving.values()]
    same = len(set.intersection(*stamps)) / max(map(len, stamps)) if stamps else 0.0
    senders = {arm.nodes.get(gid, gid) for samples in arm.moving.values()
               for gid in samples.publishers}
    # Several nodes cannot share a stamp; a wrong stamp is a fault of its own.
    can_share = len(senders - {NOT_RECORDED}) == 1 and not has_wrong_stamps
    return Line(f'{100 * same:.0f} % of the ticks' if len(stamps) > 1 and (
                    same >= _SAME_STAMP or can_share) else '',
                '' if same >= _SAME_STAMP else
                'Call get_clock().now() once in each tick, and use it for all frames.')


def _use_of_limits(arm: Arm, needs: Mapping[SheetFrame, Sequence[Line]]) -> Line:
    used = {joint.name: arm.samples[joint.name].largest_angle / joint.limit
            for joint, needed in needs.items()
            if not any(joint.name in line.broken for line in needed)}
    name, part = min(used.items(), key=itemgetter(1), default=('', 0.0))
    return Line(', '.join(f'{100 * each:.0f} %' for each in used.values()),
                  '' if part >= _USED else f'{name} uses only {100 * part:.0f} % of its limit.')


def _broadcasters(arm: Arm) -> Line:
    gids = {gid for publishers in arm.senders.values() for gid in publishers}
    is_known = gids - {NOT_RECORDED, ''}
    return Line(f'{len(gids)} publishers' if is_known else '', causes.recreation(arm))


def _base_sent_once(arm: Arm) -> Line:
    samples = arm.samples.get(BASE.name)
    count = int(samples.is_static.sum()) if samples else 0
    return Line(f'messages: {count}' if count else '', '' if count <= _MOST_STATIC else
                  'Send map → base_link once, in __init__: a late listener also receives it.')


def _other_frames(arm: Arm) -> Line:
    return Line(f'{len(arm.others)} other frames' if arm.samples else '',
                  f'Other frames: {comma_list(arm.others)}.' if arm.others else '')


def _usual_speeds(speeds: Sequence[float], has_fixed_step: bool) -> Line:
    cause = next((causes.of_speed(joint, speed, has_fixed_step)
                  for joint, speed in zip(JOINTS, speeds)
                  if not 1 / SPEED_FACTOR <= speed / joint.speed <= SPEED_FACTOR), '')
    return Line(_in_words(speeds), cause or ('' if _are_in_order(speeds) else (
        'By the phases, the speeds are not in the order of the sheet.')))


def _floats(arm: Arm) -> Line:
    if arm.int_line:
        return Line(f'an int in line {arm.int_line}', causes.USE_FLOATS)
    if any(causes.has_ints(samples.poses) for samples in arm.samples.values()):
        return Line('an int', causes.USE_FLOATS)
    return Line('no sign of an int' if arm.samples else '')
