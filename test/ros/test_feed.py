"""The frames on /tf and /tf_static, as the web page reads them."""

from time import monotonic

import pytest
from rclpy.time import Time
from ros_node import LATCHED, stamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, String

from puretf import StaticTransformBroadcaster, TFMessage, TransformBroadcaster
from puretf_tools.robot import observed
from puretf_tools.view.feed import LiveFeed


def test_a_node_that_has_stopped_sending_is_no_publisher(ros, make_node):
    """Although it still runs: ten seconds later, by /clock, with which stamps are compared."""
    feed = LiveFeed(ros.node)
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    broadcasters = [TransformBroadcaster(make_node(name)) for name in ('a', 'b')]
    stamp = 100 * 10**9

    def publishers():
        nonlocal stamp
        stamp += 10**8
        clock.publish(Clock(clock=Time(nanoseconds=stamp).to_msg()))
        for broadcaster in broadcasters:
            broadcaster.sendTransform(stamped('map', 'robot', stamp))
        feed.watch(monotonic())
        return {publisher for _, publisher in map(feed.publication, feed.buffer.frames())}

    begin = monotonic()  # at first, delays do not count
    ros.until(lambda: publishers() == {'/a and /b (more than one publisher)'}
              and monotonic() > begin + 1.0)
    broadcasters.pop()
    ros.until(lambda: publishers() == {'/a'})
    ros.until(lambda: publishers() and feed.verdict.endswith(
        ' in the last 30 s; times are those of /clock, published by /test'))
    assert 'other_clock' not in {each.code for each in feed.findings}


def test_static_transforms_stay_known(ros, make_node):
    """Also if more than 10 000 messages come after them, before the next examination."""
    feed, node = LiveFeed(ros.node), make_node('a')
    dynamic = TransformBroadcaster(node)
    feed.watch(0.0)
    StaticTransformBroadcaster(node).sendTransform(stamped('odom', 'base'))
    ros.until(feed.buffer.frames)
    begin = ros.node.get_clock().now().nanoseconds
    for last in range(begin + 50, begin + 10_500, 50):
        for stamp in range(last - 49, last + 1):
            dynamic.sendTransform([stamped('map', 'odom', stamp), stamped('base', 'arm', stamp)])
        ros.until(lambda last=last: [frame.latest for frame in feed.buffer.frames()] == [
            0, last, last])
        feed.watch(1.0)
    feed.watch(10.0)
    assert 'several_trees' not in {each.code for each in feed.findings}


def test_what_is_wrong_is_found(ros, make_node):
    """Without another subscription to /tf: two publishers, and half of the robot elsewhere."""
    feed = LiveFeed(ros.node)
    first, second = (TransformBroadcaster(make_node(name)) for name in ('a', 'b'))
    elsewhere = ros.node.create_publisher(TFMessage, '/robot/tf', 10)

    def send():
        now = ros.node.get_clock().now().nanoseconds
        for broadcaster in first, second:
            broadcaster.sendTransform(stamped('map', 'robot', now))
        elsewhere.publish(TFMessage(transforms=[stamped('robot', 'wheel', now)]))

    def is_found():
        feed.watch(monotonic())
        return {('two_publishers', ('/a', '/b')), ('half_namespace', ('/a', '/b', '/test'))} <= {
            (each.code, (*sorted(each.nodes),)) for each in feed.findings}

    ros.node.create_timer(0.02, send)
    ros.until(is_found)
    # On a busy machine, there may be others, such as a gap.
    assert feed.verdict == f'{len(feed.findings)} findings in the last 30 s'
    assert ros.node.count_subscribers('/tf') == 1


def test_a_middleware_that_does_not_report_gids(ros, make_node, handles):
    """The delay is that of all publishers of the topic."""
    feed = LiveFeed(ros.node)
    broadcasters = [TransformBroadcaster(make_node(name)) for name in ('a', 'b')]

    def is_measured():
        for broadcaster in broadcasters:
            broadcaster.sendTransform(
                stamped('map', 'robot', ros.node.get_clock().now().nanoseconds))
        feed.watch(monotonic())
        return any(delay is not None and publisher == 'unknown publisher'
                   for delay, publisher in map(feed.publication, feed.buffer.frames()))

    ros.until(is_measured)


@pytest.fixture
def offer(ros):
    """A function that publishes a latched text, and returns its publisher."""
    def offer(topic, text):
        publisher = ros.node.create_publisher(String, topic, LATCHED)
        publisher.publish(String(data=text))
        return publisher

    return offer


def urdf(name):
    """Return the description of a robot of one link."""
    return f'<robot name="{name}"><link name="base"/></robot>'


def test_descriptions(ros, offer):
    """They are found in all namespaces, also late ones; a new text replaces the old one."""
    feed = LiveFeed(ros.node)
    assert feed.descriptions() == {}

    def names():
        return {topic: getattr(found, 'name', found)
                for topic, found in feed.descriptions().items()}

    offer('/robot_description', urdf('one'))
    offer('/not_robot_description', urdf('no'))
    ros.node.create_publisher(Empty, '/other/robot_description', 1)
    ros.until(lambda: names() == {'/robot_description': 'one'})
    before = feed.descriptions()
    publisher = offer('/a/b/robot_description', urdf('two'))
    ros.until(lambda: names() == {'/robot_description': 'one', '/a/b/robot_description': 'two'})
    assert feed.descriptions()['/robot_description'] is before['/robot_description']
    publisher.publish(String(data=urdf('new')))
    ros.until(lambda: names()['/a/b/robot_description'] == 'new')
    publisher.publish(String(data='<robot'))
    ros.until(lambda: 'not valid XML' in str(names()['/a/b/robot_description']))
    publisher.publish(b'\0\1\0\0')  # without a text
    ros.until(lambda: "begins with <, got ''" in str(names()['/a/b/robot_description']))
    ros.node.destroy_publisher(publisher)
    ros.until(lambda: names() == {'/robot_description': 'one'})


def test_given_descriptions_are_shown_alone(ros, offer):
    """Nothing subscribes to those in the network."""
    given = {'/robot_description': observed.parsed(urdf('given'))}
    feed = LiveFeed(ros.node, descriptions=given)
    offer('/robot_description', urdf('other'))
    ros.until(lambda: ros.node.count_publishers('/robot_description'))
    assert feed.descriptions() is given
    assert not ros.node.count_subscribers('/robot_description')


def test_descriptions_of_a_namespace(ros, make_node, offer):
    """The page of a namespace has its robots only."""
    feed = LiveFeed(make_node('page', namespace='left', is_spun=True, cli_args=[
        '--ros-args', '-r', '/tf:=tf', '-r', '/tf_static:=tf_static']))
    for topic in '/robot_description', '/right/robot_description', '/left/robot_description':
        offer(topic, urdf('one'))
    ros.until(feed.descriptions)
    assert feed.descriptions().keys() == {'/left/robot_description'}


def test_joint_states_without_a_robot_state_publisher(ros, monkeypatch):
    """The page says which program is missing."""
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.0)
    feed = LiveFeed(ros.node)
    ros.node.create_publisher(JointState, '/joint_states', 1)
    ros.until(lambda: feed.why_no_frames().endswith(
        '. /joint_states has a publisher. Start robot_state_publisher FILE. More: tf_doctor '
        '--explain missing_frame'))
