"""
The names of tf_transformations, from transforms3d and numpy.

Quaternions are x, y, z, w, angles are in rad, and matrices are (4, 4) homogeneous matrices, which
transform column vectors (x, y, z, 1). Except where a function says otherwise, a vector or point
has three numbers, and results are float64. ROS is not needed.

The functions of Euler angles and quaternions check their arguments as `puretf.rotations`
does, but a quaternion of length zero is no rotation. `quaternion_slerp` and the functions that
only computer graphics needs (projections, clipping, the virtual trackball) call the module of
C. Gohlke from which all of these names come, and of which transforms3d contains a copy.
"""

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray
from transforms3d import _gohlketransforms, affines, axangles, euler, reflections, shears, zooms

from puretf import rotations
from puretf.rotations import Axes, Quaternion
from puretf.rotations import quaternion_about_axis as quaternion_about_axis
from puretf.rotations import quaternion_from_euler as quaternion_from_euler
from puretf.rotations import quaternion_multiply as quaternion_multiply

__all__ = ['ROTATION_IDENTITY', 'SHEAR_IDENTITY', 'TRANSLATION_IDENTITY', 'ZOOM_IDENTITY',
           'Arcball', 'arcball_constrain_to_axis', 'arcball_map_to_sphere', 'arcball_nearest_axis',
           'clip_matrix', 'compose_matrix', 'concatenate_matrices', 'decompose_matrix',
           'euler_from_matrix', 'euler_from_quaternion', 'euler_matrix', 'identity_matrix',
           'inverse_matrix', 'is_same_transform', 'orthogonalization_matrix',
           'projection_from_matrix', 'projection_matrix', 'quaternion_about_axis',
           'quaternion_conjugate', 'quaternion_from_euler', 'quaternion_from_matrix',
           'quaternion_inverse', 'quaternion_matrix', 'quaternion_multiply', 'quaternion_slerp',
           'random_quaternion', 'random_rotation_matrix', 'random_vector',
           'reflection_from_matrix', 'reflection_matrix', 'rotation_from_matrix',
           'rotation_matrix', 'scale_from_matrix', 'scale_matrix', 'shear_from_matrix',
           'shear_matrix', 'superimposition_matrix', 'translation_from_matrix',
           'translation_matrix', 'unit_vector', 'vector_norm']

Array = NDArray[np.float64]

TRANSLATION_IDENTITY = [0.0, 0.0, 0.0]
ROTATION_IDENTITY = np.identity(3)
ZOOM_IDENTITY = [1.0, 1.0, 1.0]
SHEAR_IDENTITY = TRANSLATION_IDENTITY


# Matrices


def identity_matrix() -> Array:
    """Return the identity."""
    return np.identity(4)


def inverse_matrix(matrix: ArrayLike) -> Array:
    """
    Return the inverse of a square matrix.

    :param matrix: (n, n).
    :returns: (n, n).
    :raises numpy.linalg.LinAlgError: if the matrix has no inverse.
    """
    return np.linalg.inv(np.asarray(matrix, np.float64))


def concatenate_matrices(*matrices: ArrayLike) -> Array:
    """
    Return the product of matrices.

    :param matrices: (4, 4) each; the last one is applied first.
    :returns: (4, 4); the identity if there are no matrices.
    """
    return reduce(np.matmul, matrices, np.identity(4))


def is_same_transform(matrix0: ArrayLike, matrix1: ArrayLike) -> bool:
    """
    Return True if two matrices are the same transform.

    :returns: whether they are equal up to rounding, when each is divided by its last element.
    """
    first, second = np.asarray(matrix0, np.float64), np.asarray(matrix1, np.float64)
    return bool(np.allclose(first / first[3, 3], second / second[3, 3]))


def translation_matrix(direction: ArrayLike) -> Array:
    """
    Return the matrix of a translation.

    :param direction: the translation x, y, z.
    """
    return np.asarray(affines.compose(_vector(direction), ROTATION_IDENTITY, ZOOM_IDENTITY))


def translation_from_matrix(matrix: ArrayLike) -> Array:
    """
    Return the translation of a matrix.

    :returns: (3,).
    """
    return np.array(matrix, np.float64)[:3, 3]


def rotation_matrix(angle: float, direction: ArrayLike, point: Optional[ArrayLike] = None
                    ) -> Array:
    """
    Return the matrix of a rotation about an axis.

    :param angle: the angle.
    :param direction: the direction of the axis; of any length except zero.
    :param point: a point on the axis; None: the origin.
    """
    return np.asarray(axangles.axangle2aff(
        _vector(direction), angle, None if point is None else _vector(point)))


def rotation_from_matrix(matrix: ArrayLike) -> tuple[float, Array, Array]:
    """
    Return the angle and the axis of a rotation; the inverse of `rotation_matrix`.

    :returns: the angle; (3,): the unit vector of the axis; (4,): a point x, y, z, 1 on it.
    :raises ValueError: if the matrix is not a rotation about an axis.
    """
    direction, angle, point = axangles.aff2axangle(np.asarray(matrix, np.float64))
    return angle, direction, point


def reflection_matrix(point: ArrayLike, normal: ArrayLike) -> Array:
    """
    Return the matrix of a reflection at a plane.

    :param point: a point on the plane.
    :param normal: the normal of the plane; of any length except zero.
    """
    return np.asarray(reflections.rfnorm2aff(_vector(normal), _vector(point)))


def reflection_from_matrix(matrix: ArrayLike) -> tuple[Array, Array]:
    """
    Return the plane of a reflection; the inverse of `reflection_matrix`.

    :returns: (4,): a point x, y, z, 1 on the plane; (3,): its unit normal.
    :raises ValueError: if the matrix is not a reflection.
    """
    normal, point = reflections.aff2rfnorm(np.asarray(matrix, np.float64))
    return point, normal


def scale_matrix(factor: float, origin: Optional[ArrayLike] = None,
                 direction: Optional[ArrayLike] = None) -> Array:
    """
    Return the matrix that scales by a factor.

    :param factor: the factor.
    :param origin: the point that stays where it is; None: the origin.
    :param direction: the direction in which to scale, of any length except zero; None: all.
    """
    return np.asarray(zooms.zfdir2aff(
        factor, None if direction is None else _vector(direction),
        None if origin is None else _vector(origin)))


def scale_from_matrix(matrix: ArrayLike) -> tuple[float, Array, Optional[Array]]:
    """
    Return the arguments of `scale_matrix`.

    :returns: the factor; (4,): the point x, y, z, 1 that stays where it is; (3,): the unit vector
        of the direction, or None if all directions are scaled.
    :raises ValueError: if the matrix does not scale.
    """
    factor, direction, origin = zooms.aff2zfdir(np.asarray(matrix, np.float64))
    return factor, origin, direction


def shear_matrix(angle: float, direction: ArrayLike, point: ArrayLike, normal: ArrayLike) -> Array:
    """
    Return the matrix of a shear.

    :param angle: the angle between a point that is one unit above the plane, its projection onto
        the plane and its image.
    :param direction: the direction in which points move, perpendicular to the normal; of any
        length except zero.
    :param point: a point on the plane whose points stay where they are.
    :param normal: the normal of the plane; of any length except zero.
    :raises ValueError: if the direction is not perpendicular to the normal.
    """
    return np.asarray(shears.sadn2aff(
        angle, _vector(direction), _vector(normal), _vector(point)))


def shear_from_matrix(matrix: ArrayLike) -> tuple[float, Array, Array, Array]:
    """
    Return the arguments of `shear_matrix`.

    :returns: the angle; (3,): the unit vector of the direction; (4,): a point x, y, z, 1 on the
        plane; (3,): the unit normal of the plane.
    :raises ValueError: if the matrix is not a shear.
    """
    angle, direction, normal, point = shears.aff2sadn(np.asarray(matrix, np.float64))
    return angle, direction, point, normal


def compose_matrix(scale: Optional[ArrayLike] = None, shear: Optional[ArrayLike] = None,
                   angles: Optional[Sequence[float]] = None, translate: Optional[ArrayLike] = None,
                   perspective: Optional[ArrayLike] = None) -> Array:
    """
    Return the matrix that shears, scales, rotates, translates and projects, in this order.

    :param scale: the factors along x, y and z; None: 1, 1, 1.
    :param shear: the shears x-y, x-z, y-z; None: 0, 0, 0.
    :param angles: the angles about the static axes x, y and z; None: 0, 0, 0.
    :param translate: the translation x, y, z; None: 0, 0, 0.
    :param perspective: (4,): the last row of a projection; None: 0, 0, 0, 1.
    """
    result = np.asarray(affines.compose(
        _vector(TRANSLATION_IDENTITY if translate is None else translate),
        ROTATION_IDENTITY if angles is None else euler.euler2mat(*angles),
        _vector(ZOOM_IDENTITY if scale is None else scale),
        _vector(SHEAR_IDENTITY if shear is None else shear)))
    if perspective is not None:
        result[3] = np.asarray(perspective, np.float64) @ result
    return result


def decompose_matrix(matrix: ArrayLike
                     ) -> tuple[Array, Array, tuple[float, float, float], Array, Optional[Array]]:
    """
    Return the arguments of `compose_matrix`.

    :returns: (3,): the factors along x, y and z; (3,): the shears x-y, x-z, y-z; the angles about
        the static axes x, y and z; (3,): the translation; (4,): the perspective, or None if the
        last row of the matrix is 0, 0, 0, 1.
    :raises ValueError: if the matrix has a determinant of zero.
    """
    affine = np.array(matrix, np.float64)
    perspective = None
    if not np.allclose(affine[3], (0.0, 0.0, 0.0, 1.0)):
        last_row, affine[3] = affine[3].copy(), (0.0, 0.0, 0.0, 1.0)
        try:
            perspective = last_row @ np.linalg.inv(affine)
        except np.linalg.LinAlgError:
            raise ValueError(f'the matrix has no inverse: {affine.tolist()}') from None
    translation, rotation, factors, shear = affines.decompose44(affine)
    return factors, shear, euler.mat2euler(rotation), translation, perspective


# Euler angles and quaternions


def euler_matrix(ai: float, aj: float, ak: float, axes: Axes = 'sxyz') -> Array:
    """
    Return the matrix of a rotation by three Euler angles.

    :param ai: the angle about the first axis.
    :param aj: the angle about the second axis.
    :param ak: the angle about the third axis.
    :param axes: the convention, as in `quaternion_from_euler`.
    :raises ValueError: if an angle is not finite, or the convention does not exist.
    """
    return quaternion_matrix(quaternion_from_euler(ai, aj, ak, axes))


def euler_from_matrix(matrix: ArrayLike, axes: Axes = 'sxyz') -> tuple[float, float, float]:
    """
    Return the Euler angles of a rotation.

    :param matrix: (4, 4) or (3, 3).
    :param axes: the convention, as in `quaternion_from_euler`.
    :returns: the angles about the first, second and third axis.
    :raises ValueError: if the matrix is not a rotation, or the convention does not exist.
    """
    return euler_from_quaternion(quaternion_from_matrix(matrix), axes)


def euler_from_quaternion(quaternion: Iterable[float], axes: Axes = 'sxyz'
                          ) -> tuple[float, float, float]:
    """
    Return the Euler angles of a rotation.

    :param quaternion: x, y, z, w, of any length; of length zero: no rotation.
    :param axes: the convention, as in `quaternion_from_euler`.
    :returns: the angles about the first, second and third axis.
    :raises ValueError: if the quaternion is not finite, or the convention does not exist.
    """
    return rotations.euler_from_quaternion(_rotation(quaternion), axes)


def quaternion_matrix(quaternion: Iterable[float]) -> Array:
    """
    Return the matrix of a rotation.

    :param quaternion: x, y, z, w, of any length; of length zero: no rotation.
    :raises ValueError: if the quaternion is not finite.
    """
    return rotations.quaternion_matrix(_rotation(quaternion))


def quaternion_from_matrix(matrix: ArrayLike) -> Quaternion:
    """
    Return the rotation of a matrix.

    :param matrix: (4, 4); its translation, scale and shear are ignored. Or (3, 3): a rotation.
    :returns: the unit quaternion x, y, z, w with w >= 0.
    :raises ValueError: if the matrix does not contain a rotation.
    """
    given = np.asarray(matrix, np.float64)
    return rotations.quaternion_from_matrix(
        affines.decompose44(given)[1] if given.shape == (4, 4) else given)


def quaternion_conjugate(quaternion: Iterable[float]) -> Array:
    """
    Return a quaternion with the signs of x, y, z changed.

    :param quaternion: x, y, z, w; of any length.
    :returns: (4,): x, y, z, w.
    """
    return np.array(rotations.quaternion_conjugate(quaternion))


def quaternion_inverse(quaternion: Iterable[float]) -> Array:
    """
    Return the inverse of a quaternion: the product of both is (0, 0, 0, 1).

    :param quaternion: x, y, z, w; of any length except zero.
    :returns: (4,): x, y, z, w.
    :raises ValueError: if the quaternion has length zero.
    """
    return np.array(rotations.quaternion_inverse(quaternion))


def quaternion_slerp(quat0: Iterable[float], quat1: Iterable[float], fraction: float,
                     spin: int = 0, shortestpath: bool = True) -> Array:
    """
    Interpolate between two rotations (slerp), with the results of the real package.

    :param quat0: x, y, z, w of the first rotation.
    :param quat1: x, y, z, w of the second rotation.
    :param fraction: from 0 (`quat0`) to 1 (`quat1`); other values extrapolate.
    :param spin: the number of half turns of the quaternion that are added on the way.
    :param shortestpath: whether to take the shorter way.
    :returns: (4,): x, y, z, w; of length 1 if `spin` is even.
    :raises ValueError: if a quaternion has length zero.
    """
    ends = [*quat0], [*quat1]
    rotations.quaternion_slerp(*ends, 0.0)  # checks them
    return np.asarray(_gohlketransforms.quaternion_slerp(*ends, fraction, spin, shortestpath))


def random_quaternion(rand: Optional[Sequence[float]] = None) -> Array:
    """
    Return a random rotation; all rotations are equally likely.

    K. Shoemake, Uniform Random Rotations, Graphics Gems III (1992).

    :param rand: three independent random numbers from 0 to 1; None: new ones.
    :returns: (4,): the unit quaternion x, y, z, w.
    """
    return np.roll(_gohlketransforms.random_quaternion(rand), -1)


def random_rotation_matrix(rand: Optional[Sequence[float]] = None) -> Array:
    """
    Return a random rotation; all rotations are equally likely.

    :param rand: as in `random_quaternion`.
    """
    return quaternion_matrix(random_quaternion(rand))


# Vectors


def random_vector(size: Union[int, tuple[int, ...]]) -> Array:
    """
    Return random numbers.

    :param size: the shape of the result.
    :returns: an array of that shape, with values from 0 to 1, without 1.
    """
    return np.random.random(size)


def vector_norm(data: ArrayLike, axis: Optional[int] = None, out: Optional[Array] = None) -> Any:
    """
    Return the length (norm) of a vector, or the lengths of many.

    :param data: the vector, or an array of vectors.
    :param axis: the axis along which the elements of a vector are; None: `data` is one vector.
    :param out: an array for the result.
    :returns: the length as a float, if `data` has one axis; else the array of the lengths; None
        if `out` is given.
    """
    return _gohlketransforms.vector_norm(data, axis, out)


def unit_vector(data: ArrayLike, axis: Optional[int] = None, out: Optional[Array] = None) -> Any:
    """
    Return a vector, or many vectors, divided by their lengths.

    :param data: the vector, or an array of vectors.
    :param axis: the axis along which the elements of a vector are; None: `data` is one vector.
    :param out: an array for the result, of the shape of `data`.
    :returns: the array of the shape of `data`; None if `out` is given.
    """
    return _gohlketransforms.unit_vector(
        data if out is data else np.asarray(data, np.float64), axis, out)


# Computer graphics


def projection_matrix(point: ArrayLike, normal: ArrayLike, direction: Optional[ArrayLike] = None,
                      perspective: Optional[ArrayLike] = None, pseudo: bool = False) -> Array:
    """
    Return the matrix of a projection onto a plane.

    :param point: a point on the plane.
    :param normal: the normal of the plane; of any length except zero.
    :param direction: the direction of a parallel projection; None: along the normal, or the
        projection has a perspective.
    :param perspective: the point to which all points are projected; None: a parallel projection.
    :param pseudo: whether a projection with a perspective keeps the relative depth of points.
    """
    return np.asarray(_gohlketransforms.projection_matrix(
        _vector(point), _vector(normal), None if direction is None else _vector(direction),
        None if perspective is None else _vector(perspective), pseudo))


def projection_from_matrix(matrix: ArrayLike, pseudo: bool = False
                           ) -> tuple[Array, Array, Optional[Array], Optional[Array], bool]:
    """
    Return the arguments of `projection_matrix`.

    :param pseudo: whether the projection keeps the relative depth of points.
    :returns: (4,): a point x, y, z, 1 on the plane; (3,): its unit normal; (3,): the direction of
        a parallel projection, or None; (3,): the point of the perspective, or None; `pseudo`.
    :raises ValueError: if the matrix is not a projection.
    """
    result: tuple[Array, Array, Optional[Array], Optional[Array], bool] = (
        _gohlketransforms.projection_from_matrix(np.asarray(matrix, np.float64), pseudo))
    return result


def clip_matrix(left: float, right: float, bottom: float, top: float, near: float, far: float,
                perspective: bool = False) -> Array:
    """
    Return the matrix from a view volume to normalised coordinates, which are from -1 to 1.

    :param left: the smallest x of the volume.
    :param right: the largest x.
    :param bottom: the smallest y.
    :param top: the largest y.
    :param near: the smallest z.
    :param far: the largest z.
    :param perspective: whether the volume is a truncated pyramid with its tip at the origin, and
        not a box. The result must then be divided by its fourth coordinate.
    :raises ValueError: if a largest value is not larger than the smallest, or a pyramid begins at
        its tip.
    """
    return np.asarray(_gohlketransforms.clip_matrix(
        left, right, bottom, top, near, far, perspective))


def orthogonalization_matrix(lengths: ArrayLike, angles: ArrayLike) -> Array:
    """
    Return the matrix that makes the coordinates of a crystal cell orthogonal.

    :param lengths: the lengths a, b, c of the edges of the cell.
    :param angles: the angles alpha, beta, gamma between them (degrees).
    """
    return np.asarray(_gohlketransforms.orthogonalization_matrix(
        _vector(lengths), _vector(angles)))


def superimposition_matrix(v0: ArrayLike, v1: ArrayLike, scaling: bool = False,
                           usesvd: bool = True) -> Array:
    """
    Return the matrix that brings points as close as possible to other points.

    The sum of the squared distances is the smallest. See W. Kabsch, A solution for the best
    rotation to relate two sets of vectors, 1976; B. Horn, Closed-form solution of absolute
    orientation using unit quaternions, 1987.

    :param v0: (3, n) or (4, n): the points, one in each column, at least three.
    :param v1: of the same shape: the points to which they are brought.
    :param scaling: whether the matrix also scales.
    :param usesvd: True: the method of Kabsch; False: that of Horn, which is slower.
    """
    first, second = np.asarray(v0, np.float64)[:3], np.asarray(v1, np.float64)[:3]
    return np.asarray(_gohlketransforms.superimposition_matrix(first, second, scaling, usesvd))


class Arcball:
    """
    A virtual trackball: turns the movement of a mouse into a rotation.

    K. Shoemake, ARCBALL: A User Interface for Specifying Three-Dimensional Orientation Using a
    Mouse, 1992.
    """

    def __init__(self, initial: Optional[ArrayLike] = None) -> None:
        """
        Create a trackball.

        :param initial: its rotation: (4,): x, y, z, w; or (4, 4); None: the identity.
        :raises ValueError: if `initial` has another shape.
        """
        if initial is not None and np.shape(initial) == (4,):
            initial = np.roll(np.asarray(initial, np.float64), 1)
        self._ball = _gohlketransforms.Arcball(initial)

    def place(self, center: Sequence[float], radius: float) -> None:
        """
        Place the trackball, for example when the size of its window has changed.

        :param center: x, y of its centre in the window (pixels).
        :param radius: its radius (pixels).
        """
        self._ball.place(center, radius)

    def setaxes(self, *axes: ArrayLike) -> None:
        """
        Set the axes about which it turns while it is constrained.

        :param axes: vectors of any length except zero.
        """
        self._ball.setaxes(*axes)

    def setconstrain(self, constrain: bool) -> None:
        """
        Set whether it turns only about the axes of `setaxes`.

        :param constrain: whether it is constrained.
        """
        self._ball.constrain = constrain

    def getconstrain(self) -> bool:
        """
        Return whether it turns only about the axes of `setaxes`.

        :returns: whether it is constrained.
        """
        return bool(self._ball.constrain)

    def down(self, point: Sequence[float]) -> None:
        """
        Begin to drag, and choose an axis if the trackball is constrained.

        :param point: x, y of the mouse in the window (pixels).
        """
        self._ball.down(point)

    def drag(self, point: Sequence[float]) -> None:
        """
        Turn the trackball.

        :param point: x, y of the mouse in the window (pixels).
        """
        self._ball.drag(point)

    def next(self, acceleration: float = 0.0) -> None:
        """
        Turn the trackball on, in the direction of the last movement.

        :param acceleration: how much faster than the last movement; 0: as fast.
        """
        self._ball.next(acceleration)

    def matrix(self) -> Array:
        """
        Return the rotation of the trackball.

        :returns: (4, 4).
        """
        return np.asarray(self._ball.matrix())


def arcball_map_to_sphere(point: Sequence[float], center: Sequence[float], radius: float
                          ) -> Array:
    """
    Return the point of the unit sphere that is seen at a point of a window.

    :param point: x, y in the window (pixels).
    :param center: x, y of the centre of the sphere in the window (pixels).
    :param radius: the radius of the sphere (pixels).
    :returns: (3,); outside of the sphere: the nearest point of its outline.
    """
    return np.asarray(_gohlketransforms.arcball_map_to_sphere(point, center, radius))


def arcball_constrain_to_axis(point: ArrayLike, axis: ArrayLike) -> Array:
    """
    Return the point of the unit sphere that is perpendicular to an axis and nearest to a point.

    :param point: a point of the unit sphere.
    :param axis: the unit vector of the axis.
    :returns: (3,).
    """
    return np.asarray(_gohlketransforms.arcball_constrain_to_axis(_vector(point), _vector(axis)))


def arcball_nearest_axis(point: ArrayLike, axes: Sequence[ArrayLike]) -> Any:
    """
    Return the axis whose great circle is nearest to a point of the unit sphere.

    :param point: a point of the unit sphere.
    :param axes: the unit vectors of the axes.
    :returns: the element of `axes`; None if there is none.
    """
    return _gohlketransforms.arcball_nearest_axis(_vector(point), axes)


def _rotation(quaternion: Iterable[float]) -> Sequence[float]:
    """Return a quaternion, or the identity if its length is zero, as in transforms3d."""
    given = [*quaternion]
    return given if np.dot(given, given) >= np.finfo(np.float64).eps else (0.0, 0.0, 0.0, 1.0)


def _vector(given: ArrayLike) -> Array:
    """Convert the first three numbers of a vector or a point to an array."""
    return np.array(given, np.float64)[:3]


