"""
The private parts of rclpy and rcl on which this package relies, as of ROS 2 Jazzy (rclpy 7.1).

Each public name of this module relies on some behaviour of rclpy or rcl. A test in
test/ros/test_rclpy_private.py checks this behaviour, and fails if an upgrade of rclpy changes it.
"""

from collections.abc import Callable
import ctypes
from ctypes import byref, c_char_p, c_int64, c_size_t, c_uint8, c_uint64, c_void_p, POINTER
from functools import cache
from typing import Any, Generic, Optional, TypeVar
from weakref import finalize

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import (
    QoSSubscriptionEventType,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.expand_topic_name import expand_topic_name
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.type_support import check_is_valid_msg_type
from rclpy.utilities import get_rmw_implementation_identifier
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_topic_name import validate_topic_name

from dummy_arm.tf._ros import cyclone_dds
from dummy_arm.tf._ros.transform_stamped import deserialize, serialize
from dummy_arm.tf._wire.cdr import MalformedMessage

_Message = TypeVar('_Message')

#: The exception that rclpy's compiled part raises if rcl returns an error code.
RCLError = _rclpy.RCLError
#: The class that wraps the C struct rcl_wait_set_t. The first six arguments of its constructor
#: say how many subscriptions, guard conditions, timers, clients, services and events can be added.
#: The last argument is the context. This package uses the methods clear_entities,
#: add_subscription, add_guard_condition and wait(timeout in ns).
WaitSet = _rclpy.WaitSet
#: take_message(handle, message type, raw) takes a message, as bytes if `raw` is True. It returns
#: the message and its info, or None if there is no message. `install` replaces the method in
#: rclpy, but not here: this name always refers to the original method.
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
    Make rclpy exchange the messages of one class with rcl as bytes.

    rclpy's compiled part converts a message with compiled functions of the message's class. A
    class that was created at run time does not have such functions. So `_exchange_bytes` replaces
    the four functions of rclpy that publish, take, serialize and deserialize messages. The new
    functions convert the messages of this class in Python, and handle other messages as before.

    :param message_type: the class of the messages that are converted in Python.
    :param serialize: a function that packs a list of TransformStamped into the bytes of a message.
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
        Take a message, in place of `Subscription.take_message`; drop a malformed message.

        :param taken_type: the class of the message.
        :param raw: True to return the bytes of the message instead of a message object.
        :returns: the message and its info; None if there is no message or it was dropped.
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
    Create a subscription whose messages the caller must take.

    The subscription is not in the node's list of subscriptions, so executors do not know it.

    :param node: the node.
    :param message_type: the class of the messages.
    :param topic: the name of the topic; the node's remappings apply.
    :param callback: kept as the attribute `callback` of the subscription; never called.
    :param qos: the profile of the subscription.
    :param group: the callback group of the subscription.
    :returns: the subscription.
    :raises InvalidTopicNameException: if the name of the topic is invalid; the text says why.
    """
    # This call loads the type support of a generated message class.
    check_is_valid_msg_type(message_type)
    validate_topic_name(topic)
    validate_full_topic_name(expand_topic_name(topic, node.get_name(), node.get_namespace()))
    with node.handle:
        handle = _rclpy.Subscription(node.handle, message_type, topic, qos.get_c_qos_profile())
    return Subscription(handle, message_type, topic, callback, group, qos, True,
                        SubscriptionEventCallbacks(use_default_callbacks=False))


def incompatible_qos(subscription: Subscription) -> Any:
    """
    Create the event that reports publishers whose QoS is incompatible with a subscription.

    The method `take_event` of the event returns a status, or None if there is no new status. A
    status has the attributes `total_count_change` and `last_policy_kind`. The method
    `destroy_when_not_in_use` releases the event.

    :param subscription: the subscription.
    :returns: the event; None if the middleware does not support this event.
    """
    with subscription.handle:
        try:
            return _rclpy.EventHandle(
                subscription.handle,
                QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS)
        except UnsupportedEventTypeError:
            return None


def guard_condition(node: Node, group: CallbackGroup, on_destroy: Callable[[], object],
                    callback: Callable[[], object] = lambda: None) -> GuardCondition:
    """
    Create a guard condition that wakes the executor of a node.

    :param node: the node.
    :param group: the callback group of the guard condition.
    :param on_destroy: a function that is called before the guard condition is destroyed. The
        method `destroy_node` has no hook, but it destroys all guard conditions of the node. So
        `destroy_node`, too, calls `on_destroy`.
    :param callback: the function that the executor calls when the guard condition is triggered.
    :returns: the guard condition.
    """
    guard = node.create_guard_condition(callback, group)

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


# Functions of rcl that are called through ctypes

#: The code RCL_RET_SUBSCRIPTION_TAKE_FAILED, which means that there is no message.
_TAKE_FAILED = 401
#: The number of bytes in a gid, which identifies a publisher. The `endpoint_gid` of rclpy's
#: `TopicEndpointInfo` begins with these bytes.
GID_SIZE = 16


class _Allocator(ctypes.Structure):
    """The struct rcutils_allocator_t."""

    _fields_ = [(name, c_void_p) for name in (
        'allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')]


class _Bytes(ctypes.Structure):
    """The struct rcutils_uint8_array_t, also named rcl_serialized_message_t."""

    _fields_ = [('buffer', POINTER(c_uint8)), ('length', c_size_t), ('capacity', c_size_t),
                ('allocator', _Allocator)]


class _MessageInfo(ctypes.Structure):
    """The struct rmw_message_info_t, with extra room because it is longer in other releases."""

    _fields_ = [('source_timestamp', c_int64), ('received_timestamp', c_int64),
                ('publication_sequence_number', c_uint64), ('reception_sequence_number', c_uint64),
                ('implementation_identifier', c_void_p), ('gid', c_uint8 * GID_SIZE),
                ('room', c_uint8 * 64)]


@cache
def rcl_take() -> Any:
    """
    Load the function rcl_take_serialized_message.

    :returns: the function; None if librcl.so cannot be loaded or does not have the function.
    """
    try:
        take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
    except (OSError, AttributeError):
        return None
    take.argtypes = c_void_p, POINTER(_Bytes), POINTER(_MessageInfo), c_void_p
    return take


class _RmwSubscription(ctypes.Structure):
    """The beginning of the struct rmw_subscription_t."""

    _fields_ = [('implementation_identifier', c_char_p), ('data', c_void_p),
                ('topic_name', c_char_p)]


def rmw_subscription(handle: Any) -> Any:
    """
    Return the struct with which the middleware represents a subscription.

    :param handle: the handle of the subscription.
    :returns: the struct, which is valid while the subscription exists. Its fields are
        `implementation_identifier`, `data` (the address of a struct of the middleware; its layout
        depends on the middleware) and `topic_name`.
    """
    get = ctypes.PyDLL('librcl.so').rcl_subscription_get_rmw_handle
    get.argtypes, get.restype = (c_void_p,), POINTER(_RmwSubscription)
    with handle:
        return get(handle.pointer).contents


class Taker(Generic[_Message]):
    """
    An object that takes messages from a subscription.

    rclpy does not report which publisher has sent a message. So this class calls rcl through
    ctypes. With each message, rcl returns the gid of the publisher.
    """

    def __init__(self, handle: Any, make: Callable[[bytes, str, int], _Message]) -> None:
        """
        Create the structs into which rcl writes.

        A Taker can be used only if `rcl_take` does not return None.

        :param handle: the handle of the subscription.
        :param make: a function that creates a message. Its arguments are the bytes of the message,
            the gid of the publisher (hex), and the time of reception (ns; 0 if it is not known).
        """
        self._handle, self._make, self._take = handle, make, rcl_take()
        middleware = get_rmw_implementation_identifier()
        is_cyclone = middleware == cyclone_dds.IDENTIFIER
        self._gid_of = cyclone_dds.gid_translator(
            rmw_subscription(handle).data) if is_cyclone else None
        #: True if each gid is the gid of a publisher in the ROS graph, once the graph knows it.
        #: False if this is not known; a gid still identifies one publisher.
        self.has_gids = 'fastrtps' in middleware or self._gid_of is not None
        #: False if the time of reception is the time at which the message is taken.
        self.has_reception_times = not is_cyclone
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._bytes = _Bytes(allocator=rcutils.rcutils_get_default_allocator())
        self._info = _MessageInfo()
        finalize(self, rcutils.rcutils_uint8_array_fini, byref(self._bytes))

    def take(self, max_messages: int, messages: list[_Message]) -> None:
        """
        Take the messages that have arrived; only one thread at a time may call this method.

        :param max_messages: the largest number of messages to take.
        :param messages: the list to which the messages are appended.
        :raises InvalidHandle: if the subscription is destroyed.
        :raises RCLError: if rcl returns an error.
        """
        # If Ctrl-C has interrupted the previous call, one message may be taken but not appended.
        self._append_taken(messages)
        with self._handle:
            for _ in range(max_messages):
                code = self._take(self._handle.pointer, self._bytes, self._info, None)
                if code == _TAKE_FAILED:
                    break
                if code:
                    raise RCLError(f'rcl_take_serialized_message failed with code {code}')
                self._append_taken(messages)

    def _append_taken(self, messages: list[_Message]) -> None:
        """Append the message that was taken last, if it is not appended yet."""
        written, info = self._bytes, self._info
        if written.length:
            gid = bytes(info.gid).hex()
            message = self._make(
                ctypes.string_at(written.buffer, written.length),
                self._gid_of(gid) if self._gid_of else gid, info.received_timestamp)
            # After a call of `append`, Ctrl-C could interrupt before `length` is set to 0. Then
            # the message would be appended twice.
            messages += [message]
            written.length = 0
