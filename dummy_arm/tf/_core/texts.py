"""
The words of errors and log lines: tf2's own and the hints after them, and how names are written.

Names of frames come from others, so they are escaped and cut where they are printed.
"""

from collections import deque
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import lru_cache
import logging
from math import inf
from time import monotonic

from dummy_arm.tf._core.times import display, SECOND

#: The longest name (characters) that a log line shows in full.
LONGEST = 100
#: So many names are shown at most, and match_candidates for near ones.
_SHOWN, _SEARCHED = 5, 1000


def visible(text: str) -> str:
    r"""
    Return a text with every character that is not printable as Python escapes it.

    That is control characters, which could move the cursor, and lone surrogates, which cannot be
    encoded.

    >>> print(visible('tool\x1b[2J'))
    tool\x1b[2J
    """
    return text if text.isprintable() else ''.join(
        c if c.isprintable() else repr(c)[1:-1] for c in text)


def visible_lines(text: str) -> str:
    """Return a text of several lines, each as `visible` returns it."""
    return '\n'.join(map(visible, text.split('\n')))


def abbreviated(text: str, longest: int = LONGEST) -> str:
    """
    Return a text of at most some characters, with the middle replaced by three dots.

    :param longest: the number of characters, at least 3.

    >>> abbreviated('left_front_wheel', 11)
    'left...heel'
    """
    if len(text) <= longest:
        return text
    kept = longest - 3
    return f'{text[:kept - kept // 2]}...{text[len(text) - kept // 2:]}'


def shortened(name: str) -> str:
    """Return a name as a line with several of them shows it: visible, and abbreviated."""
    return visible(abbreviated(name))


def logged(name: str) -> str:
    """
    Return a name as log lines show it: visible, and a long one abbreviated, with its length.

    >>> logged('arm')
    'arm'
    >>> logged('x' * 3000) == 'x' * 49 + '...' + 'x' * 48 + ' (3000 characters)'
    True
    """
    return shortened(name) + (f' ({len(name)} characters)' if len(name) > LONGEST else '')


@lru_cache(maxsize=8)  # a program that waits asks again and again
def suggest_names(name: str, known: tuple[str, ...], what: str = 'frames') -> str:
    """Name those whose names are nearest to one that does not exist, or some others."""
    if not known:
        return 'No transform has been received yet.'
    close = []
    if len(name) <= LONGEST:
        close = get_close_matches(name, match_candidates(known), _SHOWN)
    if close:
        return f'Nearest known: {_listed(close)}.'
    return f'Known {what}: {comma_list(known, _SHOWN, quoted)}.'


def match_candidates(known: Sequence[str]) -> list[str]:
    """Return those of many names that are compared with one: more of them would take seconds."""
    return [name for name in known[:_SEARCHED] if len(name) <= LONGEST]


def quoted(name: str) -> str:
    """Return a name in quotes, a long one abbreviated."""
    return repr(abbreviated(name))


def comma_list(texts: Sequence[str], shown: int, write: Callable[[str], str] = str) -> str:
    """List the first of some texts, and tell how many more there are."""
    more = f' and {len(texts) - shown} more' if len(texts) > shown else ''
    return f'{", ".join(map(write, texts[:shown]))}{more}'


def _listed(names: Sequence[str]) -> str:
    return ', '.join(map(quoted, names))


def roots(target: str, target_root: str, source: str, source_root: str) -> str:
    """Name the roots of two trees."""
    return (f' {quoted(target)} is in the tree of root {quoted(target_root)}, '
            f'{quoted(source)} in that of root {quoted(source_root)}.')


def no_pose(count: int, oldest: int, latest: int, time: int) -> str:
    """
    Write tf2's words for a time at which a frame has no pose.

    :param count: how many samples the frame has; 0: ''.
    :param oldest: the stamp of the first of them (ns).
    :param latest: the stamp of the last of them (ns).
    :param time: ns.
    """
    if not count:
        return ''
    if count == 1:
        return (f'Lookup would require extrapolation at time {display(time)}, but only time '
                f'{display(latest)} is in the buffer')
    if time > latest:
        return ('Lookup would require extrapolation into the future.  Requested time '
                f'{display(time)} but the latest data is at time {display(latest)}')
    return ('Lookup would require extrapolation into the past.  Requested time '
            f'{display(time)} but the earliest data is at time {display(oldest)}')


def extrapolation(frame: str, parent: str, oldest: int, latest: int, time: int) -> str:
    """
    Name the edge above a frame that does not cover a time, and by how much.

    :param parent: the newest parent of the frame.
    :param oldest: the stamp of its oldest sample (ns).
    :param latest: the stamp of its newest sample (ns).
    :param time: ns.
    """
    edge = f'{quoted(parent)} -> {quoted(frame)}'
    if time > latest:
        return f' The edge {edge} ends {seconds(time - latest)} before that time.'
    return f' The edge {edge} begins {seconds(oldest - time)} after that time.'


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


class ThrottledLog:
    """
    A log that says the same cause at most once a second.

    What is told is logged by `flush`, for which no lock must be held: a log may look up.
    """

    def __init__(self) -> None:
        """Begin with nothing said."""
        self.write: Callable[[str], None] = logging.getLogger('dummy_arm.tf').warning
        self._again: dict[str, float] = {}
        self._waiting: deque[str] = deque()

    def warn(self, *problems: str) -> None:
        """Tell problems, but not one whose cause, its first word, was told within a second."""
        for problem in problems:
            self._warn(problem.partition(' ')[0], problem, 1.0)

    def warn_once(self, cause: str, problem: str) -> None:
        """Tell a problem, but not if its cause was told before."""
        self._warn(cause, problem, inf)

    def _warn(self, cause: str, problem: str, silence: float) -> None:
        now = monotonic()
        if now >= self._again.get(cause, now):
            self._again[cause] = now + silence
            self._waiting.append(problem)

    def flush(self) -> None:
        """Log what was told."""
        while self._waiting:
            self.write(self._waiting.popleft())
