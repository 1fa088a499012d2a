"""The formats of bags: which one a file has, by its first bytes."""

from pathlib import Path
from typing import Optional

from puretf._bag.unpacking import ZSTD

#: The first bytes of the formats; `.zstd` is a file that is compressed as a whole.
_KINDS = {b'\x89MCAP0\r\n': '.mcap', b'SQLite format 3\0': '.db3', b'#ROSBAG V': '.bag',
          ZSTD: '.zstd'}
BAG_DEFINITION = ('a bag is a directory written by ros2 bag record, a .mcap or .db3 file in it, '
                  'or a .bag file of ROS 1')


class BagError(Exception):
    """A bag cannot be read or has no transforms; the text says why, and what to do."""


def kind_of(path: Path, name: Optional[Path] = None) -> str:
    """Return '.mcap', '.db3', '.bag' or '.zstd'; `name`: the path in the text of the error."""
    refuse_special(path)
    with path.open('rb') as file:
        beginning = file.read(16)
    for magic, kind in _KINDS.items():
        if beginning.startswith(magic):
            return kind
    raise BagError(
        f'{name or path} is not a bag: ' + (BAG_DEFINITION if beginning else 'it is empty'))


def refuse_special(path: Path) -> None:
    """Refuse pipes and devices, whose end might never be reached."""
    if path.exists() and not path.is_file():
        raise BagError(f'{path} is not a bag: it is not a regular file')
