"""What a buffer knows of every frame, and tf2's texts of it."""

from collections.abc import Iterable
import re
from typing import NamedTuple, Optional

from dummy_arm.tf._core.times import display, in_seconds

#: The span of time (ns) that tf2 takes at least for its rate.
_SHORTEST = 100_000
#: What YAML reads as the text that it is, without quotes.
_PLAIN = re.compile(r'(?!(?i:true|false|yes|no|on|off|null|y|n)$)[A-Za-z_][\w/.-]*', re.ASCII)


class Frame(NamedTuple):
    """A frame that has a parent."""

    name: str
    parent: str
    authority: str  #: who has sent its newest transform
    is_static: bool
    length: int  #: how many transforms are kept; 1 of a static one
    latest: int  #: the newest stamp (ns); 0 of a static one
    oldest: int  #: the oldest stamp (ns); 0 of a static one

    @property
    def rate(self) -> float:
        """The average rate (Hz) as tf2 computes it: 10000 for a single transform."""
        return self.length * 1e9 / max(self.latest - self.oldest, _SHORTEST)

    @property
    def buffer_length(self) -> float:
        """The time from the oldest to the newest transform (s)."""
        return in_seconds(self.latest - self.oldest)


def as_string(edges: Iterable[tuple[str, Optional[str]]]) -> str:
    """Write tf2's list of frames and their parents, a line each."""
    return ''.join(f'Frame {name} exists with parent {parent or "NO_PARENT"}.\n'
                   for name, parent in edges)


def as_yaml(frames: Iterable[Frame]) -> str:
    """Write tf2's YAML of all frames; a name that YAML would not read as it is, is quoted."""
    return ''.join(
        f'{_key(frame.name)}: \n'
        f'  parent: {_value(frame.parent)}\n'
        f'  broadcaster: {_value(frame.authority)}\n'
        f'  rate: {frame.rate:.3f}\n'
        f'  most_recent_transform: {display(frame.latest)}\n'
        f'  oldest_transform: {display(frame.oldest)}\n'
        f'  buffer_length: {frame.buffer_length:.3f}\n'
        for frame in frames)


def _key(name: str) -> str:
    return name if _PLAIN.fullmatch(name) else _double_quoted(name)


def _value(text: str) -> str:
    return f"'{text}'" if text.isprintable() and "'" not in text else _double_quoted(text)


def _double_quoted(text: str) -> str:
    plain = (c if c.isprintable() and c not in '"\\' else f'\\U{ord(c):08x}' for c in text)
    return f'"{"".join(plain)}"'


def as_dot(frames: Iterable[Frame], names: Iterable[str], now: int = 0) -> str:
    """
    Write tf2's graph of all frames in the DOT language, names quoted.

    :param names: all frames, also those without parent.
    :param now: the time (ns) from which ages count; 0: no ages.
    """
    edges = list(frames)
    lines = ['digraph G {']
    for frame in edges:
        age = f'( {in_seconds(now - frame.latest):.3f} sec old)' if now else ''
        lines.append(
            f'{dot_quoted(frame.parent)} -> {dot_quoted(frame.name)}[label="'
            f'Broadcaster: {_escaped(frame.authority)}\\nAverage rate: {frame.rate:.3f} Hz\\n'
            f'Most recent transform: {display(frame.latest)} {age}\\n'
            f'Buffer length: {frame.buffer_length:.3f} sec\\n"];')
    children = {frame.name for frame in edges}
    roots = [name for name in names if name not in children]
    if not roots and not edges:
        lines.append('"no tf data received"')
    lines += [f'{dot_quoted(root)};' for root in roots]
    return '\n'.join([*lines, '}'])


def dot_quoted(name: str) -> str:
    """Write a name as DOT quotes it."""
    return f'"{_escaped(name)}"'


def _escaped(text: str) -> str:
    return text.replace('\\', '\\\\').replace('"', '\\"').replace('\n', '\\n')
