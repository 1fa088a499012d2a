"""The messages of TF in a bag, as they were recorded."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from dummy_arm.tf import torn_bag, wire
from dummy_arm.tf.bag_content import BagError, Content, NOT_RECORDED, Stream
from dummy_arm.tf.bag_files import decompressed, kind_of, log_of, storage_files

_ADVANCE = 100
_SHOWN = 5


def records(path: Path, content: Content) -> Iterator[tuple[Stream, bytes]]:
    """
    Read the messages of TF, in the order in which they were recorded.

    :param content: learns what there is.
    :raises BagError: when it is no bag; or is damaged, and not to be read as partial.
    :raises OSError: when it is not there, or may not be read.
    """
    kind = kind_of(path)
    if content.partial and kind != '.bag':
        yield from torn_bag.records(path, content)
        return
    try:
        if kind == '.bag':
            from dummy_arm.tf import ros1_records
            yield from ros1_records.records(path, content)
        else:
            yield from _records_of_ros2(path, kind, content)
    except ImportError as error:
        raise BagError(f'rosbags, which reads bags, cannot be imported ({error}): '
                       'pip install rosbags') from None
    except BagError:
        raise
    except Exception as error:  # a damaged file is met by errors of many types
        content.meet(path, error)


def _records_of_ros2(path: Path, kind: str, content: Content) -> Iterator[tuple[Stream, bytes]]:
    reader = _reader(path, kind)
    reader.open()
    with closing(reader):
        streams: dict[int, Stream] = {}
        chosen = []
        for connection in reader.connections:
            if stream := content.stream(connection.topic, connection.msgtype, NOT_RECORDED, wire):
                streams[connection.id] = stream
                chosen.append(connection)
        if not chosen:  # rosbags would give the messages of all
            return
        total = max(1, sum(connection.msgcount for connection in chosen))
        for number, (connection, _, data) in enumerate(reader.messages(chosen)):
            if number % _ADVANCE == 0:
                content.advance(number / total)
            yield streams[connection.id], decompressed(data)


def _reader(path: Path, kind: str) -> Any:
    """Choose a reader of rosbags; the one that it has for any bag goes by the file's name."""
    files = storage_files(path) if kind == 'dir' else [path]
    if kind == 'dir' and not (path / 'metadata.yaml').exists():
        raise BagError(
            f'{path} has no metadata.yaml, which is written when a recording ends: name one of '
            f'its files ({", ".join(file.name for file in files[:_SHOWN])}), or if they are one '
            'recording, mend it by ros2 bag reindex or read it as partial (--partial)')
    for file in files:
        log = log_of(file)
        if log.exists() and log.stat().st_size:
            raise BagError(f'{file} was not closed when it was recorded, and {log.name} has what '
                           'is not in it yet: read it as partial (--partial)')
        if {'#', '%', '?'} & {*str(file)} and '.db3' in (kind, file.suffix):
            raise BagError(f'{file} cannot be read: rosbags takes no #, % or ? in the path of an '
                           'SQLite file: rename it, or read it as partial (--partial)')
    from rosbags.rosbag2 import Reader
    return Reader.STORAGE_PLUGINS[kind](path)
