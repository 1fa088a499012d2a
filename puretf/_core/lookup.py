"""Lookups in the tree of frames: one pose, the poses at many times, or the poses of all frames."""

from collections.abc import Container, Iterable, Sequence
from contextlib import suppress
from typing import Optional

import numpy as np
from numpy.typing import NDArray

from puretf._core import failures, search
from puretf._core.history import History, NoPose
from puretf._core.pose import compose, IDENTITY, inverse, Pose
from puretf._core.tree import END, FrameTree
from puretf.exceptions import TransformException

#: The largest number of paths that are kept.
_MAX_PATHS = 10_000
#: Up to this number of times, one lookup for each is faster than numpy.
_FEW = 16

#: An edge, as seen from one of its two frames. The items are: the name of the other frame; True if
#: the other frame is the child; the history of the child.
_Neighbour = tuple[str, bool, History]
#: A time (ns), and the pose at this time. If the time is 0, the pose holds at all times. If there
#: is no pose at this time, the second item is None.
_TimedPose = tuple[int, Optional[Pose]]


class Lookups:
    """
    Lookups in a tree of frames; paths that were found are kept for later lookups.

    A path from a source frame to a target frame is kept if these frames and their ancestors have
    only one parent each in their histories, and no loop. Such a path is the only path between the
    two frames until a frame gets a new parent. If no path
    between two frames is kept, or if the kept path has no pose at the requested time, the tree is
    searched in the same way as in tf2. Therefore all results and errors are the same as in tf2.

    Times are in ns; 0 means the latest common time. `pose` returns its time, too. Methods raise
    tf2's errors. Hold the lock of the buffer during each call.
    """

    def __init__(self, tree: FrameTree) -> None:
        self.tree = tree
        #: The kept paths; the keys are (target frame, source frame). `Insertion` clears this dict
        #: when a frame gets a new parent, or changes between static and dynamic.
        self.paths: dict[tuple[str, str], search.Path] = {}

    def pose(self, target: str, source: str, time: int) -> tuple[int, Pose]:
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
        failures.check_for_lookup(self.tree, target_frame=target, source_frame=source)
        time, path = self._search(target, source, time)
        return time, path.pose(time)

    def pose_full(self, target: str, target_time: int, source: str, source_time: int, fixed: str
                  ) -> tuple[int, Pose]:
        failures.check_for_lookup(
            self.tree, target_frame=target, source_frame=source, fixed_frame=fixed)
        _, fixed_from_source = self.pose(fixed, source, source_time)
        time, target_from_fixed = self.pose(target, fixed, target_time)
        return time, compose(target_from_fixed, fixed_from_source)

    def poses(self, target: str, source: str, times: NDArray[np.int64]
              ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        path = self._kept_path(target, source)
        if path is not None and len(times) > _FEW:
            poses, known = path.poses(times)
        else:
            poses, known = np.empty((7, len(times))), np.zeros(len(times), np.bool_)
            for i, time in enumerate(times.tolist()):
                with suppress(TransformException):
                    _, poses[:, i] = self.pose(target, source, time)
                    known[i] = True
        poses[:, ~known] = np.nan
        return poses, known

    def _kept_path(self, target: str, source: str) -> Optional[search.Path]:
        """Return the kept path between two frames; if there is none, try to find and keep one."""
        if (target, source) not in self.paths:
            # A lookup at the latest common time is the most likely to succeed.
            with suppress(TransformException):
                self.pose(target, source, 0)
        return self.paths.get((target, source))

    def check(self, target: str, source: str, time: int) -> None:
        """Raise the error of tf2's canTransform if `pose` has no result."""
        path = self.paths.get((target, source))
        begin, end = path.span() if path else (END, -END)
        if not begin <= (time or end) <= end:
            if target == source:
                return
            failures.check_for_can_transform(self.tree, target_frame=target, source_frame=source)
            self._search(target, source, time)

    def available(self, target: str, source: str, times: Sequence[int]) -> tuple[list[bool], int]:
        """
        Return at which times `pose` has a result; much faster than one `check` for each.

        The second value is a time: a pose for an earlier time, other than 0, that is not available
        now never will be. It is the latest common time minus the cache time.
        """
        latest, available = 0, [target == source] * len(times)
        if target != source and ((target, source) in self.paths or search.may_be_connected(
                self.tree, target, source)):
            path = self._kept_path(target, source)
            if path is not None:
                latest, (begin, end) = path.latest_common_time(), path.span()
                available = [begin <= (time or latest) <= end for time in times]
            else:
                with suppress(TransformException):
                    latest = search.latest_common_time(self.tree, target, source)
                for i, time in enumerate(times):
                    with suppress(TransformException):
                        self.check(target, source, time)
                        available[i] = True
        return available, latest - self.tree.cache_time if latest else -END

    def check_full(self, target: str, target_time: int, source: str, source_time: int, fixed: str
                   ) -> None:
        """Raise the error of tf2's canTransform if `pose_full` has no result."""
        failures.check_for_can_transform(
            self.tree, target_frame=target, source_frame=source, fixed_frame=fixed)
        self.check(target, fixed, target_time)
        self.check(fixed, source, source_time)

    def chain(self, target: str, target_time: int, source: str, source_time: int, fixed: str
              ) -> list[str]:
        """
        Return the frames on the path from a source frame via a fixed frame to a target frame.

        If the path goes to the fixed frame and back along the same edges, these edges are left
        out.
        """
        failures.check_for_lookup(
            self.tree, target_frame=target, source_frame=source, fixed_frame=fixed)
        self.check_full(target, target_time, source, source_time, fixed)
        from_source = search.chain(self.tree, fixed, source, source_time)
        from_target = search.chain(self.tree, fixed, target, target_time)
        while len(from_source) > 1 and len(from_target) > 1 and from_source[-2] == from_target[-2]:
            from_source.pop()
            from_target.pop()
        return from_source[:-1] + from_target[::-1]

    def latest_common_time(self, target: str, source: str) -> int:
        """Return the latest time for which every edge has data; 0 if all edges are static."""
        for name in target, source:
            failures.check(self.tree, name, 'get_latest_common_time')
        return search.latest_common_time(self.tree, target, source)

    def _search(self, target: str, source: str, time: int) -> tuple[int, search.Path]:
        """Search the tree for a path; keep the path if it meets the conditions in `Lookups`."""
        time = time or search.latest_common_time(self.tree, target, source)
        path = search.path(self.tree, target, source, time)
        if all(search.has_one_chain(self.tree, frame) for frame in (source, target)):
            if len(self.paths) >= _MAX_PATHS:
                self.paths.clear()
            self.paths[target, source] = path
        return time, path

    def all_poses(self, targets: Iterable[str], until: int,
                  children: Optional[Container[str]] = None
                  ) -> list[dict[str, tuple[int, Pose]]]:
        """Compute what `BufferBase.lookup_all` returns, as times and poses."""
        edges: dict[str, list[_Neighbour]] = {}
        for (child, parent, *_), history in self.tree.frames(until):
            if children is None or child in children:
                edges.setdefault(parent, []).append((child, True, history))
                edges.setdefault(child, []).append((parent, False, history))
        return [self._all_poses(edges, target, until) for target in targets]

    def _all_poses(self, edges: dict[str, list[_Neighbour]], target: str, until: int
                   ) -> dict[str, tuple[int, Pose]]:
        """Walk the tree from a target frame, breadth first, and compute the pose of each frame."""
        if target not in self.tree.histories:
            failures.check(self.tree, target, 'lookup_all')
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
                    # If the pose of `name` is valid at the common time, and the child frame of the
                    # edge has only one parent in its history, no lookup is needed: the pose of
                    # `other` follows from the pose of `name`.
                    if pose is not None and time in (0, common) and edge.parents is None:
                        step = edge.pose_at(common)
                        poses[other] = common, compose(pose, step if is_child else inverse(step))
                    else:
                        poses[other] = self.pose(target, other, common)
                except (NoPose, TransformException):
                    # The walk goes on, because frames beyond `other` may have a pose at an earlier
                    # time, at which the path to them was different.
                    pass
        if (history := self.tree.histories[target]) is not None:
            poses[target] = min(until, history.latest) if until else history.latest, IDENTITY
        return {name: (time, pose) for name, (time, pose) in poses.items() if pose is not None}
