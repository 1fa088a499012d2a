"""The frames at one time: the position and the parent of each in the scene, and its age."""

from collections import Counter
from collections.abc import Callable, Iterable
from itertools import takewhile
from math import inf, isfinite
from time import monotonic
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puretf import Frame, in_seconds
from puretf_tools.inspection.forest import descend, Forest, self_and_ancestors
from puretf_tools.view.feed import AnyBuffer

#: A frame of this age (s) is not drawn, as by default in rviz2 ("Frame Timeout").
TIMEOUT = 15.0
#: If a frame has had no new stamp for more than this time (s), its rate is not shown.
SILENT = 1.0
#: A dynamic frame leaves the page if its last update is this much (s) older than the last update
#: of any frame.
GONE = 60.0
#: The distance between the anchors of trees that are not connected, along -y (m).
SPACING = 2.0
#: Frames that are farther than this from the origin of the scene are drawn at this distance (m): a
#: browser computes in float32, and much larger numbers would become infinite.
REACH = 1e6
#: The largest distance of frames from an origin that is not the fixed frame (m), and the side of
#: the cubes that are searched for most frames: in float32, 10 km have 1 mm.
_FARTHEST, _TILE = 1e9, 1e4
#: If no viewer has chosen a fixed frame, it is the first of these that exists.
PREFERRED = 'map', 'odom', 'world', 'base_link'
#: The largest number of frames that are shown.
MAX_FRAMES = 2000


class Placement(NamedTuple):
    """
    The frames at one time; the frames in the tree of the fixed frame come first.

    Poses are expressed in the anchor of their tree: the fixed frame, or in other trees the root.
    """

    fixed: str  #: '' if there are no frames
    names: list[str]  #: of the n frames that have a pose
    anchors: list[str]  #: (n,): of their trees
    parents: list[int]  #: (n,): the index of the parent in `names`, or -1
    poses: NDArray[np.float64]  #: (n, 7): x, y, z (m), quaternion x, y, z, w, in the anchor
    points: NDArray[np.float64]  #: (n, 3): x, y, z in the scene (m), within `REACH`
    #: (3,): where the scene has its origin, in the fixed frame (m): it is where most frames are,
    #: if these are far from the fixed frame.
    origin: NDArray[np.float64]
    stamps: list[int]  #: (n,): ns; 0: the pose is valid at all times
    ages: NDArray[np.float64]  #: (n,): s, see `ages_of`
    silences: dict[str, float]  #: by name: s since the last new stamp; 0 if the frame is static
    frames: dict[str, Frame]  #: by name: the frames that have a parent and are shown
    trees: dict[str, float]  #: by anchor: its y in the scene (m)
    deepest: str  #: in the tree of the fixed frame, the frame with the most ancestors; or ''
    loops: list[list[str]]  #: frames in loops; these are not in `names`
    far: list[str]  #: frames beyond `REACH`, which are drawn at that distance
    not_finite: list[str]  #: frames that are not in `names` because x, y or z is not finite
    gone: int  #: the number of frames that have left the page; see `GONE`
    left_out: list[str]  #: frames beyond `MAX_FRAMES`, which are not in `names`


class FrameWatcher:
    """Places the frames of a buffer, and remembers when each frame was last updated."""

    def __init__(self, buffer: AnyBuffer, clock: Callable[[], float] = monotonic) -> None:
        self._buffer, self._clock = buffer, clock
        #: By dynamic frame: the newest stamp (ns), and when it was first seen (s).
        self._updates: dict[str, tuple[int, float]] = {}
        self._origins: dict[str, NDArray[np.float64]] = {}  # of the scene, by fixed frame

    def placement(self, fixed: str = '', until: int = 0) -> Placement:
        """
        Place the frames.

        :param fixed: the fixed frame; if no tree has it, another one is chosen.
        :param until: the time (ns); 0: the latest time.
        """
        found = self._placement(fixed, until)
        if fixed == found.fixed or found.fixed not in found.far:
            return found
        # Nobody has chosen this fixed frame, such as the centre of the Earth.
        near = [name for name, anchor in zip(found.names, found.anchors)
                if name not in found.far and anchor == found.fixed]
        return self._placement(min(near, key=_preference, default=''), until) if near else found

    def _placement(self, fixed: str, until: int) -> Placement:
        with self._buffer.updated():
            known = {frame.name: frame for frame in self._buffer.frames(until)}
            silences = self._silences(known, until)
            kept = known if until else without_gone(known, silences)
            forest = Forest(kept.values())
            # Frames in and below loops have no root.
            root_of = descend(kept, {root: root for root in forest.roots}, lambda _, root: root)
            if fixed not in root_of:
                # Between trees of the same size, the name decides, and not what came first.
                sizes = Counter(root_of.values())
                fixed = min(root_of, default='', key=lambda name: (
                    _preference(name), -sizes[name], name))
            shown = _first(kept, root_of, fixed)
            root = root_of.get(fixed, '')
            anchors = [fixed] * bool(fixed) + [
                each for each in forest.roots if each in shown and each != root]
            trees = {anchor: -SPACING * i for i, anchor in enumerate(anchors)}
            frames = {name: frame for name, frame in kept.items() if name in shown}
            found = [(anchor, name, pose) for anchor, tree in zip(
                trees, self._buffer.lookup_all(trees, until, frames))
                for name, pose in tree.items()]
        placed = [each for each in found if all(map(isfinite, each[2].translation))]
        names = [name for _, name, _ in placed]
        index = {name: i for i, name in enumerate(names)}
        poses = np.array([(*pose.translation, *pose.rotation)
                          for _, _, pose in placed]).reshape(-1, 7)
        places = poses[:, :3].copy()
        places[:, 1] += [trees[anchor] for anchor, _, _ in placed]
        origin = self._origin(fixed, places)
        places -= origin
        points = within_reach(places)
        is_far = (points != places).any(axis=1)
        silences = {name: silences[name] for name in frames}
        age_of = ages_of(frames, trees, silences)
        return Placement(
            fixed=fixed, names=names, anchors=[anchor for anchor, _, _ in placed],
            parents=[index.get(frames[name].parent, -1) if name in frames else -1
                     for name in names],
            poses=poses, points=points, origin=origin,
            stamps=[pose.stamp for _, _, pose in placed],
            ages=np.array([age_of[name] for name in names]), silences=silences,
            frames=frames, trees=trees, deepest=_deepest(frames, root, index), loops=forest.loops,
            far=[name for name, far in zip(names, is_far) if far],
            not_finite=[name for _, name, _ in found if name not in index],
            gone=_count(known) - _count(kept),
            left_out=[name for name in root_of if name not in shown])

    def _origin(self, fixed: str, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the origin of the scene; it stays while most frames are near it."""
        tiles = Counter({(0.0, 0.0, 0.0): 0})
        near = places[(np.abs(places) < _FARTHEST).all(axis=1)]
        tiles.update(map(tuple, np.round(near / _TILE).tolist()))
        (tile, _), = tiles.most_common(1)
        if not any(tile):
            return np.zeros(3)
        middle = near[(np.round(near / _TILE) == tile).all(axis=1)].mean(axis=0)
        before = self._origins.get(fixed, middle)
        self._origins[fixed] = before if np.abs(middle - before).max() <= _TILE else middle
        return self._origins[fixed]

    def watch(self) -> None:
        """Remember when the frames were updated, as `placement` does for the latest time."""
        self._silences({frame.name: frame for frame in self._buffer.frames()})

    def _silences(self, frames: dict[str, Frame], until: int = 0) -> dict[str, float]:
        """
        Return how long frames have had no new stamp (s); 0.0 if a frame is static.

        :param until: the time of a bag (ns), to which the stamps are compared; 0: the frames are
            live, and this call remembers which stamps are new.
        """
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


def without_gone(frames: dict[str, Frame], silences: dict[str, float]) -> dict[str, Frame]:
    """
    Return the frames without those that have left the page.

    A dynamic frame leaves after `GONE`, and with it the static frames below it. If there is a
    dynamic frame below it that stays, they stay too, in a tree of their own.
    """
    quietest = min((silences[name] for name, frame in frames.items() if not frame.is_static),
                   default=0.0)
    silent = {name for name, silence in silences.items() if silence - quietest > GONE}
    rest = {name: frame for name, frame in frames.items() if name not in silent}
    root_of = descend(rest, {frame.parent: frame.parent for frame in rest.values()
                             if frame.parent not in rest}, lambda _, root: root)
    silent.difference_update(
        root_of.get(name, '') for name, frame in rest.items() if not frame.is_static)
    return {name: frame for name, frame in rest.items() if root_of.get(name) not in silent}


def ages_of(frames: dict[str, Frame], trees: Iterable[str], silences: dict[str, float]
            ) -> dict[str, float]:
    """
    Compute the ages of frames (s): the longest silence on the path to the anchor of their tree.

    For the anchor itself, there is no such path: its age is its own silence, or if it is a root,
    the shortest silence of its children.
    """
    found: dict[str, float] = {}
    for anchor in trees:
        age = 0.0
        for name in self_and_ancestors(anchor, frames):
            found[name] = age
            age = max(age, silences.get(name, 0.0))
    found = descend(frames, found, lambda name, age: max(age, silences[name]))
    children: dict[str, float] = {}
    for name, frame in frames.items():
        children[frame.parent] = min(silences[name], children.get(frame.parent, inf))
    for anchor in trees:
        found[anchor] = silences.get(anchor, children.get(anchor, 0.0))
    return found


def _preference(name: str) -> int:
    return PREFERRED.index(name) if name in PREFERRED else len(PREFERRED)


def _count(frames: dict[str, Frame]) -> int:
    """Return the number of frames, and of their parents that have no parent."""
    return len({*frames, *(frame.parent for frame in frames.values())})


def _first(frames: dict[str, Frame], root_of: dict[str, str], fixed: str) -> Iterable[str]:
    """Return up to `MAX_FRAMES` names: the first in the tree of the fixed frame, then others."""
    if len(root_of) <= MAX_FRAMES:
        return root_of
    shown: dict[str, None] = {}
    preferred = sorted((name for name in frames if name in root_of),
                       key=lambda name: root_of[name] != root_of[fixed])
    for name in [fixed, *preferred]:  # each with its ancestors
        new = [*takewhile(lambda each: each not in shown, self_and_ancestors(name, frames))]
        shown.update(dict.fromkeys(new[::-1][:MAX_FRAMES - len(shown)]))
        if len(shown) == MAX_FRAMES:
            break
    return shown


def _deepest(frames: dict[str, Frame], root: str, index: dict[str, int]) -> str:
    """Return the frame in the tree of a root with the most ancestors; of several, the first."""
    depths = descend(frames, {root: 0}, lambda _, depth: depth + 1)
    return max(depths.keys() & index.keys(), key=lambda name: (depths[name], -index[name]),
               default='')


def within_reach(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Move points (..., 3) beyond `REACH` straight towards the origin; x, y, z (m), finite."""
    largest = np.abs(points).max(axis=-1, keepdims=True, initial=1.0)
    # Each point is divided by its largest coordinate, so that no square in the norm overflows.
    ratios = np.linalg.norm(points / largest, axis=-1, keepdims=True)
    clipped: NDArray[np.float64] = points * np.minimum(
        1.0, REACH / largest / np.maximum(ratios, 1.0))
    return clipped
