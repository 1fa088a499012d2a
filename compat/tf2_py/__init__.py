"""
The names of tf2_py, from `puretf`.

The exceptions need no ROS. `BufferCore` needs it, and is imported on its first use.
"""

from typing import Any, TYPE_CHECKING

from puretf.exceptions import ConnectivityException as ConnectivityException
from puretf.exceptions import ExtrapolationException as ExtrapolationException
from puretf.exceptions import InvalidArgumentException as InvalidArgumentException
from puretf.exceptions import LookupException as LookupException
from puretf.exceptions import TimeoutException as TimeoutException
from puretf.exceptions import TransformException as TransformException

if TYPE_CHECKING:
    from puretf import BufferCore as BufferCore

__all__ = ['BufferCore', 'ConnectivityException', 'ExtrapolationException',
           'InvalidArgumentException', 'LookupException', 'TimeoutException',
           'TransformException']


def __getattr__(name: str) -> Any:
    """Import `BufferCore` on its first use."""
    if name == 'BufferCore':
        import _dummy_arm_tf2.ros  # noqa: F401

        from puretf import BufferCore
        return BufferCore
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
