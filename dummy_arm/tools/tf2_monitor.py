"""The command `tf2_monitor`: how often and how late transforms come in, again and again."""

from collections.abc import Iterator, Sequence
from typing import Optional, TYPE_CHECKING

from dummy_arm.cli.parser import Parser, run, UsageError
from dummy_arm.cli.signals import sleep
from dummy_arm.inspection.terminal import column, padded, show, width, wrapped
from dummy_arm.inspection.traffic import Delays, Stream, summarize, Traffic, WINDOW
from dummy_arm.tf import TransformException
from dummy_arm.tf.formatting import SECOND, shortened, visible

if TYPE_CHECKING:
    from dummy_arm.inspection.frame_listener import FrameListener

_SAMPLES = 20
_REFRESH = 1.0  # s


class Chain:
    """The way between two frames, and how old its newest transform is in the course of time."""

    def __init__(self, listening: 'FrameListener', ends: tuple[str, str]) -> None:
        """
        Begin to look.

        :param ends: the frames.
        """
        self._listening, self.ends = listening, ends
        self._ages, self._latest = Delays(), 0
        #: The newest common time at the last look; and, where time was set back, that of before.
        self._common = self._stale = 0

    def sample(self) -> None:
        """Look how old the newest transform is, if there is any that moves."""
        now, before = self._listening.now(), self._latest
        self._latest = now
        if now < before - SECOND:  # time was set back
            self._ages.clear()
            self._stale = self._common
        try:
            self._common = self._listening.buffer.get_latest_common_time(*self.ends).nanoseconds
        except TransformException:  # which `lines` tells
            return
        if self._stale and self._common >= self._stale:  # the buffer is not cleared yet
            return
        self._stale = 0
        if self._common:
            self._ages.add(now, now - self._common)

    def frames(self) -> list[str]:
        """List the frames; none while they are not connected."""
        first, last = self.ends
        try:
            return self._listening.buffer.chain(last, first)
        except TransformException:
            return []

    def lines(self) -> list[str]:
        """Tell it."""
        first, last = self.ends
        if why := self._listening.why_no_transform(first, last):
            return wrapped(visible(f'Waiting for transform {first} ->  {last}: {why}'))
        age = summarize([self._ages], self._listening.now())
        return [f'Chain is: {" -> ".join(map(shortened, self.frames()))}',
                'Net delay     none: nothing moves' if age is None else
                f'Net delay     avg = {age.average_delay:.6f} s: max = {age.maximum_delay:.6f} s']


def format_streams(streams: Sequence[Stream]) -> list[str]:
    """
    Tell what came in.

    :param streams: of frames and nodes, and then of nodes.
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


def _table(title: str, of_senders: str, streams: Sequence[Stream]) -> Iterator[str]:
    names = [f'  {shortened(stream.frame)}' for stream in streams]
    columns = column([len(title), *map(width, names)])
    yield f'{title:<{columns}}{"rate":>11}{"average delay":>16}{"max delay":>14}  {of_senders}'
    for name, stream in zip(names, streams):
        yield (f'{padded(name, columns)}{_told(stream)}  '
               f'{shortened(stream.node)}{"" if stream.is_present else " (gone)"}')


def _told(stream: Stream) -> str:
    """Tell of a stream, in 41 columns or more."""
    if stream.is_static:
        return f'{"static":>11}{"":30}'
    if stream.summary is None:
        heard = '' if stream.silence is None else f'last heard {stream.silence:.1f} s ago'
        return f'{heard:>41}'
    rate, average, maximum = stream.summary
    hertz = '?' if rate is None else f'{rate:.1f}'
    return f'{hertz:>8} Hz {average:13.6f} s {maximum:11.6f} s'


def command(source_frame: Optional[str] = None, target_frame: Optional[str] = None, *,
            ros_args: Sequence[str] = ()) -> int:
    """
    Print what comes in, until Ctrl-C.

    :param source_frame: with target_frame, what is on the way between these.
    :returns: the exit code.
    :raises UsageError: when there is only one frame, or one without name.
    """
    ends = tuple(name.removeprefix('/') for name in (source_frame, target_frame)
                 if name is not None)
    if len(ends) == 1 or not all(ends):
        raise UsageError('give two frames, or none for all')
    from dummy_arm.cli.node import spinning_node
    from dummy_arm.inspection.frame_listener import FrameListener
    with spinning_node('tf2_monitor', ros_args) as node:
        traffic = Traffic(lambda: int(node.get_clock().now().nanoseconds))
        listening = FrameListener(node)
        chain = Chain(listening, (ends[0], ends[1])) if len(ends) == 2 else None
        while True:
            dropped = 0
            for _ in range(_SAMPLES):
                messages, too_many = listening.listener.received()
                traffic.observe(messages)
                dropped += too_many
                if chain is not None:
                    chain.sample()
                sleep(_REFRESH / _SAMPLES)
            show(_results(listening, traffic, chain, dropped))


def _results(listening: 'FrameListener', traffic: Traffic, chain: Optional[Chain],
             dropped: int) -> list[str]:
    streams = traffic.streams(listening.listener.names_of, listening.listener.present)
    if not streams:
        return wrapped(f'nothing yet. {listening.why_no_frames()}')
    ends = 'all frames' if chain is None else ' to '.join(map(shortened, chain.ends))
    lines = [f'RESULTS: for {ends}, over the last {WINDOW} s']
    if not listening.now():
        lines += wrapped('Warning: use_sim_time is set, but nothing comes in on /clock: there are '
                         'no delays')
    if dropped:
        lines += wrapped(f'Warning: {dropped} messages came too fast to be counted')
    if chain is not None:
        lines += chain.lines()
        if names := chain.frames():
            nodes = {stream.node for stream in streams if stream.frame in names}
            streams = [stream for stream in streams
                       if stream.frame in names or (not stream.frame and stream.node in nodes)]
    return [*lines, *format_streams(streams)]


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'tf2_monitor', 'Print how often and how late the transforms of each frame and of each '
        'node come in; with two frames, of those on the way between them, and its net delay.',
        'examples: tf2_monitor\n          tf2_monitor map end_effector')
    parser.add_argument('source_frame', nargs='?')
    parser.add_argument('target_frame', nargs='?')
    return run(parser, command, args)
