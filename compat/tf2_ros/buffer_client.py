"""The module of tf2_ros with the client of a buffer server, which is not available."""

from typing import TypeVar

from _dummy_arm_tf2.unavailable import Unavailable

__all__ = ['BufferClient', 'LookupTransform', 'LookupTransformGoal', 'LookupTransformResult']


class BufferClient(metaclass=Unavailable):
    """The client of a buffer in another process; not available."""


class LookupTransform(metaclass=Unavailable):
    """The action with which a BufferClient looks up transforms; not available."""


LookupTransformGoal = TypeVar('LookupTransformGoal')
LookupTransformResult = TypeVar('LookupTransformResult')
