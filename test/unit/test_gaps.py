"""Holes in the data between two frames, compared with a search in all data of the buffer."""

from bisect import bisect_left, bisect_right

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from puretf import SECOND, TransformBuffer
from puretf_tools.inspection.gaps import beyond_ends, Hole, holes_at

STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def buffer_of(*edges):
    """Return a buffer: the parent, the child, and the stamps (s), or None: static."""
    buffer = TransformBuffer(2**62)
    for parent, child, stamps in edges:
        for stamp in stamps or [0.0]:
            buffer.insert(round(stamp * SECOND), parent, child, STILL, is_static=stamps is None)
    return buffer


def holes(buffer, target, source, times, longest=None):
    """Return the holes at some times (s), as `holes_at` does, in a list."""
    return holes_at(buffer.path_edges(target, source), np.array(
        [round(time * SECOND) for time in times], np.int64), longest).tolist()


def steps(begin, end, hertz=10):
    return [i / hertz for i in range(round(begin * hertz), round(end * hertz) + 1)]


def test_a_hole():
    """It is between two stamps, without these; before and after all data, there is none."""
    buffer = buffer_of(('odom', 'base', [*steps(1, 3), *steps(7, 9)]))
    hole = Hole('odom -> base', 3 * SECOND, 7 * SECOND)
    for frames in ('odom', 'base'), ('base', 'odom'):
        assert holes(buffer, *frames, [0.5, 2.05, 3.0, 3.000000001, 6.99, 7.0, 9.5]) == [
            None, None, None, hole, hole, None, None]


@pytest.mark.parametrize(('stamps', 'time', 'is_hole'), [
    ([*steps(1, 5, 1), 14.0, 15.0], 10.0, False), ([*steps(1, 2, 100), 2.49, 2.5], 2.2, False),
    ([1.0, 90.0], 50.0, False), ([*steps(1, 2, 100), 2.5, 2.51], 2.2, True)])
def test_the_length_of_a_hole(stamps, time, is_hole):
    """It is more than ten times the usual step, and at least 0.5 s."""
    (found,) = holes(buffer_of(('odom', 'base', stamps)), 'odom', 'base', [time])
    assert bool(found) is is_hole


def test_a_given_limit():
    """A step that is as long is not a hole; edges that do not move have none."""
    buffer = buffer_of(('odom', 'base', [1.0, 1.1, 1.3]), ('base', 'arm', None))
    hole = Hole('odom -> base', 1100 * 10**6, 1300 * 10**6)
    assert holes(buffer, 'odom', 'arm', [1.05, 1.2], 200 * 10**6 - 1) == [None, hole]
    assert holes(buffer, 'odom', 'arm', [1.2], 200 * 10**6) == [None]
    assert holes(buffer, 'base', 'arm', [1.2], 0) == [None]


@st.composite
def moves(draw):
    """The stamps of base, each with its parent (odom or cart), and the stamps of both."""
    stamps = st.lists(st.integers(1, 30), unique=True, min_size=1).map(sorted)
    return [(stamp, draw(st.sampled_from(['odom', 'cart']))) for stamp in draw(stamps)], {
        'odom': draw(stamps), 'cart': draw(stamps)}


@given(moves(), st.lists(st.integers(0, 31)).map(sorted), st.integers(0, 9))
def test_holes_on_a_path_that_changes(given, times, longest):
    """At each time, the edges are those of the parents at this time."""
    base, others = given
    buffer = TransformBuffer(100)
    for child, stamps in others.items():
        for stamp in stamps:
            buffer.insert(stamp, 'map', child, STILL)
    for stamp, parent in base:
        buffer.insert(stamp, parent, 'base', STILL)
    own = [stamp for stamp, _ in base]

    def holes_around(time):
        """Return the longest holes; [None] if there are none."""
        parent = base[max(0, bisect_right(own, time) - 1)][1]
        found = []
        for above, below, stamps in ((parent, 'base', own), ('map', parent, others[parent])):
            i = bisect_left(stamps, time)
            if 0 < i < len(stamps) and stamps[i] != time and (
                    stamps[i] - stamps[i - 1] > longest):
                found.append(Hole(f'{above} -> {below}', stamps[i - 1], stamps[i]))
        most = max((hole.end - hole.begin for hole in found), default=0)
        return [hole for hole in found if hole.end - hole.begin == most] or [None]

    edges = buffer.path_edges('map', 'base')
    got = holes_at(edges, np.array(times, np.int64), longest).tolist()
    assert len(got) == len(times)
    for time, hole in zip(times, got):
        assert hole in holes_around(time)


def beyond(buffer, target, source, times):
    mask, text = beyond_ends(buffer.path_edges(target, source), np.array(
        [round(time * SECOND) for time in times], np.int64))
    return mask.tolist(), text


@pytest.mark.parametrize(('times', 'mask', 'text'), [
    ([1.0, 2.0, 5.0], [False] * 3, ''), ([], [], ''),
    ([0.75, 1.5], [True, False], 'odom -> base: the first 0.25 s'),
    ([4.0, 5.04], [False, True], 'odom -> base: the last 0.04 s'),
    ([0.0, 3.0, 1505.0], [True, False, True],
        'odom -> base: the first 1 s; of odom -> base: the last 1500 s')])
def test_times_outside_of_the_data(times, mask, text):
    """The text says how far they are outside."""
    buffer = buffer_of(('odom', 'base', [1.0, 5.0]), ('base', 'arm', None))
    assert beyond(buffer, 'arm', 'odom', times) == (mask, text)


def test_the_edges_that_end_first():
    """Of several edges, those that leave out most are named."""
    buffer = buffer_of(('map', 'odom', [1.0, 5.0]), ('odom', 'base', [2.0, 6.0]),
                       ('base', 'tool', [1.5, 6.5]))
    assert beyond(buffer, 'map', 'tool', [1.0, 1.75, 3.0, 6.0, 6.5]) == (
        [True, True, False, True, True],
        'odom -> base: the first 1 s; of map -> odom: the last 1.5 s')
