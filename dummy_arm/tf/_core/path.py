"""The path from one frame to another, edge by edge, and the pose that it gives at a time."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf._core.history import AnyHistory
from dummy_arm.tf._core.pose import Columns, compose, IDENTITY, inverse, Pose


class Path:
    """The edges above a source and above a target, up to the frame where they meet."""

    __slots__ = ('edges', 'from_source', 'from_target')

    def __init__(self, from_source: Sequence[AnyHistory], from_target: Sequence[AnyHistory]
                 ) -> None:
        """Create a path from the edges, each list from the lowest to the highest."""
        self.from_source, self.from_target = from_source, from_target
        self.edges = [*from_source, *from_target]

    def is_fixed(self) -> bool:
        """Return whether no edge changes its parent in the course of its history."""
        return all(edge.parents is None for edge in self.edges)

    def latest_common_time(self) -> int:
        """Return the newest time (ns) of which all moving edges know; 0 when none moves."""
        return min([latest for edge in self.edges if (latest := edge.latest)], default=0)

    def covers(self, time: int) -> bool:
        """Return whether every edge has a pose at a time (ns)."""
        return all(edge.parent_at(time) is not None for edge in self.edges)

    def pose(self, time: int) -> Pose:
        """
        Compute the pose of the source in the target.

        :param time: ns.
        :raises NoPose: when an edge has none at that time.
        """
        if not self.from_target:
            return _pose_along(self.from_source, time)
        target_from_top = inverse(_pose_along(self.from_target, time))
        if not self.from_source:
            return target_from_top
        return compose(target_from_top, _pose_along(self.from_source, time))

    def poses(self, times: NDArray[np.int64]
              ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """
        Compute the poses of the source in the target at many times; the path must be fixed.

        :param times: (n,) ns; 0: the latest common time.
        :returns: (n, 7) x, y, z, qx, qy, qz, qw, and (n,) which of them are answers.
        """
        if not times.all():
            times = np.where(times == 0, self.latest_common_time(), times)
        known = np.ones(len(times), np.bool_)
        with np.errstate(invalid='ignore', over='ignore'):
            columns = _columns_along(self.from_source, times, known)
            if self.from_target:
                target_from_top = inverse(_columns_along(self.from_target, times, known))
                columns = (compose(target_from_top, columns) if self.from_source
                           else target_from_top)
        result = np.empty((len(times), 7))
        for i, column in enumerate(columns):
            result[:, i] = column
        return result, known


def _pose_along(edges: Sequence[AnyHistory], time: int) -> Pose:
    """Compose the poses of a chain of edges, from its lowest frame up to its highest."""
    if not edges:
        return IDENTITY
    pose = edges[0].pose_at(time)
    for edge in edges[1:]:
        pose = compose(edge.pose_at(time), pose)
    return pose


def _columns_along(edges: Sequence[AnyHistory], times: NDArray[np.int64],
                   known: NDArray[np.bool_]) -> Columns:
    """Compose the poses of a chain at many times; set `known` to False where an edge has none."""
    columns: Columns = IDENTITY
    for i, edge in enumerate(edges):
        poses = edge.poses_at(times, known)
        columns = compose(poses, columns) if i else poses
    return columns
