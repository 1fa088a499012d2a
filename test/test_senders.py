"""Who sent a transform, over DDS."""

import sys
import threading
import time
from types import SimpleNamespace

from conftest import TIMEOUT, tool
import pytest
from rclpy.qos import QoSProfile

from dummy_arm.tf import (
    Buffer,
    senders,
    StaticTransformBroadcaster,
    TFMessage,
    TransformBroadcaster,
)
from dummy_arm.tf.senders import SenderListener, Taker, UNKNOWN
from dummy_arm.tf.subscribing import subscribe
from dummy_arm.tf.transform_stamped import message_of

STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def listener(ros):
    """Listen."""
    made = SenderListener(Buffer(node=ros.node), ros.node)
    yield made
    made.unregister()


def sender_of(listener, name, known=True):
    """Wait for a frame and, if it is to be known, for its sender; give it."""
    deadline = time.monotonic() + TIMEOUT
    while time.monotonic() < deadline:
        for frame in listener.frames():
            if frame.name == name and (frame.authority != UNKNOWN or not known):
                return frame.authority
        time.sleep(0.01)
    pytest.fail(f'not heard in time: {listener.frames()}')


def test_each_transform_is_of_the_node_that_sent_it(ros, start, listener):
    """Also where several send at the same time, and after the sender has ended."""
    ours = TransformBroadcaster(ros.node)
    StaticTransformBroadcaster(ros.node).sendTransform(message_of((0, 0, 'map', 'a', *STILL)))
    process = start(*tool(
        'static_transform_publisher', '--frame-id', 'map', '--child-frame-id', 'b',
        '--ros-args', '-r', '__ns:=/robot', '-r', '__node:=other'))
    arm = start(*tool('dummy_arm'))
    for i in range(100):
        ours.sendTransform(message_of((i, 0, 'map', 'c', *STILL)))
        time.sleep(0.002)
    assert sender_of(listener, 'a') == '/test'
    assert sender_of(listener, 'b') == '/robot/other'
    assert sender_of(listener, 'c') == '/test'
    assert sender_of(listener, 'joint_1') == '/dummy_arm'
    process.close()
    arm.close()
    assert sender_of(listener, 'b') == '/robot/other'
    assert listener.buffer.frames()[0].authority not in ('', '/test')  # a gid


def test_the_newest_sender_counts(ros, start, listener):
    """Where two nodes send the same frame."""
    ours = TransformBroadcaster(ros.node)
    arm = start(*tool('dummy_arm'))
    assert sender_of(listener, 'joint_1') == '/dummy_arm'
    arm.close()
    deadline = time.monotonic() + TIMEOUT
    while sender_of(listener, 'joint_1') != '/test':
        stamp = divmod(time.time_ns(), 10**9)
        ours.sendTransform(message_of((*stamp, 'base_link', 'joint_1', *STILL)))
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize('lacks', ['the library', 'the function'])
def test_where_rcl_cannot_be_called_the_sender_is_unknown(ros, monkeypatch, lacks):
    """It says so, and the transforms come in all the same."""
    def load(name):
        if lacks == 'the library':
            raise OSError(name)
        return object()

    monkeypatch.setattr(senders.ctypes, 'PyDLL', load)
    senders._rcl_take.cache_clear()
    listener = SenderListener(Buffer(node=ros.node), ros.node)
    try:
        StaticTransformBroadcaster(ros.node).sendTransform(message_of((0, 0, 'map', 'a', *STILL)))
        assert sender_of(listener, 'a', known=False) == UNKNOWN
    finally:
        listener.unregister()
        senders._rcl_take.cache_clear()


def test_bytes_are_those_that_rclpy_takes(ros, listener, golden_messages):
    """Of all sizes, empty ones too."""
    listener.unregister()
    subscription = subscribe(ros.node, '/bytes', lambda _: None, QoSProfile(depth=100), None)
    raw = []
    ros.node.create_subscription(TFMessage, '/bytes', raw.append, 100, raw=True)
    publisher = ros.node.create_publisher(TFMessage, '/bytes', 100)
    ros.until(lambda: publisher.get_subscription_count() == 2)
    messages = [bytes.fromhex(case['cdr_hex']) for case in golden_messages]
    begin = time.time_ns()
    for message in messages:
        publisher.publish(message)
    taken, taker = [], Taker()

    def all_taken():
        taker.take_all(subscription, taken)
        return len(taken) == len(raw) == len(messages)

    ros.until(all_taken)
    assert taken == raw
    (gid,) = {message.gid for message in taken}
    (info,) = ros.node.get_publishers_info_by_topic('/bytes')
    assert bytes.fromhex(gid) == bytes(info.endpoint_gid)[:16]
    times = [begin, *(message.received for message in taken), time.time_ns()]
    assert times == sorted(times)
    subscription.destroy()


def test_listeners_in_threads_of_their_own_do_not_mix_up_messages(ros, golden_messages):
    """Each takes into its own memory."""
    ends, mixed = threading.Event(), []
    publishers, subscriptions = zip(*(
        (ros.node.create_publisher(TFMessage, topic, 1000),
         subscribe(ros.node, topic, lambda _: None, QoSProfile(depth=1000), None))
        for topic in ('/one', '/two')))
    ros.until(lambda: all(publisher.get_subscription_count() for publisher in publishers))
    messages = [bytes.fromhex(case['cdr_hex']) for case in golden_messages[1:3]]

    def take(subscription, expected):
        taker, taken = Taker(), []
        while not ends.is_set():
            taker.take_all(subscription, taken)
        mixed.extend(message for message in taken if message != expected)
        counts.append(len(taken))

    counts = []
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


def test_the_names_that_are_kept_are_bounded(ros, listener, monkeypatch):
    """Publishers come and go; those that are there, and the last that were, have names."""
    monkeypatch.setattr(senders, '_MOST_NAMES', 10)
    gids = [bytes([i] * 16) for i in range(100)]

    def look(i):
        """Have two publishers: one that stays, and one that goes next time."""
        monkeypatch.setattr(ros.node, 'get_publishers_info_by_topic', lambda _: [
            SimpleNamespace(endpoint_gid=gid, node_name='node', node_namespace=f'/{gid[0]}')
            for gid in (gids[0], gids[i])])
        return listener.names_of([gids[i].hex()])

    for i in range(1, 100):
        assert look(i) == {gids[i].hex(): f'/{i}/node'}
    names = listener.names_of(gid.hex() for gid in gids)
    assert [i for i, gid in enumerate(gids) if names[gid.hex()] != UNKNOWN] == [
        0, *range(91, 100)]
