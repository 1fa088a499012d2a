"""The base class of buffers that transform objects, and the registries of object types."""

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

#: The default timeout: do not wait. `Buffer.lookup_transform` recognises it by its identity.
NO_WAIT = Duration()


class TypeException(Exception):
    """No function is registered for a type."""

    def __init__(self, errstr: str) -> None:
        """
        Create the exception.

        :param errstr: the text of the exception; kept as the attribute `errstr`, as in tf2_ros.
        """
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A subclass of BufferInterface does not implement a method."""

    def __init__(self) -> None:
        """Create the exception, with the text of tf2_ros."""
        self.errstr = 'CanTransform or LookupTransform not implemented'
        super().__init__(self.errstr)


class BufferInterface:
    """Base class of buffers: transforms objects by lookups that a subclass implements."""

    def __init__(self) -> None:
        """Create the attribute `registration`, the registry of transform functions."""
        self.registration = TransformRegistration()

    def transform(self, object_stamped: TransformableObject, target_frame: str,
                  timeout: Duration = NO_WAIT,
                  new_type: Optional[TransformableObjectType] = None) -> TransformableObject:
        """
        Transform an object from the frame and time in its header to another frame.

        PointStamped, Vector3Stamped, PoseStamped, PoseWithCovarianceStamped, PolygonStamped and
        PointCloud2 are registered; see `TransformRegistration` for other types.

        :param object_stamped: an object with a header, of a registered type. A zero stamp means
            the latest time for which every edge on the path has data.
        :param target_frame: the frame in which the result is expressed.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :param new_type: the type to which the result is converted; None: no conversion.
        :returns: the object in the target frame, of the same type or of `new_type`.
        :raises TypeException: if the type, or a conversion to `new_type`, is not registered.
        :raises TransformException: if there is no such transform; its subclass says why.
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
        Transform an object from the frame and time in its header to another frame and time.

        :param object_stamped: as in `transform`.
        :param target_frame: the frame in which the result is expressed.
        :param target_time: time of the target frame; a zero Time: the latest time for which every
            edge between it and the fixed frame has data.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :param new_type: as in `transform`.
        :returns: the object in the target frame, of the same type or of `new_type`.
        :raises TypeException: if the type, or a conversion to `new_type`, is not registered.
        :raises TransformException: if there is no such transform; its subclass says why.
        """
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        transform = self.lookup_transform_full(
            target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout)
        result = do_transform(object_stamped, transform)
        return result if new_type is None else convert(result, new_type)

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time,
                         timeout: Duration = NO_WAIT) -> TransformStamped:
        """
        Return the pose of the source frame in the target frame; a subclass implements this.

        :param target_frame: the frame in which the result is expressed.
        :param source_frame: the frame whose pose is looked up.
        :param time: time of the transform; a zero Time: the latest time for which every edge on
            the path has data.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :returns: the transform from the source frame to the target frame.
        :raises TransformException: if there is no such transform; its subclass says why.
        :raises NotImplementedException: if the subclass does not implement it.
        """
        raise NotImplementedException

    def lookup_transform_full(self, target_frame: str, target_time: Time, source_frame: str,
                              source_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT
                              ) -> TransformStamped:
        """
        Return the pose of the source frame at one time in the target frame at another time.

        A subclass implements this.

        :param target_frame: the frame in which the result is expressed.
        :param target_time: time of the target frame; a zero Time: the latest time for
            which every edge between it and the fixed frame has data.
        :param source_frame: the frame whose pose is looked up.
        :param source_time: time of the source frame; a zero Time: as for `target_time`.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :returns: the transform from the source frame to the target frame.
        :raises TransformException: if there is no such transform; its subclass says why.
        :raises NotImplementedException: if the subclass does not implement it.
        """
        raise NotImplementedException

    def can_transform(self, target_frame: str, source_frame: str, time: Time,
                      timeout: Duration = NO_WAIT) -> Union[bool, tuple[bool, str]]:
        """
        Return whether `lookup_transform` would return a transform; a subclass implements this.

        :param target_frame: the frame in which the result is expressed.
        :param source_frame: the frame whose pose is looked up.
        :param time: time of the transform; a zero Time: the latest time for which every edge on
            the path has data.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :returns: whether the transform is available; or a tuple of this bool and the text of the
            error.
        :raises NotImplementedException: if the subclass does not implement it.
        """
        raise NotImplementedException

    def can_transform_full(self, target_frame: str, target_time: Time, source_frame: str,
                           source_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT
                           ) -> Union[bool, tuple[bool, str]]:
        """
        Return whether `lookup_transform_full` would return a transform.

        A subclass implements this.

        :param target_frame: the frame in which the result is expressed.
        :param target_time: time of the target frame; a zero Time: the latest time for
            which every edge between it and the fixed frame has data.
        :param source_frame: the frame whose pose is looked up.
        :param source_time: time of the source frame; a zero Time: as for `target_time`.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :returns: whether the transform is available; or a tuple of this bool and the text of the
            error.
        :raises NotImplementedException: if the subclass does not implement it.
        """
        raise NotImplementedException


def Stamped(  # noqa: N802
        obj: TransformableObject, stamp: Time, frame_id: str) -> TransformableObject:
    """
    Set the header of an object, and return the object.

    :param obj: the object, which is changed.
    :param stamp: the stamp of the header, a Time message.
    :param frame_id: the frame of the header.
    :returns: `obj`.
    """
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj


_transforms: dict[Any, Callable[..., Any]] = {}
_to_messages: dict[Any, Callable[..., Any]] = {}
_from_messages: dict[Any, Callable[..., Any]] = {}
_conversions: dict[Any, Callable[..., Any]] = {}


def register_default(message_type: type, transform: Callable[..., Any]) -> None:
    """
    Register the functions of a message type, except those that a user has already registered.

    :param message_type: the type; it needs no conversion to or from a message.
    :param transform: a function as in `TransformRegistration.add`.
    """
    _transforms.setdefault(message_type, transform)
    _to_messages.setdefault(message_type, to_msg_msg)
    _from_messages.setdefault(message_type, from_msg_msg)


def to_msg_msg(msg: Any) -> Any:
    """
    Convert an object that is a message to a message: return it unchanged.

    :param msg: the message.
    :returns: the same message.
    """
    return msg


def from_msg_msg(msg: Any) -> Any:
    """
    Convert a message to an object that is a message: return it unchanged.

    :param msg: the message.
    :returns: the same message.
    """
    return msg


def _find_function(functions: dict[Any, Callable[..., Any]], key: Any) -> Callable[..., Any]:
    """Return the registered function of a key, or raise a TypeException."""
    if key not in functions:
        import_module('dummy_arm.tf.geometry')  # registers the built-in types
    if key not in functions:
        raise TypeException(f'Type {key} is not loaded or supported')
    return functions[key]


class TransformRegistration:
    """The registry of the functions that transform objects, shared by all buffers."""

    def print_me(self) -> None:
        """Print the registered functions."""
        print(_transforms)

    def add(self, key: TransformableObjectType,
            callback: Callable[[TransformableObject, TransformStamped], TransformableObject]
            ) -> None:
        """
        Register the function that transforms objects of a type.

        :param key: the type.
        :param callback: is called with the object and a TransformStamped from the object's frame
            to the target frame, and returns the transformed object.
        """
        _transforms[key] = callback

    def get(self, key: TransformableObjectType
            ) -> Callable[[TransformableObject, TransformStamped], TransformableObject]:
        """
        Return the function that transforms objects of a type.

        :param key: the type.
        :returns: the function, as in `add`.
        :raises TypeException: if none is registered.
        """
        return _find_function(_transforms, key)


class ConvertRegistration:
    """The registry of the functions that convert between types, and to and from messages."""

    def add_from_msg(self, key: TransformableObjectType,
                     callback: Callable[[MsgStamped], TransformableObject]) -> None:
        """
        Register the function that creates an object of a type from a message.

        :param key: the type.
        :param callback: is called with the message and returns the object.
        """
        _from_messages[key] = callback

    def add_to_msg(self, key: TransformableObjectType,
                   callback: Callable[[TransformableObject], MsgStamped]) -> None:
        """
        Register the function that creates a message from an object of a type.

        :param key: the type.
        :param callback: is called with the object and returns the message.
        """
        _to_messages[key] = callback

    def add_convert(self, key: tuple[TransformableObjectType, TransformableObjectType],
                    callback: Callable[[Any], TransformableObject]) -> None:
        """
        Register the function that converts objects of one type to another type.

        :param key: the type of the objects, and the type of the results.
        :param callback: is called with the object and returns the result.
        """
        _conversions[key] = callback

    def get_from_msg(self, key: TransformableObjectType
                     ) -> Callable[[MsgStamped], TransformableObject]:
        """
        Return the function that creates an object of a type from a message.

        :param key: the type.
        :returns: the function, as in `add_from_msg`.
        :raises TypeException: if none is registered.
        """
        return _find_function(_from_messages, key)

    def get_to_msg(self, key: TransformableObjectType
                   ) -> Callable[[TransformableObject], MsgStamped]:
        """
        Return the function that creates a message from an object of a type.

        :param key: the type.
        :returns: the function, as in `add_to_msg`.
        :raises TypeException: if none is registered.
        """
        return _find_function(_to_messages, key)

    def get_convert(self, key: tuple[TransformableObjectType, TransformableObjectType]
                    ) -> Callable[[Any], TransformableObject]:
        """
        Return the function that converts objects of one type to another type.

        :param key: the type of the objects, and the type of the results.
        :returns: the function, as in `add_convert`.
        :raises TypeException: if none is registered.
        """
        return _find_function(_conversions, key)


def convert(a: TransformableObject, b_type: TransformableObjectType) -> TransformableObject:
    """
    Convert an object to a type.

    The registered conversion between the two types is used. If there is none, an object that
    already has the type is copied. Any other object is converted to a message, and the message is
    converted to the type.

    :param a: the object.
    :param b_type: the type of the result.
    :returns: an object of that type.
    :raises TypeException: if a function that this needs is not registered.
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
