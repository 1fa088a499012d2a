"""The TF messages of the files of a recording; rosbags reads those of mcap and of ROS 1."""

from collections.abc import Iterator, Set
from contextlib import closing
from pathlib import Path
import re
from tempfile import mkdtemp
from typing import Any, Optional

from rosbags import rosbag1

from puretf._bag.context import ADVANCE, BagContext, NOT_RECORDED, Record
from puretf._bag.database import records_of_database
from puretf._bag.formats import BagError, kind_of
from puretf._bag.mcap_stream import read_summary, records_in_file_order
from puretf._bag.rosbags_private import McapReader
from puretf._bag.unpacking import Oversized, unpack_file
from puretf._wire.definitions import checked_yaml


def records(context: BagContext) -> Iterator[Record]:
    """Yield the messages that are wanted, file by file, each in the order of time."""
    files = context.recording.files
    for number, path in enumerate(files):
        context.begin(number / len(files), 1 / len(files))
        kind = ''
        try:
            kind = kind_of(path)
            whole = path
            if kind == '.zstd':
                if path not in context.copies:
                    context.begin(number / len(files), 0.5 / len(files))
                    _unpack(path, context)
                    context.begin((number + 0.5) / len(files), 0.5 / len(files))
                whole = context.copies[path]
                kind = kind_of(whole, path)
            yield from _records_of_file(whole, path, kind, context)
        except Exception as error:  # the libraries raise errors of many types
            # A recorder that was killed may have left an empty last file.
            if not kind and (len(files) == 1 or not isinstance(error, BagError)):
                raise
            context.handle_error(path, kind, error)


def _unpack(path: Path, context: BagContext) -> None:
    whole = Path(mkdtemp(), 'whole')
    context.copies[path] = whole
    try:
        unpack_file(path, whole, context.advance)
    except Exception as error:  # damaged or cut off
        context.handle_error(path, '' if isinstance(error, OSError) else
                             path.with_suffix('').suffix, error)


def _records_of_file(whole: Path, path: Path, kind: str, context: BagContext) -> Iterator[Record]:
    """Yield the messages of a file; `path` is the file before it was decompressed."""
    reader: Any = None
    if kind == '.mcap':
        reader = None if context.partial else _open_mcap(whole, context.max_bytes)
        if reader is None:
            yield from records_in_file_order(whole, context)
            return
    elif context.partial:
        raise BagError(f'{path} cannot be read with partial=True, which reads .mcap '
                       'files only: leave it out')
    elif kind == '.db3':
        yield from records_of_database(whole, context)
        return
    elif kind == '.bag':
        reader = rosbag1.Reader(whole)
        reader.open()
    else:
        raise ValueError('it is compressed twice')
    with closing(reader):
        yield from _records_of_reader(reader, kind, context)


def _open_mcap(path: Path, max_bytes: int) -> Optional[McapReader]:
    """Open a file; return None if rosbags refuses it, or would miss messages."""
    reader, summary = McapReader(path), read_summary(path, max_bytes)
    try:
        # rosbags parses what follows the size after each of these.
        for end in [each.end() + 4 for each in re.finditer(b'offered_qos_profiles', summary)]:
            checked_yaml(summary[end:end + int.from_bytes(summary[end - 4:end], 'little')])
        reader.open()
    except Exception:  # `records_in_file_order` raises an error if the file is damaged
        return None
    known = {each.id for each in reader.connections if each.msgtype != '__schemaless__'}
    counts = [chunk.channel_count for chunk in reader.chunks]
    # All parts of the index are optional.
    if (reader.has_statistics and all(counts) and all(map(known.issuperset, counts))
            and sum(sum(count.values()) for count in counts) == reader.statistics.message_count):
        return reader
    reader.close()
    return None


def _records_of_reader(reader: Any, kind: str, context: BagContext) -> Iterator[Record]:
    topics, wanted = {}, []
    for connection in reader.connections:
        ext, count = connection.ext, connection.msgcount
        about = connection.topic, connection.msgtype, connection.msgdef.data
        topic = context.add_topic(
            *about, 'ros1', publisher=ext.callerid or NOT_RECORDED, count=count) if (
            kind == '.bag') else context.add_topic(*about, ext.serialization_format, [
                qos.durability.name for qos in ext.offered_qos_profiles], count=count)
        if topic.is_read:
            topics[connection.id] = topic
            wanted.append(connection)
    if any(connection.msgcount for connection in reader.connections):
        context.add_span(*(reader.start_time, reader.end_time - 1) if kind == '.bag' else (
            reader.statistics.start_time, reader.statistics.end_time))
    if kind == '.mcap':
        _check_sizes(reader, topics.keys(), context.max_bytes)
    number, total = 0, sum(connection.msgcount for connection in wanted)
    messages = reader.messages(wanted) if wanted else ()
    for number, (connection, time, data) in enumerate(messages, 1):
        if number % ADVANCE == 1:
            context.advance(min(1.0, number / total))
        if record := context.record(topics[connection.id], time, data):
            yield record
    if number != total:
        raise ValueError(f'its index announces {total} messages, but {number} were found')


def _check_sizes(reader: McapReader, channels: Set[int], max_bytes: int) -> None:
    """Raise `Oversized` if a chunk that will be read is larger than the limit."""
    for chunk in reader.chunks:
        size = max(chunk.compressed_size, chunk.uncompressed_size)
        if size > max_bytes and not channels.isdisjoint(chunk.channel_count):
            raise Oversized(f'a chunk of {chunk.compressed_size} bytes', str(size), max_bytes)
