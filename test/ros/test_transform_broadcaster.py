"""TransformBroadcaster and StaticTransformBroadcaster, over DDS."""

from decimal import Decimal
import math
import sys
import threading
from typing import Any, cast
import warnings

from geometry_msgs.msg import Quaternion, TransformStamped
import numpy as np
import pytest
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from ros_node import LATCHED, run_in_thread, stamped

from puretf import StaticTransformBroadcaster, TFMessage, Transform, TransformBroadcaster


def transform(frame_id='map', child_frame_id='base_link', x=0.0, rotation=(0.0, 0.0, 0.0, 1.0)):
    """Return a TransformStamped."""
    message = stamped(frame_id, child_frame_id, x=x)
    message.transform.rotation = Quaternion(**dict(zip('xyzw', rotation)))
    return message


@pytest.fixture
def received(ros):
    """The transforms of every message on /tf."""
    messages = []
    ros.node.create_subscription(TFMessage, '/tf', lambda m: messages.append(m.transforms), 100)
    return messages


@pytest.mark.parametrize(('broadcaster', 'topic', 'durability'), [
    (TransformBroadcaster, '/tf', DurabilityPolicy.VOLATILE),
    (StaticTransformBroadcaster, '/tf_static', DurabilityPolicy.TRANSIENT_LOCAL)])
def test_quality_of_service(ros, broadcaster, topic, durability):
    """The profile is that of tf2_ros, unless one is given; a depth alone keeps the durability."""
    for qos in (None, 7):
        pub_tf = broadcaster(ros.node, qos).pub_tf
        assert pub_tf.topic_name == topic
        assert pub_tf.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert pub_tf.qos_profile.durability == durability
        assert pub_tf.qos_profile.depth == (qos or (100 if topic == '/tf' else 1))
    profile = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
    assert broadcaster(ros.node, qos=profile).pub_tf.qos_profile == profile
    overridden = broadcaster(
        ros.node, qos_overriding_options=QoSOverridingOptions.with_default_policies())
    assert overridden.pub_tf.qos_profile.durability == durability
    assert ros.node.has_parameter(f'qos_overrides.{topic}.publisher.depth')


@pytest.mark.parametrize(('count', 'given'), [
    (1, lambda transforms: transforms[0]), (2, list), (2, iter)], ids=['one', 'list', 'iterator'])
def test_one_transform_or_any_iterable_is_one_message(ros, received, count, given):
    """A single transform needs no list; all arrive as they were sent."""
    sent = [transform('map', 'odom', 2.0, (0.0, 0.0, 0.6, 0.8)), transform('/a', 'b')][:count]
    sent[0].header.stamp = Time(nanoseconds=1_700_000_000_123_456_789).to_msg()
    TransformBroadcaster(ros.node).sendTransform(given(sent))
    ros.until(lambda: received)
    assert received == [sent]


BAD = [
    (transform(x=math.nan), "'map' -> 'base_link': every number must be finite"),
    (transform(x=math.inf), 'every number must be finite'),
    (transform(rotation=(0.0, 0.0, 0.0, math.nan)), 'every number must be finite'),
    (transform(rotation=(0.0, 0.0, 0.0, 0.0)), r'cannot be normalised; use \(0, 0, 0, 1\)'),
    (transform(rotation=(0.0, 1e-170, 0.0, 0.0)), 'cannot be normalised'),
    (transform(rotation=(0.0, 1e200, 0.0, 0.0)), 'cannot be normalised'),
    (transform(frame_id=''), r"'' -> 'base_link': header.frame_id is empty"),
    (transform(frame_id='/'), 'header.frame_id is empty'),
    (transform(child_frame_id=''), "'map' -> '': child_frame_id is empty"),
    (transform('map', 'map'), "'map' -> 'map': a frame cannot be its own parent"),
    (transform('map', '/map'), 'a frame cannot be its own parent'),
    (transform(frame_id='a\0b'), 'must not contain a NUL'),
    (transform(frame_id='\ud800'), 'must be valid Unicode'),
    (transform(x=10**400), r"2 of 2, to child 'base_link': transform\.translation\.x must be a n"),
    (transform(x=Decimal(1)), r'transform\.translation\.x must be a number, got Decimal')]


@pytest.mark.parametrize('kind', [TransformBroadcaster, StaticTransformBroadcaster])
def test_a_bad_transform_is_a_value_error(ros, kind):
    """The error names the frame and says what is wrong."""
    broadcaster = kind(ros.node)
    for bad, error in BAD:
        with pytest.raises(ValueError, match=error):
            broadcaster.sendTransform([transform('a', 'b'), bad])


def test_after_a_shutdown(ros):
    """Ctrl-C in a callback that sends is the exception that programs expect of `rclpy.spin`."""
    moving, static = TransformBroadcaster(ros.node), StaticTransformBroadcaster(ros.node)
    prepared = moving.prepare([('map', 'base_link')])
    ros.node.context.shutdown()
    for send in (lambda: moving.sendTransform(transform()),
                 lambda: static.sendTransform(transform()),
                 lambda: prepared.send(1, [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)])):
        with pytest.raises(ExternalShutdownException):
            send()


def test_odd_but_sound_transforms_are_sent(ros, received):
    """Huge numbers, integers and quaternions of another length than one are valid."""
    odd = [transform('map', 'far', 1.7e308), transform('map', 'b', 0.0, (0.0, 0.0, 0.0, 2.0)),
           transform('map', 'c', 3)]
    odd[0].transform.translation.y = 1.7e308
    broadcaster, poses = TransformBroadcaster(ros.node), POSES.copy()
    poses[:, 0] = 1.7e308  # their sum overflows
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        broadcaster.sendTransform(odd)
        broadcaster.prepare(EDGES).send(1, poses)
    ros.until(lambda: len(received) == 2)
    assert received[0] == odd
    assert received[1][1].transform.translation.x == 1.7e308


def test_a_list_with_one_bad_element_sends_nothing(ros, received):
    """The first message that arrives is the one after it."""
    broadcaster = TransformBroadcaster(ros.node)
    with pytest.raises(ValueError, match='finite'):
        broadcaster.sendTransform([transform('a', 'b'), transform(x=math.nan)])
    broadcaster.sendTransform(transform('a', 'c'))
    ros.until(lambda: received)
    assert received == [[transform('a', 'c')]]


def latched(ros):
    """Return the transforms of the only message that a late subscriber of /tf_static receives."""
    late: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf_static', late.append, LATCHED)
    ros.until(lambda: late)
    (message,) = late
    return message.transforms


def test_a_signal_handler_may_send_statics(ros):
    """Also while the program sends; nothing is lost."""
    broadcaster, sent = StaticTransformBroadcaster(ros.node), list[bytes]()
    publisher = broadcaster.pub_tf

    class Interrupted:
        def publish(self, data):
            if not sent:
                sent.append(data)
                broadcaster.sendTransform(transform('map', 'last'))
            publisher.publish(data)

    broadcaster.pub_tf = cast(Any, Interrupted())
    run_in_thread(lambda: broadcaster.sendTransform(transform('map', 'first')))
    broadcaster.sendTransform(transform('map', 'end'))
    assert {each.child_frame_id for each in latched(ros)} == {'first', 'last', 'end'}


def test_statics_accumulate(ros):
    """A late subscriber receives the newest transform of each child, as it was when sent."""
    broadcaster = StaticTransformBroadcaster(ros.node)
    kept = transform('map', 'a', 1.0)
    broadcaster.sendTransform(kept)
    kept.transform.translation.x = 99.0  # the broadcaster has made a copy
    broadcaster.sendTransform([transform('map', 'b', 2.0), transform('map', 'c', 3.0)])
    with pytest.raises(ValueError, match='finite'):
        broadcaster.sendTransform([transform('map', 'a', 7.0), transform('map', 'd', math.nan)])
    broadcaster.sendTransform(transform('odom', '/b', 4.0))
    assert latched(ros) == [
        transform('map', 'a', 1.0), transform('odom', '/b', 4.0), transform('map', 'c', 3.0)]


def test_statics_are_replaced(ros):
    """`replace` drops the frames that were sent before; if one of its frames is bad, nothing."""
    broadcaster = StaticTransformBroadcaster(ros.node)
    broadcaster.sendTransform([transform('map', 'a', 1.0), transform('map', 'b', 2.0)])
    broadcaster.replace(iter([transform('map', 'b', 3.0), transform('b', 'c', 4.0)]))
    with pytest.raises(ValueError, match='finite'):
        broadcaster.replace([transform('map', 'd', math.nan)])
    broadcaster.sendTransform(transform('c', 'e', 5.0))
    assert latched(ros) == [
        transform('map', 'b', 3.0), transform('b', 'c', 4.0), transform('c', 'e', 5.0)]


@pytest.mark.parametrize(('stamp', 'sec', 'nanosec'), [
    (0, 0, 0), (1_700_000_000_123_456_789, 1_700_000_000, 123_456_789), (-1, -1, 999_999_999)])
def test_a_transform_as_a_message(stamp, sec, nanosec):
    """`to_message` is the inverse of `from_message`; integers become float64."""
    expected = transform('a', 'b', 1.5)
    expected.header.stamp.sec, expected.header.stamp.nanosec = sec, nanosec
    message = Transform(stamp, 'a', 'b', (1.5, 0, 0), (0, 0, 0, 1)).to_message()
    assert message == expected
    assert deserialize_message(serialize_message(message), TransformStamped) == expected
    assert Transform.from_message(message) == Transform(stamp, 'a', 'b', (1.5, 0.0, 0.0))


def test_several_threads_may_send(ros):
    """Each message is that of one thread; each static one has all frames before it, too."""
    moving, static = TransformBroadcaster(ros.node, 1000), StaticTransformBroadcaster(ros.node)
    prepared = moving.prepare([('map', f'{i}') for i in range(20)])
    start = threading.Barrier(4)
    received: list[TFMessage] = []
    lengths: list[int] = []
    ros.node.create_subscription(TFMessage, '/tf', received.append, 1000)
    ros.node.create_subscription(
        TFMessage, '/tf_static', lambda message: lengths.append(len(message.transforms)), 1000)

    def send(thread):
        start.wait()
        for i in range(60):
            prepared.send(thread, np.tile([thread, 0, 0, 0, 0, 0, 1], (20, 1)))
            moving.sendTransform([transform(x=float(thread))] * 20)
            static.sendTransform(transform('map', f'{thread} {i}'))

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=send, args=(thread,)) for thread in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    ros.until(lambda: len(received) == 480 and 240 in lengths)
    assert lengths == sorted(lengths)
    for message in received:
        numbers = {each.transform.translation.x for each in message.transforms}
        assert len(numbers) == 1
        assert {each.header.stamp.nanosec for each in message.transforms} in ({0}, numbers)


EDGES = [('map', 'odom'), ('odom', 'base_link')]
POSES = np.array([[1, 2, 3, 0, 0, 0, 1], [4, 5, 6, 0, 0, 0.6, 0.8]])


def test_a_prepared_set(ros, received):
    """The names are given once, then only poses and a stamp for each send."""
    prepared = TransformBroadcaster(ros.node).prepare(EDGES)
    stamp = Time(nanoseconds=1_500_000_000)
    for each in stamp, stamp.to_msg(), stamp.nanoseconds, np.int64(stamp.nanoseconds):
        prepared.send(each, POSES)
    ros.until(lambda: len(received) == 4)
    expected = [transform('map', 'odom', 1.0),
                transform('odom', 'base_link', 4.0, (0.0, 0.0, 0.6, 0.8))]
    for message, (y, z) in zip(expected, [(2.0, 3.0), (5.0, 6.0)]):
        message.header.stamp = stamp.to_msg()
        message.transform.translation.y, message.transform.translation.z = y, z
    assert received == [expected] * 4


def test_a_prepared_set_refuses_bad_poses(ros, received):
    """The error names the frame, and nothing is sent."""
    prepared = TransformBroadcaster(ros.node).prepare(EDGES)
    for row, column, value, error in (
            (1, 0, math.nan, "'odom' -> 'base_link': every number must be finite"),
            (0, 2, math.inf, "'map' -> 'odom': every number must be finite"),
            (0, 6, math.nan, 'finite'),
            (0, 6, 0.0, "'map' -> 'odom': the quaternion .* cannot be normalised"),
            (1, 5, 1e200, "'odom' -> 'base_link': the quaternion .* cannot be normalised")):
        poses = POSES.copy()
        poses[row, column] = value
        with pytest.raises(ValueError, match=error):
            prepared.send(1, poses)
    prepared.send(2, POSES)
    ros.until(lambda: received)
    assert received[0][0].header.stamp.nanosec == 2


def test_a_prepared_set_refuses_bad_edges_and_stamps(ros):
    """The names are checked when they are prepared, not when they are sent."""
    broadcaster = TransformBroadcaster(ros.node)
    for edges in [], [('map', '')], [('map', 'odom'), ('a', '/a')]:
        with pytest.raises(ValueError, match=r'at least one pair|is empty|its own parent'):
            broadcaster.prepare(edges)
    bad: list[Any] = [
        ('map', 5), ('map', None), ('map', ['a']), ('map', 'a', 'b'), ('map',), 'ab', 3]
    for edge in bad:
        with pytest.raises(TypeError, match='an edge must be two names'):
            broadcaster.prepare([('a', 'b'), edge])
    for stamp in None, 1.5, 'now':
        with pytest.raises(TypeError, match=r'time must be an integer \(ns\), or a time'):
            broadcaster.prepare(EDGES).send(stamp, POSES)
