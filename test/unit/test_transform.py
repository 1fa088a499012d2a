"""The class Transform, the result of a lookup."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from puretf import Transform

HALF = math.sqrt(0.5)
A_FROM_B = Transform(3, 'a', 'b', (1.0, 0.0, 0.0), (0.0, 0.0, HALF, HALF))  # a quarter about z
B_FROM_C = Transform(5, 'b', 'c', (2.0, 0.0, 0.0))


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


def test_composes_where_the_frames_between_are_the_same():
    """a_from_b @ b_from_c is a_from_c, with the stamp of the left operand."""
    a_from_c = A_FROM_B @ B_FROM_C
    assert a_from_c[:3] == (3, 'a', 'c')
    assert a_from_c.translation == pytest.approx((1, 2, 0))
    assert a_from_c.rotation == pytest.approx(A_FROM_B.rotation)
    with pytest.raises(ValueError, match="'b' from 'c' with 'a' from 'b': 'c' and 'a' must"):
        _ = B_FROM_C @ A_FROM_B
    with pytest.raises(TypeError):
        _ = A_FROM_B @ (1, 2)  # type: ignore[operator]


def test_its_inverse():
    """The inverse swaps the frames, and its product with the transform is the identity."""
    b_from_a = A_FROM_B.inverse()
    assert b_from_a[:3] == (3, 'b', 'a')
    assert (A_FROM_B @ b_from_a).matrix() == pytest.approx(np.eye(4))
