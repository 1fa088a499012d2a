"""The sources of the frames that are shown: a bag, or the topics /tf and /tf_static."""

from collections.abc import Iterable
from time import monotonic
from typing import NamedTuple, Optional, Protocol, TYPE_CHECKING, Union

from dummy_arm.inspection.forest import frequency
from dummy_arm.inspection.traffic import Traffic
from dummy_arm.tf import BufferCore, Frame
from dummy_arm.tf.formatting import SECOND

if TYPE_CHECKING:
    from rclpy.node import Node

    from dummy_arm.tf import Buffer

#: The buffer of a bag, or of a node.
AnyBuffer = Union[BufferCore, 'Buffer']
#: The start of a bag is the earliest of the first stamps of all dynamic frames. The end is the
#: latest of the last stamps of all dynamic frames. In both cases, stamps that differ from the
#: median of these stamps by this time (ns) or more are ignored.
_FAR = 24 * 3600 * SECOND
#: The length of a trail, and the time for which a live buffer keeps transforms (both in s).
LENGTH = 20


class Player:
    """The playback clock of a bag: it runs at the speed of the recording, in a loop."""

    def __init__(self, frames: Iterable[Frame]) -> None:
        """
        Create a player at the start of the bag.

        :param frames: the frames of the bag.
        """
        dynamic = [frame for frame in frames if not frame.is_static and frame.oldest > 0]
        self._begin = min(_without_outliers([frame.oldest for frame in dynamic]))
        self._end = max(self._begin, *_without_outliers([frame.latest for frame in dynamic]))
        self._position, self._last = 0, monotonic()

    @property
    def length(self) -> float:
        """The length of the bag (s); 0 if it has no dynamic frames."""
        return (self._end - self._begin) / SECOND

    @property
    def position(self) -> float:
        """The current time, in seconds after the start of the bag."""
        return self._position / SECOND

    @property
    def time(self) -> int:
        """The current time on the clock of the stamps (ns)."""
        return self._begin + self._position

    @property
    def is_at_end(self) -> bool:
        """Whether the end of the bag is reached."""
        return self.time >= self._end

    def advance(self, plays: bool) -> None:
        """
        Advance by the time since the last call; from the end of the bag, go to its start.

        :param plays: True if the player runs; False if it is paused, so its time does not change.
        """
        now = monotonic()
        passed, self._last = now - self._last, now
        if plays:
            self._position = min(self._end - self._begin, 0 if self.is_at_end else
                                 self._position + round(passed * SECOND))

    def seek(self, position: float) -> None:
        """
        Go to a time.

        :param position: seconds after the start of the bag, clamped to the length of the bag.
        """
        self._position = min(max(0, round(position * SECOND)), self._end - self._begin)


def _without_outliers(stamps: list[int]) -> list[int]:
    """
    Return the stamps (ns) that are near the median stamp; [1] if there are no stamps.

    The stamps of a node that publishes before its clock is set can be wrong by years.
    """
    if not stamps:
        return [1]
    median = sorted(stamps)[len(stamps) // 2]
    return [stamp for stamp in stamps if abs(stamp - median) < _FAR]


class Publication(NamedTuple):
    """The rate, the delay and the publisher of a frame."""

    rate: Optional[float]  #: Hz; None if the rate is not known
    delay: Optional[float]  #: the average time from stamp to reception (s); None if not known
    publisher: str  #: the names of the nodes that publish the frame; for a bag, the authority


class Source(Protocol):
    """The source of the frames that are shown."""

    name: str  #: the name of the source, as shown in the panel
    buffer: AnyBuffer
    player: Optional[Player]  #: the playback clock of a bag; None if the frames are live

    def publication(self, frame: Frame) -> Publication:
        """
        Return how a frame is published.

        :param frame: the frame.
        :returns: its rate, delay and publisher.
        """

    def topics_hint(self) -> str:
        """
        Return which publishers have a wrong type, and which other topics have transforms.

        :returns: one or more sentences; '' if there are no such publishers and topics.
        """

    def why_no_frames(self) -> str:
        """
        Return the likely reason that there are no frames.

        :returns: one or more sentences.
        """


class BagSource:
    """A bag that is played."""

    def __init__(self, buffer: BufferCore, name: str) -> None:
        """
        Create a source that plays a bag from its start.

        :param buffer: the buffer with all transforms of the bag.
        :param name: the name of the bag.
        """
        self.buffer: AnyBuffer = buffer
        self.name = name
        self.player: Optional[Player] = Player(buffer.frames())

    def publication(self, frame: Frame) -> Publication:
        """
        Return how a frame was published.

        :param frame: the frame.
        :returns: its rate and publisher. The delay is None, since a buffer does not keep the times
            at which transforms were received.
        """
        return Publication(frequency(frame), None, frame.authority)

    def topics_hint(self) -> str:
        """
        Return an empty text: when a bag is opened, the command checks its topics.

        :returns: ''.
        """
        return ''

    def why_no_frames(self) -> str:
        """
        Return the reason that there are no frames.

        :returns: one sentence.
        """
        return 'The bag has no transforms up to this time.'


class LiveSource:
    """The frames on /tf and /tf_static."""

    def __init__(self, node: 'Node') -> None:
        """
        Start to listen to /tf and /tf_static.

        :param node: the node that subscribes.
        """
        from dummy_arm.inspection.frame_listener import FrameListener
        self.player: Optional[Player] = None
        #: The frame whose rate and delay are measured.
        self._measured_frame = ''
        self._traffic: Optional[Traffic] = None
        self._frame_listener = FrameListener(node, LENGTH)
        self.name = ' and '.join(reversed(self._frame_listener.topics))
        self.buffer: AnyBuffer = self._frame_listener.buffer

    def publication(self, frame: Frame) -> Publication:
        """
        Return how a frame is published.

        The rate and the delay are measured for one frame at a time. If the last call was for
        another frame, this call starts a new measurement, so rate and delay are not known yet.

        :param frame: the frame.
        :returns: its rate, delay and publishers.
        """
        listener = self._frame_listener.publisher_listener
        messages, _ = listener.received()
        if self._traffic is None or frame.name != self._measured_frame:
            self._measured_frame = frame.name
            self._traffic = Traffic(self._frame_listener.now, frame.name)
        else:
            self._traffic.observe(messages)
        publisher = listener.names_of([frame.authority])[frame.authority]
        streams = [
            stream for stream in self._traffic.streams(listener.names_of, listener.is_present)
            if stream.frame == frame.name and stream.is_present is not False]
        summary = next((stream.summary for stream in streams if stream.node == publisher), None)
        if len(several := [stream.node for stream in streams if stream.is_present]) > 1:
            nodes = ' and '.join(several)
            publisher = f'{nodes} (more than one publisher)'
        if summary is None:
            return Publication(None, None, publisher)
        return Publication(summary.rate, summary.average_delay, publisher)

    def topics_hint(self) -> str:
        """
        Return which publishers have a wrong type, and which other topics have transforms.

        :returns: as `FrameListener.topics_hint`.
        """
        return self._frame_listener.topics_hint()

    def why_no_frames(self) -> str:
        """
        Return the likely reason that no transforms have arrived.

        :returns: one or more sentences.
        """
        return self._frame_listener.why_no_frames()
