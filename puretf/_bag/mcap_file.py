"""
The messages of an mcap file, with or without its index.

The records of the file are visited once; chunks, whose messages are counted behind them, are read
afterwards if they have messages that are wanted. See https://mcap.dev/spec.
"""

from bisect import bisect_left
from collections.abc import Iterator
from io import BytesIO
from itertools import accumulate
from operator import itemgetter
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple
from zlib import crc32

from puretf._bag.contents import Contents, Record, Topic
from puretf._bag.unpacking import DECOMPRESSORS, Item, TICK, too_large

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _STATISTICS = 2, 3, 4, 5, 6, 7, 11
#: The begin of a record, of a message, and of a chunk: begin, end, size, checksum, and the length
#: of the name of its compression.
_RECORD, _HEAD, _CHUNK_HEAD = map(struct.Struct, ('<BQ', '<HIqq', '<qqQII'))
_LATEST = 2**63  # ns
_time = itemgetter(1)


class _Chunk(NamedTuple):
    """Where a chunk is in the file, when it begins (ns), and its messages by channel."""

    at: int
    length: int
    begin: int
    counts: dict[int, int]


class McapFile:
    """The definitions and chunks that have been found in a file."""

    def __init__(self, path: Path, contents: Contents) -> None:
        self._path, self._contents, self._size = path, contents, path.stat().st_size
        self._schemas = {0: ('', '')}  # the name and the definition
        self._topics: dict[int, Topic] = {}  # by channel
        self._chunks: list[_Chunk] = []

    def records(self) -> Iterator[Item]:
        """Yield the messages that are read, in the order of time if they are in chunks."""
        with self._path.open('rb') as file:
            try:
                yield from self._items(file, 8, self._size)
            except Exception as error:
                self._contents.add_damage(error)
            # By chunk: the earliest begin of all later ones.
            begins = [*accumulate((chunk.begin or _LATEST for chunk in reversed(self._chunks)),
                                  min, initial=_LATEST)][-2::-1]
            waiting: list[Record] = []
            for chunk, next_begin in zip(self._chunks, begins):
                try:
                    waiting += self._in_chunk(chunk, file)
                except Exception as error:
                    self._contents.add_damage(error)
                waiting.sort(key=_time)
                ready = bisect_left(waiting, next_begin, key=_time)
                yield from waiting[:ready]
                del waiting[:ready]
                yield (chunk.at + chunk.length) / self._size

    def _items(self, file: BinaryIO, at: int, size: int) -> Iterator[Item]:
        """Yield the messages that are read in a file or a chunk; note definitions and chunks."""
        kind, is_chunk = 0, isinstance(file, BytesIO)
        while kind != _FOOTER and (at < size or not is_chunk):
            file.seek(at)
            kind, length = _RECORD.unpack(file.read(9).ljust(9, b'\0'))
            begin, at = at + 9, at + 9 + length
            if not kind or at > size:
                raise EOFError('it ends too early')
            if kind == _MESSAGE:
                channel, _, time, _ = _HEAD.unpack(file.read(_HEAD.size))
                if topic := self._topics.get(channel):
                    topic.count += 1
                    if topic.is_read:
                        yield topic, time, file.read(length - _HEAD.size)
                    if not is_chunk:
                        self._contents.add_span(time, time)
                        if topic.count % TICK == 0:
                            yield at / size
                elif not is_chunk:
                    raise ValueError('a message that is not in a chunk has no channel')
            elif kind in (_SCHEMA, _CHANNEL):
                self._define(kind, file.read(length))
            elif kind == _CHUNK:
                first, last, *_ = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
                self._chunks.append(_Chunk(begin, length, first, {}))
                self._contents.add_span(first, last)
            elif kind == _INDEX:
                channel, length = struct.unpack('<HI', file.read(6))
                self._chunks[-1].counts[channel] = length // 16
            elif kind == _STATISTICS:
                (count,) = struct.unpack('<22xI', file.read(26))
                if count != len(self._chunks):
                    raise ValueError(f'it has {len(self._chunks)} chunks, not {count}')
            elif kind == _FOOTER:
                start, _, checksum = struct.unpack('<QQI', file.read(20))
                file.seek(start)
                if checksum and crc32(file.read()[:-12]) != checksum:
                    self._topics.clear()  # which may be wrong; chunks repeat them
                    raise ValueError('the checksum of its summary is wrong')

    def _define(self, kind: int, data: bytes) -> None:
        number, schema = struct.unpack_from('<HH', data)
        if kind == _SCHEMA:
            name, _, definition, *_ = _strings(data[2:])
            self._schemas[number] = name, definition
        elif number not in self._topics and schema in self._schemas:
            name, encoding, qos, *_ = _strings(data[4:])
            self._topics[number] = self._contents.topic(
                name, *self._schemas[schema], encoding, qos)

    def _in_chunk(self, chunk: _Chunk, file: BinaryIO) -> list[Record]:
        """Return the messages in a chunk that are read, and count all."""
        topics = [self._topics.get(channel) for channel in chunk.counts]
        if topics and not any(topic is None or topic.is_read for topic in topics):
            for channel, count in chunk.counts.items():
                self._topics[channel].count += count
            return []
        file.seek(chunk.at)
        _, _, size, checksum, named = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
        if max(size, chunk.length) > self._contents.max_bytes:
            raise too_large(f'a chunk of {chunk.length} bytes', f'{size}',
                            self._contents.max_bytes)
        method, length = file.read(named), int.from_bytes(file.read(8), 'little')
        data = file.read(min(length, chunk.length))
        if method in DECOMPRESSORS:
            data = DECOMPRESSORS[method]().decompress(data, size)
        if len(data) != size or (checksum and crc32(data) != checksum):
            raise ValueError('the size or the checksum of a chunk is wrong')
        return [item for item in self._items(BytesIO(data), 0, size)
                if not isinstance(item, float)]


def _strings(data: bytes) -> Iterator[str]:
    """Yield the texts, each with its length before it; the last ones may be a map of texts."""
    while data:
        end = 4 + int.from_bytes(data[:4], 'little')
        yield data[4:end].decode(errors='replace')
        data = data[end:]
