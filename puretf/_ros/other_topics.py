"""What publishers of transforms send, on all topics, also those of no listener."""

from collections import defaultdict
from collections.abc import Sequence
from contextlib import closing, suppress
from time import monotonic, sleep

from rclpy.node import Node

from puretf._causes.facts import Heard, UNKNOWN
from puretf._ros.graph import nodes_by_gid, other_topics
from puretf._ros.messages import TFMessage
from puretf._ros.topic_watch import TopicWatch
from puretf._text.names import is_too_long, TF_MESSAGE

#: How long `Ear` listens, the time until it listens again, and between two looks (s).
_DURATION, _PAUSE, _POLL_INTERVAL = 0.5, 5.0, 0.01
#: The largest number of topics; from so many frames of a publisher on, no more are read.
_MOST_TOPICS, _MOST_FRAMES = 20, 10_000
#: How many messages of a topic are read at most in each `poll`.
_DEPTH = 20


class TransformSampler(TopicWatch):
    """Subscriptions to all topics of transforms except some; no executor serves them."""

    def __init__(self, node: Node, own: Sequence[str]) -> None:
        super().__init__(node, lambda: (
            (topic, TFMessage) for topic in other_topics(node, own)), _MOST_TOPICS, _DEPTH)
        #: By topic and publisher: the parents, and when one was received last (s).
        self._parents: defaultdict[tuple[str, str], dict[str, str]] = defaultdict(dict)
        self._times: dict[tuple[str, str], float] = {}

    def poll(self) -> None:
        """Read what has arrived, and twice a second search for topics."""
        super().poll()
        for topic in self.readers:
            for data, _ in self.take(topic):
                parents = self._parents[topic, data.publisher]
                self._times[topic, data.publisher] = monotonic()
                with suppress(ValueError):  # malformed
                    for row in data.rows() if len(parents) < _MOST_FRAMES else ():
                        parent = row.frame_id.removeprefix('/')
                        child = row.child_frame_id.removeprefix('/')
                        if parent and child and not is_too_long(child):
                            parents[child] = parent

    def heard(self, since: float = 0.0) -> list[Heard]:
        """Return what publishers have sent that were heard since a time (s), or latch it."""
        nodes = self._nodes()
        return [Heard(topic, gid, [nodes[topic][gid]] if gid in nodes[topic] else
                      sorted({*nodes[topic].values()}), parents)
                for (topic, gid), parents in self._parents.items()
                if self._times[topic, gid] >= since or (
                    topic.endswith('_static') and nodes[topic])]

    def is_complete(self) -> bool:
        """Return whether each publisher has sent something, and its node is known."""
        return all(name != UNKNOWN and (topic, gid) in self._parents
                   for topic, by_gid in self._nodes().items() for gid, name in by_gid.items())

    def _nodes(self) -> dict[str, dict[str, str]]:
        return {topic: nodes_by_gid(self.node_for(topic), topic, TF_MESSAGE)
                for topic in self.readers}


class Ear:
    """Listens to all topics of transforms for half a second at most, once in five seconds."""

    def __init__(self, node: Node) -> None:
        self._node, self._heard, self._next = node, tuple[Heard, ...](), 0.0

    def listen(self) -> Sequence[Heard]:
        if monotonic() >= self._next:
            self._next = monotonic() + _DURATION + _PAUSE  # no other thread listens meanwhile
            with suppress(Exception), closing(TransformSampler(self._node, ())) as sampler:
                deadline = monotonic() + _DURATION
                sampler.poll()
                while monotonic() < deadline and not sampler.is_complete():
                    sleep(_POLL_INTERVAL)
                    sampler.poll()
                self._heard = *sampler.heard(),
        return self._heard  # as before if the node is destroyed, or ROS shut down
