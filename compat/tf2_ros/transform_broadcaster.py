"""The module of tf2_ros with the broadcaster of dynamic transforms."""

import _dummy_arm_tf2.ros  # noqa: F401

from dummy_arm.tf import TFMessage as TFMessage
from dummy_arm.tf import TransformBroadcaster as TransformBroadcaster
