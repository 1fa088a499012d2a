"""What an error says after tf2's own words: what is there instead, and by how much it is off."""

from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import lru_cache

from dummy_arm.tf.history import History
from dummy_arm.tf.texts import abbreviated, LONGEST
from dummy_arm.tf.times import SECOND

#: So many names are shown at most, and searched for near ones.
_SHOWN, _SEARCHED = 5, 1000


@lru_cache(maxsize=8)  # a program that waits asks again and again
def nearest(name: str, known: tuple[str, ...], what: str = 'frames') -> str:
    """Name those whose names are nearest to one that does not exist, or some others."""
    if not known:
        return 'No transform has been received yet.'
    close = get_close_matches(name, searched(known), _SHOWN) if len(name) <= LONGEST else []
    if close:
        return f'Nearest known: {_listed(close)}.'
    return f'Known {what}: {some(known, _SHOWN, quoted)}.'


def searched(known: Sequence[str]) -> list[str]:
    """Return those of many names that are compared with one: more of them would take seconds."""
    return [name for name in known[:_SEARCHED] if len(name) <= LONGEST]


def quoted(name: str) -> str:
    """Return a name in quotes, a long one abbreviated."""
    return repr(abbreviated(name))


def some(texts: Sequence[str], shown: int, write: Callable[[str], str] = str) -> str:
    """List the first of some texts, and tell how many more there are."""
    more = f' and {len(texts) - shown} more' if len(texts) > shown else ''
    return f'{", ".join(map(write, texts[:shown]))}{more}'


def _listed(names: Sequence[str]) -> str:
    return ', '.join(map(quoted, names))


def roots(target: str, target_root: str, source: str, source_root: str) -> str:
    """Name the roots of two trees."""
    return (f' {quoted(target)} is in the tree of root {quoted(target_root)}, '
            f'{quoted(source)} in that of root {quoted(source_root)}.')


def extrapolation(frame: str, history: History, time: int) -> str:
    """Name the edge above a frame that does not cover a time (ns), and by how much."""
    if not len(history):
        return cleared(frame)
    edge = f'{quoted(history.parent_at(0) or "")} -> {quoted(frame)}'
    if time > history.latest:
        return f' The edge {edge} ends {seconds(time - history.latest)} before that time.'
    return f' The edge {edge} begins {seconds(history.oldest - time)} after that time.'


def cleared(frame: str) -> str:
    """Name a frame whose history was cleared, so that its parent is not known."""
    return f' Nothing is known of {quoted(frame)} since the buffer was cleared.'


def loop(chain: Sequence[str]) -> str:
    """Name the loop in which a chain of frames ends, each the parent of the one before."""
    last = chain[-1]
    before = [i for i, frame in enumerate(chain[:-1]) if frame == last]
    if not before:
        return f'There is none, but more than {len(chain) - 1} edges in a row.'
    return f'The loop: {" -> ".join(map(quoted, reversed(chain[before[-1]:])))}.'


def seconds(duration: int) -> str:
    """Write a duration (ns >= 0) in s, exactly."""
    return f'{duration // SECOND}.{duration % SECOND:09d} s'
