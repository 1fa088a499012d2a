"""
The names of tf2_py, from `dummy_arm.tf`.

The exceptions need no ROS. `BufferCore` needs it, and is imported on its first use.
"""

from typing import Any, TYPE_CHECKING

import _dummy_arm_tf2  # noqa: F401

from dummy_arm.tf.exceptions import ConnectivityException as ConnectivityException
from dummy_arm.tf.exceptions import ExtrapolationException as ExtrapolationException
from dummy_arm.tf.exceptions import InvalidArgumentException as InvalidArgumentException
from dummy_arm.tf.exceptions import LookupException as LookupException
from dummy_arm.tf.exceptions import TimeoutException as TimeoutException
from dummy_arm.tf.exceptions import TransformException as TransformException

if TYPE_CHECKING:
    from dummy_arm.tf import BufferCore as BufferCore

__all__ = ['BufferCore', 'ConnectivityException', 'ExtrapolationException',
           'InvalidArgumentException', 'LookupException', 'TimeoutException',
           'TransformException']


def __getattr__(name: str) -> Any:
    """Import `BufferCore` on its first use."""
    if name == 'BufferCore':
        import _dummy_arm_tf2.ros  # noqa: F401

        from dummy_arm.tf import BufferCore
        return BufferCore
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    """Return all names, including `BufferCore` before its first use."""
    return sorted({*globals(), *__all__})
