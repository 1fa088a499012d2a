"""
The private parts of rclpy and rcl on which this package relies: Jazzy (rclpy 7.1), Kilted (9.1).

For each public name of this module, a test in test/ros/test_rclpy_private.py checks the behaviour
of rclpy or rcl on which it relies.
"""

from collections.abc import Callable
from contextlib import suppress
import ctypes
from ctypes import byref, c_char_p, c_int64, c_size_t, c_uint8, c_uint64, c_void_p, POINTER
from functools import cache, partial
import inspect
from itertools import islice
from typing import Any, Optional
from weakref import finalize

from rclpy import event_handler
from rclpy.callback_groups import CallbackGroup
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

from puretf._ros import cyclone_dds
from puretf._ros.transform_stamped import deserialize, serialize
from puretf._text.times import SECOND
from puretf._wire.encoding import MalformedMessage

#: A message: its bytes, the gid of its publisher (hex), and the times of reception and of sending
#: (ns). What is not known is '' or 0.
_Taken = tuple[bytes, str, int, int]
#: The exception that rclpy's compiled part raises if rcl returns an error code.
RCLError = _rclpy.RCLError
#: WaitSet(subscriptions, guard conditions, timers, clients, services, events, context), with the
#: methods clear_entities, add_subscription, add_guard_condition and wait(timeout in ns).
WaitSet: Any = getattr(_rclpy, 'WaitSet', None)  # None: see `missing_part`
#: Returns a message, as bytes if its argument `raw` is True, and its info; None if there is no
#: message. `install` replaces the method in rclpy, but not here.
_take_message = _rclpy.Subscription.take_message

# TFMessages that were created at run time. rclpy's compiled part converts a message with compiled
# functions of its class, which such a class does not have. So four functions of rclpy are replaced
# by functions that convert these messages in Python, and handle other messages as before.

_publish = _rclpy.Publisher.publish
_serialize, _deserialize = _rclpy.rclpy_serialize, _rclpy.rclpy_deserialize
#: The class that is converted in Python.
_converted: tuple[Any, ...] = ()
_warned_topics: set[str] = set()


def install(message_type: Any) -> None:
    """Make rclpy exchange the messages of a class TFMessage with rcl as bytes."""
    global _converted
    _converted = message_type,
    _rclpy.Publisher.publish = _publish_any
    _rclpy.Subscription.take_message = _take_any
    _rclpy.rclpy_serialize = _serialize_any
    _rclpy.rclpy_deserialize = _deserialize_any


def _publish_any(publisher: Any, message: Any) -> None:
    if isinstance(message, _converted):
        publisher.publish_raw(serialize(message.transforms))
    else:
        _publish(publisher, message)


def _take_any(subscription: Any, message_type: type, raw: bool) -> Optional[tuple[Any, Any]]:
    """Take a message; drop it with a warning, once per topic, if it is malformed."""
    is_converted = not raw and issubclass(message_type, _converted)
    taken = _take_message(subscription, message_type, raw or is_converted)
    if taken is None or not is_converted:
        return taken  # type: ignore[no-any-return]
    try:
        return _converted[0](transforms=deserialize(taken[0])), taken[1]
    except MalformedMessage as error:
        topic = subscription.get_topic_name()
        if topic not in _warned_topics:
            _warned_topics.add(topic)
            get_logger('puretf').warning(f'dropped a message on {topic}: {error}')
        return None


def _serialize_any(message: Any, message_type: type) -> bytes:
    if isinstance(message, _converted):
        return serialize(message.transforms)
    return _serialize(message, message_type)  # type: ignore[no-any-return]


def _deserialize_any(data: bytes, message_type: type) -> Any:
    if issubclass(message_type, _converted):
        return _converted[0](transforms=deserialize(data))
    return _deserialize(data, message_type)


def _has(owner: Any, *names: str) -> bool:
    return all(hasattr(owner, name) for name in names)


def _takes(function: Any, *names: str) -> bool:
    return {*names} <= inspect.signature(function).parameters.keys()


def _exchanges_bytes() -> bool:
    from geometry_msgs.msg import Point
    check_is_valid_msg_type(Point)  # this loads its type support
    point = Point(x=1.0)
    return bool(_deserialize(_serialize(point, Point), Point) == point)


#: By name: whether a private part is as a listener needs it.
_PARTS: dict[str, Callable[[], bool]] = {
    'the class Subscription': lambda: _takes(
        Subscription, 'callback_group', 'qos_profile', 'raw', 'event_callbacks'),
    'the compiled Subscription': lambda: _has(
        _rclpy.Subscription, 'take_message', 'destroy_when_not_in_use', 'get_topic_name'),
    'the compiled EventHandle': lambda: _has(
        _rclpy.EventHandle, 'take_event', 'destroy_when_not_in_use'),
    'the compiled WaitSet': lambda: _has(
        _rclpy.WaitSet, 'clear_entities', 'add_subscription', 'add_guard_condition', 'wait'),
    'the class GuardCondition': lambda: _takes(
        GuardCondition, 'callback', 'callback_group', 'context'),
    'its serialization': _exchanges_bytes}


@cache
def missing_part() -> str:
    """Return the first private part that is not as a listener needs it; '' if there is none."""
    for name, is_there in _PARTS.items():
        with suppress(Exception):
            if is_there():
                continue
        return name
    return ''


def subscribe(node: Node, message_type: type, topic: str, callback: Callable[[Any], None],
              qos: QoSProfile, group: CallbackGroup) -> Subscription:
    """
    Create a subscription that no executor knows; the caller must take its messages.

    The callback is only an attribute of the subscription; nobody calls it.
    """
    check_is_valid_msg_type(message_type)  # this loads the type support of a generated class
    validate_topic_name(topic)
    validate_full_topic_name(expand_topic_name(topic, node.get_name(), node.get_namespace()))
    with node.handle:
        handle = _rclpy.Subscription(node.handle, message_type, topic, qos.get_c_qos_profile())
    # rclpy 10 takes some of them by keyword only.
    return Subscription(
        handle, message_type, topic, callback, callback_group=group, qos_profile=qos, raw=True,
        event_callbacks=event_handler.SubscriptionEventCallbacks(use_default_callbacks=False))


def take_bytes(subscription: Any, most: int) -> list[tuple[bytes, Any]]:
    """Take at most a number of the messages that have arrived, each as its bytes and its info."""
    if not isinstance(subscription, Subscription):
        return subscription.take(most)  # type: ignore[no-any-return]  # of a node of our own
    handle = subscription.handle
    with handle:
        # The type does not matter.
        return [*islice(iter(partial(_take_message, handle, object, True), None), most)]


def is_given(node: Node, parameter: str) -> bool:
    """Return whether the user has set a parameter by ROS arguments."""
    return hasattr(node, '_parameter_overrides') and parameter in node._parameter_overrides


def incompatible_qos(subscription: Subscription) -> Any:
    """
    Create the event of publishers with an incompatible QoS; None if there is no such event.

    Its method `take_event` returns None or a status with the attributes `total_count_change` and
    `last_policy_kind`; its method `destroy_when_not_in_use` releases it.
    """
    with subscription.handle:
        try:
            kinds = event_handler.QoSSubscriptionEventType
            return _rclpy.EventHandle(
                subscription.handle, kinds.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS)
        except event_handler.UnsupportedEventTypeError:
            return None


def guard_condition(node: Node, group: CallbackGroup, on_destroy: Callable[[], object],
                    callback: Callable[[], object] = lambda: None) -> GuardCondition:
    """
    Create a guard condition that makes the executor of a node call `callback`.

    `on_destroy` is called before the guard condition is destroyed. `destroy_node` has no hook, but
    it destroys all guard conditions of the node, so it calls `on_destroy`, too.
    """
    guard = node.create_guard_condition(callback, group)

    def destroy() -> None:
        on_destroy()
        GuardCondition.destroy(guard)

    guard.destroy = destroy  # type: ignore[method-assign]
    return guard


def is_of_executor(callback: Callable[..., Any]) -> bool:
    """
    Return True if a done callback of a future was added by an executor.

    An executor that spins until a future is done adds such a callback, and never removes it.
    """
    return callback.__module__ == 'rclpy.executors'


# Functions of rcl that are called through ctypes

#: RCL_RET_SUBSCRIPTION_TAKE_FAILED: there is no message.
_TAKE_FAILED = 401
#: The number of bytes in the gid of a publisher. The `endpoint_gid` of rclpy's `TopicEndpointInfo`
#: begins with these bytes.
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
    """Load rcl_take_serialized_message."""
    take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
    take.argtypes = c_void_p, POINTER(_Bytes), POINTER(_MessageInfo), c_void_p
    return take


class _RmwSubscription(ctypes.Structure):
    """The beginning of the struct rmw_subscription_t."""

    _fields_ = [('implementation_identifier', c_char_p), ('data', c_void_p),
                ('topic_name', c_char_p)]


def rmw_subscription(handle: Any) -> Any:
    """
    Return the struct with which the middleware represents a subscription.

    It is valid while the subscription exists. `data` is the address of a struct of the middleware.
    """
    get = ctypes.PyDLL('librcl.so').rcl_subscription_get_rmw_handle
    get.argtypes, get.restype = (c_void_p,), POINTER(_RmwSubscription)
    with handle:
        return get(handle.pointer).contents


class Taker:
    """An object that takes messages, each with the gid of its publisher, which rclpy hides."""

    def __init__(self, subscription: Any) -> None:
        """Create the structs into which rcl writes; for an OwnNode, rclpy must tell the gid."""
        self._subscription = subscription
        self._handle: Any = (
            subscription.handle if isinstance(subscription, Subscription) else None)
        is_cyclone = get_rmw_implementation_identifier() == cyclone_dds.IDENTIFIER
        #: False if the time of reception is the time at which the message is taken.
        self.has_reception_times = not is_cyclone
        self._received = 0  # the last time of reception (ns)
        if self._handle is None:
            return
        self._take = rcl_take()
        self._gid_of = cyclone_dds.gid_translator(
            rmw_subscription(self._handle).data) if is_cyclone else None
        rcutils = ctypes.PyDLL('librcutils.so')
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self._bytes = _Bytes(allocator=rcutils.rcutils_get_default_allocator())
        self._info = _MessageInfo()
        finalize(self, rcutils.rcutils_uint8_array_fini, byref(self._bytes))

    def take(self, most: int) -> list[_Taken]:
        """Take the messages that have arrived; only one thread at a time may call this."""
        if self._handle is None:
            taken = [(data, _gid(info), info['received_timestamp'] or 0,
                      info['source_timestamp'] or 0)
                     for data, info in take_bytes(self._subscription, most)]
        else:
            with self._handle:
                taken = [*islice(iter(self._take_one, None), most)]
        # For Fast DDS 3, the first messages of a publisher come after those that follow.
        for i, (data, gid, received, sent) in enumerate(taken):
            if not 0 < self._received - received < SECOND:
                self._received = received
            taken[i] = data, gid, self._received, sent
        return taken

    def _take_one(self) -> Optional[_Taken]:
        written, info = self._bytes, self._info
        code = self._take(self._handle.pointer, written, info, None)
        if code == _TAKE_FAILED:
            return None
        if code:
            raise RCLError(f'rcl_take_serialized_message failed with code {code}')
        gid = bytes(info.gid).hex()
        return (ctypes.string_at(written.buffer, written.length),
                self._gid_of(gid) if self._gid_of else gid, info.received_timestamp,
                info.source_timestamp)


def _gid(info: Any) -> str:
    """Return the gid of the publisher (hex), which rclpy tells from 9 on."""
    gid = info.get('publisher_gid')
    return gid['data'][:GID_SIZE].hex() if gid else ''
