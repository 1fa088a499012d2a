"""Tests of the TransformListener over DDS; most publishers run in processes of their own."""

from abc import ABC, abstractmethod
import math
from pathlib import Path
import re
import threading
import time
from typing import Any

from conftest import fail_on_error, ignore, TIMEOUT
from endings import without_library_lines
from geometry_msgs.msg import TransformStamped
import pytest
from rclpy.clock import ROSClock
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
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
    StaticTransformListener,
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

PUBLISHER = """
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


def stamped(stamp_ns=0, parent='map', child='robot', x=0.0):
    """Return a TransformStamped without rotation; the stamp is in ns, x in m."""
    return message_of(Row(stamp_ns, parent, child, (x, *STILL[1:])))


@pytest.fixture
def start_publisher(start):
    """
    Return a function that starts a process which publishes transforms.

    Its argument is `PARENT CHILD ...`: the frames, which are published a hundred times a second.
    """
    def start_publishing(frames):
        process = start('-c', PUBLISHER, frames)
        process.line_with('sending')
        return process

    return start_publishing


@pytest.fixture
def listen(ros):
    """Return a function that creates a buffer and its listener."""
    listeners = []

    def create(node=None, buffer=None, **kwargs):
        node = node or ros.node
        buffer = Buffer(node=node) if buffer is None else buffer
        listeners.append(TransformListener(buffer, node, **kwargs))
        return buffer, listeners[-1]

    yield create
    for listener in listeners:
        listener.unregister()


def eventually(condition):
    """Wait until a condition holds, without spinning anything."""
    deadline = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < deadline, 'the condition did not become true in time'
        time.sleep(0.002)


def run_in_thread(work):
    """Call a function in a thread, wait until it returns, and return its result."""
    results = []
    thread = threading.Thread(target=lambda: results.append(work()), daemon=True)
    thread.start()
    thread.join(2 * TIMEOUT)
    assert results, 'the function did not return in time'
    return results[0]


@pytest.mark.parametrize('spin_thread', [False, True])
@pytest.mark.parametrize('where', ['timer', 'subscription', 'service'])
def test_a_lookup_waits_inside_a_callback(ros, start_publisher, listen, where, spin_thread):
    """The lookup succeeds although a single-threaded executor spins nothing else meanwhile."""
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
    starting = threading.Timer(0.3, lambda: start_publisher('map robot'))
    starting.start()
    ros.until(lambda: len(answers) == 2, 2 * TIMEOUT)
    assert answers[0].child_frame_id == 'robot'
    assert answers[1] > 0.05
    starting.join()
    other.destroy_node()


def test_spin_once_returns_when_transforms_arrive(ros, start_publisher, listen):
    """The transforms alone end a spin_once without a timeout: nothing else happens in the node."""
    buffer, _ = listen()
    starting = threading.Timer(0.3, lambda: start_publisher('map robot'))
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

    assert run_in_thread(spin) > 0
    starting.join()


def test_the_executor_is_woken_ten_times_a_second(ros, start_publisher, listen):
    """The executor is not woken for each message, so spinning the node costs little."""
    buffer, _ = listen()
    for number in range(3):
        start_publisher(f'map robot_{number}')
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
def test_async_waits_end_while_the_node_is_spun(ros, start_publisher, listen, with_node):
    """A coroutine continues soon after the data arrive, even if the buffer has no node."""
    buffer, _ = listen(buffer=Buffer(node=ros.node if with_node else None))
    found = []

    async def look_up():
        transform = await buffer.lookup_transform_async('map', 'robot', LATEST)
        found.append((transform, buffer.lookup_transform('map', 'robot', LATEST)))

    ros.executor.create_task(look_up)
    ros.executor.spin_once(timeout_sec=0.0)
    start_publisher('map robot')
    ros.until(lambda: found)
    assert found[0][0].child_frame_id == 'robot'


def test_a_late_joiner_receives_static_transforms(start_publisher, listen, ros):
    """Two publishers have sent the transforms only once, long before the listener starts."""
    first, _ = listen()
    start_publisher('map a')
    start_publisher('map b')
    first.lookup_transform('a_static', 'b_static', LATEST, timeout=WAIT)
    for name in 'ab':  # both publishers have sent further messages
        first.lookup_transform('map', name, LATEST, timeout=WAIT)
    buffer, _ = listen()
    assert buffer.lookup_transform('a_static', 'b_static', LATEST, timeout=WAIT)


def test_a_publisher_that_was_killed_comes_back(start_publisher, listen, kill):
    """Transforms of its successor are received like those of the first publisher."""
    buffer, _ = listen()
    first = start_publisher('map robot')
    buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)
    kill(first)
    silence = buffer.get_latest_common_time('map', 'robot')
    start_publisher('map robot')
    buffer.lookup_transform('map', 'robot', silence + Duration(seconds=0.1), timeout=WAIT)


def test_two_publishers_of_interleaved_frames(start_publisher, listen):
    """A lookup combines the edges of a chain that different publishers send."""
    buffer, _ = listen()
    start_publisher('f0 f1')
    start_publisher('f1 f2')
    start_publisher('f2 f3')
    begin = buffer.lookup_transform('f0', 'f3', LATEST, timeout=WAIT).header.stamp
    later = Time.from_msg(begin) + Duration(seconds=0.5)
    assert buffer.lookup_transform('f0', 'f3', later, timeout=WAIT)


def test_static_transforms_are_updated(ros, listen):
    """The same broadcaster may update a static transform, and so may another one."""
    buffer, _ = listen()
    first, second = StaticTransformBroadcaster(ros.node), StaticTransformBroadcaster(ros.node)
    for number, broadcaster in enumerate([first, first, second, first]):
        broadcaster.sendTransform(stamped(child=f'other_{number}'))
        broadcaster.sendTransform(stamped(x=float(number)))
        eventually(lambda: buffer.can_transform(
            'map', f'other_{number}', LATEST))  # noqa: B023
        eventually(lambda: buffer.lookup_transform(
            'map', 'robot', LATEST).transform.translation.x == number)  # noqa: B023


def test_a_clock_that_jumps_back_clears_the_buffer(ros, listen):
    """A switch to simulated time clears the buffer, too; static transforms stay."""
    node = Node('simulated', context=ros.context)
    ros.executor.add_node(node)
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    buffer, _ = listen(node=node)
    StaticTransformBroadcaster(ros.node).sendTransform(stamped(child='static'))
    broadcaster = TransformBroadcaster(ros.node)

    def send(seconds):
        broadcaster.sendTransform(stamped(seconds * 10**9))
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
    """The names of the topics are absolute, and can be remapped."""
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
    publisher.publish(TFMessage(transforms=[stamped(5)]))
    eventually(lambda: listener.buffer.can_transform('map', 'robot', LATEST))
    node.destroy_node()


def test_other_topics(ros, listen):
    """Listeners and broadcasters can use other topics than /tf and /tf_static."""
    topics = {'tf_topic': '/robot1/tf', 'tf_static_topic': 'robot1/tf_static'}
    buffer, listener = listen(**topics)
    default, _ = listen()
    assert [each.topic_name for each in listener.subscriptions] == [
        '/robot1/tf_static', '/robot1/tf']
    dynamic = TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    static = StaticTransformBroadcaster(ros.node, tf_static_topic='/robot1/tf_static')
    eventually(lambda: dynamic.pub_tf.get_subscription_count() == 1)
    dynamic.sendTransform(stamped(5))
    static.sendTransform(stamped(0, 'robot', 'camera'))
    buffer.lookup_transform('map', 'camera', LATEST, WAIT)
    assert not default.frame_names()
    for create in TransformListener, StaticTransformListener:
        with pytest.raises(InvalidTopicNameException, match="must not contain repeated '/'"):
            create(Buffer(), ros.node, tf_static_topic='robot1//tf_static')


def test_a_static_transform_listener(ros):
    """It receives what was latched before, and never subscribes to /tf."""
    StaticTransformBroadcaster(ros.node).sendTransform(stamped(0, 'robot', 'camera'))
    buffer, node = Buffer(), Node('static_only', context=ros.context)
    listener = StaticTransformListener(buffer, node, spin_thread=True, static_qos=LATCHED)
    buffer.lookup_transform('robot', 'camera', LATEST, WAIT)
    assert listener.tf_sub is None

    def topics():
        return dict(ros.node.get_subscriber_names_and_types_by_node('static_only', '/'))

    eventually(lambda: '/tf_static' in topics())
    assert '/tf' not in topics()
    listener.unregister()
    eventually(lambda: '/tf_static' not in topics())
    node.destroy_node()


def test_a_static_transform_listener_calls_its_callback(ros):
    """An overridden callback gets the messages, as that of a TransformListener does."""
    frames: list[str] = []

    class Recorder(StaticTransformListener):
        def static_callback(self, data):
            frames.extend(transform.child_frame_id for transform in data.transforms)

    listener = Recorder(Buffer(), ros.node)
    StaticTransformBroadcaster(ros.node).sendTransform(stamped(0, 'robot', 'camera'))
    eventually(lambda: frames == ['camera'])
    listener.unregister()


def test_no_executor_sees_the_subscriptions(ros, listen):
    """The listener adds only one guard condition to the node, and removes it at its end."""
    before = [list(ros.node.subscriptions), list(ros.node.waitables), list(ros.node.guards)]
    _, listener = listen()
    after = [list(ros.node.subscriptions), list(ros.node.waitables), list(ros.node.guards)]
    assert after[:2] == before[:2]
    assert len(after[2]) == len(before[2]) + 1
    assert [name for name, _ in ros.node.get_node_names_and_namespaces()] == ['test']
    listener.unregister()
    assert list(ros.node.guards) == before[2]


def publish_and_wait(ros, listener, *messages):
    """Publish messages and one more with a new frame; wait until that is in the buffer."""
    publisher = ros.node.create_publisher(TFMessage, '/tf', 1000)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    for message in messages:
        publisher.publish(message)
    mark = f'mark_{time.monotonic_ns()}'
    publisher.publish(TFMessage(transforms=[stamped(1, child=mark)]))
    eventually(lambda: listener.buffer.can_transform('map', mark, LATEST))


@pytest.fixture
def log_lines(monkeypatch):
    """The lines that the listener and the buffer log, each with the name of its logger."""
    lines = []
    from rclpy.impl.rcutils_logger import RcutilsLogger

    def log(self, message, severity, **_):
        lines.append((self.name, message))

    monkeypatch.setattr(RcutilsLogger, 'log', log)
    return lines


def test_malformed_messages_are_counted_and_logged_once_per_cause(
        ros, listen, log_lines, golden_messages):
    """A valid message that follows is inserted, and a cause is not logged a second time."""
    _, listener = listen()
    data = bytes.fromhex(max((case['cdr_hex'] for case in golden_messages), key=len))
    bad = [data[:end] for end in range(9, len(data) - 8, 41)]
    publish_and_wait(
        ros, listener, *bad, data[:4] + bytes([255] * 4) + data[8:], b'\0\7' + data[2:])
    assert listener.malformed == len(bad) + 2
    eventually(lambda: len(log_lines) == 3)
    lines = [line for name, line in log_lines if name == 'tf2_listener']
    assert [line.partition(':')[0] for line in lines] == [
        'Dropped a message that cannot be decoded, impossible count',
        'Dropped a message that cannot be decoded, truncated',
        'Dropped a message that cannot be decoded, unknown encoding']
    publish_and_wait(ros, listener, *bad)
    assert listener.malformed == 2 * len(bad) + 2
    assert len([line for name, line in log_lines if name == 'tf2_listener']) == 3


def test_refusals_are_in_the_words_of_tf2_once_a_second(ros, listen, log_lines):
    """Each cause is logged once a second at most; valid transforms in a message are inserted."""
    buffer, listener = listen()
    now = 1_700_000_000 * 10**9
    nan, unturned = stamped(now, child='nan'), stamped(now, child='unturned')
    nan.transform.translation.x = math.nan
    unturned.transform.rotation.w = 0.0
    bad = [nan, unturned, stamped(now, parent='self', child='self'), stamped(now, parent=''),
           stamped(now, child='')]
    good = stamped(now, child='good')
    message = TFMessage(transforms=[good, *bad])
    old = TFMessage(transforms=[stamped(now - 11 * 10**9, child='good')])
    begin = time.monotonic()
    publish_and_wait(ros, listener, *[message] * 20, *[old] * 20)
    eventually(lambda: any('TF_OLD_DATA' in line for _, line in log_lines))
    seconds = time.monotonic() - begin
    lines = [line for name, line in log_lines if name == 'tf2_buffer']
    causes = [line.partition(' ')[0].rstrip(':') for line in lines]
    for cause in ('TF_NAN_INPUT', 'TF_DENORMALIZED_QUATERNION', 'TF_SELF_TRANSFORM',
                  'TF_NO_FRAME_ID', 'TF_NO_CHILD_FRAME_ID', 'TF_OLD_DATA'):
        assert 1 <= causes.count(cause) <= 1 + seconds
    assert ('TF_SELF_TRANSFORM: Ignoring transform from authority "default_authority" with '
            'frame_id and  child_frame_id "self" because they are the same') in lines
    assert set(buffer._getFrameStrings()) >= {'map', 'good'}
    assert not {'nan', 'unturned', 'self', ''} & set(buffer._getFrameStrings())


def test_frames_are_limited(ros, listen, log_lines):
    """A publisher that keeps sending new frame names cannot fill the memory."""
    buffer, _ = listen(buffer=Buffer(node=ros.node, max_frames=50))
    known = stamped(1, child='known')
    flood = [TFMessage(transforms=[known, *(
        stamped(1, child=f'{i}_{j}') for j in range(10))]) for i in range(20)]
    publisher = ros.node.create_publisher(TFMessage, '/tf', 1000)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    for message in flood:
        publisher.publish(message)
    publisher.publish(TFMessage(transforms=[stamped(2, child='known')]))
    eventually(lambda: buffer.can_transform('map', 'known', Time(nanoseconds=2)))
    assert len(buffer._getFrameStrings()) == 50
    eventually(lambda: log_lines)
    assert {line.partition(':')[0] for _, line in log_lines} == {'TF_TOO_MANY_FRAMES'}


def test_incompatible_qos_is_logged_with_the_remedy(ros, log_lines):
    """Static transforms that are not latched never arrive; the log has one line per second."""
    tf_static, now = subscribe(ros.node, TFMessage, '/tf_static', ignore, LATCHED,
                               ros.node.default_callback_group), 0.0
    monitor = QosMonitor(tf_static, lambda: now)
    ros.node.create_publisher(TFMessage, '/tf_static', QoSProfile(depth=10))

    def check_later():
        nonlocal now
        now += 1.0
        monitor.check()
        return log_lines

    ros.until(check_later)
    assert log_lines[0][1].startswith(
        "New publisher discovered on topic '/tf_static', offering incompatible QoS. "
        'No messages will be received from it. Last incompatible policy: DURABILITY')
    ros.node.create_publisher(TFMessage, '/tf_static', QoSProfile(depth=10))
    ros.until(lambda: ros.node.count_publishers('/tf_static') == 2)
    monitor.check()
    assert len(log_lines) == 1
    ros.until(lambda: len(check_later()) == 2)
    for _ in range(3):
        check_later()
    assert len(log_lines) == 2
    monitor.close()
    tf_static.destroy()


def test_qos_is_as_asked(listen):
    """A depth alone leaves /tf_static latched; a profile is used as it is."""
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
    """A buffer that counts the calls of its setters."""

    dynamic = static = 0

    def set_transform(self, transform, authority='default_authority'):
        """Count the call, and insert a dynamic transform."""
        assert isinstance(transform, TransformStamped)
        self.dynamic += 1
        super().set_transform(transform, authority)

    def set_transform_static(self, transform, authority='default_authority'):
        """Count the call, and insert a static transform."""
        self.static += 1
        super().set_transform_static(transform, authority)


class Recorder:
    """An object that is not a buffer, but has the setters of one."""

    def __init__(self):
        """Create empty lists of calls."""
        self.dynamic, self.static = [], []

    def set_transform(self, transform, authority):
        """Record the frame and the authority of a dynamic transform."""
        self.dynamic.append((transform.child_frame_id, authority))

    def set_transform_static(self, transform, authority):
        """Record the frame and the authority of a static transform."""
        self.static.append((transform.child_frame_id, authority))


def test_methods_that_are_overridden_are_called(ros, start_publisher, listen):
    """The setters of a Buffer subclass or another object are called, as are own callbacks."""
    counting, recorder = Counting(node=ros.node), Recorder()

    class Filtering(TransformListener):
        def callback(self, data):
            if data.transforms[0].child_frame_id != 'b':
                super().callback(data)

    filtered = Buffer(node=ros.node)
    listen(buffer=counting)
    listen(buffer=recorder)
    filtering = Filtering(filtered, ros.node)
    start_publisher('map a')
    start_publisher('map b')
    assert counting.lookup_transform('a', 'b', LATEST, timeout=WAIT)
    assert counting.lookup_transform('a_static', 'b_static', LATEST, timeout=WAIT)
    assert counting.dynamic >= 2
    assert counting.static >= 2
    eventually(lambda: {name for name, _ in recorder.dynamic} == {'a', 'b'})
    eventually(lambda: set(recorder.static) == {
        (f'{name}_static', 'default_authority') for name in 'ab'})
    assert filtered.lookup_transform('a', 'b_static', LATEST, timeout=WAIT)
    assert not filtered.can_transform('map', 'b', LATEST)
    filtering.unregister()


@pytest.mark.parametrize('kind', [Buffer, MessageBufferCore, BufferCore])
def test_a_callback_that_is_overridden_fills_any_buffer(ros, kind):
    """The base callback passes messages to a Buffer, and a Transform to a BufferCore."""
    class Own(TransformListener):
        def callback(self, data):
            super().callback(data)

    buffer = kind()
    listener = Own(buffer, ros.node)
    publisher = ros.node.create_publisher(TFMessage, '/tf', 10)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(TFMessage(transforms=[stamped(5, x=2.0)]))
    StaticTransformBroadcaster(ros.node).sendTransform(stamped(child='static'))
    eventually(lambda: len(buffer.frames()) == 2)
    known = buffer.dump()
    assert known['robot']['stamps'] == [5]
    assert known['robot']['poses'][0][0] == 2.0
    assert known['static']['is_static']
    listener.unregister()


def test_an_error_in_an_overridden_method_is_logged_and_the_next_message_taken(
        ros, listen, log_lines):
    """The error does not end the thread, and is not logged for each message."""
    class Failing(Counting):
        def set_transform(self, transform, authority='default_authority'):
            super().set_transform(transform, authority)
            raise ZeroDivisionError('of the user')

    buffer, listener = listen(buffer=Failing(node=ros.node))
    publish_and_wait(ros, listener, *[TFMessage(transforms=[stamped(i)]) for i in range(1, 20)],
              b'\0\1\0\0\1\0\0\0')
    assert buffer.dynamic == 20
    assert listener.malformed == 1
    eventually(lambda: len(log_lines) > 1)
    errors = [line for name, line in log_lines if 'ZeroDivisionError: of the user' in line]
    assert 1 <= len(errors) <= 3
    assert 'in set_transform' in errors[0]


def test_the_buffer_can_be_changed(ros, start_publisher, listen):
    """The new buffer may be of any kind, and the previous one receives nothing more."""
    start_publisher('map robot')
    first, listener = listen()
    first.lookup_transform('map', 'robot', LATEST, timeout=WAIT)
    listener.buffer = recorder = Recorder()
    eventually(lambda: recorder.dynamic)
    last = first.get_latest_common_time('map', 'robot')
    listener.buffer = core = BufferCore()
    assert listener.buffer is core
    assert core.lookup_transform('map', 'robot', 0, timeout=WAIT).stamp > last.nanoseconds
    number = len(recorder.dynamic)
    later = core.get_latest_common_time('map', 'robot') + 10**8
    assert core.lookup_transform('map', 'robot', later, timeout=WAIT)
    assert len(recorder.dynamic) == number
    listener.buffer = messages = MessageBufferCore()
    eventually(lambda: messages.can_transform_core('map', 'robot', LATEST)[0])
    assert first.get_latest_common_time('map', 'robot') == last


def test_a_lookup_has_all_that_has_arrived(ros, listen):
    """A lookup inserts the messages in the queue, even while the listener's thread pauses."""
    buffer, _ = listen()
    publisher = ros.node.create_publisher(TFMessage, '/tf', 100)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    late = 0  # failed attempts; with the thread alone, some 25 for each message
    for stamp in range(1, 500):
        publisher.publish(TFMessage(transforms=[stamped(stamp * 10**6)]))
        time.sleep(0.001)
        deadline = time.monotonic() + TIMEOUT
        while not buffer.can_transform('map', 'robot', Time(nanoseconds=stamp * 10**6)):
            assert time.monotonic() < deadline
            late += 1
            time.sleep(0.001)
    assert late < 250


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
    """The pause follows from the rate since the last round; up to 100 Hz there is no pause."""
    now = 1000.0
    source, publish, close = source_of(ros, depth, lambda: now)
    source.end_round()
    publish(messages)
    now += seconds
    assert source.end_round() == pytest.approx(expected)
    assert source.end_round() == 0.0
    close()


def source_of(ros, depth, clock=time.monotonic):
    """
    Create a source with its own subscriptions.

    :returns: the source, a function that publishes messages which the source then takes, and a
        function that destroys the subscriptions.
    """
    tf, tf_static = (subscribe(ros.node, TFMessage, topic, ignore, QoSProfile(depth=depth),
                               ros.node.default_callback_group)
                     for topic in ('/tf', '/tf_static'))
    source = SubscriptionSource(tf_static, tf, fail_on_error, lambda: None, clock)
    broadcaster = TransformBroadcaster(ros.node)
    ros.until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)

    def publish(count):
        for number in range(count):
            source.take().clear()
            broadcaster.sendTransform(stamped(number + 1))
            eventually(source.take)
        source.take().clear()

    def close():
        tf.destroy()
        tf_static.destroy()

    return source, publish, close


def test_taken_messages_stay_until_the_list_is_cleared(ros):
    """The source keeps the list, which the buffer clears after the insertion."""
    source, publish, close = source_of(ros, 10)
    publish(1)
    TransformBroadcaster(ros.node).sendTransform(stamped(5))
    eventually(source.take)
    assert source.take() is source.take()
    (piece,) = source.take()
    assert (piece.authority, piece.is_static) == ('default_authority', False)
    close()
    assert source.take() == [piece]
    source.take().clear()
    assert source.take() == []


def test_the_trip_of_a_message_is_as_written_down(ros):
    """The theory of operation in engine.py lists exactly the calls that a message causes."""
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
        publisher.publish(TFMessage(transforms=[stamped(number + 1)]))
        eventually(lambda: ('insert_batches', '_core/insertion.py') in calls[before:])  # noqa: B023
        eventually(lambda: calls[-1] == ('_wait', '_ros/listener_thread.py'))
    listener.unregister()
    insertion = 'insert_batches', '_core/insertion.py'
    begin = max(i for i, call in enumerate(calls) if call == insertion)
    first = max(i for i in range(begin) if calls[i][0] == '_work')
    last = max(i for i, call in enumerate(calls) if call == ('append', '_core/history.py'))
    trip = [(call.rpartition('.')[2], file) for call, file in re.findall(
        r'^    ([\w.]+) +([\w/]+\.py) ', engine.__doc__, re.MULTILINE)]
    assert len(trip) == 11
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
    """Each listener receives the messages of its domain, and goes on when another one ends."""
    other = Context()
    other.init(domain_id=ros.context.get_domain_id() + 100)
    node = Node('elsewhere', context=other)
    here, listener = listen()
    also_here, also = listen()
    elsewhere = Buffer(node=node)
    listener_elsewhere = TransformListener(elsewhere, node)
    StaticTransformBroadcaster(ros.node).sendTransform(stamped(child='here'))
    StaticTransformBroadcaster(node).sendTransform(stamped(child='there'))
    for buffer, mine, not_mine in ((here, 'here', 'there'), (also_here, 'here', 'there'),
                                   (elsewhere, 'there', 'here')):
        assert buffer.lookup_transform('map', mine, LATEST, timeout=WAIT)
        assert not buffer.can_transform('map', not_mine, LATEST)
    listener.unregister()
    other.try_shutdown()
    StaticTransformBroadcaster(ros.node).sendTransform(stamped(child='later'))
    assert also_here.lookup_transform('map', 'later', LATEST, timeout=WAIT)
    assert not here.can_transform('map', 'later', LATEST)
    listener_elsewhere.unregister()
    also.unregister()
    also.unregister()


def test_nothing_is_inserted_after_the_end(ros, start_publisher, listen):
    """Neither the thread nor a lookup inserts a message, even if another buffer is set then."""
    buffer, listener = listen()
    start_publisher('map robot')
    buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)
    listener.unregister()
    eventually(lambda: not [
        thread for thread in threading.enumerate() if thread.name == 'tf of test'])
    last = buffer.get_latest_common_time('map', 'robot')
    listener.buffer = other = Buffer(node=ros.node)
    eventually(lambda: not ros.node.get_subscriptions_info_by_topic('/tf'))
    later_buffer, _ = listen()
    later_buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)
    eventually(lambda: later_buffer.get_latest_common_time('map', 'robot') > last)
    assert buffer.get_latest_common_time('map', 'robot') == last
    assert not other.can_transform('map', 'robot', LATEST)


@pytest.mark.parametrize('end', ['unregister', 'destroy_node'])
def test_all_that_had_arrived_is_there_after_the_end(ros, listen, end):
    """Messages that are still in the queue are inserted at the end."""
    node = Node('ending', context=ros.context)
    buffer, listener = listen(node=node)
    also, _ = listen()
    publish = flood(ros, listener)
    publish(2000 * 10**9)
    last = Time(nanoseconds=2000 * 10**9 + 19)
    eventually(lambda: also.can_transform('map', 'robot', last))  # DDS sends to this one last
    if end == 'unregister':
        listener.unregister()
    node.destroy_node()
    assert buffer.get_latest_common_time('map', 'robot') == last


def test_messages_are_inserted_without_lookups(ros):
    """The thread pauses at this rate, but inserts messages while they keep arriving."""
    class Watched(Buffer):
        """A buffer that counts the updates with new data; only the thread makes them here."""

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


def test_a_refusal_is_logged_without_further_messages(ros, listen, log_lines):
    """The refusal is logged although the thread pauses and nobody looks up."""
    _, listener = listen()
    publish = flood(ros, listener)
    publish(2000 * 10**9, 60)
    publisher = ros.node.create_publisher(TFMessage, '/tf', 100)
    ros.until(lambda: publisher.get_subscription_count() > 0)
    publish(3000 * 10**9, 60)
    publisher.publish(TFMessage(transforms=[stamped(child='map')]))
    eventually(lambda: any('TF_SELF_TRANSFORM' in text for _, text in log_lines))


def test_a_shutdown_without_callbacks_ends_the_spin(domain_id):
    """Ctrl-C shuts down this way, which does not always wake an executor that is spinning."""
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
    context.handle.shutdown()  # this calls no shutdown callbacks
    thread.join(TIMEOUT)
    assert ended
    assert ended[0] < begin + 2.0
    listener.unregister()
    executor.shutdown()
    node.destroy_node()


def test_the_node_name_is_free_at_once_after_destroy_node(start):
    """No subscription outlives its node, so the next node of this name is the only one."""
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


def test_a_listener_that_nobody_holds_goes_on(ros, start_publisher):
    """As with tf2_ros, a listener receives messages although the user keeps no reference to it."""
    buffer = Buffer(node=ros.node)
    TransformListener(buffer, ros.node)
    start_publisher('map robot')
    assert buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)


def flood(ros, listener):
    """Return a function that publishes transforms at a rate at which the thread pauses."""
    publisher = ros.node.create_publisher(TFMessage, '/tf', 100)
    ros.until(lambda: publisher.get_subscription_count() > 0)

    def publish(stamp_ns, number=20):
        for i in range(number):
            publisher.publish(TFMessage(transforms=[stamped(stamp_ns + i)]))
            time.sleep(0.002)

    publish(1000 * 10**9, 50)
    assert listener.buffer.can_transform('map', 'robot', LATEST)
    return publish


def test_messages_from_before_a_clear_are_not_inserted_after_it(ros, listen):
    """After a jump back in time, such a message would be newer than all that follow."""
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
    """No message is lost while the thread waits for the lock of the previous buffer."""
    first, listener = listen()
    flood(ros, listener)
    second = Buffer(node=ros.node)
    also, _ = listen()
    with first.fetched():
        TransformBroadcaster(ros.node).sendTransform(stamped(2000 * 10**9))
        eventually(lambda: also.can_transform('map', 'robot', Time(seconds=2000)))
        listener.buffer = second
        StaticTransformBroadcaster(ros.node).sendTransform(stamped(child='static'))
        eventually(lambda: also.can_transform('map', 'static', LATEST))
    assert second.lookup_transform('map', 'static', LATEST, timeout=WAIT)
    assert not first.can_transform('map', 'static', LATEST)


def test_a_signal_handler_may_look_up(start):
    """Each pose keeps its stamp, wherever the handler interrupts a lookup."""
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


def test_what_a_done_callback_does_leaves_the_thread_alive(ros, listen, log_lines):
    """A done callback runs in this thread; it may wait for transforms, and raise SystemExit."""
    buffer, listener = listen()
    found = []

    def wait(_):
        found.append(buffer.can_transform('map', 'moving', LATEST, timeout=WAIT))
        found.append(buffer.can_transform('map', 'static', LATEST, timeout=WAIT))
        raise SystemExit('of the user')

    buffer.wait_for_transform_async('map', 'robot', LATEST).add_done_callback(wait)
    publish_and_wait(ros, listener)
    broadcaster = TransformBroadcaster(ros.node)
    ros.until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)
    broadcaster.sendTransform(stamped(1))
    also, _ = listen()
    broadcaster.sendTransform(stamped(1, child='also'))
    eventually(lambda: also.can_transform('map', 'also', LATEST))
    assert not found
    broadcaster.sendTransform(stamped(1, child='moving'))
    StaticTransformBroadcaster(ros.node).sendTransform(stamped(child='static'))
    eventually(lambda: [line for _, line in log_lines if 'SystemExit: of the user' in line])
    assert found == [True, True]
    publish_and_wait(ros, listener)


@pytest.mark.parametrize('own_callback', [False, True])
@pytest.mark.parametrize('method', ['unregister', 'destroy_node'])
def test_an_end_within_a_block_of_the_buffer(ros, method, own_callback):
    """While messages arrive, the call returns at once, and the thread ends after the block."""
    class Own(TransformListener):
        def callback(self, data):
            super().callback(data)

    for _ in range(5):
        node = Node('test', context=ros.context, namespace='/own')
        buffer = Buffer(node=node)
        listener = (Own if own_callback else TransformListener)(buffer, node)
        broadcaster = TransformBroadcaster(ros.node)
        ros.until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)  # noqa: B023

        end_of = {'unregister': listener.unregister, 'destroy_node': node.destroy_node}

        def end():
            with buffer.fetched():  # noqa: B023
                broadcaster.sendTransform(stamped(1))  # noqa: B023
                end_of[method]()  # noqa: B023
            return True

        assert run_in_thread(end)
        eventually(lambda: not threads_of_listeners())
        broadcaster.pub_tf.destroy()
        node.destroy_node()


def test_an_end_while_another_thread_is_in_a_block(ros):
    """`destroy_node` does not wait for the lock, which the listener's thread needs to end."""
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
    """Return the threads of the listeners of nodes with the name `test`."""
    return [thread for thread in threading.enumerate() if thread.name == 'tf of test']


def wait_for_latched(node):
    """Wait as long as a listener's thread needs to call the callbacks, if it runs already."""
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node)
    buffer.lookup_transform('map', 'latched', LATEST, timeout=WAIT)
    listener.unregister()


class Filter(TransformListener):
    """A listener whose callback needs an attribute that its constructor sets last."""

    def __init__(self, *args, **kwargs):
        """Start the listener, and set the attribute late."""
        super().__init__(*args, **kwargs)
        wait_for_latched(self.node)
        self.received = []

    def static_callback(self, data):
        """Record the frames, and insert the transforms."""
        self.received += [transform.child_frame_id for transform in data.transforms]
        super().static_callback(data)


class AbstractFilter(Filter, ABC):
    """A filter with another metaclass."""

    @abstractmethod
    def name(self):
        """Return a name."""


class NamedFilter(AbstractFilter):
    """A filter that inherits the constructor of an abstract class."""

    def name(self):
        """Return a name."""
        return 'filter'


class Mixin:
    """A class whose constructor calls that of the listener."""

    node: Node

    def __init__(self, *args, **kwargs):
        """Start the listener, and set the attribute late."""
        super().__init__(*args, **kwargs)
        wait_for_latched(self.node)
        self.names = []


class MixedFilter(Mixin, TransformListener):
    """A filter whose attribute is set by the constructor of another class."""

    def static_callback(self, data):
        """Record the frame, and insert the transform."""
        self.names.append(data.transforms[0].child_frame_id)
        super().static_callback(data)


class PlainFilter(TransformListener):
    """A filter without a constructor, which is the first of two bases."""

    def static_callback(self, data):
        """Insert the transforms."""
        super().static_callback(data)


class BothFilters(PlainFilter, Filter):
    """A filter that inherits the constructor of its second base."""


@pytest.mark.parametrize('another_waits', [False, True])
@pytest.mark.parametrize('kind', [Filter, NamedFilter, MixedFilter, BothFilters])
def test_callbacks_of_a_subclass_are_called_after_its_constructor(
        ros, log_lines, kind, another_waits):
    """A latched message is not lost: it is taken later, even if another thread waits for it."""
    static = StaticTransformBroadcaster(ros.node)
    static.sendTransform(stamped(child='latched'))
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
    assert 'latched' in (listener.names if kind is MixedFilter else listener.received)
    assert not log_lines
    listener.unregister()


@pytest.mark.parametrize('method', ['timeout', 'future', 'poll'])
def test_a_subclass_may_wait_for_a_transform_in_its_constructor(ros, method):
    """The constructor may wait with a timeout, with a future, or by repeated lookups."""
    StaticTransformBroadcaster(ros.node).sendTransform(stamped(child='latched'))

    class Waiting(TransformListener):
        def __init__(self, buffer, node):
            self.received = []
            super().__init__(buffer, node)
            arguments = 'map', 'latched', LATEST
            if method == 'timeout':
                self.found = buffer.lookup_transform(*arguments, timeout=WAIT)
            elif method == 'future':
                future = buffer.wait_for_transform_async(*arguments)
                eventually(future.done)
                self.found = future.result()
            else:
                eventually(lambda: buffer.can_transform(*arguments))
                self.found = buffer.lookup_transform(*arguments)

        def static_callback(self, data):
            self.received += data.transforms
            super().static_callback(data)

    listener = run_in_thread(lambda: Waiting(Buffer(node=ros.node), ros.node))
    assert listener.found.child_frame_id == 'latched'
    assert listener.received
    listener.unregister()


def test_a_subclass_may_end_in_its_constructor(ros):
    """If the constructor calls `unregister`, no thread and no subscription are left."""
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
    """The callbacks, which may need attributes that were not set, are never called."""
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
    """If the handler runs during the replacement, the new buffer keeps no source."""
    class Interrupted(Buffer):
        """A buffer that ends the listener when its source is added, as a signal handler may."""

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

    assert run_in_thread(switch)
    assert not other.sources
    eventually(lambda: not threads_of_listeners())


def test_a_listener_that_gets_its_own_buffer_again_goes_on(ros):
    """The listener does not remove its source, since that would end a blocked lookup."""
    class Watched(Buffer):
        """A buffer that counts the sources that were removed."""

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


def wait_for_retries(buffer):
    """Wait until a blocked lookup has tried twice more, which it does every 0.2 s."""
    with pytest.raises(LookupException):
        buffer.lookup_transform('map', 'nobody', LATEST, timeout=Duration(seconds=0.45))


class Ignoring(TransformListener):
    """A listener that inserts nothing."""

    def callback(self, data):
        """Insert nothing."""


@pytest.mark.parametrize('kind', [TransformListener, Ignoring])
@pytest.mark.parametrize('end', ['unregister', 'destroy_node', 'other buffer'])
def test_a_blocked_lookup_ends_when_the_last_listener_ends(ros, end, kind):
    """The lookup raises its last error then, and not when the first of two listeners ends."""
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
    wait_for_retries(buffer)
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


def test_a_lookup_that_began_before_any_listener_waits_on(ros, start_publisher):
    """The lookup outlasts the end of a listener that started later, and uses the next one."""
    buffer = Buffer(node=ros.node)
    found = []
    thread = threading.Thread(target=lambda: found.append(
        buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)))
    thread.start()
    eventually(lambda: buffer.has_waiters)
    TransformListener(buffer, ros.node).unregister()
    wait_for_retries(buffer)
    assert thread.is_alive()
    listener = TransformListener(buffer, ros.node)
    start_publisher('map robot')
    thread.join(TIMEOUT)
    assert found
    listener.unregister()


@pytest.mark.parametrize('ending', [KeyboardInterrupt, SystemExit])
def test_ctrl_c_while_a_listener_is_ended_is_not_swallowed(ros, ending):
    """A done callback that runs in the thread which ends the listener raises there."""
    class Late(Buffer):
        """A buffer that reports no new data to the listener's thread."""

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
    broadcaster.sendTransform(stamped(1))
    eventually(lambda: buffer.can_transform('map', 'robot', LATEST))  # this completes no future
    with pytest.raises(ending):
        listener.unregister()
    assert not buffer.is_held()
    eventually(lambda: not threads_of_listeners())


#: The number of repetitions: a few, or more than a hundred.
often = pytest.mark.parametrize('count', [3, pytest.param(101, marks=pytest.mark.soak)])


def check_endings(start, count, kind, *ways):
    """Run `endings.py` in each of the ways at the same time; check that all succeed."""
    script = str(Path(__file__).parent / 'endings.py')
    processes = [start(script, str(count), kind, way, str(100 * i)) for i, way in enumerate(ways)]
    for process in processes:
        assert process.exit_code(300) == 0
        assert without_library_lines(process.output) == 'all ended\n'


@often
def test_every_order_of_ending_in_a_thread(start, count):
    """Three calls end a listener in any order, in the executor's thread and in its own."""
    check_endings(start, count, 'in', 'executor', 'thread')


@often
def test_every_order_of_ending_in_the_main_thread(start, count):
    """The calls unregister, destroy_node and shutdown end a listener in any order."""
    check_endings(start, count, 'in', 'main')


@often
def test_every_end_of_a_program(start, count):
    """A program with a listener ends cleanly by its last line, or by sys.exit() in a callback."""
    check_endings(start, count, 'by', 'end', 'exit')


@often
def test_every_end_by_ctrl_c(start, count):
    """Ctrl-C ends a program with a listener while it spins and while it waits for a transform."""
    check_endings(start, count, 'by', 'spin', 'lookup')
