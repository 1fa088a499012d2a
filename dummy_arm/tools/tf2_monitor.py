"""The command `tf2_monitor`: how often and how late transforms come in, again and again."""

from collections.abc import Iterator, Sequence
from typing import Optional, TYPE_CHECKING

from dummy_arm.command import Parser, run, UsageError
from dummy_arm.interruption import sleep
from dummy_arm.tf.texts import shortened
from dummy_arm.tools.screen import column, padded, show, width, wrapped
from dummy_arm.tools.traffic import Stream, Traffic, WINDOW

if TYPE_CHECKING:
    from dummy_arm.tools.chain import Chain
    from dummy_arm.tools.frame_listener import FrameListener

_SAMPLES = 20
_REFRESH = 1.0  # s


def lines_of(streams: Sequence[Stream]) -> list[str]:
    """
    Tell what came in.

    :param streams: of frames and nodes, and then of nodes.
    """
    frames = [stream for stream in streams if stream.frame]
    nodes = [stream for stream in streams if not stream.frame]
    senders: dict[str, list[str]] = {}
    for stream in frames:
        if stream.is_present and (stream.is_static or stream.summary is not None):
            senders.setdefault(stream.frame, []).append(stream.sender)
    return [
        *(f'Warning: {shortened(frame)} is published by {" and ".join(map(shortened, several))}; '
          'a frame should have one publisher'
          for frame, several in senders.items() if len(several) > 1),
        '', *_table('Frames:', 'published by', frames), '',
        *_table('All Broadcasters:', 'node', nodes)]


def _table(title: str, of_senders: str, streams: Sequence[Stream]) -> Iterator[str]:
    names = [f'  {shortened(stream.frame)}' for stream in streams]
    columns = column([len(title), *map(width, names)])
    yield f'{title:<{columns}}{"rate":>11}{"average delay":>16}{"max delay":>14}  {of_senders}'
    for name, stream in zip(names, streams):
        yield (f'{padded(name, columns)}{_told(stream)}  '
               f'{shortened(stream.sender)}{"" if stream.is_present else " (gone)"}')


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
    from dummy_arm.node_command import spun_node
    from dummy_arm.tools.chain import Chain
    from dummy_arm.tools.frame_listener import FrameListener
    with spun_node('tf2_monitor', ros_args) as node:
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


def _results(listening: 'FrameListener', traffic: Traffic, chain: 'Optional[Chain]',
             dropped: int) -> list[str]:
    streams = traffic.streams(listening.listener.names_of, listening.listener.present)
    if not streams:
        return wrapped(f'nothing yet. {listening.why_none()}')
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
            senders = {stream.sender for stream in streams if stream.frame in names}
            streams = [stream for stream in streams
                       if stream.frame in names or (not stream.frame and stream.sender in senders)]
    return [*lines, *lines_of(streams)]


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'tf2_monitor', 'Print how often and how late the transforms of each frame and of each '
        'node come in; with two frames, of those on the way between them, and its net delay.',
        'examples: tf2_monitor\n          tf2_monitor map end_effector')
    parser.add_argument('source_frame', nargs='?')
    parser.add_argument('target_frame', nargs='?')
    return run(parser, command, args)
