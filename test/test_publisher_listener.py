"""Tests of the PublisherListener over DDS: which node has published a transform."""

import ctypes
import sys
import threading
import time
from types import SimpleNamespace

from conftest import TIMEOUT, tool
import pytest
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rclpy.time import Time

from dummy_arm.tf import (
    Buffer,
    publisher_listener,
    StaticTransformBroadcaster,
    TFMessage,
    TransformBroadcaster,
)
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._ros import rclpy_private
from dummy_arm.tf._ros.rclpy_private import subscribe, Taker
from dummy_arm.tf._ros.transform_stamped import message_of
from dummy_arm.tf._wire.cdr import pack, unpack
from dummy_arm.tf.publisher_listener import PublisherListener, ReceivedMessage, UNKNOWN

S = 10**9
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def listener(ros):
    """A listener that knows the publisher of each transform."""
    created = PublisherListener(Buffer(node=ros.node), ros.node)
    yield created
    created.unregister()


def publisher_of(listener, name, known=True):
    """
    Wait for a frame, and return the name of the node that has published it.

    :param known: True: wait until the node is known.
    """
    deadline = time.monotonic() + TIMEOUT
    while time.monotonic() < deadline:
        for frame in listener.frames():
            if frame.name == name and (frame.authority != UNKNOWN or not known):
                return frame.authority
        time.sleep(0.01)
    pytest.fail(f'frame {name!r} or its publisher was not found in time: {listener.frames()}')


def test_each_transform_is_of_the_node_that_sent_it(ros, start, listener):
    """The publisher is known while several nodes publish, and after it has ended."""
    broadcaster = TransformBroadcaster(ros.node)
    StaticTransformBroadcaster(ros.node).sendTransform(message_of(Row(0, 'map', 'a', STILL)))
    process = start(*tool(
        'static_transform_publisher', '--frame-id', 'map', '--child-frame-id', 'b',
        '--ros-args', '-r', '__ns:=/robot', '-r', '__node:=other'))
    arm = start(*tool('dummy_arm'))
    for i in range(100):
        broadcaster.sendTransform(message_of(Row(i * S, 'map', 'c', STILL)))
        time.sleep(0.002)
    assert publisher_of(listener, 'a') == '/test'
    assert publisher_of(listener, 'b') == '/robot/other'
    assert publisher_of(listener, 'c') == '/test'
    assert publisher_of(listener, 'joint_1') == '/dummy_arm'
    process.close()
    arm.close()
    assert publisher_of(listener, 'b') == '/robot/other'
    assert listener.buffer.frames()[0].authority not in ('', '/test')  # a gid


def test_the_newest_publisher_counts(ros, start, listener):
    """If two nodes publish the same frame, its publisher is that of the newest transform."""
    broadcaster = TransformBroadcaster(ros.node)
    arm = start(*tool('dummy_arm'))
    assert publisher_of(listener, 'joint_1') == '/dummy_arm'
    arm.close()
    deadline = time.monotonic() + TIMEOUT
    while publisher_of(listener, 'joint_1') != '/test':
        broadcaster.sendTransform(message_of(Row(time.time_ns(), 'base_link', 'joint_1', STILL)))
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize('lacks', ['the library', 'the function'])
def test_where_rcl_cannot_be_called_the_publisher_is_unknown(ros, monkeypatch, lacks):
    """The listener reports an unknown publisher, and receives the transforms all the same."""
    def load(name):
        if lacks == 'the library':
            raise OSError(name)
        return object()

    monkeypatch.setattr(ctypes, 'PyDLL', load)
    rclpy_private.rcl_take.cache_clear()
    listener = PublisherListener(Buffer(node=ros.node), ros.node)
    try:
        StaticTransformBroadcaster(ros.node).sendTransform(message_of(Row(0, 'map', 'a', STILL)))
        assert publisher_of(listener, 'a', known=False) == UNKNOWN
        (message,), dropped = listener.received()
        assert (message.publisher, message.is_static, dropped) == ('', True, 0)
        assert 0 <= time.time_ns() - message.time < TIMEOUT * S
    finally:
        listener.unregister()
        rclpy_private.rcl_take.cache_clear()


def test_bytes_are_those_that_rclpy_takes(ros, listener, golden_messages):
    """Messages of all sizes, also empty ones, equal those of a raw subscription of rclpy."""
    listener.unregister()
    subscription = subscribe(
        ros.node, TFMessage, '/bytes', lambda _: None, QoSProfile(depth=100),
        ros.node.default_callback_group)
    raw: list[bytes] = []
    ros.node.create_subscription(TFMessage, '/bytes', raw.append, 100, raw=True)
    publisher = ros.node.create_publisher(TFMessage, '/bytes', 100)
    ros.until(lambda: publisher.get_subscription_count() == 2)
    messages = [bytes.fromhex(case['cdr_hex']) for case in golden_messages]
    begin = time.time_ns()
    for message in messages:
        publisher.publish(message)
    taken: list[ReceivedMessage] = []
    taker = Taker(ReceivedMessage.of)

    def all_taken():
        taker.take(subscription.handle, 1000, taken)
        return len(taken) == len(raw) == len(messages)

    ros.until(all_taken)
    assert taken == raw
    (gid,) = {message.publisher for message in taken}
    (info,) = ros.node.get_publishers_info_by_topic('/bytes')
    assert bytes.fromhex(gid) == bytes(info.endpoint_gid)[:16]
    times = [begin, *(message.time for message in taken), time.time_ns()]
    assert times == sorted(times)
    subscription.destroy()


def test_listeners_in_threads_of_their_own_do_not_mix_up_messages(ros, golden_messages):
    """Each Taker writes into its own memory, although threads take at the same time."""
    ends = threading.Event()
    mixed: list[ReceivedMessage] = []
    publishers, subscriptions = zip(*(
        (ros.node.create_publisher(TFMessage, topic, 1000),
         subscribe(ros.node, TFMessage, topic, lambda _: None, QoSProfile(depth=1000),
                   ros.node.default_callback_group))
        for topic in ('/one', '/two')))
    ros.until(lambda: all(publisher.get_subscription_count() for publisher in publishers))
    messages = [bytes.fromhex(case['cdr_hex']) for case in golden_messages[1:3]]

    def take(subscription, expected):
        taken: list[ReceivedMessage] = []
        taker = Taker(ReceivedMessage.of)
        while not ends.is_set():
            taker.take(subscription.handle, 1000, taken)
        mixed.extend(message for message in taken if message != expected)
        counts.append(len(taken))

    counts: list[int] = []
    threads = [threading.Thread(target=take, args=both) for both in zip(subscriptions, messages)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        for thread in threads:
            thread.start()
        for _ in range(2000):
            for publisher, message in zip(publishers, messages):
                publisher.publish(message)
    finally:
        time.sleep(0.2)
        ends.set()
        for thread in threads:
            thread.join()
        sys.setswitchinterval(interval)
    assert min(counts) > 500
    assert not mixed
    for subscription in subscriptions:
        subscription.destroy()


@pytest.fixture
def send(ros, listener):
    """
    Return a function that publishes a transform with a stamp (ns) and returns the message.

    Publisher and listener have discovered each other.
    """
    publisher = TransformBroadcaster(ros.node).pub_tf

    def send(stamp):
        message = pack([Row(stamp, 'map', 'moving', STILL)])
        publisher.publish(message)
        return message

    for stamp in range(1, 100):
        send(stamp)
        if has_arrived(listener, stamp, 0.2):
            listener.received()
            return send
    pytest.fail('the listener received nothing in time')


def has_arrived(listener, stamp, seconds=TIMEOUT):
    """Wait for a transform; return True if it and all earlier ones are in the buffer in time."""
    return listener.buffer.can_transform(
        'map', 'moving', Time(nanoseconds=stamp), Duration(seconds=seconds))


def test_received_messages_are_returned_once(ros, listener, send):
    """Messages keep their order, gid, time and topic, even if a lookup has pulled them before."""
    static = StaticTransformBroadcaster(ros.node)
    begin, sent, latched, messages = time.time_ns(), [], [], []
    for number in range(100, 150):
        sent.append(send(number))
        latched.append(Row(0, 'map', f'still_{number}', STILL))
        static.sendTransform(message_of(latched[-1]))
        if number % 3:
            messages += listener.received().messages
        assert has_arrived(listener, number)
        listener.buffer.lookup_transform(
            'map', f'still_{number}', Time(), Duration(seconds=TIMEOUT))
    messages += listener.received().messages
    assert listener.received() == ([], 0)
    for topic, expected in (('/tf', sent), ('/tf_static', [
            pack(latched[:count]) for count in range(1, 51)])):
        of_topic = [message for message in messages
                    if message.is_static == (topic == '/tf_static')]
        assert of_topic == expected
        (info,) = ros.node.get_publishers_info_by_topic(topic)
        assert {message.publisher for message in of_topic} == {bytes(info.endpoint_gid)[:16].hex()}
        times = [begin, *(message.time for message in of_topic), time.time_ns()]
        assert times == sorted(times)


def test_received_messages_are_returned_to_one_thread_only(listener, send):
    """No message is lost or returned twice while several threads call `received`."""
    ends, messages = threading.Event(), []

    def receive():
        while not ends.is_set():
            messages.extend(listener.received().messages)

    threads = [threading.Thread(target=receive) for _ in range(3)]
    for thread in threads:
        thread.start()
    try:
        sent = []
        for stamp in range(100, 1100):
            sent.append(send(stamp))
            if stamp % 50 == 0:  # so that no queue overflows
                assert has_arrived(listener, stamp)
        assert has_arrived(listener, 1099)
    finally:
        ends.set()
        for thread in threads:
            thread.join()
    messages += listener.received().messages
    assert sorted(messages) == sorted(sent)


def test_messages_from_before_the_end_are_received(listener, send):
    """`received` returns exactly the messages whose transforms are in the buffer."""
    sent = [send(stamp) for stamp in range(100, 150)]
    assert has_arrived(listener, 149)
    sent += [send(stamp) for stamp in range(150, 200)]
    listener.unregister()
    messages, dropped = listener.received()
    assert len(messages) >= 50
    assert (messages, dropped) == (sent[:len(messages)], 0)
    assert listener.buffer.dump()['moving']['stamps'][-len(messages):] == [
        unpack(message)[0].stamp_ns for message in messages]
    send(200)
    time.sleep(0.2)
    assert listener.received() == ([], 0)


SIZE = len(pack([Row(0, 'map', 'moving', STILL)]))


@pytest.mark.parametrize(('limit', 'value', 'kept'), [
    ('_MOST_MESSAGES', 10, 10), ('_MOST_BYTES', 11 * SIZE - 1, 10), ('_MOST_BYTES', 2 * SIZE, 2),
    ('_MOST_BYTES', SIZE - 1, 0)])
def test_the_number_and_size_of_kept_messages_are_bounded(
        listener, send, monkeypatch, limit, value, kept):
    """`received` returns the newest messages, and the number of those that were dropped."""
    assert publisher_listener._MOST_MESSAGES == 10_000
    assert publisher_listener._MOST_BYTES == 16 * 2**20
    monkeypatch.setattr(publisher_listener, limit, value)
    for stamps in range(100, 125), range(125, 175), range(175, 176):
        sent = [send(stamp) for stamp in stamps]
        assert has_arrived(listener, stamps[-1])
        dropped = max(0, len(sent) - kept)
        assert listener.received() == (sent[dropped:], dropped)
        assert listener.received() == ([], 0)


def test_the_names_that_are_kept_are_bounded(ros, listener, monkeypatch):
    """The names of the existing publishers are kept, and those of the last that have ended."""
    monkeypatch.setattr(publisher_listener, '_MOST_NAMES', 10)
    gids = [bytes([i] * 16) for i in range(100)]

    def name_at(i):
        """Return the name of publisher i, by its gid, while only 0 and i exist."""
        monkeypatch.setattr(ros.node, 'get_publishers_info_by_topic', lambda _: [
            SimpleNamespace(endpoint_gid=gid, node_name='node', node_namespace=f'/{gid[0]}')
            for gid in (gids[0], gids[i])])
        return listener.names_of([gids[i].hex()])

    for i in range(1, 100):
        assert name_at(i) == {gids[i].hex(): f'/{i}/node'}
    names = listener.names_of(gid.hex() for gid in gids)
    assert [i for i, gid in enumerate(gids) if names[gid.hex()] != UNKNOWN] == [
        0, *range(91, 100)]
