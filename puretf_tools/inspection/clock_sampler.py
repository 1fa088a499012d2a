"""Who publishes /clock, and which nodes use it."""

from collections import deque
from collections.abc import Callable
from functools import partial
import struct
from time import monotonic, time_ns
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from puretf import SECOND
from puretf.publisher_listener import nodes_on, TopicReader, UNKNOWN
from puretf_tools.inspection.feeds import Sender, Senders
from puretf_tools.inspection.stamp_clock import StampClock

TOPIC = '/clock'
#: The time between two searches for nodes (s), each of which asks those of the last one that have
#: not answered.
_SCAN_INTERVAL = 1.0
#: A time that has not changed for this long (s) stands.
_STANDS = 3.0
#: The largest number of jumps back that are kept.
_MOST_JUMPS = 1000
#: Programs that show or record what others send; it does not matter which clock they use.
_TOOLS = ('rviz', 'rqt', 'rosbag2', 'foxglove', 'rosbridge', 'transform_listener_impl', 'tf2_echo',
          'tf2_monitor', 'tf_doctor', 'tf_trajectory', 'view_frames', 'web_view', '_')


def is_tool(node: str) -> bool:
    return node.rpartition('/')[2].startswith(_TOOLS)


class ClockSampler:
    """A subscription to /clock, and the clock of the stamps."""

    def __init__(self, node: Node) -> None:
        self._node, self.clock = node, StampClock()
        self._reader = TopicReader(node, Clock, TOPIC, 200)
        self._senders, self._last, self._moved = Senders(), -1, time_ns()
        #: When the time has jumped back (ns, on the system clock).
        self.jumps = deque[int](maxlen=_MOST_JUMPS)

    def senders(self) -> list[Sender]:
        return self._senders.named(self._reader.names_of)

    def nodes(self) -> list[str]:
        """Return the nodes that publish /clock now."""
        return nodes_on(self._node, TOPIC)

    def stands(self) -> float:
        """Return for how long the time has not changed (s), if it is published; 0.0: it runs."""
        silence = (time_ns() - self._moved) / SECOND
        return silence if silence > _STANDS and self.nodes() else 0.0

    def poll(self) -> None:
        for message in self._reader.take():
            if len(message) < 12:
                continue
            order = '<' if message[1] & 1 else '>'
            seconds, nanoseconds = struct.unpack_from(f'{order}iI', message, 4)
            stamp = seconds * SECOND + nanoseconds
            self._senders.add(message.publisher, message.time, stamp)
            self.clock.add(message.time, stamp)
            if stamp < self._last:
                self.jumps.append(message.time)
            if stamp != self._last:
                self._last, self._moved = stamp, message.time

    def close(self) -> None:
        self._reader.close()


class SimTimeSurvey:
    """Asks nodes whether they use /clock, while it is published."""

    def __init__(self, node: Node, sampler: ClockSampler, nodes: Callable[[], set[str]]) -> None:
        """Ask nobody yet; `nodes` returns the full names of those that may be asked."""
        self._node, self._sampler, self._nodes, self._next = node, sampler, nodes, 0.0
        self._clients: dict[str, Any] = {}
        #: By node: whether it uses /clock; nodes that have not answered are left out.
        self.answers: dict[str, bool] = {}

    def poll(self) -> None:
        if monotonic() < self._next:
            return
        self._next = monotonic() + _SCAN_INTERVAL
        publishers = {sender.node for sender in self._sampler.senders()}
        if not publishers:
            return
        own = self._node.get_fully_qualified_name()
        for name in self._nodes() - publishers - self.answers.keys() - {UNKNOWN, own}:
            client = self._clients.get(name)
            if client and client.service_is_ready():
                client.call_async(GetParameters.Request(
                    names=['use_sim_time'])).add_done_callback(partial(self._receive, name))
            elif not client and not is_tool(name):
                self._clients[name] = self._node.create_client(
                    GetParameters, f'{name}/get_parameters')

    def _receive(self, name: str, answer: Any) -> None:
        for value in answer.result().values:
            self.answers[name] = value.bool_value
