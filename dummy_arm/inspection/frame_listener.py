"""The TF listener of the commands: it knows who publishes a frame, and why a frame is missing."""

from difflib import SequenceMatcher
import os
from time import monotonic

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from dummy_arm.tf import Buffer, Frame
from dummy_arm.tf.formatting import comma_list, match_candidates, quoted, suggest_names
from dummy_arm.tf.publisher_listener import PublisherListener

#: The largest number of known frames that a message lists.
_SHOWN = 20
#: For this time (s) after the start, `why_no_transform` does not add the text of `why_no_frames`,
#: since the publishers may not have been discovered yet.
_DISCOVERY = 1.0


class FrameListener:
    """A buffer with a listener that knows the publisher of each frame."""

    def __init__(self, node: Node, seconds: float = 10.0) -> None:
        """
        Subscribe to /tf and /tf_static.

        :param node: the node that subscribes.
        :param seconds: how long the buffer keeps transforms (s).
        """
        self.node, self._start, self._has_explained = node, monotonic(), False
        self.buffer = Buffer(Duration(seconds=seconds), node)
        self.publisher_listener = PublisherListener(self.buffer, node)

    def now(self) -> int:
        """
        Return the time of the node's clock.

        :returns: the time (ns); 0 if use_sim_time is set and no /clock message has arrived.
        """
        return int(self.node.get_clock().now().nanoseconds)

    def frames(self) -> list[Frame]:
        """
        Return the frames of the buffer.

        :returns: the frames; their authorities are the full names of the publishing nodes.
        """
        return self.publisher_listener.frames()

    def why_no_frames(self) -> str:
        """
        Return the possible reasons why no transform has been received.

        :returns: sentences that name the settings to check.
        """
        publishers = sum(map(self.node.count_publishers, ('/tf', '/tf_static')))
        return (f'Publishers on /tf and /tf_static here: {publishers}. Check that something '
                'publishes, and that it has the same '
                f'ROS_DOMAIN_ID (here: {os.environ.get("ROS_DOMAIN_ID") or 0}) and '
                'ROS_AUTOMATIC_DISCOVERY_RANGE (here: '
                f'{os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"}); or listen '
                'longer: discovery can take several seconds.')

    def why_no_transform(self, target: str, source: str, time: int = 0) -> str:
        """
        Return why there is no transform, and which frames exist.

        If no frame exists at all, the text of `why_no_frames` is added, but only once, and not in
        the first second after the start.

        :param target: the frame in which the transform is expressed.
        :param source: the frame whose pose is looked up.
        :param time: the time of the transform (ns); 0: the latest time for which every edge on the
            path has data.
        :returns: the reason; '' if there is a transform.
        """
        is_available, why = self.buffer.can_transform_core(target, source, Time(nanoseconds=time))
        if is_available:
            return ''
        known = self.buffer.frame_names()
        if not known:
            if self._has_explained or monotonic() < self._start + _DISCOVERY:
                return why
            self._has_explained = True
            return f'{why} {self.why_no_frames()}'
        for name in (target, source):  # the list below replaces these suggestions
            why = why.replace(f' {suggest_names(name, tuple(known))}', '')
        missing = [name for name in (target, source) if name not in known]
        if len(missing) == 2:
            why = f'{why} {source!r} does not exist either.'
        near = sorted(match_candidates(known), key=lambda name: -max(
            SequenceMatcher(None, name, other).ratio() for other in missing or [target, source]))
        listed = list(dict.fromkeys((*near, *known)))
        return f'{why} Frames here, the nearest names first: {comma_list(listed, _SHOWN, quoted)}.'
