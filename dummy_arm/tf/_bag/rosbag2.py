"""
The messages of TF in a bag of rosbag2: mcap or sqlite3, whole, cut off or damaged.

A bag is a directory with storage files and `metadata.yaml`, or one of the storage files. A bag
that is read as a whole must have all that its metadata declare, and the first damage is an error.
One that is read as partial may lack anything: every file is read from its beginning to its end,
and what is damaged in it is skipped and noted.

The order of the messages:

- Files come one after the other, as the metadata list them; without these, by their numbers.
- mcap: chunks and the messages in them come by log time, for which the index at the end of the
  file is read. Chunks without a message of TF are not even decompressed. Without an index, of a
  partial bag, and of a file that is compressed as a whole, chunks come as they lie in the file,
  and the messages in each by log time. Messages outside chunks come as they lie in the file.
- sqlite3: by time; of a partial bag by id, which is the order in which they were written.

No length in a file is believed: each is compared with what is left of the file or chunk, and with
`max_bytes`, before so much is read.
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
from typing import Any, BinaryIO, Optional

import numpy as np

from dummy_arm.tf._bag.context import (
    BagContext,
    BagError,
    kind_of,
    NOT_RECORDED,
    refuse_special,
    Stream,
    WHAT,
)
from dummy_arm.tf._bag.decompression import (
    Buffer,
    checksum,
    Decompressed,
    decompressed,
    Oversized,
    PIECE,
    pieces,
    read,
    Tick,
    ZSTD,
    zstd,
)
from dummy_arm.tf._core.texts import visible
from dummy_arm.tf._wire import cdr

_Records = Iterator[tuple[Stream, bytes]]

_ADVANCE = 100
_SHOWN = 5
_NEWEST_VERSION = 9
_LONGEST_METADATA = 10_000_000  # bytes


class _CutOff(EOFError):
    """A file ends in the midst of a record, or before its index."""

    def __init__(self) -> None:
        super().__init__('it ends too early')


def records(path: Path, context: BagContext) -> _Records:
    """
    Read the messages of TF.

    :param path: the directory of a bag, or a storage file.
    :param context: learns what there is, and what is wrong.
    :raises BagError: if it is no bag; or is damaged, and not to be read as partial.
    :raises OSError: if a file may not be read.
    """
    if path.is_dir():
        files, is_compressed = _files(path, context)
    else:
        files, is_compressed = [path], None
    for number, file in enumerate(files):
        context.start_file(number, len(files))
        try:
            yield from _records_of_file(file, context, is_compressed)
        except Exception as error:  # of several libraries, and of many types
            context.handle_error(file, error)


def _records_of_file(path: Path, context: BagContext, is_compressed: Optional[bool]) -> _Records:
    """
    Read a storage file.

    :param is_compressed: whether each message is, by the metadata of the bag; None: not known.
    """
    refuse_special(path)
    with path.open('rb') as file:
        is_packed = file.read(len(ZSTD)) == ZSTD
        file.seek(0)
        if path.name.endswith('.mcap.zstd') if is_packed else kind_of(path) == '.mcap':
            yield from _records_of_mcap(path, file, is_packed, context)
        elif is_packed:
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
    """
    Write a temporary file.

    :raises OSError: if it would take more than half of what is free.
    """
    directory = path.parent
    most = shutil.disk_usage(directory).free // 2
    size = 0
    with path.open('wb') as file:
        for part in parts:
            size += len(part)
            if size > most:
                raise OSError(
                    f'it takes more than {most} bytes in {directory.parent}, which is half of '
                    'what is free there: set TMPDIR to a directory with more room')
            file.write(part)


# metadata.yaml


def _files(directory: Path, context: BagContext) -> tuple[list[Path], Optional[bool]]:
    """
    List the storage files of a bag; and whether each message is compressed, None: not known.

    :raises BagError: if there is no file, or one is missing in a bag that is read as a whole.
    """
    files = _storage_files(directory)
    metadata = directory / 'metadata.yaml'
    refuse_special(metadata)
    if not metadata.exists():
        names = [visible(file.name) for file in files]
        if context.partial:
            logging.getLogger('dummy_arm.tf').warning(
                '%s has no metadata.yaml; what is read of it: %s', directory, ', '.join(names))
            return files, None
        raise BagError(
            f'{directory} has no metadata.yaml, which is written when a recording ends: name one '
            f'of its files ({", ".join(names[:_SHOWN])}), or if they are one recording, mend it '
            'by ros2 bag reindex or read it as partial (--partial)')
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
        raise BagError(f'{directory} cannot be read: its version is {version}, the newest that is '
                       f'known {_NEWEST_VERSION}')
    if mode != 'none' and compression != 'zstd':
        raise BagError(f'{directory} cannot be read: its compression format is '
                       f'{visible(repr(compression))}, not zstd')
    if missing := [visible(file.name) for file in listed if not file.exists()]:
        raise BagError(
            f'{directory} cannot be read: files are missing that its metadata.yaml names: '
            f'{", ".join(missing[:_SHOWN])}; partial (--partial) reads the others')
    return listed, mode == 'message'


def _storage_files(directory: Path) -> list[Path]:
    """
    List the files with messages in a directory, in the order of their numbers.

    :raises BagError: if there is none.
    """
    files = [path for path in directory.iterdir()
             if re.search(r'\.(mcap|db3)(\.zstd)?$', path.name)]
    if not files:
        raise BagError(f'{directory} is no bag: {WHAT}')
    return sorted(files, key=lambda path: [
        part.zfill(20) if part.isdigit() else part for part in re.split(r'(\d+)', path.name)])


def _text(metadata: Path) -> str:
    """
    Read metadata.

    :raises ValueError: if they are so long that to parse them would take minutes.
    """
    with metadata.open('rb') as file:
        data = file.read(_LONGEST_METADATA + 1)
    if len(data) > _LONGEST_METADATA:
        raise ValueError(f'it has more than {_LONGEST_METADATA} bytes')
    return data.decode(errors='replace')


def _declares_messages(metadata: str) -> Optional[bool]:
    """Return whether metadata declare that each message is compressed; None: nothing declared."""
    found = re.search(r'^ *compression_mode: *["\']?(\w*)', metadata, re.MULTILINE)
    return found[1].lower() == 'message' if found else None


# mcap

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX = 0x02, 0x03, 0x04, 0x05, 0x06, 0x08
_END = 1 + 8 + 20 + len(_MAGIC)  # the footer and what follows
_unpack_head = struct.Struct('<BQ').unpack_from  # opcode, length
_unpack_message = struct.Struct('<HIQQ').unpack_from  # channel, sequence, log and publish time
_MESSAGE_HEAD = 22
_unpack_chunk = struct.Struct('<QQQII').unpack_from  # times, size, CRC, length of the compression
_CHUNK_HEAD = 32
_SHORTEST = {_MESSAGE: _MESSAGE_HEAD, _CHUNK: _CHUNK_HEAD + 8}
_LONGEST_NAME = 16
_unpack_size = struct.Struct('<Q').unpack_from
#: Messages that wait for others with an earlier log time take so much at most (bytes), with so
#: much for each.
_MOST_WAITING = 2**26
_OVERHEAD = 200


class _Source:
    """The bytes of a file, from its beginning to its end."""

    def __init__(self, file: BinaryIO, is_compressed: bool, tick: Tick) -> None:
        """
        Keep the file.

        :param is_compressed: as a whole, by zstd; it cannot be sought in, then.
        """
        self._file, self._tick = file, tick
        self._stream: Any = Decompressed(file, tick) if is_compressed else file
        self.is_compressed = is_compressed
        self.size = os.fstat(file.fileno()).st_size
        #: How much has been read (bytes), decompressed.
        self.position = 0

    def part(self) -> float:
        """Return how much of the file has been read, from 0 to 1."""
        return self._file.tell() / max(1, self.size)

    def read(self, size: int) -> Buffer:
        """Read so many bytes, or what there is up to the end."""
        if not self.is_compressed:
            size = min(size, self.size - self.position)
        data = read(self._stream, size, self._tick)
        self.position += len(data)
        return data

    def exactly(self, size: int) -> Buffer:
        """
        Read so many bytes.

        :raises EOFError: if there are fewer.
        """
        data = self.read(size)
        if len(data) < size:
            raise _CutOff
        return data

    def skip(self, size: int) -> None:
        """
        Go on behind so many bytes.

        :raises EOFError: if there are fewer.
        """
        if self.is_compressed:
            while size > 0:
                self._tick()
                size -= len(self.exactly(min(size, PIECE)))
        elif size:
            self.seek(self.position + size)

    def seek(self, position: int) -> None:
        """
        Go to a position; not in a compressed file.

        :raises EOFError: if it lies behind the end.
        """
        if position > self.size:
            raise _CutOff
        self._file.seek(position)
        self.position = position


def _records_of_mcap(path: Path, file: BinaryIO, is_packed: bool, context: BagContext) -> _Records:
    source = _Source(file, is_packed, context.tick)
    if source.read(len(_MAGIC)) != _MAGIC:
        raise ValueError('it does not begin as an mcap file')
    reader = _McapReader(path, context, source)
    if context.partial or is_packed or (chunks := reader.index()) is None:
        return reader.sequential()
    return reader.indexed(chunks)


class _McapReader:
    """Reads the records of an mcap file."""

    def __init__(self, path: Path, context: BagContext, source: _Source) -> None:
        """
        Keep what is given.

        :param source: of the file, behind its first bytes.
        """
        self._path, self._context, self._source = path, context, source
        self._most = context.max_bytes
        self._types: dict[int, str] = {}
        self._streams: dict[int, Optional[Stream]] = {}
        #: Channels whose messages are no TF, for sure.
        self._others: set[int] = set()

    def index(self) -> Optional[list[tuple[int, int]]]:
        """
        Read the index, and what it has of channels.

        :returns: log time of the first message (ns) and position of the chunks that may have
            messages of TF; None if there is no index.
        :raises EOFError: if the file was cut off.
        :raises ValueError: if the index is damaged.
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
        if end - start > self._most:
            raise Oversized('its index', str(end - start), self._most)
        source.seek(start)
        summary = source.exactly(end - start)
        if crc and checksum(summary + footer[:25], self._context.tick) != crc:
            raise ValueError('the checksum of its index is wrong')
        chunks = {*self._chunks(summary)}
        source.seek(begin)
        if not chunks:
            return None
        return sorted((time, position) for time, position, channels in chunks
                      if not channels or not self._others.issuperset(channels))

    def _chunks(self, summary: Buffer) -> Iterator[tuple[int, int, frozenset[int]]]:
        """Yield the first log time, the position and the channels of every chunk."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import ChunkIndex
        for kind, start, end in _split(summary, self._context.tick):
            if kind == _CHUNK_INDEX:
                index = ChunkIndex.read(ReadDataStream(BytesIO(summary[start:end])))
                yield (index.message_start_time, index.chunk_start_offset,
                       frozenset(index.message_index_offsets))
            elif kind in (_SCHEMA, _CHANNEL):
                self._learn(kind, summary[start:end])

    def indexed(self, chunks: list[tuple[int, int]]) -> _Records:
        """
        Read chunks by their index; messages come by log time.

        If chunks overlap by too much, messages come earlier than that.
        """
        waiting: list[tuple[int, int, Stream, bytes]] = []
        size = count = 0
        for number, (_, position) in enumerate(chunks):
            self._context.advance(number / len(chunks))
            following = chunks[number + 1][0] if number + 1 < len(chunks) else 2**64
            for time, stream, data in self._chunk_at(position):
                if not waiting and time <= following:
                    yield stream, data
                    continue
                count += 1
                size += len(data) + _OVERHEAD
                heappush(waiting, (time, count, stream, data))
                while size > _MOST_WAITING:
                    _, _, stream, data = heappop(waiting)
                    size -= len(data) + _OVERHEAD
                    yield stream, data
            while waiting and waiting[0][0] <= following:
                _, _, stream, data = heappop(waiting)
                size -= len(data) + _OVERHEAD
                yield stream, data

    def _chunk_at(self, position: int) -> Iterator[tuple[int, Stream, bytes]]:
        self._source.seek(position)
        kind, length = _unpack_head(self._source.exactly(9))
        if kind != _CHUNK or length < _SHORTEST[_CHUNK]:
            raise ValueError('its index is wrong: no chunk lies where it has one')
        return self._chunk(length)

    def sequential(self) -> _Records:
        """Read all records, as they lie in the file."""
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
        """Read a record, or some of it."""
        if length < _SHORTEST.get(kind, 0):
            raise ValueError('a record ends too early')
        if kind == _CHUNK:
            for _, of_tf, data in self._chunk(length):
                yield of_tf, data
        elif kind == _MESSAGE:
            channel, _, _, _ = _unpack_message(self._source.exactly(_MESSAGE_HEAD))
            if stream := self._streams.get(channel):
                size = self._checked('a message', length - _MESSAGE_HEAD)
                message = self._message(self._source.exactly(size))
                if message is not None:
                    yield stream, message
        elif kind in (_SCHEMA, _CHANNEL):
            self._learn(kind, self._source.exactly(self._checked('a record', length)))

    def _checked(self, what: str, size: int) -> int:
        """
        Return a size.

        :raises Oversized: if it is larger than the limit.
        """
        if size > self._most:
            raise Oversized(what, str(size), self._most)
        return size

    def _learn(self, kind: int, record: Buffer) -> None:
        """Keep what there is to know of a type or a channel."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema
        if kind == _SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(record)))
            self._types[schema.id] = schema.name
            return
        channel = Channel.read(ReadDataStream(BytesIO(record)))
        msgtype = _encoded(self._types.get(channel.schema_id, ''), channel.message_encoding)
        stream = self._context.stream(channel.topic, msgtype, NOT_RECORDED, cdr)
        self._streams[channel.id] = stream
        if not stream and channel.schema_id in self._types:
            self._others.add(channel.id)

    def _chunk(self, length: int) -> Iterator[tuple[int, Stream, bytes]]:
        """
        Read a chunk.

        :returns: log time (ns), stream and bytes of its messages of TF, by log time.
        """
        source = self._source
        _, _, size, crc, name = _unpack_chunk(source.exactly(_CHUNK_HEAD))
        if name > min(_LONGEST_NAME, length - _SHORTEST[_CHUNK]):
            raise ValueError('the head of a chunk is damaged')
        method = source.exactly(name).decode()
        (packed_size,) = _unpack_size(source.exactly(8))
        if packed_size > length - _SHORTEST[_CHUNK] - name:
            raise ValueError('a chunk is larger than its record')
        self._checked('a chunk', packed_size)
        if size > self._most:
            raise Oversized(f'a chunk of {packed_size} bytes', str(size), self._most)
        data = source.read(packed_size)
        is_whole = len(data) == packed_size
        if is_whole:
            data = decompressed(data, method, size, self._most, 'chunk', self._context.tick)
            if crc and checksum(data, self._context.tick) != crc:
                raise ValueError('the checksum of a chunk is wrong')
        elif method or not self._context.partial:
            raise _CutOff
        yield from self._messages(data, is_whole)
        if not is_whole:
            raise _CutOff

    def _messages(self, data: Buffer, is_whole: bool) -> Iterator[tuple[int, Stream, bytes]]:
        """Read the records of a chunk; its messages are sorted by log time."""
        times, starts = array('Q'), array('Q')
        latest, is_ordered = 0, True
        try:
            for kind, start, end in _split(data, self._context.tick):
                if kind == _MESSAGE:
                    channel, _, time, _ = _unpack_message(data, start)
                    if self._streams.get(channel):
                        times.append(time)
                        starts.append(start)
                        is_ordered = is_ordered and time >= latest
                        latest = time
                elif kind in (_SCHEMA, _CHANNEL):
                    self._learn(kind, data[start:end])
                elif kind == _CHUNK:
                    raise ValueError('a chunk lies in a chunk')
        except Exception as error:  # of mcap, too
            if is_whole:
                self._context.handle_error(self._path, error)
        order: Any = range(len(times))
        if not is_ordered:
            order = np.argsort(np.frombuffer(times, np.uint64), kind='stable')
        for i in order:
            start = starts[i]
            _, length = _unpack_head(data, start - 9)
            stream = self._streams[_unpack_message(data, start)[0]]
            message = self._message(data[start + _MESSAGE_HEAD:start + length])
            if stream and message is not None:
                yield times[i], stream, message

    def _message(self, data: Buffer) -> Optional[bytes]:
        """
        Decompress a message if zstd has compressed it; nothing else begins like that.

        :returns: None if that cannot be done.
        """
        if data[:4] != ZSTD:
            return bytes(data)
        return _decompressed(data, self._path, self._context)


def _split(data: Buffer, tick: Tick) -> Iterator[tuple[int, int, int]]:
    """
    Split data into records.

    :returns: opcode, start and end of each.
    :raises ValueError: if they do not end with the data.
    """
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
    """Return the type of messages, with their encoding if it is another than that of ROS 2."""
    return msgtype if encoding in ('cdr', '') else f'{msgtype} in {encoding}'


def _decompressed(data: Buffer, path: Path, context: BagContext) -> Optional[bytes]:
    """Decompress a message; return None if that cannot be done."""
    try:
        return bytes(decompressed(data, 'zstd', None, context.max_bytes, 'message',
                                  context.tick))
    except Exception as error:
        context.handle_error(path, error)
        return None


# sqlite3

_LARGEST_ID = 2**63 - 1
#: Rows have id, topic, length and data; NULL where those are too long.
_Row = tuple[int, int, Optional[int], Optional[bytes]]
_ROWS = ('SELECT id, topic_id, length(data), CASE WHEN topic_id IN ({topics}) AND '
         'length(data) <= {most} THEN CAST(data AS BLOB) END FROM messages')
_SMALLEST_LIMIT = 2**20


def _records_of_sqlite(path: Path, whole: Path, context: BagContext, is_compressed: Optional[bool]
                       ) -> _Records:
    """
    Read a database.

    :param path: the file, for the texts of errors.
    :param whole: the same, decompressed.
    """
    log = path.with_name(f'{path.name}-wal')
    for other in log, path.with_name(f'{path.name}-shm'), path.with_name(f'{path.name}-journal'):
        refuse_special(other)
    has_log = log.exists() and log.stat().st_size > 0
    if has_log and not context.partial:
        raise BagError(f'{path} was not closed when it was recorded, and {log.name} has what is '
                       'not in it yet: read it as partial (--partial)')
    with ExitStack() as stack:
        if context.partial:
            whole = _whole_pages(whole, log, Path(stack.enter_context(TemporaryDirectory())),
                                 context.tick)
        uri = f'{whole.absolute().as_uri()}?mode=ro{"" if has_log else "&immutable=1"}'
        with closing(sqlite3.connect(uri, uri=True)) as database:
            yield from _SqliteReader(path, context, database, is_compressed).records()


def _whole_pages(path: Path, log: Path, directory: Path, tick: Tick) -> Path:
    """Leave out what a file has of its last page, where SQLite would read zeros for the rest."""
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
    """Reads the rows of a database."""

    def __init__(self, path: Path, context: BagContext, database: sqlite3.Connection,
                 is_compressed: Optional[bool]) -> None:
        """
        Keep what is given.

        :param path: the file, for the texts of errors.
        :param is_compressed: whether each message is; None: as the file itself or the metadata
            beside it declare.
        """
        self._path, self._context, self._database = path, context, database
        self._most = context.max_bytes
        database.set_progress_handler(self._is_stopped, 50_000)
        database.text_factory = lambda data: data.decode(errors='replace')
        if sys.version_info >= (3, 11):  # nor may it compute larger values
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(
                2**31 - 1, max(self._most, _SMALLEST_LIMIT)))
        if context.partial:
            database.execute('PRAGMA writable_schema = on')  # which lets it read a truncated file
        self._is_compressed = self._declared() if is_compressed is None else is_compressed

    def records(self) -> _Records:
        """
        Read the messages of TF.

        :raises sqlite3.Error: if the file is damaged.
        """
        tables = {name for (name,) in self._database.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'")}
        if missing := {'messages', 'topics'} - tables:
            raise ValueError(f'it is the database of something else, missing tables: '
                             f'{", ".join(sorted(missing))}')
        streams = {int(key): self._context.stream(
            str(topic), _encoded(str(msgtype), str(encoding)), NOT_RECORDED, cdr)
            for key, topic, msgtype, encoding in self._database.execute(
                'SELECT id, name, type, serialization_format FROM topics')}
        topics = ', '.join(str(key) for key, stream in streams.items() if stream)
        if not topics:
            return
        query = _ROWS.format(topics=topics, most=self._most)
        rows = self._recovered(query) if self._context.partial else self._database.execute(
            f'{query} WHERE topic_id IN ({topics}) ORDER BY timestamp, id')
        first, count = self._ids()
        most, has_no_loop_above = self._most, not self._is_compressed
        for number, (key, topic, length, data) in enumerate(rows):
            self._context.tick()
            if number % _ADVANCE == 0:
                self._context.advance(min(1.0, max(0, key - first) / count))
            if stream := streams.get(topic):
                if has_no_loop_above and data is not None and len(data) <= most:
                    yield stream, data
                elif (message := self._message(length, data)) is not None:
                    yield stream, message

    def _is_stopped(self) -> bool:
        """Return whether the query that is under way shall end; the caller then calls `tick`."""
        try:
            self._context.tick()
        except BaseException:
            return True
        return False

    def _message(self, length: Optional[int], data: Optional[bytes]) -> Optional[bytes]:
        """Return the bytes of a message; None if it is too large, or cannot be decompressed."""
        if max(length or 0, len(data or b'')) > self._most:
            self._context.handle_error(self._path, Oversized('a message', str(length), self._most))
            return None
        if data is None:  # NULL is no message, as others that cannot be decoded
            return b''
        return _decompressed(data, self._path, self._context) if self._is_compressed else data

    def _declared(self) -> bool:
        """Return whether metadata, beside the file or in it, declare compressed messages."""
        metadata = self._path.with_name('metadata.yaml')
        refuse_special(metadata)
        if metadata.exists():
            text = _text(metadata)
            if self._path.name in text and (declared := _declares_messages(text)) is not None:
                return declared
        with suppress(sqlite3.DatabaseError):  # it has no such table, or that is damaged
            for (text,) in self._database.execute(
                    'SELECT metadata FROM metadata WHERE length(metadata) < ? '
                    'ORDER BY id DESC LIMIT 1', (_LONGEST_METADATA,)):
                return bool(_declares_messages(str(text)))
        return False

    def _ids(self) -> tuple[int, int]:
        """Return the smallest id, and how many there are if none is left out; 1, 1: not known."""
        try:
            ((first, last),) = self._database.execute('SELECT min(id), max(id) FROM messages')
        except sqlite3.DatabaseError:
            self._context.tick()
            return 1, 1
        return (1, 1) if first is None else (first, last - first + 1)

    def _recovered(self, query: str) -> Iterator[_Row]:
        """
        Read the rows that can be read, by their ids; note how many others there are.

        :param query: for all rows.
        """
        first: Optional[int] = self._ids()[0]
        skipped, why = 0, ''
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
                why = why or str(error)
            try:  # Python 3.10 reads one row ahead: this one may be whole
                row = self._row(query, first)
            except sqlite3.DatabaseError:
                self._context.tick()
                resumed = self._readable(query, first)
                skipped += max(1, (resumed or first) - first)
                first = resumed
            else:
                if row is None:
                    break
                yield row
                first = row[0] + 1
        if why:
            least = 'at least ' if first is None else ''
            records = 'record' if skipped == 1 else 'records'
            self._context.handle_error(self._path, ValueError(
                f'{why}; skipped {least}{skipped} damaged {records}'))

    def _row(self, query: str, first: int) -> Optional[_Row]:
        """
        Read the first row from an id on.

        :raises sqlite3.DatabaseError: if it is damaged.
        """
        row: Optional[_Row] = self._database.execute(
            f'{query} WHERE id >= ? ORDER BY id LIMIT 1', (first,)).fetchone()
        if row and row[0] < first:
            raise sqlite3.DatabaseError('its records are not in order')
        return row

    def _readable(self, query: str, first: int) -> Optional[int]:
        """
        Find the next id from which rows can be read again.

        It is match_candidates for by steps that double, then by bisection, so that few queries do.

        :param first: an id from which they cannot be read.
        :returns: None if there is none.
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
        """Return whether the first row from an id on can be read, or there is none."""
        try:
            self._row(query, first)
        except sqlite3.DatabaseError:
            self._context.tick()
            return False
        return True
