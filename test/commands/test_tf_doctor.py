"""The command `tf_doctor` on real DDS: publishers, headers of other topics, healthy systems."""

from importlib import import_module
import json
import os
import re
import shutil
import signal
from typing import Any

from cli_runner import call
from geometry_msgs.msg import PointStamped, TransformStamped
from processes import cpu_seconds, TIMEOUT, tool, tool_without_ros
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from ros_node import eventually, LATCHED, stamped
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


def point_in(frame, stamp=0):
    """Return a message with a header; the stamp in ns."""
    message = PointStamped()
    message.header.frame_id = frame
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    return message


def run(ros, *arguments, publishers, send=lambda now: None, ticks=15):
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
    return {finding['code'] for finding in data['findings']} - {'gap', 'late'}


def finding_of(data, code):
    """Return the only finding with a code."""
    (finding,) = (each for each in data['findings'] if each['code'] == code)
    return finding


def test_publishers_and_headers(ros, other):
    """Two publishers, unlatched and best-effort ones, headers, transforms from another clock."""
    senders = [TransformBroadcaster(node) for node in (ros.node, other)]
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(stamped('map', 'odom'))
    unlatched = other.create_publisher(TFMessage, '/tf_static', 10)
    best_effort = other.create_publisher(
        TFMessage, '/tf', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    volatile = other.create_subscription(TFMessage, '/tf_static', lambda _: None, 10)
    point = ros.node.create_publisher(PointStamped, '/point', LATCHED)
    point.publish(point_in('lost'))
    joints = ros.node.create_publisher(JointState, '/joint_states', 10)

    def send(now):
        for i, sender in enumerate(senders):
            sender.sendTransform([stamped('odom', 'base_link', now + i, float(i))])
        senders[1].sendTransform(stamped('base_link', 'wheel', now - 100 * S))
        joints.publish(JointState())

    status, data = examine(ros, send=send, publishers=[
        *(sender.pub_tf for sender in senders), static.pub_tf, point, joints])
    assert (unlatched.topic_name, best_effort.topic_name) == ('/tf_static', '/tf')
    assert volatile.topic_name == '/tf_static'
    found = {finding['code']: finding for finding in data['findings']}
    assert codes(data) == {'two_publishers', 'unknown_frame', 'static_not_latched',
                           'incompatible_qos', 'other_clock', 'volatile_listener'}
    assert status == 1
    assert {*found['two_publishers']['nodes']} == {'/test', '/other'}
    assert found['two_publishers']['frames'] == ['base_link']
    assert (found['unknown_frame']['frames'], found['unknown_frame']['topics']) == (
        ['lost'], ['/point'])
    assert found['static_not_latched']['nodes'] == ['/other']
    assert found['static_not_latched']['topics'] == ['/tf_static']
    assert found['volatile_listener']['nodes'] == ['/other']
    assert found['volatile_listener']['topics'] == ['/tf_static']
    assert found['incompatible_qos']['topics'] == ['/tf']
    assert found['incompatible_qos']['evidence'] == (
        '1 publisher on /tf (/other) is not reliable: listeners that require it receive nothing')
    assert found['other_clock']['frames'] == ['wheel']
    assert found['other_clock']['nodes'] == ['/other']
    assert not [text for text in data['not_checked'] if not text.startswith('headers on')]


def test_a_section_without_ros(start):
    """The command at the end of an error works wherever the package is installed."""
    process = start(*tool_without_ros('tf_doctor', '--explain', 'clock'))
    assert process.exit_code() == 0
    assert process.output.startswith('use_sim_time and the wall clock\n\nCause. Some nodes ')


URDF = """<robot name="gripper">
<link name="base"/><link name="arm"/><link name="left"/><link name="tip"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/></joint>
<joint name="grip" type="continuous"><parent link="arm"/><child link="left"/></joint>
<joint name="end" type="fixed"><parent link="left"/><child link="tip"/></joint></robot>"""


def test_a_robot(ros):
    """A joint without a state is named, and a fixed link that nobody publishes."""
    text = ros.node.create_publisher(String, '/r1/robot_description', LATCHED)
    text.publish(String(data=URDF))
    joints = ros.node.create_publisher(JointState, '/r1/joint_states', 10)
    sender = TransformBroadcaster(ros.node)

    def send(now):
        joints.publish(JointState(name=['turn'], position=[0.0]))
        sender.sendTransform(stamped('r1/base', 'r1/arm', now))

    status, data = examine(ros, send=send, publishers=[text, joints, sender.pub_tf], ticks=50)
    found = {finding['code']: finding for finding in data['findings']}
    assert codes(data) == {'joint_without_state', 'link_without_transform'}
    assert status == 1
    assert found['joint_without_state']['frames'] == ['r1/left']
    assert found['joint_without_state']['evidence'] == (
        '1 of 2 movable joints are not on /r1/joint_states, which names turn: grip')
    assert found['link_without_transform']['frames'] == ['r1/tip']


def test_messages_at_their_stamps(ros):
    """Each verdict on a topic of its own, beside some that are healthy."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform([stamped('map', 'odom'), stamped('base_link', 'laser')])
    sender = TransformBroadcaster(ros.node)
    begin = ros.node.get_clock().now().nanoseconds
    topics = {name: ros.node.create_publisher(PointStamped, name, 100) for name in (
        '/scan', '/fast', '/map_point', '/early', '/early_fast', '/never', '/too_old',
        '/zero_stamp', '/other_clock')}
    heard = [0]

    def send(now):
        heard[0] += all(
            each.get_subscription_count() for each in (sender.pub_tf, *topics.values()))
        quick = now + 20 * (now - begin)  # the stamps of a frame that are 20 times as fast
        sender.sendTransform([
            stamped('odom', 'base_link', now), stamped('base_link', 'slow', now - 3 * S // 10),
            stamped('odom', 'quick', quick),
            *([stamped('base_link', 'gone', now)] if heard[0] < 25 else [])])
        for name, frame, stamp in [
                ('/scan', 'laser', now - 3 * S // 100), ('/map_point', 'odom', now - 200 * S),
                ('/early', 'slow', now), ('/never', 'gone', now), ('/zero_stamp', 'laser', 0),
                ('/too_old', 'quick', quick - 12 * S), ('/other_clock', 'laser', 5 * S),
                *[('/fast', 'laser', now - 3 * S // 100), ('/early_fast', 'slow', now)] * 4]:
            topics[name].publish(point_in(frame, stamp))

    status, data = examine(ros, send=send, publishers=[
        sender.pub_tf, static.pub_tf, *topics.values()], ticks=160)
    assert status == 1
    found = {min(finding['topics']): finding for finding in data['findings']
             if finding['code'].startswith('message')}
    assert {topic: finding['code'] for topic, finding in found.items()} == {
        topic: f'message{topic.replace("/", "_")}' for topic in topics
        if topic not in ('/scan', '/fast', '/map_point', '/early_fast')}
    assert {*found['/early']['topics']} == {'/early', '/early_fast'}
    assert 'edge base_link -> gone of /test end at' in found['/never']['evidence']
    assert 'edge base_link -> slow of /test: ' in found['/early']['evidence']
    assert all(finding['nodes'] == ['/test'] for finding in found.values())
    table = {row['topic']: row for row in data['topics']}
    assert table.keys() == topics.keys()
    for topic in '/scan', '/fast', '/map_point':
        assert table[topic]['at_once'] > 0.8
        assert table[topic]['never'] == 0.0
    assert table['/fast']['messages'] > 3 * table['/scan']['messages']
    assert table['/early']['waiting'] == 1.0
    # They wait for 0.3 s; how many are sent in this time, the load of the computer decides.
    assert table['/early']['queue'] >= 5
    assert table['/early_fast']['queue'] > 3 * table['/early']['queue']
    assert table['/other_clock']['never'] == 1.0


def test_latched_messages_at_their_stamps(ros):
    """What was latched before the listening began is not judged; what comes later is."""
    sender = TransformBroadcaster(ros.node)
    costmap = ros.node.create_publisher(PointStamped, '/costmap', LATCHED)
    costmap.publish(point_in('odom', ros.node.get_clock().now().nanoseconds - 300 * S))
    path = ros.node.create_publisher(PointStamped, '/path', LATCHED)
    both = [ros.node.create_publisher(PointStamped, '/both', profile) for profile in (LATCHED, 10)]

    def send(now):
        sender.sendTransform(stamped('map', 'odom', now - 3 * S // 10))
        for publisher in path, *both:
            publisher.publish(point_in('odom', now))

    status, data = examine(ros, send=send, publishers=[sender.pub_tf, costmap, path, *both],
                           ticks=50)
    assert (status, codes(data)) == (0, {'message_early'})
    table = {row['topic']: row for row in data['topics']}
    assert table.keys() == {'/path', '/both'}
    assert [row['waiting'] for row in table.values()] == [1.0, 1.0]
    assert 0.2 < table['/path']['median_wait'] < 0.6
    assert table['/both']['messages'] < 2.2 * table['/path']['messages']


def test_another_type(ros):
    """A publisher of another type on /tf is the one cause, and nothing else is said about it."""
    ros.node.create_publisher(TransformStamped, '/tf', 10)
    point = ros.node.create_publisher(PointStamped, '/point', 10)  # it is discovered later
    code, output, error = run(ros, '--json', publishers=[point])
    data = json.loads(output)
    (finding,) = data['findings']
    assert (code, finding['code'], finding['severity']) == (1, 'wrong_type', 'error')
    assert (finding['topics'], finding['nodes']) == (['/tf'], ['/test'])
    assert finding['evidence'] == ('/test publishes geometry_msgs/msg/TransformStamped on /tf, '
                                   'not tf2_msgs/msg/TFMessage')
    assert 'TransformBroadcaster' in finding['remedy']
    assert (data['not_checked'], error) == ([], '')


def test_another_type_beside_transforms(ros):
    """It is an error where transforms arrive, too, and the cause of a missing frame."""
    ros.node.create_publisher(TransformStamped, '/tf', 10)
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(stamped('map', 'odom'))
    status, data = examine(ros, publishers=[static.pub_tf])
    assert (status, codes(data)) == (1, {'wrong_type'})
    code, output, _ = run(ros, 'map', 'camera', publishers=[static.pub_tf])
    assert code == 1
    assert '/test publishes geometry_msgs/msg/TransformStamped on /tf, not' in output


def test_a_type_that_cannot_be_imported(ros, monkeypatch):
    """Its headers are listed as not checked, with the reason."""
    def fail(name):
        if name == 'sensor_msgs.msg':
            raise OSError('no memory')
        return import_module(name)

    monkeypatch.setattr(header_sampler, 'import_module', fail)
    ros.node.create_publisher(JointState, '/joints', 10)
    point = ros.node.create_publisher(PointStamped, '/point', 10)
    _, data = examine(ros, '--ignore', 'no_transforms', publishers=[point])
    assert data['not_checked'] == ['headers on /joints: its type sensor_msgs/msg/JointState '
                                   'cannot be imported (OSError: no memory)']


def test_joint_states_of_another_type(ros):
    """The joints are without a state, and the rest is examined."""
    text = ros.node.create_publisher(String, '/robot_description', LATCHED)
    text.publish(String(data=URDF))
    points = ros.node.create_publisher(PointStamped, '/joint_states', 10)
    _, data = examine(ros, send=lambda now: points.publish(point_in('base')),
                      publishers=[text, points], ticks=50)
    assert {'joint_without_state', 'link_without_transform'} <= codes(data)


@pytest.mark.parametrize('create', [TransformBroadcaster, StaticTransformBroadcaster])
def test_broadcasters_that_are_created_in_a_callback(ros, create):
    """They are found; the frame is not said to have two publishers."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(stamped('map', 'odom'))
    _, data = examine(ros, publishers=[static.pub_tf], send=lambda now: create(
        ros.node).sendTransform(stamped('odom', 'base_link', now, now % S / S)))
    found = {finding['code']: finding for finding in data['findings']}
    assert 'two_publishers' not in found
    finding = found['many_publishers']
    assert finding['nodes'] == ['/test']
    assert finding['topics'] == ['/tf' if create is TransformBroadcaster else '/tf_static']
    assert re.fullmatch(r'\d\d+ publishers, one after another, from one node',
                        finding['evidence'])


def test_many_publishers_of_which_nothing_arrives(ros):
    """They are the cause that is named."""
    for _ in range(30):
        ros.node.create_publisher(TFMessage, '/tf', 10)
    point = ros.node.create_publisher(PointStamped, '/point', 10)  # it is discovered later
    status, data = examine(ros, publishers=[point])
    (finding,) = data['findings']
    assert (status, finding['code'], finding['topics']) == (1, 'many_publishers', ['/tf'])
    assert finding['evidence'].startswith('30 publishers')


def test_a_middleware_that_does_not_report_gids(ros, other, handles):
    """Whether a frame has two publishers is not checked; they are not known."""
    static = [StaticTransformBroadcaster(node) for node in (ros.node, other)]
    for x, each in enumerate(static):
        each.sendTransform([stamped('map', '/odom', x=float(x))])
    status, data = examine(ros, publishers=[each.pub_tf for each in static])
    assert (status, codes(data)) == (0, {'leading_slash'})
    assert data['not_checked'] == [
        'two_publishers, many_publishers: the ROS graph does not know the publishers of the '
        'transforms']
    assert {*data['findings'][0]['nodes']} == {'unknown publisher'}


def test_malformed_headers(ros):
    """A malformed message on another topic is skipped; later headers are read."""
    sender = TransformBroadcaster(ros.node)
    point = ros.node.create_publisher(PointStamped, '/point', 10)

    def send(now):
        sender.sendTransform(stamped('map', 'odom', now))
        for data in b'', b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 20:
            point.publish(data)
        point.publish(point_in('lost'))

    _, data = examine(ros, send=send, publishers=[sender.pub_tf, point])
    assert codes(data) == {'unknown_frame'}


def test_latched_and_volatile_publishers(ros):
    """Latched headers are read; that the volatile publisher does not match is not logged."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(stamped('map', 'odom'))
    latched = ros.node.create_publisher(PointStamped, '/point', LATCHED)
    other = ros.node.create_publisher(PointStamped, '/point', 10)
    latched.publish(point_in('lost'))
    code, output, error = run(ros, '--json', publishers=[static.pub_tf, latched, other])
    assert code == 1
    assert '[tf_doctor]' not in error
    assert [finding['frames'] for finding in json.loads(output)['findings']] == [['lost']]


def test_headers_of_another_robot(ros):
    """The headers in a namespace with transforms of its own are not judged by other transforms."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(stamped('map', 'odom'))
    robot = StaticTransformBroadcaster(ros.node, tf_static_topic='/robot/tf_static')
    robot.sendTransform(stamped('world', 'lamp'))
    point = ros.node.create_publisher(PointStamped, '/robot/front/point', LATCHED)
    point.publish(point_in('lamp'))
    _, data = examine(ros, publishers=[static.pub_tf, point])
    assert codes(data) <= {'other_namespace'}
    _, data = examine(ros, '--namespace', 'robot', publishers=[robot.pub_tf, point])
    assert codes(data) == set()


def test_another_namespace(ros):
    """Publishers in a namespace are named, with the option that listens to them."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(stamped('world', 'lamp'))
    other = ros.node.create_publisher(TFMessage, '/robot/tf', 10)

    def send(now):
        other.publish(TFMessage(transforms=[stamped('odom', 'base_link', now)]))

    status, data = examine(ros, send=send, publishers=[static.pub_tf])
    assert (status, codes(data)) == (0, {'other_namespace'})
    assert '--namespace robot' in data['findings'][0]['remedy']
    status, data = examine(ros, '--namespace', 'robot', send=send, publishers=[other])
    assert (status, codes(data)) == (0, set())


@pytest.fixture
def half(ros, make_node):
    """Send map -> odom on /tf, and odom -> base_link on /robot1/tf; return how, and publishers."""
    senders = [TransformBroadcaster(ros.node), TransformBroadcaster(
        make_node('driver', namespace='/robot1'), tf_topic='/robot1/tf')]

    def send(now):
        for sender, edge in zip(senders, (('map', 'odom'), ('odom', 'base_link'))):
            sender.sendTransform(stamped(*edge, now))

    return send, [sender.pub_tf for sender in senders]


REMAPPED = '--ros-args -r /tf:=/robot1/tf -r /tf_static:=/robot1/tf_static'


@pytest.mark.parametrize(('arguments', 'evidence'), [
    ((), "'odom' -> 'base_link' is published on /robot1/tf by /robot1/driver, not on /tf and "
     '/tf_static'),
    (('--namespace', 'robot1'), "'map' -> 'odom' is published on /tf by /test, not on /robot1/tf "
     'and /robot1/tf_static')])
def test_half_a_namespace(ros, half, arguments, evidence):
    """The topic, the nodes and the remedy are named, from whichever half one looks."""
    send, publishers = half
    status, data = examine(ros, *arguments, send=send, publishers=publishers)
    assert (status, codes(data)) == (1, {'half_namespace'})
    finding = finding_of(data, 'half_namespace')
    assert finding['evidence'] == evidence
    assert {*finding['nodes']} == {'/test', '/robot1/driver'}
    assert {*finding['topics']} == {'/tf', '/robot1/tf'}
    assert f'in all nodes of the robot ({REMAPPED}), or in none of them.' in finding['remedy']


def test_the_path_to_the_other_half(ros, half):
    """It is said where the missing frame is, and what to do."""
    send, publishers = half
    code, output, _ = run(ros, 'map', 'base_link', send=send, publishers=publishers[:1])
    output = ' '.join(output.split())
    assert code == 1
    assert ('is published on /robot1/tf by /robot1/driver, not on /tf and '
            f'/tf_static. Remap both /tf and /tf_static in all nodes of the robot ({REMAPPED}), '
            'or in none of them.') in output


def test_the_remedy_for_half_a_namespace(ros, make_node):
    """With its arguments, a node publishes where the others of the robot do."""
    senders = [TransformBroadcaster(make_node('slam', cli_args=REMAPPED.split())),
               TransformBroadcaster(ros.node, tf_topic='/robot1/tf')]

    def send(now):
        senders[0].sendTransform(stamped('map', 'odom', now))
        senders[1].sendTransform(stamped('odom', 'base_link', now))

    status, data = examine(ros, '--namespace', 'robot1', send=send,
                           publishers=[sender.pub_tf for sender in senders])
    assert (status, codes(data)) == (0, set())


def test_only_static_transforms_in_a_namespace(ros):
    """They are received although they were sent before, and nothing else is proposed."""
    static = StaticTransformBroadcaster(ros.node, tf_static_topic='/robot1/tf_static')
    static.sendTransform(stamped('base_link', 'laser'))
    sender = TransformBroadcaster(ros.node)
    own = StaticTransformBroadcaster(ros.node)
    own.sendTransform(stamped('laser', 'lens'))
    status, data = examine(
        ros, send=lambda now: sender.sendTransform(stamped('odom', 'base_link', now)),
        publishers=[sender.pub_tf, static.pub_tf, own.pub_tf])
    assert (status, codes(data)) == (1, {'half_namespace'})


@pytest.mark.parametrize(('sent', 'expected'), [('turn', {'two_joint_publishers'}),
                                               ('grip', set())])
def test_two_nodes_send_joint_states(ros, make_node, sent, expected):
    """If both send one joint, it is the only finding; if each has its own, nothing is wrong."""
    make_node(URDF, is_spun=True, kind=RobotStatePublisher)
    publishers = [node.create_publisher(JointState, '/joint_states', 10)
                  for node in (ros.node, make_node('gui'))]

    def send(now):
        stamp = Time(nanoseconds=now).to_msg()
        for publisher, name, position in zip(publishers, ('turn', sent), (2.0, 0.0)):
            state = JointState(name=[name], position=[position])
            state.header.stamp = stamp
            publisher.publish(state)

    status, data = examine(ros, '--ignore', 'joint_without_state', '--ignore',
                           'several_trees', send=send, publishers=publishers, ticks=60)
    assert (status, codes(data)) == (bool(expected), expected)
    if expected:
        finding = finding_of(data, 'two_joint_publishers')
        assert ({*finding['nodes']}, finding['frames']) == ({'/test', '/gui'}, ['arm'])
        assert ' messages) send turn on /joint_states' in finding['evidence']


def test_two_nodes_publish_the_clock(ros, other):
    """Both are named, and nothing that follows from it."""
    clocks = [node.create_publisher(Clock, '/clock', 10) for node in (ros.node, other)]
    sender = TransformBroadcaster(ros.node)
    begin = ros.node.get_clock().now().nanoseconds

    def send(now):
        for clock, offset in zip(clocks, (20 * S, 160 * S)):
            stamp = now - begin + offset
            clock.publish(Clock(clock=Time(nanoseconds=stamp).to_msg()))
        sender.sendTransform(stamped('map', 'odom', stamp))

    status, data = examine(ros, *SIM_TIME, send=send, publishers=[*clocks, sender.pub_tf])
    assert (status, codes(data)) == (1, {'two_clocks'})
    assert {*finding_of(data, 'two_clocks')['nodes']} == {'/test', '/other'}


@pytest.mark.parametrize('arguments', [(), SIM_TIME])
def test_a_node_that_does_not_use_the_clock(ros, make_node, arguments):
    """It is named, whichever clock the command uses; the publisher of /clock is not."""
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

    status, data = examine(ros, *arguments, send=send, ticks=50, publishers=[
        clock, *(sender.pub_tf for sender in senders)])
    assert (status, codes(data) - {'future'}) == (1, {'use_sim_time_differs'})
    assert finding_of(data, 'use_sim_time_differs')['evidence'] == (
        'use_sim_time is false in /driver, and true in /nav, while /test publishes /clock')


def test_a_late_transform_after_a_reset(ros, make_node):
    """What it makes old is counted, after the buffers were cleared."""
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    senders = [TransformBroadcaster(node) for node in (ros.node, make_node('old_node'))]
    begin = ros.node.get_clock().now().nanoseconds
    heard = [0]

    def send(now):
        heard[0] += all(each.pub_tf.get_subscription_count() for each in senders)
        stamp = now - begin + (5 if heard[0] > 20 else 100) * S
        clock.publish(Clock(clock=Time(nanoseconds=stamp).to_msg()))
        if heard[0] == 30:
            senders[1].sendTransform(stamped('odom', 'base', stamp + 95 * S))
        elif heard[0] != 21:  # the clock arrives before the first transform
            senders[0].sendTransform(stamped('odom', 'base', stamp))

    _, data = examine(ros, '--ignore', 'future', *SIM_TIME, send=send, ticks=60, publishers=[
        clock, *(sender.pub_tf for sender in senders)])
    assert codes(data) == {'time_goes_back'}
    assert re.match(r"\d\d transforms of 'base' from /test were refused by a buffer with the "
                    r'default cache of 10 s, since one at \d+\.\d{9} s from /old_node is newer; ',
                    finding_of(data, 'time_goes_back')['evidence'])


def test_publishers_one_after_the_other(ros):
    """A publisher that begins when another one has ended is no second publisher."""
    senders: list[Any] = []

    def send(now):
        if not senders:
            senders.append(TransformBroadcaster(ros.node))
        publisher = senders[-1].pub_tf
        if len(senders) < 3 and publisher.get_subscription_count():
            for i in range(20):
                senders[-1].sendTransform(stamped('map', 'odom', now + i))
            assert publisher.wait_for_all_acked()
            ros.node.destroy_publisher(publisher)
            senders.append(TransformBroadcaster(ros.node))
        if len(senders) == 3:
            os.kill(os.getpid(), signal.SIGINT)
            ros.node.destroy_publisher(senders[-1].pub_tf)
            senders.append(None)

    timer = ros.node.create_timer(
        0.02, lambda: None in senders or send(ros.node.get_clock().now().nanoseconds))
    with ros.spinning():
        result = call(main, '--json', '--time', '1000', domain=ros.domain)
    ros.node.destroy_timer(timer)
    data = json_in(result)
    assert codes(data) == set()
    assert ': 40 transforms of 2 frames' in data['verdict']


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


def test_ctrl_c_ends_the_observation(ros):
    """On a terminal, there is a progress bar; what was received until Ctrl-C is reported."""
    StaticTransformBroadcaster(ros.node).sendTransform(stamped('map', 'odom'))
    code, output, error = call(
        main, domain=ros.context.get_domain_id(), columns=80, until=lambda text: (
            'listening' in text))
    assert code == 0
    assert 'listening' in error
    assert 'healthy: 1 transform of 2 frames in' in ' '.join(output.split())


def test_the_path_between_two_frames(ros, make_node):
    """The path is listed with publishers, rates and stamps; the edge without data is named."""
    static = StaticTransformBroadcaster(make_node('other', namespace='/robot'))
    sender = TransformBroadcaster(ros.node)
    static.sendTransform(stamped('base_link', 'camera'))

    def send(now):
        sender.sendTransform([stamped('base_link', 'arm', now), stamped('arm', 'hand', now)])

    publishers = [static.pub_tf, sender.pub_tf]
    code, output, _ = run(ros, 'camera', '/hand', send=send, publishers=publishers)
    assert code == 0
    lines = output.splitlines()
    rate = r' +\d+\.\d Hz  \d+\.\d{9} to \d+\.\d{9}  /test'
    for line, expected in zip(lines[2:5], (
            'base_link -> camera  static +/robot/other', f'base_link -> arm{rate}',
            f'arm -> hand{rate}')):
        assert re.fullmatch(expected, line)
    assert re.fullmatch(r'The transform from hand to camera exists at \d+\.\d{9}, '
                        r'\d+\.\d{3} s before the end of listening\.', lines[-1])
    code, output, _ = run(ros, 'camera', 'hand', '-t', '100', '--json', send=send,
                          publishers=publishers)
    assert code == 1
    refusals = [edge['refusal'] for edge in json.loads(output)['path']]
    assert ['newer than 100.0' in refusal for refusal in refusals] == [False, True, True]


@pytest.mark.parametrize('arguments', [(), SIM_TIME])
def test_sim_time(ros, arguments):
    """Stamps that fit /clock are compared with it, also without use_sim_time."""
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    sender = TransformBroadcaster(ros.node)
    begin = ros.node.get_clock().now().nanoseconds

    def send(now):
        simulated = now - begin + 100 * S
        clock.publish(Clock(clock=Time(nanoseconds=simulated).to_msg()))
        sender.sendTransform(stamped('map', 'odom', simulated))

    status, data = examine(ros, *arguments, send=send, publishers=[clock, sender.pub_tf])
    assert (status, codes(data)) == (0, set())
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
    (97, ', 3 s after the time of this node, 97.000000000'),
    (1, ', 99 s after the time of this node, 1.000000000: they are on different clocks')])
def test_the_age_of_a_transform(now, text):
    """It is not negative; a stamp of another clock is said to be one."""
    assert tf_doctor._age(now * S, 100 * S) == text


def test_a_healthy_arm(arm_domain, monkeypatch):
    """Nothing is found where nothing is wrong."""
    def listen(_, frame_names, poll):
        return progress.listen(1.0, lambda: poll() or len(frame_names()) == 6, poll)

    monkeypatch.setattr(progress, 'DISCOVERY', TIMEOUT)
    monkeypatch.setattr(tf_doctor, 'listen', listen)
    code, output, _ = call(main, '--json', domain=arm_domain)
    data = json.loads(output)
    assert (code, codes(data), data['not_checked']) == (0, set(), [])


def test_the_process(start, arm_domain):
    """It prints a verdict, and exits with code 1 if there is an error."""
    process = start(*tool('tf_doctor', '--time', '0.3'), domain=arm_domain)
    assert process.exit_code() == bool(re.search('^error ', process.output, re.MULTILINE))
    assert re.search(r': \d+ transforms? of \d frames in \d+\.\d s\n$', process.output)
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_processes_examine_bags(start, tmp_path, number):
    """It ends all processes, also if each of them receives it, as from a terminal."""
    bags = pytest.importorskip('bags')
    path = bags.make(tmp_path / 'walk.bag', 'bag', bags.walk(3000))
    for name in 'abc':
        shutil.copy(path, tmp_path / f'{name}.bag')
    process = start(*tool('tf_doctor', '--jobs', '2', '--bag', str(tmp_path)))
    eventually(lambda: sum(cpu_seconds(pid) > 0.1 for pid in process.descendants()) == 2)
    os.killpg(process.pid, number)
    assert process.exit_code() == 128 + number, process.output
    assert process.output == f'tf_doctor: ended early by {number.name}\n'
    eventually(lambda: not process.has_left_processes())
