"""
Measure what small files and messages cost that claim much more than they hold.

`hostile.py` prints a table. Each line is from a process of its own: the size of the input, and the
time and the memory until it was read or refused, without those of the imports.
"""

from collections.abc import Callable
import json
from pathlib import Path
import resource
import struct
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from backports.zstd import compress as zstandard

_DAE = (
    '{before}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">{nodes}'
    '<library_geometries><geometry id="g"><mesh><source id="s"><float_array id="a" count="9">'
    '0 0 0 1 0 0 0 1 0</float_array><technique_common><accessor source="#a" count="3" stride="3">'
    '<param name="X"/><param name="Y"/><param name="Z"/></accessor></technique_common></source>'
    '<vertices id="v"><input semantic="POSITION" source="#s"/></vertices><triangles count="1">'
    '<input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry>'
    '</library_geometries><library_visual_scenes><visual_scene id="c"><node>{scene}</node>'
    '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#c"/></scene>'
    '</COLLADA>')
_LEAF = '<instance_geometry url="#g"/>'


def _attlist() -> bytes:
    return _DAE.format(
        before=f'<!DOCTYPE x [<!ATTLIST node z CDATA "{120_000 * "x"}">]>', nodes='',
        scene=_LEAF + 16_000 * '<node/>').encode()


def _nested() -> bytes:
    nodes = ''.join(f'<node id="d{i + 1}">' + 2 * f'<instance_node url="#d{i}"/>' + '</node>'
                    for i in range(24))
    return _DAE.format(
        before='', nodes=f'<library_nodes><node id="d0">{_LEAF}</node>{nodes}</library_nodes>',
        scene='<instance_node url="#d24"/>').encode()


def _without_data() -> bytes:
    text = json.dumps({
        'asset': {'version': '2.0'}, 'scenes': [{'nodes': [0]}], 'nodes': [{'mesh': 0}],
        'meshes': [{'primitives': [{'attributes': {'POSITION': 0}}]}],
        'accessors': [{'componentType': 5126, 'count': 200_000_000, 'type': 'MAT4'}],
        'bufferViews': []}).encode()
    text += b' ' * (-len(text) % 4)
    return struct.pack('<4sIII4s', b'glTF', 2, 20 + len(text), len(text), b'JSON') + text


def _cloud(width: int, point_step: int, count: int) -> Any:
    from sensor_msgs.msg import PointCloud2, PointField
    fields = [PointField(name='x', offset=0, datatype=PointField.UINT8, count=count)]
    return PointCloud2(height=1, width=width, point_step=point_step, fields=fields * (count > 0))


def _mcap(*records: bytes, summary: int = 0, size: int = 0) -> Callable[[Path], None]:
    """Return a function that writes a file with these records, which has a size (bytes), too."""
    def write(path: Path) -> None:
        with path.open('wb') as file:
            file.write(b'\x89MCAP0\r\n' + b''.join(records))
            file.seek(max(size, file.tell()))
            file.write(struct.pack('<BQQQI', 2, 20, summary, 0, 7 * (summary > 0))
                       + b'\x89MCAP0\r\n')

    return write


def _chunk(data: bytes) -> bytes:
    packed = zstandard(data)
    head = struct.pack('<QQQII4sQ', 0, 0, len(data), 0, 4, b'zstd', len(packed))
    return struct.pack('<BQ', 6, len(head) + len(packed)) + head + packed


def _short_messages() -> Callable[[Path], None]:
    return _mcap(_chunk(struct.pack('<BQ', 5, 0) * 33_000))


def _long_channel() -> Callable[[Path], None]:
    fields = b'\2\0\0\0' b'\2\0\0\0/x' b'\3\0\0\0cdr' + bytes(2**23)
    return _mcap(_chunk(struct.pack('<BQ', 4, len(fields)) + fields))


_CASES: dict[str, tuple[str, Callable[[], Any]]] = {
    '`.mcap`, a chunk of 33 000 messages of 0 bytes': ('.mcap', _short_messages),
    '`.mcap`, a channel with 8 MB behind its fields': ('.mcap', _long_channel),
    '`.mcap`, a sparse file that claims a summary of 3.9 GB': (
        '.mcap', lambda: _mcap(summary=8, size=3_900_000_000)),
    '`.dae`, a default attribute of 120 kB, 16 000 nodes': ('.dae', _attlist),
    '`.dae`, `<instance_node>` nested 24 deep': ('.dae', _nested),
    '`.glb`, an accessor of 200 million matrices without data': ('.glb', _without_data),
    'PointCloud2, a field with a count of 4 million': (
        '', lambda: _cloud(0, 4_000_000, 4_000_000)),
    'PointCloud2, 4 billion points of 0 bytes': ('', lambda: _cloud(2**32 - 1, 0, 0))}


def _measure(name: str) -> None:
    """Print a line of the table."""
    kind, make = _CASES[name]
    made = make()
    read: Callable[[], Any]
    with TemporaryDirectory() as folder:
        if kind == '.mcap':
            from puretf import bag
            path = Path(folder, 'a.mcap')
            made(path)
            size, read = path.stat().st_blocks * 512, lambda: bag.read(path)
        elif kind:
            from puretf_tools.view.meshes import load
            path = Path(folder, f'a{kind}')
            path.write_bytes(made)
            size, read = len(made), lambda: load(path)
        else:
            from rclpy.serialization import serialize_message

            from puretf.point_cloud2 import read_points_list
            size, read = len(serialize_message(made)), lambda: read_points_list(made)
        memory, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
        try:
            read()
            result = 'read'
        except Exception as error:
            result = str(error)
        seconds = time.perf_counter() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
    print(f'| {name} | {size:,} | {seconds:.3f} | {memory / 1024:.1f} | {result:.60} |')


if __name__ == '__main__':
    if len(sys.argv) > 1:
        _measure(sys.argv[1])
    else:
        print('| input | bytes | time (s) | memory (MiB) | result |\n|---|---|---|---|---|')
        for each in _CASES:
            subprocess.run([sys.executable, __file__, each], check=False, timeout=600)
