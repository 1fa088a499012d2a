"""Decompression within limits of what is compressed by zstd: whole files, and single messages."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
import shutil
import sys
from typing import Any

#: The first bytes of data that are compressed by zstd; a message in CDR never begins with them.
ZSTD = b'\x28\xb5\x2f\xfd'
_PIECE = 2**18  # bytes


class Oversized(Exception):
    """A chunk or a message is larger than the limit."""

    def __init__(self, what: str, size: str, limit: int) -> None:
        super().__init__(f'{what} takes {size} bytes, more than the limit of {limit}: if this '
                         'size is expected, pass a larger max_bytes to bag.read')


def unpack_file(path: Path, whole: Path, advance: Callable[[float], object]) -> None:
    """
    Decompress a file into a temporary one, but fill no more than half of the free space.

    Of a file that is cut off, what can be decompressed is written before the EOFError.

    :param advance: called with the fraction of the file that has been read.
    """
    max_size, size = shutil.disk_usage(whole.parent).free // 2, 0
    decompressor, compressed_size = _zstd().ZstdDecompressor(), max(1, path.stat().st_size)
    with path.open('rb') as source, whole.open('wb') as target:
        data = source.read(_PIECE)
        while data or not decompressor.needs_input:
            advance(min(1.0, source.tell() / compressed_size))
            piece = decompressor.decompress(data, _PIECE)
            target.write(piece)
            size += len(piece)
            if size > max_size:
                raise OSError(
                    f'its temporary copy takes more than {max_size} bytes, half of the free space '
                    f'in {whole.parent.parent}: set TMPDIR to a directory with more space')
            data = b''
            if decompressor.eof:  # other data that were compressed separately may follow
                data = decompressor.unused_data or source.read(_PIECE)
                if not data:
                    return
                decompressor = _zstd().ZstdDecompressor()
            elif decompressor.needs_input:
                data = source.read(_PIECE)
    raise EOFError('its compressed data end too early')


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


def _zstd() -> Any:
    """Return the module `compression.zstd`, or its backport if Python is older than 3.14."""
    return import_module('compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd')
