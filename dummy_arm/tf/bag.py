"""TF out of a bag: read into a BufferCore, without ROS."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
import logging
from operator import index
import os
from pathlib import Path
from typing import Any, Optional, Union

from dummy_arm.tf._bag.context import BagContext, BagError, kind_of, Stream
from dummy_arm.tf._wire.cdr import MalformedMessage
from dummy_arm.tf._wire.streams import Encoding, MessageReader
from dummy_arm.tf.buffer_core import BufferCore

__all__ = ['BagError', 'read']

_FOR_EVER = 2**63 - 1  # ns
#: So many are inserted at once.
_MOST_BYTES = 500_000
#: What an empty message takes.
_OVERHEAD = 100
#: Of a longer message (bytes), a list of its transforms could fill the memory.
_LONG = 2**22


def read(path: Union[str, 'os.PathLike[str]'], *, cache_time: Any = None, namespace: str = '',
         partial: bool = False, max_bytes: int = 2**30, max_samples: Optional[int] = None,
         on_progress: Optional[Callable[[float], object]] = None) -> BufferCore:
    """
    Read the transforms of a bag.

    :param path: a bag of rosbag2 (its directory, or a file .mcap or .db3), or a .bag of ROS 1.
    :param cache_time: how long transforms are kept, as BufferCore has it; None: all are kept.
    :param namespace: the topics are `/tf` and `/tf_static` in this namespace.
    :param partial: of a bag that was cut off or is damaged, take what can be read, and warn.
    :param max_bytes: no chunk and no message may be larger than this, decompressed (bytes); it
        bounds the memory that a damaged or malicious bag can take.
    :param max_samples: how many transforms are kept, as BufferCore has it; None: all.
    :param on_progress: is called again and again with the part of the bag that has been read, from
        0 to 1; what it raises ends the reading, and is raised here.
    :returns: a buffer with them; the authority of a frame is the node that sent it, where that was
        recorded: in ROS 1.
    :raises BagError: when it is no bag, is damaged, has no TF, or something in it is too large.
    :raises ValueError: when max_bytes is not positive.
    :raises OSError: when it is not there, or not readable.
    """
    path = Path(path)
    if index(max_bytes) < 1:
        raise ValueError(f'max_bytes must be a positive number of bytes, got {max_bytes}')
    buffer = BufferCore(_FOR_EVER if cache_time is None else cache_time, max_samples=max_samples)
    faults: Counter[str] = Counter()

    def on_malformed(error: MalformedMessage) -> None:
        faults[str(error).partition(':')[0]] += 1

    readers: dict[tuple[bool, Encoding], MessageReader] = {}
    count = 0
    context = BagContext(path, namespace, partial, max_bytes, on_progress or (lambda done: None))
    for gathered in _gathered(_records(path, context), cache_time is not None):
        for stream, messages in gathered.items():
            key = stream.is_static, stream.encoding
            reader = readers.setdefault(key, MessageReader(on_malformed, stream.encoding))
            for is_long, some in groupby(messages, lambda message: len(message) > _LONG):
                if is_long:
                    _insert_long(buffer, some, stream, on_malformed, context.tick)
                else:
                    buffer.insert_batches(reader.read(some, stream.publisher, stream.is_static))
            count += len(messages)
    context.finish()
    if not count:
        raise BagError(
            f'nothing of TF can be read of {" ".join(context.damage)}' if context.damage else
            f'{path} has no TF: {context.why_no_tf()}')
    log = logging.getLogger('dummy_arm.tf')
    for fault, times in faults.items():
        log.warning('%s: left out %d of %d messages of TF, which cannot be decoded: %s',
                    path, times, count, fault)
    if context.damage:
        log.warning('%s What could be read are %d messages of TF',
                    ' '.join(context.damage), count)
    if not buffer.frames():
        raise BagError(f'{path} has no TF that can be used, in {count} messages')
    return buffer


def _insert_long(buffer: BufferCore, messages: Iterable[bytes], stream: Stream,
                 on_malformed: Callable[[MalformedMessage], None], tick: Callable[[], None]
                 ) -> None:
    """Insert messages, one transform after the other; of a malformed one, none."""
    for data in messages:
        try:
            for _ in stream.encoding.rows(data):
                tick()
        except MalformedMessage as error:
            on_malformed(error)
            continue
        for row in stream.encoding.rows(data):
            tick()
            buffer.insert(*row, stream.publisher, stream.is_static)


def _records(path: Path, context: BagContext) -> Iterator[tuple[Stream, bytes]]:
    """
    Read the messages of TF, as they were recorded.

    :raises BagError: when it is no bag; or is damaged, and not to be read as partial.
    :raises OSError: when it is not there, or may not be read.
    """
    kind = kind_of(path)
    try:
        if kind == '.bag':
            from dummy_arm.tf._bag import rosbag1
            yield from rosbag1.records(path, context)
        else:
            from dummy_arm.tf._bag import rosbag2
            yield from rosbag2.records(path, context)
    except Exception as error:  # a damaged file is met by errors of many types
        context.tick()  # the error may be what the callback has raised before
        if isinstance(error, ImportError):
            raise BagError(f'what reads bags cannot be imported ({error}): '
                           'pip install mcap lz4 ruamel.yaml backports.zstd') from None
        if isinstance(error, BagError):
            raise
        context.handle_error(path, error)


def _gathered(records: Iterable[tuple[Stream, bytes]], in_order: bool
              ) -> Iterator[dict[Stream, list[bytes]]]:
    """
    Gather messages by their streams, some at a time; the order of static ones is kept.

    :param in_order: that of the others, too.
    """
    gathered: defaultdict[Stream, list[bytes]] = defaultdict(list)
    messages: list[bytes] = []
    last: Optional[Stream] = None
    size = 0
    for stream, data in records:
        if size > _MOST_BYTES or (last and stream is not last and (
                in_order or last.is_static or stream.is_static)):
            yield gathered
            gathered, last, size = defaultdict(list), None, 0
        if stream is not last:
            last, messages = stream, gathered[stream]
        messages.append(data)
        size += len(data) + _OVERHEAD
    yield gathered
