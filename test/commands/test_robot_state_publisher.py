"""The command `robot_state_publisher` and its node, against recordings of the real 3.3.3."""

from functools import partial
import json
import re
from typing import Any

from cli_runner import call
from environment import DATA
import pytest
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from recorded_robots import ACCEPTED, answer, assert_equal, CASES, fixed, OF_THE_COMMAND
from ros_node import command_node, LATCHED, pose_of
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from puretf import TFMessage
from puretf_tools.commands.robot_state_publisher import main
from puretf_tools.robot import state_publisher
from puretf_tools.robot.state_publisher import RobotStatePublisher

NAME = 'robot_state_publisher'


def transforms_of(message):
    """Return frame_id, child_frame_id and the seven numbers of each transform of a message."""
    return [(transform.header.frame_id, transform.child_frame_id, pose_of(transform))
            for transform in message.transforms]


def joint_states(stamp, names, positions):
    """Return a message; the stamp is (s, ns)."""
    message = JointState(name=names, position=[*map(float, positions)])
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    return message


class Peer:
    """What a node of the test sends to a robot_state_publisher, and receives from it."""

    def __init__(self, ros, publishers=()):
        """Create the publishers and subscriptions, and wait for those of the other node."""
        self.ros = ros
        self.tf: list[TFMessage] = []
        self.static: list[TFMessage] = []
        self.texts: list[str] = []
        node = ros.node
        node.create_subscription(TFMessage, '/tf', self.tf.append, 100)
        node.create_subscription(TFMessage, '/tf_static', self.static.append, LATCHED)
        node.create_subscription(
            String, '/robot_description', lambda message: self.texts.append(message.data), LATCHED)
        self.states = node.create_publisher(JointState, 'joint_states', 10)
        self.clock = node.create_publisher(Clock, '/clock', 10)
        self._markers = 0
        ros.until(lambda: self.static and self.texts and self.states.get_subscription_count())
        ros.until(lambda: all(
            each.get_subscription_count() for each in publishers if each.topic_name == '/tf'))

    def wait_for_fixed(self, children):
        """Wait for a message on /tf_static with these child frames."""
        expected = [*children]
        self.ros.until(lambda: expected == [
            transform.child_frame_id for transform in self.static[-1].transforms])

    def send(self, states):
        """Send a message and wait for the answer to one after it; return the answers before."""
        del self.tf[:]
        self.states.publish(states)
        # The answer to the marker is always an empty message.
        self._markers += 1
        self.states.publish(joint_states([1_600_000_000 + 10 * self._markers, 0], ['marker'], [0]))
        self.ros.until(lambda: self.tf and not self.tf[-1].transforms)
        return self.tf[:-1]


@pytest.fixture
def file(tmp_path):
    """The path of a description."""
    path = tmp_path / 'robot.urdf'
    path.write_text(CASES['chain']['urdf'])
    return path


@pytest.mark.parametrize('name', [
    'chain', 'mimic', 'planar_and_floating', 'names', 'prefix_ä b/', 'rate_default',
    'rate_publish_frequency_0.0', 'stamp_nanosec_too_large', 'not_finite_positions', 'lengths',
    'rate_ignore_timestamp', 'sim_time', 'change_description', 'change_parameters', 'one_link'])
def test_answers_over_dds(domain_id, name):
    """Answers, their stamps, fixed transforms and the text are those of the real one."""
    case = CASES[name]
    overrides = [Parameter(key, value=value) for key, value in case['parameters'].items()]
    with command_node(lambda: RobotStatePublisher(case['urdf'], parameter_overrides=overrides),
                      domain_id) as (node, ros):
        peer = Peer(ros, node.publishers)
        assert_equal(transforms_of(peer.static[-1]), fixed(case, -1))
        answered = {message['step'] for message in case['tf']}
        static = {message['step'] for message in case['tf_static']}
        for step, states in enumerate(case['joint_states']):
            for change in states.get('before', ()):
                apply(node, peer, change)
            if step in static:
                expected = fixed(case, step)
                peer.wait_for_fixed(child for _, child, _ in expected)
                assert_equal(transforms_of(peer.static[-1]), expected)
            if not states['name']:
                continue  # its answer would be taken for that to the marker
            if step in answered and not answer(case, step):
                continue  # so would this one
            answers = peer.send(joint_states(states['stamp'], states['name'], states['position']))
            assert len(answers) == (step in answered), step
            for message in answers:
                assert_equal(transforms_of(message), answer(case, step))
                assert {(transform.header.stamp.sec, transform.header.stamp.nanosec)
                        for transform in message.transforms} == {tuple(states['stamp'])}
        assert peer.texts[0] == case['urdf']
        assert peer.texts[-1] == node.get_parameter('robot_description').value


def apply(node, peer, change):
    """Send a time on /clock, or set a parameter, with the result of the real one."""
    if 'clock' in change:
        message = Clock()
        message.clock.sec, message.clock.nanosec = change['clock']
        peer.ros.until(lambda: peer.clock.get_subscription_count())
        peer.clock.publish(message)
        peer.ros.until(lambda: node.get_clock().now().to_msg() == message.clock)
        return
    (name, value), = change['set_parameters'].items()
    if (name, value) != ('publish_frequency', 20):  # ours accepts integers
        result, = node.set_parameters([Parameter(name, value=value)])
        assert result.successful == change['result'][0]
        assert result.successful or result.reason.isprintable()


def test_a_late_state_after_a_reset_of_the_clock(domain_id):
    """It is ignored, the next ones are answered, and the log names stamp and publisher."""
    chain, logs = CASES['chain'], list[Any]()
    names, positions = (chain['joint_states'][0][key] for key in ('name', 'position'))
    with command_node(lambda: RobotStatePublisher(chain['urdf'], parameter_overrides=[
            Parameter('use_sim_time', value=True)]), domain_id) as (node, ros):
        peer = Peer(ros, node.publishers)
        ros.node.create_subscription(Log, '/rosout', logs.append, 100)
        found = []
        for clock, stamp in (110, 110), (5, 5), (6, 111), (7, 7), (7, 2**31 - 1), (8, 8):
            apply(node, peer, {'clock': [clock, 0]})
            found += [(clock, stamp) for _ in peer.send(
                joint_states([stamp, 0], names, positions))]
        assert found == [(110, 110), (5, 5), (7, 7), (8, 8)]
        ros.until(lambda: any(
            'ahead of the clock of this node by 105.0 s' in log.msg and log.msg.endswith(
                'publishers of /joint_states: /test') for log in logs))


@pytest.mark.parametrize('name', OF_THE_COMMAND)
def test_arguments_and_parameters(domain_id, file, name):
    """Where the real one dies, ours prints one line and exits with code 2."""
    case = CASES[name]
    file.write_text(case['urdf'])
    arguments = case.get('arguments') or [str(file)]
    parameters = [f'{key}:={json.dumps(value)}' for key, value in case['parameters'].items()]
    result = call(main, *arguments, *(['--ros-args', '-p', *parameters] if parameters else []),
                  domain=domain_id, until=lambda text: 'Robot initialized' in text)
    assert not result.stdout
    assert not result.stderr.splitlines()[1:]
    assert result.code == (0 if name in ACCEPTED else 2)
    if name not in ACCEPTED:
        assert result.stderr.startswith(f'{NAME}: ')


@pytest.mark.parametrize('text', ['{file}', '$(command "cat {file}")'])
def test_the_command_that_an_error_names_works(domain_id, file, text):
    """The parameter is a file, or has not been expanded."""
    result = call(main, '--ros-args', '-p', 'robot_description:=' + json.dumps(
        text.format(file=file)), domain=domain_id)
    assert (result.code, result.stdout, result.stderr.splitlines()[1:]) == (2, '', [])
    command, = re.findall(f'; {NAME} (.*) takes a file', result.stderr)
    assert call(main, command.replace('FILE', str(file)), domain=domain_id,
                until=lambda text: 'Robot initialized' in text).code == 0


def test_topics_qos_and_parameters_are_those_of_the_real_one(domain_id):
    """Its source says which names are relative, and which policies they have."""
    with command_node(lambda: RobotStatePublisher(CASES['chain']['urdf'], namespace='left'),
                      domain_id) as (node, ros):
        latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
        expected = {
            ('/tf', 'publishers'): (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
            ('/tf_static', 'publishers'): latched,
            ('/left/robot_description', 'publishers'): latched,
            ('/left/joint_states', 'subscriptions'): (ReliabilityPolicy.BEST_EFFORT,
                                                      DurabilityPolicy.VOLATILE)}
        for (topic, kind), policies in expected.items():
            infos = partial(getattr(ros.node, f'get_{kind}_info_by_topic'), topic)
            ros.until(infos)
            assert [(info.qos_profile.reliability, info.qos_profile.durability)
                    for info in infos()] == [policies]
        for name in ('use_sim_time', *(
                f'qos_overrides.{topic}.{kind}.{policy}' for topic, kind in (
                    ('/left/joint_states', 'subscription'), ('/tf', 'publisher'),
                    ('/tf_static', 'publisher'))
                for policy in ('depth', 'history', 'reliability'))):
            assert node.has_parameter(name), name


def test_a_changed_prefix_applies_to_fixed_joints_at_once(domain_id):
    """The real one sends them with the next description only, so the tree falls apart."""
    with command_node(lambda: RobotStatePublisher(CASES['chain']['urdf']), domain_id) as (
            node, ros):
        peer = Peer(ros)
        node.set_parameters([Parameter('frame_prefix', value='x/')])
        peer.wait_for_fixed(['x/l1', 'x/tool'])


def test_joints_without_a_position_are_named(domain_id, file, monkeypatch):
    """A warning names them some seconds after the start."""
    monkeypatch.setattr(state_publisher, 'PATIENCE', 0.1)
    assert call(main, str(file), domain=domain_id, until=lambda text: (
        'no JointState message has been accepted yet' in text)).code == 0


@pytest.mark.parametrize('options', [[], ['--namespace', 'left', 'unused:=1'], [
    '--ros-args', '-p', 'publish_frequency:=50.0']])
def test_arguments_of_xacro(domain_id, options):
    """They come after the file, as those of the command xacro; the error has this form."""
    pytest.importorskip('xacro')
    file = str(DATA / 'robots' / 'arg.urdf.xacro')
    code, output, error = call(main, file, *options, domain=domain_id)
    assert (code, output, error.splitlines()[1:]) == (2, '', [])
    given, = re.findall(r'; write (.*):=VALUE\n', error)
    assert call(main, *f'{given}:=ur5e'.split(), *options, domain=domain_id,
                until=lambda text: 'Robot initialized' in text).code == 0


@pytest.mark.parametrize(('arguments', 'message'), [
    (['a:=b'], 'a:=... is an argument of a .xacro file: write the name of the file before it'),
    ([str(DATA / 'robots' / 'geometry_two.urdf'), 'joint_states:=/b'],
     'or write --ros-args -r joint_states:=... if it remaps a name')])
def test_arguments_without_a_file_of_xacro(domain_id, arguments, message):
    """They are refused: rcl would take them for remappings, with a warning."""
    code, output, error = call(main, *arguments, domain=domain_id)
    assert (code, output, error.splitlines()[1:]) == (2, '', [])
    assert message in error


def test_each_description_is_warned_of(ros, capfd):
    """Also one that is set while the node runs."""
    urdf = ('<robot name="r"><link name="a"/><link name="b"/><joint name="{}" type="floating">'
            '<parent link="a"/><child link="b"/></joint></robot>')
    node = RobotStatePublisher(urdf.format('one'), context=ros.context)
    text = Parameter('robot_description', value=urdf.format('two'))
    assert node.set_parameters([text])[0].successful
    node.destroy_node()
    logged = capfd.readouterr().err
    assert "joint 'one' is floating" in logged
    assert "joint 'two' is floating" in logged
