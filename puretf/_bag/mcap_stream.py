"""The TF messages of an mcap file without an index, or that was cut off, read by mcap."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
import struct
from typing import Any
from zlib import crc32

from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk, StreamReader

from puretf._bag.context import BagContext, Record, Topic
from puretf._bag.rosbags_private import durabilities
from puretf._bag.unpacking import Oversized


def read_summary(path: Path, max_bytes: int) -> bytes:
    """Return the file from its summary on, b'' without one; raise an error if it is damaged."""
    size = path.stat().st_size
    with path.open('rb') as file:
        file.seek(max(0, size - 37))  # the footer
        begin, start, checksum = struct.unpack('<9sQ8xI8x', file.read().ljust(37, b'\0'))
        if not start or begin != b'\x02\x14' + bytes(7):  # the file may be cut off
            return b''
        if size - start > max_bytes:
            raise Oversized('its summary', str(size - start), max_bytes)
        file.seek(min(start, size))
        summary = file.read()
    if checksum and crc32(summary[:-12]) != checksum:
        raise ValueError('the checksum of its summary is wrong')
    return summary


def records_in_file_order(path: Path, context: BagContext) -> Iterator[Record]:
    """Yield the messages that are wanted, chunk by chunk; if `partial`, skip damaged chunks."""
    schemas: dict[int, Schema] = {}
    topics: dict[int, Topic] = {}
    for record in chain(_definitions(path, context), _records(path, context)):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in topics:
            schema = schemas.get(record.schema_id)
            topics[record.id] = context.add_topic(
                record.topic, schema.name if schema else '',
                schema.data.decode(errors='replace') if schema else '', record.message_encoding,
                durabilities(record.metadata.get('offered_qos_profiles', '')))
        elif isinstance(record, Message):
            context.add_span(record.log_time, record.log_time)
            if (topic := topics.get(record.channel_id)) and topic.is_read:
                try:
                    found = context.record(topic, record.log_time, record.data)
                except Exception as error:
                    context.handle_error(path, '.mcap', error)
                    continue
                if found:
                    yield found


def _definitions(path: Path, context: BagContext) -> Iterator[Any]:
    """Yield the schemas and channels at the end of a file: the chunk with them may be damaged."""
    try:
        if read_summary(path, context.max_bytes):
            with path.open('rb') as file:
                summary: Any = SeekingReader(
                    file, record_size_limit=context.max_bytes).get_summary()
            yield from summary.schemas.values()
            yield from (each for each in summary.channels.values()
                        if each.schema_id in summary.schemas)
    except Exception as error:
        context.handle_error(path, '.mcap', error)


def _records(path: Path, context: BagContext) -> Iterator[Any]:
    """Yield the records of a file, and those in chunks; the messages of a chunk by time."""
    size = path.stat().st_size
    with path.open('rb') as file:
        reader = StreamReader(file, emit_chunks=True, record_size_limit=context.max_bytes)
        try:
            for record in reader.records:
                context.advance(file.tell() / size)
                if not isinstance(record, Chunk):
                    yield record
                    continue
                try:
                    yield from _in_chunk(record, context.max_bytes)
                except Exception as error:
                    context.handle_error(path, '.mcap', error)
        except (EndOfFile, struct.error):
            raise EOFError('it ends too early') from None
        except RecordLengthLimitExceeded as error:
            raise ValueError(f'{error}, and what follows is not read: if this size is expected, '
                             'pass a larger max_bytes') from None


def _in_chunk(chunk: Chunk, max_bytes: int) -> list[Any]:
    if chunk.uncompressed_size > max_bytes:
        raise Oversized(f'a chunk of {len(chunk.data)} bytes', str(chunk.uncompressed_size),
                        max_bytes)
    # Definitions, which have no log time, come first.
    return sorted(breakup_chunk(chunk, validate_crc=True),
                  key=lambda record: getattr(record, 'log_time', -1))
