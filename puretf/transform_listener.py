"""Transform listeners like those of tf2_ros: they subscribe to /tf and /tf_static."""

# Before the packages of ROS, to say how to install them.
from puretf._ros.messages import TFMessage

# isort: split
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from time import monotonic
from traceback import format_exception
from types import SimpleNamespace
from typing import Any, Optional, Union
from weakref import ref

from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from puretf._causes.facts import Blocked, Surroundings
from puretf._core.engine import Engine, engine_of
from puretf._core.texts import ThrottledLog
from puretf._ros.graph import blocked_nodes, surroundings
from puretf._ros.listener_thread import ListenerThread, MessageWait, NodeThread, SpinThread
from puretf._ros.other_topics import Ear
from puretf._ros.own_node import OwnNode, OwnSubscription
from puretf._ros.qos import check_node, profile, TF, TF_STATIC
from puretf._ros.rclpy_private import missing_part, subscribe
from puretf._ros.subscription import AUTHORITY, QosMonitor, SubscriptionSource
from puretf._wire.encoding import MalformedMessage
from puretf.buffer_core import BufferCore
from puretf.transform import Transform
from puretf.transform_buffer import TransformBuffer

#: Until a listener is so old (s), it may not have discovered all publishers: Fast DDS announces
#: itself every 3 s.
_DISCOVERY = 4.0


class TransformListener:
    """
    A subscriber to /tf and /tf_static that fills a buffer, as tf2_ros.TransformListener does.

    There are two kinds of listeners. The kind is decided when the listener is created.

    Normally, the listener has its own thread and inserts the messages as bytes. The node need not
    be spun, a lookup uses every message that has arrived, and a lookup in any callback can wait.
    New data wake the executor that spins the node, but at most 10 times a second; a future of the
    buffer that is completed wakes it at once.

    The listener uses two subscriptions of the node, as in tf2_ros, if a subclass overrides
    `callback` or `static_callback`, if the buffer overrides `set_transform` or
    `set_transform_static`, or if the buffer is not one of this package. The executor that spins
    the node then calls `callback` with each message of /tf and `static_callback` with each message
    of /tf_static. A node that is not spun receives nothing, and a lookup that waits in a callback
    of a single-threaded executor waits in vain.

    The listener ends at `unregister()`, `node.destroy_node()`, `rclpy.shutdown()` or Ctrl-C.
    """

    _has_tf = True

    def __init__(self, buffer: Any, node: Node, *, spin_thread: bool = False,
                 qos: Optional[Union[QoSProfile, int]] = None,
                 static_qos: Optional[Union[QoSProfile, int]] = None,
                 tf_topic: str = '/tf', tf_static_topic: str = '/tf_static') -> None:
        """
        Subscribe, and start the thread.

        :param buffer: the buffer that is filled, or any object with the methods `set_transform`
            and `set_transform_static`.
        :param node: the node that subscribes; its remappings apply.
        :param spin_thread: True: if the listener uses subscriptions of the node, a thread spins
            the node. A listener with its own thread needs none, and ignores this.
        :param qos: the QoS profile of the subscription to /tf. An int is the depth of a reliable,
            volatile profile. None means the same as the int 100.
        :param static_qos: the QoS profile of the subscription to /tf_static. An int is the depth
            of a reliable, transient local profile. None means the same as the int 100.
        """
        check_node(node, f'{type(self).__name__}(buffer, node)')
        self.node = node
        self.group = ReentrantCallbackGroup()
        #: The number of messages that the listener's own thread could not decode and has dropped.
        self.malformed = 0
        self._start = monotonic()
        self._log = ThrottledLog(get_logger('tf2_listener').warning)
        self._buffer = buffer
        self._engine: Optional[Engine] = None
        with suppress(TypeError):  # another buffer
            self._engine = engine_of(buffer)
        self._uses_callbacks = (
            self._engine is None
            or _overrides(self, [TransformListener], 'callback', 'static_callback')
            or _overrides(buffer, [TransformBuffer, BufferCore],
                          'set_transform', 'set_transform_static'))
        #: The generation of the data after the last update by the listener's thread.
        self._seen = -1
        self._own = None if self._uses_callbacks or not missing_part() else OwnNode(node)
        #: The subscription to the topic of dynamic transforms; None in a StaticTransformListener.
        self.tf_sub = self._subscribe(
            tf_topic, self.callback, profile(qos, TF)) if self._has_tf else None
        self.tf_static_sub = self._subscribe(
            tf_static_topic, self.static_callback, profile(static_qos, TF_STATIC))
        self._ear = Ear(node)
        self._qos_monitors: list[QosMonitor] = []
        self._thread: NodeThread
        self._source: Any
        if self._uses_callbacks:
            self._thread = SpinThread(node, self.group, self._end, self._release)
            # It has no messages, but blocked lookups give up when it is removed.
            self._source = SimpleNamespace(
                is_alive=node.context.ok, take=list, wake=lambda: None, close=lambda: None)
        else:
            if self._own is None:
                self._qos_monitors += (QosMonitor(each, self._log) for each in self.subscriptions)
            self._thread = ListenerThread(
                node, self.group, self._own or MessageWait(node, self.tf_static_sub, self.tf_sub),
                self._work, self._end, self._release)
            self._source = self._create_source(
                self.tf_static_sub, self.tf_sub, self._on_fault, self._thread.wake)
        if self._engine is not None:
            self._engine.look = partial(_surroundings, ref(self))
            self._engine.find_blocked = partial(_blocked, ref(self))
            self._engine.add_source(self._source)
        if spin_thread or not self._uses_callbacks:
            self._thread.start()

    def _subscribe(self, topic: str, callback: Callable[[TFMessage], None], qos: QoSProfile
                   ) -> Any:
        if self._uses_callbacks:
            return self.node.create_subscription(
                TFMessage, topic, callback, qos, callback_group=self.group)
        if self._own:
            return OwnSubscription(self._own, TFMessage, topic, qos)
        return subscribe(self.node, TFMessage, topic, callback, qos, self.group)

    def _create_source(self, *args: Any) -> SubscriptionSource:
        return SubscriptionSource(*args)

    def unregister(self) -> None:
        """Stop listening for good."""
        try:
            self._detach()
        finally:
            self._thread.end()

    @property
    def subscriptions(self) -> list[Subscription]:
        """The subscriptions of this listener: static transforms first, then dynamic ones."""
        return [each for each in (self.tf_static_sub, self.tf_sub) if each is not None]

    @property
    def buffer(self) -> Any:
        """The buffer that is filled."""
        return self._buffer

    def _detach(self) -> None:
        """Insert what has arrived, and remove the source."""
        if self._engine is not None:
            self._engine.remove_source(self._source)
            self._engine.after_insertion()

    def _surroundings(self) -> Surroundings:
        """Return what the texts of errors use: the clock and the publishers."""
        assert self._engine is not None  # the texts are those of its errors
        tree = self._engine.tree
        around = surroundings(self.node, self.subscriptions, bool(tree.histories),
                              bool(tree.dynamic()), self._ear.listen)
        return around._replace(is_new=monotonic() < self._start + _DISCOVERY)

    def callback(self, data: TFMessage) -> None:
        """Insert a message of /tf; called only if the listener uses subscriptions of the node."""
        for transform in data.transforms:
            self._buffer.set_transform(self._converted(transform), AUTHORITY)

    def static_callback(self, data: TFMessage) -> None:
        """Insert a message of /tf_static; called in the same case as `callback`."""
        for transform in data.transforms:
            self._buffer.set_transform_static(self._converted(transform), AUTHORITY)

    def _converted(self, message: TransformStamped) -> Union[TransformStamped, Transform]:
        """Convert a transform to the type that `set_transform` of the buffer takes."""
        is_ours = isinstance(self._buffer, TransformBuffer)
        return Transform.from_message(message) if is_ours else message

    def _work(self) -> tuple[bool, bool, float]:
        """Insert the messages that have arrived; the `work` of a ListenerThread."""
        for monitor in self._qos_monitors:
            monitor.check()
        assert self._engine is not None  # as always without callbacks
        before, is_urgent = self._seen, False
        try:
            self._seen = self._engine.update()
            if self._seen != before:
                is_urgent = self._engine.after_insertion()
        except BaseException as error:  # such as that of a done callback of a future
            self._on_fault(error)
        pause = self._source.next_pause()
        self._log.flush()
        return self._seen != before, is_urgent, 0.0 if self._engine.is_awaited else pause

    def _on_fault(self, error: BaseException) -> None:
        """Count malformed messages, and log each kind once; log other errors once a second."""
        if isinstance(error, MalformedMessage):
            self.malformed += 1
            self._log.warn(str(error).partition(':')[0], (
                f'Dropped a message that cannot be decoded, {error}. Further messages with '
                'this fault are dropped silently.'))
        elif self._log.is_due('error'):
            self._log.write(''.join(format_exception(error)))

    def _end(self) -> None:
        try:
            self._detach()
        except BaseException as error:  # raised by a done callback of a future
            self._on_fault(error)
        self._log.flush()

    def _release(self) -> None:
        """Destroy the subscriptions; called by the thread that ends the listener."""
        for monitor in self._qos_monitors:
            monitor.close()
        for subscription in self.subscriptions:
            self.node.destroy_subscription(subscription)  # if the node knows it
        self._source.close()


class StaticTransformListener(TransformListener):
    """
    A subscriber to static transforms only, as in newer versions of tf2_ros.

    A program that needs no dynamic transforms saves the cost of receiving them. The arguments are
    those of `TransformListener`, of which `qos` and `tf_topic` are for dynamic transforms only.
    """

    _has_tf = False


def _surroundings(reference: ref[TransformListener]) -> Surroundings:
    listener = reference()
    return Surroundings() if listener is None else listener._surroundings()


def _blocked(reference: ref[TransformListener]) -> Mapping[str, Blocked]:
    listener = reference()
    if listener is not None:
        with suppress(Exception):  # the node is destroyed
            return blocked_nodes(listener.node)
    return {}


def _overrides(instance: Any, bases: list[type], *names: str) -> bool:
    """Return True if a method of one of these names overrides that of the bases."""
    own = [getattr(base, name) for base in bases for name in names]
    return any(getattr(getattr(instance, name), '__func__', None) not in own for name in names)
