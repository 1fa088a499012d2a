"""The TF listener of the commands: it knows who publishes a frame, and why a frame is missing."""

from time import monotonic
from typing import Optional

from rclpy.duration import Duration
from rclpy.node import Node

from puretf import Buffer
from puretf._causes.facts import Surroundings
from puretf._text.names import comma_list, visible
from puretf.publisher_listener import is_given, PublisherListener, Received, ReceivedMessage
from puretf.transform_buffer import CACHE_TIME
from puretf_tools.inspection.clock_sampler import ClockSampler, is_tool, TOPIC
from puretf_tools.inspection.pulse import Pulse
from puretf_tools.inspection.stamp_clock import PATIENCE
from puretf_tools.inspection.terminal import Once
from puretf_tools.inspection.time_watch import TimeWatch

#: For how long messages wait for the choice of the clock if nothing publishes /clock (s), and how
#: many of them.
_DISCOVERY, _MOST_HELD = 2.0, 10_000
#: The time between two choices of the clock (s).
_INTERVAL = 1.0


class FrameListener(PublisherListener):
    """A listener with a buffer of its own, which knows the publisher of each frame."""

    def __init__(self, node: Node, seconds: float = 0.0) -> None:
        """Subscribe to /tf and /tf_static; keep transforms for some seconds longer than usual."""
        self.clock_sampler = ClockSampler(node)
        self.clock = self.clock_sampler.clock  #: that of the stamps
        self.pulse = Pulse()  #: how late this program runs
        self._held: list[ReceivedMessage] = []
        self._since = self._next_choice = 0.0
        self.patience = PATIENCE  #: how long, at most, they wait for the choice of the clock (s)
        #: By publisher: by how much the clock of its computer is ahead (ns), by its messages.
        self.ahead: dict[str, int] = {}
        super().__init__(Buffer(Duration(seconds=seconds, nanoseconds=CACHE_TIME), node), node)
        #: The names of the topics of static and of dynamic transforms, after remapping.
        self.topics = [each.topic_name for each in self.subscriptions]
        #: Clears the buffer if time goes back, and says so.
        self.time_hint = TimeWatch(self).follow

    def topics_hint(self) -> str:
        """Return why transforms may not arrive; '' if there is no sign of it. See `time_hint`."""
        return self.time_hint() or super().topics_hint()

    def around(self) -> Surroundings:
        """Return what the ROS graph shows; of the nodes that wait, tools are left out."""
        around = self._surroundings()
        return around._replace(waits_for={
            node: topic for node, topic in around.waits_for.items() if not is_tool(node)})

    def now(self) -> int:
        """Return the time (ns); 0: use_sim_time is set, and nothing has arrived on /clock."""
        self.knows_clock()
        return self.clock.now()

    def knows_clock(self) -> bool:
        """
        Choose the clock; return False if it may become known by a message of /clock.

        The parameter use_sim_time of the node decides, if the user has set it. Otherwise /clock is
        used if the stamps fit it, and not the system clock.
        """
        self.clock_sampler.poll()
        if (uses := self.node.get_parameter('use_sim_time').value) or is_given(
                self.node, 'use_sim_time'):
            self.clock.is_simulated = uses
            return True
        if (now := monotonic()) < self._next_choice:
            return True
        stamps = [frame.arrived for frame in self.buffer.frames() if frame.arrived]
        if not stamps:
            return True
        choice, self._since = self.clock.choice(stamps), self._since or now
        if choice is not None:
            self.clock.is_simulated = choice
        elif not self._next_choice and len(self._held) < _MOST_HELD and now < self._since + min(
                self.patience, PATIENCE if self.node.count_publishers(TOPIC) else _DISCOVERY):
            return False
        self._next_choice = now + _INTERVAL
        return True

    def dated(self) -> Received:
        """Return the messages since the last call, as `received`, once their clock is known."""
        messages, dropped = self.received()
        for message in messages:
            if message.sent:
                ahead, gid = message.sent - message.time, message.publisher
                self.ahead[gid] = max(ahead, self.ahead.get(gid, ahead))
        self._held += messages
        if not self.knows_clock():
            return Received([], dropped)
        held, self._held = self._held, []
        return Received(held, dropped)

    def clock_text(self) -> str:
        """Return that times are those of /clock; '' if they are not."""
        if not self.clock.is_simulated or not self.clock.now():
            return ''
        nodes = comma_list(self.clock_sampler.nodes(), visible)
        return f'times are those of /clock{nodes and f", published by {nodes}"}'

    def _surroundings(self) -> Surroundings:
        return super()._surroundings()._replace(
            now=self.clock.now(), is_simulated=self.clock.is_simulated)

    def _release(self) -> None:
        self.pulse.end()
        self.clock_sampler.close()
        super()._release()

    def why_no_transform(self, target: str, source: str, time: int = 0,
                         say: Optional[Once] = None) -> str:
        """Return why there is no transform, with a hint unless `say` omits it; '': there is."""
        words = self.buffer.why_not(target, source, time, has_hint=False)
        why = words and (self.buffer.why_not(target, source, time) or words)
        return say(why, words) if say else why

    def nothing_received(self, say: Once) -> str:
        """Return that there is no transform yet, and `why_nothing`, which `say` leaves out."""
        words = 'No transform has been received yet.'
        return say(f'{words} {self.why_nothing()}', words)
