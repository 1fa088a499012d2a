"""The TF listener of the commands: it knows who publishes a frame, and why a frame is missing."""

import os
from time import monotonic

from rclpy.duration import Duration
from rclpy.node import Node

from dummy_arm.inspection.robots import joint_states_of
from dummy_arm.tf import Buffer, Frame
from dummy_arm.tf.publisher_listener import PublisherListener

#: How long the discovery of publishers takes at most (s): up to 5 s on a busy computer.
_DISCOVERY = 6.0


class FrameListener:
    """A buffer with a listener that knows the publisher of each frame."""

    def __init__(self, node: Node, seconds: float = 10.0) -> None:
        """Subscribe to /tf and /tf_static; keep transforms for some seconds."""
        self.node, self._start, self._has_explained = node, monotonic(), False
        self.buffer = Buffer(Duration(seconds=seconds), node)
        self.publisher_listener = PublisherListener(self.buffer, node)
        #: The names of the topics of static and of dynamic transforms, after remapping.
        self.topics = [each.topic_name for each in self.publisher_listener.subscriptions]

    def now(self) -> int:
        """Return the time of the node (ns); 0 if it waits for /clock, as use_sim_time is set."""
        return int(self.node.get_clock().now().nanoseconds)

    def frames(self) -> list[Frame]:
        """Return the frames of the buffer; their authorities are the names of nodes."""
        return self.publisher_listener.frames()

    def why_no_frames(self) -> str:
        """Return `topics_hint`, or if it is empty, a hint about the settings to check."""
        if hint := self.topics_hint():
            return hint
        publishers = sum(map(self.node.count_publishers, self.topics))
        joints = joint_states_of(self.topics[0])
        if not publishers and self.node.count_publishers(joints):
            return (f'{joints} has a publisher, but nothing publishes transforms: start '
                    'robot_state_publisher FILE')
        static, dynamic = self.topics
        return (f'Publishers on {dynamic} and {static} here: '
                f'{publishers}. Check that something publishes, and that it has the same '
                f'ROS_DOMAIN_ID (here: {os.environ.get("ROS_DOMAIN_ID") or 0}) and '
                'ROS_AUTOMATIC_DISCOVERY_RANGE (here: '
                f'{os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"}); or listen '
                'longer: discovery can take several seconds.')

    def topics_hint(self) -> str:
        return self.publisher_listener.topics_hint()

    def wrong_type_hint(self) -> str:
        return self.publisher_listener.wrong_type_hint()

    def other_topics_hint(self) -> str:
        return self.publisher_listener.other_topics_hint()

    def why_no_transform(self, target: str, source: str, time: int = 0) -> str:
        """
        Return why there is no transform, with a hint; '' if there is one.

        If nothing has been received after the discovery, `why_no_frames` is added, but only once.

        :param time: (ns); 0: the latest time for which every edge on the path has data.
        """
        why = self.buffer.why_not(target, source, time)
        if (not why or self._has_explained or monotonic() < self._start + _DISCOVERY
                or self.buffer.frame_names() or self.topics_hint()):
            return why
        self._has_explained = True
        return f'{why} {self.why_no_frames()}'
