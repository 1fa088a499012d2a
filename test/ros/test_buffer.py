"""Buffer: the interface of tf2_ros, waiting, and the release of resources."""

from collections.abc import Iterator
import gc
import sys
import threading
import time
import weakref

from geometry_msgs.msg import TransformStamped
from messages import ArrivedMessages
from processes import TIMEOUT
import pytest
import rclpy
from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rclpy.time import Time
from rclpy.utilities import get_default_context
import ros_node
from ros_node import eventually, run_in_thread, when_awaited

from puretf import (
    Buffer,
    BufferCore,
    ConnectivityException,
    LookupException,
    TFMessage,
    TimeoutException,
)
from puretf._core.engine import engine_of

T = Time(seconds=100)
SOON, LONG = Duration(seconds=0.05), Duration(seconds=TIMEOUT)


def stamped(parent='map', child='tool', at=T, x=42.0):
    """Return a transform without rotation."""
    message = ros_node.stamped(parent, child, at.nanoseconds, x)
    message.transform.translation.y = -3.14
    return message


def new_threads(before):
    """Return the threads that have been started since, and have not ended."""
    return {*threading.enumerate()} - before


def feed(buffer, *transforms):
    """Insert transforms in another thread as soon as the buffer has waiters; return the thread."""
    return when_awaited(buffer, lambda: [
        buffer.set_transform(transform, 'test') for transform in transforms])


def test_new_data_wake_a_lookup(monkeypatch):
    """It does not wait for its next attempt."""
    monkeypatch.setattr('puretf._core.engine._RETRY_INTERVAL', 1e6)
    buffer, begin = Buffer(), time.monotonic()
    feed(buffer, stamped())
    assert buffer.lookup_transform('map', 'tool', T, LONG) == stamped()
    assert time.monotonic() < begin + TIMEOUT / 2


@pytest.fixture
def quick_gc() -> Iterator[None]:
    """Make `gc.collect()` quick: it looks at the objects of this test only."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


def test_answers_with_the_message():
    """The lookup of one edge returns a message equal to the one that was set."""
    buffer = Buffer()
    tip = stamped('tool', 'tip')
    assert buffer.set_transform(stamped(), 'test') is None  # type: ignore[func-returns-value]
    assert buffer.set_transform_static(tip, 'test') is None  # type: ignore[func-returns-value]
    assert buffer.lookup_transform('map', 'tool', T) == stamped()
    assert buffer.lookup_transform('map', 'tool', T.to_msg()) == stamped()
    assert buffer.lookup_transform_core('map', 'tool', Time()) == stamped()
    assert buffer.lookup_transform_full('map', T, 'tool', T, 'map') == stamped()
    assert buffer.lookup_transform_full_core('map', T, 'tool', T, 'map') == stamped()
    assert buffer.lookup_transform('tool', 'tip', Time()).header.stamp == Time().to_msg()
    assert buffer.can_transform('map', 'tool', T) is True
    assert buffer.can_transform_core('map', 'tool', T) == (True, '')
    assert buffer.can_transform_full_core('map', T, 'tool', T, 'map') == (True, '')
    assert buffer.can_transform('map', 'tool', Time(seconds=1)) is False
    answer = buffer.can_transform('map', 'x', T, return_debug_tuple=True)
    assert isinstance(answer, tuple)
    assert answer[1].startswith(
        'Invalid frame ID "x" passed to canTransform argument source_frame - frame does not exist')
    assert not buffer.can_transform('map', 'x', T, SOON)
    latest = buffer.get_latest_common_time('map', 'tip')
    assert (type(latest), latest) == (Time, T)
    with pytest.raises(LookupException, match=r'"x" passed to get_latest_common_time does not'):
        buffer.get_latest_common_time('map', 'x')
    translations, _, known = buffer.lookup_transforms('map', 'tip', [T.nanoseconds, 1])
    assert (translations[0, 0], known.tolist()) == (84.0, [True, False])


def test_without_a_time():
    """A lookup is at the latest time; other numbers than the default are refused."""
    buffer = Buffer()
    buffer.set_transform(stamped(), 'test')
    assert buffer.lookup_transform('map', 'tool').header.stamp == T.to_msg()
    assert buffer.can_transform('map', 'tool') is True
    assert buffer.can_transform('map', 'nothing', return_debug_tuple=True)[0] is False
    with pytest.raises(TypeError, match=r'write Time\(seconds=1\)'):
        buffer.lookup_transform('map', 'tool', 1)  # type: ignore[arg-type]


def test_a_frame_must_be_a_str():
    """It is refused at once, not when the future is awaited."""
    buffer = Buffer()
    buffer.set_transform(stamped(), 'test')
    with pytest.raises(TypeError, match='a frame must be a str, got None'):
        buffer.wait_for_transform_async('map', None, T)  # type: ignore[arg-type]


def test_the_cache_time():
    """It is a Duration or its message, and must not be negative."""
    buffer = Buffer(Duration(seconds=1))
    buffer.set_transform(stamped(at=Time(seconds=10)), 'test')
    buffer.set_transform(stamped(at=Time(seconds=8)), 'test')
    assert not buffer.can_transform('map', 'tool', Time(seconds=8))
    Buffer(cache_time=Duration(seconds=1).to_msg())
    with pytest.raises(ValueError, match='cache_time must not be negative, got -1000000000 ns'):
        Buffer(Duration(seconds=-1))


@pytest.mark.parametrize('kind', [Buffer, BufferCore])
def test_the_limits_of_memory(kind):
    """Both limits of a TransformBuffer are arguments."""
    buffer = kind(Duration(seconds=1000), max_frames=3, max_samples=50)
    for child in 'abcd':
        buffer.set_transform(stamped(child=child), 'test')
    assert buffer.frame_names() == ['a', 'map', 'b']
    for seconds in range(200):
        buffer.set_transform(stamped(child='a', at=Time(seconds=100 + seconds)), 'test')
    assert sum(frame.length for frame in buffer.frames()) <= 50


def test_what_programs_use_although_it_begins_with_an_underscore():
    """Programs list the frames, and draw the graph in DOT, where all names are quoted."""
    buffer = Buffer()
    assert '"no tf data received"' in buffer._allFramesAsDot()
    buffer.set_transform(stamped('map', 'a "b"'), 'test')
    assert buffer._getFrameStrings() == ['a "b"', 'map']
    assert buffer._frameExists('map')
    assert not buffer._frameExists('nobody')
    for parent, child in ('base', 'arm'), ('base', 'head'), ('head', 'eye'):
        buffer.set_transform(stamped(parent, child), 'test')
    for fixed in 'base', 'head':  # no frame twice
        assert buffer._chain('arm', T, 'eye', Time(), fixed) == ['eye', 'head', 'base', 'arm']
    assert buffer._chain('eye', T, 'base', T, 'base') == ['base', 'head', 'eye']
    assert buffer._chain('eye', T, 'eye', T, 'eye') == ['eye']
    assert '"map" -> "a \\"b\\""[label="Broadcaster: test\\n' in buffer._allFramesAsDot(T)


@pytest.mark.parametrize('name', ['set_transform', 'set_transform_static'])
def test_a_bad_transform_changes_nothing(name):
    """The error names the field of a wrong type."""
    buffer, bad = Buffer(), stamped()
    bad.transform.rotation.w = '1'
    with pytest.raises(ValueError, match=r'rotation\.w must be a number'):
        getattr(buffer, name)(bad, 'test')
    with pytest.raises(TypeError, match='expected a TransformStamped'):
        getattr(buffer, name)('tool', 'test')
    assert not buffer.frame_names()


def test_logs_of_rclpy_take_lone_surrogates():
    """The logger of rclpy cannot encode them, and would raise in the listener's thread."""
    buffer = Buffer()
    for _ in range(2):
        assert not buffer.insert(1, 'map\udc80', 'map\udc80', (0.0,) * 6 + (1.0,))


def test_a_subclass_may_look_up_in_its_own_way():
    """It may call the core methods, as with tf2_ros; futures do not use its lookup_transform."""
    class Patient(Buffer):
        def can_transform(  # type: ignore[override]
                self, target_frame, source_frame, time, timeout=LONG):
            return self.can_transform_core(target_frame, source_frame, time)[0]

        def lookup_transform(  # type: ignore[override]
                self, target_frame, source_frame, time, timeout=LONG):
            if not self.can_transform(target_frame, source_frame, time):
                raise RuntimeError('not mine')
            return self.lookup_transform_core(target_frame, source_frame, time)

    buffer = Patient()
    future = buffer.wait_for_transform_async('map', 'tool', T)
    with pytest.raises(RuntimeError):
        buffer.lookup_transform('map', 'tool', T)
    buffer.set_transform(stamped(), 'test')
    assert buffer.lookup_transform('map', 'tool', T) == future.result() == stamped()


def test_an_error_of_a_lookup_goes_to_its_future():
    """Neither the caller of set_transform nor the other futures get the error."""
    class Broken(Buffer):
        broken = False

        def lookup_transform_core(self, target_frame, source_frame, time):
            if self.broken and source_frame == 'tool':
                raise RuntimeError('broken')
            return super().lookup_transform_core(target_frame, source_frame, time)

    buffer = Broken()
    futures = [buffer.wait_for_transform_async('map', name, T) for name in ('tool', 'tip')]
    buffer.broken = True
    buffer.set_transform(stamped(child='tip'), 'test')
    assert isinstance(futures[0].exception(), RuntimeError)
    assert futures[1].result() == stamped(child='tip')


def test_a_lookup_waits_for_the_data():
    """Data that complete the path end the wait; other data do not end it."""
    buffer = Buffer()
    feeding = feed(buffer, stamped(child='other'), stamped())
    assert buffer.lookup_transform('map', 'tool', T, timeout=LONG) == stamped()
    feeding.join()
    assert buffer.can_transform('map', 'other', T, LONG)
    for method, expected in ((buffer.can_transform_full, True),
                             (buffer.lookup_transform_full, stamped(child='late'))):
        buffer = Buffer()
        feeding = feed(buffer, stamped(child='late'))
        assert getattr(buffer, method.__name__)(
            'map', T, 'late', T, 'map', timeout=LONG) == expected
        feeding.join()


def test_a_lookup_waits_no_longer_than_its_timeout():
    """The error then says what is missing after the wait, not before it."""
    class LateSource(ArrivedMessages):
        """A source whose message arrives after the first attempt."""

        is_late = True

        def take(self):
            was_late, self.is_late = self.is_late, False
            return [] if was_late else super().take()

    buffer = Buffer()
    buffer.set_transform(stamped('map', 'base'), 'test')
    engine_of(buffer).add_source(LateSource(serialize_message(TFMessage(transforms=[stamped('other')]))))
    with pytest.raises(ConnectivityException):
        buffer.lookup_transform('map', 'tool', T, timeout=SOON)


@pytest.mark.parametrize('with_node', [True, False])
def test_a_wait_ends_when_ros_is_shut_down(domain_id, with_node):
    """A buffer without a node waits while the default context is valid."""
    context = Context() if with_node else get_default_context()
    rclpy.init(context=context, domain_id=domain_id)
    node = Node('test', context=context)
    buffer = Buffer(node=node if with_node else None)

    def look_up():
        with pytest.raises(LookupException):
            buffer.lookup_transform('a', 'b', Time(), Duration(seconds=10 * TIMEOUT))
        return True

    shutting_down = when_awaited(buffer, context.try_shutdown)
    assert run_in_thread(look_up)
    shutting_down.join()
    node.destroy_node()


@pytest.mark.parametrize('is_there', [True, False])
def test_a_coroutine_waits_for_what_is_not_there(is_there):
    """An available transform is returned without suspension, as in the tests of tf2_ros."""
    buffer = Buffer()
    coroutines = [buffer.lookup_transform_async('map', 'tool', T),
                  buffer.lookup_transform_full_async('map', T, 'tool', T, 'map')]
    if not is_there:
        for coroutine in coroutines:
            coroutine.send(None)
    buffer.set_transform(stamped(), 'test')
    for coroutine in coroutines:
        with pytest.raises(StopIteration) as done:
            coroutine.send(None)
        assert done.value.value == stamped()
    assert not engine_of(buffer).is_awaited


def test_a_future_times_out():
    """The error says what was missing, and the thread that watched the deadline ends."""
    buffer, before = Buffer(), {*threading.enumerate()}
    future = buffer.wait_for_transform_async('map', 'tool', T, timeout=SOON)
    callers: set[threading.Thread] = set()
    future.add_done_callback(lambda _: callers.add(threading.current_thread()))
    eventually(lambda: callers)
    assert not callers & before
    with pytest.raises(TimeoutException, match=(
            r"^Timed out after 0\.05 s, waiting for the transform from 'tool' to 'map': "
            '"map" passed to lookupTransform argument target_frame does not exist')):
        future.result()
    assert not engine_of(buffer).is_awaited
    full = buffer.wait_for_transform_full_async('map', T, 'tool', T, 'map', timeout=LONG)
    buffer.set_transform(stamped(), 'test')
    assert full.result() == stamped()
    eventually(lambda: not new_threads(before))


@pytest.mark.parametrize('abandon', ['drop', 'cancel', 'close', 'stop spinning'])
def test_an_abandoned_wait_leaves_nothing_behind(ros, quick_gc, abandon):
    """Neither a future nor a thread remains, and nothing keeps the buffer alive."""
    buffer, before = Buffer(node=ros.node), {*threading.enumerate()}
    if abandon == 'close':
        coroutine = buffer.lookup_transform_async('map', 'tool', T, timeout=LONG)
        coroutine.send(None)
        assert engine_of(buffer).is_awaited
        coroutine.close()
        del coroutine
    else:
        waiting = buffer.wait_for_transform_async('map', 'tool', T, timeout=LONG)
        assert engine_of(buffer).is_awaited
        if abandon == 'stop spinning':
            ros.executor.spin_until_future_complete(waiting, 0.05)
            ros.executor.spin_once(timeout_sec=0.0)  # else the executor holds the future
        if abandon == 'cancel':
            waiting.add_done_callback(lambda _: None)
            waiting.cancel()
            assert not engine_of(buffer).is_awaited
            buffer.set_transform(stamped(), 'test')
            assert waiting.cancelled()
        del waiting
    gc.collect()
    assert not engine_of(buffer).is_awaited
    eventually(lambda: not new_threads(before))
    gone = weakref.ref(buffer)
    del buffer
    gc.collect()
    assert gone() is None


def test_a_future_that_is_done_holds_no_buffer(quick_gc):
    """A program may keep the future without keeping all data of the buffer."""
    buffer = Buffer()
    future = buffer.wait_for_transform_async('map', 'tool', T)
    buffer.set_transform(stamped(), 'test')
    gone = weakref.ref(buffer)
    del buffer
    gc.collect()
    assert (gone(), future.result()) == (None, stamped())


def test_a_future_with_a_callback_needs_no_other_reference(quick_gc):
    """The buffer keeps a future with a done callback, as tf2_ros does."""
    buffer, results = Buffer(), []
    buffer.wait_for_transform_async('map', 'tool', T).add_done_callback(
        lambda future: results.append(future.result()))
    gc.collect()
    buffer.set_transform(stamped(child='other'), 'test')
    assert results == []
    buffer.set_transform(stamped(), 'test')
    buffer.set_transform(stamped(x=1.0), 'test')
    assert results == [stamped()]


@pytest.mark.parametrize('mode', ['callback', 'spun until done'])
def test_an_executor_that_was_shut_down_harms_nobody(ros, mode):
    """The insertion does not raise, and all futures are completed."""
    executor, buffer = SingleThreadedExecutor(context=ros.context), Buffer(node=ros.node)
    seen: list[object] = []
    ros.executor.remove_node(ros.node)
    executor.add_node(ros.node)
    first = buffer.wait_for_transform_async('map', 'tool', T)
    second = buffer.wait_for_transform_async('map', 'tool', T)
    if mode == 'callback':
        first.add_done_callback(seen.append)
    else:
        executor.spin_until_future_complete(first, 0.01)
    executor.shutdown()
    buffer.set_transform(stamped(), 'test')
    assert (first.result(), second.result()) == (stamped(), stamped())
    assert seen == ([first] if mode == 'callback' else [])


def test_hundreds_wait_with_one_thread():
    """A single thread handles all timeouts, from 50 ms to centuries."""
    buffer, before = Buffer(), {*threading.enumerate()}
    waiting = [buffer.wait_for_transform_async('map', 'tool', T, timeout=LONG)
               for _ in range(200)]
    waiting.append(buffer.wait_for_transform_async('map', 'tool', T, Duration(seconds=2 ** 33)))
    soon = buffer.wait_for_transform_async('map', 'tool', T, timeout=SOON)
    assert len(new_threads(before)) == 1
    eventually(soon.done)
    assert [type(future.exception()) for future in (soon, waiting[0])] == [
        TimeoutException, type(None)]
    buffer.set_transform(stamped(), 'test')
    assert all(future.result() == stamped() for future in waiting)


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_a_callback_that_exits_does_not_keep_other_futures_from_their_end():
    """The others are completed, both by timeouts and by an insertion."""
    buffer = Buffer()
    with buffer.updated():  # no future times out in this block
        futures = [buffer.wait_for_transform_async('map', 'tool', T, timeout=SOON)
                   for _ in range(3)]
        for future in futures:
            future.add_done_callback(lambda _: sys.exit())
    eventually(lambda: all(future.done() for future in futures))
    assert all(isinstance(future.exception(), TimeoutException) for future in futures)
    later = buffer.wait_for_transform_async('map', 'tool', T, timeout=SOON)
    eventually(later.done)
    futures = [buffer.wait_for_transform_async('map', 'tool', T) for _ in range(3)]
    for future in futures:
        future.add_done_callback(lambda _: sys.exit())
    with pytest.raises(SystemExit):
        buffer.set_transform(stamped(), 'test')
    assert all(future.result() == stamped() for future in futures)


def test_a_finalizer_may_cancel_a_wait(quick_gc):
    """The garbage collector may call it at any point where another wait is being started."""
    buffer = Buffer()

    class Owner:
        def __init__(self):
            self.future, self.itself = buffer.wait_for_transform_async('a', 'b', T, LONG), self

        def __del__(self):
            self.future.cancel()

    thresholds = gc.get_threshold()
    gc.set_threshold(1)
    try:
        for _ in range(100):
            Owner()
    finally:
        gc.set_threshold(*thresholds)
    gc.collect()
    assert not engine_of(buffer).is_awaited


def test_a_callback_may_use_the_buffer():
    """A done callback may insert transforms, and wait for others."""
    buffer, seen = Buffer(), []

    def on_tool(future):
        seen.append(future.result().child_frame_id)
        buffer.wait_for_transform_async('map', 'tip', T).add_done_callback(
            lambda future: seen.append(future.result().child_frame_id))
        buffer.set_transform(stamped('tool', 'tip'), 'test')

    buffer.wait_for_transform_async('map', 'tool', T).add_done_callback(on_tool)
    buffer.set_transform(stamped(), 'test')
    assert seen == ['tool', 'tip']


def test_an_awaiting_callback_goes_on_when_another_thread_brings_the_data(ros):
    """The completion of the future wakes the executor; nothing else does."""
    buffer = Buffer(node=ros.node)
    results: list[TransformStamped] = []

    async def on_timer():
        timer.cancel()
        results.append(await buffer.lookup_transform_async('map', 'tool', T))

    def spin():
        while not results:
            ros.executor.spin_once()
        return results

    timer = ros.node.create_timer(0.0, on_timer)
    feeding = feed(buffer, stamped())
    assert run_in_thread(spin) == [stamped()]
    feeding.join()


def test_a_clock_that_jumps_back_clears_the_buffer(ros):
    """
    A jump back by less than a second does not clear it; a change of the clock's source does.

    Static transforms stay.
    """
    clock = ros.node.get_clock()
    buffer = Buffer(node=ros.node)
    assert buffer.clock is clock
    assert isinstance(clock, ROSClock)

    def to(seconds):
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))

    def insert():
        buffer.set_transform(stamped(), 'test')
        assert buffer.can_transform('map', 'tip', T)

    buffer.set_transform_static(stamped('tool', 'tip'), 'test')
    insert()
    ros.node.set_parameters([Parameter('use_sim_time', value=True)])
    assert not buffer.can_transform('map', 'tip', T)
    to(50)
    insert()
    to(49.5)
    to(60)
    assert buffer.can_transform('map', 'tip', T)
    to(58)
    assert not buffer.can_transform('map', 'tip', T)
    assert buffer.can_transform('tool', 'tip', T)
    insert()
    ros.node.set_parameters([Parameter('use_sim_time', value=False)])
    assert not buffer.can_transform('map', 'tip', T)


def test_a_clock_may_jump_when_the_buffer_is_gone(make_node, quick_gc):
    """The clock does not keep the buffer alive, and does not use its freed jump handle."""
    node = make_node('simulated', parameter_overrides=[Parameter('use_sim_time', value=True)])
    gone = [weakref.ref(Buffer(node=node)) for _ in range(50)]
    gc.collect()
    clock = node.get_clock()
    assert isinstance(clock, ROSClock)
    others = [bytes(100) * 10 for _ in range(1000)]  # in the memory that is free now
    for seconds in 9, 2, 9, 2:
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
    assert [buffer() for buffer in gone] == [None] * 50
    kept = Buffer(node=node)
    node.destroy_node()
    del kept, others
