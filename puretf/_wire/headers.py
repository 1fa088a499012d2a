"""The headers at the beginning of messages: those of an even sample of the messages of a topic."""

from array import array
from contextlib import suppress
import struct
from typing import Optional

from puretf._text.names import is_too_long
from puretf._wire.encoding import CDR, Encoding

#: The largest number of frames that these messages name.
_MOST_FRAMES = 1000


class Headers:
    """
    The headers of an even sample of the messages of a topic.

    Whenever the sample is full, every second message is dropped, and from then on half as many are
    added.

    :ivar count: the number of all messages
    :ivar step: of so many messages, one is in the sample
    :ivar frames: by name: the number of the frame
    :ivar frame_numbers: by message: the frame
    :ivar arrivals: by message: the time of arrival or of the recording (ns)
    :ivar stamps: by message: the stamp (ns)
    :ivar nanosec: the largest nanosec of a stamp, which should be less than a second
    """

    def __init__(self, encoding: Encoding = CDR, most: int = 20_000) -> None:
        """Create an empty sample of at most `most` messages."""
        self._most, self._header = most, encoding.header
        self.count, self.step, self.nanosec = 0, 1, 0
        self.frames: dict[str, int] = {}
        self.frame_numbers, self.arrivals, self.stamps = array('q'), array('q'), array('q')

    def wants_next(self) -> bool:
        """Count a message; return whether it belongs to the sample."""
        self.count += 1
        return (self.count - 1) % self.step == 0

    def add(self, arrival: int, data: bytes) -> None:
        """Add the header of a message, unless it is damaged; the arrival in ns."""
        try:
            stamp, name, nanosec = self._header(data)
        except struct.error:
            return
        if (number := self._learn(name)) is None:
            return
        if len(self.stamps) >= self._most:
            self.frame_numbers, self.arrivals, self.stamps = (
                each[::2] for each in (self.frame_numbers, self.arrivals, self.stamps))
            self.step *= 2
        if 0 <= arrival < 2**63:
            self.frame_numbers.append(number)
            self.arrivals.append(arrival)
            self.stamps.append(stamp)
            self.nanosec = max(self.nanosec, nanosec)

    def add_frame(self, data: bytes) -> None:
        """Add the frame of a message, but not its times."""
        with suppress(struct.error):
            self._learn(self._header(data)[1])

    def _learn(self, name: bytes) -> Optional[int]:
        """Return the number of a frame; None if there are too many, or its name is too long."""
        text = name.partition(b'\0')[0].decode('utf-8', 'replace')
        if text not in self.frames and (len(self.frames) >= _MOST_FRAMES or is_too_long(text)):
            return None
        return self.frames.setdefault(text, len(self.frames))
