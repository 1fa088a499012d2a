"""Buffer: the interface of tf2_ros, waiting, and the release of resources."""

import gc
import inspect
import signal
import sys
import threading
import time
from typing import Any
import weakref

from conftest import made_at_run_time
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
import pytest
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time

import dummy_arm.tf
from dummy_arm.tf import (
    Buffer,
    BufferInterface,
    ConnectivityException,
    LookupException,
    MessageBufferCore,
    TimeoutException,
    TransformException,
)

T = Time(seconds=100)
SOON, LONG = Duration(seconds=0.05), Duration(seconds=20)


def stamped(parent='map', child='tool', at=T, x=42.0):
    """Return a transform without rotation."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, at.to_msg()
    message.transform.translation = Vector3(x=x, y=-3.14, z=0.0)
    message.transform.rotation = Quaternion(w=1.0)
    return message


def call_later(function, *arguments):
    """Call a function in another thread after 50 ms; return the timer."""
    timer = threading.Timer(0.05, function, arguments)
    timer.start()
    return timer


NO_WAIT: dict[str, object] = {'timeout': Duration()}
SIGNATURES: dict[str, tuple[str, dict[str, object]]] = {
    '__init__': ('cache_time node', {'cache_time': None, 'node': None}),
    'set_transform': ('transform authority', {}),
    'set_transform_static': ('transform authority', {}),
    'lookup_transform': ('target_frame source_frame time timeout', NO_WAIT),
    'lookup_transform_full': (
        'target_frame target_time source_frame source_time fixed_frame timeout', NO_WAIT),
    'lookup_transform_async': ('target_frame source_frame time', {}),
    'lookup_transform_full_async': (
        'target_frame target_time source_frame source_time fixed_frame', {}),
    'can_transform': ('target_frame source_frame time timeout return_debug_tuple',
                      {**NO_WAIT, 'return_debug_tuple': False}),
    'can_transform_full': (
        'target_frame target_time source_frame source_time fixed_frame timeout '
        'return_debug_tuple', {**NO_WAIT, 'return_debug_tuple': False}),
    'wait_for_transform_async': ('target_frame source_frame time', {}),
    'wait_for_transform_full_async': (
        'target_frame target_time source_frame source_time fixed_frame', {}),
    'transform': ('object_stamped target_frame timeout new_type', {**NO_WAIT, 'new_type': None}),
    'transform_full': ('object_stamped target_frame target_time fixed_frame timeout new_type',
                       {**NO_WAIT, 'new_type': None}),
    'lookup_transform_core': ('target_frame source_frame time', {}),
    'lookup_transform_full_core': (
        'target_frame target_time source_frame source_time fixed_frame', {}),
    'can_transform_core': ('target_frame source_frame time', {}),
    'can_transform_full_core': (
        'target_frame target_time source_frame source_time fixed_frame', {}),
    'get_latest_common_time': ('target_frame source_frame', {}),
    'all_frames_as_yaml': ('', {}),
    'all_frames_as_string': ('', {}),
    'clear': ('', {}),
    'time_jump_callback': ('time_jump', {}),
    '_chain': ('target_frame target_time source_frame source_time fixed_frame', {}),
    '_allFramesAsDot': ('time', {}),
    '_frameExists': ('frame_id', {}),
    '_getFrameStrings': ('', {}),
}


@pytest.mark.parametrize('name', SIGNATURES)
def test_has_the_signatures_of_tf2_ros(name):
    """Additional parameters follow those of tf2_ros, and have defaults."""
    names, defaults = SIGNATURES[name]
    parameters = list(inspect.signature(getattr(Buffer, name)).parameters.values())[1:]
    count = len(names.split())
    assert [parameter.name for parameter in parameters[:count]] == names.split()
    for parameter in parameters[:count]:
        if parameter.name in defaults:
            assert parameter.default == defaults[parameter.name]
    assert all(parameter.default is not parameter.empty for parameter in parameters[count:])


def test_has_the_names_of_tf2_ros():
    """The names are in the package, and in modules with the same names as those of tf2_ros."""
    from dummy_arm.tf.buffer import Buffer as InModule
    from dummy_arm.tf.buffer_interface import BufferInterface as InInterface
    assert (InModule, InInterface) == (Buffer, BufferInterface)
    assert dummy_arm.tf.buffer.Buffer is Buffer
    assert issubclass(Buffer, MessageBufferCore)
    assert issubclass(Buffer, BufferInterface)
    everything: dict[str, Any] = {}
    exec('from dummy_arm.tf import *', everything)
    for name in ('Buffer', 'BufferCore', 'BufferInterface', 'TransformRegistration',
                 'ConvertRegistration', 'TypeException', 'NotImplementedException', 'Stamped',
                 'convert', 'TransformBroadcaster', 'StaticTransformBroadcaster',
                 'TransformException', 'ConnectivityException', 'LookupException',
                 'ExtrapolationException', 'InvalidArgumentException', 'TimeoutException'):
        assert everything[name] is getattr(dummy_arm.tf, name)
        if name.endswith('Exception') and name not in ('TypeException', 'NotImplementedException'):
            assert issubclass(everything[name], TransformException)


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
    latest = buffer.get_latest_common_time('map', 'tip')
    assert (type(latest), latest) == (Time, T)
    with pytest.raises(LookupException, match=r'"x" passed to get_latest_common_time does not'):
        buffer.get_latest_common_time('map', 'x')
    translations, _, known = buffer.lookup_transforms('map', 'tip', [T.nanoseconds, 1])
    assert (translations[0, 0], known.tolist()) == (84.0, [True, False])


def test_times_are_no_plain_numbers():
    """A number is refused as a time, since 5 might be meant as seconds."""
    buffer = Buffer()
    for time_like in 5, 5.0, None:
        with pytest.raises(TypeError, match='time must have sec and nanosec, or nanoseconds'):
            buffer.lookup_transform('a', 'b', time_like)  # type: ignore[arg-type]
    buffer.set_transform(stamped(), 'test')
    with pytest.raises(TypeError, match=r'timeout must have .* Got 1\.0 of type float'):
        buffer.lookup_transform('map', 'tool', T, timeout=1.0)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match='timeout must have'):
        buffer.wait_for_transform_async('map', 'x', T, timeout=1.0)  # type: ignore[arg-type]
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


@pytest.mark.parametrize(('break_it', 'error'), [
    (lambda message: setattr(message.transform.translation, 'x', None), r'translation\.x must be'),
    (lambda message: setattr(message.transform.rotation, 'w', '1'), r'rotation\.w must be'),
    (lambda message: setattr(message.header.stamp, 'sec', 0.5), r'stamp\.sec must be'),
    (lambda message: setattr(message, 'child_frame_id', None), 'child_frame_id must be')])
def test_a_field_that_is_none_of_its_kind(break_it, error):
    """The error names the field with the wrong type, and the buffer stays as it was."""
    buffer, bad = Buffer(), stamped(child='other')
    buffer.set_transform(stamped(), 'test')
    break_it(bad)
    with pytest.raises(ValueError, match=error):
        buffer.set_transform(bad, 'test')
    with pytest.raises(TypeError, match='expected a TransformStamped'):
        buffer.set_transform('tool', 'test')
    assert buffer._getFrameStrings() == ['tool', 'map']


def test_a_subclass_may_watch_inserted_transforms():
    """Overriding set_transform does not keep the transform from completing a future."""
    class Watching(Buffer):
        seen = 0

        def set_transform(self, transform, authority):  # type: ignore[override]
            self.seen += 1
            return super().set_transform(transform, authority)

    buffer = Watching()
    future = buffer.wait_for_transform_async('map', 'tool', T)
    buffer.set_transform(stamped(), 'test')
    assert (buffer.seen, future.result()) == (1, stamped())


@pytest.mark.parametrize(('target', 'source', 'fixed', 'chain'), [
    ('tool', 'eye', 'map', ['eye', 'head', 'base', 'arm', 'tool']),
    ('tool', 'eye', 'head', ['eye', 'head', 'base', 'arm', 'tool']),
    ('map', 'eye', 'map', ['eye', 'head', 'base', 'map']),
    ('eye', 'map', 'map', ['map', 'base', 'head', 'eye']),
    ('eye', 'eye', 'eye', ['eye'])])
def test_the_chain_of_frames(target, source, fixed, chain):
    """The chain leads from the source to the target, and passes no frame twice."""
    buffer = Buffer()
    for parent, child in (('map', 'base'), ('base', 'arm'), ('arm', 'tool'), ('base', 'head'),
                          ('head', 'eye')):
        buffer.set_transform(stamped(parent, child), 'test')
    assert buffer._chain(target, T, source, Time(), fixed) == chain


def test_what_programs_use_although_it_begins_with_an_underscore():
    """Programs list the frames, and draw the graph in DOT, where all names are quoted."""
    buffer = Buffer()
    assert '"no tf data received"' in buffer._allFramesAsDot()
    buffer.set_transform(stamped('map', 'a "b"'), 'test')
    assert buffer._getFrameStrings() == ['a "b"', 'map']
    assert buffer._frameExists('map')
    assert not buffer._frameExists('nobody')
    assert '"map" -> "a \\"b\\""[label="Broadcaster: test\\n' in buffer._allFramesAsDot(T)


def test_a_subclass_may_look_up_in_its_own_way():
    """It may call the core methods, as with tf2_ros; futures do not use its lookup_transform."""
    class Patient(Buffer):
        def can_transform(  # type: ignore[override]
                self, target_frame, source_frame, time, timeout=LONG):
            return self.can_transform_core(target_frame, source_frame, time)[0]

        def lookup_transform(self, target_frame, source_frame, time, timeout=LONG):
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
    """Data that complete the path end the wait at once; other data do not end it."""
    buffer = Buffer()
    timers = [call_later(buffer.set_transform, stamped(child='other'), 'test'),
              call_later(buffer.set_transform_static, stamped(), 'test')]
    began = time.monotonic()
    assert buffer.lookup_transform('map', 'tool', T, timeout=LONG) == stamped()
    assert time.monotonic() - began < 10.0
    assert buffer.can_transform('map', 'other', T, LONG)
    assert buffer.can_transform_full('map', T, 'other', T, 'map', timeout=LONG)
    for timer in timers:
        timer.join()


def test_a_lookup_waits_no_longer_than_its_timeout():
    """The error then says what is missing after the wait, not before it."""
    buffer = Buffer()
    timer = call_later(buffer.set_transform, stamped('other', 'tool'), 'test')
    buffer.set_transform(stamped('map', 'base'), 'test')
    began = time.monotonic()
    with pytest.raises(ConnectivityException):
        buffer.lookup_transform('map', 'tool', T, timeout=Duration(seconds=2.0))
    assert 2.0 <= time.monotonic() - began < 12.0
    assert not buffer.can_transform('map', 'tool', T, SOON)
    timer.join()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_wait_ends_with_the_program(start, number):
    """A signal ends the lookup by KeyboardInterrupt or, after the shutdown, LookupException."""
    process = start('-c', """
import threading
import time
import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time
from dummy_arm.tf import Buffer, LookupException
rclpy.init()
buffer = Buffer()


def tell():
    while not buffer.has_waiters:
        time.sleep(0.01)
    print('waiting', flush=True)


threading.Thread(target=tell).start()
try:
    buffer.lookup_transform('a', 'b', Time(), timeout=Duration(seconds=60))
except (KeyboardInterrupt, LookupException) as error:
    print(type(error).__name__)
""")
    process.line_with('waiting')
    process.end(number)
    assert process.exit_code() == 0
    last_lines = ['LookupException'] + ['KeyboardInterrupt'] * (number == signal.SIGINT)
    assert process.output.splitlines()[-1] in last_lines


def test_a_coroutine_gets_what_is_there_at_once():
    """An available transform is returned without suspension, as in the tests of tf2_ros."""
    buffer = Buffer()
    buffer.set_transform(stamped(), 'test')
    for coroutine in (buffer.lookup_transform_async('map', 'tool', T),
                      buffer.lookup_transform_full_async('map', T, 'tool', T, 'map')):
        with pytest.raises(StopIteration) as done:
            coroutine.send(None)
        assert done.value.value == stamped()


def test_a_coroutine_waits_for_what_is_not_there():
    """The coroutine returns the transform when it is resumed after the insertion."""
    buffer = Buffer()
    coroutines = [buffer.lookup_transform_async('map', 'tool', T),
                  buffer.lookup_transform_full_async('map', T, 'tool', T, 'map')]
    for coroutine in coroutines:
        coroutine.send(None)
    buffer.set_transform(stamped(), 'test')
    for coroutine in coroutines:
        with pytest.raises(StopIteration) as done:
            coroutine.send(None)
        assert done.value.value == stamped()
    assert not buffer.has_waiters


def test_a_future_times_out():
    """The error says what was missing, and the thread that watched the deadline ends."""
    buffer, threads = Buffer(), threading.active_count()
    done = threading.Event()
    future = buffer.wait_for_transform_async('map', 'tool', T, timeout=SOON)
    future.add_done_callback(lambda _: done.set())
    assert done.wait(20)
    with pytest.raises(TimeoutException, match=(
            r"^Timed out after 0\.05 s, waiting for the transform from 'tool' to 'map': "
            '"map" passed to lookupTransform argument target_frame does not exist')):
        future.result()
    assert not buffer.has_waiters
    full = buffer.wait_for_transform_full_async('map', T, 'tool', T, 'map', timeout=LONG)
    buffer.set_transform(stamped(), 'test')
    assert full.result() == stamped()
    for _ in range(200):
        if threading.active_count() == threads:
            break
        time.sleep(0.01)
    assert threading.active_count() == threads


@pytest.mark.parametrize('abandon', ['drop', 'cancel', 'close', 'stop spinning'])
def test_an_abandoned_wait_leaves_nothing_behind(ros, abandon):
    """Neither a future nor a thread remains, and nothing keeps the buffer alive."""
    buffer, threads = Buffer(node=ros.node), threading.active_count()
    if abandon == 'close':
        coroutine = buffer.lookup_transform_async('map', 'tool', T, timeout=LONG)
        coroutine.send(None)
        assert buffer.has_waiters
        coroutine.close()
        del coroutine
    else:
        waiting = buffer.wait_for_transform_async('map', 'tool', T, timeout=LONG)
        assert buffer.has_waiters
        if abandon == 'stop spinning':
            ros.executor.spin_until_future_complete(waiting, 0.05)
            ros.executor.spin_once(timeout_sec=0.0)  # else the executor holds the future
        if abandon == 'cancel':
            waiting.add_done_callback(lambda _: None)
            waiting.cancel()
            assert not buffer.has_waiters
            buffer.set_transform(stamped(), 'test')
            assert waiting.cancelled()
        del waiting
    gc.collect()
    assert not buffer.has_waiters
    for _ in range(200):
        if threading.active_count() == threads:
            break
        time.sleep(0.01)
    assert threading.active_count() == threads
    gone = weakref.ref(buffer)
    del buffer
    gc.collect()
    assert gone() is None


def test_a_future_that_is_done_holds_no_buffer():
    """A program may keep the future without keeping all data of the buffer."""
    buffer = Buffer()
    future = buffer.wait_for_transform_async('map', 'tool', T)
    buffer.set_transform(stamped(), 'test')
    gone = weakref.ref(buffer)
    del buffer
    gc.collect()
    assert (gone(), future.result()) == (None, stamped())


def test_a_future_with_a_callback_needs_no_other_reference():
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
    buffer, threads = Buffer(), threading.active_count()
    waiting = [buffer.wait_for_transform_async('map', 'tool', T, timeout=LONG)
               for _ in range(200)]
    waiting.append(buffer.wait_for_transform_async('map', 'tool', T, Duration(seconds=2 ** 33)))
    soon = buffer.wait_for_transform_async('map', 'tool', T, timeout=SOON)
    assert threading.active_count() == threads + 1
    done = threading.Event()
    soon.add_done_callback(lambda _: done.set())
    assert done.wait(20)
    assert [type(future.exception()) for future in (soon, waiting[0])] == [
        TimeoutException, type(None)]
    buffer.set_transform(stamped(), 'test')
    assert all(future.result() == stamped() for future in waiting)


def test_ended_waits_are_not_kept_for_their_deadlines():
    """They are removed even if a wait with an earlier deadline goes on."""
    buffer = Buffer()
    kept = buffer.wait_for_transform_async('map', 'tool', T, timeout=LONG)
    for _ in range(1000):
        buffer.wait_for_transform_async('map', 'tool', T, timeout=Duration(seconds=60)).cancel()
    assert len(buffer._futures._deadlines) < 50
    assert not kept.done()


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_timeouts_go_on_after_a_callback_that_ended_their_thread():
    """The SystemExit of a done callback is not caught by rclpy."""
    buffer, done = Buffer(), threading.Event()
    timeout = Duration(seconds=0.5)  # else it may end before the callback is added
    buffer.wait_for_transform_async('map', 'tool', T, timeout=timeout).add_done_callback(
        lambda _: sys.exit())
    thread = buffer._futures._thread
    assert thread is not None
    thread.join(20)
    buffer.wait_for_transform_async('map', 'tool', T, timeout=SOON).add_done_callback(
        lambda _: done.set())
    assert done.wait(20)


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_a_callback_that_exits_does_not_keep_other_futures_from_their_end():
    """The others are completed, both by timeouts and by an insertion."""
    buffer, done = Buffer(), threading.Event()
    futures = [buffer.wait_for_transform_async('map', 'tool', T, timeout=Duration(seconds=0.5))
               for _ in range(3)]
    for future in futures:
        future.add_done_callback(lambda _: sys.exit())
    futures[-1].add_done_callback(lambda _: None)
    last = buffer.wait_for_transform_async('map', 'tool', T, timeout=Duration(seconds=1.0))
    last.add_done_callback(lambda _: done.set())
    assert done.wait(20)
    assert all(isinstance(future.exception(), TimeoutException) for future in futures)
    futures = [buffer.wait_for_transform_async('map', 'tool', T) for _ in range(3)]
    for future in futures:
        future.add_done_callback(lambda _: sys.exit())
    with pytest.raises(SystemExit):
        buffer.set_transform(stamped(), 'test')
    assert all(future.result() == stamped() for future in futures)


def test_a_finalizer_may_cancel_a_wait():
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
    assert not buffer.has_waiters


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

    timer = ros.node.create_timer(0.0, on_timer)
    feeder = threading.Timer(0.3, buffer.set_transform, [stamped(), 'test'])
    feeder.start()
    began = time.monotonic()
    while not results and time.monotonic() - began < 15:
        ros.executor.spin_once(timeout_sec=15)
    assert time.monotonic() - began < 10
    assert results == [stamped()]
    feeder.join()


def test_done_callbacks_need_no_executor(ros):
    """
    They run in the thread that inserts the data, as in tf2_ros.

    So a callback of the executor may block until one of them has run.
    """
    buffer, done = Buffer(node=ros.node), threading.Event()
    results: list[bool] = []

    def on_timer():
        timer.cancel()
        buffer.wait_for_transform_async('map', 'tool', T).add_done_callback(
            lambda _: done.set())
        results.append(done.wait(20))

    timer = ros.node.create_timer(0.0, on_timer)
    feeder = call_later(buffer.set_transform, stamped(), 'test')
    ros.until(lambda: results)
    assert results == [True]
    feeder.join()


def test_a_callback_that_waits_gets_the_data_of_another_thread(ros):
    """A blocked lookup in a single-threaded executor does not prevent the insertion."""
    buffer = Buffer(node=ros.node)
    results: list[TransformStamped] = []

    def on_timer():
        timer.cancel()
        results.append(buffer.lookup_transform('map', 'tool', T, timeout=LONG))

    timer = ros.node.create_timer(0.0, on_timer)
    feeder = call_later(buffer.set_transform, stamped(), 'test')
    ros.until(lambda: results)
    assert results == [stamped()]
    feeder.join()


def test_a_clock_that_jumps_back_clears_the_buffer(ros):
    """
    A jump back by less than a second does not clear it; a change of the clock's source does.

    Static transforms stay.
    """
    clock = ros.node.get_clock()
    buffer = Buffer(node=ros.node)
    clock._set_ros_time_is_active(True)

    def to(seconds):
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))

    to(50)
    buffer.set_transform(stamped(), 'test')
    buffer.set_transform_static(stamped('tool', 'tip'), 'test')
    to(49.5)
    to(60)
    assert buffer.can_transform('map', 'tip', T)
    to(58)
    assert not buffer.can_transform('map', 'tip', T)
    assert buffer.can_transform('tool', 'tip', T)
    buffer.set_transform(stamped(), 'test')
    clock._set_ros_time_is_active(False)
    assert not buffer.can_transform('map', 'tip', T)


def test_a_clock_may_jump_when_the_buffer_is_gone(start):
    """The clock does not keep the buffer alive, and does not use its freed jump handle."""
    process = start('-c', """
import gc
import weakref
import rclpy
from rclpy.clock import ClockType, ROSClock
from rclpy.time import Time
from dummy_arm.tf import Buffer
rclpy.init()
node = rclpy.create_node('test')
clock = node.get_clock()
clock._set_ros_time_is_active(True)
gone = [weakref.ref(Buffer(node=node)) for _ in range(50)]
gc.collect()
others = [bytes(100) * 10 for _ in range(1000)]
for seconds in 9, 2, 9, 2:
    clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
print(sum(buffer() is None for buffer in gone))
kept = Buffer(node=node)
node.destroy_node()
del kept
print('end')
""")
    assert process.exit_code() == 0
    assert process.output.split() == ['50', 'end']


def test_the_buffer_of_tf2_py():
    """
    MessageBufferCore takes messages and the times of rclpy.

    It has no node, no method that waits, and no `transform`.
    """
    buffer = MessageBufferCore(Duration(seconds=5))
    buffer.set_transform(stamped(), 'me')
    buffer.set_transform_static(stamped('tool', 'tip', x=1.0), 'me')
    assert buffer.lookup_transform_core('map', 'tool', T) == stamped()
    assert buffer.lookup_transform_full_core('map', T, 'tool', Time(), 'map') == stamped()
    assert buffer.can_transform_core('map', 'tip', Time()) == (True, '')
    assert buffer.can_transform_full_core('map', T, 'tip', T, 'map') == (True, '')
    is_available, text = buffer.can_transform_core('map', 'tip', Time(seconds=1))
    assert not is_available
    assert 'extrapolation' in text
    assert buffer.get_latest_common_time('map', 'tip') == T
    assert buffer._getFrameStrings() == ['tool', 'map', 'tip']
    assert not hasattr(buffer, 'lookup_transform')
    assert not hasattr(buffer, 'transform')
    with pytest.raises(TypeError, match='expected a TransformStamped'):
        buffer.set_transform('tool', 'me')


def test_a_buffer_without_node_has_a_clock():
    """The clock is a plain Clock, which shows the system time."""
    assert type(Buffer().clock) is Clock


@made_at_run_time
def test_without_tf2_msgs_there_is_no_service(ros):
    """test_desktop.py tests the service where tf2_msgs is installed."""
    assert Buffer(node=ros.node).srv is None


def test_refusals_go_to_the_log_of_ros(start):
    """The line has tf2's words, and is a warning of the logger tf2_buffer."""
    process = start('-c', """
from dummy_arm.tf import Buffer
from geometry_msgs.msg import TransformStamped
Buffer().set_transform(TransformStamped(child_frame_id='a'), 'somebody')
""")
    assert process.exit_code() == 0
    assert '[WARN]' in process.output
    assert '[tf2_buffer]: TF_NO_FRAME_ID: Ignoring transform with child_frame_id "a"  from ' \
        'authority "somebody" because frame_id not set' in process.output
