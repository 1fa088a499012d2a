"""The transformation of messages, and their conversion to other types."""

from copy import deepcopy

from clouds import cloud_of
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    TransformStamped,
    Vector3,
    Vector3Stamped,
    WrenchStamped,
)
from hypothesis import given
from hypothesis import strategies as st
from model import matrix
from nav_msgs.msg import Odometry, Path
import numpy as np
import pytest
from rclpy.time import Time
from sensor_msgs.msg import PointField
from std_msgs.msg import Header

from puretf import (
    Buffer,
    buffer_interface,
    BufferInterface,
    convert,
    ConvertRegistration,
    NotImplementedException,
    Stamped,
    TransformRegistration,
    TypeException,
)
from puretf.geometry import (
    do_transform_point,
    do_transform_pose,
    do_transform_pose_stamped,
    transform_covariance,
    transform_points,
)
from puretf.point_cloud2 import create_cloud, read_points, read_points_numpy

XYZ, XYZW = (1.0, 2.0, 3.0), (0.5, -0.5, 0.5, 0.5)
STAMP = Time(seconds=7).to_msg()
HEADER = Header(stamp=STAMP, frame_id='camera')


def transform(xyz=XYZ, xyzw=XYZW):
    """Return a transform from camera to map."""
    message = TransformStamped(child_frame_id='camera')
    message.header = Header(stamp=STAMP, frame_id='map')
    (message.transform.translation.x, message.transform.translation.y,
     message.transform.translation.z) = xyz
    message.transform.rotation = Quaternion(x=xyzw[0], y=xyzw[1], z=xyzw[2], w=xyzw[3])
    return message


@pytest.fixture
def buffer():
    """A buffer that has the transform from camera to map."""
    made = Buffer()
    made.set_transform(transform(), 'test')
    return made


def moved(point):
    """Transform a point by the matrix."""
    return (matrix(XYZ, XYZW) @ [*point, 1.0])[:3]


def matrix_of(pose):
    """Return the 4 x 4 matrix of a pose."""
    turned = pose.orientation
    return matrix(xyz_of(pose.position), (*xyz_of(turned), turned.w))


def xyz_of(message):
    """Return x, y and z of a message."""
    return message.x, message.y, message.z


def test_a_point(buffer):
    """A point is rotated and translated, and its header is that of the map."""
    point = PointStamped(header=HEADER, point=Point(x=1.0, y=-2.0, z=0.5))
    result = buffer.transform(point, 'map')
    assert (type(result), result.header) == (PointStamped, Header(stamp=STAMP, frame_id='map'))
    assert xyz_of(result.point) == pytest.approx(moved((1.0, -2.0, 0.5)))
    assert point.point.x == 1.0


def test_a_vector(buffer):
    """A vector is rotated only, and the transform itself is not changed."""
    vector = Vector3Stamped(header=HEADER, vector=Vector3(x=1.0, y=-2.0, z=0.5))
    by = transform()
    result = TransformRegistration().get(Vector3Stamped)(vector, by)
    assert (type(result), result.header.frame_id) == (Vector3Stamped, 'map')
    assert xyz_of(result.vector) == pytest.approx(moved((1.0, -2.0, 0.5)) - moved((0, 0, 0)))
    result.header.frame_id, result.header.stamp.sec = 'x', 99
    assert by == transform()


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_a_pose(rotation):
    """Poses are composed, with w >= 0; the quaternions need not be normalised."""
    by = transform(xyzw=np.multiply(XYZW, 1.5).tolist())
    x, y, z, w = rotation
    orientation = Quaternion(x=x, y=y, z=z, w=w)
    pose = Pose(position=Point(x=1.0, y=-2.0, z=0.5), orientation=orientation)
    result = do_transform_pose(pose, by)
    assert result.orientation.w >= 0.0
    assert matrix_of(result) == pytest.approx(
        matrix(XYZ, XYZW) @ matrix((1.0, -2.0, 0.5), rotation), abs=1e-9)
    turned = TransformRegistration().get(QuaternionStamped)(
        QuaternionStamped(quaternion=orientation), by)
    assert (turned.quaternion, turned.header) == (result.orientation, by.header)
    zeros = do_transform_pose(Pose(orientation=Quaternion(w=0.0)), by)  # no rotation
    assert matrix_of(zeros) == pytest.approx(matrix(XYZ, XYZW))


def test_a_pose_with_covariance(buffer):
    """The covariance equals that of a sample of points that is rotated."""
    random = np.random.default_rng(3)
    sample = random.normal(size=(6, 50))
    pose = PoseWithCovarianceStamped(header=HEADER)
    pose.pose.covariance = np.cov(sample).reshape(36)
    result = buffer.transform(pose, 'map')
    rotation = matrix(XYZ, XYZW)[:3, :3]
    turned = np.vstack([rotation @ sample[:3], rotation @ sample[3:]])
    assert result.pose.covariance == pytest.approx(np.cov(turned).reshape(36))
    assert xyz_of(result.pose.pose.position) == pytest.approx(XYZ)
    assert transform_covariance(range(36), transform((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
                                ) == pytest.approx(list(range(36)))
    doubled = transform(xyzw=np.multiply(2.0, XYZW).tolist())  # tf2 does not normalise it
    assert transform_covariance(pose.pose.covariance, doubled) == pytest.approx(
        np.cov(turned).reshape(36))


def test_a_polygon(buffer):
    """Each of its points is transformed."""
    polygon = PolygonStamped(header=HEADER)
    polygon.polygon.points = [Point32(x=1.0), Point32(y=2.0, z=-1.0)]
    result = buffer.transform(polygon, 'map')
    assert type(result) is PolygonStamped
    assert [type(point) for point in result.polygon.points] == [Point32, Point32]
    assert np.array([xyz_of(point) for point in result.polygon.points]) == pytest.approx(
        np.array([moved((1, 0, 0)), moved((0, 2, -1))]))


#: Poses in the camera, whose quaternions are not normalized.
POSES = [((1.0, -2.0, 0.5), (0.0, 0.0, 0.0, 2.0)), ((0.0, 4.0, -1.0), (-0.5, 0.7, -0.1, -0.4)),
         ((7.0, 0.0, 3.0), (0.1, 0.2, -0.3, 0.4))]


def poses():
    """Return the poses as messages."""
    return [Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
            for (x, y, z), (qx, qy, qz, qw) in POSES]


def check_poses(results):
    """Compare the poses in the map with products of matrices."""
    for result, (xyz, xyzw) in zip(results, POSES, strict=True):
        assert type(result) is Pose
        assert matrix_of(result) == pytest.approx(matrix(XYZ, XYZW) @ matrix(xyz, xyzw))
        assert result.orientation.w >= 0.0


def test_poses_of_an_array(buffer):
    """Each pose is transformed, and the array that was given is unchanged."""
    array = PoseArray(header=HEADER, poses=poses())
    result = buffer.transform(array, 'map')
    assert (type(result), result.header) == (PoseArray, Header(stamp=STAMP, frame_id='map'))
    check_poses(result.poses)
    assert array == PoseArray(header=HEADER, poses=poses())


def path_of(frames):
    """Return a path whose poses have these frames, and stamps of 0 s, 1 s and so on."""
    return Path(header=HEADER, poses=[
        PoseStamped(header=Header(stamp=Time(seconds=i).to_msg(), frame_id=frame), pose=pose)
        for i, (frame, pose) in enumerate(zip(frames, poses()))])


def test_a_path(buffer):
    """All poses are in the map, and each has its own stamp; their frames may be left out."""
    path = path_of(['camera', '', 'camera'])
    result = buffer.transform(path, 'map')
    assert (type(result), result.header) == (Path, Header(stamp=STAMP, frame_id='map'))
    assert [pose.header for pose in result.poses] == [
        Header(stamp=Time(seconds=i).to_msg(), frame_id='map') for i in range(3)]
    check_poses([pose.pose for pose in result.poses])
    result.poses[0].header.stamp.sec = 99
    assert path == path_of(['camera', '', 'camera'])


def test_a_path_whose_poses_have_other_frames(buffer):
    """One transform does not fit all of them; the function that the error names transforms one."""
    with pytest.raises(ValueError, match=(
            "the path and its poses have several frames, 'camera', 'map': transform each pose by "
            'do_transform_pose_stamped')):
        buffer.transform(path_of(['camera', 'map']), 'map')
    result = do_transform_pose_stamped(path_of(['camera']).poses[0], transform())
    assert (type(result), result.header.frame_id) == (PoseStamped, 'map')
    assert matrix_of(result.pose) == pytest.approx(matrix(XYZ, XYZW) @ matrix(*POSES[0]))


def test_a_wrench(buffer):
    """The torque of the result is the one about the origin of the map."""
    wrench = WrenchStamped(header=HEADER)
    wrench.wrench.force, wrench.wrench.torque = Vector3(x=1.0, y=-2.0, z=0.5), Vector3(y=3.0)
    result = buffer.transform(wrench, 'map')
    assert (type(result), result.header) == (WrenchStamped, Header(stamp=STAMP, frame_id='map'))
    force, torque = xyz_of(result.wrench.force), xyz_of(result.wrench.torque)
    rotation = matrix(XYZ, XYZW)[:3, :3]
    assert force == pytest.approx(rotation @ (1.0, -2.0, 0.5))
    assert torque == pytest.approx(rotation @ (0.0, 3.0, 0.0) + np.cross(XYZ, force))
    assert xyz_of(wrench.wrench.force) == (1.0, -2.0, 0.5)


def test_odometry(buffer):
    """The pose and its covariance are transformed; the twist is in the axes of the robot."""
    odometry = Odometry(header=HEADER, child_frame_id='base_link')
    odometry.pose.pose = poses()[1]
    root = np.random.default_rng(4).normal(size=(6, 6))
    odometry.pose.covariance, odometry.twist.covariance = (root @ root.T).ravel(), root.ravel()
    odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = 1.5, -0.5
    given = deepcopy(odometry)
    result = buffer.transform(odometry, 'map')
    assert (type(result), result.header, result.child_frame_id) == (
        Odometry, Header(stamp=STAMP, frame_id='map'), 'base_link')
    assert matrix_of(result.pose.pose) == pytest.approx(matrix(XYZ, XYZW) @ matrix(*POSES[1]))
    turned = np.zeros((6, 6))
    turned[:3, :3] = turned[3:, 3:] = matrix(XYZ, XYZW)[:3, :3]
    assert result.pose.covariance == pytest.approx((turned @ root @ root.T @ turned.T).ravel())
    assert str(result.twist) == str(given.twist)
    result.twist.twist.linear.x = result.twist.covariance[0] = 99.0
    assert str(odometry) == str(given)


def test_between_two_times():
    """The point stays where it is in the fixed frame."""
    buffer = Buffer()
    for second in range(3):
        moving = transform((float(second), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        moving.header.stamp.sec = second + 1
        buffer.set_transform(moving, 'test')
    point = PointStamped(point=Point(x=10.0))
    point.header = Header(stamp=Time(seconds=1).to_msg(), frame_id='camera')
    result = buffer.transform_full(point, 'camera', Time(seconds=3), 'map')
    assert (result.point.x, result.header.stamp.sec) == (8.0, 3)


class Own:
    """A type that only the user knows."""

    def __init__(self, x):
        """Create an object with a number and a header."""
        self.x = x
        self.header = HEADER


@pytest.fixture
def own_type():
    """Forget the functions for `Own` after the test; the registry is that of the process."""
    yield
    for functions in vars(buffer_interface).values():
        if isinstance(functions, dict):
            functions.pop(Own, None)


@pytest.mark.usefixtures('own_type')
def test_types_can_be_registered(buffer):
    """Registered types can be transformed and converted."""
    with pytest.raises(TypeException, match=r'^Type <class .*Own.> is not loaded or supp'):
        buffer.transform(Own(1.0), 'map')
    TransformRegistration().add(Own, lambda own, by: Own(own.x + by.transform.translation.x))
    assert buffer.transform(Own(1.0), 'map').x == 2.0
    with pytest.raises(TypeException):
        buffer.transform(Own(1.0), 'map', new_type=PointStamped)
    ConvertRegistration().add_to_msg(Own, lambda own: PointStamped(point=Point(x=own.x)))
    assert buffer.transform(Own(1.0), 'map', new_type=PointStamped).point.x == 2.0
    ConvertRegistration().add_from_msg(Own, lambda message: Own(message.point.x))
    point = PointStamped(header=HEADER)
    assert buffer.transform(point, 'map', new_type=Own).x == pytest.approx(1.0)
    ConvertRegistration().add_convert((PointStamped, Own), lambda message: Own(-1.0))
    assert convert(point, Own).x == -1.0
    copied = convert(point, PointStamped)
    assert copied == point
    assert copied is not point


def test_stamped_gives_a_header():
    """The header has the stamp and the frame, as in tf2_ros."""
    own = Stamped(Own(1.0), STAMP, 'tool')
    assert own.header == Header(stamp=STAMP, frame_id='tool')


def test_the_interface_is_to_be_implemented():
    """Each lookup of the interface raises NotImplementedException."""
    interface = BufferInterface()
    for method, count in (('lookup_transform', 3), ('lookup_transform_full', 5),
                          ('can_transform', 3), ('can_transform_full', 5)):
        with pytest.raises(NotImplementedException, match='not implemented'):
            getattr(interface, method)(*['a'] * count)


#: Fields of several datatypes, not aligned, in points of 24 bytes.
FIELDS = [('x', 7, 2), ('y', 8, 7), ('z', 7, 16), ('tag', 4, 0)]


@pytest.mark.parametrize(('big', 'padding', 'height'), [
    (False, 0, 1), (False, 5, 3), (True, 5, 3), (False, 0, 0)])
def test_a_cloud(buffer, big, padding, height):
    """Only the bytes of x, y and z change, unaligned and of mixed widths; NaN stays NaN."""
    def cloud(points):
        return cloud_of([[(*point, 7) for point in row] for row in points.tolist()] or [[]],
                        FIELDS, 24, big=big, padding=padding)

    points = np.random.default_rng(2).normal(size=(height, 4, 3))
    points[:1, 1] = np.nan
    before = cloud(points)
    after = buffer.transform(before, 'map')
    expected = cloud(points @ matrix(XYZ, XYZW)[:3, :3].T + XYZ)
    # It differs from the result by rounding only, so in no other byte.
    differing = [i for i, pair in enumerate(zip(after.data, expected.data)) if len({*pair}) > 1]
    assert {i % before.row_step % 24 for i in differing} <= {
        i for at, size in ((2, 4), (7, 8), (16, 4)) for i in range(at, at + size)}
    for name, _, _ in FIELDS:
        np.testing.assert_allclose(
            read_points(after)[name], read_points(expected)[name], rtol=1e-6, atol=1e-6)
    assert bytes(before.data) == bytes(cloud(points).data)
    assert after.header.frame_id == 'map'
    after.header, after.data = expected.header, expected.data
    assert after == expected


@pytest.mark.parametrize('datatype', [PointField.FLOAT32, PointField.FLOAT64])
def test_normals_are_rotated(buffer, datatype):
    """The translation does not apply to them; the other fields are the same."""
    names = ['x', 'y', 'z', 'curvature', 'normal_x', 'normal_y', 'normal_z']
    values = np.random.default_rng(5).normal(size=(4, 7))
    values[1, 4] = np.nan
    before = create_cloud(HEADER, [
        PointField(name=name, offset=i * 8, count=1, datatype=datatype)
        for i, name in enumerate(names)], values)
    rotation = matrix(XYZ, XYZW)[:3, :3]
    expected = np.hstack([values[:, :3] @ rotation.T + XYZ, values[:, 3:4],
                          values[:, 4:] @ rotation.T])
    np.testing.assert_allclose(read_points_numpy(buffer.transform(before, 'map')), expected,
                               rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize('change', [{'name': 'normal'}, {'datatype': PointField.INT32}])
def test_incomplete_normals_are_copied(buffer, change):
    """One of them is missing, or has another datatype."""
    fields = [PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
              for i, name in enumerate(['x', 'y', 'z', 'normal_x', 'normal_y', 'normal_z'])]
    before = create_cloud(HEADER, fields, np.ones((2, 6)))
    for name, value in change.items():
        setattr(before.fields[5], name, value)
    after = np.frombuffer(buffer.transform(before, 'map').data, 'f4').reshape(2, 6)
    np.testing.assert_allclose(after, [[*moved((1, 1, 1)), 1, 1, 1]] * 2, rtol=1e-6)


def test_points_in_an_array():
    """Each point is transformed as a PointStamped is; a zero quaternion is no rotation."""
    transform = TransformStamped()
    transform.transform.translation.x, transform.transform.translation.z = 1.0, -2.0
    points = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 6.0]])
    for rotation in (0.0, 0.0, 0.0, 0.0), (0.1, -0.5, 0.3, 0.8):
        x, y, z, w = rotation
        transform.transform.rotation = Quaternion(x=x, y=y, z=z, w=w)
        for point, result in zip(points, transform_points(points, transform.transform)):
            single = PointStamped(point=Point(x=point[0], y=point[1], z=point[2]))
            expected = do_transform_point(single, transform).point
            assert result == pytest.approx((expected.x, expected.y, expected.z))
    assert transform_points(np.empty((0, 3)), transform.transform).shape == (0, 3)
    with pytest.raises(ValueError, match=r'must be of shape .* or \(n, 3\), got \(2,\)'):
        transform_points([1.0, 2.0], transform.transform)


@pytest.mark.parametrize(('change', 'error'), [
    ({'fields': [PointField(name='x', datatype=PointField.INT16, count=1)]},
     r'needs a field x of FLOAT32 or FLOAT64; its fields: x \(datatype 3\)'),
    ({'point_step': 5}, "field 'x' ends at byte 6, but a point has at most 5 bytes"),
    ({'width': 5}, 'layout does not fit: 1 x 5 points of 24 bytes, .* in 96 bytes of data')])
def test_a_cloud_that_does_not_fit(buffer, change, error):
    """The error says in one line what does not fit."""
    bad = cloud_of([[(0.0, 0.0, 0.0, 7)] * 4], FIELDS, 24)
    for name, value in change.items():
        setattr(bad, name, value)
    with pytest.raises(ValueError, match=error):
        buffer.transform(bad, 'map')
