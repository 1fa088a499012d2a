"""The listener that observes an arm, in the process of a command or in one of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import json
import os
from select import select
import time
from typing import Any, NamedTuple, TYPE_CHECKING
import warnings

from dummy_arm.grading.processes import end_with_parent, pid_of_publisher, processes
from dummy_arm.grading.program import ProgramError
from dummy_arm.grading.records import Message, Publisher, Report
from puretf_tools.cli.parser import CommandError
from puretf_tools.cli.signals import wait_until

if TYPE_CHECKING:
    from rclpy.node import Node

#: How long to wait for the first transform on /tf (s).
START = 20.0
#: How long a late listener waits for base_link (s).
_LATE = 10.0
#: The largest number of transforms that are judged.
MOST = 1_000_000
#: The line that an observer writes when its program may start.
READY = 'ready'


class Observer:
    """A listener that collects the messages of an arm."""

    def __init__(self, node: 'Node') -> None:
        from puretf_tools.inspection.frame_listener import FrameListener
        self._node = node
        self.listener = FrameListener(node)
        self.messages: list[Message] = []
        #: True if a message of /tf has been received.
        self.has_started = False
        self._count = 0
        #: All publishers that have been seen on the topics of transforms, by gid.
        self._publishers: dict[str, Publisher] = {}

    def poll(self) -> bool:
        """Collect what has arrived; return `has_started`, or raise ProgramError: too much."""
        received, dropped = self.listener.received()
        for message in received:
            with suppress(ValueError):  # the listener logs this error
                rows = message.rows()
                self._count += len(rows)
                self.messages.append(Message(
                    message.time, message.is_static, message.publisher, rows))
                self.has_started |= not message.is_static
        if dropped or self._count > MOST:
            raise ProgramError('More transforms arrive than can be judged.')
        for gid, (node, topic) in self.listener.publishers().items():
            if gid not in self._publishers:
                self._publishers[gid] = Publisher(
                    gid, node, topic == self.listener.topics[0], pid_of_publisher(gid))
        return self.has_started

    def publishers(self) -> list[Publisher]:
        """Return the publishers that have been seen, those of the oldest process first."""
        found = processes()
        return sorted(self._publishers.values(), key=lambda each: (
            found[each.pid].start if each.pid in found else 0))

    def _reaches_late_joiners(self) -> bool:
        """Return whether a listener that starts now receives base_link on /tf_static."""
        from puretf import StaticTransformListener, TransformBuffer
        buffer = TransformBuffer()
        listener = StaticTransformListener(buffer, self._node)
        try:
            return wait_until(_LATE, lambda: any(
                frame.name == 'base_link' for frame in buffer.frames()))
        finally:
            listener.unregister()

    def report(self, is_at_once: bool = False) -> Report:
        """Judge the messages; before that, start a late listener, unless it is at once."""
        from dummy_arm.grading.requirements import check
        if is_at_once:
            return check(self.messages, publishers=self.publishers())._replace(passed=False)
        self.poll()
        end = time.time_ns()
        is_sent = any(row.child_frame_id.removeprefix('/') == 'base_link'
                      for message in self.messages if message.is_static for row in message.rows)
        return check(self.messages, is_sent and self._reaches_late_joiners(), end,
                     self.publishers())


class Observation(NamedTuple):
    """What an observer in a process of its own has found."""

    report: Report
    has_messages: bool
    wrong_type: str  #: who publishes another type than TFMessage; '' if nobody does
    publishers: list[Publisher]

    @classmethod
    def from_json(cls, text: bytes) -> 'Observation':
        """Read the last line that `main` writes, or raise the error that it says."""
        result = json.loads(text)
        if isinstance(result, str):
            raise CommandError(result)
        if len(result) == 1:
            raise ProgramError(*result)
        report, has_messages, wrong_type, publishers = result
        return cls(Report.from_json(*report), has_messages, wrong_type,
                   [Publisher(*each) for each in publishers])


def main(write: Callable[[str], object], seconds: float, domain: int) -> None:
    """
    Observe an arm from the next line of the standard input on; at its end, report at once.

    :param write: writes empty lines, which are signs of life, the line READY, and the last line,
        JSON: an Observation, or [text] of a ProgramError, or the text of a CommandError.
    :param seconds: how long to observe the arm from its first message on /tf (s).
    :param domain: the ROS domain.
    """
    warnings.simplefilter('ignore')  # of numbers that are too large
    end_with_parent()  # also if the middleware hangs, so that the end of the input is not noticed
    try:
        result: Any = _observe(seconds, domain, write)
    except ProgramError as error:
        result = [str(error)]
    except CommandError as error:
        result = str(error)
    write(json.dumps(result))


def _observe(seconds: float, domain: int, write: Callable[[str], object]) -> Observation:
    with _node_in(domain) as node:
        observer = Observer(node)
        write(READY)
        is_over = not os.read(0, 1)

        def is_to_end() -> bool:
            nonlocal is_over
            write('')
            is_over = is_over or bool(select([0], [], [], 0)[0])
            return is_over

        wait_until(START, lambda: observer.poll() or is_to_end())
        if observer.has_started:
            wait_until(seconds, lambda: observer.poll() and is_to_end())
        return Observation(observer.report(is_over), bool(observer.messages),
                           observer.listener.wrong_type_hint(), observer.publishers())


@contextmanager
def _node_in(domain: int) -> Iterator['Node']:
    """Create a node in a domain, or raise CommandError; destroy it at the end of the block."""
    from rclpy.context import Context
    from rclpy.logging import get_logging_severity_from_string, set_logger_level
    from rclpy.node import Node

    from puretf_tools.cli.fast_dds import destroy
    from puretf_tools.cli.node import clear_shared_memory, create
    clear_shared_memory(['check_arm'])
    context = Context()

    def make_node() -> 'Node':
        context.init(args=[], domain_id=domain)
        return Node('check_arm', context=context, enable_rosout=False,
                    start_parameter_services=False)

    # The lines of all programs would be mixed, and the report has what matters.
    set_logger_level('tf2_buffer', get_logging_severity_from_string('FATAL'))
    try:
        node = create(make_node)
        try:
            yield node
        finally:
            destroy(node)
    finally:
        context.try_shutdown()
