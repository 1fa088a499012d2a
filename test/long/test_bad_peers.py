"""
The arm, a listener and the endless commands while others publish nonsense: see `bad_peers.py`.

All programs are started once; each attack lasts five seconds. These tests take 3 min.
"""

from collections import Counter
from itertools import pairwise
import json
from math import cos, dist, hypot, sin
import os
from pathlib import Path
import re
import signal
import socket
import subprocess
import sys
import time
from typing import NamedTuple

from arms import Arm
from bad_peers import ATTACKS, WRONG_PLACE
from environment import ROOT
from processes import ARM, reserved_domain, TIMEOUT, tool
import pytest
from viewer import Viewer

S = 10**9
SECONDS = 5
#: These attacks leave so many frames that the programs are started anew before them.
FRESH = 'parents', 'names'
#: In these attacks, the listener is one with QoS "best effort". Where packets are lost, a reliable
#: subscription (the default, as in tf2) receives nothing of a publisher until Fast DDS sends the
#: lost packet again, which takes up to 3 s.
BEST_EFFORT = 'flood',
#: A lookup at a time that has yet to come waits at most this long (s).
WAIT = 0.6

LISTENER = f"""
import json
import sys
import time
import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from puretf import Buffer, TransformListener

rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node('listener')
buffer = Buffer(node=node)
TransformListener(buffer, node, qos=QoSProfile(
    depth=100, reliability=ReliabilityPolicy.BEST_EFFORT) if 'best effort' in sys.argv else None)

def look_up(frame, time_ns=0, wait=0.0):
    begin, answer, error, gap = time.monotonic(), [], '', 0
    try:
        result = buffer.lookup_transform(
            'map', frame, Time(nanoseconds=time_ns), Duration(seconds=wait))
    except Exception as problem:
        error = type(problem).__name__
    end = time.monotonic()
    if not error:
        at, turn = result.transform.translation, result.transform.rotation
        stamp = result.header.stamp
        time_is = stamp.sec * 10**9 + stamp.nanosec
        if time_ns:
            stamps = buffer.path_stamps('map', frame)
            after = stamps.searchsorted(time_ns)
            gap = int(stamps[after] - stamps[after - 1]) if 0 < after < len(stamps) else -1
            assert time_is == time_ns
        answer = [time_is, at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w]
    print(json.dumps([frame, begin, end, gap, error, answer]))

buffer.lookup_transform('map', 'end_effector', Time(), Duration(seconds={TIMEOUT}))
try:
    while True:
        look_up('joint_1')
        look_up('end_effector')
        look_up('end_effector', time.time_ns(), {WAIT})
except KeyboardInterrupt:
    node.destroy_node()
    rclpy.shutdown()
"""


class Lookup(NamedTuple):
    """A line of the listener: the pose of a frame in map."""

    frame: str
    begin: float  #: on the monotonic clock (s)
    end: float
    #: From the sample before the time to the sample after it (ns); 0: at a sample; -1: the path
    #: has been cut meanwhile.
    gap: int
    error: str  #: the class of the exception
    answer: list[float]  #: stamp (ns), x, y, z, quaternion x, y, z, w; [] after an exception


class Program:
    """A program whose stdout and stderr are files, since it may print megabytes."""

    def __init__(self, domain, directory, name, *arguments):
        """Start python."""
        self.out, self.log = directory / f'{name}.out', directory / f'{name}.log'
        with self.out.open('w') as out, self.log.open('w') as log:
            self._popen = subprocess.Popen(
                [sys.executable, '-u', *arguments], stdout=out, stderr=log,
                env={**os.environ, 'ROS_DOMAIN_ID': str(domain)})

    def has_ended(self):
        """Return whether the process has ended."""
        return self._popen.poll() is not None

    def interrupt(self):
        """Send SIGINT."""
        self._popen.send_signal(signal.SIGINT)

    def exit_code(self):
        """Wait until the process ends, or kill it; return its exit code."""
        try:
            return self._popen.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            return self._popen.wait()


def text_since(path: Path, start: int) -> str:
    """Return the text of a file from a position on."""
    with path.open('rb') as file:
        file.seek(start)
        return file.read().decode()


def wait_until(condition, what):
    """Wait until the condition holds, and return its value; fail if that takes too long."""
    deadline = time.monotonic() + TIMEOUT
    while not (value := condition()):
        assert time.monotonic() < deadline, f'waited in vain: {what}'
        time.sleep(0.05)
    return value


class Victims:
    """The arm, a listener and the commands that run until Ctrl-C."""

    def __init__(self, domain, directory):
        """Prepare to start them in a domain; their output is written to a directory."""
        self._domain, self._directory = domain, directory
        self._programs: dict[str, Program] = {}
        with socket.socket() as free:
            free.bind(('127.0.0.1', 0))
            self._port = free.getsockname()[1]
        self.begin, self.listens = 0, ''

    def start(self, listens):
        """
        Start all, and wait until each of them shows the arm.

        :param listens: the QoS of the listener: 'reliable' or 'best effort'.
        """
        self.listens = listens
        commands = {
            'listener': ('-c', LISTENER, listens), 'dummy_arm': ARM,
            'tf2_echo': tool('tf2_echo', 'map', 'end_effector', '5', '-p', '9'),
            'tf2_monitor': tool('tf2_monitor'), 'view_frames': tool('view_frames', '--watch'),
            'web_view': tool('web_view', '--port', str(self._port))}
        self._programs = {name: Program(self._domain, self._directory, name, *arguments)
                          for name, arguments in commands.items()}
        (begin,) = wait_until(lambda: re.findall(
            r't = 0 at (\d+) ns\n', self._programs['dummy_arm'].log.read_text()), 'the arm')
        self.begin = int(begin)
        wait_until(self._programs['listener'].out.read_text, 'the listener')
        self.check_output(self.sizes(), self.begin)

    def ended(self):
        """Return the names and log lines of the programs that have ended."""
        return {name: program.log.read_text().splitlines()[-20:]
                for name, program in self._programs.items() if program.has_ended()}

    def end(self):
        """End all that run; check that they end well."""
        programs, self._programs = self._programs, {}
        for program in programs.values():
            program.interrupt()
        codes = {name: program.exit_code() for name, program in programs.items()}
        assert set(codes.values()) <= {0}, codes
        for program in programs.values():
            assert 'Traceback' not in program.log.read_text()

    def sizes(self):
        """Return how much each program has written, to stdout and to stderr."""
        return {name: (program.out.stat().st_size, program.log.stat().st_size)
                for name, program in self._programs.items()}

    def output(self, name, sizes):
        """Return what a program has written to stdout since `sizes` was called."""
        return text_since(self._programs[name].out, sizes[name][0])

    def log_lines(self, sizes):
        """Return the number of log lines since `sizes` was called, by program and cause."""
        causes: Counter[tuple[str, str]] = Counter()
        for name, program in self._programs.items():
            for line in text_since(program.log, sizes[name][1]).splitlines():
                if line != 'Possible reasons are listed at http://wiki.ros.org/tf/Errors%20explained':
                    causes[name, cause_of(line)] += 1
        return causes

    def lookups(self, sizes, begin, end):
        """Return the lookups since `sizes` was called that were made in a span of time."""
        lines = self.output('listener', sizes).split('\n')[:-1]
        lookups = [Lookup(*json.loads(line)) for line in lines if line.startswith('[')]
        return [lookup for lookup in lookups if lookup.end >= begin and lookup.begin <= end]

    def attack(self, name):
        """Attack once; return the lookups meanwhile, and the number of messages."""
        sizes = self.sizes()
        with subprocess.Popen(
                [sys.executable, str(ROOT / 'test' / 'support' / 'bad_peers.py'), name,
                 str(SECONDS)], text=True, stdout=subprocess.PIPE,
                env={**os.environ, 'ROS_DOMAIN_ID': str(self._domain)}) as peer:
            assert peer.stdout is not None
            assert peer.stdout.readline() == 'attacking\n'
            begin = time.monotonic()
            sent = int(peer.stdout.read().split()[-1])
        assert peer.returncode == 0
        end = time.monotonic()
        listener = self._programs['listener']
        wait_until(lambda: listener.has_ended() or any(
            lookup.begin > end for lookup in self.lookups(sizes, end, end + TIMEOUT)),
            'the listener')
        return self.lookups(sizes, begin, end), sent

    def check_output(self, sizes, since):
        """Check that each command shows the arm, later than a time (ns) and correctly."""
        def echoed():
            poses = re.findall(
                r'At time (\d+)\.(\d{9})\n- Translation: \[(.+)\]\n- Rotation: in Quaternion '
                r'\[(.+)\]\n', self.output('tf2_echo', sizes))
            return [(int(sec + nanosec), *(float(number) for number in f'{at}, {turn}'.split(',')))
                    for sec, nanosec, at, turn in poses if int(sec + nanosec) > since]

        assert error_of('end_effector', wait_until(echoed, 'tf2_echo')[-1], self.begin) < 1e-6
        wait_until(lambda: re.search(
            r'\n  end_effector +[\d.]+ Hz +-?\d\.\d+ s +\d\.\d+ s  /dummy_arm\n',
            self.output('tf2_monitor', sizes)), 'tf2_monitor')

        def drawn_anew():
            # Trees are drawn once a second or less often: if the ages of two that follow each
            # other differ by less, a newer transform has arrived meanwhile.
            ages = [float(age) for age in re.findall(
                r'── end_effector +[\d.]+ Hz +(-?\d\.\d+) s old  /dummy_arm\n',
                self.output('view_frames', sizes))]
            return any(later < earlier + 0.9 for earlier, later in pairwise(ages))

        wait_until(drawn_anew, 'view_frames')
        wait_until(self._programs['web_view'].out.read_text, 'web_view')
        viewer = Viewer(self._port)
        viewer.until(lambda: 'end_effector' in str(viewer.gui))
        viewer.close()


def cause_of(line):
    """Return a line of a log without its time, numbers, names and quotations."""
    line = re.sub(r'^(\[\w+\]) \[[\d.]+\]', r'\1', line)
    line = re.sub(r'"[^"]*"|\'[^\']*\'|\S*bad_\S*', '…', line)
    return re.sub(r'[-+]?\b(\d[\d.]*(e[-+]?\d+)?|nan|inf|[0-9a-f]{32})\b', '#', line)


def error_of(frame, answer, begin, joint_2=None):
    """
    Return the error of an answer: the largest difference of the positions (m) and angles (rad).

    :param frame: end_effector or joint_1, in map.
    :param answer: as in `Lookup`.
    :param begin: the time at which all phases are 0 (ns).
    :param joint_2: x, y, z in joint_1 that someone claims, without rotation; None: as in the arm.
    """
    stamp, x, y, z, qx, qy, qz, qw = answer
    arm, t = Arm(), (stamp - begin) / S
    angles = [arm.angle(joint, t) for joint in (1, 2, 3)]
    place, yaw = (0.0, 0.0, 0.3), angles[0]
    if frame == 'end_effector':
        steps = [arm.positions[2] if joint_2 is None else joint_2, *arm.positions[3:]]
        turns = [angles[1] if joint_2 is None else 0.0, angles[2], 0.0]
        for (dx, dy, dz), turn in zip(steps, turns):
            place = (place[0] + cos(yaw) * dx - sin(yaw) * dy,
                     place[1] + sin(yaw) * dx + cos(yaw) * dy, place[2] + dz)
            yaw += turn
    sign = 1.0 if qw * cos(yaw / 2) + qz * sin(yaw / 2) > 0.0 else -1.0
    return max(dist((x, y, z), place), 2 * hypot(
        qx, qy, qz - sign * sin(yaw / 2), qw - sign * cos(yaw / 2)))


def is_right(lookup, begin, attack):
    """
    Return whether an answer is that of the arm.

    Between two samples, the error of an interpolation is at most h² / 8 times the largest second
    derivative, which is less than 0.72 rad/s² for the angle, and less than 0.9 m/s² here.

    In the fight, the pose of end_effector at a sample is that of the arm or that of the attacker,
    or it is not connected to map, as the newest sample says. Between two samples, it may also be
    between both.
    """
    if lookup.error:
        # It waited in vain for the arm: this is late, not wrong.
        is_late = lookup.error == 'ExtrapolationException' and lookup.end - lookup.begin >= WAIT
        return is_late or (attack == 'fight' and lookup.frame == 'end_effector'
                           and lookup.error == 'ConnectivityException')
    limit = 1e-6 + 0.15 * (lookup.gap / S) ** 2
    if error_of(lookup.frame, lookup.answer, begin) < limit:
        return True
    return attack == 'fight' and lookup.frame == 'end_effector' and (
        lookup.gap or error_of(lookup.frame, lookup.answer, begin, WRONG_PLACE) < limit)


def slowest(lookups):
    """Return how long the slowest lookup took (s), without the wait for what never came."""
    return max(lookup.end - lookup.begin - WAIT * (lookup.error == 'ConnectivityException')
               for lookup in lookups)


@pytest.fixture(scope='module')
def domain_id():
    """The ROS domain id of all tests of this module."""
    yield from reserved_domain()


@pytest.fixture(scope='module')
def running(domain_id, tmp_path_factory):
    """The programs, which are ended after the last test."""
    victims = Victims(domain_id, tmp_path_factory.mktemp('victims'))
    yield victims
    victims.end()


@pytest.fixture
def victims(running, request):
    """The running programs: started anew if one has ended, or if an attack needs it."""
    attack = request.node.callspec.params['attack']
    listens = 'best effort' if attack in BEST_EFFORT else 'reliable'
    if running.ended() or running.listens != listens or attack in FRESH:
        running.end()
        running.start(listens)
    return running


@pytest.mark.parametrize('attack', ATTACKS)
def test_attack(victims, attack, show):
    """Lookups stay right, the commands go on, and log at most a line per cause and second."""
    sizes, begin = victims.sizes(), time.monotonic()
    lookups, sent = victims.attack(attack)
    assert not victims.ended()
    show(f'{attack}: {sent} messages; {len(lookups)} lookups, the slowest '
         f'{slowest(lookups) * 1e3:.0f} ms')
    assert not [lookup for lookup in lookups if not is_right(lookup, victims.begin, attack)]
    victims.check_output(victims.sizes(), time.time_ns())
    assert not victims.ended()
    lines = victims.log_lines(sizes)
    show(f'{attack}: {sum(lines.values())} log lines, of one cause '
         f'{max(lines.values(), default=0)} in {time.monotonic() - begin:.0f} s')
    most = 1 + time.monotonic() - begin
    assert not {cause: count for cause, count in lines.items() if count > most}
