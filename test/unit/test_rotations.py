"""The functions on rotations, compared with matrices, theorems and transforms3d."""

from collections.abc import Callable
from itertools import product
import math

from hypothesis import assume, example, given
from hypothesis import strategies as st
import numpy as np
import pytest
from transforms3d import euler

from puretf import Transform
from puretf.rotations import (
    euler_from_quaternion,
    quaternion_about_axis,
    quaternion_conjugate,
    quaternion_from_euler,
    quaternion_from_matrix,
    quaternion_inverse,
    quaternion_matrix,
    quaternion_multiply,
    quaternion_slerp,
)

CONVENTIONS = [frame + a + b + c for frame, a, b, c in product('sr', *['xyz'] * 3) if a != b != c]
HALF = math.sqrt(0.5)
UNIT = (0.0, 0.0, 0.0, 1.0)

angles = st.floats(-7.0, 7.0)
numbers = st.floats(-10.0, 10.0)
quaternions = st.tuples(numbers, numbers, numbers, numbers)
units = quaternions.filter(lambda q: np.linalg.norm(q) > 0.1).map(
    lambda q: tuple((np.array(q) / np.linalg.norm(q)).tolist()))
axes_of_turns = st.tuples(numbers, numbers, numbers).filter(
    lambda v: np.linalg.norm(v) > 0.1).map(lambda v: np.array(v) / np.linalg.norm(v))
conventions = st.sampled_from(CONVENTIONS)


def hamilton(left, right):
    """Multiply two quaternions by their scalar and vector parts."""
    v, w = np.array(left[:3]), left[3]
    u, s = np.array(right[:3]), right[3]
    return np.array([*(w * u + s * v + np.cross(v, u)), w * s - v @ u])


def about(angle, axis):
    """Return the quaternion of a rotation about a unit vector."""
    return np.array([*(math.sin(angle / 2) * np.array(axis)), math.cos(angle / 2)])


def turned(quaternion):
    """Return the rotation matrix of a unit quaternion."""
    v, w = np.array(quaternion[:3]), quaternion[3]
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * np.cross(np.eye(3), v)


def composed(three, axes):
    """Multiply the quaternions of three rotations, those about fixed axes from the left."""
    a, b, c = (about(angle, np.eye(3)['xyz'.index(axis)]) for axis, angle in zip(axes[1:], three))
    return hamilton(c, hamilton(b, a)) if axes[0] == 's' else hamilton(a, hamilton(b, c))


def from_angles(three: tuple[float, float, float], axes: str):
    """Return the same quaternion by the function under test."""
    return quaternion_from_euler(*three, axes)


def apart(one, other):
    """Return the angle between two rotations (rad), which must be small."""
    one, other = np.array(one), np.array(other)
    return 2.0 * min(np.linalg.norm(one - other), np.linalg.norm(one + other))


def locks(axes):
    """Return the middle angles at gimbal lock (rad)."""
    return [0.0, math.pi, -math.pi] if axes[1] == axes[3] else [math.pi / 2, -math.pi / 2]


def check_round_trip(quaternion, axes):
    """
    Assert that the Euler angles of a unit quaternion make the same rotation, to rounding.

    :returns: the angles.
    """
    found = euler_from_quaternion(quaternion, axes)
    assert apart(composed(found, axes), quaternion) < 1e-14
    assert apart(quaternion_from_euler(*found, axes), quaternion) < 1e-14
    check_form(found, axes)
    return found


def check_form(found, axes):
    """Assert that three angles are Python floats in their ranges, none of them -0."""
    assert [type(angle) for angle in found] == [float] * 3
    assert all(angle or math.copysign(1.0, angle) == 1.0 for angle in found)
    assert all(-math.pi < angle <= math.pi for angle in (found[0], found[2]))
    if axes[1] != axes[3]:
        assert abs(found[1]) <= math.pi / 2
    elif axes[1:3] in ('xy', 'yz', 'zx'):
        assert 0.0 <= found[1] <= math.pi
    else:
        assert -math.pi <= found[1] <= 0.0


@given(conventions, st.tuples(angles, angles, angles))
def test_euler_angles_are_three_turns(axes, three):
    """The result is the product of three rotations, whose angles are found again."""
    quaternion = from_angles(three, axes)
    assert [type(number) for number in quaternion] == [float] * 4
    assert apart(quaternion, composed(three, axes)) < 1e-14
    check_round_trip(composed(three, axes), axes)


def test_conventions_as_codes():
    """A code is the first axis, parity, repetition and frame, as in transforms3d."""
    for code in product(range(3), range(2), range(2), range(2)):
        quaternion = quaternion_from_euler(1.0, 2.0, 3.0, code)
        expected = euler.euler2mat(1.0, 2.0, 3.0, code)
        assert np.allclose(turned(quaternion), expected, rtol=0, atol=1e-14)
        found = euler_from_quaternion(quaternion, code)
        assert np.allclose(euler.euler2mat(*found, code), expected, rtol=0, atol=1e-14)


def test_names_of_conventions_in_capitals():
    """Capitals are accepted, as by transforms3d; the default is 'sxyz': roll, pitch, yaw."""
    assert quaternion_from_euler(1, 2, 3, 'RZYX') == quaternion_from_euler(1, 2, 3, 'rzyx')
    assert quaternion_from_euler(1, 2, 3) == quaternion_from_euler(1, 2, 3, 'sxyz')
    assert euler_from_quaternion((1, 2, 3, 4)) == euler_from_quaternion((1, 2, 3, 4), 'sxyz')


@given(st.data(), angles, angles)
def test_at_gimbal_lock_the_last_angle_is_zero(data, first, last):
    """About rotating axes, it is the first angle that is zero."""
    for axes in CONVENTIONS:
        middle = data.draw(st.sampled_from(locks(axes)))
        for make in composed, from_angles:
            found = check_round_trip(make((first, middle, last), axes), axes)
            assert found[2 if axes[0] == 's' else 0] == 0.0


@given(angles, angles, st.floats(-16.0, -6.0), st.sampled_from([1.0, -1.0]))
def test_near_gimbal_lock(first, last, exponent, sign):
    """The angles are accurate even where a matrix can no longer tell them apart."""
    for axes in CONVENTIONS:
        for middle in locks(axes):
            three = first, middle + sign * 10.0 ** exponent, last
            check_round_trip(composed(three, axes), axes)


@given(conventions, units, st.floats(1e-3, 1e3))
def test_both_signs_and_any_length_are_the_same(axes, quaternion, length):
    """The angles and the matrix depend neither on the sign nor on the length."""
    found = euler_from_quaternion(quaternion, axes)
    assert euler_from_quaternion(np.negative(quaternion), axes) == found
    assert np.array_equal(quaternion_matrix(np.negative(quaternion)),
                          quaternion_matrix(quaternion))
    longer = np.multiply(length, quaternion)
    assert apart(composed(euler_from_quaternion(longer, axes), axes),
                 quaternion) < 1e-14
    assert np.allclose(quaternion_matrix(longer), quaternion_matrix(quaternion),
                       rtol=0, atol=1e-14)


@pytest.mark.parametrize('length', [1e-300, 1e-200, 1e-9, 1e9, 1e200, 1e307])
def test_lengths_that_have_no_square(length):
    """Normalising does not square lengths that would underflow or overflow."""
    unit = 0.5, -0.5, 0.5, 0.5
    quaternion = np.multiply(length, unit)
    assert np.allclose(quaternion_matrix(quaternion)[:3, :3], turned(unit), rtol=0, atol=1e-15)
    assert apart(composed(euler_from_quaternion(quaternion), 'sxyz'), unit) < 1e-15
    assert quaternion_about_axis(math.pi / 2, (0, length, 0)) == pytest.approx((0, HALF, 0, HALF))
    assert quaternion_slerp(quaternion, quaternion, 0.5) == pytest.approx(unit)


@given(angles, axes_of_turns, st.floats(1e-3, 1e3))
def test_about_an_axis(angle, axis, length):
    """The axis may have any length; the result agrees with Rodrigues' formula."""
    cross = np.cross(np.eye(3), axis)
    expected = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    quaternion = quaternion_about_axis(angle, length * axis)
    assert [type(number) for number in quaternion] == [float] * 4
    assert np.allclose(turned(quaternion), expected, rtol=0, atol=1e-14)


@given(units, st.tuples(numbers, numbers, numbers))
@example((1e-9, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
@example((0.0, 0.6, 0.8, 0.0), (0.0, 0.0, 0.0))
def test_matrices_there_and_back(quaternion, translation):
    """Matrices of shape (3, 3) and (4, 4) are accepted, and the translation is ignored."""
    matrix = quaternion_matrix(quaternion)
    assert np.allclose(matrix[:3, :3], turned(quaternion), rtol=0, atol=1e-14)
    assert np.array_equal(matrix[3], (0, 0, 0, 1))
    assert np.array_equal(matrix[:, 3], (0, 0, 0, 1))
    matrix[:3, 3] = translation
    found = quaternion_from_matrix(matrix)
    assert [type(number) for number in found] == [float] * 4
    assert found[3] >= 0.0
    assert apart(found, quaternion) < 1e-14
    assert apart(quaternion_from_matrix(turned(quaternion).tolist()), quaternion) < 1e-14


@given(quaternions, quaternions)
@example((0.0, 0.0, 0.0, 0.0), (1.0, 2.0, 3.0, 4.0))
def test_products_and_conjugates_of_any_length(left, right):
    """They do not normalise, and accept zeros."""
    assert quaternion_multiply(left, right) == pytest.approx(hamilton(left, right), abs=1e-12)
    x, y, z, w = left
    assert quaternion_conjugate(np.array(left)) == (-x, -y, -z, w)


@given(units, st.floats(-150.0, 150.0))
def test_inverses_of_any_length(quaternion, exponent):
    """The product with the inverse is (0, 0, 0, 1), not a multiple of it."""
    quaternion = np.multiply(10.0 ** exponent, quaternion)
    found = quaternion_inverse(quaternion)
    assert [type(number) for number in found] == [float] * 4
    assert hamilton(quaternion, found) == pytest.approx(UNIT, abs=1e-14)
    assert hamilton(found, quaternion) == pytest.approx(UNIT, abs=1e-14)


halves = st.floats(0.0, math.pi / 2 - 1e-6) | st.floats(-16.0, -6.0).map(lambda e: 10.0 ** e)


@given(units, axes_of_turns, halves, st.floats(-0.5, 1.5), st.sampled_from([1.0, -1.0]))
@example((0.0, 0.0, 0.0, 1.0), np.array([1.0, 0.0, 0.0]), 0.5e-9, 0.25, 1.0)
def test_slerp_turns_evenly_the_short_way(begin, axis, half, fraction, sign):
    """The angle about one axis is proportional to the fraction, whatever the signs are."""
    end = sign * hamilton(about(2 * half, axis), begin)
    found = quaternion_slerp(begin, end, fraction)
    assert [type(number) for number in found] == [float] * 4
    assert apart(found, hamilton(about(2 * half * fraction, axis), begin)) < 1e-14
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-15)


@given(units, units)
def test_slerp_at_its_ends(begin, end):
    """The result equals the begin or the end to the last bit."""
    for kwargs in {}, {'shortestpath': False}, {'spin': 1}:
        assert quaternion_slerp(begin, end, 0.0, **kwargs) == begin
        assert quaternion_slerp(begin, end, 1, **kwargs) == end
    assert quaternion_slerp(begin, np.multiply(4.0, end), 1.0) == pytest.approx(end, abs=1e-15)


@given(units, axes_of_turns, st.floats(1e-3, math.pi - 1e-3), st.floats(-0.5, 1.5),
       st.integers(-2, 2))
def test_slerp_without_shortestpath(begin, axis, half, fraction, spin):
    """The signs decide which way is taken, and spin adds whole turns."""
    assume(fraction not in (0.0, 1.0))
    end = hamilton(about(2 * half, axis), begin)
    found = quaternion_slerp(begin, end, fraction, spin, False)
    expected = hamilton(about((2 * half + spin * math.tau) * fraction, axis), begin)
    assert found == pytest.approx(expected, abs=1e-11)
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-14)


def test_slerp_from_a_rotation_to_itself():
    """The rotation stays as it is for either sign, since there is no axis."""
    begin = (0.5, -0.5, 0.5, 0.5)
    for end in begin, np.negative(begin), np.multiply(1 + 2e-16, begin):
        for fraction, spin, shortestpath in product((0.3, 0.5), (0, 1), (True, False)):
            assert quaternion_slerp(begin, end, fraction, spin, shortestpath) == begin


NO_NUMBERS = 'a quaternion must be four finite numbers x, y, z, w, got '
NO_LENGTH = (r'a quaternion must have a finite length that is not zero; the identity is '
             r'\(0, 0, 0, 1\), got ')
WITH_ROTATIONS: list[Callable[..., object]] = [
    euler_from_quaternion, quaternion_matrix, quaternion_inverse,
    lambda q: quaternion_slerp(q, UNIT, 0.5), lambda q: quaternion_slerp(UNIT, q, 0.0)]
WITH_QUATERNIONS = [
    *WITH_ROTATIONS, quaternion_conjugate, lambda q: quaternion_multiply(q, UNIT),
    lambda q: quaternion_multiply(UNIT, q)]


@pytest.mark.parametrize(('quaternion', 'given'), [
    ((0, 0, 1), r'\(0, 0, 1\)$'), ([0, 0, 0, 0, 1], r'\[0, 0, 0, 0, 1\]$'),
    ((0, 0, math.nan, 1), r'\(0, 0, nan, 1\)$'), ('xyzw', "'xyzw'$"), (None, 'None$'),
    (np.full((4, 4), math.pi), r'array\(\[\[3.14159265, 3.14159265, 3.14159265, 3.14159265\], ')])
def test_no_quaternion(quaternion, given):
    """A quaternion has four finite elements; the error shows anything else."""
    for function in WITH_QUATERNIONS:
        with pytest.raises(ValueError, match=NO_NUMBERS + given) as error:
            function(quaternion)
        assert '\n' not in str(error.value)


@pytest.mark.parametrize('function', WITH_ROTATIONS)
def test_no_rotation(function):
    """A quaternion whose length is zero, infinite or too small is not a rotation."""
    with pytest.raises(ValueError, match=NO_LENGTH + r'\(0.0, 0.0, 0.0, 0.0\) of length 0$'):
        function((0, 0, 0, 0))
    with pytest.raises(ValueError, match=NO_LENGTH + r'.* of length inf$'):
        function((1.7e308, 1.7e308, 1.7e308, 0))
    with pytest.raises(ValueError, match=NO_LENGTH + r'.* of length 1e-320$'):
        function((1e-320, 0, 0, 0))


@pytest.mark.parametrize('axis', [
    (0, 0, 0), (0, 0), (0, 0, 0, 1), (0, math.nan, 1), (0, math.inf, 1), 3])
def test_no_axis(axis):
    """An axis has three finite elements, of which at least one is not zero."""
    with pytest.raises(ValueError, match='an axis must be three finite numbers x, y, z, not all '
                                         r'zero, got [\(3]'):
        quaternion_about_axis(1.0, axis)


@pytest.mark.parametrize(('function', 'arguments', 'error'), [
    (quaternion_from_euler, (0.5, math.nan, 1), r'Euler angles must .* got \(0.5, nan, 1'),
    (quaternion_about_axis, (math.inf, (0, 0, 1)), r'an angle must be a finite .* got \(inf,\)'),
    (quaternion_slerp, (UNIT, UNIT, 0.5, math.nan), r'fraction and spin must be .* \(0.5, nan\)')])
def test_angles_and_fractions_are_finite(function, arguments, error):
    """Numbers that are not finite are shown in the error."""
    with pytest.raises(ValueError, match=error):
        function(*arguments)


@pytest.mark.parametrize('axes', ['xyz', 'sxxy', 'txyz', '', (0, 0, 0, 2), [0, 0, 0, 0], None])
def test_no_axes_convention(axes):
    """The error describes the form of a convention and gives examples."""
    with pytest.raises(ValueError, match=(
            r"axes must be 's' .* or 'r' .* and three of x, y, z,"
            r".* such as 'sxyz', 'rzyx' or 'szxz'")) as error:
        euler_from_quaternion(UNIT, axes)
    assert str(error.value).endswith(f'; got {axes!r}')


@pytest.mark.parametrize(('matrix', 'message'), [
    (np.eye(2), r'of shape \(3, 3\) or \(4, 4\), got \(2, 2\)$'),
    (np.diag([1, 1, -1]), r'unit vectors at right angles.* got \[\[1.0.*determinant -1$'),
    (-np.eye(4), r'the last row of a \(4, 4\) matrix must be 0, 0, 0, 1, got \[-0.0, '),
    (np.diag([1, 1, 1, math.nan]), r'must be 0, 0, 0, 1, got \[0.0, 0.0, 0.0, nan\]$'),
    (1.01 * np.eye(3), 'unit vectors at right angles.* error 0.02, determinant 1.03$'),
    ([[1, 0.01, 0], [0, 1, 0], [0, 0, 1]], 'unit vectors.* error 0.01, determinant 1$'),
    (np.diag([1, math.nan, 1]), 'unit vectors.* error nan, determinant nan$'),
    (np.full((3, 3), 1e200), 'unit vectors.* error inf, determinant')])
def test_no_rotation_matrix(matrix, message):
    """A matrix that has another shape, mirrors, scales, shears or is not finite is refused."""
    with pytest.raises(ValueError, match=message) as error:
        quaternion_from_matrix(matrix)
    assert '\n' not in str(error.value)


def test_transforms_take_any_numbers():
    """Transform does not check them: zeros do not rotate, and NaN stays NaN."""
    still = Transform(0, 'a', 'b', (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 0.0))
    assert np.array_equal(still.matrix()[:3, :3], np.eye(3))
    unknown = Transform(0, 'b', 'c', rotation=(math.nan,) * 4)
    assert np.isnan((still @ unknown).rotation).all()
    assert np.isnan(unknown.inverse().rotation).all()
