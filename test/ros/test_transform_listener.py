"""The TransformListener, over DDS."""

from contextlib import suppress
import gc
import signal
import threading
import time
from types import SimpleNamespace

from endings import check_end, end_in_every_order, without_library_lines
from geometry_msgs.msg import TransformStamped
from messages import golden_messages, ignore
from processes import TIMEOUT
import pytest
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle, InvalidTopicNameException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
import ros_node
from ros_node import eventually, LATCHED, run_in_thread, when_awaited
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from puretf import (
    Buffer,
    BufferCore,
    LookupException,
    StaticTransformBroadcaster,
    StaticTransformListener,
    TFMessage,
    TransformBroadcaster,
    TransformBuffer,
    TransformException,
    TransformListener,
)
from puretf._core.engine import engine_of
from puretf._ros.listener_thread import ListenerThread, MessageWait
from puretf._ros.rclpy_private import subscribe
from puretf._ros.subscription import SubscriptionSource

LATEST = Time()
WAIT = Duration(seconds=TIMEOUT)


def stamped(stamp=0, parent='map', child='robot', x=0.0):
    """Return a TransformStamped without rotation; the stamp is in ns, x in m."""
    return ros_node.stamped(parent, child, stamp, x)


def at(stamp):
    """Return a time (ns)."""
    return Time(nanoseconds=stamp)


class Sender:
    """The broadcasters of the test's node."""

    def __init__(self, node):
        """Create the broadcasters."""
        self._node = node
        self.dynamic, self.static = TransformBroadcaster(node), StaticTransformBroadcaster(node)

    def publish(self, *messages):
        """Publish messages on /tf, when each subscription is connected."""
        publisher = self.dynamic.pub_tf
        eventually(lambda: 0 < self._node.count_subscribers('/tf')
                   == publisher.get_subscription_count())
        for message in messages:
            publisher.publish(message)

    def send(self, *transforms):
        """Publish one message on /tf, when each subscription is connected."""
        self.publish(TFMessage(transforms=transforms))

    def flood(self, count=50):
        """Send transforms for /tf so fast that the listener's thread pauses."""
        for stamp in range(1, count + 1):
            self.send(stamped(stamp))
            time.sleep(0.002)


@pytest.fixture
def sender(ros):
    """The broadcasters of the test's node."""
    return Sender(ros.node)


@pytest.fixture
def listen(ros):
    """Return a function that creates a buffer and its listener."""
    listeners = []

    def create(node=None, buffer=None, kind=TransformListener, **kwargs):
        node = node or ros.node
        buffer = Buffer(node=node) if buffer is None else buffer
        listeners.append(kind(buffer, node, **kwargs))
        return buffer, listeners[-1]

    yield create
    for listener in listeners:
        listener.unregister()


def late(buffer):
    """Let the listener's thread insert nothing, so that only lookups do; return the buffer."""
    engine = engine_of(buffer)
    update = engine.update

    def update_unless_listener():
        if threading.current_thread() in threads_of_listeners():
            time.sleep(0.005)
            return 0
        return update()

    vars(engine)['update'] = update_unless_listener
    return buffer


def threads_of_listeners():
    """Return the threads of the listeners of nodes with the name `test`."""
    return [thread for thread in threading.enumerate() if thread.name == 'tf of test']


# Lookups, waits and the executor


@pytest.mark.parametrize(('where', 'spin_thread'), [
    ('timer', False), ('subscription', True), ('service', False)])
def test_a_lookup_waits_inside_a_callback(ros, sender, listen, where, spin_thread):
    """The lookup succeeds although a single-threaded executor spins nothing else meanwhile."""
    buffer, _ = listen(spin_thread=spin_thread)
    answers: list[TransformStamped] = []

    def wait(*_):
        if not answers:
            answers.append(buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT))

    if where == 'timer':
        ros.node.create_timer(0.01, wait)
    elif where == 'subscription':
        ros.node.create_subscription(Empty, 'go', wait, 10)
        publisher = ros.node.create_publisher(Empty, 'go', 10)
        ros.until(publisher.get_subscription_count)
        publisher.publish(Empty())
    else:
        ros.node.create_service(Trigger, 'go', lambda _, answer: wait() or answer)
        client = ros.node.create_client(Trigger, 'go')
        assert client.wait_for_service(TIMEOUT)
        client.call_async(Trigger.Request())
    feeding = when_awaited(buffer, lambda: sender.send(stamped(1)))
    ros.until(lambda: answers, 2 * TIMEOUT)
    assert answers[0].child_frame_id == 'robot'
    feeding.join()


def test_spin_once_returns_when_transforms_arrive(ros, sender, listen):
    """The transforms alone end a spin_once without a timeout: nothing else happens in the node."""
    buffer, _ = listen()
    is_over = threading.Event()

    def send():
        stamp = 1
        while not is_over.wait(0.01):
            sender.send(stamped(stamp))
            stamp += 1

    def spin():
        executor = SingleThreadedExecutor(context=ros.context)
        executor.add_node(ros.node)
        while not buffer.can_transform('map', 'robot', LATEST):
            executor.spin_once()
        for _ in range(5):
            executor.spin_once()
        executor.shutdown()
        return True

    sending = threading.Thread(target=send)
    sending.start()
    try:
        run_in_thread(spin)
    finally:
        is_over.set()
        sending.join()


def test_new_data_wake_the_executor_at_most_ten_times_a_second(ros):
    """A future that is done wakes it at once; a wake-up that is put off is made up for."""
    now, rounds, wakes = 100.0, [], []
    results: list[tuple[bool, bool, float]] = []

    def work():
        rounds.append(now)
        return results.pop() if results else (False, False, 0.0)

    tf, tf_static = (subscribe(ros.node, TFMessage, topic, ignore, LATCHED,
                               ros.node.default_callback_group) for topic in ('/tf', '/tf_static'))
    before = {*ros.node.guards}
    thread = ListenerThread(
        ros.node, ros.node.default_callback_group, MessageWait(ros.node, tf_static, tf), work,
        ignore, ignore, lambda: now)
    (guard,) = {*ros.node.guards} - before
    guard.trigger = lambda: wakes.append(now)

    def wakes_after(has_news, is_urgent):
        results.append((has_news, is_urgent, 0.0))
        number = len(rounds)
        while results or len(rounds) < number + 2:  # the last round with a result is over
            thread.wake()
            time.sleep(0.001)
        return wakes

    thread.start()
    assert wakes_after(False, False) == []
    assert wakes_after(True, False) == [100.0]
    now = 100.09
    assert wakes_after(True, False) == [100.0]
    now = 100.11
    assert wakes_after(False, False) == [100.0, 100.11]
    assert wakes_after(True, True) == [100.0, 100.11, 100.11]
    thread.end()
    tf.destroy()
    tf_static.destroy()


@pytest.mark.parametrize('with_node', [True, False])
def test_async_waits_end_while_the_node_is_spun(ros, sender, listen, with_node):
    """A coroutine continues after the data arrive, even if the buffer has no node."""
    buffer, _ = listen(buffer=Buffer(node=ros.node if with_node else None))
    found = []

    async def look_up():
        transform = await buffer.lookup_transform_async('map', 'robot', LATEST)
        found.append((transform, buffer.lookup_transform('map', 'robot', LATEST)))

    ros.executor.create_task(look_up)
    ros.executor.spin_once(timeout_sec=0.0)
    sender.send(stamped(1))
    ros.until(lambda: found)
    assert found[0][0].child_frame_id == 'robot'


def test_a_lookup_has_all_that_has_arrived(sender, listen):
    """It inserts the messages in the queue, which the listener's thread has not taken yet."""
    buffer, _ = listen(buffer=late(Buffer()))
    witness, _ = listen()
    for stamp in range(1, 10):
        sender.send(stamped(stamp))
        eventually(lambda: witness.can_transform('map', 'robot', at(stamp)))  # noqa: B023
        assert buffer.can_transform('map', 'robot', at(stamp))  # DDS sends to the witness last


def test_messages_from_before_a_clear_are_not_inserted_after_it(sender, listen):
    """After a jump back in time, such a message would be newer than all that follow."""
    buffer, _ = listen(buffer=late(Buffer()))
    witness, _ = listen()
    sender.send(stamped(10**12))
    eventually(lambda: witness.can_transform('map', 'robot', LATEST))
    buffer.clear()
    assert not buffer.can_transform('map', 'robot', LATEST)
    sender.send(stamped(10**9))
    eventually(lambda: buffer.can_transform('map', 'robot', at(10**9)))


@pytest.mark.parametrize('spin_thread', [True, False])
def test_a_shutdown_ends_lookups_of_a_listener_that_calls_back(stranger, spin_thread):
    """It does so although the buffer does not know the context."""
    buffer = TransformBuffer()
    listener = Ignoring(buffer, stranger.node, spin_thread=spin_thread)
    found = []
    thread = threading.Thread(target=lambda: found.append(
        buffer.can_transform('map', 'robot', timeout=int(30 * TIMEOUT) * 10**9)))
    thread.start()
    eventually(lambda: engine_of(buffer).is_awaited)
    stranger.context.shutdown()
    thread.join(TIMEOUT)
    assert found == [False]
    listener.unregister()


def test_a_signal_handler_may_look_up(ros, listen):
    """
    Each pose keeps its stamp; there is an error if the handler has interrupted an insertion.

    The timer counts CPU time, so that the thread goes on between two signals on a busy machine.
    """
    buffer, _ = listen()
    prepared = TransformBroadcaster(ros.node).prepare([('map', 'robot')])
    calls: list[bool] = []

    def look_up(*_):
        assert not buffer.can_transform('map', 'nowhere', LATEST, Duration(seconds=0.0001))
        buffer.can_transform('map', 'robot', LATEST)
        with suppress(TransformException):
            buffer.lookup_transforms('map', 'robot', range(0, 10**4, 10**2))
            calls.append(True)
        signal.setitimer(signal.ITIMER_PROF, 0.001)

    stamp = 0

    def send():
        nonlocal stamp
        stamp += 1
        prepared.send(stamp, [[float(stamp), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
        buffer.can_transform('map', 'robot', LATEST)
        return buffer.can_transform('map', 'robot', LATEST)

    eventually(send)
    before = signal.signal(signal.SIGPROF, look_up)
    try:
        signal.setitimer(signal.ITIMER_PROF, 0.001)
        while len(calls) < 100:
            send()
            buffer.lookup_transforms('map', 'robot', [stamp])
    finally:
        signal.signal(signal.SIGPROF, signal.SIG_IGN)  # look_up may start the timer once more
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    eventually(lambda: buffer.can_transform('map', 'robot', at(stamp)))
    for each in range(buffer.frames()[0].oldest, stamp + 1):
        assert buffer.lookup_transform('map', 'robot', at(each)).transform.translation.x == each


def test_a_done_callback_may_wait_and_fail(sender, listen, log_lines):
    """It runs in the listener's thread, which goes on after a SystemExit of the callback."""
    buffer, _ = listen()
    found = []

    def wait(_):
        found.append(threading.current_thread() in threads_of_listeners())
        found.append(buffer.can_transform('map', 'moving', LATEST, timeout=WAIT))
        found.append(buffer.can_transform('map', 'static', LATEST, timeout=WAIT))
        raise SystemExit('of the user')

    buffer.wait_for_transform_async('map', 'robot', LATEST).add_done_callback(wait)
    sender.send(stamped(1))
    eventually(lambda: engine_of(buffer).is_awaited)
    assert found in ([], [True])
    sender.send(stamped(1, child='moving'))
    sender.static.sendTransform(stamped(child='static'))
    eventually(lambda: [line for _, line in log_lines if 'SystemExit: of the user' in line])
    assert found == [True, True, True]
    sender.send(stamped(1, child='next'))
    eventually(lambda: buffer.can_transform('map', 'next', LATEST))


# Topics and their QoS


def test_remappings_and_namespace_apply_as_with_tf2(ros, make_node, listen):
    """The names of the topics are absolute, and can be remapped."""
    buffer, listener = listen(node=make_node('n', namespace='/robot1', cli_args=[
        '--ros-args', '-r', '/tf:=/other/tf', '-r', '/tf_static:=tf_static']))
    assert (listener.tf_sub.topic_name, listener.tf_static_sub.topic_name) == (
        '/other/tf', '/robot1/tf_static')
    assert [*dict(ros.node.get_subscriber_names_and_types_by_node('n', '/robot1'))].count(
        '/other/tf') == 1
    publisher = ros.node.create_publisher(TFMessage, '/other/tf', 10)
    eventually(publisher.get_subscription_count)
    publisher.publish(TFMessage(transforms=[stamped(5)]))
    assert buffer.can_transform('map', 'robot', LATEST, timeout=WAIT)


def test_other_topics(ros, listen):
    """Listeners and broadcasters can use other topics than /tf and /tf_static."""
    buffer, listener = listen(tf_topic='/robot1/tf', tf_static_topic='robot1/tf_static')
    default, _ = listen()
    assert [each.topic_name for each in listener.subscriptions] == [
        '/robot1/tf_static', '/robot1/tf']
    dynamic = TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    static = StaticTransformBroadcaster(ros.node, tf_static_topic='/robot1/tf_static')
    eventually(dynamic.pub_tf.get_subscription_count)
    dynamic.sendTransform(stamped(5))
    static.sendTransform(stamped(0, 'robot', 'camera'))
    assert buffer.can_transform('map', 'camera', LATEST, WAIT)
    assert not default.frame_names()
    for create in TransformListener, StaticTransformListener:
        with pytest.raises(InvalidTopicNameException, match="must not contain repeated '/'"):
            create(Buffer(), ros.node, tf_static_topic='robot1//tf_static')


def test_a_static_transform_listener(sender, make_node):
    """It receives what was latched before, and never subscribes to /tf."""
    sender.static.sendTransform(stamped(0, 'robot', 'camera'))
    buffer, node = Buffer(), make_node('static_only')
    listener = StaticTransformListener(buffer, node, spin_thread=True, static_qos=LATCHED)
    assert buffer.can_transform('robot', 'camera', LATEST, WAIT)
    assert listener.tf_sub is None
    assert listener.subscriptions == [listener.tf_static_sub]
    topics = {name for name, _ in node.get_subscriber_names_and_types_by_node(
        'static_only', '/')}
    assert '/tf_static' in topics
    assert '/tf' not in topics
    listener.unregister()
    eventually(lambda: not node.count_subscribers('/tf_static'))


def test_qos_is_as_asked(listen):
    """A depth alone leaves /tf_static latched; a profile is used as it is."""
    volatile, latched = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL
    best_effort = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
    for qos, static_qos, expected in (
            (None, None, [(100, ReliabilityPolicy.RELIABLE, latched),
                          (100, ReliabilityPolicy.RELIABLE, volatile)]),
            (7, 8, [(8, ReliabilityPolicy.RELIABLE, latched),
                    (7, ReliabilityPolicy.RELIABLE, volatile)]),
            (best_effort, best_effort, [(3, ReliabilityPolicy.BEST_EFFORT, volatile)] * 2)):
        _, listener = listen(qos=qos, static_qos=static_qos)
        profiles = [each.qos_profile for each in listener.subscriptions]
        assert [(each.depth, each.reliability, each.durability) for each in profiles] == expected
        assert {each.history for each in profiles} == {HistoryPolicy.KEEP_LAST}


@pytest.mark.parametrize('is_overridden', [False, True])
def test_no_executor_sees_the_subscriptions(ros, listen, is_overridden):
    """Unless callbacks are overridden; at its end, the listener leaves nothing in the node."""
    subscriptions, guards = [*ros.node.subscriptions], [*ros.node.guards]
    waitables = [*ros.node.waitables]
    _, listener = listen(kind=Recording if is_overridden else TransformListener)
    own = [listener.tf_sub, listener.tf_static_sub]
    assert [*ros.node.subscriptions] == subscriptions + own * is_overridden
    assert is_overridden or [*ros.node.waitables] == waitables
    assert len([*ros.node.guards]) == len(guards) + 1
    assert [name for name, _ in ros.node.get_node_names_and_namespaces()] == ['test']
    listener.unregister()
    assert [*ros.node.subscriptions] == subscriptions
    assert [*ros.node.guards] == guards


# Faults


@pytest.fixture
def log_lines(monkeypatch):
    """The lines that the listener and the buffer log, each with the name of its logger."""
    lines = []
    monkeypatch.setattr(RcutilsLogger, 'log', lambda self, message, severity, **_: lines.append(
        (self.name, message)))
    return lines


def send_to_the_end(sender, buffer, *messages):
    """Publish messages and one with a new frame; wait until that is in the buffer."""
    mark = f'mark_{time.monotonic_ns()}'
    sender.publish(*messages, TFMessage(transforms=[stamped(1, child=mark)]))
    eventually(lambda: buffer.can_transform('map', mark, LATEST))


def test_malformed_messages_are_counted_and_logged_once_per_cause(sender, listen, log_lines):
    """A valid message that follows is inserted, and a cause is not logged a second time."""
    buffer, listener = listen()
    data = bytes.fromhex(max((case['cdr_hex'] for case in golden_messages()), key=len))
    bad = [data[:end] for end in range(9, len(data) - 8, 41)]
    send_to_the_end(sender, buffer, *bad, data[:4] + bytes([255] * 4) + data[8:],
                    b'\0\7' + data[2:])
    assert listener.malformed == len(bad) + 2
    eventually(lambda: len(log_lines) == 3)
    assert {(name, line.partition(':')[0]) for name, line in log_lines} == {
        ('tf2_listener', f'Dropped a message that cannot be decoded, {cause}')
        for cause in ('impossible count', 'truncated', 'unknown encoding')}
    send_to_the_end(sender, buffer, *bad)
    assert listener.malformed == 2 * len(bad) + 2
    assert len(log_lines) == 3


def test_refusals_are_logged_in_the_words_of_tf2(sender, listen, log_lines):
    """The valid transforms of the message are inserted."""
    buffer, _ = listen()
    sender.send(stamped(1, child='good'), stamped(1, 'self', 'self'), stamped(1, child='better'))
    eventually(lambda: log_lines)
    assert log_lines == [(
        'tf2_buffer', 'TF_SELF_TRANSFORM: Ignoring transform from authority "default_authority" '
        'with frame_id and  child_frame_id "self" because they are the same. Publishers on /tf: '
        '/test.')]
    assert buffer.frame_names() == ['good', 'map', 'better']


def test_a_refusal_is_logged_without_further_messages(sender, listen, log_lines):
    """The refusal is logged although the thread pauses and nobody looks up."""
    listen()
    sender.flood()
    sender.send(stamped(child='map'))
    eventually(lambda: any('TF_SELF_TRANSFORM' in text for _, text in log_lines))


def test_incompatible_qos_is_logged_with_the_remedy(ros, log_lines):
    """Static transforms that are not latched never arrive."""
    listener = TransformListener(Buffer(), ros.node)
    ros.node.create_publisher(TFMessage, '/tf_static', QoSProfile(depth=10))
    words = ("New publisher discovered on topic '/tf_static', offering incompatible QoS. "
             'No messages will be received from it. Last incompatible policy: DURABILITY')
    ros.until(lambda: any(text.startswith(words) for _, text in log_lines))
    listener.unregister()


# Overridden methods, and other buffers


class Recording(TransformListener):
    """A listener that records in which threads its callback runs."""

    def __init__(self, *args, **kwargs):
        """Create an empty list of threads."""
        self.threads = []
        super().__init__(*args, **kwargs)

    def callback(self, data):
        """Insert the transforms, and record the thread."""
        self.threads.append(threading.current_thread())
        super().callback(data)


@pytest.mark.parametrize('name', ['set_transform', 'set_transform_static'])
def test_overridden_setters_of_a_buffer_are_called(ros, sender, listen, name):
    """Each of them makes the listener call the setters for each transform."""
    frames = []

    def method(self, *arguments):
        frames.append(arguments[0].child_frame_id)
        return getattr(Buffer, name)(self, *arguments)

    buffer, _ = listen(buffer=type('Own', (Buffer,), {name: method})(node=ros.node))
    sender.static.sendTransform([stamped(child='a'), stamped(child='b')])
    sender.send(stamped(1, child='c'), stamped(1, child='d'))
    expected = {'set_transform': 'cd', 'set_transform_static': 'ab'}
    ros.until(lambda: sorted(frames) == [*expected[name]])
    ros.until(lambda: len(buffer.frames()) == 4)


def test_an_object_with_setters_is_filled(ros, sender, listen):
    """It need not be a buffer; the authority is the default one."""
    dynamic: list[object] = []
    static: list[object] = []
    listen(buffer=SimpleNamespace(
        set_transform=lambda *each: dynamic.append(each),
        set_transform_static=lambda *each: static.append(each)))
    sender.static.sendTransform([stamped(child='a'), stamped(child='b')])
    sender.send(stamped(1, child='c'))
    ros.until(lambda: dynamic and len(static) == 2)
    assert static == [(stamped(child=name), 'default_authority') for name in 'ab']
    assert dynamic == [(stamped(1, child='c'), 'default_authority')]


@pytest.mark.parametrize('base', [TransformListener, StaticTransformListener])
@pytest.mark.parametrize('kind', [Buffer, BufferCore, TransformBuffer])
def test_overridden_callbacks_are_called(ros, sender, listen, base, kind):
    """The base callbacks pass messages to a Buffer, and a Transform to a TransformBuffer."""
    class Own(base):  # type: ignore[misc, valid-type]
        def __init__(self, *args):
            super().__init__(*args)
            self.name = 'callback'

        def callback(self, data):
            received.append((self.name, data.transforms))
            super().callback(data)

        def static_callback(self, data):
            received.append(('static_callback', data.transforms))
            super().static_callback(data)

    received: list[tuple[str, list[TransformStamped]]] = []
    buffer, _ = listen(buffer=kind(), kind=Own)
    sender.static.sendTransform(stamped(child='static'))
    ros.until(lambda: received == [('static_callback', [stamped(child='static')])])
    if base is TransformListener:
        sender.send(stamped(5, x=2.0))
        ros.until(lambda: received[1:] == [('callback', [stamped(5, x=2.0)])])
        ros.until(lambda: len(buffer.frames()) == 2)
        assert buffer.dump()['robot']['poses'][0][0] == 2.0
    assert buffer.dump()['static']['is_static']


def test_without_a_spin_the_callbacks_are_not_called(ros, sender, listen):
    """As with tf2_ros: a lookup waits in vain, also in a callback of the executor."""
    answers = []

    def wait():
        answers.append(buffer.can_transform('map', 'robot', at(1), Duration(seconds=0.1)))
        timer.cancel()

    buffer, _ = listen(kind=Recording)
    sender.send(stamped(1))
    assert not buffer.can_transform('map', 'robot', LATEST, Duration(seconds=0.3))
    timer = ros.node.create_timer(0.0, wait)
    ros.until(lambda: answers)
    ros.until(lambda: buffer.can_transform('map', 'robot', LATEST))


@pytest.fixture
def own(make_node):
    """A node whose name is that of the test's node, in a namespace."""
    return make_node('test', namespace='/own')


@pytest.mark.parametrize('end', ['unregister', 'destroy_node', 'shutdown'])
def test_a_thread_spins_the_node_until_the_end(stranger, sender, end):
    """It calls the callbacks, and other callbacks of the node; then the thread ends."""
    node, is_spun = stranger.node, threading.Event()
    node.create_timer(0.0, is_spun.set)
    buffer = Buffer(node=node)
    listener = Recording(buffer, node, spin_thread=True)
    sender.send(stamped(1))
    assert buffer.can_transform('map', 'robot', LATEST, WAIT)
    assert {*listener.threads} == {*threads_of_listeners()}
    assert is_spun.wait(TIMEOUT)
    {'unregister': listener.unregister, 'destroy_node': node.destroy_node,
     'shutdown': stranger.context.shutdown}[end]()
    eventually(lambda: not threads_of_listeners())
    listener.unregister()


def test_a_callback_may_end_the_listener_and_its_node(ros, sender, own):
    """It runs in the thread that spins the node, which ends afterwards."""
    class Ending(TransformListener):
        def callback(self, data):
            self.unregister()
            own.destroy_node()

    Ending(Buffer(node=own), own, spin_thread=True)
    sender.send(stamped(1))
    eventually(lambda: not threads_of_listeners())
    assert not ros.node.count_subscribers('/tf')


@pytest.mark.parametrize('is_destroyed', [True, False])
def test_a_destroyed_handle_is_an_error_only_if_the_node_lives(own, monkeypatch, is_destroyed):
    """`destroy_node` destroys publishers first, and long before it tells the listener."""
    errors = []
    monkeypatch.setattr(threading, 'excepthook', lambda args: errors.append(args.exc_type))
    Recording(Buffer(node=own), own, spin_thread=True)
    (thread,) = threads_of_listeners()
    publisher = own.create_publisher(Empty, 'used', 10)
    own.create_timer(0.0, lambda: publisher.publish(Empty()))
    service = own.create_service(Trigger, 'slow', ignore)
    destroy = service.destroy
    service.destroy = lambda: (thread.join(TIMEOUT), destroy())
    if is_destroyed:
        own.destroy_node()
    else:
        own.destroy_publisher(publisher)
        thread.join(TIMEOUT)
    assert not thread.is_alive()
    assert errors == [InvalidHandle] * (not is_destroyed)


# The source and the pauses of the thread


@pytest.mark.parametrize(('depth', 'messages', 'seconds', 'expected'), [
    (100, 50, 0.1, 0.1),  # 500 Hz
    (100, 50, 0.05, 0.05),  # 1000 Hz
    (100, 50, 0.005, 0.005),  # 10 000 Hz
    (100, 76, 0.1, 0.0),  # more may have been lost
    (6, 4, 0.01, 0.0075), (1, 1, 0.001, 0.0),
    (100, 9, 0.1, 0.0),  # 90 Hz
    (100, 11, 0.1, 0.1), (100, 0, 0.1, 0.0)])
def test_in_a_pause_half_of_the_queue_stays_free(ros, depth, messages, seconds, expected):
    """The pause follows from the rate since the last round; up to 100 Hz there is no pause."""
    class Source(SubscriptionSource):
        """A source to which messages have come."""

        def _take(self, subscription):
            return [] if subscription.is_static else [(b'', None)] * messages

    now = 1000.0
    tf, tf_static = (subscribe(ros.node, TFMessage, topic, ignore, QoSProfile(depth=depth),
                               ros.node.default_callback_group) for topic in ('/tf', '/tf_static'))
    source = Source(tf_static, tf, ignore, ignore, lambda: now)
    source.take()
    now += seconds
    assert source.next_pause() == pytest.approx(expected)
    assert source.next_pause() == 0.0
    source.close()


# Ends


def test_a_listener_that_nobody_holds_goes_on(ros, sender):
    """As with tf2_ros, a listener receives messages although the user keeps no reference to it."""
    buffer = Buffer(node=ros.node)
    TransformListener(buffer, ros.node)
    gc.collect()
    sender.send(stamped(1))
    assert buffer.can_transform('map', 'robot', LATEST, timeout=WAIT)


def test_nothing_is_inserted_after_the_end(sender, listen):
    """Neither the thread nor a lookup inserts a message; another listener of the node goes on."""
    buffer, listener = listen()
    witness, _ = listen()
    sender.send(stamped(1))
    assert buffer.can_transform('map', 'robot', LATEST, timeout=WAIT)
    listener.unregister()
    eventually(lambda: len(threads_of_listeners()) == 1)
    sender.send(stamped(2))
    assert witness.can_transform('map', 'robot', at(2), timeout=WAIT)
    assert buffer.dump()['robot']['stamps'] == [1]


@pytest.mark.parametrize('end', ['unregister', 'destroy_node'])
def test_all_that_had_arrived_is_there_after_the_end(sender, own, listen, end):
    """Messages that are still in the queue are inserted at the end."""
    buffer, listener = listen(node=own, buffer=late(Buffer(node=own)))
    witness, _ = listen()
    for stamp in range(1, 21):
        sender.send(stamped(stamp))
    eventually(lambda: witness.can_transform('map', 'robot', at(20)))  # DDS sends to it last
    del engine_of(buffer).update
    if end == 'unregister':
        listener.unregister()
    own.destroy_node()
    eventually(lambda: len(threads_of_listeners()) == 1)
    assert buffer.get_latest_common_time('map', 'robot') == at(20)


def test_a_shutdown_without_callbacks_ends_the_spin(stranger):
    """Ctrl-C shuts down this way, which does not always wake an executor that is spinning."""
    listener = TransformListener(Buffer(node=stranger.node), stranger.node)
    is_spinning = threading.Event()

    def shut_down():
        is_spinning.wait()
        time.sleep(0.5)  # it is likely that the executor waits by then
        stranger.context.handle.shutdown()  # this calls no shutdown callbacks

    def spin():
        with pytest.raises(ExternalShutdownException):
            stranger.executor.spin()
        return True

    stranger.executor.create_task(is_spinning.set)
    thread = threading.Thread(target=shut_down)
    thread.start()
    assert run_in_thread(spin)
    thread.join()
    listener.unregister()


def test_the_node_name_is_free_at_once_after_destroy_node(ros, capfd):
    """No subscription outlives its node; otherwise rcl warns that the name is in use."""
    for _ in range(5):
        node = Node('again', context=ros.context)
        TransformListener(Buffer(node=node), node)
        node.destroy_node()
    assert ros.node.get_node_names() == ['test']
    assert without_library_lines(capfd.readouterr().err) == ''


@pytest.mark.parametrize('is_own', [True, False])
@pytest.mark.parametrize('end', ['unregister', 'destroy_node'])
def test_an_end_within_a_block_of_the_buffer(sender, own, end, is_own):
    """The call returns, unless it waits for the lock of another; the thread ends afterwards."""
    buffer, is_held, is_over = Buffer(node=own), threading.Event(), threading.Event()
    listener = TransformListener(buffer, own)

    def end_it():
        {'unregister': listener.unregister, 'destroy_node': own.destroy_node}[end]()
        return True

    def hold():
        with buffer.updated():
            sender.send(stamped(1))
            if is_own:
                end_it()
            is_held.set()
            is_over.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    try:
        assert is_held.wait(TIMEOUT)
        if not is_own and end == 'destroy_node':  # it does not wait for the lock
            assert run_in_thread(end_it)
    finally:
        is_over.set()
        thread.join()
    end_it()
    eventually(lambda: not threads_of_listeners())


@pytest.mark.parametrize('end', ['unregister', 'destroy_node'])
def test_a_late_thread_destroys_nothing(ros, sender, own, listen, end):
    """The thread that ends the listener destroys the subscriptions, also before the other ends."""
    buffer, listener = listen(node=own)
    is_called, is_over = threading.Event(), threading.Event()

    def wait(_):
        is_called.set()
        is_over.wait(TIMEOUT)

    buffer.wait_for_transform_async('map', 'robot', LATEST).add_done_callback(wait)
    eventually(lambda: ros.node.count_subscribers('/tf') == 1)
    sender.send(stamped(1))
    assert is_called.wait(TIMEOUT)
    {'unregister': listener.unregister, 'destroy_node': own.destroy_node}[end]()
    try:
        eventually(lambda: not ros.node.count_subscribers('/tf'))
        assert threads_of_listeners()
    finally:
        is_over.set()
    eventually(lambda: not threads_of_listeners())


def wait_for_a_retry(buffer):
    """Wait until a blocked lookup has tried once more, which it does every 0.2 s."""
    assert not buffer.can_transform('map', 'nobody', LATEST, timeout=Duration(seconds=0.25))


class Ignoring(TransformListener):
    """A listener that inserts nothing."""

    def callback(self, data):
        """Insert nothing."""


@pytest.mark.parametrize('kind', [TransformListener, Ignoring])
@pytest.mark.parametrize('end', ['unregister', 'destroy_node'])
def test_a_blocked_lookup_ends_when_the_last_listener_ends(make_node, end, kind):
    """The lookup raises its last error then, and not when the first of two listeners ends."""
    node = make_node('ending')
    buffer = Buffer(node=node)
    listeners = [kind(buffer, node), kind(buffer, node)]
    results = []

    def look_up():
        with pytest.raises(LookupException) as error:
            buffer.lookup_transform('map', 'nowhere', LATEST, Duration(seconds=10 * TIMEOUT))
        results.append(str(error.value))

    thread = threading.Thread(target=look_up, daemon=True)
    thread.start()
    eventually(lambda: engine_of(buffer).is_awaited)
    listeners[0].unregister()
    wait_for_a_retry(buffer)
    assert not results
    {'unregister': listeners[1].unregister, 'destroy_node': node.destroy_node}[end]()
    thread.join(TIMEOUT)
    assert '"map" passed to lookupTransform argument target_frame does not exist' in results[0]
    listeners[1].unregister()


def test_a_lookup_that_began_before_any_listener_waits_on(ros, sender, listen):
    """The lookup outlasts the end of a listener that started later, and uses the next one."""
    buffer = Buffer(node=ros.node)
    found = []
    thread = threading.Thread(target=lambda: found.append(
        buffer.lookup_transform('map', 'robot', LATEST, timeout=WAIT)))
    thread.start()
    eventually(lambda: engine_of(buffer).is_awaited)
    TransformListener(buffer, ros.node).unregister()
    wait_for_a_retry(buffer)
    assert thread.is_alive()
    listen(buffer=buffer)
    sender.send(stamped(1))
    thread.join(TIMEOUT)
    assert found


@pytest.mark.parametrize('ending', [KeyboardInterrupt, SystemExit])
def test_ctrl_c_while_a_listener_is_ended_is_not_swallowed(sender, listen, ending):
    """A done callback that runs in the thread which ends the listener raises there."""
    buffer, listener = listen(buffer=late(Buffer()))

    def end(_):
        raise ending

    buffer.wait_for_transform_async('map', 'robot', LATEST).add_done_callback(end)
    sender.send(stamped(1))
    eventually(lambda: buffer.can_transform('map', 'robot', LATEST))  # this completes no future
    with pytest.raises(ending):
        listener.unregister()
    assert not engine_of(buffer).is_held()
    eventually(lambda: not threads_of_listeners())


@pytest.mark.parametrize('where', ['main', 'executor', 'thread'])
def test_every_order_of_ending(domain_id, capfd, where):
    """unregister, destroy_node and shutdown end a listener in any order, in any thread."""
    end_in_every_order(domain_id, where)
    assert without_library_lines(capfd.readouterr().err) == ''


@pytest.mark.parametrize('way', ['end', 'exit', 'spin', 'lookup'])
def test_the_end_of_a_program(start, way):
    """A program ends cleanly by its last line, sys.exit(), and by Ctrl-C in a spin or a lookup."""
    check_end(start, way)
