"""The TF messages of an mcap file without an index, or that was cut off, read by mcap."""

from collections.abc import Iterator
from pathlib import Path
import struct
from typing import Any, Optional, Union

from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk, StreamReader

from dummy_arm.tf._bag.context import BagContext, BagTopic, Record, Stream
from dummy_arm.tf._bag.unpacking import first_bytes, Oversized, unpack_message
from dummy_arm.tf._wire.definitions import durabilities


def records_in_file_order(path: Path, context: BagContext) -> Iterator[Record]:
    """Yield the messages of TF, chunk by chunk; skip damaged chunks if `partial` is True."""
    schemas: dict[int, Schema] = {}
    streams: dict[int, Union[Stream, BagTopic, None]] = {}
    for record in _records(path, context):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in streams:
            streams[record.id] = _stream(record, schemas.get(record.schema_id), context)
        elif isinstance(record, Message):
            stream = streams.get(record.channel_id)
            if isinstance(stream, Stream):
                yield stream, record.log_time, unpack_message(record.data, context.max_bytes)
            elif stream and stream.headers.wants_next():
                stream.headers.add(record.log_time, first_bytes(record.data))


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


def _stream(channel: Channel, schema: Optional[Schema], context: BagContext
            ) -> Union[Stream, BagTopic, None]:
    return context.add_topic(
        channel.topic, schema.name if schema else '',
        schema.data.decode(errors='replace') if schema else '', channel.message_encoding,
        durabilities(channel.metadata.get('offered_qos_profiles', '')))
