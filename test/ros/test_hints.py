"""The hints of a program with a Buffer and a TransformListener, from its clock and ROS graph."""

import gc
import re
import weakref

from geometry_msgs.msg import PointStamped, TransformStamped
import pytest
from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.time import Time
from ros_node import Ros, stamped

from dummy_arm.tf import (
    Buffer,
    ExtrapolationException,
    MessageFilter,
    TFMessage,
    TransformBroadcaster,
    TransformException,
    TransformListener,
)
from dummy_arm.tf.publisher_listener import PublisherListener

S = 10**9
FUTURE = 'See troubleshooting.md: Extrapolation into the future.'


@pytest.fixture
def other(ros):
    """A node of another participant: within one, a topic cannot have two types."""
    ros_of_other = Ros(ros.context.get_domain_id())
    yield ros_of_other.node
    ros_of_other.close()


@pytest.fixture
def buffer(ros):
    """The buffer of a program."""
    created = Buffer(node=ros.node)
    listener = TransformListener(created, ros.node)
    yield created
    listener.unregister()


def error_of(buffer, time=0, source='base'):
    """Return the error that a lookup raises."""
    with pytest.raises(TransformException) as raised:
        buffer.lookup_transform('map', source, Time(nanoseconds=time))
    return raised.value


def now_of(ros):
    """Return the time of the node (ns)."""
    return ros.node.get_clock().now().nanoseconds


def send(ros, node, buffer, *stamps):
    """Send the frame base in map at some times, until they have arrived; return the publisher."""
    publisher = TransformBroadcaster(node).pub_tf
    message = TFMessage(transforms=[stamped('map', 'base', stamp) for stamp in stamps])

    def has_arrived():
        publisher.publish(message)
        return buffer.can_transform('map', 'base', Time(nanoseconds=stamps[-1]))

    ros.until(has_arrived)
    return publisher


def logged(capfd, text):
    """Return a function that returns True as soon as stderr has a text."""
    error = ''

    def is_logged():
        nonlocal error
        error += capfd.readouterr().err
        return text in error

    return is_logged


def test_the_clock_is_known_without_a_listener(ros):
    """Also after a listener has ended."""
    buffer = Buffer(node=ros.node)
    buffer.set_transform(stamped('map', 'base', now_of(ros) - 30 * S), 'test')
    buffer.set_transform(stamped('map', 'base', now_of(ros) - 29 * S), 'test')
    before = str(error_of(buffer, now_of(ros)))
    assert re.search(r'29\.\d+ s old', before)
    TransformListener(buffer, ros.node).unregister()
    assert re.search(r'29\.\d+ s old', str(error_of(buffer, now_of(ros))))


def test_another_namespace(ros, buffer):
    """The arguments of the listener are named, and the option of commands."""
    TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    ros.until(lambda: str(error_of(buffer)).endswith(
        'No transform has been received yet. No transform has arrived on /tf, but transforms are '
        "published on /robot1/tf. To listen to /robot1/tf, pass tf_topic='/robot1/tf', "
        "tf_static_topic='/robot1/tf_static' to the TransformListener; in commands, pass "
        '--namespace robot1. See troubleshooting.md: A leading slash, or a namespace.'))
    listener = TransformListener(
        buffer, ros.node, tf_topic='/robot1/tf', tf_static_topic='/robot1/tf_static')
    assert 'robot1' not in str(error_of(buffer))
    listener.unregister()


def test_another_type(ros, other, buffer):
    """The debug tuple of can_transform names the node and the type, too."""
    other.create_publisher(TransformStamped, '/tf', 10)
    ros.until(lambda: buffer.can_transform('map', 'base', Time(), return_debug_tuple=True) == (
        False, 'Invalid frame ID "map" passed to canTransform argument target_frame - frame does '
        'not exist. No transform has been received yet. /test publishes '
        'geometry_msgs/msg/TransformStamped on /tf. The type must be tf2_msgs/msg/TFMessage: send '
        'transforms with a TransformBroadcaster or a StaticTransformBroadcaster. See '
        'troubleshooting.md: A frame does not exist.'))


def test_a_publisher_that_is_not_latched(ros, buffer):
    """Nothing arrives from it, so that two trees are not connected."""
    for root in 'map', 'world':
        buffer.set_transform_static(stamped(root, f'child_of_{root}'), 'test')
    ros.node.create_publisher(TFMessage, '/tf_static', 10)
    ros.until(lambda: str(error_of(buffer, source='world')).endswith(
        "in the tree with root 'world'. Nothing arrives on /tf_static from /test, whose publisher "
        'is not transient local. Send with a StaticTransformBroadcaster. See '
        'troubleshooting.md: The QoS of /tf_static.'))


def test_a_listener_that_is_not_latched(ros):
    """It misses what was sent before its start."""
    buffer = Buffer()
    listener = TransformListener(buffer, ros.node, static_qos=QoSProfile(depth=10))
    assert str(error_of(buffer)).endswith(
        'This listener of /tf_static is not transient local, so it misses what was sent before '
        'its start. Omit static_qos, or make it transient local. See troubleshooting.md: The QoS '
        'of /tf_static.')
    listener.unregister()


def test_data_that_still_come(ros, buffer):
    """Waiting helps; the newest stamp is in the future here, however slow this test is."""
    latest = now_of(ros) + 3600 * S
    send(ros, ros.node, buffer, latest - S, latest)
    assert str(error_of(buffer, latest + S // 2)).endswith(
        "The data of edge 'map' -> 'base' end 0.500000000 s before that time. Data still come, so "
        'this transform is on its way. Pass timeout= to wait for it, or time 0 (Time()) for the '
        f'latest transform. {FUTURE}')


def test_a_publisher_that_has_ended(ros, buffer):
    """The TransformListener knows who publishes on /tf; the PublisherListener, who published."""
    latest = now_of(ros) - 5 * S
    publisher = send(ros, ros.node, buffer, latest - S, latest)
    assert f'the publishers on {publisher.topic} are /test. Check the publisher, or look up time' \
        in str(error_of(buffer, latest + S))
    ros.node.destroy_publisher(publisher)
    ros.until(lambda: 's old: nothing publishes on /tf any more. Check the publisher, or look ' in
              str(error_of(buffer, latest + S)))


def test_a_node_that_has_ended(ros, other):
    """The PublisherListener knows which publisher has sent the newest transform."""
    buffer = Buffer(node=ros.node)
    listener = PublisherListener(buffer, ros.node)
    latest = now_of(ros) - 5 * S
    publisher = send(ros, other, buffer, latest - S, latest)
    ros.until(lambda: 'old: /test, which has published it, still exists, but is silent. Check '
              '/test, or' in str(error_of(buffer, latest + S)))
    ros.until(listener.publishers)
    other.destroy_publisher(publisher)
    ros.until(lambda: 'old: /test, which has published it, has ended. Check /test, or look up '
              in str(error_of(buffer, latest + S)))
    listener.unregister()


@pytest.fixture
def simulated(ros):
    """A node whose clock is simulated: it is 100 s."""
    node = Node('simulated', context=ros.context,
                parameter_overrides=[Parameter('use_sim_time', value=True)])
    clock = node.get_clock()
    assert isinstance(clock, ROSClock)
    clock.set_ros_time_override(Time(seconds=100, clock_type=ClockType.ROS_TIME))
    yield node
    node.destroy_node()


def test_two_clocks(ros, simulated):
    """The node has use_sim_time, the publisher has not."""
    buffer = Buffer()
    listener = TransformListener(buffer, simulated)
    now = now_of(ros)
    send(ros, ros.node, buffer, now - S, now)
    assert str(error_of(buffer, 100 * S)).endswith(
        'These times are probably from different clocks: the requested time is on the simulated '
        'clock of this node, the data are not. Set use_sim_time in all nodes, or in none. See '
        'troubleshooting.md: use_sim_time and the wall clock.')
    listener.unregister()


def test_a_buffer_without_a_listener(simulated):
    """It knows the clock of its node."""
    buffer = Buffer(node=simulated)
    for stamp in 99 * S, 100 * S:
        buffer.set_transform(stamped('map', 'base', stamp), 'test')
    assert 'Data still come' in str(error_of(buffer, 101 * S))
    assert 'The buffer keeps the last 10 s of each frame.' in str(error_of(buffer, 89 * S))
    assert 'That time is before the first transform' in str(error_of(buffer, 91 * S))


def test_a_message_filter_logs_the_cause(ros, buffer, capfd):
    """It waits for a frame that is published in another namespace."""
    TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    ros.until(lambda: 'robot1' in str(error_of(buffer)))
    message_filter = MessageFilter(None, buffer, 'map', 1, ros.node)
    for stamp in 1, 2:
        message = PointStamped()
        message.header.frame_id, message.header.stamp.sec = 'base', stamp
        message_filter.add(message)
    ros.until(logged(capfd, '--namespace robot1. See troubleshooting.md: A leading slash, or a '))


def test_an_old_transform_is_logged_with_its_node(ros, other, capfd):
    """The authority of a PublisherListener is a gid; the node follows."""
    buffer = Buffer(node=ros.node)
    listener = PublisherListener(buffer, ros.node)
    publisher = send(ros, other, buffer, 100 * S)
    ros.until(lambda: ('/test', '/tf') in listener.publishers().values())
    publisher.publish(TFMessage(transforms=[stamped('map', 'base', 50 * S)]))
    ros.until(logged(capfd, 'Publisher: /test. See troubleshooting.md: TF_OLD_DATA.'))
    listener.unregister()


@pytest.mark.parametrize('is_shut_down', [False, True])
def test_an_error_is_read_after_the_end_of_the_node(domain_id, is_shut_down):
    """Then nothing is known of the graph; the text is complete all the same."""
    context = Context()
    context.init(domain_id=domain_id)
    node = Node('short', context=context)
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node)
    for stamp in S, 2 * S:
        buffer.set_transform(stamped('map', 'base', stamp), 'test')
    error = error_of(buffer, 3 * S)
    if is_shut_down:
        context.shutdown()
    else:
        node.destroy_node()
    assert isinstance(error, ExtrapolationException)
    assert str(error).endswith(FUTURE)
    listener.unregister()
    if is_shut_down:
        node.destroy_node()
    context.try_shutdown()


def test_an_unread_error_keeps_no_buffer(ros):
    """Nor a listener; read later, it knows nothing of them."""
    buffer = Buffer(node=ros.node)
    listener = TransformListener(buffer, ros.node)
    for stamp in S, 2 * S:
        buffer.set_transform(stamped('map', 'base', stamp), 'test')
    error = error_of(buffer, 3 * S).with_traceback(None)
    listener.unregister()
    gone = [weakref.ref(each) for each in (buffer, listener)]
    del buffer, listener
    gc.collect()
    assert [each() for each in gone] == [None, None]
    assert 'If data still come' in str(error)
