"""
What this package uses of rclpy and rcl that is not public, as of ROS 2 Jazzy (rclpy 7.1).

Each name here is a touch point, and test/test_rclpy_private.py has a test for each, which states
what it relies on: after an upgrade of rclpy that changes one of them, that test fails.
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

#: What rclpy's compiled part raises for an error that rcl returns.
RCLError = _rclpy.RCLError
#: rcl_wait_set_t: WaitSet(subscriptions, guard conditions, timers, clients, services, events,
#: context), with clear_entities, add_subscription, add_guard_condition and wait(ns).
WaitSet = _rclpy.WaitSet
#: Take a message: take_message(handle, message type, whether as bytes) returns None or the message
#: and its info. This is rclpy's own, also after `install`.
take_message = _rclpy.Subscription.take_message


def install(message_type: Any) -> None:
    """
    Have rclpy send and take a TFMessage that was made at run time.

    :param message_type: the TFMessage that is used; if it is that of tf2_msgs, nothing is done.
    """
    if not message_type.__module__.startswith('tf2_msgs.'):
        _exchange_bytes(message_type, serialize)


def _exchange_bytes(message_type: Any, serialize: Callable[[Any], bytes]) -> None:
    """
    Have rclpy exchange bytes with rcl in place of the messages of a type.

    Its compiled part converts messages by functions that a compiler made, which this type does not
    have. So bytes are handed over where messages are published, taken, serialized and
    deserialized. Messages of all other types take the way that they took before.

    :param serialize: packs a list of TransformStamped into the bytes of a message.
    """
    publish = _rclpy.Publisher.publish
    serialize_other, deserialize_other = _rclpy.rclpy_serialize, _rclpy.rclpy_deserialize
    faulty_topics = set()

    def publish_as_bytes(self: Any, message: Any) -> None:
        if isinstance(message, message_type):
            self.publish_raw(serialize(message.transforms))
        else:
            publish(self, message)

    def take_as_bytes(self: Any, taken_type: type, raw: bool) -> Optional[tuple[Any, Any]]:
        if raw or not issubclass(taken_type, message_type):
            return take_message(self, taken_type, raw)  # type: ignore[no-any-return]
        taken = take_message(self, taken_type, True)
        if taken is None:
            return None
        try:
            return message_type(transforms=deserialize(taken[0])), taken[1]
        except MalformedMessage as error:
            topic = self.get_topic_name()
            if topic not in faulty_topics:
                faulty_topics.add(topic)
                get_logger('tf').warning(f'dropped a message on {topic}: {error}')
            return None

    def serialize_as_bytes(message: Any, given_type: type) -> bytes:
        if isinstance(message, message_type):
            return serialize(message.transforms)
        return serialize_other(message, given_type)  # type: ignore[no-any-return]

    def deserialize_as_bytes(data: bytes, given_type: type) -> Any:
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
    Subscribe a node to a topic, so that only the owner of the subscription can take messages.

    It is none of the node's subscriptions, which an executor would take messages from.

    :param callback: what the subscription shows as its callback; nobody calls it.
    """
    # As create_subscription does: a generated class loads its type support only when asked to.
    check_is_valid_msg_type(message_type)
    with node.handle:
        handle = _rclpy.Subscription(node.handle, message_type, topic, qos.get_c_qos_profile())
    return Subscription(handle, message_type, topic, callback, group, qos, True,
                        SubscriptionEventCallbacks(use_default_callbacks=False))


def incompatible_qos(subscription: Subscription) -> Any:
    """
    Return the event of publishers whose QoS does not fit a subscription.

    Its `take_event` returns None or a status with `total_count_change` and `last_policy_kind`, and
    `destroy_when_not_in_use` releases it.

    :returns: None where the middleware has no such event.
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
    Create a guard condition of a node, by which the executor of the node is woken.

    :param on_destroy: is called before it is destroyed, as by `destroy_node`, which destroys all
        guard conditions of the node: there is no other hook.
    """
    guard = node.create_guard_condition(lambda: None, group)

    def destroy() -> None:
        on_destroy()
        GuardCondition.destroy(guard)

    guard.destroy = destroy  # type: ignore[method-assign]
    return guard


def is_of_executor(callback: Callable[..., Any]) -> bool:
    """
    Return whether a done callback was added by an executor that spins until a future is done.

    The executor keeps the future meanwhile, and never removes its callback.
    """
    return callback.__module__ == 'rclpy.executors'


# rcl, by ctypes

_TAKE_FAILED = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED: there is no message
#: The size of a gid (bytes), as in `endpoint_gid` of get_publishers_info_by_topic.
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
    """The struct rmw_message_info_t; with some room, should it be longer elsewhere."""

    _fields_ = [('source_timestamp', c_int64), ('received_timestamp', c_int64),
                ('publication_sequence_number', c_uint64), ('reception_sequence_number', c_uint64),
                ('implementation_identifier', c_void_p), ('gid', c_uint8 * GID_SIZE),
                ('room', c_uint8 * 64)]


@cache
def rcl_take() -> Any:
    """Return the function rcl_take_serialized_message; None where there is none."""
    try:
        take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
    except (OSError, AttributeError):
        return None
    take.argtypes = c_void_p, POINTER(_Bytes), POINTER(_MessageInfo), c_void_p
    return take


class Taker(Generic[_Message]):
    """Takes messages with the gids of their publishers, which rclpy does not report."""

    def __init__(self, make: Callable[[bytes, str, int], _Message]) -> None:
        """
        Create what rcl writes into; `rcl_take` must have returned a function.

        :param make: makes a message of its bytes, the gid of its publisher (hex), and the time of
            its reception (ns; 0: not known).
        """
        self._make, self._take = make, rcl_take()
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._bytes = _Bytes(allocator=rcutils.rcutils_get_default_allocator())
        self._info = _MessageInfo()
        finalize(self, rcutils.rcutils_uint8_array_fini, byref(self._bytes))

    def take(self, handle: Any, most: int, messages: list[_Message]) -> None:
        """
        Append what has arrived; by one thread at a time.

        :param handle: of a subscription.
        :param most: the number of messages that are taken at most.
        """
        self._append_taken(messages)  # if Ctrl-C came before that was done
        with handle:
            for _ in range(most):
                code = self._take(handle.pointer, self._bytes, self._info, None)
                if code == _TAKE_FAILED:
                    break
                if code:
                    raise RCLError(f'rcl_take_serialized_message returns {code}')
                self._append_taken(messages)

    def _append_taken(self, messages: list[_Message]) -> None:
        """Append the message that was taken last, once."""
        written, info = self._bytes, self._info
        if written.length:
            message = self._make(ctypes.string_at(written.buffer, written.length),
                                 bytes(info.gid).hex(), info.received_timestamp)
            messages += [message]  # no call, after which Ctrl-C could come before the next line
            written.length = 0
