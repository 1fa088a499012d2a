"""
Functions that apply a transform to points, vectors, poses, wrenches, paths and point clouds.

Names and results are those of tf2_geometry_msgs and tf2_sensor_msgs. The data are in the child
frame of the transform; their header is ignored. The result is in the parent frame of the
transform, and has the header of the transform. Coordinates are in m.

The Python packages of tf2 have no functions for PoseArray, QuaternionStamped, WrenchStamped, Path
and Odometry. That of a wrench returns what tf2 returns in C++; that of a quaternion returns the
same rotation, normalised.

This module needs ROS. Without it, `Transform.apply` transforms points.
"""

# Before the packages of ROS, to say how to install them.
from puretf.point_cloud2 import points_in

# isort: split
from array import array
from collections.abc import Callable
from copy import copy, deepcopy
from functools import wraps
from typing import Any, cast, TypeVar, Union

from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    Transform,
    TransformStamped,
    Vector3,
    Vector3Stamped,
    Wrench,
    WrenchStamped,
)
from nav_msgs.msg import Odometry, Path
import numpy as np
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from puretf import rotations
from puretf._core.pose import compose, normalized
from puretf._core.pose import Pose as FramePose
from puretf._text.names import comma_list, quoted
from puretf.exceptions import described, is_of_rosbags
from puretf.transform import Transform as OurTransform

_IDENTITY = (0.0, 0.0, 0.0, 1.0)
_NORMAL = 'normal_x', 'normal_y', 'normal_z'


def to_msg_msg(msg: Any) -> Any:
    """Return the message itself: a message needs no conversion to a message."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """Return the message itself: a message needs no conversion from a message."""
    return msg


_Function = TypeVar('_Function', bound=Callable[..., Any])
#: The function for each type; `BufferInterface.transform` takes those that have a header.
functions: dict[type, Callable[..., Any]] = {}


def _takes(kind: type) -> Callable[[_Function], _Function]:
    """Decorate the function that transforms a type; its errors say what it takes."""
    def decorate(function: _Function) -> _Function:
        @wraps(function)
        def checked(*args: Any, **kwargs: Any) -> Any:
            try:
                return function(*args, **kwargs)
            except AttributeError as error:
                types: list[Any] = [type(each) for each in (*args, *kwargs.values())]
                if types == [kind, TransformStamped]:
                    raise
                other = functions.get(types[0], checked)
                use = '' if other is checked else f': use {other.__name__}'
                names = ' and a '.join(
                    f'message {each.__msgtype__} of rosbags' if is_of_rosbags(each) else
                    each.__name__ for each in types)
                article = 'an' if kind.__name__[0] in 'AEIOU' else 'a'
                raise AttributeError(
                    f'{error}. {function.__name__} takes {article} {kind.__name__} and a '
                    f'TransformStamped, got a {names}{use}') from None
        functions[kind] = checked
        return cast(_Function, checked)
    return decorate


@_takes(PointStamped)
def do_transform_point(point: PointStamped, transform: TransformStamped) -> PointStamped:
    """Transform a point."""
    point_there = Point(**_moved(point.point, _pose_of(transform)))
    return PointStamped(header=_header(transform), point=point_there)


@_takes(Vector3Stamped)
def do_transform_vector3(vector3: Vector3Stamped, transform: TransformStamped) -> Vector3Stamped:
    """Rotate a vector; the translation of the transform does not apply to vectors."""
    return Vector3Stamped(header=_header(transform), vector=_rotated(vector3.vector, transform))


@_takes(QuaternionStamped)
def do_transform_quaternion_stamped(quaternion: QuaternionStamped, transform: TransformStamped
                                    ) -> QuaternionStamped:
    """Rotate an orientation; the quaternion of the result has w >= 0."""
    pose = do_transform_pose(Pose(orientation=quaternion.quaternion), transform)
    return QuaternionStamped(header=_header(transform), quaternion=pose.orientation)


@_takes(WrenchStamped)
def do_transform_wrench_stamped(wrench: WrenchStamped, transform: TransformStamped
                                ) -> WrenchStamped:
    """
    Transform a force (N) and a torque (N m), as tf2 does in C++.

    Both are rotated. The given torque is the one about the origin of the child frame. In the
    result, it is the one about the origin of the parent frame: the cross product of the
    translation and the rotated force is added.
    """
    force = _rotated(wrench.wrench.force, transform)
    torque = _rotated(wrench.wrench.torque, transform)
    arm = transform.transform.translation
    torque.x += arm.y * force.z - arm.z * force.y
    torque.y += arm.z * force.x - arm.x * force.z
    torque.z += arm.x * force.y - arm.y * force.x
    return WrenchStamped(header=_header(transform), wrench=Wrench(force=force, torque=torque))


@_takes(Pose)
def do_transform_pose(pose: Pose, transform: TransformStamped) -> Pose:
    """Transform a pose; the quaternion of the result has w >= 0."""
    x, y, z, *rotation = compose(_pose_of(transform), _pose(pose.position, pose.orientation))
    qx, qy, qz, qw = rotation if rotation[3] >= 0.0 else [-number for number in rotation]
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


@_takes(PoseStamped)
def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """Transform a stamped pose; the quaternion of the result has w >= 0."""
    return PoseStamped(header=_header(transform), pose=do_transform_pose(pose.pose, transform))


@_takes(PoseWithCovarianceStamped)
def do_transform_pose_with_covariance_stamped(
        pose: PoseWithCovarianceStamped, transform: TransformStamped
        ) -> PoseWithCovarianceStamped:
    """Transform a pose and its covariance."""
    return PoseWithCovarianceStamped(
        header=_header(transform), pose=_with_covariance(pose.pose, transform))


def _with_covariance(pose: PoseWithCovariance, transform: TransformStamped) -> PoseWithCovariance:
    return PoseWithCovariance(pose=do_transform_pose(pose.pose, transform),
                              covariance=transform_covariance(pose.covariance, transform))


@_takes(PoseArray)
def do_transform_pose_array(poses: PoseArray, transform: TransformStamped) -> PoseArray:
    """Transform each pose; the quaternions of the result have w >= 0."""
    return PoseArray(header=_header(transform), poses=[
        do_transform_pose(pose, transform) for pose in poses.poses])


@_takes(Path)
def do_transform_path(path: Path, transform: TransformStamped) -> Path:
    """
    Transform each pose of a path by the same transform; each pose keeps its own stamp.

    :raises ValueError: if a pose has another frame than the path; an empty name is none.
    """
    result = Path(header=_header(transform))
    frames = {path.header.frame_id, *(pose.header.frame_id for pose in path.poses)} - {''}
    if len(frames) > 1:
        raise ValueError('the path and its poses have several frames, '
                         f'{comma_list(sorted(frames), quoted)}: transform each pose by '
                         'do_transform_pose_stamped')
    result.poses = [do_transform_pose_stamped(pose, transform) for pose in path.poses]
    for pose, given in zip(result.poses, path.poses):
        pose.header.stamp = copy(given.header.stamp)
    return result


@_takes(Odometry)
def do_transform_odometry(odometry: Odometry, transform: TransformStamped) -> Odometry:
    """
    Transform the pose of the robot, and the covariance of the pose.

    The twist remains as it is: it is given in the axes of the `child_frame_id`, the frame of the
    robot, which is the same in the result.
    """
    return Odometry(
        header=_header(transform), child_frame_id=odometry.child_frame_id,
        pose=_with_covariance(odometry.pose, transform), twist=deepcopy(odometry.twist))


@_takes(PolygonStamped)
def do_transform_polygon_stamped(polygon: PolygonStamped, transform: TransformStamped
                                 ) -> PolygonStamped:
    """Transform the points of a polygon."""
    result, pose = PolygonStamped(header=_header(transform)), _pose_of(transform)
    result.polygon.points = [Point32(**_moved(each, pose)) for each in polygon.polygon.points]
    return result


def transform_covariance(cov_in: 'ArrayLike', transform: TransformStamped) -> NDArray[np.float64]:
    """
    Rotate the covariance matrix of a pose.

    The result is R C R^T, where C is the given matrix, and the two blocks of the block-diagonal
    matrix R are the rotation matrix of the transform. See A. Leon-Garcia, Probability, Statistics,
    and Random Processes for Electrical Engineering, 3rd ed., 2008, section 6.3.

    :param cov_in: (36,): the rows of the covariance of x, y, z (m) and of the rotations about the
        x, y and z axes (rad).
    :returns: (36,) float64.
    """
    rotation = np.kron(np.eye(2), rotations.matrix(_rotation(transform.transform.rotation)))
    rotated: NDArray[np.float64] = rotation @ np.reshape(cov_in, (6, 6)) @ rotation.T
    return rotated.reshape(36)


def _header(transform: TransformStamped) -> Header:
    """Return a copy, so that a result does not share the transform's header."""
    if is_of_rosbags(transform):
        raise TypeError(f'expected a TransformStamped, got {described(transform)}: read the bag '
                        'by puretf.bag.read, and apply the transforms that it looks up')
    return Header(stamp=copy(transform.header.stamp), frame_id=transform.header.frame_id)


def _moved(point: Union[Point, Point32, Vector3], pose: FramePose) -> dict[str, float]:
    return dict(zip('xyz', compose(pose, (point.x, point.y, point.z, *_IDENTITY))))


def _rotated(vector: Vector3, transform: TransformStamped) -> Vector3:
    return Vector3(**_moved(vector, (0.0, 0.0, 0.0, *_rotation(transform.transform.rotation))))


def _pose_of(transform: TransformStamped) -> FramePose:
    return _pose(transform.transform.translation, transform.transform.rotation)


def _pose(position: Union[Point, Vector3], orientation: Quaternion) -> FramePose:
    return (position.x, position.y, position.z, *_rotation(orientation))


def _rotation(orientation: Quaternion) -> rotations.Quaternion:
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    if x * x + y * y + z * z + w * w < 2.0 ** -52:  # as in tf2_geometry_msgs
        return _IDENTITY
    return normalized(x, y, z, w)


@_takes(PointCloud2)
def do_transform_cloud(cloud: PointCloud2, transform: Union[Transform, TransformStamped]
                       ) -> PointCloud2:
    """
    Transform x, y and z of the points of a cloud, and rotate its normals; copy all other fields.

    Normals are the fields normal_x, normal_y and normal_z. They are copied, too, if one of them is
    missing, or is neither FLOAT32 nor FLOAT64.

    :param cloud: a cloud of any layout, with x, y, z of the datatype FLOAT32 or FLOAT64. If one
        of them is NaN, all three are NaN in the result; so it is for normals.
    :returns: a new cloud, with data of its own. If `transform` is a Transform, which has no
        header, the header is that of the given cloud.
    :raises AssertionError: as `puretf.point_cloud2.read_points`.
    :raises ValueError: if one of the fields x, y, z is missing or has another datatype, or if the
        layout does not fit the data.
    """
    result = copy(cloud)
    result.fields = list(cloud.fields)
    if isinstance(transform, TransformStamped):
        result.header = _header(transform)
        transform = transform.transform
    data = array('B', bytes(cloud.data))
    points = points_in(cloud, data)
    floats = {name for name in points.dtype.names or () if points.dtype[name].kind == 'f'}
    if missing := {*'xyz'} - floats:
        fields = ', '.join(f'{field.name} (datatype {field.datatype})' for field in cloud.fields)
        raise ValueError(f'the cloud needs a field {min(missing)} of FLOAT32 or FLOAT64; its '
                         f'fields: {fields or "none"}')
    rotation = rotations.matrix([getattr(transform.rotation, name) for name in 'xyzw'])
    translation = transform.translation.x, transform.translation.y, transform.translation.z
    _move([points[name] for name in 'xyz'], rotation, translation)
    if floats.issuperset(_NORMAL):
        _move([points[name] for name in _NORMAL], rotation, (0.0, 0.0, 0.0))
    result.data = data
    return result


def _move(columns: list[NDArray[np.floating[Any]]], rotation: NDArray[np.float64],
          translation: tuple[float, float, float]) -> None:
    """Rotate and translate vectors in place; each column has one coordinate of all vectors."""
    x, y, z = (column.astype(np.float64) for column in columns)
    for column, row, offset in zip(columns, rotation, translation):
        column[...] = row[0] * x + row[1] * y + row[2] * z + offset


def transform_points(point_cloud: 'ArrayLike', transform: Transform) -> NDArray[np.float64]:
    """
    Transform an array of points.

    :param point_cloud: (n, 3), or one point, (3,): x, y, z (m); the result has the same shape, in
        float64.
    :raises ValueError: if the array has another shape.
    """
    pose = _pose(transform.translation, transform.rotation)
    return OurTransform(0, '', '', pose[:3], pose[3:]).apply(point_cloud)
