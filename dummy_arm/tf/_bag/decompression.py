"""
Decompression within limits.

A few kilobytes can decompress to many gigabytes, and a size that a file declares may be wrong.
Therefore, long data are decompressed in pieces. The total size of the pieces is compared with the
declared size or, if no size is declared, with the limit of the caller. Before each piece, the
function `tick` of the caller is called. If `tick` raises an exception, the decompression ends.
"""

from collections.abc import Callable, Iterator
from importlib import import_module
from io import BytesIO
import sys
from typing import Any, BinaryIO, Optional, Union
import zlib

#: The first bytes of data that are compressed by zstd.
ZSTD = b'\x28\xb5\x2f\xfd'
#: The largest size of a piece (bytes). Larger pieces would be slower, because the memory of one
#: piece would not be reused for the next piece.
PIECE = 2**18
#: Data of at most this size (bytes) are read or decompressed in one call. The slowest method, bz2,
#: takes 0.1 s for this size.
_SHORT = 2**21

#: Data in memory. Pieces are joined in a bytearray, because a bytearray grows in place.
Buffer = Union[bytes, bytearray]
#: A function that is called repeatedly during a long operation. If the function raises an
#: exception, the operation ends with this exception.
Tick = Callable[[], object]


class Oversized(Exception):
    """A chunk, a message or another part of a file is larger than the limit."""

    def __init__(self, what: str, size: str, limit: int) -> None:
        super().__init__(f'{what} takes {size} bytes, more than the limit of {limit}: if this '
                         'size is expected, pass a larger max_bytes to bag.read')


def pieces(source: BinaryIO, method: str, tick: Tick) -> Iterator[bytes]:
    """Decompress a file, in pieces of at most 256 KiB."""
    new = _decompressor(method)
    decompressor = new()
    while True:
        tick()
        data = b''
        if decompressor.eof:  # other data that were compressed separately may follow
            data = decompressor.unused_data or source.read(PIECE)
            if not data:
                return
            decompressor = new()
        elif decompressor.needs_input:
            data = source.read(PIECE)
            if not data:
                raise EOFError('its compressed data end too early')
        if piece := decompressor.decompress(data, PIECE):
            yield piece


def decompress(data: Buffer, method: str, declared: Optional[int], limit: int,
                 what: str, tick: Tick) -> Buffer:
    """Decompress a chunk or a message."""
    if declared is not None and declared > limit:
        raise Oversized(_sized(what, data), str(declared), limit)
    if not method:
        result: Buffer = data
    elif len(data) <= _SHORT and (short := _short(data, method, limit)) is not None:
        result = short
    else:
        max_size = limit if declared is None else declared
        result = bytearray()
        for piece in pieces(BytesIO(data), method, tick):
            if len(result) + len(piece) > max_size:
                if declared is None:
                    raise Oversized(_sized(what, data), f'more than {max_size}', limit)
                raise ValueError(f'{_sized(what, data)} takes more than the {declared} bytes that '
                                 'it declares')
            result += piece
    if declared is not None and len(result) != declared:
        raise ValueError(f'{_sized(what, data)} takes {len(result)} bytes, not the {declared} '
                         'that it declares')
    if len(result) > limit:
        raise Oversized(_sized(what, data), str(len(result)), limit)
    return result


def _sized(what: str, data: Buffer) -> str:
    return f'a {what} of {len(data)} bytes'


def _short(data: Buffer, method: str, limit: int) -> Optional[bytes]:
    """Decompress data in one call; return None if one call does not decompress all data."""
    decompressor = _decompressor(method)()
    result: bytes = decompressor.decompress(data, min(_SHORT, limit + 1))
    return result if decompressor.eof and not decompressor.unused_data else None


def checksum(data: Buffer, tick: Tick) -> int:
    """Compute a checksum."""
    crc = 0
    view = memoryview(data)
    for start in range(0, len(data), 8 * PIECE):
        tick()
        crc = zlib.crc32(view[start:start + 8 * PIECE], crc)
    return crc


def read(file: BinaryIO, size: int, tick: Tick) -> Buffer:
    """Read bytes from a file."""
    if size <= _SHORT:
        return file.read(size)
    result = bytearray()
    while len(result) < size and (piece := file.read(min(PIECE, size - len(result)))):
        tick()
        result += piece
    return result


class DecompressedFile:
    """A file that is compressed as a whole by zstd, and decompressed while it is read."""

    def __init__(self, file: BinaryIO, tick: Tick) -> None:
        self._pieces = pieces(file, 'zstd', tick)
        self._piece = b''
        self._start = 0

    def read(self, size: int) -> bytes:
        """Read decompressed bytes."""
        data = self._piece[self._start:self._start + size]
        self._start += len(data)
        while len(data) < size and self._next():
            self._start = size - len(data)
            data += self._piece[:self._start]
            self._start = min(self._start, len(self._piece))
        return data

    def _next(self) -> bool:
        """Decompress the next piece; return False if the file has ended or is damaged."""
        try:
            self._piece = next(self._pieces, b'')
        except (EOFError, zstd().ZstdError):
            self._piece = b''
        self._start = 0
        return bool(self._piece)


def zstd() -> Any:
    """Return the module `compression.zstd`, or its backport if Python is older than 3.14."""
    return import_module('compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd')


def _decompressor(method: str) -> Callable[[], Any]:
    """
    Return a function that creates a decompressor.

    The library of a method is imported when the method is first used.
    """
    if method == 'zstd':
        new: Callable[[], Any] = zstd().ZstdDecompressor
    elif method == 'lz4':
        import lz4.frame
        new = lz4.frame.LZ4FrameDecompressor
    elif method == 'bz2':
        import bz2
        new = bz2.BZ2Decompressor
    else:
        raise ValueError(f'its compression {method!r} is unknown; known are bz2, lz4 and zstd')
    return new
