"""
Point clouds as numpy arrays, with the names and results of `sensor_msgs_py.point_cloud2`.

A structured array has one element for each point, with the fields of the cloud by name. A field
without a name is called `unnamed_field_0`, where 0 is its number among the fields. A field of
several values, whose `count` is more than 1, becomes several fields: `name_0`, `name_1` and so on.

Arrays of organized clouds have the shape (width, height), as in ROS 2 Jazzy. So in an array that
was read, the points of a row do not follow one another, unless it is reshaped to (height, width).

This module needs ROS.
"""

# Before the packages of ROS, to say how to install them.
import puretf._ros  # noqa: F401

# isort: split
from array import array
from collections import namedtuple
from collections.abc import Iterable
import sys
from typing import Any, Optional

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from puretf.exceptions import described

#: The beginning of the name of a field that has none.
DUMMY_FIELD_PREFIX = 'unnamed_field'
#: The largest number of values of a point: numpy keeps 650 bytes for each of their names.
_MOST_VALUES = 100_000
#: The largest size of a point (bytes), that of an element of numpy.
_MOST_BYTES = 2**31 - 1
_TYPES = {getattr(PointField, name): np.dtype(name.lower()) for name in (
    'INT8', 'UINT8', 'INT16', 'UINT16', 'INT32', 'UINT32', 'FLOAT32', 'FLOAT64')}


def read_points(cloud: PointCloud2, field_names: Optional[Iterable[str]] = None,
                skip_nans: bool = False, uvs: Optional[Iterable[int]] = None,
                reshape_organized_cloud: bool = False) -> NDArray[Any]:
    """
    Read the points of a cloud into a structured array, in the byte order of this computer.

    :param field_names: the fields, in this order; None: all fields.
    :param skip_nans: leave out points with a NaN in one of these fields, unless the cloud says
        that it is dense.
    :param uvs: the indices of the points to be returned, or an array that numpy takes as an index;
        None: all points. They count the points that `skip_nans` has left.
    :param reshape_organized_cloud: return the shape (width, height) if the height is more than 1.
    :returns: (n,), or (width, height). This is a view of the data of the message if it needs no
        copy: the bytes are in the order of this computer, no row has padding, and no points are
        selected.
    :raises AssertionError: if the cloud is no PointCloud2 or has no such field, or if two fields
        have the same name.
    :raises ValueError: if the layout does not fit the data.
    """
    if not isinstance(cloud, PointCloud2):
        raise AssertionError(f'the cloud must be a sensor_msgs.msg.PointCloud2, got '
                             f'{described(cloud)}')
    points: NDArray[Any] = points_in(cloud, cloud.data).reshape(-1)
    if field_names is not None:
        names = list(field_names)
        if unknown := [name for name in names if name not in (points.dtype.names or ())]:
            raise AssertionError(f'the cloud has no field {unknown[0]!r}; its fields: '
                                 f'{", ".join(points.dtype.names or ()) or "none"}')
        points = points[names]
    points = points.astype(points.dtype.newbyteorder('='), copy=False)
    if skip_nans and not cloud.is_dense:
        complete = np.ones(len(points), bool)
        for name in points.dtype.names or ():
            complete &= ~np.isnan(points[name])
        points = points[complete]
    if uvs is not None:
        points = points[uvs if isinstance(uvs, np.ndarray) else np.fromiter(uvs, int)]
    if reshape_organized_cloud and cloud.height > 1:
        points = points.reshape(cloud.width, cloud.height)
    return points


def read_points_numpy(cloud: PointCloud2, field_names: Optional[Iterable[str]] = None,
                      skip_nans: bool = False, uvs: Optional[Iterable[int]] = None,
                      reshape_organized_cloud: bool = False) -> NDArray[Any]:
    """
    Read fields of one datatype into an array without names, such as (n, 3) for x, y and z.

    The parameters are those of `read_points`.

    :raises AssertionError: if the fields have several datatypes.
    """
    points = read_points(cloud, field_names, skip_nans, uvs, reshape_organized_cloud)
    _check_uniform(points.dtype, 'read them by read_points, or choose some by field_names')
    return structured_to_unstructured(points)


def read_points_list(cloud: PointCloud2, field_names: Optional[Iterable[str]] = None,
                     skip_nans: bool = False, uvs: Optional[Iterable[int]] = None) -> list[Any]:
    """
    Read the points of a cloud into a list of named tuples; the arrays of `read_points` are faster.

    The parameters are those of `read_points`. A field whose name cannot be an attribute, such as
    `class`, is called by its number: `_0`.
    """
    points = read_points(cloud, field_names, skip_nans, uvs)
    create: Any = namedtuple
    return [*map(create('Point', points.dtype.names, rename=True)._make, points)]


def dtype_from_fields(fields: Iterable[PointField], point_step: Optional[int] = None
                      ) -> np.dtype[Any]:
    """
    Return the type of the elements of a structured array, in the byte order of this computer.

    :param point_step: the size of a point (bytes); None: up to the end of the last field.
    :raises AssertionError: if two fields have the same name, or if the count of a field is 0.
    :raises ValueError: if a datatype is unknown, if a field ends after the `point_step`, or if
        the fields have more values than a point has bytes, or more than 100 000.
    """
    if point_step is not None and point_step > _MOST_BYTES:
        raise ValueError(f'a point has {point_step} bytes, but at most {_MOST_BYTES} are possible:'
                         ' correct the point_step')
    formats: dict[str, tuple[np.dtype[Any], int]] = {}
    for i, field in enumerate(fields):
        name = field.name or f'{DUMMY_FIELD_PREFIX}_{i}'
        dtype = _TYPES.get(field.datatype)
        if dtype is None:
            raise ValueError(f'field {name!r} has the datatype {field.datatype}; a PointField has '
                             f'one of {min(_TYPES)} (INT8) to {max(_TYPES)} (FLOAT64)')
        if field.count == 0:
            raise AssertionError(f'field {name!r} has the count 0: set count to the number of '
                                 'values in each point, such as 1')
        end = field.offset + field.count * dtype.itemsize
        if end > (size := _MOST_BYTES if point_step is None else point_step):
            raise ValueError(f'field {name!r} ends at byte {end}, but a point has at most {size} '
                             'bytes: correct its offset, its count or the point_step')
        if len(formats) + field.count > (most := min(_MOST_VALUES, size)):
            raise ValueError(f'with field {name!r}, a point has {len(formats) + field.count} '
                             f'values, but at most {most} are possible: correct its count')
        for k in range(field.count):
            part = f'{name}_{k}' if field.count > 1 else name
            if part in formats:
                raise AssertionError(f'two fields have the name {part!r}: rename one of them')
            formats[part] = dtype, field.offset + k * dtype.itemsize
    description: Any = {
        'names': [*formats], 'formats': [dtype for dtype, _ in formats.values()],
        'offsets': [offset for _, offset in formats.values()]}
    if point_step is not None:
        description['itemsize'] = point_step
    result: np.dtype[Any] = np.dtype(description)
    return result


def create_cloud(header: Header, fields: Iterable[PointField], points: Iterable[Any],
                 point_step: Optional[int] = None) -> PointCloud2:
    """
    Create a cloud.

    :param points: one of three forms: a structured array of the type that `dtype_from_fields`
        returns, (n,) or (width, height); an array without names, (n, k) or (width, height, k), for
        k fields of one datatype; or an iterable of points, each an iterable of k values.
    :param point_step: the size of a point (bytes); None: up to the end of the last field. Bytes
        without a field are 0.
    :raises AssertionError: if the array has more than two dimensions of points, or does not match
        the fields.
    """
    fields = list(fields)
    dtype = dtype_from_fields(fields, point_step)
    names = dtype.names or ()
    if not isinstance(points, np.ndarray):
        points = np.array([tuple(point) for point in points], dtype)
    elif points.dtype.names is None:
        _check_uniform(dtype, 'pass a structured array')
        if points.shape[-1:] != (len(names),):
            raise ValueError(f'points must have the shape (n, {len(names)}) for the fields '
                             f'{", ".join(names)}, got {points.shape}')
        points = unstructured_to_structured(points, dtype)
    elif points.dtype != dtype:
        raise AssertionError(
            f'points have the dtype {points.dtype}, but the fields need {dtype}: create them with '
            'dtype_from_fields(fields, point_step)')
    if points.ndim not in (1, 2):
        raise AssertionError(f'points must have 1 or 2 dimensions, got {points.ndim}')
    packed = np.zeros(points.shape, dtype)
    for name in names:  # not the whole points, whose other bytes may have any value
        packed[name] = points[name]
    width, height = (*points.shape, 1)[:2]
    cloud = PointCloud2(
        header=header, height=height, width=width, fields=fields, is_dense=False,
        is_bigendian=sys.byteorder != 'little', point_step=dtype.itemsize,
        row_step=dtype.itemsize * width)
    cloud.data = array('B', packed.tobytes())  # the constructor would check each byte
    return cloud


def create_cloud_xyz32(header: Header, points: Iterable[Any]) -> PointCloud2:
    """Create a cloud with the fields x, y and z of the datatype FLOAT32; see `create_cloud`."""
    return create_cloud(header, [
        PointField(name=name, offset=offset, datatype=PointField.FLOAT32, count=1)
        for name, offset in zip('xyz', (0, 4, 8))], points)


def points_in(cloud: PointCloud2, data: Any) -> NDArray[Any]:
    """
    Return a structured view of shape (height, width) into `data`, the data of a cloud or a copy.

    If the data have only the bytes of the points, the rows follow one another, even if the
    `row_step` is another one.

    :raises ValueError: if the layout does not fit the data; and as `dtype_from_fields`.
    """
    rows, columns, point_step = cloud.height, cloud.width, cloud.point_step
    dtype = dtype_from_fields(cloud.fields, point_step)
    size = columns * point_step
    row_step = size if rows == 1 or len(data) == rows * size else cloud.row_step
    if row_step < size or (not size and rows * columns) or (
            len(data) < (rows - 1) * row_step + size):
        raise ValueError(
            f'the layout does not fit: {rows} x {columns} points of {point_step} bytes, '
            f'{row_step} bytes a row, in {len(data)} bytes of data')
    return np.ndarray((rows, columns), dtype.newbyteorder('>' if cloud.is_bigendian else '<'),
                      data, 0, (row_step, point_step))


def _check_uniform(dtype: np.dtype[Any], remedy: str) -> None:
    kinds = {dtype[name] for name in dtype.names or ()}
    if len(kinds) > 1:
        names = ', '.join(f'{name} ({dtype[name]})' for name in dtype.names or ())
        raise AssertionError(f'the fields have several datatypes, {names}: {remedy}')
