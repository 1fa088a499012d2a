"""
The requirements of the lab's final task, and the check whether the transforms of an arm meet them.

The check needs no ROS: its input is a list of received or recorded messages.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property, partial
from itertools import combinations, groupby, pairwise
from math import asin, degrees, log, pi, radians
from operator import itemgetter
from typing import Any, NamedTuple, Optional

import numpy as np
from numpy.typing import ArrayLike

from dummy_arm.grading.records import (
    ADVICE,
    Line,
    Message,
    NOT_JUDGED,
    NOT_OK,
    OK,
    Publisher,
    Report,
)
from dummy_arm.grading.sine import FASTEST, FEWEST, fit, fit_sine, Floats, Sine
from puretf import comma_list, is_frozen, near_names, SECOND, shortened
from puretf.bag import NOT_RECORDED
from puretf_tools.inspection.traffic import recreated

#: How far a position may be from the required position (m), and how far a frame may be rotated
#: about an axis about which it must not rotate (rad).
_POSITION_TOLERANCE, _ROTATION_TOLERANCE = 1e-3, radians(0.1)
#: How far an angle may exceed its limit (rad): the rounding of a program's own constants.
_LIMIT_TOLERANCE = radians(0.05)
#: A joint that turns by less than this angle (rad) does not move.
_SMALLEST_MOTION = radians(3.0)
#: The largest residual of a sine; a triangle wave has 0.08. The part of a period that must be
#: observed leaves 8 of 25 s to the pauses of a busy machine; a triangle wave still has 0.076.
_LARGEST_RESIDUAL, _SHORTEST_WAVE = 0.02, 0.8
#: A joint of which less than this part of a period is observed in this time (s) is too slow.
_SLOW, _LONG_ENOUGH = 0.3, 15.0
#: A frame from which nothing was received for this time (s) at the end of an observation is not
#: sent any more; a busy machine stops for less. The period of a timer that is meant to be in ms.
_SILENCE, _LONG_PERIOD = 6.0, 5.0
#: Two speeds are different if their ratio is at least this number.
_DIFFERENT = 1.05
#: A current stamp differs from the time of arrival by less than this time (s). This part of the
#: stamps may differ by more: if the machine stops for some seconds, what was sent then is late.
_LARGEST_DELAY, _DELAYED = 0.5, 0.3
#: tf2's limit for |norm² - 1| of a quaternion.
_NORM_TOLERANCE = 10e-3
#: Good practice: the lowest rate (Hz), the part of a limit that is used, the part of the ticks in
#: which all frames have the same stamp, and the largest factor to a speed of the sheet.
_LOWEST_RATE, _USED, _SAME_STAMP, _SPEED_FACTOR = 9.5, 0.49, 0.9, 1.5
#: A joint that is this many times faster than on the sheet probably has another unit of time. So
#: has one whose usual change between two messages is this part of its range, and no sine.
_OTHER_UNIT, _LARGE_STEP = 10.0, 0.1
#: The mean of |w| is larger, unless another number is in its place: joints turn by ±60° at most.
_SMALL_W = 0.4
#: The largest number of frames that a cause lists.
_SHOWN = 5

#: What can be wrong with a frame, so that other requirements cannot be judged.
_TRANSFORMS, _STAMPS, _AXIS, _MOTION, _TURNS = 'transforms', 'stamps', 'axis', 'motion', 'turns'
_LATE_LISTENER = 'base_link reaches a late listener'

#: Causes: of an angle that is twice as large as it should be, of a quaternion that has another
#: number in the place of w, of a wrong speed.
_HALF_ANGLE = 'In the quaternion, use the half angle: z = sin(angle / 2), w = cos(angle / 2).'
_WRONG_ORDER = ('Is the order x, y, z, w? In a message, w is the last number; transforms3d has '
                'it first.')
_UNIT_OF_TIME = 'is t in seconds? Use .nanoseconds * 1e-9.'

_Vector = tuple[float, float, float]
#: What was measured, and the cause if the requirement is not met, otherwise ''.
_Result = tuple[str, str]


class Edge(NamedTuple):
    """What the sheet of the lab requires of a frame."""

    name: str
    parent: str
    position: _Vector  #: the origin of the frame in its parent (m)
    limit: float = 0.0  #: the largest angle about z, in both directions (rad); 0: does not rotate
    speed: float = 0.0  #: rad/s; see `Sine.speed` and `Sine.fastest`

    @property
    def place(self) -> str:
        """The position in words, such as '0.3 m along z'."""
        length, axis = max(zip(self.position, 'xyz'))
        return f'{length:g} m along {axis}'


BASE = Edge('base_link', 'map', (0.0, 0.0, 0.0))
JOINTS = (Edge('joint_1', 'base_link', (0.0, 0.0, 0.3), radians(45), 0.3),
          Edge('joint_2', 'joint_1', (0.4, 0.0, 0.0), radians(30), 0.5),
          Edge('joint_3', 'joint_2', (0.3, 0.0, 0.0), radians(60), 0.7))
HAND = Edge('end_effector', 'joint_3', (0.2, 0.0, 0.0))
EDGES = (BASE, *JOINTS, HAND)
#: The names of all frames, from the root to the hand.
FRAMES = (BASE.parent, *(edge.name for edge in EDGES))


def check(messages: Iterable[Message], reaches_late_joiners: Optional[bool] = None,
          end: Optional[int] = None, publishers: Sequence[Publisher] = ()) -> Report:
    """
    Check whether the transforms of an arm meet the requirements.

    :param messages: the messages of /tf and /tf_static, in the order of their times.
    :param reaches_late_joiners: whether a listener that started later than the arm has received
        base_link; None: not known, which does not count as a failure.
    :param end: the end of the observation (ns); None: the time of the last message on /tf.
    :param publishers: the publishers on /tf and /tf_static, also those that are gone; those of
        the oldest process first; empty: not known.
    """
    return _Check(messages, reaches_late_joiners, end, publishers).report()


class _NotJudged(Exception):
    """Why a requirement cannot be judged, and what was measured all the same."""

    def __init__(self, why: str, measured: str = '') -> None:
        self.why, self.measured = why, measured


class _Fault(NamedTuple):
    """What is wrong with an edge of the tree."""

    measured: str
    reason: str  #: why nothing else of the frame can be judged
    cause: str


class _Samples:
    """The transforms of one frame, each with its message, in the order of their arrival."""

    def __init__(self, rows: list[tuple[Message, Any]]) -> None:
        self.parents = {_name(row.frame_id): None for _, row in rows}  # in order of appearance
        self.is_static = np.array([message.is_static for message, _ in rows])
        self.poses = np.array([row.pose for _, row in rows], float)
        self.publishers = [message.publisher for message, _ in rows]
        moving = [(message, row) for message, row in rows if not message.is_static]
        #: Of the transforms on /tf: the times of arrival (s; 0: not known) and the stamps (ns).
        self.times = np.array([message.time / SECOND for message, _ in moving])
        self.stamps = np.array([row.stamp_ns for _, row in moving], np.int64)

    @property
    def delays(self) -> Floats:
        """The times from the stamps to the arrivals (s) of the transforms on /tf."""
        return np.asarray(self.times - self.stamps / SECOND)

    @property
    def interval(self) -> float:
        """The median time from one transform on /tf to the next one (s)."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0

    @property
    def ticks(self) -> Floats:
        """The numbers of the stamps on /tf, times the median interval of the stamps (s)."""
        steps = np.diff(self.stamps)
        is_new = steps != 0
        interval = np.median(abs(steps[is_new])) / SECOND
        return np.asarray(np.append(0, np.cumsum(is_new)) * interval)

    @property
    def positions(self) -> Floats:
        """(n, 3): the positions (m)."""
        return self.poses[:, :3]

    @cached_property
    def rotations(self) -> Floats:
        """(n, 4): the unit quaternions x, y, z, w."""
        quaternions = self.poses[:, 3:]
        return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1)[:, None])

    @cached_property
    def angles(self) -> Floats:
        """(n,): the angles about z (rad), from -pi to pi."""
        angles = 2 * np.arctan2(self.rotations[:, 2], self.rotations[:, 3])
        return np.asarray((angles + pi) % (2 * pi) - pi)

    def has_wrong_order(self) -> bool:
        """Return whether another number is probably in the place of w."""
        return float(abs(self.rotations[:, 3]).mean()) < _SMALL_W

    def is_published_twice(self) -> bool:
        """Return whether two publishers send the frame on one topic at the same time."""
        # If each begins after the one before it has ended, as when a program is started again,
        # the messages of each are one group.
        return any(
            len([*groupby(names)]) > len(set(names)) for names in (
                [name for name, is_static in zip(self.publishers, self.is_static)
                 if is_static == topic] for topic in (False, True)))


class _Check:
    """The check of one arm; the arguments are those of `check`."""

    def __init__(self, messages: Iterable[Message], reaches_late_joiners: Optional[bool],
                 end: Optional[int], publishers: Sequence[Publisher]) -> None:
        self._publishers = publishers
        self._reaches_late_joiners = reaches_late_joiners
        rows: defaultdict[str, list[tuple[Message, Any]]] = defaultdict(list)
        #: A frame that is in one message more than once; '': none.
        self._repeated = ''
        for message in messages:
            for row in message.rows:
                name = _name(row.child_frame_id)
                if rows[name] and rows[name][-1][0] is message:
                    self._repeated = name
                rows[name].append((message, row))
        self._samples = {name: _Samples(found) for name, found in rows.items()}
        self._others = [shortened(name) for name in self._samples if name not in FRAMES]
        #: The frames of the arm that are on /tf, in the order of the chain.
        self._moving = {edge.name: samples for edge in EDGES
                        if (samples := self._samples.get(edge.name)) and len(samples.times)}
        times = [samples.times[-1] for samples in self._samples.values() if len(samples.times)]
        self._end = max(times, default=0.0) if end is None else end / SECOND  # s
        #: By frame and by what is wrong with it: a sentence. A method that judges a requirement
        #: adds what it finds; later methods then do not judge what depends on it.
        self._faults: dict[tuple[str, str], str] = {}
        #: The sines that fit the angles, by joint; also those that are too short to be judged.
        self._sines: dict[str, Sine] = {}
        #: True if a joint moves as a sine of the number of the message, and not of the time.
        self._has_fixed_step = False
        #: The speeds of the joints (rad/s), if they are as required.
        self._speeds_found: list[float] = []

    def report(self) -> Report:
        lines = [_judged(*each) for each in self._requirements()]
        passed = all(line.verdict == OK for line in lines
                     if self._reaches_late_joiners is not None
                     or line.requirement != _LATE_LISTENER)
        return Report(lines, [_advised(*each) for each in self._advice()], passed)

    def _requirements(self) -> Iterator[tuple[str, Callable[[], _Result]]]:
        yield 'all transforms are valid', self._validity
        yield 'the tree', self._tree
        yield 'the stamps are the current time', self._stamps
        yield 'base_link is on /tf_static', self._base_on_tf_static
        yield 'base_link is fixed at the origin of map', self._base_at_origin
        yield _LATE_LISTENER, self._late_joiner
        for edge in EDGES[1:]:
            yield f'{edge.name} is {edge.place} from {edge.parent}', partial(self._position, edge)
        for text, method in (
                ('turns about z only', self._axis), ('moves', self._motion),
                ('stays within ±{:.0f}°', self._limit), ('moves as a sine', self._sine)):
            for joint in JOINTS:
                yield f'{joint.name} {text.format(degrees(joint.limit))}', partial(method, joint)
        yield 'the joints have three different speeds', self._speeds
        yield 'end_effector does not move in joint_3', self._hand

    def _why_not(self, name: str, *kinds: str) -> str:
        """Return the first of some faults of a frame; '' if it has none of them."""
        if not self._samples:
            return 'There are no transforms.'
        reasons = (self._faults.get((name, kind), '') for kind in (_TRANSFORMS, *kinds))
        return next(filter(None, reasons), '')

    def _right(self, name: str, *kinds: str) -> _Samples:
        """Return the transforms of a frame; raise _NotJudged if it has one of some faults."""
        if why := self._why_not(name, *kinds):
            raise _NotJudged(why)
        return self._samples[name]

    # Transforms and tree

    def _validity(self) -> _Result:
        """Judge the numbers: tf2 ignores transforms with NaN, and with a quaternion of norm 0."""
        if not self._samples:
            return 'no transform', (self._recreated or
                                    'Nothing was received on /tf and /tf_static.')
        results = []
        for name in (edge.name for edge in EDGES if edge.name in self._samples):
            if result := _fault_of_numbers(name, self._samples[name].poses):
                self._faults[name, _TRANSFORMS] = f'The transforms of {name} are not valid.'
                results.append(result)
        count = sum(len(samples.poses) for samples in self._samples.values())
        return results[0] if results else (f'{count} transforms', '')

    def _tree(self) -> _Result:
        """Judge the names of the frames and of their parents."""
        if not self._samples:
            raise _NotJudged('There are no transforms.')
        faults = {edge: fault for edge in EDGES if (fault := self._fault_of_edge(edge))}
        for edge, fault in faults.items():
            self._faults.setdefault((edge.name, _TRANSFORMS), fault.reason)
        for edge, fault in faults.items():
            return fault.measured, self._star(edge) or fault.cause
        if 'map' in self._samples:
            parents = comma_list([*map(shortened, self._samples['map'].parents)], _SHOWN)
            return f'{parents} → map', 'map is the root of the tree: it must not have a parent.'
        return f'{len(FRAMES)} frames in a chain', ''

    def _fault_of_edge(self, edge: Edge) -> Optional[_Fault]:
        for look in (self._exchanged, self._missing, self._sent_twice, self._on_both_topics,
                     self._wrong_parent):
            if fault := look(edge):
                return fault
        return None

    def _exchanged(self, edge: Edge) -> Optional[_Fault]:
        reverse = self._samples.get(edge.parent)
        return _Fault(
            f'{edge.name} → {edge.parent}', f'The parent of {edge.parent} is {edge.name}.',
            f'Parent and child are exchanged: {edge.parent} is the frame_id, and {edge.name} is '
            'the child_frame_id.') if reverse and [*reverse.parents] == [edge.name] else None

    def _missing(self, edge: Edge) -> Optional[_Fault]:
        if edge.name in self._samples:
            return None
        missing = f'There is no {edge.name}.'
        if near := _nearest(edge.name, [name for name in self._samples if name not in FRAMES]):
            misspelt = repr(shortened(near))
            return _Fault(misspelt, missing, f'{misspelt} is misspelt: the name is {edge.name}.')
        return _Fault(f'no {edge.name}', missing, self._cause_of_missing(edge))

    def _cause_of_missing(self, edge: Edge) -> str:
        received = f'No transform of {edge.name} was received'
        if self._recreated:
            return self._recreated
        if edge is not BASE and self._static_joints:
            return self._static_joints
        if all(samples.is_static.all() for samples in self._samples.values()):
            return (f'{received}: nothing arrives on /tf. Is the timer created, with its period '
                    'in seconds, and does rclpy.spin run?')
        if self._repeated:
            return (f'{shortened(self._repeated)} is in one message more than once: create a new '
                    'TransformStamped for each frame.')
        if self._others:
            return f'{received}, but of other frames: {comma_list(self._others, _SHOWN)}.'
        if edge is BASE:
            return (f'{received}: send it with StaticTransformBroadcaster, and keep the node '
                    'running. What TransformBroadcaster sends once does not reach later '
                    'listeners.')
        return f'{received}.'

    def _sent_twice(self, edge: Edge) -> Optional[_Fault]:
        name, samples = edge.name, self._samples[edge.name]
        if not samples.is_published_twice():
            return None
        return _Fault(f'{name} from {len(set(samples.publishers))} publishers',
                      f'{name} has several publishers.',
                      self._recreated or self._two_programs(name) or
                      f'Two publishers send {name} at the same time: two programs, nodes or '
                      'broadcasters. Only one may send it.')

    def _on_both_topics(self, edge: Edge) -> Optional[_Fault]:
        name, is_static = edge.name, self._samples[edge.name].is_static
        return _Fault(
            f'{name} on /tf and /tf_static', f'{name} is on both topics.',
            f'{name} is sent on /tf and on /tf_static; only one of them is right.'
        ) if edge is not BASE and is_static.any() and not is_static.all() else None

    def _wrong_parent(self, edge: Edge) -> Optional[_Fault]:
        name, found = edge.name, [*self._samples[edge.name].parents]
        if found == [edge.parent]:
            return None
        parents = comma_list([*map(shortened, found)], _SHOWN)
        if len(found) > 1:
            cause = f'{name} has several parents; only {edge.parent} is right.'
        elif parents not in FRAMES and _nearest(edge.parent, found):
            cause = f'{parents!r} is misspelt: the name is {edge.parent}.'
        else:
            cause = f'The parent of {name} must be {edge.parent}, not {parents}.'
        return _Fault(f'{parents} → {name}', f'The parent of {name} is not {edge.parent}.', cause)

    def _star(self, edge: Edge) -> str:
        """Return that most frames have the same parent as a frame; '' if they have not."""
        if edge.name not in self._samples:
            return ''
        (parent, *_) = self._samples[edge.name].parents
        children = [child.name for child in EDGES if child.name in self._samples
                    and parent in self._samples[child.name].parents]
        return (f'The tree is a star: {", ".join(children)} have the same parent. In a chain, the '
                'parent of a frame is the frame before it.') if len(children) > 2 else ''

    @cached_property
    def _static_joints(self) -> str:
        """Which joints are sent as static transforms; '' if none is."""
        names = [joint.name for joint in JOINTS if (samples := self._samples.get(joint.name))
                 and samples.is_static.all()]
        return '' if not names else (
            f'{", ".join(names)} {"are" if len(names) > 1 else "is"} sent with '
            'StaticTransformBroadcaster: send the joints with TransformBroadcaster in a timer.')

    def _two_programs(self, name: str) -> str:
        """Return which copies of a program send a frame; '' if it is not known."""
        gids = {*self._samples[name].publishers}
        nodes = {each.pid: each.node for each in self._publishers if each.pid and each.gid in gids}
        if len(nodes) < 2 or len({*nodes.values()}) > 1:
            return ''
        *old, newest = nodes
        pids = ', '.join(f'PID {pid}' for pid in old)
        return (f'Copies of one program send {name} at the same time: {pids} and PID {newest}. An '
                f'old one still runs: end it (kill {" ".join(map(str, old))}).')

    @cached_property
    def _frames_of(self) -> dict[tuple[bool, str], set[str]]:
        """By topic (True: /tf_static) and publisher: the frames that it has sent."""
        frames: dict[tuple[bool, str], set[str]] = {
            (each.is_static, each.gid): set() for each in self._publishers}
        for name, samples in self._samples.items():
            for key in {*zip(samples.is_static.tolist(), samples.publishers)}:
                frames.setdefault(key, set()).add(name)
        return frames

    @cached_property
    def _recreated(self) -> str:
        """That a program creates a broadcaster again and again; '' if none does."""
        nodes = {each.gid: (each.node, each.pid) for each in self._publishers}
        groups: defaultdict[Any, dict[str, set[str]]] = defaultdict(dict)
        for (is_static, gid), frames in self._frames_of.items():
            groups[is_static, nodes.get(gid)][gid] = frames
        for (_, node), publishers in groups.items():
            if found := recreated(publishers):
                where = ', from one node' if node else ''
                return (f'{len(found)} publishers, one after another{where}: create the '
                        'broadcaster once, not in the callback of the timer.')
        return ''

    def _stamps(self) -> _Result:
        """Judge the stamps of all transforms on /tf."""
        known = {name: samples for name, samples in self._moving.items() if samples.times.all()}
        if not known:
            raise _NotJudged('The bag has no times.' if self._moving else
                             'No transform of the arm is on /tf.')
        results = []
        for name, samples in known.items():
            if result := _fault_of_stamps(name, samples.stamps, samples.delays):
                self._faults[name, _STAMPS] = f'The stamps of {name} are wrong.'
                results.append(result)
        largest = max(abs(float(np.median(samples.delays))) for samples in known.values())
        return results[0] if results else (f'{largest * 1e3:.1f} ms from the time of arrival', '')

    # base_link and end_effector

    def _base_on_tf_static(self) -> _Result:
        is_static = self._right(BASE.name).is_static
        if is_static.all():
            return '/tf_static', ''
        return 'on both' if is_static.any() else '/tf', (
            'map → base_link is sent on /tf: use StaticTransformBroadcaster, which sends on '
            '/tf_static.')

    def _base_at_origin(self) -> _Result:
        samples = self._right(BASE.name)
        position = _farthest(samples.positions, BASE.position)
        measured = _metres(position)
        if (angle := _largest_angle(samples.rotations[:, :3])) > _ROTATION_TOLERANCE:
            return f'{measured}, rotated by {_degrees(angle)}', (
                _WRONG_ORDER if samples.has_wrong_order() else
                'base_link must not be rotated in map: the quaternion is (0, 0, 0, 1).')
        return measured, '' if _is_near(position, BASE.position) else (
            'The translation of base_link in map must be (0, 0, 0).')

    def _late_joiner(self) -> _Result:
        samples = self._right(BASE.name)
        if self._reaches_late_joiners is None:
            raise _NotJudged('This was not observed.')
        if not samples.is_static.any():
            raise _NotJudged('base_link is not on /tf_static.')
        if self._reaches_late_joiners:
            return 'received', ''
        return 'not received', (
            'A listener that starts now does not receive base_link: keep the node and its '
            'StaticTransformBroadcaster as long as the program runs.')

    def _hand(self) -> _Result:
        samples = self._right(HAND.name)
        if HAND.name in self._moving and (silence := self._silence(HAND.name)):
            return '', silence
        rotations = samples.rotations
        # The angle between two rotations is 2 acos(|q1 · q2|); the absolute value, because q and
        # -q are the same rotation.
        angle = 2 * float(np.arccos(min(1.0, abs(rotations @ rotations[0]).min())))
        if abs(rotations[:, 3]).max() < _ROTATION_TOLERANCE:
            return 'rotated by 180.0°', _WRONG_ORDER
        if angle < _ROTATION_TOLERANCE:
            return 'fixed', ''
        return f'turns by {_degrees(angle)}', (
            'end_effector must not rotate in joint_3: always send (0, 0, 0, 1).')

    # Positions and joints

    def _position(self, edge: Edge) -> _Result:
        positions = self._right(edge.name).positions
        position = _farthest(positions, edge.position)
        if _is_near(position, edge.position):
            return _metres(position), ''
        if np.ptp(positions, axis=0).max() > _POSITION_TOLERANCE:
            return _metres(position), (
                f'The position of {edge.name} changes. Only its rotation may change: the rotation '
                f'of {edge.parent} already moves {edge.name}.')
        return _metres(position), _cause_of_position(edge, position)

    def _axis(self, joint: Edge) -> _Result:
        samples = self._right(joint.name)
        rotations = samples.rotations
        x, y, z = abs(rotations[:, :3]).max(axis=0)
        if _largest_angle(rotations[:, :2]) <= _ROTATION_TOLERANCE:
            return 'about z' if z > 1e-6 else 'no rotation', ''
        self._faults[joint.name, _AXIS] = f'{joint.name} does not turn about z only.'
        # The vector part of the quaternion is sin(angle / 2) times the axis.
        axes = ' and '.join(axis for axis, part in zip('xyz', (x, y, z))
                            if part > _ROTATION_TOLERANCE / 4)
        if samples.has_wrong_order():
            cause = _WRONG_ORDER
        elif axes in ('x', 'y'):
            cause = (f'{joint.name} turns about {axes}: in (x, y, z, w), z is sin(angle / 2), and '
                     'in quaternion_from_euler(roll, pitch, yaw), yaw is the angle about z.')
        else:
            cause = f'{joint.name} must turn about z only: x and y of its quaternion are 0.'
        return f'about {axes}', cause

    def _motion(self, joint: Edge) -> _Result:
        samples = self._right(joint.name, _AXIS)
        span = float(np.ptp(samples.angles))
        self._faults[joint.name, _MOTION] = f'{joint.name} does not move.'
        if samples.is_static.all():
            return 'on /tf_static', self._static_joints
        if silence := self._silence(joint.name):
            self._faults[joint.name, _MOTION] = f'{joint.name} is not sent all the time.'
            return '', silence
        measured = f'by {_degrees(span)}'
        if span >= _SMALLEST_MOTION:
            del self._faults[joint.name, _MOTION]
            return measured, ''
        return measured, (
            f'{joint.name} hardly moves: {_UNIT_OF_TIME} Or is a limit or a speed converted from '
            'degrees to radians twice?' if span > 0.0 else
            f'The angle of {joint.name} does not change: compute it in the callback of the timer, '
            'from the current time.')

    def _silence(self, name: str) -> str:
        """Return that a frame on /tf is sent too rarely, or not any more; '' if it is not."""
        samples = self._samples[name]
        silence = self._end - samples.times[-1]
        if len(samples.times) == 1:
            cause = (f'{name} was sent only once: send it in a timer; the period is in seconds, '
                     'such as 0.02.')
        elif samples.interval >= _LONG_PERIOD:
            cause = _cause_of_interval(name, samples.interval)
        elif silence >= _SILENCE:
            cause = (f'{name} has not been sent for the last {silence:.1f} s: send it as long as '
                     'the program runs.')
        else:
            return ''
        return self._recreated or cause

    def _limit(self, joint: Edge) -> _Result:
        angles = self._right(joint.name, _AXIS, _MOTION).angles
        largest = float(abs(angles).max())
        measured = f'{_degrees(float(angles.min()))} to {_degrees(float(angles.max()))}'
        if largest <= joint.limit + _LIMIT_TOLERANCE:
            return measured, ''
        if largest > radians(170) or np.ptp(np.unwrap(angles)) > 2 * pi:
            self._faults[joint.name, _TURNS] = f'{joint.name} turns all the way round.'
            return measured, (
                'The joint turns all the way round: the angle is in degrees where radians are '
                'needed, or it has no sine. Write radians(limit) * sin(speed * t).')
        return measured, _cause_of_excess(joint, largest)

    def _sine(self, joint: Edge) -> _Result:
        times, angles, sine = self._fitted(
            joint, self._right(joint.name, _AXIS, _MOTION, _TURNS, _STAMPS))
        is_sine = sine.residual < _LARGEST_RESIDUAL
        if is_sine:
            self._sines[joint.name] = sine
        if sine.periods < _SHORTEST_WAVE:
            raise _NotJudged(f'{times[-1]:.1f} s are less than a period: observe the arm longer '
                             '(--time).', f'{sine.periods:.2f} periods')
        return (f'differs by {100 * sine.residual:.1f} % of the amplitude',
                '' if is_sine else _cause_of_wave(joint, times, angles, sine))

    def _fitted(self, joint: Edge, samples: _Samples) -> tuple[Floats, Floats, Sine]:
        """Fit against the stamps or, if that fits better, the number of the message (s)."""
        usable = (samples.times == 0) | (abs(samples.delays) < _LARGEST_DELAY)
        stamps = samples.stamps[usable]
        if len(stamps) < FEWEST or np.ptp(stamps) < SECOND:
            raise _NotJudged(self._recreated or (
                f'{len(stamps)} transforms are too few to see a wave.' if samples.interval < 1.0
                else _cause_of_interval(joint.name, samples.interval)))
        order = np.argsort(stamps, kind='stable')
        times = (stamps[order] - stamps.min()) / SECOND
        angles = np.unwrap(samples.angles[usable][order])
        sine = fit_sine(times, angles)
        ticks = samples.ticks
        if sine.residual >= _LARGEST_RESIDUAL and ticks[-1] >= 1.0:
            fixed = fit_sine(ticks, np.unwrap(samples.angles))
            if fixed.residual < sine.residual:
                self._has_fixed_step |= fixed.residual < _LARGEST_RESIDUAL
                return ticks, np.unwrap(samples.angles), fixed
        return times, angles, sine

    def _speeds(self) -> _Result:
        for joint in JOINTS:
            sine = self._sines.get(joint.name)
            if sine and sine.periods < _SLOW and sine.span >= _LONG_ENOUGH:
                return f'{joint.name}: less than {sine.speed:.2g} rad/s', (
                    f'{joint.name} is much too slow: {_UNIT_OF_TIME} Or is the speed converted? '
                    f'About {joint.speed} rad/s is in radians already: do not convert it.')
            if not sine or sine.periods < _SHORTEST_WAVE:
                raise _NotJudged(f'The speed of {joint.name} cannot be measured.')
        speeds, reading = self._speeds_and_reading()
        measured = f'{", ".join(f"{speed:.2f}" for speed in speeds)} rad/s ({reading})'
        if _are_in_order(speeds):
            self._speeds_found = speeds
            return measured, ''
        for (first, speed), (second, other) in combinations(zip(JOINTS, speeds), 2):
            if max(speed, other) < _DIFFERENT * min(speed, other):
                return measured, f'{first.name} and {second.name} have the same speed.'
        for speed, joint in reversed([*zip(speeds, JOINTS)]):
            if speed > _OTHER_UNIT * joint.speed:
                return measured, f'{joint.name} is much too fast: {_UNIT_OF_TIME}'
        return measured, ('The order of the speeds is wrong: joint_1 is the slowest, joint_3 is '
                          'the fastest.')

    def _speeds_and_reading(self) -> tuple[list[float], str]:
        """Return the speeds of the joints (rad/s), and what they are."""
        # The speed on the sheet can be that of the phase, or the largest one that a joint reaches.
        sines = [self._sines[joint.name] for joint in JOINTS]
        phase, largest = [sine.speed for sine in sines], [sine.fastest for sine in sines]
        if _are_in_order(largest) and _deviation(largest) < _deviation(phase):
            return largest, 'largest speed'
        return phase, 'phase'

    # Good practice

    def _advice(self) -> Iterator[tuple[str, str, bool, str]]:
        """Yield each practice, what was measured ('': nothing), if it is followed, and advice."""
        rates = {name: rate for name, samples in self._moving.items()
                 if (rate := _rate(samples.times)) is not None}
        name, rate = min(rates.items(), key=itemgetter(1), default=('', 0.0))
        yield ('at least 10 messages per second', f'{rate:.1f} Hz' if rates else '',
               rate >= _LOWEST_RATE,
               f'{name} is sent {rate:.1f} times a second: its motion does not look smooth.')
        is_by = 'number of the message' if self._has_fixed_step else 'time'
        yield ('the motion follows the clock', f'a sine of the {is_by}' if self._sines else '',
               not self._has_fixed_step,
               'Use the clock: with a fixed step, the speed depends on the rate.')
        stamps = [set(samples.stamps.tolist()) for samples in self._moving.values()]
        same = len(set.intersection(*stamps)) / max(map(len, stamps)) if stamps else 0.0
        yield ('all frames have the same stamp',
               f'{100 * same:.0f} % of the ticks' if len(stamps) > 1 else '', same >= _SAME_STAMP,
               'Call get_clock().now() once in each tick, and use it for all frames.')
        used = {joint.name: float(abs(self._samples[joint.name].angles).max()) / joint.limit
                for joint in JOINTS if not self._why_not(joint.name, _AXIS, _MOTION, _TURNS)}
        name, part = min(used.items(), key=itemgetter(1), default=('', 0.0))
        yield ('the joints use at least half of their limits',
               ', '.join(f'{100 * each:.0f} %' for each in used.values()), part >= _USED,
               f'{name} uses only {100 * part:.0f} % of its limit.')
        is_known = {gid for _, gid in self._frames_of} - {NOT_RECORDED, ''}
        yield ('each broadcaster is created once',
               (self._recreated.partition(':')[0] or f'{len(self._frames_of)} publishers')
               if is_known else '', not self._recreated, self._recreated)
        yield ('no other frames on /tf and /tf_static',
               f'{len(self._others)} other frames' if self._samples else '', not self._others,
               f'Other frames: {comma_list(self._others, _SHOWN)}.')
        speeds = self._speeds_found
        yield ('speeds of about 0.3, 0.5 and 0.7 rad/s',
               ', '.join(f'{speed:.2f}' for speed in speeds),
               all(1 / _SPEED_FACTOR <= speed / joint.speed <= _SPEED_FACTOR
                   for speed, joint in zip(speeds, JOINTS)),
               'The sheet says 0.3, 0.5 and 0.7 rad/s. Is the time in seconds?')


def _judged(requirement: str, judge: Callable[[], _Result]) -> Line:
    try:
        measured, cause = judge()
    except _NotJudged as reason:
        return Line(requirement, reason.measured, NOT_JUDGED, reason.why)
    return Line(requirement, measured, NOT_OK if cause else OK, cause)


def _advised(practice: str, measured: str, is_followed: bool, text: str) -> Line:
    if not measured:
        return Line(practice, '', NOT_JUDGED, 'It cannot be measured.')
    return Line(practice, measured, OK) if is_followed else Line(practice, measured, ADVICE, text)


def _fault_of_numbers(name: str, poses: Floats) -> Optional[_Result]:
    if not np.isfinite(poses).all():
        return 'nan or inf', (f'{name} has a number that is not finite; tf2 ignores such a '
                              'transform.')
    norms = np.linalg.norm(poses[:, 3:], axis=1)
    if abs(norms ** 2 - 1).max() < _NORM_TOLERANCE:
        return None
    norm = norms[abs(norms - 1).argmax()]
    return f'norm {norm:.2f}', (
        f'All four numbers of the quaternion of {name} are 0: for no rotation, w is 1.'
        if norm < 0.01 else
        f'The quaternion of {name} does not have the norm 1: z and w are the sine and the cosine '
        'of the same angle, half of the joint angle.')


def _fault_of_stamps(name: str, stamps: np.ndarray[Any, Any], delays: Floats
                     ) -> Optional[_Result]:
    is_wrong = abs(delays) >= _LARGEST_DELAY
    has_whole_seconds = len(stamps) > 1 and not (stamps % SECOND).any()
    if is_wrong.mean() <= _DELAYED and not has_whole_seconds:
        return None
    now = 'write header.stamp = self.get_clock().now().to_msg()'
    if not stamps.any():
        return f'{name}: 0', f'The stamp of {name} is not set: {now}.'
    if is_frozen(int(stamps.min()), int(stamps.max()), len(stamps)):
        return f'{name}: always the same', (f'The stamp of {name} is set only once: {now} before '
                                            'each sendTransform.')
    if has_whole_seconds:
        return f'{name}: whole seconds', f'The stamp of {name} has no nanoseconds: {now}.'
    delay = float(np.median(delays[is_wrong]))
    return (f'{name}: {abs(delay):.3g} s {"old" if delay > 0 else "in the future"}',
            f'The stamp of {name} is not the current time: {now}.')


def _cause_of_position(edge: Edge, position: _Vector) -> str:
    """Return the likely cause of a wrong position that does not change."""
    length = max(edge.position)
    if abs(float(np.linalg.norm(position)) - length) <= _POSITION_TOLERANCE:
        return f'The distance is right, but not the direction: {edge.name} is {edge.place}.'
    for other in EDGES[1:]:
        if _is_near(position, other.position):
            return f'This is the position of {other.name}: the positions are at the wrong frames.'
    from_base = np.sum([other.position for other in EDGES[:EDGES.index(edge) + 1]], axis=0)
    if _is_near(position, from_base):
        return (f'This is the position in base_link. A transform has the position in the parent, '
                f'which is {edge.parent}.')
    for factor, unit in (1000.0, 'millimetres'), (100.0, 'centimetres'):
        if _is_near(position, np.multiply(factor, edge.position)):
            return f'The position is in {unit}; TF uses metres.'
    if not any(position):
        return f'The position of {edge.name} is not set.'
    return f'The translation of {edge.name} must be {_metres(edge.position)}.'


def _cause_of_excess(joint: Edge, largest: float) -> str:
    """Return the likely cause if the largest angle of a joint exceeds its limit."""
    excess = f'The limit is exceeded by {_degrees(largest - joint.limit)}'
    is_double = abs(largest / joint.limit - 2) < 0.04
    if others := [other.name for other in JOINTS if other is not joint
                  and abs(largest - other.limit) < radians(0.5)]:
        cause = f'{excess}: this is the limit of {others[0]}.'
        return f'{cause} {_HALF_ANGLE}' if is_double else cause
    if is_double:
        return f'{excess}: the angle is twice as large as it should be. {_HALF_ANGLE}'
    if largest - joint.limit < radians(1.0):
        return f'{excess}: is the limit rounded, or does the last step go beyond it?'
    return (f'{excess}. The amplitude of the sine, plus an offset if there is one, must be at '
            f'most {degrees(joint.limit):.0f}°.')


def _cause_of_interval(name: str, interval: float) -> str:
    return (f'{name} is sent every {interval:.3g} s: is the period of the timer in seconds, such '
            'as 0.02?')


def _cause_of_wave(joint: Edge, times: Floats, angles: Floats, sine: Sine) -> str:
    """Return the likely cause if the motion of a joint is not a sine."""
    too_fast = f'{joint.name} moves too fast to see a wave: {_UNIT_OF_TIME}'
    if sine.speed > 0.9 * FASTEST:
        return too_fast
    low, high = float(angles.min()), float(angles.max())
    at_ends = np.mean((angles > high - 0.01 * (high - low)) | (angles < low + 0.01 * (high - low)))
    if at_ends > 0.2:  # for a sine, it is 0.13
        return (f'{joint.name} rests at {_degrees(high)} or {_degrees(low)}: the wave is clipped. '
                'Do not cut the angle off; the amplitude of the sine is the limit.')
    phase = sine.speed * times + sine.phase
    triangle = np.column_stack([np.ones_like(times), np.arcsin(np.sin(phase))])
    if fit(triangle, angles)[1] / sine.amplitude < sine.residual / 2:
        return (f'{joint.name} moves at a constant speed to and fro, which is a triangle wave: '
                'the angle is limit * sin(speed * t).')
    steps = abs(np.diff(angles)) / (high - low)
    if sine.speed > _OTHER_UNIT * joint.speed or (
            sine.residual > 1.0 and np.median(steps) > _LARGE_STEP):
        return too_fast
    if steps.max() > 0.3:
        return f'The angle of {joint.name} jumps: it must change smoothly.'
    return f'The angle of {joint.name} is not a sine of the time: it is limit * sin(speed * t).'


def _are_in_order(speeds: list[float]) -> bool:
    """Return whether each speed is higher than the one before, and not nearly the same."""
    return all(speed * _DIFFERENT <= following for speed, following in pairwise(speeds))


def _deviation(speeds: list[float]) -> float:
    """Return how far the speeds of the joints are from the sheet, on a logarithmic scale."""
    # A common factor, as from a wrong unit of time, counts once: it does not change which reading
    # of the sheet fits.
    logarithms = [log(speed / joint.speed) for speed, joint in zip(speeds, JOINTS)]
    common = sorted(logarithms)[1]
    return abs(common) + sum(abs(each - common) for each in logarithms)


def _nearest(name: str, others: Sequence[str]) -> str:
    """Return the name that is probably a misspelling of a frame's name; '' if there is none."""
    # The names of the joints differ in one digit only, so a similar name must have the same digit.
    digits = [character for character in name if character.isdigit()]
    candidates = [other for other in others
                  if [character for character in other if character.isdigit()] == digits]
    return next(iter(near_names(name, candidates, 0.75)), '')


def _name(name: str) -> str:
    return name.removeprefix('/')


def _farthest(positions: Floats, expected: _Vector) -> _Vector:
    """Return the position that is the farthest from the expected one."""
    x, y, z = positions[np.linalg.norm(positions - expected, axis=1).argmax()].tolist()
    return x, y, z


def _is_near(position: _Vector, expected: ArrayLike) -> bool:
    return bool(np.linalg.norm(np.subtract(position, expected)) <= _POSITION_TOLERANCE)


def _largest_angle(vectors: Floats) -> float:
    """Return the largest angle (rad), from vector parts of quaternions: axis * sin(angle / 2)."""
    return 2 * asin(min(1.0, float(np.linalg.norm(vectors, axis=1).max())))


def _metres(position: _Vector) -> str:
    return f'({", ".join(f"{value + 0.0:.3f}" for value in position)}) m'


def _degrees(angle: float) -> str:
    return f'{degrees(angle):.1f}°'


def _rate(times: Floats) -> Optional[float]:
    """Return the average rate of messages (Hz), from their times (s); None if it is not known."""
    span = times[-1] - times[0]
    return (len(times) - 1) / span if span > 0.0 else None
