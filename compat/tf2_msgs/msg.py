"""The messages of tf2_msgs."""

import _dummy_arm_tf2.ros  # noqa: F401, I001

from _dummy_arm_tf2.unavailable import Unavailable
from dummy_arm.tf import TFMessage as TFMessage

__all__ = ['TF2Error', 'TFMessage']


class TF2Error(metaclass=Unavailable):
    """The error in the result of the action LookupTransform; not available."""
