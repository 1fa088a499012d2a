"""The MessageFilter: which messages it passes on or drops, when, and in which order."""

from collections.abc import Callable
import gc
import random
import threading
import time
from typing import Any, NamedTuple

from geometry_msgs.msg import PointStamped
from hypothesis import given
from hypothesis import strategies as st
from messages import ArrivedMessages
import pytest
from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rclpy.time import Time
from recorded import judged, T, tf
from ros_node import run_in_thread, stamped
from std_msgs.msg import Empty

from puretf import (
    Buffer,
    FilterFailureReason,
    MessageFilter,
    TFMessage,
    TransformBroadcaster,
    TransformException,
    TransformListener,
)
from puretf._core.engine import engine_of
from puretf._ros.rclpy_private import guard_condition
from puretf_tools.doctor.message_times import Verdict

S = 10**9
MS = 10**6
NO_DROPS = dict.fromkeys(FilterFailureReason, 0)


def point(stamp, frame='laser', x=0.0):
    """Return a message with a header; the stamp is in ns."""
    message = PointStamped()
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    message.header.frame_id = frame
    message.point.x = x
    return message


def stamp_of(message):
    """Return the stamp of a message (ns)."""
    return Time.from_msg(message.header.stamp).nanoseconds


def insert(buffer, stamp, child='laser', parent='map'):
    """Insert a transform into a buffer; the stamp is in ns."""
    buffer.set_transform(stamped(parent, child, stamp), 'test')


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
            insert(self.buffer, stamp, child, parent)

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
    message = point(5 * S, x=1.0)
    setup.add(message)
    setup.insert(4 * S)
    assert setup.stamps() == []
    setup.insert(6 * S)
    assert setup.passed == []  # the executor has not been spun
    assert setup.stamps() == [5 * S]
    assert setup.passed[0] is message
    setup.insert(7 * S)
    assert setup.stamps() == [5 * S]
    setup.add(point(5 * S + 1, '/laser'), point(0, x=2.0))  # available at once; 0 is the latest
    assert setup.stamps() == [5 * S, 0, 5 * S + 1]
    assert setup.filter.dropped == NO_DROPS
    assert setup.failures() == []


def test_a_waiting_message_holds_no_other_back(ros):
    """A later message of another frame is passed on first."""
    setup = Setup(ros)
    setup.add(point(1 * S, 'nowhere'), point(1 * S), point(2 * S))
    setup.insert(1 * S)
    assert setup.stamps() == [1 * S]
    setup.insert(3 * S)
    assert setup.stamps() == [1 * S, 2 * S]
    setup.insert(1 * S, child='nowhere')
    assert setup.stamps() == [1 * S, 2 * S, 1 * S]


def test_messages_that_become_ready_together_are_sorted_by_stamp(ros):
    """The order of arrival decides only between equal stamps."""
    setup = Setup(ros)
    setup.add(*(point(stamp * S, x=float(i)) for i, stamp in enumerate((5, 3, 4, 3))))
    setup.insert(1 * S, 6 * S)
    assert setup.stamps() == [3 * S, 3 * S, 4 * S, 5 * S]
    assert [message.point.x for message in setup.passed] == [1.0, 3.0, 2.0, 0.0]


def test_an_empty_frame(ros):
    """The reason is EmptyFrameID, also for a lone slash."""
    setup = Setup(ros)
    setup.add(point(1 * S, ''), point(2 * S, '/'))
    assert setup.failures() == [(1 * S, FilterFailureReason.EmptyFrameID),
                                (2 * S, FilterFailureReason.EmptyFrameID)]
    assert setup.filter.dropped == {**NO_DROPS, FilterFailureReason.EmptyFrameID: 2}


def test_a_full_queue(ros):
    """The oldest message that waits is dropped; messages that need not wait need no place."""
    setup = Setup(ros, queue_size=2)
    setup.insert(1 * S)
    setup.add(point(5 * S), point(3 * S), point(1 * S))
    assert setup.stamps() == [1 * S]
    assert setup.failures() == []
    setup.add(point(4 * S))
    assert setup.failures() == [(5 * S, FilterFailureReason.QueueFull)]
    setup.filter.setQueueSize(1)
    assert setup.filter.getQueueSize() == 1
    assert setup.failures()[1:] == [(3 * S, FilterFailureReason.QueueFull)]
    setup.filter.setQueueSize(0)
    setup.add(*(point(6 * S) for _ in range(100)))
    assert setup.filter.dropped == {**NO_DROPS, FilterFailureReason.QueueFull: 2}
    setup.insert(7 * S)
    assert setup.stamps() == [1 * S, 4 * S, *[6 * S] * 100]


def test_a_message_that_is_too_old(ros):
    """It is dropped as soon as the latest transform is newer by more than the cache time."""
    setup = Setup(ros, buffer=Buffer(Duration(seconds=10), ros.node))
    setup.insert(20 * S)
    setup.add(point(10 * S), point(10 * S - 1))
    assert setup.failures() == [(10 * S - 1, FilterFailureReason.OutTheBack)]
    setup.insert(20 * S + 1)
    assert setup.failures()[1:] == [(10 * S, FilterFailureReason.OutTheBack)]
    assert setup.filter.dropped == {**NO_DROPS, FilterFailureReason.OutTheBack: 2}
    assert setup.stamps() == []


def test_a_timeout(ros):
    """A message is dropped when its own timeout is over, though nothing else happens."""
    setup = Setup(ros, buffer_timeout=Duration(seconds=0.1))
    begin = time.monotonic()
    setup.add(point(1 * S), point(2 * S, 'other'))
    setup.insert(2 * S, child='other')
    ros.until(lambda: time.monotonic() - begin > 0.05)
    setup.add(point(3 * S))
    ros.until(lambda: setup.failed)
    assert time.monotonic() - begin >= 0.1
    ros.until(lambda: len(setup.failed) == 2)
    assert time.monotonic() - begin >= 0.15
    assert setup.failures() == [(1 * S, FilterFailureReason.NoTransformFound),
                                (3 * S, FilterFailureReason.NoTransformFound)]
    assert setup.stamps() == [2 * S]
    assert setup.filter.dropped == {**NO_DROPS, FilterFailureReason.NoTransformFound: 2}
    setup.add(point(4 * S))  # the timer starts again
    ros.until(lambda: len(setup.failed) == 3)


def test_a_timeout_of_zero(ros):
    """A message whose transforms are not available is dropped at once."""
    setup = Setup(ros, buffer_timeout=0)
    setup.insert(1 * S)
    setup.add(point(1 * S), point(2 * S))
    ros.until(lambda: setup.failed)
    assert setup.failures() == [(2 * S, FilterFailureReason.NoTransformFound)]
    assert setup.stamps() == [1 * S]


def test_a_transform_that_is_gone(ros):
    """The reason is Unknown if the transform is lost before the executor calls the callbacks."""
    setup = Setup(ros)
    setup.add(point(1 * S))
    setup.insert(1 * S)
    setup.buffer.clear()
    assert setup.failures() == [(1 * S, FilterFailureReason.Unknown)]
    assert setup.stamps() == []
    assert setup.filter.dropped == {**NO_DROPS, FilterFailureReason.Unknown: 1}


def test_a_tolerance(ros):
    """The transform must be available at the stamp and at the stamp plus the tolerance."""
    setup = Setup(ros, tolerance=Duration(seconds=0.5))
    setup.add(point(1 * S))
    setup.insert(1 * S, 1 * S + 499 * MS)
    assert setup.stamps() == []
    setup.insert(1 * S + 500 * MS)
    assert setup.stamps() == [1 * S]
    setup.add(point(1 * S - 200 * MS))  # available at stamp + tolerance, but not at the stamp
    assert setup.stamps() == [1 * S]
    setup.add(point(1 * S + 100 * MS), point(1 * S + 200 * MS))
    setup.filter.setTolerance(400 * MS)
    assert setup.stamps() == [1 * S, 1 * S + 100 * MS]
    setup.filter.setTolerance(0)
    assert setup.stamps() == [1 * S, 1 * S + 100 * MS, 1 * S + 200 * MS]


def test_several_target_frames(ros):
    """A message waits for all of them; a target frame may appear later."""
    setup = Setup(ros, targets=['map', '/odom'])
    setup.add(point(1 * S))
    setup.insert(1 * S)
    assert setup.stamps() == []
    setup.insert(1 * S, child='map', parent='odom')
    assert setup.stamps() == [1 * S]


def test_target_frames_that_are_set_later(ros):
    """New target frames hold for the messages that wait, and for those that are due."""
    setup = Setup(ros, targets='map')
    setup.insert(2 * S)
    setup.add(point(1 * S), point(2 * S), point(3 * S))  # the second is due
    setup.filter.setTargetFrames(['map', 'odom'])
    assert setup.stamps() == []
    setup.insert(2 * S, 3 * S, child='map', parent='odom')
    assert setup.stamps() == [2 * S]
    setup.filter.setTargetFrame('laser')  # no transform is needed
    assert setup.stamps() == [2 * S, 1 * S, 3 * S]
    assert setup.failures() == []
    setup.add(point(4 * S))
    setup.filter.setTargetFrame('laser')  # the same again, while a message is due
    assert setup.stamps() == [2 * S, 1 * S, 3 * S, 4 * S]


def test_without_target_frames(ros):
    """As in tf2, new messages are ignored while there are no target frames, and old ones wait."""
    setup = Setup(ros, targets=[])
    setup.add(point(1 * S))
    setup.filter.setTargetFrame('map')
    setup.insert(1 * S)
    assert setup.stamps() == []
    setup.add(point(1 * S))
    assert setup.stamps() == [1 * S]
    setup.add(point(2 * S))
    setup.filter.setTargetFrames([])
    setup.insert(2 * S)
    assert setup.stamps() == [1 * S]
    setup.filter.setTargetFrames(['map'])
    assert setup.stamps() == [1 * S, 2 * S]


def test_limits_hold_after_a_change(ros):
    """Messages that were due and wait again count for the queue, and have their timeout."""
    setup = Setup(ros, queue_size=2, buffer_timeout=Duration(seconds=0.1))
    setup.insert(1 * S, 5 * S)
    setup.add(point(1 * S), point(2 * S), point(3 * S))
    setup.filter.setTargetFrame('nowhere')
    assert setup.failures()[0] == (1 * S, FilterFailureReason.QueueFull)
    ros.until(lambda: len(setup.failed) == 3)
    assert setup.filter.dropped == {
        **NO_DROPS, FilterFailureReason.QueueFull: 1, FilterFailureReason.NoTransformFound: 2}
    assert setup.stamps() == []


def test_a_message_that_is_added_during_a_check(ros, monkeypatch):
    """The check of another thread does not hide the message, though it is the last check."""
    setup = Setup(ros)
    setup.add(point(9 * S, 'other'))  # so that there is something to check
    availability = engine_of(setup.buffer).availability
    thread = threading.Thread(target=setup.add, args=(point(3 * S),))

    def add_meanwhile(*arguments):
        monkeypatch.undo()
        thread.start()
        thread.join(0.1)  # the thread waits for the buffer, which is locked during the check
        return availability(*arguments)

    monkeypatch.setattr(engine_of(setup.buffer), 'availability', add_meanwhile)
    setup.insert(3 * S)
    thread.join()
    assert setup.stamps() == [3 * S]


def test_a_message_whose_check_inserts_transforms(ros, monkeypatch):
    """If they are those of older messages, these are passed on first."""
    setup = Setup(ros)
    setup.insert(1 * S)
    setup.add(point(2 * S), point(3 * S))
    assert setup.stamps() == []
    transforms = [stamped('map', 'laser', stamp * S) for stamp in (2, 5)]
    data = serialize_message(TFMessage(transforms=transforms))
    updated = setup.buffer.updated

    def arrive():  # at the last moment before the check
        monkeypatch.undo()
        engine_of(setup.buffer).add_source(ArrivedMessages(data))
        return updated()

    monkeypatch.setattr(setup.buffer, 'updated', arrive)
    setup.add(point(4 * S))
    assert setup.stamps() == [2 * S, 3 * S, 4 * S]


def test_a_stamp_of_zero_is_never_too_old(ros):
    """It stands for the latest time, as in a lookup; it waits until there is such a time."""
    setup = Setup(ros, buffer=Buffer(Duration(seconds=10), ros.node))
    setup.insert(100 * S, 101 * S, child='odom')
    setup.insert(50 * S, child='laser', parent='odom')
    setup.add(point(0))
    assert setup.failures() == []
    setup.insert(101 * S, child='laser', parent='odom')
    assert setup.stamps() == [0]


def test_a_long_timeout(ros):
    """A timeout may be as long as a Duration can be."""
    setup = Setup(ros, buffer_timeout=Duration(nanoseconds=2**63 - 1))
    setup.add(point(1 * S))
    assert setup.failures() == []
    setup.insert(1 * S)
    assert setup.stamps() == [1 * S]


def test_a_stamp_before_1970(ros, capfd):
    """It is logged like any other."""
    message_filter = MessageFilter(None, Buffer(), 'map', 1, ros.node, tolerance=-5 * S)
    for x in 0.0, 1.0:
        message = point(1 * S, x=x)
        message.header.stamp.sec = -1
        message_filter.add(message)
    for _ in range(5):
        ros.executor.spin_once(timeout_sec=0.0)
    assert "frame 'laser' at time -1.000000 for reason" in capfd.readouterr().err


def test_messages_that_wait_long_are_logged(ros, capfd, monkeypatch):
    """If nothing is dropped, it is logged why the oldest message still waits."""
    now = [0]
    monkeypatch.setattr('puretf.message_filter.monotonic_ns', lambda: now[0])
    message_filter = MessageFilter(None, Buffer(), 'map', 0, ros.node)
    for _ in range(100):
        message_filter.add(point(1 * S))
        now[0] += 100 * MS
    error = capfd.readouterr().err
    assert error.count('Messages wait for their transforms.') == 1
    assert ("The oldest, of frame 'laser' at time 1.000000, has waited for 2.1 s. Invalid frame "
            'ID "map" passed to canTransform argument target_frame - ') in error


def test_after_clear_nothing_old_is_delivered(ros):
    """Neither messages that wait nor those that are due, nor failures; counters stay."""
    setup = Setup(ros, queue_size=1)
    setup.add(point(1 * S), point(2 * S), point(3 * S))  # two are dropped, one waits
    setup.insert(4 * S, child='other')
    setup.add(point(4 * S, 'other'))  # due
    setup.filter.clear()
    setup.insert(3 * S)
    assert setup.stamps() == []
    assert setup.failures() == []
    assert setup.filter.dropped == {**NO_DROPS, FilterFailureReason.QueueFull: 2}
    setup.add(point(3 * S))
    assert setup.stamps() == [3 * S]


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


def test_coroutine_functions_start_in_order(ros):
    """None waits for the end of another; messages that are ready together start by stamp."""
    setup = Setup(ros)
    started, ended = [], []

    async def look_up(message):
        started.append(stamp_of(message) // S)
        later = Time(nanoseconds=stamp_of(message) + 10 * S)
        await setup.buffer.lookup_transform_async('map', 'laser', later)
        ended.append(stamp_of(message) // S)

    setup.filter.registerCallback(look_up)
    setup.add(*(point(stamp * S) for stamp in (3, 1, 4, 2, 5)))
    setup.insert(1 * S, 5 * S)
    ros.until(lambda: len(started) == 5)
    assert started == [1, 2, 3, 4, 5]
    assert not ended
    setup.insert(15 * S)
    ros.until(lambda: len(ended) == 5)


def test_a_coroutine_function(ros):
    """It may be registered for messages and for failures, and may await a transform."""
    setup = Setup(ros)
    results = []

    async def look_up(message, offset):
        later = Time(nanoseconds=stamp_of(message) + offset)
        results.append(await setup.buffer.lookup_transform_async('map', 'laser', later))

    async def fail(message, reason):
        results.append(reason)

    setup.filter.registerCallback(look_up, 1 * S)
    setup.filter.registerFailureCallback(fail)
    setup.add(point(1 * S), point(1 * S, ''))
    setup.insert(1 * S)
    ros.until(lambda: results == [FilterFailureReason.EmptyFrameID])
    setup.insert(2 * S)
    ros.until(lambda: len(results) == 2)
    assert results[1].header.stamp.sec == 2


class SimpleFilter:
    """What the filters of message_filters are in Python, a part of that library's interface."""

    def __init__(self):
        """Create a filter without callbacks."""
        self.callbacks: dict[int, tuple[Callable[..., object], Any]] = {}

    def registerCallback(self, callback, *args):
        """Register a callback."""
        self.callbacks[len(self.callbacks)] = callback, args
        return len(self.callbacks) - 1

    def signalMessage(self, *message):
        """Call the callbacks."""
        for callback, args in self.callbacks.values():
            callback(*(message + args))


def test_the_input_can_be_replaced(ros):
    """Messages of the previous input are ignored, also if it cannot forget its callbacks."""
    first, second = SimpleFilter(), SimpleFilter()
    setup = Setup(ros, source=first)
    setup.insert(1 * S, 9 * S)
    first.signalMessage(point(1 * S))
    setup.filter.connectInput(second)
    first.signalMessage(point(2 * S))
    second.signalMessage(point(3 * S))
    assert setup.stamps() == [1 * S, 3 * S]
    setup.filter.connectInput((PointStamped, 'points', 10))
    second.signalMessage(point(4 * S))
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
    first.signalMessage(point(6 * S))
    assert setup.stamps() == [1 * S, 3 * S, 5 * S, 5 * S + 1, 6 * S]


def test_it_can_be_the_input_of_another_filter(ros):
    """A TimeSynchronizer of message_filters registers a callback with further arguments."""
    setup = Setup(ros, targets='map')
    calls = []
    setup.filter.registerCallback(lambda *arguments: calls.append(arguments), 'queue', 3)
    second = Setup(ros, targets='odom', source=setup.filter, buffer=setup.buffer)
    setup.insert(1 * S)
    message = point(1 * S)
    setup.add(message)
    assert setup.stamps() == [1 * S]
    assert calls == [(message, 'queue', 3)]
    assert second.stamps() == []
    setup.insert(1 * S, child='map', parent='odom')
    assert second.stamps() == [1 * S]


@pytest.mark.parametrize('by_node', [False, True])
def test_it_ends(ros, by_node):
    """It ends with its node, or by unregister; no callback is called any more."""
    node = Node('other', context=ros.context)
    ros.executor.add_node(node)
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
        setup.filter.connectInput(SimpleFilter())
    if not by_node:
        node.destroy_node()


def test_messages_of_a_node_that_ends(ros):
    """A message may be added while the node is being destroyed."""
    node = Node('other', context=ros.context)
    added: list[bool] = []

    def add():
        setup.add(point(1 * S))
        added.append(True)

    guard_condition(node, node.default_callback_group, add)  # it is destroyed first
    setup = Setup(ros, node=node, buffer=Buffer(), buffer_timeout=Duration(seconds=100))
    node.destroy_node()
    assert added
    assert not engine_of(setup.buffer).is_awaited


def test_the_node_keeps_the_filter_alive(ros):
    """As with a subscription, the program need not keep a reference."""
    passed: list[Any] = []
    buffer = Buffer(node=ros.node)
    MessageFilter((PointStamped, 'points', 10), buffer, 'map', 10, ros.node,
                  ).registerCallback(passed.append)
    gc.collect()
    publisher = ros.node.create_publisher(PointStamped, 'points', 10)
    ros.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(point(1 * S))
    insert(buffer, 1 * S)
    ros.until(lambda: passed)


def test_time_that_jumps_back(ros):
    """The messages that wait, and those that are due, are dropped without a failure."""
    node = Node('simulated', context=ros.context, parameter_overrides=[
        Parameter('use_sim_time', value=True)])
    ros.executor.add_node(node)
    setup = Setup(ros, node=node)
    clock = node.get_clock()
    assert isinstance(clock, ROSClock)

    def set_time(stamp):
        clock.set_ros_time_override(
            Time(nanoseconds=stamp, clock_type=ClockType.ROS_TIME))

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
    ros.executor.remove_node(node)
    node.destroy_node()


def test_dropped_messages_are_logged(ros, capfd):
    """tf2's text and why, once a second for each reason, unless there is a failure callback."""
    buffer = Buffer(node=ros.node)
    for stamp in 1, 2:
        insert(buffer, stamp * S)
    message_filter = MessageFilter(None, buffer, 'map', 1, ros.node)
    for stamp in range(5, 8):
        message_filter.add(point(stamp * S))
        message_filter.add(point(stamp * S, 'a\nb'))
    message_filter.add(point(1 * S, ''))
    for _ in range(5):
        ros.executor.spin_once(timeout_sec=0.0)
    error = capfd.readouterr().err
    assert error.count('Message Filter dropping message: ') == 2
    assert ("Message Filter dropping message: frame 'laser' at time 5.000000 for reason "
            "'discarding message because the queue is full'. Messages dropped for this reason: 5. "
            'Lookup would require extrapolation into the future.') in error
    assert ("Message Filter dropping message: frame '' at time 1.000000 for reason 'the frame id "
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
            ('tolerance', 0.1, TypeError, 'tolerance must have sec and nanosec'),
            ('buffer_timeout', -1, ValueError, 'buffer_timeout must not be negative, got -1 ns'),
            ('buffer_timeout', 0.1, TypeError, 'buffer_timeout must have sec and nanosec'),
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


def test_over_dds_while_the_listener_inserts(ros):
    """In the callback, which the executor's thread calls, a lookup needs no timeout."""
    buffer = Buffer(node=ros.node)
    listener = TransformListener(buffer, ros.node)
    broadcaster = TransformBroadcaster(ros.node)
    passed = []

    def use(message):
        buffer.transform(message, 'map')
        passed.append((stamp_of(message), threading.get_ident()))

    message_filter = MessageFilter((PointStamped, 'points', 10), buffer, 'map', 10, ros.node)
    message_filter.registerCallback(use)
    publisher = ros.node.create_publisher(PointStamped, 'points', 10)
    ros.until(lambda: publisher.get_subscription_count()
              and broadcaster.pub_tf.get_subscription_count())
    expected = []
    for stamp in range(1 * S, 6 * S, 1 * S):
        publisher.publish(point(stamp))
        ros.until(lambda: message_filter.is_waiting)
        broadcaster.sendTransform(stamped('map', 'laser', stamp))
        expected.append((stamp, threading.get_ident()))
        ros.until(lambda: passed == expected)
    listener.unregister()


def test_messages_and_transforms_of_several_threads(ros):
    """Every message is passed on exactly once, whatever the order of additions and insertions."""
    setup = Setup(ros, queue_size=0, buffer=Buffer(Duration(seconds=10**6), ros.node))
    number = 100

    def add(offset):
        for stamp in range(offset, number + 1, 4):
            setup.add(point(stamp * S, 'laser'))

    def move():
        for stamp in range(number + 1):
            setup.insert(stamp * S)
            time.sleep(0.0002)

    threads = [*(threading.Thread(target=add, args=(offset + 1,)) for offset in range(4)),
               threading.Thread(target=move)]
    for thread in threads:
        thread.start()
    ros.until(lambda: len(setup.passed) == number)
    for thread in threads:
        thread.join()
    assert sorted(setup.stamps()) == [stamp * S for stamp in range(1, number + 1)]
    assert setup.filter.dropped == NO_DROPS
    assert not setup.filter.is_waiting


CACHE = 100 * MS  #: the cache time of the buffer that the filters share (ns)


class Setting(NamedTuple):
    """The settings of a filter; the tolerance in ns."""

    targets: list[str]
    queue_size: int
    tolerance: int


class Waiting(NamedTuple):
    """A message in the slow filter."""

    stamp: int
    frame: str
    number: int


class SlowFilter:
    """The specification of the filter: after each event, it looks up every message."""

    def __init__(self, buffer, setting):
        """Create a filter of messages (stamp, frame, number)."""
        self.buffer = buffer
        self.targets, self.queue_size, self.tolerance = setting
        self.queue: list[Waiting] = []

    def _times(self, message):
        return [message.stamp] + [message.stamp + self.tolerance] * bool(self.tolerance)

    def _is_ready(self, message):
        return all(self.buffer.can_transform(target, message.frame, Time(nanoseconds=stamp))
                   for target in self.targets for stamp in self._times(message))

    def _is_too_old(self, message):
        for target in self.targets:
            try:
                latest = self.buffer.get_latest_common_time(target, message.frame).nanoseconds
            except TransformException:
                continue
            if any(0 != stamp < latest - CACHE and not self.buffer.can_transform(
                    target, message.frame, Time(nanoseconds=stamp))
                    for stamp in self._times(message) if latest):
                return True
        return False

    def add(self, message):
        """Add a message, and return what is passed on or dropped because of it."""
        if not message.frame:
            return [(message, FilterFailureReason.EmptyFrameID)]
        self.queue.append(message)
        if self._is_ready(message):
            return [(self.queue.pop(), None)]
        if self._is_too_old(message):
            return [(self.queue.pop(), FilterFailureReason.OutTheBack)]
        if self.queue_size and len(self.queue) > self.queue_size:
            return [(self.queue.pop(0), FilterFailureReason.QueueFull)]
        return []

    def check(self):
        """Return what is passed on or dropped after an insertion, in the order of the stamps."""
        outcomes: list[tuple[Waiting, Any]] = []
        for message in tuple(self.queue):
            if self._is_ready(message):
                outcomes.append((message, None))
            elif self._is_too_old(message):
                outcomes.append((message, FilterFailureReason.OutTheBack))
            else:
                continue
            self.queue.remove(message)
        return sorted(outcomes, key=lambda outcome: (outcome[0].stamp, outcome[0].number))


def random_events(seed):
    """
    Return 40 messages in 0.2 s, and transforms, in the order of their arrival.

    Transforms arrive with random delays (shorter than the cache) and gaps, one edge gets another
    parent now and then, and one tree is connected only at times.
    """
    draw = random.Random(seed)

    def delay():
        return min(int(draw.expovariate(1 / (40 * MS))), CACHE - 10 * MS)

    events: list[tuple[int, Any]] = []
    for i in range(40):
        stamp = S + i * 5 * MS
        frame = draw.choice([*['laser'] * 12, *['camera'] * 8, 'lost', 'nowhere', ''])
        events.append((stamp + delay(), Waiting(stamp, frame, i)))
    for parent, child, period in (('map', 'odom', 25), ('odom', 'base', 12), ('base', 'laser', 40),
                                  ('base', 'camera', 66), ('other', 'lost', 30)):
        for stamp in range(S - CACHE, S + 200 * MS, period * MS):
            if draw.random() < 0.9:
                now = 'odom' if child == 'laser' and draw.random() < 0.1 else parent
                events.append((stamp + delay(), stamped(now, child, stamp)))
    for stamp in range(S + 50 * MS, S + 120 * MS, 20 * MS):  # the trees are connected for a time
        events.append((stamp, stamped('map', 'other', stamp)))
    return [event for _, event in sorted(events, key=lambda event: event[0])]


def check_against_slow_filter(ros, setting, seed):
    """Compare the outcomes of random events, one by one; return the reasons of all drops."""
    buffer = Buffer(Duration(nanoseconds=CACHE))
    slow = SlowFilter(buffer, setting)
    fast = MessageFilter(None, buffer, setting.targets, setting.queue_size, ros.node,
                         tolerance=setting.tolerance)
    outcomes: list[tuple[Waiting, Any]] = []

    def waiting(message):
        return Waiting(stamp_of(message), message.header.frame_id, int(message.point.x))

    fast.registerCallback(lambda message: outcomes.append((waiting(message), None)))
    fast.registerFailureCallback(lambda message, why: outcomes.append((waiting(message), why)))
    for event in random_events(seed):
        del outcomes[:]
        if isinstance(event, Waiting):
            fast.add(point(event.stamp, event.frame, float(event.number)))
            expected = slow.add(event)
        else:
            buffer.set_transform(event, 'test')
            expected = slow.check()
        for _ in range(10):
            if len(outcomes) < len(expected):
                ros.executor.spin_once(timeout_sec=0.0)
        assert outcomes == expected
    fast.unregister()
    return {why for why, number in fast.dropped.items() if number}


def test_random_delays_against_a_slow_implementation(ros):
    """The outcomes are those of the specification, event by event."""
    reasons = set()

    @given(st.sampled_from([Setting(['map'], 0, 0), Setting(['map', 'odom'], 9, 30 * MS),
                            Setting(['base', 'other'], 5, 0)]), st.integers(0, 2**32))
    def check(setting, seed):
        reasons.update(check_against_slow_filter(ros, setting, seed))

    check()
    assert reasons == {FilterFailureReason.EmptyFrameID, FilterFailureReason.QueueFull,
                       FilterFailureReason.OutTheBack}


def test_a_filter_of_another_executor(ros):
    """The filter wakes the executor of its own node, not that of the listener's node."""
    node = Node('filtering', context=ros.context)
    executor = SingleThreadedExecutor(context=ros.context)
    executor.add_node(node)
    setup = Setup(ros, node=node, buffer=Buffer(node=ros.node))
    is_spinning = threading.Event()

    def spin():
        while not setup.passed:
            executor.spin_once()
        return setup.passed

    def insert_later():
        is_spinning.wait()
        time.sleep(0.05)  # it is likely that the executor waits by then
        setup.insert(1 * S)

    executor.create_task(is_spinning.set)
    setup.add(point(1 * S))
    inserting = threading.Thread(target=insert_later)
    inserting.start()
    assert len(run_in_thread(spin)) == 1
    inserting.join()
    executor.shutdown()
    node.destroy_node()


@pytest.mark.parametrize('seed', range(8))
def test_tf_doctor_predicts_what_is_passed_on(ros, seed):
    """With the queue of its table, a filter passes on what it says; with half of it, less."""
    choose = random.Random(seed)
    steps = [(edge, choose.choice([0, 20, 200, 700]), choose.choice([100, 250, 1000]))
             for edge in ('map odom', 'odom base')]
    transforms = [tf(i + delay, i, edge) for edge, delay, step in steps
                  for i in range(0, choose.choice([12_000, 15_000]), step)]
    messages = [(i, i - choose.choice([0, 0, 30, 300, 300, 11_000, -400]))
                for i in range(10, 15_000, 200)]
    times = judged(transforms, messages)
    queue = times.queue()
    assert queue > 1
    passed = [stamp for stamp, verdict in zip(times.stamps.tolist(), times.verdicts.tolist())
              if verdict in (Verdict.AT_ONCE, Verdict.WAITS)]
    assert len(passed) == times.count(Verdict.AT_ONCE, Verdict.WAITS) < len(messages)
    assert sorted(filtered(ros, transforms, messages, queue)) == sorted(passed)
    assert len(filtered(ros, transforms, messages, queue // 2)) < len(passed)


def filtered(ros, transforms, messages, queue):
    """Return the stamps of the messages that a filter passes on, of those that arrive in turn."""
    setup = Setup(ros, queue_size=queue, buffer=Buffer(Duration(seconds=10)))
    events = sorted([*((each.time, 0, each) for each in transforms), *(
        (T + arrival * MS, 1, T + stamp * MS) for arrival, stamp in messages)],
        key=lambda event: event[:2])
    for _, is_message, event in events:
        if is_message:
            setup.add(point(event, 'base'))
        else:
            for row in event.rows():
                setup.insert(row.stamp_ns, child=row.child_frame_id, parent=row.frame_id)
        setup.spin()
    return setup.stamps()
