"""Stand-ins for the classes of tf2 that need services, actions or messages of tf2_msgs."""

from typing import Any, NoReturn, TypeVar

__all__ = ['BufferClient', 'FrameGraph', 'FrameGraphSrvRequest', 'FrameGraphSrvResponse',
           'LookupTransform', 'LookupTransformGoal', 'LookupTransformResult']

_REMEDY = ('needs services and actions of tf2_msgs, which only ROS has. To look up transforms, '
           'use a Buffer and a TransformListener, which takes much less CPU time here than in ROS')


class Unavailable(type):
    """The type of a class that can be imported, but not used."""

    def __call__(cls, *_: Any, **__: Any) -> NoReturn:
        """Raise NotImplementedError, which says what to use instead."""
        raise NotImplementedError(f'{cls.__name__} {_REMEDY}')

    def __getattr__(cls, name: str) -> NoReturn:
        """Raise AttributeError for a constant or a nested class."""
        raise AttributeError(f'{cls.__name__}.{name}: {cls.__name__} {_REMEDY}')


class BufferClient(metaclass=Unavailable):
    """The client of a buffer in another process."""


class FrameGraph(metaclass=Unavailable):
    """The service that returns the frames of a buffer."""


class LookupTransform(metaclass=Unavailable):
    """The action with which a BufferClient looks up transforms."""


FrameGraphSrvRequest = TypeVar('FrameGraphSrvRequest')
FrameGraphSrvResponse = TypeVar('FrameGraphSrvResponse')
LookupTransformGoal = TypeVar('LookupTransformGoal')
LookupTransformResult = TypeVar('LookupTransformResult')
