"""Lookups in the tree of frames: of one pose, of many poses, of all frames at once."""

from collections.abc import Iterable
from contextlib import suppress
from typing import Optional

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf._core.history import AnyHistory, NoPose
from dummy_arm.tf._core.path import Path
from dummy_arm.tf._core.pose import compose, IDENTITY, inverse, Pose
from dummy_arm.tf._core.tree import FrameTree
from dummy_arm.tf.exceptions import TransformException

#: The largest number of paths that are kept.
_MAX_PATHS = 10_000

#: An edge, seen from one of its two frames: the other frame, whether the other frame is the child,
#: and the history of the child.
_Edge = tuple[str, bool, AnyHistory]
#: The time of a pose (ns; 0: any time), and the pose; None: there is no pose.
_TimedPose = tuple[int, Optional[Pose]]


class Lookups:
    """
    Lookups in a tree of frames, and the paths that were found in it.

    If no frame on a path has changed its parent, and there is no loop above it at any time, then
    the path is the only one between its frames until some frame gets a new parent. Such a path is
    kept. If there is no such path, or if it has no pose at the requested time, the tree is
    searched as tf2 does, so that the result or the error is tf2's.

    Times are in ns; 0 means the latest common time. Hold the lock of the buffer during each call.
    """

    def __init__(self, tree: FrameTree) -> None:
        """
        Create lookups in a tree.

        :param tree: the tree of frames.
        """
        self.tree = tree
        #: The paths that are kept, by target and source frame. The insertion clears them when a
        #: frame gets a new parent or another kind of history.
        self.paths: dict[tuple[str, str], Path] = {}

    def pose(self, target: str, source: str, time: int) -> tuple[int, Pose]:
        """
        Compute the pose of the source frame in the target frame.

        :param target: the frame in which the result is expressed.
        :param source: the frame whose pose is looked up.
        :param time: time (ns); 0: the latest common time.
        :returns: the time of the pose (ns), and the pose.
        :raises TransformException: if there is no such transform; its subclass says why.
        """
        path = self.paths.get((target, source))
        if path is not None:
            try:
                pose_time = time or path.latest_common_time()
                return pose_time, path.pose(pose_time)
            except NoPose:
                pass
        if target == source:
            history = self.tree.histories.get(target)
            return time or (history.latest if history is not None else 0), IDENTITY
        self.tree.check_for_lookup(target_frame=target, source_frame=source)
        time, path = self._search(target, source, time)
        return time, path.pose(time)

    def pose_full(self, target: str, target_time: int, source: str, source_time: int, fixed: str
                  ) -> tuple[int, Pose]:
        """
        Compute the pose of the source frame at one time in the target frame at another time.

        :param target: the frame in which the result is expressed.
        :param target_time: time of the target frame (ns); 0: its latest common time with `fixed`.
        :param source: the frame whose pose is looked up.
        :param source_time: time of the source frame (ns); 0: its latest common time with `fixed`.
        :param fixed: a frame that does not move between the two times.
        :returns: the time of the target frame (ns), and the pose.
        :raises TransformException: if there is no such transform; its subclass says why.
        """
        self.tree.check_for_lookup(target_frame=target, source_frame=source, fixed_frame=fixed)
        _, fixed_from_source = self.pose(fixed, source, source_time)
        time, target_from_fixed = self.pose(target, fixed, target_time)
        return time, compose(target_from_fixed, fixed_from_source)

    def poses(self, target: str, source: str, times: NDArray[np.int64]
              ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """
        Compute the poses of the source frame in the target frame at many times.

        :param target: the frame in which the poses are expressed.
        :param source: the frame whose poses are looked up.
        :param times: (n,) times (ns); 0: the latest common time.
        :returns: (n, 7) float64: x, y, z (m), quaternion x, y, z, w, NaN where there is no pose;
            and (n,) bool: True where there is a pose.
        """
        path = self.paths.get((target, source))
        if path is None:
            # A lookup at the latest common time is the most likely to find the path.
            with suppress(TransformException):
                self.pose(target, source, 0)
            path = self.paths.get((target, source))
        if path is not None:
            poses, known = path.poses(times)
        else:
            poses, known = np.empty((len(times), 7)), np.zeros(len(times), np.bool_)
            for i, time in enumerate(times.tolist()):
                with suppress(TransformException):
                    _, poses[i] = self.pose(target, source, time)
                    known[i] = True
        poses[~known] = np.nan
        return poses, known

    def check(self, target: str, source: str, time: int) -> None:
        """
        Check that there is a pose of the source frame in the target frame.

        :param target: as `pose`.
        :param source: as `pose`.
        :param time: as `pose`.
        :raises TransformException: if there is no such transform; its subclass says why.
        """
        path = self.paths.get((target, source))
        if path is None or not path.covers(time or path.latest_common_time()):
            if target == source:
                return
            self.tree.check_for_can_transform(target_frame=target, source_frame=source)
            self._search(target, source, time)

    def check_full(self, target: str, target_time: int, source: str, source_time: int, fixed: str
                   ) -> None:
        """
        Check that `pose_full` has a result.

        :param target: as `pose_full`.
        :param target_time: as `pose_full`.
        :param source: as `pose_full`.
        :param source_time: as `pose_full`.
        :param fixed: as `pose_full`.
        :raises TransformException: if there is no such transform; its subclass says why.
        """
        self.tree.check_for_can_transform(
            target_frame=target, source_frame=source, fixed_frame=fixed)
        self.check(target, fixed, target_time)
        self.check(fixed, source, source_time)

    def chain(self, target: str, target_time: int, source: str, source_time: int, fixed: str
              ) -> list[str]:
        """
        Return the frames on the path from a source frame via a fixed frame to a target frame.

        Frames that would be passed twice, there and back, are left out.

        :param target: as `pose_full`.
        :param target_time: as `pose_full`.
        :param source: as `pose_full`.
        :param source_time: as `pose_full`.
        :param fixed: as `pose_full`.
        :returns: the names of the frames, the source frame first.
        :raises TransformException: if there is no such path; its subclass says why.
        """
        self.check_full(target, target_time, source, source_time, fixed)
        from_source = self._frames(fixed, source, source_time)
        from_target = self._frames(fixed, target, target_time)
        while len(from_source) > 1 and len(from_target) > 1 and from_source[-2] == from_target[-2]:
            from_source.pop()
            from_target.pop()
        return from_source[:-1] + from_target[::-1]

    def _frames(self, target: str, source: str, time: int) -> list[str]:
        if target == source:
            return [target]
        time = time or self.tree.latest_common_time(target, source)
        return self.tree.chain(target, source, time)

    def latest_common_time(self, target: str, source: str) -> int:
        """
        Return the latest time for which every dynamic edge between two frames has data.

        :param target: the one frame.
        :param source: the other frame.
        :returns: time (ns); 0 if there is no dynamic edge.
        :raises TransformException: if a frame does not exist, or if they are not connected.
        """
        for name in target, source:
            self.tree.check(name, 'get_latest_common_time')
        return self.tree.latest_common_time(target, source)

    def _search(self, target: str, source: str, time: int) -> tuple[int, Path]:
        """
        Search the tree for a path, and keep it if it is the only one; see `Lookups`.

        :returns: the time (ns), which is the latest common time if `time` is 0; and the path.
        """
        time = time or self.tree.latest_common_time(target, source)
        path = self.tree.path(target, source, time)
        if path.has_constant_parents() and all(map(self.tree.has_no_loop_above, (source, target))):
            if len(self.paths) >= _MAX_PATHS:
                self.paths.clear()
            self.paths[target, source] = path
        return time, path

    def all_poses(self, targets: Iterable[str], until: int) -> list[dict[str, tuple[int, Pose]]]:
        """
        Compute the poses of all frames that are connected to each target frame.

        The tree is walked once for each target frame.

        :param targets: the target frames.
        :param until: the latest time (ns) of the poses; the frames are connected by the parents
            that they had at that time; 0: no limit.
        :returns: for each target frame, a dict from the name of each connected frame to the time
            (ns) and the pose; the nearest frames come first.
        :raises TransformException: if a target frame does not exist.
        """
        edges: dict[str, list[_Edge]] = {}
        for child, parent, history in self.tree.parents(until):
            edges.setdefault(parent, []).append((child, True, history))
            edges.setdefault(child, []).append((parent, False, history))
        return [self._all_poses(edges, target, until) for target in targets]

    def _all_poses(self, edges: dict[str, list[_Edge]], target: str, until: int
                   ) -> dict[str, tuple[int, Pose]]:
        if target not in self.tree.histories:
            self.tree.check(target, 'lookup_all')
        history, poses = self.tree.histories[target], self._walk(edges, target, until)
        if history is not None:
            poses[target] = min(until, history.latest) if until else history.latest, IDENTITY
        return {name: (time, pose) for name, (time, pose) in poses.items() if pose is not None}

    def _walk(self, edges: dict[str, list[_Edge]], target: str, until: int
              ) -> dict[str, _TimedPose]:
        """Walk the tree from a target frame, breadth first, and compute the pose of each frame."""
        poses: dict[str, _TimedPose] = {target: (0, IDENTITY)}
        names = [target]
        for name in names:
            time, pose = poses[name]
            for other, is_child, edge in edges.get(name, ()):
                if other in poses:
                    continue
                names.append(other)
                latest = min(until, edge.latest) if until else edge.latest
                common = min(time, latest) if time and latest else time or latest
                poses[other] = common, None
                try:
                    # One step is enough if the pose of this frame is valid at the common time, and
                    # the child of the edge has had one parent only.
                    if pose is not None and time in (0, common) and edge.parents is None:
                        step = edge.pose_at(common)
                        poses[other] = common, compose(pose, step if is_child else inverse(step))
                    else:
                        poses[other] = self.pose(target, other, common)
                except (NoPose, TransformException):
                    # Frames behind this one may still have a path, via the parents that they had
                    # at that time.
                    pass
        return poses
