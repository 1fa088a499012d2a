"""The likely cause of what is wrong with an arm, in a sentence; all are pure functions."""

from collections.abc import Iterable, Sequence
from itertools import combinations
from math import degrees, pi, radians
import re
from typing import Optional

import numpy as np
from numpy.typing import ArrayLike

from dummy_arm.grading.samples import Arm, Samples
from dummy_arm.grading.sheet import BASE, FRAMES, JOINTS, SHEET, SheetFrame
from dummy_arm.grading.sine import FASTEST, FEWEST, fit, fit_sine, Floats, Sine
from puretf import SECOND
from puretf._text.names import comma_list, shortened
from puretf._text.similar_names import near_names

#: How far a position may be from the required position (m).
POSITION_TOLERANCE = 1e-3
#: Two speeds are different if their ratio is at least this number.
DIFFERENT = 1.05
#: A slow joint is named if it was observed for this time (s).
LONG_ENOUGH = 15.0
#: The largest factor to a speed of the sheet.
SPEED_FACTOR = 1.5
#: A frame from which nothing was received for this time (s) at the end of an observation is not
#: sent any more; a busy machine stops for less. The period of a timer that is meant to be in ms.
_SILENCE, _LONG_PERIOD = 6.0, 5.0
#: The factor to a speed of the sheet is probably 2π if it differs from 2π by less than this part.
_TURN_TOLERANCE = 0.05
#: A joint that is this many times faster than on the sheet probably has another unit of time. So
#: has one whose usual change between two messages is this part of its range, and no sine.
_OTHER_UNIT, _LARGE_STEP = 10.0, 0.1
#: A current stamp differs from the time of arrival by less than this time (s). This part of the
#: stamps may differ by more: if the machine stops for some seconds, what was sent then is late.
LARGEST_DELAY, _DELAYED = 0.5, 0.3
#: tf2's limit for |norm² - 1| of a quaternion.
_NORM_TOLERANCE = 10e-3
#: A float that is smaller, but not 0, is what an int becomes where a float is expected.
_SMALLEST_FLOAT = 1e-300

WRONG_ORDER = ('Is the order x, y, z, w? In a message, w is the last number; transforms3d has it '
               'first.')
USE_FLOATS = ('Write 0.0 and not 0, since all numbers in a message are floats: in the container, '
              'an int may be sent as another number.')
_HALF_ANGLE = 'In the quaternion, use the half angle: z = sin(angle / 2), w = cos(angle / 2).'
UNIT_OF_TIME = 'is t in seconds? Use .nanoseconds * 1e-9.'
_NOW = 'write header.stamp = self.get_clock().now().to_msg()'
#: What was measured, and the cause.
Fault = tuple[str, str]


# Transforms and tree


def recreation(arm: Arm) -> str:
    """Say that a program creates a broadcaster again and again; '' if none does."""
    return (f'{arm.recreated} publishers, one after another: create the broadcaster once, not in '
            'the callback of the timer.') if arm.recreated else ''


def static_joints(arm: Arm) -> str:
    """Say which joints are sent as static transforms; '' if none is."""
    names = [joint.name for joint in JOINTS if (samples := arm.samples.get(joint.name))
             and samples.is_static.all()]
    return (f'{", ".join(names)} {"are" if len(names) > 1 else "is"} sent with '
            'StaticTransformBroadcaster: send the joints with TransformBroadcaster in a timer.'
            ) if names else ''


def fault_of_numbers(name: str, poses: Floats) -> Optional[Fault]:
    if not np.isfinite(poses).all():
        return 'nan or inf', (f'{name} has a number that is not finite; tf2 ignores such a '
                              'transform.')
    norms = np.linalg.norm(poses[:, 3:], axis=1)
    if abs(norms ** 2 - 1).max() < _NORM_TOLERANCE:
        return None
    norm = norms[abs(norms - 1).argmax()]
    if has_ints(poses[:, 3:]):
        cause = f'The quaternion of {name} has an int. {USE_FLOATS}'
    elif norm < 0.01:
        cause = f'All four numbers of the quaternion of {name} are 0: for no rotation, w is 1.'
    else:
        cause = (f'The quaternion of {name} does not have the norm 1: z and w are the sine and '
                 'the cosine of the same angle, half of the joint angle.')
    return f'norm {norm:.2f}', cause


def has_ints(numbers: Floats) -> bool:
    """Return whether numbers are probably ints that were read as floats, as in the container."""
    return bool(((numbers != 0.0) & (abs(numbers) < _SMALLEST_FLOAT)).any())


def fault_of_edge(arm: Arm, edge: SheetFrame) -> Optional[Fault]:
    """Return what is wrong with an edge of the tree: with its frames, or with who sends it."""
    name, samples = edge.name, arm.samples.get(edge.name)
    reverse = arm.samples.get(edge.parent)
    if reverse and reverse.parents == [name]:
        return f'{name} → {edge.parent}', (
            f'Parent and child are exchanged: {edge.parent} is the frame_id, and {name} is the '
            'child_frame_id.')
    if not samples:
        return _fault_of_missing(arm, edge)
    is_on_both = samples.is_static.any() and not samples.is_static.all()
    if is_on_both and edge is not BASE:  # which has a requirement of its own
        return f'{name} on /tf and /tf_static', (
            f'{name} is sent on /tf and on /tf_static; only one of them is right.')
    if samples.is_published_twice and not is_on_both:
        return f'{name} from {len(set(samples.publishers))} publishers', (
            recreation(arm) or _two_programs(arm, name) or f'Two publishers send {name} at the '
            'same time: two programs, nodes or broadcasters. Only one may send it.')
    if samples.parents == [edge.parent]:
        return None
    parents = comma_list([*samples.parents], shortened)
    if len(samples.parents) > 1:
        cause = f'{name} has several parents; only {edge.parent} is right.'
    else:
        cause = misspelling(edge.parent, samples.parents) or (
            f'The parent of {name} must be {edge.parent}, not {parents}.')
    return f'{parents} → {name}', _star(arm, samples) or cause


def _fault_of_missing(arm: Arm, edge: SheetFrame) -> Fault:
    received = f'No transform of {edge.name} was received'
    if not (cause := misspelling(edge.name, [*arm.samples]) or recreation(arm)
            or (static_joints(arm) if edge is not BASE else '')):
        if all(each.is_static.all() for each in arm.samples.values()):
            cause = f'{received}: nothing arrives on /tf. {of_nothing(arm)}'
        elif arm.repeated:
            cause = (f'{shortened(arm.repeated)} is in one message more than once: create a new '
                     'TransformStamped for each frame.')
        elif arm.others:
            cause = f'{received}, but of other frames: {comma_list(arm.others)}.'
        elif edge is BASE:
            cause = (f'{received}: send it with StaticTransformBroadcaster, and keep the node '
                     'running. What TransformBroadcaster sends once does not reach later '
                     'listeners.')
        else:
            cause = f'{received}.'
    return f'no {edge.name}', cause


def of_nothing(arm: Arm) -> str:
    """Return why a program may send nothing."""
    return arm.no_clock or (
        f'The program is in line {arm.place}: is there a loop or a wait without end?' if arm.place
        else 'Does a timer, with its period in seconds, call sendTransform, and does rclpy.spin '
        'run?')


def _star(arm: Arm, samples: Samples) -> str:
    """Say that most frames have the same parent; '' if they have not."""
    children = [child.name for child in SHEET if child.name in arm.samples
                and samples.parents[0] in arm.samples[child.name].parents]
    return (f'The tree is a star: {", ".join(children)} have the same parent. In a chain, the '
            'parent of a frame is the frame before it.') if len(children) > 2 else ''


def _two_programs(arm: Arm, name: str) -> str:
    """Say which copies of a program send a frame; '' if it is not known."""
    gids = {*arm.samples[name].publishers}
    nodes = {each.pid: each.node for each in arm.publishers if each.pid and each.gid in gids}
    if len(nodes) < 2 or len({*nodes.values()}) > 1:
        return ''
    *old, newest = nodes
    pids = ', '.join(f'PID {pid}' for pid in old)
    return (f'Copies of one program send {name} at the same time: {pids} and PID {newest}. An '
            f'old one still runs: end it (kill {" ".join(map(str, old))}).')


def misspelling(name: str, others: Sequence[str]) -> str:
    """Say which of other names is probably meant to be a frame's name; '' if none is."""
    # The names of the joints differ in one digit only, so a similar name must have the same digit.
    candidates = [other for other in others if other not in FRAMES
                  and re.findall(r'\d', other) == re.findall(r'\d', name)]
    near = near_names(name, candidates, 0.75)
    return f'{shortened(near[0])!r} is misspelt: the name is {name}.' if near else ''


def fault_of_stamps(arm: Arm, name: str, samples: Samples) -> Optional[Fault]:
    stamps, delays = samples.stamps, samples.delays
    is_wrong = abs(delays) >= LARGEST_DELAY
    has_whole_seconds = len(stamps) > 1 and not (stamps % 10**9).any()
    if is_wrong.mean() <= _DELAYED and not has_whole_seconds:
        return None
    if not stamps.any():
        measured, cause = '0', f'is 0: {arm.no_clock}' if arm.no_clock else f'is not set: {_NOW}.'
    elif stamps.min() == stamps.max() != 0 and len(stamps) > 2:
        measured, cause = 'always the same', f'is set only once: {_NOW} before each sendTransform.'
    elif has_whole_seconds:
        measured, cause = 'whole seconds', f'has no nanoseconds: {_NOW}.'
    else:
        delay = float(np.median(delays[is_wrong]))
        measured = f'{abs(delay):.3g} s {"old" if delay > 0 else "in the future"}'
        cause = f'is not the current time: {_NOW}.'
    return f'{name}: {measured}', f'The stamp of {name} {cause}'


# Positions and rotations


def of_position(edge: SheetFrame, positions: Floats, position: Floats) -> str:
    if np.ptp(positions, axis=0).max() > POSITION_TOLERANCE:
        return (f'The position of {edge.name} changes. Only its rotation may change: the rotation '
                f'of {edge.parent} already moves {edge.name}.')
    length = max(edge.position)
    if abs(float(np.linalg.norm(position)) - length) <= POSITION_TOLERANCE:
        return f'The distance is right, but not the direction: {edge.name} is {edge.place}.'
    for other in SHEET[1:]:
        if is_near(position, other.position):
            return (f'On the sheet, this is the position of {other.name}: are positions at wrong '
                    'frames?')
    from_base = np.sum([other.position for other in SHEET[:SHEET.index(edge) + 1]], axis=0)
    if is_near(position, from_base):
        return (f'This is the position in base_link. A transform has the position in the parent, '
                f'which is {edge.parent}.')
    for factor, unit in (1000.0, 'millimetres'), (100.0, 'centimetres'):
        if is_near(position, np.multiply(factor, edge.position)):
            return f'The position is in {unit}; TF uses metres.'
    if not any(position):
        return f'The position of {edge.name} is not set.'
    return f'The translation of {edge.name} must be {metres(edge.position)}.'


def is_near(position: Floats, expected: ArrayLike) -> bool:
    return bool(np.linalg.norm(np.subtract(position, expected)) <= POSITION_TOLERANCE)


def of_excess(arm: Arm, joint: SheetFrame) -> str:
    """Return why the largest angle of a joint exceeds its limit."""
    largest = {each: arm.samples[each.name].largest_angle
               for each in JOINTS if each.name in arm.samples}
    excess = f'The limit is exceeded by {in_degrees(largest[joint] - joint.limit)}'
    doubled = [each for each in largest if abs(largest[each] / each.limit - 2) < 0.04]
    others = [other.name for other in JOINTS if other is not joint and len(doubled) < 2
              and abs(largest[joint] - other.limit) < radians(0.5)]
    if joint in doubled:
        return (f'{excess}: the angle is twice as large as it should be. {_HALF_ANGLE}' +
                ''.join(f' Or is it the limit of {other}?' for other in others))
    if others:
        return f'{excess}: this is the limit of {others[0]}.'
    if largest[joint] - joint.limit < radians(1.0):
        return f'{excess}: is the limit rounded, or does the last step go beyond it?'
    return (f'{excess}. The amplitude of the sine, plus an offset if there is one, must be at '
            f'most {degrees(joint.limit):.0f}°.')


# Motion


def of_silence(arm: Arm, name: str) -> str:
    """Say that a frame on /tf is sent too rarely, or not any more; '' if it is not."""
    samples = arm.samples[name]
    silence = arm.end - samples.times[-1]
    if len(samples.times) == 1:
        cause = (f'{name} was sent only once: send it in a timer; the period is in seconds, such '
                 'as 0.02.')
    elif samples.interval >= _LONG_PERIOD:
        cause = of_interval(name, samples.interval)
    elif silence >= _SILENCE:
        cause = (f'{name} has not been sent for the last {silence:.1f} s: send it as long as the '
                 'program runs.')
    else:
        return ''
    return recreation(arm) or cause


def of_sum(arm: Arm, joint: SheetFrame) -> str:
    """Say that a joint has the angle of its parent added to its sine; '' if it has not."""
    own, parent = arm.samples[joint.name], arm.samples.get(joint.parent)
    if not parent or len(own.stamps) < FEWEST or not np.array_equal(own.stamps, parent.stamps):
        return ''
    times = (own.stamps - own.stamps[0]) / SECOND
    if times[-1] < LONG_ENOUGH:
        return ''
    rest = fit_sine(times, np.unwrap(own.angles - parent.angles))
    is_sum = rest.is_exact and rest.periods > 1.0 and (
        radians(3) < rest.amplitude < joint.limit + radians(1))
    return (f'{joint.name} has the angle of {joint.parent} added: leave it out, since the angle '
            'of a transform is in its parent.') if is_sum else ''


def of_interval(name: str, interval: float) -> str:
    return (f'{name} is sent every {interval:.3g} s: is the period of the timer in seconds, such '
            'as 0.02?')


def of_wave(joint: SheetFrame, times: Floats, angles: Floats, sine: Sine) -> str:
    """Return why the motion of a joint is not a sine."""
    too_fast = f'{joint.name} moves too fast to see a wave: {UNIT_OF_TIME}'
    if sine.speed > 0.9 * FASTEST:
        return too_fast
    changes = times[1:][np.diff(angles) != 0.0]
    if 1 < len(changes) < len(times) / 2 and abs(np.median(np.diff(changes)) - 1.0) < 0.1:
        return (f'The angle of {joint.name} changes only once a second: is t in whole seconds? '
                'Use .nanoseconds * 1e-9.')
    low, high = float(angles.min()), float(angles.max())
    at_ends = np.mean((angles > high - 0.01 * (high - low)) | (angles < low + 0.01 * (high - low)))
    if at_ends > 0.2:  # for a sine, it is 0.13
        return (f'{joint.name} rests at {in_degrees(high)} or {in_degrees(low)}: the wave is '
                'clipped. Do not cut the angle off; the amplitude of the sine is the limit.')
    phase = sine.speed * times + sine.phase
    triangle = np.column_stack([np.ones_like(times), np.arcsin(np.sin(phase))])
    if fit(triangle, angles)[1] / sine.amplitude < sine.residual / 2:
        return (f'{joint.name} moves at a constant speed to and fro, which is a triangle wave: '
                'the angle must be limit * sin(speed * t).')
    steps = abs(np.diff(angles)) / (high - low)
    if sine.speed > _OTHER_UNIT * joint.speed or (
            sine.residual > 1.0 and np.median(steps) > _LARGE_STEP):
        return too_fast
    how = 'jumps' if steps.max() > 0.3 else 'is not a sine of the time'
    return f'The angle of {joint.name} {how}: it must be limit * sin(speed * t).'


def of_short_time(joint: SheetFrame, sine: Sine) -> str:
    """Return why less than a period was observed, and how long to observe the arm."""
    seconds = max(25, 5 * int(np.ceil(2 * pi / sine.speed / 5)))
    remedy = f'observe or record the arm for {seconds} s (--time {seconds})'
    if sine.speed * SPEED_FACTOR < joint.speed and sine.span >= LONG_ENOUGH:
        return f'{of_speed(joint, sine.speed, sine.has_fixed_step)} Or {remedy}.'
    return f'{sine.span:.1f} s are less than a period: {remedy}.'


def of_speed(joint: SheetFrame, speed: float, has_fixed_step: bool) -> str:
    """Return how fast a joint is in comparison with the sheet, and why."""
    ratio = speed / joint.speed
    how = {0.5: 'half', 2.0: 'twice'}.get(round(ratio, 1), f'{ratio:.2g} times')
    why = ('the step is fixed, so the speed depends on the rate; take the time from the clock.'
           if has_fixed_step else 'is there a factor 2π? In sin(speed * t), it is in rad/s.'
           if _is_turn(ratio) else
           'is it the speed of the sheet, and the time in seconds?')
    return (f'{joint.name} is {how} as fast as the sheet ({speed:.2f} in place of {joint.speed} '
            f'rad/s): {why}')


def _is_turn(ratio: float) -> bool:
    return abs(ratio / (2 * pi) - 1) < _TURN_TOLERANCE


def of_speeds(speeds: Sequence[float]) -> str:
    """Return why speeds are not in the right order."""
    for (first, speed), (second, other) in combinations(zip(JOINTS, speeds), 2):
        if max(speed, other) < DIFFERENT * min(speed, other):
            return f'{first.name} and {second.name} have the same speed.'
    for speed, joint in zip(speeds, JOINTS):
        if speed > _OTHER_UNIT * joint.speed:
            return f'{joint.name} is much too fast: {UNIT_OF_TIME}'
        if _is_turn(speed / joint.speed):
            return of_speed(joint, speed, has_fixed_step=False)
    return 'The order of the speeds is wrong: joint_1 must be the slowest, joint_3 the fastest.'


def metres(position: Iterable[float]) -> str:
    return f'({", ".join(f"{value + 0.0:.3f}" for value in position)}) m'


def in_degrees(angle: float) -> str:
    return f'{degrees(angle):.1f}°'
