"""The listener that observes an arm, in the process of a command or in one of its own."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import json
import os
from select import select
import time
from typing import Any, NamedTuple, TYPE_CHECKING
import warnings

from dummy_arm.cli.parser import CommandError, UsageError
from dummy_arm.cli.signals import wait_until
from dummy_arm.grading.arm_check import check, Line, Message, Publisher, Report
from dummy_arm.grading.processes import end_with_parent, pid_of_publisher, processes
from dummy_arm.grading.program import ProgramError

if TYPE_CHECKING:
    from rclpy.node import Node

#: How long to wait for the first transform on /tf (s).
START = 20.0
#: How long a late listener waits for base_link (s).
_LATE = 10.0
#: The largest number of transforms that are judged.
MOST = 1_000_000


class Observer:
    """A listener that collects the messages of an arm."""

    def __init__(self, node: 'Node') -> None:
        """Subscribe to /tf and /tf_static."""
        from dummy_arm.inspection.frame_listener import FrameListener
        self._node = node
        self._listener = FrameListener(node)
        self.messages: list[Message] = []
        #: True if a message of /tf has been received.
        self.has_started = False
        self._count = 0
        #: All publishers that have been seen on the topics of transforms.
        self._publishers: dict[str, Publisher] = {}

    def poll(self) -> bool:
        """
        Collect the messages that have arrived since the last call.

        :returns: True if a message of /tf has been received, now or earlier.
        :raises ProgramError: if there are too many messages.
        """
        received, dropped = self._listener.publisher_listener.received()
        for message in received:
            with suppress(ValueError):  # the listener logs this error
                rows = message.rows()
                self._count += len(rows)
                self.messages.append(Message(
                    message.time, message.is_static, message.publisher, rows))
                self.has_started |= not message.is_static
        if dropped or self._count > MOST:
            raise ProgramError('More transforms arrive than can be judged.')
        for gid, (node, topic) in self._listener.publisher_listener.publishers().items():
            if gid not in self._publishers:
                self._publishers[gid] = Publisher(
                    gid, node, topic == self._listener.topics[0], pid_of_publisher(gid))
        return self.has_started

    def publishers(self) -> list[Publisher]:
        """Return the publishers that have been seen, those of the oldest process first."""
        found = processes()
        return sorted(self._publishers.values(), key=lambda each: (
            found[each.pid].start if each.pid in found else 0))

    def reaches_late_joiners(self) -> bool:
        """Return whether a listener that starts now receives base_link on /tf_static."""
        from dummy_arm.tf import BufferCore, StaticTransformListener
        buffer = BufferCore()
        listener = StaticTransformListener(buffer, self._node)
        try:
            return wait_until(_LATE, lambda: any(
                frame.name == 'base_link' for frame in buffer.frames()))
        finally:
            listener.unregister()

    def report(self) -> Report:
        """Judge the messages; before that, start a late listener."""
        self.poll()
        end = time.time_ns()
        is_sent = any(row.child_frame_id.removeprefix('/') == 'base_link'
                      for message in self.messages if message.is_static for row in message.rows)
        return check(self.messages, is_sent and self.reaches_late_joiners(), end,
                     self.publishers())

    def why_no_frames(self) -> str:
        """Return the possible reasons why no transform has been received."""
        return self._listener.why_no_frames()

    def wrong_type_hint(self) -> str:
        """Return who publishes another type than TFMessage; '' if nobody does."""
        return self._listener.wrong_type_hint()


class Observation(NamedTuple):
    """What an observer in a process of its own has found."""

    report: Report
    has_messages: bool
    wrong_type: str  #: as `Observer.wrong_type_hint`
    publishers: list[Publisher]

    @classmethod
    def from_json(cls, text: bytes) -> 'Observation':
        """
        Read the last line that `main` writes.

        :raises ProgramError: if it is an error of the program.
        :raises CommandError: if it is another error.
        """
        result = json.loads(text)
        if isinstance(result, str):
            raise CommandError(result)
        if len(result) == 1:
            raise ProgramError(*result)
        report, has_messages, wrong_type, publishers = result
        return cls(report_of(report), has_messages, wrong_type,
                   [Publisher(*each) for each in publishers])


def report_of(values: Sequence[Any]) -> Report:
    """Return the report that was written as JSON."""
    lines, advice, passed = values
    return Report([Line(*line) for line in lines], [Line(*line) for line in advice], passed)


#: The line that an observer writes when its program may start.
READY = 'ready'


def main(write: Callable[[str], object], seconds: float, domain: int, ros_args: Sequence[str]
         ) -> None:
    """
    Observe an arm from the next line of the standard input on; at its end, report at once.

    :param write: writes empty lines, which are signs of life, the line READY, and the last line,
        JSON: an Observation, or [text] of an error of the program, or the text of another error.
    :param seconds: how long to observe the arm from its first message on /tf (s).
    :param domain: the ROS domain.
    :param ros_args: the command line, with the name of the command, for the node that listens.
    """
    warnings.simplefilter('ignore')  # of numbers that are too large
    end_with_parent()  # also if the middleware hangs, so that the end of the input is not noticed
    try:
        result: Any = _observe(seconds, domain, ros_args, write)
    except ProgramError as error:
        result = [str(error)]
    except (CommandError, UsageError) as error:
        result = str(error)
    write(json.dumps(result))


def _observe(seconds: float, domain: int, ros_args: Sequence[str],
             write: Callable[[str], object]) -> Observation:
    with _node_in(domain, ros_args) as node:
        observer = Observer(node)
        write(READY)
        is_over = not os.read(0, 1)

        def is_to_end() -> bool:
            """Write a sign of life, and return whether the input has ended."""
            nonlocal is_over
            write('')
            is_over = is_over or bool(select([0], [], [], 0)[0])
            return is_over

        wait_until(START, lambda: observer.poll() or is_to_end())
        if observer.has_started:
            wait_until(seconds, lambda: observer.poll() and is_to_end())
        report = (check(observer.messages, publishers=observer.publishers()) if is_over
                  else observer.report())
        return Observation(report, bool(observer.messages), observer.wrong_type_hint(),
                           observer.publishers())


@contextmanager
def _node_in(domain: int, ros_args: Sequence[str]) -> Iterator['Node']:
    """
    Create a node in a domain, and destroy it at the end of the `with` block.

    :raises CommandError: if rcl fails.
    :raises UsageError: if the node rejects a parameter.
    """
    from rclpy.context import Context
    from rclpy.logging import get_logging_severity_from_string, set_logger_level
    from rclpy.node import Node

    from dummy_arm.cli.fast_dds import destroy
    from dummy_arm.cli.node import clear_shared_memory, create
    clear_shared_memory(ros_args)
    context = Context()

    def make_node() -> 'Node':
        context.init(args=[*ros_args], domain_id=domain)
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
