"""The buffer of tf2_ros: its interface, waiting, and what it leaves behind."""

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


def made(parent='map', child='tool', at=T, x=42.0):
    """Make a transform, not turned."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, at.to_msg()
    message.transform.translation = Vector3(x=x, y=-3.14, z=0.0)
    message.transform.rotation = Quaternion(w=1.0)
    return message


def later(function, *arguments):
    """Call a function in another thread in a moment."""
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
    """What comes on top comes after, with a default."""
    names, defaults = SIGNATURES[name]
    parameters = list(inspect.signature(getattr(Buffer, name)).parameters.values())[1:]
    count = len(names.split())
    assert [parameter.name for parameter in parameters[:count]] == names.split()
    for parameter in parameters[:count]:
        if parameter.name in defaults:
            assert parameter.default == defaults[parameter.name]
    assert all(parameter.default is not parameter.empty for parameter in parameters[count:])


def test_has_the_names_of_tf2_ros():
    """In the package and in modules of the same names."""
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
    """The very one that was set; for time 0 the latest."""
    buffer = Buffer()
    tip = made('tool', 'tip')
    assert buffer.set_transform(made(), 'test') is None  # type: ignore[func-returns-value]
    assert buffer.set_transform_static(tip, 'test') is None  # type: ignore[func-returns-value]
    assert buffer.lookup_transform('map', 'tool', T) == made()
    assert buffer.lookup_transform('map', 'tool', T.to_msg()) == made()
    assert buffer.lookup_transform_core('map', 'tool', Time()) == made()
    assert buffer.lookup_transform_full('map', T, 'tool', T, 'map') == made()
    assert buffer.lookup_transform_full_core('map', T, 'tool', T, 'map') == made()
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
    """Since 5 might be meant as seconds."""
    buffer = Buffer()
    for time_like in 5, 5.0, None:
        with pytest.raises(TypeError, match='time must have sec and nanosec, or nanoseconds'):
            buffer.lookup_transform('a', 'b', time_like)  # type: ignore[arg-type]
    buffer.set_transform(made(), 'test')
    with pytest.raises(TypeError, match=r'timeout must have .* Got 1\.0 of type float'):
        buffer.lookup_transform('map', 'tool', T, timeout=1.0)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match='timeout must have'):
        buffer.wait_for_transform_async('map', 'x', T, timeout=1.0)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match='a frame must be a str, got None'):
        buffer.wait_for_transform_async('map', None, T)  # type: ignore[arg-type]


def test_the_cache_time():
    """A Duration, or its message; none that is negative."""
    buffer = Buffer(Duration(seconds=1))
    buffer.set_transform(made(at=Time(seconds=10)), 'test')
    buffer.set_transform(made(at=Time(seconds=8)), 'test')
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
    """Is named, and the buffer stays as it was."""
    buffer, bad = Buffer(), made(child='other')
    buffer.set_transform(made(), 'test')
    break_it(bad)
    with pytest.raises(ValueError, match=error):
        buffer.set_transform(bad, 'test')
    with pytest.raises(TypeError, match='expected a TransformStamped'):
        buffer.set_transform('tool', 'test')
    assert buffer._getFrameStrings() == ['tool', 'map']


def test_a_subclass_may_watch_what_comes_in():
    """By overriding set_transform."""
    class Watching(Buffer):
        seen = 0

        def set_transform(self, transform, authority):  # type: ignore[override]
            self.seen += 1
            return super().set_transform(transform, authority)

    buffer = Watching()
    future = buffer.wait_for_transform_async('map', 'tool', T)
    buffer.set_transform(made(), 'test')
    assert (buffer.seen, future.result()) == (1, made())


@pytest.mark.parametrize(('target', 'source', 'fixed', 'chain'), [
    ('tool', 'eye', 'map', ['eye', 'head', 'base', 'arm', 'tool']),
    ('tool', 'eye', 'head', ['eye', 'head', 'base', 'arm', 'tool']),
    ('map', 'eye', 'map', ['eye', 'head', 'base', 'map']),
    ('eye', 'map', 'map', ['map', 'base', 'head', 'eye']),
    ('eye', 'eye', 'eye', ['eye'])])
def test_the_chain_of_frames(target, source, fixed, chain):
    """From the source to the target, without detour."""
    buffer = Buffer()
    for parent, child in (('map', 'base'), ('base', 'arm'), ('arm', 'tool'), ('base', 'head'),
                          ('head', 'eye')):
        buffer.set_transform(made(parent, child), 'test')
    assert buffer._chain(target, T, source, Time(), fixed) == chain


def test_what_programs_use_although_it_begins_with_an_underscore():
    """Names, and the graph in DOT with all names quoted."""
    buffer = Buffer()
    assert '"no tf data received"' in buffer._allFramesAsDot()
    buffer.set_transform(made('map', 'a "b"'), 'test')
    assert buffer._getFrameStrings() == ['a "b"', 'map']
    assert buffer._frameExists('map')
    assert not buffer._frameExists('nobody')
    assert '"map" -> "a \\"b\\""[label="Broadcaster: test\\n' in buffer._allFramesAsDot(T)


def test_a_subclass_may_look_up_in_its_own_way():
    """By way of the core methods, as tf2_ros does; waits do not go by way of the subclass."""
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
    buffer.set_transform(made(), 'test')
    assert buffer.lookup_transform('map', 'tool', T) == future.result() == made()


def test_an_error_of_a_lookup_goes_to_who_waits():
    """Not to who brings the data, nor to others that wait."""
    class Broken(Buffer):
        broken = False

        def lookup_transform_core(self, target_frame, source_frame, time):
            if self.broken and source_frame == 'tool':
                raise RuntimeError('broken')
            return super().lookup_transform_core(target_frame, source_frame, time)

    buffer = Broken()
    futures = [buffer.wait_for_transform_async('map', name, T) for name in ('tool', 'tip')]
    buffer.broken = True
    buffer.set_transform(made(child='tip'), 'test')
    assert isinstance(futures[0].exception(), RuntimeError)
    assert futures[1].result() == made(child='tip')


def test_a_lookup_waits_for_the_data():
    """Woken by them; what is not enough does not end the wait."""
    buffer = Buffer()
    timers = [later(buffer.set_transform, made(child='other'), 'test'),
              later(buffer.set_transform_static, made(), 'test')]
    began = time.monotonic()
    assert buffer.lookup_transform('map', 'tool', T, timeout=LONG) == made()
    assert time.monotonic() - began < 10.0
    assert buffer.can_transform('map', 'other', T, LONG)
    assert buffer.can_transform_full('map', T, 'other', T, 'map', timeout=LONG)
    for timer in timers:
        timer.join()


def test_a_lookup_waits_no_longer_than_told():
    """And then says what is missing now."""
    buffer = Buffer()
    timer = later(buffer.set_transform, made('other', 'tool'), 'test')
    buffer.set_transform(made('map', 'base'), 'test')
    began = time.monotonic()
    with pytest.raises(ConnectivityException):
        buffer.lookup_transform('map', 'tool', T, timeout=Duration(seconds=0.3))
    assert 0.3 <= time.monotonic() - began < 10.0
    assert not buffer.can_transform('map', 'tool', T, SOON)
    timer.join()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_wait_ends_with_the_program(start, number):
    """On Ctrl-C and on SIGTERM, not after its minute; of the shutdown, or of KeyboardInterrupt."""
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
    """As upstream tests it."""
    buffer = Buffer()
    buffer.set_transform(made(), 'test')
    for coroutine in (buffer.lookup_transform_async('map', 'tool', T),
                      buffer.lookup_transform_full_async('map', T, 'tool', T, 'map')):
        with pytest.raises(StopIteration) as done:
            coroutine.send(None)
        assert done.value.value == made()


def test_a_coroutine_waits_for_what_is_not_there():
    """And goes on when it is."""
    buffer = Buffer()
    coroutines = [buffer.lookup_transform_async('map', 'tool', T),
                  buffer.lookup_transform_full_async('map', T, 'tool', T, 'map')]
    for coroutine in coroutines:
        coroutine.send(None)
    buffer.set_transform(made(), 'test')
    for coroutine in coroutines:
        with pytest.raises(StopIteration) as done:
            coroutine.send(None)
        assert done.value.value == made()
    assert not buffer.has_waiters


def test_a_future_times_out():
    """With what was missing; the thread that saw to it is gone."""
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
    buffer.set_transform(made(), 'test')
    assert full.result() == made()
    for _ in range(200):
        if threading.active_count() == threads:
            break
        time.sleep(0.01)
    assert threading.active_count() == threads


@pytest.mark.parametrize('abandon', ['drop', 'cancel', 'close', 'stop spinning'])
def test_an_abandoned_wait_leaves_nothing_behind(ros, abandon):
    """No future, no thread, no reference to the buffer."""
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
            ros.executor.spin_once(timeout_sec=0.0)  # till then it holds what it has waited for
        if abandon == 'cancel':
            waiting.add_done_callback(lambda _: None)
            waiting.cancel()
            assert not buffer.has_waiters
            buffer.set_transform(made(), 'test')
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
    """However long somebody keeps it."""
    buffer = Buffer()
    future = buffer.wait_for_transform_async('map', 'tool', T)
    buffer.set_transform(made(), 'test')
    gone = weakref.ref(buffer)
    del buffer
    gc.collect()
    assert (gone(), future.result()) == (None, made())


def test_a_future_with_a_callback_needs_no_other_reference():
    """As in tf2_ros."""
    buffer, results = Buffer(), []
    buffer.wait_for_transform_async('map', 'tool', T).add_done_callback(
        lambda future: results.append(future.result()))
    gc.collect()
    buffer.set_transform(made(child='other'), 'test')
    assert results == []
    buffer.set_transform(made(), 'test')
    buffer.set_transform(made(x=1.0), 'test')
    assert results == [made()]


@pytest.mark.parametrize('how', ['callback', 'spun until done'])
def test_an_executor_that_was_shut_down_harms_nobody(ros, how):
    """Neither who brings the data, nor who waits besides."""
    executor, buffer = SingleThreadedExecutor(context=ros.context), Buffer(node=ros.node)
    seen: list[object] = []
    ros.executor.remove_node(ros.node)
    executor.add_node(ros.node)
    first = buffer.wait_for_transform_async('map', 'tool', T)
    second = buffer.wait_for_transform_async('map', 'tool', T)
    if how == 'callback':
        first.add_done_callback(seen.append)
    else:
        executor.spin_until_future_complete(first, 0.01)
    executor.shutdown()
    buffer.set_transform(made(), 'test')
    assert (first.result(), second.result()) == (made(), made())
    assert seen == ([first] if how == 'callback' else [])


def test_hundreds_wait_with_one_thread():
    """And all are told in time, the one that waits longest, too."""
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
    buffer.set_transform(made(), 'test')
    assert all(future.result() == made() for future in waiting)


def test_ended_waits_are_not_kept_for_their_deadlines():
    """Behind one that goes on."""
    buffer = Buffer()
    kept = buffer.wait_for_transform_async('map', 'tool', T, timeout=LONG)
    for _ in range(1000):
        buffer.wait_for_transform_async('map', 'tool', T, timeout=Duration(seconds=60)).cancel()
    assert len(buffer._futures._deadlines) < 50
    assert not kept.done()


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_timeouts_go_on_after_a_callback_that_ended_their_thread():
    """By SystemExit, which rclpy lets through."""
    buffer, done = Buffer(), threading.Event()
    timeout = Duration(seconds=0.5)  # else it might be over before there is a callback
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
    """Neither from their timeouts nor from their answers."""
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
        buffer.set_transform(made(), 'test')
    assert all(future.result() == made() for future in futures)


def test_a_finalizer_may_cancel_a_wait():
    """Wherever the garbage collector finds it, in the midst of another wait's beginning."""
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
    """Look up, insert and wait anew."""
    buffer, seen = Buffer(), []

    def on_tool(future):
        seen.append(future.result().child_frame_id)
        buffer.wait_for_transform_async('map', 'tip', T).add_done_callback(
            lambda future: seen.append(future.result().child_frame_id))
        buffer.set_transform(made('tool', 'tip'), 'test')

    buffer.wait_for_transform_async('map', 'tool', T).add_done_callback(on_tool)
    buffer.set_transform(made(), 'test')
    assert seen == ['tool', 'tip']


def test_an_awaiting_callback_goes_on_when_another_thread_brings_the_data(ros):
    """Although nothing else wakes the executor."""
    buffer = Buffer(node=ros.node)
    results: list[TransformStamped] = []

    async def on_timer():
        timer.cancel()
        results.append(await buffer.lookup_transform_async('map', 'tool', T))

    timer = ros.node.create_timer(0.0, on_timer)
    feeder = threading.Timer(0.3, buffer.set_transform, [made(), 'test'])
    feeder.start()
    began = time.monotonic()
    while not results and time.monotonic() - began < 15:
        ros.executor.spin_once(timeout_sec=15)
    assert time.monotonic() - began < 10
    assert results == [made()]
    feeder.join()


def test_done_callbacks_need_no_executor(ros):
    """They run where the data come in, as in tf2_ros; so a callback may wait for one."""
    buffer, done = Buffer(node=ros.node), threading.Event()
    results: list[bool] = []

    def on_timer():
        timer.cancel()
        buffer.wait_for_transform_async('map', 'tool', T).add_done_callback(
            lambda _: done.set())
        results.append(done.wait(20))

    timer = ros.node.create_timer(0.0, on_timer)
    feeder = later(buffer.set_transform, made(), 'test')
    ros.until(lambda: results)
    assert results == [True]
    feeder.join()


def test_a_callback_that_waits_gets_the_data_of_another_thread(ros):
    """In a single-threaded executor, too."""
    buffer = Buffer(node=ros.node)
    results: list[TransformStamped] = []

    def on_timer():
        timer.cancel()
        results.append(buffer.lookup_transform('map', 'tool', T, timeout=LONG))

    timer = ros.node.create_timer(0.0, on_timer)
    feeder = later(buffer.set_transform, made(), 'test')
    ros.until(lambda: results)
    assert results == [made()]
    feeder.join()


def test_a_clock_that_jumps_back_clears_the_buffer(ros):
    """By a second or more, or to another clock; not by less."""
    clock = ros.node.get_clock()
    buffer = Buffer(node=ros.node)
    clock._set_ros_time_is_active(True)

    def to(seconds):
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))

    to(50)
    buffer.set_transform(made(), 'test')
    buffer.set_transform_static(made('tool', 'tip'), 'test')
    to(49.5)
    to(60)
    assert buffer.can_transform('map', 'tip', T)
    to(58)
    assert not buffer.can_transform('map', 'tip', T)
    assert buffer.can_transform('tool', 'tip', T)
    buffer.set_transform(made(), 'test')
    clock._set_ros_time_is_active(False)
    assert not buffer.can_transform('map', 'tip', T)


def test_a_clock_may_jump_when_the_buffer_is_gone(start):
    """Which the clock does not keep, nor crash on."""
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
    """Messages and rclpy's times, but no node, nothing that waits and nothing that transforms."""
    buffer = MessageBufferCore(Duration(seconds=5))
    buffer.set_transform(made(), 'me')
    buffer.set_transform_static(made('tool', 'tip', x=1.0), 'me')
    assert buffer.lookup_transform_core('map', 'tool', T) == made()
    assert buffer.lookup_transform_full_core('map', T, 'tool', Time(), 'map') == made()
    assert buffer.can_transform_core('map', 'tip', Time()) == (True, '')
    assert buffer.can_transform_full_core('map', T, 'tip', T, 'map') == (True, '')
    is_there, why = buffer.can_transform_core('map', 'tip', Time(seconds=1))
    assert not is_there
    assert 'extrapolation' in why
    assert buffer.get_latest_common_time('map', 'tip') == T
    assert buffer._getFrameStrings() == ['tool', 'map', 'tip']
    assert not hasattr(buffer, 'lookup_transform')
    assert not hasattr(buffer, 'transform')
    with pytest.raises(TypeError, match='expected a TransformStamped'):
        buffer.set_transform('tool', 'me')


def test_a_buffer_without_node_has_a_clock():
    """That of the system."""
    assert type(Buffer().clock) is Clock


@made_at_run_time
def test_without_tf2_msgs_there_is_no_service(ros):
    """Where there is, see test_desktop.py."""
    assert Buffer(node=ros.node).srv is None


def test_refusals_go_to_the_log_of_ros(start):
    """With tf2's words, as a warning of tf2_buffer."""
    process = start('-c', """
from dummy_arm.tf import Buffer
from geometry_msgs.msg import TransformStamped
Buffer().set_transform(TransformStamped(child_frame_id='a'), 'somebody')
""")
    assert process.exit_code() == 0
    assert '[WARN]' in process.output
    assert '[tf2_buffer]: TF_NO_FRAME_ID: Ignoring transform with child_frame_id "a"  from ' \
        'authority "somebody" because frame_id not set' in process.output
