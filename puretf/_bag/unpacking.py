"""Decompression within limits of what is compressed by zstd: whole files, and single messages."""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
import shutil
import sys
from typing import Any, Union

from lz4.frame import LZ4FrameDecompressor

from puretf._bag.contents import Record

#: Part of Python since 3.14.
zstd: Any = import_module('compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd')
#: By the name of a method: what decompresses up to a number of bytes.
DECOMPRESSORS: dict[str, Any] = {'zstd': zstd.ZstdDecompressor, 'lz4': LZ4FrameDecompressor}
#: A message, or the fraction of a file that has been read.
Item = Union[Record, float]
#: The fraction is yielded once for so many messages.
TICK = 100
#: The first bytes of data that are compressed by zstd; a message in CDR never begins with them.
ZSTD = b'\x28\xb5\x2f\xfd'


def too_large(what: str, size: str, limit: int) -> ValueError:
    return ValueError(f'{what} takes {size} bytes, more than the limit of {limit}: if this size '
                      'is expected, pass a larger max_bytes to bag.read')


def unpack_file(path: Path, whole: Path) -> Iterator[float]:
    """
    Decompress a file into a temporary one, but fill no more than half of the free space.

    Of a file that is cut off, what can be decompressed is written before the EOFError, each time:
    only a copy that is complete is not written again.
    """
    if (mark := whole.with_name('is_complete')).exists():
        return
    limit, size = shutil.disk_usage(whole.parent).free // 2, path.stat().st_size
    with path.open('rb') as source, whole.open('wb') as target:
        file = zstd.ZstdFile(source)
        while piece := file.read1(2**18):
            yield source.tell() / size
            if target.tell() + len(piece) > limit:
                raise OSError(f'its temporary copy takes more than {limit} bytes, half of the '
                              f'free space in {whole.parent.parent}: set TMPDIR to a directory '
                              'with more space')
            target.write(piece)
    mark.touch()


def unpacked(data: bytes, limit: int) -> bytes:
    """Return the first bytes of a message, which may be compressed; b'' if it is damaged."""
    if data[:4] != ZSTD:
        return data
    try:
        return bytes(zstd.ZstdDecompressor().decompress(data, limit))
    except zstd.ZstdError:
        return b''
