"""The messages of the files of a recording, of any format; rosbags reads those of ROS 1."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Optional

from rosbags import rosbag1
from rosbags.typesys import get_typestore, Stores

from puretf._bag.contents import Contents, NOT_RECORDED
from puretf._bag.database import records_of_database
from puretf._bag.mcap_file import McapFile
from puretf._bag.recordings import BAG_DEFINITION
from puretf._bag.unpacking import Item, TICK, unpack_file, ZSTD
from puretf._wire.encoding import Encoding, ROS1

_typestore = cache(get_typestore)
_Reader = Callable[[Path, Contents], Iterator[Item]]


def records(path: Path, contents: Contents, copies: dict[Path, TemporaryDirectory[str]]
            ) -> Iterator[Item]:
    """Yield the messages of a file that are read; `copies`: the decompressed copies of files."""
    contents.file = path
    try:
        read = _format_of(path)
        if read is not None:
            yield from read(path, contents)
            return
        if path not in copies:
            copies[path] = TemporaryDirectory()
        whole = Path(copies[path].name, 'whole')
        try:
            for done in unpack_file(path, whole):
                yield done / 2
        except Exception as error:  # what has been decompressed is read
            contents.add_damage(error)
        # Of a file that is cut off early, nothing may have been decompressed.
        read = _format_of(whole) if whole.stat().st_size or not contents.damage else None
        for item in read(whole, contents) if read else ():
            yield (1 + item) / 2 if isinstance(item, float) else item
    except Exception as error:  # the libraries raise errors of many types
        contents.add_damage(error)


def _format_of(path: Path) -> Optional[_Reader]:
    if not path.is_file():  # the end of a pipe might never be reached
        raise ValueError('it is no file' if path.exists() else 'it is missing')
    with path.open('rb') as file:
        beginning = file.read(16)
    for magic, read in _FORMATS.items():
        if beginning.startswith(magic):
            return read
    raise ValueError('it is not a bag: ' + (
        'it is a Git LFS pointer: git lfs pull' if beginning == b'version https://' else
        BAG_DEFINITION if beginning else 'it is empty'))


def _records_of_ros1(path: Path, contents: Contents) -> Iterator[Item]:
    with rosbag1.Reader(path) as reader:
        topics = {each.id: contents.topic(
            each.topic, each.msgtype, each.msgdef.data, 'ros1',
            publisher=each.ext.callerid or NOT_RECORDED, count=each.msgcount)
            for each in reader.connections}
        wanted = [each for each in reader.connections if topics[each.id].is_read]
        number, total = 0, sum(each.msgcount for each in wanted)
        contents.add_span(reader.start_time, reader.end_time - 1)
        for number, (each, time, data) in enumerate(
                reader.messages(wanted) if wanted else (), 1):
            if number % TICK == 1:
                yield min(1.0, number / total)
            yield topics[each.id], time, data
    if number != total:
        raise ValueError(f'its index announces {total} messages, but {number} were found')


#: The formats, by the first bytes of a file, and what reads it.
_FORMATS: dict[bytes, Optional[_Reader]] = {
    b'\x89MCAP0\r\n': lambda path, contents: McapFile(path, contents).records(),
    b'SQLite format 3\0': records_of_database,
    b'#ROSBAG V': _records_of_ros1,
    ZSTD: None}  # a file that is compressed as a whole


def decoded(data: bytes, msgtype: str, encoding: Encoding) -> Any:
    """Return a message of a standard type as an object; None if it cannot be decoded."""
    types = _typestore(Stores.ROS1_NOETIC if encoding is ROS1 else Stores.LATEST)
    with suppress(Exception):  # the decoder raises errors of many types
        return (types.deserialize_ros1 if encoding is ROS1 else types.deserialize_cdr)(
            data, msgtype)
    return None
