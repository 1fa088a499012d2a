"""
The TF messages in a bag of rosbag2 (mcap or sqlite3), which may be cut off or damaged.

A bag is either a directory with `metadata.yaml` and storage files, or a single storage file.

- If `BagContext.partial` is False, all files that `metadata.yaml` lists must exist, and the first
  damaged part raises an error.
- If `BagContext.partial` is True, files may be missing. Every storage file in the directory is
  read from its beginning to its end. Damaged parts are skipped, and noted in `BagContext.damage`.

The order of the messages:

- Files are read one after the other, in the order in which `metadata.yaml` lists them. If
  `BagContext.partial` is True, files are read in the order of the numbers in their names.
- An mcap file is normally read with the index at its end. Messages are then ordered by log time,
  and chunks that certainly have no wanted messages are not decompressed.
- An mcap file is read sequentially if its index is missing or lists no chunks, if the file is
  compressed as a whole, or if `BagContext.partial` is True. Chunks, and messages outside chunks,
  are then read in the order of the file. The messages in a chunk are ordered by log time.
- The messages of an sqlite3 file are ordered by timestamp. If `BagContext.partial` is True, they
  are ordered by id, which is the order of writing.

A length in a file may be wrong. Therefore, before data are read, their length is compared with
`max_bytes` and with the size of the rest of the file or chunk. If a file is compressed as a whole,
the size of its rest is unknown, and the length is compared only with `max_bytes`.
"""

from array import array
from collections.abc import Iterator
from contextlib import closing, ExitStack, suppress
from heapq import heappop, heappush
from io import BytesIO
import logging
import os
from pathlib import Path, PurePath
import re
import shutil
import sqlite3
import struct
import sys
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, Optional, Union

import numpy as np

from dummy_arm.tf._bag.context import (
    BagContext,
    HEADERS,
    HeaderStream,
    NOT_RECORDED,
    Record,
    Stream,
)
from dummy_arm.tf._bag.decompression import (
    Buffer,
    checksum,
    decompress,
    DecompressedFile,
    Oversized,
    PIECE,
    pieces,
    read,
    Tick,
    ZSTD,
    zstd,
)
from dummy_arm.tf._bag.formats import BAG_DEFINITION, BagError, kind_of, refuse_special
from dummy_arm.tf._core.texts import visible
from dummy_arm.tf._wire import cdr

_Records = Iterator[Record]

#: Progress is reported once every `_ADVANCE` records of an mcap file or rows of a database. If an
#: mcap file is read with its index, progress is reported at each chunk instead.
_ADVANCE = 100
#: The largest number of files that the text of an error lists.
_SHOWN = 5
#: The newest version of metadata.yaml that can be read.
_NEWEST_VERSION = 9
_LONGEST_METADATA = 10_000_000  # bytes


class _CutOff(EOFError):
    """A file ends in the middle of a record, or before the end of its footer."""

    def __init__(self) -> None:
        super().__init__('it ends too early')


def records(path: Path, context: BagContext) -> _Records:
    """Yield the messages of TF, and the first ones of topics with headers."""
    if path.is_dir():
        files, is_compressed = _files(path, context)
    else:
        files, is_compressed = [path], None
    for number, file in enumerate(files):
        context.start_file(number, len(files))
        try:
            yield from _records_of_file(file, context, is_compressed)
        except Exception as error:  # several libraries raise errors of many types
            context.handle_error(file, error)


def _records_of_file(path: Path, context: BagContext, is_compressed: Optional[bool]) -> _Records:
    refuse_special(path)
    with path.open('rb') as file:
        is_zstd = file.read(len(ZSTD)) == ZSTD
        file.seek(0)
        if path.name.endswith('.mcap.zstd') if is_zstd else kind_of(path) == '.mcap':
            yield from _records_of_mcap(path, file, is_zstd, context)
        elif is_zstd:
            with TemporaryDirectory() as directory:
                whole = Path(directory, path.stem)
                try:
                    _write(pieces(file, 'zstd', context.tick), whole)
                except (EOFError, zstd().ZstdError) as error:
                    context.handle_error(path, error)
                yield from _records_of_sqlite(path, whole, context, is_compressed)
        else:
            yield from _records_of_sqlite(path, path, context, is_compressed)


def _write(parts: Iterator[Buffer], path: Path) -> None:
    """Write a temporary file, but fill no more than half of the free space."""
    directory = path.parent
    max_size = shutil.disk_usage(directory).free // 2
    size = 0
    with path.open('wb') as file:
        for part in parts:
            size += len(part)
            if size > max_size:
                raise OSError(
                    f'its temporary copy takes more than {max_size} bytes, half of the free space '
                    f'in {directory.parent}: set TMPDIR to a directory with more space')
            file.write(part)


# metadata.yaml


def _files(directory: Path, context: BagContext) -> tuple[list[Path], Optional[bool]]:
    """Return the storage files, and whether each message is compressed; None: not known."""
    files = _storage_files(directory)
    metadata = directory / 'metadata.yaml'
    refuse_special(metadata)
    if not metadata.exists():
        names = [visible(file.name) for file in files]
        if context.partial:
            logging.getLogger('dummy_arm.tf').warning(
                '%s has no metadata.yaml; reading %s', directory, ', '.join(names))
            return files, None
        raise BagError(
            f'{directory} has no metadata.yaml, which is written when a recording ends: read one '
            f'of its files ({", ".join(names[:_SHOWN])}), or, if the files are one recording, '
            'repair the bag by ros2 bag reindex or read it with partial=True (--partial)')
    try:
        from ruamel.yaml import YAML
        information = YAML(typ='safe').load(_text(metadata))[
            'rosbag2_bagfile_information']
        version, compression = int(information['version']), information.get('compression_format')
        mode = str(information.get('compression_mode') or 'none').lower()
        listed = [directory / PurePath(name).name for name in information['relative_file_paths']]
    except Exception as error:
        context.handle_error(metadata, error)
        return files, None
    if context.partial:
        return files, mode == 'message'
    if version > _NEWEST_VERSION:
        raise BagError(f'{directory} cannot be read: its version is {version}, the newest '
                       f'supported version is {_NEWEST_VERSION}')
    if mode != 'none' and compression != 'zstd':
        raise BagError(f'{directory} cannot be read: its compression format is '
                       f'{visible(repr(compression))}, not zstd')
    if missing := [visible(file.name) for file in listed if not file.exists()]:
        raise BagError(
            f'{directory} cannot be read: files that its metadata.yaml lists are missing: '
            f'{", ".join(missing[:_SHOWN])}; partial=True (--partial) reads the others')
    return listed, mode == 'message'


def _storage_files(directory: Path) -> list[Path]:
    """Return the storage files in a directory, in the order of the numbers in their names."""
    files = [path for path in directory.iterdir()
             if re.search(r'\.(mcap|db3)(\.zstd)?$', path.name)]
    if not files:
        raise BagError(f'{directory} is not a bag: {BAG_DEFINITION}')
    return sorted(files, key=lambda path: [
        part.zfill(20) if part.isdigit() else part for part in re.split(r'(\d+)', path.name)])


def _text(metadata: Path) -> str:
    with metadata.open('rb') as file:
        data = file.read(_LONGEST_METADATA + 1)
    if len(data) > _LONGEST_METADATA:
        raise ValueError(f'it has more than {_LONGEST_METADATA} bytes')
    return data.decode(errors='replace')


def _declares_messages(metadata: str) -> Optional[bool]:
    """Return whether each message is compressed separately; None: the metadata do not say it."""
    found = re.search(r'^ *compression_mode: *["\']?(\w*)', metadata, re.MULTILINE)
    return found[1].lower() == 'message' if found else None


# mcap

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX = 0x02, 0x03, 0x04, 0x05, 0x06, 0x08
_END = 1 + 8 + 20 + len(_MAGIC)  # length (bytes) of the footer and the final magic bytes
_unpack_head = struct.Struct('<BQ').unpack_from  # opcode and length of a record
_unpack_message = struct.Struct('<HIQQ').unpack_from  # channel, sequence, log time, publish time
_MESSAGE_HEAD = 22
_unpack_chunk = struct.Struct('<QQQII').unpack_from  # times, size, CRC, length of method name
_CHUNK_HEAD = 32
_SHORTEST_RECORD = {_MESSAGE: _MESSAGE_HEAD, _CHUNK: _CHUNK_HEAD + 8}
_LONGEST_METHOD = 16  # the largest length of the name of a compression method (bytes)
_unpack_size = struct.Struct('<Q').unpack_from
#: The largest total size of the messages that wait in `_McapReader.indexed` (bytes).
_MAX_WAITING = 2**26
#: The memory that a message takes in addition to its data (bytes).
_OVERHEAD = 200


class _Source:
    """A file whose bytes are read or skipped, and decompressed if necessary."""

    def __init__(self, file: BinaryIO, is_compressed: bool, tick: Tick) -> None:
        self._file, self._tick = file, tick
        self._stream: Any = DecompressedFile(file, tick) if is_compressed else file
        self.is_compressed = is_compressed
        self.size = os.fstat(file.fileno()).st_size
        #: The position in the decompressed file (bytes).
        self.position = 0

    def part(self) -> float:
        """Return the fraction of the file that has been read, from 0 to 1."""
        return self._file.tell() / max(1, self.size)

    def read(self, size: int) -> Buffer:
        """Read `size` bytes; fewer if the file ends early."""
        if not self.is_compressed:
            size = min(size, self.size - self.position)
        data = read(self._stream, size, self._tick)
        self.position += len(data)
        return data

    def exactly(self, size: int) -> Buffer:
        """Read `size` bytes; raise an EOFError if fewer are left."""
        data = self.read(size)
        if len(data) < size:
            raise _CutOff
        return data

    def skip(self, size: int) -> None:
        if self.is_compressed:
            while size > 0:
                self._tick()
                size -= len(self.exactly(min(size, PIECE)))
        elif size:
            self.seek(self.position + size)

    def seek(self, position: int) -> None:
        """Set the position in a file that is not compressed."""
        if position > self.size:
            raise _CutOff
        self._file.seek(position)
        self.position = position


def _records_of_mcap(path: Path, file: BinaryIO, is_zstd: bool, context: BagContext) -> _Records:
    source = _Source(file, is_zstd, context.tick)
    if source.read(len(_MAGIC)) != _MAGIC:
        raise ValueError('its first bytes are not those of an mcap file')
    reader = _McapReader(path, context, source)
    if context.partial or is_zstd or (chunks := reader.index()) is None:
        return reader.sequential()
    return reader.indexed(chunks)


class _McapReader:
    """A reader of the records of an mcap file."""

    def __init__(self, path: Path, context: BagContext, source: _Source) -> None:
        self._path, self._context, self._source = path, context, source
        self._max_bytes = context.max_bytes
        #: By the id of a schema: the message type and its definition.
        self._types: dict[int, tuple[str, str]] = {}
        self._streams: dict[int, Optional[Union[Stream, HeaderStream]]] = {}
        #: The ids of the channels of which certainly no message is wanted.
        self._unwanted_channels: set[int] = set()

    def index(self) -> Optional[list[tuple[int, int, frozenset[int]]]]:
        """
        Read the index at the end of the file; keep the streams of the channels in the index.

        The result is sorted: the earliest log time (ns), the position in the file and the channel
        ids (none: not known) of each chunk. It is None if there is no index, or no chunk in it.
        """
        source = self._source
        begin = source.position
        end = source.size - _END
        source.seek(max(end, begin))
        footer = source.exactly(_END)
        if footer[-len(_MAGIC):] != _MAGIC:
            raise _CutOff
        start, _, crc = struct.unpack_from('<QQI', footer, 9)
        if _unpack_head(footer) != (_FOOTER, 20) or (start and not begin <= start <= end):
            raise ValueError('its footer is damaged')
        if start == 0:
            source.seek(begin)
            return None
        if end - start > self._max_bytes:
            raise Oversized('its index', str(end - start), self._max_bytes)
        source.seek(start)
        summary = source.exactly(end - start)
        if crc and checksum(summary + footer[:25], self._context.tick) != crc:
            raise ValueError('the checksum of its index is wrong')
        chunks = {*self._chunks(summary)}
        source.seek(begin)
        if not chunks:
            return None
        return sorted((chunk for chunk in chunks if self._is_wanted(chunk[2])),
                      key=lambda chunk: chunk[:2])

    def _is_wanted(self, channels: frozenset[int]) -> bool:
        """Return True if a chunk with messages of these channels may have wanted messages."""
        return not channels or any(
            (stream := self._streams.get(channel)) is None or stream.is_wanted
            for channel in channels - self._unwanted_channels)

    def _chunks(self, summary: Buffer) -> Iterator[tuple[int, int, frozenset[int]]]:
        """
        Yield the earliest log time (ns), the position (bytes) and the channel ids of each chunk.

        The index also has schemas and channels: remember their message types and streams.
        """
        from mcap.data_stream import ReadDataStream
        from mcap.records import ChunkIndex
        for kind, start, end in _split(summary, self._context.tick):
            if kind == _CHUNK_INDEX:
                index = ChunkIndex.read(ReadDataStream(BytesIO(summary[start:end])))
                yield (index.message_start_time, index.chunk_start_offset,
                       frozenset(index.message_index_offsets))
            elif kind in (_SCHEMA, _CHANNEL):
                self._add_definition(kind, summary[start:end])

    def indexed(self, chunks: list[tuple[int, int, frozenset[int]]]) -> _Records:
        """
        Yield the wanted messages of indexed chunks, ordered by log time.

        The time ranges of chunks may overlap. A message therefore waits until no unread chunk can
        have a message with an earlier log time. If the waiting messages together take more than
        `_MAX_WAITING` bytes, the earliest waiting messages are yielded, even if the order may
        become wrong.
        """
        waiting: list[tuple[int, int, Union[Stream, HeaderStream], bytes]] = []
        size = count = 0
        for number, (_, position, channels) in enumerate(chunks):
            self._context.advance(number / len(chunks))
            following = chunks[number + 1][0] if number + 1 < len(chunks) else 2**64
            for stream, time, data in (
                    self._chunk_at(position) if self._is_wanted(channels) else ()):
                if not waiting and time <= following:
                    yield stream, time, data
                    continue
                count += 1
                size += len(data) + _OVERHEAD
                heappush(waiting, (time, count, stream, data))
                while size > _MAX_WAITING:
                    time, _, stream, data = heappop(waiting)
                    size -= len(data) + _OVERHEAD
                    yield stream, time, data
            while waiting and waiting[0][0] <= following:
                time, _, stream, data = heappop(waiting)
                size -= len(data) + _OVERHEAD
                yield stream, time, data

    def _chunk_at(self, position: int) -> _Records:
        self._source.seek(position)
        kind, length = _unpack_head(self._source.exactly(9))
        if kind != _CHUNK or length < _SHORTEST_RECORD[_CHUNK]:
            raise ValueError('its index is wrong: there is no chunk at a position that it lists')
        return self._chunk(length)

    def sequential(self) -> _Records:
        """Read the file from its beginning; yield its wanted messages."""
        source, number = self._source, 0
        while True:
            self._context.tick()
            if number % _ADVANCE == 0:
                self._context.advance(source.part())
            number += 1
            kind, length = _unpack_head(source.exactly(9))
            end = source.position + length
            if kind == 0:
                raise ValueError('no record begins where one should')
            try:
                yield from self._record(kind, length)
            except _CutOff:
                raise
            except Exception as error:
                self._context.handle_error(self._path, error)
            source.skip(end - source.position)
            if kind == _FOOTER:
                if source.read(len(_MAGIC)) != _MAGIC:
                    raise _CutOff
                return

    def _record(self, kind: int, length: int) -> _Records:
        """Yield the wanted messages of a record; `sequential` skips what is left of the record."""
        if length < _SHORTEST_RECORD.get(kind, 0):
            raise ValueError('a record ends too early')
        if kind == _CHUNK:
            yield from self._chunk(length)
        elif kind == _MESSAGE:
            channel, _, time, _ = _unpack_message(self._source.exactly(_MESSAGE_HEAD))
            if (stream := self._streams.get(channel)) and stream.is_wanted:
                size = self._check_size('a message', length - _MESSAGE_HEAD)
                message = self._message(self._source.exactly(size))
                if message is not None:
                    yield stream, time, message
        elif kind in (_SCHEMA, _CHANNEL):
            self._add_definition(kind, self._source.exactly(self._check_size('a record', length)))

    def _check_size(self, what: str, size: int) -> int:
        if size > self._max_bytes:
            raise Oversized(what, str(size), self._max_bytes)
        return size

    def _add_definition(self, kind: int, record: Buffer) -> None:
        """Keep the message type of a schema, or the stream of a channel."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema
        if kind == _SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(record)))
            self._types[schema.id] = schema.name, schema.data.decode(errors='replace')
            return
        channel = Channel.read(ReadDataStream(BytesIO(record)))
        msgtype, definition = self._types.get(channel.schema_id, ('', ''))
        encoded = _encoded(msgtype, channel.message_encoding)
        stream = self._context.stream(
            channel.topic, encoded, NOT_RECORDED, cdr, definition if encoded == msgtype else '')
        self._streams[channel.id] = stream
        if not stream and channel.schema_id in self._types:
            self._unwanted_channels.add(channel.id)

    def _chunk(self, length: int) -> _Records:
        """Read a chunk; yield its wanted messages in the order of their log times."""
        source = self._source
        _, _, size, crc, method_length = _unpack_chunk(source.exactly(_CHUNK_HEAD))
        if method_length > min(_LONGEST_METHOD, length - _SHORTEST_RECORD[_CHUNK]):
            raise ValueError('the header of a chunk is damaged')
        method = source.exactly(method_length).decode()
        (compressed_size,) = _unpack_size(source.exactly(8))
        if compressed_size > length - _SHORTEST_RECORD[_CHUNK] - method_length:
            raise ValueError('a chunk is larger than its record')
        self._check_size('a chunk', compressed_size)
        if size > self._max_bytes:
            raise Oversized(f'a chunk of {compressed_size} bytes', str(size), self._max_bytes)
        data = source.read(compressed_size)
        is_complete = len(data) == compressed_size
        if is_complete:
            data = decompress(data, method, size, self._max_bytes, 'chunk', self._context.tick)
            if crc and checksum(data, self._context.tick) != crc:
                raise ValueError('the checksum of a chunk is wrong')
        elif method or not self._context.partial:
            raise _CutOff
        yield from self._messages(data, is_complete)
        if not is_complete:
            raise _CutOff

    def _messages(self, data: Buffer, is_complete: bool) -> _Records:
        """Yield the wanted messages of a chunk in the order of their log times."""
        times, starts = array('Q'), array('Q')
        latest, is_ordered = 0, True
        try:
            for kind, start, end in _split(data, self._context.tick):
                if kind == _MESSAGE:
                    channel, _, time, _ = _unpack_message(data, start)
                    if (stream := self._streams.get(channel)) and stream.is_wanted:
                        times.append(time)
                        starts.append(start)
                        is_ordered = is_ordered and time >= latest
                        latest = time
                elif kind in (_SCHEMA, _CHANNEL):
                    self._add_definition(kind, data[start:end])
                elif kind == _CHUNK:
                    raise ValueError('a chunk is inside another chunk')
        except Exception as error:  # the library mcap raises errors of its own types
            if is_complete:
                self._context.handle_error(self._path, error)
        order: Any = range(len(times))
        if not is_ordered:
            order = np.argsort(np.frombuffer(times, np.uint64), kind='stable')
        for i in order:
            start = starts[i]
            _, length = _unpack_head(data, start - 9)
            stream = self._streams[_unpack_message(data, start)[0]]
            if stream and stream.is_wanted:
                message = self._message(data[start + _MESSAGE_HEAD:start + length])
                if message is not None:
                    yield stream, times[i], message

    def _message(self, data: Buffer) -> Optional[bytes]:
        """
        Return the bytes of a message; decompress them if they are compressed by zstd.

        Compressed bytes begin with the magic bytes of zstd. An uncompressed message in CDR never
        begins with these bytes.
        """
        if data[:4] != ZSTD:
            return bytes(data)
        return _decompressed(data, self._path, self._context)


def _split(data: Buffer, tick: Tick) -> Iterator[tuple[int, int, int]]:
    """Yield the opcode of each record, and where its content starts and ends in `data`."""
    end, size = 0, len(data)
    while end < size:
        tick()
        start = end + 9
        if start > size:
            raise ValueError('a record ends too early')
        kind, length = _unpack_head(data, end)
        end = start + length
        if end > size or kind == 0 or (kind == _MESSAGE and length < _MESSAGE_HEAD):
            raise ValueError('the length of a record is wrong')
        yield kind, start, end


def _encoded(msgtype: str, encoding: str) -> str:
    """
    Append the encoding to a message type, if the encoding is another one than CDR.

    A type with an appended encoding is no known type, so that `BagContext.stream` returns None for
    it.
    """
    return msgtype if encoding in ('cdr', '') else f'{msgtype} in {encoding}'


def _decompressed(data: Buffer, path: Path, context: BagContext) -> Optional[bytes]:
    """Decompress a message; if an error occurs, report it to the context and return None."""
    try:
        return bytes(decompress(data, 'zstd', None, context.max_bytes, 'message',
                                  context.tick))
    except Exception as error:
        context.handle_error(path, error)
        return None


# sqlite3

_LARGEST_ID = 2**63 - 1
#: A row of the query `_ROWS`: the id of a message, the id of the topic, the time of the recording
#: (ns), the length of the message (bytes), and the data of the message. The data are None in three
#: cases: they are NULL in the database, they are longer than `max_bytes`, or the topic has no
#: wanted messages.
_Row = tuple[int, int, Any, Optional[int], Optional[bytes]]
_ROWS = ('SELECT id, topic_id, timestamp, length(data), CASE WHEN topic_id IN ({topics}) AND '
         'length(data) <= {max_bytes} THEN CAST(data AS BLOB) END FROM messages')
_SMALLEST_LIMIT = 2**20


def _records_of_sqlite(path: Path, whole: Path, context: BagContext, is_compressed: Optional[bool]
                       ) -> _Records:
    log = path.with_name(f'{path.name}-wal')
    for other in log, path.with_name(f'{path.name}-shm'), path.with_name(f'{path.name}-journal'):
        refuse_special(other)
    has_log = log.exists() and log.stat().st_size > 0
    if has_log and not context.partial:
        raise BagError(f'{path} was not closed after recording, and {log.name} has data that '
                       'are not in the database yet: read the bag with partial=True (--partial)')
    with ExitStack() as stack:
        if context.partial:
            directory = Path(stack.enter_context(TemporaryDirectory()))
            whole = _without_incomplete_page(whole, log, directory, context.tick)
        uri = f'{whole.absolute().as_uri()}?mode=ro{"" if has_log else "&immutable=1"}'
        with closing(sqlite3.connect(uri, uri=True)) as database:
            yield from _SqliteReader(path, context, database, is_compressed).records()


def _without_incomplete_page(path: Path, log: Path, directory: Path, tick: Tick) -> Path:
    """
    Return the path of a database that has no incomplete page at its end.

    If the last page is incomplete, SQLite would read the missing part of this page as zeros. In
    this case, the database is copied without this page, and the path of the copy is returned. If
    all pages are complete, `path` is returned.
    """
    with path.open('rb') as file:
        page_size = int.from_bytes(file.read(18)[16:], 'big')
        size = path.stat().st_size
        page_size = 65536 if page_size == 1 else page_size
        if page_size < 512 or size % page_size == 0:
            return path
        file.seek(0)
        whole = directory / path.name
        _write(_parts(file, tick), whole)
    os.truncate(whole, size - size % page_size)
    if log.exists():
        with log.open('rb') as file:
            _write(_parts(file, tick), directory / log.name)
    return whole


def _parts(file: BinaryIO, tick: Tick) -> Iterator[Buffer]:
    while part := file.read(PIECE):
        tick()
        yield part


class _SqliteReader:
    """A reader of the messages in a database."""

    def __init__(self, path: Path, context: BagContext, database: sqlite3.Connection,
                 is_compressed: Optional[bool]) -> None:
        self._path, self._context, self._database = path, context, database
        self._max_bytes = context.max_bytes
        database.set_progress_handler(self._must_stop, 50_000)
        database.text_factory = lambda data: data.decode(errors='replace')
        # `setlimit` is new in Python 3.11. It limits the size of stored and of computed values.
        if sys.version_info >= (3, 11):
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(
                2**31 - 1, max(self._max_bytes, _SMALLEST_LIMIT)))
        if context.partial:
            database.execute('PRAGMA writable_schema = on')  # needed to read a truncated file
        self._is_compressed = (
            self._is_declared_compressed() if is_compressed is None else is_compressed)

    def records(self) -> _Records:
        tables = {name for (name,) in self._database.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'")}
        if missing := {'messages', 'topics'} - tables:
            raise ValueError(f'it is not a database of rosbag2, missing tables: '
                             f'{", ".join(sorted(missing))}')
        definitions: dict[str, str] = {}
        if self._context.with_headers and 'message_definitions' in tables:
            with suppress(sqlite3.DatabaseError):  # the table is damaged, or has other columns
                definitions = dict(self._database.execute(
                    'SELECT topic_type, encoded_message_definition FROM message_definitions'))
            self._context.tick()
        streams = {int(key): self._context.stream(
            str(topic), _encoded(str(msgtype), str(encoding)), NOT_RECORDED, cdr,
            str(definitions.get(msgtype) or ''))
            for key, topic, msgtype, encoding in self._database.execute(
                'SELECT id, name, type, serialization_format FROM topics')}
        topics = ', '.join(str(key) for key, stream in streams.items() if stream)
        if not topics:
            return
        query = _ROWS.format(topics=topics, max_bytes=self._max_bytes)
        if self._context.partial:
            rows = self._recover(query)
        else:
            tf_topics = ', '.join(
                str(key) for key, stream in streams.items() if isinstance(stream, Stream))
            ids = ', '.join(map(str, self._ids_of_headers(
                [key for key, stream in streams.items() if isinstance(stream, HeaderStream)])))
            rows = self._database.execute(f'{query} WHERE topic_id IN ({tf_topics}) '
                                          f'OR id IN ({ids}) ORDER BY timestamp, id')
        first, count = self._ids()
        max_bytes, is_plain = self._max_bytes, not self._is_compressed
        for number, (key, topic, time, length, data) in enumerate(rows):
            self._context.tick()
            if number % _ADVANCE == 0:
                self._context.advance(min(1.0, max(0, key - first) / count))
            if (stream := streams.get(topic)) and stream.is_wanted:
                time = time if type(time) is int else 0  # SQLite does not enforce column types
                if is_plain and data is not None and len(data) <= max_bytes:
                    yield stream, time, data
                elif (message := self._message(length, data)) is not None:
                    yield stream, time, message

    def _ids_of_headers(self, topics: list[int]) -> Iterator[int]:
        """Yield the ids of the messages whose headers are read: the first ones of each topic."""
        left = dict.fromkeys(topics, HEADERS)
        for key, topic in self._database.execute(
                'SELECT id, topic_id FROM messages WHERE topic_id IN '
                f'({", ".join(map(str, topics))}) ORDER BY timestamp, id'):
            if not left:
                return
            if topic in left:
                yield key
                left[topic] -= 1
                if not left[topic]:
                    del left[topic]

    def _must_stop(self) -> bool:
        """
        Call `tick`; return True if it raises an exception.

        If True is returned, SQLite ends the query with an error. The next call of `tick` raises
        the same exception.
        """
        try:
            self._context.tick()
        except BaseException:
            return True
        return False

    def _message(self, length: Optional[int], data: Optional[bytes]) -> Optional[bytes]:
        """Return the bytes of a message; None if it is too large or cannot be decompressed."""
        if max(length or 0, len(data or b'')) > self._max_bytes:
            self._context.handle_error(
                self._path, Oversized('a message', str(length), self._max_bytes))
            return None
        if data is None:  # NULL in the database; `bag.read` counts b'' as a malformed message
            return b''
        return _decompressed(data, self._path, self._context) if self._is_compressed else data

    def _is_declared_compressed(self) -> bool:
        """
        Return whether metadata declare that each message is compressed separately.

        First, `metadata.yaml` in the directory of the storage file is read. If it does not exist,
        does not name the storage file or has no compression mode, the table `metadata` of the
        database is read instead. If the table is missing or has no compression mode, False is
        returned.
        """
        metadata = self._path.with_name('metadata.yaml')
        refuse_special(metadata)
        if metadata.exists():
            text = _text(metadata)
            if self._path.name in text and (declared := _declares_messages(text)) is not None:
                return declared
        with suppress(sqlite3.DatabaseError):  # the table is missing or damaged
            for (text,) in self._database.execute(
                    'SELECT metadata FROM metadata WHERE length(metadata) < ? '
                    'ORDER BY id DESC LIMIT 1', (_LONGEST_METADATA,)):
                return bool(_declares_messages(str(text)))
        return False

    def _ids(self) -> tuple[int, int]:
        """
        Return the smallest id, and the number of ids from the smallest to the largest.

        Both numbers are 1 if there are no messages, or if the ids cannot be read.
        """
        try:
            ((first, last),) = self._database.execute('SELECT min(id), max(id) FROM messages')
        except sqlite3.DatabaseError:
            self._context.tick()
            return 1, 1
        return (1, 1) if first is None else (first, last - first + 1)

    def _recover(self, query: str) -> Iterator[_Row]:
        """
        Yield the rows that are found between damaged rows, ordered by id.

        If rows are damaged, the number of skipped ids is reported to the context.
        """
        first: Optional[int] = self._ids()[0]
        skipped, reason = 0, ''
        while first is not None and first <= _LARGEST_ID:
            try:
                for row in self._database.execute(f'{query} WHERE id >= ? ORDER BY id', (first,)):
                    if row[0] < first:
                        raise sqlite3.DatabaseError('its records are not in order')
                    yield row
                    first = row[0] + 1
                break
            except sqlite3.DatabaseError as error:
                self._context.tick()
                reason = reason or str(error)
            # Is the row with the id `first` damaged, or only the row after it? (Python 3.10 reads
            # one row ahead.) To find out, read the row with the id `first` alone.
            try:
                row = self._read_row(query, first)
            except sqlite3.DatabaseError:
                self._context.tick()
                resumed = self._find_readable(query, first)
                skipped += max(1, (resumed or first) - first)
                first = resumed
            else:
                if row is None:
                    break
                yield row
                first = row[0] + 1
        if reason:
            least = 'at least ' if first is None else ''
            records = 'record' if skipped == 1 else 'records'
            self._context.handle_error(self._path, ValueError(
                f'{reason}; skipped {least}{skipped} damaged {records}'))

    def _read_row(self, query: str, first: int) -> Optional[_Row]:
        """Return the first row whose id is at least `first`; None if there is no such row."""
        row: Optional[_Row] = self._database.execute(
            f'{query} WHERE id >= ? ORDER BY id LIMIT 1', (first,)).fetchone()
        if row and row[0] < first:
            raise sqlite3.DatabaseError('its records are not in order')
        return row

    def _find_readable(self, query: str, first: int) -> Optional[int]:
        """
        Return an id from which rows can be read again; None if no such id is found.

        The ids `first + 1`, `first + 2`, `first + 4`, `first + 8` and so on are tried until a row
        can be read. The range between the last two of these ids is then bisected. So the search
        needs few queries, but it may skip readable rows between damaged rows.
        """
        step, bad = 1, first
        while not self._can_read(query, first + step):
            bad, step = first + step, 2 * step
            if first + step > _LARGEST_ID:
                return None
        good = first + step
        while good - bad > 1:
            middle = (bad + good) // 2
            if self._can_read(query, middle):
                good = middle
            else:
                bad = middle
        return good

    def _can_read(self, query: str, first: int) -> bool:
        """Return False if the first row whose id is at least `first` is damaged, else True."""
        try:
            self._read_row(query, first)
        except sqlite3.DatabaseError:
            self._context.tick()
            return False
        return True
