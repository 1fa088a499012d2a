"""The functions of tf_transformations, by their inverses, known values and transforms3d."""

from itertools import product
from math import pi

import numpy as np
import pytest
from transforms3d import affines, euler

from puretf import rotations

tft = pytest.importorskip('tf_transformations')  # it is in the directory `compat`
AXES = [f'{frame}{first}{second}{third}' for frame, first, second, third
        in product('sr', 'xyz', 'xyz', 'xyz') if first != second != third]


def same(first, second):
    """Return whether two arrays are equal up to rounding."""
    return np.allclose(first, second, rtol=1e-7, atol=1e-9)


@pytest.fixture(autouse=True)
def seed():
    """Random numbers of the functions are the same in each run."""
    np.random.seed(18)


def test_euler_angles():
    """Matrices are those of transforms3d, and the inverse function fits."""
    for axes in AXES * 4:
        angles = tft.random_vector(3) * 6.0 - 3.0
        matrix = tft.euler_matrix(*angles, axes)
        assert same(matrix[:3, :3], euler.euler2mat(*angles, axes))
        assert same(matrix[3], (0.0, 0.0, 0.0, 1.0))
        assert same(tft.euler_matrix(*tft.euler_from_matrix(matrix, axes), axes=axes), matrix)
    scaled = tft.euler_matrix(0.1, 0.2, 0.3) @ tft.scale_matrix(2.0)
    assert same(tft.euler_from_matrix(scaled), (0.1, 0.2, 0.3))
    assert same(tft.euler_from_matrix(tft.euler_matrix(0.1, 0.2, 0.3)[:3, :3]), (0.1, 0.2, 0.3))


def test_quaternions_are_those_of_rotations():
    """test_rotations.py has their tests."""
    for name in 'quaternion_about_axis', 'quaternion_from_euler', 'quaternion_multiply':
        assert getattr(tft, name) is getattr(rotations, name)
    for axes in AXES:
        a, b = tft.random_quaternion(), tft.random_quaternion()
        assert same(np.linalg.norm(a), 1.0)
        for name, *arguments in (
                ('euler_from_quaternion', a, axes), ('quaternion_conjugate', a),
                ('quaternion_from_matrix', rotations.quaternion_matrix(a)),
                ('quaternion_inverse', a), ('quaternion_matrix', a),
                ('quaternion_slerp', a, b, 0.3)):
            assert same(getattr(tft, name)(*arguments), getattr(rotations, name)(*arguments))


def test_slerp_of_known_values():
    """Half of a quarter turn with a spin of 1: sin(5π/8) / sin(5π/4) times the sum of the ends."""
    end = (0.0, 0.0, 0.5 ** 0.5, 0.5 ** 0.5)
    found = tft.quaternion_slerp((0, 0, 0, 1), end, 0.5, 1)
    assert same(found, (0, 0, -0.9238795325, -2.2304424973))
    for other in end, np.negative(end):  # equal rotations
        for spin, shortestpath in product((0, 1, 2), (True, False)):
            assert same(tft.quaternion_slerp(end, other, 0.5, spin, shortestpath), end)
            assert same(tft.quaternion_slerp(end, other, 1.0, spin, shortestpath), other)
    for wrong in (0, 0, 0, 0), (0, 0, float('nan'), 1):
        with pytest.raises(ValueError, match='quaternion must'):
            tft.quaternion_slerp(wrong, end, 0.5)
        with pytest.raises(ValueError, match='quaternion must'):
            tft.quaternion_slerp(end, wrong, 0.0)


def test_what_programs_do_with_quaternions():
    """They use zeros as no rotation, and change the array that they get."""
    assert tft.euler_from_quaternion([0, 0, 0, 0]) == (0.0, 0.0, 0.0)
    assert same(tft.quaternion_matrix(np.zeros(4)), np.identity(4))
    inverse = tft.quaternion_inverse((0.0, 0.0, 0.0, 2.0))
    inverse[3] = -inverse[3]
    assert same(inverse, (0, 0, 0, -0.5))


def test_rotation():
    """The axis stays where it is, and a point turns about it."""
    matrix = tft.rotation_matrix(pi / 2, [0, 0, 2], [1, 0, 0])
    assert same(matrix @ (2, 0, 0, 1), (1, 1, 0, 1))
    for angle in 1e-9, 1e-5, 3.14159:
        found, axis, _ = tft.rotation_from_matrix(tft.rotation_matrix(angle, [0.6, 0, 0.8]))
        assert found * axis == pytest.approx([0.6 * angle, 0, 0.8 * angle], abs=1e-6 * angle)


QUARTER = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
CUBE = [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize(('name', 'arguments', 'expected'), [
    ('identity_matrix', (), np.identity(4)), ('concatenate_matrices', (), np.identity(4)),
    ('inverse_matrix', (QUARTER,), np.transpose(QUARTER)),
    ('concatenate_matrices', (QUARTER, np.diag((2, 3, 1, 1))), np.dot(
        QUARTER, np.diag((2, 3, 1, 1)))),
    ('is_same_transform', (QUARTER, np.multiply(3, QUARTER)), True),
    ('is_same_transform', (QUARTER, np.identity(4)), False),
    ('translation_matrix', ([1, 2, 3],), [
        [1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]),
    ('translation_from_matrix', ([[1, 0, 0, 7], *QUARTER[1:]],), (7, 0, 0)),
    ('reflection_matrix', ([0, 0, 1], [0, 0, 5]), [
        [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]]),
    ('scale_matrix', (2,), np.diag((2, 2, 2, 1))),
    ('scale_matrix', (-1, [1, 2, 3], [1, 0, 0]), [
        [-1, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    ('shear_matrix', (pi / 4, [1, 0, 0], [0, 0, 1], [0, 0, 1]), [
        [1, 0, 1, -1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    ('projection_matrix', ([0, 0, 1], [0, 0, 1]), [
        [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1], [0, 0, 0, 1]]),
    ('clip_matrix', (-1, 1, -2, 2, 3, 5), [
        [1, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 1, -4], [0, 0, 0, 1]]),
    ('orthogonalization_matrix', ((10, 20, 30), (90, 90, 90)), np.diag((10, 20, 30, 1))),
    ('superimposition_matrix', (CUBE, np.multiply(2.5, CUBE).tolist(), True), np.diag(
        (2.5, 2.5, 2.5, 1))),
    ('superimposition_matrix', (CUBE, np.dot(np.array(QUARTER)[:3, :3], CUBE), False, False),
     QUARTER),
    ('random_quaternion', ((0.5, 0, 0.25),), (0, 0.5 ** 0.5, 0.5 ** 0.5, 0)),
    ('random_rotation_matrix', ((0.5, 0, 0.25),), [
        [-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
    ('vector_norm', ([3, 4],), 5), ('vector_norm', ([[3, 4], [0, 2]], 1), (5, 2)),
    ('unit_vector', ([0, 0, 5],), (0, 0, 1)), ('unit_vector', ([[3, 4], [0, 2]], 1), [
        (0.6, 0.8), (0, 1)]),
    ('arcball_map_to_sphere', ([960, 320], [320, 320], 320), (1, 0, 0)),
    ('arcball_constrain_to_axis', ([0.6, 0, 0.8], [0, 0, 1]), (1, 0, 0)),
    ('arcball_nearest_axis', ([0, 1, 0], [[0.6, 0.8, 0], [0, 0, 1]]), (0, 0, 1)),
    ('TRANSLATION_IDENTITY', None, (0, 0, 0)), ('ROTATION_IDENTITY', None, np.identity(3)),
    ('ZOOM_IDENTITY', None, (1, 1, 1)), ('SHEAR_IDENTITY', None, (0, 0, 0))])
def test_known_values(name, arguments, expected):
    """Lists of integers are accepted."""
    value = getattr(tft, name)
    assert same(value if arguments is None else value(*arguments), expected)


@pytest.mark.parametrize(('name', 'arguments'), [
    ('rotation', (0.5, [1, 2, 3], [4, 5, 6])), ('reflection', ([1, 2, 3], [4, 5, 6])),
    ('scale', (-1.5, [1, 2, 3])), ('scale', (1.5, [1, 2, 3], [4, 5, 6])),
    ('shear', (0.3, [1, -1, 0], [1, 2, 3], [1, 1, 5])),
    ('projection', ([1, 2, 3], [0, 1, 1], [1, 2, 3])),
    ('projection', ([1, 2, 3], [0, 1, 1], None, [4, 5, 6]))])
def test_inverse_functions(name, arguments):
    """They return arguments that make the same matrix."""
    make, arguments_of = getattr(tft, f'{name}_matrix'), getattr(tft, f'{name}_from_matrix')
    matrix = make(*arguments)
    assert tft.is_same_transform(make(*arguments_of(matrix.tolist())), matrix)


def test_arcball():
    """Half of the radius to the right is a turn by 60 degrees; a quaternion is x y z w."""
    assert same(tft.Arcball([0, 0, 1, 0]).matrix(), np.diag((-1.0, -1.0, 1.0, 1.0)))
    assert same(tft.Arcball(QUARTER).matrix(), QUARTER)
    ball = tft.Arcball()
    ball.place([320, 320], 320)
    ball.down([320, 320])
    ball.drag([480, 320])
    assert same(ball.matrix(), tft.rotation_matrix(pi / 3, [0, 1, 0]))
    ball.setconstrain(True)
    assert ball.getconstrain()


def test_compose_and_decompose():
    """Each argument has its effect, and the inverse function returns the arguments."""
    assert same(tft.compose_matrix(), np.identity(4))
    assert same(tft.compose_matrix(scale=(1, 2, 3)) @ (1, 1, 1, 1), (1, 2, 3, 1))
    assert same(tft.compose_matrix(angles=(0, 0, pi / 2)) @ (1, 0, 0, 1), (0, 1, 0, 1))
    arguments = (0.5, 2.0, 1.5), (0.1, -0.2, 0.3), (0.3, -0.4, 0.5), (1.0, 2.0, 3.0)
    matrix = tft.compose_matrix(*arguments)
    assert same(matrix, affines.compose(
        arguments[3], euler.euler2mat(*arguments[2]), arguments[0], arguments[1]))
    *found, perspective = tft.decompose_matrix(matrix.tolist())
    assert perspective is None
    assert all(map(same, found, arguments))
    persp = (0.1, 0.2, 0.3, 1.5)
    matrix = tft.compose_matrix(*arguments, persp)
    *found, perspective = tft.decompose_matrix(matrix)
    assert all(map(same, found, arguments))
    assert same(perspective, persp)
    with pytest.raises(ValueError, match='the matrix has no inverse'):
        tft.decompose_matrix(np.ones((4, 4)))
