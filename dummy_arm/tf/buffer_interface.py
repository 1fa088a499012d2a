"""What every buffer offers to users of messages, and the registries of types that it handles."""

from collections.abc import Callable
from copy import deepcopy
from importlib import import_module
from typing import Any, Optional, Union

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time
from std_msgs.msg import Header

MsgStamped = Any
PyKDLType = Any
TransformableObject = Any
TransformableObjectType = Any

#: What a timeout is unless another is given; one object, so that buffers know it.
NO_WAIT = Duration()


class TypeException(Exception):
    """A type is asked for that was not registered."""

    def __init__(self, errstr: str) -> None:
        """Keep the text in `errstr`, too."""
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A subclass of BufferInterface lacks a method."""

    def __init__(self) -> None:
        """Say so."""
        self.errstr = 'CanTransform or LookupTransform not implemented'
        super().__init__(self.errstr)


class BufferInterface:
    """Base class of buffers: `transform`, by way of lookups that a subclass implements."""

    def __init__(self) -> None:
        """Give access to the registered types."""
        self.registration = TransformRegistration()

    def transform(self, object_stamped: TransformableObject, target_frame: str,
                  timeout: Duration = NO_WAIT,
                  new_type: Optional[TransformableObjectType] = None) -> TransformableObject:
        """
        Transform an object from the frame and time in its header to another frame.

        PointStamped, Vector3Stamped, PoseStamped, PoseWithCovarianceStamped, PolygonStamped and
        PointCloud2 are known; others can be registered.

        :param timeout: how long to wait for the transform at most.
        :param new_type: a type to convert the result to, by what is registered.
        :raises TypeException: when a type is not registered.
        :raises TransformException: when there is no transform.
        """
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        transform = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        result = do_transform(object_stamped, transform)
        return result if new_type is None else convert(result, new_type)

    def transform_full(self, object_stamped: TransformableObject, target_frame: str,
                       target_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT,
                       new_type: Optional[TransformableObjectType] = None) -> TransformableObject:
        """
        Transform an object to another frame at another time; else as `transform`.

        :param fixed_frame: the frame in which things stay where they are between the two times.
        """
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        transform = self.lookup_transform_full(
            target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout)
        result = do_transform(object_stamped, transform)
        return result if new_type is None else convert(result, new_type)

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time,
                         timeout: Duration = NO_WAIT) -> TransformStamped:
        """Look up a transform; for a subclass to implement."""
        raise NotImplementedException

    def lookup_transform_full(self, target_frame: str, target_time: Time, source_frame: str,
                              source_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT
                              ) -> TransformStamped:
        """Look up a transform between two times; for a subclass to implement."""
        raise NotImplementedException

    def can_transform(self, target_frame: str, source_frame: str, time: Time,
                      timeout: Duration = NO_WAIT) -> Union[bool, tuple[bool, str]]:
        """Tell whether there is a transform; for a subclass to implement."""
        raise NotImplementedException

    def can_transform_full(self, target_frame: str, target_time: Time, source_frame: str,
                           source_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT
                           ) -> Union[bool, tuple[bool, str]]:
        """Tell whether there is a transform between two times; for a subclass to implement."""
        raise NotImplementedException


def Stamped(  # noqa: N802
        obj: TransformableObject, stamp: Time, frame_id: str) -> TransformableObject:
    """Give an object a header, and return it."""
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj


_transforms: dict[Any, Callable[..., Any]] = {}
_to_messages: dict[Any, Callable[..., Any]] = {}
_from_messages: dict[Any, Callable[..., Any]] = {}
_conversions: dict[Any, Callable[..., Any]] = {}


def register_default(message_type: type, transform: Callable[..., Any]) -> None:
    """Register a type of message with all that it needs, unless the user has done so."""
    _transforms.setdefault(message_type, transform)
    _to_messages.setdefault(message_type, to_msg_msg)
    _from_messages.setdefault(message_type, from_msg_msg)


def to_msg_msg(msg: Any) -> Any:
    """Convert a message to a message: it is one."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """Convert a message from a message: it is one."""
    return msg


def _registered(functions: dict[Any, Callable[..., Any]], key: Any) -> Callable[..., Any]:
    if key not in functions:
        import_module('dummy_arm.tf.geometry')  # registers the types that are known anyway
    if key not in functions:
        raise TypeException(f'Type {key} is not loaded or supported')
    return functions[key]


class TransformRegistration:
    """The functions that transform an object of a type by a TransformStamped."""

    def print_me(self) -> None:
        """Print them all."""
        print(_transforms)

    def add(self, key: TransformableObjectType,
            callback: Callable[[TransformableObject, TransformStamped], TransformableObject]
            ) -> None:
        """Register the function of a type."""
        _transforms[key] = callback

    def get(self, key: TransformableObjectType
            ) -> Callable[[TransformableObject, TransformStamped], TransformableObject]:
        """
        Get the function of a type.

        :raises TypeException: when there is none.
        """
        return _registered(_transforms, key)


class ConvertRegistration:
    """The functions that convert from a type to another, or to and from a message."""

    def add_from_msg(self, key: TransformableObjectType,
                     callback: Callable[[MsgStamped], TransformableObject]) -> None:
        """Register what makes a type from a message."""
        _from_messages[key] = callback

    def add_to_msg(self, key: TransformableObjectType,
                   callback: Callable[[TransformableObject], MsgStamped]) -> None:
        """Register what makes a message from a type."""
        _to_messages[key] = callback

    def add_convert(self, key: tuple[TransformableObjectType, TransformableObjectType],
                    callback: Callable[[Any], TransformableObject]) -> None:
        """Register what converts the first of two types to the second."""
        _conversions[key] = callback

    def get_from_msg(self, key: TransformableObjectType
                     ) -> Callable[[MsgStamped], TransformableObject]:
        """Get what makes a type from a message, or raise a TypeException."""
        return _registered(_from_messages, key)

    def get_to_msg(self, key: TransformableObjectType
                   ) -> Callable[[TransformableObject], MsgStamped]:
        """Get what makes a message from a type, or raise a TypeException."""
        return _registered(_to_messages, key)

    def get_convert(self, key: tuple[TransformableObjectType, TransformableObjectType]
                    ) -> Callable[[Any], TransformableObject]:
        """Get what converts the first of two types to the second, or raise a TypeException."""
        return _registered(_conversions, key)


def convert(a: TransformableObject, b_type: TransformableObjectType) -> TransformableObject:
    """
    Convert an object to a type: directly, else by a copy if it has it, else by way of a message.

    :raises TypeException: when nothing fitting is registered.
    """
    registration = ConvertRegistration()
    try:
        function = registration.get_convert((type(a), b_type))
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
        to_message = registration.get_to_msg(type(a))
        return registration.get_from_msg(b_type)(to_message(a))
    return function(a)
