"""tf2's search for the path between two frames, the poses along it, and its stamps."""

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from puretf._core import failures
from puretf._core.history import History, Neighbours
from puretf._core.pose import Columns, compose, IDENTITY, inverse, Pose
from puretf._core.tree import END, FrameTree

#: The largest number of edges above a frame. If there are more, tf2 reports a loop.
MAX_GRAPH_DEPTH = 1000


class Path:
    """
    The edges between a source frame and a target frame.

    The path goes up from the source frame to the highest frame of the path, the *meeting frame*,
    then down to the target frame. An edge is represented by the history of its child frame.
    """

    def __init__(self, from_source: Sequence[History], from_target: Sequence[History]
                 ) -> None:
        self.from_source, self.from_target = from_source, from_target
        self.edges = [*from_source, *from_target]

    def latest_common_time(self) -> int:
        """Return the latest time (ns) for which every dynamic edge has data; 0: no such edge."""
        return min([latest for edge in self.edges if (latest := edge.latest)], default=0)

    def span(self) -> tuple[int, int]:
        """Return the first and last time (ns) with data of all edges of a kept path."""
        begin, end = -2**63, 2**63
        for edge in self.edges:
            if not edge.is_static:
                begin, end = max(begin, edge.oldest), min(end, edge.latest)
        return begin, end

    def pose(self, time: int) -> Pose:
        """Compute the pose of the source frame at a time (ns; 0: each edge's newest)."""
        return self._composed(_pose_along, time)

    def poses(self, times: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """
        Compute the poses of the source frame in the target frame at many times (ns).

        The parents must be constant. Return (7, n) poses, and (n,) bool: True where there is one.
        """
        times = np.where(times == 0, self.latest_common_time(), times)
        begin, end = self.span()
        known = (begin <= times) & (times <= end)
        if not known.any():
            return np.empty((7, len(times))), known
        neighbours = Neighbours(times if known.all() else np.where(known, times, begin))
        with np.errstate(invalid='ignore', over='ignore'):
            columns = self._composed(_columns_along, neighbours)
        return np.array([np.broadcast_to(column, len(times)) for column in columns]), known

    def _composed(self, along: Callable[[Sequence[History], Any], Columns], at: Any) -> Columns:
        """Compose the poses along both sides; a pose is one, or columns of many."""
        if not self.from_target:
            return along(self.from_source, at)
        target_from_top = inverse(along(self.from_target, at))
        return compose(target_from_top, along(self.from_source, at)) if (
            self.from_source) else target_from_top


def _pose_along(edges: Sequence[History], time: int) -> Pose:
    """Compute the pose of the lowest frame in the highest; the edges go upwards."""
    pose: Optional[Pose] = None
    for edge in edges:
        step = edge.pose_at(time)
        pose = compose(step, pose) if pose else step
    return pose or IDENTITY


def _columns_along(edges: Sequence[History], neighbours: Neighbours) -> Columns:
    steps = (edge.poses_at(neighbours) for edge in edges)  # a list would take more memory
    return reduce(lambda lower, step: compose(step, lower), steps) if edges else IDENTITY


def path(tree: FrameTree, target: str, source: str, time: int) -> Path:
    """Find the path at a time (ns; 0: by the newest parents); raise tf2's error."""
    from_source, from_target = _walk(tree, target, source, time)
    return Path(_edges(tree, from_source[:-1]), _edges(tree, from_target))


def chain(tree: FrameTree, target: str, source: str, time: int) -> list[str]:
    """Return the frames on the path at a time (ns; 0: the latest common), the source first."""
    time = time or latest_common_time(tree, target, source)
    from_source, from_target = _walk(tree, target, source, time)
    return [*from_source, *reversed(from_target)]


def _edges(tree: FrameTree, frames: Iterable[str]) -> list[History]:
    return [history for frame in frames if (history := tree.histories[frame]) is not None]


def _walk(tree: FrameTree, target: str, source: str, time: int) -> tuple[list[str], list[str]]:
    """
    Find a path; return its frames from the source up to the highest one, and the others.

    The others are the frames from the target up to below the highest one.

    As in tf2, the search first follows the ancestors of the source, as far as there are data
    for the time, and then the ancestors of the target. If there are several errors, this order
    decides which error is raised.
    """
    from_source, top, is_source_short = _climb(tree, source, (target,), time)
    from_target, end, is_target_short = _climb(tree, target, (top, source), time)
    if end == source:
        return [source], from_target
    if end != top:
        if time and (is_target_short or is_source_short):
            raise failures.extrapolation(
                tree, end if is_target_short else top, time, target, source)
        raise failures.unconnected(tree, target, source, time or END)
    while from_source and from_target and from_source[-1] == from_target[-1]:
        top = from_source.pop()
        from_target.pop()
    return [*from_source, top], from_target


def _climb(tree: FrameTree, frame: str, goals: tuple[str, ...], time: int
           ) -> tuple[list[str], str, bool]:
    """
    Follow the parents of a frame to a goal, to the root, or as far as there are data for a time.

    Return the frames below the last one, the last one, and whether it is one without data.
    """
    chain: list[str] = []
    while frame not in goals and (history := tree.histories[frame]) is not None:
        if (parent := history.parent_at(time)) is None:
            return chain, frame, True
        chain.append(frame)
        if len(chain) > MAX_GRAPH_DEPTH:
            raise failures.too_long(tree, chain)
        frame = parent
    return chain, frame, False


def latest_common_time(tree: FrameTree, target: str, source: str) -> int:
    """
    Return the latest time (ns) for which every dynamic edge has data; 0: no such edge.

    The path follows the newest parents of the frames.
    """
    if source == target:
        history = tree.histories[source]
        return history.latest if history else 0
    return path(tree, target, source, 0).latest_common_time()


class PathEdge(NamedTuple):
    """A dynamic edge on the path between two frames, while no frame changes its parent."""

    parent: str
    child: str
    begin: int  #: when the edge is on the path, first (ns)
    end: int  #: and last (ns)
    #: (n,) int64: the stamps of the edge (ns) from begin to end, and the nearest on both sides.
    stamps: NDArray[np.int64]


def path_edges(tree: FrameTree, target: str, source: str) -> list[PathEdge]:
    failures.check_for_lookup(tree, target_frame=target, source_frame=source)
    ancestors = tree.all_ancestors(target) | tree.all_ancestors(source)
    changes = {time for edge in _edges(tree, ancestors) for time in edge.parent_changes()}
    # In each of these periods, no frame above the two frames changes its parent.
    periods = [(begin, end, tree.dynamic_edges(source, target, begin))
               for begin, end in pairwise((-END, *sorted(changes), END))]
    if all(edges is None for *_, edges in periods):
        raise failures.unconnected(tree, target, source)
    return [PathEdge(str(edge.parent_near(begin)), child, begin, end - 1,
                     edge.stamps_around(begin, end))
            for begin, end, edges in periods for child, edge in edges or ()]


def stamps(tree: FrameTree, target: str, source: str) -> NDArray[np.int64]:
    """
    Return the stamps of the samples of all edges on the path between two frames.

    At each time, the path follows the parents that the frames had at this time. Before its
    first sample and after its last one, a frame has the parent of this sample. So stamps at
    which only some of the edges have data are returned, too.
    """
    parts = [edge.stamps[(edge.begin <= edge.stamps) & (edge.stamps <= edge.end)]
             for edge in path_edges(tree, target, source)]
    # A stable sort merges the sorted parts, many times as fast as np.unique.
    result = np.sort(np.concatenate([np.empty(0, np.int64), *parts]), kind='stable')
    is_new: NDArray[np.bool_] = np.diff(result, prepend=result[:1] - 1) != 0
    return result[is_new]


def has_one_chain(tree: FrameTree, frame: str) -> bool:
    """Return True if a frame and its ancestors have one parent each at all times, but no loop."""
    ancestors = tree.all_ancestors(frame)
    edges = _edges(tree, ancestors)
    # A loop has as many edges as frames.
    return (len(edges) < len(ancestors) <= MAX_GRAPH_DEPTH + 1
            and all(edge.parents is None for edge in edges))


def may_be_connected(tree: FrameTree, frame: str, other: str) -> bool:
    """
    Return True if two frames may be connected at some time.

    From both frames upwards, every parent that occurs in a history is followed.
    """
    return not (tree.problem(frame) or tree.problem(other)
                or tree.all_ancestors(frame).isdisjoint(tree.all_ancestors(other)))
