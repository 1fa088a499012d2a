"""
The C structs of rosidl that describe a message type, with their layout in ROS 2 Jazzy.

The structs are declared in rosidl_runtime_c/message_type_support_struct.h,
rosidl_runtime_c/type_description/*.h, rosidl_typesupport_fastrtps_cpp/message_type_support.h and
rosidl_typesupport_introspection_c/message_introspection.h. Compare them with these headers before
you support another distribution of ROS.
"""

import ctypes
from ctypes import c_bool, c_char_p, c_size_t, c_uint8, c_uint32, c_uint64, c_void_p, POINTER


class String(ctypes.Structure):
    """The struct rosidl_runtime_c__String; `str()` returns the decoded string."""

    _fields_ = [('data', c_char_p), ('size', c_size_t), ('capacity', c_size_t)]

    @classmethod
    def of(cls, text: str) -> 'String':
        """Create the struct; Python owns its bytes, so C must not free them."""
        data = text.encode()
        return cls(data, len(data), len(data) + 1)

    def __str__(self) -> str:
        return (self.data or b'').decode()


def sequence_of(element: type) -> type:
    """Create the ctypes class for a rosidl sequence."""
    fields = [('data', POINTER(element)), ('size', c_size_t), ('capacity', c_size_t)]
    return type(f'{element.__name__}Sequence', (ctypes.Structure,), {
        '_fields_': fields, '__iter__': lambda self: (self.data[i] for i in range(self.size))})


class FieldType(ctypes.Structure):
    _fields_ = [('type_id', c_uint8), ('capacity', c_uint64), ('string_capacity', c_uint64),
                ('nested_type_name', String)]


class Field(ctypes.Structure):
    _fields_ = [('name', String), ('type', FieldType), ('default_value', String)]


Fields = sequence_of(Field)


class IndividualTypeDescription(ctypes.Structure):
    _fields_ = [('type_name', String), ('fields', Fields)]


IndividualTypeDescriptions = sequence_of(IndividualTypeDescription)


class TypeDescription(ctypes.Structure):
    _fields_ = [('type_description', IndividualTypeDescription),
                ('referenced_type_descriptions', IndividualTypeDescriptions)]


class TypeSource(ctypes.Structure):
    _fields_ = [('type_name', String), ('encoding', String), ('raw_file_contents', String)]


TypeSources = sequence_of(TypeSource)


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
