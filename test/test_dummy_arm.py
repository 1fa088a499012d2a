"""The node `dummy_arm`, run as a user runs it; its messages are received over DDS."""

import math
import re
import signal
import time

from conftest import ARM
import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from dummy_arm.arm import Arm
from dummy_arm.tf import TFMessage

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CHAIN = [('base_link', 'joint_1'), ('joint_1', 'joint_2'), ('joint_2', 'joint_3'),
         ('joint_3', 'end_effector')]


def zero_in(text):
    """Return the time of t = 0 (ns) that a log line contains."""
    found = re.search(r't = 0 at (\d+) ns', text)
    assert found is not None
    return int(found[1])


def zero(process):
    """Return the time of t = 0 (ns) that the first log line contains."""
    return zero_in(process.line())


def ns(transform):
    """Return the stamp (ns)."""
    stamp = transform.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec


def edges(message):
    """Return parent and child of each transform."""
    return [(t.header.frame_id, t.child_frame_id) for t in message.transforms]


def poses(message):
    """Return the (n, 7) poses: x, y, z (m), quaternion x, y, z, w."""
    return np.array([(t.transform.translation.x, t.transform.translation.y,
                      t.transform.translation.z, t.transform.rotation.x, t.transform.rotation.y,
                      t.transform.rotation.z, t.transform.rotation.w) for t in message.transforms])


def angle(message, joint):
    """Return the angle of joint 0, 1 or 2 (rad)."""
    rotation = message.transforms[joint].transform.rotation
    return 2 * math.atan2(rotation.z, rotation.w)


@pytest.fixture
def joints(ros):
    """The messages received on /tf."""
    messages: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf', messages.append, 1000)
    return messages


@pytest.fixture
def statics(ros):
    """The messages received on /tf_static."""
    messages: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf_static', messages.append, LATCHED)
    return messages


def assert_static(message):
    """Check the only static transform."""
    assert edges(message) == [('map', 'base_link')]
    np.testing.assert_array_equal(poses(message), [[0, 0, 0, 0, 0, 0, 1]])


def test_early_and_late_subscribers_get_the_arm(ros, joints, statics, start):
    """Both get the static transform; the joints follow the formula at their stamps."""
    process = start(*ARM)
    start_ns = zero(process)
    ros.until(lambda: statics and len(joints) >= 100)
    late: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf_static', late.append, LATCHED)
    ros.until(lambda: late)
    for message in (*statics, *late):
        assert_static(message)
    speeds = np.array([0.3, 0.5, 0.7])
    for message in joints:
        assert edges(message) == CHAIN
        (stamp_ns,) = {ns(transform) for transform in message.transforms}
        expected = Arm().poses(speeds * (stamp_ns - start_ns) / 1e9)
        np.testing.assert_allclose(poses(message), expected, rtol=0, atol=1e-9)
    stamps = np.diff([ns(message.transforms[0]) for message in joints]) / 1e9
    assert np.median(stamps) == pytest.approx(1 / 50, rel=0.3)


def test_the_first_message_is_a_straight_arm(joints, statics, ros, start):
    """The phases are zero at the first tick, which here waits for /clock."""
    publisher = ros.node.create_publisher(Clock, '/clock', 10)
    process = start(*ARM, '--ros-args', '-p', 'use_sim_time:=true', '-p', 'rate:=0.5')
    # A node that has discovered the subscription to /tf_static has discovered the one to /tf,
    # which is older, too.
    ros.until(lambda: statics)
    clock = Clock(clock=Time(seconds=100).to_msg())
    ros.node.create_timer(0.1, lambda: publisher.publish(clock))
    ros.until(lambda: joints)
    assert ns(joints[0].transforms[0]) == 100 * 10**9
    assert [angle(joints[0], i) for i in range(3)] == [0.0, 0.0, 0.0]
    ros.until(lambda: 't = 0 at 100000000000 ns' in process.output)
    assert 'publishing map -> base_link on /tf_static' in process.output
    assert 'base_link -> joint_1 -> joint_2 -> joint_3 -> end_effector on /tf at 0.5 Hz' in (
        process.output)


class Parameters:
    """The parameter services of the node."""

    def __init__(self, ros):
        self._ros, self._last_call = ros, 0.0
        self._client = AsyncParameterClient(ros.node, 'dummy_arm')
        ros.until(self._client.services_are_ready)

    def _response(self, call):
        """Call a service until it responds: DDS may lose a response to a new client."""
        futures: list[Future] = []

        def has_response():
            if not futures or time.monotonic() > self._last_call + 2.0:
                futures.append(call())
                self._last_call = time.monotonic()
            return any(future.done() for future in futures)

        self._ros.until(has_response)
        return next(future.result() for future in futures if future.done())

    def set(self, **values):
        """Set parameters, `__` for a dot; return the reasons of refusals ('' if accepted)."""
        parameters = [
            Parameter(name.replace('__', '.'), value=value) for name, value in values.items()]
        results = self._response(lambda: self._client.set_parameters(parameters))
        assert all(result.successful == (not result.reason) for result in results.results)
        return [result.reason for result in results.results]

    def describe(self, *names):
        """Return the descriptors of parameters."""
        return self._response(lambda: self._client.describe_parameters(list(names))).descriptors


def test_changes_keep_the_angle_continuous(ros, joints, start):
    """New speeds and limits, set by the parameter service, cause no jump."""
    start_ns = zero(start(*ARM, '--ros-args', '-p', 'rate:=200'))
    parameters = Parameters(ros)
    ros.until(lambda: len(joints) > 100)
    assert parameters.set(joint_1__speed=3.0, joint_2__limit=2.0) == ['', '']
    changed = len(joints)
    ros.until(lambda: len(joints) > changed + 300)
    assert parameters.set(joint_1__speed=-1, joint_1__limit=1) == ['', '']
    changed = len(joints)

    def follows():  # this takes longer if a response was late, and the call was repeated
        last = joints[-100:]
        seconds = np.array([ns(message.transforms[0]) - start_ns for message in last]) / 1e9
        return np.allclose([angle(message, 1) for message in last], 2.0 * np.sin(0.5 * seconds),
                           rtol=0, atol=1e-9)

    ros.until(lambda: len(joints) > changed + 300 and follows())

    seconds = np.array([ns(message.transforms[0]) - start_ns for message in joints]) / 1e9
    for joint, fastest in ((0, 3.0 * math.pi / 4 + 1.5), (1, 0.5 * 2.0 + 1.5 * 1.5)):
        angles = np.array([angle(message, joint) for message in joints])
        assert np.all(np.abs(np.diff(angles)) <= fastest * np.diff(seconds) + 1e-9)
        assert np.ptp(angles) > 0.3
    angles = np.array([angle(message, 1) for message in joints[-100:]])
    np.testing.assert_allclose(angles, 2.0 * np.sin(0.5 * seconds[-100:]), atol=1e-9)
    angles = np.array([angle(message, 2) for message in joints])
    np.testing.assert_allclose(
        angles, math.radians(60) * np.sin(0.7 * seconds), atol=1e-9)


def test_a_new_rate_is_taken_at_once(ros, joints, start):
    """The arm does not wait for the next tick, even if ticks are ten seconds apart."""
    start(*ARM, '--ros-args', '-p', 'rate:=0.1')
    parameters = Parameters(ros)
    assert parameters.set(rate=100) == ['']
    ros.until(lambda: len(joints) > 50, timeout=9.0)


def test_a_new_offset_moves_the_frame(ros, joints, start):
    """The frame moves along the previous link."""
    start(*ARM)
    assert Parameters(ros).set(joint_2__offset=1.5) == ['']
    ros.until(lambda: joints and joints[-1].transforms[1].transform.translation.x == 1.5)


@pytest.mark.parametrize(('name', 'value', 'reason'), [
    ('rate', 0, 'rate must be a number from 0.1 to 10000 Hz, got 0'),
    ('rate', 0.0, 'rate out of range'), ('rate', math.nan, 'rate out of range'),
    ('rate', 'fast', "rate must be a number from 0.1 to 10000 Hz, got 'fast'"),
    ('rate', True, 'rate must be a number'), ('rate', None, 'rate must be a number'),
    ('joint_1__limit', 3.2, 'joint_1.limit out of range'),
    ('joint_1__limit', 4, 'joint_1.limit must be a number from 0 to 3.14159 rad, got 4'),
    ('joint_3__speed', math.inf, 'joint_3.speed out of range'),
    ('frame_prefix', 'x/', 'read-only')])
def test_nonsense_is_refused_with_a_reason(ros, joints, start, name, value, reason):
    """The arm continues to publish."""
    start(*ARM)
    (returned,) = Parameters(ros).set(**{name: value})
    assert reason in returned
    count = len(joints)
    ros.until(lambda: len(joints) > count + 5)


def test_parameters_are_described(ros, start):
    """Each parameter has a description; those that are numbers have a range."""
    start(*ARM)
    rate, limit, prefix = Parameters(ros).describe('rate', 'joint_2.limit', 'frame_prefix')
    assert 'Hz' in rate.description
    assert rate.floating_point_range[0].to_value == 10000.0
    assert 'rad' in limit.description
    assert limit.floating_point_range[0].to_value == math.pi
    assert prefix.read_only
    assert 'map' in prefix.description


def test_parameters_at_the_start(ros, joints, statics, start):
    """Speeds, limits and the prefix can be set on the command line; integers are accepted."""
    start_ns = zero(start(
        *ARM, '--ros-args', '-p', 'joint_1.speed:=2', '-p', 'joint_1.limit:=0.25',
        '-p', 'joint_1.offset:=1', '-p', 'frame_prefix:=robot1/'))
    ros.until(lambda: statics and len(joints) > 20)
    assert edges(statics[0]) == [('map', 'robot1/base_link')]
    for message in joints:
        assert edges(message) == [(f'robot1/{a}', f'robot1/{b}') for a, b in CHAIN]
        assert message.transforms[0].transform.translation.z == 1.0
        t = (ns(message.transforms[0]) - start_ns) / 1e9
        assert angle(message, 0) == pytest.approx(0.25 * math.sin(2 * t), abs=1e-9)


@pytest.mark.parametrize('arguments', [
    ('-p', 'rate:=0'), ('-p', 'rate:=-5.0'), ('-p', 'rate:=.nan'), ('-p', 'rate:=fast'),
    ('-p', 'joint_1.limit:=3.2'), ('-p', 'frame_prefix:=/x'), ('-p', 'frame_prefix:=7'),
    ('-p', 'use_sim_time:=7'), ('-p', 'rate'), ('--no-such-option',)])
def test_a_bad_start_is_one_line_and_exit_code_2(start, arguments):
    """The line begins with the name of the command."""
    process = start(*ARM, '--ros-args', *arguments)
    assert process.exit_code() == 2
    assert re.fullmatch(r'dummy_arm: .+\n', process.output)


def test_an_unknown_argument_is_exit_code_2(start):
    """The error contains the usage."""
    process = start(*ARM, '--fast')
    assert process.exit_code() == 2
    assert 'usage: dummy_arm' in process.output


def test_help(start):
    """The help says what the arm is, and lists its parameters."""
    process = start(*ARM, '--help')
    assert process.exit_code() == 0
    for text in ('small arm that waves', 'rate', 'joint_3.limit', 'frame_prefix', 'example:'):
        assert text in process.output


@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('rate', [50, 1000, 10000])
@pytest.mark.parametrize('count', [1, pytest.param(5, marks=pytest.mark.soak)])
def test_signals_are_normal_ends(start, signal_number, rate, count):
    """Whatever the arm is doing, it ends soon, with exit code 0 and no traceback."""
    for _ in range(count):
        process = start(*ARM, '--ros-args', '-p', f'rate:={rate}')
        zero(process)
        assert process.end(signal_number) < 5.0
        assert process.exit_code() == 0
        assert process.output.count('\n') == 1, process.output


@pytest.mark.parametrize('delay', [0.0, 0.01, *(
    pytest.param(i / 1000, marks=pytest.mark.soak) for i in range(2, 24, 3))])
def test_two_signals_are_a_normal_end(start, delay):
    """A second signal during the cleanup, as make sends it after Ctrl-C, does not interrupt it."""
    process = start(*ARM, '--ros-args', '-p', 'rate:=1000')
    zero(process)
    process.press_ctrl_c()
    time.sleep(delay)
    process.end(signal.SIGTERM)
    assert process.exit_code() == 0
    assert process.output.count('\n') == 1, process.output


@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('module', [
    'numpy.', 'rclpy.', 'geometry_msgs.', 'dummy_arm.tf._wire.cdr'])
def test_signals_while_it_imports_are_normal_ends(start, signal_number, module):
    """No traceback is printed from within an import."""
    process = start('-X', 'importtime', *ARM)
    process.line_with(f' {module}')
    process.end(signal_number)
    assert process.exit_code() == 0
    assert 'Traceback' not in process.output


def test_a_kill_and_a_restart_are_picked_up(ros, joints, statics, start, kill):
    """A subscriber that keeps running receives the messages of the new arm."""
    process = start(*ARM)
    ros.until(lambda: statics and joints)
    kill(process)
    statics.clear()
    start_ns = zero(start(*ARM))
    ros.until(lambda: statics and joints and ns(joints[-1].transforms[0]) > start_ns)
    assert_static(statics[0])


def test_sim_time_without_a_clock_is_logged(start):
    """Without the log line, the arm would seem to do nothing."""
    process = start(*ARM, '--ros-args', '-p', 'use_sim_time:=true')
    assert 'no message has arrived on /clock' in process.line()


def play(ros, publisher, joints, start_ns):
    """Advance /clock from a time (ns) until 30 more messages arrive; return its time (ns)."""
    enough, now_ns, step_ns = len(joints) + 30, start_ns, 5 * 10**7
    while len(joints) < enough:
        publisher.publish(Clock(clock=Time(nanoseconds=now_ns).to_msg()))
        ros.executor.spin_once(timeout_sec=0.02)
        now_ns += step_ns
        assert now_ns < start_ns + 1000 * step_ns
    return now_ns


def test_sim_time_is_followed_backwards_too(ros, joints, start):
    """Stamps and phases follow /clock, also after it has jumped back."""
    publisher = ros.node.create_publisher(Clock, '/clock', 10)
    start(*ARM, '--ros-args', '-p', 'use_sim_time:=true')
    ros.until(lambda: publisher.get_subscription_count() == 1)
    logs: list[Log] = []
    ros.node.create_subscription(Log, '/rosout', logs.append, LATCHED)

    def check(messages, earliest_ns, latest_ns):
        for message in messages:
            t = (ns(message.transforms[0]) - start_ns) / 1e9
            assert earliest_ns <= ns(message.transforms[0]) <= latest_ns
            np.testing.assert_allclose(
                poses(message), Arm().poses(np.array([0.3, 0.5, 0.7]) * t), atol=1e-9)

    end_ns = play(ros, publisher, joints, 100 * 10**9)
    ros.until(lambda: any('t = 0' in log.msg for log in logs))
    start_ns = zero_in(next(log.msg for log in logs if 't = 0' in log.msg))
    assert 100 * 10**9 <= start_ns < end_ns
    check(joints, start_ns, end_ns)
    count = len(joints)
    end_ns = play(ros, publisher, joints, 40 * 10**9)
    backwards = [m for m in joints[count:] if ns(m.transforms[0]) < 100 * 10**9]
    assert len(backwards) > 20
    check(backwards, 40 * 10**9, end_ns)


def test_a_limit_stays_when_the_clock_goes_back(ros, joints, start):
    """A bag that is played in a loop does not restore the previous limit."""
    publisher = ros.node.create_publisher(Clock, '/clock', 10)
    start(*ARM, '--ros-args', '-p', 'use_sim_time:=true')
    parameters = Parameters(ros)
    play(ros, publisher, joints, 100 * 10**9)
    assert parameters.set(joint_1__limit=0.0) == ['']
    joints.clear()
    play(ros, publisher, joints, 10 * 10**9)
    last = [m for m in joints if ns(m.transforms[0]) < 100 * 10**9]
    assert len(last) > 10
    assert [angle(message, 0) for message in last] == [0.0] * len(last)
