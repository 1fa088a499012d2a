"""The TF listener of the commands: it knows who publishes a frame, and why a frame is missing."""

from time import time_ns
from typing import Optional

from rclpy.duration import Duration
from rclpy.node import Node

from puretf import Buffer
from puretf.publisher_listener import PublisherListener
from puretf_tools.inspection.terminal import Once
from puretf_tools.inspection.time_watch import TimeWatch


class FrameListener(PublisherListener):
    """A listener with a buffer of its own, which knows the publisher of each frame."""

    def __init__(self, node: Node, seconds: float = 10.0) -> None:
        """Subscribe to /tf and /tf_static; keep transforms for some seconds."""
        super().__init__(Buffer(Duration(seconds=seconds), node), node)
        #: The names of the topics of static and of dynamic transforms, after remapping.
        self.topics = [each.topic_name for each in self.subscriptions]
        self._time_watch = TimeWatch(self)

    def time_hint(self) -> str:
        """Clear the buffer if time goes back, and say so: see `TimeWatch.follow`."""
        return self._time_watch.follow()

    def topics_hint(self) -> str:
        """Return why transforms may not arrive; '' if there is no sign of it. See `time_hint`."""
        return self.time_hint() or super().topics_hint()

    def now(self) -> int:
        """Return the time of the node (ns); 0 if it waits for /clock, as use_sim_time is set."""
        return int(self.node.get_clock().now().nanoseconds)

    def clock_offset(self) -> Optional[int]:
        """Return the time of the node minus that of this computer (ns); None: not known yet."""
        # Without simulated time, both are one clock; a pause between two looks at it would count.
        if not self.node.get_parameter('use_sim_time').value:
            return 0
        return now - time_ns() if (now := self.now()) else None

    def why_no_transform(self, target: str, source: str, time: int = 0,
                         say: Optional[Once] = None) -> str:
        """
        Return why there is no transform, with a hint; '' if there is one.

        :param time: (ns); 0: the latest time for which every edge on the path has data.
        :param say: abbreviates the text to tf2's words.
        """
        words = self.buffer.why_not(target, source, time, has_hint=False)
        why = words and (self.buffer.why_not(target, source, time) or words)
        return say(why, words) if say else why

    def nothing_received(self, say: Once) -> str:
        """Return that there is no transform yet, and `why_nothing`, which `say` leaves out."""
        words = 'No transform has been received yet.'
        return say(f'{words} {self.why_nothing()}', words)
