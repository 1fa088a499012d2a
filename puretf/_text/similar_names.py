"""Names that are similar to a name: "did you mean", and names that one letter sets apart."""

from collections.abc import Iterable
from difflib import get_close_matches
from functools import lru_cache
from itertools import islice
import re

from puretf._text.names import comma_list, LONGEST, quoted, SHOWN

#: The largest number of names that are compared with an unknown name.
_MAX_COMPARED = 1000
#: In shorter words, another letter can be on purpose: `wheel_fl` and `wheel_fr`, `top` and `tip`.
_SHORTEST_WORD = 4


@lru_cache(maxsize=8)  # A program that waits for a frame prints the same error many times.
def suggest_names(name: str, known: tuple[str, ...], what: str = 'frames') -> str:
    """
    Return a sentence with up to five known names that are similar to an unknown name.

    If no name is similar, the sentence has the first five known names; `what` is a plural noun.

    >>> suggest_names('base_lnik', ('map', 'base_link', 'base_scan'))
    "Nearest known: 'base_link', 'base_scan'."
    >>> suggest_names('tool', ('map', 'odom'))
    "Known frames: 'map', 'odom'."
    >>> suggest_names('tool', ())
    'No transform has been received yet.'
    >>> suggest_names('rate', (), 'parameters')
    'There are no parameters.'
    """
    if not known:
        return ('No transform has been received yet.' if what == 'frames' else
                f'There are no {what}.')
    if matches := near_names(name, known):
        return f'Nearest known: {", ".join(map(quoted, matches))}.'
    return f'Known {what}: {comma_list(known, quoted)}.'


def near_names(name: str, known: Iterable[str], cutoff: float = 0.6) -> list[str]:
    """
    Return the known names that are similar to a name, the nearest first, at most five.

    Case, blanks and signs do not count. Names of more than `LONGEST` characters, or after the
    first 1000, are not compared, since that would take seconds.

    :param cutoff: how similar a name must be, from 0 to 1.

    >>> near_names('BASE_LINK', ['map', 'base_scan', 'base_link'])
    ['base_link', 'base_scan']
    """
    if len(name) > LONGEST:
        return []
    candidates: dict[str, list[str]] = {}
    for each in islice(known, _MAX_COMPARED):
        if len(each) <= LONGEST:
            candidates.setdefault(_plain(each) or each, []).append(each)
    near = get_close_matches(_plain(name) or name, [*candidates], SHOWN, cutoff)
    return [each for plain in near for each in candidates[plain]][:SHOWN]


def is_slip(name: str, other: str) -> bool:
    """
    Return whether two names are so alike that one may be a mistake for the other.

    They differ in case, blanks or signs, or by one letter of a word of their last parts. The
    numbers are the same: names with other numbers are different on purpose.

    >>> is_slip('base_link', 'Base-Link '), is_slip('base_link', 'base_lnk')
    (True, True)
    >>> is_slip('wheel_1', 'wheel_2'), is_slip('robot_a/base', 'robot_b/base')
    (False, False)
    """
    a, b = _words(name), _words(other)
    different = [i for i, (x, y) in enumerate(zip(a, b)) if x != y]
    is_alike = ''.join(a) == ''.join(b) or (
        len(a) == len(b) and len(different) == 1
        and different[0] >= len(_words(name.rpartition('/')[0]))
        and _differ_by_a_letter(a[different[0]], b[different[0]]))
    return is_alike and name != other and a != [] and (
        re.findall(r'\d+', name) == re.findall(r'\d+', other))


@lru_cache(maxsize=8192)
def _words(name: str) -> list[str]:
    """Return the words of a name, in lower case, without blanks and signs."""
    # The letter at the end of mapA is a word.
    return re.findall(r'[^\W_+]+|\+', re.sub(r'(?<=[a-z])(?=[A-Z]\b)', ' ', name).lower())


def _plain(name: str) -> str:
    return ''.join(_words(name))


def _differ_by_a_letter(a: str, b: str) -> bool:
    """Return whether one letter is another or missing, or two neighbours have changed places."""
    same = next((i for i, (x, y) in enumerate(zip(a, b)) if x != y), min(len(a), len(b)))
    rest, other = a[same:], b[same:]
    return max(len(a), len(b)) >= _SHORTEST_WORD and (
        rest[1:] in (other, other[1:]) or rest == other[1:]
        or (rest[:2] == other[1::-1] and rest[2:] == other[2:]))


#: The frames of REP 105: a prefix of such a name may lack the slash.
_REP_105 = 'earth', 'map', 'odom', 'base_link', 'base_footprint'


@lru_cache(maxsize=8192)
def without_prefix(name: str) -> set[str]:
    """
    Return the names that a name is with a namespace, a suffix, or a prefix of REP 105's names.

    >>> without_prefix('robot1/tool'), without_prefix('odom_combined'), without_prefix('tool_link')
    ({'tool'}, {'odom'}, {'tool'})
    >>> without_prefix('left_wheel')
    set()
    """
    suffixes = {name.removesuffix(end) for end in ('_link', '_frame')} - {name}
    return suffixes | {name[i + 1:] for i, letter in enumerate(name) if letter == '/'} | {
        other for other in _REP_105 if name != other and (
            name.endswith(other) or name.startswith(f'{other}_'))}


def may_be_one_robot(topic: str, other: str) -> bool:
    """Return whether one topic is in the namespace of the other, or one namespace is misspelt."""
    a, b = (f'{each.rpartition("/")[0]}/' for each in (topic, other))
    return a.startswith(b) or b.startswith(a) or _plain(a) == _plain(b)
