"""The TF listener of the commands: it knows who publishes a frame, and why a frame is missing."""

from difflib import SequenceMatcher
from itertools import islice
import os
from time import monotonic

from rclpy.duration import Duration
from rclpy.node import Node

from dummy_arm.tf import Buffer, Frame
from dummy_arm.tf.formatting import (
    comma_list,
    match_candidates,
    quoted,
    suggest_names,
    TF_MESSAGE,
)
from dummy_arm.tf.publisher_listener import node_of, PublisherListener

#: The largest number of frames, publishers or topics that a message lists.
_SHOWN = 20
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
        self._has_dynamic_frames = False

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
        static, dynamic = self.topics
        return (f'Publishers on {dynamic} and {static} here: '
                f'{publishers}. Check that something publishes, and that it has the same '
                f'ROS_DOMAIN_ID (here: {os.environ.get("ROS_DOMAIN_ID") or 0}) and '
                'ROS_AUTOMATIC_DISCOVERY_RANGE (here: '
                f'{os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"}); or listen '
                'longer: discovery can take several seconds.')

    def topics_hint(self) -> str:
        return ' '.join(filter(None, [self.wrong_type_hint(), self.other_topics_hint()]))

    def wrong_type_hint(self) -> str:
        """Return who publishes another type than TFMessage on the topics of transforms."""
        wrong = dict.fromkeys(
            f'{node_of(info)} publishes {info.topic_type} on {topic}' for topic in self.topics
            for info in self.node.get_publishers_info_by_topic(topic)
            if info.topic_type != TF_MESSAGE)
        if not wrong:
            return ''
        return (f'{comma_list([*wrong], _SHOWN)}. The type must be {TF_MESSAGE}: send transforms '
                'with a TransformBroadcaster or a StaticTransformBroadcaster.')

    def other_topics_hint(self) -> str:
        """
        Return which other topics have transforms, and the options to receive them.

        It is '' if a dynamic transform was received or has a publisher here, or if a static one
        was received in a namespace.
        """
        static, dynamic = self.topics
        if not self._has_dynamic_frames:
            frames = self.buffer.frames()
            self._has_dynamic_frames = not all(frame.is_static for frame in frames)
            if frames and dynamic != '/tf':
                return ''
        if self._has_dynamic_frames or any(
                info.topic_type == TF_MESSAGE
                for info in self.node.get_publishers_info_by_topic(dynamic)):
            return ''
        remedies: dict[str, str] = {}
        for topic, types in sorted(self.node.get_topic_names_and_types()):
            if (TF_MESSAGE in types and topic not in (static, dynamic)
                    and (count := self.node.count_publishers(topic))):
                base = topic.removesuffix('_static')
                namespace, _, name = base.rpartition('/')
                option = (f'--ros-args -r /tf:={base} -r /tf_static:={base}_static'
                          if name != 'tf' else
                          f'--namespace {namespace[1:]}' if namespace else 'omit --namespace')
                remedies.setdefault(
                    option, f'{topic} has {count} publisher{"s" if count > 1 else ""}: {option}')
        if not remedies:
            return ''
        more = f'; {len(remedies) - _SHOWN} more' if len(remedies) > _SHOWN else ''
        return (f'No transform has arrived on {dynamic}, but '
                f'{"; ".join(islice(remedies.values(), _SHOWN))}{more}.')

    def why_no_transform(self, target: str, source: str, time: int = 0) -> str:
        """
        Return why there is no transform, with a hint; '' if there is one.

        :param time: (ns); 0: the latest time for which every edge on the path has data.
        """
        why = self.buffer.why_not(target, source, time)
        if not why:
            return ''
        known = self.buffer.frame_names()
        if not known:
            is_early = monotonic() < self._start + _DISCOVERY
            if hint := self.wrong_type_hint() if is_early else self.topics_hint():
                return f'{why} {hint}'
            if is_early or self._has_explained:
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
        return (f'{why} Frames here, the nearest names first: '
                f'{comma_list(listed, _SHOWN, quoted)}. {self.topics_hint()}').rstrip()
