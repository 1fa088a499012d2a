"""Lookups among the frames of a tree, by any number of threads, while others insert."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import RLock
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf import batch, frame_names
from dummy_arm.tf.exceptions import TransformException
from dummy_arm.tf.frame_tree import FrameTree
from dummy_arm.tf.history import NoPose, Pose
from dummy_arm.tf.path import compose, IDENTITY, Path

_MOST_PATHS = 10_000
#: So many answers at once, so that nobody waits long for the lock.
_CHUNK = 2048


class Source(Protocol):
    """What brings transforms into a buffer."""

    def fetch(self) -> None:
        """Insert what has arrived; called with the lock held, before a look at the data."""

    def hurry(self) -> None:
        """From now on, and as long as somebody waits, bring in what arrives at once."""

    def abandon(self) -> None:
        """Bring in nothing more: this is in a process that was forked, without its threads."""


class Lookups:
    """
    A frame tree, its lock, and the paths that were found in it.

    A path on which no frame changes its parent, with no loop above it at any time, is the only one
    between its frames, until some frame gets a new parent: it is kept. Where there is none, or it
    gives no answer, the tree is searched as tf2 does, for the answer or error that tf2 would give.
    Times are ns; 0: the latest common time.
    """

    def __init__(self, cache_time: int) -> None:
        """
        Begin without frames.

        :param cache_time: how long a history lasts (ns).
        """
        self.lock = RLock()
        self.tree = FrameTree(cache_time)
        self.sources: tuple[Source, ...] = ()
        #: Another object whenever a frame got another history or another parent.
        self.version = object()
        self._paths: dict[tuple[str, str], Path] = {}

    def insert(self, stamp: int, parent: str, child: str, pose: Pose, authority: str,
               is_static: bool) -> bool:
        """
        Insert the pose of a child in its parent.

        :returns: False when it is too old.
        """
        with self.lock:
            try:
                taken, changed = self.tree.insert(stamp, parent, child, pose, authority, is_static)
            except BaseException:  # as Ctrl-C, in the midst of a change
                self.has_changed()
                raise
            if changed:
                self.has_changed()
        return taken

    def fetch(self) -> None:
        """Insert what has arrived; with the lock held, and no lookup under way."""
        for origin in self.sources:
            origin.fetch()

    def hurry(self) -> None:
        """As long as somebody waits, have the sources bring in at once what arrives."""
        for origin in self.sources:
            origin.hurry()

    @contextmanager
    def fetched(self) -> Iterator[None]:
        """Hold the lock, and insert what has arrived first, unless this thread has held it."""
        self.update()
        with self.lock:
            yield

    def update(self) -> None:
        """
        Insert what has arrived, unless this thread holds the lock.

        Lookups call this and then take the lock themselves: Ctrl-C as a block of `fetched` begins
        would leave it locked for as long as somebody keeps the exception.
        """
        if self.sources and not self.is_held():
            with self.lock:
                self.fetch()

    def is_held(self) -> bool:
        """Return whether this thread holds the lock: in a block, or in an interrupted lookup."""
        return bool(self.lock._is_owned())  # type: ignore[attr-defined]

    def clear(self) -> None:
        """Forget what moves; the frames and what is static stay."""
        self.update()  # so that nothing that was sent before comes in after this
        with self.lock:
            try:
                self.tree.clear()
            finally:
                self.has_changed()

    def has_changed(self) -> None:
        """Forget the paths: a frame has got another history, or other parents."""
        self._paths.clear()
        self.version = object()

    def pose(self, target: str, source: str, time: int) -> tuple[int, Pose]:
        """
        Compute the pose of a source in a target.

        :returns: the time (ns), and the pose.
        :raises TransformException: when there is none.
        """
        fetches = self.sources and not self.is_held()  # as `fetched`, which takes longer
        with self.lock:
            if fetches:
                self.fetch()
            path = self._paths.get((target, source))
            if path is not None:
                try:
                    answered = time or path.latest_common_time()
                    return answered, path.pose(answered)
                except NoPose:
                    pass
            if target == source:
                history = self.tree.histories.get(target)
                return time or (history.latest if history is not None else 0), IDENTITY
            frame_names.check_for_lookup(self.tree, target_frame=target, source_frame=source)
            time, path = self._search(target, source, time)
            return time, path.pose(time)

    def pose_full(self, target: str, target_time: int, source: str, source_time: int, fixed: str
                  ) -> tuple[int, Pose]:
        """
        Compute the pose that a source had at its time, in a target at its own.

        :param fixed: the frame in which things stay where they are between the two times.
        """
        self.update()
        with self.lock:
            frame_names.check_for_lookup(
                self.tree, target_frame=target, source_frame=source, fixed_frame=fixed)
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
        self.update()
        order = np.argsort(times, kind='stable')  # which makes searching in histories fast
        poses = np.empty((len(times), 7))
        known = np.zeros(len(times), np.bool_)
        for begin in range(0, len(times), _CHUNK):
            part = order[begin:begin + _CHUNK]
            if not self._poses_at_once(target, source, times, part, poses, known):
                for i in part.tolist():
                    with suppress(TransformException):
                        _, poses[i] = self.pose(target, source, int(times[i]))
                        known[i] = True
        poses[~known] = np.nan
        return poses, known

    def _poses_at_once(self, target: str, source: str, times: NDArray[np.int64],
                       part: NDArray[np.intp], poses: NDArray[np.float64],
                       known: NDArray[np.bool_]) -> bool:
        """Fill in a part of the poses by way of the path that is kept; False: there is none."""
        with self.lock:
            path = self._paths.get((target, source))
            if path is None:
                with suppress(TransformException):  # the latest, which most likely can be had
                    self.pose(target, source, 0)
                path = self._paths.get((target, source))
            if path is not None:
                poses[part], known[part] = batch.poses(path, times[part])
            return path is not None

    def check(self, target: str, source: str, time: int) -> None:
        """
        Check that there is a pose of a source in a target.

        :raises TransformException: when there is none.
        """
        fetches = self.sources and not self.is_held()
        with self.lock:
            if fetches:
                self.fetch()
            path = self._paths.get((target, source))
            if path is None or not path.covers(time or path.latest_common_time()):
                if target == source:
                    return
                frame_names.check_for_can(self.tree, target_frame=target, source_frame=source)
                self._search(target, source, time)

    def check_full(self, target: str, target_time: int, source: str, source_time: int, fixed: str
                   ) -> None:
        """Check that there is what `pose_full` gives."""
        self.update()
        with self.lock:
            frame_names.check_for_can(
                self.tree, target_frame=target, source_frame=source, fixed_frame=fixed)
            self.check(target, fixed, target_time)
            self.check(fixed, source, source_time)

    def chain(self, target: str, target_time: int, source: str, source_time: int, fixed: str
              ) -> list[str]:
        """List the frames from a source by way of the fixed frame to a target, without detour."""
        self.update()
        with self.lock:
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
        """Find the latest time (ns) that all frames between two know of; 0 when nothing moves."""
        self.update()
        with self.lock:
            for name in target, source:
                frame_names.check(name, 'get_latest_common_time', self.tree)
            return self.tree.latest_common_time(target, source)

    def _search(self, target: str, source: str, time: int) -> tuple[int, Path]:
        time = time or self.tree.latest_common_time(target, source)
        path = self.tree.path(target, source, time)
        if path.is_fixed() and self.tree.is_plain(source) and self.tree.is_plain(target):
            if len(self._paths) >= _MOST_PATHS:
                self._paths.clear()
            self._paths[target, source] = path
        return time, path
