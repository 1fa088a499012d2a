"""tf_doctor on real DDS: faults of publishers, headers of other topics, healthy systems."""

from contextlib import contextmanager
import json
import re
import time

from conftest import ARM, run_in_terminal, tool
from geometry_msgs.msg import PointStamped
import pytest
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from dummy_arm.tf import StaticTransformBroadcaster, TFMessage, TransformBroadcaster
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._ros.transform_stamped import message_of

S = 10**9
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STATIC_PUBLISHER = tool('static_transform_publisher', '--frame-id', 'base_link',
                        '--child-frame-id', 'camera')


def transform(parent, child, stamp, x=0.0):
    """Return a message with a transform."""
    return message_of(Row(stamp, parent, child, (x, *STILL[1:])))


def examine(ros, start, *arguments):
    """Run the command while the node of the test spins; return the exit code and the JSON."""
    process = start(*tool('tf_doctor', '--json', *arguments))
    ros.until(process.has_ended)
    code = process.exit_code()
    return code, json.loads(process.output[process.output.index('{'):])  # after log messages


def codes(data):
    """
    Return the codes of what was found.

    A busy machine, as during other tests, stops publishers and listeners for so long that there
    are real gaps and late transforms.
    """
    return {finding['code'] for finding in data['findings']} - {'gap', 'late'}


@contextmanager
def timer(ros, hertz, callback):
    """Call a function at a rate, with the current time (ns)."""
    each = ros.node.create_timer(
        1 / hertz, lambda: callback(ros.node.get_clock().now().nanoseconds))
    yield
    ros.node.destroy_timer(each)


def test_publishers_and_headers(start, ros):
    """Two publishers, unlatched and best-effort ones, headers, transforms from another clock."""
    nodes = [ros.node, Node('other', context=ros.context)]
    senders = [TransformBroadcaster(node) for node in nodes]
    StaticTransformBroadcaster(ros.node).sendTransform(transform('map', 'odom', 0))
    unlatched = nodes[1].create_publisher(TFMessage, '/tf_static', 10)
    best_effort = nodes[1].create_publisher(
        TFMessage, '/tf', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    point = ros.node.create_publisher(PointStamped, '/point', LATCHED)
    message = PointStamped()
    message.header.frame_id = 'lost'
    point.publish(message)
    joints = ros.node.create_publisher(JointState, '/joint_states', 10)

    def send(now):
        for i, sender in enumerate(senders):
            sender.sendTransform([transform('odom', 'base_link', now + i, float(i))])
        senders[1].sendTransform(transform('base_link', 'wheel', now - 100 * S))
        joints.publish(JointState())

    with timer(ros, 20, send):
        status, data = examine(ros, start, '--time', '3')
    assert (unlatched.topic_name, best_effort.topic_name) == ('/tf_static', '/tf')
    nodes[1].destroy_node()  # or it would publish in this domain until it is garbage
    found = {finding['code']: finding for finding in data['findings']}
    assert codes(data) == {'two_publishers', 'unknown_frame', 'static_not_latched',
                           'incompatible_qos', 'other_clock'}
    assert status == 1
    assert {*found['two_publishers']['nodes']} == {'/test', '/other'}
    assert found['two_publishers']['frames'] == ['base_link']
    assert (found['unknown_frame']['frames'], found['unknown_frame']['topics']) == (
        ['lost'], ['/point'])
    assert found['static_not_latched']['nodes'] == ['/other']
    assert found['static_not_latched']['topics'] == ['/tf_static']
    assert found['incompatible_qos']['topics'] == ['/tf']
    assert found['incompatible_qos']['evidence'] == (
        '1 publisher of /other on /tf does not match a TransformListener (Best effort publisher '
        'and reliable subscription)')
    assert found['other_clock']['frames'] == ['wheel']
    assert found['other_clock']['nodes'] == ['/other']
    assert not [text for text in data['not_checked'] if not text.startswith('headers on')]


def test_malformed_headers(start, ros):
    """A malformed message on another topic is skipped; later headers are read."""
    sender = TransformBroadcaster(ros.node)
    point = ros.node.create_publisher(PointStamped, '/point', 10)
    message = PointStamped()
    message.header.frame_id = 'lost'

    def send(now):
        sender.sendTransform(transform('map', 'odom', now))
        for data in b'', b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 20:
            point.publish(data)
        point.publish(message)

    with timer(ros, 20, send):
        _, data = examine(ros, start, '--time', '4')
    assert codes(data) == {'unknown_frame'}


@pytest.mark.soak
def test_latched_and_volatile_publishers(start, ros):
    """
    The frames of latched messages are read, also if the topic has other publishers.

    That these do not match the latched subscription is not logged.
    """
    StaticTransformBroadcaster(ros.node).sendTransform(transform('map', 'odom', 0))
    latched = ros.node.create_publisher(PointStamped, '/point', LATCHED)
    other = ros.node.create_publisher(PointStamped, '/point', 10)
    message = PointStamped()
    message.header.frame_id = 'lost'
    latched.publish(message)
    process = start(*tool('tf_doctor', '--json', '--time', '2'))
    ros.until(process.has_ended)
    assert process.exit_code() == 1
    assert other.topic_name == '/point'
    data = json.loads(process.output)  # there is no log
    assert [finding['frames'] for finding in data['findings']] == [['lost']]


@pytest.mark.soak
def test_headers_of_another_robot(start, ros):
    """The headers in a namespace with transforms of its own are not judged by other transforms."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(transform('map', 'odom', 0))
    robot = StaticTransformBroadcaster(ros.node, tf_static_topic='/robot/tf_static')
    robot.sendTransform(transform('world', 'lamp', 0))
    point = ros.node.create_publisher(PointStamped, '/robot/front/point', LATCHED)
    message = PointStamped()
    message.header.frame_id = 'lamp'
    point.publish(message)
    assert codes(examine(ros, start, '--time', '2')[1]) <= {'other_namespace'}
    assert codes(examine(ros, start, '--time', '2', '--namespace', 'robot')[1]) == set()


def test_nothing_is_published(start, ros):
    """Without transforms, the settings to check are named; the exit code is 1."""
    status, data = examine(ros, start, '--time', '0.5')
    assert (status, codes(data)) == (1, {'no_transforms'})
    assert 'ROS_DOMAIN_ID' in data['findings'][0]['evidence']


def test_another_namespace(start, ros):
    """Publishers in a namespace are named, with the option that listens to them."""
    StaticTransformBroadcaster(ros.node).sendTransform(transform('map', 'odom', 0))
    other = ros.node.create_publisher(TFMessage, '/robot/tf', 10)
    with timer(ros, 20, lambda now: other.publish(TFMessage(
            transforms=[transform('odom', 'base_link', now)]))):
        status, data = examine(ros, start, '--time', '4')
        assert (status, codes(data)) == (0, {'other_namespace'})
        assert '--namespace robot' in data['findings'][0]['evidence']
        status, data = examine(ros, start, '--time', '4', '--namespace', 'robot')
        assert (status, codes(data)) == (0, set())


@pytest.mark.soak
def test_sim_time(start, ros):
    """With use_sim_time, stamps are compared with /clock; without it, they seem to be wrong."""
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    sender = TransformBroadcaster(ros.node)
    begin = time.time_ns()

    def send(now):
        simulated = now - begin + 100 * S
        clock.publish(Clock(clock=Time(nanoseconds=simulated).to_msg()))
        sender.sendTransform(transform('map', 'odom', simulated))

    with timer(ros, 20, send):
        _, data = examine(
            ros, start, '--time', '2', '--ros-args', '-p', 'use_sim_time:=true')
        assert codes(data) <= {'future'}  # of the first messages, if /clock is read late
        assert examine(ros, start, '--time', '2')[1]['findings'][0]['code'] == 'other_clock'


@pytest.mark.soak
def test_without_a_clock(start):
    """With use_sim_time and no /clock, what depends on the time is listed as not checked."""
    start(*ARM)
    process = start(*tool('tf_doctor', '--time', '1', '--ros-args', '-p', 'use_sim_time:=true'))
    assert process.exit_code() == 0
    assert ('not checked: late, future: use_sim_time is set, but no message has arrived on /clock'
            in process.output)


@pytest.mark.soak
def test_publishers_one_after_the_other(start, ros):
    """A publisher that begins when another one has ended is no second publisher."""
    process = start(*tool('tf_doctor', '--json', '--time', '4'))
    for i in range(2):
        sender = TransformBroadcaster(ros.node)
        ros.until(sender.pub_tf.get_subscription_count)
        for _ in range(20):
            sender.sendTransform(transform(
                'map', 'odom', ros.node.get_clock().now().nanoseconds + i))
        assert sender.pub_tf.wait_for_all_acked()
        ros.node.destroy_publisher(sender.pub_tf)
    ros.until(process.has_ended)
    data = json.loads(process.output)
    assert codes(data) == set()
    assert ': 40 transforms of 2 frames' in data['verdict']


def test_ctrl_c_ends_the_observation(ros):
    """On a terminal, there is a progress bar; what was received until Ctrl-C is reported."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(transform('map', 'odom', 0))
    matched: list[float] = []

    def until(written):
        if 'listening' in written and static.pub_tf.get_subscription_count():
            matched.append(time.monotonic())
        return matched and time.monotonic() > matched[0] + 1.0

    written = run_in_terminal(
        ros.context.get_domain_id(), *tool('tf_doctor', '--time', '60'), until=until)
    assert 'healthy: 1 transform of 2 frames in' in ' '.join(written.split())


def test_the_path_between_two_frames(start):
    """The path is listed with publishers, rates and stamps; the edge without data is named."""
    start(*ARM)
    start(*STATIC_PUBLISHER)
    # It listens from the first transform on; one publisher may be discovered 3 s after the other.
    process = start(*tool('tf_doctor', 'camera', 'end_effector', '--time', '6'))
    past = start(*tool(
        'tf_doctor', 'map', 'end_effector', '--time', '6', '-t', '100', '--json'))
    assert process.exit_code() == 0
    lines = process.output.splitlines()
    assert [line.split('  ')[0].strip() for line in lines[2:7]] == [
        'base_link -> camera', 'base_link -> joint_1', 'joint_1 -> joint_2',
        'joint_2 -> joint_3', 'joint_3 -> end_effector']
    assert '/static_transform_publisher' in lines[2]
    (rate,) = re.findall(r'  (\d+\.\d) Hz  ', lines[3])
    assert 30.0 < float(rate) < 55.0
    assert lines[-1].startswith('The transform from end_effector to camera exists at ')
    assert past.exit_code() == 1
    refusals = [edge['refusal'] for edge in json.loads(past.output)['path']]
    assert ['newer than 100.0' in refusal for refusal in refusals] == [False, *[True] * 4]


def healthy_arm(start, ros):
    """Start the arm."""
    start(*ARM)


def healthy_lab(start, ros):
    """Start the publishers of the lab, and the arm."""
    start(*ARM)
    start(*tool('dynamic_tf_publisher'))
    start(*STATIC_PUBLISHER)


def healthy_frames(start, ros):
    """Publish 500 frames at 100 Hz."""
    start('-c', """
import math, rclpy
from dummy_arm.tf import TransformBroadcaster
rclpy.init()
node = rclpy.create_node('many')
frames = TransformBroadcaster(node).prepare([('map', f'frame_{i}') for i in range(500)])
poses = [(0.0,) * 6 + (1.0,)] * 500
node.create_timer(0.01, lambda: frames.send(node.get_clock().now(), poses))
rclpy.spin(node)
""")


def healthy_wheels(start, ros):
    """Publish four wheels."""
    sender = TransformBroadcaster(ros.node)
    ros.node.create_timer(0.02, lambda: sender.sendTransform([transform(
        'base_link', f'{name}_wheel', ros.node.get_clock().now().nanoseconds)
        for name in ('fl', 'fr', 'rl', 'rr')]))


@pytest.mark.parametrize('begin', [healthy_arm, *(
    pytest.param(begin, marks=pytest.mark.soak)
    for begin in (healthy_lab, healthy_frames, healthy_wheels))])
def test_healthy(start, ros, begin):
    """Nothing is found where nothing is wrong."""
    begin(start, ros)
    ros.until(lambda: ros.node.count_publishers('/tf'))
    status, data = examine(ros, start, '--time', '6')  # a publisher may be discovered 3 s late
    assert (status, codes(data), data['not_checked']) == (0, set(), [])
