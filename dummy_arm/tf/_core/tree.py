"""The tree of frames: who is whose parent at a time; the paths through it, as tf2 finds them."""

from collections.abc import Callable, Iterator
from typing import Any, Optional

from dummy_arm.tf._core import texts
from dummy_arm.tf._core.frames import as_string
from dummy_arm.tf._core.history import AnyHistory, History, State, StaticHistory
from dummy_arm.tf._core.path import Path
from dummy_arm.tf._core.pose import Pose
from dummy_arm.tf.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)

#: More edges in a row tf2 takes for a loop.
MAX_GRAPH_DEPTH = 1000
_UNKNOWN = 'frame does not exist'


class FrameTree:
    """
    Every frame that was ever named, in the order of the naming, and what is known of it.

    `histories` has None for a frame that was named as a parent only. Where tf2 has an answer for
    a path, an error or a text, it is the same here.
    """

    def __init__(self, cache_time: int) -> None:
        """
        Begin without frames.

        :param cache_time: how long a history lasts (ns).
        """
        self.cache_time = cache_time
        self.histories: dict[str, Optional[AnyHistory]] = {}
        self._names: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """
        All frames, in the order of their naming.

        The tuple is renewed when a frame was added (a name is never removed), so an error can keep
        it and be read by any thread, without the lock and without the tree.
        """
        if len(self._names) != len(self.histories):
            self._names = tuple(self.histories)
        return self._names

    def insert(self, stamp: int, parent: str, child: str, pose: Pose, authority: str,
               is_static: bool) -> bool:
        """
        Insert the pose of a child in its parent.

        :param stamp: ns.
        :returns: False when it is too old, and was left out.
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

    def has_edge(self, parent: str, child: str, is_static: bool) -> bool:
        """Return whether a frame has had a parent, so that one more sample changes no path."""
        history = self.histories.get(child)
        return (history is not None and history.is_static is is_static
                and parent in history.all_parents)

    def clear(self) -> None:
        """Forget what moves; the frames and what is static stay."""
        for name, history in self.histories.items():
            if isinstance(history, History):
                self.histories[name] = History(self.cache_time)

    def check(self, name: str, where: str) -> None:
        """
        Check that a frame exists.

        :param where: which argument of what it is, in tf2's words.
        :raises InvalidArgumentException: when it is empty or begins with a slash.
        :raises LookupException: when it does not exist.
        """
        problem = self._problem(name)
        if problem == _UNKNOWN:
            raise LookupException.with_hint(
                f'"{name}" passed to {where} does not exist. ', self._nearest(name))
        if problem:
            raise InvalidArgumentException(
                f'Invalid argument "{name}" passed to {where} - {problem}')

    def check_for_lookup(self, **frames: str) -> None:
        """Check the frames of a lookup, each under the name of its argument, as `check` does."""
        for argument, name in frames.items():
            self.check(name, f'lookupTransform argument {argument}')

    def check_for_can_transform(self, **frames: str) -> None:
        """
        Check frames as `check_for_lookup` does, with what tf2's can_transform says.

        :raises TransformException: when one does not exist.
        """
        for argument, name in frames.items():
            if problem := self._problem(name):
                words = (f'Invalid frame ID "{name}" passed to canTransform argument {argument} - '
                         f'{problem}')
                if problem != _UNKNOWN:
                    raise TransformException(words)
                raise TransformException.with_hint(f'{words}. ', self._nearest(name))

    def _nearest(self, name: str) -> Callable[[], str]:
        """Return a function that finds the nearest of the names that are known now."""
        names = self.names
        return lambda: texts.suggest_names(name, names)

    def _problem(self, name: str) -> Optional[str]:
        if not isinstance(name, str):
            raise TypeError(f'a frame must be a str, got {name!r} of type {type(name).__name__}')
        if not name:
            return 'in tf2 frame_ids cannot be empty'
        if name.startswith('/'):
            return "in tf2 frame_ids cannot start with a '/'"
        return None if name in self.histories else _UNKNOWN

    def path(self, target: str, source: str, time: int) -> Path:
        """
        Find the path from a source to a target, two frames that exist, at a time (ns; 0: newest).

        :raises ConnectivityException: when they are in two trees.
        :raises ExtrapolationException: when an edge has no pose for the time.
        :raises LookupException: when there is a loop, or a path of more than 1000 edges.
        """
        from_source, from_target = self._walk(target, source, time)
        return Path(self._edges(from_source), self._edges(from_target))

    def chain(self, target: str, source: str, time: int) -> list[str]:
        """List the frames from a source to a target; else as `path`."""
        from_source, from_target = self._walk(target, source, time)
        if from_target:
            return [*from_source, *self._parents(from_target[-1:], time), *reversed(from_target)]
        return [source, *self._parents(from_source, time)]

    def _parents(self, frames: list[str], time: int) -> list[str]:
        return [str(edge.parent_at(time)) for edge in self._edges(frames)]

    def _edges(self, frames: list[str]) -> list[AnyHistory]:
        return [history for frame in frames if (history := self.histories[frame]) is not None]

    def _walk(self, target: str, source: str, time: int) -> tuple[list[str], list[str]]:
        """
        List the frames above which the path's edges are: from the source, and from the target.

        First the source's ancestors are followed as far as there is data, then the target's until
        they meet those, as in tf2: so of several errors it is tf2's that is raised.
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
            raise self._unconnected(target, source)
        while from_source and from_target and from_source[-1] == from_target[-1]:
            from_source.pop()
            from_target.pop()
        return from_source, from_target

    def latest_common_time(self, target: str, source: str) -> int:
        """
        Find the newest time (ns) of which every moving edge of the newest path knows.

        :returns: 0 when nothing moves on it.
        :raises ConnectivityException: when they are in two trees.
        :raises LookupException: when there is a loop, or a path of more than 1000 edges.
        """
        if source == target:
            history = self.histories[source]
            return history.latest if history else 0
        from_source: list[str] = []
        met: dict[str, int] = {}
        for child, parent in self._ancestors(source):
            self._append(from_source, child)
            if parent == target:
                return Path(self._edges(from_source), []).latest_common_time()
            met[parent] = len(from_source)
        from_target: list[str] = []
        for child, parent in self._ancestors(target):
            self._append(from_target, child)
            if parent == source:
                return Path([], self._edges(from_target)).latest_common_time()
            if parent in met:
                path = Path(self._edges(from_source[:met[parent]]), self._edges(from_target))
                return path.latest_common_time()
        raise self._unconnected(target, source)

    def _ancestors(self, frame: str) -> Iterator[tuple[str, str]]:
        """Follow the newest parents of a frame: (child, parent), …; for ever in a loop."""
        while (history := self.histories[frame]) and (parent := history.parent_at(0)):
            yield frame, parent
            frame = parent

    def root(self, frame: str) -> str:
        """Find the frame without parent above a frame; in a loop, any of its frames."""
        seen = {frame}
        for _, parent in self._ancestors(frame):
            frame = parent
            if frame in seen:
                break
            seen.add(frame)
        return frame

    def has_no_loop_above(self, frame: str) -> bool:
        """Tell whether all ancestors that a frame has at any time are without loop, and few."""
        ancestors = {frame}
        for _ in range(MAX_GRAPH_DEPTH + 1):
            ancestors = {
                parent for name in ancestors if (history := self.histories[name]) is not None
                for parent in history.all_parents}
            if not ancestors:
                return True
        return False

    def _append(self, chain: list[str], frame: str) -> None:
        chain.append(frame)
        if len(chain) > MAX_GRAPH_DEPTH:
            edges = self.newest_edges()  # the text is written without the lock
            raise LookupException.with_hint(
                'The tf tree is invalid because it contains a loop.\n',
                lambda: f'{as_string(edges)}\n{texts.loop(chain)}')

    def states(self, until: int = 0) -> list[tuple[str, State]]:
        """
        List what is known of the frames that have a parent, in the order of their naming.

        :param until: a time (ns): no newer than then; 0: of all.
        """
        return [(name, state) for name, history in self.histories.items()
                if history is not None and (state := history.state(until)) is not None]

    def parents(self, until: int = 0) -> Iterator[tuple[str, str, AnyHistory]]:
        """
        Give every frame that has a parent, the newest one, and the frame's history.

        :param until: a time (ns): no newer than then; 0: of all.
        """
        for name, history in self.histories.items():
            if history is not None and (state := history.state(until)) is not None:
                yield name, state[0], history

    def dump(self) -> dict[str, dict[str, Any]]:
        """Return everything that is known; see `BufferCore.dump`."""
        return {name: (history or History(0)).dump() for name, history in self.histories.items()}

    def newest_edges(self) -> list[tuple[str, Optional[str]]]:
        """List the frames that had a parent, and their newest parents; None: since cleared."""
        return [(name, history.parent_at(0)) for name, history in self.histories.items()
                if history is not None]

    def _extrapolation(self, frame: str, time: int, target: str, source: str
                       ) -> ExtrapolationException:
        """
        Return the error of a walk that stopped at a frame.

        tf2's words are about that frame, which may be off the path: tf2 follows the ancestors of
        the source as far as there is data, and then those of the target. The hint is about the
        path.
        """
        history = self.histories[frame]
        assert isinstance(history, History)
        words = texts.no_pose(len(history), history.oldest, history.latest, time)
        return ExtrapolationException(
            f'{words}, when looking up transform from frame [{source}] to frame [{target}].'
            + self._why_not_at(time, target, source, frame))

    def _why_not_at(self, time: int, target: str, source: str, stopped_at: str) -> str:
        """
        Return the hint of an ExtrapolationException.

        It names the edge between the two frames, by their newest parents, that is farthest from
        covering the time (ns); where all of these cover it, the frames had other parents then,
        and it names the edge above the frame at which the walk stopped.
        """
        from_source, from_target, meeting = self._ways_up(source, target)
        if meeting is None:
            return self._why_unconnected(target, [*from_target][-1], source, [*from_source][-1])
        worst, widest = stopped_at, 0
        for way in from_source, from_target:
            for frame in way:
                if frame == meeting:
                    break
                gap = self.histories[frame].distance_to(time)  # type: ignore[union-attr]
                if gap > widest:
                    worst, widest = frame, gap
        history = self.histories[worst]
        assert isinstance(history, History)
        if not len(history):
            return texts.cleared(worst)
        return texts.extrapolation(
            worst, history.parent_at(0) or '', history.oldest, history.latest, time)

    def _ways_up(self, source: str, target: str
                 ) -> tuple[dict[str, None], dict[str, None], Optional[str]]:
        """
        Follow the newest parents of two frames, in turn, until they meet.

        :returns: the frames on both ways, each from its first frame on; and that in which they
            meet, or None.
        """
        ways: tuple[dict[str, None], dict[str, None]] = {source: None}, {target: None}
        ends: list[Optional[str]] = [source, target]
        turn = 0
        while ends[0] or ends[1]:
            if end := ends[turn]:
                history = self.histories[end]
                parent = None if history is None else history.parent_at(0)
                if parent in ways[turn]:  # a loop
                    parent = None
                if parent:
                    ways[turn][parent] = None
                    if parent in ways[1 - turn]:
                        return *ways, parent
                ends[turn] = parent
            turn = 1 - turn
        return *ways, None

    def _why_unconnected(self, target: str, target_root: str, source: str, source_root: str
                         ) -> str:
        """Return the hint for two frames whose newest ancestors end in two frames."""
        for root in source_root, target_root:
            if (history := self.histories[root]) is not None and not len(history):
                return texts.cleared(root)
        return texts.roots(target, target_root, source, source_root)

    def _unconnected(self, target: str, source: str) -> ConnectivityException:
        return ConnectivityException(
            f"Could not find a connection between '{target}' and '{source}' because they are not "
            'part of the same tree.Tf has two or more unconnected trees.'
            + texts.roots(target, self.root(target), source, self.root(source)))
