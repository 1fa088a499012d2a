"""The path between two frames: its edges, and the poses that are computed along it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from puretf._core.composition import compose, inverse
from puretf._core.history import History, Neighbours
from puretf._core.pose import Columns, IDENTITY, Pose


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
        return _composed([edge.pose_at(time) for edge in self.from_source],
                         [edge.pose_at(time) for edge in self.from_target])

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
            columns = _composed([edge.poses_at(neighbours) for edge in self.from_source],
                                [edge.poses_at(neighbours) for edge in self.from_target])
        return np.array([np.broadcast_to(column, len(times)) for column in columns]), known


def _composed(from_source: Sequence[Columns], from_target: Sequence[Columns]) -> Columns:
    """Compose the poses of the edges, each upwards; each is one pose, or columns."""
    if not from_target:
        return _along(from_source) if from_source else IDENTITY
    target_from_top = inverse(_along(from_target))
    return compose(target_from_top, _along(from_source)) if from_source else target_from_top


def _along(steps: Sequence[Columns]) -> Columns:
    pose, *rest = steps
    for step in rest:
        pose = compose(step, pose)
    return pose
