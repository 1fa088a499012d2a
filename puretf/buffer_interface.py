"""The base class of buffers that transform objects, and the registries of their functions."""

# Before the packages of ROS, to say how to install them.
from puretf import geometry

# isort: split
from collections.abc import Callable
from copy import deepcopy
from typing import Any, Optional, Union

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time
from std_msgs.msg import Header

from puretf.exceptions import is_of_rosbags

__all__ = ['BufferInterface', 'ConvertRegistration', 'MsgStamped', 'NotImplementedException',
           'PyKDLType', 'Stamped', 'TransformRegistration', 'TransformableObject',
           'TransformableObjectType', 'TypeException', 'convert']

MsgStamped = Any
PyKDLType = Any
TransformableObject = Any
TransformableObjectType = Any

#: The default timeout: do not wait.
NO_WAIT = Duration()


class TypeException(Exception):
    """No function is registered for a type; the text is the attribute `errstr`, as in tf2_ros."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A subclass of BufferInterface does not implement a method."""

    def __init__(self) -> None:
        self.errstr = 'CanTransform or LookupTransform not implemented'
        super().__init__(self.errstr)


class BufferInterface:
    """
    Base class of buffers: it transforms objects, and a subclass implements the lookups.

    An edge connects a frame with its parent; a path is the edges between two frames. A zero stamp
    or Time means the latest time for which every edge on the path has data. The methods with two
    times have two paths: from each frame to the fixed frame, which does not move between these
    times. A timeout is how long to wait for the transform at most, on the wall clock.
    """

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def transform(self, object_stamped: TransformableObject, target_frame: str,
                  timeout: Duration = NO_WAIT,
                  new_type: Optional[TransformableObjectType] = None) -> TransformableObject:
        """
        Transform an object from the frame and time in its header to another frame.

        The types PointStamped, Vector3Stamped, PoseStamped, PoseWithCovarianceStamped,
        PolygonStamped and PointCloud2 are registered, as in tf2, and also QuaternionStamped,
        WrenchStamped, PoseArray, Path and Odometry. Register other types with
        `TransformRegistration`.

        :param new_type: the type to which the result is converted; None: no conversion.
        :raises TypeException: if no registered function transforms or converts the object.
        :raises TransformException: if there is no such transform; the class of the error says why.
        """
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        transform = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        result = do_transform(object_stamped, transform)
        return result if new_type is None else convert(result, new_type)

    def transform_full(self, object_stamped: TransformableObject, target_frame: str,
                       target_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT,
                       new_type: Optional[TransformableObjectType] = None) -> TransformableObject:
        """Transform an object as `transform` does, but to the target frame at another time."""
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

        :raises TransformException: if there is no such transform; the class of the error says why.
        :raises NotImplementedException: if the subclass does not implement this method.
        """
        raise NotImplementedException

    def lookup_transform_full(self, target_frame: str, target_time: Time, source_frame: str,
                              source_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT
                              ) -> TransformStamped:
        """Return the pose of the source frame at one time, in the target frame at another one."""
        raise NotImplementedException

    def can_transform(self, target_frame: str, source_frame: str, time: Time,
                      timeout: Duration = NO_WAIT) -> Union[bool, tuple[bool, str]]:
        """
        Return whether `lookup_transform` would return a transform; a subclass implements this.

        It may return a tuple of this bool and the text of the error instead.
        """
        raise NotImplementedException

    def can_transform_full(self, target_frame: str, target_time: Time, source_frame: str,
                           source_time: Time, fixed_frame: str, timeout: Duration = NO_WAIT
                           ) -> Union[bool, tuple[bool, str]]:
        """Return whether `lookup_transform_full` would return a transform."""
        raise NotImplementedException


def Stamped(  # noqa: N802
        obj: TransformableObject, stamp: Time, frame_id: str) -> TransformableObject:
    """Set the header of an object, and return the object; `stamp` is a Time message."""
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj


_transforms: dict[Any, Callable[..., Any]] = {
    kind: function for kind, function in geometry.functions.items() if hasattr(kind, 'header')}
_to_messages: dict[Any, Callable[..., Any]] = dict.fromkeys(_transforms, geometry.to_msg_msg)
_from_messages: dict[Any, Callable[..., Any]] = dict.fromkeys(_transforms, geometry.from_msg_msg)
_conversions: dict[Any, Callable[..., Any]] = {}


def _find_function(functions: dict[Any, Callable[..., Any]], key: Any) -> Callable[..., Any]:
    if key in functions:
        return functions[key]
    remedy = ': it is a message of rosbags; create the message of ROS with these fields'
    if not is_of_rosbags(key):
        names = sorted(getattr(each, '__name__', str(each)) for each in functions)
        remedy = f'. The types with a function: {", ".join(names) or "none"}'
    raise TypeException(f'Type {key} is not loaded or supported{remedy}')


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

        It is called with the object and the transform from its frame to the target frame.
        """
        _transforms[key] = callback

    def get(self, key: TransformableObjectType
            ) -> Callable[[TransformableObject, TransformStamped], TransformableObject]:
        """Return the function that transforms objects of a type, or raise a TypeException."""
        return _find_function(_transforms, key)


class ConvertRegistration:
    """
    The registry of the functions that convert objects: from messages, to messages, and directly.

    The methods `get_...` raise a TypeException if no function is registered for `key`.
    """

    def add_from_msg(self, key: TransformableObjectType,
                     callback: Callable[[MsgStamped], TransformableObject]) -> None:
        """Register the function that converts messages to objects of the type `key`."""
        _from_messages[key] = callback

    def add_to_msg(self, key: TransformableObjectType,
                   callback: Callable[[TransformableObject], MsgStamped]) -> None:
        """Register the function that converts objects of the type `key` to messages."""
        _to_messages[key] = callback

    def add_convert(self, key: tuple[TransformableObjectType, TransformableObjectType],
                    callback: Callable[[Any], TransformableObject]) -> None:
        """Register the function that converts objects of the type `key[0]` to `key[1]`."""
        _conversions[key] = callback

    def get_from_msg(self, key: TransformableObjectType
                     ) -> Callable[[MsgStamped], TransformableObject]:
        """Return the function that converts messages to objects of the type `key`."""
        return _find_function(_from_messages, key)

    def get_to_msg(self, key: TransformableObjectType
                   ) -> Callable[[TransformableObject], MsgStamped]:
        """Return the function that converts objects of the type `key` to messages."""
        return _find_function(_to_messages, key)

    def get_convert(self, key: tuple[TransformableObjectType, TransformableObjectType]
                    ) -> Callable[[Any], TransformableObject]:
        """Return the function that converts objects of the type `key[0]` to `key[1]`."""
        return _find_function(_conversions, key)


def convert(a: TransformableObject, b_type: TransformableObjectType) -> TransformableObject:
    """
    Convert an object to another type.

    If a conversion from the type of the object to `b_type` is registered, this conversion is used.
    Otherwise, an object that already has the type `b_type` is copied. Any other object is
    converted to a message, and the message is converted to `b_type`.

    :raises TypeException: if a function that the conversion needs is not registered.
    """
    function = _conversions.get((type(a), b_type))
    if function is not None:
        return function(a)
    if type(a) is b_type:
        return deepcopy(a)
    to_message = _find_function(_to_messages, type(a))
    return _find_function(_from_messages, b_type)(to_message(a))
