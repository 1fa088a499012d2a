"""The messages of TF in a bag that was cut off or is damaged, up to there, without its index."""

from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from io import BytesIO, SEEK_CUR
import os
from pathlib import Path
import shutil
import sqlite3
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, Optional

from dummy_arm.tf import wire, wire_ros1
from dummy_arm.tf.bag_records import (
    Content,
    decompressed,
    described,
    kind_of,
    NOT_RECORDED,
    storage_files,
    Stream,
    zstd,
)

_Records = Iterator[tuple[Stream, bytes]]


def records(path: Path, content: Content) -> _Records:
    """
    Read the messages of TF, in the order in which they lie in the file.

    :param content: learns what there is and, where a file ends too early, what is wrong.
    :raises BagError: when it is no bag.
    :raises OSError: when it is not there, or not readable.
    """
    for file in storage_files(path) if kind_of(path) == 'dir' else [path]:
        with TemporaryDirectory() as directory:
            try:
                whole = _decompressed(file, directory) if file.suffix == '.zstd' else file
                for stream, data in _READERS[kind_of(whole)](whole, content):
                    yield stream, decompressed(data)
            except Exception as error:  # of three libraries, and of many types
                content.damage.append(f'{file}: {described(error)}')


def _decompressed(file: Path, directory: str) -> Path:
    """Decompress a file into a directory, as far as that can be done."""
    whole = Path(directory, file.stem)
    with (file.open('rb') as source, whole.open('wb') as target,
          suppress(EOFError, zstd().ZstdError)):
        shutil.copyfileobj(zstd().open(source), target)
    if not whole.stat().st_size:
        raise EOFError('nothing of it can be decompressed')
    return whole


def _records_of_mcap(path: Path, content: Content) -> _Records:
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import EndOfFile
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import get_chunk_data_stream
    types: dict[int, str] = {}
    streams: dict[int, Optional[Stream]] = {}

    def walk(file: Any, end: int) -> _Records:
        while file.count < end:
            kind, length = file.read1(), file.read8()
            begin = file.count
            if kind == Opcode.SCHEMA:
                schema = Schema.read(file)
                types[schema.id] = schema.name
            elif kind == Opcode.CHANNEL:
                channel = Channel.read(file)
                streams[channel.id] = content.stream(
                    channel.topic, types.get(channel.schema_id, ''), NOT_RECORDED, wire)
            elif kind == Opcode.MESSAGE:
                message = Message.read(file, length)
                stream = streams.get(message.channel_id)
                if stream and file.count == begin + length:
                    yield stream, message.data
            elif kind == Opcode.CHUNK:
                chunk = Chunk.read(file)
                yield from walk(*get_chunk_data_stream(
                    chunk, validate_crc=file.count == begin + length))
            else:
                file.read(length)
            if file.count < begin + length:
                raise EndOfFile

    with path.open('rb') as file, suppress(EndOfFile):
        magic = file.read(8)
        yield from walk(ReadDataStream(file), path.stat().st_size - 2 * len(magic))
        if file.read() == magic:
            return
    raise EOFError('it ends too early')


def _records_of_sqlite(path: Path, content: Content) -> _Records:
    with TemporaryDirectory() as directory, closing(sqlite3.connect(
            f'{_whole_pages(path, directory).absolute().as_uri()}?mode=ro', uri=True)) as database:
        database.execute('PRAGMA writable_schema = on')  # which lets it read a truncated file
        streams = {key: content.stream(topic, msgtype, NOT_RECORDED, wire) for key, topic, msgtype
                   in database.execute('SELECT id, name, type FROM topics')}
        wanted = [str(int(key)) for key, stream in streams.items() if stream]
        for key, data in database.execute(
                f'SELECT topic_id, data FROM messages WHERE topic_id IN ({",".join(wanted)})'):
            if stream := streams[key]:
                yield stream, data


def _whole_pages(path: Path, directory: str) -> Path:
    """Leave out what a file has of its last page, where SQLite would read zeros for the rest."""
    with path.open('rb') as file:
        page_size = int.from_bytes(file.read(18)[16:], 'big')
    size = path.stat().st_size
    page_size = 65536 if page_size == 1 else page_size
    if page_size < 512 or size % page_size == 0:
        return path
    whole = Path(directory, path.name)
    shutil.copyfile(path, whole)
    os.truncate(whole, size - size % page_size)
    return whole


def _records_of_ros1(path: Path, content: Content) -> _Records:
    from rosbags.rosbag1.reader import Header, read_bytes, read_uint32, RecordType
    with path.open('rb') as file:
        file.readline()
        index = Header.read(file, RecordType.BAGHEADER).get_uint64('index_pos')
        read_bytes(file, read_uint32(file))
        yield from _walk(file, content, {})
        if not 0 < index <= file.tell():
            raise EOFError('there is no index, so that it may have been cut off')


def _walk(file: BinaryIO, content: Content, streams: dict[int, Optional[Stream]]) -> _Records:
    """Read the records of a bag of ROS 1, or of one of its chunks."""
    from rosbags.rosbag1.reader import decompressors, Header, read_uint32, RecordType
    from rosbags.typesys.msg import normalize_msgtype
    while file.read(1):
        file.seek(-1, SEEK_CUR)
        header = Header.read(file)
        kind, size = header.get_uint8('op'), read_uint32(file)
        data = file.read(size)
        if kind == RecordType.CHUNK:
            chunk = decompressors[header.get_string('compression')](data)
            yield from _walk(BytesIO(chunk), content, streams)
        if len(data) < size:
            raise EOFError('it ends in the midst of a record')
        if kind == RecordType.CONNECTION:
            about = Header.read(BytesIO(size.to_bytes(4, 'little') + data))
            streams[header.get_uint32('conn')] = content.stream(
                header.get_string('topic'), normalize_msgtype(about.get_string('type')),
                about.get('callerid', b'').decode() or NOT_RECORDED, wire_ros1)
        elif kind == RecordType.MSGDATA and (stream := streams.get(header.get_uint32('conn'))):
            yield stream, data


_READERS: dict[str, Callable[[Path, Content], _Records]] = {
    '.mcap': _records_of_mcap, '.db3': _records_of_sqlite, '.bag': _records_of_ros1}
