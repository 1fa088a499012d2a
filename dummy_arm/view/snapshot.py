"""A snapshot of the frames of a buffer: the position, the parent and the age of each frame."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from math import isfinite
from time import monotonic
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from dummy_arm.inspection.forest import Forest
from dummy_arm.tf import Frame, Transform
from dummy_arm.tf.formatting import in_seconds
from dummy_arm.view.source import AnyBuffer

#: Trees that are not connected are drawn side by side. Their anchors (see `Snapshot`) are at this
#: distance from each other, along -y (m).
SPACING = 2.0
#: Frames that are farther than this from the origin of the scene are drawn at this distance (m): a
#: browser computes in float32, and much larger numbers would become infinite.
REACH = 1e6

_Value = TypeVar('_Value')


class Snapshot(NamedTuple):
    """
    The frames at one time; the frames in the tree of the fixed frame come first.

    In each tree, one frame is the anchor: the poses of all frames of the tree are expressed in
    the anchor. In the tree of the fixed frame, the anchor is the fixed frame; in every other tree,
    the anchor is the root.
    """

    fixed: str  #: the fixed frame; '' if there are no frames
    names: list[str]  #: the names of the n frames that have a pose in the anchor of their tree
    parents: list[int]  #: for each of `names`: the index of the parent in `names`; -1: no parent
    #: in `names`
    poses: NDArray[np.float64]  #: (n, 7): x, y, z (m), quaternion x, y, z, w, in the anchor
    points: NDArray[np.float64]  #: (n, 3): x, y, z in the scene (m), at most `REACH` from the
    #: origin of the scene
    stamps: list[int]  #: the time of each pose (ns); 0: the pose is valid at all times
    ages: NDArray[np.float64]  #: (n,): the longest of the `silences` on the path between the frame
    #: and its anchor (s); for the anchor itself see `_ages`
    silences: dict[str, float]  #: by name, for each of `frames`: the time since its last new stamp
    #: (s); 0 if the frame is static
    frames: dict[str, Frame]  #: all frames that have a parent, by name
    trees: dict[str, float]  #: by the name of each anchor: the y of the anchor in the scene (m)
    deepest: str  #: in the tree of the fixed frame, the frame with the most ancestors; '': none
    loops: list[list[str]]  #: for each loop, the names of its frames; these are not in `names`
    far: list[str]  #: the frames that are beyond `REACH`, and therefore drawn at that distance
    not_finite: list[str]  #: the frames that are not in `names` because x, y or z is not finite

    def anchor_of(self, name: str) -> tuple[str, float]:
        """
        Return the anchor of the tree that contains a frame.

        :param name: the name of the frame.
        :returns: the name of the anchor, and the y of the anchor in the scene (m).
        """
        for ancestor in _self_and_ancestors(name, self.frames):
            if ancestor in self.trees:
                return ancestor, self.trees[ancestor]
        return self.fixed, 0.0


class FrameWatcher:
    """Takes snapshots of the frames of a buffer, and stores when each frame was last updated."""

    def __init__(self, buffer: AnyBuffer) -> None:
        """
        Create a watcher that has not seen any frame.

        :param buffer: the buffer whose frames are watched.
        """
        self._buffer = buffer
        #: The newest stamp of each frame (ns), and the time at which this stamp was first seen (s,
        #: monotonic clock).
        self._updates: dict[str, tuple[int, float]] = {}

    def snapshot(self, fixed: str = '', until: int = 0) -> Snapshot:
        """
        Take a snapshot of the frames.

        :param fixed: the name of the fixed frame. If no tree has this frame, the root of the
            largest tree is used. (Frames in a loop and below a loop are in no tree.)
        :param until: the time of the snapshot (ns), for a bag; 0: the latest time.
        :returns: the snapshot.
        """
        with self._buffer.fetched():
            return self._snapshot(fixed, until)

    def _snapshot(self, fixed: str, until: int) -> Snapshot:
        forest = Forest(self._buffer.frames(until))
        frames = forest.frames
        root_of = _descend(frames, {root: root for root in forest.roots}, lambda _, root: root)
        if fixed not in root_of:
            counts = Counter(root_of.values())
            fixed = max(counts, key=counts.__getitem__, default='')
        trees = {fixed: 0.0} if fixed else {}
        for root in forest.roots:
            if root != root_of.get(fixed):
                trees[root] = -SPACING * len(trees)
        placed: dict[str, Transform] = {}
        offsets: list[float] = []
        not_finite: list[str] = []
        for y, tree in zip(trees.values(), self._buffer.lookup_all(trees, until)):
            placed |= {name: transform for name, transform in tree.items()
                       if all(map(isfinite, transform.translation))}
            not_finite += [name for name in tree if name not in placed]
            offsets += [y] * (len(placed) - len(offsets))
        index = {name: i for i, name in enumerate(placed)}
        poses = np.array([(*transform.translation, *transform.rotation)
                          for transform in placed.values()]).reshape(-1, 7)
        places = poses[:, :3].copy()
        places[:, 1] += offsets
        points = within_reach(places)
        silences = {name: self._silence(frame, until) for name, frame in frames.items()}
        ages = _ages(frames, trees, silences)
        depths = _descend(frames, {root_of.get(fixed, ''): 0}, lambda _, depth: depth + 1)
        return Snapshot(
            fixed, [*placed],
            [index.get(frames[name].parent, -1) if name in frames else -1 for name in placed],
            poses, points, [transform.stamp for transform in placed.values()],
            np.array([ages[name] for name in placed]), silences, frames, trees,
            max(depths.keys() & placed.keys(), key=lambda name: (depths[name], -index[name]),
                default=''), forest.loops,
            [name for name, is_far in zip(placed, (points != places).any(axis=1)) if is_far],
            not_finite)

    def _silence(self, frame: Frame, until: int) -> float:
        """Return the time since the last new stamp of a frame (s)."""
        if frame.is_static:
            return 0.0
        if until:
            return in_seconds(until - frame.latest)
        now = monotonic()
        stamp, since = self._updates.get(frame.name, (None, now))
        if stamp != frame.latest:
            self._updates[frame.name] = frame.latest, now
            return 0.0
        return now - since


def within_reach(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Limit the distance of points from the origin to `REACH`.

    :param points: (..., 3): x, y, z (m), finite.
    :returns: (..., 3): the points; a point beyond `REACH` is moved straight towards the origin.
    """
    largest = np.abs(points).max(axis=-1, keepdims=True, initial=1.0)
    # Each point is divided by its largest coordinate, so that no square in the norm overflows.
    ratios = np.linalg.norm(points / largest, axis=-1, keepdims=True)
    clipped: NDArray[np.float64] = points * np.minimum(
        1.0, REACH / largest / np.maximum(ratios, 1.0))
    return clipped


def _ages(frames: dict[str, Frame], trees: Iterable[str], silences: dict[str, float]
          ) -> dict[str, float]:
    """
    Compute the ages of frames (s), for `Snapshot.ages`.

    The pose of a frame in the anchor depends on each transform on the path between the frame and
    the anchor. So the age of the frame is the longest silence on that path. For the anchor itself,
    there is no such path. If the anchor has a parent, the age of the anchor is its own silence. If
    the anchor is a root, its age is the shortest silence of its children.
    """
    ages: dict[str, float] = {}
    for anchor in trees:
        age = 0.0
        for name in _self_and_ancestors(anchor, frames):
            ages[name] = age
            age = max(age, silences.get(name, 0.0))
    ages = _descend(frames, ages, lambda name, age: max(age, silences[name]))
    children: dict[str, float] = {}
    for name, frame in frames.items():
        children[frame.parent] = min(silences[name], children.get(frame.parent, np.inf))
    for anchor in trees:
        ages[anchor] = silences.get(anchor, children.get(anchor, 0.0))
    return ages


def _descend(frames: dict[str, Frame], known: dict[str, _Value],
             child_value: Callable[[str, _Value], _Value]) -> dict[str, _Value]:
    """
    Compute a value for each descendant of the frames whose values are known.

    :param frames: the frames that have a parent, by name.
    :param known: the known values, by frame.
    :param child_value: computes the value of a frame from its name and the value of its parent.
    :returns: the values by frame, including the known values.
    """
    values = dict(known)
    for name in frames:
        path: dict[str, None] = {}
        while name in frames and name not in values and name not in path:
            path[name] = None
            name = frames[name].parent
        if name in values:
            for child in reversed(path):
                values[child] = child_value(child, values[frames[child].parent])
    return values


def _self_and_ancestors(name: str, frames: dict[str, Frame]) -> Iterator[str]:
    """Yield a frame, its parent, and so on, up to the root or until a loop is complete."""
    seen = set()
    while name not in seen:
        yield name
        seen.add(name)
        if name in frames:
            name = frames[name].parent
