"""Transform listeners like those of tf2_ros: they subscribe to /tf and /tf_static."""

from collections.abc import Callable
from functools import partial, wraps
from threading import get_ident, RLock
from traceback import format_exception
from typing import Any, Optional, Union

from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from dummy_arm.tf._core.engine import Engine, Source
from dummy_arm.tf._core.pose import BatchOrRows
from dummy_arm.tf._core.texts import ThrottledLog
from dummy_arm.tf._ros.listener_thread import ListenerThread, Round
from dummy_arm.tf._ros.messages import TFMessage
from dummy_arm.tf._ros.qos import profile
from dummy_arm.tf._ros.rclpy_private import subscribe
from dummy_arm.tf._ros.subscription import AUTHORITY, QosMonitor, SubscriptionSource, Topic
from dummy_arm.tf._ros.transform_stamped import deserialize
from dummy_arm.tf._wire import cdr
from dummy_arm.tf.buffer_core import BufferCore
from dummy_arm.tf.message_buffer import MessageBufferCore
from dummy_arm.tf.transform import Transform


class _CallbackSource:
    """
    A source without messages, for a buffer whose listener passes the messages to callbacks.

    This source has two purposes:

    - It makes waiting lookups end when the listener ends: the listener then removes this source,
      and the lookups that wait in a buffer end when the buffer has lost its last source.
    - It starts the listener's thread early if necessary. If a subclass of TransformListener
      overrides a callback, the thread normally starts when the constructor of the subclass has
      returned. But this constructor may look up or wait for a transform. Then the buffer calls
      `take` or `wake`, which starts the thread.
    """

    def __init__(self, start: Callable[[], None]) -> None:
        """
        Create the source in the thread that creates the listener.

        :param start: a function that starts the listener's thread, unless the thread was started
            before.
        """
        self._start, self._thread_id = start, get_ident()

    def take(self) -> list[BatchOrRows]:
        """
        Start the listener's thread, as `wake` does; return no transforms.

        The buffer calls this method at the start of each lookup. The lookup needs the thread,
        because only the thread passes messages to the callbacks, which insert the transforms.

        :returns: an empty list.
        """
        self.wake()
        return []

    def wake(self) -> None:
        """
        Start the listener's thread, if the calling thread has created the listener.

        A call in another thread has no effect. The constructor of a subclass may still be running
        then, and the callbacks may need attributes that the constructor has not set yet.
        """
        if get_ident() == self._thread_id:
            self._start()


class TransformListener:
    """
    A subscriber to /tf and /tf_static that fills a buffer, as tf2_ros.TransformListener does.

    The listener has its own thread. So it receives messages even if the node is not spun, and even
    while a callback of the node runs or waits. Normally, the messages are taken as bytes and
    inserted without conversion to message objects, and a lookup uses every message that has
    arrived.

    New data wake the executor that spins the node, but at most 10 times a second, because each
    wake-up costs 0.1 to 0.3 ms. When a future of the buffer is completed, the executor is woken at
    once.

    The listener ends at `unregister()`, `node.destroy_node()`, `rclpy.shutdown()` or Ctrl-C.

    A subclass may override `callback` and `static_callback`. If it overrides one of them, the
    thread creates message objects. It calls `callback` for each message of /tf, and
    `static_callback` for each message of /tf_static. A lookup then uses only what these two
    methods have inserted. The calls begin when the constructor of the subclass has returned, or as
    soon as this constructor looks up or waits for a transform in the buffer.
    """

    #: The wrapper of a subclass's constructor: it calls the constructor, then starts the thread.
    _starting_constructor: Optional[Callable[..., None]] = None

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """
        Wrap the constructor of a subclass: when the constructor returns, the thread starts.

        :param kwargs: the keyword arguments of the class statement.
        """
        super().__init_subclass__(**kwargs)
        own_init = cls.__dict__.get('__init__')

        @wraps(cls.__init__)
        def construct_and_start(self: Any, *args: Any, **kwargs: Any) -> None:
            """
            Call the constructor of the subclass, then start the thread.

            :param args: the positional arguments of the constructor.
            :param kwargs: the keyword arguments of the constructor.
            """
            construct = partial(own_init, self) if own_init else super(cls, self).__init__
            if type(self) is not cls:  # the constructor of a subclass of `cls` starts the thread
                construct(*args, **kwargs)
                return
            try:
                construct(*args, **kwargs)
            except BaseException:
                if hasattr(self, '_thread'):
                    self.unregister()
                raise
            if hasattr(self, '_thread'):  # False if `TransformListener.__init__` was not called
                self._thread.start()

        cls.__init__ = cls._starting_constructor = construct_and_start  # type: ignore

    def __init__(self, buffer: Any, node: Node, *, spin_thread: bool = False,
                 qos: Optional[Union[QoSProfile, int]] = None,
                 static_qos: Optional[Union[QoSProfile, int]] = None,
                 tf_topic: str = '/tf', tf_static_topic: str = '/tf_static',
                 static_only: bool = False,
                 source: Callable[..., SubscriptionSource] = SubscriptionSource) -> None:
        """
        Subscribe, and start the thread.

        If a subclass overrides a callback, the thread starts later; see the class docstring.

        :param buffer: the buffer that is filled: a Buffer, MessageBufferCore or BufferCore, or any
            object with the methods `set_transform` and `set_transform_static`. If the object is
            not a buffer of this package, the thread calls one of these two methods for each
            transform. The thread does the same for a buffer of this package whose class overrides
            `insert`, `set_transform` or `set_transform_static`.
        :param node: the node that subscribes; its remappings apply.
        :param spin_thread: ignored: the listener always has a thread, which never spins the node.
        :param qos: the QoS profile of the subscription to /tf. An int is the depth of a reliable,
            volatile profile. None means the same as the int 100.
        :param static_qos: the QoS profile of the subscription to /tf_static. An int is the depth
            of a reliable, transient local profile. None means the same as the int 100.
        :param tf_topic: the name of the topic of dynamic transforms.
        :param tf_static_topic: the name of the topic of static transforms.
        :param static_only: True: subscribe to the topic of static transforms only.
        :param source: a function that creates the object that takes messages from the
            subscriptions; for use inside this package only.
        """
        self.node = node
        self.group = ReentrantCallbackGroup()
        #: The number of messages that were dropped because they could not be decoded.
        self.malformed = 0
        self._log = ThrottledLog()
        self._log.write = get_logger('tf2_listener').warning
        self._buffer: Any = None
        #: The buffer to which this listener has added a source, and that source; None: there is
        #: no such buffer.
        self._attached: Optional[tuple[Engine, Source]] = None
        #: The generation of the attached buffer after the last update by this listener. A
        #: generation is a number that grows with each insertion. -1: there was no update yet.
        self._generation = -1
        #: True if messages are passed to the callbacks. There are three cases: the buffer is not
        #: an `Engine`; `_overrides_callbacks` returns True; `_overrides_setters` returns True.
        self._calls_back = False
        #: Held only while `_attached` is replaced; no other lock is taken meanwhile. The lock is
        #: reentrant, because a signal handler or the garbage collector may interrupt the thread
        #: that holds the lock. If they end the listener, the same thread takes the lock again.
        self._attach_lock = RLock()
        #: The subscription to the topic of dynamic transforms; None if `static_only` is True.
        self.tf_sub = None if static_only else subscribe(
            node, TFMessage, tf_topic, self.callback, profile(qos, 100), self.group)
        self.tf_static_sub = subscribe(
            node, TFMessage, tf_static_topic, self.static_callback,
            profile(static_qos, 100, durability=DurabilityPolicy.TRANSIENT_LOCAL), self.group)
        self._qos_monitors = [QosMonitor(each) for each in self.subscriptions]
        self._thread = ListenerThread(node, self.group, self.tf_static_sub, self.tf_sub,
                                      self._work, self._close, self._holds_lock)
        self._messages = source(
            self.tf_static_sub, self.tf_sub, self._on_fault, self._thread.wake)
        self._callbacks = _CallbackSource(self._thread.start)
        #: The topics whose messages are passed to the callbacks, if `_calls_back` is True.
        self._topics = [Topic(each, each is self.tf_static_sub) for each in self.subscriptions]
        self.buffer = buffer
        if (not self._overrides_callbacks()
                or type(self).__init__ is not type(self)._starting_constructor):
            self._thread.start()

    def unregister(self) -> None:
        """Stop listening for good: end the thread, which destroys the subscriptions at its end."""
        try:
            self._attach(None)
        finally:
            self._thread.end()

    @property
    def subscriptions(self) -> list[Subscription]:
        """The subscriptions of this listener: static transforms first, then dynamic ones."""
        return [each for each in (self.tf_static_sub, self.tf_sub) if each is not None]

    @property
    def buffer(self) -> Any:
        """The buffer that is filled; it may be replaced at any time."""
        return self._buffer

    @buffer.setter
    def buffer(self, buffer: Any) -> None:
        if buffer is self._buffer:
            return
        self._buffer, self._generation = buffer, -1
        if not isinstance(buffer, Engine):
            self._calls_back = True
            self._attach(None)
            return
        self._calls_back = self._overrides_callbacks() or _overrides_setters(buffer)
        self._attach((buffer, self._callbacks if self._calls_back else self._messages))

    def _attach(self, attached: Optional[tuple[Engine, Source]]) -> None:
        """
        Remove the current source from the current buffer, then add a source to a new buffer.

        :param attached: the new buffer, and the source that is added to it; None: no new buffer.
        """
        with self._attach_lock:
            if self._thread.has_ended:
                attached = None
            before, self._attached = self._attached, attached
        if before is not None:
            _detach(*before)
        if attached is not None:
            buffer, source = attached
            buffer.add_source(source)
            # Another thread may have replaced `_attached` or ended the listener meanwhile.
            if self._attached is not attached or self._thread.has_ended:
                _detach(buffer, source)

    def _overrides_callbacks(self) -> bool:
        """Return True if `callback` or `static_callback` is overridden."""
        return {getattr(self.callback, '__func__', None),
                getattr(self.static_callback, '__func__', None)} != {
                    TransformListener.callback, TransformListener.static_callback}

    def _holds_lock(self) -> bool:
        """Return True if the calling thread holds the buffer's lock."""
        return isinstance(self._buffer, Engine) and self._buffer.is_held()

    def callback(self, data: TFMessage) -> None:
        """
        Insert the transforms of a message as dynamic transforms.

        :param data: the message, from /tf.
        """
        for transform in data.transforms:
            self._buffer.set_transform(self._converted(transform), AUTHORITY)

    def static_callback(self, data: TFMessage) -> None:
        """
        Insert the transforms of a message as static transforms.

        :param data: the message, from /tf_static.
        """
        for transform in data.transforms:
            self._buffer.set_transform_static(self._converted(transform), AUTHORITY)

    def _converted(self, message: TransformStamped) -> Union[TransformStamped, Transform]:
        """Convert a transform to the type that `set_transform` of the buffer takes."""
        if isinstance(self._buffer, BufferCore):
            return Transform.from_message(message)
        return message

    def _work(self) -> Round:
        """Do one round of the listener's thread: insert new messages, or call the callbacks."""
        for monitor in self._qos_monitors:
            monitor.check()
        attached, result = self._attached, Round(False, False, 0.0)
        if self._calls_back:
            result = Round(self._call_back(), False, 0.0)
        elif attached is not None:
            buffer, is_urgent = attached[0], False
            generation = buffer.update()
            if has_news := generation != self._generation:
                self._generation = generation
                try:
                    is_urgent = buffer.after_insertion()
                except BaseException as error:  # raised by a done callback of a future
                    self._on_fault(error)
            pause = self._messages.end_round()
            result = Round(has_news, is_urgent, 0.0 if buffer.has_waiters else pause)
        self._log.flush()
        return result

    def _call_back(self) -> bool:
        """
        Call the callbacks with the messages that have arrived.

        :returns: True if messages have arrived.
        """
        has_news = False
        for topic in self._topics:
            callback = self.static_callback if topic.is_static else self.callback
            arrived: list[Any] = []
            topic.take(arrived)
            for data, _ in arrived:
                has_news = True
                try:
                    callback(TFMessage(transforms=deserialize(data)))
                except BaseException as error:  # SystemExit, too, must not end this thread
                    self._on_fault(error)
        return has_news

    def _on_fault(self, error: BaseException) -> None:
        """
        Log an error; if a message was malformed, increment `malformed`.

        For malformed messages, each kind of fault is logged once. Other errors are logged at most
        once a second.
        """
        if isinstance(error, cdr.MalformedMessage):
            self.malformed += 1
            self._log.warn_once(str(error).partition(':')[0], (
                f'Dropped a message that cannot be decoded, {error}. Further messages with '
                'this fault are dropped silently.'))
        else:
            self._log.warn(''.join(format_exception(error)))

    def _close(self) -> None:
        """Remove the sources and destroy the subscriptions; called when the listener ends."""
        buffer = self._buffer
        try:
            self._attach(None)
            # If Ctrl-C has interrupted `unregister`, a source may still be in the buffer.
            if isinstance(buffer, Engine):
                for source in self._messages, self._callbacks:
                    buffer.remove_source(source)
        except BaseException as error:  # raised by a done callback of a future
            self._on_fault(error)
        self._log.flush()
        for monitor in self._qos_monitors:
            monitor.close()
        for subscription in self.subscriptions:
            subscription.destroy()


class StaticTransformListener(TransformListener):
    """
    A subscriber to static transforms only, as StaticTransformListener of newer tf2_ros.

    A program that needs no dynamic transforms saves the cost of receiving them.
    """

    def __init__(self, buffer: Any, node: Node, *, spin_thread: bool = False,
                 static_qos: Optional[Union[QoSProfile, int]] = None,
                 tf_static_topic: str = '/tf_static') -> None:
        """
        Subscribe, and start the thread; see `TransformListener`.

        :param buffer: the buffer that is filled; see `TransformListener`.
        :param node: the node that subscribes; its remappings apply.
        :param spin_thread: ignored, as in `TransformListener`.
        :param static_qos: the QoS profile of the subscription, as in `TransformListener`.
        :param tf_static_topic: the name of the topic of static transforms.
        """
        super().__init__(buffer, node, spin_thread=spin_thread, static_qos=static_qos,
                         tf_static_topic=tf_static_topic, static_only=True)


def _detach(buffer: Engine, source: Source) -> None:
    """Remove a source, and complete the futures whose transforms are available now."""
    buffer.remove_source(source)
    buffer.after_insertion()


def _overrides_setters(buffer: Any) -> bool:
    """Return True if a buffer overrides `insert`, `set_transform` or `set_transform_static`."""
    own = {Engine.insert, *(getattr(kind, name) for kind in (BufferCore, MessageBufferCore)
                            for name in ('set_transform', 'set_transform_static'))}
    return not all(getattr(method, '__func__', None) in own for method in (
        buffer.insert, buffer.set_transform, buffer.set_transform_static))
