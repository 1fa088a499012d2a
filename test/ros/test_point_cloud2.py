"""Point clouds as arrays, as in sensor_msgs_py: the bytes are packed by `struct`."""

from math import isnan, nan
import struct
from typing import Any

from clouds import cloud_of, fields_of, FORMATS, HEADER, MIXED, NATIVE_IS_BIG, XYZ
import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from puretf.point_cloud2 import (
    create_cloud,
    create_cloud_xyz32,
    dtype_from_fields,
    DUMMY_FIELD_PREFIX,
    read_points,
    read_points_list,
    read_points_numpy,
)

# Reading


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize('padding', [0, 5])
def test_points_of_any_layout(big, padding):
    """Offsets, padding after points and rows, and both byte orders; the message is unchanged."""
    rows = [[(1.5, 1e300, 65535, -128), (-2.25, 0.1, 0, 127)],
            [(0.5, -0.3, 256, 1), (3.0, 7.0, 1, -1)], [(4.0, 8.0, 2, 2), (5.0, 9.0, 3, 3)]]
    cloud = cloud_of(rows, MIXED, 20, big=big, padding=padding)
    before = bytes(cloud.data)
    for _ in range(2):
        points = read_points(cloud)
        assert points.tolist() == [point for row in rows for point in row]
    assert points.dtype.isnative
    assert points.dtype.itemsize == 20
    assert bytes(cloud.data) == before


def test_a_view_of_the_data():
    """Where nothing must be converted, nothing is copied: a change of the points is one of it."""
    cloud = cloud_of([[(1.0, 2.0, 3.0)]], XYZ, 12, big=NATIVE_IS_BIG)
    read_points(cloud)['y'] = 5.0
    assert read_points(cloud).tolist() == [(1.0, 5.0, 3.0)]


@pytest.mark.parametrize('big', [False, True])
def test_some_fields(big):
    """They are in the order in which they are asked for."""
    cloud = cloud_of([[(nan, 2.5, 7, -3), (4.5, 5.5, 8, -4)]], MIXED, 18, big=big)
    points = read_points(cloud, ('near', 'x'), skip_nans=True)  # integers are no NaN
    assert points.dtype.names == ('near', 'x')
    assert points.tolist() == [(-4, 4.5)]
    assert read_points(cloud, iter(['t'])).tolist() == [(2.5,), (5.5,)]


@pytest.mark.parametrize(('names', 'is_dense', 'left'), [
    (None, False, [0.0, 3.0]), (['x', 'y'], False, [0.0, 2.0, 3.0]), (['x'], False, [0, 1, 2, 3]),
    (None, True, [0.0, 1.0, 2.0, 3.0])])
def test_points_with_nan_are_left_out(names, is_dense, left):
    """Only the fields that are read count; a cloud that says that it is dense is believed."""
    cloud = cloud_of([[(0.0, 0.0, 0.0), (1.0, nan, 0.0), (2.0, 0.0, nan), (3.0, 0.0, 0.0)]],
                     XYZ, 16, is_dense=is_dense)
    assert read_points(cloud, names, skip_nans=True)['x'].tolist() == left
    assert len(read_points(cloud, names)) == 4


def test_points_by_their_number():
    """The numbers count the points that are not left out; they may be repeated."""
    cloud = cloud_of([[(0.0,), (nan,), (2.0,), (3.0,)]], [('x', 7, 0)], 4)
    assert read_points(cloud, uvs=iter([3, 0, 3]))['x'].tolist() == [3.0, 0.0, 3.0]
    assert read_points_numpy(cloud, skip_nans=True, uvs=[1]).tolist() == [[2.0]]
    assert read_points_list(cloud, uvs=np.array([True, False, False, True])) == [(0.0,), (3.0,)]


def test_organized_clouds():
    """They are flat unless asked for, and have the shape (width, height), as in Jazzy."""
    rows = [[(0.0,), (1.0,), (2.0,)], [(3.0,), (4.0,), (5.0,)]]
    cloud = cloud_of(rows, [('x', 7, 0)], 4, padding=4)
    assert read_points(cloud)['x'].tolist() == [0, 1, 2, 3, 4, 5]
    organized = read_points(cloud, reshape_organized_cloud=True)
    assert organized['x'].tolist() == [[0, 1], [2, 3], [4, 5]]
    assert organized.reshape(cloud.height, cloud.width)['x'].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert read_points_numpy(cloud, reshape_organized_cloud=True).shape == (3, 2, 1)
    one_row = cloud_of(rows[:1], [('x', 7, 0)], 4)
    assert read_points(one_row, reshape_organized_cloud=True).shape == (3,)


@pytest.mark.parametrize('row_step', [0, 12, 1000])
def test_a_wrong_row_step_does_not_matter(row_step):
    """It is ignored if the data have exactly the bytes of the points, as in the real one."""
    rows = [[(0.0,), (1.0,), (2.0,)], [(3.0,), (4.0,), (5.0,)]]
    cloud = cloud_of(rows, [('x', 7, 0)], 4)
    cloud.row_step = row_step
    assert read_points(cloud)['x'].tolist() == [0, 1, 2, 3, 4, 5]


def test_points_as_an_array_without_names():
    """All fields, or those that are chosen, must have one datatype."""
    cloud = cloud_of([[(1.0, 2.0, 3.0), (4.0, nan, 6.0)]], XYZ, 16, big=True)
    points = read_points_numpy(cloud)
    assert points.dtype.str[1:] == 'f4'
    np.testing.assert_array_equal(points, [[1.0, 2.0, 3.0], [4.0, nan, 6.0]])
    assert read_points_numpy(cloud, ['z', 'x'], skip_nans=True).tolist() == [[3.0, 1.0], [6, 4]]
    mixed = cloud_of([[(1.5, 2.5, 7, 8)]], [*MIXED[:3], ('u', 4, 17)], 20)
    assert read_points_numpy(mixed, ['ring', 'u']).tolist() == [[7, 8]]
    with pytest.raises(AssertionError, match=(
            r'several datatypes, x \(float32\), t \(float64\), ring \(uint16\), u \(uint16\): '
            'read them by read_points, or choose some by field_names')):
        read_points_numpy(mixed)


def test_points_as_named_tuples():
    """The values have the types of numpy."""
    cloud = cloud_of([[(1.0, nan, 3.0), (4.0, 5.0, 6.0)]], XYZ, 12)
    first, second = read_points_list(cloud)
    assert (first.x, first.z, type(first.x)) == (1.0, 3.0, np.float32)
    assert isnan(first.y)
    assert second._asdict() == {'x': 4.0, 'y': 5.0, 'z': 6.0}
    assert read_points_list(cloud, ['z', 'y'], skip_nans=True) == [(6.0, 5.0)]
    keyword = cloud_of([[(1.0, 2.0)]], [('class', 7, 0), ('x', 7, 4)], 8)
    assert read_points_list(keyword)[0]._asdict() == {'_0': 1.0, 'x': 2.0}


def test_fields_of_several_values_and_without_a_name():
    """Each value is a field; a field without a name has its number."""
    cloud = cloud_of([[(1.0, 2.0, 3.0)]], XYZ, 12)
    cloud.fields = [PointField(name='a', offset=0, datatype=7, count=2),
                    PointField(name='', offset=8, datatype=7, count=1)]
    assert DUMMY_FIELD_PREFIX == 'unnamed_field'
    assert read_points_list(cloud)[0]._asdict() == {'a_0': 1.0, 'a_1': 2.0, 'unnamed_field_1': 3.0}
    assert read_points(cloud, ['a_1']).tolist() == [(2.0,)]
    cloud.fields = [PointField(name='', offset=4, datatype=7, count=2)]
    assert read_points_list(cloud)[0]._asdict() == {
        'unnamed_field_0_0': 2.0, 'unnamed_field_0_1': 3.0}


def test_clouds_without_points():
    """They give empty arrays; the data may be missing altogether."""
    nothing: list[Any] = [[[]], [[], []]]
    for rows in nothing:
        cloud = cloud_of(rows, XYZ, 12)
        assert read_points(cloud).shape == (0,)
        assert read_points_numpy(cloud, skip_nans=True).shape == (0, 3)
        assert read_points_list(cloud) == []
    assert read_points(PointCloud2()).shape == (0,)


@pytest.mark.parametrize(('change', 'kind', 'error'), [
    ({'width': 3}, ValueError, 'does not fit: 1 x 3 points of 12 bytes, .* in 24 bytes of data'),
    ({'height': 2, 'row_step': 25}, ValueError, '2 x 2 points of 12 bytes, 25 bytes a row'),
    ({'height': 2, 'row_step': 23, 'data': [0] * 99}, ValueError, '23 bytes a row'),
    ({'point_step': 11}, ValueError,
     "field 'z' ends at byte 12, but a point has at most 11 bytes: correct its offset, its"),
    ({'fields': fields_of([('x', 9, 0)])}, ValueError,
     r"field 'x' has the datatype 9; a PointField has one of 1 \(INT8\) to 8 \(FLOAT64\)"),
    ({'fields': fields_of([('x', 7, 0)], 0)}, AssertionError,
     "field 'x' has the count 0: set count to the number of values in each point, such as 1"),
    ({'fields': fields_of([('x', 7, 0), ('x', 7, 4)])}, AssertionError,
     "two fields have the name 'x': rename one of them")])
def test_a_cloud_that_does_not_fit(change, kind, error):
    """The error says in one line what does not fit."""
    cloud = cloud_of([[(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]], XYZ, 12)
    for name, value in change.items():
        setattr(cloud, name, value)
    with pytest.raises(kind, match=error):
        read_points(cloud)


@pytest.mark.parametrize(('values', 'error'), [
    ({'point_step': 4_000_000, 'fields': fields_of([('x', 2, 0)], 4_000_000)},
     "with field 'x', a point has 4000000 values, but at most 100000 are possible"),
    ({'point_step': 1, 'fields': fields_of([('x', 2, 0), ('y', 2, 0)])},
     "with field 'y', a point has 2 values, but at most 1 are possible: correct its count"),
    ({'height': 2**16, 'width': 2**32 - 1}, '65536 x 4294967295 points of 0 bytes'),
    ({'point_step': 2**32 - 1}, 'a point has 4294967295 bytes, but at most 2147483647 are')])
def test_more_than_the_data_can_hold(values, error):
    """Such a cloud is refused before memory is taken for it: a number of its message is enough."""
    with pytest.raises(ValueError, match=error):
        read_points(PointCloud2(**values))


def test_what_is_not_there():
    """The error has the fields of the cloud, or the type of what is no cloud."""
    cloud = cloud_of([[(1.0, 2.0, 3.0)]], XYZ, 12)
    with pytest.raises(AssertionError, match="the cloud has no field 'i'; its fields: x, y, z"):
        read_points(cloud, ['x', 'i'])
    with pytest.raises(AssertionError, match=r'must be a .*PointCloud2, got None'):
        read_points(None)


# Creating


def test_the_type_of_the_points():
    """The size is that of the fields, or the one given."""
    fields = fields_of(MIXED)
    expected: Any = {'names': ['x', 't', 'ring', 'near'], 'formats': ['f4', 'f8', 'u2', 'i1'],
                     'offsets': [3, 9, 0, 17]}
    assert dtype_from_fields(fields) == np.dtype(expected)
    expected['itemsize'] = 32
    assert dtype_from_fields(iter(fields), 32) == np.dtype(expected)
    every = fields_of([(f'f{number}', number, 8 * number) for number in FORMATS])
    assert [dtype_from_fields(every)[i] for i in range(8)] == [
        np.dtype(kind) for _, kind in FORMATS.values()]


VALUES = [(0.5, 1e300, 65535, -128), (nan, 0.1, 0, 127)]


@pytest.mark.parametrize('points', [
    VALUES, map(list, VALUES), np.array(VALUES, dtype_from_fields(fields_of(MIXED), 20))])
def test_a_cloud_is_created(points):
    """The bytes are those of `struct`, and 0 where no field is."""
    cloud = create_cloud(HEADER, iter(fields_of(MIXED)), points, 20)
    expected = cloud_of([VALUES], MIXED, 20, big=NATIVE_IS_BIG)
    expected.data = bytearray(expected.data).replace(b'\xee', b'\0')
    assert cloud == expected
    assert (cloud.height, cloud.width, cloud.row_step, cloud.is_dense) == (1, 2, 40, False)


def test_a_cloud_from_an_array_without_names():
    """The numbers are converted to the datatype of the fields, of which each has one column."""
    points = np.array([[1, 2, 3], [4, 5, 6]])
    assert create_cloud(HEADER, fields_of(XYZ), points) == cloud_of(
        [[(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]], XYZ, 12, big=NATIVE_IS_BIG)
    several = [PointField(name='v', offset=0, datatype=8, count=3)]
    cloud = create_cloud(HEADER, several, points, point_step=32)
    assert (cloud.fields, cloud.point_step) == (several, 32)
    assert bytes(cloud.data) == struct.pack('=3d8x3d8x', 1, 2, 3, 4, 5, 6)


@pytest.mark.parametrize('points', [
    [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], ((1, 2, 3), (4, 5, 6)),
    np.array([[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]).T])
def test_a_cloud_of_x_y_z(points):
    """Its points have three numbers of 4 bytes."""
    assert create_cloud_xyz32(HEADER, points) == cloud_of(
        [[(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]], XYZ, 12, big=NATIVE_IS_BIG)


def test_an_organized_cloud_is_created():
    """An array of the shape (width, height) becomes a cloud that is read as this array."""
    points = np.arange(18.0).reshape(3, 2, 3)
    cloud = create_cloud_xyz32(HEADER, points)
    assert (cloud.width, cloud.height, cloud.row_step) == (3, 2, 36)
    assert bytes(cloud.data) == struct.pack('=18f', *range(18))
    np.testing.assert_array_equal(
        read_points_numpy(cloud, reshape_organized_cloud=True), points)
    structured = read_points(cloud, reshape_organized_cloud=True)
    assert create_cloud(HEADER, fields_of(XYZ), structured) == cloud


def test_a_cloud_without_points_is_created():
    """Such as when a filter leaves no points."""
    nothing: list[Any] = [[], np.empty((0, 3)), iter(())]
    for points in nothing:
        cloud = create_cloud_xyz32(HEADER, points)
        assert (cloud.width, cloud.height, len(cloud.data)) == (0, 1, 0)
        assert read_points_list(cloud) == []


@pytest.mark.parametrize(('description', 'points', 'kind', 'error'), [
    (XYZ, np.zeros((2, 4)), ValueError, r'shape \(n, 3\) for the fields x, y, z, got \(2, 4\)'),
    (XYZ, np.zeros(()), ValueError, r'shape \(n, 3\) for the fields x, y, z, got \(\)'),
    (XYZ, [(1.0, 2.0)], ValueError, 'tuple of length 2'),
    (XYZ, np.zeros(3), AssertionError, 'points must have 1 or 2 dimensions, got 0'),
    (XYZ, np.zeros((1, 1, 1, 3)), AssertionError, 'must have 1 or 2 dimensions, got 3'),
    (MIXED, np.zeros((1, 4)), AssertionError,
     r'several datatypes, x \(float32\), .*: pass a structured array')])
def test_points_that_do_not_fit(description, points, kind, error):
    """The error says in one line what does not fit."""
    with pytest.raises(kind, match=error):
        create_cloud(HEADER, fields_of(description), points)


def test_a_structured_array_of_another_type():
    """The error says how to create one."""
    points = np.zeros(2, [('x', 'f4'), ('y', 'f8'), ('z', 'f4')])
    with pytest.raises(AssertionError, match=(
            r'but the fields need .*: create them with dtype_from_fields\(fields, point_step\)')):
        create_cloud(HEADER, fields_of(XYZ), points, 16)
