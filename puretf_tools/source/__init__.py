"""Where a command takes transforms from: a bag, or the live system."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Optional, TYPE_CHECKING

from puretf import Frame, Transform, TransformBuffer
from puretf.bag import Bag
from puretf_tools.cli.bag_options import BagOption
from puretf_tools.cli.progress import listen, wait
from puretf_tools.inspection.bag_times import span_of, why_outside
from puretf_tools.inspection.gaps import AnyBuffer, interpolated
from puretf_tools.inspection.stamp_clock import PATIENCE

if TYPE_CHECKING:
    from puretf_tools.inspection.frame_listener import FrameListener


class Source:
    """The transforms of a bag that has been read, or of a node that listens."""

    def __init__(self, buffer: AnyBuffer, span: tuple[int, int] = (0, 0),
                 listener: 'Optional[FrameListener]' = None) -> None:
        self.buffer = buffer
        self.span = span  #: of a bag: the first and the last stamp (ns), see `span_of`
        self.listener = listener  #: None: a bag

    def frames(self) -> list[Frame]:
        """Return all frames; those of the live system with the nodes that publish them."""
        return self.listener.frames() if self.listener else self.buffer.frames()

    def now(self) -> int:
        """Return the time of the listener, or the last stamp in the bag (ns); 0: not known."""
        return self.listener.now() if self.listener else max(
            frame.latest for frame in self.buffer.frames())

    def listen(self, seconds: float, poll: Callable[[], object] = lambda: None) -> float:
        """Listen as `progress.listen`, and until the clock of the stamps is known."""
        if not (listener := self.listener):
            return 0.0
        elapsed = listen(seconds, listener.buffer.frame_names, poll)
        if not listener.knows_clock():
            with suppress(KeyboardInterrupt):
                wait(PATIENCE, 'waiting for /clock', listener.knows_clock)
            listener.patience = 0.0
            poll()
        return elapsed

    def why_not(self, target: str, source: str, time: int = 0) -> str:
        """Return why there is no transform at a time (ns), with a hint; '' if there is one."""
        if self.listener:
            return self.listener.why_no_transform(target, source, time)
        return why_outside(time, self.span) or self.buffer.why_not(target, source, time)

    def lookup(self, target: str, source: str, time: int) -> Transform:
        """Return the transform at a time (ns); raise a TransformException if there is none."""
        if isinstance(self.buffer, TransformBuffer):
            return self.buffer.lookup_transform(target, source, time)
        from rclpy.time import Time
        return Transform.from_message(
            self.buffer.lookup_transform_core(target, source, Time(nanoseconds=time)))

    def interpolated(self, target: str, source: str, time: int) -> str:
        """Say that a pose is interpolated over a hole in a bag; '' if it is not."""
        if self.listener or target == source:
            return ''
        return interpolated(self.buffer, target, source, time, self.span[0])


@contextmanager
def source(name: str, bag: Optional[BagOption], namespace: str, ros_args: Sequence[str],
           seconds: float = 0.0, read: Callable[[Bag], TransformBuffer] = Bag.read
           ) -> Iterator[Source]:
    """
    Read a bag; or spin a node until the end of the `with` block, and listen.

    :param name: that of the node.
    :param seconds: how much longer than usual the listener keeps transforms (s).
    :param read: reads the bag.
    """
    if bag:
        with bag.opened() as opened:
            buffer = read(opened)
        yield Source(buffer, span_of(buffer.frames(), (opened.begin, opened.end)))
        return
    from puretf_tools.cli.node import spinning_node
    from puretf_tools.inspection.frame_listener import FrameListener
    with spinning_node(name, ros_args, namespace) as node:
        listener = FrameListener(node, seconds)
        yield Source(listener.buffer, listener=listener)
