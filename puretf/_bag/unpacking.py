"""Decompression within limits of what is compressed by zstd: whole files, and single messages."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
import shutil
import sys
from typing import Any

#: A std_msgs/Header with a frame_id of usual length takes no more than this (bytes).
_HEADER = 2000
#: The first bytes of data that are compressed by zstd; a message in CDR never begins with them.
ZSTD = b'\x28\xb5\x2f\xfd'


class Oversized(Exception):
    """A chunk or a message is larger than the limit."""

    def __init__(self, what: str, size: str, limit: int) -> None:
        super().__init__(f'{what} takes {size} bytes, more than the limit of {limit}: if this '
                         'size is expected, pass a larger max_bytes to bag.read')


def unpack_file(path: Path, whole: Path, advance: Callable[[float], object]) -> None:
    """
    Decompress a file into a temporary one, but fill no more than half of the free space.

    Of a file that is cut off, what can be decompressed is written before the EOFError.
    """
    limit, size = shutil.disk_usage(whole.parent).free // 2, max(1, path.stat().st_size)
    with path.open('rb') as source, whole.open('wb') as target:
        file = _zstd().ZstdFile(source)
        while piece := file.read1(2**18):
            advance(source.tell() / size)
            if target.tell() + len(piece) > limit:
                raise OSError(f'its temporary copy takes more than {limit} bytes, half of the '
                              f'free space in {whole.parent.parent}: set TMPDIR to a directory '
                              'with more space')
            target.write(piece)


def unpack_message(data: bytes, limit: int) -> bytes:
    """Decompress a message, if it is compressed; raise `Oversized` if it is too large."""
    if len(data) > limit:
        raise Oversized('a message', str(len(data)), limit)
    if data[:4] == ZSTD:
        decompressor = _zstd().ZstdDecompressor()
        size, data = len(data), decompressor.decompress(data, limit + 1)
        if len(data) > limit:
            raise Oversized(f'a message of {size} bytes', f'more than {limit}', limit)
        if not decompressor.eof:
            raise EOFError('the compressed data of a message end too early')
    return data


def first_bytes(data: bytes) -> bytes:
    """Return at least the first bytes of a message, with its header; b'' if it is damaged."""
    try:
        return _zstd().ZstdDecompressor().decompress(data, _HEADER) if data[:4] == ZSTD else data
    except Exception:  # the sample does without this message
        return b''


def _zstd() -> Any:
    """Return the module `compression.zstd`, or its backport if Python is older than 3.14."""
    return import_module('compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd')
