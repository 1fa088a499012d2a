"""
TF in pure Python: what `import tf2_ros` would have given.

Names that need rclpy are imported when they are first asked for.
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from dummy_arm.tf.buffer_core import BufferCore as BufferCore
    from dummy_arm.tf.exceptions import ConnectivityException as ConnectivityException
    from dummy_arm.tf.exceptions import ExtrapolationException as ExtrapolationException
    from dummy_arm.tf.exceptions import InvalidArgumentException as InvalidArgumentException
    from dummy_arm.tf.exceptions import LookupException as LookupException
    from dummy_arm.tf.exceptions import TimeoutException as TimeoutException
    from dummy_arm.tf.exceptions import TransformException as TransformException
    from dummy_arm.tf.message import TFMessage as TFMessage
    from dummy_arm.tf.static_transform_broadcaster import (
        StaticTransformBroadcaster as StaticTransformBroadcaster,
    )
    from dummy_arm.tf.transform import Transform as Transform
    from dummy_arm.tf.transform_broadcaster import PreparedTransforms as PreparedTransforms
    from dummy_arm.tf.transform_broadcaster import TransformBroadcaster as TransformBroadcaster

_MODULES = {
    'BufferCore': 'buffer_core',
    'ConnectivityException': 'exceptions',
    'ExtrapolationException': 'exceptions',
    'InvalidArgumentException': 'exceptions',
    'LookupException': 'exceptions',
    'PreparedTransforms': 'transform_broadcaster',
    'StaticTransformBroadcaster': 'static_transform_broadcaster',
    'TFMessage': 'message',
    'TimeoutException': 'exceptions',
    'Transform': 'transform',
    'TransformBroadcaster': 'transform_broadcaster',
    'TransformException': 'exceptions',
}


__all__ = [*_MODULES]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
    if name in _MODULES.values():
        return import_module(f'{__name__}.{name}')
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES, *_MODULES.values()})
