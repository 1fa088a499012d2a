"""The errors of lookups: tf2's words, and what follows them when the text is read."""

from functools import partial
from itertools import takewhile
from time import monotonic_ns
from typing import TypeVar
from weakref import ref

from puretf import exceptions
from puretf._causes.explanation import explain
from puretf._causes.facts import Edge, Facts, Frames, Look, NO_EDGE, RECENT, Symptom, Waited
from puretf._core import texts
from puretf._core.frames import as_string
from puretf._core.tree import END, FrameTree
from puretf._text.names import quoted, see

_Error = TypeVar('_Error', bound=exceptions.TransformException)


def check(tree: FrameTree, name: str, where: str) -> None:
    """Raise tf2's error if a frame does not exist; its text names the caller, `where`."""
    problem = tree.problem(name)
    if problem == texts.UNKNOWN_FRAME:
        raise _explained(exceptions.LookupException(
            f'"{name}" passed to {where} does not exist. '), tree, 'missing', (name,))
    if problem:
        raise exceptions.InvalidArgumentException(
            f'Invalid argument "{name}" passed to {where} - {problem}')


def check_for_lookup(tree: FrameTree, **frames: str) -> None:
    """Check frames; each keyword is tf2's name of the argument, such as `target_frame`."""
    for argument, name in frames.items():
        check(tree, name, f'lookupTransform argument {argument}')


def check_for_can_transform(tree: FrameTree, **frames: str) -> None:
    """Check frames as `check_for_lookup` does, with the errors of tf2's canTransform."""
    for argument, name in frames.items():
        if problem := tree.problem(name):
            words = (f'Invalid frame ID "{name}" passed to canTransform argument {argument} - '
                     f'{problem}')
            if problem != texts.UNKNOWN_FRAME:
                raise exceptions.TransformException(words)
            raise _explained(exceptions.TransformException(f'{words}. '), tree, 'missing', (name,))


def extrapolation(tree: FrameTree, frame: str, time: int, target: str, source: str
                  ) -> exceptions.ExtrapolationException:
    """
    Create the error of a search that stopped at a frame without data for the time.

    tf2's words describe the frame at which the search stopped. This frame may be above the path,
    since tf2 follows the ancestors of the source as far as there are data.

    What follows these words is about the path that follows the newest parents of the frames. Of
    its edges, it names one whose stamp does not advance, or the one whose samples are farthest
    from `time` (ns); if `time` is the newest stamp of an edge that does not arrive any more, this
    edge. If all edges have data at `time`, the frames had other parents at that time. Then it
    names the edge above `frame`. If the newest parents do not connect the two frames, it names the
    roots of their two trees.
    """
    child, worst, widest, shorter = frame, tree.histories[frame], 0, ''
    now = monotonic_ns()
    assert worst is not None
    error = exceptions.ExtrapolationException(texts.extrapolation(
        len(worst), worst.oldest, worst.latest, time, target, source))
    edges = tree.dynamic_edges(source, target)
    if edges is None:
        return _explained_by_roots(error, tree, target, source)
    for each, history in edges:
        # In the second case, the latest time of all edges is the stamp of this one.
        gap = END if history.is_frozen or (
            tree.needs_listener and history.latest == time
            and now - history.advance > RECENT) else history.distance_to(time)
        if history.latest == time:
            shorter = each
        if gap > widest:
            child, worst, widest = each, history, gap
    if not len(worst):
        return _explained(error, tree, 'cleared', (child,))
    return _explained(
        error, tree, 'past' if time < worst.oldest else 'future', (target, source), (), time, Edge(
            worst.parent_at(0) or '', child, len(worst), worst.oldest, worst.latest,
            tree.cache_time, worst.start > 0, worst.is_full, shorter, worst.is_frozen,
            worst.authority, now - worst.arrival, worst.arrival - worst.advance, worst.offsets,
            worst.refused, worst.refused_stamp, worst.refused_authority, worst.is_refusing))


def unconnected(tree: FrameTree, target: str, source: str, time: int = END
                ) -> exceptions.ConnectivityException:
    return _explained_by_roots(exceptions.ConnectivityException(
        f"Could not find a connection between '{target}' and '{source}' because they are not part "
        'of the same tree.Tf has two or more unconnected trees.'), tree, target, source, time)


def _explained_by_roots(error: _Error, tree: FrameTree, target: str, source: str, time: int = END
                        ) -> _Error:
    """Let an error say that two frames have different roots at a time (ns)."""
    roots = [*tree.chain(target, time)][-1], [*tree.chain(source, time)][-1]
    for root in roots[::-1]:
        if (history := tree.histories[root]) is not None and not len(history):
            return _explained(error, tree, 'cleared', (root,))
    return _explained(error, tree, 'unconnected', (target, source), roots)


def _explained(error: _Error, tree: FrameTree, symptom: Symptom, names: tuple[str, ...],
               roots: tuple[str, ...] = (), time: int = 0, edge: Edge = NO_EDGE) -> _Error:
    """Copy what is known now; the rest is asked when the text is read, without the lock."""
    # A closure would cost more, since its cells are objects for the garbage collector.
    return exceptions.with_explanation(error, partial(
        _explain, ref(tree), tree.look, () if edge.child else tuple(tree.histories), symptom,
        names, roots, time, edge))


def _explain(tree_ref: ref[FrameTree], look: Look, known: tuple[str, ...], symptom: Symptom,
             names: tuple[str, ...], roots: tuple[str, ...], time: int, edge: Edge,
             error: exceptions.TransformException) -> tuple[str, tuple[str, ...]]:
    tree = tree_ref()
    return explain(Facts(symptom, look(), Frames(known) if tree is None else tree.facts(known),
                         names, roots, time, edge, error._waited or Waited(), error._is_duration))


def too_long(tree: FrameTree, chain: list[str]) -> exceptions.LookupException:
    """Return the error for a chain of ancestors that has too many edges, or is a loop."""
    # Copy the edges now, since the text of the error is written later, without the lock.
    edges = tree.newest_edges()
    words = 'The tf tree is invalid because it contains a loop.\n'
    return exceptions.with_explanation(exceptions.LookupException(words), lambda _: (
        f'{as_string(edges)}\n{_loop(chain)}', ('loop',)))


def _loop(chain: list[str]) -> str:
    """Name the frames of the loop at the upper end of a chain, or say that the chain is long."""
    last, *below = reversed(chain)
    loop = [*takewhile(last.__ne__, below)]
    if len(loop) == len(below):
        return f'There is no loop, but a chain of more than {len(below)} edges.'
    return (f'The loop: {" -> ".join(map(quoted, (last, *loop, last)))}. Remove one of these '
            f'transforms.{see("other")}')
