"""The files of a bag."""

from pathlib import Path
import re
from typing import Any

from dummy_arm.tf.bag_content import BagError

_KINDS = {b'\x89MCAP0\r\n': '.mcap', b'SQLite format 3\0': '.db3', b'#ROSBAG V': '.bag'}
_ZSTD = b'\x28\xb5\x2f\xfd'
_WHAT = ('a bag is the directory that ros2 bag record makes, a file .mcap or .db3 in it, or a '
         '.bag of ROS 1')


def kind_of(path: Path) -> str:
    """
    Tell what a bag is: 'dir', '.mcap', '.db3' or '.bag'; by its first bytes.

    :raises BagError: when it is none of these.
    :raises OSError: when it is not there, or may not be read.
    """
    if path.is_dir():
        return 'dir'
    if path.exists() and not path.is_file():
        raise BagError(f'{path} is no bag: it is no regular file')
    with path.open('rb') as file:
        beginning = file.read(16)
    for magic, kind in _KINDS.items():
        if beginning.startswith(magic):
            return kind
    if beginning.startswith(_ZSTD):
        raise BagError(f'{path} is compressed as a file: give the directory that it lies in')
    raise BagError(f'{path} is no bag: ' + (_WHAT if beginning else 'it is empty'))


def storage_files(directory: Path) -> list[Path]:
    """
    List the files with messages in the directory of a bag, in the order of their numbers.

    :raises BagError: when there is none.
    """
    files = [path for path in directory.iterdir()
             if re.search(r'\.(mcap|db3)(\.zstd)?$', path.name)]
    if not files:
        raise BagError(f'{directory} is no bag: {_WHAT}')
    return sorted(files, key=lambda path: [
        part.zfill(20) if part.isdigit() else part for part in re.split(r'(\d+)', path.name)])


def log_of(file: Path) -> Path:
    """Tell where an SQLite file that was not closed has its newest messages."""
    return file.with_name(f'{file.name}-wal')


def decompressed(data: bytes) -> bytes:
    """Decompress a message, if it was compressed by itself, which is told beside the file."""
    if data[:4] != _ZSTD:
        return data
    return bytes(zstd().decompress(data))


def zstd() -> Any:
    """Find the module that rosbags uses."""
    try:
        from compression import zstd  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        from backports import zstd
    return zstd
