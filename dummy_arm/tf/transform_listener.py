"""The listener of tf2_ros: it subscribes to /tf and /tf_static and fills a buffer."""

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
    The source of a buffer whose listener calls callbacks: there is nothing to take.

    Its presence tells the buffer that transforms may still come. If the callbacks are those of a
    subclass, the thread that calls them does not run before the constructor of the subclass has
    returned, unless that constructor looks up or waits for a transform.
    """

    def __init__(self, start: Callable[[], None]) -> None:
        self._start, self._thread_id = start, get_ident()

    def take(self) -> list[BatchOrRows]:
        """Return nothing."""
        self.wake()
        return []

    def wake(self) -> None:
        """Start the listener's thread, if it is the constructor that looks up or waits."""
        if get_ident() == self._thread_id:
            self._start()


class TransformListener:
    """
    Fills a buffer with what is published on /tf and /tf_static, as tf2_ros.TransformListener.

    A thread of its own takes the messages, so that they come in while callbacks of the node run
    or wait, and whether the node is spun or not. They are taken as bytes and go straight into
    the buffer; a lookup has everything that has arrived by then. The executor that spins the node
    is woken by new data, but at most 10 times a second.

    It listens until `unregister()`, `node.destroy_node()` or `rclpy.shutdown()`.

    A subclass may override `callback` and `static_callback`. The thread calls them after the
    constructor of the subclass has returned; or as soon as that constructor looks up a transform
    in the buffer, or waits for one.
    """

    #: The constructor of a subclass that starts the thread at its end.
    _starting_constructor: Optional[Callable[..., None]] = None

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Have the constructor of a subclass start the thread when it returns."""
        super().__init_subclass__(**kwargs)
        own = cls.__dict__.get('__init__')

        @wraps(cls.__init__)
        def construct_and_start(self: Any, *args: Any, **kwargs: Any) -> None:
            construct = partial(own, self) if own else super(cls, self).__init__
            if type(self) is not cls:  # this is called by the constructor of a further subclass
                construct(*args, **kwargs)
                return
            try:
                construct(*args, **kwargs)
            except BaseException:
                if hasattr(self, '_thread'):
                    self.unregister()
                raise
            if hasattr(self, '_thread'):  # else TransformListener's constructor was not called
                self._thread.start()

        cls.__init__ = cls._starting_constructor = construct_and_start  # type: ignore

    def __init__(self, buffer: Any, node: Node, *, spin_thread: bool = False,
                 qos: Optional[Union[QoSProfile, int]] = None,
                 static_qos: Optional[Union[QoSProfile, int]] = None,
                 source: Callable[..., SubscriptionSource] = SubscriptionSource) -> None:
        """
        Start to listen.

        :param buffer: what is filled: a Buffer, MessageBufferCore or BufferCore, or any object
            with `set_transform` and `set_transform_static`. These are called by the thread if they
            are overridden.
        :param node: the node that subscribes; its remappings apply.
        :param spin_thread: ignored: there is a thread in any case, and it never spins the node.
        :param qos: profile or depth for /tf; None: reliable, volatile, the last 100.
        :param static_qos: profile or depth for /tf_static; None: a depth of 100. Unless a profile
            says otherwise it is reliable and transient local.
        :param source: makes the source that takes the messages from the subscriptions.
        """
        self.node = node
        self.group = ReentrantCallbackGroup()
        #: How many messages could not be decoded, and were dropped.
        self.malformed = 0
        self._log = ThrottledLog()
        self._log.write = get_logger('tf2_listener').warning
        #: The buffer that is filled; the one that pulls, if it does, and what it pulls from.
        self._buffer: Any = None
        self._attached: Optional[tuple[Engine, Source]] = None
        #: Of the attached buffer, at the last look.
        self._generation = -1
        #: Whether messages are passed to callbacks, since something is overridden.
        self._calls_back = False
        #: Held for a moment, in which no other lock is taken; reentrant, since a signal handler or
        #: the garbage collector may end the listener just then.
        self._switching = RLock()
        self.tf_sub = subscribe(
            node, TFMessage, '/tf', self.callback, profile(qos, 100), self.group)
        self.tf_static_sub = subscribe(
            node, TFMessage, '/tf_static', self.static_callback,
            profile(static_qos, 100, durability=DurabilityPolicy.TRANSIENT_LOCAL), self.group)
        self._qos_monitors = QosMonitor(self.tf_sub), QosMonitor(self.tf_static_sub)
        self._thread = ListenerThread(node, self.group, self.tf_static_sub, self.tf_sub,
                                      self._work, self._close, self._holds_lock)
        self._messages = source(
            self.tf_static_sub, self.tf_sub, self._on_fault, self._thread.wake)
        self._callbacks = _CallbackSource(self._thread.start)
        #: What callbacks are called with, if they are.
        self._topics = Topic(self.tf_static_sub, True), Topic(self.tf_sub, False)
        self.buffer = buffer
        if (not self._has_own_callbacks()
                or type(self).__init__ is not type(self)._starting_constructor):
            self._thread.start()

    def unregister(self) -> None:
        """Stop listening, for good."""
        try:
            self._attach(None)
        finally:
            self._thread.end()

    @property
    def buffer(self) -> Any:
        """The buffer that is filled."""
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
        self._calls_back = self._has_own_callbacks() or _has_own_setters(buffer)
        self._attach((buffer, self._callbacks if self._calls_back else self._messages))

    def _attach(self, attached: Optional[tuple[Engine, Source]]) -> None:
        """Remove the present source from its buffer, then add another one to its buffer."""
        with self._switching:
            if self._thread.has_ended:
                attached = None
            before, self._attached = self._attached, attached
        if before is not None:
            _detach(*before)
        if attached is not None:
            buffer, source = attached
            buffer.add_source(source)
            if self._attached is not attached or self._thread.has_ended:  # in the meantime
                _detach(buffer, source)

    def _has_own_callbacks(self) -> bool:
        """Return whether a callback is overridden."""
        return {getattr(self.callback, '__func__', None),
                getattr(self.static_callback, '__func__', None)} != {
                    TransformListener.callback, TransformListener.static_callback}

    def _holds_lock(self) -> bool:
        return isinstance(self._buffer, Engine) and self._buffer.is_held()

    def callback(self, data: TFMessage) -> None:
        """Set the transforms of a message, as moving ones."""
        for transform in data.transforms:
            self._buffer.set_transform(self._converted(transform), AUTHORITY)

    def static_callback(self, data: TFMessage) -> None:
        """Set the transforms of a message, as static ones."""
        for transform in data.transforms:
            self._buffer.set_transform_static(self._converted(transform), AUTHORITY)

    def _converted(self, message: TransformStamped) -> Union[TransformStamped, Transform]:
        """Return a transform as the buffer takes it."""
        if isinstance(self._buffer, BufferCore):
            return Transform.from_message(message)
        return message

    def _work(self) -> Round:
        """Fill the buffer with what has arrived; the thread calls this."""
        for misfits in self._qos_monitors:
            misfits.look()
        attached, done = self._attached, Round(False, False, 0.0)
        if self._calls_back:
            done = Round(self._call_back(), False, 0.0)
        elif attached is not None:
            buffer, is_urgent = attached[0], False
            generation = buffer.update()
            if has_news := generation != self._generation:
                self._generation = generation
                try:
                    is_urgent = buffer.after_insertion()
                except BaseException as error:  # raised by a done callback
                    self._on_fault(error)
            pause = self._messages.end_round()
            done = Round(has_news, is_urgent, 0.0 if buffer.has_waiters else pause)
        self._log.flush()
        return done

    def _call_back(self) -> bool:
        """Call the callbacks with what has arrived; return whether there was anything."""
        has_news = False
        for topic, callback in zip(self._topics, (self.static_callback, self.callback)):
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
        """Count a malformed message and note its kind once; note other errors once a second."""
        if isinstance(error, cdr.MalformedMessage):
            self.malformed += 1
            self._log.warn_once(str(error).partition(':')[0], (
                f'Dropped a message that cannot be decoded, {error}. Others of this kind are '
                'dropped silently.'))
        else:
            self._log.warn(''.join(format_exception(error)))

    def _close(self) -> None:
        """Release the subscriptions; the thread calls this at its end."""
        buffer = self._buffer
        try:
            self._attach(None)
            if isinstance(buffer, Engine):  # Ctrl-C may have come in the midst of `unregister`
                for source in self._messages, self._callbacks:
                    buffer.remove_source(source)
        except BaseException as error:  # raised by a done callback
            self._on_fault(error)
        self._log.flush()
        for misfits in self._qos_monitors:
            misfits.close()
        self.tf_sub.destroy()
        self.tf_static_sub.destroy()


def _detach(buffer: Engine, source: Source) -> None:
    buffer.remove_source(source)
    buffer.after_insertion()


def _has_own_setters(buffer: Any) -> bool:
    """Return whether `insert` or a setter is overridden."""
    own = {Engine.insert, *(getattr(kind, name) for kind in (BufferCore, MessageBufferCore)
                            for name in ('set_transform', 'set_transform_static'))}
    return not all(getattr(method, '__func__', None) in own for method in (
        buffer.insert, buffer.set_transform, buffer.set_transform_static))
