"""Explain the path between two frames: its edges, and why they give no transform."""

from collections.abc import Mapping
from itertools import takewhile
from typing import Any, NamedTuple, TYPE_CHECKING

from puretf import comma_list, exact_time, Frame, in_seconds, shortened, visible
from puretf_tools.inspection.bag_times import both
from puretf_tools.inspection.forest import self_and_ancestors
from puretf_tools.inspection.terminal import columns, wrapped
from puretf_tools.inspection.traffic import rate_of

if TYPE_CHECKING:
    from puretf import BufferCore, TransformBuffer


class Explanation(NamedTuple):
    """A path between two frames, and why it gives no transform."""

    ends: tuple[str, str]
    stamp: int  #: the time of the transform (ns); 0: the path is static
    path: list[Frame]  #: the child of each edge
    refusals: dict[str, str]  #: by child: why the edge has no pose at the time; '': it has one
    roots: tuple[str, str]  #: the roots above the two frames; if they meet, the meeting frame
    why_not: str  #: why there is no transform; '': there is one
    age: str = ''  #: how old the transform is, in words; '': not known
    begin: int = 0  #: the begin of the bag (ns); 0: the frames are live
    hole: str = ''  #: that the transform is interpolated over a time without data

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, as in the JSON of `tf_doctor`."""
        return {'frames': self.ends, 'time': self.stamp, 'roots': self.roots,
                'why_not': self.why_not, 'path': [
                    {**frame._asdict(), 'refusal': self.refusals[frame.name]}
                    for frame in self.path]}

    def __str__(self) -> str:
        """Return the edges, and whether there is a transform."""
        first, second = map(shortened, self.ends)
        rows = [[f'{shortened(frame.parent)} -> {shortened(frame.name)}',
                 'static' if frame.is_static else
                 '?' if (hertz := rate_of(frame)) is None else f'{hertz:.1f} Hz',
                 '' if frame.is_static else
                 f'{exact_time(frame.oldest)} to {exact_time(frame.latest)}',
                 shortened(frame.authority)] for frame in self.path]
        lines = []
        for line, frame in zip(columns(rows), self.path):
            lines.append(line)
            if refusal := self.refusals[frame.name]:
                lines += wrapped(f'No pose at that time: {refusal}.', '    ')
        if lines:
            what = f'The path from {first} to {second}'
            if self.roots[0] != self.roots[1]:
                what = f'The edges above {first} and {second}'
                lines += ['', f'No edge connects {" and ".join(map(shortened, self.roots))}.']
            lines = [*wrapped(f'{what}, with the rate, the oldest and the newest stamp, and the '
                              'publisher of each edge:'), '', *lines, '']
        zero = [shortened(frame.name) for frame in self.path
                if not (frame.is_static or frame.latest)]
        stamp = both(self.stamp, self.begin) if self.begin else exact_time(self.stamp)
        when = (f'at {stamp}' if self.stamp else 'at all times' if not zero
                else f'only at the time 0, the stamp of {comma_list(zero, 5)}')
        return '\n'.join([*lines, *wrapped(visible(
            f'There is no transform from {second} to {first}: {self.why_not}'
            if self.why_not else
            f'The transform from {second} to {first} exists {when}{self.age}.'
            f'{self.hole and f" It is {self.hole}."}'))])


def explain(buffer: 'TransformBuffer | BufferCore', ends: tuple[str, str], stamp: int,
            publishers: Mapping[str, str]) -> Explanation:
    """
    Explain the path from a frame up to where the two meet, then down to the other frame.

    If the two frames are in different trees, the path goes up to both roots.

    :param stamp: time of the transform (ns); 0: the latest time for which every edge has data.
    :param publishers: by child: the names of the nodes that publish it.
    """
    with buffer.updated():  # so that all that follows describes the same state
        why_not = buffer.why_not(*ends, stamp)
        frames = {frame.name: frame._replace(authority=publishers.get(frame.name, frame.authority))
                  for frame in buffer.frames()}
        path, _ = _path(frames, ends)
        time = stamp or min((frame.latest for frame in path if frame.latest), default=0)
        # At this time, frames may have had other parents.
        for frame in buffer.frames(time):
            frames[frame.name] = frames[frame.name]._replace(parent=frame.parent)
    path, roots = _path(frames, ends)
    # The hint about the publishers needs the lock to be free.
    return Explanation(ends, time, path, {frame.name: _refusal(frame, time) for frame in path},
                       roots, why_not and (buffer.why_not(*ends, stamp) or why_not))


def _path(frames: Mapping[str, Frame], ends: tuple[str, str]
          ) -> tuple[list[Frame], tuple[str, str]]:
    """Return the path between two frames, and its roots: the meeting frame twice, if they meet."""
    chains = [[*self_and_ancestors(name, frames)] for name in ends]
    first, second = ({name: i for i, name in enumerate(chain)} for chain in chains)
    # If there is a loop, several frames are in both chains.
    meeting = min(first.keys() & second.keys(), key=lambda name: first[name] + second[name],
                  default='')
    edges = [[frames[name] for name in takewhile(meeting.__ne__, chain) if name in frames]
             for chain in chains]
    return [*edges[0], *edges[1][::-1]], (meeting or chains[0][-1], meeting or chains[1][-1])


def _refusal(frame: Frame, stamp: int) -> str:
    if frame.is_static or frame.oldest <= stamp <= frame.latest:
        return ''
    which, gap, side = ('newest', stamp - frame.latest, 'older') if stamp > frame.latest else (
        'oldest', frame.oldest - stamp, 'newer')
    return f'its {which} transform is {in_seconds(gap):.3f} s {side} than {exact_time(stamp)}'
