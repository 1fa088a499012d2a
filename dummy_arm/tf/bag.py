"""TF out of a bag: read into a BufferCore, without ROS."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
import logging
import os
from pathlib import Path
from typing import Any, Optional, Union

from dummy_arm.progress import progress
from dummy_arm.tf.bag_content import BagError, Content, Stream
from dummy_arm.tf.bag_records import records
from dummy_arm.tf.buffer_core import BufferCore
from dummy_arm.tf.message_reader import Form, MessageReader
from dummy_arm.tf.wire import MalformedMessage

__all__ = ['BagError', 'read']

_FOR_EVER = 2**63 - 1  # ns
#: So many are inserted at once.
_MOST_BYTES = 500_000


def read(path: Union[str, 'os.PathLike[str]'], *, cache_time: Any = None, namespace: str = '',
         partial: bool = False, max_samples: Optional[int] = None) -> BufferCore:
    """
    Read the transforms of a bag; on a terminal with a progress bar, where tqdm is installed.

    :param path: a bag of rosbag2 (its directory, or a file .mcap or .db3), or a .bag of ROS 1.
    :param cache_time: how long transforms are kept, as BufferCore has it; None: all are kept.
    :param namespace: the topics are `/tf` and `/tf_static` in this namespace.
    :param partial: of a bag that was cut off or is damaged, take what can be read, and warn.
    :param max_samples: how many transforms are kept, as BufferCore has it; None: all.
    :returns: a buffer with them; the authority of a frame is the node that sent it, where that was
        recorded: in ROS 1.
    :raises BagError: when it is no bag, is damaged, or has no TF.
    :raises OSError: when it is not there, or not readable.
    """
    path = Path(path)
    buffer = BufferCore(_FOR_EVER if cache_time is None else cache_time, max_samples=max_samples)
    faults: Counter[str] = Counter()

    def on_malformed(error: MalformedMessage) -> None:
        faults[str(error).partition(':')[0]] += 1

    readers: dict[tuple[bool, Form], MessageReader] = {}
    count = 0
    with progress(1.0, desc=f'reading {path.name}',
                  bar_format='{desc} {bar} {percentage:.0f} %') as show:
        content = Content(namespace, partial, show)
        for gathered in _gathered(records(path, content), cache_time is not None):
            for stream, messages in gathered.items():
                key = stream.is_static, stream.form
                reader = readers.setdefault(key, MessageReader(on_malformed, stream.form))
                buffer.insert_messages(messages, reader, stream.sender, stream.is_static)
                count += len(messages)
            buffer.on_new_data()
    if not count:
        raise BagError(
            f'nothing of TF can be read of {" ".join(content.damage)}' if content.damage else
            f'{path} has no TF: {content.why_none()}')
    log = logging.getLogger('dummy_arm.tf')
    for fault, times in faults.items():
        log.warning('%s: left out %d of %d messages of TF, which cannot be decoded: %s',
                    path, times, count, fault)
    if content.damage:
        log.warning('%s What could be read are %d messages of TF',
                    ' '.join(content.damage), count)
    if not buffer.frames():
        raise BagError(f'{path} has no TF that can be used, in {count} messages')
    return buffer


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
        size += len(data)
    yield gathered
