"""
The requirements of the lab's final task, and the check whether the transforms of an arm meet them.

The check needs no ROS: its input is a list of received or recorded messages.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from functools import cached_property
from itertools import combinations, groupby, pairwise
from math import asin, degrees, hypot, log, pi, radians
from operator import itemgetter
from typing import Any, NamedTuple, Optional

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dummy_arm.inspection.diagnosis import recreated
from dummy_arm.tf.bag import NOT_RECORDED
from dummy_arm.tf.formatting import (
    comma_list,
    match_candidates,
    SECOND,
    shortened,
)

#: The states of a line of the table.
OK, NOT_OK, NOT_JUDGED, ADVICE = 'ok', 'not ok', 'not judged', 'advice'

#: How far a position may be from the required position (m), and how far a frame may be rotated
#: about an axis about which it must not rotate (rad).
_POSITION_TOLERANCE, _ROTATION_TOLERANCE = 1e-3, radians(0.1)
#: How far an angle may exceed its limit (rad): the rounding of a program's own constants.
_LIMIT_TOLERANCE = radians(0.05)
#: A joint that turns by less than this angle (rad) does not move.
_SMALLEST_MOTION = radians(3.0)
#: The largest root mean square of the residuals of a sine, in relation to its amplitude. For the
#: best fit to a triangle wave, this ratio is 0.08.
_LARGEST_RESIDUAL = 0.02
#: The part of a period that must be observed to judge a wave. It leaves 8 of 25 s to the pauses of
#: a busy machine. For a triangle wave, the ratio above is still 0.076.
_SHORTEST_WAVE = 0.8
#: A joint of which less than this part of a period is observed in this time (s) is too slow.
_SLOW, _LONG_ENOUGH = 0.3, 15.0
#: The smallest number of samples that show a wave.
_FEWEST = 20
#: If nothing was received for this time (s) at the end of an observation, a frame is not sent any
#: more. A busy machine stops for less.
_SILENCE = 6.0
#: The period of a timer (s) that is probably meant to be in milliseconds.
_LONG_PERIOD = 5.0
#: The largest angular frequency that is looked for (rad/s); the time at the beginning of an
#: observation in which it is looked for (s), and the largest number of samples that are used.
_FASTEST, _FIRST_WINDOW, _MOST_SAMPLES = 20.0, 60.0, 1000
#: Two speeds are different if their ratio is at least this number.
_DIFFERENT = 1.05
#: A current stamp differs from the time of arrival by less than this time (s). This part of the
#: stamps may differ by more: if the machine stops for some seconds, what was sent then is late.
_LARGEST_DELAY, _DELAYED = 0.5, 0.3
#: tf2's limit for |norm² - 1| of a quaternion.
_NORM_TOLERANCE = 10e-3
#: Good practice: the lowest rate (Hz), the part of a limit that is used, the part of the ticks in
#: which all frames have the same stamp, and the largest factor between a speed and that of the
#: sheet.
_LOWEST_RATE, _USED, _SAME_STAMP, _SPEED_FACTOR = 9.5, 0.49, 0.9, 1.5
#: The largest number of frames that a cause lists.
_SHOWN = 5

#: What can be wrong with a frame, so that other requirements cannot be judged: its transforms, its
#: stamps, its axis, its motion (none), or its turns (all the way round).
_TRANSFORMS, _STAMPS, _AXIS, _MOTION, _TURNS = 'transforms', 'stamps', 'axis', 'motion', 'turns'
_LATE_LISTENER = 'base_link reaches a late listener'

#: A joint that is this many times faster than on the sheet probably has another unit of time. So
#: has one whose usual change between two messages is this part of its range, and no sine.
_OTHER_UNIT, _LARGE_STEP = 10.0, 0.1
#: The mean size of w is larger, unless another number is in its place: a joint turns by ±60° at
#: most, so that w is at least 0.87.
_SMALL_W = 0.4

#: A cause of an angle that is twice as large as it should be.
_HALF_ANGLE = ('In the quaternion, use the half angle: z = sin(angle / 2), w = cos(angle / 2).')
#: A cause of a quaternion that has another number in the place of w.
_WRONG_ORDER = ('Is the order x, y, z, w? In a message, w is the last number; transforms3d has '
                'it first.')
#: A cause of a wrong speed.
_UNIT_OF_TIME = 'is t in seconds? Use .nanoseconds * 1e-9.'

_Vector = tuple[float, float, float]
_Floats = NDArray[np.float64]


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


class Message(NamedTuple):
    """A message that was received or recorded."""

    time: int  #: the time of arrival or of the recording (ns); 0: not known
    is_static: bool  #: True if the message is from /tf_static
    publisher: str  #: an identifier of the publisher
    #: The transforms: `stamp_ns`, `frame_id`, `child_frame_id`, and `pose` (x, y, z in m, then the
    #: quaternion x, y, z, w).
    rows: Sequence[Any]


class Publisher(NamedTuple):
    """A publisher on /tf or /tf_static that has been in the ROS graph during the observation."""

    gid: str  #: as `Message.publisher`
    node: str  #: the full name of its node
    is_static: bool  #: True if it is on /tf_static
    pid: int  #: the process id; 0: not known


class Line(NamedTuple):
    """A line of the table: a requirement, and what was measured."""

    requirement: str
    measured: str
    verdict: str  #: OK, NOT_OK or NOT_JUDGED; ADVICE for good practice that is not followed
    #: A sentence: the likely cause if the verdict is NOT_OK, the reason if it is NOT_JUDGED, and
    #: what to do if it is ADVICE.
    text: str = ''


class Report(NamedTuple):
    """The result of a check."""

    lines: list[Line]  #: the requirements
    advice: list[Line]  #: good practice, which has no influence on `passed`
    #: True if every requirement is met; that of a late listener need not be judged.
    passed: bool

    @property
    def first_failure(self) -> Optional[Line]:
        """The first line with the verdict NOT_OK; if there is none, the first with NOT_JUDGED."""
        if self.passed:
            return None
        return next((line for verdict in (NOT_OK, NOT_JUDGED) for line in self.lines
                     if line.verdict == verdict), None)


class Sine(NamedTuple):
    """A sine with a constant term, fitted to the angles of a joint."""

    amplitude: float  #: rad
    speed: float  #: the angular frequency: the speed of the phase (rad/s)
    phase: float  #: the phase at the first time (rad)
    residual: float  #: the root mean square of the residuals, divided by the amplitude
    periods: float  #: the number of periods between the first and the last time

    @property
    def span(self) -> float:
        """The time from the first to the last angle (s)."""
        return self.periods * 2 * pi / self.speed

    @property
    def fastest(self) -> float:
        """The largest speed of the joint (rad/s)."""
        return self.amplitude * self.speed


def fit_sine(times: _Floats, angles: _Floats) -> Sine:
    """
    Fit c + a sin(speed t) + b cos(speed t) to angles by least squares.

    The speed is searched on a grid, in a window at the beginning. Then it is improved by
    Gauss-Newton steps, as in the four-parameter sine fit of IEEE Std 1057, in windows that grow to
    the whole observation.

    :param times: (n,) times (s), n >= 20, in ascending order.
    :param angles: (n,) angles (rad), which are not all equal.
    :returns: the sine.
    """
    t = times - times[0]
    span, window = t[-1], min(t[-1], max(_FIRST_WINDOW, t[_FEWEST - 1]))
    count = int(np.searchsorted(t, window, 'right'))
    fastest = min(_FASTEST, 0.9 * pi * (count - 1) / window)
    grid = np.arange(pi / (4 * window), fastest, pi / (4 * window))
    step = -(-count // _MOST_SAMPLES)
    first, y = t[:count:step], angles[:count:step]
    speed = float(grid[np.argmin([_linear_fit(first, y, each)[1] for each in grid])])
    while True:
        speed = _improved(t[:count:step], angles[:count:step], speed, pi / (4 * window), fastest)
        if window == span:
            break
        window = min(4 * window, span)
        count = int(np.searchsorted(t, window, 'right'))
        step = -(-count // _MOST_SAMPLES)
    (_, a, b), residual = _linear_fit(t, angles, speed)
    amplitude = max(hypot(a, b), 1e-12)
    return Sine(amplitude, speed, float(np.arctan2(b, a)), residual / amplitude,
                speed * span / (2 * pi))


def _improved(t: _Floats, y: _Floats, speed: float, step: float, fastest: float) -> float:
    """Return the speed after Gauss-Newton steps, each of which is at most `step` (rad/s)."""
    for _ in range(10):
        (_, a, b), _ = _linear_fit(t, y, speed)
        sine, cosine = np.sin(speed * t), np.cos(speed * t)
        columns = np.column_stack([np.ones_like(t), sine, cosine, t * (a * cosine - b * sine)])
        change = float(_fit(columns, y)[0][3])
        speed = min(max(speed + min(max(change, -step), step), step / 2), fastest)
    return speed


def _linear_fit(t: _Floats, y: _Floats, speed: float) -> tuple[_Floats, float]:
    """Return c, a, b of the best sine of this speed, and the root mean square of its residuals."""
    return _fit(np.column_stack([np.ones_like(t), np.sin(speed * t), np.cos(speed * t)]), y)


def _fit(columns: _Floats, y: _Floats) -> tuple[_Floats, float]:
    """Return the least-squares coefficients, and the root mean square of the residuals."""
    found = np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0], np.float64)
    return found, float(np.sqrt(np.mean((columns @ found - y) ** 2)))


class _Samples:
    """The transforms of one frame, in the order of their arrival."""

    def __init__(self, rows: list[tuple[Message, Any]]) -> None:
        """
        Collect the transforms.

        :param rows: the transforms, each with its message.
        """
        self.parents = {_name(row.frame_id): None for _, row in rows}  # in order of appearance
        self.is_static = np.array([message.is_static for message, _ in rows])
        self.poses = np.array([row.pose for _, row in rows], float)
        self.publishers = [message.publisher for message, _ in rows]
        moving = [(message, row) for message, row in rows if not message.is_static]
        #: Of the transforms on /tf: the times of arrival (s; 0: not known) and the stamps (ns).
        self.times = np.array([message.time / SECOND for message, _ in moving])
        self.stamps = np.array([row.stamp_ns for _, row in moving], np.int64)

    @property
    def delays(self) -> _Floats:
        """The times from the stamps to the arrivals (s) of the transforms on /tf."""
        return np.asarray(self.times - self.stamps / SECOND)

    @property
    def interval(self) -> float:
        """The median time from one transform on /tf to the next one (s)."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0

    @property
    def ticks(self) -> _Floats:
        """The numbers of the stamps on /tf, times the median interval of the stamps (s)."""
        steps = np.diff(self.stamps)
        is_new = steps != 0
        interval = np.median(abs(steps[is_new])) / SECOND
        return np.asarray(np.append(0, np.cumsum(is_new)) * interval)

    @property
    def positions(self) -> _Floats:
        """(n, 3): the positions (m)."""
        return self.poses[:, :3]

    @cached_property
    def rotations(self) -> _Floats:
        """(n, 4): the unit quaternions x, y, z, w."""
        quaternions = self.poses[:, 3:]
        return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1)[:, None])

    @cached_property
    def angles(self) -> _Floats:
        """(n,): the angles about z (rad), from -pi to pi."""
        angles = 2 * np.arctan2(self.rotations[:, 2], self.rotations[:, 3])
        return np.asarray((angles + pi) % (2 * pi) - pi)

    def has_wrong_order(self) -> bool:
        """Return whether another number is probably in the place of w."""
        return float(abs(self.rotations[:, 3]).mean()) < _SMALL_W

    def is_published_twice(self) -> bool:
        """
        Return whether two publishers send the frame on one topic at the same time.

        If each publisher begins after the one before it has ended, as when a program is started
        again, the messages of each publisher are one group. If they send at the same time, there
        are more groups than publishers.
        """
        return any(
            len([*groupby(names)]) > len(set(names)) for names in (
                [name for name, is_static in zip(self.publishers, self.is_static)
                 if is_static == topic] for topic in (False, True)))


def _name(name: str) -> str:
    return name.removeprefix('/')


class _Check:
    """The check of one arm."""

    def __init__(self, messages: Iterable[Message], reaches_late_joiners: Optional[bool],
                 end: Optional[int], publishers: Sequence[Publisher]) -> None:
        """Sort the transforms by frames; the arguments are those of `check`."""
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
        #: The end of the observation (s).
        times = [samples.times[-1] for samples in self._samples.values() if len(samples.times)]
        self._end = max(times, default=0.0) if end is None else end / SECOND
        #: The frames of the arm that are on /tf, in the order of the chain.
        self._moving = {edge.name: samples for edge in EDGES
                        if (samples := self._samples.get(edge.name)) and len(samples.times)}
        #: By frame and by what is wrong with it: a sentence. A method that judges a requirement
        #: adds what it finds; the methods after it in `_lines` then do not judge what depends on
        #: it.
        self._faults: dict[tuple[str, str], str] = {}
        #: The sines that fit the angles, by joint; also those that are too short to be judged.
        self._sines: dict[str, Sine] = {}
        #: True if a joint moves as a sine of the number of the message, and not of the time.
        self._has_fixed_step = False
        #: The speeds of the joints (rad/s), if they are as required.
        self._speeds_found: list[float] = []

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
        """Return that a program creates a broadcaster again and again; '' if none does."""
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

    def report(self) -> Report:
        """Judge all requirements."""
        lines = [*self._lines()]
        is_late_known = self._reaches_late_joiners is not None
        passed = all(line.verdict == OK for line in lines
                     if is_late_known or line.requirement != _LATE_LISTENER)
        return Report(lines, [*self._advice()], passed)

    def _why_not(self, name: str, *kinds: str) -> str:
        """
        Return why a requirement for a frame cannot be judged; '' if it can be judged.

        :param name: the frame.
        :param kinds: what must be right to judge the requirement.
        """
        if not self._samples:
            return 'There are no transforms.'
        reasons = (self._faults.get((name, kind), '') for kind in kinds)
        return next(filter(None, reasons), '')

    def _lines(self) -> Iterator[Line]:
        yield self._validity()
        yield self._tree()
        yield self._stamps()
        yield self._base_on_tf_static()
        yield self._base_at_origin()
        yield self._late_joiner()
        yield from map(self._position, EDGES[1:])
        for method in self._axis, self._motion, self._limit, self._sine:
            yield from map(method, JOINTS)
        yield self._speeds()
        yield self._hand()

    # Transforms and tree

    def _validity(self) -> Line:
        """Judge the numbers: tf2 ignores transforms with NaN, and with a quaternion of norm 0."""
        requirement = 'all transforms are valid'
        if not self._samples:
            return Line(requirement, 'no transform', NOT_OK, self._recreated or
                        'Nothing was received on /tf and /tf_static.')
        first: Optional[Line] = None
        for name in (edge.name for edge in EDGES if edge.name in self._samples):
            poses = self._samples[name].poses
            norms = np.linalg.norm(poses[:, 3:], axis=1)
            if not np.isfinite(poses).all():
                measured = 'nan or inf'
                cause = f'{name} has a number that is not finite; tf2 ignores such a transform.'
            elif abs(norms ** 2 - 1).max() >= _NORM_TOLERANCE:
                norm = norms[abs(norms - 1).argmax()]
                measured = f'norm {norm:.2f}'
                cause = (f'All four numbers of the quaternion of {name} are 0: for no rotation, '
                         'w is 1.' if norm < 0.01 else
                         f'The quaternion of {name} does not have the norm 1: z and w are the '
                         'sine and the cosine of the same angle, half of the joint angle.')
            else:
                continue
            self._faults[name, _TRANSFORMS] = f'The transforms of {name} are not valid.'
            first = first or Line(requirement, measured, NOT_OK, cause)
        if first:
            return first
        count = sum(len(samples.poses) for samples in self._samples.values())
        return Line(requirement, f'{count} transforms', OK)

    def _tree(self) -> Line:
        """Judge the names of the frames and of their parents."""
        requirement = 'the tree'
        if why := self._why_not(BASE.parent):
            return Line(requirement, '', NOT_JUDGED, why)
        faults = {edge: fault for edge in EDGES if (fault := self._fault_of_edge(edge))}
        for edge, (_, reason, _) in faults.items():
            self._faults.setdefault((edge.name, _TRANSFORMS), reason)
        if not faults and 'map' in self._samples:
            parents = comma_list([*map(shortened, self._samples['map'].parents)], _SHOWN)
            return Line(requirement, f'{parents} → map', NOT_OK,
                        'map is the root of the tree: it must not have a parent.')
        if not faults:
            return Line(requirement, f'{len(FRAMES)} frames in a chain', OK)
        edge, (measured, _, cause) = next(iter(faults.items()))
        if edge.name in self._samples:
            (parent, *_) = self._samples[edge.name].parents
            children = [child.name for child in EDGES if child.name in self._samples
                        and parent in self._samples[child.name].parents]
            if len(children) > 2:
                cause = (f'The tree is a star: {", ".join(children)} have the same parent. In a '
                         'chain, the parent of a frame is the frame before it.')
        return Line(requirement, measured, NOT_OK, cause)

    def _fault_of_edge(self, edge: Edge) -> Optional[tuple[str, str, str]]:
        """Return what is wrong with an edge: measured, why it cannot be judged, and the cause."""
        name = edge.name
        reverse = self._samples.get(edge.parent)
        if reverse and [*reverse.parents] == [name]:
            return (f'{name} → {edge.parent}', f'The parent of {edge.parent} is {name}.',
                    f'Parent and child are exchanged: {edge.parent} is the frame_id, and {name} '
                    'is the child_frame_id.')
        if name not in self._samples:
            missing = f'There is no {name}.'
            if near := _nearest(name, [other for other in self._samples if other not in FRAMES]):
                return (f'{shortened(near)!r}', missing,
                        f'{shortened(near)!r} is misspelt: the name is {name}.')
            others = [shortened(other) for other in self._samples if other not in FRAMES]
            if self._recreated:
                cause = self._recreated
            elif edge is not BASE and self._static_joints:
                cause = self._static_joints
            elif all(samples.is_static.all() for samples in self._samples.values()):
                cause = (f'No transform of {name} was received: nothing arrives on /tf. Is the '
                         'timer created, with its period in seconds, and does rclpy.spin run?')
            elif self._repeated:
                cause = (f'{shortened(self._repeated)} is in one message more than once: create a '
                         'new TransformStamped for each frame.')
            elif others:
                cause = (f'No transform of {name} was received, but of other frames: '
                         f'{comma_list(others, _SHOWN)}.')
            elif edge is BASE:
                cause = (f'No transform of {name} was received: send it with '
                         'StaticTransformBroadcaster, and keep the node running. What '
                         'TransformBroadcaster sends once does not reach later listeners.')
            else:
                cause = f'No transform of {name} was received.'
            return f'no {name}', missing, cause
        samples = self._samples[name]
        if samples.is_published_twice():
            return (f'{name} from {len(set(samples.publishers))} publishers',
                    f'{name} has several publishers.',
                    self._recreated or self._two_programs(name) or
                    f'Two publishers send {name} at the same time: two programs, nodes or '
                    'broadcasters. Only one may send it.')
        if edge is not BASE and samples.is_static.any() and not samples.is_static.all():
            return (f'{name} on /tf and /tf_static', f'{name} is on both topics.',
                    f'{name} is sent on /tf and on /tf_static; only one of them is right.')
        if [*samples.parents] == [edge.parent]:
            return None
        parents = comma_list([shortened(parent) for parent in samples.parents], _SHOWN)
        measured = f'{parents} → {name}'
        reason = f'The parent of {name} is not {edge.parent}.'
        if len(samples.parents) > 1:
            return measured, reason, f'{name} has several parents; only {edge.parent} is right.'
        if parents not in FRAMES and _nearest(edge.parent, [*samples.parents]):
            return measured, reason, f'{parents!r} is misspelt: the name is {edge.parent}.'
        return measured, reason, f'The parent of {name} must be {edge.parent}, not {parents}.'

    @cached_property
    def _static_joints(self) -> str:
        """Return which joints are sent as static transforms; '' if none is."""
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

    def _stamps(self) -> Line:
        """Judge the stamps of all transforms on /tf."""
        requirement = 'the stamps are the current time'
        known = {name: samples for name, samples in self._moving.items() if samples.times.all()}
        if not known:
            return Line(requirement, '', NOT_JUDGED, 'The bag has no times.' if self._moving else
                        'No transform of the arm is on /tf.')
        faults = [fault for name in known if (fault := self._fault_of_stamps(name))]
        if faults:
            return Line(requirement, faults[0][0], NOT_OK, faults[0][1])
        largest = max(abs(float(np.median(samples.delays))) for samples in known.values())
        return Line(requirement, f'{largest * 1e3:.1f} ms from the time of arrival', OK)

    def _fault_of_stamps(self, name: str) -> Optional[tuple[str, str]]:
        """Return what is wrong with the stamps of a frame: measured, and the cause."""
        stamps, delays = self._moving[name].stamps, self._moving[name].delays
        is_wrong = abs(delays) >= _LARGEST_DELAY
        has_whole_seconds = len(stamps) > 1 and not (stamps % SECOND).any()
        if is_wrong.mean() <= _DELAYED and not has_whole_seconds:
            return None
        self._faults[name, _STAMPS] = f'The stamps of {name} are wrong.'
        now = 'write header.stamp = self.get_clock().now().to_msg()'
        if not stamps.any():
            return f'{name}: 0', f'The stamp of {name} is not set: {now}.'
        if len(stamps) > 1 and (stamps == stamps[0]).all():
            return (f'{name}: always the same', f'The stamp of {name} is set only once: {now} '
                    'before each sendTransform.')
        if has_whole_seconds:
            return (f'{name}: whole seconds', f'The stamp of {name} has no nanoseconds: {now}.')
        delay = float(np.median(delays[is_wrong]))
        age = 'old' if delay > 0 else 'in the future'
        return (f'{name}: {abs(delay):.3g} s {age}',
                f'The stamp of {name} is not the current time: {now}.')

    # base_link

    def _base_on_tf_static(self) -> Line:
        requirement = 'base_link is on /tf_static'
        if why := self._why_not(BASE.name, _TRANSFORMS):
            return Line(requirement, '', NOT_JUDGED, why)
        is_static = self._samples[BASE.name].is_static
        if is_static.all():
            return Line(requirement, '/tf_static', OK)
        return Line(requirement, 'on both' if is_static.any() else '/tf', NOT_OK,
                    'map → base_link is sent on /tf: use StaticTransformBroadcaster, which sends '
                    'on /tf_static.')

    def _base_at_origin(self) -> Line:
        requirement = 'base_link is fixed at the origin of map'
        if why := self._why_not(BASE.name, _TRANSFORMS):
            return Line(requirement, '', NOT_JUDGED, why)
        samples = self._samples[BASE.name]
        position = _farthest(samples.positions, BASE.position)
        angle = _largest_angle(samples.rotations[:, :3])
        measured = _metres(position)
        if angle > _ROTATION_TOLERANCE:
            return Line(requirement, f'{measured}, rotated by {_degrees(angle)}', NOT_OK,
                        _WRONG_ORDER if samples.has_wrong_order() else
                        'base_link must not be rotated in map: the quaternion is (0, 0, 0, 1).')
        if not _is_near(position, BASE.position):
            return Line(requirement, measured, NOT_OK, 'The translation of base_link in map must '
                        'be (0, 0, 0).')
        return Line(requirement, measured, OK)

    def _late_joiner(self) -> Line:
        requirement = _LATE_LISTENER
        if why := self._why_not(BASE.name, _TRANSFORMS):
            return Line(requirement, '', NOT_JUDGED, why)
        if self._reaches_late_joiners is None:
            return Line(requirement, '', NOT_JUDGED, 'A bag does not show this.')
        if not self._samples[BASE.name].is_static.any():
            return Line(requirement, '', NOT_JUDGED, 'base_link is not on /tf_static.')
        if self._reaches_late_joiners:
            return Line(requirement, 'received', OK)
        return Line(requirement, 'not received', NOT_OK,
                    'A listener that starts now does not receive base_link: keep the node and its '
                    'StaticTransformBroadcaster as long as the program runs.')

    # Positions and axes

    def _position(self, edge: Edge) -> Line:
        requirement = f'{edge.name} is {edge.place} from {edge.parent}'
        if why := self._why_not(edge.name, _TRANSFORMS):
            return Line(requirement, '', NOT_JUDGED, why)
        positions = self._samples[edge.name].positions
        position = _farthest(positions, edge.position)
        if _is_near(position, edge.position):
            return Line(requirement, _metres(position), OK)
        if np.ptp(positions, axis=0).max() > _POSITION_TOLERANCE:
            cause = (f'The position of {edge.name} changes. Only its rotation may change: the '
                     f'rotation of {edge.parent} already moves {edge.name}.')
        else:
            cause = _cause_of_position(edge, position)
        return Line(requirement, _metres(position), NOT_OK, cause)

    def _axis(self, joint: Edge) -> Line:
        requirement = f'{joint.name} turns about z only'
        if why := self._why_not(joint.name, _TRANSFORMS):
            return Line(requirement, '', NOT_JUDGED, why)
        samples = self._samples[joint.name]
        rotations = samples.rotations
        x, y, z = abs(rotations[:, :3]).max(axis=0)
        if _largest_angle(rotations[:, :2]) <= _ROTATION_TOLERANCE:
            return Line(requirement, 'about z' if z > 1e-6 else 'no rotation', OK)
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
        return Line(requirement, f'about {axes}', NOT_OK, cause)

    # Motion

    def _motion(self, joint: Edge) -> Line:
        requirement = f'{joint.name} moves'
        if why := self._why_not(joint.name, _TRANSFORMS, _AXIS):
            return Line(requirement, '', NOT_JUDGED, why)
        samples = self._samples[joint.name]
        if samples.is_static.all():
            self._faults[joint.name, _MOTION] = f'{joint.name} does not move.'
            return Line(requirement, 'on /tf_static', NOT_OK, self._static_joints)
        if silence := self._silence(joint.name):
            self._faults[joint.name, _MOTION] = f'{joint.name} is not sent all the time.'
            return Line(requirement, '', NOT_OK, silence)
        span = float(np.ptp(samples.angles))
        measured = f'by {_degrees(span)}'
        if span >= _SMALLEST_MOTION:
            return Line(requirement, measured, OK)
        self._faults[joint.name, _MOTION] = f'{joint.name} does not move.'
        if span > 0.0:
            cause = (f'{joint.name} hardly moves: {_UNIT_OF_TIME} Or is a limit or a speed '
                     'converted from degrees to radians twice?')
        else:
            cause = (f'The angle of {joint.name} does not change: compute it in the callback of '
                     'the timer, from the current time.')
        return Line(requirement, measured, NOT_OK, cause)

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

    def _limit(self, joint: Edge) -> Line:
        requirement = f'{joint.name} stays within ±{degrees(joint.limit):.0f}°'
        if why := self._why_not(joint.name, _TRANSFORMS, _AXIS, _MOTION):
            return Line(requirement, '', NOT_JUDGED, why)
        angles = self._samples[joint.name].angles
        largest = float(abs(angles).max())
        measured = f'{_degrees(float(angles.min()))} to {_degrees(float(angles.max()))}'
        if largest <= joint.limit + _LIMIT_TOLERANCE:
            return Line(requirement, measured, OK)
        excess = f'The limit is exceeded by {_degrees(largest - joint.limit)}'
        is_double = abs(largest / joint.limit - 2) < 0.04
        if largest > radians(170) or np.ptp(np.unwrap(angles)) > 2 * pi:
            self._faults[joint.name, _TURNS] = f'{joint.name} turns all the way round.'
            cause = ('The joint turns all the way round: the angle is in degrees where radians '
                     'are needed, or it has no sine. Write radians(limit) * sin(speed * t).')
        elif others := [other.name for other in JOINTS if other is not joint
                        and abs(largest - other.limit) < radians(0.5)]:
            cause = f'{excess}: this is the limit of {others[0]}.'
            if is_double:
                cause += f' {_HALF_ANGLE}'
        elif is_double:
            cause = f'{excess}: the angle is twice as large as it should be. {_HALF_ANGLE}'
        elif largest - joint.limit < radians(1.0):
            cause = f'{excess}: is the limit rounded, or does the last step go beyond it?'
        else:
            cause = (f'{excess}. The amplitude of the sine, plus an offset if there is one, must '
                     f'be at most {degrees(joint.limit):.0f}°.')
        return Line(requirement, measured, NOT_OK, cause)

    def _sine(self, joint: Edge) -> Line:
        requirement = f'{joint.name} moves as a sine'
        if why := self._why_not(joint.name, _TRANSFORMS, _AXIS, _MOTION, _TURNS, _STAMPS):
            return Line(requirement, '', NOT_JUDGED, why)
        samples = self._samples[joint.name]
        usable = (samples.times == 0) | (abs(samples.delays) < _LARGEST_DELAY)
        stamps = samples.stamps[usable]
        if len(stamps) < _FEWEST or np.ptp(stamps) < SECOND:
            return Line(requirement, '', NOT_JUDGED, self._recreated or (
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
                times, angles, sine = ticks, np.unwrap(samples.angles), fixed
                self._has_fixed_step |= sine.residual < _LARGEST_RESIDUAL
        if sine.residual < _LARGEST_RESIDUAL:
            self._sines[joint.name] = sine
        if sine.periods < _SHORTEST_WAVE:
            return Line(requirement, f'{sine.periods:.2f} periods', NOT_JUDGED,
                        f'{times[-1]:.1f} s are less than a period: observe the arm longer '
                        '(--time).')
        measured = f'differs by {100 * sine.residual:.1f} % of the amplitude'
        if sine.residual < _LARGEST_RESIDUAL:
            return Line(requirement, measured, OK)
        return Line(requirement, measured, NOT_OK, _cause_of_wave(joint, times, angles, sine))

    def _speeds(self) -> Line:
        requirement = 'the joints have three different speeds'
        for joint in JOINTS:
            sine = self._sines.get(joint.name)
            if sine and sine.periods < _SLOW and sine.span >= _LONG_ENOUGH:
                return Line(requirement, f'{joint.name}: less than {sine.speed:.2g} rad/s', NOT_OK,
                            f'{joint.name} is much too slow: {_UNIT_OF_TIME} Or is the speed '
                            f'converted? About {joint.speed} rad/s is in radians already: do not '
                            'convert it.')
            if not sine or sine.periods < _SHORTEST_WAVE:
                return Line(requirement, '', NOT_JUDGED,
                            f'The speed of {joint.name} cannot be measured.')
        speeds, reading = self._speeds_and_reading()
        measured = f'{", ".join(f"{speed:.2f}" for speed in speeds)} rad/s ({reading})'
        if _are_in_order(speeds):
            self._speeds_found = speeds
            return Line(requirement, measured, OK)
        for (first, speed), (second, other) in combinations(zip(JOINTS, speeds), 2):
            if max(speed, other) < _DIFFERENT * min(speed, other):
                return Line(requirement, measured, NOT_OK,
                            f'{first.name} and {second.name} have the same speed.')
        cause = ('The order of the speeds is wrong: joint_1 is the slowest, joint_3 is the '
                 'fastest.')
        for speed, joint in zip(speeds, JOINTS):
            if speed > _OTHER_UNIT * joint.speed:
                cause = f'{joint.name} is much too fast: {_UNIT_OF_TIME}'
        return Line(requirement, measured, NOT_OK, cause)

    def _speeds_and_reading(self) -> tuple[list[float], str]:
        """
        Return the speeds of the joints (rad/s), and what they are.

        The sheet can be read in two ways: the speed of a joint is that of its phase, or the
        largest speed that the joint reaches. The second reading is used if its speeds are in
        order and nearer to those of the sheet.
        """
        sines = [self._sines[joint.name] for joint in JOINTS]
        phase, largest = [sine.speed for sine in sines], [sine.fastest for sine in sines]
        is_nearer = _deviation(largest) < _deviation(phase)
        if is_nearer and _are_in_order(largest):
            return largest, 'largest speed'
        return phase, 'phase'

    def _hand(self) -> Line:
        requirement = 'end_effector does not move in joint_3'
        if why := self._why_not(HAND.name, _TRANSFORMS):
            return Line(requirement, '', NOT_JUDGED, why)
        if HAND.name in self._moving and (silence := self._silence(HAND.name)):
            return Line(requirement, '', NOT_OK, silence)
        rotations = self._samples[HAND.name].rotations
        # The angle between two rotations is 2 acos(|q1 · q2|); the absolute value, because q and
        # -q are the same rotation.
        cosine = float(abs(rotations @ rotations[0]).min())
        angle = 2 * float(np.arccos(min(1.0, cosine)))
        if abs(rotations[:, 3]).max() < _ROTATION_TOLERANCE:
            return Line(requirement, 'rotated by 180.0°', NOT_OK, _WRONG_ORDER)
        if angle < _ROTATION_TOLERANCE:
            return Line(requirement, 'fixed', OK)
        return Line(requirement, f'turns by {_degrees(angle)}', NOT_OK,
                    'end_effector must not rotate in joint_3: always send (0, 0, 0, 1).')

    # Good practice

    def _advice(self) -> Iterator[Line]:
        rates = {name: rate for name, samples in self._moving.items()
                 if (rate := _rate(samples.times)) is not None}
        name, rate = min(rates.items(), key=itemgetter(1), default=('', 0.0))
        yield _advised('at least 10 messages per second', f'{rate:.1f} Hz' if rates else '',
                       rate >= _LOWEST_RATE, f'{name} is sent {rate:.1f} times a second: its '
                       'motion does not look smooth.')
        is_by = 'number of the message' if self._has_fixed_step else 'time'
        yield _advised('the motion follows the clock',
                       f'a sine of the {is_by}' if self._sines else '', not self._has_fixed_step,
                       'Use the clock: with a fixed step, the speed depends on the rate.')
        stamps = [set(samples.stamps.tolist()) for samples in self._moving.values()]
        same = len(set.intersection(*stamps)) / max(map(len, stamps)) if stamps else 0.0
        yield _advised('all frames have the same stamp',
                       f'{100 * same:.0f} % of the ticks' if len(stamps) > 1 else '',
                       same >= _SAME_STAMP, 'Call get_clock().now() once in each tick, and use '
                       'it for all frames.')
        used = {joint.name: float(abs(self._samples[joint.name].angles).max()) / joint.limit
                for joint in JOINTS
                if not self._why_not(joint.name, _TRANSFORMS, _AXIS, _MOTION, _TURNS)}
        name, part = min(used.items(), key=itemgetter(1), default=('', 0.0))
        yield _advised('the joints use at least half of their limits',
                       ', '.join(f'{100 * each:.0f} %' for each in used.values()),
                       part >= _USED, f'{name} uses only {100 * part:.0f} % of its limit.')
        is_known = {gid for _, gid in self._frames_of} - {NOT_RECORDED, ''}
        yield _advised('each broadcaster is created once',
                       (self._recreated.partition(':')[0] or f'{len(self._frames_of)} publishers')
                       if is_known else '', not self._recreated, self._recreated)
        others = [shortened(name) for name in self._samples if name not in FRAMES]
        yield _advised('no other frames on /tf and /tf_static',
                       f'{len(others)} other frames' if self._samples else '', not others,
                       f'Other frames: {comma_list(others, _SHOWN)}.')
        speeds = self._speeds_found
        yield _advised('speeds of about 0.3, 0.5 and 0.7 rad/s',
                       ', '.join(f'{speed:.2f}' for speed in speeds), all(
                           1 / _SPEED_FACTOR <= speed / joint.speed <= _SPEED_FACTOR
                           for speed, joint in zip(speeds, JOINTS)),
                       'The sheet says 0.3, 0.5 and 0.7 rad/s. Is the time in seconds?')


def _are_in_order(speeds: list[float]) -> bool:
    """Return whether each speed is higher than the one before, and not nearly the same."""
    return all(speed * _DIFFERENT <= following for speed, following in pairwise(speeds))


def _deviation(speeds: list[float]) -> float:
    """
    Return how far the speeds of the joints are from those of the sheet, on a logarithmic scale.

    A common factor, as from a wrong unit of time, counts once: it does not change which reading of
    the sheet fits.

    :returns: the common deviation, which is the median, plus the sum of the deviations from it.
    """
    logarithms = [log(speed / joint.speed) for speed, joint in zip(speeds, JOINTS)]
    common = sorted(logarithms)[1]
    return abs(common) + sum(abs(each - common) for each in logarithms)


def _nearest(name: str, others: Sequence[str]) -> str:
    """Return the name that is probably a misspelling of a frame's name; '' if there is none."""
    # The names of the joints differ in one digit only, so a similar name must have the same digit.
    digits = [character for character in name if character.isdigit()]
    candidates = {_folded(other): other for other in match_candidates(others)
                  if [character for character in other if character.isdigit()] == digits}
    near = get_close_matches(_folded(name), candidates, 1, 0.75)
    return candidates[near[0]] if near else ''


def _folded(name: str) -> str:
    return ''.join(character for character in name.lower() if character.isalnum())


def _farthest(positions: _Floats, expected: _Vector) -> _Vector:
    """Return the position that is the farthest from the expected one."""
    x, y, z = positions[np.linalg.norm(positions - expected, axis=1).argmax()].tolist()
    return x, y, z


def _largest_angle(vectors: _Floats) -> float:
    """Return the largest angle (rad), from vector parts of quaternions: axis * sin(angle / 2)."""
    return 2 * asin(min(1.0, float(np.linalg.norm(vectors, axis=1).max())))


def _metres(position: _Vector) -> str:
    return f'({", ".join(f"{value + 0.0:.3f}" for value in position)}) m'


def _degrees(angle: float) -> str:
    return f'{degrees(angle):.1f}°'


def _rate(times: _Floats) -> Optional[float]:
    """Return the average rate of messages (Hz), from their times (s); None if it is not known."""
    span = times[-1] - times[0]
    return (len(times) - 1) / span if span > 0.0 else None


def _advised(practice: str, measured: str, is_followed: bool, text: str) -> Line:
    """Return the line of a good practice; `measured` is '' if it cannot be judged."""
    if not measured:
        return Line(practice, '', NOT_JUDGED, 'It cannot be measured.')
    return Line(practice, measured, OK) if is_followed else Line(practice, measured, ADVICE, text)


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


def _is_near(position: _Vector, expected: ArrayLike) -> bool:
    return bool(np.linalg.norm(np.subtract(position, expected)) <= _POSITION_TOLERANCE)


def _cause_of_interval(name: str, interval: float) -> str:
    return (f'{name} is sent every {interval:.3g} s: is the period of the timer in seconds, such '
            'as 0.02?')


def _cause_of_wave(joint: Edge, times: _Floats, angles: _Floats, sine: Sine) -> str:
    """Return the likely cause if the motion of a joint is not a sine."""
    too_fast = f'{joint.name} moves too fast to see a wave: {_UNIT_OF_TIME}'
    if sine.speed > 0.9 * _FASTEST:
        return too_fast
    low, high = float(angles.min()), float(angles.max())
    at_ends = np.mean((angles > high - 0.01 * (high - low)) | (angles < low + 0.01 * (high - low)))
    if at_ends > 0.2:  # for a sine, it is 0.13
        return (f'{joint.name} rests at {_degrees(high)} or {_degrees(low)}: the wave is clipped. '
                'Do not cut the angle off; the amplitude of the sine is the limit.')
    phase = sine.speed * times + sine.phase
    triangle = np.column_stack([np.ones_like(times), np.arcsin(np.sin(phase))])
    if _fit(triangle, angles)[1] / sine.amplitude < sine.residual / 2:
        return (f'{joint.name} moves at a constant speed to and fro, which is a triangle wave: '
                'the angle is limit * sin(speed * t).')
    steps = abs(np.diff(angles)) / (high - low)
    if sine.speed > _OTHER_UNIT * joint.speed or (
            sine.residual > 1.0 and np.median(steps) > _LARGE_STEP):
        return too_fast
    if steps.max() > 0.3:
        return f'The angle of {joint.name} jumps: it must change smoothly.'
    return f'The angle of {joint.name} is not a sine of the time: it is limit * sin(speed * t).'


def check(messages: Iterable[Message], reaches_late_joiners: Optional[bool] = None,
          end: Optional[int] = None, publishers: Sequence[Publisher] = ()) -> Report:
    """
    Check whether the transforms of an arm meet the requirements.

    :param messages: the messages of /tf and /tf_static, in the order of their times.
    :param reaches_late_joiners: whether a listener that started later than the arm has received
        base_link; None: not known, which does not count as a failure.
    :param end: the end of the observation (ns); None: the time of the last message.
    :param publishers: the publishers on /tf and /tf_static, also those that are gone; those of
        the oldest process first; empty: not known.
    :returns: the report.
    """
    return _Check(messages, reaches_late_joiners, end, publishers).report()
