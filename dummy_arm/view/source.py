"""What can be looked at: a bag that is played, or what a node receives."""

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
#: A stamp that is farther from most others is not of the same recording (ns).
_FAR = 24 * 3600 * SECOND
#: How long transforms of a node are kept, and how long a trail is (s).
LENGTH = 20


class Player:
    """Goes through the time of a bag, as fast as it was recorded, to its end."""

    def __init__(self, frames: Iterable[Frame]) -> None:
        """
        Stand at the begin.

        :param frames: what the bag has.
        """
        moving = [frame for frame in frames if not frame.is_static and frame.oldest > 0]
        self._begin = min(_without_strays([frame.oldest for frame in moving]))
        self._end = max(self._begin, *_without_strays([frame.latest for frame in moving]))
        self._position, self._last = 0, monotonic()

    @property
    def length(self) -> float:
        """How long the bag is (s); 0 where nothing moves."""
        return (self._end - self._begin) / SECOND

    @property
    def position(self) -> float:
        """How long after the begin it is (s)."""
        return self._position / SECOND

    @property
    def time(self) -> int:
        """What time it is (ns)."""
        return self._begin + self._position

    @property
    def is_at_end(self) -> bool:
        """Whether there is nothing more."""
        return self.time >= self._end

    def advance(self, plays: bool) -> None:
        """
        Go on, by the time since the last call.

        :param plays: whether it goes on at all; at the end it begins anew.
        """
        now = monotonic()
        passed, self._last = now - self._last, now
        if plays:
            self._position = min(self._end - self._begin, 0 if self.is_at_end else
                                 self._position + round(passed * SECOND))

    def seek(self, position: float) -> None:
        """Go to a time after the begin (s)."""
        self._position = min(max(0, round(position * SECOND)), self._end - self._begin)


def _without_strays(stamps: list[int]) -> list[int]:
    """Leave out the stamps that are far from the middle one, as those before the clock was set."""
    if not stamps:
        return [1]
    middle = sorted(stamps)[len(stamps) // 2]
    return [stamp for stamp in stamps if abs(stamp - middle) < _FAR]


class Publication(NamedTuple):
    """How a frame is published."""

    rate: Optional[float]  #: Hz; None: not known
    delay: Optional[float]  #: the average from the stamp to the reception (s); None: not known
    publisher: str


class Source(Protocol):
    """What frames come from."""

    name: str
    buffer: AnyBuffer
    player: Optional[Player]  #: the time of a bag; None: it is now

    def publication(self, frame: Frame) -> Publication:
        """Tell how a frame is published."""

    def why_no_frames(self) -> str:
        """Tell what may be the reason that there is no frame."""


class BagSource:
    """A bag that is played."""

    def __init__(self, buffer: BufferCore, name: str) -> None:
        """Stand at its begin."""
        self.buffer: AnyBuffer = buffer
        self.name = name
        self.player: Optional[Player] = Player(buffer.frames())

    def publication(self, frame: Frame) -> Publication:
        """Tell what was recorded."""
        return Publication(frequency(frame), None, frame.authority)

    def why_no_frames(self) -> str:
        """Tell that they come."""
        return 'There is none yet at this time of the bag.'


class LiveSource:
    """What is on /tf and /tf_static."""

    def __init__(self, node: 'Node') -> None:
        """Begin to listen."""
        from dummy_arm.inspection.frame_listener import FrameListener
        self.name = '/tf and /tf_static'
        self.player: Optional[Player] = None
        self._asked = ''
        self._traffic: Optional[Traffic] = None
        self._listening = FrameListener(node, LENGTH)
        self.buffer: AnyBuffer = self._listening.buffer

    def publication(self, frame: Frame) -> Publication:
        """Tell how a frame is published; rate and delay since it was first asked for."""
        listener = self._listening.listener
        messages, _ = listener.received()
        if self._traffic is None or frame.name != self._asked:
            self._asked = frame.name
            self._traffic = Traffic(self._listening.now, frame.name)
        else:
            self._traffic.observe(messages)
        publisher = listener.names_of([frame.authority])[frame.authority]
        streams = [stream for stream in self._traffic.streams(listener.names_of, listener.present)
                   if stream.frame == frame.name and stream.is_present]
        summary = next((stream.summary for stream in streams if stream.node == publisher), None)
        if len(streams) > 1:
            publisher = f'{" and ".join(stream.node for stream in streams)}: more than one'
        if summary is None:
            return Publication(None, None, publisher)
        return Publication(summary.rate, summary.average_delay, publisher)

    def why_no_frames(self) -> str:
        """Tell what may be the reason that nothing was heard."""
        return self._listening.why_no_frames()
