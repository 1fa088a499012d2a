"""Explain the path between two frames: its edges, and why they give no transform."""

from collections.abc import Mapping
from typing import Any, NamedTuple, TYPE_CHECKING

from puretf import exact_time, Frame, in_seconds
from puretf._text.names import shortened, visible
from puretf_tools.inspection.forest import self_and_ancestors
from puretf_tools.inspection.terminal import columns, wrapped
from puretf_tools.inspection.traffic import rate_text

if TYPE_CHECKING:
    from puretf import BufferCore, TransformBuffer


class Explanation(NamedTuple):
    """A path between two frames, and why it gives no transform."""

    ends: tuple[str, str]
    stamp: int  #: the time of the transform (ns); 0: the path is static
    path: list[Frame]  #: the child of each edge
    why_not: str  #: why there is no transform; '': there is one
    when: str  #: when there is one, such as 'at all times'

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, as in the JSON of `tf_doctor`."""
        return {'frames': self.ends, 'time': self.stamp, 'why_not': self.why_not, 'path': [
            {**frame._asdict(), 'refusal': _refusal(frame, self.stamp)} for frame in self.path]}

    def __str__(self) -> str:
        """Return the edges, and whether there is a transform."""
        first, second = map(shortened, self.ends)
        rows = [[
            f'{shortened(frame.parent)} -> {shortened(frame.name)}', rate_text(frame),
            '' if frame.is_static else f'{exact_time(frame.oldest)} to {exact_time(frame.latest)}',
            shortened(frame.authority)] for frame in self.path]
        lines = []
        for line, frame in zip(columns(rows), self.path):
            lines.append(line)
            if refusal := _refusal(frame, self.stamp):
                lines += wrapped(f'No pose at that time: {refusal}.', '    ')
        if lines:
            lines = [*wrapped(f'The path from {first} to {second}, with the average rate, oldest '
                              'and newest stamp, and publisher of each edge:'), '', *lines, '']
        result = (f'There is no transform from {second} to {first}: {self.why_not}' if self.why_not
                  else f'The transform from {second} to {first} exists {self.when}.')
        return '\n'.join([*lines, *wrapped(visible(result))])


def explain(buffer: 'TransformBuffer | BufferCore', ends: tuple[str, str], stamp: int
            ) -> Explanation:
    """
    Explain the path from a frame up to where the two meet, then down to the other frame.

    If the two frames are in different trees, the path goes up to both roots.

    :param stamp: time of the transform (ns); 0: the latest time for which every edge has data.
    """
    with buffer.updated():  # so that all that follows describes the same state
        why_not = buffer.why_not(*ends, stamp, has_hint=False)
        frames = {frame.name: frame for frame in buffer.frames()}
        time = stamp or min((frame.latest for frame in _path(frames, ends) if frame.latest),
                            default=0)
        # At this time, frames may have had other parents.
        for frame in buffer.frames(time):
            frames[frame.name] = frames[frame.name]._replace(parent=frame.parent)
    path = _path(frames, ends)
    when = (f'at {exact_time(time)}' if time else
            'at all times' if all(frame.is_static for frame in path) else 'only at the time 0')
    return Explanation(ends, time, path, why_not, when)


def _path(frames: Mapping[str, Frame], ends: tuple[str, str]) -> list[Frame]:
    """Return the path between two frames, without what is above both; empty within a loop."""
    up, down = ([*self_and_ancestors(name, frames)] for name in ends)
    shared = {*up} & {*down}
    return [frames[name] for name in (*up, *down[::-1]) if name in frames and name not in shared]


def _refusal(frame: Frame, stamp: int) -> str:
    if frame.is_static or frame.oldest <= stamp <= frame.latest:
        return ''
    which, gap, side = ('newest', stamp - frame.latest, 'older') if stamp > frame.latest else (
        'oldest', frame.oldest - stamp, 'newer')
    return f'its {which} transform is {in_seconds(gap):.3f} s {side} than {exact_time(stamp)}'
