"""
The TF messages in a bag of ROS 1.

The bag is read sequentially, without its index, because the index may be larger than the TF
messages.

A bag file consists of `#ROSBAG V2.0`, a newline, and records. A record consists of four parts: the
length of its header, the header, the length of its data, and the data. A header consists of
fields. A field consists of its length, a name, `=` and a value. All lengths are uint32, in bytes.

A length in a file may be wrong. Therefore, before data are read, their length is compared with
`max_bytes` and with the size of the rest of the file or chunk.
"""

from collections.abc import Iterator
from os import SEEK_CUR
from pathlib import Path
import re
import struct
from typing import BinaryIO, Optional, Union

from dummy_arm.tf._bag.context import BagContext, HeaderStream, NOT_RECORDED, Record, Stream
from dummy_arm.tf._bag.decompression import Buffer, decompress, Oversized, read
from dummy_arm.tf._core.times import SECOND
from dummy_arm.tf._wire import ros1

_Records = Iterator[Record]
_Fields = dict[bytes, bytes]

_MAGIC = b'#ROSBAG V2.0\n'
_MESSAGE, _BAG, _CHUNK, _CONNECTION = b'\x02', b'\x03', b'\x05', b'\x07'
#: Progress is reported once every `_ADVANCE` records.
_ADVANCE = 100
_unpack_length = struct.Struct('<I').unpack_from
_unpack_time = struct.Struct('<II').unpack_from  # seconds and nanoseconds


class _CutOff(EOFError):
    """A file or a chunk ends in the middle of a record."""

    def __init__(self) -> None:
        super().__init__('it ends in the middle of a record')


def records(path: Path, context: BagContext) -> _Records:
    """Yield the wanted messages of a bag, in the order of the file."""
    size = path.stat().st_size
    with path.open('rb') as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError('its version is not 2.0')
        reader = _Reader(path, context, file, size)
        fields, length = reader.record_header()
        if fields[b'op'] != _BAG:
            raise ValueError('its first record is not the header of a bag')
        if fields.get(b'encryptor'):
            raise ValueError('it is encrypted')
        has_index = 0 < int.from_bytes(fields[b'index_pos'], 'little') <= size
        if not has_index and not context.partial:
            raise EOFError('it has no index')
        file.seek(length, SEEK_CUR)
        number = 0
        while file.tell() < size:
            context.tick()
            if number % _ADVANCE == 0:
                context.advance(file.tell() / size)
            yield from reader.record()
            number += 1
        if not has_index:
            raise EOFError('it has no index')


class _Reader:
    """A reader of the records of a file."""

    def __init__(self, path: Path, context: BagContext, file: BinaryIO, size: int) -> None:
        self._path, self._context, self._file, self._size = path, context, file, size
        self._streams: dict[bytes, Optional[Union[Stream, HeaderStream]]] = {}

    def record_header(self) -> tuple[_Fields, int]:
        """Read the header of a record."""
        file = self._file
        length = int.from_bytes(file.read(4), 'little')
        if length > self._size - file.tell():
            raise _CutOff
        if length > self._context.max_bytes:
            raise Oversized('the header of a record', str(length), self._context.max_bytes)
        fields = _fields(read(file, length, self._context.tick))
        data = file.read(4)
        if len(data) < 4:
            raise _CutOff
        return fields, int.from_bytes(data, 'little')

    def record(self) -> _Records:
        """
        Read the next record.

        Only chunks, connections and wanted messages are read; other records are skipped.
        """
        fields, size = self.record_header()
        kind = fields[b'op']
        stream = self._streams.get(fields[b'conn']) if kind == _MESSAGE else None
        if kind not in (_CHUNK, _CONNECTION) and not (stream and stream.is_wanted):
            self._file.seek(size, SEEK_CUR)
            return
        if size > self._context.max_bytes:
            self._context.handle_error(self._path, Oversized(
                'a record', str(size), self._context.max_bytes))
            self._file.seek(size, SEEK_CUR)
            return
        data = read(self._file, min(size, self._size - self._file.tell()), self._context.tick)
        is_complete = len(data) == size
        if kind == _CHUNK:
            try:
                yield from self._chunk(fields, data, is_complete)
            except Exception as error:
                if not is_complete:
                    raise
                self._context.handle_error(self._path, error)
        if not is_complete:
            raise _CutOff
        if kind == _CONNECTION:
            self._add_connection(fields, data)
        elif stream:
            yield stream, _time(fields), bytes(data)

    def _chunk(self, fields: _Fields, data: Buffer, is_complete: bool) -> _Records:
        """Yield the wanted messages of a chunk; keep the streams of its connections."""
        method = fields[b'compression'].decode()
        if is_complete or method != 'none':
            data = decompress(
                data, '' if method == 'none' else method, _unpack_length(fields[b'size'])[0],
                self._context.max_bytes, 'chunk', self._context.tick)
        position, end = 0, len(data)
        while position < end:
            self._context.tick()
            if position + 4 > end:
                raise _CutOff
            start = position + 4 + _unpack_length(data, position)[0]
            if start + 4 > end:
                raise _CutOff
            fields = _fields(data[position + 4:start])
            position = start + 4 + _unpack_length(data, start)[0]
            if position > end:
                raise _CutOff
            kind = fields[b'op']
            if kind == _MESSAGE:
                if (stream := self._streams.get(fields[b'conn'])) and stream.is_wanted:
                    yield stream, _time(fields), bytes(data[start + 4:position])
            elif kind == _CONNECTION:
                self._add_connection(fields, data[start + 4:position])
            elif kind == _CHUNK:
                raise ValueError('a chunk is inside another chunk')

    def _add_connection(self, fields: _Fields, data: Buffer) -> None:
        """
        Keep the stream of a connection.

        A connection is one publisher on one topic.
        """
        properties = _fields(data)
        msgtype = re.sub('^([^/]+)/([^/]+)$', r'\1/msg/\2', _text(properties[b'type']))
        self._streams[fields[b'conn']] = self._context.stream(
            _text(fields[b'topic']), msgtype,
            _text(properties.get(b'callerid', b'')) or NOT_RECORDED, ros1,
            _text(properties.get(b'message_definition', b'')))


def _fields(header: Buffer) -> _Fields:
    """Parse the fields of a header."""
    fields = {}
    position, end = 0, len(header)
    while position < end:
        if position + 4 > end:
            raise ValueError('the header of a record is damaged')
        start = position + 4
        position = start + _unpack_length(header, position)[0]
        name, found, value = bytes(header[start:position]).partition(b'=')
        if not found or position > end:
            raise ValueError('the header of a record is damaged')
        fields[name] = value
    return fields


def _time(fields: _Fields) -> int:
    """Return the time at which a message was recorded (ns); 0 if its header has no time."""
    if len(value := fields.get(b'time', b'')) != 8:
        return 0
    seconds, nanoseconds = _unpack_time(value)
    return int(seconds) * SECOND + int(nanoseconds)


def _text(value: bytes) -> str:
    return value.decode(errors='replace')
