"""Lookups in the tree of frames: one pose, many poses, all frames at once."""

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

_MOST_PATHS = 10_000

#: An edge, as it is seen from the frame at one of its ends: the frame at the other end, whether
#: that is the child, and the poses of the child in the parent.
_Edge = tuple[str, bool, AnyHistory]
#: The time of a pose (ns; 0: any), and the pose; None: there is none.
_Placed = tuple[int, Optional[Pose]]


class Lookups:
    """
    A tree of frames, and the paths that were found in it.

    A path on which no frame changes its parent, with no loop above it at any time, is the only one
    between its frames until some frame gets a new parent: it is kept. Where there is none, or
    where it gives no answer, the tree is match_candidates as tf2 does, for tf2's answer or error.

    Times are ns; 0: the latest common time. The lock of the buffer is held during each call.
    """

    def __init__(self, tree: FrameTree) -> None:
        """Create lookups in a tree."""
        self.tree = tree
        #: Paths that were found; cleared when a frame gets another history, or a new parent.
        self.paths: dict[tuple[str, str], Path] = {}

    def pose(self, target: str, source: str, time: int) -> tuple[int, Pose]:
        """
        Compute the pose of a source in a target.

        :returns: the time (ns), and the pose.
        :raises TransformException: when there is none.
        """
        path = self.paths.get((target, source))
        if path is not None:
            try:
                answered = time or path.latest_common_time()
                return answered, path.pose(answered)
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
        Compute the pose that a source had at its time, in a target at its own time.

        :param fixed: the frame in which things stay where they are between the two times.
        """
        self.tree.check_for_lookup(target_frame=target, source_frame=source, fixed_frame=fixed)
        _, fixed_from_source = self.pose(fixed, source, source_time)
        time, target_from_fixed = self.pose(target, fixed, target_time)
        return time, compose(target_from_fixed, fixed_from_source)

    def poses(self, target: str, source: str, times: NDArray[np.int64]
              ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """
        Compute the poses of a source in a target at many times.

        :param times: (n,).
        :returns: (n, 7), NaN where there is none, and (n,) whether there is one.
        """
        path = self.paths.get((target, source))
        if path is None:
            with suppress(TransformException):  # the latest, which most likely can be had
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
        Check that there is a pose of a source in a target.

        :raises TransformException: when there is none.
        """
        path = self.paths.get((target, source))
        if path is None or not path.covers(time or path.latest_common_time()):
            if target == source:
                return
            self.tree.check_for_can_transform(target_frame=target, source_frame=source)
            self._search(target, source, time)

    def check_full(self, target: str, target_time: int, source: str, source_time: int, fixed: str
                   ) -> None:
        """Check that there is what `pose_full` returns."""
        self.tree.check_for_can_transform(
            target_frame=target, source_frame=source, fixed_frame=fixed)
        self.check(target, fixed, target_time)
        self.check(fixed, source, source_time)

    def chain(self, target: str, target_time: int, source: str, source_time: int, fixed: str
              ) -> list[str]:
        """List the frames from a source by way of the fixed frame to a target, without detour."""
        self.check_full(target, target_time, source, source_time, fixed)
        there = self._frames(fixed, source, source_time)
        back = self._frames(fixed, target, target_time)
        while len(there) > 1 and len(back) > 1 and there[-2] == back[-2]:
            there.pop()
            back.pop()
        return there[:-1] + back[::-1]

    def _frames(self, target: str, source: str, time: int) -> list[str]:
        if target == source:
            return [target]
        time = time or self.tree.latest_common_time(target, source)
        return self.tree.chain(target, source, time)

    def latest_common_time(self, target: str, source: str) -> int:
        """Return the latest time (ns) of which all frames between two know; 0: nothing moves."""
        for name in target, source:
            self.tree.check(name, 'get_latest_common_time')
        return self.tree.latest_common_time(target, source)

    def _search(self, target: str, source: str, time: int) -> tuple[int, Path]:
        time = time or self.tree.latest_common_time(target, source)
        path = self.tree.path(target, source, time)
        if path.is_fixed() and all(map(self.tree.has_no_loop_above, (source, target))):
            if len(self.paths) >= _MOST_PATHS:
                self.paths.clear()
            self.paths[target, source] = path
        return time, path

    def all_poses(self, targets: Iterable[str], until: int) -> list[dict[str, tuple[int, Pose]]]:
        """
        Compute the pose of every frame that is connected to a target, by one walk for each target.

        :param until: no later than this time, by the parents that the frames have then; 0: without
            a limit.
        :returns: for each target, the time (ns) and the pose by the names of the frames, the
            nearest first.
        :raises TransformException: when a target does not exist.
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
        own, placed = self.tree.histories[target], self._placed(edges, target, until)
        if own is not None:
            placed[target] = min(until, own.latest) if until else own.latest, IDENTITY
        return {name: (time, pose) for name, (time, pose) in placed.items() if pose is not None}

    def _placed(self, edges: dict[str, list[_Edge]], target: str, until: int
                ) -> dict[str, _Placed]:
        placed: dict[str, _Placed] = {target: (0, IDENTITY)}
        names = [target]
        for name in names:
            time, pose = placed[name]
            for other, is_child, edge in edges.get(name, ()):
                if other in placed:
                    continue
                names.append(other)
                latest = min(until, edge.latest) if until else edge.latest
                common = min(time, latest) if time and latest else time or latest
                placed[other] = common, None
                try:
                    # The pose holds at the common time, and the edge has one parent only.
                    if pose is not None and time in (0, common) and edge.parents is None:
                        step = edge.pose_at(common)
                        placed[other] = common, compose(pose, step if is_child else inverse(step))
                    else:
                        placed[other] = self.pose(target, other, common)
                except (NoPose, TransformException):
                    pass  # those beyond may have another path, by parents that they had then
        return placed
