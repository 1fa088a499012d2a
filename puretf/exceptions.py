"""The exceptions of tf2; the text of a lookup error is that of tf2, sometimes with a hint."""

from collections.abc import Callable
from typing import Any, Optional, TypeVar

_Error = TypeVar('_Error', bound='TransformException')


#: The longest value (characters) that the text of an error shows in full.
_LONGEST = 100


class TransformException(Exception):
    """Base class of the errors of a lookup."""

    #: tf2's words, and the hint; None after the text was read.
    _parts: Optional[tuple[str, Callable[[Any], str]]] = None
    #: How the lookup has waited: a `_core.hints.Waited`; None: it has not.
    _waited: Any = None

    def __str__(self) -> str:
        if (parts := self._parts) is not None:  # two threads may come here
            words, hint = parts
            self.args = (words + hint(self._waited),)
            self._parts = None
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


def tf2_words(error: TransformException) -> str:
    """Return the text of an error without the hint; the text must not have been read yet."""
    return str(error.args[0]).rstrip()


def described(value: Any) -> str:
    """
    Return a value and its type for the text of an error, in one line.

    >>> described(0.5)
    '0.5 of type float'

    :meta private:
    """
    if is_of_rosbags(value):
        return f'a message {value.__msgtype__} of rosbags'
    text = ' '.join(repr(value).split())
    return (f'{text if len(text) <= _LONGEST else f"{text[:_LONGEST - 3]}..."} of type '
            f'{type(value).__name__}')


def is_of_rosbags(value: Any) -> bool:
    """
    Return whether a value is a message of the library rosbags.

    :meta private:
    """
    return hasattr(value, '__msgtype__')


def with_hint(error: _Error, hint: Callable[[Any], str]) -> _Error:
    """
    Append a hint to the text of an error; it is computed when the text is first read.

    `hint` is called with the `_core.hints.Waited` of the lookup, or None.

    While a lookup or a future waits, many errors are raised and discarded. A hint can take long to
    compute, so do not read the text while you hold the lock of the buffer.
    """
    error._parts = error.args[0], hint
    return error
