"""The node `dummy_arm`: its messages, its parameters and its ends."""

from contextlib import closing, contextmanager
import math
import re

from cli_runner import call
from environment import ROOT
import numpy as np
from processes import ARM
import pytest
from rclpy.parameter import Parameter
from rclpy.time import Time
from ros_node import command_node, LATCHED, pose_of, Ros
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from dummy_arm.arm import poses as poses_at
from dummy_arm.dummy_arm import DummyArm, main
from puretf import TFMessage

CHAIN = [('base_link', 'joint_1'), ('joint_1', 'joint_2'), ('joint_2', 'joint_3'),
         ('joint_3', 'end_effector')]
S = 10**9
TICK = S // 50  # ns


def ns(message):
    """Return the stamp that all transforms of a message have (ns)."""
    (stamp_ns,) = {Time.from_msg(t.header.stamp).nanoseconds for t in message.transforms}
    return stamp_ns


def edges(message):
    """Return parent and child of each transform."""
    return [(t.header.frame_id, t.child_frame_id) for t in message.transforms]


def poses(message):
    """Return the (n, 7) poses: x, y, z (m), quaternion x, y, z, w."""
    return np.array([*map(pose_of, message.transforms)])


def angle(message, joint):
    """Return the angle of joint 0, 1 or 2 (rad)."""
    rotation = message.transforms[joint].transform.rotation
    return 2 * math.atan2(rotation.z, rotation.w)


def waving(message, start_ns):
    """Return the angles of the formula (rad) at the stamp of a message; t = 0 is at `start_ns`."""
    t = (ns(message) - start_ns) / S
    return np.radians([45, 30, 60]) * np.sin(np.array([0.3, 0.5, 0.7]) * t)


def assert_waves(messages, start_ns):
    """Check that the joints follow the formula at the stamps; t = 0 is at `start_ns`."""
    for message in messages:
        np.testing.assert_allclose(poses(message), poses_at(waving(message, start_ns)), 0, 1e-9)


class SimulatedArm:
    """The arm in this process, its messages, and the time on /clock."""

    def __init__(self, node, ros):
        self.node, self._ros = node, ros
        self.joints: list[TFMessage] = []
        self.statics: list[TFMessage] = []
        ros.node.create_subscription(TFMessage, '/tf', self.joints.append, 1000)
        ros.node.create_subscription(TFMessage, '/tf_static', self.statics.append, LATCHED)
        self.states: list[JointState] = []
        self._commands: list[bytes] = []
        ros.node.create_subscription(JointState, '/joint_states', self.states.append, 1000)
        topic = '/dummy_arm/joint_command'
        ros.node.create_subscription(JointState, topic, self._commands.append, 10, raw=True)
        self._command = ros.node.create_publisher(JointState, topic, 10)
        self._clock = ros.node.create_publisher(Clock, '/clock', 10)
        ros.until(lambda: self.statics and self._command.get_subscription_count() == 2)

    def set_time(self, time_ns):
        """Set the time, and let the arm do what is due at it."""
        def is_set():
            if self.node.get_clock().now().nanoseconds == time_ns:
                return True
            self._clock.publish(Clock(clock=Time(nanoseconds=time_ns).to_msg()))
            return False

        self._ros.until(is_set)
        self._do_what_is_due()

    def _do_what_is_due(self):
        for _ in range(10):
            self._ros.executor.spin_once(timeout_sec=0.0)

    def ticks(self, start_ns, count):
        """Play some ticks at 50 Hz; return their messages."""
        times = [start_ns + i * TICK for i in range(count)]
        before = len(self.joints)
        for time_ns in times:
            self.set_time(time_ns)
        self._ros.until(lambda: self.joints and ns(self.joints[-1]) == times[-1])
        return [message for message in self.joints[before:] if ns(message) in times]

    def command(self, names=(), positions=()):
        """Send a message on ~/joint_command, and let the arm do what it says."""
        self.publish(JointState(name=names, position=positions))

    def publish(self, command):
        """Send a command, or its bytes, and let the arm do what it says."""
        count = len(self._commands)
        self._command.publish(command)
        self._ros.until(lambda: len(self._commands) > count)
        self._do_what_is_due()

    def set(self, **values):
        """Set parameters, `__` for a dot; return the reasons of refusals ('' if accepted)."""
        results = [self.node.set_parameters_atomically([
            Parameter(name.replace('__', '.'), value=value)]) for name, value in values.items()]
        assert all(result.successful == (not result.reason) for result in results)
        return [result.reason for result in results]


@contextmanager
def simulated_arm(domain, *arguments):
    """Create an arm with ROS arguments that waits for /clock."""
    with command_node(DummyArm, domain, '--ros-args', '-p', 'use_sim_time:=true', *arguments
                      ) as (node, ros):
        yield SimulatedArm(node, ros)


@pytest.fixture
def arm(domain_id):
    """An arm that waits for /clock."""
    with simulated_arm(domain_id) as arm:
        yield arm


def test_early_and_late_subscribers_get_the_arm(ros, start):
    """Both get the static transform; the joints follow the formula at their stamps."""
    joints: list[TFMessage] = []
    statics: list[TFMessage] = []
    late: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf', joints.append, 1000)
    ros.node.create_subscription(TFMessage, '/tf_static', statics.append, LATCHED)
    process = start(*ARM)
    log = re.fullmatch(
        r'\[INFO\] .*: publishing map -> base_link on /tf_static, base_link -> joint_1 -> '
        r'joint_2 -> joint_3 -> end_effector on /tf, joint angles on /joint_states at 50 Hz; '
        r't = 0 at (\d+) ns\n',
        process.line())
    assert log is not None
    ros.until(lambda: statics and len(joints) > 20)
    ros.node.create_subscription(TFMessage, '/tf_static', late.append, LATCHED)
    ros.until(lambda: late)
    for message in (*statics, *late):
        assert edges(message) == [('map', 'base_link')]
        np.testing.assert_array_equal(poses(message), [[0, 0, 0, 0, 0, 0, 1]])
    assert {*map(tuple, map(edges, joints))} == {tuple(CHAIN)}
    assert_waves(joints, int(log[1]))
    process.end_normally()
    assert process.output.count('\n') == 1


def test_a_late_subscriber_gets_the_description(arm_domain):
    """It is the text of the file, as the robot_state_publisher sends it."""
    received: list[String] = []
    with closing(Ros(arm_domain)) as ros:
        ros.node.create_subscription(String, '/robot_description', received.append, LATCHED)
        ros.until(lambda: received)
    assert [each.data for each in received] == [
        (ROOT / 'dummy_arm' / 'urdf' / 'dummy_arm.urdf').read_text()]


@pytest.mark.parametrize('argument', [
    'rate:=0', 'rate:=-5.0', 'rate:=fast', 'frame_prefix:=/x', 'frame_prefix:=7', 'publish_tf:=1'])
def test_a_bad_start_is_one_line_and_exit_code_2(domain_id, argument):
    """The line names the parameter."""
    code, output, error = call(main, '--ros-args', '-p', argument, domain=domain_id)
    assert (code, output) == (2, '')
    assert re.fullmatch(rf'dummy_arm: .*{argument.split(":")[0]}.* (must|out of|expecting) .+\n',
                        error)


def test_the_help_has_every_parameter(capsys, arm):
    """Those that rclpy adds to every node are not in it."""
    with pytest.raises(SystemExit):
        main(['--help'])
    text = capsys.readouterr().out
    names = {name for name in arm.node.get_parameters_by_prefix('')
             if not name.startswith(('start_type', 'qos'))}
    assert len(names) > 10
    for name in names:
        assert f'\n  {name} ' in text


def test_sim_time_without_a_clock_is_logged(domain_id):
    """Without the log line, the arm would seem to do nothing."""
    result = call(main, '--ros-args', '-p', 'use_sim_time:=true', domain=domain_id,
                  until=lambda text: 'waiting for a message on /clock' in text)
    assert result.code == 0


def test_sim_time_is_followed_backwards_too(arm):
    """Stamps and phases follow /clock, also after it has jumped back."""
    for begin_ns in 100 * S, 40 * S:
        arm.set_time(begin_ns - TICK)
        messages = arm.ticks(begin_ns, 30)
        assert [*map(ns, messages)] == [begin_ns + i * TICK for i in range(30)]
        assert_waves(messages, 100 * S - TICK)


def test_new_speeds_and_limits(arm):
    """A new speed keeps the phase, and a new limit is reached within a second."""
    arm.ticks(100 * S, 50)
    assert arm.set(joint_1__speed=3.0, joint_2__limit=2.0) == ['', '']
    messages = arm.ticks(101 * S, 100)[-30:]
    t = np.array([ns(message) - 100 * S for message in messages]) / S
    for joint, expected in enumerate((
            math.pi / 4 * np.sin(0.3 * 0.98 + 3.0 * (t - 0.98)), 2.0 * np.sin(0.5 * t),
            math.radians(60) * np.sin(0.7 * t))):
        np.testing.assert_allclose([angle(each, joint) for each in messages], expected, atol=1e-9)


def test_a_new_rate_is_taken_at_once(domain_id):
    """The arm does not wait for the next tick, even if ticks are ten seconds apart."""
    with simulated_arm(domain_id, '-p', 'rate:=0.1') as arm:
        arm.ticks(100 * S, 1)
        arm.set_time(109 * S)
        assert arm.set(rate=50) == ['']
        arm.ticks(109 * S + TICK, 5)
        assert [*map(ns, arm.joints)] == [100 * S, *(109 * S + i * TICK for i in range(1, 6))]


def test_a_new_offset_moves_the_frame(arm):
    """The frame moves along the previous link."""
    assert arm.set(joint_2__offset=1.5) == ['']
    (message,) = arm.ticks(100 * S, 1)
    assert [*poses(message)[1, :3]] == [1.5, 0.0, 0.0]


def test_nonsense_is_refused_with_a_reason(arm):
    """The arm continues to publish, with the old values."""
    before = arm.node.get_parameters_by_prefix('')
    for name, value, reason in (
            ('rate', 0, 'rate must be a number from 0.1 to 10000 Hz, got 0'),
            ('rate', 0.0, 'from 0.1 to 10000 Hz, got 0.0'), ('rate', math.nan, 'Hz, got nan'),
            ('rate', 'fast', "rate must be a number from 0.1 to 10000 Hz, got 'fast'"),
            ('rate', True, 'rate must be a number'), ('rate', None, 'rate must be a number'),
            ('joint_1__limit', 3.2, 'from 0 to 3.14159 rad, got 3.2'),
            ('joint_1__limit', 4, 'joint_1.limit must be a number from 0 to 3.14159 rad, got 4'),
            ('joint_3__speed', math.inf, 'from -100 to 100 rad/s, got inf'),
            ('frame_prefix', 'x/', 'read-only'), ('publish_tf', False, 'read-only')):
        (returned,) = arm.set(**{name: value})
        assert reason in returned
    after = arm.node.get_parameters_by_prefix('')
    assert {name: each.value for name, each in before.items()} == {
        name: each.value for name, each in after.items()}
    assert_waves(arm.ticks(100 * S, 5), 100 * S)


def test_parameters_at_the_start(domain_id):
    """Speeds, limits and the prefix can be set on the command line; integers are accepted."""
    with simulated_arm(domain_id, '-p', 'joint_1.speed:=2', '-p', 'joint_1.limit:=0.25', '-p',
                       'joint_1.offset:=1', '-p', 'frame_prefix:=robot1/') as arm:
        messages = arm.ticks(100 * S, 20)
        assert edges(arm.statics[0]) == [('map', 'robot1/base_link')]
    for message in messages:
        assert edges(message) == [(f'robot1/{a}', f'robot1/{b}') for a, b in CHAIN]
        assert message.transforms[0].transform.translation.z == 1.0
        t = (ns(message) - 100 * S) / S
        assert angle(message, 0) == pytest.approx(0.25 * math.sin(2 * t), abs=1e-9)


def test_the_joint_states_are_those_of_the_transforms(arm):
    """At each stamp, the angles are those by which the frames are rotated."""
    messages = arm.ticks(100 * S, 30)
    states = {Time.from_msg(state.header.stamp).nanoseconds: state for state in arm.states}
    for message in messages:
        state = states[ns(message)]
        assert state.name == ['joint_1', 'joint_2', 'joint_3']
        np.testing.assert_allclose(state.position, [angle(message, i) for i in range(3)],
                                   atol=1e-12)


def test_a_joint_is_held_while_the_others_wave(arm):
    """A second command adds a second joint."""
    arm.ticks(100 * S, 50)
    for names, positions, held in (['joint_1'], [0.5], [0.5, None, None]), (
            ['joint_3', 'joint_1'], [-1.0, 0.6], [0.6, None, -1.0]):
        arm.command(names, positions)
        for message in arm.ticks(ns(arm.joints[-1]) + TICK, 50):
            expected = [wave if position is None else position
                        for wave, position in zip(waving(message, 100 * S), held)]
            np.testing.assert_allclose([angle(message, i) for i in range(3)], expected, atol=1e-12)


def test_all_joints_wave_again(arm):
    """They return to the formula within a second, and not at once."""
    arm.command(['joint_1', 'joint_2'], [0.7, -0.5])
    arm.ticks(100 * S, 5)
    arm.command()
    messages = arm.ticks(100 * S + 5 * TICK, 60)
    assert angle(messages[1], 0) == pytest.approx(0.7, abs=0.01)
    assert_waves(messages[52:], 100 * S)


@pytest.mark.parametrize(('names', 'positions', 'problem'), [
    (['joint_1', 'joint_9\n'], [0.1, 0.1],
     r"there is no joint 'joint_9\n'. Nearest known: 'joint_3', 'joint_2', 'joint_1'."),
    (['joint_1', 'joint_2'], [0.1],
     'it has 1 positions for 2 joints (joint_1, joint_2); each joint needs one'),
    ([], [0.1], 'it has 1 positions for 0 joints (none); each joint needs one'),
    (['joint_1', 'joint_2'], [0.1, 0.6], f'joint_2 must be at an angle from {-math.radians(30)} '
                                         f'to {math.radians(30)} rad, got 0.6'),
    (['joint_3'], [math.nan], f'joint_3 must be at an angle from {-math.radians(60)} to '
                              f'{math.radians(60)} rad, got nan')])
def test_a_wrong_command_is_refused(capfd, arm, names, positions, problem):
    """A warning says why, and no joint is held, not even one that is named rightly."""
    arm.command(names, positions)
    assert_waves(arm.ticks(100 * S, 30), 100 * S)
    arm.command(names, positions)  # is not logged again
    arm.ticks(200 * S, 5)
    error = capfd.readouterr().err
    assert error.count(f'refused a message on /dummy_arm/joint_command: {problem}\n') == 1


def test_malformed_commands_are_named_once(capfd, arm):
    """The middleware prints nothing; the next command is obeyed."""
    for _ in range(3):
        arm.publish(b'\0\1\0\0' + bytes(16) + b'\xff' * 4)
    arm.command(['joint_1'], [0.5])
    assert angle(arm.ticks(100 * S, 60)[-1], 0) == pytest.approx(0.5)
    error = capfd.readouterr().err
    assert 'sequence size' not in error
    assert error.count('dropped a message on /dummy_arm/joint_command that cannot be decoded: a '
                       'JointState of 24 bytes ends in the middle of a field; published by /') == 1


def test_what_is_switched_off_is_not_published(domain_id):
    """Then robot_state_publisher can send the transforms; base_link stays on /tf_static."""
    with simulated_arm(domain_id, '-p', 'publish_tf:=false', '-p', 'publish_joint_states:=false',
                       '-p', 'publish_description:=false') as arm:
        names = {name for name, _ in arm.node.get_publisher_names_and_types_by_node(
            'dummy_arm', '/')}
        assert edges(arm.statics[0]) == [('map', 'base_link')]
    assert '/tf_static' in names
    assert not names & {'/tf', '/joint_states', '/robot_description'}
