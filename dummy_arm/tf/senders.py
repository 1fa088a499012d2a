"""Who sent a transform: rclpy does not tell of a message, but rcl does, by its publisher's gid."""

from collections.abc import Callable, Iterable
import ctypes
from ctypes import byref, c_int64, c_size_t, c_uint8, c_uint64, c_void_p, POINTER
from functools import cache, partial
from itertools import groupby
from operator import attrgetter
from time import monotonic, time_ns
from typing import Any
from weakref import finalize

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.subscription import Subscription

from dummy_arm.tf.feed import Feed
from dummy_arm.tf.frames import Frame
from dummy_arm.tf.subscribing import most_at_once, take_all
from dummy_arm.tf.transform_listener import TransformListener

UNKNOWN = 'unknown sender'
_TAKE_FAILED = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED: there is no message
_GID_SIZE = 16
_BETWEEN_LOOKS = 0.5  # s
#: The names of so many publishers are kept, those that are gone included.
_MOST_NAMES = 10_000
_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'  # of a publisher whose node is not discovered yet


class Sent(bytes):
    """The bytes of a message, with what the middleware knows of it."""

    gid = ''  #: of its publisher, in hex; '' where that cannot be told
    received = 0  #: when it came in, on the system's clock (ns)


#: What is called with messages, and whether they are static.
Observe = Callable[[list[Sent], bool], object]


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
                ('implementation_identifier', c_void_p), ('gid', c_uint8 * _GID_SIZE),
                ('room', c_uint8 * 64)]


class Taker:
    """Takes messages with the gids of their publishers, by rcl; where it cannot be, without."""

    def __init__(self) -> None:
        """Find rcl, and make what it writes into."""
        self._take = _rcl_take()
        if self._take is not None:
            rcutils = ctypes.PyDLL('librcutils.so')
            rcutils.rcutils_get_default_allocator.restype = _Allocator
            self._bytes = _Bytes(allocator=rcutils.rcutils_get_default_allocator())
            self._info = _MessageInfo()
            finalize(self, rcutils.rcutils_uint8_array_fini, byref(self._bytes))

    def take_all(self, subscription: Subscription, messages: list[Sent]) -> None:
        """Append what has arrived; by one thread at a time."""
        if self._take is None:
            plain: list[bytes] = []
            take_all(subscription, plain)
            messages += map(_sent, plain)
            return
        written, info = self._bytes, self._info
        with subscription.handle:
            for _ in range(most_at_once(subscription)):
                code = self._take(subscription.handle.pointer, written, info, None)
                if code == _TAKE_FAILED:
                    break
                if code:
                    raise _rclpy.RCLError(f'rcl_take_serialized_message returns {code}')
                messages.append(_sent(
                    ctypes.string_at(written.buffer, written.length), bytes(info.gid).hex(),
                    info.received_timestamp))


def _sent(data: bytes, gid: str = '', received: int = 0) -> Sent:
    message = Sent(data)
    message.gid, message.received = gid, received or time_ns()
    return message


@cache
def _rcl_take() -> Any:
    """Find rcl_take_serialized_message; None where it is not."""
    try:
        take = ctypes.PyDLL('librcl.so').rcl_take_serialized_message
    except (OSError, AttributeError):
        return None
    take.argtypes = c_void_p, POINTER(_Bytes), POINTER(_MessageInfo), c_void_p
    return take


class SentFeed(Feed):
    """A Feed that inserts each message with the gid of its publisher as authority."""

    def __init__(self, *arguments: Any, observe: Observe) -> None:
        """
        Begin to feed; as Feed.

        :param observe: as SenderListener has it.
        """
        self._taker, self._observe = Taker(), observe
        super().__init__(*arguments)

    def _take_all(self, subscription: Subscription, arrived: list[Any]) -> None:
        self._taker.take_all(subscription, arrived)

    def _insert_messages(self, messages: list[Any], is_static: bool) -> None:
        self._observe(messages, is_static)
        for gid, sent in groupby(messages, attrgetter('gid')):
            self._buffer.insert_messages(sent, self._reader, gid, is_static)


class SenderListener(TransformListener):
    """A TransformListener that knows which node sent the newest transform of a frame."""

    def __init__(self, *arguments: Any, observe: Observe = lambda *_: None, **how: Any) -> None:
        """
        Begin to listen; as TransformListener.

        :param observe: is called with messages before they are inserted, and whether they are
            static; by any thread that looks something up, but one at a time.
        """
        self.feed_class = partial(SentFeed, observe=observe)
        self._names: dict[str, str] = {}
        #: The gids of the publishers that there are.
        self.present: frozenset[str] = frozenset()
        self._next_look = 0.0
        super().__init__(*arguments, **how)

    def frames(self) -> list[Frame]:
        """List the frames of the buffer, with the full names of nodes as their authorities."""
        frames: list[Frame] = self.buffer.frames()
        names = self.names_of(frame.authority for frame in frames)
        return [frame._replace(authority=names[frame.authority]) for frame in frames]

    def names_of(self, gids: Iterable[str]) -> dict[str, str]:
        """Tell the full names of the nodes of publishers."""
        asked = set(gids)
        if not asked <= self._names.keys():
            self._look()
        return {gid: self._names.get(gid, UNKNOWN) for gid in asked}

    def _take(self) -> tuple[bool, float]:
        # Now and then, since a node may end before it is asked who it was.
        if (now := monotonic()) >= self._next_look:
            self._next_look = now + _BETWEEN_LOOKS
            self._look()
        return super()._take()

    def _look(self) -> None:
        """
        Learn the names of the publishers that there are.

        Those of publishers that are gone stay known, up to a number; the oldest are forgotten.
        """
        present = set()
        for topic in {self.tf_sub.topic_name, self.tf_static_sub.topic_name}:
            for info in self.node.get_publishers_info_by_topic(topic):
                gid = bytes(info.endpoint_gid[:_GID_SIZE]).hex()
                present.add(gid)
                if info.node_name != _UNKNOWN_NODE:
                    self._names[gid] = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
        self.present = frozenset(present)
        if (surplus := len(self._names) - _MOST_NAMES) > 0:
            gone = [gid for gid in tuple(self._names) if gid not in present]
            for gid in gone[:surplus]:
                self._names.pop(gid, None)
