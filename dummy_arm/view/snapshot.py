"""What is shown of the frames of a buffer: where each is, below which, and how old that is."""

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

#: How far apart the roots of trees are shown that nothing connects (m, along -y).
SPACING = 2.0
#: Frames beyond this distance from the fixed frame are drawn at this distance (m). A browser
#: computes in float32, in which much larger numbers are infinite.
REACH = 1e6

_Value = TypeVar('_Value')


class Snapshot(NamedTuple):
    """The frames at a time, those of the tree with the fixed frame first."""

    fixed: str  #: the frame in which the poses are; '' where there is none
    names: list[str]
    parents: list[int]  #: the index of each one's parent; -1 of a root
    poses: NDArray[np.float64]  #: (n, 7): x, y, z (m) and the rotation's x, y, z, w, in the frame
    #: that its tree is placed by
    points: NDArray[np.float64]  #: (n, 3): where it is drawn: x, y, z (m), at most `REACH` away
    stamps: list[int]  #: of these (ns); 0 where all is static
    ages: NDArray[np.float64]  #: (n,): for how long it has not moved as it may have (s), since
    #: nothing was heard of it, or of another on the way to the frame that its tree is placed by
    silences: dict[str, float]  #: for how long nothing was heard of each one (s); 0 where static
    frames: dict[str, Frame]  #: what is known of those with a parent
    trees: dict[str, float]  #: the frame that each tree is placed by, and its y (m)
    deepest: str  #: in the tree of the fixed frame, that which is farthest from the root; or ''
    loops: list[list[str]]  #: frames that cannot be shown, since each is below the other
    far: list[str]  #: those that are drawn nearer than they are
    not_finite: list[str]  #: those that cannot be shown, since their translation is not finite

    def anchor_of(self, name: str) -> tuple[str, float]:
        """Tell by which frame the tree of a frame is placed, and its y (m)."""
        for above in _upwards(name, self.frames):
            if above in self.trees:
                return above, self.trees[above]
        return self.fixed, 0.0


class FrameWatcher:
    """Looks at the frames of a buffer again and again."""

    def __init__(self, buffer: AnyBuffer) -> None:
        """Begin; nothing was heard so far."""
        self._buffer = buffer
        #: The newest stamp of each frame (ns), and when it came (s).
        self._heard: dict[str, tuple[int, float]] = {}

    def snapshot(self, fixed: str = '', until: int = 0) -> Snapshot:
        """
        Look at the frames.

        :param fixed: the frame in which they are shown; '' or unknown: the root of most frames.
        :param until: the time at which (ns), as in a bag; 0: now.
        """
        with self._buffer.fetched():
            return self._snapshot(fixed, until)

    def _snapshot(self, fixed: str, until: int) -> Snapshot:
        forest = Forest(self._buffer.frames(until))
        frames = forest.frames
        tops = _from_above(frames, {root: root for root in forest.roots}, lambda _, top: top)
        if fixed not in tops:
            counts = Counter(tops.values())
            fixed = max(counts, key=counts.__getitem__, default='')
        trees = {fixed: 0.0} if fixed else {}
        for root in forest.roots:
            if root != tops.get(fixed):
                trees[root] = -SPACING * len(trees)
        placed: dict[str, Transform] = {}
        heights: list[float] = []
        not_finite: list[str] = []
        for y, tree in zip(trees.values(), self._buffer.lookup_all(trees, until)):
            placed |= {name: transform for name, transform in tree.items()
                       if all(map(isfinite, transform.translation))}
            not_finite += [name for name in tree if name not in placed]
            heights += [y] * (len(placed) - len(heights))
        index = {name: i for i, name in enumerate(placed)}
        poses = np.array([(*transform.translation, *transform.rotation)
                          for transform in placed.values()]).reshape(-1, 7)
        places = poses[:, :3].copy()
        places[:, 1] += heights
        points = within_reach(places)
        silences = {name: self._silence(frame, until) for name, frame in frames.items()}
        ages = _ages(frames, trees, silences)
        depths = _from_above(frames, {tops.get(fixed, ''): 0}, lambda _, depth: depth + 1)
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
        """Compute how long nothing was heard of a frame (s)."""
        if frame.is_static:
            return 0.0
        if until:
            return in_seconds(until - frame.latest)
        now = monotonic()
        stamp, since = self._heard.get(frame.name, (None, now))
        if stamp != frame.latest:
            self._heard[frame.name] = frame.latest, now
            return 0.0
        return now - since


def within_reach(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Move what is farther than `REACH` from the origin to that distance, in the same direction.

    :param points: (..., 3): x, y, z (m), finite.
    """
    largest = np.abs(points).max(axis=-1, keepdims=True, initial=1.0)
    ratios = np.linalg.norm(points / largest, axis=-1, keepdims=True)  # no square overflows
    near: NDArray[np.float64] = points * np.minimum(
        1.0, REACH / largest / np.maximum(ratios, 1.0))
    return near


def _ages(frames: dict[str, Frame], trees: Iterable[str], silences: dict[str, float]
          ) -> dict[str, float]:
    """Compute for how long frames have not moved as they may have (s)."""
    ages: dict[str, float] = {}
    for target in trees:
        age = 0.0
        for name in _upwards(target, frames):
            ages[name] = age
            age = max(age, silences.get(name, 0.0))
    ages = _from_above(frames, ages, lambda name, age: max(age, silences[name]))
    children: dict[str, float] = {}
    for name, frame in frames.items():
        children[frame.parent] = min(silences[name], children.get(frame.parent, np.inf))
    for target in trees:
        ages[target] = silences.get(target, children.get(target, 0.0))
    return ages


def _from_above(frames: dict[str, Frame], known: dict[str, _Value],
                below: Callable[[str, _Value], _Value]) -> dict[str, _Value]:
    """
    Compute a value for all frames below those of which it is known.

    :param below: computes that of a frame from its parent's.
    """
    values = dict(known)
    for name in frames:
        way: dict[str, None] = {}
        while name in frames and name not in values and name not in way:
            way[name] = None
            name = frames[name].parent
        if name in values:
            for each in reversed(way):
                values[each] = below(each, values[frames[each].parent])
    return values


def _upwards(name: str, frames: dict[str, Frame]) -> Iterator[str]:
    """Follow the parents of a frame, from itself on; in a loop, once round."""
    seen = set()
    while name not in seen:
        yield name
        seen.add(name)
        if name in frames:
            name = frames[name].parent
