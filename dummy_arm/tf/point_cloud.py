"""Transforming point clouds, as tf2_sensor_msgs does."""

from array import array
from copy import copy, deepcopy
from typing import Any, Union

from geometry_msgs.msg import Transform, TransformStamped
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from dummy_arm.tf import rotations

_TYPES = {PointField.FLOAT32: ('f4', 4), PointField.FLOAT64: ('f8', 8)}


def do_transform_cloud(cloud: PointCloud2, transform: Union[Transform, TransformStamped]
                       ) -> PointCloud2:
    """
    Transform x, y and z of the points of a cloud; any other field stays as it is.

    :param cloud: of any layout; x, y, z are FLOAT32 or FLOAT64. A point of NaN stays NaN.
    :param transform: from the frame of the cloud. The result has its header, if it has one.
    :returns: another cloud, with data of its own.
    :raises ValueError: when there is no x, y or z, or the layout does not fit the data.
    """
    result = copy(cloud)
    result.fields = list(cloud.fields)
    if isinstance(transform, TransformStamped):
        result.header = deepcopy(transform.header)
        transform = transform.transform
    data = array('B', bytes(cloud.data))
    points = [_column(cloud, name, data) for name in 'xyz']
    rotation = rotations.matrix([transform.rotation.x, transform.rotation.y,
                                 transform.rotation.z, transform.rotation.w])
    translation = transform.translation.x, transform.translation.y, transform.translation.z
    xyz = [column.astype(np.float64) for column in points]
    for column, row, offset in zip(points, rotation, translation):
        column[...] = row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2] + offset
    result.data = data
    return result


def _column(cloud: PointCloud2, name: str, data: 'array[int]') -> NDArray[np.floating[Any]]:
    """View one field of all points in the data, (height, width)."""
    field = next((field for field in cloud.fields if field.name == name), None)
    if field is None or field.datatype not in _TYPES:
        names = ', '.join(f'{field.name} (datatype {field.datatype})' for field in cloud.fields)
        raise ValueError(f'the cloud needs a field {name} of FLOAT32 or FLOAT64, it has {names}')
    kind, size = _TYPES[field.datatype]
    rows, columns, point_step = cloud.height, cloud.width, cloud.point_step
    row_step = cloud.row_step if rows > 1 else columns * point_step
    if (field.offset + size > point_step or row_step < columns * point_step
            or (len(data) < (rows - 1) * row_step + columns * point_step and rows * columns)):
        raise ValueError(
            f'the layout does not fit: {rows} x {columns} points of {point_step} bytes, '
            f'{row_step} bytes a row, {name} at byte {field.offset}, in {len(data)} bytes of data')
    view: NDArray[np.floating[Any]] = np.ndarray(
        (rows, columns), ('>' if cloud.is_bigendian else '<') + kind, data,
        field.offset if rows * columns else 0, (row_step, point_step))
    return view
