"""
The private parts of rclpy and rcl on which this package relies, as of ROS 2 Jazzy (rclpy 7.1).

Each public name of this module relies on some behaviour of rclpy or rcl. A test in
test/test_rclpy_private.py checks this behaviour, and fails if an upgrade of rclpy changes it.
"""

from collections.abc import Callable
import ctypes
from ctypes import byref, c_int64, c_size_t, c_uint8, c_uint64, c_void_p, POINTER
from functools import cache
from typing import Any, Generic, Optional, TypeVar
from weakref import finalize

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import (
    QoSSubscriptionEventType,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.type_support import check_is_valid_msg_type

from dummy_arm.tf._ros.transform_stamped import deserialize, serialize
from dummy_arm.tf._wire.cdr import MalformedMessage

_Message = TypeVar('_Message')

#: The exception that rclpy's compiled part raises for an error code of rcl.
RCLError = _rclpy.RCLError
#: The class of rcl_wait_set_t. The arguments of its constructor are the numbers of subscriptions,
#: guard conditions, timers, clients, services and events, and the context. Its methods are
#: clear_entities, add_subscription, add_guard_condition and wait(timeout in ns).
WaitSet = _rclpy.WaitSet
#: take_message(handle, message type, raw) takes a message, as bytes if `raw` is True. It returns
#: the message and its info, or None if there is no message. `install` replaces the method in
#: rclpy; this name keeps the original method.
take_message = _rclpy.Subscription.take_message


def install(message_type: Any) -> None:
    """
    Make rclpy support a TFMessage class that was created at run time.

    :param message_type: the class TFMessage. If it is the class of tf2_msgs, nothing is changed.
    """
    if not message_type.__module__.startswith('tf2_msgs.'):
        _exchange_bytes(message_type, serialize)


def _exchange_bytes(message_type: Any, serialize: Callable[[Any], bytes]) -> None:
    """
    Make rclpy pass messages of one type to rcl, and take them from rcl, as bytes.

    rclpy's compiled part converts a message with compiled functions of the message's class. A
    class that was created at run time does not have such functions. So messages of this class are
    converted to and from bytes here, when rclpy publishes, takes, serializes or deserializes them.
    Messages of other types are handled as before.

    :param message_type: the class of the messages that are converted here.
    :param serialize: packs a list of TransformStamped into the bytes of a message.
    """
    publish = _rclpy.Publisher.publish
    serialize_other, deserialize_other = _rclpy.rclpy_serialize, _rclpy.rclpy_deserialize
    warned_topics = set()

    def publish_as_bytes(self: Any, message: Any) -> None:
        """
        Publish a message, in place of `Publisher.publish`.

        :param message: a message of any type.
        """
        if isinstance(message, message_type):
            self.publish_raw(serialize(message.transforms))
        else:
            publish(self, message)

    def take_as_bytes(self: Any, taken_type: type, raw: bool) -> Optional[tuple[Any, Any]]:
        """
        Take a message, in place of `Subscription.take_message`; drop it if it is malformed.

        :param taken_type: the class of the message.
        :param raw: True: return the bytes of the message.
        :returns: the message and its info; None if there is no message, or if it is malformed.
        """
        if raw or not issubclass(taken_type, message_type):
            return take_message(self, taken_type, raw)  # type: ignore[no-any-return]
        taken = take_message(self, taken_type, True)
        if taken is None:
            return None
        try:
            return message_type(transforms=deserialize(taken[0])), taken[1]
        except MalformedMessage as error:
            topic = self.get_topic_name()
            if topic not in warned_topics:
                warned_topics.add(topic)
                get_logger('tf').warning(f'dropped a message on {topic}: {error}')
            return None

    def serialize_as_bytes(message: Any, given_type: type) -> bytes:
        """
        Serialize a message, in place of `rclpy_serialize`.

        :param message: a message of any type.
        :param given_type: the class of the message.
        :returns: the bytes of the message.
        """
        if isinstance(message, message_type):
            return serialize(message.transforms)
        return serialize_other(message, given_type)  # type: ignore[no-any-return]

    def deserialize_as_bytes(data: bytes, given_type: type) -> Any:
        """
        Deserialize a message, in place of `rclpy_deserialize`.

        :param data: the bytes of the message.
        :param given_type: the class of the message.
        :returns: the message.
        """
        if issubclass(given_type, message_type):
            return message_type(transforms=deserialize(data))
        return deserialize_other(data, given_type)

    _rclpy.Publisher.publish = publish_as_bytes
    _rclpy.Subscription.take_message = take_as_bytes
    _rclpy.rclpy_serialize = serialize_as_bytes
    _rclpy.rclpy_deserialize = deserialize_as_bytes


def subscribe(node: Node, message_type: type, topic: str, callback: Callable[[Any], None],
              qos: QoSProfile, group: CallbackGroup) -> Subscription:
    """
    Subscribe a node to a topic, for a caller that takes the messages itself.

    The subscription is not in the node's list of subscriptions, so no executor takes its messages.

    :param node: the node.
    :param message_type: the class of the messages.
    :param topic: the name of the topic; the node's remappings apply.
    :param callback: kept as the attribute `callback` of the subscription; never called.
    :param qos: the profile of the subscription.
    :param group: the callback group of the subscription.
    :returns: the subscription.
    """
    # As in create_subscription, this call loads the type support of a generated class.
    check_is_valid_msg_type(message_type)
    with node.handle:
        handle = _rclpy.Subscription(node.handle, message_type, topic, qos.get_c_qos_profile())
    return Subscription(handle, message_type, topic, callback, group, qos, True,
                        SubscriptionEventCallbacks(use_default_callbacks=False))


def incompatible_qos(subscription: Subscription) -> Any:
    """
    Create the event that reports publishers whose QoS is incompatible with a subscription.

    The method `take_event` of the event returns None, or a status with `total_count_change` and
    `last_policy_kind`. The method `destroy_when_not_in_use` releases the event.

    :param subscription: the subscription.
    :returns: the event; None if the middleware does not support it.
    """
    with subscription.handle:
        try:
            return _rclpy.EventHandle(
                subscription.handle,
                QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS)
        except UnsupportedEventTypeError:
            return None


def guard_condition(node: Node, group: CallbackGroup, on_destroy: Callable[[], object]
                    ) -> GuardCondition:
    """
    Create a guard condition that wakes the executor of a node.

    :param node: the node.
    :param group: the callback group of the guard condition.
    :param on_destroy: called before the guard condition is destroyed. `destroy_node` destroys all
        guard conditions of the node, so it calls this function, too. It has no other hook.
    :returns: the guard condition.
    """
    guard = node.create_guard_condition(lambda: None, group)

    def destroy() -> None:
        """Call `on_destroy`, then destroy the guard condition."""
        on_destroy()
        GuardCondition.destroy(guard)

    guard.destroy = destroy  # type: ignore[method-assign]
    return guard


def is_of_executor(callback: Callable[..., Any]) -> bool:
    """
    Return True if a done callback of a future was added by an executor.

    An executor that spins until a future is done adds a done callback to the future. The executor
    refers to the future while it spins, and never removes the callback.

    :param callback: the done callback.
    :returns: True if the callback is defined in the module `rclpy.executors`.
    """
    return callback.__module__ == 'rclpy.executors'


# rcl, by ctypes

#: The code RCL_RET_SUBSCRIPTION_TAKE_FAILED, which means that there is no message.
_TAKE_FAILED = 401
#: The size of a gid (bytes). A gid identifies a publisher. The `endpoint_gid` of a
#: TopicEndpointInfo begins with the gid.
GID_SIZE = 16


class _Allocator(ctypes.Structure):
    """The struct rcutils_allocator_t."""

    _fields_ = [(name, c_void_p) for name in (
        'allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')]


class _Bytes(ctypes.Structure):
    """The struct rcutils_uint8_array_t, which is rcl_serialized_message_t."""

    _fields_ = [('buffer', POINTER(c_uint8)), ('length', c_size_t), ('capacity', c_size_t),
                ('allocator', _Allocator)]


class _MessageInfo(ctypes.Structure):
    """The struct rmw_message_info_t, with room for the longer structs of other releases."""

    _fields_ = [('source_timestamp', c_int64), ('received_timestamp', c_int64),
                ('publication_sequence_number', c_uint64), ('reception_sequence_number', c_uint64),
                ('implementation_identifier', c_void_p), ('gid', c_uint8 * GID_SIZE),
                ('room', c_uint8 * 64)]


@cache
def rcl_take() -> Any:
    """
    Load the function rcl_take_serialized_message.

    :returns: the function; None if librcl.so cannot be loaded or does not have it.
    """
    try:
        take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
    except (OSError, AttributeError):
        return None
    take.argtypes = c_void_p, POINTER(_Bytes), POINTER(_MessageInfo), c_void_p
    return take


class Taker(Generic[_Message]):
    """A reader of messages and the gids of their publishers; rclpy does not report these gids."""

    def __init__(self, make: Callable[[bytes, str, int], _Message]) -> None:
        """
        Create the structs into which rcl writes.

        This needs the function of `rcl_take`, so `rcl_take` must not return None.

        :param make: creates a message from its bytes, the gid of its publisher (hex), and the time
            of its reception (ns; 0: not known).
        """
        self._make, self._take = make, rcl_take()
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._bytes = _Bytes(allocator=rcutils.rcutils_get_default_allocator())
        self._info = _MessageInfo()
        finalize(self, rcutils.rcutils_uint8_array_fini, byref(self._bytes))

    def take(self, handle: Any, max_messages: int, messages: list[_Message]) -> None:
        """
        Take the messages that have arrived; only one thread at a time may call this method.

        :param handle: the handle of a subscription.
        :param max_messages: the largest number of messages to take.
        :param messages: the list to which the messages are appended.
        :raises InvalidHandle: if the subscription is destroyed.
        :raises RCLError: if rcl returns an error.
        """
        # If Ctrl-C has interrupted the last call, a message may be taken but not appended.
        self._append_taken(messages)
        with handle:
            for _ in range(max_messages):
                code = self._take(handle.pointer, self._bytes, self._info, None)
                if code == _TAKE_FAILED:
                    break
                if code:
                    raise RCLError(f'rcl_take_serialized_message failed with code {code}')
                self._append_taken(messages)

    def _append_taken(self, messages: list[_Message]) -> None:
        """Append the message that was taken last, if it is not appended yet."""
        written, info = self._bytes, self._info
        if written.length:
            message = self._make(ctypes.string_at(written.buffer, written.length),
                                 bytes(info.gid).hex(), info.received_timestamp)
            messages += [message]  # not `append`: after a call, Ctrl-C can interrupt
            written.length = 0
