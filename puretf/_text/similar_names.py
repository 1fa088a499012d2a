"""Names that are similar to a name: "did you mean", and names that one letter sets apart."""

from collections.abc import Callable, Iterable
from difflib import get_close_matches, SequenceMatcher
from functools import lru_cache
from itertools import islice
import re
from typing import NamedTuple

from puretf._text.names import comma_list, LONGEST, quoted

#: The largest number of names that an error lists.
_MAX_SHOWN = 5
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
    return f'Known {what}: {comma_list(known, _MAX_SHOWN, quoted)}.'


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
            candidates.setdefault(_spelling(each).plain or each, []).append(each)
    near = get_close_matches(
        _spelling(name).plain or name, [*candidates], _MAX_SHOWN, cutoff)
    return [each for plain in near for each in candidates[plain]
            if SequenceMatcher(None, *_what_differs(name, each)).ratio() >= cutoff][:_MAX_SHOWN]


def _what_differs(name: str, other: str) -> tuple[str, str]:
    """Return two names without the namespace and the suffix that both have."""
    ends = [re.fullmatch(r'(.*/)?(.*?)(_link|_frame)?', each.lower(), re.DOTALL)
            for each in (name, other)]
    (space, a, end), (other_space, b, other_end) = (each.groups('') for each in ends if each)
    if space != other_space:
        a, b = space + a, other_space + b
    return (a, b) if end == other_end else (a + end, b + other_end)


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
    a, b = _spelling(name), _spelling(other)
    if name == other or a.numbers != b.numbers or not a.plain:
        return False
    if a.plain == b.plain:
        return True
    if abs(len(a.plain) - len(b.plain)) > 1 or len(a.words) != len(b.words):
        return False
    different = [i for i, (x, y) in enumerate(zip(a.words, b.words)) if x != y]
    return (len(different) == 1 and different[0] >= a.namespace
            and _differ_by_a_letter(a.words[different[0]], b.words[different[0]]))


class _Spelling(NamedTuple):
    words: list[str]  #: in lower case, without blanks and signs
    namespace: int  #: how many of the words are before the last slash
    plain: str  #: all words
    numbers: list[str]


@lru_cache(maxsize=8192)
def _spelling(name: str) -> _Spelling:
    words, rest = _words(name), _words(name.rpartition('/')[2])
    return _Spelling(words, len(words) - len(rest), ''.join(words), re.findall(r'\d+', name))


def _words(name: str) -> list[str]:
    # The letter at the end of mapA is a word.
    return re.findall(r'[^\W_+]+|\+', re.sub(r'(?<=[a-z])(?=[A-Z]\b)', ' ', name).lower())


def _differ_by_a_letter(a: str, b: str) -> bool:
    """Return whether one letter is another or missing, or two neighbours have changed places."""
    if max(len(a), len(b)) < _SHORTEST_WORD:
        return False
    same = next((i for i, (x, y) in enumerate(zip(a, b)) if x != y), min(len(a), len(b)))
    a, b = a[same:], b[same:]
    return (a[1:] == b[1:] or a[1:] == b or a == b[1:]
            or (a[:2] == b[1::-1] and a[2:] == b[2:]))


def difference(name: str, other: str) -> str:
    """
    Say by what two names differ for which `is_slip` is True.

    >>> difference('base_link ', 'base_link'), difference('base_lnk', 'base_link')
    ('a blank at the end', 'a letter')
    """
    for what, plain in _DIFFERENCES.items():
        if plain(name) == plain(other):
            return what
    return 'a letter'


#: What is the only difference of two names that a function makes equal.
_DIFFERENCES: dict[str, Callable[[str], str]] = {
    'a blank at the end': str.rstrip,
    'a blank at the beginning': str.lstrip,
    'blanks at the ends': str.strip,
    'case': str.lower,
    'a slash at the beginning': lambda name: name.removeprefix('/'),
    'a character that cannot be seen': lambda name: ''.join(filter(str.isprintable, name)),
    "'-' and '_'": lambda name: name.replace('-', '_'),
    'case, blanks or signs': lambda name: _spelling(name).plain}


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
    """
    Return whether one topic is in the namespace of the other, or one namespace is misspelt.

    >>> may_be_one_robot('/robot1/tf', '/tf'), may_be_one_robot('/robot1/tf', '/robot2/tf')
    (True, False)
    """
    a, b = (f'{each.rpartition("/")[0]}/' for each in (topic, other))
    return a.startswith(b) or b.startswith(a) or _spelling(a).plain == _spelling(b).plain
