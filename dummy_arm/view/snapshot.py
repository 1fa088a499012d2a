"""A snapshot of the frames of a buffer: the position, the parent and the age of each frame."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import takewhile
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
#: If no viewer has chosen a fixed frame, it is the first of these that exists.
PREFERRED = 'map', 'odom', 'world', 'base_link'
#: A dynamic frame leaves the page if its last update is this much (s) older than the last update
#: of any frame.
GONE = 60.0
#: The largest number of frames that are shown.
MAX_FRAMES = 2000

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
    frames: dict[str, Frame]  #: the frames that have a parent, by name, without those that have
    #: left the page or are left out
    trees: dict[str, float]  #: by the name of each anchor: the y of the anchor in the scene (m)
    deepest: str  #: in the tree of the fixed frame, the frame with the most ancestors; '': none
    loops: list[list[str]]  #: for each loop, the names of its frames; these are not in `names`
    far: list[str]  #: the frames that are beyond `REACH`, and therefore drawn at that distance
    not_finite: list[str]  #: the frames that are not in `names` because x, y or z is not finite
    gone: int  #: the number of frames that have left the page; see `GONE`
    left_out: list[str]  #: the frames that are not in `names` because there are more than
    #: `MAX_FRAMES`

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

    def __init__(self, buffer: AnyBuffer, clock: Callable[[], float] = monotonic) -> None:
        """
        Create a watcher that has not seen any frame.

        :param buffer: the buffer whose frames are watched.
        :param clock: a function that returns the time (s), which never goes back.
        """
        self._buffer, self._clock = buffer, clock
        #: For each dynamic frame of the buffer: the newest stamp (ns), and the time at which this
        #: stamp was first seen (s).
        self._updates: dict[str, tuple[int, float]] = {}

    def snapshot(self, fixed: str = '', until: int = 0) -> Snapshot:
        """
        Take a snapshot of the frames.

        :param fixed: the name of the fixed frame. If no tree has this frame, the first frame of
            `PREFERRED` that a tree has is used; if there is none, the root of the largest tree.
            (Frames in a loop and below a loop are in no tree.)
        :param until: the time of the snapshot (ns), for a bag; 0: the latest time.
        :returns: the snapshot.
        """
        with self._buffer.fetched():
            return self._snapshot(fixed, until)

    def _snapshot(self, fixed: str, until: int) -> Snapshot:
        known = {frame.name: frame for frame in self._buffer.frames(until)}
        silences = self._silences(known, until)
        kept = known if until else _without_gone(known, silences)
        forest = Forest(kept.values())
        frames = forest.frames
        root_of = _descend(frames, {root: root for root in forest.roots}, lambda _, root: root)
        if fixed not in root_of:
            # Between trees of the same size, the name decides, and not what came first.
            counts = Counter(root_of.values())
            fixed = next((name for name in PREFERRED if name in root_of), min(
                counts, key=lambda root: (-counts[root], root), default=''))
        left_out: list[str] = []
        if len(root_of) > MAX_FRAMES:
            shown = _first(frames, root_of, fixed)
            left_out = [name for name in root_of if name not in shown]
            root_of = {name: root_of[name] for name in shown}
            frames = {name: frame for name, frame in frames.items() if name in shown}
        silences = {name: silences[name] for name in frames}
        trees = {fixed: 0.0} if fixed else {}
        for root in forest.roots:
            if root != root_of.get(fixed) and root in root_of:
                trees[root] = -SPACING * len(trees)
        placed: dict[str, Transform] = {}
        offsets: list[float] = []
        not_finite: list[str] = []
        for y, tree in zip(trees.values(), self._buffer.lookup_all(trees, until, frames)):
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
            not_finite, 0 if kept is known else len(_names(known)) - len(_names(kept)), left_out)

    def _silences(self, frames: dict[str, Frame], until: int) -> dict[str, float]:
        """Return the time since the last new stamp of each frame (s); 0 if it is static."""
        if until:
            return {name: 0.0 if frame.is_static else in_seconds(until - frame.latest)
                    for name, frame in frames.items()}
        now, before = self._clock(), self._updates
        self._updates = {}
        for name, frame in frames.items():
            if not frame.is_static:
                stamp, since = before.get(name, (0, now))
                self._updates[name] = frame.latest, since if stamp == frame.latest else now
        return {name: now - self._updates[name][1] if name in self._updates else 0.0
                for name in frames}


def _names(frames: dict[str, Frame]) -> set[str]:
    """Return the names of frames that have a parent, and of their parents."""
    return {*frames, *(frame.parent for frame in frames.values())}


def _without_gone(frames: dict[str, Frame], silences: dict[str, float]) -> dict[str, Frame]:
    """
    Return the frames without those that have left the page.

    A dynamic frame leaves after `GONE`, and with it the static frames below it, unless there is
    also a dynamic frame below it that stays: then they stay, in a tree of their own.
    """
    quietest = min((silences[name] for name, frame in frames.items() if not frame.is_static),
                   default=0.0)
    silent = {name for name, silence in silences.items() if silence - quietest > GONE}
    if not silent:
        return frames
    rest = {name: frame for name, frame in frames.items() if name not in silent}
    root_of = _descend(rest, {root: root for root in _names(rest) - rest.keys()},
                       lambda _, root: root)
    silent.difference_update(
        root_of.get(name, '') for name, frame in rest.items() if not frame.is_static)
    return {name: frame for name, frame in rest.items() if root_of.get(name) not in silent}


def _first(frames: dict[str, Frame], root_of: dict[str, str], fixed: str) -> dict[str, None]:
    """
    Return `MAX_FRAMES` names: the frames that came first, each with its ancestors.

    The frames in the tree of the fixed frame are preferred.
    """
    shown: dict[str, None] = {}
    preferred = sorted((name for name in frames if name in root_of),
                       key=lambda name: root_of[name] != root_of[fixed])
    for name in [fixed, *preferred]:
        new = [*takewhile(lambda each: each not in shown, _self_and_ancestors(name, frames))]
        shown.update(dict.fromkeys(new[::-1][:MAX_FRAMES - len(shown)]))
        if len(shown) == MAX_FRAMES:
            break
    return shown


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
