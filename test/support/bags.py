"""Bags for tests, written by rosbags from messages that rosbags serializes."""

import bz2
from functools import cache
import os
from random import randrange
import signal
import struct
import sys

import lz4.frame
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

from puretf._core.pose import Row
import puretf.bag
from puretf_tools.doctor import examine_bag

S = 10**9
#: Every kind of bag, with each of its compressions.
ROS2 = ('db3', 'mcap', 'db3 file', 'db3 message', 'mcap file', 'mcap message', 'mcap storage')
ROS1 = ('bag', 'bag bz2', 'bag lz4')
TF = 'tf2_msgs/msg/TFMessage'
STRING, JOINT_STATE = 'std_msgs/msg/String', 'sensor_msgs/msg/JointState'
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def row(stamp, parent, child, pose=STILL):
    """Return a transform as a row of the wire format; the stamp in ns."""
    return Row(stamp, parent, child, pose)


def walk(seconds=10, hertz=10, begin=100 * S):
    """
    Yield the messages of a bag of a robot: topic, time (ns) and rows.

    Static: map -> odom. Dynamic: odom -> base_link, which moves along x at 1 m/s.

    :param begin: the time of the first message (ns).
    """
    yield '/tf_static', begin, [row(begin, 'map', 'odom', (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0))]
    for i in range(seconds * hertz + 1):
        stamp = begin + i * S // hertz
        yield '/tf', stamp + 1_000_000, [
            row(stamp, 'odom', 'base_link', (i / hertz, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))]


def make(path, kind, messages, qos=()):
    """
    Write a bag.

    :param path: where to write it; in a directory, under a name of its own.
    :param kind: 'db3', 'mcap' or 'bag', and after a blank how it is compressed.
    :param messages: topic, time (ns), and a list of rows or the bytes of a message; optionally the
        type of the message, and then its publisher, which only ROS 1 records.
    :param qos: for a bag of ROS 2: the profiles of rosbags that are recorded for /tf_static.
    :returns: the path.
    """
    storage, _, compression = kind.partition(' ')
    path = path / f'walk.{kind.replace(" ", "_")}' if path.is_dir() else path
    if storage == 'bag':
        _write_ros1(path, compression, messages)
    else:
        _write_ros2(path, storage, compression, messages, qos)
    return path


def messages(path, *, tf=True, headers=False, others=(), **kwargs):
    """Open a bag and yield its messages."""
    with puretf.bag.open(path, **kwargs) as bag:
        yield from bag.messages(tf=tf, headers=headers, others=others)


def file_of(path):
    """Return the storage file of a bag that has only one."""
    (file,) = [path] if path.is_file() else (
        each for each in path.iterdir() if each.suffix != '.yaml')
    return file


def examine_unless_faulty(paths, **kwargs):
    """Examine a bag in this process; end the process if the bag has the name faulty.bag."""
    if paths[0].name == 'faulty.bag':
        os.kill(os.getpid(), signal.SIGKILL)
    return examine_bag(paths, **kwargs)


def point(frame, stamp=S, version=2):
    """Serialize a PointStamped, which begins with a header."""
    new = _types(version).types
    return _serialized('geometry_msgs/msg/PointStamped', version, _header(version, stamp, frame),
                       new['geometry_msgs/msg/Point'](1.0, 2.0, 3.0))


def string(text, version=2):
    """Serialize a String."""
    return _serialized(STRING, version, text)


def joint_state(names, version=2, *, stamp=1, positions=None):
    """Serialize a JointState with positions of 0; the stamp is in seconds."""
    zeros = np.zeros(len(names) if positions is None else positions)
    return _serialized(
        JOINT_STATE, version, _header(version, stamp * S, ''), names, zeros, zeros, zeros)


def _header(version, stamp, frame):
    new = _types(version).types
    return new['std_msgs/msg/Header'](
        *((7,) if version == 1 else ()), new['builtin_interfaces/msg/Time'](*divmod(stamp, S)),
        frame)


def _serialized(msgtype, version, *fields):
    types = _types(version)
    serialize = types.serialize_ros1 if version == 1 else types.serialize_cdr
    return bytes(serialize(types.types[msgtype](*fields), msgtype))


def ros1(rows):
    """Serialize a message in the format of ROS 1."""
    return bytes(_types(1).serialize_ros1(_message(_types(1), rows), TF))


def ros2(rows):
    """Serialize a message in the format of ROS 2."""
    return bytes(_types(2).serialize_cdr(_message(_types(2), rows), TF))


def _write_ros2(path, storage, compression, messages, qos):
    writer = Writer2(path, version=9, storage_plugin={
        'db3': StoragePlugin.SQLITE3, 'mcap': StoragePlugin.MCAP}[storage])
    if compression:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    connections = {}
    with writer:
        for topic, time, content, msgtype, _ in map(_filled, messages):
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, msgtype, typestore=_types(2),
                    offered_qos_profiles=qos if topic == '/tf_static' else ())
            writer.write(connections[topic], time,
                         content if isinstance(content, bytes) else ros2(content))


def _write_ros1(path, compression, messages):
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    connections = {}
    with writer:
        for topic, time, content, msgtype, publisher in map(_filled, messages):
            if (topic, publisher) not in connections:
                connections[topic, publisher] = writer.add_connection(
                    topic, msgtype, typestore=_types(1), callerid=publisher, latching=0)
            writer.write(connections[topic, publisher], time,
                         content if isinstance(content, bytes) else ros1(content))


def _filled(message):
    return (*message, *(TF, '/sender')[len(message) - 3:])


@cache
def _types(version):
    types = get_typestore(Stores.ROS2_JAZZY if version == 2 else Stores.ROS1_NOETIC)
    if version == 1:
        for name in ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'):
            types.register(get_types_from_msg('geometry_msgs/TransformStamped[] transforms', name))
    return types


def _message(types, rows):
    def new(name, *fields):
        return types.types[name](*fields)

    number = (randrange(2**32),) if types is _types(1) else ()
    return new(TF, [
        new('geometry_msgs/msg/TransformStamped',
            new('std_msgs/msg/Header', *number,
                new('builtin_interfaces/msg/Time', *divmod(stamp, S)), parent),
            child,
            new('geometry_msgs/msg/Transform', new('geometry_msgs/msg/Vector3', *pose[:3]),
                new('geometry_msgs/msg/Quaternion', *pose[3:])))
        for stamp, parent, child, pose in rows])


def packed(data, method):
    """Compress data by 'zstd', 'lz4' or 'bz2'; return it unchanged for ''."""
    return {'': bytes, 'zstd': zstd.compress, 'lz4': lz4.frame.compress,
            'bz2': bz2.compress}[method](data)


def mcap(path, *records, summary=b''):
    """
    Write an mcap file that consists of the given records.

    :param summary: the records of its index, if it has one.
    :returns: the path.
    """
    data = b'\x89MCAP0\r\n' + mcap_record(1, _text('ros2') + _text('test')) + b''.join(records)
    data += mcap_record(0x0F, bytes(4))
    start = len(data) if summary else 0
    path.write_bytes(data + summary + mcap_record(2, struct.pack('<QQI', start, 0, 0))
                     + b'\x89MCAP0\r\n')
    return path


def mcap_record(opcode, content, length=None):
    """
    Return a record of an mcap file.

    :param length: the length that it declares (bytes); None: its real one.
    """
    return struct.pack('<BQ', opcode, len(content) if length is None else length) + content


def mcap_channel(topic='/tf', number=1, msgtype=TF, encoding='cdr', definition=''):
    """Return the records of a channel and of its type."""
    return mcap_record(3, struct.pack('<H', number) + _text(msgtype) + _text('ros2msg')
                       + _text(definition)) + mcap_record(
        4, struct.pack('<HH', number, number) + _text(topic) + _text(encoding) + _text(''))


def mcap_message(rows, time=0, number=1):
    """
    Return the record of a message.

    :param rows: its transforms, or its bytes, which are written as they are.
    """
    return mcap_record(5, struct.pack('<HIQQ', number, 0, time, time) + (
        rows if isinstance(rows, bytes) else ros2(rows)))


def mcap_chunk(data, method='', size=None, crc=0):
    """
    Return the record of a chunk.

    :param size: the uncompressed size that it declares (bytes); None: its real one.
    :param crc: the checksum that it declares; 0: none.
    """
    content = packed(data, method)
    return mcap_record(6, struct.pack('<QQQI', 0, 0, len(data) if size is None else size, crc)
                       + _text(method) + struct.pack('<Q', len(content)) + content)


def checked_mcap(path, index='ALL', compression='NONE', seconds=1, chunk_size=600, **options):
    """
    Write a walk with texts between the transforms, and with metadata, by mcap's own writer.

    There are checksums of the chunks and of the summary.

    :param options: arguments of `mcap.writer.Writer`.
    :returns: the path.
    """
    from mcap.writer import CompressionType, IndexType, Writer
    with path.open('wb') as file:
        writer = Writer(file, chunk_size, compression=CompressionType[compression],
                        index_types=IndexType[index], **options)
        writer.start('ros2')
        writer.add_metadata('rosbag2', {'distribution': 'jazzy'})
        types = {name: writer.register_schema(name, 'ros2msg', b'') for name in (TF, STRING)}
        channels = {topic: writer.register_channel(topic, 'cdr', types[name])
                    for topic, name in (('/tf_static', TF), ('/tf', TF), ('/chatter', STRING))}
        for topic, time, rows in walk(seconds, 5):
            writer.add_message(channels[topic], time, ros2(rows), time)
            for i in range(3):
                writer.add_message(channels['/chatter'], time + i, string('x' * 100), time)
        writer.finish()
    return path


def content(path, partial=False):
    """Return the messages of TF, the begin and the end of a bag; or its error."""
    try:
        with puretf.bag.open(path, partial=partial) as bag:
            found = [(each.topic.name, each.time, each.data) for each in bag.messages()]
            return found, bag.begin, bag.end
    except puretf.bag.BagError as error:
        return str(error)


def flips(path, bits):
    """
    Flip one bit of a bag after the other, whose numbers are given; count them.

    Rule: the bag is refused, or its messages, begin and end are those without the flip.
    """
    whole, data, count = content(path), path.read_bytes(), 0
    assert not isinstance(whole, str)
    for bit in bits:
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        found = content(path)
        assert found == whole or isinstance(found, str), bit
        count += 1
    path.write_bytes(data)
    return count


def _bytes(data):
    return struct.pack('<I', len(data)) + data


def _text(text):
    return _bytes(text.encode())
