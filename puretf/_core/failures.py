"""The errors of lookups: tf2's words, and what follows them when the text is read."""

from collections.abc import Sequence
from functools import partial
from time import monotonic_ns
from typing import Optional
from weakref import ref

from puretf._causes.explanation import explain
from puretf._causes.facts import (
    CLEARED,
    Edge,
    Facts,
    Frames,
    FUTURE,
    Look,
    MISSING,
    ONE_TIME,
    PAST,
    RECENT,
    UNCONNECTED,
)
from puretf._core import texts
from puretf._core.frames import as_string
from puretf._core.history import History
from puretf._core.tree import END, FrameTree
from puretf._text.names import quoted, see
from puretf._text.times import is_frozen
from puretf.exceptions import (
    ConnectivityException,
    Explanation,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
    with_explanation,
)


def check(tree: FrameTree, name: str, where: str) -> None:
    """Raise tf2's error if a frame does not exist; its text names the caller, `where`."""
    problem = tree.problem(name)
    if problem == texts.UNKNOWN_FRAME:
        raise with_explanation(LookupException(texts.unknown_frame(name, where)),
                               _explanation(tree, MISSING, (name,)))
    if problem:
        raise InvalidArgumentException(texts.invalid_argument(name, where, problem))


def check_for_lookup(tree: FrameTree, **frames: str) -> None:
    """Check frames; each keyword is tf2's name of the argument, such as `target_frame`."""
    for argument, name in frames.items():
        check(tree, name, f'lookupTransform argument {argument}')


def check_for_can_transform(tree: FrameTree, **frames: str) -> None:
    """Check frames as `check_for_lookup` does, with the errors of tf2's canTransform."""
    for argument, name in frames.items():
        if problem := tree.problem(name):
            words = texts.invalid_frame_id(name, argument, problem)
            if problem != texts.UNKNOWN_FRAME:
                raise TransformException(words)
            raise with_explanation(TransformException(f'{words}. '),
                                   _explanation(tree, MISSING, (name,)))


def extrapolation(tree: FrameTree, frame: str, time: int, target: str, source: str
                  ) -> ExtrapolationException:
    """
    Create the error of a search that stopped at a frame without data for the time.

    tf2's words describe the frame at which the search stopped. This frame may be above the path,
    since tf2 follows the ancestors of the source as far as there are data. What follows these
    words describes the path itself.
    """
    history = tree.histories[frame]
    assert isinstance(history, History)
    words = texts.extrapolation(
        len(history), history.oldest, history.latest, time, target, source)
    return with_explanation(
        ExtrapolationException(words), _why_not_at(tree, time, target, source, frame))


def _why_not_at(tree: FrameTree, time: int, target: str, source: str, stopped_at: str
                ) -> Explanation:
    """
    Return the explanation of an ExtrapolationException.

    It is about the path that follows the newest parents of the frames. Of the edges on this path,
    it names one whose stamp does not advance, or the one whose samples are farthest from `time`
    (ns); if `time` is the newest stamp of an edge that does not arrive any more, this edge. If all
    edges on this path have data at `time`, the frames had other parents at that time. Then it
    names the edge above `stopped_at`, the frame at which the search stopped. If the newest parents
    do not connect the two frames, it names the roots of their two trees.
    """
    from_source, from_target, meeting = tree.chains_to_meeting(source, target)
    if meeting is None:
        return _why_unconnected(tree, target, [*from_target][-1], source, [*from_source][-1])
    now, worst, widest = monotonic_ns(), stopped_at, 0
    for chain in from_source, from_target:
        for frame in chain:
            if frame == meeting:
                break
            history = tree.histories[frame]
            assert history is not None
            gap = history.distance_to(time)
            if isinstance(history, History) and is_frozen(
                    history.oldest, history.latest, len(history) + history.repeated):
                gap = END  # the latest time of all edges is its stamp
            elif tree.needs_listener and isinstance(history, History) and (
                    history.latest == time and now - history.advance > RECENT):
                gap = END - 1
            if gap > widest:
                worst, widest = frame, gap
    history = tree.histories[worst]
    assert isinstance(history, History)
    if not len(history):
        return _explanation(tree, CLEARED, (worst,))
    symptom = FUTURE if time > history.latest or widest == END - 1 else (
        PAST if time < history.oldest else ONE_TIME)
    return _explanation(tree, symptom, (target, source), (), time, Edge(
        history.parent_at(0) or '', worst, len(history), history.oldest, history.latest,
        tree.cache_time, history.start > 0, history.authority,
        now - history.arrival, history.repeated, history.refused,
        history.refused_stamp, history.refused_authority, history.is_refusing,
        tree.nanosecs.get(worst, 0), history.is_full, history.arrival - history.advance,
        max(history.offsets, default=0) - min(history.offsets, default=0)))


def unconnected(tree: FrameTree, target: str, source: str, time: int = END
                ) -> ConnectivityException:
    from_source, from_target, _ = tree.chains_to_meeting(source, target, time)
    return with_explanation(
        ConnectivityException(texts.unconnected(target, source)),
        _why_unconnected(tree, target, [*from_target][-1], source, [*from_source][-1]))


def _why_unconnected(tree: FrameTree, target: str, target_root: str, source: str, source_root: str
                     ) -> Explanation:
    """Explain that two frames have different roots."""
    for root in source_root, target_root:
        if (history := tree.histories[root]) is not None and not len(history):
            return _explanation(tree, CLEARED, (root,))
    return _explanation(tree, UNCONNECTED, (target, source), (target_root, source_root))


def _explanation(tree: FrameTree, symptom: str, names: tuple[str, ...],
                 roots: tuple[str, ...] = (), time: int = 0, edge: Optional[Edge] = None
                 ) -> Explanation:
    """Copy what is known now; the rest is asked when the text is read, without the lock."""
    return partial(_explain, ref(tree), tree.look, tree.names if edge is None else (), symptom,
                   names, roots, time, edge)


def _explain(tree_ref: ref[FrameTree], look: Look, known: tuple[str, ...], symptom: str,
             names: tuple[str, ...], roots: tuple[str, ...], time: int, edge: Optional[Edge],
             error: TransformException) -> tuple[str, tuple[str, ...]]:
    tree = tree_ref()
    return explain(Facts(symptom, look(), Frames(known) if tree is None else tree.facts(known),
                         names, roots, time, edge, error._waited, error._is_duration))


def too_long(tree: FrameTree, chain: list[str]) -> LookupException:
    """Return the error for a chain of ancestors that has too many edges, or is a loop."""
    # Copy the edges now, since the text of the error is written later, without the lock.
    edges = tree.newest_edges()
    return with_explanation(LookupException(texts.LOOP), lambda _: (
        f'{as_string(edges)}\n{_loop(chain)}', ('loop',)))


def _loop(chain: Sequence[str]) -> str:
    """Name the frames of the loop at the upper end of a chain, or say that the chain is long."""
    last = chain[-1]
    earlier = [i for i, frame in enumerate(chain[:-1]) if frame == last]
    if not earlier:
        return f'There is no loop, but a chain of more than {len(chain) - 1} edges.'
    return (f'The loop: {" -> ".join(map(quoted, reversed(chain[earlier[-1]:])))}. Remove one of '
            f'these transforms.{see("Other faults")}')
