"""The class Transform, the result of a lookup."""

import math
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from puretf import Transform

HALF = math.sqrt(0.5)
A_FROM_B = Transform(3, 'a', 'b', (1.0, 0.0, 0.0), (0.0, 0.0, HALF, HALF))  # a quarter about z


def test_its_matrix():
    """The matrix is homogeneous, of shape (4, 4)."""
    assert A_FROM_B.matrix() == pytest.approx(np.array(
        [[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), abs=1e-15)


def test_is_made_of_a_message():
    """The message is of geometry_msgs, or of any class with the same fields."""
    def fields(**values):
        return SimpleNamespace(**values)

    message = fields(
        header=fields(stamp=fields(sec=3, nanosec=4), frame_id='a'), child_frame_id='b',
        transform=fields(translation=fields(x=1.0, y=2.0, z=3.0),
                         rotation=fields(x=0.0, y=0.6, z=0.0, w=0.8)))
    assert Transform.from_message(message) == Transform(
        3_000_000_004, 'a', 'b', (1.0, 2.0, 3.0), (0.0, 0.6, 0.0, 0.8))


def test_takes_points_from_the_child_frame():
    """`apply` transforms one point or an array of points into the parent frame."""
    assert A_FROM_B.apply([1, 2, 3]) == pytest.approx([-1, 1, 3])
    assert A_FROM_B.apply(np.eye(3)[:2]) == pytest.approx(np.array([[1, 1, 0], [0, 0, 0]]))
    with pytest.raises(ValueError, match=r'of shape \(3,\) or \(n, 3\), got \(2,\)'):
        A_FROM_B.apply([1, 2])


def test_only_transforms_that_meet_in_a_frame_are_composed():
    """The error names all four frames."""
    with pytest.raises(ValueError, match="'b' from 'c' with 'a' from 'b': 'c' and 'a' must"):
        _ = Transform(5, 'b', 'c') @ A_FROM_B
    with pytest.raises(TypeError, match=r'for points, write transform\.apply\(points\)'):
        _ = A_FROM_B @ np.ones(3)  # type: ignore[operator]


vectors = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
rotations = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(
    lambda q: np.linalg.norm(q) > 0.1).map(
    lambda q: tuple((np.array(q) / np.linalg.norm(q)).tolist()))


def transforms(parent, child):
    """Return a strategy for transforms between two frames."""
    return st.builds(Transform, st.integers(0, 2**62), st.just(parent), st.just(child), vectors,
                     rotations)


def assert_near(found, expected):
    """Assert that two transforms are equal up to rounding; stamps and frames exactly."""
    assert found[:3] == expected[:3]
    np.testing.assert_allclose(found.matrix(), expected.matrix(), rtol=0, atol=1e-9)


@given(transforms('a', 'b'))
def test_the_inverse_takes_back(a_from_b):
    """Its products with the transform are the identities of the two frames."""
    assert_near(a_from_b @ a_from_b.inverse(), Transform(a_from_b.stamp, 'a', 'a'))
    assert_near(a_from_b.inverse() @ a_from_b, Transform(a_from_b.stamp, 'b', 'b'))


@given(transforms('a', 'b'), transforms('b', 'c'))
def test_the_matrix_of_a_composition_is_the_product(a_from_b, b_from_c):
    """The order of the factors is that of the transforms; the stamp is that of the left one."""
    a_from_c = a_from_b @ b_from_c
    assert a_from_c[:3] == (a_from_b.stamp, 'a', 'c')
    np.testing.assert_allclose(a_from_c.matrix(), a_from_b.matrix() @ b_from_c.matrix(), rtol=0,
                               atol=1e-9)
