"""What an error says after tf2's own words: what is there instead, and by how much it is off."""

from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import lru_cache

from dummy_arm.tf.history import History
from dummy_arm.tf.times import SECOND

_SHOWN = 5


@lru_cache(maxsize=8)  # a program that waits asks again and again
def nearest(name: str, known: tuple[str, ...], what: str = 'frames') -> str:
    """Name those whose names are nearest to one that does not exist, or some others."""
    if not known:
        return 'No transform has been received yet.'
    close = get_close_matches(name, known, _SHOWN)
    if close:
        return f'Nearest known: {_listed(close)}.'
    return f'Known {what}: {some(known, _SHOWN, repr)}.'


def some(texts: Sequence[str], shown: int, write: Callable[[str], str] = str) -> str:
    """List the first of some texts, and tell how many more there are."""
    more = f' and {len(texts) - shown} more' if len(texts) > shown else ''
    return f'{", ".join(map(write, texts[:shown]))}{more}'


def _listed(names: Sequence[str]) -> str:
    return ', '.join(map(repr, names))


def roots(target: str, target_root: str, source: str, source_root: str) -> str:
    """Name the roots of two trees."""
    return (f' {target!r} is in the tree of root {target_root!r}, '
            f'{source!r} in that of root {source_root!r}.')


def extrapolation(frame: str, history: History, time: int) -> str:
    """Name the edge above a frame that does not cover a time (ns), and by how much."""
    if not len(history):
        return cleared(frame)
    edge = f'{history.parent_at(0)!r} -> {frame!r}'
    if time > history.latest:
        return f' The edge {edge} ends {seconds(time - history.latest)} before that time.'
    return f' The edge {edge} begins {seconds(history.oldest - time)} after that time.'


def cleared(frame: str) -> str:
    """Name a frame whose history was cleared, so that its parent is not known."""
    return f' Nothing is known of {frame!r} since the buffer was cleared.'


def loop(chain: Sequence[str]) -> str:
    """Name the loop in which a chain of frames ends, each the parent of the one before."""
    last = chain[-1]
    before = [i for i, frame in enumerate(chain[:-1]) if frame == last]
    if not before:
        return f'There is none, but more than {len(chain) - 1} edges in a row.'
    return f'The loop: {" -> ".join(map(repr, reversed(chain[before[-1]:])))}.'


def seconds(duration: int) -> str:
    """Write a duration (ns >= 0) in s, exactly."""
    return f'{duration // SECOND}.{duration % SECOND:09d} s'
