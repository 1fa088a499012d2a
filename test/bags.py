"""Bags for tests: made by the writers of rosbags, of messages that rosbags serializes."""

from functools import cache
from random import randrange

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

S = 10**9
#: Every kind of bag, and its compressions.
ROS2 = ('db3', 'mcap', 'db3 file', 'db3 message', 'mcap file', 'mcap message', 'mcap storage')
ROS1 = ('bag', 'bag bz2', 'bag lz4')
TF = 'tf2_msgs/msg/TFMessage'
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def row(stamp, parent, child, pose=STILL):
    """Make a transform, as the rows of the wire are; its stamp in ns."""
    return (*divmod(stamp, S), parent, child, *pose)


def walk(seconds=10, hertz=10, begin=100 * S):
    """Make what a bag has of a robot: latched map -> odom, and odom -> base_link, which moves."""
    yield '/tf_static', begin, [row(begin, 'map', 'odom', (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0))]
    for i in range(seconds * hertz + 1):
        stamp = begin + i * S // hertz
        yield '/tf', stamp + 1_000_000, [
            row(stamp, 'odom', 'base_link', (i / hertz, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))]


def make(path, kind, messages):
    """
    Write a bag.

    :param kind: 'db3', 'mcap' or 'bag', and after a blank how it is compressed.
    :param messages: topic, time (ns), and a list of rows, or the bytes of a message; then the type
        of the message, and in ROS 1 its sender, if they are others than usual.
    :returns: the path.
    """
    storage, _, compression = kind.partition(' ')
    path = path / f'walk.{kind.replace(" ", "_")}' if path.is_dir() else path
    if storage == 'bag':
        _write_ros1(path, compression, messages)
    else:
        _write_ros2(path, storage, compression, messages)
    return path


def ros1(rows):
    """Serialize a message as ROS 1 has it."""
    return bytes(_types(1).serialize_ros1(_message(_types(1), rows), TF))


def ros2(rows):
    """Serialize a message as ROS 2 has it."""
    return bytes(_types(2).serialize_cdr(_message(_types(2), rows), TF))


def _write_ros2(path, storage, compression, messages):
    writer = Writer2(path, version=9, storage_plugin={
        'db3': StoragePlugin.SQLITE3, 'mcap': StoragePlugin.MCAP}[storage])
    if compression:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    connections = {}
    with writer:
        for topic, time, content, msgtype, _ in map(_filled, messages):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=_types(2))
            writer.write(connections[topic], time,
                         content if isinstance(content, bytes) else ros2(content))


def _write_ros1(path, compression, messages):
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    connections = {}
    with writer:
        for topic, time, content, msgtype, sender in map(_filled, messages):
            if (topic, sender) not in connections:
                connections[topic, sender] = writer.add_connection(
                    topic, msgtype, typestore=_types(1), callerid=sender, latching=0)
            writer.write(connections[topic, sender], time,
                         content if isinstance(content, bytes) else ros1(content))


def _filled(message):
    topic, time, content, *others = message
    msgtype, sender = [*others, *(TF, '/sender')[len(others):]]
    return topic, time, content, msgtype, sender


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
                new('builtin_interfaces/msg/Time', sec, nanosec), parent),
            child,
            new('geometry_msgs/msg/Transform', new('geometry_msgs/msg/Vector3', x, y, z),
                new('geometry_msgs/msg/Quaternion', *rotation)))
        for sec, nanosec, parent, child, x, y, z, *rotation in rows])
