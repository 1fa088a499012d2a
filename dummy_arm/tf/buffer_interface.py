"""
The base class of buffers that transform objects.

The functions that transform objects are registered in `TransformRegistration`. The functions that
convert objects to other types are registered in `ConvertRegistration`.
"""

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

#: The default timeout: do not wait. `Buffer.lookup_transform` tests for this object by `is`.
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
        """Create the exception, with the same text as in tf2_ros."""
        self.errstr = 'CanTransform or LookupTransform not implemented'
        super().__init__(self.errstr)


class BufferInterface:
    """
    Base class of buffers: it transforms objects, and a subclass implements the lookups.

    An edge connects a frame with its parent; a path is the edges between two frames.
    """

    def __init__(self) -> None:
        """Create the attribute `registration`, the registry of transform functions."""
        self.registration = TransformRegistration()

    def transform(self, object_stamped: TransformableObject, target_frame: str,
                  timeout: Duration = NO_WAIT,
                  new_type: Optional[TransformableObjectType] = None) -> TransformableObject:
        """
        Transform an object from the frame and time in its header to another frame.

        The types PointStamped, Vector3Stamped, PoseStamped, PoseWithCovarianceStamped,
        PolygonStamped and PointCloud2 are registered. Register other types with
        `TransformRegistration`.

        :param object_stamped: an object of a registered type. A zero stamp in its header means
            the latest time for which every edge on the path has data.
        :param target_frame: the frame in which the result is expressed.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :param new_type: the type to which the result is converted; None: no conversion.
        :returns: the object in the target frame. If `new_type` is not None, the object has this
            type.
        :raises TypeException: if no registered function transforms the object, or if no registered
            function converts the result to `new_type`.
        :raises TransformException: if the needed transform is not available; the class of the
            error says why.
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

        :param object_stamped: an object of a registered type. A zero stamp in its header means
            the latest time for which every edge between the frame of the object and the fixed
            frame has data.
        :param target_frame: the frame in which the result is expressed.
        :param target_time: time of the target frame; a zero Time: the latest time for which every
            edge between the target frame and the fixed frame has data.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :param new_type: as in `transform`.
        :returns: the object in the target frame. If `new_type` is not None, the object has this
            type.
        :raises TypeException: if no registered function transforms the object, or if no registered
            function converts the result to `new_type`.
        :raises TransformException: if the needed transform is not available; the class of the
            error says why.
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
        :raises TransformException: if there is no such transform; the class of the error says why.
        :raises NotImplementedException: if the subclass does not implement this method.
        """
        raise NotImplementedException

    def lookup_transform_full(self, target_frame: str, target_time: Time, source_frame: str,
                              source_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT
                              ) -> TransformStamped:
        """
        Return the pose of the source frame at one time, in the target frame at another time.

        A subclass implements this.

        :param target_frame: the frame in which the result is expressed.
        :param target_time: time of the target frame; a zero Time: the latest time for
            which every edge between the target frame and the fixed frame has data.
        :param source_frame: the frame whose pose is looked up.
        :param source_time: time of the source frame; a zero Time: the latest time for
            which every edge between the source frame and the fixed frame has data.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :returns: the transform from the source frame to the target frame.
        :raises TransformException: if there is no such transform; the class of the error says why.
        :raises NotImplementedException: if the subclass does not implement this method.
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
        :returns: whether the transform is available. A subclass may return a tuple of this bool
            and the text of the error instead.
        :raises NotImplementedException: if the subclass does not implement this method.
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
            which every edge between the target frame and the fixed frame has data.
        :param source_frame: the frame whose pose is looked up.
        :param source_time: time of the source frame; a zero Time: the latest time for
            which every edge between the source frame and the fixed frame has data.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for the transform at most, on the wall clock.
        :returns: whether the transform is available. A subclass may return a tuple of this bool
            and the text of the error instead.
        :raises NotImplementedException: if the subclass does not implement this method.
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
    Register the functions of a message type, but do not replace functions of the user.

    :param message_type: the type. Its objects are messages, so they need no conversion.
    :param transform: the function that transforms the objects; see `TransformRegistration.add`.

    :meta private:
    """
    _transforms.setdefault(message_type, transform)
    _to_messages.setdefault(message_type, to_msg_msg)
    _from_messages.setdefault(message_type, from_msg_msg)


def to_msg_msg(msg: Any) -> Any:
    """
    Return a message unchanged: an object that is a message needs no conversion to a message.

    :param msg: the message.
    :returns: the same message.
    """
    return msg


def from_msg_msg(msg: Any) -> Any:
    """
    Return a message unchanged: an object that is a message needs no conversion from a message.

    :param msg: the message.
    :returns: the same message.
    """
    return msg


def _find_function(functions: dict[Any, Callable[..., Any]], key: Any) -> Callable[..., Any]:
    """Return the function that is registered for a key; raise a TypeException if there is none."""
    if key not in functions:
        import_module('dummy_arm.tf.geometry')  # registers the built-in types
    if key not in functions:
        raise TypeException(f'Type {key} is not loaded or supported')
    return functions[key]


class TransformRegistration:
    """The registry of the functions that transform objects; all buffers share one registry."""

    def print_me(self) -> None:
        """Print the registered functions."""
        print(_transforms)

    def add(self, key: TransformableObjectType,
            callback: Callable[[TransformableObject, TransformStamped], TransformableObject]
            ) -> None:
        """
        Register the function that transforms objects of a type.

        :param key: the type of the objects.
        :param callback: the function. It is called with the object and with a TransformStamped
            from the object's frame to the target frame, and returns the transformed object.
        """
        _transforms[key] = callback

    def get(self, key: TransformableObjectType
            ) -> Callable[[TransformableObject, TransformStamped], TransformableObject]:
        """
        Return the function that transforms objects of a type.

        :param key: the type of the objects.
        :returns: the function, as in `add`.
        :raises TypeException: if no function is registered for `key`.
        """
        return _find_function(_transforms, key)


class ConvertRegistration:
    """
    The registry of the functions that convert objects.

    There are three kinds of functions: from a message to an object, from an object to a message,
    and from an object of one type to an object of another type.
    """

    def add_from_msg(self, key: TransformableObjectType,
                     callback: Callable[[MsgStamped], TransformableObject]) -> None:
        """
        Register the function that converts messages to objects of a type.

        :param key: the type of the objects.
        :param callback: the function; it is called with a message and returns the object.
        """
        _from_messages[key] = callback

    def add_to_msg(self, key: TransformableObjectType,
                   callback: Callable[[TransformableObject], MsgStamped]) -> None:
        """
        Register the function that converts objects of a type to messages.

        :param key: the type of the objects.
        :param callback: the function; it is called with an object and returns the message.
        """
        _to_messages[key] = callback

    def add_convert(self, key: tuple[TransformableObjectType, TransformableObjectType],
                    callback: Callable[[Any], TransformableObject]) -> None:
        """
        Register the function that converts objects of one type to another type.

        :param key: a pair: the type of the objects, and the type of the results.
        :param callback: the function; it is called with an object and returns the result.
        """
        _conversions[key] = callback

    def get_from_msg(self, key: TransformableObjectType
                     ) -> Callable[[MsgStamped], TransformableObject]:
        """
        Return the function that converts messages to objects of a type.

        :param key: the type of the objects.
        :returns: the function, as in `add_from_msg`.
        :raises TypeException: if no function is registered for `key`.
        """
        return _find_function(_from_messages, key)

    def get_to_msg(self, key: TransformableObjectType
                   ) -> Callable[[TransformableObject], MsgStamped]:
        """
        Return the function that converts objects of a type to messages.

        :param key: the type of the objects.
        :returns: the function, as in `add_to_msg`.
        :raises TypeException: if no function is registered for `key`.
        """
        return _find_function(_to_messages, key)

    def get_convert(self, key: tuple[TransformableObjectType, TransformableObjectType]
                    ) -> Callable[[Any], TransformableObject]:
        """
        Return the function that converts objects of one type to another type.

        :param key: a pair: the type of the objects, and the type of the results.
        :returns: the function, as in `add_convert`.
        :raises TypeException: if no function is registered for `key`.
        """
        return _find_function(_conversions, key)


def convert(a: TransformableObject, b_type: TransformableObjectType) -> TransformableObject:
    """
    Convert an object to another type.

    If a conversion from the type of the object to `b_type` is registered, this conversion is used.
    Otherwise, an object that already has the type `b_type` is copied. Any other object is
    converted to a message, and the message is converted to `b_type`.

    :param a: the object.
    :param b_type: the type of the result.
    :returns: an object of the type `b_type`.
    :raises TypeException: if a function that the conversion needs is not registered.
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
