"""Arrange the frames of a buffer into trees and loops."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Optional, TypeVar

from puretf import Frame

#: A line shows the branches of at most this many levels, those nearest to the name. Otherwise, the
#: text of a chain of n frames would grow with the square of n.
_DEEPEST = 100

_Value = TypeVar('_Value')


class TreeLine(NamedTuple):
    """A line of a drawn tree: one frame."""

    branches: str  #: the box-drawing characters before the name; '' for a root
    name: str
    frame: Optional[Frame]  #: None for a root

    @property
    def level(self) -> int:
        """The number of frames above this one."""
        return len(self.branches) // 4


class Forest:
    """Frames arranged by their parents: trees, and loops."""

    def __init__(self, frames: Iterable[Frame], root: Optional[str] = None) -> None:
        """Arrange frames in trees; if `root` is given, show it even if it has no children."""
        self.frames = {frame.name: frame for frame in frames}
        self._root = root
        self._children: dict[str, list[str]] = {} if root is None else {root: []}
        for frame in self.frames.values():
            self._children.setdefault(frame.parent, []).append(frame.name)
        self.roots = [name for name in self._children if name not in self.frames]
        #: In each loop, a frame is the parent of the next one, and the last one that of the first.
        self.loops = loops({frame.name: frame.parent for frame in self.frames.values()})

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all frames, including those without a parent."""
        return *self.roots, *self.frames

    def subtree(self, root: str) -> 'Forest':
        """Return a frame and its descendants, including those that are reached through a loop."""
        below = descend(self.frames, {root: None}, lambda *_: None)
        return Forest([frame for frame in self.frames.values() if frame.parent in below], root)

    def lines(self) -> Iterator[TreeLine]:
        """Draw the trees; a loop is a tree whose root appears once more, as a leaf."""
        starts = [self._root or loop[0] for loop in self.loops]
        for root, leaf in [*((root, None) for root in self.roots), *zip(starts, starts)]:
            yield TreeLine('', root, None)
            pending = self._child_lines(root, '', 1)
            while pending:
                line, indent, level = pending.pop()
                yield line
                if line.name != leaf:
                    pending += self._child_lines(line.name, indent, level)

    def _child_lines(self, parent: str, indent: str, level: int
                     ) -> list[tuple[TreeLine, str, int]]:
        # The caller pops the first child first.
        lines = []
        children = self._children.get(parent, [])
        if level > _DEEPEST:
            indent = indent[-4 * (_DEEPEST - 1):]  # 4 characters for each level
        prefix = f'{level} ... {indent}' if level > _DEEPEST else indent
        for child in children:
            branch, rest = ('└── ', '    ') if child is children[-1] else ('├── ', '│   ')
            lines.append((TreeLine(prefix + branch, child, self.frames[child]), indent + rest,
                          level + 1))
        return lines[::-1]


def loops(parents: Mapping[str, str]) -> list[list[str]]:
    """Return the loops, as `Forest.loops`, of what has parents, by name."""
    found, seen = [], set[str]()
    for name in parents:
        path: list[str] = []
        while name in parents and name not in seen:
            seen.add(name)
            path.append(name)
            name = parents[name]
        if name in path:
            found.append(path[path.index(name):][::-1])
    return found


def self_and_ancestors(name: str, frames: Mapping[str, Frame]) -> Iterator[str]:
    """Yield a frame, its parent, and so on, up to the root or until a loop is complete."""
    seen = set()
    while name not in seen:
        yield name
        seen.add(name)
        if name in frames:
            name = frames[name].parent


def descend(frames: Mapping[str, Any], known: Mapping[str, _Value],
            child_value: Callable[[str, _Value], _Value]) -> dict[str, _Value]:
    """
    Add the values of all descendants, each from its name and the value of its parent.

    :param frames: by name: a `Frame`, or another object with the name of its `parent`.
    """
    values = dict(known)
    for name in frames:
        path: dict[str, None] = {}
        while name in frames and name not in values and name not in path:
            path[name] = None
            name = frames[name].parent
        if name in values:
            for child in reversed(path):
                values[child] = child_value(child, values[frames[child].parent])
    return values
