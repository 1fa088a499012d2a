"""What goes wrong with transforms, as in tf2. Every text begins with tf2's own words."""


from collections.abc import Callable
from typing import Any, Optional, TypeVar

_Error = TypeVar('_Error', bound='TransformException')


class TransformException(Exception):
    """Base of all that a lookup raises."""

    _hint: Optional[Callable[[], str]] = None

    @classmethod
    def with_hint(cls: type[_Error], words: str, hint: Callable[[], str]) -> _Error:
        """
        Make an error of tf2's words, and of more that is worked out when somebody reads it.

        Whoever waits for a frame gets many errors that nobody reads.
        """
        error = cls(words)
        error._hint = hint
        return error

    def __str__(self) -> str:
        if self._hint is not None:
            self.args, self._hint = (f'{self.args[0]}{self._hint()}',), None
        return super().__str__()

    def __repr__(self) -> str:
        str(self)
        return super().__repr__()

    def __reduce__(self) -> Any:
        str(self)
        return super().__reduce__()


class ConnectivityException(TransformException):
    """The two frames are not in one tree."""


class LookupException(TransformException):
    """A frame does not exist, or the tree has a loop."""


class ExtrapolationException(TransformException):
    """An edge on the way has no data for the time that was asked for."""


class InvalidArgumentException(TransformException):
    """A frame id is empty or begins with a slash."""


class TimeoutException(TransformException):
    """A wait for a transform has taken too long."""
