"""The tree of frames: the history of each frame, and tf2's search for paths between frames."""

from collections.abc import Callable, Iterator
from functools import partial, reduce
from itertools import pairwise, takewhile
from time import monotonic_ns
from typing import Any, Optional
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from puretf._core import hints, texts
from puretf._core.frames import as_string
from puretf._core.history import AnyHistory, History, State, StaticHistory
from puretf._core.path import Path
from puretf._core.pose import Pose
from puretf.exceptions import (
    ConnectivityException,
    described,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
    with_hint,
)

#: The largest number of edges above a frame. If there are more, tf2 reports a loop.
MAX_GRAPH_DEPTH = 1000
#: A time after all stamps (ns), which are int64.
_END = 2**63
#: The largest number of names that are compared with the root of another tree.
_MAX_SLIPS = 5000


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
        self._names: tuple[str, ...] = ()
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

        Names are never removed. When frames have been added, a new tuple is created, and the old
        tuple does not change. So the text of an error can be written later from the old tuple,
        without the lock of the buffer.
        """
        if len(self._names) != len(self.histories):
            self._names = tuple(self.histories)
        return self._names

    def insert(self, stamp: int, parent: str, child: str, pose: Pose, authority: str,
               is_static: bool) -> bool:
        """
        Insert the pose of a child frame in its parent.

        A static pose replaces all samples of a dynamic frame, and a dynamic pose replaces a static
        one. Return False if the pose is older than the cache time allows.
        """
        histories = self.histories
        history = histories.setdefault(child, None)
        histories.setdefault(parent, None)
        if is_static:
            if isinstance(history, StaticHistory) and history.only_parent == parent:
                history.pose, history.authority = pose, authority
            else:
                histories[child] = StaticHistory(parent, pose, authority)
            return True
        if not isinstance(history, History):
            histories[child] = history = History(self.cache_time)
        return history.insert(stamp, parent, pose, authority)

    def is_known_edge(self, parent: str, child: str, is_static: bool) -> bool:
        """Return True if the paths that `Lookups` keeps stay valid when a sample is inserted."""
        history = self.histories.get(child)
        return (history is not None and history.is_static is is_static
                and parent in history.all_parents)

    def clear(self) -> None:
        """Drop the samples of dynamic frames; static poses and the names of all frames stay."""
        for name, history in self.histories.items():
            if isinstance(history, History):
                self.histories[name] = History(self.cache_time)

    def mend(self) -> None:
        """Drop the samples of each frame in which a change was interrupted."""
        for name, history in self.histories.items():
            if isinstance(history, History) and not history.is_consistent():
                self.histories[name] = History(self.cache_time)

    def release(self) -> None:
        """Make all histories able to grow after a fork; see `History.release`."""
        for history in self.histories.values():
            if isinstance(history, History):
                history.release()

    def check(self, name: str, where: str) -> None:
        """Raise tf2's error if a frame does not exist; its text names the caller, `where`."""
        problem = self._problem(name)
        if problem == texts.UNKNOWN_FRAME:
            raise with_hint(
                LookupException(texts.unknown_frame(name, where)), self._unknown(name))
        if problem:
            raise InvalidArgumentException(texts.invalid_argument(name, where, problem))

    def check_for_lookup(self, **frames: str) -> None:
        """Check frames; each keyword is tf2's name of the argument, such as `target_frame`."""
        for argument, name in frames.items():
            self.check(name, f'lookupTransform argument {argument}')

    def check_for_can_transform(self, **frames: str) -> None:
        """Check frames as `check_for_lookup` does, with the errors of tf2's canTransform."""
        for argument, name in frames.items():
            if problem := self._problem(name):
                words = texts.invalid_frame_id(name, argument, problem)
                if problem != texts.UNKNOWN_FRAME:
                    raise TransformException(words)
                raise with_hint(TransformException(f'{words}. '), self._unknown(name))

    def _unknown(self, name: str) -> Callable[[Optional[hints.Waited]], str]:
        return partial(hints.unknown_frame, self.look, name, self.names,
                       partial(_children, ref(self)), self.advice)

    def _problem(self, name: str) -> Optional[str]:
        """Return, in tf2's words, what is wrong with a frame's name; None if the frame exists."""
        if not isinstance(name, str):
            raise TypeError(f'a frame must be a str, got {described(name)}')
        if not name:
            return texts.EMPTY_NAME
        if name.startswith('/'):
            return texts.LEADING_SLASH
        return None if name in self.histories else texts.UNKNOWN_FRAME

    def path(self, target: str, source: str, time: int) -> Path:
        """Find the path at a time (ns; 0: by the newest parents); raise tf2's error."""
        from_source, from_target = self._walk(target, source, time)
        return Path(self._edges(from_source), self._edges(from_target))

    def chain(self, target: str, source: str, time: int) -> list[str]:
        """Return the frames on the path that `path` finds, the source frame first."""
        from_source, from_target = self._walk(target, source, time)
        # The highest frame of the path is in neither list. It is the parent of the last frame of
        # each list.
        if from_target:
            return [*from_source, *self._parents(from_target[-1:], time), *reversed(from_target)]
        return [source, *self._parents(from_source, time)]

    def _parents(self, frames: list[str], time: int) -> list[str]:
        return [str(edge.parent_at(time)) for edge in self._edges(frames)]

    def _edges(self, frames: list[str]) -> list[AnyHistory]:
        return [history for frame in frames if (history := self.histories[frame]) is not None]

    def _walk(self, target: str, source: str, time: int) -> tuple[list[str], list[str]]:
        """
        Find a path; return the child frames of its edges up from the source, and from the target.

        As in tf2, the search first follows the ancestors of the source, as far as there are data
        for the time, and then the ancestors of the target. If there are several errors, this order
        decides which error is raised.
        """
        from_source: list[str] = []
        stopped_at: Optional[str] = None
        frame = source
        while (history := self.histories[frame]) is not None:
            parent = history.parent_at(time)
            if parent is None:
                stopped_at = frame
                break
            if frame == target:
                return from_source, []
            self._append(from_source, frame)
            frame = parent
        top = frame
        from_target: list[str] = []
        frame = target
        while frame != top and (history := self.histories[frame]) is not None:
            parent = history.parent_at(time)
            if parent is None:
                raise self._extrapolation(frame, time, target, source)
            if frame == source:
                return [], from_target
            self._append(from_target, frame)
            frame = parent
        if frame != top:
            if stopped_at is not None:
                raise self._extrapolation(stopped_at, time, target, source)
            raise self._unconnected(target, source, time or _END)
        while from_source and from_target and from_source[-1] == from_target[-1]:
            from_source.pop()
            from_target.pop()
        return from_source, from_target

    def latest_common_time(self, target: str, source: str) -> int:
        """
        Return the latest time (ns) for which every dynamic edge has data; 0: no such edge.

        The path follows the newest parents of the frames.
        """
        if source == target:
            history = self.histories[source]
            return history.latest if history else 0
        from_source: list[str] = []
        # The number of edges from the source frame up to each of its ancestors.
        depths: dict[str, int] = {}
        for child, parent in self._ancestors(source):
            self._append(from_source, child)
            if parent == target:
                return Path(self._edges(from_source), []).latest_common_time()
            depths[parent] = len(from_source)
        from_target: list[str] = []
        for child, parent in self._ancestors(target):
            self._append(from_target, child)
            if parent == source:
                return Path([], self._edges(from_target)).latest_common_time()
            if parent in depths:
                path = Path(self._edges(from_source[:depths[parent]]), self._edges(from_target))
                return path.latest_common_time()
        raise self._unconnected(target, source)

    def stamps(self, target: str, source: str) -> NDArray[np.int64]:
        """
        Return the stamps of the samples of all edges on the path between two frames.

        At each time, the path follows the parents that the frames had at this time. Before its
        first sample and after its last one, a frame has the parent of this sample. So stamps at
        which only some of the edges have data are returned, too.
        """
        changes = {change for name in self._all_ancestors(target) | self._all_ancestors(source)
                   if isinstance(history := self.histories[name], History)
                   for change in history.parent_changes()}
        parts, is_connected = [], False
        for begin, end in pairwise((-_END, *sorted(changes), _END)):
            from_source, from_target, meeting = self._chains_to_meeting(source, target, begin)
            if meeting is None:
                continue
            is_connected = True
            edges = [history for chain in (from_source, from_target)
                     for frame in takewhile(meeting.__ne__, chain)
                     if isinstance(history := self.histories[frame], History)]
            parts.append(reduce(_union, (
                edge.stamps_between(begin, end) for edge in edges), np.empty(0, np.int64)))
        if not is_connected:
            raise self._unconnected(target, source)
        return np.concatenate(parts)

    def _ancestors(self, frame: str) -> Iterator[tuple[str, str]]:
        """Yield (frame, newest parent) of a frame and each ancestor; follow a loop without end."""
        while (history := self.histories[frame]) and (parent := history.parent_at(0)):
            yield frame, parent
            frame = parent

    def has_no_loop_above(self, frame: str) -> bool:
        """
        Return True if no loop can be above a frame at any time.

        From the frame upwards, every parent that occurs in a history is followed. So there can be
        several chains of parents. If all chains end within 1000 edges, no chain contains a loop.
        """
        ancestors = {frame}
        for _ in range(MAX_GRAPH_DEPTH + 1):
            ancestors = {
                parent for name in ancestors if (history := self.histories[name]) is not None
                for parent in history.all_parents}
            if not ancestors:
                return True
        return False

    def may_be_connected(self, frame: str, other: str) -> bool:
        """
        Return True if two frames may be connected at some time.

        From both frames upwards, every parent that occurs in a history is followed.
        """
        if self._problem(frame) or self._problem(other):
            return False
        return not self._all_ancestors(frame).isdisjoint(self._all_ancestors(other))

    def _all_ancestors(self, frame: str) -> set[str]:
        """Return a frame and its ancestors; follow every parent that occurs in a history."""
        found = [frame]
        seen = {frame}
        for name in found:
            if (history := self.histories[name]) is not None:
                parents = [*history.all_parents]  # at once, since `_slip` has no lock
                found += [parent for parent in parents if parent not in seen]
                seen.update(parents)
        return seen

    def _append(self, chain: list[str], frame: str) -> None:
        """Append a frame to a chain; raise a LookupException if the chain becomes too long."""
        chain.append(frame)
        if len(chain) > MAX_GRAPH_DEPTH:
            # Copy the edges now, since the text of the error is written later, without the lock.
            edges = self.newest_edges()
            raise with_hint(
                LookupException(texts.LOOP),
                lambda _: f'{as_string(edges)}\n{hints.loop(chain)}')

    def states(self, until: int = 0) -> list[tuple[str, State]]:
        """Return the name and state of each frame with samples up to a time (ns; 0: no limit)."""
        return [(name, state) for name, history in self.histories.items()
                if history is not None and (state := history.state(until)) is not None]

    def has_dynamic(self) -> bool:
        """Return whether there are, or were, dynamic frames; needs no lock."""
        return any(isinstance(history, History) for history in tuple(self.histories.values()))

    def edges(self, until: int = 0) -> Iterator[tuple[str, str, AnyHistory]]:
        """Yield each frame of `states` with its newest parent and its history."""
        for name, history in self.histories.items():
            if history is not None and (state := history.state(until)) is not None:
                yield name, state[0], history

    def dump(self) -> dict[str, dict[str, Any]]:
        return {name: (history or History(0)).dump() for name, history in self.histories.items()}

    def newest_edges(self) -> list[tuple[str, Optional[str]]]:
        """Return the frames that have had a parent, each with the newest (None: cleared)."""
        return [(name, history.parent_at(0)) for name, history in self.histories.items()
                if history is not None]

    def _extrapolation(self, frame: str, time: int, target: str, source: str
                       ) -> ExtrapolationException:
        """
        Create the error of a search that stopped at a frame without data for the time.

        The text consists of tf2's words and a hint. tf2's words describe the frame at which the
        search stopped. This frame may be above the path, since tf2 follows the ancestors of the
        source as far as there are data. Therefore the hint describes the path itself.
        """
        history = self.histories[frame]
        assert isinstance(history, History)
        words = texts.extrapolation(
            len(history), history.oldest, history.latest, time, target, source)
        return with_hint(
            ExtrapolationException(words), self._why_not_at(time, target, source, frame))

    def _why_not_at(self, time: int, target: str, source: str, stopped_at: str
                    ) -> Callable[[Optional[hints.Waited]], str]:
        """
        Return the hint of an ExtrapolationException.

        The hint is about the path that follows the newest parents of the frames. Of the edges on
        this path, the hint names the one whose samples are farthest from `time` (ns). If all edges
        on this path have data at `time`, the frames had other parents at that time. The hint then
        names the edge above `stopped_at`, the frame at which the search stopped. If the newest
        parents do not connect the two frames, the hint names the roots of their two trees.
        """
        from_source, from_target, meeting = self._chains_to_meeting(source, target)
        if meeting is None:
            return self._why_unconnected(target, [*from_target][-1], source, [*from_source][-1])
        worst, widest = stopped_at, 0
        for chain in from_source, from_target:
            for frame in chain:
                if frame == meeting:
                    break
                gap = self.histories[frame].distance_to(time)  # type: ignore[union-attr]
                if gap > widest:
                    worst, widest = frame, gap
        history = self.histories[worst]
        assert isinstance(history, History)
        if not len(history):
            return partial(hints.cleared, self.look, worst)
        return partial(hints.extrapolation, self.look, hints.Edge(
            history.parent_at(0) or '', worst, len(history), history.oldest, history.latest,
            self.cache_time, history.start > 0, history.authority,
            monotonic_ns() - history.arrival, history.repeated, history.refused,
            history.refused_stamp, history.refused_authority,
            history.refused > 0 and history.refusal == history.arrival, self.takes_ns), time)

    def _chains_to_meeting(self, source: str, target: str, time: int = _END
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

    def _why_unconnected(self, target: str, target_root: str, source: str, source_root: str
                         ) -> Callable[[Optional[hints.Waited]], str]:
        """Return the hint for two frames that have different roots."""
        for root in source_root, target_root:
            if (history := self.histories[root]) is not None and not len(history):
                return partial(hints.cleared, self.look, root)
        return partial(hints.unconnected, self.look, target, target_root, source, source_root,
                       self.advice,
                       partial(_slip, ref(self), self.names, target_root, source_root),
                       partial(_children, ref(self)))

    def _unconnected(self, target: str, source: str, time: int = _END) -> ConnectivityException:
        from_source, from_target, _ = self._chains_to_meeting(source, target, time)
        return with_hint(
            ConnectivityException(texts.unconnected(target, source)),
            self._why_unconnected(target, [*from_target][-1], source, [*from_source][-1]))


def _slip(tree_ref: ref[FrameTree], names: tuple[str, ...], *roots: str) -> str:
    """
    Name a root and a frame of the other tree that are probably meant to be one frame.

    The lock is not needed: frames are never removed.
    """
    tree = tree_ref()
    if tree is not None:
        for root, other in roots, roots[::-1]:
            for name in names[:_MAX_SLIPS]:
                if texts.is_slip(root, name) and other in tree._all_ancestors(name):
                    return hints.slip(name, root)
    return ''


def _children(tree_ref: ref[FrameTree]) -> set[str]:
    """Return the frames that have had a parent; the lock is not needed."""
    tree = tree_ref()
    return set() if tree is None else {
        name for name in tree.names if tree.histories[name] is not None}


def _union(stamps: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.int64]:
    """Merge two sorted arrays of stamps, and drop duplicates."""
    both = np.concatenate((stamps, others))
    both.sort(kind='stable')  # this merges two sorted parts, many times as fast as np.union1d
    is_new = np.ones(len(both), np.bool_)
    np.not_equal(both[1:], both[:-1], out=is_new[1:])
    return both[is_new]
