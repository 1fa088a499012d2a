"""Where the frames come from: a bag that is played, or the topics /tf and /tf_static."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from time import monotonic
from typing import Optional, TYPE_CHECKING

from puretf import exact_time, Frame, SECOND, Transform, TransformBuffer, TransformException
from puretf_tools.doctor.checks import Finding
from puretf_tools.doctor.recent import RecentFindings
from puretf_tools.inspection.bag_times import both, span_of
from puretf_tools.inspection.gaps import AnyBuffer, Hole, interpolated
from puretf_tools.inspection.traffic import Traffic
from puretf_tools.robot.joint_senders import JointCommanders, JointControls
from puretf_tools.robot.observed import DescriptionOrWhy

if TYPE_CHECKING:
    from rclpy.node import Node

    from puretf import StaticTransformBroadcaster
    from puretf_tools.inspection.frame_listener import FrameListener

Descriptions = Mapping[str, DescriptionOrWhy]  #: of robots, by topic
#: The length of a trail, and how long a live buffer keeps transforms: for the plots (s).
LENGTH, _KEPT = 20, 120


class Player:
    """The playback clock of a bag: it runs in a loop. All times are on the clock of the stamps."""

    def __init__(self, frames: Iterable[Frame]) -> None:
        self.time = 0  #: what is shown (ns)
        self._last = monotonic()
        self.speed = 1.0  #: how many times as fast as the recording it runs
        #: When the first and the last message were recorded (ns); (0, 0): it is not known.
        self.recorded: tuple[int, int] = (0, 0)
        self.plays = True  #: False: it is paused
        self.loops = True  #: whether it goes on from the start at the end
        self.is_whole = True  #: False while the bag is read: then the player waits at its end
        self.fit(frames)

    def fit(self, frames: Iterable[Frame]) -> None:
        """Begin and end with the dynamic frames of the bag."""
        self.begin, self.end = span_of(frames, self.recorded)  #: ns
        self.seek(self.time)

    @property
    def length(self) -> float:
        """The length of the bag (s); 0 if it has no dynamic frames."""
        return (self.end - self.begin) / SECOND

    @property
    def position(self) -> float:
        """Seconds after the start of the bag."""
        return (self.time - self.begin) / SECOND

    def advance(self, plays: bool) -> None:
        """Advance by the time since the last call; from the end of the bag, go to its start."""
        now = monotonic()
        passed, self._last = now - self._last, now
        if plays:
            is_over = self.loops and self.is_whole and self.time >= self.end
            self.seek(self.begin if is_over else self.time + round(passed * self.speed * SECOND))

    def seek(self, time: int) -> None:
        """Go to a time (ns), or to the nearest one in the bag."""
        self.time = min(max(self.begin, time), self.end)

    def stop_at(self, time: int) -> None:
        self.seek(time)
        self.plays = False


class HandPublisher:
    """Publishes the frames that viewers place by hand, each with a publisher of its own."""

    def __init__(self, frame_listener: 'FrameListener') -> None:
        self._frame_listener = frame_listener
        #: By frame: who publishes it.
        self._broadcasters: dict[str, tuple[object, StaticTransformBroadcaster]] = {}
        #: The frames that have been published.
        self._published: set[str] = set()

    def send(self, transform: Transform, owner: object) -> str:
        """Publish a transform of an owner, and return ''; or return why it is refused."""
        from puretf import StaticTransformBroadcaster
        node, name = self._frame_listener.node, transform.child_frame_id
        if self._broadcasters.get(name, (owner,))[0] is not owner:
            return f'another viewer publishes frame {name} already'
        for frame in self._frame_listener.buffer.frames():
            if frame.name == name and (publisher := self._other_publisher(frame)):
                return f'{publisher} publishes frame {name} already'
        if name not in self._broadcasters:
            self._broadcasters[name] = owner, StaticTransformBroadcaster(node)
        self._broadcasters[name][1].sendTransform(transform._replace(
            stamp=self._frame_listener.now()).to_message())
        self._published.add(name)
        return ''

    def stop(self, name: str) -> None:
        """Stop publishing a frame: listeners that start later do not receive it."""
        if found := self._broadcasters.pop(name, None):
            self._frame_listener.node.destroy_publisher(found[1].pub_tf)

    def _other_publisher(self, frame: Frame) -> str:
        """Return which other node publishes a frame; '' if none does."""
        listener, gid = self._frame_listener, frame.authority
        publisher = listener.names_of([gid])[gid]
        # After our own message, the name is our own, or not known exactly, as with Cyclone DDS.
        is_own = frame.name in self._published and (
            not publisher.startswith('/')
            or publisher == listener.node.get_fully_qualified_name())
        # A frame whose publisher has ended can be published by another one.
        return '' if is_own or listener.is_present(gid) is False else publisher


class Feed:
    name: str  #: as shown in the panel
    buffer: AnyBuffer
    player: Optional[Player] = None  #: the playback clock of a bag; None if the frames are live
    hand_publisher: Optional[HandPublisher] = None  #: None for a bag: nothing can be published
    joint_controls = JointControls()  #: a bag has none
    follow: str = ''  #: the frame that stays in the picture, until a viewer chooses another one
    #: What `tf_doctor` finds, errors first; another object after a change.
    findings: Sequence[Finding] = ()
    verdict: str = ''  #: the line at the end of its report; '': not examined yet
    now: Callable[[], int]  #: returns the time shown, or of the clock of the stamps (ns)
    why_no_frames: Callable[[], str]  #: returns the likely reason that there are no frames
    #: Returns the average delay of a frame (s; None: not known), and who publishes it.
    publication: Callable[[Frame], tuple[Optional[float], str]]
    #: Returns the descriptions of robots; each is the same object until it changes.
    descriptions: Callable[[], Descriptions] = dict
    #: Why transforms may not arrive, or that time has gone back; '' if neither.
    hint: str = ''

    def watch(self, now: float) -> None:
        """Look at what has arrived; `now`: on the monotonic clock (s)."""

    def ago(self, stamp: int) -> str:
        """Write how old a transform is, or its stamp (ns) if that is more than an hour away."""
        age = (self.now() - stamp) / SECOND
        return self.time_text(stamp) if abs(age) > 3600.0 else (
            f'{abs(age):.2f} s {"ago" if age >= 0.0 else "ahead"}')

    def time_text(self, stamp: int) -> str:
        return f'{exact_time(stamp)} s'

    def hole(self, target: str, name: str) -> str:
        """Say over which hole in the data the shown pose is interpolated; '' if there is none."""
        return ''


class BagFeed(Feed):
    """A bag that is played, perhaps while another thread reads it into the buffer."""

    def __init__(self, buffer: TransformBuffer, name: str) -> None:
        self.name = name
        self.buffer: TransformBuffer = buffer
        self.player: Player = Player(buffer.frames())
        self.now = lambda: self.player.time
        #: Empty until the bag has been read.
        self.robots: Descriptions = {}
        #: The fraction of the bag that has been read; None: all of it, or nobody reads it.
        self.done: Optional[float] = None
        self.error: Optional[BaseException] = None  #: what has ended the reading
        self.missing_spans: Sequence[tuple[int, int]] = ()  #: see `Bag.missing_spans`

    def update(self) -> str:
        """Let the player follow the reading; return how far it is, or raise its error."""
        if self.error:
            raise self.error
        done = self.done
        if not self.player.is_whole:
            self.player.fit(self.buffer.frames())
            self.player.is_whole = done is None
        return '' if done is None else f'reading {self.name}: {done * 100:.0f} %'

    def watch(self, now: float) -> None:
        lost = [Hole('', *span).between(self.player.begin) for span in self.missing_spans
                if span[0] < self.player.time < span[1]]
        self.hint = f'a part of the recording is missing or damaged {lost[0]}' if lost else ''

    def descriptions(self) -> Descriptions:
        return self.robots

    def publication(self, frame: Frame) -> tuple[Optional[float], str]:
        return None, frame.authority

    def why_no_frames(self) -> str:
        return 'The bag has no transforms up to this time.'

    def time_text(self, stamp: int) -> str:
        return both(stamp, self.player.begin)

    def hole(self, target: str, name: str) -> str:
        with suppress(TransformException):
            return interpolated(self.buffer, target, name, self.player.time, self.player.begin)
        return ''


class LiveFeed(Feed):
    """The frames on /tf and /tf_static."""

    def __init__(self, node: 'Node', joint_controls: Optional[JointControls] = None,
                 descriptions: Optional[Descriptions] = None) -> None:
        """Listen; `joint_controls`, `descriptions`: None: those of the nodes in the network."""
        from puretf.publisher_listener import TransformSampler
        from puretf_tools.inspection.frame_listener import FrameListener
        from puretf_tools.robot.description_listener import DescriptionListener
        self._frame_listener = FrameListener(node, _KEPT)
        self._traffic = Traffic(self._frame_listener.clock)
        self._recent = RecentFindings(
            self._frame_listener, TransformSampler(node, self._frame_listener.topics))
        self.descriptions = DescriptionListener(
            node, self._frame_listener.topics[0].rpartition('/')[0]
        ).descriptions if descriptions is None else lambda: descriptions
        self.name = ' and '.join(reversed(self._frame_listener.topics))
        self.buffer, self.now = self._frame_listener.buffer, self._frame_listener.now
        self.why_no_frames = self._frame_listener.why_nothing
        self.hand_publisher = HandPublisher(self._frame_listener)
        self.joint_controls = joint_controls or JointCommanders(node)

    def watch(self, now: float) -> None:
        received = self._frame_listener.dated()
        self._traffic.observe(received.messages)
        if self._recent.update(received, now):
            self.findings, self.verdict = self._recent.findings, self._recent.verdict
            self.hint = self._frame_listener.topics_hint()

    def publication(self, frame: Frame) -> tuple[Optional[float], str]:
        listener = self._frame_listener
        publisher = listener.names_of([frame.authority])[frame.authority]
        nodes = [each for each in self._traffic.by_node(listener, frame.name)
                 if each.is_present is not False]
        summary = next((each.summary for each in nodes if each.node == publisher), None)
        if len(several := [each.node for each in nodes if each.senders]) > 1:
            publisher = f'{" and ".join(several)} (more than one publisher)'
        return summary and summary.average_delay, publisher
