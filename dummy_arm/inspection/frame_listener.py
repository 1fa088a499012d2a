"""What the commands hear of TF: the frames and their senders, or why there is none."""

from difflib import SequenceMatcher
import os
from time import monotonic

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from dummy_arm.tf import Buffer, Frame
from dummy_arm.tf.formatting import comma_list, match_candidates, quoted, suggest_names
from dummy_arm.tf.publisher_listener import PublisherListener

_SHOWN = 20
_DISCOVERY = 1.0  # s


class FrameListener:
    """A buffer that is filled by what a node hears; it knows who sent what."""

    def __init__(self, node: Node, seconds: float = 10.0) -> None:
        """
        Start to listen.

        :param seconds: how long transforms are kept.
        """
        self.node, self._begin, self._has_told = node, monotonic(), False
        self.buffer = Buffer(Duration(seconds=seconds), node)
        self.listener = PublisherListener(self.buffer, node)

    def now(self) -> int:
        """Tell the time (ns)."""
        return int(self.node.get_clock().now().nanoseconds)

    def frames(self) -> list[Frame]:
        """List the frames that were heard of, with their senders."""
        return self.listener.frames()

    def why_no_frames(self) -> str:
        """Tell what may be the reason that nothing was heard."""
        publishers = sum(map(self.node.count_publishers, ('/tf', '/tf_static')))
        return (f'Publishers on /tf and /tf_static here: {publishers}. Check that something '
                'publishes, and that it has the same '
                f'ROS_DOMAIN_ID (here: {os.environ.get("ROS_DOMAIN_ID") or 0}) and '
                'ROS_AUTOMATIC_DISCOVERY_RANGE (here: '
                f'{os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"}); or listen '
                'longer: to discover others may take seconds.')

    def why_no_transform(self, target: str, source: str, time: int = 0) -> str:
        """
        Tell why there is no transform, and what frames there are instead.

        Where there is none, the reasons that there may be for it are told once.

        :param time: ns; 0: the latest.
        :returns: '' when there is one.
        """
        is_there, why = self.buffer.can_transform_core(target, source, Time(nanoseconds=time))
        if is_there:
            return ''
        known = self.buffer.frame_names()
        if not known:
            if self._has_told or monotonic() < self._begin + _DISCOVERY:
                return why
            self._has_told = True
            return f'{why} {self.why_no_frames()}'
        for name in (target, source):  # since all are listed
            why = why.replace(f' {suggest_names(name, tuple(known))}', '')
        missing = [name for name in (target, source) if name not in known]
        if len(missing) == 2:
            why = f'{why} {source!r} does not exist either.'
        near = sorted(match_candidates(known), key=lambda name: -max(
            SequenceMatcher(None, name, other).ratio() for other in missing or [target, source]))
        listed = list(dict.fromkeys((*near, *known)))
        return f'{why} Frames here, the nearest names first: {comma_list(listed, _SHOWN, quoted)}.'
