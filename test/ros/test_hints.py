"""The hints of a program with a Buffer and a TransformListener, from its clock and ROS graph."""

import gc
from inspect import iscoroutine
import re
import threading
from time import monotonic_ns
import weakref

from processes import ARM, reserved_domain
import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.time import Time
from ros_node import stamped
from rosgraph_msgs.msg import Clock as ClockMessage

from puretf import (
    Buffer,
    ExtrapolationException,
    TFMessage,
    TransformBroadcaster,
    TransformException,
    TransformListener,
)
from puretf.publisher_listener import PublisherListener

S = 10**9
FUTURE = 'More: tf_doctor --explain future'


def error_of(buffer, time=0, source='base'):
    """Return the error that a lookup raises."""
    with pytest.raises(TransformException) as raised:
        buffer.lookup_transform('map', source, Time(nanoseconds=time))
    return raised.value


def now_of(ros):
    """Return the time of the node (ns)."""
    return ros.node.get_clock().now().nanoseconds


def send(ros, node, buffer, *stamps, frame='base'):
    """Send a frame in map at some times, until they have arrived; return the publisher."""
    publisher = TransformBroadcaster(node).pub_tf
    message = TFMessage(transforms=[stamped('map', frame, stamp) for stamp in stamps])

    def has_arrived():
        publisher.publish(message)
        return buffer.can_transform('map', frame, Time(nanoseconds=stamps[-1]))

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


def test_nothing_at_all(ros, listening, start, monkeypatch):
    """The domain, and the other domains in which processes run."""
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.0)
    monkeypatch.setattr('puretf._causes.domains.comma_list', ', '.join)  # other tests run, too
    for domain in reserved_domain():
        process = start(*ARM, environment={'ROS_DOMAIN_ID': str(domain)})
        process.line_with('t = 0')
        ros.until(lambda: (
            'No transform has been received yet. 0 publishers on /tf and /tf_static were found in '
            f'ROS domain {ros.domain}.') in str(error_of(listening)))
        text = str(error_of(listening))
        assert re.search(rf'programs run in other ROS domains: .*{domain} \(PID {process.pid}: ',
                         text)
        assert 'ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST hides other machines.' in text


class Waving:
    """A node that broadcasts a frame by a timer, and listens to it."""

    def __init__(self, ros, executor):
        self.node = Node('waving', context=ros.context)
        self.buffer = Buffer(node=self.node)
        self.listener = TransformListener(self.buffer, self.node)
        self._broadcaster = TransformBroadcaster(self.node)
        self.node.create_timer(0.05, self._send)
        self.executor = executor
        if executor:
            executor.add_node(self.node)

    def _send(self):
        self._broadcaster.sendTransform(stamped('map', 'base', now_of(self)))

    def look_up(self, child='base'):
        """Wait for the present transform; return the error, or ''."""
        try:
            self.buffer.lookup_transform('map', child, Time(nanoseconds=now_of(self)),
                                         Duration(seconds=0.2))
        except TransformException as error:
            return str(error)
        return ''

    async def look_up_async(self):
        """Do the same by the remedy."""
        await self.buffer.lookup_transform_async(
            'map', 'base', Time(nanoseconds=now_of(self)), Duration(seconds=60))
        return ''

    def result_in_a_callback(self, look_up, is_own_group=True):
        """Call a lookup in a callback, after the first transform; return what it returns."""
        done: list[str] = []

        async def callback():
            if not self.buffer.can_transform('map', 'base', Time()):
                return
            timer.cancel()
            result = look_up()
            done.append(await result if iscoroutine(result) else result)

        group = MutuallyExclusiveCallbackGroup() if is_own_group else None
        timer = self.node.create_timer(0.1, callback, callback_group=group)
        while not done:
            self.executor.spin_once(0.05)
        return done[0]


@pytest.fixture
def waving(ros):
    """Create such nodes."""
    nodes = []

    def create(executor):
        nodes.append(Waving(ros, executor))
        return nodes[-1]

    yield create
    for each in nodes:
        each.listener.unregister()
        if each.executor:
            each.executor.shutdown()
        each.node.destroy_node()


OWN = ' More: tf_doctor --explain own_node'
BLOCKED = ('It is published by this node, which cannot while this lookup blocks its executor. '
           f'Await lookup_transform_async instead, in a callback group of its own.{OWN}')


def test_a_lookup_that_blocks_the_broadcaster_of_its_node(ros, waving):
    """The remedy works."""
    node = waving(SingleThreadedExecutor(context=ros.context))
    assert node.result_in_a_callback(node.look_up).endswith(f'that time. {BLOCKED}')
    assert node.result_in_a_callback(node.look_up_async) == ''


def test_a_lookup_that_blocks_a_node_in_the_same_executor(ros, make_node, waving):
    """It is named."""
    broadcasting = waving(SingleThreadedExecutor(context=ros.context))
    looking = make_node('looking')
    buffer = Buffer(node=looking)
    listener = TransformListener(buffer, looking)
    broadcasting.executor.add_node(looking)
    broadcasting.buffer = buffer
    assert 'published by /waving, which cannot while this lookup blocks its executor. ' in (
        broadcasting.result_in_a_callback(broadcasting.look_up))
    listener.unregister()
    broadcasting.executor.remove_node(looking)


@pytest.mark.parametrize('child', ['other', 'nobody'])
def test_a_frame_of_another_node_is_not_that_of_the_blocked_one(ros, stranger, waving, child):
    """It has ended, or never was there."""
    node = waving(SingleThreadedExecutor(context=ros.context))
    if child == 'other':
        stranger.node.destroy_publisher(
            send(ros, stranger.node, node.buffer, now_of(ros), frame='other'))
    text = node.result_in_a_callback(lambda: node.look_up(child))
    assert 'published by this node' not in text
    assert ('Nobody publishes on /tf but this node, which cannot while' in text
            ) == (child == 'nobody')


@pytest.mark.parametrize(('is_own_group', 'is_blocked'), [(False, True), (True, False)])
def test_a_lookup_in_one_of_several_threads(ros, waving, is_own_group, is_blocked):
    """It blocks the callbacks of its group; the remedy works."""
    executor = MultiThreadedExecutor(3, context=ros.context)
    node = waving(executor)
    text = node.result_in_a_callback(node.look_up, is_own_group)
    assert ('by this node, which cannot while this lookup keeps its callback group busy. '
            'Put the callback that looks up into a group of its own.' in text) == is_blocked
    assert bool(text) == is_blocked


def test_a_node_that_nobody_spins(ros, waving):
    """It cannot call its timer; the remedy works."""
    node = waving(None)
    nobody = ('Nobody publishes on /tf but this node, which cannot while nothing spins it. '
              f'Spin it in a thread.{OWN}')
    assert node.look_up().endswith(nobody)
    node.executor = SingleThreadedExecutor(context=ros.context)
    node.executor.add_node(node.node)
    ros.until(lambda: node.executor.spin_once(0.05) or node.buffer.can_transform(
        'map', 'base', Time()))
    node.executor.remove_node(node.node)
    assert node.look_up().endswith(
        f'published by this node, which cannot while nothing spins it. Spin it in a thread.{OWN}')
    node.executor.add_node(node.node)
    thread = threading.Thread(target=node.executor.spin, daemon=True)
    thread.start()
    assert node.buffer.lookup_transform(
        'map', 'base', Time(nanoseconds=now_of(node)), Duration(seconds=60))
    node.executor.shutdown()
    thread.join()


def test_two_publishers_of_clock(ros, make_node, capfd):
    """The warning, once a second, and the error of the cleared buffer name both."""
    node = make_node('costmap', is_spun=True,
                     parameter_overrides=[Parameter('use_sim_time', value=True)])
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node)
    text = ('2 nodes publish /clock, and the time jumps: /bridge_1, /bridge_2. '
            'Stop all but one.')
    clocks = [make_node(f'bridge_{i}').create_publisher(ClockMessage, '/clock', 10)
              for i in (1, 2)]

    def is_told():
        for seconds, publisher in zip((160, 20), clocks):
            publisher.publish(ClockMessage(clock=Time(seconds=seconds).to_msg()))
            ros.executor.spin_once(0.05)
        buffer.set_transform(stamped('map', 'base', S), 'test')
        buffer.clear()
        return text in str(error_of(buffer))

    ros.until(is_told)
    ros.until(logged(capfd, 'Detected jump back in time. Clearing tf buffer. Publishers of '
                     '/clock: /bridge_1, /bridge_2.'))
    listener.unregister()


def test_a_listener_that_is_not_latched(ros):
    """It misses what was sent before its start."""
    buffer = Buffer()
    listener = TransformListener(buffer, ros.node, static_qos=QoSProfile(depth=10))
    assert str(error_of(buffer)).endswith(
        'This listener of /tf_static is not transient local, so it misses what was sent before '
        'its start. Omit static_qos, or make it transient local. More: tf_doctor '
        '--explain tf_static')
    listener.unregister()


def test_a_node_that_has_ended(ros, stranger, monkeypatch):
    """The PublisherListener knows which publisher has sent the newest transform."""
    buffer = Buffer(node=ros.node)
    listener = PublisherListener(buffer, ros.node)
    latest = now_of(ros) - 5 * S
    publisher = send(ros, stranger.node, buffer, latest - S, latest)
    monkeypatch.setattr('puretf._core.failures.monotonic_ns', lambda: monotonic_ns() + 4 * S)
    ros.until(lambda: ' s ago. Publisher: /test.' in str(error_of(buffer, latest + S)))
    ros.until(listener.publishers)
    stranger.node.destroy_publisher(publisher)
    ros.until(lambda: '/test, which has published it, has ended. Start /test again.'
              in str(error_of(buffer, latest + S)))
    listener.unregister()


def test_an_old_transform_is_logged_with_its_node(ros, stranger, capfd):
    """The authority of a PublisherListener is a gid; the node follows."""
    buffer = Buffer(node=ros.node)
    listener = PublisherListener(buffer, ros.node)
    publisher = send(ros, stranger.node, buffer, 100 * S)
    ros.until(lambda: ('/test', '/tf') in listener.publishers().values())
    publisher.publish(TFMessage(transforms=[stamped('map', 'base', 50 * S)]))
    ros.until(logged(capfd, 'Publisher: /test. More: tf_doctor --explain old_data'))
    listener.unregister()


@pytest.mark.parametrize('is_shut_down', [False, True])
def test_an_error_is_read_after_the_end_of_the_node(stranger, is_shut_down):
    """Then nothing is known of the graph; the text is complete all the same."""
    buffer = Buffer(node=stranger.node)
    listener = TransformListener(buffer, stranger.node)
    for stamp in S, 2 * S:
        buffer.set_transform(stamped('map', 'base', stamp), 'test')
    error = error_of(buffer, 3 * S)
    if is_shut_down:
        stranger.context.shutdown()
    else:
        stranger.node.destroy_node()
    assert isinstance(error, ExtrapolationException)
    assert str(error).endswith(FUTURE)
    listener.unregister()


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
    assert str(error).endswith(FUTURE)
