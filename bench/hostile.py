"""The highest cost of a hostile publisher: time with the lock held, and memory."""

from collections.abc import Iterator
import subprocess
import sys
from time import perf_counter

from measure import best, Row
import numpy as np

from puretf import TransformBuffer, TransformException
from puretf._core import pose as poses
from puretf._core.engine import engine_of
from puretf._core.pose import IDENTITY
from puretf._wire import cdr
from puretf._wire.message_reader import MessageReader

_S = 10**9
_PARENTS, _FRAMES = 20_000, 100_000


def _fail(error: cdr.MalformedMessage) -> None:
    raise error


def rows() -> Iterator[Row]:
    """Measure operations whose time is linear in the number of frames or transforms."""
    message = cdr.pack(
        poses.Row(_S + 1000 * i, f'parent_{i}', 'child', IDENTITY) for i in range(_PARENTS))
    begin = perf_counter()
    engine_of(TransformBuffer()).insert_batches(
        MessageReader(_fail).read([message], 'bench', False))
    yield (f'{_PARENTS} transforms of one frame, each with another parent, in one message',
           f'{perf_counter() - begin:.2f} s', '', '')
    buffer = TransformBuffer()
    for i in range(_FRAMES - 1):
        buffer.insert(_S, 'map', f'frame_{i}', IDENTITY)
    held = best(engine_of(buffer).tree.states)
    listed = best(buffer.frames)
    yield (f'frames() of {_FRAMES} frames', f'{listed * 1e3:.0f} ms', '',
           f'{held * 1e3:.0f} ms locked')
    begin = perf_counter()
    try:
        buffer.lookup_transform('map', 'frame_x')
    except TransformException as error:
        raised = perf_counter() - begin
        str(error)
    yield (f'error about an unknown frame among {_FRAMES}, with its text',
           f'{(perf_counter() - begin) * 1e3:.0f} ms', '', f'{raised * 1e3:.0f} ms locked')


def memory() -> Iterator[Row]:
    """Measure the memory of buffers at their limits of samples, or of frames with long names."""
    for what, *arguments in (
            ('a buffer with 110 frames, full of samples', 110, 13_300_000 // 110, 5),
            (f'a buffer with {_FRAMES} frames, full of samples', _FRAMES - 1, 133, 12),
            (f'a buffer with {_FRAMES} frames, names of 1024 bytes, 4 bytes a character',
             _FRAMES - 1, 1, 1021)):
        size, number = subprocess.run(
            [sys.executable, __file__, *map(str, arguments)], stdout=subprocess.PIPE, text=True,
            check=True).stdout.split()
        yield what, f'{size} MiB', '', f'{number} samples'


def status(field: str) -> float:
    """
    Return an amount of memory from the status of this process (MiB).

    :param field: the beginning of its line.
    """
    with open('/proc/self/status') as lines:
        (line,) = (line for line in lines if line.startswith(field))
    return int(line.split()[1]) / 1024


def fill(frames: int, samples: int, length: int) -> None:
    """
    Fill a buffer; print the growth of its peak memory (MiB), and the number of its samples.

    :param frames: the number of frames, without their parent.
    :param samples: the number of samples that each of them receives.
    :param length: the length of their names (characters); one of 100 or more begins with an emoji,
        so that Python stores each of its characters in four bytes.
    """
    begin = '' if length < 100 else '\U0001f600'
    together = 110
    packets = [
        cdr.MessageTemplate([('map', f'{begin}{j:0{length - len(begin)}}')
                     for j in range(i, min(i + together, frames))])
        for i in range(0, frames, together)]
    before = status('VmRSS')
    buffer, reader = TransformBuffer(), MessageReader(_fail)
    for number in range(samples):
        for i, packet in enumerate(packets):
            poses = np.tile(IDENTITY, (min(together, frames - i * together), 1))
            engine_of(buffer).insert_batches(reader.read(
                [packet.pack(_S + 1000 * number, poses)], 'bench', False))
    peak = status('VmHWM')
    print(f'{peak - before:.0f} {sum(frame.length for frame in buffer.frames())}')


if __name__ == '__main__':
    if len(sys.argv) > 1:
        fill(*map(int, sys.argv[1:]))
    else:
        for row in (*rows(), *memory()):
            print(f'| {" | ".join(row)} |')
