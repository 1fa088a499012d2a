"""The path between two frames: its edges, and the poses that are computed along it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf._core.history import AnyHistory, Neighbours
from dummy_arm.tf._core.pose import Columns, compose, IDENTITY, inverse, Pose


class Path:
    """
    The edges between a source frame and a target frame.

    The path goes up from the source frame to the highest frame of the path, the *meeting frame*,
    then down to the target frame. An edge is represented by the history of its child frame.
    """

    __slots__ = ('edges', 'from_source', 'from_target')

    def __init__(self, from_source: Sequence[AnyHistory], from_target: Sequence[AnyHistory]
                 ) -> None:
        """
        Create a path.

        :param from_source: the edges from the source frame upwards to the meeting frame, which
            may be the target frame.
        :param from_target: the edges from the target frame upwards to the meeting frame, which
            may be the source frame.
        """
        self.from_source, self.from_target = from_source, from_target
        self.edges = [*from_source, *from_target]

    def has_constant_parents(self) -> bool:
        """
        Return True if each edge's child frame has had only one parent in its history.

        :returns: True if the path consists of the same edges at all times.
        """
        return all(edge.parents is None for edge in self.edges)

    def latest_common_time(self) -> int:
        """
        Return the latest common time: the latest time for which every dynamic edge has data.

        Each dynamic edge has a newest stamp. The result is the earliest of these stamps.

        :returns: time (ns); 0 if no dynamic edge has samples.
        """
        return min([latest for edge in self.edges if (latest := edge.latest)], default=0)

    def span(self) -> tuple[int, int]:
        """
        Return the first and the last time at which every edge has a pose.

        Call this only if `has_constant_parents` returns True.

        :returns: two times (ns). If there is no such time, the first is later than the last.
        """
        begin, end = -2**63, 2**63
        for edge in self.edges:
            if not edge.is_static:
                begin, end = max(begin, edge.oldest), min(end, edge.latest)
                if not len(edge):
                    return 1, 0
        return begin, end

    def covers(self, time: int) -> bool:
        """
        Return True if every edge has a pose at a time.

        :param time: time (ns); 0: the newest sample of each edge, not the latest common time.
        :returns: True if `pose` returns a pose for this time.
        """
        return all(edge.parent_at(time) is not None for edge in self.edges)

    def pose(self, time: int) -> Pose:
        """
        Compute the pose of the source frame in the target frame.

        :param time: time (ns); 0: the newest sample of each edge, not the latest common time.
        :returns: x, y, z (m) and the quaternion x, y, z, w.
        :raises NoPose: if an edge has no pose at that time.
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
        Compute the poses of the source frame in the target frame at many times.

        Call this only if `has_constant_parents` returns True.

        :param times: (n,) times (ns); 0: the latest common time.
        :returns: two arrays. The first is (n, 7) float64: x, y, z (m), quaternion x, y, z, w. The
            second is (n,) bool: True where there is a pose. Where the second array is False, the
            row of the first array contains arbitrary numbers.
        """
        if not times.all():
            times = np.where(times == 0, self.latest_common_time(), times)
        begin, end = self.span()
        known = (begin <= times) & (times <= end)
        if not known.any():
            return np.empty((len(times), 7)), known
        neighbours = Neighbours(times if known.all() else np.where(known, times, begin))
        with np.errstate(invalid='ignore', over='ignore'):
            columns = _columns_along(self.from_source, neighbours)
            if self.from_target:
                target_from_top = inverse(_columns_along(self.from_target, neighbours))
                columns = (compose(target_from_top, columns) if self.from_source
                           else target_from_top)
        result = np.empty((len(times), 7))
        for i, column in enumerate(columns):
            result[:, i] = column
        return result, known


def _pose_along(edges: Sequence[AnyHistory], time: int) -> Pose:
    """
    Compute the pose of the lowest frame of a chain in the highest frame of the chain.

    The edges of the chain are in order, from the lowest edge upwards.
    """
    if not edges:
        return IDENTITY
    pose = edges[0].pose_at(time)
    for edge in edges[1:]:
        pose = compose(edge.pose_at(time), pose)
    return pose


def _columns_along(edges: Sequence[AnyHistory], neighbours: Neighbours) -> Columns:
    """Compute the poses at many times, each as `_pose_along` does."""
    columns: Columns = IDENTITY
    for i, edge in enumerate(edges):
        poses = edge.poses_at(neighbours)
        columns = compose(poses, columns) if i else poses
    return columns
