"""The command `tf2_monitor`: print the rates and delays of received transforms repeatedly."""

from collections import deque
from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from statistics import fmean
from typing import Optional, TYPE_CHECKING

from puretf import in_seconds, SECOND, TransformException
from puretf._text.names import shortened, visible
from puretf_tools.cli.parser import add_namespace_option, frame_name, Parser, run, UsageError
from puretf_tools.cli.signals import sleep
from puretf_tools.inspection.terminal import columns, is_terminal, Once, show, wrapped
from puretf_tools.inspection.traffic import NodeTraffic, Traffic, WINDOW
from puretf_tools.source import source

if TYPE_CHECKING:
    from puretf_tools.inspection.frame_listener import FrameListener

#: The interval between two outputs (s), and how often messages are collected in each interval.
_REFRESH, _SAMPLES = 1.0, 20


class Chain:
    """The path between two frames, and its delay: the age of the newest time with all its data."""

    def __init__(self, frame_listener: 'FrameListener', ends: tuple[str, str]) -> None:
        self._frame_listener, self.ends = frame_listener, ends
        self._say = Once(is_terminal())
        #: The last times and delays (ns).
        self._delays: deque[tuple[int, int]] = deque(maxlen=WINDOW * _SAMPLES)
        self._common = 0  #: the newest time (ns) with data of the whole path; 0: it is static

    def sample(self) -> None:
        """Count the current delay, if it is known; after a jump back in time, begin again."""
        now, before = self._frame_listener.now(), self._common
        try:
            buffer = self._frame_listener.buffer
            self._common = buffer.get_latest_common_time(*self.ends).nanoseconds
        except TransformException:  # `lines` reports the error
            return
        if self._common < before - SECOND:  # the buffer was cleared
            self._delays.clear()
        if self._common and now:  # now is 0 while no message has arrived on /clock
            self._delays.append((now, now - self._common))

    def frames(self) -> list[str]:
        """Return the frames from the first to the last; none if there is no path."""
        first, last = self.ends
        try:
            return list(self._frame_listener.buffer.chain(last, first))
        except TransformException:
            return []

    def lines(self) -> list[str]:
        first, last = self.ends
        if why := self._frame_listener.why_no_transform(first, last, 0, self._say):
            return wrapped(f'Waiting for transform {shortened(first)} ->  {shortened(last)}: '
                           f'{visible(why)}')
        begin = self._frame_listener.now() - WINDOW * SECOND
        delays = [in_seconds(delay) for time, delay in self._delays if time >= begin]
        return [f'Chain is: {" -> ".join(map(shortened, self.frames()))}',
                'Net delay     none: all transforms are static, or the time is not known'
                if not delays else
                f'Net delay     avg = {fmean(delays):.6f} s: max = {max(delays):.6f} s']


def format_traffic(rows: Sequence[NodeTraffic]) -> list[str]:
    """Return a warning for each frame with several publishers, and tables of frames and nodes."""
    frames = [row for row in rows if row.frame]
    nodes = [row for row in rows if not row.frame]
    lines = []
    for frame, group in groupby(frames, attrgetter('frame')):
        several = {row.node: row.senders for row in group if row.senders}
        if sum(several.values()) > 1:
            names = [f'{shortened(node)}{f" ({count} publishers)" if count > 1 else ""}'
                     for node, count in several.items()]
            lines.append(f'Warning: {shortened(frame)} is published by {" and ".join(names)}; '
                         'a frame should have one publisher')
    return [*lines, '', *_table('Frames:', 'published by', frames), '',
            *_table('All Broadcasters:', 'node', nodes)]


def _table(title: str, node_title: str, rows: Sequence[NodeTraffic]) -> list[str]:
    head = title, f'{"rate":>9}{"average delay":>16}{"max delay":>14}', node_title
    return columns([head, *(
        (f'  {shortened(row.frame)}', _rate_and_delays(row),
         f'{shortened(row.node)}{" (gone)" if row.is_present is False else ""}')
        for row in rows)])


def _rate_and_delays(row: NodeTraffic) -> str:
    """Return a text of at least 39 columns."""
    if row.is_static:
        return f'{"static":>9}{"":30}'
    if row.summary is None:
        last = '' if row.silence is None else f'last received {row.silence:.1f} s ago'
        return f'{last:>39}'
    rate, average, maximum = row.summary
    hertz = '?' if rate is None else f'{rate:.1f}'
    return f'{hertz:>6} Hz {average:13.6f} s {maximum:11.6f} s'


def command(source_frame: Optional[str], target_frame: Optional[str], namespace: str,
            ros_args: Sequence[str]) -> int:
    """Print the rates and delays of received transforms every second, until Ctrl-C."""
    if source_frame and not target_frame:
        raise UsageError('give two frames, or none to monitor all frames')
    with source('tf2_monitor', None, namespace, ros_args) as found:
        frame_listener, say = found.listener, Once(is_terminal())
        assert frame_listener
        traffic = Traffic(frame_listener.clock)
        chain = (Chain(frame_listener, (source_frame, target_frame))
                 if source_frame and target_frame else None)
        while True:
            dropped = 0
            for _ in range(_SAMPLES):
                messages, newly_dropped = frame_listener.dated()
                traffic.observe(messages)
                dropped += newly_dropped
                if chain is not None:
                    chain.sample()
                sleep(_REFRESH / _SAMPLES)
            if frame_listener.knows_clock():
                show(_results(frame_listener, traffic, chain, dropped, say))


def _results(frame_listener: 'FrameListener', traffic: Traffic, chain: Optional[Chain],
             dropped: int, say: Once) -> list[str]:
    rows = traffic.by_node(frame_listener)
    if not rows:
        return wrapped(frame_listener.nothing_received(say))
    ends = 'all frames' if chain is None else ' to '.join(map(shortened, chain.ends))
    lines = [f'RESULTS: for {ends}, over the last {WINDOW} s']
    if clock := frame_listener.clock_text():
        lines += wrapped(clock)
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
            nodes = {row.node for row in rows if row.frame in names}
            rows = [row for row in rows if row.frame in names
                    or (not row.frame and row.node in nodes)]
    return [*lines, *format_traffic(rows)]


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command with some arguments, or those of the command line."""
    parser = Parser(
        'tf2_monitor', 'Print the rate and the delay of the transforms of each frame and each '
        'node every second. If two frames are named, print only the frames and nodes on the path '
        'between these frames, and the net delay of the path.',
        'examples: tf2_monitor\n          tf2_monitor map end_effector')
    for name in 'source_frame', 'target_frame':
        parser.add_argument(name, nargs='?', type=frame_name)
    add_namespace_option(parser, 'listen to')
    return run(parser, command, args)
