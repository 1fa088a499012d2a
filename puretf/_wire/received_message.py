"""A TFMessage as bytes, and from where and when it came."""

from time import time_ns

from puretf._core.pose import Row
from puretf._wire.encoding import CDR, Encoding


class ReceivedMessage(bytes):
    """The bytes of a TFMessage, with the publisher's gid, the time of arrival and the topic."""

    #: The gid of the publisher, in hex; '' if the gid is not known. If the middleware does not
    #: report gids: the bytes that it reports instead, in hex.
    publisher = ''
    time = 0  #: the time of arrival, on the system clock (ns)
    sent = 0  #: when it was sent, on the system clock of its computer (ns); 0: not known
    is_static = False  #: True if the message is from /tf_static
    encoding: Encoding = CDR

    @property
    def data(self) -> bytes:
        """The bytes of the message."""
        return self

    @classmethod
    def of(cls, data: bytes, publisher: str = '', time: int = 0, sent: int = 0
           ) -> 'ReceivedMessage':
        """Create a message; a time of 0 is replaced by the current time."""
        message = cls(data)
        message.publisher, message.time, message.sent = publisher, time or time_ns(), sent
        return message

    def rows(self) -> list[Row]:
        """
        Return the transforms of the message, unchanged: names may have a leading slash.

        :returns: for each transform: `stamp_ns`, `frame_id`, `child_frame_id` and `pose`. The pose
            is x, y, z (m) and the quaternion x, y, z, w, which may have any norm.
        :raises ValueError: if the bytes are not those of a TFMessage.
        """
        return CDR.unpack(self)
