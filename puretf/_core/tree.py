"""The tree of frames: the history of each frame, and the ancestors of a frame."""

from copy import deepcopy
from itertools import takewhile
from operator import ne
from typing import Any, Optional

from puretf._causes.facts import Frames, Look, Parent, Surroundings
from puretf._core import texts
from puretf._core.frames import Frame
from puretf._core.history import History
from puretf.exceptions import described

#: A time after all stamps (ns), which are int64.
END = 2**63
#: The largest number of parents that are kept of a frame, and of frames with faults.
_MAX_PARENTS, _MAX_REFUSED = 8, 1000
#: Parents alternate if they do so among the last samples.
_LAST = 20


class FrameTree:
    """
    The frames of a buffer and their histories.

    `histories` is a dict from the name of each frame to its history, in the order in which the
    frames first occurred in a transform. The value is None if a frame has occurred only as a
    parent. Paths and errors are the same as in tf2, but more may follow tf2's error text.
    """

    def __init__(self, cache_time: int) -> None:
        self.cache_time = cache_time
        self.histories: dict[str, Optional[History]] = {}
        self.missing_part = ''  #: which part of a bag is missing, and what to do
        self.takes_ns = False  #: True if the buffer's times are integers (ns)
        self.needs_listener = False  #: True if a listener is expected to fill the buffer
        #: What the texts of errors use; called when a text is read.
        self.look: Look = Surroundings
        #: By child: the parents that it has had before, the latest last.
        self._earlier: dict[str, dict[str, Parent]] = {}
        #: By child, then by the code of a cause: how many transforms were refused, or a `nanosec`
        #: of a stamp that was 10**9 or more; and the last publisher.
        self._refusals: dict[str, dict[str, tuple[int, str]]] = {}

    def clear(self) -> None:
        """Drop the samples of dynamic frames; static poses and the names of all frames stay."""
        for name, _ in self.dynamic():
            self.histories[name] = History(self.cache_time)
        self._earlier.clear()
        self._refusals.clear()

    def copy(self, other: 'FrameTree') -> None:
        """Take the data of another tree."""
        self.missing_part = other.missing_part
        self.histories.update(deepcopy(other.histories))
        self._earlier, self._refusals = deepcopy((other._earlier, other._refusals))

    def note_parents(self, child: str) -> None:
        """Keep the parents of a frame, which is about to get another one."""
        history = self.histories.get(child)
        if history is not None and len(history):
            parents = self._earlier.setdefault(child, {})
            for name in history.all_parents:
                parents.pop(name, None)
                parents[name] = Parent(name, history.authority, history.is_static)
            for name in [*parents][:-_MAX_PARENTS]:
                del parents[name]

    def note_refusal(self, child: str, code: str, authority: str, nanosec: int = 0) -> None:
        """Count a transform that is refused, by the code of the cause, or keep its `nanosec`."""
        if child in self._refusals or len(self._refusals) < _MAX_REFUSED:
            codes = self._refusals.setdefault(child, {})
            codes[code] = nanosec or codes.get(code, (0, ''))[0] + 1, authority

    def facts(self, names: tuple[str, ...]) -> Frames:
        """Return what is known of the frames, of which some have these names; needs no lock."""
        return Frames(
            names, {child: parent for child, parent in self.newest_edges() if parent},
            tuple(self._earlier), self._parents,
            lambda child: self._refusals.get(child, {}), self.missing_part,
            self.takes_ns, self.needs_listener)

    def _parents(self, child: str) -> list[Parent]:
        """Return the parent of a frame, and before it those with which it alternates."""
        history = self.histories.get(child)
        if history is None or (newest := history.parent_at(0)) is None:
            return []
        parents = [*(history.parents or ())]
        # A frame that is handed over to another one, as by a gripper, has one parent.
        is_moved = not history.is_static and sum(
            map(ne, parents[-_LAST - 1:], parents[-_LAST:])) < 2
        found = {each: Parent(each, '', False) for each in parents if not is_moved}
        found.update((name, each) for name, each in tuple(self._earlier.get(child, {}).items())
                     if each.is_static or not is_moved)
        found.pop(newest, None)
        return [*found.values(), Parent(newest, history.authority, history.is_static)]

    def remove(self, name: str) -> None:
        """Drop the samples of a frame; its name stays if it is the parent of another one."""
        self.histories[name] = None
        if not any(name in history.all_parents
                   for history in self.histories.values() if history is not None):
            del self.histories[name]

    def mend(self) -> None:
        """Drop the samples of each frame in which a change was interrupted."""
        for name, history in self.dynamic():
            if not history.is_consistent():
                self.histories[name] = History(self.cache_time)

    def copy_samples(self) -> None:
        """Copy arrays that could not grow after a fork, if numpy arrays still use their memory."""
        for _, history in self.dynamic():
            history.stamps, history.poses = history.stamps[:], history.poses[:]

    def problem(self, name: str) -> Optional[str]:
        """Return, in tf2's words, what is wrong with a frame's name; None if the frame exists."""
        if not isinstance(name, str):
            raise TypeError(f'a frame must be a str, got {described(name)}')
        if not name:
            return texts.EMPTY_NAME
        if name.startswith('/'):
            return texts.LEADING_SLASH
        return None if name in self.histories else texts.UNKNOWN_FRAME

    def frames(self, until: int = 0) -> list[tuple[Frame, History]]:
        """Return state and history of each frame with samples up to a time (ns; 0: any)."""
        return [(frame, history) for name, history in self.histories.items()
                if history is not None and (frame := history.state(name, until)) is not None]

    def dynamic(self) -> list[tuple[str, History]]:
        """Return the dynamic frames, also those whose samples were dropped; needs no lock."""
        return [(name, history) for name, history in [*self.histories.items()]
                if history is not None and not history.is_static]

    def dump(self) -> dict[str, dict[str, Any]]:
        return {name: {**History(0).dump(), 'arrived': None} if history is None else history.dump()
                for name, history in self.histories.items()}

    def newest_edges(self) -> list[tuple[str, Optional[str]]]:
        """Return the frames that have had a parent, each with the newest (None: cleared)."""
        return [(name, history.parent_at(0)) for name, history in [*self.histories.items()]
                if history is not None]

    def all_ancestors(self, frame: str) -> set[str]:
        """Return a frame and its ancestors; follow every parent that occurs in a history."""
        found = [frame]
        seen = {frame}
        for name in found:
            if (history := self.histories.get(name)) is not None:
                found += [parent for parent in history.all_parents if parent not in seen]
                seen.update(history.all_parents)
        return seen

    def chain(self, frame: str, time: int) -> dict[str, None]:
        """Return a frame and its ancestors by the parents nearest to a time (ns), as keys."""
        chain: dict[str, None] = {}
        parent: Optional[str] = frame
        while parent and parent not in chain:  # or a loop
            chain[parent] = None
            history = self.histories[parent]
            parent = None if history is None else history.parent_near(time)
        return chain

    def dynamic_edges(self, source: str, target: str, time: int = END
                      ) -> Optional[list[tuple[str, History]]]:
        """
        Return the dynamic frames on the path by the parents nearest to a time (ns).

        By default, these are the newest parents. None: there is no path.
        """
        chains = self.chain(source, time), self.chain(target, time)
        meeting = next(filter(chains[0].__contains__, chains[1]), None)
        return None if meeting is None else [
            (frame, history) for chain in chains for frame in takewhile(meeting.__ne__, chain)
            if (history := self.histories[frame]) is not None and not history.is_static]
