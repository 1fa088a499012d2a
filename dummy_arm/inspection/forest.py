"""Arrange the frames of a buffer into trees and loops."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple, Optional

from dummy_arm.tf import Frame

#: A line shows the branches of at most this many levels. The line of a deeper level begins with
#: the number of the level, and shows only the branches nearest to the name. Without this limit,
#: the text of a chain of n frames would grow with the square of n.
_DEEPEST = 100


class TreeLine(NamedTuple):
    """A line of a drawn tree: one frame."""

    branches: str  #: the box-drawing characters before the name; '' for a root
    name: str  #: the name of the frame
    frame: Optional[Frame]  #: the state of the frame; None for a root


class Forest:
    """Frames arranged by their parents: trees, and loops."""

    def __init__(self, frames: Iterable[Frame], root: Optional[str] = None) -> None:
        """
        Build the trees, and find the loops.

        :param frames: the frames that have a parent.
        :param root: the common root of all frames, which is shown even if `frames` is empty;
            None: there may be any number of trees.
        """
        self.frames = {frame.name: frame for frame in frames}
        self._root = root
        self._children: dict[str, list[str]] = {} if root is None else {root: []}
        for frame in self.frames.values():
            self._children.setdefault(frame.parent, []).append(frame.name)
        #: The names of the frames that have no parent in this forest.
        self.roots = [name for name in self._children if name not in self.frames]
        #: For each loop, the names of its frames: each frame is the parent of the next frame, and
        #: the last frame is the parent of the first.
        self.loops = list(self._find_loops())

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all frames, including those without a parent."""
        return *self.roots, *self.frames

    @property
    def line_count(self) -> int:
        """The number of lines that `lines` yields."""
        return len(self.roots) + len(self.loops) + len(self.frames)

    def subtree(self, root: str) -> 'Forest':
        """
        Return the tree that consists of a frame and its descendants.

        If the frame is part of a loop, the tree has all frames of the loop and their descendants.

        :param root: the name of the frame.
        :returns: the tree, with `root` as its root.
        """
        found, pending = {}, [root]
        while pending:
            for name in self._children.get(pending.pop(), []):
                if name not in found:
                    found[name] = self.frames[name]
                    pending.append(name)
        return Forest(found.values(), root)

    def _find_loops(self) -> Iterator[list[str]]:
        """
        Yield each loop once.

        From each frame, follow the path from parent to parent. If the path comes back to one of
        its own frames, there is a loop.
        """
        seen = set(self.roots)
        for start in self.frames:
            path: dict[str, None] = {}
            name = start
            while name not in seen:
                seen.add(name)
                path[name] = None
                name = self.frames[name].parent
            if name in path:
                loop = list(path)[list(path).index(name):]
                yield loop[::-1]

    def lines(self) -> Iterator[TreeLine]:
        """
        Draw the trees.

        A loop is drawn as a tree whose root appears once more, as a leaf.

        :returns: the lines, from top to bottom.
        """
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
        """
        Return the lines of the children of a frame, the last child first.

        The order is reversed, since the caller pops the lines from the end of the list.

        :param parent: the name of the frame.
        :param indent: the branches of the levels above the children.
        :param level: the level of the children; 1: they are children of a root.
        :returns: for each child: its line, and the `indent` and the `level` of its own children.
        """
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


def frequency(frame: Frame) -> Optional[float]:
    """
    Compute the average rate of the samples of a frame.

    :param frame: the frame.
    :returns: the rate (Hz); None if all samples have the same stamp, as for a static frame.
    """
    span = frame.latest - frame.oldest
    return (frame.length - 1) * 1e9 / span if span > 0 else None
