"""
The exceptions of tf2.

The text of a lookup error begins with the words of tf2. A hint may follow these words.
"""


from collections.abc import Callable
from typing import Any, Optional, TypeVar

_Error = TypeVar('_Error', bound='TransformException')


class TransformException(Exception):
    """Base class of the errors of a lookup."""

    _hint: Optional[Callable[[], str]] = None

    @classmethod
    def with_hint(cls: type[_Error], words: str, hint: Callable[[], str]) -> _Error:
        """
        Create an error whose text ends with a hint.

        The hint is computed only when the text is first read, because many texts are never read:
        while a lookup or a future waits for a transform, many errors are raised and discarded.

        :param words: the words of tf2.
        :param hint: a function that returns the hint, which is appended to `words`. The function
            is called in the thread that first reads the text. This can be any thread that does
            not hold the lock of the buffer.
        :returns: the error.

        :meta private:
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
    """A frame does not exist, the tree has a loop, or a frame has more than 1000 ancestors."""


class ExtrapolationException(TransformException):
    """An edge on the path between the two frames has no data for the requested time."""


class InvalidArgumentException(TransformException):
    """A frame id is empty or begins with a slash."""


class TimeoutException(TransformException):
    """The transform is still not available when the timeout of a future expires."""
