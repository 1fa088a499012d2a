"""Listening to /tf and /tf_static: what comes in goes into a buffer."""

from collections.abc import Callable
from functools import partial, wraps
from threading import get_ident, RLock
from traceback import format_exception
from typing import Any, Optional, Union

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from dummy_arm.tf import wire
from dummy_arm.tf.buffer import Buffer
from dummy_arm.tf.buffer_core import BufferCore
from dummy_arm.tf.feed import AUTHORITY, Feed
from dummy_arm.tf.listening import Listening
from dummy_arm.tf.message import TFMessage
from dummy_arm.tf.qos import profile
from dummy_arm.tf.refusals import Refusals
from dummy_arm.tf.subscribing import Misfits, subscribe, take_all
from dummy_arm.tf.transform_stamped import message_of


class _Callbacks:
    """
    The source of a buffer that a listener fills by callbacks.

    There is nothing to fetch from it; but the buffer knows by it that transforms may come in. If
    the callbacks are those of a subclass, their thread does not run before the constructor of the
    subclass has returned, unless that constructor looks up or waits for a transform.
    """

    def __init__(self, buffer: BufferCore, listening: Listening) -> None:
        self._buffer, self._listening, self._thread_id = buffer, listening, get_ident()

    def begin(self) -> None:
        """Add this to the sources of the buffer."""
        self._buffer.add_source(self)

    def end(self) -> None:
        """Remove this from the sources of the buffer."""
        self._buffer.remove_source(self)

    def fetch(self) -> None:
        """Start the listener's thread, if it is the constructor that looks up or waits."""
        if get_ident() == self._thread_id:
            self._listening.start()

    hurry = fetch

    def abandon(self) -> None:
        """Do nothing: in a process that was forked, there is no such thread."""


class TransformListener:
    """
    Fills a buffer with what is sent on /tf and /tf_static, as the class of this name in tf2_ros.

    A thread of its own takes the messages, so that they come in while callbacks of the node run
    or wait, and whether the node is spun or not. They are taken as bytes and go straight into
    the buffer; a lookup has all that has arrived by then. The executor that spins the node is
    woken by new data, but at most 10 times a second.

    It listens until `unregister()`, `node.destroy_node()` or `rclpy.shutdown()`.

    A subclass may override `callback` and `static_callback`. The thread calls them after the
    constructor of the subclass has returned; or as soon as that constructor looks up a transform
    in the buffer, or waits for one.
    """

    feed_class: Callable[..., Feed] = Feed
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
                if hasattr(self, '_listening'):
                    self.unregister()
                raise
            if hasattr(self, '_listening'):  # else TransformListener's constructor was not called
                self._listening.start()

        cls.__init__ = cls._starting_constructor = construct_and_start  # type: ignore

    def __init__(self, buffer: Buffer, node: Node, *, spin_thread: bool = False,
                 qos: Optional[Union[QoSProfile, int]] = None,
                 static_qos: Optional[Union[QoSProfile, int]] = None) -> None:
        """
        Begin to listen.

        :param buffer: what is filled: a Buffer or BufferCore, or whatever has `set_transform` and
            `set_transform_static`. Those are called, from the thread, if they are not Buffer's.
        :param node: the node that subscribes; its remappings apply.
        :param spin_thread: no matter: there is a thread in any case, and it never spins the node.
        :param qos: profile or depth for /tf; None: reliable, volatile, the last 100.
        :param static_qos: profile or depth for /tf_static; None: a depth of 100. Unless a profile
            says otherwise it is reliable and transient local.
        """
        self.node = node
        self.group = ReentrantCallbackGroup()
        self.tf_sub = subscribe(node, '/tf', self.callback, profile(qos, 100), self.group)
        self.tf_static_sub = subscribe(
            node, '/tf_static', self.static_callback,
            profile(static_qos, 100, durability=DurabilityPolicy.TRANSIENT_LOCAL), self.group)
        self._misfits = Misfits(self.tf_sub), Misfits(self.tf_static_sub)
        #: How many messages could not be decoded, and were dropped.
        self.malformed = 0
        self._faults = Refusals()
        self._faults.log = get_logger('tf2_listener').warning
        self._listening = Listening(node, self.group, self.tf_static_sub, self.tf_sub,
                                    self._take, self._close, self._holds_lock)
        self._source: Union[Feed, _Callbacks, None] = None
        #: Held for a moment, in which no other lock is taken; reentrant, since a signal handler or
        #: the garbage collector may end the listener just then.
        self._switching = RLock()
        self._buffer: Any = None
        self.buffer = buffer
        if (not self._has_own_callbacks()
                or type(self).__init__ is not type(self)._starting_constructor):
            self._listening.start()

    def unregister(self) -> None:
        """Stop to listen, for good."""
        self._listening.end()
        self._switch(None)

    @property
    def buffer(self) -> Any:
        """What is filled."""
        return self._buffer

    @buffer.setter
    def buffer(self, buffer: Any) -> None:
        if buffer is self._buffer:
            return
        self._buffer = buffer
        if not isinstance(buffer, BufferCore):
            self._switch(None)
        elif self._has_own_callbacks() or _has_own_setters(buffer):
            self._switch(_Callbacks(buffer, self._listening))
        else:
            self._switch(self.feed_class(
                buffer, self.tf_sub, self.tf_static_sub, self._listening, self._on_fault))

    def _switch(self, source: Union[Feed, _Callbacks, None]) -> None:
        """Remove the present source from its buffer, and add another one to its own."""
        with self._switching:
            if self._listening.has_ended:
                source = None
            before, self._source = self._source, source
        if before is not None:
            before.end()
        if source is not None:
            source.begin()
            if self._source is not source or self._listening.has_ended:  # meanwhile
                source.end()

    def _has_own_callbacks(self) -> bool:
        """Return whether a callback is overridden."""
        return {getattr(self.callback, '__func__', None),
                getattr(self.static_callback, '__func__', None)} != {
                    TransformListener.callback, TransformListener.static_callback}

    def _holds_lock(self) -> bool:
        return isinstance(self._buffer, BufferCore) and self._buffer.is_held

    def callback(self, data: TFMessage) -> None:
        """Set the transforms of a message, as moving ones."""
        for transform in data.transforms:
            self._buffer.set_transform(transform, AUTHORITY)

    def static_callback(self, data: TFMessage) -> None:
        """Set the transforms of a message, as static ones."""
        for transform in data.transforms:
            self._buffer.set_transform_static(transform, AUTHORITY)

    def _take(self) -> tuple[bool, float]:
        """Take what has arrived; tell whether there is news, and how long to pause then (s)."""
        for misfits in self._misfits:
            misfits.look()
        source = self._source
        taken = source.take() if isinstance(source, Feed) else self._call_back()
        self._faults.log_all()
        return taken

    def _call_back(self) -> tuple[bool, float]:
        has_news = False
        for subscription, callback in ((self.tf_static_sub, self.static_callback),
                                       (self.tf_sub, self.callback)):
            arrived: list[bytes] = []
            take_all(subscription, arrived)
            for data in arrived:
                has_news = True
                try:
                    callback(TFMessage(transforms=[*map(message_of, wire.unpack(data))]))
                except BaseException as error:  # SystemExit, too, is not of this thread
                    self._on_fault(error)
        return has_news, 0.0

    def _on_fault(self, error: BaseException) -> None:
        """Count a malformed message, and tell of its kind once; of other errors once a second."""
        if isinstance(error, wire.MalformedMessage):
            self.malformed += 1
            self._faults.tell_once(str(error).partition(':')[0], (
                f'Dropped a message that cannot be decoded, {error}. Others of this kind are '
                'dropped without a word.'))
        else:
            self._faults.tell(''.join(format_exception(error)))

    def _close(self) -> None:
        """Let go of the subscriptions."""
        self._switch(None)
        for misfits in self._misfits:
            misfits.close()
        self.tf_sub.destroy()
        self.tf_static_sub.destroy()


def _has_own_setters(buffer: BufferCore) -> bool:
    """Return whether a method between the messages and the buffer is overridden."""
    own = {BufferCore.insert, *(getattr(kind, name) for kind in (BufferCore, Buffer)
                                for name in ('set_transform', 'set_transform_static'))}
    return not all(getattr(method, '__func__', None) in own for method in (
        buffer.insert, buffer.set_transform, buffer.set_transform_static))
