"""
TF of ROS 2 in pure Python, with the names of tf2_ros.

Each name is imported on its first use. So what does not need ROS can be used without it:
TransformBuffer, Transform, Twist, Frame, the exceptions, the times, and the modules bag, rotations
and transform_table.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from puretf._core.frames import Frame as Frame
    from puretf._ros.messages import TFMessage as TFMessage
    from puretf._text.times import exact_time as exact_time
    from puretf._text.times import in_seconds as in_seconds
    from puretf._text.times import SECOND as SECOND
    from puretf.buffer import Buffer as Buffer
    from puretf.buffer_core import BufferCore as BufferCore
    from puretf.buffer_interface import *  # noqa: F403
    from puretf.exceptions import *  # noqa: F403
    from puretf.message_filter import FilterFailureReason as FilterFailureReason
    from puretf.message_filter import MessageFilter as MessageFilter
    from puretf.static_transform_broadcaster import (
        StaticTransformBroadcaster as StaticTransformBroadcaster,
    )
    from puretf.transform import Transform as Transform
    from puretf.transform import Twist as Twist
    from puretf.transform_broadcaster import PreparedTransforms as PreparedTransforms
    from puretf.transform_broadcaster import TransformBroadcaster as TransformBroadcaster
    from puretf.transform_buffer import TransformBuffer as TransformBuffer
    from puretf.transform_listener import StaticTransformListener as StaticTransformListener
    from puretf.transform_listener import TransformListener as TransformListener

#: The public names of each module.
_NAMES = {
    '_core.frames': 'Frame',
    '_ros.messages': 'TFMessage',
    '_text.times': 'exact_time in_seconds SECOND',
    'buffer': 'Buffer',
    'buffer_core': 'BufferCore',
    'buffer_interface':
        'BufferInterface convert ConvertRegistration MsgStamped NotImplementedException PyKDLType '
        'Stamped TransformableObject TransformableObjectType TransformRegistration TypeException',
    'exceptions':
        'ConnectivityException ExtrapolationException InvalidArgumentException LookupException '
        'TimeoutException TransformException',
    'message_filter': 'FilterFailureReason MessageFilter',
    'static_transform_broadcaster': 'StaticTransformBroadcaster',
    'transform': 'Transform Twist',
    'transform_broadcaster': 'PreparedTransforms TransformBroadcaster',
    'transform_buffer': 'TransformBuffer',
    'transform_listener': 'StaticTransformListener TransformListener',
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}
_PUBLIC_MODULES = {module for module in _NAMES if not module.startswith('_')} | {
    'bag', 'geometry', 'point_cloud2', 'publisher_listener', 'rotations', 'transform_table'}
#: The modules that can be imported now.
_USABLE = {*_NAMES, *_PUBLIC_MODULES} if find_spec('rclpy') else {
    '_core.frames', '_text.times', 'bag', 'exceptions', 'rotations', 'transform',
    'transform_buffer', 'transform_table'}

__all__ = sorted(name for name, module in _MODULES.items() if module in _USABLE)


def __getattr__(name: str) -> Any:
    """Import a public name, or a public module of this package, on its first use."""
    if name in _MODULES:
        return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
    if name in _PUBLIC_MODULES:
        return import_module(f'{__name__}.{name}')
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    """Return the names that can be used, including those that are not imported yet."""
    return sorted({*globals(), *__all__, *(_PUBLIC_MODULES & _USABLE)})
