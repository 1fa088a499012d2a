"""Arms for tests: what a right program sends, where its hand is, and small mistakes."""

from math import asin, cos, degrees, pi, radians, sin
from random import Random

import numpy as np

from puretf._core.pose import Row

S = 10**9
BEGIN = 1_700_000_000 * S


def hand(stamps, begin=BEGIN):
    """
    Return x, y, z (m), roll, pitch and yaw (rad) of end_effector in map, by the sum of the links.

    :param stamps: times (ns).
    :param begin: the time at which all phases are 0 (ns).
    """
    t = (np.asarray(stamps) - begin) / S
    angles = np.radians(Arm.limits) * np.sin(np.outer(t, Arm.speeds))
    turned, links, zero = angles.cumsum(axis=1), np.array([0.4, 0.3, 0.2]), np.zeros(len(t))
    return np.stack([np.cos(turned) @ links, np.sin(turned) @ links, zero + 0.3, zero, zero,
                     turned[:, 2]], axis=1)


class Arm:
    """The arm of the final task. A wrong arm overrides one method, or changes one number."""

    limits = (45.0, 30.0, 60.0)  # degrees
    speeds = (0.3, 0.5, 0.7)  # rad/s
    hertz = 20
    names = ('map', 'base_link', 'joint_1', 'joint_2', 'joint_3', 'end_effector')
    positions = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.3), (0.4, 0.0, 0.0), (0.3, 0.0, 0.0),
                 (0.2, 0.0, 0.0))
    topics = ('/tf_static', '/tf', '/tf', '/tf', '/tf')
    angle_of_hand = staticmethod(lambda t: 0.0)
    tick = 0

    def angle(self, joint, t):
        """Return the angle of joint 1, 2 or 3 (rad) at the time t (s)."""
        return radians(self.limits[joint - 1]) * sin(self.speeds[joint - 1] * t)

    def rotation(self, edge, angle):
        """Return the quaternion x, y, z, w of an edge (0 to 4) from the angle of its joint."""
        return (0.0, 0.0, sin(angle / 2), cos(angle / 2))

    def position(self, edge, t):
        """Return x, y, z of an edge (0 to 4)."""
        return self.positions[edge]

    def parent(self, edge):
        """Return the name of the parent of an edge."""
        return self.names[edge]

    def stamp(self, edge, now):
        """Return the stamp (ns) of an edge that is sent at the time now (ns)."""
        return now

    def time(self, tick):
        """Return the time (ns) of a tick of the timer."""
        return BEGIN + int(tick * S / self.hertz)

    def t(self, now):
        """Return the time (s) from which the program computes the angles."""
        return (now - BEGIN) / S

    def row(self, edge, now):
        """Return the transform of an edge at the time now (ns)."""
        t = self.t(now)
        angle = self.angle(edge, t) if 1 <= edge <= 3 else self.angle_of_hand(t) * (edge == 4)
        return Row(self.stamp(edge, now), self.parent(edge), self.names[edge + 1],
                   (*self.position(edge, t), *self.rotation(edge, angle)))

    def messages(self, seconds=25.0):
        """Yield topic, time (ns) and transforms of all messages."""
        static = [edge for edge in range(5) if self.topics[edge] == '/tf_static']
        moving = [edge for edge in range(5) if self.topics[edge] == '/tf']
        if static:
            yield '/tf_static', BEGIN, [self.row(edge, BEGIN) for edge in static]
        for tick in range(int(seconds * self.hertz) + 1 if moving else 0):
            self.tick, now = tick, self.time(tick)
            yield '/tf', now + S // 1000, [self.row(edge, now) for edge in moving]


def changed(**attributes):
    """Return an arm with other attributes or methods; a method gets the arm as `self`."""
    return type('Changed', (Arm,), attributes)()


def each(edit):
    """Return an arm of whose messages `edit` makes others: of topic, time (ns) and transforms."""
    return changed(messages=lambda self, seconds=25.0: [
        new for message in Arm.messages(self, seconds) for new in edit(*message)])


def _with_static(*row):
    """Return an arm and another static transform: its parent, its name and its pose."""
    return changed(messages=lambda self, seconds=25.0: [
        ('/tf_static', BEGIN, [Row(BEGIN, *row)]), *Arm.messages(self, seconds)])


def jitter(self, tick):
    """Return the time of a tick that is late by up to 0.1 ms (ns)."""
    return Arm.time(self, tick) + Random(tick).randrange(S // 10_000)


def _busy(self, tick):
    """Return the time of a tick on a busy machine (ns): up to 40 ms late, after pauses by 4 s."""
    pauses = 1.7 * (tick >= 4.5 * self.hertz) + 2.3 * (tick >= 15.5 * self.hertz)
    return Arm.time(self, tick) + Random(tick).randrange(S // 25) + int(pauses * S)


#: The attributes of a program that adds a fixed step in each tick, on a busy machine.
FIXED_STEP = {'time': _busy, 't': lambda self, now: self.tick / self.hertz}


def _with_period(seconds):
    """Return an arm whose timer has a long period; its hand is static."""
    return changed(hertz=1 / seconds, time=jitter, topics=(
        *Arm.topics[:4], '/tf_static'))


def _in_unit(unit):
    """Return an arm whose time is in another unit (s), and whose timer is a little late."""
    return changed(hertz=50, time=jitter, t=lambda self, now: (now - BEGIN) / S / unit)


def _triangle(self, joint, t):
    return radians(self.limits[joint - 1]) * 2 / pi * asin(sin(self.speeds[joint - 1] * t))


def _clipped(self, joint, t):
    return max(-1.0, min(1.0, 1.3 * sin(self.speeds[joint - 1] * t))) * radians(
        self.limits[joint - 1])


def _bounded(self, joint, t):
    """Turn at a constant speed, and start again at the limit."""
    limit = radians(self.limits[joint - 1])
    return (self.speeds[joint - 1] * t) % (2 * limit) - limit


def _joint(number, angle, other=Arm.angle):
    """Return a method that uses another function for the angle of one joint."""
    return lambda self, joint, t: (angle if joint == number else other)(self, joint, t)


def _added(self, joint, t):
    """Return the angle of a joint and its parent, as if it were measured in base_link."""
    return Arm.angle(self, joint - 1, t) + Arm.angle(self, joint, t)


def _edge(number, quaternion):
    """Return a method that uses another function for the rotation of one edge."""
    return lambda self, edge, angle: (
        quaternion(angle) if edge == number else Arm.rotation(self, edge, angle))


def _at(edge, position):
    """Return the positions with that of one edge changed."""
    return (*Arm.positions[:edge], position, *Arm.positions[edge + 1:])


def _named(index, name):
    return (*Arm.names[:index], name, *Arm.names[index + 1:])


#: By the beginning of the requirement that it breaks, and by a part of the cause: a wrong arm.
WRONG = {
    'all transforms': {
        'Nothing': changed(messages=lambda self, seconds=25: iter(())),
        'finite': changed(positions=_at(2, (float('nan'), 0.0, 0.0))),
        'w is 1': changed(rotation=_edge(4, lambda _: (0.0, 0.0, 0.0, 0.0))),
        'same angle': changed(rotation=_edge(3, lambda a: (0.0, 0.0, sin(a), cos(a / 2))))},
    'the tree': {
        "'joint1' is misspelt": changed(names=_named(2, 'joint1')),
        r'other frames: end_effector\x1b[2J.': changed(names=_named(5, 'end_effector\x1b[2J')),
        'must be map, not world': changed(names=_named(0, 'world')),
        'StaticTransformBroadcaster': changed(topics=('', '/tf', '/tf', '/tf', '/tf')),
        'other frames: base.': changed(names=('map', 'base', *Arm.names[2:])),
        'No transform of end_effector': changed(topics=(*Arm.topics[:4], '')),
        'is a star': changed(parent=lambda self, edge: self.names[min(edge, 1)]),
        'The parent of joint_3 must be joint_2, not joint_1': changed(
            parent=lambda self, edge: self.names[2 if edge == 3 else edge]),
        'joint_3 has several parents; only joint_2 is right': changed(
            parent=lambda self, edge: self.names[1 if edge == 3 and self.tick % 2 else edge]),
        'end_effector is in one message more than once': each(
            lambda topic, time, rows: [(topic, time, [rows[-1]] * len(rows))]),
        'exchanged': changed(row=lambda self, edge, now: Row(
            now, self.names[edge + 1], self.names[edge], (0.0,) * 6 + (1.0,))),
        'Does a timer, with its period in seconds,': changed(topics=('/tf_static', *[''] * 4)),
        'map is the root': _with_static('world', 'map', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)),
        'on /tf and on /tf_static': each(lambda topic, time, rows: [
            (topic, time, rows), *[('/tf_static', time, rows)] * (time - BEGIN == S // 1000)])},
    'the stamps': {
        'The stamp of joint_3 is not set': changed(
            stamp=lambda self, edge, now: 0 if edge == 3 else now),
        'only once': changed(stamp=lambda self, edge, now: BEGIN),
        'not the current': changed(stamp=lambda self, edge, now: now - 2 * S),
        'has no nanoseconds': changed(stamp=lambda self, edge, now: round(now, -9))},
    'base_link is on /tf_static': {
        'do not send it in the timer': each(lambda topic, time, rows: [(topic, time, rows + [
            rows[0]._replace(frame_id='map', child_frame_id='base_link', pose=(0.0,) * 6 + (1.0,))
            ] * (topic == '/tf'))]),
        'use StaticTransformBroadcaster': changed(topics=('/tf',) * 5),
        'which sends on /tf_static': changed(
            topics=('/tf',) * 5, stamp=lambda self, edge, now: now * (edge > 0))},
    'base_link is fixed': {
        '(0, 0, 0)': changed(positions=_at(0, (0.0, 0.0, 0.3))),
        'must not be rotated': changed(rotation=_edge(0, lambda _: (0.0, 0.0, 0.6, 0.8)))},
    'joint_2 is 0.4 m along x': {
        'On the sheet, this is the position of joint_3': changed(
            positions=_at(2, Arm.positions[3]))},
    'joint_1 is 0.3 m along z': {'not the direction': changed(positions=_at(1, (0.3, 0.0, 0.0)))},
    'joint_2 is 0.4 m': {
        'centimetres': changed(positions=_at(2, (40.0, 0.0, 0.0))),
        'changes': changed(position=lambda self, edge, t: (
            (0.4 * cos(t), 0.4 * sin(t), 0.0) if edge == 2 else self.positions[edge]))},
    'joint_3 is 0.3 m': {'position in base_link': changed(positions=_at(3, (0.7, 0.0, 0.3)))},
    'end_effector is 0.2 m': {'not set': changed(positions=_at(4, (0.0, 0.0, 0.0)))},
    'joint_1 turns about z': {
        'turns about x': changed(rotation=_edge(1, lambda a: (sin(a / 2), 0.0, 0.0, cos(a / 2))))},
    'joint_3 turns about z': {
        'turns about x and z': changed(rotation=_edge(3, lambda a: (
            0.00095, 0.0, sin(a / 2), (1 - 0.00095 ** 2 - sin(a / 2) ** 2) ** 0.5)))},
    'joint_2 turns about z': {
        'w is the last number; transforms3d has it first': changed(
            rotation=_edge(2, lambda a: (cos(a / 2), 0.0, 0.0, sin(a / 2))))},
    'end_effector does not': {
        'w is the last number': changed(rotation=_edge(4, lambda _: (1.0, 0.0, 0.0, 0.0))),
        'was sent only once': each(lambda topic, time, rows: [
            (topic, time, rows[:-1] if time > BEGIN + S // 100 else rows)]),
        'must not rotate': changed(angle_of_hand=sin)},
    'joint_2 moves': {
        'joint_2 is sent with StaticTransformBroadcaster: send the joints with Tr': changed(
            topics=('/tf_static', '/tf', '/tf_static', '/tf', '/tf')),
        'twice': changed(limits=(45.0, radians(30.0), 60.0))},
    'joint_1 moves': {
        'stands at its limit': changed(angle=_joint(1, lambda self, joint, t: radians(45.0))),
        'joint_1 is sent every 7 s': _with_period(7),
        'is t in seconds?': _in_unit(1e3)},
    'joint_3 moves': {'does not change': changed(angle=_joint(3, lambda self, joint, t: 0.5))},
    'joint_1 stays': {
        'degrees': changed(angle=lambda *arguments: degrees(Arm.angle(*arguments))),
        'half angle': changed(
            rotation=lambda self, edge, angle: (0.0, 0.0, sin(angle), cos(angle))),
        'rounded': changed(limits=(45.3, 30.0, 60.0))},
    'joint_2 stays': {
        'the angle of joint_1 added': changed(angle=_joint(2, _added)),
        'exceeded by 3.0°': changed(limits=(45.0, 33.0, 60.0)),
        'limit of joint_3': changed(limits=(45.0, 60.0, 30.0)),
        'twice as large as it should be. In the quaternion, use the half angle': changed(
            rotation=_edge(2, lambda angle: (0.0, 0.0, sin(angle), cos(angle))))},
    'joint_1 moves as a sine': {
        'triangle': changed(angle=_joint(1, _triangle)),
        'jumps: it must be limit * sin(speed * t)': changed(angle=_joint(1, _bounded)),
        'not a sine': changed(angle=_joint(
            1, lambda self, joint, t: 0.5 * sin(0.3 * t) + 0.2 * sin(t))),
        'joint_1 changes only once a second: is t in whole seconds?': changed(
            t=lambda self, now: (now - BEGIN) // S),
        'is t in seconds?': _in_unit(1e-9),
        'too fast to see a wave: is t in seconds?': changed(speeds=(25.0, 30.0, 35.0), hertz=50),
        'joint_1 moves too fast to see a wave': changed(speeds=(30.0, 50.0, 70.0), hertz=50)},
    'joint_3 moves as a sine': {
        'clipped': changed(angle=_joint(3, _clipped)),
        'the angle of joint_2 added': changed(limits=(45.0, 30.0, 30.0), angle=_joint(3, _added))},
    'joint_2 moves as a sine': {
        'triangle': changed(**FIXED_STEP, angle=_joint(2, _triangle)),
        'is t in seconds?': _in_unit(1e-3)},
    'the joints have': {
        # At 10 Hz, steps of 30, 50 and 70 rad look like steps of -1.42, -0.27 and 0.88 rad.
        'much too fast: is t in seconds?': changed(
            hertz=10, t=lambda self, now: (now - BEGIN) * 1e-6),
        'much too slow: is t in seconds?': _in_unit(60.0),
        'joint_2 and joint_3 have the same': changed(speeds=(0.3, 0.7, 0.7)),
        '(1.88 in place of 0.3 rad/s): is there a factor 2π?': changed(speeds=(1.885, 0.5, 0.7)),
        '(3.14 in place of 0.5 rad/s): is there a factor 2π?': changed(speeds=(0.3, 3.1416, 0.7)),
        'The order': changed(speeds=(0.7, 0.5, 0.3)),
        'do not convert': changed(speeds=(radians(0.3), radians(0.5), radians(0.7)))},
}

#: By name: arms that meet all requirements.
RIGHT = {
    'model': Arm(),
    'cosine with offset': changed(angle=lambda self, joint, t: radians(self.limits[joint - 1]) * (
        0.2 + 0.7 * cos(self.speeds[joint - 1] * t))),
    'slow rate': changed(hertz=10),
    'changing sign of the quaternion': changed(row=lambda self, edge, now: Arm.row(
        self, edge, now)._replace(pose=(*Arm.positions[edge], *(
            (-1) ** (now // S) * part for part in Arm.row(self, edge, now).pose[3:])))),
    'second reading of the speeds': changed(speeds=tuple(
        speed / radians(limit) for speed, limit in zip(Arm.speeds, Arm.limits))),
    'slashes': changed(names=('/map', '/base_link', *Arm.names[2:])),
    'other direction': changed(speeds=(-0.3, -0.5, -0.7)),
    'static hand': changed(topics=(*Arm.topics[:4], '/tf_static')),
    'another node': each(lambda topic, time, rows: [(topic, time, rows), (
        topic, time, [rows[0]._replace(frame_id='map', child_frame_id='other')])]),
    'a broken camera': _with_static('map', 'camera', (0.0,) * 7),
    'a message for each frame': each(lambda topic, time, rows: [
        (topic, time + i * 1000, [row._replace(stamp_ns=row.stamp_ns + i * 1000)])
        for i, row in enumerate(rows)]),
    'fixed step': changed(**FIXED_STEP),
    'busy machine': changed(time=_busy),
    'busy listener': each(lambda topic, time, rows: [
        (topic, BEGIN + 12 * S if 8 * S < time - BEGIN < 12 * S else time, rows)]),
}
