"""
The names of tf_transformations, from transforms3d and numpy.

Quaternions are x, y, z, w, angles are in rad, and matrices are (4, 4) homogeneous matrices, which
transform column vectors (x, y, z, 1). Except where a function says otherwise, a vector or point
has three numbers, and results are float64. ROS is not needed.

The functions of Euler angles and quaternions check their arguments as `puretf.rotations`
does, but a quaternion of length zero is no rotation. The others are those of the module of
C. Gohlke from which all of these names come, and of which transforms3d contains a copy.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any, Optional

import numpy as np
from numpy.typing import ArrayLike, NDArray
from transforms3d import _gohlketransforms, affines, euler

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


def _with_arrays(function: Callable[..., Any]) -> Callable[..., Any]:
    """Convert the arguments to arrays of float64: numpy 2 does not convert lists there."""
    def convert(value: Any) -> Any:
        is_array = isinstance(value, (list, tuple, np.ndarray))
        return np.asarray(value, np.float64) if is_array else value

    @wraps(function)
    def converted(*args: Any, **kwargs: Any) -> Any:
        return function(*map(convert, args), **{
            name: convert(value) for name, value in kwargs.items()})
    return converted


identity_matrix = _gohlketransforms.identity_matrix
inverse_matrix = _gohlketransforms.inverse_matrix
concatenate_matrices = _gohlketransforms.concatenate_matrices
is_same_transform = _gohlketransforms.is_same_transform
translation_matrix = _gohlketransforms.translation_matrix
clip_matrix = _gohlketransforms.clip_matrix
orthogonalization_matrix = _gohlketransforms.orthogonalization_matrix
random_rotation_matrix = _gohlketransforms.random_rotation_matrix
random_vector = _gohlketransforms.random_vector
vector_norm = _gohlketransforms.vector_norm
arcball_map_to_sphere = _gohlketransforms.arcball_map_to_sphere
arcball_constrain_to_axis = _gohlketransforms.arcball_constrain_to_axis
translation_from_matrix = _with_arrays(_gohlketransforms.translation_from_matrix)
rotation_matrix = _with_arrays(_gohlketransforms.rotation_matrix)
rotation_from_matrix = _with_arrays(_gohlketransforms.rotation_from_matrix)
reflection_matrix = _with_arrays(_gohlketransforms.reflection_matrix)
reflection_from_matrix = _with_arrays(_gohlketransforms.reflection_from_matrix)
scale_matrix = _with_arrays(_gohlketransforms.scale_matrix)
scale_from_matrix = _with_arrays(_gohlketransforms.scale_from_matrix)
shear_matrix = _with_arrays(_gohlketransforms.shear_matrix)
shear_from_matrix = _with_arrays(_gohlketransforms.shear_from_matrix)
projection_matrix = _with_arrays(_gohlketransforms.projection_matrix)
projection_from_matrix = _with_arrays(_gohlketransforms.projection_from_matrix)
unit_vector = _with_arrays(_gohlketransforms.unit_vector)


def compose_matrix(scale: 'ArrayLike | None' = None, shear: 'ArrayLike | None' = None,
                   angles: Optional[Sequence[float]] = None, translate: 'ArrayLike | None' = None,
                   perspective: 'ArrayLike | None' = None) -> Array:
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


def decompose_matrix(matrix: 'ArrayLike'
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


def superimposition_matrix(v0: 'ArrayLike', v1: 'ArrayLike', scaling: bool = False,
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


def euler_from_matrix(matrix: 'ArrayLike', axes: Axes = 'sxyz') -> tuple[float, float, float]:
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


def quaternion_from_matrix(matrix: 'ArrayLike') -> Quaternion:
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


class Arcball(_gohlketransforms.Arcball):
    """A virtual trackball: turns the movement of a mouse into a rotation."""

    def __init__(self, initial: Any = None) -> None:
        """Create a trackball with a rotation: (4,): x, y, z, w; or (4, 4); None: the identity."""
        super().__init__(np.roll(initial, 1) if np.size(initial) == 4 else initial)

    def setconstrain(self, constrain: bool) -> None:
        """Set whether it turns only about the axes of `setaxes`."""
        self.constrain = constrain

    def getconstrain(self) -> bool:
        """Return whether it turns only about the axes of `setaxes`."""
        return bool(self.constrain)


def arcball_nearest_axis(point: 'ArrayLike', axes: 'Sequence[ArrayLike]') -> Any:
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
