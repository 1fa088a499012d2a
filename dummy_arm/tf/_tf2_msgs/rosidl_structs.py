"""
The C structs of rosidl that a message type is made of, as ROS 2 Jazzy lays them out.

From rosidl_runtime_c/message_type_support_struct.h, rosidl_runtime_c/type_description/*.h,
rosidl_typesupport_fastrtps_cpp/message_type_support.h and
rosidl_typesupport_introspection_c/message_introspection.h; each class is named as the C struct.
"""

import ctypes
from ctypes import c_bool, c_char_p, c_size_t, c_uint8, c_uint32, c_uint64, c_void_p, POINTER


class String(ctypes.Structure):
    """Text; `str()` reads it."""

    _fields_ = [('data', c_char_p), ('size', c_size_t), ('capacity', c_size_t)]

    @classmethod
    def of(cls, text: str) -> 'String':
        """Make one of a text."""
        data = text.encode()
        return cls(data, len(data), len(data) + 1)

    def __str__(self) -> str:
        return (self.data or b'').decode()


def sequence_of(element: type) -> type:
    """Make the struct of a sequence; iterating over it gives the elements."""
    fields = [('data', POINTER(element)), ('size', c_size_t), ('capacity', c_size_t)]
    return type(f'{element.__name__}Sequence', (ctypes.Structure,), {
        '_fields_': fields, '__iter__': lambda self: (self.data[i] for i in range(self.size))})


class FieldType(ctypes.Structure):
    """The type of a field."""

    _fields_ = [('type_id', c_uint8), ('capacity', c_uint64), ('string_capacity', c_uint64),
                ('nested_type_name', String)]


class Field(ctypes.Structure):
    """A field of a message."""

    _fields_ = [('name', String), ('type', FieldType), ('default_value', String)]


Fields = sequence_of(Field)


class IndividualTypeDescription(ctypes.Structure):
    """A type without the types that it refers to."""

    _fields_ = [('type_name', String), ('fields', Fields)]


IndividualTypeDescriptions = sequence_of(IndividualTypeDescription)


class TypeDescription(ctypes.Structure):
    """A type with all types that it refers to."""

    _fields_ = [('type_description', IndividualTypeDescription),
                ('referenced_type_descriptions', IndividualTypeDescriptions)]


class TypeSource(ctypes.Structure):
    """The file that a type was defined in."""

    _fields_ = [('type_name', String), ('encoding', String), ('raw_file_contents', String)]


TypeSources = sequence_of(TypeSource)


class TypeHash(ctypes.Structure):
    """The hash of a type description."""

    _fields_ = [('version', c_uint8), ('value', c_uint8 * 32)]


class TypeSupport(ctypes.Structure):
    """A type as the middleware is given it: rosidl_message_type_support_t."""

    _fields_ = [('typesupport_identifier', c_char_p), ('data', c_void_p), ('func', c_void_p),
                ('get_type_hash_func', c_void_p), ('get_type_description_func', c_void_p),
                ('get_type_description_sources_func', c_void_p)]


class FastRTPSCallbacks(ctypes.Structure):
    """What Fast DDS calls: message_type_support_callbacks_t."""

    _fields_ = [('message_namespace', c_char_p), ('message_name', c_char_p),
                *((name, c_void_p) for name in (
                    'cdr_serialize', 'cdr_deserialize', 'get_serialized_size',
                    'max_serialized_size', 'key_callbacks'))]


class Member(ctypes.Structure):
    """A field of a message in memory."""

    _fields_ = [('name', c_char_p), ('type_id', c_uint8), ('string_upper_bound', c_size_t),
                ('members', c_void_p), ('is_key', c_bool), ('is_array', c_bool),
                ('array_size', c_size_t), ('is_upper_bound', c_bool), ('offset', c_uint32),
                ('default_value', c_void_p),
                *((f'{name}_function', c_void_p) for name in (
                    'size', 'get_const', 'get', 'fetch', 'assign', 'resize'))]


class Members(ctypes.Structure):
    """A message in memory."""

    _fields_ = [('message_namespace', c_char_p), ('message_name', c_char_p),
                ('member_count', c_uint32), ('size_of', c_size_t),
                ('has_any_key_member', c_bool), ('members', POINTER(Member)),
                ('init_function', c_void_p), ('fini_function', c_void_p)]
