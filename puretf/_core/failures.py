"""The errors of lookups: tf2's words, and a hint that is written when the text is read."""

from collections.abc import Callable
from functools import partial
from time import monotonic_ns
from typing import Optional
from weakref import ref

from puretf._core import hints, texts
from puretf._core.frames import as_string
from puretf._core.history import History
from puretf._core.tree import END, FrameTree
from puretf._text.similar_names import is_slip
from puretf._text.times import is_frozen
from puretf.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
    with_hint,
)

#: The largest number of names that are compared with the root of another tree.
_MAX_SLIPS = 5000


def check(tree: FrameTree, name: str, where: str) -> None:
    """Raise tf2's error if a frame does not exist; its text names the caller, `where`."""
    problem = tree.problem(name)
    if problem == texts.UNKNOWN_FRAME:
        raise with_hint(
            LookupException(texts.unknown_frame(name, where)), _unknown(tree, name))
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
            raise with_hint(TransformException(f'{words}. '), _unknown(tree, name))


def _unknown(tree: FrameTree, name: str) -> Callable[[Optional[hints.Waited]], str]:
    return partial(hints.unknown_frame, tree.look, name, tree.names,
                   partial(_children, ref(tree)), tree.advice)


def extrapolation(tree: FrameTree, frame: str, time: int, target: str, source: str
                  ) -> ExtrapolationException:
    """
    Create the error of a search that stopped at a frame without data for the time.

    The text consists of tf2's words and a hint. tf2's words describe the frame at which the
    search stopped. This frame may be above the path, since tf2 follows the ancestors of the
    source as far as there are data. Therefore the hint describes the path itself.
    """
    history = tree.histories[frame]
    assert isinstance(history, History)
    words = texts.extrapolation(
        len(history), history.oldest, history.latest, time, target, source)
    return with_hint(
        ExtrapolationException(words), _why_not_at(tree, time, target, source, frame))


def _why_not_at(tree: FrameTree, time: int, target: str, source: str, stopped_at: str
                ) -> Callable[[Optional[hints.Waited]], str]:
    """
    Return the hint of an ExtrapolationException.

    The hint is about the path that follows the newest parents of the frames. Of the edges on
    this path, the hint names one whose stamp does not advance, or the one whose samples are
    farthest from `time` (ns). If all edges on this path have data at `time`, the frames had other
    parents at that time. The hint then names the edge above `stopped_at`, the frame at which the
    search stopped. If the newest parents do not connect the two frames, the hint names the roots
    of their two trees.
    """
    from_source, from_target, meeting = tree.chains_to_meeting(source, target)
    if meeting is None:
        return _why_unconnected(tree, target, [*from_target][-1], source, [*from_source][-1])
    worst, widest = stopped_at, 0
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
            if gap > widest:
                worst, widest = frame, gap
    history = tree.histories[worst]
    assert isinstance(history, History)
    if not len(history):
        return partial(hints.cleared, tree.look, worst)
    return partial(hints.extrapolation, tree.look, hints.Edge(
        history.parent_at(0) or '', worst, len(history), history.oldest, history.latest,
        tree.cache_time, history.start > 0, history.authority,
        monotonic_ns() - history.arrival, history.repeated, history.refused,
        history.refused_stamp, history.refused_authority,
        history.is_refusing, tree.takes_ns), time)


def unconnected(tree: FrameTree, target: str, source: str, time: int = END
                ) -> ConnectivityException:
    from_source, from_target, _ = tree.chains_to_meeting(source, target, time)
    return with_hint(
        ConnectivityException(texts.unconnected(target, source)),
        _why_unconnected(tree, target, [*from_target][-1], source, [*from_source][-1]))


def _why_unconnected(tree: FrameTree, target: str, target_root: str, source: str, source_root: str
                     ) -> Callable[[Optional[hints.Waited]], str]:
    """Return the hint for two frames that have different roots."""
    for root in source_root, target_root:
        if (history := tree.histories[root]) is not None and not len(history):
            return partial(hints.cleared, tree.look, root)
    return partial(hints.unconnected, tree.look, target, target_root, source, source_root,
                   tree.advice,
                   partial(_slip, ref(tree), tree.names, target_root, source_root),
                   partial(_children, ref(tree)))


def too_long(tree: FrameTree, chain: list[str]) -> LookupException:
    """Return the error for a chain of ancestors that has too many edges, or is a loop."""
    # Copy the edges now, since the text of the error is written later, without the lock.
    edges = tree.newest_edges()
    return with_hint(LookupException(texts.LOOP),
                     lambda _: f'{as_string(edges)}\n{hints.loop(chain)}')


def _slip(tree_ref: ref[FrameTree], names: tuple[str, ...], *roots: str) -> str:
    """
    Name a root and a frame of the other tree that are probably meant to be one frame.

    The lock is not needed: a frame that has been removed has no ancestors.
    """
    tree = tree_ref()
    if tree is not None:
        for root, other in roots, roots[::-1]:
            for name in names[:_MAX_SLIPS]:
                if is_slip(root, name) and other in tree.all_ancestors(name):
                    return hints.slip(name, root)
    return ''


def _children(tree_ref: ref[FrameTree]) -> set[str]:
    """Return the frames that have had a parent; the lock is not needed."""
    tree = tree_ref()
    return set() if tree is None else {
        name for name in tree.names if tree.histories.get(name) is not None}
