"""The messages of TF in a bag of ROS 1, one after the other: its index may be larger than they."""

from collections.abc import Iterator
from io import BytesIO, SEEK_CUR
from pathlib import Path
from typing import BinaryIO, Optional

from rosbags.rosbag1.reader import decompressors, Header, read_bytes, read_uint32, RecordType
from rosbags.typesys.msg import normalize_msgtype

from dummy_arm.tf import wire_ros1
from dummy_arm.tf.bag_content import Content, NOT_RECORDED, Stream

_Streams = dict[int, Optional[Stream]]


def records(path: Path, content: Content) -> Iterator[tuple[Stream, bytes]]:
    """
    Read the messages, in the order in which they lie in the file.

    :param content: learns what there is and, of a partial bag, what is wrong.
    :raises Exception: of many types, where the file is damaged.
    """
    size = path.stat().st_size
    with path.open('rb') as file:
        if file.readline() != b'#ROSBAG V2.0\n':
            raise ValueError('its version is not 2.0')
        header = Header.read(file, RecordType.BAGHEADER)
        if header.get('encryptor'):
            raise ValueError('it is encrypted')
        has_index = 0 < header.get_uint64('index_pos') <= size
        if not has_index and not content.partial:
            raise EOFError('it has no index')
        read_bytes(file, read_uint32(file))
        streams: _Streams = {}
        while file.tell() < size:
            content.advance(file.tell() / size)
            yield from _record(file, path, content, streams)
        if not has_index:
            raise EOFError('it has no index')


def _record(file: BinaryIO, path: Path, content: Content, streams: _Streams
            ) -> Iterator[tuple[Stream, bytes]]:
    """Read a record: a message, what is known of a connection, or a chunk of these."""
    header = Header.read(file)
    kind, size = header.get_uint8('op'), read_uint32(file)
    stream = streams.get(header.get_uint32('conn')) if kind == RecordType.MSGDATA else None
    if kind not in (RecordType.CHUNK, RecordType.CONNECTION) and stream is None:
        file.seek(size, SEEK_CUR)
        return
    data = file.read(size)
    is_whole = len(data) == size
    if kind == RecordType.CHUNK:
        try:
            raw = decompressors[header.get_string('compression')](data)
            chunk = BytesIO(raw)
            while chunk.tell() < len(raw):
                yield from _record(chunk, path, content, streams)
        except Exception as error:
            if not is_whole:
                raise
            content.meet(path, error)
    if not is_whole:
        raise EOFError('it ends in the midst of a record')
    if kind == RecordType.CONNECTION:
        about = Header.read(BytesIO(size.to_bytes(4, 'little') + data))
        streams[header.get_uint32('conn')] = content.stream(
            header.get_string('topic'), normalize_msgtype(about.get_string('type')),
            about.get('callerid', b'').decode() or NOT_RECORDED, wire_ros1)
    elif stream is not None:
        yield stream, data
