"""The messages of TF in a bag of rosbag2 that was cut off or is damaged: without its index."""

from collections.abc import Callable, Iterator
from contextlib import closing, suppress
import logging
import os
from pathlib import Path
import shutil
import sqlite3
from tempfile import TemporaryDirectory
from typing import Any, Optional

from dummy_arm.interruption import has_come, heed
from dummy_arm.tf import wire
from dummy_arm.tf.bag_content import BagError, Content, NOT_RECORDED, Stream
from dummy_arm.tf.bag_files import decompressed, kind_of, log_of, storage_files, zstd

_Records = Iterator[tuple[Stream, bytes]]


def records(path: Path, content: Content) -> _Records:
    """
    Read the messages of TF, in the order in which they lie in the files.

    :param content: learns what there is, and what is wrong.
    :raises BagError: when it is no bag.
    """
    files = storage_files(path) if kind_of(path) == 'dir' else [path]
    if path not in files and not (path / 'metadata.yaml').exists():
        logging.getLogger('dummy_arm.tf').warning(
            '%s has no metadata.yaml; what is read of it: %s', path,
            ', '.join(file.name for file in files))
    for number, file in enumerate(files):
        content.advance(number / len(files))
        with TemporaryDirectory() as directory:
            try:
                whole = _decompressed(file, directory) if file.suffix == '.zstd' else file
                for stream, data in _READERS[kind_of(whole)](whole, content):
                    yield stream, decompressed(data)
            except ImportError as error:
                raise BagError(f'what reads damaged bags cannot be imported ({error}): '
                               'pip install mcap rosbags') from None
            except Exception as error:  # of three libraries, and of many types
                content.meet(file, error)


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
                heed()
                chunk = Chunk.read(file)
                is_whole = file.count == begin + length
                try:
                    yield from walk(*get_chunk_data_stream(chunk, validate_crc=is_whole))
                except Exception as error:
                    if not is_whole:
                        raise
                    content.meet(path, error)
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
        database.set_progress_handler(has_come, 100_000)  # which ends what it does then
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
    if log_of(path).exists():
        shutil.copyfile(log_of(path), log_of(whole))
    return whole


_READERS: dict[str, Callable[[Path, Content], _Records]] = {
    '.mcap': _records_of_mcap, '.db3': _records_of_sqlite}
