"""Listening to /tf and /tf_static, over DDS; what is sent comes from processes of their own."""

from abc import ABC, abstractmethod
import math
from pathlib import Path
import re
import threading
import time
from typing import Any

from conftest import TIMEOUT, unexpected
from endings import without_others
from geometry_msgs.msg import TransformStamped
import pytest
from rclpy.clock import ROSClock
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Empty

from dummy_arm.tf import (
    Buffer,
    BufferCore,
    LookupException,
    MessageBufferCore,
    StaticTransformBroadcaster,
    TFMessage,
    TransformBroadcaster,
    TransformListener,
)
from dummy_arm.tf._core import engine
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._ros.rclpy_private import subscribe
from dummy_arm.tf._ros.subscription import QosMonitor, SubscriptionSource
from dummy_arm.tf._ros.transform_stamped import message_of

LATEST = Time()
WAIT = Duration(seconds=TIMEOUT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

SENDER = """
import sys, time, rclpy
from dummy_arm.tf import StaticTransformBroadcaster, TransformBroadcaster
from dummy_arm.tf._ros.transform_stamped import message_of
parent, *children = sys.argv[1].split()
rclpy.init()
node = rclpy.create_node('sender')
static = StaticTransformBroadcaster(node)
static.sendTransform(message_of((0, parent, children[0] + '_static', (0, 0, 0, 0, 0, 0, 1))))
broadcaster = TransformBroadcaster(node)
print('sending')
while True:
    stamp = time.time_ns()
    broadcaster.sendTransform([
        message_of((stamp, parent, child, (i, 0, 0, 0, 0, 0, 1)))
        for i, child in enumerate(children)])
    time.sleep(0.01)
"""


def made(stamp_ns=0, parent='map', child='robot', x=0.0):
    """Make a transform."""
    return message_of(Row(stamp_ns, parent, child, (x, *STILL[1:])))


@pytest.fixture
def sender(start):
    """Start a process that sends `PARENT CHILD ...` a hundred times a second."""
    def send(frames):
        process = start('-c', SENDER, frames)
        process.line_with('sending')
        return process

    return send


@pytest.fixture
def listen(ros):
    """Make a buffer and its listener."""
    listeners = []

    def make(node=None, buffer=None, **how):
        node = node or ros.node
        buffer = Buffer(node=node) if buffer is None else buffer
        listeners.append(TransformListener(buffer, node, **how))
        return buffer, listeners[-1]

    yield make
    for listener in listeners:
        listener.unregister()


def eventually(condition):
    """Wait until a condition holds, without spinning anything."""
    deadline = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < deadline, 'waited in vain'
        time.sleep(0.002)


def spun(work):
    """Do work in a thread; wait for its end; give its result."""
    results = []
    thread = threading.Thread(target=lambda: results.append(work()), daemon=True)
    thread.start()
    thread.join(2 * TIMEOUT)
    assert results, 'it never ended'
    return results[0]


@pytest.mark.parametrize('spin_thread', [False, True])
@pytest.mark.parametrize('where', ['timer', 'subscription', 'service'])
def test_a_lookup_waits_inside_a_callback(ros, sender, listen, where, spin_thread):
    """Of a single-threaded executor, which spins nothing else meanwhile."""
    buffer, _ = listen(spin_thread=spin_thread)
    answers: list[Any] = []

    def wait(*_):
        if not answers:
            begin = time.monotonic()
            answers.append(buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT))
            answers.append(time.monotonic() - begin)

    other = Node('other', context=ros.context)
    if where == 'timer':
        ros.node.create_timer(0.01, wait)
    elif where == 'subscription':
        ros.node.create_subscription(Empty, 'go', wait, 10)
        publisher = other.create_publisher(Empty, 'go', 10)
        other_timer = threading.Timer(0.5, lambda: publisher.publish(Empty()))
        other_timer.start()
    else:
        from std_srvs.srv import Trigger
        ros.node.create_service(Trigger, 'go', lambda _, answer: wait() or answer)
        client = other.create_client(Trigger, 'go')
        assert client.wait_for_service(TIMEOUT)
        client.call_async(Trigger.Request())
    starting = threading.Timer(0.3, lambda: sender('map robot'))
    starting.start()
    ros.until(lambda: len(answers) == 2, 2 * TIMEOUT)
    assert answers[0].child_frame_id == 'robot'
    assert answers[1] > 0.05
    starting.join()
    other.destroy_node()


def test_spin_once_returns_when_transforms_come_in(ros, sender, listen):
    """Without a timeout, and nothing else that happens in the node."""
    buffer, _ = listen()
    starting = threading.Timer(0.3, lambda: sender('map robot'))
    starting.start()

    def spin():
        executor = SingleThreadedExecutor(context=ros.context)
        executor.add_node(ros.node)
        spins = 0
        while not (buffer.can_transform('map', 'robot', LATEST)
                   and buffer.can_transform('map', 'robot_static', LATEST)):
            executor.spin_once()
            spins += 1
        for _ in range(10):
            executor.spin_once()
        executor.remove_node(ros.node)
        executor.shutdown()
        return spins

    assert spun(spin) > 0
    starting.join()


def test_the_executor_is_woken_ten_times_a_second(ros, sender, listen):
    """However many messages come in; so spinning costs little."""
    buffer, _ = listen()
    for number in range(3):
        sender(f'map robot_{number}')
    eventually(lambda: buffer.can_transform('robot_0', 'robot_2', LATEST))
    executor = SingleThreadedExecutor(context=ros.context)
    executor.add_node(ros.node)
    end, wakes = time.monotonic() + 2.0, 0
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=1.0)
        wakes += 1
    executor.shutdown()
    assert 2 <= wakes <= 24


@pytest.mark.parametrize('with_node', [True, False])
def test_async_waits_end_while_the_node_is_spun(ros, sender, listen, with_node):
    """Soon after the data are there, whether the buffer knows the node or not."""
    buffer, _ = listen(buffer=Buffer(node=ros.node if with_node else None))
    found = []

    async def look():
        transform = await buffer.lookup_transform_async('map', 'robot', LATEST)
        found.append((transform, buffer.lookup_transform('map', 'robot', LATEST)))

    ros.executor.create_task(look)
    ros.executor.spin_once(timeout_sec=0.0)
    sender('map robot')
    ros.until(lambda: found)
    assert found[0][0].child_frame_id == 'robot'


def test_a_late_joiner_has_what_is_static(sender, listen, ros):
    """Although it was sent once, long ago, by two."""
    first, _ = listen()
    sender('map a')
    sender('map b')
    first.lookup_transform('a_static', 'b_static', LATEST, timeout=WAIT)
    for name in 'ab':  # long after that
        first.lookup_transform('map', name, LATEST, timeout=WAIT)
    buffer, _ = listen()
    assert buffer.lookup_transform('a_static', 'b_static', LATEST, timeout=WAIT)


def test_a_publisher_that_was_killed_comes_back(sender, listen, kill):
    """And is heard again."""
    buffer, _ = listen()
    first = sender('map robot')
    buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)
    kill(first)
    silence = buffer.get_latest_common_time('map', 'robot')
    sender('map robot')
    buffer.lookup_transform('map', 'robot', silence + Duration(seconds=0.1), timeout=WAIT)


def test_two_publishers_of_interleaved_frames(sender, listen):
    """Each has every other frame of a chain."""
    buffer, _ = listen()
    sender('f0 f1')
    sender('f1 f2')
    sender('f2 f3')
    begin = buffer.lookup_transform('f0', 'f3', LATEST, timeout=WAIT).header.stamp
    later = Time.from_msg(begin) + Duration(seconds=0.5)
    assert buffer.lookup_transform('f0', 'f3', later, timeout=WAIT)


def test_static_transforms_are_updated(ros, listen):
    """By the same broadcaster, and by another."""
    buffer, _ = listen()
    first, second = StaticTransformBroadcaster(ros.node), StaticTransformBroadcaster(ros.node)
    for number, broadcaster in enumerate([first, first, second, first]):
        broadcaster.sendTransform(made(child=f'other_{number}'))
        broadcaster.sendTransform(made(x=float(number)))
        eventually(lambda: buffer.can_transform(
            'map', f'other_{number}', LATEST))  # noqa: B023
        eventually(lambda: buffer.lookup_transform(
            'map', 'robot', LATEST).transform.translation.x == number)  # noqa: B023


def test_a_clock_that_jumps_back_clears_the_buffer(ros, listen):
    """As does a switch to the simulation's; what is static stays."""
    node = Node('simulated', context=ros.context)
    ros.executor.add_node(node)
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    buffer, _ = listen(node=node)
    StaticTransformBroadcaster(ros.node).sendTransform(made(child='static'))
    broadcaster = TransformBroadcaster(ros.node)

    def send(seconds):
        broadcaster.sendTransform(made(seconds * 10**9))
        eventually(lambda: buffer.can_transform('map', 'robot', Time(seconds=seconds)))

    def tick(seconds):
        def has_ticked():
            clock.publish(Clock(clock=Time(seconds=seconds).to_msg()))
            return node.get_clock().now().nanoseconds == seconds * 10**9
        ros.until(has_ticked)

    ros.until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)
    assert buffer.lookup_transform('map', 'static', LATEST, timeout=WAIT)
    send(100)
    node.set_parameters([Parameter('use_sim_time', value=True)])
    its_clock = node.get_clock()
    assert isinstance(its_clock, ROSClock)
    assert its_clock.ros_time_is_active
    assert not buffer.can_transform('map', 'robot', LATEST)
    tick(100)
    send(100)
    tick(110)
    send(110)
    tick(101)
    assert not buffer.can_transform('map', 'robot', LATEST)
    assert buffer.can_transform('map', 'static', LATEST)
    send(95)
    buffer.lookup_transform('static', 'robot', LATEST)
    ros.executor.remove_node(node)
    node.destroy_node()


def test_remappings_and_namespace_apply_as_with_tf2(ros, listen):
    """The topics' names are absolute, and can be remapped."""
    node = Node('n', context=ros.context, namespace='/robot1',
                cli_args=['--ros-args', '-r', '/tf:=/other/tf', '-r', '/tf_static:=tf_static'])
    _, listener = listen(node=node)
    assert (listener.tf_sub.topic_name, listener.tf_static_sub.topic_name) == (
        '/other/tf', '/robot1/tf_static')
    eventually(lambda: '/other/tf' in dict(ros.node.get_topic_names_and_types()))
    assert [*dict(ros.node.get_subscriber_names_and_types_by_node('n', '/robot1'))].count(
        '/other/tf') == 1
    publisher = ros.node.create_publisher(TFMessage, '/other/tf', 10)
    ros.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(TFMessage(transforms=[made(5)]))
    eventually(lambda: listener.buffer.can_transform('map', 'robot', LATEST))
    node.destroy_node()


def test_no_executor_sees_the_subscriptions(ros, listen):
    """Nothing of the node but one guard condition is added to what it waits for."""
    before = [list(ros.node.subscriptions), list(ros.node.waitables), list(ros.node.guards)]
    _, listener = listen()
    after = [list(ros.node.subscriptions), list(ros.node.waitables), list(ros.node.guards)]
    assert after[:2] == before[:2]
    assert len(after[2]) == len(before[2]) + 1
    assert [name for name, _ in ros.node.get_node_names_and_namespaces()] == ['test']
    listener.unregister()
    assert list(ros.node.guards) == before[2]


def published(ros, listener, *messages):
    """Publish messages, and wait until the last, with a mark in it, is in the buffer."""
    publisher = ros.node.create_publisher(TFMessage, '/tf', 1000)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    for message in messages:
        publisher.publish(message)
    mark = f'mark_{time.monotonic_ns()}'
    publisher.publish(TFMessage(transforms=[made(1, child=mark)]))
    eventually(lambda: listener.buffer.can_transform('map', mark, LATEST))


@pytest.fixture
def said(monkeypatch):
    """List what the listener and the buffer log."""
    lines = []
    from rclpy.impl.rcutils_logger import RcutilsLogger

    def log(self, message, severity, **_):
        lines.append((self.name, message))

    monkeypatch.setattr(RcutilsLogger, 'log', log)
    return lines


def test_malformed_messages_are_counted_and_told_once_a_cause(ros, listen, said, golden_messages):
    """And what comes between them is heard."""
    _, listener = listen()
    data = bytes.fromhex(max((case['cdr_hex'] for case in golden_messages), key=len))
    bad = [data[:end] for end in range(9, len(data) - 8, 41)]
    published(ros, listener, *bad, data[:4] + bytes([255] * 4) + data[8:], b'\0\7' + data[2:])
    assert listener.malformed == len(bad) + 2
    eventually(lambda: len(said) == 3)
    lines = [line for name, line in said if name == 'tf2_listener']
    assert [line.partition(':')[0] for line in lines] == [
        'Dropped a message that cannot be decoded, impossible count',
        'Dropped a message that cannot be decoded, truncated',
        'Dropped a message that cannot be decoded, unknown encoding']
    published(ros, listener, *bad)
    assert listener.malformed == 2 * len(bad) + 2
    assert len([line for name, line in said if name == 'tf2_listener']) == 3


def test_refusals_are_in_the_words_of_tf2_once_a_second(ros, listen, said):
    """NaN, no rotation, a frame in itself, no name, too old; the good ones with them go in."""
    buffer, listener = listen()
    now = 1_700_000_000 * 10**9
    nan, unturned = made(now, child='nan'), made(now, child='unturned')
    nan.transform.translation.x = math.nan
    unturned.transform.rotation.w = 0.0
    bad = [nan, unturned, made(now, parent='self', child='self'), made(now, parent=''),
           made(now, child='')]
    good = made(now, child='good')
    message = TFMessage(transforms=[good, *bad])
    old = TFMessage(transforms=[made(now - 11 * 10**9, child='good')])
    begin = time.monotonic()
    published(ros, listener, *[message] * 20, *[old] * 20)
    eventually(lambda: any('TF_OLD_DATA' in line for _, line in said))
    seconds = time.monotonic() - begin
    lines = [line for name, line in said if name == 'tf2_buffer']
    causes = [line.partition(' ')[0].rstrip(':') for line in lines]
    for cause in ('TF_NAN_INPUT', 'TF_DENORMALIZED_QUATERNION', 'TF_SELF_TRANSFORM',
                  'TF_NO_FRAME_ID', 'TF_NO_CHILD_FRAME_ID', 'TF_OLD_DATA'):
        assert 1 <= causes.count(cause) <= 1 + seconds
    assert ('TF_SELF_TRANSFORM: Ignoring transform from authority "default_authority" with '
            'frame_id and  child_frame_id "self" because they are the same') in lines
    assert set(buffer._getFrameStrings()) >= {'map', 'good'}
    assert not {'nan', 'unturned', 'self', ''} & set(buffer._getFrameStrings())


def test_frames_are_limited(ros, listen, said):
    """A peer that sends ever new names does not fill the machine."""
    buffer, _ = listen(buffer=Buffer(node=ros.node, max_frames=50))
    known = made(1, child='known')
    flood = [TFMessage(transforms=[known, *(
        made(1, child=f'{i}_{j}') for j in range(10))]) for i in range(20)]
    publisher = ros.node.create_publisher(TFMessage, '/tf', 1000)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    for message in flood:
        publisher.publish(message)
    publisher.publish(TFMessage(transforms=[made(2, child='known')]))
    eventually(lambda: buffer.can_transform('map', 'known', Time(nanoseconds=2)))
    assert len(buffer._getFrameStrings()) == 50
    eventually(lambda: said)
    assert [line.partition(':')[0] for _, line in said] == ['TF_TOO_MANY_FRAMES']


def test_a_misfit_is_told_with_the_remedy(ros, said):
    """Static transforms that are not latched never arrive; it is told once a second at most."""
    tf_static, now = subscribe(ros.node, TFMessage, '/tf_static', print, LATCHED,
                               ros.node.default_callback_group), 0.0
    monitor = QosMonitor(tf_static, lambda: now)
    ros.node.create_publisher(TFMessage, '/tf_static', QoSProfile(depth=10))

    def told():
        nonlocal now
        now += 1.0
        monitor.check()
        return said

    ros.until(told)
    assert said[0][1].startswith(
        "New publisher discovered on topic '/tf_static', offering incompatible QoS. "
        'No messages will be received from it. Last incompatible policy: DURABILITY')
    ros.node.create_publisher(TFMessage, '/tf_static', QoSProfile(depth=10))
    ros.until(lambda: ros.node.count_publishers('/tf_static') == 2)
    monitor.check()
    assert len(said) == 1
    ros.until(lambda: len(told()) == 2)
    for _ in range(3):
        told()
    assert len(said) == 2
    monitor.close()
    tf_static.destroy()


def test_qos_is_as_asked(listen):
    """Depths alone leave /tf_static latched; profiles are taken as they are."""
    _, default = listen()
    assert (default.tf_sub.qos_profile.depth, default.tf_static_sub.qos_profile.depth) == (
        100, 100)
    for sub, durability in ((default.tf_sub, DurabilityPolicy.VOLATILE),
                            (default.tf_static_sub, DurabilityPolicy.TRANSIENT_LOCAL)):
        qos = sub.qos_profile
        assert (qos.reliability, qos.durability, qos.history) == (
            ReliabilityPolicy.RELIABLE, durability, HistoryPolicy.KEEP_LAST)
    _, depths = listen(qos=7, static_qos=8)
    assert (depths.tf_sub.qos_profile.depth, depths.tf_static_sub.qos_profile.depth) == (7, 8)
    assert depths.tf_static_sub.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    best_effort = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
    _, profiles = listen(qos=best_effort, static_qos=best_effort)
    for sub in profiles.tf_sub, profiles.tf_static_sub:
        assert sub.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        assert sub.qos_profile.durability == DurabilityPolicy.VOLATILE


class Counting(Buffer):
    """A buffer that counts what is set."""

    moving = static = 0

    def set_transform(self, transform, authority='default_authority'):
        """Count, and set it."""
        assert isinstance(transform, TransformStamped)
        self.moving += 1
        super().set_transform(transform, authority)

    def set_transform_static(self, transform, authority='default_authority'):
        """Count, and set it."""
        self.static += 1
        super().set_transform_static(transform, authority)


class Recorder:
    """What is no Buffer, but can be set."""

    def __init__(self):
        """Begin with nothing."""
        self.moving, self.static = [], []

    def set_transform(self, transform, authority):
        """Remember it."""
        self.moving.append((transform.child_frame_id, authority))

    def set_transform_static(self, transform, authority):
        """Remember it."""
        self.static.append((transform.child_frame_id, authority))


def test_methods_that_are_overridden_are_called(ros, sender, listen):
    """Of a subclass, of anything else, and of the listener."""
    counting, recorder = Counting(node=ros.node), Recorder()

    class Filtering(TransformListener):
        def callback(self, data):
            if data.transforms[0].child_frame_id != 'b':
                super().callback(data)

    filtered = Buffer(node=ros.node)
    listen(buffer=counting)
    listen(buffer=recorder)
    filtering = Filtering(filtered, ros.node)
    sender('map a')
    sender('map b')
    assert counting.lookup_transform('a', 'b', LATEST, timeout=WAIT)
    assert counting.lookup_transform('a_static', 'b_static', LATEST, timeout=WAIT)
    assert counting.moving >= 2
    assert counting.static >= 2
    eventually(lambda: {name for name, _ in recorder.moving} == {'a', 'b'})
    eventually(lambda: set(recorder.static) == {
        (f'{name}_static', 'default_authority') for name in 'ab'})
    assert filtered.lookup_transform('a', 'b_static', LATEST, timeout=WAIT)
    assert not filtered.can_transform('map', 'b', LATEST)
    filtering.unregister()


@pytest.mark.parametrize('kind', [Buffer, MessageBufferCore, BufferCore])
def test_a_callback_that_is_overridden_fills_any_buffer(ros, kind):
    """With what that takes: a BufferCore has no messages."""
    class Own(TransformListener):
        def callback(self, data):
            super().callback(data)

    buffer = kind()
    listener = Own(buffer, ros.node)
    publisher = ros.node.create_publisher(TFMessage, '/tf', 10)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(TFMessage(transforms=[made(5, x=2.0)]))
    StaticTransformBroadcaster(ros.node).sendTransform(made(child='static'))
    eventually(lambda: len(buffer.frames()) == 2)
    known = buffer.dump()
    assert known['robot']['stamps'] == [5]
    assert known['robot']['poses'][0][0] == 2.0
    assert known['static']['is_static']
    listener.unregister()


def test_an_error_in_what_is_overridden_is_told_and_the_next_message_taken(ros, listen, said):
    """It must not end the thread; nor is it told at each message."""
    class Failing(Counting):
        def set_transform(self, transform, authority='default_authority'):
            super().set_transform(transform, authority)
            raise ZeroDivisionError('of the user')

    buffer, listener = listen(buffer=Failing(node=ros.node))
    published(ros, listener, *[TFMessage(transforms=[made(i)]) for i in range(1, 20)],
              b'\0\1\0\0\1\0\0\0')
    assert buffer.moving == 20
    assert listener.malformed == 1
    eventually(lambda: len(said) > 1)
    errors = [line for name, line in said if 'ZeroDivisionError: of the user' in line]
    assert 1 <= len(errors) <= 3
    assert 'in set_transform' in errors[0]


def test_the_buffer_can_be_changed(ros, sender, listen):
    """To another, to something else, to a BufferCore; what was before gets nothing more."""
    sender('map robot')
    first, listener = listen()
    first.lookup_transform('map', 'robot', LATEST, timeout=WAIT)
    listener.buffer = recorder = Recorder()
    eventually(lambda: recorder.moving)
    last = first.get_latest_common_time('map', 'robot')
    listener.buffer = core = BufferCore()
    assert listener.buffer is core
    assert core.lookup_transform('map', 'robot', 0, timeout=WAIT).stamp > last.nanoseconds
    number = len(recorder.moving)
    later = core.get_latest_common_time('map', 'robot') + 10**8
    assert core.lookup_transform('map', 'robot', later, timeout=WAIT)
    assert len(recorder.moving) == number
    listener.buffer = messages = MessageBufferCore()
    eventually(lambda: messages.can_transform_core('map', 'robot', LATEST)[0])
    assert first.get_latest_common_time('map', 'robot') == last


def test_a_lookup_has_all_that_has_arrived(ros, listen):
    """Also while the thread pauses, since messages come in fast."""
    buffer, _ = listen()
    publisher = ros.node.create_publisher(TFMessage, '/tf', 100)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    late = 0
    for stamp in range(1, 500):
        publisher.publish(TFMessage(transforms=[made(stamp * 10**6)]))
        time.sleep(0.001)
        deadline = time.monotonic() + TIMEOUT
        while not buffer.can_transform('map', 'robot', Time(nanoseconds=stamp * 10**6)):
            assert time.monotonic() < deadline
            late += 1
            time.sleep(0.001)
    assert late < 250  # of 500; if the thread alone took them, some 25 for each


@pytest.mark.parametrize(('depth', 'messages', 'seconds', 'expected'), [
    (100, 50, 0.1, 0.1),  # 500 Hz
    (100, 50, 0.05, 0.05),  # 1000 Hz
    (100, 50, 0.005, 0.005),  # 10 000 Hz
    (100, 76, 0.1, 0.0),  # more may have been lost
    (6, 4, 0.01, 0.0075),
    (1, 1, 0.001, 0.0),
    (100, 9, 0.1, 0.0),  # 90 Hz
    (100, 11, 0.1, 0.1),
    (100, 0, 0.1, 0.0)])
def test_in_a_pause_half_of_the_queue_stays_free(ros, depth, messages, seconds, expected):
    """At the rate since the last round; above 100 Hz, and for a tenth of a second at most."""
    now = 1000.0
    source, publish, close = source_of(ros, depth, lambda: now)
    source.end_round()
    publish(messages)
    now += seconds
    assert source.end_round() == pytest.approx(expected)
    assert source.end_round() == 0.0
    close()


def source_of(ros, depth, clock=time.monotonic):
    """Return a source of a topic, what publishes messages that it then takes, and its end."""
    tf, tf_static = (subscribe(ros.node, TFMessage, topic, print, QoSProfile(depth=depth),
                               ros.node.default_callback_group)
                     for topic in ('/tf', '/tf_static'))
    source = SubscriptionSource(tf_static, tf, unexpected, lambda: None, clock)
    broadcaster = TransformBroadcaster(ros.node)
    ros.until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)

    def publish(count):
        for number in range(count):
            source.take().clear()
            broadcaster.sendTransform(made(number + 1))
            eventually(source.take)
        source.take().clear()

    def close():
        tf.destroy()
        tf_static.destroy()

    return source, publish, close


def test_what_was_taken_stays_until_it_is_emptied(ros):
    """By the buffer, after the insertion: the list is the source's own."""
    source, publish, close = source_of(ros, 10)
    publish(1)
    TransformBroadcaster(ros.node).sendTransform(made(5))
    eventually(source.take)
    assert source.take() is source.take()
    (piece,) = source.take()
    assert (piece.authority, piece.is_static) == ('default_authority', False)
    close()
    assert source.take() == [piece]
    source.take().clear()
    assert source.take() == []


def test_the_trip_of_a_message_is_as_written_down(ros):
    """In the theory of operation, call by call."""
    calls = []

    def profile(frame, event, _):
        _, found, file = frame.f_code.co_filename.rpartition('/dummy_arm/tf/')
        if event == 'call' and found:
            calls.append((frame.f_code.co_name, file))

    threading.setprofile(profile)
    try:
        listener = TransformListener(Buffer(node=ros.node), ros.node)
    finally:
        threading.setprofile(None)
    publisher = ros.node.create_publisher(TFMessage, '/tf', 100)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    for number in range(3):
        before = len(calls)
        publisher.publish(TFMessage(transforms=[made(number + 1)]))
        eventually(lambda: ('insert_batches', '_core/insertion.py') in calls[before:])  # noqa: B023
        eventually(lambda: calls[-1] == ('_wait', '_ros/listener_thread.py'))
    listener.unregister()
    insertion = 'insert_batches', '_core/insertion.py'
    begin = max(i for i, call in enumerate(calls) if call == insertion)
    first = max(i for i in range(begin) if calls[i][0] == '_work')
    last = max(i for i, call in enumerate(calls) if call == ('append', '_core/history.py'))
    trip = [(call.rpartition('.')[2], file) for call, file in re.findall(
        r'^    ([\w.]+) +([\w/]+\.py) ', engine.__doc__, re.MULTILINE)]
    assert len(trip) == 10
    assert len({file for _, file in trip}) <= 7
    taken = [call for call in calls[first:last + 1] if call[0] not in (
        'check',  # for incompatible publishers
        '__init__',  # of a batch
        'normalized')]  # each of few rotations
    topic = ('take', '_ros/subscription.py')
    assert taken.count(topic) == 3  # /tf_static, too
    taken.remove(topic)
    assert taken == trip


def test_listeners_and_contexts_are_independent(ros, listen):
    """Each hears its domain; the end of one leaves the others."""
    other = Context()
    other.init(domain_id=ros.context.get_domain_id() + 100)
    node = Node('elsewhere', context=other)
    here, listener = listen()
    also_here, also = listen()
    elsewhere = Buffer(node=node)
    listener_elsewhere = TransformListener(elsewhere, node)
    StaticTransformBroadcaster(ros.node).sendTransform(made(child='here'))
    StaticTransformBroadcaster(node).sendTransform(made(child='there'))
    for buffer, mine, not_mine in ((here, 'here', 'there'), (also_here, 'here', 'there'),
                                   (elsewhere, 'there', 'here')):
        assert buffer.lookup_transform('map', mine, LATEST, timeout=WAIT)
        assert not buffer.can_transform('map', not_mine, LATEST)
    listener.unregister()
    other.try_shutdown()
    StaticTransformBroadcaster(ros.node).sendTransform(made(child='later'))
    assert also_here.lookup_transform('map', 'later', LATEST, timeout=WAIT)
    assert not here.can_transform('map', 'later', LATEST)
    listener_elsewhere.unregister()
    also.unregister()
    also.unregister()


def test_after_the_end_nothing_more_comes_in(ros, sender, listen):
    """Neither by the thread nor by a lookup, nor if the buffer is set anew."""
    buffer, listener = listen()
    sender('map robot')
    buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)
    listener.unregister()
    assert not [thread for thread in threading.enumerate() if thread.name == 'tf of test']
    last = buffer.get_latest_common_time('map', 'robot')
    listener.buffer = other = Buffer(node=ros.node)
    assert not ros.node.get_subscriptions_info_by_topic('/tf')
    heard, _ = listen()
    heard.lookup_transform('map', 'robot', LATEST, timeout=WAIT)
    eventually(lambda: heard.get_latest_common_time('map', 'robot') > last)
    assert buffer.get_latest_common_time('map', 'robot') == last
    assert not other.can_transform('map', 'robot', LATEST)


@pytest.mark.parametrize('end', ['unregister', 'destroy_node'])
def test_all_that_had_arrived_is_there_after_the_end(ros, listen, end):
    """Whether it was taken already or not."""
    node = Node('ending', context=ros.context)
    buffer, listener = listen(node=node)
    also, _ = listen()
    publish = flood(ros, listener)
    publish(2000 * 10**9)
    last = Time(nanoseconds=2000 * 10**9 + 19)
    eventually(lambda: also.can_transform('map', 'robot', last))  # to which it was sent last
    if end == 'unregister':
        listener.unregister()
    node.destroy_node()
    assert buffer.get_latest_common_time('map', 'robot') == last


def test_messages_come_in_though_nobody_looks_up(ros):
    """In the course of a stream that has the thread pause."""
    class Watched(Buffer):
        """Counts the updates that bring something, which only the thread can make."""

        news = last = 0

        def update(self):
            before, self.last = self.last, super().update()
            self.news += self.last > before
            return self.last

    buffer = Watched(node=ros.node)
    listener = TransformListener(buffer, ros.node)
    publish = flood(ros, listener)
    buffer.news = 0
    for second in range(2001, 2501):
        publish(second * 10**9, 1)
    eventually(lambda: buffer.news >= 3)
    assert buffer.news < 250
    listener.unregister()


def test_what_is_refused_late_is_told_all_the_same(ros, listen, said):
    """Though nothing follows it, and nobody looks up."""
    _, listener = listen()
    publish = flood(ros, listener)
    publish(2000 * 10**9, 60)
    publisher = ros.node.create_publisher(TFMessage, '/tf', 100)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    publish(3000 * 10**9, 60)
    publisher.publish(TFMessage(transforms=[made(child='map')]))
    eventually(lambda: any('TF_SELF_TRANSFORM' in text for _, text in said))


def test_a_shutdown_without_a_word_ends_the_spin(domain_id):
    """As Ctrl-C shuts down, and may find rclpy's executor between its looks at the context."""
    context = Context()
    context.init(domain_id=domain_id)
    node = Node('spun', context=context)
    listener = TransformListener(Buffer(node=node), node)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    ended = []

    def spin():
        try:
            executor.spin()
        except ExternalShutdownException:
            ended.append(time.monotonic())

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    time.sleep(0.5)
    begin = time.monotonic()
    assert context.handle is not None
    context.handle.shutdown()  # which calls none of those that want to know
    thread.join(TIMEOUT)
    assert ended
    assert ended[0] < begin + 2.0
    listener.unregister()
    executor.shutdown()
    node.destroy_node()


def test_the_node_name_is_free_at_once_after_destroy_node(start):
    """No subscription outlives its node, so that the next of this name is the only one."""
    process = start('-c', """
import rclpy
from dummy_arm.tf import Buffer, TransformListener
rclpy.init()
for _ in range(20):
    node = rclpy.create_node('again')
    listener = TransformListener(Buffer(node=node), node)
    node.destroy_node()
rclpy.shutdown()
print('done')
""")
    assert process.exit_code() == 0
    assert process.output == 'done\n'


def test_a_listener_that_nobody_holds_goes_on(ros, sender):
    """As with tf2_ros, whose subscriptions hold it."""
    buffer = Buffer(node=ros.node)
    TransformListener(buffer, ros.node)
    sender('map robot')
    assert buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)


def flood(ros, listener):
    """Make a function that publishes a transform, at a rate at which the thread pauses."""
    publisher = ros.node.create_publisher(TFMessage, '/tf', 100)
    ros.until(lambda: publisher.get_subscription_count() > 0)

    def publish(stamp_ns, number=20):
        for i in range(number):
            publisher.publish(TFMessage(transforms=[made(stamp_ns + i)]))
            time.sleep(0.002)

    publish(1000 * 10**9, 50)
    assert listener.buffer.can_transform('map', 'robot', LATEST)
    return publish


def test_what_was_sent_before_a_clear_does_not_come_in_after_it(ros, listen):
    """It would be newer than all that follows, where time has jumped back."""
    buffer, listener = listen()
    publish = flood(ros, listener)
    for _ in range(10):
        publish(1000 * 10**9)
        time.sleep(0.005)
        buffer.clear()
        assert not buffer.can_transform('map', 'robot', LATEST)
        publish(10**9)
        eventually(lambda: buffer.can_transform('map', 'robot', Time(seconds=1)))
        buffer.clear()


def test_a_buffer_that_is_set_gets_all_that_is_sent_from_then_on(ros, listen):
    """Also when the thread waits for the lock of the one before."""
    first, listener = listen()
    flood(ros, listener)
    second = Buffer(node=ros.node)
    also, _ = listen()
    with first.fetched():
        TransformBroadcaster(ros.node).sendTransform(made(2000 * 10**9))
        eventually(lambda: also.can_transform('map', 'robot', Time(seconds=2000)))
        listener.buffer = second
        StaticTransformBroadcaster(ros.node).sendTransform(made(child='static'))
        eventually(lambda: also.can_transform('map', 'static', LATEST))
    assert second.lookup_transform('map', 'static', LATEST, timeout=WAIT)
    assert not first.can_transform('map', 'static', LATEST)


def test_a_signal_handler_may_look_up(start):
    """Wherever it interrupts a lookup: each pose stays with its stamp."""
    process = start('-c', """
import signal, time
import rclpy
from rclpy.duration import Duration
from rclpy.time import Time
from dummy_arm.tf import Buffer, TransformBroadcaster, TransformListener
rclpy.init()
node = rclpy.create_node('handling')
buffer = Buffer(node=node)
listener = TransformListener(buffer, node)
prepared = TransformBroadcaster(node).prepare([('map', 'robot')])
calls = []
def look_up(*_):
    assert not buffer.can_transform('map', 'nowhere', Time(), Duration(seconds=0.0001))
    buffer.can_transform('map', 'robot', Time())
    buffer.lookup_transforms('map', 'robot', range(0, 10**6, 10**4))
    calls.append(1)
    signal.setitimer(signal.ITIMER_REAL, 0.001)
signal.signal(signal.SIGALRM, look_up)
signal.setitimer(signal.ITIMER_REAL, 0.001)
for stamp in range(1, 4000):
    prepared.send(stamp, [[float(stamp), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    buffer.can_transform('map', 'robot', Time())
    buffer.lookup_transforms('map', 'robot', [stamp])
signal.setitimer(signal.ITIMER_REAL, 0)
assert len(calls) > 100
while not buffer.can_transform('map', 'robot', Time(nanoseconds=3999)):
    time.sleep(0.01)
first = buffer.frames()[0].oldest
for stamp in range(first, 4000):
    assert buffer.lookup_transform(
        'map', 'robot', Time(nanoseconds=stamp)).transform.translation.x == stamp
rclpy.shutdown()
print('good')
""")
    assert process.exit_code() == 0
    assert process.output == 'good\n'


def test_what_a_done_callback_does_leaves_the_thread_alive(ros, listen, said):
    """It may exit, and it may wait for moving and static transforms, although it runs in there."""
    buffer, listener = listen()
    found = []

    def wait(_):
        found.append(buffer.can_transform('map', 'moving', LATEST, timeout=WAIT))
        found.append(buffer.can_transform('map', 'static', LATEST, timeout=WAIT))
        raise SystemExit('of the user')

    buffer.wait_for_transform_async('map', 'robot', LATEST).add_done_callback(wait)
    published(ros, listener)
    broadcaster = TransformBroadcaster(ros.node)
    ros.until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)
    broadcaster.sendTransform(made(1))
    also, _ = listen()
    broadcaster.sendTransform(made(1, child='also'))
    eventually(lambda: also.can_transform('map', 'also', LATEST))
    assert not found
    broadcaster.sendTransform(made(1, child='moving'))
    StaticTransformBroadcaster(ros.node).sendTransform(made(child='static'))
    eventually(lambda: [line for _, line in said if 'SystemExit: of the user' in line])
    assert found == [True, True]
    published(ros, listener)


@pytest.mark.parametrize('own_callback', [False, True])
@pytest.mark.parametrize('way', ['unregister', 'destroy_node'])
def test_an_end_within_a_block_of_the_buffer(ros, way, own_callback):
    """While messages come in: it ends at once, and so does the thread after the block."""
    class Own(TransformListener):
        def callback(self, data):
            super().callback(data)

    for _ in range(5):
        node = Node('test', context=ros.context, namespace='/own')
        buffer = Buffer(node=node)
        listener = (Own if own_callback else TransformListener)(buffer, node)
        broadcaster = TransformBroadcaster(ros.node)
        ros.until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)  # noqa: B023

        def end():
            with buffer.fetched():  # noqa: B023
                broadcaster.sendTransform(made(1))  # noqa: B023
                (listener.unregister if way == 'unregister' else node.destroy_node)()  # noqa: B023
            return True

        assert spun(end)
        eventually(lambda: not threads_of_listeners())
        broadcaster.pub_tf.destroy()
        node.destroy_node()


def test_an_end_while_another_thread_is_in_a_block(ros):
    """It takes no longer than to wait for the listener's thread: half a second."""
    node = Node('test', context=ros.context, namespace='/own')
    buffer = Buffer(node=node)
    TransformListener(buffer, node)
    is_held, is_over = threading.Event(), threading.Event()

    def hold():
        with buffer.fetched():
            is_held.set()
            is_over.wait(2 * TIMEOUT)

    thread = threading.Thread(target=hold)
    thread.start()
    assert is_held.wait(TIMEOUT)
    begin = time.monotonic()
    node.destroy_node()
    assert time.monotonic() - begin < TIMEOUT
    is_over.set()
    thread.join()
    eventually(lambda: not threads_of_listeners())


def threads_of_listeners():
    """List the threads of listeners."""
    return [thread for thread in threading.enumerate() if thread.name == 'tf of test']


def latched_has_come(node):
    """Wait until a thread that ran already would have called the callbacks."""
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node)
    buffer.lookup_transform('map', 'latched', LATEST, timeout=WAIT)
    listener.unregister()


class Filter(TransformListener):
    """A listener whose callbacks need what its constructor sets at its end."""

    def __init__(self, *args, **kwargs):
        """Listen, and take one's time."""
        super().__init__(*args, **kwargs)
        latched_has_come(self.node)
        self.heard = []

    def static_callback(self, data):
        """Remember, and set."""
        self.heard += [transform.child_frame_id for transform in data.transforms]
        super().static_callback(data)


class AbstractFilter(Filter, ABC):
    """The same with another metaclass."""

    @abstractmethod
    def name(self):
        """Give a name."""


class NamedFilter(AbstractFilter):
    """Without a constructor of its own."""

    def name(self):
        """Give a name."""
        return 'filter'


class Mixin:
    """A class whose constructor comes before the listener's."""

    node: Node

    def __init__(self, *args, **kwargs):
        """Listen, and take one's time."""
        super().__init__(*args, **kwargs)
        latched_has_come(self.node)
        self.names = []


class MixedFilter(Mixin, TransformListener):
    """What it needs is set by the constructor of another class."""

    def static_callback(self, data):
        """Remember, and set."""
        self.names.append(data.transforms[0].child_frame_id)
        super().static_callback(data)


class PlainFilter(TransformListener):
    """A filter without a constructor, as a base beside another."""

    def static_callback(self, data):
        """Set."""
        super().static_callback(data)


class BothFilters(PlainFilter, Filter):
    """Its constructor is that of its second base."""


@pytest.mark.parametrize('another_waits', [False, True])
@pytest.mark.parametrize('kind', [Filter, NamedFilter, MixedFilter, BothFilters])
def test_callbacks_of_a_subclass_are_called_after_its_constructor(ros, said, kind, another_waits):
    """A latched message waits till then, and so does another thread; it is not lost."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(made(child='latched'))
    buffer, waiting = Buffer(node=ros.node), None
    if another_waits:
        waiting = threading.Thread(
            target=buffer.lookup_transform, args=('map', 'latched', LATEST, WAIT))
        waiting.start()
        eventually(lambda: buffer.has_waiters)
    listener = kind(buffer, ros.node)
    if waiting is not None:
        waiting.join()
    assert buffer.lookup_transform('map', 'latched', LATEST, timeout=WAIT)
    assert 'latched' in (listener.names if kind is MixedFilter else listener.heard)
    assert not said
    listener.unregister()


@pytest.mark.parametrize('way', ['timeout', 'future', 'poll'])
def test_a_subclass_may_wait_for_a_transform_in_its_constructor(ros, way):
    """By a timeout, a future, or by asking again and again."""
    StaticTransformBroadcaster(ros.node).sendTransform(made(child='latched'))

    class Waiting(TransformListener):
        def __init__(self, buffer, node):
            self.heard = []
            super().__init__(buffer, node)
            arguments = 'map', 'latched', LATEST
            if way == 'timeout':
                self.found = buffer.lookup_transform(*arguments, timeout=WAIT)
            elif way == 'future':
                future = buffer.wait_for_transform_async(*arguments)
                eventually(future.done)
                self.found = future.result()
            else:
                eventually(lambda: buffer.can_transform(*arguments))
                self.found = buffer.lookup_transform(*arguments)

        def static_callback(self, data):
            self.heard += data.transforms
            super().static_callback(data)

    listener = spun(lambda: Waiting(Buffer(node=ros.node), ros.node))
    assert listener.found.child_frame_id == 'latched'
    assert listener.heard
    listener.unregister()


def test_a_subclass_may_end_in_its_constructor(ros):
    """Before its thread was started; nothing is left."""
    class Ended(TransformListener):
        def callback(self, data):
            super().callback(data)

        def __init__(self, buffer, node):
            super().__init__(buffer, node)
            self.unregister()

    Ended(Buffer(node=ros.node), ros.node)
    assert not threads_of_listeners()
    eventually(lambda: not ros.node.get_subscriptions_info_by_topic('/tf'))


def test_a_subclass_whose_constructor_fails_listens_no_more(ros):
    """Nor are its callbacks called, with what it has not set."""
    class Failing(TransformListener):
        def callback(self, data):
            self.nothing.append(data)  # type: ignore[attr-defined]

        def __init__(self, buffer, node):
            super().__init__(buffer, node)
            raise ZeroDivisionError

    buffer = Buffer(node=ros.node)
    with pytest.raises(ZeroDivisionError):
        Failing(buffer, ros.node)
    assert not threads_of_listeners()
    eventually(lambda: not ros.node.get_subscriptions_info_by_topic('/tf'))


def test_a_signal_handler_may_end_a_listener_that_gets_another_buffer(ros):
    """Wherever it interrupts that; the buffer gets nothing more."""
    class Interrupted(Buffer):
        """When a source is added, a signal comes."""

        sources: frozenset[object] = frozenset()

        def add_source(self, source):
            listener.unregister()
            super().add_source(source)
            self.sources |= {source}

        def remove_source(self, source):
            super().remove_source(source)
            self.sources -= {source}

    listener = TransformListener(Buffer(node=ros.node), ros.node)
    other = Interrupted(node=ros.node)

    def switch():
        listener.buffer = other
        return True

    assert spun(switch)
    assert not other.sources
    eventually(lambda: not threads_of_listeners())


def test_a_listener_that_gets_its_own_buffer_again_goes_on(ros):
    """A lookup that waits does not end."""
    class Watched(Buffer):
        """Counts the sources that were removed."""

        removed = 0

        def remove_source(self, source):
            super().remove_source(source)
            self.removed += 1

    buffer = Watched(node=ros.node)
    listener = TransformListener(buffer, ros.node)
    listener.buffer = buffer
    assert not buffer.removed
    listener.unregister()
    assert buffer.removed


def later_looks(buffer):
    """Wait as long as somebody waits who looks again twice without news."""
    with pytest.raises(LookupException):
        buffer.lookup_transform('map', 'nobody', LATEST, timeout=Duration(seconds=0.45))


class Ignoring(TransformListener):
    """A listener that sets nothing."""

    def callback(self, data):
        """Set nothing."""


@pytest.mark.parametrize('kind', [TransformListener, Ignoring])
@pytest.mark.parametrize('end', ['unregister', 'destroy_node', 'other buffer'])
def test_a_blocked_lookup_ends_when_the_last_listener_ends(ros, end, kind):
    """With its last error, and no sooner."""
    node = Node('ending', context=ros.context)
    buffer = Buffer(node=node)
    listeners = [kind(buffer, node), kind(buffer, node)]
    results = []

    def look_up():
        with pytest.raises(LookupException) as error:
            buffer.lookup_transform('map', 'nowhere', LATEST, timeout=WAIT)
        results.append((time.monotonic(), str(error.value)))

    thread = threading.Thread(target=look_up)
    thread.start()
    eventually(lambda: buffer.has_waiters)
    listeners[0].unregister()
    later_looks(buffer)
    assert not results
    begin = time.monotonic()
    if end == 'unregister':
        listeners[1].unregister()
    elif end == 'destroy_node':
        node.destroy_node()
    else:
        listeners[1].buffer = Buffer(node=node)
    thread.join(TIMEOUT / 2)
    assert results[0][0] < begin + TIMEOUT / 2
    assert '"map" passed to lookupTransform argument target_frame does not exist' in results[0][1]
    listeners[1].unregister()
    node.destroy_node()


def test_a_lookup_that_began_before_any_listener_waits_on(ros, sender):
    """One that comes and goes does not end it; the next brings the transform."""
    buffer = Buffer(node=ros.node)
    found = []
    thread = threading.Thread(target=lambda: found.append(
        buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)))
    thread.start()
    eventually(lambda: buffer.has_waiters)
    TransformListener(buffer, ros.node).unregister()
    later_looks(buffer)
    assert thread.is_alive()
    listener = TransformListener(buffer, ros.node)
    sender('map robot')
    thread.join(TIMEOUT)
    assert found
    listener.unregister()


@pytest.mark.parametrize('ending', [KeyboardInterrupt, SystemExit])
def test_ctrl_c_in_who_ends_a_listener_is_not_swallowed(ros, ending):
    """It is not of the listener's thread; as SystemExit of a callback that runs there."""
    class Late(Buffer):
        """Its listener's thread gets no news."""

        def update(self):
            return 0 if threads_of_listeners() == [threading.current_thread()] else (
                super().update())

    buffer = Late(node=ros.node)
    listener = TransformListener(buffer, ros.node)

    def end(_):
        raise ending

    buffer.wait_for_transform_async('map', 'robot', LATEST).add_done_callback(end)
    broadcaster = TransformBroadcaster(ros.node)
    ros.until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)
    broadcaster.sendTransform(made(1))
    eventually(lambda: buffer.can_transform('map', 'robot', LATEST))  # which finishes no future
    with pytest.raises(ending):
        listener.unregister()
    assert not buffer.is_held()
    eventually(lambda: not threads_of_listeners())


#: A few times, and more than a hundred.
often = pytest.mark.parametrize('count', [3, pytest.param(101, marks=pytest.mark.soak)])


def ended(start, count, kind, *ways):
    """Run `endings.py` in two ways at the same time; wait for the good end of both."""
    script = str(Path(__file__).parent / 'endings.py')
    processes = [start(script, str(count), kind, way, str(100 * i)) for i, way in enumerate(ways)]
    for process in processes:
        assert process.exit_code(300) == 0
        assert without_others(process.output) == 'all ended\n'


@often
def test_every_order_of_ending_in_a_thread(start, count):
    """In any order of three calls, again and again; in the executor's and the listener's."""
    ended(start, count, 'in', 'executor', 'thread')


@often
def test_every_order_of_ending_in_the_main_thread(start, count):
    """In any order of three calls, again and again."""
    ended(start, count, 'in', 'main')


@often
def test_every_end_of_a_program(start, count):
    """Again and again: its last line, and sys.exit() in a callback."""
    ended(start, count, 'by', 'end', 'exit')


@often
def test_every_end_by_ctrl_c(start, count):
    """Again and again: while it spins, and while it waits for a transform."""
    ended(start, count, 'by', 'spin', 'lookup')
