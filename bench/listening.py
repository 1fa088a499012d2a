"""The cost of listening: from bytes into the buffer, and of whole processes over DDS."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from statistics import mean
import subprocess
import sys
from timeit import timeit

from measure import cost, has_real_tf2, resident, Row
import numpy as np
from numpy.typing import NDArray

from puretf import TransformBuffer
from puretf._core.engine import engine_of
from puretf._wire.encoding import CDR
from puretf._wire.message_reader import Layout, MessageReader

ROLES = str(Path(__file__).parent / 'roles.py')
MS = 1_000_000
RUNS = 2
#: Samples of each frame (at 1000 Hz).
HISTORY = 1000
#: The rate at which lost messages are counted (Hz).
RATE_LOST = 2000
#: Rates (Hz), and numbers of frames in a message.
STREAMS = (500, 20), (1000, 4), (50, 20)


def chain(frames: int) -> tuple[Layout, NDArray[np.float64]]:
    """Return a template for messages of a chain of frames, and their poses."""
    packet = Layout(CDR, [(f'frame_{i}', f'frame_{i + 1}') for i in range(frames)])
    return packet, np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8], (frames, 1))


def into_the_buffer(u: float) -> Iterator[Row]:
    """Measure the insertion of messages, as bytes, into a full buffer, whose samples expire."""
    for frames in 4, 20, 100:
        packet, poses = chain(frames)
        buffer, reader = TransformBuffer(HISTORY * MS), MessageReader(print)
        stamps = count(10**18, MS)

        def insert(messages: list[bytes]) -> None:
            for message in messages:
                engine_of(buffer).insert_batches(reader.read((message,), 'bench', False))  # noqa: B023

        def measure(number: int) -> float:
            messages = [packet.pack(next(stamps), poses) for _ in range(number)]  # noqa: B023
            return timeit(lambda: insert(messages), number=1) / number

        measure(HISTORY + 100)
        seconds = min(measure(200) for _ in range(20))
        yield (f'message of {frames} frames', *cost(seconds, u),
               f'{seconds / frames * 1e6:.2f} µs per frame')


def memory() -> Iterator[Row]:
    """Measure the memory of a buffer that receives 100 frames at 100 Hz."""
    packet, poses = chain(100)
    buffer, reader = TransformBuffer(10_000 * MS), MessageReader(print)
    sizes = {}
    for number in range(300 * 100 + 1):
        engine_of(buffer).insert_batches(reader.read(
            (packet.pack(10**18 + number * 10 * MS, poses),), 'bench', False))
        if number in (3_000, 30_000):
            sizes[number // 100] = resident()
    yield ('resident memory of the process, after 30 s, 100 frames at 100 Hz, cache time 10 s',
           f'{sizes[30]:.1f} MiB', '', f'{sizes[300]:.1f} MiB after 300 s')


def play(*arguments: str) -> 'subprocess.Popen[str]':
    """Start a process of roles.py."""
    return subprocess.Popen([sys.executable, ROLES, *arguments], stdout=subprocess.PIPE, text=True)


def measured(role: str, listener: str, topic: str, rate: float, frames: int, seconds: float
             ) -> float:
    """Return what a listening process measures while messages are published."""
    with play('send', topic, str(rate), str(frames), str(seconds)) as sender:
        with play(role, *listener.split()) as process:
            result = float(process.communicate(timeout=60)[0])
        if role != 'count':
            sender.terminate()
    return result


def over_dds() -> Iterator[Row]:
    """Measure the CPU time, the losses and the latency of listening processes."""
    listeners = [
        ('rclpy subscription, compiled conversion, insert', 'Compiled', 'poses'),
        ("rclpy subscription, this package's TFMessage, set_transform", 'Objects', 'tf'),
        ('TransformListener, node spun', 'TransformListener', 'tf'),
        ('TransformListener, node not spun', 'TransformListener unspun', 'tf'),
        ('the same while a future waits', 'Waiting unspun', 'tf')]
    if has_real_tf2():
        listeners.insert(0, ('tf2_ros.TransformListener', 'tf2_ros', 'tf'))
    for rate, frames in STREAMS:
        results: dict[str, list[float]] = {}
        for _ in range(RUNS):
            for what, listener, topic in listeners:
                results.setdefault(what, []).append(
                    measured('cpu', listener, topic, rate, frames, 30))
        reference = mean(results[listeners[0][0]])
        for what, parts in results.items():
            yield (f'{rate} Hz x {frames} frames: {what}', f'{mean(parts):.1%} of a core', '',
                   f'{mean(parts) / reference:.3f} of the first')
    expected = RATE_LOST * 10
    got = measured('count', 'TransformListener', 'tf', RATE_LOST, 20, 10)
    yield (f'{RATE_LOST} Hz x 20 frames: TransformListener with a queue of 100',
           f'{got:.0f} of {expected} messages', '',
           f'{expected - got:.0f} lost')
    own = measured('latency', 'subscription', 'tf', 100, 20, 30)
    waiting = measured('latency', 'TransformListener', 'tf', 100, 20, 30)
    yield ('median from publish to the callback of a subscription, 100 Hz x 20 frames',
           f'{own * 1e3:.2f} ms', '', '1')
    yield ('median from publish to the end of a lookup that waits for it',
           f'{waiting * 1e3:.2f} ms', '', f'{waiting / own:.2f}')
