"""The exceptions of tf2. The text of a lookup error is tf2's own; a hint may follow it."""


from collections.abc import Callable
from typing import Any, Optional, TypeVar

_Error = TypeVar('_Error', bound='TransformException')


class TransformException(Exception):
    """Base class of the errors of a lookup."""

    _hint: Optional[Callable[[], str]] = None

    @classmethod
    def with_hint(cls: type[_Error], words: str, hint: Callable[[], str]) -> _Error:
        """
        Create an error whose text ends with a hint, computed when the text is first read.

        A lookup or a future that waits raises and discards many errors whose text is never read.

        :param words: the text of tf2.
        :param hint: returns the text that follows `words`; may be called in any thread, without
            the lock of the buffer.
        :returns: the error.
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
    """A frame does not exist, or the tree has a loop or a path of more than 1000 edges."""


class ExtrapolationException(TransformException):
    """An edge on the path has no data for the requested time."""


class InvalidArgumentException(TransformException):
    """A frame id is empty or begins with a slash."""


class TimeoutException(TransformException):
    """The timeout of a future passed before its transform was available."""
