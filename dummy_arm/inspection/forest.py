"""The trees that the frames of a buffer form, and the loops."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple, Optional

from dummy_arm.tf import Frame

#: The branches of so many levels are drawn at most: else those of a chain of frames would take
#: the square of its length. Lines that are deeper begin with their level.
_DEEPEST = 100


class TreeLine(NamedTuple):
    """A line of a drawn tree."""

    branches: str  #: the lines that lead to the frame
    name: str
    frame: Optional[Frame]  #: what is known of it; None of a root


class Forest:
    """Frames, by their parents."""

    def __init__(self, frames: Iterable[Frame], root: Optional[str] = None) -> None:
        """
        Find the trees and the loops.

        :param root: the frame that all others are below, which may be the only one; None: any
            number of trees.
        """
        self.frames = {frame.name: frame for frame in frames}
        self._root = root
        self._children: dict[str, list[str]] = {} if root is None else {root: []}
        for frame in self.frames.values():
            self._children.setdefault(frame.parent, []).append(frame.name)
        #: The frames without a parent.
        self.roots = [name for name in self._children if name not in self.frames]
        #: Frames each of which is the parent of the next, and the last that of the first.
        self.loops = list(self._find_loops())

    @property
    def names(self) -> tuple[str, ...]:
        """All frames, also those without a parent."""
        return *self.roots, *self.frames

    @property
    def line_count(self) -> int:
        """The number of lines that `lines` yields."""
        return len(self.roots) + len(self.loops) + len(self.frames)

    def subtree(self, root: str) -> 'Forest':
        """
        Return the tree of a frame and all frames below it.

        Where the frame is in a loop, that is the loop with all that is below it.
        """
        found, waiting = {}, [root]
        while waiting:
            for name in self._children.get(waiting.pop(), []):
                if name not in found:
                    found[name] = self.frames[name]
                    waiting.append(name)
        return Forest(found.values(), root)

    def _find_loops(self) -> Iterator[list[str]]:
        seen = set(self.roots)
        for start in self.frames:
            way: dict[str, None] = {}
            name = start
            while name not in seen:
                seen.add(name)
                way[name] = None
                name = self.frames[name].parent
            if name in way:
                loop = list(way)[list(way).index(name):]
                yield loop[::-1]

    def lines(self) -> Iterator[TreeLine]:
        """Draw the trees; a loop as one that begins and ends with the same frame."""
        begins = [self._root or loop[0] for loop in self.loops]
        for root, ends in [*((root, None) for root in self.roots), *zip(begins, begins)]:
            yield TreeLine('', root, None)
            waiting = self._child_lines(root, '', 1)
            while waiting:
                twig, indent, level = waiting.pop()
                yield twig
                if twig.name != ends:
                    waiting += self._child_lines(twig.name, indent, level)

    def _child_lines(self, parent: str, indent: str, level: int
                     ) -> list[tuple[TreeLine, str, int]]:
        """
        List the children of a frame, the first last, and the indent and level of theirs.

        :param level: of the children; 1 below a root.
        """
        twigs = []
        children = self._children.get(parent, [])
        if level > _DEEPEST:
            indent = indent[-4 * (_DEEPEST - 1):]
        begin = f'{level} ... {indent}' if level > _DEEPEST else indent
        for child in children:
            branch, rest = ('└── ', '    ') if child is children[-1] else ('├── ', '│   ')
            twigs.append((TreeLine(begin + branch, child, self.frames[child]), indent + rest,
                          level + 1))
        return twigs[::-1]


def frequency(frame: Frame) -> Optional[float]:
    """Compute the rate at which a frame moves (Hz); None where its transforms do not tell."""
    span = frame.latest - frame.oldest
    return (frame.length - 1) * 1e9 / span if span > 0 else None
