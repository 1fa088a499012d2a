"""Frames as trees and loops."""

import pytest

from puretf import Frame
from puretf_tools.inspection.forest import Forest


def static(name, parent):
    """Return a static frame."""
    return Frame(name, parent, '/node', True, 1, 0, 0)


def chain(length):
    """Return a forest in which each frame is the parent of the next: 0, 1, and so on."""
    return Forest([static(f'{i + 1}', f'{i}') for i in range(length)])


def lines(forest):
    """Return the drawn lines."""
    return [line.branches + line.name for line in forest.lines()]


def test_several_roots_and_a_loop_are_drawn():
    """tf2 draws only the last root, and nothing if there is a loop."""
    forest = Forest([static('a', 'root 1'), static('b', 'root 2'), static('x', 'y'),
                     static('y', 'z'), static('z', 'x'), static('twig', 'x')])
    assert forest.roots == ['root 1', 'root 2']
    (loop,) = forest.loops
    assert {*zip(loop, loop[1:] + loop[:1])} == {('y', 'x'), ('z', 'y'), ('x', 'z')}
    drawn = lines(forest)
    assert drawn[:4] == ['root 1', '└── a', 'root 2', '└── b']
    assert [line.split()[-1] for line in drawn].count(loop[0]) == 2  # as root, and as leaf
    assert {line.split()[-1] for line in drawn[4:]} == {'x', 'y', 'z', 'twig'}


def test_the_branches_of_a_chain_are_cut_off():
    """From the hundredth level on, a line begins with its level; its indent grows no more."""
    first, *others = (line.branches for line in chain(5000).lines())
    assert first == ''
    assert others[:100] == [f'{" " * 4 * i}└── ' for i in range(100)]
    assert others[100:] == [f'{i + 1} ... {" " * 4 * 99}└── ' for i in range(100, 5000)]


def test_a_long_chain_below_a_root():
    """The chain is longer than Python's recursion limit."""
    tree = chain(3000).subtree('1000')
    assert [*tree.names] == [f'{i}' for i in range(1000, 3001)]
    assert tree.roots == ['1000']


@pytest.mark.parametrize('root', ['x', 'y', 'z'])
def test_the_subtree_of_a_frame_in_a_loop(root):
    """The loop begins and ends with the root; its branches are shown."""
    tree = Forest([static('x', 'z'), static('y', 'x'), static('z', 'y'), static('twig', 'y'),
                   static('a', 'map')]).subtree(root)
    assert len(tree.loops) == 1
    names = [line.split()[-1] for line in lines(tree)]
    assert names[0] == root
    assert sorted(names) == sorted([root, 'x', 'y', 'z', 'twig'])
