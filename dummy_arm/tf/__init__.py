"""
TF in pure Python: what `import tf2_ros` would have given.

Names that need rclpy are imported when they are first asked for.
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from dummy_arm.tf.message import TFMessage as TFMessage
    from dummy_arm.tf.static_transform_broadcaster import (
        StaticTransformBroadcaster as StaticTransformBroadcaster,
    )
    from dummy_arm.tf.transform_broadcaster import PreparedTransforms as PreparedTransforms
    from dummy_arm.tf.transform_broadcaster import TransformBroadcaster as TransformBroadcaster

_MODULES = {
    'PreparedTransforms': 'transform_broadcaster',
    'StaticTransformBroadcaster': 'static_transform_broadcaster',
    'TFMessage': 'message',
    'TransformBroadcaster': 'transform_broadcaster',
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)


def __dir__() -> list[str]:
    return sorted((*globals(), *_MODULES))
