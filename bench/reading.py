"""
The cost of reading TF from a bag.

    reading.py BAG SECONDS    read it with a cache time of SECONDS, '' for the whole bag; print the
                              peak memory (MiB)
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import redirect_stdout
import os
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
from timeit import timeit
from typing import Any

from mcap.writer import CompressionType, Writer
from measure import cost, Row
import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from puretf import bag, TransformBuffer
from puretf._core.engine import engine_of
from puretf._core.pose import IDENTITY
from puretf._core.pose import Row as TransformRow
from puretf._wire import cdr
from puretf._wire.encoding import CDR, ROS1
from puretf._wire.message_reader import Layout, MessageReader
from puretf_tools.commands import tf_doctor

TF = 'tf2_msgs/msg/TFMessage'
MS = 1_000_000
BEGIN = 10**18
TRANSFORMS = 20_000
RUNS = 5
FOR_EVER = 2**62  # ns
#: A connection of rosbags, the time (ns) and the bytes of a message.
Record = tuple[Any, int, bytes]
NAMES = {'mcap': 'rosbag2 in mcap', 'db3': 'rosbag2 in sqlite3', 'bag': 'ROS 1'}


def packets(frames: int, count: int, hertz: int = 100) -> Iterator[tuple[int, bytes]]:
    """Yield messages of a chain of frames: stamp (ns) and bytes."""
    packet = Layout(CDR, [(f'frame_{i}', f'frame_{i + 1}') for i in range(frames)])
    for number in range(count):
        half = 0.4 * np.sin(number / hertz + np.arange(frames))
        zero = np.zeros(frames)
        stamp = BEGIN + number * 1000 * MS // hertz
        yield stamp, packet.pack(stamp, np.stack(
            [zero + 0.1, zero, zero, zero, zero, np.sin(half), np.cos(half)], axis=1))


def write(path: Path, kind: str, frames: int, count: int, hertz: int = 100, others: int = 0
          ) -> None:
    """Write a bag: mcap or db3 of ROS 2, or bag of ROS 1; `others`: topics with headers, 50 Hz."""
    types = get_typestore(Stores.ROS2_JAZZY)
    if kind == 'bag':
        ros1 = get_typestore(Stores.ROS1_NOETIC)
        ros1.register(get_types_from_msg('geometry_msgs/TransformStamped[] transforms', TF))
        with Writer1(path) as writer:
            connection = writer.add_connection('/tf', TF, typestore=ros1)
            for stamp, data in packets(frames, count, hertz):
                writer.write(connection, stamp, bytes(types.cdr_to_ros1(data, TF)))
        return
    plugin = StoragePlugin.MCAP if kind == 'mcap' else StoragePlugin.SQLITE3
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection('/tf', TF, typestore=types)
        topics = [writer.add_connection(f'/imu_{i}', 'sensor_msgs/msg/Imu', typestore=types)
                  for i in range(others)]
        for number, (stamp, data) in enumerate(packets(frames, count, hertz)):
            writer.write(connection, stamp, data)
            if number * 50 % hertz == 0:
                header = cdr.pack([TransformRow(stamp, f'frame_{frames}', '', IDENTITY)])[8:]
                for topic in topics:
                    writer.write(topic, stamp, b'\0\1\0\0' + header + bytes(300))


def insert_deserialized(reader: AnyReader, records: Iterable[Record]) -> None:
    """Let rosbags deserialize messages into objects, and insert their transforms one by one."""
    buffer = TransformBuffer(FOR_EVER)
    for connection, _, data in records:
        message: Any = reader.deserialize(data, connection.msgtype)
        for t in message.transforms:
            stamp, p, q = t.header.stamp, t.transform.translation, t.transform.rotation
            buffer.insert(stamp.sec * 10**9 + stamp.nanosec, t.header.frame_id, t.child_frame_id,
                          (p.x, p.y, p.z, q.x, q.y, q.z, q.w))


def insert_objects(path: Path) -> None:
    """Read a bag by `insert_deserialized`."""
    with AnyReader([path]) as reader:
        insert_deserialized(reader, reader.messages())


def insert_records(records: Iterable[Record], kind: str) -> None:
    """Insert messages as bytes."""
    reader = MessageReader(print, ROS1 if kind == 'bag' else CDR)
    engine_of(TransformBuffer(FOR_EVER)).insert_batches(
        reader.read((data for _, _, data in records), 'bench', False))


def least(work: Callable[[], object]) -> float:
    """Return the least time of some runs (s)."""
    return min(timeit(work, number=1) for _ in range(RUNS))


def rows(u: float) -> Iterator[Row]:
    """Measure both ways to read a bag, with and without the reading of the file."""
    for kind in 'mcap', 'db3', 'bag':
        for frames in 1, 4, 20:
            with TemporaryDirectory() as directory:
                path = Path(directory, f'bench.{kind}')
                write(path, kind, frames, TRANSFORMS // frames)
                whole = least(lambda: insert_objects(path))  # noqa: B023
                ours = least(lambda: bag.read(path))  # noqa: B023
                with AnyReader([path]) as reader:
                    records = [*reader.messages()]
                    deserialized = least(
                        lambda: insert_deserialized(reader, records))  # noqa: B023
                decoded = least(lambda: insert_records(records, kind))  # noqa: B023
            yield (f'{NAMES[kind]}, {frames} frame{"s"[:frames - 1]} per message',
                   *cost(ours / TRANSFORMS, u),
                   f'{whole / ours:.1f} x as fast as rosbags; without the reading of the file, '
                   f'{deserialized / decoded:.1f} x')


def many(u: float) -> Iterator[Row]:
    """Measure the reading of 20 000 messages of 4 frames, alone and among 200 000 others."""
    for compression in '', 'lz4', 'zstd':
        for others in 0, 10:
            with TemporaryDirectory() as directory:
                path = Path(directory, 'bench.mcap')
                write_chunks(path, compression, others)
                seconds = least(lambda: bag.read(path))  # noqa: B023
                with AnyReader([path]) as reader:
                    wanted = [each for each in reader.connections if each.topic == '/tf']
                    theirs = least(
                        lambda: deque(reader.messages(wanted), maxlen=0))  # noqa: B023
            yield (f'mcap{", " * bool(compression)}{compression}, 4 frames per message'
                   + ', ten other messages for each' * bool(others), *cost(seconds / 80_000, u),
                   f'{seconds / theirs:.1f} of reading the bytes by rosbags')


def write_chunks(path: Path, compression: str, others: int, size: int = 300) -> None:
    """Write an mcap file as rosbag2 does; `others`: messages of a size (bytes) for each of TF."""
    other = b'\0\1\0\0' + bytes(8) + b'\x05\0\0\0imu_\0\0\0\0' + bytes(size)
    with path.open('wb') as file:
        writer = Writer(file, chunk_size=786_432, compression=CompressionType[
            compression.upper() or 'NONE'])
        writer.start('ros2')
        channels = [writer.register_channel(topic, 'cdr', writer.register_schema(
            msgtype, 'ros2msg', b'std_msgs/Header header'))
            for topic, msgtype in (('/tf', TF), ('/imu', 'sensor_msgs/msg/Imu'))]
        for stamp, data in packets(4, 20_000):
            writer.add_message(channels[0], stamp, data, stamp)
            for number in range(others):
                writer.add_message(channels[1], stamp + number, other, stamp)
        writer.finish()


def doctor() -> Iterator[Row]:
    """Measure tf_doctor for a bag, and compare it with reading the bag."""
    seconds, hertz, frames = 60, 1000, 20
    for kind, others in ('mcap', 0), ('db3', 0), ('bag', 0), ('mcap', 40), ('db3', 40):
        with TemporaryDirectory() as directory:
            path = Path(directory, f'bench.{kind}')
            write(path, kind, frames, seconds * hertz, hertz, others)
            rounds = []
            for _ in range(3):
                read = timeit(lambda: bag.read(path, cache_time=10**10), number=1)  # noqa: B023
                with open(os.devnull, 'w') as nothing, redirect_stdout(nothing):
                    checked = timeit(
                        lambda: tf_doctor.main(['--bag', str(path)]), number=1)  # noqa: B023
                rounds.append((checked / read, checked))
            ratio, cost_of_all = sorted(rounds)[1]
        yield (f'tf_doctor, {NAMES[kind]}, {seconds} s at {hertz} Hz, {frames} frames'
               + f', {others} topics with headers' * bool(others),
               f'{cost_of_all:.2f} s', '', f'{ratio:.2f} of reading it')


def memory() -> Iterator[Row]:
    """Measure the peak memory of a process that reads a bag and keeps a part of it."""
    with TemporaryDirectory() as directory:
        peaks = []
        for seconds in 30, 300:
            path = Path(directory, f'{seconds}.mcap')
            write(path, 'mcap', 100, seconds * 100)
            peaks += [peak(path, '10'), peak(path, '')]
        few, huge = Path(directory, 'few.mcap'), Path(directory, 'huge.mcap')
        write_chunks(few, '', 0)
        write_chunks(huge, '', 1, 50_000)
        beside = peak(few, ''), peak(huge, '')
    kept = (peaks[3] - peaks[1]) * 2**20 / (100 * 100 * (300 - 30))
    yield ('peak memory of reading a bag of 30 s, 100 frames at 100 Hz, cache time 10 s',
           f'{peaks[0]:.1f} MiB', '', f'{peaks[2]:.1f} MiB for 300 s')
    yield ('peak memory of reading 80 000 transforms', f'{beside[0]:.1f} MiB', '',
           f'{beside[1]:.1f} MiB with 1 GB of another topic beside them')
    yield ('peak memory of reading 30 s, 100 frames at 100 Hz, all transforms kept',
           f'{peaks[1]:.1f} MiB', '',
           f'{peaks[3]:.1f} MiB for 300 s: {kept:.0f} bytes per transform')


def peak(path: Path, seconds: str) -> float:
    """
    Return the peak memory of another process that reads a bag (MiB).

    :param seconds: the cache time (s); '': the whole bag.
    """
    done = subprocess.run([sys.executable, __file__, str(path), seconds], text=True, check=True,
                          stdout=subprocess.PIPE)
    return float(done.stdout)


if __name__ == '__main__':
    bag.read(sys.argv[1], cache_time=int(sys.argv[2]) * 10**9 if sys.argv[2] else None)
    # Not ru_maxrss, which a process inherits from the one that starts it.
    print(int(Path('/proc/self/status').read_text().partition('VmHWM:')[2].split()[0]) / 1024)
