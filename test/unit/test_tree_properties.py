"""Properties of lookups in random trees."""

import contextlib
import math
import re

from hypothesis import assume, example, given
from hypothesis import strategies as st
from model import are_equal, compare_many_with_single, Loop, matrix, Model, outcome
import numpy as np
import pytest
from transforms3d import quaternions

from puretf import ExtrapolationException, TransformBuffer
from puretf._core.engine import engine_of

S = 1_000_000_000
START = 1_700_000_000 * S
FRAMES = 'abcde'
STILL = (0.0, 0.0, 0.0, 1.0)
HALF_TURNS = [(1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0),
              (0.6, 0.8, 0.0, 0.0)]


def unit(numbers):
    """Normalise a quaternion."""
    return tuple((np.array(numbers) / np.linalg.norm(numbers)).tolist())


coordinates = st.floats(-10.0, 10.0)
translations = st.tuples(coordinates, coordinates, coordinates)
any_rotations = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(
    lambda numbers: np.linalg.norm(numbers) > 0.1).map(unit)
near_rotations = st.tuples(*[st.floats(-1e-7, 1e-7)] * 3).map(lambda v: unit((*v, 1.0)))
rotations = any_rotations | near_rotations | st.sampled_from(HALF_TURNS)
# No two of these rotations are half a turn apart, so that their interpolation is unambiguous.
pool = [unit(numbers) for numbers in np.random.default_rng(7).normal(size=(8, 4))]
inserts = st.tuples(
    st.integers(0, 30).map(lambda tenths: START + tenths * S // 10),
    st.sampled_from(FRAMES), st.sampled_from(FRAMES), translations, st.sampled_from(pool),
    st.sampled_from([False, False, False, True])).filter(lambda insert: insert[1] != insert[2])
times = st.one_of(st.just(0), st.integers(-1, 61).map(lambda n: START + n * S // 20))
names = st.sampled_from([*FRAMES, 'nobody'])


queries = st.tuples(names, names, names, times, times)


@given(st.lists(inserts | queries, min_size=20, max_size=60))
def test_answers_as_the_model(data):
    """Frames are re-parented and form loops; transforms are static, late, or repeated."""
    buffer, model = TransformBuffer(2 * S), Model(2 * S)
    for item in data:
        if len(item) == 6:
            stamp, parent, child, xyz, xyzw, is_static = item
            taken = buffer.insert(stamp, parent, child, (*xyz, *xyzw), is_static=is_static)
            assert taken == model.insert(stamp, parent, child, xyz, xyzw, is_static)
        else:
            compare_lookups(buffer, model, *item)


def compare_lookups(buffer, model, target, source, fixed, at, source_at):
    """Compare the answers of all kinds of lookups with those of the model."""
    answer = outcome(buffer.lookup_transform, target, source, at)
    full = outcome(buffer.lookup_transform_full, target, at, source, source_at, fixed)
    poses = buffer.lookup_transforms(target, source, [at, source_at, at] * 6)  # by numpy
    available, _ = engine_of(buffer).lookups.available(target, source, [at, source_at])
    other = outcome(buffer.lookup_transform, target, source, source_at)
    assert available == [not isinstance(one, str) for one in (answer, other)]
    assert [*poses[2][:3]] == [not isinstance(one, str) for one in (answer, other, answer)]
    for i, one in enumerate((answer, other, answer)):
        if poses[2][i]:
            assert np.allclose(matrix(poses[0][i], poses[1][i]), one[1], rtol=0, atol=1e-9)
    assert buffer.can_transform(target, source, at) != isinstance(answer, str)
    assert buffer.can_transform_full(target, at, source, source_at, fixed) != isinstance(full, str)
    with contextlib.suppress(Loop):
        assert are_equal(answer, model.lookup(target, source, at))
        assert are_equal(full, model.lookup_full(target, at, source, source_at, fixed))


def turning(before, after, duration=S):
    """Return a buffer in which a frame turns from one rotation to another."""
    buffer = TransformBuffer()
    buffer.insert(START, 'a', 'b', (0.0, 0.0, 0.0, *before))
    buffer.insert(START + duration, 'a', 'b', (0.0, 0.0, 0.0, *after))
    return buffer


@pytest.mark.parametrize('rotation', HALF_TURNS)
@pytest.mark.parametrize('ratio', [0.0, 0.25, 0.5, 1.0])
def test_half_a_turn(rotation, ratio):
    """The interpolation to an exact half turn rotates evenly about its axis."""
    angle = ratio * math.pi
    expected = [*(math.sin(angle / 2) * axis for axis in rotation[:3]), math.cos(angle / 2)]
    buffer = turning(STILL, rotation)
    answer = buffer.lookup_transform('a', 'b', START + int(ratio * S))
    assert answer.rotation == pytest.approx(expected, abs=1e-12)


@given(st.tuples(*[st.floats(-1e-6, 1e-6)] * 3), st.floats(0.0, 1.0))
@example((1e-9, 0.0, 0.0), 0.5)
def test_near_the_identity(vector, ratio):
    """A tiny rotation is interpolated within the error of tf2, where a cosine rounds to one."""
    buffer = turning(STILL, unit((*vector, 1.0)))
    answer = buffer.lookup_transform('a', 'b', START + int(ratio * S))
    assert answer.rotation == pytest.approx([*np.multiply(vector, ratio), 1.0], abs=2e-8)


@st.composite
def sampled_trees(draw):
    """
    Return a tree, its frames, and times.

    Edges, and samples of an edge, may have the same stamps. Successive rotations may be equal,
    opposite or almost equal.
    """
    buffer = TransformBuffer(2 ** 65)
    clocks = st.integers(START, START + 5), st.sampled_from([1 - 2 ** 63, -S, 7, 2 ** 63 - 1])
    stamps = draw(st.lists(draw(st.sampled_from(clocks)), min_size=1, max_size=5))
    steps = st.builds(lambda vector, exponent: np.multiply(vector, 10.0 ** exponent),
                      st.tuples(*[st.floats(-1.0, 1.0)] * 4), st.floats(-9.0, -1.0))
    frames = [f'f{i}' for i in range(draw(st.integers(2, 7)))]
    for i, child in enumerate(frames[1:]):
        parent, rotation = draw(st.sampled_from(frames[:i + 1])), draw(rotations)
        own = draw(st.just(stamps) | st.lists(st.sampled_from(stamps), min_size=1, max_size=5))
        is_static = draw(st.integers(0, 3)) == 0
        for stamp in sorted(own):
            buffer.insert(stamp, parent, child, (*draw(translations), *rotation),
                          is_static=is_static)
            rotation = draw(st.just(rotation) | st.just(tuple(np.negative(rotation))) | rotations
                            | st.just(unit(np.add(rotation, draw(steps)))))
    between = st.integers(min(stamps), max(stamps))
    return buffer, frames, draw(st.lists(
        between | st.sampled_from(stamps) | st.just(0) | clocks[0] | clocks[1], max_size=8))


@given(sampled_trees(), st.data())
def test_many_at_once_are_single_lookups(tree, data):
    """lookup_transforms returns what lookup_transform returns for each of the times."""
    buffer, frames, times = tree
    target, source = data.draw(st.sampled_from(frames)), data.draw(st.sampled_from(frames))
    compare_many_with_single(buffer, target, source, times)


@given(any_rotations, st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.floats(-6.0, 0.5))
def test_many_at_once_are_exact(rotation, axis, exponent):
    """Interpolated rotations equal slerp in extended precision, for all angles above 1e-6 rad."""
    assume(np.linalg.norm(axis) > 0.1)
    angle = min(10.0 ** exponent, 3.14)
    turn = (math.cos(angle / 2), *np.multiply(unit(axis), math.sin(angle / 2)))
    after = quaternions.qmult(turn, np.roll(rotation, 1))
    buffer = turning(rotation, np.roll(after, -1), 1024)
    _, result, _ = buffer.lookup_transforms('a', 'b', range(START, START + 1025))
    # The samples themselves, because their rotations are rounded when they are inserted.
    first, last = result[[0, -1]].astype(np.longdouble)
    first, last = first / np.sqrt(first @ first), last / np.sqrt(last @ last)
    sign = 1 if first @ last > 0 else -1
    chord = first - sign * last
    p = 2 * np.arcsin(np.sqrt(chord @ chord) / 2)
    s = np.arange(1025, dtype=np.longdouble)[:, np.newaxis] / 1024
    expected = (np.sin((1 - s) * p) * first + np.sin(s * p) * sign * last) / np.sin(p)
    expected[-1] *= sign
    assert np.abs(result - expected).max() < 1.1e-13


@st.composite
def uneven_trees(draw):
    """Return a tree whose edges have data for different times, and its parents and time spans."""
    buffer, parents, spans = TransformBuffer(100 * S), {}, {}
    for child in range(1, draw(st.integers(2, 9))):
        parent = f'f{draw(st.integers(0, child - 1))}'
        begin, length = draw(st.integers(0, 20)), draw(st.integers(0, 20))
        parents[f'f{child}'] = parent
        is_static = draw(st.integers(0, 4)) == 0
        if not is_static:
            spans[f'f{child}'] = START + begin * S, START + (begin + length) * S
        for stamp in spans.get(f'f{child}', (0,)):
            buffer.insert(stamp, parent, f'f{child}', (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
                          is_static=is_static)
    return buffer, parents, spans


def edges_between(target, source, parents):
    """Return the child frames of the edges between two frames of a tree."""
    def up(frame):
        return [frame, *up(parents[frame])] if frame in parents else [frame]

    return {*up(target)} ^ {*up(source)}


HINT = re.compile(
    r"\. The data of edge '(\w+)' -> '(\w+)' are [\w. ]+ and (end|begin) (\d+\.\d{9}) s "
    r'(before|after) that time\. .*More: tf_doctor --explain \w+$')


@given(uneven_trees(), st.data())
def test_the_edge_that_an_error_names_is_on_the_path_and_short_by_what_it_says(tree, data):
    """No other edge of the path misses the time by more, whichever edge tf2 itself refers to."""
    buffer, parents, spans = tree
    frames = st.sampled_from(['f0', *parents])
    target, source = data.draw(frames), data.draw(frames)
    at = START + data.draw(st.integers(-1, 41)) * S
    path = edges_between(target, source, parents)
    short = {child: max(spans[child][0] - at, at - spans[child][1])
             for child in path & spans.keys() if not spans[child][0] <= at <= spans[child][1]}
    try:
        buffer.lookup_transform(target, source, at)
    except ExtrapolationException as error:
        hint = HINT.search(str(error))
        assert hint is not None
        parent, child, verb, seconds, _ = hint.groups()
        assert parent == parents[child]
        assert short[child] == round(float(seconds) * S) == max(short.values())
        assert verb == ('end' if at > spans[child][1] else 'begin')
    else:
        assert not short
