"""What goes wrong with transforms, as in tf2. Every text begins with tf2's own words."""


class TransformException(Exception):
    """Base of all that a lookup raises."""


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
