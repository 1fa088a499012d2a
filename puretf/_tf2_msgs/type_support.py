"""
The type support of `tf2_msgs/msg/TFMessage`, derived from types of geometry_msgs.

The middleware identifies a message type by a C struct, `rosidl_message_type_support_t`. This
struct points to further structs. Like a TFMessage, a `geometry_msgs/msg/Polygon` has a single
field, which is an unbounded sequence. So this module copies the structs of Polygon. In the copies,
it replaces the name, the element type, the description and the hash.

The structs contain pointers to functions. C code calls these functions when a publisher or a
subscription is created, but not for each message. Ctrl-C could interrupt a function that runs
Python bytecode. Therefore each function is compiled, or is a ctypes callback that only calls a
compiled function.
"""

from collections.abc import Callable, Iterable
import ctypes
from ctypes import c_char_p, c_uint8, c_void_p, POINTER
from hashlib import sha256
from itertools import repeat
import json
import operator
from typing import Any, Optional

from geometry_msgs.msg import Polygon, TransformStamped
from rclpy.type_support import check_for_type_support

from puretf._tf2_msgs.rosidl_structs import (
    FastRTPSCallbacks,
    Field,
    Fields,
    FieldType,
    IndividualTypeDescription,
    IndividualTypeDescriptions,
    Member,
    Members,
    String,
    TypeDescription,
    TypeHash,
    TypeSource,
    TypeSources,
    TypeSupport,
)

_NAME = 'tf2_msgs/msg/TFMessage'
_SOURCE = 'geometry_msgs/TransformStamped[] transforms\n'
_NESTED_TYPE_UNBOUNDED_SEQUENCE = 145  # rosidl_runtime_c/type_description/field_type__struct.h
_ROS_TYPE_MESSAGE = 18  # rosidl_typesupport_introspection_c/field_types.h
_FASTRTPS = b'rosidl_typesupport_fastrtps_c'
_INTROSPECTION = b'rosidl_typesupport_introspection_c'


class _Handle(c_void_p):
    """
    The class of the argument `handle` of the C function `func` in a TypeSupport.

    C code calls `func(handle, identifier)` to get the address of the type support for one
    typesupport library, whose name is `identifier`. For TFMessage, `func` calls
    `operator.getitem(handle, identifier)`, which calls the function `__getitem__` of this class.
    This function is set at the end of this module.
    """

    __getitem__: Callable[[bytes], Optional[int]]


_Dispatch = ctypes.CFUNCTYPE(c_void_p, _Handle, c_char_p)
_Getter = ctypes.CFUNCTYPE(c_void_p)


def _expect(what: str, expected: object, found: object) -> None:
    """Raise an ImportError if a value from C code differs from the value in ROS 2 Jazzy."""
    if expected != found:
        raise ImportError(
            f'cannot create {_NAME} without tf2_msgs, because {what} is not as in ROS 2 Jazzy: '
            f'expected {expected!r}, found {found!r}; install tf2_msgs')


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
    _expect('the identifier of a type support', b'rosidl_typesupport_c',
            handle.typesupport_identifier)
    get = ctypes.CFUNCTYPE(c_void_p, c_void_p, c_char_p)(handle.func)
    address = get(address, identifier)
    _expect(f'the type support {identifier.decode()}', True, address is not None)
    kind = TypeSupport.from_address(address)
    _expect('the identifier of a type support', identifier, kind.typesupport_identifier)
    return kind


def _description_of(handle: TypeSupport) -> tuple[TypeDescription, Iterable[TypeSource]]:
    """Return the description and the sources of a type, after a check of the type's hash."""
    address = ctypes.addressof(handle)
    hash_, description, sources = (
        ctypes.CFUNCTYPE(POINTER(layout), c_void_p)(function)(address).contents
        for layout, function in (
            (TypeHash, handle.get_type_hash_func),
            (TypeDescription, handle.get_type_description_func),
            (TypeSources, handle.get_type_description_sources_func)))
    _expect('the version of a type hash', 1, hash_.version)
    _expect(f'the hash of {description.type_description.type_name}',
            _hash_of(description).hex(), bytes(hash_.value).hex())
    return description, sources


def _hash_of(description: TypeDescription) -> bytes:
    """Compute the hash of a type description: the SHA-256 of its canonical JSON (REP-2011)."""
    def plain(individual: IndividualTypeDescription) -> dict[str, Any]:
        """Convert a description to dicts and lists, with the keys in the order of REP-2011."""
        return {'type_name': str(individual.type_name), 'fields': [
            {'name': str(field.name), 'type': {
                'type_id': field.type.type_id, 'capacity': field.type.capacity,
                'string_capacity': field.type.string_capacity,
                'nested_type_name': str(field.type.nested_type_name)}}
            for field in individual.fields]}

    canonical = {
        'type_description': plain(description.type_description),
        'referenced_type_descriptions': [
            plain(individual) for individual in description.referenced_type_descriptions]}
    return sha256(json.dumps(canonical).encode()).digest()


def _array(sequence: type, elements: Iterable[Any]) -> Any:
    """Create the struct of a sequence that has at least one element."""
    elements = list(elements)
    array = (type(elements[0]) * len(elements))(*elements)
    return sequence(array, len(elements), len(elements))


def _constant(value: ctypes.Structure) -> int:
    """Return the address of a new C function, which itself returns the address of `value`."""
    getter = _Getter(repeat(ctypes.addressof(value)).__next__)
    _referenced.extend((value, getter))
    return ctypes.cast(getter, c_void_p).value or 0


#: Objects to which C code has pointers; the list keeps them alive.
_referenced: list[object] = []

_element_fastrtps = _type_support_of(TransformStamped, _FASTRTPS)
_element_introspection = _type_support_of(TransformStamped, _INTROSPECTION)
_polygon_fastrtps = _type_support_of(Polygon, _FASTRTPS)
_polygon_introspection = _type_support_of(Polygon, _INTROSPECTION)

# The description of TFMessage: one field, which is an unbounded sequence of TransformStamped.
_element_description, _element_sources = _description_of(_element_fastrtps)
_itself = IndividualTypeDescription(String.of(_NAME), _array(Fields, [Field(
    String.of('transforms'),
    FieldType(_NESTED_TYPE_UNBOUNDED_SEQUENCE, 0, 0,
              _element_description.type_description.type_name))]))
_description = TypeDescription(_itself, _array(IndividualTypeDescriptions, sorted(
    (_element_description.type_description, *_element_description.referenced_type_descriptions),
    key=lambda individual: str(individual.type_name))))
_sources = _array(TypeSources, (
    TypeSource(String.of(_NAME), String.of('msg'), String.of(_SOURCE)), *_element_sources))
_hash = TypeHash(1, (c_uint8 * 32)(*_hash_of(_description)))
_description_functions = [_constant(value) for value in (_hash, _description, _sources)]

# The functions for rmw_fastrtps. Messages are passed to rmw_fastrtps as bytes, so rmw_fastrtps
# calls only one of these functions: the function that returns whether the type is bounded.
_callbacks = FastRTPSCallbacks.from_buffer_copy(
    FastRTPSCallbacks.from_address(_polygon_fastrtps.data))
_expect("Polygon's name", (b'geometry_msgs::msg', b'Polygon'),
        (_callbacks.message_namespace, _callbacks.message_name))
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
_expect("Polygon's member", (b'points', _ROS_TYPE_MESSAGE, True, 0, False, 0),
        (_member.name, _member.type_id, _member.is_array, _member.array_size,
         _member.is_upper_bound, _member.offset))
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
_dispatch = _Dispatch(operator.getitem)
_handle = TypeSupport(b'rosidl_typesupport_c', None, ctypes.cast(_dispatch, c_void_p).value,
                      *_description_functions)

TYPE_SUPPORT = _new_capsule(ctypes.addressof(_handle), None, None)
CREATE_ROS_MESSAGE = Polygon.__class__._CREATE_ROS_MESSAGE
DESTROY_ROS_MESSAGE = Polygon.__class__._DESTROY_ROS_MESSAGE
# A TFMessage is sent and taken only as bytes, so rclpy does not need the next two functions. If
# rclpy still calls one of them, the function raises a TypeError.
CONVERT_FROM_PY = CONVERT_TO_PY = _new_capsule(
    ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, c_void_p).value, None, None)
