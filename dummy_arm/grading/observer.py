"""The listener that observes an arm."""

from collections.abc import Callable
from pathlib import Path
import time
from typing import TYPE_CHECKING

from dummy_arm.grading.program import ProgramError
from dummy_arm.grading.records import ArmPublisher, Messages, Report
from dummy_arm.grading.sheet import BASE
from puretf._causes.domains import ros_domains
from puretf_tools.cli.signals import wait_until

if TYPE_CHECKING:
    from rclpy.node import Node

#: How long a late listener waits for base_link (s).
_LATE = 10.0
#: The largest number of transforms, which a busy computer can judge within a few seconds.
_MOST = 200_000


class Observer:
    """A listener that collects the messages of an arm."""

    def __init__(self, node: 'Node') -> None:
        from puretf_tools.inspection.frame_listener import FrameListener
        self._node = node
        self.listener = FrameListener(node)
        self.messages = Messages()
        #: All publishers that have been seen on the topics of transforms, by gid.
        self.publishers: dict[str, ArmPublisher] = {}

    def poll(self) -> bool:
        """Collect what has arrived; return whether any is of /tf; raise ProgramError: too much."""
        received, dropped = self.listener.received()
        for message in received:
            if dropped or self.messages.size > _MOST:
                raise ProgramError('More transforms arrive than can be judged: does a timer send '
                                   'them, or a loop without a pause?')
            self.messages.add(message)
        for gid, (node, topic) in self.listener.publishers().items():
            if gid not in self.publishers:
                self.publishers[gid] = ArmPublisher(
                    gid, node, topic == self.listener.topics[0], _pid(gid))
        return any(not message.is_static for message in self.messages)

    def _reaches_late_joiners(self, tick: Callable[[], object]) -> bool:
        """Return whether a listener that starts now receives base_link on /tf_static."""
        from puretf import StaticTransformListener, TransformBuffer
        buffer = TransformBuffer()
        listener = StaticTransformListener(buffer, self._node)
        reaches = wait_until(_LATE, lambda: tick() or any(
            frame.name == BASE.name for frame in buffer.frames()))
        listener.unregister()
        return reaches

    def lifecycle_nodes(self) -> list[str]:
        """Return the full names of the lifecycle nodes in the ROS graph."""
        return [name.removesuffix('/get_state')
                for name, types in self._node.get_service_names_and_types()
                if 'lifecycle_msgs/srv/GetState' in types]

    def report(self, int_line: int = 0, place: str = '',
               tick: Callable[[], object] = lambda: None) -> Report:
        """Judge the messages; before that, start a late listener, and call `tick` meanwhile."""
        from dummy_arm.grading.requirements import check
        from dummy_arm.grading.samples import Arm
        self.poll()
        end = time.time_ns()
        has_base = any(row.child_frame_id.removeprefix('/') == BASE.name
                       for message in self.messages if message.is_static for row in message.rows)
        reaches = has_base and self._reaches_late_joiners(tick)
        oldest_first = sorted(self.publishers.values(), key=lambda each: each.pid)
        waits_for = self.listener.around().waits_for
        no_clock = 'use_sim_time needs /clock, which nothing publishes: leave it out.' * any(
            waits_for.get(each.node) == '/clock' for each in oldest_first)
        return check(Arm(self.messages, reaches, end, oldest_first, int_line, place, no_clock))


def _pid(gid: str) -> int:
    """Return the process id of a publisher, from its gid in hex; 0 if it is not known."""
    prefix = bytes.fromhex(gid[:16])
    if prefix[:2] != b'\x01\x0f':
        return 0
    # Fast DDS writes the lower 16 bits of the process id into a gid. Several processes may have
    # them, but seldom two that take part in a ROS domain.
    low = int.from_bytes(prefix[4:6], 'little')
    pids = (int(path.name) for path in Path('/proc').glob('[0-9]*'))
    return next((pid for pid in pids if pid & 0xffff == low and ros_domains([pid])), 0)
