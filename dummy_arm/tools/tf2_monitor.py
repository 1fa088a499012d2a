"""The command `tf2_monitor`: print the rates and delays of received transforms repeatedly."""

from collections.abc import Iterator, Sequence
from typing import Optional, TYPE_CHECKING

from dummy_arm.cli.parser import add_namespace_option, Parser, run, UsageError
from dummy_arm.cli.signals import sleep
from dummy_arm.inspection.terminal import column_width, padded, show, width, wrapped
from dummy_arm.inspection.traffic import Delays, Stream, summarize, Traffic, WINDOW
from dummy_arm.tf import TransformException
from dummy_arm.tf.formatting import SECOND, shortened, visible

if TYPE_CHECKING:
    from dummy_arm.inspection.frame_listener import FrameListener

#: The interval between two outputs (s), and how often messages are collected in each interval.
_REFRESH, _SAMPLES = 1.0, 20


class Chain:
    """
    The path between two frames, and the delay of this path over time.

    The delay is the current time minus the latest time for which every transform on the path has
    data.
    """

    def __init__(self, frame_listener: 'FrameListener', ends: tuple[str, str]) -> None:
        """
        Create the chain, without samples.

        :param frame_listener: the source of the transforms.
        :param ends: the first and the last frame.
        """
        self._frame_listener, self.ends = frame_listener, ends
        self._ages = Delays()
        #: The time of the last call of `sample` (ns).
        self._latest = 0
        #: The latest time (ns) for which every transform on the path had data when the ends were
        #: last connected; 0 if all transforms on the path are static.
        self._common = 0
        #: After a jump back in time: the value that `_common` had before the jump (ns). It is set
        #: to 0 again when the buffer has been cleared, or when the clock has reached this value.
        self._stale = 0

    def sample(self) -> None:
        """
        Add the current delay of the path to the statistics.

        Nothing is added if the ends are not connected, if all transforms on the path are static,
        if the time is not known, or if the time has jumped back and the buffer is not cleared yet.
        At a jump back in time, the earlier delays are removed from the statistics.
        """
        now, before = self._frame_listener.now(), self._latest
        self._latest = now
        if now < before - SECOND:
            self._ages.clear()
            self._stale = self._common
        try:
            buffer = self._frame_listener.buffer
            self._common = buffer.get_latest_common_time(*self.ends).nanoseconds
        except TransformException:  # `lines` reports the error
            return
        if now < self._stale <= self._common:  # the buffer is not cleared yet
            return
        self._stale = 0
        if self._common and now:  # now is 0 while no message has arrived on /clock
            self._ages.add(now, now - self._common)

    def frames(self) -> list[str]:
        """
        Return the names of the frames on the path.

        :returns: the names, from the first to the last; an empty list if the ends are not
            connected.
        """
        first, last = self.ends
        try:
            return self._frame_listener.buffer.chain(last, first)
        except TransformException:
            return []

    def lines(self) -> list[str]:
        """
        Return the text about the path: its frames and its delay, or why there is no path.

        :returns: the lines.
        """
        first, last = self.ends
        if why := self._frame_listener.why_no_transform(first, last):
            return wrapped(visible(f'Waiting for transform {first} ->  {last}: {why}'))
        age = summarize([self._ages], self._frame_listener.now())
        return [f'Chain is: {" -> ".join(map(shortened, self.frames()))}',
                'Net delay     none: all transforms are static, or the time is not known'
                if age is None else
                f'Net delay     avg = {age.average_delay:.6f} s: max = {age.maximum_delay:.6f} s']


def format_streams(streams: Sequence[Stream]) -> list[str]:
    """
    Format the warnings, the table of frames and the table of nodes.

    There is a warning for each frame that has several publishers.

    :param streams: the streams, in the order of `Traffic.streams`.
    :returns: the lines.
    """
    frames = [stream for stream in streams if stream.frame]
    nodes = [stream for stream in streams if not stream.frame]
    publishers: dict[str, list[str]] = {}
    for stream in frames:
        if stream.is_present and (stream.is_static or stream.summary is not None):
            publishers.setdefault(stream.frame, []).append(stream.node)
    return [
        *(f'Warning: {shortened(frame)} is published by {" and ".join(map(shortened, several))}; '
          'a frame should have one publisher'
          for frame, several in publishers.items() if len(several) > 1),
        '', *_table('Frames:', 'published by', frames), '',
        *_table('All Broadcasters:', 'node', nodes)]


def _table(title: str, node_title: str, streams: Sequence[Stream]) -> Iterator[str]:
    names = [f'  {shortened(stream.frame)}' for stream in streams]
    columns = column_width([len(title), *map(width, names)])
    yield f'{title:<{columns}}{"rate":>11}{"average delay":>16}{"max delay":>14}  {node_title}'
    for name, stream in zip(names, streams):
        yield (f'{padded(name, columns)}{_rate_and_delays(stream)}  '
               f'{shortened(stream.node)}{" (gone)" if stream.is_present is False else ""}')


def _rate_and_delays(stream: Stream) -> str:
    """Return the text of the rate and the delays in a table line, at least 41 characters wide."""
    if stream.is_static:
        return f'{"static":>11}{"":30}'
    if stream.summary is None:
        last = '' if stream.silence is None else f'last received {stream.silence:.1f} s ago'
        return f'{last:>41}'
    rate, average, maximum = stream.summary
    hertz = '?' if rate is None else f'{rate:.1f}'
    return f'{hertz:>8} Hz {average:13.6f} s {maximum:11.6f} s'


def command(source_frame: Optional[str] = None, target_frame: Optional[str] = None,
            namespace: str = '', *, ros_args: Sequence[str] = ()) -> int:
    """
    Print the rates and delays of received transforms every second, until Ctrl-C.

    :param source_frame: the first frame of the path to monitor; None: monitor all frames.
    :param target_frame: the last frame of the path; None if `source_frame` is None.
    :param namespace: the namespace of the topics `tf` and `tf_static`; '': none.
    :param ros_args: the command line, with the name of the command; ROS reads what follows
        `--ros-args`.
    :returns: the exit code.
    :raises UsageError: if only one frame is given, if the name of a frame is empty, or if the
        namespace is invalid.
    """
    ends = tuple(name.removeprefix('/') for name in (source_frame, target_frame)
                 if name is not None)
    if len(ends) == 1 or not all(ends):
        raise UsageError('give two frames, or none to monitor all frames')
    from dummy_arm.cli.node import spinning_node
    from dummy_arm.inspection.frame_listener import FrameListener
    with spinning_node('tf2_monitor', ros_args, namespace) as node:
        traffic = Traffic(lambda: int(node.get_clock().now().nanoseconds))
        frame_listener = FrameListener(node)
        chain = Chain(frame_listener, (ends[0], ends[1])) if len(ends) == 2 else None
        while True:
            dropped = 0
            for _ in range(_SAMPLES):
                messages, newly_dropped = frame_listener.publisher_listener.received()
                traffic.observe(messages)
                dropped += newly_dropped
                if chain is not None:
                    chain.sample()
                sleep(_REFRESH / _SAMPLES)
            show(_results(frame_listener, traffic, chain, dropped))


def _results(frame_listener: 'FrameListener', traffic: Traffic, chain: Optional[Chain],
             dropped: int) -> list[str]:
    listener = frame_listener.publisher_listener
    streams = traffic.streams(listener.names_of, listener.is_present)
    if not streams:
        return wrapped(f'No transform has been received yet. {frame_listener.why_no_frames()}')
    ends = 'all frames' if chain is None else ' to '.join(map(shortened, chain.ends))
    lines = [f'RESULTS: for {ends}, over the last {WINDOW} s']
    if not frame_listener.now():
        lines += wrapped('Warning: use_sim_time is set, but no message has arrived on /clock: '
                         'delays are not known')
    if hint := frame_listener.topics_hint():
        lines += wrapped(f'Warning: {hint}')
    if dropped:
        lines += wrapped(f'Warning: {dropped} messages arrived too fast to be counted')
    if chain is not None:
        lines += chain.lines()
        if names := chain.frames():
            nodes = {stream.node for stream in streams if stream.frame in names}
            streams = [stream for stream in streams
                       if stream.frame in names or (not stream.frame and stream.node in nodes)]
    return [*lines, *format_streams(streams)]


def main(args: Optional[Sequence[str]] = None) -> int:
    """
    Run the command; see `--help`.

    :param args: the command line without the name of the command; None: `sys.argv[1:]`.
    :returns: the exit code.
    """
    parser = Parser(
        'tf2_monitor', 'Print the rate and the delay of the transforms of each frame and each '
        'node every second. If two frames are named, print only the frames and nodes on the path '
        'between these frames, and the net delay of the path.',
        'examples: tf2_monitor\n          tf2_monitor map end_effector')
    parser.add_argument('source_frame', nargs='?')
    parser.add_argument('target_frame', nargs='?')
    add_namespace_option(parser, 'listen to')
    return run(parser, command, args)
