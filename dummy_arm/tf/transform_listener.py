"""Listening to /tf and /tf_static: what comes in goes into a buffer."""

from collections.abc import Callable
from threading import RLock
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


class TransformListener:
    """
    Fills a buffer with what is sent on /tf and /tf_static, as the class of this name in tf2_ros.

    A thread of its own takes the messages, so that they come in while callbacks of the node run
    or wait, and whether the node is spun or not. They are taken as bytes and go straight into
    the buffer; a lookup has all that has arrived by then. The executor that spins the node is
    woken by new data, but at most 10 times a second.

    It listens until `unregister()`, `node.destroy_node()` or `rclpy.shutdown()`.
    """

    feed_class: Callable[..., Feed] = Feed

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
                                    self._take, self._close)
        self._feed: Optional[Feed] = None
        self._switching = RLock()
        self.buffer = buffer
        self._listening.start()

    def unregister(self) -> None:
        """Stop to listen, for good."""
        self._listening.end()
        self._feed_into(None)

    @property
    def buffer(self) -> Any:
        """What is filled."""
        return self._buffer

    @buffer.setter
    def buffer(self, buffer: Any) -> None:
        with self._switching:
            self._buffer = buffer
            self._feed_into(buffer if self._goes_straight_into(buffer) else None)

    def _feed_into(self, buffer: Optional[BufferCore]) -> None:
        """Feed a buffer, if any, and no other any more."""
        with self._switching:
            feed = self._feed
            self._feed = None if buffer is None or self._listening.has_ended else self.feed_class(
                buffer, self.tf_sub, self.tf_static_sub, self._listening, self._on_fault)
            if feed is not None:
                feed.end()

    def _goes_straight_into(self, buffer: Any) -> bool:
        """Tell whether nobody has put anything of his own between the messages and the buffer."""
        own = {TransformListener.callback, TransformListener.static_callback, BufferCore.insert,
               *(getattr(kind, name) for kind in (BufferCore, Buffer)
                 for name in ('set_transform', 'set_transform_static'))}
        return isinstance(buffer, BufferCore) and all(
            getattr(method, '__func__', None) in own for method in (
                self.callback, self.static_callback, buffer.insert, buffer.set_transform,
                buffer.set_transform_static))

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
        feed = self._feed
        taken = self._call_back() if feed is None else feed.take()
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
        self._feed_into(None)
        for misfits in self._misfits:
            misfits.close()
        self.tf_sub.destroy()
        self.tf_static_sub.destroy()
