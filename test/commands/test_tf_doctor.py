"""The command `tf_doctor` on real DDS: publishers, headers of other topics, healthy systems."""

from importlib import import_module
import json
import os
import re
import shutil
import signal

from cli_runner import call
from geometry_msgs.msg import PointStamped
from processes import cpu_seconds, TIMEOUT, tool
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from ros_node import eventually, LATCHED, point, stamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from puretf import StaticTransformBroadcaster, TFMessage, TransformBroadcaster
from puretf._ros import topic_watch
from puretf_tools.cli import progress
from puretf_tools.commands import tf_doctor
from puretf_tools.commands.tf_doctor import main
from puretf_tools.inspection import clock_sampler, header_sampler
from puretf_tools.robot.state_publisher import RobotStatePublisher

S = 10**9
SIM_TIME = '--ros-args', '-p', 'use_sim_time:=true'


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """Let the command search for topics twenty times a second."""
    for module in clock_sampler, topic_watch:
        monkeypatch.setattr(module, '_SCAN_INTERVAL', 0.05)


def run(ros, *arguments, publishers, send=lambda now: None, ticks=40):
    """
    Call the command; press Ctrl-C when it has heard the publishers for some time.

    :param publishers: those to which the command subscribes.
    :param send: called 50 times per second with the current time (ns).
    :param ticks: how often it is called when all are heard.
    """
    unheard, left = {*publishers}, ticks

    def tick():
        nonlocal unheard, left
        send(ros.node.get_clock().now().nanoseconds)
        unheard = {each for each in unheard if not each.get_subscription_count()}
        left -= not unheard
        if left == 0:
            os.kill(os.getpid(), signal.SIGINT)

    timer = ros.node.create_timer(0.02, tick)
    with ros.spinning():
        result = call(main, '--time', '1000', *arguments, domain=ros.domain)
    ros.node.destroy_timer(timer)
    return result


def examine(ros, *arguments, **kwargs):
    """Run the command as `run` does; return the exit code, and the JSON that it prints."""
    result = run(ros, '--json', *arguments, **kwargs)
    return result.code, json_in(result)


def json_in(result):
    """Return the JSON on stdout, where Fast DDS may say that another process opens a port, too."""
    return json.loads(re.sub(
        r'^\x1b.*RTPS_TRANSPORT_SHM.*Failed init_port.*\n', '', result.stdout, flags=re.MULTILINE))


def codes(data):
    """
    Return the codes of what was found.

    A busy machine, as during other tests, stops publishers and listeners for so long that there
    are real gaps and late transforms.
    """
    return {finding['code'] for finding in data['findings']} - {'gap', 'late', 'listener_busy'}


def finding_of(data, code):
    """Return the only finding with a code."""
    (finding,) = (each for each in data['findings'] if each['code'] == code)
    return finding


def test_publishers_and_headers(ros, other):
    """Two publishers, unlatched and best-effort ones, headers, transforms from another clock."""
    senders = [TransformBroadcaster(node) for node in (ros.node, other)]
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(stamped('map', 'odom'))
    other.create_publisher(TFMessage, '/tf_static', 10)
    other.create_publisher(
        TFMessage, '/tf', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    other.create_subscription(TFMessage, '/tf_static', lambda _: None, 10)
    points = ros.node.create_publisher(PointStamped, '/point', LATCHED)
    points.publish(point('lost'))
    joints = ros.node.create_publisher(JointState, '/joint_states', 10)
    malformed = ros.node.create_publisher(PointStamped, '/malformed', 10)

    def send(now):
        for i, sender in enumerate(senders):
            sender.sendTransform([stamped('odom', 'base_link', now + i, float(i))])
        senders[1].sendTransform(stamped('base_link', 'wheel', now - 100 * S))
        joints.publish(JointState())
        for message in b'', b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 20, point('lost'):
            malformed.publish(message)

    status, data = examine(ros, send=send, publishers=[
        *(sender.pub_tf for sender in senders), static.pub_tf, points, joints, malformed])
    assert status == 1
    assert {each['code']: (each['frames'], each['topics'], sorted(each['nodes']))
            for each in data['findings'] if each['code'] in codes(data)} == {
        'two_publishers': (['base_link'], ['/tf'], ['/other', '/test']),
        'unknown_frame': (['lost'], ['/malformed', '/point'], []),
        'static_not_latched': ([], ['/tf_static'], ['/other']),
        'volatile_listener': ([], ['/tf_static'], ['/other']),
        'incompatible_qos': ([], ['/tf'], ['/other']),
        'other_clock': (['wheel'], ['/tf'], ['/other'])}
    assert '(/other) are not reliable: ' in finding_of(data, 'incompatible_qos')['evidence']
    assert not [text for text in data['not_checked'] if not text.startswith('headers on')]


URDF = """<robot name="gripper">
<link name="base"/><link name="arm"/><link name="left"/><link name="tip"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/></joint>
<joint name="grip" type="continuous"><parent link="arm"/><child link="left"/></joint>
<joint name="end" type="fixed"><parent link="left"/><child link="tip"/></joint></robot>"""


def test_joint_states_of_another_type(ros):
    """The joints are without a state, and the headers of the messages are examined."""
    make = ros.node.create_publisher
    text, points = make(String, '/robot_description', LATCHED), make(
        PointStamped, '/joint_states', 10)
    text.publish(String(data=URDF))
    _, data = examine(ros, send=lambda now: points.publish(point('lost', now)),
                      publishers=[text, points], ticks=120)
    assert codes(data) >= {'joint_without_state', 'unknown_frame'}
    assert finding_of(data, 'joint_without_state')['evidence'] == (
        '2 of 2 movable joints are not on /joint_states, where nothing was received: turn, grip')


def test_messages_at_their_stamps(ros):
    """Each topic has a row, also a latched one."""
    sender = TransformBroadcaster(ros.node)
    fast = ros.node.create_publisher(PointStamped, '/fast', 100)
    path = ros.node.create_publisher(PointStamped, '/path', LATCHED)

    def send(now):
        sender.sendTransform([stamped('map', 'odom', now - 3 * S // 10), stamped('map', 'a', now)])
        path.publish(point('odom', now))
        for _ in range(4):
            fast.publish(point('a', now - 3 * S // 100))

    status, data = examine(ros, send=send, ticks=100, publishers=[sender.pub_tf, fast, path])
    assert (status, codes(data)) == (0, {'message_early'})
    finding = finding_of(data, 'message_early')
    assert (finding['topics'], finding['nodes']) == (['/path'], ['/test'])
    assert 'edge map -> odom of /test, up to ' in finding['evidence']
    table = {row['topic']: row for row in data['topics']}
    assert table['/fast']['at_once'] > 0.8
    assert table['/fast']['messages'] > 3 * table['/path']['messages']
    assert table['/path']['waiting'] == 1.0
    assert 0.2 < table['/path']['median_wait'] < 0.6
    assert table['/path']['queue'] >= 5  # in 0.3 s, on a busy computer


def test_a_type_that_cannot_be_imported(ros, monkeypatch):
    """Its headers are listed as not checked, with the reason."""
    def fail(name):
        if name == 'sensor_msgs.msg':
            raise OSError('no memory')
        return import_module(name)

    monkeypatch.setattr(header_sampler, 'import_module', fail)
    ros.node.create_publisher(JointState, '/joints', 10)
    points = ros.node.create_publisher(PointStamped, '/point', 10)
    _, data = examine(ros, '--ignore', 'no_transforms', publishers=[points])
    assert data['not_checked'] == ['headers on /joints: its type sensor_msgs/msg/JointState '
                                   'cannot be imported (OSError: no memory)']


def test_a_middleware_that_does_not_report_gids(ros, other, handles):
    """Whether a frame has two publishers is not checked; they are not known."""
    static = [StaticTransformBroadcaster(node) for node in (ros.node, other)]
    for x, each in enumerate(static):
        each.sendTransform([stamped('map', '/odom', x=float(x))])
    status, data = examine(ros, publishers=[each.pub_tf for each in static], ticks=100)
    assert (status, codes(data)) == (0, {'leading_slash'})
    assert data['not_checked'] == [
        'two_publishers, many_publishers: the ROS graph does not know the publishers of the '
        'transforms']
    assert {*data['findings'][0]['nodes']} == {'unknown publisher'}


def test_half_a_namespace(ros, make_node):
    """It is found from both sides, and where a path leads to it; the remedy works."""
    static = StaticTransformBroadcaster(
        make_node('driver', namespace='/robot1'), tf_static_topic='/robot1/tf_static')
    static.sendTransform(stamped('odom', 'base_link'))
    sender = TransformBroadcaster(make_node('slam'))

    def send(now):
        sender.sendTransform(stamped('map', 'odom', now))

    text = ("'odom' -> 'base_link' is published on /robot1/tf_static by /robot1/driver, not on "
            '/tf and /tf_static')
    for arguments, evidence in ((), text), (('--namespace', 'robot1'), (
            "'map' -> 'odom' is published on /tf by /slam, not on /robot1/tf and "
            '/robot1/tf_static')):
        status, data = examine(
            ros, *arguments, send=send, publishers=[sender.pub_tf, static.pub_tf])
        assert (status, codes(data)) == (1, {'half_namespace'})
        finding = finding_of(data, 'half_namespace')
        assert finding['evidence'] == evidence
        assert {*finding['nodes']} == {'/slam', '/robot1/driver'}
    code, output, _ = run(ros, 'map', 'base_link', send=send, publishers=[sender.pub_tf])
    assert (code, text in ' '.join(output.split())) == (1, True)
    remapped = '--ros-args -r /tf:=/robot1/tf -r /tf_static:=/robot1/tf_static'
    assert 'Remap both /tf and /tf_static in all nodes of the robot' in finding['remedy']
    sender = TransformBroadcaster(make_node('again', cli_args=remapped.split()))
    status, data = examine(ros, '--namespace', 'robot1', send=send, publishers=[sender.pub_tf])
    assert (status, codes(data)) == (0, set())


def test_two_nodes_send_joint_states(ros, make_node):
    """If both send one joint, they are named; so is a joint without a state."""
    make_node(URDF, is_spun=True, kind=RobotStatePublisher)
    publishers = [node.create_publisher(JointState, '/joint_states', 10)
                  for node in (ros.node, make_node('gui'))]

    def send(now):
        for publisher, position in zip(publishers, (2.0, 0.0)):
            state = JointState(name=['turn'], position=[position])
            state.header.stamp = Time(nanoseconds=now).to_msg()
            publisher.publish(state)

    _, data = examine(
        ros, '--ignore', 'several_trees', send=send, publishers=publishers, ticks=60)
    assert codes(data) == {'two_joint_publishers', 'joint_without_state'}
    finding = finding_of(data, 'joint_without_state')
    assert (finding['frames'], finding['evidence']) == (
        ['left'], '1 of 2 movable joints are not on /joint_states, which names turn: grip')
    finding = finding_of(data, 'two_joint_publishers')
    assert ({*finding['nodes']}, finding['frames']) == ({'/test', '/gui'}, ['arm'])
    assert ' messages) send turn on /joint_states' in finding['evidence']


def test_a_node_that_does_not_use_the_clock(ros, make_node):
    """It is named; the publisher of /clock is not."""
    nodes = [make_node(name, is_spun=True, parameter_overrides=[
        Parameter('use_sim_time', value=name == 'nav')]) for name in ('nav', 'driver')]
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    senders = [TransformBroadcaster(node) for node in nodes]
    begin = ros.node.get_clock().now().nanoseconds

    def send(now):
        stamp = now - begin + 100 * S
        clock.publish(Clock(clock=Time(nanoseconds=stamp).to_msg()))
        for sender, edge, each in zip(senders, (('map', 'odom'), ('odom', 'base')), (stamp, now)):
            sender.sendTransform(stamped(*edge, each))

    status, data = examine(ros, send=send, ticks=50, publishers=[
        clock, *(sender.pub_tf for sender in senders)])
    assert (status, codes(data) - {'future'}) == (1, {'use_sim_time_differs'})
    assert finding_of(data, 'use_sim_time_differs')['evidence'] == (
        'use_sim_time is false in /driver, and true in /nav, while /test publishes /clock')


@pytest.mark.parametrize('arguments', [(), ('map', 'odom')])
def test_nothing_is_published(domain_id, monkeypatch, arguments):
    """Without transforms, the settings to check are named; the exit code is 1."""
    monkeypatch.setattr(progress, 'DISCOVERY', 0.1)
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.0)
    code, output, _ = call(main, '--time', '0.2', *arguments, domain=domain_id)
    assert code == 1
    assert f'0 publishers on /tf and /tf_static were found in ROS domain {domain_id}.' in ' '.join(
        output.split())
    if not arguments:
        assert 'error no_transforms: ' in output


def test_the_path_between_two_frames(ros, make_node):
    """The path is listed with publishers, rates and stamps."""
    static = StaticTransformBroadcaster(make_node('other', namespace='/robot'))
    sender = TransformBroadcaster(ros.node)
    static.sendTransform(stamped('base_link', 'camera'))

    def send(now):
        sender.sendTransform([stamped('base_link', 'arm', now), stamped('arm', 'hand', now),
                              *(stamped('base_link', 'mark', each * S) for each in (100, 102))])

    publishers = [static.pub_tf, sender.pub_tf]
    code, output, _ = run(ros, 'camera', '/hand', send=send, publishers=publishers, ticks=50)
    assert code == 0, output
    lines = output.splitlines()
    rate = r' +\d+\.\d Hz  \d+\.\d{9} to \d+\.\d{9}  /test'
    for line, expected in zip(lines[2:5], (
            'base_link -> camera  static +/robot/other', f'base_link -> arm{rate}',
            f'arm -> hand{rate}')):
        assert re.fullmatch(expected, line)
    assert re.fullmatch(r'The transform from hand to camera exists at \d+\.\d{9}, '
                        r'\d+\.\d{3} s before the end of listening\.', lines[-1])
    code, output, _ = run(ros, 'mark', 'camera', '-t', '101', send=send, publishers=publishers)
    assert (code, output.splitlines()[-1]) == (
        0, 'The transform from camera to mark exists at 101.000000000.')


@pytest.mark.parametrize(('arguments', 'is_reset'), [
    ((), False), (SIM_TIME, False), (SIM_TIME, True)])
def test_sim_time(ros, arguments, is_reset):
    """Stamps that fit /clock are compared with it; buffers were cleared when it jumped back."""
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    sender = TransformBroadcaster(ros.node)
    begin = ros.node.get_clock().now().nanoseconds
    heard = [0]

    def send(now):
        heard[0] += sender.pub_tf.get_subscription_count()
        simulated = now - begin + (5 if is_reset and heard[0] > 20 else 100) * S
        clock.publish(Clock(clock=Time(nanoseconds=simulated).to_msg()))
        if heard[0] != 21:  # the clock arrives before the first transform
            sender.sendTransform(stamped('map', 'odom', simulated))

    _, data = examine(ros, '--ignore', 'future', *arguments, send=send, ticks=50,
                      publishers=[clock, sender.pub_tf])
    assert codes(data) == {'time_goes_back'} if is_reset else not codes(data)
    assert 'refuses' not in str(data['findings'])
    assert data['clock'] == 'times are those of /clock, published by /test'
    assert not [text for text in data['not_checked'] if not text.startswith('headers on')]


def test_without_a_clock(arm_domain):
    """With use_sim_time and no /clock, what depends on the time is listed as not checked."""
    result = call(main, '--time', '0.1', *SIM_TIME, domain=arm_domain)
    assert ('not checked: late, future: use_sim_time is set, but no message has arrived on /clock'
            in result.stdout)
    result = call(main, 'base_link', 'joint_1', '--time', '0.1', *SIM_TIME, domain=arm_domain)
    assert re.search(r'exists at \d+\.\d{9} \(use_sim_time is set, but no message has arrived on '
                     r'/clock\)\.', ' '.join(result.stdout.split()))


@pytest.mark.parametrize(('now', 'text'), [
    (104, ', 4.000 s before the end of listening'),
    (97, ', 3 s after the time of this node, 97.000000000')])
def test_the_age_of_a_transform(now, text):
    """It is not negative."""
    assert tf_doctor._age(now * S, 100 * S) == text


def test_a_healthy_arm(arm_domain, monkeypatch):
    """Nothing is found where nothing is wrong."""
    def listen(_, frame_names, poll):
        return progress.listen(1.0, lambda: poll() or len(frame_names()) == 6, poll)

    monkeypatch.setattr(progress, 'DISCOVERY', TIMEOUT)
    monkeypatch.setattr('puretf_tools.source.listen', listen)
    code, output, _ = call(main, '--json', domain=arm_domain)
    data = json.loads(output)
    assert (code, codes(data), data['not_checked']) == (0, set(), [])


def test_a_signal_while_processes_examine_bags(start, tmp_path):
    """It ends all processes, also if each of them receives it, as from a terminal."""
    bags = pytest.importorskip('bags')
    path = bags.make(tmp_path / 'walk.bag', 'bag', bags.walk(3000))
    for name in 'abc':
        shutil.copy(path, tmp_path / f'{name}.bag')
    process = start(*tool('tf_doctor', '--jobs', '2', '--bag', str(tmp_path)))
    eventually(lambda: sum(cpu_seconds(pid) > 0.1 for pid in process.descendants()) == 2)
    os.killpg(process.pid, signal.SIGINT)
    assert process.exit_code() == 130, process.output
    assert process.output == 'tf_doctor: ended early by SIGINT\n'
    eventually(lambda: not process.has_left_processes())
