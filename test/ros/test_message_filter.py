"""The MessageFilter: inputs, callbacks, timeouts and logs; test_filter_queue.py has the queue."""

import gc
import re
import threading
import time
from typing import Any

from geometry_msgs.msg import PointStamped
import pytest
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.time import Time
import ros_node
from ros_node import run_in_thread, stamped
from std_msgs.msg import Empty

from puretf import Buffer, FilterFailureReason, MessageFilter, TransformBroadcaster
from puretf._core.engine import engine_of
from puretf._ros.rclpy_private import guard_condition

S = 10**9
MS = 10**6


def point(stamp, frame='laser'):
    """Return a message with a header; the stamp is in ns."""
    return ros_node.point(frame, stamp)


def stamp_of(message):
    """Return the stamp of a message (ns)."""
    return Time.from_msg(message.header.stamp).nanoseconds


class Setup:
    """A filter without a listener, and what has come out of it."""

    def __init__(self, ros, targets='map', queue_size=10, source=None, node=None, buffer=None,
                 **kwargs):
        """Create the filter; by default, messages are added by hand."""
        self.ros, self.node = ros, node or ros.node
        self.buffer = buffer or Buffer(node=self.node)
        self.filter = MessageFilter(
            source, self.buffer, targets, queue_size, self.node, **kwargs)
        self.passed: list[Any] = []
        self.failed: list[tuple[Any, FilterFailureReason]] = []
        self.filter.registerCallback(self.passed.append)
        self.filter.registerFailureCallback(
            lambda message, reason: self.failed.append((message, reason)))

    def add(self, *messages):
        """Add messages."""
        for message in messages:
            self.filter.add(message)

    def insert(self, *stamps, child='laser', parent='map'):
        """Insert transforms at several stamps (ns)."""
        for stamp in stamps:
            self.buffer.set_transform(stamped(parent, child, stamp), 'test')

    def spin(self):
        """Let the executor call what is due now."""
        for _ in range(5):
            self.ros.executor.spin_once(timeout_sec=0.0)

    def stamps(self):
        """Return the stamps of the messages that have been passed on (ns)."""
        self.spin()
        return [stamp_of(message) for message in self.passed]

    def failures(self):
        """Return the stamps (ns) and the reasons of the messages that have been dropped."""
        self.spin()
        return [(stamp_of(message), reason) for message, reason in self.failed]


def test_a_message_is_passed_on_when_its_transform_is_available(ros):
    """It is passed on once, as it was, and by the executor only."""
    setup = Setup(ros)
    message = point(5 * S)
    setup.add(message)
    setup.insert(4 * S)
    assert setup.stamps() == []
    setup.insert(6 * S)
    assert setup.passed == []  # the executor has not been spun
    assert setup.stamps() == [5 * S]
    assert setup.passed[0] is message
    setup.insert(7 * S)
    assert setup.stamps() == [5 * S]


def test_the_settings_can_be_changed(ros):
    """They hold for the messages that wait, and for those that are due."""
    setup = Setup(ros, queue_size=2)
    setup.insert(2 * S, 4 * S)
    setup.add(point(2 * S), point(3 * S))  # both are due
    setup.filter.setTargetFrames(['map', '/odom'])
    setup.filter.setQueueSize(1)
    assert setup.filter.getQueueSize() == 1
    assert setup.failures() == [(2 * S, FilterFailureReason.QueueFull)]
    assert setup.filter.dropped[FilterFailureReason.QueueFull] == 1
    setup.filter.setTolerance(Duration(seconds=0.5))
    setup.filter.setTargetFrame('map')
    setup.filter.setTolerance(2 * S)
    assert setup.stamps() == []
    setup.filter.setTolerance(0)
    assert setup.stamps() == [3 * S]


def test_without_target_frames(ros):
    """As in tf2, new messages are ignored."""
    setup = Setup(ros, targets=[])
    setup.add(point(1 * S))
    setup.filter.setTargetFrame('map')
    setup.insert(1 * S)
    assert setup.stamps() == []


def test_a_timeout(ros):
    """A message is dropped when its timeout is over, though nothing else happens."""
    setup = Setup(ros, buffer_timeout=Duration(seconds=0.1))
    begin = time.monotonic()
    setup.add(point(1 * S))
    ros.until(lambda: setup.failed)
    assert time.monotonic() - begin >= 0.1
    setup.add(point(2 * S))  # the timer starts again
    ros.until(lambda: len(setup.failed) == 2)
    assert setup.failures() == [
        (stamp * S, FilterFailureReason.NoTransformFound) for stamp in (1, 2)]


@pytest.mark.parametrize('timeout', [0, Duration(nanoseconds=2**63 - 1)])
def test_the_shortest_and_the_longest_timeout(ros, timeout):
    """With 0, a message is dropped at once; the other one is as long as a Duration can be."""
    setup = Setup(ros, buffer_timeout=timeout)
    setup.insert(1 * S)
    setup.add(point(1 * S), point(2 * S))
    assert setup.failures() == [(2 * S, FilterFailureReason.NoTransformFound)][:timeout == 0]
    assert setup.stamps() == [1 * S]


def test_a_message_that_waits_for_long_is_logged(ros, capfd):
    """If nothing is dropped, it is logged once why the oldest message still waits."""
    message_filter = MessageFilter(None, Buffer(), 'map', 0, ros.node)
    message_filter.add(point(1 * S))
    time.sleep(2.0)
    for _ in range(2):
        message_filter.add(point(1 * S))
    (line,) = re.findall('Messages wait.*', capfd.readouterr().err)
    assert re.match(
        r"Messages wait for their transforms. The oldest, of frame 'laser' at time 1.000000, has "
        r'waited for \d+\.\d s. Invalid frame ID "map" passed to canTransform argument ', line)


@pytest.mark.parametrize('method', ['clear', 'unregister'])
def test_clear_in_a_callback(ros, method):
    """The messages that became ready together with this one are not delivered."""
    setup = Setup(ros)
    setup.filter.registerCallback(lambda _: getattr(setup.filter, method)())
    setup.add(point(1 * S), point(2 * S))
    setup.insert(1 * S, 2 * S)
    assert setup.stamps() == [1 * S]


def test_an_error_of_a_callback(ros):
    """It reaches the spinning program, as that of a subscription; other messages are not lost."""
    setup = Setup(ros)
    setup.add(point(1 * S), point(2 * S), point(3 * S))

    def fail(message):
        if stamp_of(message) == 1 * S:
            raise RuntimeError('mine')

    setup.filter.registerCallback(fail)
    setup.insert(1 * S, 3 * S)
    with pytest.raises(RuntimeError, match='mine'):
        setup.stamps()
    assert setup.stamps() == [1 * S, 2 * S, 3 * S]


def test_coroutine_functions(ros):
    """Those of messages start in the order of stamps; none waits for the end of another."""
    setup = Setup(ros)
    started, ended, reasons = [], [], []

    async def look_up(message, offset):
        started.append(stamp_of(message) // S)
        later = Time(nanoseconds=stamp_of(message) + offset)
        ended.append(await setup.buffer.lookup_transform_async('map', 'laser', later))

    async def fail(message, reason):
        reasons.append(reason)

    setup.filter.registerCallback(look_up, 10 * S)
    setup.filter.registerFailureCallback(fail)
    setup.add(*(point(stamp * S) for stamp in (3, 1, 4, 2, 5)), point(1 * S, ''))
    setup.insert(1 * S, 5 * S)
    ros.until(lambda: len(started) == 5 and reasons)
    assert started == [1, 2, 3, 4, 5]
    assert not ended
    setup.insert(15 * S)
    ros.until(lambda: len(ended) == 5)
    assert reasons == [FilterFailureReason.EmptyFrameID]


def test_the_input_can_be_replaced(ros):
    """Messages of the previous input are ignored, also if it cannot forget its callbacks."""
    first, second = (Setup(ros, targets='laser').filter for _ in range(2))  # pass all messages on
    setup = Setup(ros, source=first)
    setup.insert(1 * S, 9 * S)
    first.add(point(1 * S))
    assert setup.stamps() == [1 * S]
    setup.filter.connectInput(second)
    first.add(point(2 * S))
    second.add(point(3 * S))
    assert setup.stamps() == [1 * S, 3 * S]
    setup.filter.connectInput((PointStamped, 'points', 10))
    second.add(point(4 * S))
    publisher = ros.node.create_publisher(PointStamped, 'points', 10)
    ros.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(point(5 * S))
    ros.until(lambda: len(setup.passed) == 3)
    assert setup.stamps() == [1 * S, 3 * S, 5 * S]
    with pytest.raises(TypeError, match='input must be a tuple'):
        setup.filter.connectInput('points')
    publisher.publish(point(5 * S + 1))  # the refused input has changed nothing
    ros.until(lambda: len(setup.passed) == 4)
    setup.filter.connectInput(first)
    ros.until(lambda: not publisher.get_subscription_count())
    first.add(point(6 * S))
    assert setup.stamps() == [1 * S, 3 * S, 5 * S, 5 * S + 1, 6 * S]


@pytest.mark.parametrize('by_node', [False, True])
def test_it_ends(ros, make_node, by_node):
    """It ends with its node, or by unregister; no callback is called any more."""
    node = make_node('other', is_spun=True)
    setup = Setup(ros, node=node, buffer=Buffer(), source=(PointStamped, 'points', 10),
                  buffer_timeout=Duration(seconds=100))
    setup.add(point(1 * S), point(2 * S, ''))
    if by_node:
        node.destroy_node()
    else:
        setup.filter.unregister()
        assert not [*node.subscriptions, *node.timers]
        setup.filter.unregister()
    assert not engine_of(setup.buffer).is_awaited
    setup.insert(1 * S)
    setup.add(point(1 * S))
    assert setup.stamps() == []
    assert setup.failures() == []
    with pytest.raises(RuntimeError, match='the filter has ended'):
        setup.filter.connectInput(setup.filter)


def test_messages_of_a_node_that_ends(ros, other):
    """A message may be added while the node is being destroyed."""
    added: list[bool] = []

    def add():
        setup.add(point(1 * S))
        added.append(True)

    guard_condition(other, other.default_callback_group, add)  # it is destroyed first
    setup = Setup(ros, node=other, buffer=Buffer(), buffer_timeout=Duration(seconds=100))
    other.destroy_node()
    assert added
    assert not engine_of(setup.buffer).is_awaited


def test_time_that_jumps_back(ros, make_node):
    """The messages that wait, and those that are due, are dropped without a failure."""
    node = make_node('simulated', is_spun=True, parameter_overrides=[
        Parameter('use_sim_time', value=True)])
    setup = Setup(ros, node=node)
    clock: Any = node.get_clock()

    def set_time(stamp):
        clock.set_ros_time_override(Time(nanoseconds=stamp, clock_type=ClockType.ROS_TIME))

    set_time(100 * S)
    setup.insert(100 * S)
    setup.add(point(101 * S))  # waits
    set_time(100 * S - 500 * MS)  # less than a second back
    setup.insert(101 * S)  # now the message is due
    assert setup.stamps() == [101 * S]
    setup.add(point(102 * S))
    set_time(50 * S)
    setup.insert(102 * S)
    assert setup.stamps() == [101 * S]
    assert setup.failures() == []
    setup.add(point(102 * S))
    assert setup.stamps() == [101 * S, 102 * S]


def test_dropped_messages_are_logged(ros, capfd):
    """tf2's text and why, once a second for each reason, unless there is a failure callback."""
    buffer = Buffer(node=ros.node)
    for stamp in 1, 2:
        buffer.set_transform(stamped('map', 'laser', stamp * S), 'test')
    message_filter = MessageFilter(None, buffer, 'map', 1, ros.node)
    for stamp in range(5, 8):
        message_filter.add(point(stamp * S))
        message_filter.add(point(stamp * S, 'a\nb'))
    before_1970 = point(0, '')
    before_1970.header.stamp.sec = -1
    message_filter.add(before_1970)
    for _ in range(5):
        ros.executor.spin_once(timeout_sec=0.0)
    error = capfd.readouterr().err
    assert error.count('Message Filter dropping message: ') == 2
    assert ("Message Filter dropping message: frame 'laser' at time 5.000000 for reason "
            "'discarding message because the queue is full'. Messages dropped for this reason: 5. "
            'Lookup would require extrapolation into the future.') in error
    assert ("Message Filter dropping message: frame '' at time -1.000000 for reason 'the frame id "
            "of the message is empty'. Messages dropped for this reason: 1.\n") in error


def test_wrong_arguments(ros):
    """The error names the argument; nothing is left in the node or the buffer."""
    def entities():
        return [*ros.node.guards], [*ros.node.subscriptions], [*ros.node.timers]

    arguments = {'input': None, 'buffer': Buffer(), 'target_frames': 'map', 'queue_size': 1,
                 'node': ros.node}
    before = entities()
    for name, value, error, text in (
            ('target_frames', ['map', ''], ValueError, 'a target frame must have a name'),
            ('target_frames', '/', ValueError, 'a target frame must have a name'),
            ('target_frames', [3], TypeError, 'a target frame must be a str, got 3'),
            ('target_frames', None, TypeError, 'target_frames must be a name or several names'),
            ('queue_size', -1, ValueError, 'queue_size must be 0 .* or more, got -1'),
            ('queue_size', 1.5, TypeError, 'queue_size must be an integer, got 1.5'),
            ('tolerance', 0.1, TypeError, 'tolerance must be an integer'),
            ('buffer_timeout', -1, ValueError, 'buffer_timeout must not be negative, got -1 ns'),
            ('buffer_timeout', 0.1, TypeError, 'buffer_timeout must be an integer'),
            ('buffer', 'map', TypeError, 'buffer'),
            ('input', 'points', TypeError, 'input must be a tuple'),
            ('input', (PointStamped, 'points'), TypeError, 'input must be a tuple'),
            ('input', (Empty, 'points', 10), TypeError, 'have a header, but Empty has none')):
        with pytest.raises(error, match=text):
            MessageFilter(**{**arguments, name: value})
        assert entities() == before
    message_filter = MessageFilter(**arguments)
    with pytest.raises(TypeError, match='a message must have a header'):
        message_filter.add(Empty())
    for name in 'registerCallback', 'registerFailureCallback':
        with pytest.raises(TypeError, match='a callback must be a function, got None'):
            getattr(message_filter, name)(None)


def test_over_dds_while_the_listener_inserts(ros, listening):
    """
    In the callback, which the executor's thread calls, a lookup needs no timeout.

    As with a subscription, the program need not keep a reference to the filter.
    """
    broadcaster = TransformBroadcaster(ros.node)
    passed = []

    def use(message):
        listening.transform(message, 'map')
        passed.append((stamp_of(message), threading.get_ident()))

    MessageFilter(
        (PointStamped, 'points', 10), listening, 'map', 10, ros.node).registerCallback(use)
    gc.collect()
    publisher = ros.node.create_publisher(PointStamped, 'points', 10)
    ros.until(lambda: publisher.get_subscription_count()
              and broadcaster.pub_tf.get_subscription_count())
    for stamp in range(1, 6):
        publisher.publish(point(stamp * S))
        ros.until(lambda: engine_of(listening).is_awaited)
        broadcaster.sendTransform(stamped('map', 'laser', stamp * S))
        ros.until(lambda: len(passed) == stamp)  # noqa: B023
    assert passed == [(stamp * S, threading.get_ident()) for stamp in range(1, 6)]


def test_a_filter_of_another_executor(ros, other):
    """The filter wakes the executor of its own node, not that of the listener's node."""
    executor = SingleThreadedExecutor(context=ros.context)
    executor.add_node(other)
    setup = Setup(ros, node=other, buffer=Buffer(node=ros.node))

    def spin():
        while not setup.passed:
            executor.spin_once()
        return setup.passed

    setup.add(point(1 * S))
    # It is likely that the executor waits by then.
    inserting = threading.Timer(0.1, setup.insert, args=(1 * S,))
    inserting.start()
    assert len(run_in_thread(spin)) == 1
    inserting.join()
    executor.shutdown()
