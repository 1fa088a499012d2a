"""
The type support of `tf2_msgs/msg/TFMessage`, derived from types of geometry_msgs.

The middleware identifies a message type by a C struct, `rosidl_message_type_support_t`. This
struct points to further structs. Like a TFMessage, a `geometry_msgs/msg/Polygon` has a single
field, which is an unbounded sequence. So this module copies the structs of Polygon. In the copies,
it replaces the name, the element type and the hash. The description has only the name.

The structs contain pointers to functions. C code calls these functions when a publisher or a
subscription is created, but not for each message. Ctrl-C could interrupt a function that runs
Python bytecode. Therefore each function is compiled, or is a ctypes callback that only calls a
compiled function.

The structs have the layout of ROS 2 Jazzy and Kilted. They are declared in
rosidl_runtime_c/message_type_support_struct.h, rosidl_runtime_c/type_description/*.h,
rosidl_typesupport_fastrtps_cpp/message_type_support.h and
rosidl_typesupport_introspection_c/message_introspection.h. Compare them with these headers before
you support another distribution of ROS.
"""

from collections.abc import Callable
import ctypes
from ctypes import c_bool, c_char_p, c_size_t, c_uint8, c_uint32, c_void_p, POINTER
from itertools import repeat
import operator
from typing import Any, Optional

from geometry_msgs.msg import Polygon, TransformStamped
from rclpy.type_support import check_for_type_support

from puretf._text.distribution import distribution, rclpy_version
from puretf._text.names import TF_MESSAGE

#: The hashes of the descriptions of TFMessage and of TransformStamped, as in REP-2011.
_HASH = 'e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087'
_ELEMENT_HASH = '0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206'
_FASTRTPS = b'rosidl_typesupport_fastrtps_c'
_INTROSPECTION = b'rosidl_typesupport_introspection_c'


class String(ctypes.Structure):
    """The struct rosidl_runtime_c__String; an empty sequence is like an empty string."""

    _fields_ = [('data', c_char_p), ('size', c_size_t), ('capacity', c_size_t)]


class TypeHash(ctypes.Structure):
    """The struct rosidl_type_hash_t: the hash of a type description."""

    _fields_ = [('version', c_uint8), ('value', c_uint8 * 32)]


class TypeSupport(ctypes.Structure):
    """The struct rosidl_message_type_support_t: the type support of a message type."""

    _fields_ = [('typesupport_identifier', c_char_p), ('data', c_void_p), ('func', c_void_p),
                ('get_type_hash_func', c_void_p), ('get_type_description_func', c_void_p),
                ('get_type_description_sources_func', c_void_p)]


class FastRTPSCallbacks(ctypes.Structure):
    """The struct message_type_support_callbacks_t: a type's name and its Fast RTPS functions."""

    _fields_ = [('message_namespace', c_char_p), ('message_name', c_char_p),
                *((name, c_void_p) for name in (
                    'cdr_serialize', 'cdr_deserialize', 'get_serialized_size',
                    'max_serialized_size', 'key_callbacks'))]


class Member(ctypes.Structure):
    """The struct rosidl_typesupport_introspection_c__MessageMember: a field's memory layout."""

    _fields_ = [('name', c_char_p), ('type_id', c_uint8), ('string_upper_bound', c_size_t),
                ('members', c_void_p), ('is_key', c_bool), ('is_array', c_bool),
                ('array_size', c_size_t), ('is_upper_bound', c_bool), ('offset', c_uint32),
                ('default_value', c_void_p),
                *((f'{name}_function', c_void_p) for name in (
                    'size', 'get_const', 'get', 'fetch', 'assign', 'resize'))]


class Members(ctypes.Structure):
    """The struct rosidl_typesupport_introspection_c__MessageMembers: a message's memory layout."""

    _fields_ = [('message_namespace', c_char_p), ('message_name', c_char_p),
                ('member_count', c_uint32), ('size_of', c_size_t),
                ('has_any_key_member', c_bool), ('members', POINTER(Member)),
                ('init_function', c_void_p), ('fini_function', c_void_p)]


class _Handle(c_void_p):
    """
    The class of the argument `handle` of the C function `func` in a TypeSupport.

    C code calls `func(handle, identifier)` to get the address of the type support for one
    typesupport library, whose name is `identifier`. For TFMessage, `func` calls
    `operator.getitem(handle, identifier)`, which calls the function `__getitem__` of this class.
    This function is set at the end of this module.
    """

    __getitem__: Callable[[bytes], Optional[int]]



def _expect(what: str, expected: object, found: object) -> None:
    """Raise an ImportError if a value differs from that in ROS 2 Jazzy and Kilted."""
    if expected != found:
        raise ImportError(
            f'cannot create {TF_MESSAGE} without tf2_msgs, because {what} is not as in ROS 2 '
            f'Jazzy and Kilted: expected {expected!r}, found {found!r}; install '
            f'ros-{distribution()}-tf2-msgs by apt or conda', name='tf2_msgs')


# From rclpy 10 on, structs that C code reads here are longer.
_expect('the release of rclpy', '7 or 9', '7 or 9' if rclpy_version().split('.')[0] in (
    '7', '9') else rclpy_version())


_get_capsule_name = ctypes.PYFUNCTYPE(c_char_p, ctypes.py_object)(
    ('PyCapsule_GetName', ctypes.pythonapi))
_get_capsule_pointer = ctypes.PYFUNCTYPE(c_void_p, ctypes.py_object, c_char_p)(
    ('PyCapsule_GetPointer', ctypes.pythonapi))
_new_capsule = ctypes.PYFUNCTYPE(ctypes.py_object, c_void_p, c_char_p, c_void_p)(
    ('PyCapsule_New', ctypes.pythonapi))


def _type_support_of(message_type: type, identifier: bytes) -> TypeSupport:
    """Return the type support of a generated message type for one typesupport library."""
    check_for_type_support(message_type)
    capsule = message_type.__class__._TYPE_SUPPORT  # type: ignore[attr-defined]
    address = _get_capsule_pointer(capsule, _get_capsule_name(capsule))
    handle = TypeSupport.from_address(address)
    get = ctypes.CFUNCTYPE(c_void_p, c_void_p, c_char_p)(handle.func)
    address = get(address, identifier)
    _expect(f'the type support {identifier.decode()}', True, address is not None)
    return TypeSupport.from_address(address)


def _constant(value: Any) -> int:
    """Return the address of a new C function, which itself returns the address of `value`."""
    getter = ctypes.CFUNCTYPE(c_void_p)(repeat(ctypes.addressof(value)).__next__)
    _referenced.extend((value, getter))
    return ctypes.cast(getter, c_void_p).value or 0


#: Objects to which C code has pointers; the list keeps them alive.
_referenced: list[object] = []

_element_fastrtps = _type_support_of(TransformStamped, _FASTRTPS)
_element_introspection = _type_support_of(TransformStamped, _INTROSPECTION)
_polygon_fastrtps = _type_support_of(Polygon, _FASTRTPS)
_polygon_introspection = _type_support_of(Polygon, _INTROSPECTION)

# C code compares the hash with that of other nodes.
_element_hash = ctypes.CFUNCTYPE(POINTER(TypeHash), c_void_p)(
    _element_fastrtps.get_type_hash_func)(ctypes.addressof(_element_fastrtps)).contents
_expect('the hash of TransformStamped', _ELEMENT_HASH, bytes(_element_hash.value).hex())
_hash = TypeHash(1, (c_uint8 * 32)(*bytes.fromhex(_HASH)))
# The description for the service `get_type_description`, which rcl copies: the name of the type,
# but neither fields nor the types of fields, which are two empty sequences. No sources.
_description = (String * 3)(
    String(TF_MESSAGE.encode(), len(TF_MESSAGE), len(TF_MESSAGE) + 1))
_description_functions = [_constant(value) for value in (_hash, _description, String())]

# The functions for rmw_fastrtps. Messages are passed to rmw_fastrtps as bytes, so rmw_fastrtps
# calls only one of these functions: the function that returns whether the type is bounded.
_callbacks = FastRTPSCallbacks.from_buffer_copy(
    FastRTPSCallbacks.from_address(_polygon_fastrtps.data))
_callbacks.message_namespace = b'tf2_msgs::msg'
_callbacks.message_name = b'TFMessage'
_fastrtps = TypeSupport(_FASTRTPS, ctypes.addressof(_callbacks), _polygon_fastrtps.func,
                        *_description_functions)

# The introspection tables, which the middleware reads when it registers the type.
_members = Members.from_buffer_copy(Members.from_address(_polygon_introspection.data))
_expect("Polygon's introspection", (b'geometry_msgs__msg', b'Polygon', 1, 24),
        (_members.message_namespace, _members.message_name, _members.member_count,
         _members.size_of))
_member = Member.from_buffer_copy(_members.members[0])
_member.name = b'transforms'
_member.members = ctypes.addressof(_element_introspection)
_members.message_namespace = b'tf2_msgs__msg'
_members.message_name = b'TFMessage'
_members.members = ctypes.pointer(_member)
_introspection = TypeSupport(_INTROSPECTION, ctypes.addressof(_members),
                             _polygon_introspection.func, *_description_functions)

# operator.getitem calls dict.get. Both are compiled, so no Python bytecode runs.
_Handle.__getitem__ = {
    _FASTRTPS: ctypes.addressof(_fastrtps),
    _INTROSPECTION: ctypes.addressof(_introspection)}.get
_dispatch = ctypes.CFUNCTYPE(c_void_p, _Handle, c_char_p)(operator.getitem)
_handle = TypeSupport(b'rosidl_typesupport_c', None, ctypes.cast(_dispatch, c_void_p).value,
                      *_description_functions)

TYPE_SUPPORT = _new_capsule(ctypes.addressof(_handle), None, None)
CREATE_ROS_MESSAGE = Polygon.__class__._CREATE_ROS_MESSAGE
DESTROY_ROS_MESSAGE = Polygon.__class__._DESTROY_ROS_MESSAGE
# A TFMessage is sent and taken only as bytes, so rclpy does not need the next two functions. If
# rclpy still calls one of them, the function raises a TypeError.
CONVERT_FROM_PY = CONVERT_TO_PY = _new_capsule(
    ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, c_void_p).value, None, None)
