"""Where the frames come from: a bag that is played, or the topics /tf and /tf_static."""

from collections.abc import Iterable, Mapping, Sequence
from time import monotonic
from typing import NamedTuple, Optional, TYPE_CHECKING, Union

from puretf import Frame, SECOND, TransformBuffer
from puretf_tools.inspection.traffic import rate_of, Traffic
from puretf_tools.robot.descriptions import DescriptionOrWhy
from puretf_tools.robot.joint_senders import JointCommanders, JointControls
from puretf_tools.view.hand_publisher import HandPublisher

if TYPE_CHECKING:
    from rclpy.node import Node

    from puretf import Buffer

AnyBuffer = Union[TransformBuffer, 'Buffer']
#: Stamps that differ this much (ns) from the median are outliers.
_FAR = 24 * 3600 * SECOND
#: The length of a trail; a live buffer keeps transforms for twice this time (s).
LENGTH = 20


class Player:
    """The playback clock of a bag: it runs in a loop."""

    def __init__(self, frames: Iterable[Frame]) -> None:
        dynamic = [frame for frame in frames if not frame.is_static and frame.oldest > 0]
        self._begin = min(_without_outliers([frame.oldest for frame in dynamic]))
        self._end = max(self._begin, *_without_outliers([frame.latest for frame in dynamic]))
        self._position, self._last = 0, monotonic()
        self.speed = 1.0  #: how many times as fast as the recording it runs

    @property
    def length(self) -> float:
        """The length of the bag (s); 0 if it has no dynamic frames."""
        return (self._end - self._begin) / SECOND

    @property
    def position(self) -> float:
        """Seconds after the start of the bag."""
        return self._position / SECOND

    @property
    def time(self) -> int:
        """The time on the clock of the stamps (ns)."""
        return self._begin + self._position

    def position_of(self, time: int) -> float:
        """Return a time on the clock of the stamps (ns) in seconds after the start of the bag."""
        return (time - self._begin) / SECOND

    def advance(self, plays: bool) -> None:
        """Advance by the time since the last call; from the end of the bag, go to its start."""
        now = monotonic()
        passed, self._last = now - self._last, now
        if plays:
            self._position = (
                0 if self.time >= self._end else
                min(self._end - self._begin, self._position + round(passed * self.speed * SECOND)))

    def seek(self, position: float) -> None:
        """Go to a time, in seconds after the start of the bag."""
        self._position = min(max(0, round(position * SECOND)), self._end - self._begin)


def _without_outliers(stamps: list[int]) -> list[int]:
    """
    Return the stamps (ns) near the median; [1] if there are none.

    The stamps of a node that publishes before its clock is set can be wrong by years.
    """
    if not stamps:
        return [1]
    median = sorted(stamps)[len(stamps) // 2]
    return [stamp for stamp in stamps if abs(stamp - median) < _FAR]


class Publication(NamedTuple):
    """How a frame is published."""

    rate: Optional[float]  #: Hz; None if the rate is not known
    delay: Optional[float]  #: the average time from stamp to reception (s); None if not known
    publisher: str  #: the names of the nodes that publish the frame; for a bag, the authority


class Feed:
    """Where the frames come from."""

    name: str  #: as shown in the panel
    buffer: AnyBuffer
    player: Optional[Player] = None  #: the playback clock of a bag; None if the frames are live
    hand_publisher: Optional[HandPublisher] = None  #: None for a bag: nothing can be published
    joint_controls: Optional[JointControls] = None  #: None for a bag
    #: What `tf_doctor` finds in a bag: a line of text, and its time (ns; 0: none). It is empty
    #: until the bag is examined.
    findings: Sequence[tuple[str, int]] = ()

    def descriptions(self) -> Mapping[str, DescriptionOrWhy]:
        """Return the descriptions of robots by topic; the same object if none has changed."""
        return {}

    def publication(self, frame: Frame) -> Publication:
        """Return how a frame is published."""
        raise NotImplementedError

    def topics_hint(self) -> str:
        """Return which publishers have a wrong type, and which other topics have transforms."""
        return ''

    def why_no_frames(self) -> str:
        """Return the likely reason that there are no frames."""
        raise NotImplementedError


class BagFeed(Feed):
    """A bag that is played; when it is opened, the command checks its topics."""

    def __init__(self, buffer: TransformBuffer, name: str) -> None:
        self.buffer, self.name = buffer, name
        self.player = Player(buffer.frames())
        self.findings: list[tuple[str, int]] = []
        #: Empty until the command has read them.
        self.robots: Mapping[str, DescriptionOrWhy] = {}

    def descriptions(self) -> Mapping[str, DescriptionOrWhy]:
        return self.robots

    def publication(self, frame: Frame) -> Publication:
        return Publication(rate_of(frame), None, frame.authority)

    def why_no_frames(self) -> str:
        return 'The bag has no transforms up to this time.'


class LiveFeed(Feed):
    """The frames on /tf and /tf_static."""

    def __init__(self, node: 'Node', joint_controls: Optional[JointControls] = None,
                 descriptions: Optional[Mapping[str, DescriptionOrWhy]] = None) -> None:
        """Listen; `joint_controls`, `descriptions`: None: those of the nodes in the network."""
        from puretf_tools.inspection.frame_listener import FrameListener
        from puretf_tools.robot.description_listener import DescriptionListener
        self._frame_listener = FrameListener(node, 2 * LENGTH)
        self._traffic = Traffic(self._frame_listener.now)
        self._descriptions = descriptions if descriptions is not None else DescriptionListener(
            node, self._frame_listener.topics[0].rpartition('/')[0])
        self.name = ' and '.join(reversed(self._frame_listener.topics))
        self.buffer = self._frame_listener.buffer
        self.hand_publisher = HandPublisher(self._frame_listener)
        self.joint_controls = joint_controls or JointCommanders(node)

    def descriptions(self) -> Mapping[str, DescriptionOrWhy]:
        given = self._descriptions
        return given if isinstance(given, Mapping) else given.descriptions()

    def publication(self, frame: Frame) -> Publication:
        listener = self._frame_listener
        self._traffic.observe(listener.received().messages)
        publisher = listener.names_of([frame.authority])[frame.authority]
        nodes = [each for each in self._traffic.by_node(listener, frame.name)
                 if each.is_present is not False]
        summary = next((each.summary for each in nodes if each.node == publisher), None)
        if len(several := [each.node for each in nodes if each.is_present]) > 1:
            publisher = f'{" and ".join(several)} (more than one publisher)'
        hertz, delay, _ = summary or (None, None, None)
        return Publication(hertz, delay, publisher)

    def topics_hint(self) -> str:
        return self._frame_listener.topics_hint()

    def why_no_frames(self) -> str:
        return self._frame_listener.why_nothing()
