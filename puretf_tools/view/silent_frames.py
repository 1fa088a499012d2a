"""Whether frames are alive: how long each was silent, which have left the page, which are old."""

from collections.abc import Callable, Iterable
from math import inf
from time import monotonic

from puretf import Frame, in_seconds
from puretf_tools.inspection.forest import descend, self_and_ancestors

#: A frame of this age (s) is not drawn, as by default in rviz2 ("Frame Timeout").
TIMEOUT = 15.0
#: If a frame has had no new stamp for more than this time (s), its rate is not shown.
SILENT = 1.0
#: A dynamic frame leaves the page if its last update is this much (s) older than the last update
#: of any frame.
GONE = 60.0


class Freshness:
    """Remembers when each dynamic frame was last updated."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        #: By dynamic frame: the newest stamp (ns), and when it was first seen (s).
        self._updates: dict[str, tuple[int, float]] = {}

    def silences(self, frames: dict[str, Frame], until: int = 0) -> dict[str, float]:
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


def ages(frames: dict[str, Frame], trees: Iterable[str], silences: dict[str, float]
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
