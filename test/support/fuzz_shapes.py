"""
Fuzz targets: files of meshes, and point clouds.

See fuzz_messages.py for what a target is.
"""

from collections.abc import Iterator
from contextlib import suppress
import json
from math import isnan
import re
import struct
from typing import Any

from fuzz_messages import changed, folder, Input
import numpy as np

from puretf_tools.view.meshes import load, MeshError

# Meshes


_TRIANGLE = struct.pack('<9f3I', 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
_GLTF = json.dumps({
    'asset': {'version': '2.0'}, 'scene': 0, 'scenes': [{'nodes': [0]}],
    'nodes': [{'mesh': 0, 'children': [1]}, {'mesh': 0, 'translation': [1, 0, 0]}],
    'meshes': [{'primitives': [
        {'attributes': {'POSITION': 0, 'COLOR_0': 0}, 'indices': 1, 'material': 0, 'mode': 4}]}],
    'accessors': [
        {'bufferView': 0, 'byteOffset': 0, 'componentType': 5126, 'count': 3, 'type': 'VEC3'},
        {'bufferView': 1, 'componentType': 5125, 'count': 3, 'type': 'SCALAR'}],
    'bufferViews': [{'buffer': 0, 'byteLength': 36, 'byteStride': 12},
                    {'buffer': 0, 'byteOffset': 36, 'byteLength': 12}],
    'materials': [{'pbrMetallicRoughness': {'baseColorFactor': [1, 0, 0, 1]}}],
    'buffers': [{'byteLength': 48}]}).encode()
_SOURCE = (
    b'<source id="%b"><float_array id="a%b" count="9">0 0 0 1 0 0 0 1 0</float_array>'
    b'<technique_common><accessor source="#a%b" count="3" stride="3"><param name="X"/>'
    b'<param name="Y"/><param name="Z"/></accessor></technique_common></source>')
_POLYGONS = (
    b'<%b count="1"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" '
    b'source="#n" offset="1"/><input semantic="COLOR" source="#n" offset="1"/>%b'
    b'<p>0 0 1 1 2 2</p></%b>')
_COLLADA = (
    b'<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>'
    b'<unit name="m" meter="1"/></asset><library_nodes><node id="0"><instance_geometry url="#g"/>'
    b'</node><node id="1"><instance_node url="#0"/></node></library_nodes><library_geometries>'
    b'<geometry id="g"><mesh>' + _SOURCE % (b's', b's', b's') + _SOURCE % (b'n', b'n', b'n')
    + b'<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>%b</mesh></geometry>'
    b'</library_geometries><library_visual_scenes><visual_scene id="c"><node id="2"><matrix>'
    b'1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_node url="#1"/></node></visual_scene>'
    b'</library_visual_scenes><scene><instance_visual_scene url="#c"/></scene></COLLADA>')
_PLY = (
    b'ply\nformat %b 1.0\nelement vertex 3\nproperty float x\nproperty float y\n'
    b'property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n%b')
#: The end of a name, and the bytes of a file.
_FILES = [
    ('.glb', _GLTF),
    *(('.dae', _COLLADA % (_POLYGONS % (tag, inside, tag))) for tag, inside in (
        (b'triangles', b''), (b'polylist', b'<vcount>3</vcount>'), (b'polygons', b''),
        (b'tristrips', b''), (b'trifans', b''))),
    ('.ply', _PLY % (b'ascii', b'0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n')),
    ('.ply', _PLY % (b'binary_little_endian', _TRIANGLE[:36] + b'\3' + _TRIANGLE[36:])),
    ('.stl', bytes(80) + struct.pack('<I12fH', 1, 0, 0, 1, *struct.unpack('<9f', _TRIANGLE[:36]),
                                     0)),
    ('.stl', b'solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n'
             b'endloop\nendfacet\nendsolid a\n'),
    ('.off', b'OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n'),
    ('.obj', b'v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 3/1/1\n')]
_VALUES = (b'0', b'-1', b'-2', b'1', b'2', b'3', b'4', b'5', b'16', b'1000', b'1000000',
           b'1000001', b'2147483647', b'4294967295', b'9' * 30, b'1e400', b'-1e-400', b'nan',
           b'inf', b'', b'0.5', b'x', b'null', b'[]', b'{}', b'true', b'"1"', b'MAT4')
_PIECES = (b'<!DOCTYPE a [<!ATTLIST node z CDATA "' + b'x' * 1000 + b'">]>', b'<node>', b'</node>',
           b'<node/>', b'<instance_node url="#0"/>', b'<instance_node url="#2"/>',
           b'<instance_geometry url="#g"/>', b'<node id="0">', b'<p>0 0</p>',
           b'<vcount>3</vcount>', b'<param name="a"/>', b'<float_array>1</float_array>',
           b'<Name_array>a b</Name_array>',
           b'{"mesh":0},', b'"children":[0],', b'"sparse":{"count":9},', b'"byteStride":1,', b' ',
           b'"mode":5,', b'\nproperty list int int a', b'\nelement a 9', b'\nf 1 2 -1', b'\n')


def _edited(text: bytes, source: Input) -> bytes:
    """Replace numbers, insert pieces, and repeat parts from one mark to another."""
    for _ in range(8):
        if not source or len(text) > 100_000:
            break
        op = source.integer(4)
        if op <= 1:
            numbers = [*re.finditer(rb'-?\d+', text)]
            if numbers:
                number = source.choice(numbers)
                text = text[:number.start()] + source.choice(_VALUES) + text[number.end():]
        elif op == 2:
            marks = [found.end() for found in re.finditer(rb'[<>{}\[\n,]', text)] or [0]
            at = source.choice(marks)
            text = text[:at] + source.choice(_PIECES) + text[at:]
        elif op == 3:
            marks = [found.start() for found in re.finditer(rb'[<{\[\n]', text)] or [0]
            begin, end = sorted([source.choice(marks), source.choice(marks)])
            text = text[:begin] + text[begin:end] * source.integer(300) + text[end:]
        else:
            text = changed(text, source)
    return text


def check_meshes(data: bytes) -> None:
    """A mesh has finite vertices, and triangles of these, or is refused with one line."""
    source = Input(data)
    kind, content = source.choice(_FILES)
    content = _edited(content, source)
    if kind == '.glb':
        content += b' ' * (-len(content) % 4)
        content = (struct.pack('<4sIII4s', b'glTF', 2, 28 + len(content) + 48, len(content),
                               b'JSON') + content + struct.pack('<I4s', 48, b'BIN\0') + _TRIANGLE)
    path = folder() / f'mesh{kind}'
    path.write_bytes(content)
    try:
        mesh = load(path, 4)
    except MeshError as error:
        text = str(error)
        assert text.isprintable(), repr(text)
        assert 0 < len(text) < 1000
        assert 'MemoryError' not in text, text
        return
    assert len(mesh.vertices) <= 6_000_000
    assert 0 < len(mesh.faces) <= 2_000_000
    assert np.isfinite(mesh.vertices).all()
    assert mesh.faces.max() < len(mesh.vertices)


def seeds_of_meshes() -> Iterator[bytes]:
    """Yield each file: unchanged, with another number, another piece and a part repeated."""
    for number in range(len(_FILES)):
        yield bytes([number])
        for at in 3, 12, 25, 40:
            yield bytes([number, 0, at, 2])
            yield bytes([number, 2, at, 4])
            yield bytes([number, 3, at, at + 2, 100, 1])


# Clouds


_FORMATS = {1: 'b', 2: 'B', 3: 'h', 4: 'H', 5: 'i', 6: 'I', 7: 'f', 8: 'd'}
_COUNTS = (1, 1, 1, 0, 2, 3, 1000, 4_000_000, 2**32 - 1)
_SIZES = (1, 2, 3, 4, 0, 5, 2**16, 2**31 - 1, 2**31, 2**32 - 1)


def _cloud(source: Input) -> Any:
    """Return a cloud; rclpy is imported by the first call."""
    from sensor_msgs.msg import PointCloud2, PointField

    def size() -> int:
        return source.choice(_SIZES) if source.integer(3) == 0 else source.integer(40)

    fields = [PointField(
        name=source.choice(('x', 'y', 'z', '', 'normal_x', 'a', 'x_0')),
        datatype=source.integer(9), offset=size(), count=source.choice(_COUNTS))
        for _ in range(source.integer(6))]
    if source.integer(1):
        fields = [PointField(name=name, datatype=7, offset=4 * i, count=1)
                  for i, name in enumerate('xyz')] + fields
    cloud = PointCloud2(
        fields=fields, is_bigendian=bool(source.integer(1)), is_dense=bool(source.integer(1)),
        height=size(), width=size(), point_step=size(), row_step=size())
    cloud.data = source.raw(source.integer(400))
    return cloud


def _expected(cloud: Any) -> Iterator[tuple[Any, ...]]:
    """Yield the points of a cloud that fits its data, by `struct`."""
    order = '>' if cloud.is_bigendian else '<'
    size = cloud.width * cloud.point_step
    is_packed = cloud.height == 1 or len(cloud.data) == cloud.height * size
    for row in range(cloud.height if cloud.width else 0):
        for column in range(cloud.width):
            at = row * (size if is_packed else cloud.row_step) + column * cloud.point_step
            yield tuple(value for field in cloud.fields for value in struct.unpack_from(
                f'{order}{field.count}{_FORMATS[field.datatype]}', cloud.data, at + field.offset))


def _overlap(fields: Any) -> bool:
    used = [field.offset + i for field in fields
            for i in range(field.count * struct.calcsize(_FORMATS[field.datatype]))]
    return len(used) > len({*used})


def _texts(points: Any) -> list[list[str]]:
    return [[str(float(value)) if not isnan(value) else 'nan' for value in point]
            for point in points]


def check_clouds(data: bytes) -> None:
    """A cloud is read as by `struct`, moved and written again, or refused with one line."""
    from geometry_msgs.msg import Transform

    from puretf.geometry import do_transform_cloud
    from puretf.point_cloud2 import create_cloud, read_points, read_points_list, read_points_numpy
    cloud = _cloud(Input(data))
    before = bytes(cloud.data)
    for call in (
            lambda: do_transform_cloud(cloud, Transform()), lambda: read_points_list(cloud),
            lambda: read_points_numpy(cloud, skip_nans=True), lambda: read_points(
                cloud, reshape_organized_cloud=True, uvs=None, skip_nans=not cloud.is_dense)):
        with suppress(ValueError, AssertionError):
            call()
    try:
        points = read_points(cloud)
    except (ValueError, AssertionError) as error:
        text = str(error)
        assert text.isprintable(), repr(text)
        assert 0 < len(text) < 1000
        return
    assert bytes(cloud.data) == before
    assert points.size <= len(before)
    # Rule: as in sensor_msgs_py, fields that overlap are not converted to another byte order.
    if not (cloud.is_bigendian and _overlap(cloud.fields)):
        assert _texts(points.tolist()) == _texts(_expected(cloud))
    again = create_cloud(cloud.header, cloud.fields, points, cloud.point_step)
    assert _texts(read_points(again).tolist()) == _texts(points.tolist())


def seeds_of_clouds() -> Iterator[bytes]:
    """Yield clouds with x, y, z, of each size, and of each count."""
    for height, width, point_step in (1, 2, 12), (2, 2, 12), (0, 0, 12), (3, 1, 16):
        yield bytes([0, 1, 0, 1, 1, height, 1, width, 1, point_step, 1, 12 * width, 200, 0]) + (
            bytes(range(200)))
    for number in range(len(_SIZES)):
        yield bytes([0, 0, 0, 1, 0, number, 0, number, 0, number, 0, number, 9, 0]) + bytes(9)
    for number in range(len(_COUNTS)):
        yield bytes([1, 0, 2, 1, 0, number, 0, 0, 1, 1, 1, 1, 1, 1, 40, 1, 40, 40, 0]) + bytes(40)
