"""
Measure what small files and messages cost that claim much more than they hold.

`hostile.py` prints a table. Each line is from a process of its own: the size of the input, and the
time and the memory until it was read or refused, without those of the imports.
"""

from collections.abc import Callable
from pathlib import Path
import resource
import struct
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from backports.zstd import compress as zstandard


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
