"""The matcher of the fields Include, Exclude and Search: words in any order."""

from collections.abc import Iterable

#: Words behind this many characters of a text do not count, so that each search takes little time.
_LONGEST_TEXT = 1024


def words_of(text: str) -> list[str]:
    """Return the words of a text; a hyphen alone is no word yet."""
    return [word for word in text[:_LONGEST_TEXT].casefold().split() if word != '-']


def has_words(name: str, words: Iterable[str]) -> bool:
    """
    Return whether a name has all words, in any case, and none of those behind a hyphen.

    >>> [has_words(name, words_of('WHEEL -left')) for name in ('right_wheel', 'left_wheel')]
    [True, False]
    """
    name = name.casefold()
    return all(word[1:] not in name if word.startswith('-') else word in name for word in words)
