"""The module of tf2_ros with the client of a buffer server, which is not available."""

from _dummy_arm_tf2.unavailable import BufferClient as BufferClient
from _dummy_arm_tf2.unavailable import LookupTransform as LookupTransform
from _dummy_arm_tf2.unavailable import LookupTransformGoal as LookupTransformGoal
from _dummy_arm_tf2.unavailable import LookupTransformResult as LookupTransformResult
