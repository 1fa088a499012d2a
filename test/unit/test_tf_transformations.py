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
RANDOM = np.random.default_rng()
ONES = (1.0, 1.0, 1.0)


def vector(size=3):
    """Return a random vector."""
    return RANDOM.uniform(-2.0, 2.0, size)


def same(first, second):
    """Return whether two arrays are equal up to rounding."""
    return np.allclose(first, second, rtol=1e-7, atol=1e-9)


@pytest.fixture(autouse=True)
def seed():
    """Random numbers of the functions are the same in each run."""
    global RANDOM
    RANDOM = np.random.default_rng(18)
    np.random.seed(18)


def test_euler_angles():
    """Matrices are those of transforms3d, and the inverse function fits."""
    for axes in AXES * 4:
        angles = RANDOM.uniform(-pi, pi, 3)
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


@pytest.mark.parametrize('shortestpath', [True, False])
@pytest.mark.parametrize('spin', [0, 1, 2, -1, -2, 3])
def test_slerp_with_spin(spin, shortestpath):
    """The result is the oscillation u'' = -a² u from one to the other, with a = angle + spin π."""
    for fraction in -0.5, 0.0, 0.25, 0.5, 0.9, 1.0, 2.0:
        begin, end = tft.random_quaternion(), tft.random_quaternion()
        found = tft.quaternion_slerp(2.0 * begin, end, fraction, spin, shortestpath)
        if shortestpath and begin @ end < 0.0 and fraction != 1.0:
            end = -end
        angle = np.arccos(begin @ end) + spin * pi
        velocity = (end - begin * np.cos(angle)) / np.sin(angle)
        expected = begin * np.cos(fraction * angle) + velocity * np.sin(fraction * angle)
        assert same(found, expected)


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


def test_random():
    """Three numbers determine a rotation; a random vector has values from 0 to 1."""
    assert same(tft.random_quaternion((0.5, 0.0, 0.25)), (0, 0.5 ** 0.5, 0.5 ** 0.5, 0))
    assert same(tft.random_rotation_matrix((0.5, 0.0, 0.25)),
                tft.quaternion_matrix((0, 0.5 ** 0.5, 0.5 ** 0.5, 0)))
    matrix = tft.random_rotation_matrix()
    assert same(matrix @ matrix.T, np.identity(4))
    values = tft.random_vector((100, 3))
    assert values.shape == (100, 3)
    assert (values >= 0.0).all()
    assert (values < 1.0).all()
    assert np.ptp(values) > 0.5


def test_translation():
    """The matrix moves points; its inverse function returns the translation."""
    matrix = tft.translation_matrix([1, 2, 3])
    assert same(matrix @ (5, 5, 5, 1), (6, 7, 8, 1))
    assert same(tft.translation_from_matrix(matrix.tolist()), (1, 2, 3))
    assert same(tft.identity_matrix(), tft.translation_matrix(tft.TRANSLATION_IDENTITY))
    assert same(tft.ROTATION_IDENTITY, np.identity(3))
    assert (tft.ZOOM_IDENTITY, tft.SHEAR_IDENTITY) == ([1.0, 1.0, 1.0], [0.0, 0.0, 0.0])


def test_rotation():
    """The axis stays where it is, and a point turns about it."""
    matrix = tft.rotation_matrix(pi / 2, [0, 0, 2], [1, 0, 0])
    assert same(matrix @ (2, 0, 0, 1), (1, 1, 0, 1))
    for _ in range(10):
        angle, direction, point = RANDOM.uniform(-pi, pi), vector(), vector()
        matrix = tft.rotation_matrix(angle, direction, point)
        assert same(matrix @ (*point, 1), (*point, 1))
        assert same(tft.rotation_matrix(*tft.rotation_from_matrix(matrix.tolist())), matrix)
    for angle in 1e-9, 1e-5, 3.14159:
        found, axis, _ = tft.rotation_from_matrix(tft.rotation_matrix(angle, [0.6, 0, 0.8]))
        assert found * axis == pytest.approx([0.6 * angle, 0, 0.8 * angle], abs=1e-6 * angle)


def test_reflection():
    """A point goes to the other side of the plane."""
    assert same(tft.reflection_matrix([0, 0, 1], [0, 0, 5]) @ (1, 2, 3, 1), (1, 2, -1, 1))
    matrix = tft.reflection_matrix(vector(4), vector())
    assert same(tft.reflection_matrix(*tft.reflection_from_matrix(matrix.tolist())), matrix)


@pytest.mark.parametrize('direction', [None, (1.0, -2.0, 0.5)])
def test_scale(direction):
    """The origin of the scaling stays where it is; the inverse function fits."""
    matrix = tft.scale_matrix(-1.5, [1, 2, 3], direction)
    assert same(matrix @ (1, 2, 3, 1), (1, 2, 3, 1))
    factor, origin, axis = tft.scale_from_matrix(matrix.tolist())
    assert same(factor, -1.5)
    assert (axis is None) is (direction is None)
    assert same(tft.scale_matrix(factor, origin, axis), matrix)
    assert same(tft.scale_matrix(2.0) @ (1, 2, 3, 1), (2, 4, 6, 1))


def test_shear():
    """A point moves in the direction, by its distance from the plane times the tangent."""
    matrix = tft.shear_matrix(pi / 4, [1, 0, 0], [0, 0, 1], [0, 0, 1])
    assert same(matrix @ (0, 0, 3, 1), (2, 0, 3, 1))
    normal = vector()
    matrix = tft.shear_matrix(0.3, np.cross(normal, vector()), vector(), normal)
    assert same(tft.shear_matrix(*tft.shear_from_matrix(matrix.tolist())), matrix)


def test_compose_and_decompose():
    """Each argument has its effect, and the inverse function returns the arguments."""
    assert same(tft.compose_matrix(), np.identity(4))
    assert same(tft.compose_matrix(scale=(1, 2, 3)) @ (*ONES, 1), (1, 2, 3, 1))
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


@pytest.mark.parametrize(('direction', 'perspective', 'pseudo'), [
    (None, None, False), ((0.5, 1.0, 2.0), None, False), (None, (4.0, 5.0, 6.0), False),
    (None, (4.0, 5.0, 6.0), True)])
def test_projection(direction, perspective, pseudo):
    """Points are projected onto the plane; the inverse function fits."""
    point, normal = (1.0, 2.0, 3.0), (0.0, 1.0, 1.0)
    matrix = tft.projection_matrix(list(point), list(normal), direction, perspective, pseudo)
    assert tft.is_same_transform(
        tft.projection_matrix(*tft.projection_from_matrix(matrix.tolist(), pseudo)), matrix)
    if not pseudo:
        projected = matrix @ (7.0, -3.0, 0.5, 1.0)
        assert same(np.dot(projected[:3] / projected[3] - point, normal), 0.0)


@pytest.mark.parametrize('perspective', [False, True])
def test_clip(perspective):
    """The corners of the volume have the coordinates -1 and 1."""
    matrix = tft.clip_matrix(-1.0, 2.0, -3.0, 4.0, 0.5, 6.0, perspective)
    for corner, expected in (((-1.0, -3.0, 0.5), (-1, -1, -1)), ((2.0, 4.0, 0.5), (1, 1, -1))):
        clipped = matrix @ (*corner, 1.0)
        assert same(clipped[:3] / clipped[3], expected)
    with pytest.raises(ValueError, match='invalid frustum'):
        tft.clip_matrix(1.0, 0.0, 0.0, 1.0, 1.0, 2.0)


def test_orthogonalization():
    """A cell with right angles is only scaled."""
    assert same(tft.orthogonalization_matrix((10, 20, 30), (90, 90, 90)),
                np.diag((10.0, 20.0, 30.0, 1.0)))
    skew = tft.orthogonalization_matrix([9.8, 12.0, 15.5], [87.2, 80.7, 69.7])
    assert same(np.linalg.norm(skew[:3, :3], axis=0), (9.8, 12.0, 15.5))


@pytest.mark.parametrize('usesvd', [True, False])
def test_superimposition(usesvd):
    """The matrix that moved the points is found, with its scale if that is asked for."""
    points = RANDOM.uniform(-1.0, 1.0, (3, 10))
    rigid = tft.translation_matrix((1, 2, 3)) @ tft.random_rotation_matrix()
    moved = (rigid @ (*points, np.ones(10)))[:3]
    assert same(tft.superimposition_matrix(points.tolist(), moved.tolist(), usesvd=usesvd), rigid)
    scaled = rigid @ tft.scale_matrix(2.5)
    moved = (scaled @ (*points, np.ones(10)))[:3]
    assert same(tft.superimposition_matrix(points, moved, scaling=True, usesvd=usesvd), scaled)


def test_products_and_inverses():
    """The last matrix is applied first."""
    a, b = tft.random_rotation_matrix(), tft.translation_matrix((1, 2, 3))
    assert same(tft.concatenate_matrices(a.tolist(), b), a @ b)
    assert same(tft.concatenate_matrices(), np.identity(4))
    assert same(tft.inverse_matrix(a) @ a, np.identity(4))
    assert tft.is_same_transform(a, 3.0 * a)
    assert not tft.is_same_transform(a, b)


def test_vectors():
    """Norms and unit vectors along an axis, and into an array."""
    assert tft.vector_norm([3, 4]) == 5.0
    rows = vector((4, 3))
    assert same(tft.vector_norm(rows, axis=1), np.linalg.norm(rows, axis=1))
    assert same(tft.unit_vector([0, 0, 5]), (0, 0, 1))
    assert same(tft.vector_norm(tft.unit_vector(rows, axis=1), axis=1), np.ones(4))
    out = np.empty((4, 3))
    assert tft.unit_vector(rows.tolist(), axis=1, out=out) is None
    assert same(out, tft.unit_vector(rows, axis=1))
    lengths = np.empty(4)
    assert tft.vector_norm(rows, axis=1, out=lengths) is None
    assert same(lengths, tft.vector_norm(rows, axis=1))


def test_arcball():
    """Half of the radius to the right and back is no rotation; a quaternion is x y z w."""
    ball = tft.Arcball([0, 0, 1, 0])
    assert same(ball.matrix(), np.diag((-1.0, -1.0, 1.0, 1.0)))
    assert same(tft.Arcball(ball.matrix()).matrix(), ball.matrix())
    ball = tft.Arcball()
    ball.place([320, 320], 320)
    ball.down([320, 320])
    ball.drag([480, 320])  # by 30 degrees about y: a trackball turns by twice the angle
    assert same(ball.matrix(), tft.rotation_matrix(pi / 3, [0, 1, 0]))
    ball.drag([320, 320])
    assert same(ball.matrix(), np.identity(4))
    ball.setaxes([1, 0, 0])
    ball.setconstrain(True)
    assert ball.getconstrain()
    ball.down([320, 320])
    ball.drag([400, 160])
    ball.next()
    assert same(ball.matrix()[:3, 0], (1, 0, 0))
    with pytest.raises(ValueError, match='initial'):
        tft.Arcball([1, 2, 3])


def test_points_of_the_arcball():
    """Points of a window, and points that are perpendicular to an axis."""
    assert same(tft.arcball_map_to_sphere([320, 320], [320, 320], 320), (0, 0, 1))
    assert same(tft.arcball_map_to_sphere([960, 320], [320, 320], 320), (1, 0, 0))
    point = tft.unit_vector([1, 1, 1])
    assert same(tft.arcball_constrain_to_axis(point, [0, 0, 1]), (0.5 ** 0.5, 0.5 ** 0.5, 0))
    axes = [tft.unit_vector([1, 1, 1]), np.array([0.0, 0.0, 1.0])]
    assert tft.arcball_nearest_axis([0, 1, 0], axes) is axes[1]
    assert tft.arcball_nearest_axis([0, 1, 0], []) is None
