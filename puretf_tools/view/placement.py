"""The frames at one time: the position and the parent of each in the scene, and its age."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping
from itertools import chain, islice
from time import monotonic
from typing import NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from puretf import Frame, in_seconds
from puretf_tools.inspection.forest import descend, Forest, self_and_ancestors
from puretf_tools.inspection.gaps import AnyBuffer

Floats = NDArray[np.float64]
#: A frame of this age (s) is dead, as by default in rviz2 ("Frame Timeout").
TIMEOUT = 15.0
#: The distance between the anchors of trees that are not connected, along -y (m).
SPACING = 2.0
#: The scene has its origin at the fixed frame, unless most frames are farther from it than this
#: (m): a browser computes in float32, in which 10 km have 1 mm.
_NEAR = 1e4
#: Frames that are farther from the origin of the scene than this (m) are not drawn.
REACH = 1e6
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
    names: list[str]  #: of the n frames
    anchors: list[str]  #: (n,): of their trees
    parents: list[int]  #: (n,): the index of the parent in `names`; -1: there is no line to it
    poses: Floats  #: (n, 7): x, y, z (m), quaternion x, y, z, w, in the anchor
    points: Floats  #: (n, 3): x, y, z in the scene (m); 0 for frames that are `far`
    origin: Floats  #: (3,): of the scene, in the fixed frame (m)
    stamps: list[int]  #: (n,): ns; 0: the pose is valid at all times
    #: (n,): s since the last new stamp; a static frame has the age of its parent, and a root 0.
    ages: Floats
    late: dict[str, float]  #: the ages of those that are older than a third of the timeout
    timeout: float  #: the age (s) of frames that are dead
    frames: dict[str, Frame]  #: by name: the frames that have a parent and are shown
    trees: dict[str, float]  #: by anchor: its y in the scene (m)
    deepest: str  #: in the tree of the fixed frame, the frame with the most ancestors; or ''
    loops: list[list[str]]  #: frames in loops, which have no parent in `frames`
    far: list[str]  #: frames beyond `REACH`, which are not drawn
    dead: list[str]  #: dynamic frames without a new stamp for `timeout`
    left_out: list[str]  #: frames beyond `MAX_FRAMES`, which are not in `names`

    def point(self, name: str) -> Optional[Floats]:
        """Return where a frame is in the scene: (3,), x, y, z (m); None if it is not drawn."""
        return self.points[self.names.index(name)] if (
            name in self.names and name not in self.far) else None


class FrameWatcher:
    """Places the frames of a buffer, and remembers when each frame was last updated."""

    def __init__(self, buffer: AnyBuffer, clock: Callable[[], float] = monotonic) -> None:
        self._buffer, self._clock = buffer, clock
        #: By dynamic frame: the newest stamp (ns), and when it was first seen (s).
        self._updates: dict[str, tuple[int, float]] = {}
        self._origins: dict[str, Floats] = {}  # of the scene, by fixed frame

    def placement(self, fixed: str = '', until: int = 0, timeout: float = TIMEOUT) -> Placement:
        """
        Place the frames.

        Dead frames and those in loops are not connected to their parents. What is below them stays
        in a tree of its own, or is dead, too, if all of the tree of a dead frame is static.

        :param fixed: the fixed frame; if no tree has it, another one is chosen.
        :param until: the time (ns); 0: the latest time.
        :param timeout: the age (s) of dead frames.
        """
        with self._buffer.updated():
            known = {frame.name: frame for frame in self._buffer.frames(until)}
            silences = self._silences(known, until)
            alive = {name: frame for name, frame in known.items() if silences[name] < timeout}
            loops = Forest(alive.values()).loops
            for name in chain(*loops):
                del alive[name]
            forest = Forest(alive.values())
            root_of = descend(alive, {root: root for root in forest.roots}, lambda _, root: root)
            silent = known.keys() - {root_of[name] for name, frame in alive.items()
                                     if not frame.is_static}.union(*loops)
            root_of = {name: root for name, root in root_of.items() if root not in silent}
            if fixed not in root_of:
                fixed = _proposed(root_of)
            shown = _first(alive, root_of, fixed)
            root = root_of.get(fixed, '')
            anchors = [fixed] * bool(fixed) + [
                each for each in forest.roots if each in shown and each != root]
            trees = {anchor: -SPACING * i for i, anchor in enumerate(anchors)}
            frames = {name: frame for name, frame in alive.items() if name in shown}
            found = [(anchor, name, pose) for anchor, tree in zip(
                trees, self._buffer.lookup_all(trees, until, frames))
                for name, pose in tree.items()]
        names = [name for _, name, _ in found]
        poses = np.array([(*pose.translation, *pose.rotation)
                          for _, _, pose in found]).reshape(-1, 7)
        places = poses[:, :3].copy()
        places[:, 1] += [trees[anchor] for anchor, _, _ in found]
        origin = self._origin(fixed, places)
        with np.errstate(over='ignore'):
            points = places - origin
        is_near = np.abs(points).max(axis=1) <= REACH
        points[~is_near] = 0.0
        index = {name: i for i, name in enumerate(names) if is_near[i]}
        age_of = descend(frames, dict.fromkeys(forest.roots, 0.0), lambda name, age: (
            age if frames[name].is_static else silences[name]))
        return Placement(
            fixed=fixed, names=names, anchors=[anchor for anchor, _, _ in found],
            parents=[index.get(frames[name].parent, -1) if name in frames and name in index
                     else -1 for name in names],
            poses=poses, points=points, origin=origin,
            stamps=[pose.stamp for _, _, pose in found],
            ages=np.array([age_of[name] for name in names]),
            late={name: age for name, age in age_of.items() if age > timeout / 3}, timeout=timeout,
            frames=frames, trees=trees, deepest=_deepest(frames, root, index), loops=loops,
            far=[name for name in names if name not in index],
            dead=[name for name in known if silences[name] >= timeout],
            left_out=[name for name in root_of if name not in shown])

    def _origin(self, fixed: str, places: Floats) -> Floats:
        """Return the origin of the scene; it stays while most frames are near it."""
        origin = self._origins.get(fixed, np.zeros(3))
        if len(places := places[np.isfinite(places).all(axis=1)]):
            with np.errstate(over='ignore', invalid='ignore'):
                middle = places[
                    np.abs(places - np.median(places, axis=0)).max(axis=1).argmin()]
            if np.abs(middle - origin).max() > _NEAR:
                origin = self._origins[fixed] = middle
        return origin

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


def _proposed(root_of: Mapping[str, str]) -> str:
    # Between trees of the same size, the name decides, and not what came first.
    sizes = Counter(root_of.values())
    return min(root_of, default='', key=lambda name: (
        PREFERRED.index(name) if name in PREFERRED else len(PREFERRED), -sizes[name], name))


def _first(frames: dict[str, Frame], root_of: dict[str, str], fixed: str) -> Collection[str]:
    """Return the first `MAX_FRAMES`, each after its parent: those in the tree of `fixed` first."""
    if len(root_of) <= MAX_FRAMES:
        return root_of
    above = [*self_and_ancestors(fixed, frames)][::-1]
    others = sorted(root_of, key=lambda name: root_of[name] != root_of[fixed])
    return {*islice(dict.fromkeys([*above, *others]), MAX_FRAMES)}


def _deepest(frames: dict[str, Frame], root: str, index: dict[str, int]) -> str:
    """Return the frame in the tree of a root with the most ancestors; of several, the first."""
    depths = descend(frames, {root: 0}, lambda _, depth: depth + 1)
    return max(depths.keys() & index.keys(), key=lambda name: (depths[name], -index[name]),
               default='')
