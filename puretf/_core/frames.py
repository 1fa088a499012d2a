"""The state of each frame in a buffer, and functions that write states in tf2's formats."""

from collections.abc import Iterable
import re
from typing import NamedTuple, Optional

from puretf._text.names import dot_escaped, dot_quoted
from puretf._text.times import display_time, in_seconds

#: To compute a rate, tf2 divides the number of samples by the time between the oldest and the
#: newest sample. If this time is shorter than `_SHORTEST_SPAN` (ns), tf2 divides by
#: `_SHORTEST_SPAN` instead.
_SHORTEST_SPAN = 100_000
#: Matches only names that YAML reads as strings even if they are not quoted.
_PLAIN = re.compile(r'(?!(?i:true|false|yes|no|on|off|null|y|n)$)[A-Za-z_][\w/.-]*', re.ASCII)
#: A YAML key of this length (characters) or more must be an explicit one.
_LONGEST_KEY = 1024


class Frame(NamedTuple):
    """
    The state of a frame that has a parent.

    :param authority: the publisher of the transform that was inserted last
    :param is_static: True if the transform from the parent is static
    :param length: the number of samples; 1 if the frame is static
    :param latest: the newest stamp (ns); 0 if the frame is static
    :param oldest: the oldest stamp (ns); 0 if the frame is static
    :param arrived: the stamp (ns) of the transform that arrived last, even if it was older than
        the buffer keeps them; 0 if the frame is static
    :param sender: the publisher of that transform
    """

    name: str
    parent: str
    authority: str
    is_static: bool
    length: int
    latest: int
    oldest: int
    arrived: int = 0
    sender: str = ''

    @property
    def buffer_length(self) -> float:
        """The time from the oldest to the newest sample (s)."""
        return in_seconds(self.latest - self.oldest)


def _rate(frame: Frame) -> float:
    """Return the average rate of the samples (Hz), computed as in tf2; 10000 for a single one."""
    return frame.length * 1e9 / max(frame.latest - frame.oldest, _SHORTEST_SPAN)


def as_string(edges: Iterable[tuple[str, Optional[str]]]) -> str:
    r"""
    Write frames and their parents as tf2's allFramesAsString does.

    >>> as_string([('tool', 'arm')])
    'Frame tool exists with parent arm.\n'
    """
    return ''.join(f'Frame {name} exists with parent {parent or "NO_PARENT"}.\n'
                   for name, parent in edges)


def as_yaml(frames: Iterable[Frame]) -> str:
    """
    Write frames as tf2's allFramesAsYAML does.

    Unlike tf2, this function quotes or escapes a name that YAML would otherwise misread.
    """
    return ''.join(
        f'{_yaml_key(frame.name)}\n'
        f'  parent: {_yaml_value(frame.parent)}\n'
        f'  broadcaster: {_yaml_value(frame.authority)}\n'
        f'  rate: {_rate(frame):.3f}\n'
        f'  most_recent_transform: {display_time(frame.latest)}\n'
        f'  oldest_transform: {display_time(frame.oldest)}\n'
        f'  buffer_length: {frame.buffer_length:.3f}\n'
        for frame in frames)


def _yaml_key(name: str) -> str:
    r"""
    Write a name as a YAML key and a colon, in quotes if YAML might misread the unquoted name.

    A key that is too long for one line is written as an explicit key.

    >>> _yaml_key('base_link')
    'base_link: '
    >>> _yaml_key('on')  # a boolean, if it were not quoted
    '"on": '
    >>> _yaml_key('x' * 1024) == '? ' + 'x' * 1024 + '\n: '
    True
    """
    key = name if _PLAIN.fullmatch(name) else _double_quoted(name)
    return f'{key}: ' if len(key) < _LONGEST_KEY else f'? {key}\n: '


def _yaml_value(text: str) -> str:
    """
    Write a text as a YAML value: in single quotes, as in tf2, or if necessary in double quotes.

    >>> print(_yaml_value('base_link'))
    'base_link'
    >>> print(_yaml_value("arm's base"))
    "arm's base"
    """
    return f"'{text}'" if text.isprintable() and "'" not in text else _double_quoted(text)


def _double_quoted(text: str) -> str:
    r"""
    Write a text in YAML's double quotes, with escapes where they are necessary.

    >>> print(_double_quoted('a\nb'))
    "a\U0000000ab"
    """
    plain = (c if c.isprintable() and c not in '"\\' else f'\\U{ord(c):08x}' for c in text)
    return f'"{"".join(plain)}"'


def as_dot(frames: Iterable[Frame], names: Iterable[str], now: int = 0) -> str:
    """
    Write frames in the DOT language as tf2's allFramesAsDot does.

    Unlike tf2, this function escapes the quotes, backslashes and line feeds in a name.
    """
    edges = list(frames)
    lines = ['digraph G {']
    for frame in edges:
        age = f'( {in_seconds(now - frame.latest):.3f} sec old)' if now else ''
        lines.append(
            f'{dot_quoted(frame.parent)} -> {dot_quoted(frame.name)}[label="'
            f'Broadcaster: {dot_escaped(frame.authority)}\\nAverage rate: {_rate(frame):.3f} Hz\\n'
            f'Most recent transform: {display_time(frame.latest)} {age}\\n'
            f'Buffer length: {frame.buffer_length:.3f} sec\\n"];')
    children = {frame.name for frame in edges}
    roots = [name for name in names if name not in children]
    if not roots and not edges:
        lines.append('"no tf data received"')
    lines += [f'{dot_quoted(root)};' for root in roots]
    return '\n'.join([*lines, '}'])
