"""The messages of tf2_msgs."""

import _dummy_arm_tf2.ros  # noqa: F401
from _dummy_arm_tf2.unavailable import Unavailable

from puretf import TFMessage as TFMessage

__all__ = ['TF2Error', 'TFMessage']


class TF2Error(metaclass=Unavailable):
    """The error in the result of the action LookupTransform; not available."""
