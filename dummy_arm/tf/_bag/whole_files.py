"""The TF messages of a recording, read by rosbags: whole files of mcap, sqlite3 and ROS 1."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from dummy_arm.tf._bag.context import BagContext, BagTopic, HEADERS, Record, Stream
from dummy_arm.tf._bag.formats import BagError, kind_of, refuse_special
from dummy_arm.tf._bag.recordings import files_of, Recording
from dummy_arm.tf._bag.unpacking import Oversized, unpack_file, unpack_message, ZSTD

#: Progress is reported once for this many messages.
_ADVANCE = 100


def records(recording: Recording, context: BagContext) -> Iterator[Record]:
    """Yield the messages of TF, file by file, each in the order of time."""
    files = files_of(recording, context.partial)
    for number, path in enumerate(files):
        context.begin(number / len(files), 1 / len(files))
        try:
            kind = kind_of(path)
        except BagError as error:  # such as the empty last file of a recorder that was killed
            if len(files) == 1:
                raise
            context.handle_error(path, '', error)
            continue
        if context.partial and kind != '.mcap' and not path.name.endswith('.mcap.zstd'):
            raise BagError(f'{path} cannot be read with partial=True (--partial), which reads '
                           '.mcap files only: leave it out')
        try:
            if kind != '.zstd':
                yield from _records_of_file(path, kind, context)
                continue
            with TemporaryDirectory() as directory:
                whole = Path(directory, path.name.removesuffix('.zstd'))
                context.begin(number / len(files), 0.5 / len(files))
                try:
                    unpack_file(path, whole, context.advance)
                except Exception as error:  # damaged or cut off
                    context.handle_error(path, whole.suffix, error)
                context.begin((number + 0.5) / len(files), 0.5 / len(files))
                kind = kind_of(whole, path)
                yield from _records_of_file(whole, kind, context)
        except Exception as error:  # the libraries raise errors of many types
            context.handle_error(path, kind, error)


def _records_of_file(path: Path, kind: str, context: BagContext) -> Iterator[Record]:
    from rosbags import rosbag1, rosbag2
    if kind == '.mcap':
        from dummy_arm.tf._bag.mcap_stream import has_summary, records_in_file_order
        if context.partial or not has_summary(path):
            yield from records_in_file_order(path, context)
            return
    if kind == '.db3':
        _check_database(path)
    reader: Any = (rosbag1.Reader(path) if kind == '.bag'
                   else rosbag2.Reader.STORAGE_PLUGINS[kind](path))
    reader.open()
    try:
        if kind != '.mcap' or _has_complete_index(reader):
            yield from _records_of_reader(reader, kind, context)
            return
    finally:
        reader.close()
    yield from records_in_file_order(path, context)


def _records_of_reader(reader: Any, kind: str, context: BagContext) -> Iterator[Record]:
    streams, headers, max_bytes = {}, [], context.max_bytes
    for connection in reader.connections:
        ext = connection.ext
        stream = context.add_topic(
            connection.topic, connection.msgtype,
            'ros1' if kind == '.bag' else ext.serialization_format, connection.msgdef.data,
            () if kind == '.bag' else [qos.durability.name for qos in ext.offered_qos_profiles],
            ext.callerid or '' if kind == '.bag' else '')
        if isinstance(stream, Stream):
            streams[connection.id] = connection, stream
        elif isinstance(stream, BagTopic):
            headers.append((connection, stream))
    wanted = [connection for connection, _ in streams.values()]
    if kind == '.mcap':
        _check_sizes(reader, [*wanted, *(connection for connection, _ in headers)],
                     max_bytes)
    total = max(1, sum(connection.msgcount for connection in wanted))
    for number, (connection, time, data) in enumerate(reader.messages(wanted) if wanted else ()):
        if number % _ADVANCE == 0:
            context.advance(min(1.0, number / total))
        if type(data) is not bytes or len(data) > max_bytes or data[:4] == ZSTD:
            data = _message(data, max_bytes)
        yield streams[connection.id][1], time, data
    for connection, topic in headers:
        context.advance(1.0)
        for _, _, data in islice(reader.messages([connection]), HEADERS - topic.header_count):
            topic.add_header(_message(data, max_bytes))


def _message(data: Any, max_bytes: int) -> bytes:
    """Return the bytes of a message; sqlite3 may have a value of another type in its place."""
    if not isinstance(data, bytes):
        return b''
    if len(data) > max_bytes:
        raise Oversized('a message', str(len(data)), max_bytes)
    return unpack_message(data, max_bytes)


def _check_database(path: Path) -> None:
    log = path.with_name(f'{path.name}-wal')
    refuse_special(log)
    if log.exists() and log.stat().st_size > 0:
        raise BagError(
            f'{path} was not closed after recording, and {log.name} has data that are not in the '
            'database yet. SQLite inserts them: python3 -c "import sqlite3; '
            f"sqlite3.connect('{path.name}').execute('PRAGMA wal_checkpoint(TRUNCATE)')\"")
    if any(character in str(path) for character in '?#%'):
        raise BagError(f'{path} cannot be read, because its path has one of the characters ?, # '
                       'and %: rename it')


def _has_complete_index(reader: Any) -> bool:
    """Return False if rosbags would miss messages: the parts of the index are optional."""
    known = {connection.id for connection in reader.connections
             if connection.msgtype != '__schemaless__'}
    return bool(reader.chunks) and all(
        chunk.message_index_offsets and known.issuperset(chunk.message_index_offsets)
        for chunk in reader.chunks)


def _check_sizes(reader: Any, connections: list[Any], max_bytes: int) -> None:
    """Raise `Oversized` if a chunk that will be read is larger than the limit."""
    ids = {connection.id for connection in connections}
    for chunk in reader.chunks:
        size = max(chunk.compressed_size, chunk.uncompressed_size)
        if size > max_bytes and not ids.isdisjoint(chunk.message_index_offsets):
            raise Oversized(f'a chunk of {chunk.compressed_size} bytes', str(size), max_bytes)
