"""
The messages of an mcap file, read by the library mcap.

By the indexes of the chunks, only messages are read that are wanted; the statistics beside them
tell whether one is missing. Without an index, all is read in the order of the file. An index
without a checksum is not used if chunks have one.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from operator import attrgetter, itemgetter
from pathlib import Path
import struct
from typing import Any, BinaryIO, Optional
from zlib import crc32

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.reader import FOOTER_SIZE, SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Message, Schema, Statistics
from mcap.stream_reader import breakup_chunk, MAGIC_SIZE, StreamReader

from puretf._bag.contents import Contents, Record, Topic
from puretf._bag.unpacking import DECOMPRESSORS, Item, too_large

_END_SIZE, _CHECKSUM_SIZE = FOOTER_SIZE + MAGIC_SIZE, 4
_begin, _time = attrgetter('message_start_time'), itemgetter(1)


class McapFile:
    """The definitions and the numbers of messages that have been found in a file."""

    def __init__(self, path: Path, contents: Contents) -> None:
        self._path, self._contents, self._size = path, contents, path.stat().st_size
        self._schemas = {0: Schema(0, b'', '', '')}
        self._topics: dict[int, Topic] = {}  # by channel
        #: The numbers of messages by channel: those that were found, and those by the statistics;
        #: one object if there are no statistics.
        self._counts = self._announced = Counter[int]()

    def records(self) -> Iterator[Item]:
        """Yield the messages that are read, in the order of time if there is an index."""
        with self._path.open('rb') as file:
            summary = None
            try:
                summary = self._summary(file)
            except Exception as error:
                self._contents.add_damage(error)
            yield from self._by_index(file, summary) if summary else self._in_order(file)
        for number in self._counts | self._announced:
            announced, count = self._announced[number], self._counts[number]
            if not (topic := self._topics.get(number)):
                raise ValueError('a message has no channel')
            if topic.is_read and announced != count:
                raise ValueError(f'its statistics announce {announced} messages of {topic.name}, '
                                 f'but {count} were found')

    def _summary(self, file: BinaryIO) -> Any:
        """Check the summary; return it if its index can be used."""
        end, footer, limit = self._size - _END_SIZE, None, self._contents.max_bytes
        with suppress(Exception):
            footer = next(self._records(file, end))
        if not isinstance(footer, Footer):
            return None
        file.seek(start := min(footer.summary_start or end, end))
        if (size := self._size - start) > limit:
            raise too_large('the summary', f'{size}', limit)
        if footer.summary_crc not in (0, crc32(file.read(size - _CHECKSUM_SIZE - MAGIC_SIZE))):
            raise ValueError('the checksum of its summary is wrong')
        file.seek(0)
        found = SeekingReader(file).get_summary()
        if not (found and found.statistics and found.chunk_indexes
                and found.statistics.channel_message_counts.keys() <= found.channels.keys()
                and {each.schema_id for each in found.channels.values()} <= {0, *found.schemas}
                and all(each.message_index_offsets for each in found.chunk_indexes)):
            return None
        at = found.chunk_indexes[0].chunk_start_offset
        is_sure = footer.summary_crc or not next(self._records(file, at)).uncompressed_crc
        return found if is_sure else None

    def _by_index(self, file: BinaryIO, summary: Any) -> Iterator[Item]:
        """Yield the messages that are read, in the order of time."""
        about = summary.statistics
        for record in *summary.schemas.values(), *summary.channels.values(), about:
            self._found(record)
        self._contents.add_span(about.message_start_time, about.message_end_time)
        chunks = sorted((each for each in summary.chunk_indexes if any(
            self._topics[number].is_read for number in each.message_index_offsets)), key=_begin)
        waiting: list[Record] = []
        for number, chunk in enumerate(chunks):
            ready = bisect_left(waiting, _begin(chunk), key=_time)
            yield from waiting[:ready]
            yield number / len(chunks)
            del waiting[:ready]
            try:
                waiting += filter(None, map(self._found, [*self._wanted(file, chunk)]))
            except Exception as error:  # a damaged chunk is left out as a whole
                self._contents.add_damage(
                    error, span=(chunk.message_start_time, chunk.message_end_time))
            waiting.sort(key=_time)
        yield from waiting
        for number, topic in self._topics.items():
            topic.count += 0 if topic.is_read else self._announced[number]

    def _wanted(self, file: BinaryIO, index: ChunkIndex) -> Iterator[Message]:
        """Yield the messages of a chunk that are read, by the message indexes behind it."""
        content = BytesIO(self._content(next(self._records(file, index.chunk_start_offset))))
        stream = ReadDataStream(content)
        for number, place in index.message_index_offsets.items():
            if self._topics[number].is_read:
                for time, at in next(self._records(file, place)).records:
                    content.seek(at)
                    stream.read1()  # the kind of the record
                    message = Message.read(stream, stream.read8())
                    if (message.channel_id, message.log_time) != (number, time):
                        raise ValueError('a message index is not as the messages are')
                    yield message

    def _in_order(self, file: BinaryIO) -> Iterator[Item]:
        """Yield the messages that are read, in the order of the file."""
        for record in self._records(file, MAGIC_SIZE):
            try:
                yield from filter(None, map(self._found, self._parts(record)))
            except Exception as error:
                self._contents.add_damage(error)
            yield file.tell() / self._size

    def _found(self, record: Any) -> Optional[Record]:
        """Return a message if it is read; note other records."""
        if isinstance(record, Message):
            self._counts[record.channel_id] += 1
            self._contents.add_span(record.log_time, record.log_time)
            if topic := self._topics.get(record.channel_id):
                topic.count += 1
                if topic.is_read:
                    return topic, record.log_time, record.data
        elif isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in self._topics and (
                schema := self._schemas.get(record.schema_id)):
            self._topics[record.id] = self._contents.topic(
                record.topic, schema.name, schema.data.decode(errors='replace'),
                record.message_encoding, record.metadata.get('offered_qos_profiles', ''))
        elif isinstance(record, Statistics):
            self._announced = Counter(record.channel_message_counts)
        return None

    def _parts(self, record: Any) -> Any:
        """Return the records in a chunk, or another record."""
        if not isinstance(record, Chunk):
            return [record]
        try:
            record.data, record.compression = self._content(record), ''
            return breakup_chunk(record)
        except (EndOfFile, struct.error):
            raise ValueError('a record in a chunk is damaged') from None

    def _content(self, chunk: Any) -> Any:
        if not isinstance(chunk, Chunk):
            raise ValueError('a chunk is not where the index in its summary says')
        size, limit, data = chunk.uncompressed_size, self._contents.max_bytes, chunk.data
        if size > limit:
            raise too_large(f'a chunk of {len(data)} bytes', f'{size}', limit)
        if method := DECOMPRESSORS.get(chunk.compression):
            data = method().decompress(data, size)
        if len(data) != size or chunk.uncompressed_crc not in (0, crc32(data)):
            raise ValueError('the size or the checksum of a chunk is wrong')
        return data

    def _records(self, file: BinaryIO, begin: int) -> Iterator[Any]:
        """Yield the records from a place on, chunks as they are."""
        file.seek(begin)
        try:
            yield from StreamReader(file, skip_magic=True, emit_chunks=True,
                                    record_size_limit=self._contents.max_bytes).records
        except (EndOfFile, struct.error):
            raise EOFError('it ends too early') from None
