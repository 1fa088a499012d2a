"""Point clouds for tests, packed by `struct`."""

import struct
import sys

from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

HEADER = Header(frame_id='camera')
#: The formats of `struct` and numpy by the number of the datatype: INT8 to FLOAT64.
FORMATS = {1: ('b', 'i1'), 2: ('B', 'u1'), 3: ('h', 'i2'), 4: ('H', 'u2'), 5: ('i', 'i4'),
           6: ('I', 'u4'), 7: ('f', 'f4'), 8: ('d', 'f8')}
XYZ = [('x', 7, 0), ('y', 7, 4), ('z', 7, 8)]
#: Fields of several datatypes, neither aligned nor in the order of their offsets.
MIXED = [('x', 7, 3), ('t', 8, 9), ('ring', 4, 0), ('near', 1, 17)]
NATIVE_IS_BIG = sys.byteorder == 'big'


def fields_of(description, count=1):
    """Return the fields of a cloud: each has a name, a datatype and an offset."""
    return [PointField(name=name, datatype=datatype, offset=offset, count=count)
            for name, datatype, offset in description]


def cloud_of(rows, description, point_step, *, big=False, padding=0, is_dense=False):
    """
    Return a cloud whose unused bytes are all 0xEE.

    :param rows: of points, which are tuples with the values of the fields.
    :param padding: how many bytes follow the points of each row.
    """
    data = b''
    for row in rows:
        for point in row:
            packed = bytearray(b'\xee' * point_step)
            for value, (_, datatype, offset) in zip(point, description, strict=True):
                struct.pack_into(
                    f'{">" if big else "<"}{FORMATS[datatype][0]}', packed, offset, value)
            data += packed
        data += b'\xee' * padding
    width = len(rows[0])
    return PointCloud2(
        header=HEADER, height=len(rows), width=width, fields=fields_of(description),
        is_bigendian=big, is_dense=is_dense, point_step=point_step,
        row_step=width * point_step + padding, data=data)
