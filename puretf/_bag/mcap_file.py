"""
The messages of an mcap file, with or without its index.

The records of the file are visited once; chunks, whose messages are counted behind them, are read
afterwards if they have messages that are wanted. See https://mcap.dev/spec.

A chunk is skipped by what the checksum of the summary covers: the chunk index. Without this, a
chunk with a checksum is read, and only one without is skipped by the message indexes behind it.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from itertools import accumulate
from operator import itemgetter
from pathlib import Path
import struct
from struct import iter_unpack, Struct
from typing import BinaryIO, NamedTuple, Optional
from zlib import crc32

from puretf._bag.contents import Contents, Record, Topic
from puretf._bag.unpacking import DECOMPRESSORS, Item, too_large

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _CHUNK_INDEX, _STATISTICS = (
    2, 3, 4, 5, 6, 7, 8, 11)
_NAMES = {_SCHEMA: 'schema', _CHANNEL: 'channel', _MESSAGE: 'message', _CHUNK: 'chunk',
          _INDEX: 'message index', _CHUNK_INDEX: 'chunk index', _STATISTICS: 'statistics'}
#: The begin of a record, of a message, and of a chunk: begin, end, size, checksum, and the length
#: of the name of its compression; of a chunk index: begin, end, place, length, and the size of its
#: channels with their places; of statistics: the number of chunks, and the size of the channels
#: with their numbers of messages.
_RECORD, _HEAD, _CHUNK_HEAD, _CHUNK_INDEX_HEAD, _STATISTICS_HEAD = map(
    Struct, ('<BQ', '<HIqq', '<qqQII', '<qqQQI', '<22xI16xI'))
#: The begin of a message index: the channel and the size of its entries; a schema or channel: its
#: number and that of its schema; the length of a text.
_INDEX_HEAD, _NUMBERS, _LENGTH = map(Struct, ('<HI', '<HH', '<I'))
#: The last record of a file, and the magic behind it: kind, length, begin of the summary, begin of
#: its offsets, checksum.
_END = Struct('<BQQQI8s')
_LATEST = 2**63  # ns
_PIECE = 2**20  # bytes
#: The progress is reported once for so many records.
_TICK = 1000
_time = itemgetter(1)


class _Chunk(NamedTuple):
    """Where a chunk is in the file, when it begins and ends (ns), and its messages by channel."""

    at: int
    length: int
    begin: int
    end: int
    has_checksum: bool
    counts: dict[int, int]


class McapFile:
    """The definitions and chunks that have been found in a file."""

    def __init__(self, path: Path, contents: Contents) -> None:
        self._path, self._contents, self._size = path, contents, path.stat().st_size
        self._schemas = {0: ('', '')}  # the name and the definition
        self._topics: dict[int, Topic] = {}  # by channel
        self._chunks: list[_Chunk] = []
        #: By the place of a chunk: its length, begin, end and channels, by the chunk index.
        self._index: dict[int, tuple[int, int, int, frozenset[int]]] = {}
        self._is_checked = False  # True if the checksum of the summary is right
        #: The numbers of chunks, and of messages by channel, by the statistics.
        self._chunk_count: Optional[int] = None
        self._announced: Counter[int] = Counter()
        self._counts: Counter[int] = Counter()  # of the messages that were found

    def records(self) -> Iterator[Item]:
        """Yield the messages that are read, in the order of time if they are in chunks."""
        contents, damage = self._contents, len(self._contents.damage)
        with self._path.open('rb') as file:
            end = self._size
            try:
                if start := self._checked_summary(file):
                    yield from self._items(file, start, end)
                    self._is_checked, end = True, start
            except Exception as error:
                contents.add_damage(error)
            try:
                yield from self._items(file, 8, end)
                if not self._is_checked and len(contents.damage) > damage:
                    self._topics.clear()  # which may be wrong; chunks repeat them
                self._check_index()
            except Exception as error:
                contents.add_damage(error)
            yield from self._in_chunks(file)
        if self._is_checked and self._announced and self._announced != self._counts and (
                len(contents.damage) == damage):
            contents.add_damage(ValueError(
                f'its statistics announce {self._announced.total()} messages, but '
                f'{self._counts.total()} were found, or others of a channel'))

    def _checked_summary(self, file: BinaryIO) -> int:
        """Return where the summary begins; 0 if it has no checksum."""
        at = self._size - _END.size
        file.seek(max(0, at))
        if len(end := file.read(_END.size)) < _END.size:
            return 0
        kind, _, start, _, checksum, magic = _END.unpack(end)
        if kind != _FOOTER or magic != _MAGIC or not checksum:
            return 0
        start = start or at  # there is only a footer
        left, crc = self._size - 12 - start, 0
        if left > (limit := self._contents.max_bytes):
            raise too_large('the summary', f'{left}', limit)
        file.seek(min(start, at))
        while left > 0 and (piece := file.read(min(left, _PIECE))):
            left, crc = left - len(piece), crc32(piece, crc)
        if crc != checksum:
            raise ValueError('the checksum of its summary is wrong')
        return int(start)

    def _items(self, file: BinaryIO, at: int, end: int) -> Iterator[Item]:
        """Yield the messages that are read and not in chunks; note definitions and chunks."""
        kind = number = 0
        while kind != _FOOTER and (at < end or end == self._size):
            file.seek(at)
            kind, length = _RECORD.unpack(file.read(_RECORD.size).ljust(_RECORD.size, b'\0'))
            begin, at = at + _RECORD.size, at + _RECORD.size + length
            if not kind or at > end:
                raise EOFError('it ends too early')
            try:
                if kind == _MESSAGE:
                    yield from self._message(file, length)
                elif kind == _CHUNK:
                    first, last, _, checksum, _ = _CHUNK_HEAD.unpack(
                        file.read(min(length, _CHUNK_HEAD.size)))
                    self._chunks.append(_Chunk(begin, length, first, last, checksum > 0, {}))
                elif kind == _INDEX:
                    channel, size = _INDEX_HEAD.unpack(file.read(min(length, _INDEX_HEAD.size)))
                    if size > length - _INDEX_HEAD.size or size % 16 or not self._chunks:
                        raise struct.error
                    self._chunks[-1].counts[channel] = size // 16
                elif kind in _NAMES:
                    self._define(kind, self._read(file, length))
            except struct.error:
                raise _too_short(kind, length) from None
            number += 1
            if number % _TICK == 0:
                yield at / self._size

    def _message(self, file: BinaryIO, length: int) -> Iterator[Record]:
        channel, _, time, _ = _HEAD.unpack(file.read(min(length, _HEAD.size)))
        topic = self._topics.get(channel)
        if topic is None:
            raise ValueError('a message that is not in a chunk has no channel')
        self._counts[channel] += 1
        topic.count += 1
        self._contents.add_span(time, time)
        if topic.is_read:
            yield topic, time, self._read(file, length - _HEAD.size)

    def _read(self, file: BinaryIO, length: int) -> bytes:
        if length > (limit := self._contents.max_bytes):
            raise too_large(f'a record of {length} bytes', f'{length}', limit)
        return file.read(length)

    def _define(self, kind: int, data: bytes) -> None:
        """Note a schema, a channel, a chunk index or statistics."""
        if kind == _CHUNK_INDEX:
            begin, end, at, length, size = _CHUNK_INDEX_HEAD.unpack_from(data)
            self._index[at + _RECORD.size] = (
                length - _RECORD.size, begin, end,
                frozenset(_map(data, _CHUNK_INDEX_HEAD.size, size)))
        elif kind == _STATISTICS:
            self._chunk_count, size = _STATISTICS_HEAD.unpack_from(data)
            self._announced = Counter(_map(data, _STATISTICS_HEAD.size, size))
        else:
            number, schema = _NUMBERS.unpack_from(data)
            if kind == _SCHEMA:
                name, _, definition = _texts(data, 2)
                self._schemas[number] = name, definition
            elif number not in self._topics and schema in self._schemas:
                name, encoding, qos = _texts(data, 4)  # qos: a map of texts
                self._topics[number] = self._contents.topic(
                    name, *self._schemas[schema], encoding, qos)

    def _is_indexed(self, chunk: _Chunk) -> bool:
        """Return True if a chunk is as the chunk index says, which has a checksum."""
        return self._is_checked and self._index.get(chunk.at) == (
            chunk.length, chunk.begin, chunk.end, frozenset(chunk.counts))

    def _check_index(self) -> None:
        if self._chunk_count not in (None, len(self._chunks)):
            raise ValueError(f'it has {len(self._chunks)} chunks, not {self._chunk_count}')
        if self._is_checked and self._index and (
                len(self._index) != len(self._chunks)
                or not all(map(self._is_indexed, self._chunks))):
            raise ValueError('its chunks, or the message indexes behind them, are not as the '
                             'chunk index in its summary says')

    def _in_chunks(self, file: BinaryIO) -> Iterator[Item]:
        # By chunk: the earliest begin of all later ones.
        begins = [*accumulate((chunk.begin or _LATEST for chunk in reversed(self._chunks)),
                              min, initial=_LATEST)][-2::-1]
        waiting: list[Record] = []
        for chunk, next_begin in zip(self._chunks, begins):
            try:
                if not self._is_skipped(chunk):
                    yield from self._in_chunk(chunk, file, waiting)
            except Exception as error:
                self._contents.add_damage(error)
            waiting.sort(key=_time)
            ready = bisect_left(waiting, next_begin, key=_time)
            yield from waiting[:ready]
            del waiting[:ready]
            yield (chunk.at + chunk.length) / self._size

    def _is_skipped(self, chunk: _Chunk) -> bool:
        """Return True if it is known that no message of a chunk is read; count its messages."""
        if self._is_indexed(chunk):
            self._contents.add_span(chunk.begin, chunk.end)
        elif self._is_checked or chunk.has_checksum:
            return False
        topics = [self._topics.get(channel) for channel in chunk.counts]
        if not topics or any(topic is None or topic.is_read for topic in topics):
            return False
        self._contents.add_span(chunk.begin, chunk.end)
        self._count(chunk.counts)
        return True

    def _count(self, counts: dict[int, int]) -> None:
        self._counts.update(counts)
        for channel, count in counts.items():
            if topic := self._topics.get(channel):
                topic.count += count

    def _in_chunk(self, chunk: _Chunk, file: BinaryIO, waiting: list[Record]) -> Iterator[float]:
        """Add the messages in a chunk that are read, and count all; yield the progress."""
        data, found = self._content(chunk, file), list[Record]()
        channels, times = list[int](), list[int]()
        at = number = kind = length = 0
        try:
            while at <= len(data) - _RECORD.size:
                kind, length = _RECORD.unpack_from(data, at)
                begin = at + _RECORD.size
                at = begin + length
                if not kind or at > len(data):
                    break
                if kind == _MESSAGE:
                    if length < _HEAD.size:
                        raise struct.error
                    channel, _, time, _ = _HEAD.unpack_from(data, begin)
                    channels.append(channel)
                    times.append(time)
                    topic = self._topics.get(channel)
                    if topic and topic.is_read:
                        found.append((topic, time, data[begin + _HEAD.size:at]))
                elif kind in (_SCHEMA, _CHANNEL):
                    self._define(kind, data[begin:at])
                number += 1
                if number % _TICK == 0:
                    yield chunk.at / self._size
        except struct.error:
            raise _too_short(kind, length) from None
        if at != len(data) or (data and not kind):
            raise EOFError('a chunk ends too early')
        waiting += found
        self._count(Counter(channels))
        span = (min(times), max(times)) if times else (0, 0)
        self._contents.add_span(*span)
        if (self._is_checked or chunk.has_checksum) and (chunk.begin, chunk.end) not in (
                span, (0, 0)):
            raise ValueError('the times in the head of a chunk are not those of its messages')

    def _content(self, chunk: _Chunk, file: BinaryIO) -> bytes:
        file.seek(chunk.at)
        _, _, size, checksum, named = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
        if max(size, chunk.length) > self._contents.max_bytes:
            raise too_large(f'a chunk of {chunk.length} bytes', f'{size}',
                            self._contents.max_bytes)
        left = chunk.length - _CHUNK_HEAD.size - 8
        method = file.read(max(0, min(named, left)))
        length = int.from_bytes(file.read(8), 'little')
        if named + length > left:
            raise _too_short(_CHUNK, chunk.length)
        data = file.read(length)
        if method in DECOMPRESSORS:
            data = DECOMPRESSORS[method]().decompress(data, size)
        if len(data) != size or (checksum and crc32(data) != checksum):
            raise ValueError('the size or the checksum of a chunk is wrong')
        return data


def _too_short(kind: int, length: int) -> ValueError:
    return ValueError(f'a {_NAMES[kind]} record of {length} bytes is shorter than its fields')


def _map(data: bytes, at: int, size: int) -> dict[int, int]:
    """Return a map of numbers by channel."""
    if size > len(data) - at or size % 10:
        raise struct.error
    return dict(iter_unpack('<HQ', data[at:at + size]))


def _texts(data: bytes, at: int) -> list[str]:
    """Return three texts, each with its length before it."""
    texts = []
    for _ in range(3):
        (size,) = _LENGTH.unpack_from(data, at)
        begin, at = at + _LENGTH.size, at + _LENGTH.size + size
        if at > len(data):
            raise struct.error
        texts.append(data[begin:at].decode(errors='replace'))
    return texts
