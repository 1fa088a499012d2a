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
from puretf._bag.unpacking import DECOMPRESSORS, Item, TICK, too_large

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _CHUNK_INDEX, _STATISTICS = (
    2, 3, 4, 5, 6, 7, 8, 11)
#: The begin of a record, of a message, and of a chunk: begin, end, size, checksum, and the length
#: of the name of its compression; of a chunk index: begin, end, place, length, and the size of its
#: channels with their places; of statistics: the size of the channels with their numbers of
#: messages.
_RECORD, _HEAD, _CHUNK_HEAD, _CHUNK_INDEX_HEAD, _STATISTICS_HEAD = map(
    Struct, ('<BQ', '<HIqq', '<qqQII', '<qqQQI', '<42xI'))
#: The begin of a message index: the channel and the size of its entries; a schema or channel: its
#: number and that of its schema; the length of a text.
_INDEX_HEAD, _NUMBERS, _LENGTH = map(Struct, ('<HI', '<HH', '<I'))
#: The last record of a file, and the magic behind it: kind, length, begin of the summary, begin of
#: its offsets, checksum.
_END = Struct('<BQQQI8s')
_LATEST = 2**63  # ns
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
        self._damage = len(contents.damage)  # of other files
        self._schemas = {0: ('', '')}  # the name and the definition
        self._topics: dict[int, Topic] = {}  # by channel
        self._chunks: list[_Chunk] = []
        #: By the place of a chunk: its length, begin, end and channels, by the chunk index.
        self._index: dict[int, tuple[int, int, int, frozenset[int]]] = {}
        #: Where the summary begins, if its checksum is right.
        self._summary_at: Optional[int] = None
        #: The numbers of messages by channel: by the statistics, and those that were found.
        self._announced, self._counts = Counter[int](), Counter[int]()

    def records(self) -> Iterator[Item]:
        """Yield the messages that are read, in the order of time if they are in chunks."""
        with self._path.open('rb') as file:
            for items in self._in_summary(file), self._in_data(file), self._in_chunks(file):
                try:
                    yield from items
                except Exception as error:
                    self._contents.add_damage(error)

    def _in_summary(self, file: BinaryIO) -> Iterator[Item]:
        at = self._size - _END.size
        file.seek(max(0, at))
        kind, _, start, _, checksum, magic = _END.unpack(
            file.read(_END.size).rjust(_END.size, b'\0'))
        if kind != _FOOTER or magic != _MAGIC or not checksum:
            return
        start = start or at  # there is only a footer
        file.seek(min(start, at))
        if crc32(self._read(file, max(0, self._size - 12 - start), 'the summary')) != checksum:
            raise ValueError('the checksum of its summary is wrong')
        yield from self._items(file, start, self._size)
        self._summary_at = start

    def _in_data(self, file: BinaryIO) -> Iterator[Item]:
        """Yield the messages that are not in chunks; find the chunks."""
        yield from self._items(file, 8, self._summary_at or self._size)
        if self._summary_at is None:
            if self._contents.damage[self._damage:]:
                self._topics.clear()  # which may be wrong; chunks repeat them
        elif self._index and self._index != {
                chunk.at: (*chunk[1:4], frozenset(chunk.counts)) for chunk in self._chunks}:
            self._index.clear()
            raise ValueError('its chunks, or the message indexes behind them, are not as the '
                             'chunk index in its summary says')

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
                    found, span = self._messages(
                        _RECORD.pack(kind, length) + self._read(file, length))
                    self._contents.add_span(*span)
                    yield from found
                elif kind == _CHUNK:
                    first, last, _, checksum, _ = _CHUNK_HEAD.unpack(
                        file.read(min(length, _CHUNK_HEAD.size)))
                    self._chunks.append(_Chunk(begin, length, first, last, checksum > 0, {}))
                elif kind == _INDEX:
                    channel, size = _INDEX_HEAD.unpack(file.read(min(length, _INDEX_HEAD.size)))
                    if size > length - _INDEX_HEAD.size or size % 16 or not self._chunks:
                        raise struct.error
                    self._chunks[-1].counts[channel] = size // 16
                elif kind in (_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS):
                    self._define(kind, self._read(file, length))
            except struct.error:
                raise _too_short(length) from None
            number += 1
            if number % TICK == 0:
                yield at / self._size

    def _read(self, file: BinaryIO, size: int, what: str = 'a record') -> bytes:
        if size > (limit := self._contents.max_bytes):
            raise too_large(what, f'{size}', limit)
        return file.read(size)

    def _define(self, kind: int, data: bytes) -> None:
        """Note a schema, a channel, a chunk index or statistics."""
        if kind == _CHUNK_INDEX:
            begin, end, at, length, size = _CHUNK_INDEX_HEAD.unpack_from(data)
            self._index[at + _RECORD.size] = (
                length - _RECORD.size, begin, end,
                frozenset(_map(data, _CHUNK_INDEX_HEAD.size, size)))
        elif kind == _STATISTICS:
            (size,) = _STATISTICS_HEAD.unpack_from(data)
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

    def _in_chunks(self, file: BinaryIO) -> Iterator[Item]:
        """Yield the messages in chunks in the order of time."""
        # By chunk: the earliest begin of all later ones.
        begins = [*accumulate((chunk.begin or _LATEST for chunk in reversed(self._chunks)),
                              min, initial=_LATEST)][-2::-1]
        waiting: list[Record] = []
        for chunk, next_begin in zip(self._chunks, begins):
            try:
                if not self._is_skipped(chunk):
                    self._read_chunk(chunk, file, waiting)
            except Exception as error:
                self._contents.add_damage(error)
            waiting.sort(key=_time)
            ready = bisect_left(waiting, next_begin, key=_time)
            yield from waiting[:ready]
            del waiting[:ready]
            yield (chunk.at + chunk.length) / self._size
        if self._announced and self._announced != self._counts and (
                len(self._contents.damage) == self._damage):
            raise ValueError(
                f'its statistics announce {self._announced.total()} messages, but '
                f'{self._counts.total()} were found, or others of a channel')

    def _is_skipped(self, chunk: _Chunk) -> bool:
        """Return True if it is known that no message of a chunk is read; count its messages."""
        is_known = not chunk.has_checksum if self._summary_at is None else chunk.at in self._index
        topics = [self._topics.get(channel) for channel in chunk.counts]
        if not is_known or not topics or any(topic is None or topic.is_read for topic in topics):
            return False
        self._contents.add_span(chunk.begin, chunk.end)
        self._count(chunk.counts)
        return True

    def _count(self, counts: dict[int, int]) -> None:
        self._counts.update(counts)
        for channel, count in counts.items():
            if topic := self._topics.get(channel):
                topic.count += count

    def _read_chunk(self, chunk: _Chunk, file: BinaryIO, waiting: list[Record]) -> None:
        found, span = self._messages(self._content(chunk, file))
        waiting += found
        self._contents.add_span(*span)
        if (self._summary_at is not None or chunk.has_checksum) and (
                chunk.begin, chunk.end) not in (span, (0, 0)):
            raise ValueError('the times in the head of a chunk are not those of its messages')

    def _messages(self, data: bytes) -> tuple[list[Record], tuple[int, int]]:
        """Count the messages among records; return those that are read, and the span of all."""
        found, channels, times = list[Record](), list[int](), list[int]()
        at = kind = length = 0
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
        except struct.error:
            raise _too_short(length) from None
        if at != len(data) or (data and not kind):
            raise EOFError('a chunk ends too early')
        counts = Counter(channels)
        self._count(counts)
        if counts.keys() - self._topics.keys():
            self._contents.add_damage(ValueError('a message has no channel'))
        return found, (min(times), max(times)) if times else (0, 0)

    def _content(self, chunk: _Chunk, file: BinaryIO) -> bytes:
        file.seek(chunk.at)
        _, _, size, checksum, named = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
        if max(size, chunk.length) > (limit := self._contents.max_bytes):
            raise too_large(f'a chunk of {chunk.length} bytes', f'{size}', limit)
        left = chunk.length - _CHUNK_HEAD.size - 8
        method = file.read(max(0, min(named, left)))
        length = int.from_bytes(file.read(8), 'little')
        if named + length > left:
            raise _too_short(chunk.length)
        data = file.read(length)
        if method in DECOMPRESSORS:
            data = DECOMPRESSORS[method]().decompress(data, size)
        if len(data) != size or (checksum and crc32(data) != checksum):
            raise ValueError('the size or the checksum of a chunk is wrong')
        return data


def _too_short(length: int) -> ValueError:
    return ValueError(f'a record of {length} bytes is shorter than its fields')


def _map(data: bytes, at: int, size: int) -> dict[int, int]:
    if size > len(data) - at or size % 10:
        raise struct.error
    return dict(iter_unpack('<HQ', data[at:at + size]))


def _texts(data: bytes, at: int) -> list[str]:
    texts = []
    for _ in range(3):
        (size,) = _LENGTH.unpack_from(data, at)
        begin, at = at + _LENGTH.size, at + _LENGTH.size + size
        if at > len(data):
            raise struct.error
        texts.append(data[begin:at].decode(errors='replace'))
    return texts
