"""The exceptions of tf2; the text of a lookup error is that of tf2, and what explains it."""

from collections.abc import Callable
from typing import Any, Optional, TypeVar

from puretf._text.names import abbreviated

__all__ = ['ConnectivityException', 'ExtrapolationException', 'InvalidArgumentException',
           'LookupException', 'TimeoutException', 'TransformException']

_Error = TypeVar('_Error', bound='TransformException')

#: Returns what follows tf2's words in an error, and the codes of the causes.
Explanation = Callable[[Any], tuple[str, tuple[str, ...]]]


class TransformException(Exception):
    """Base class of the errors of a lookup."""

    #: tf2's words, and what follows; None after the text was read.
    _parts: Optional[tuple[str, 'Explanation']] = None
    #: How the lookup has waited: a `_causes.facts.Waited`; None: it has not.
    _waited: Any = None
    _is_duration = False  #: whether a Duration was passed as a time
    _causes: tuple[str, ...] = ()

    def __str__(self) -> str:
        if (parts := self._parts) is not None:  # two threads may come here
            words, explanation = parts
            text, self._causes = explanation(self)
            self.args = (words + ' ' * (words[-1:] not in ' \n') + text,)
            self._parts = None
        return super().__str__()

    @property
    def causes(self) -> tuple[str, ...]:
        """
        The code of the cause that the text names; empty if none is certain.

        `tf_doctor --explain CODE` explains it, and docs/troubleshooting.md lists the codes.
        """
        str(self)
        return self._causes

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
    """Return tf2's words in the text of an error, which must not have been read yet."""
    return str(error.args[0]).rstrip()


def described(value: Any) -> str:
    """
    Return a value and its type for the text of an error, in one line.

    >>> described(0.5)
    '0.5 of type float'
    """
    if is_of_rosbags(value):
        return f'a message {value.__msgtype__} of rosbags'
    return f'{abbreviated(" ".join(repr(value).split()))} of type {type(value).__name__}'


def is_of_rosbags(value: Any) -> bool:
    """Return whether a value is a message of the library rosbags."""
    return hasattr(value, '__msgtype__')


def note_durations(error: TransformException, *times: Any) -> None:
    """Note whether a time of a failed lookup is a Duration."""
    error._is_duration = any(type(time).__name__ == 'Duration' for time in times)


def with_explanation(error: _Error, explanation: Explanation) -> _Error:
    """
    Append an explanation to the text of an error; it is computed when the text is first read.

    While a lookup or a future waits, many errors are raised and discarded. An explanation can take
    long, so do not read the text while you hold the lock of the buffer.
    """
    error._parts = error.args[0], explanation
    return error
