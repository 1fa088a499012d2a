"""How names that others have chosen are written, in logs and on a terminal."""

#: The longest name (characters) that a log line shows in full.
LONGEST = 100


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
