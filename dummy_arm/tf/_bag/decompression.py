"""
Decompression within limits.

A few kilobytes can decompress to many gigabytes, and a size that a file declares may be wrong. So
everything here is decompressed in pieces: their sum is compared with what is declared and with the
limit of the caller, and the function `tick` of the caller, which may raise, is called before each.
"""

from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from io import BytesIO
import sys
from typing import Any, BinaryIO, Optional, Union
import zlib

#: The first bytes of what zstd has compressed.
ZSTD = b'\x28\xb5\x2f\xfd'
#: The size of a piece (bytes). Larger ones take longer: their memory is new each time.
PIECE = 2**18
#: So much is read or decompressed in one go (bytes); bz2, the slowest, takes 0.1 s for it.
_SHORT = 2**21

#: What is longer than that comes as a bytearray, which grows in place.
Buffer = Union[bytes, bytearray]
#: Is called again and again while something takes long; what it raises ends that.
Tick = Callable[[], object]


class Oversized(Exception):
    """A chunk or a message is larger than the limit."""

    def __init__(self, what: str, size: str, limit: int) -> None:
        """
        Write the text of the error.

        :param what: the thing, and its size as it lies in the file.
        :param size: how large it is when decompressed.
        :param limit: how large it may be (bytes).
        """
        super().__init__(f'{what} takes {size} bytes, more than the limit of {limit}: if that is '
                         'right, give bag.read a larger max_bytes')


def pieces(source: BinaryIO, method: str, tick: Tick) -> Iterator[bytes]:
    """
    Decompress a stream, in pieces of at most 256 KiB.

    :param method: 'zstd', 'lz4' or 'bz2'.
    :raises EOFError: after the last piece, if the stream ends too early.
    :raises Exception: of a type of the library's, if it is damaged.
    """
    new = _decompressor(method)
    decompressor = new()
    while True:
        tick()
        data = b''
        if decompressor.eof:  # another stream may follow
            data = decompressor.unused_data or source.read(PIECE)
            if not data:
                return
            decompressor = new()
        elif decompressor.needs_input:
            data = source.read(PIECE)
            if not data:
                raise EOFError('what is compressed in it ends too early')
        if piece := decompressor.decompress(data, PIECE):
            yield piece


def decompressed(data: Buffer, method: str, declared: Optional[int], limit: int,
                 what: str, tick: Tick) -> Buffer:
    """
    Decompress a chunk or a message.

    :param method: 'zstd', 'lz4' or 'bz2'; anything else that is not empty is refused.
    :param declared: its size (bytes), if the file tells it.
    :param limit: the largest size that is allowed (bytes).
    :param what: 'chunk' or 'message', for the texts of errors.
    :raises Oversized: if it is larger than the limit; if that is declared, before anything is
        decompressed.
    :raises ValueError: if its size is another than declared.
    """
    if declared is not None and declared > limit:
        raise Oversized(_sized(what, data), str(declared), limit)
    if not method:
        whole: Buffer = data
    elif len(data) <= _SHORT and (short := _short(data, method, limit)) is not None:
        whole = short
    else:
        most = limit if declared is None else declared
        whole = bytearray()
        for piece in pieces(BytesIO(data), method, tick):
            if len(whole) + len(piece) > most:
                if declared is None:
                    raise Oversized(_sized(what, data), f'more than {most}', limit)
                raise ValueError(f'{_sized(what, data)} takes more than the {declared} bytes that '
                                 'it declares')
            whole += piece
    if declared is not None and len(whole) != declared:
        raise ValueError(f'{_sized(what, data)} takes {len(whole)} bytes, not the {declared} that '
                         'it declares')
    if len(whole) > limit:
        raise Oversized(_sized(what, data), str(len(whole)), limit)
    return whole


def _sized(what: str, data: Buffer) -> str:
    return f'a {what} of {len(data)} bytes'


def _short(data: Buffer, method: str, limit: int) -> Optional[bytes]:
    """Decompress in one go; return None if it is too long for that."""
    decompressor = _decompressor(method)()
    whole: bytes = decompressor.decompress(data, min(_SHORT, limit + 1))
    return whole if decompressor.eof and not decompressor.unused_data else None


def checksum(data: Buffer, tick: Tick) -> int:
    """Return the CRC-32 of data."""
    crc = 0
    view = memoryview(data)
    for start in range(0, len(data), 8 * PIECE):
        tick()
        crc = zlib.crc32(view[start:start + 8 * PIECE], crc)
    return crc


def read(file: BinaryIO, size: int, tick: Tick) -> Buffer:
    """Read so many bytes of a file, or what there is up to its end."""
    if size <= _SHORT:
        return file.read(size)
    whole = bytearray()
    while len(whole) < size and (piece := file.read(min(PIECE, size - len(whole)))):
        tick()
        whole += piece
    return whole


class Decompressed:
    """A file that is compressed as a whole by zstd, read as if it were not."""

    def __init__(self, file: BinaryIO, tick: Tick) -> None:
        """
        Keep the file.

        :param file: is read as far as that is necessary.
        """
        self._pieces = pieces(file, 'zstd', tick)
        self._piece = b''
        self._start = 0

    def read(self, size: int) -> bytes:
        """Read so many bytes, or what there is up to the end or the first damage."""
        data = self._piece[self._start:self._start + size]
        self._start += len(data)
        while len(data) < size and self._next():
            self._start = size - len(data)
            data += self._piece[:self._start]
            self._start = min(self._start, len(self._piece))
        return data

    def _next(self) -> bool:
        try:
            self._piece = next(self._pieces, b'')
        except (EOFError, zstd().ZstdError):
            self._piece = b''
        self._start = 0
        return bool(self._piece)


def zstd() -> Any:
    """Return the module `compression.zstd`, or its backport where Python does not have it."""
    return import_module('compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd')


@cache
def _decompressor(method: str) -> Callable[[], Any]:
    """Import a library when it is needed, and return its class."""
    if method == 'zstd':
        new: Callable[[], Any] = zstd().ZstdDecompressor
    elif method == 'lz4':
        import lz4.frame
        new = lz4.frame.LZ4FrameDecompressor
    elif method == 'bz2':
        import bz2
        new = bz2.BZ2Decompressor
    else:
        raise ValueError(f'it is compressed by {method!r}; known are bz2, lz4 and zstd')
    return new
