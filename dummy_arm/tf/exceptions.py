"""What goes wrong with transforms, as in tf2. Every text begins with tf2's own words."""


from collections.abc import Callable
from typing import Any


class TransformException(Exception):
    """
    Base of all that a lookup raises.

    Its text is made when it is asked for: whoever waits for a frame gets many that nobody reads.
    """

    def __init__(self, words: str = '', hint: Callable[[], str] = str) -> None:
        """
        Take tf2's words, and what makes those that come after them.

        :param hint: called once, if at all.
        """
        super().__init__(words)
        self._hint = hint
        self._text = ''

    def __str__(self) -> str:
        if not self._text:
            self._text = f'{self.args[0]}{self._hint()}'
        return self._text

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self),)


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
