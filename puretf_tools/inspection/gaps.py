"""Times for which the edges between two frames have no data: in holes, and beyond the ends."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Optional, TYPE_CHECKING, Union

import numpy as np
from numpy.typing import NDArray

from puretf import in_seconds, SECOND, TransformBuffer
from puretf._text.names import shortened

if TYPE_CHECKING:
    from puretf import BufferCore

#: A step of an edge, from stamp to stamp, is a hole if it is longer than this many usual (median)
#: steps, and not shorter than `SHORTEST_HOLE` (ns).
USUAL_STEPS, SHORTEST_HOLE = 10, SECOND // 2

AnyBuffer = Union[TransformBuffer, 'BufferCore']
Edges = Sequence[Any]  #: what `path_edges` of a buffer returns


class Hole(NamedTuple):
    """A long step of an edge, over which poses are interpolated."""

    edge: str  #: such as 'odom -> base_link'
    begin: int  #: the stamp before the hole (ns)
    end: int  #: the stamp after it (ns)

    def between(self, zero: Optional[int] = None) -> str:
        """
        Say when the hole is.

        :param zero: the begin of a bag (ns), for times after it; None: for stamps.

        >>> Hole('odom -> base_link', 120 * SECOND, 124 * SECOND).between(100 * SECOND)
        'between +20.00 and +24.00 s'
        """
        sign = '' if zero is None else '+'
        begin, end = (in_seconds(time - (zero or 0)) for time in (self.begin, self.end))
        return f'between {begin:{sign}.2f} and {end:{sign}.2f} s'


def holes_at(edges: Edges, times: NDArray[np.int64], longest: Optional[int] = None
             ) -> NDArray[np.object_]:
    """
    Find the hole in the data between two frames that is around each time.

    :param edges: those between the frames, from `path_edges`.
    :param times: (n,) times in increasing order (ns).
    :param longest: longer steps (ns) are holes; None: those that `USUAL_STEPS` describes.
    :returns: (n,) objects: a `Hole`, the longest of several; or None.
    """
    found, lengths = np.full(len(times), None, np.object_), np.zeros(len(times), np.uint64)
    # The difference of two int64 may be too large for an int64, but not for a uint64.
    steps = [np.diff(edge.stamps).view(np.uint64) for edge in edges]
    limits: dict[str, float] = {}
    for edge, own in zip(edges, steps):
        if edge.child not in limits:
            every = np.concatenate([each for other, each in zip(edges, steps)
                                    if other.child == edge.child])
            usual = float(np.median(every[every > 0])) if every.any() else 0.0
            limits[edge.child] = max(USUAL_STEPS * usual, SHORTEST_HOLE - 1)
        first, last = _part(times, edge.begin, edge.end)
        after = edge.stamps.searchsorted(times[first:last])
        # At a stamp, and beyond the ends, nothing is interpolated.
        inside = np.flatnonzero((after > 0) & (after < len(edge.stamps)))
        inside = inside[edge.stamps[after[inside]] != times[first:last][inside]]
        step = after[inside] - 1
        is_hole = (own[step] > (limits[edge.child] if longest is None else longest)) & (
            own[step] > lengths[first:last][inside])
        inside, step = first + inside[is_hole], step[is_hole]
        lengths[inside], name = own[step], _name_of(edge)
        for i, j in zip(inside.tolist(), step.tolist()):
            found[i] = Hole(name, *edge.stamps[j:j + 2].tolist())
    return found


def interpolated(buffer: AnyBuffer, target: str, source: str, time: int, zero: int) -> str:
    """Say over which hole in a bag a pose is interpolated; '' if over none. `zero`: its begin."""
    hole, = holes_at(buffer.path_edges(target, source), np.array([time]))
    return f'interpolated {hole.between(zero)}: {hole.edge} has no data there' if hole else ''


def beyond_ends(edges: Edges, times: NDArray[np.int64]
                ) -> tuple[NDArray[np.bool_], str]:
    """
    Find the times before the first or after the last data of an edge between two frames.

    :param times: (n,) times in increasing order (ns).
    :returns: (n,) bool, and a text such as 'odom -> base_link: the last 0.04 s'; of several edges,
        it names the one that begins last and the one that ends first.
    """
    is_beyond = np.zeros(len(times), np.bool_)
    early, late = (0, ''), (0, '')
    for edge in edges:
        part = slice(*_part(times, edge.begin, edge.end))
        own, name = times[part], _name_of(edge)
        is_early, is_late = own < edge.stamps[0], own > edge.stamps[-1]
        is_beyond[part] |= is_early | is_late
        if is_early.any():
            early = max(early, (int(edge.stamps[0]) - int(own[0]), name))
        if is_late.any():
            late = max(late, (int(own[-1]) - int(edge.stamps[-1]), name))
    return is_beyond, '; of '.join(f'{name}: the {which} {in_words(time)}' for which, (time, name)
                                   in (('first', early), ('last', late)) if time)


def _name_of(edge: Any) -> str:
    return f'{shortened(edge.parent)} -> {shortened(edge.child)}'


def _part(times: NDArray[np.int64], begin: int, end: int) -> tuple[int, int]:
    """Return which of sorted times are from `begin` to `end` (ns): a range of indices."""
    return int(times.searchsorted(begin)), int(times.searchsorted(end, 'right'))


def in_words(nanoseconds: float) -> str:
    """Return a time span in s, with three significant digits; from 1000 s on, rounded to 1 s."""
    seconds = abs(nanoseconds) / SECOND
    return f'{seconds:.3g} s' if seconds < 1000 else f'{seconds:.0f} s'
