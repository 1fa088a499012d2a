"""The tree of frames: the history of each frame, and the ancestors of a frame."""

from typing import Any, Optional

from puretf._core import hints, texts
from puretf._core.history import AnyHistory, History, State
from puretf.exceptions import described

#: A time after all stamps (ns), which are int64.
END = 2**63


class FrameTree:
    """
    The frames of a buffer and their histories.

    `histories` is a dict from the name of each frame to its history, in the order in which the
    frames first occurred in a transform. The value is None if a frame has occurred only as a
    parent. Paths and errors are the same as in tf2, but a hint may follow tf2's error text.
    """

    def __init__(self, cache_time: int) -> None:
        self.cache_time = cache_time
        self.histories: dict[str, Optional[AnyHistory]] = {}
        #: A hint that follows if frames are unknown or not connected, as when a part of a bag is
        #: missing.
        self.advice = ''
        self.takes_ns = False  #: True if the buffer's times are integers (ns)
        #: What the hints of errors use; called when a text is read.
        self.look: hints.Look = hints.Surroundings

    @property
    def names(self) -> tuple[str, ...]:
        """
        The names of all frames, in the order of `histories`.

        The tuple does not change. So the text of an error can be written later from it, without
        the lock of the buffer.
        """
        return tuple(self.histories)

    def clear(self) -> None:
        """Drop the samples of dynamic frames; static poses and the names of all frames stay."""
        for name, history in self.histories.items():
            if isinstance(history, History):
                self.histories[name] = History(self.cache_time)

    def remove(self, name: str) -> None:
        """Drop the samples of a frame; its name stays if it is the parent of another one."""
        self.histories[name] = None
        if not any(name in history.all_parents
                   for history in self.histories.values() if history is not None):
            del self.histories[name]

    def mend(self) -> None:
        """Drop the samples of each frame in which a change was interrupted."""
        for name, history in self.histories.items():
            if isinstance(history, History) and not history.is_consistent():
                self.histories[name] = History(self.cache_time)

    def copy_samples(self) -> None:
        """Copy arrays that could not grow after a fork, if numpy arrays still use their memory."""
        for history in self.histories.values():
            if isinstance(history, History):
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

    def states(self, until: int = 0) -> list[tuple[str, State, AnyHistory]]:
        """Return name, state and history of each frame with samples up to a time (ns; 0: any)."""
        return [(name, state, history) for name, history in self.histories.items()
                if history is not None and (state := history.state(until)) is not None]

    def has_dynamic(self) -> bool:
        """Return whether there are, or were, dynamic frames; needs no lock."""
        return any(isinstance(history, History) for history in tuple(self.histories.values()))

    def dump(self) -> dict[str, dict[str, Any]]:
        return {name: {**History(0).dump(), 'arrived': None} if history is None else history.dump()
                for name, history in self.histories.items()}

    def newest_edges(self) -> list[tuple[str, Optional[str]]]:
        """Return the frames that have had a parent, each with the newest (None: cleared)."""
        return [(name, history.parent_at(0)) for name, history in self.histories.items()
                if history is not None]

    def all_ancestors(self, frame: str) -> set[str]:
        """Return a frame and its ancestors; follow every parent that occurs in a history."""
        found = [frame]
        seen = {frame}
        for name in found:
            if (history := self.histories.get(name)) is not None:
                parents = [*history.all_parents]  # at once, since `_slip` has no lock
                found += [parent for parent in parents if parent not in seen]
                seen.update(parents)
        return seen

    def chains_to_meeting(self, source: str, target: str, time: int = END
                          ) -> tuple[dict[str, None], dict[str, None], Optional[str]]:
        """
        Follow the parents of two frames, alternately one step each, until the chains meet.

        Follow the parents nearest to a time (ns), by default the newest. Return the chain of each
        frame as the keys of a dict, and the frame at which they meet (or None).
        """
        chains: tuple[dict[str, None], dict[str, None]] = {source: None}, {target: None}
        ends: list[Optional[str]] = [source, target]
        turn = 0
        while ends[0] or ends[1]:
            if end := ends[turn]:
                history = self.histories[end]
                parent = None if history is None else history.parent_near(time)
                if parent in chains[turn]:  # a loop
                    parent = None
                if parent:
                    chains[turn][parent] = None
                    if parent in chains[1 - turn]:
                        return *chains, parent
                ends[turn] = parent
            turn = 1 - turn
        return *chains, None
