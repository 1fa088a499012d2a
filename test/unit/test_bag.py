"""TF read from bags: of every kind, with the oddities of real ones, damaged, and within limits."""

from contextlib import closing, suppress
from functools import partial as partial_of
from io import StringIO
from itertools import cycle, product
import os
import random
import re
import shutil
import sqlite3
import struct
import sys
import tracemalloc
from types import SimpleNamespace
from typing import Any

from environment import on_unix
import numpy as np
import pytest

from puretf import bag, TransformBuffer
from puretf.bag import BagError, read
from puretf_tools.cli.bag_options import BagOption

bags = pytest.importorskip('bags')
S = bags.S
MIB = 2**20
KINDS = bags.ROS2 + bags.ROS1
PLAIN = 'db3', 'mcap', 'bag'
POINT = 'geometry_msgs/msg/PointStamped'


def messages(logs):
    """Return all that was logged, as one text."""
    return '\n'.join(record.getMessage() for record in logs)


def at(x):
    """Return a pose x m along the x axis, without rotation."""
    return (x, *bags.STILL[1:])


def outcome(path, **kwargs):
    """Read a bag; return the names of its frames, or the error."""
    try:
        return [frame.name for frame in read(path, **kwargs).frames()]
    except BagError as error:
        return str(error)


def texts(kind, count, size=5):
    """Return messages that are not TF, each with a text of some bytes."""
    text = size.to_bytes(4, 'little') + bytes(size)
    return [('/text', 200 * S, text if kind == 'bag' else b'\0\1\0\0' + text,
             'std_msgs/msg/String')] * count


# What is read


@pytest.mark.parametrize('kind', KINDS)
def test_every_kind_gives_the_same(tmp_path, logs, kind):
    """Frames, poses and messages are those that were written; only ROS 1 records publishers."""
    path = bags.make(tmp_path, kind, bags.walk())
    publisher = '/sender' if kind.startswith('bag') else 'not recorded'
    for partial in False, True:
        buffer = read(path, partial=partial)
        assert [tuple(frame) for frame in buffer.frames()] == [
            ('odom', 'map', publisher, True, 1, 0, 0, 0, publisher),
            ('base_link', 'odom', publisher, False, 101, 110 * S, 100 * S, 110 * S, publisher)]
        assert buffer.lookup_transform('map', 'base_link', 105 * S + S // 20).translation == (
            pytest.approx((6.05, 2.0, 3.0)))
        assert [(message.is_static, message.time, message.rows(), message.publisher)
                for message in bags.messages(path, partial=partial)] == [
            (topic == '/tf_static', time, rows, publisher) for topic, time, rows in bags.walk()]
    assert not logs


@pytest.mark.parametrize('kind', PLAIN)
@pytest.mark.parametrize('window', [(1, 1 * S), (2 * S, 3 * S), (4 * S, 2**63), (3 * S, S)])
def test_a_window_without_tf(tmp_path, kind, window):
    """Whether a bag has TF is a question about the bag; other messages of the window are read."""
    path = bags.make(tmp_path, kind, [
        ('/tf', time * S, [bags.row(time * S, 'map', 'odom')]) for time in (1, 3)] + [
        ('/scan', 2 * S, bags.point('map', version=1 if kind == 'bag' else 2), POINT)])
    start, stop = window
    with bag.open(path) as opened:
        assert [*opened.messages(start=start, stop=stop)] == []
        found = [*opened.messages(
            others=['/scan'], start=np.datetime64(start, 'ns'), stop=stop)]
        assert [message.topic.name for message in found] == ['/scan'] * (start <= 2 * S < stop)
    with bag.open(path, namespace='robot') as opened, pytest.raises(BagError, match='has no TF'):
        next(opened.messages(start=start, stop=stop))


def test_one_topic_in_place_of_a_list(tmp_path):
    """It is not taken for damage of the bag."""
    path = bags.make(tmp_path, PLAIN[0], [('/scan', S, bags.point('map'), POINT)])
    with bag.open(path) as opened, pytest.raises(TypeError, match=r"such as \['/scan'\]"):
        next(opened.messages(others='/scan'))


def decoded(path, name, **kwargs):
    """Return the topic and the text of each string."""
    return [(message.topic.name, text.data) for message in bags.messages(
        path, tf=False, others=[(bags.STRING, name)], **kwargs) if (text := message.decoded())]


@pytest.mark.parametrize('kind', KINDS)
def test_decoded_messages(tmp_path, kind):
    """All of the type on topics with the name, whole; damaged messages are left out."""
    long, version = 'ü<robot>' * 1000, 1 if kind.startswith('bag') else 2
    strings = [('/robot_description', 'old'), ('/r1/robot_description', 'other'),
               ('/robot_description', long), ('/my_robot_description', 'no'),
               ('/robot_description/x', 'no')]
    data = [(topic, (100 + i) * S, bags.string(text, version), bags.STRING)
            for i, (topic, text) in enumerate(strings)]
    damaged = bags.string('damaged', version)[:-3]
    path = bags.make(tmp_path, kind, [
        *bags.walk(), *data, ('/robot_description', 200 * S, damaged, bags.STRING),
        ('/r2/robot_description', S, bags.point('map', version=version), POINT)])
    assert decoded(path, 'robot_description') == [
        ('/robot_description', 'old'), ('/r1/robot_description', 'other'),
        ('/robot_description', long)]
    assert decoded(path, 'none') == []


def topics_of(path, **kwargs):
    """Read a bag; return the number of TF messages, and the frames of other topics."""
    with bag.open(path, **kwargs) as opened:
        count = len([*opened.messages(headers=True)])
    return count, {topic.name: None if topic.has_header is None else {*topic.headers.frames}
                   for topic in opened.topics if topic.name not in ('/tf', '/tf_static')}


@pytest.mark.parametrize('kind', KINDS)
def test_headers_of_other_topics(tmp_path, logs, kind):
    """The headers of topics whose type begins with a header are read."""
    version = 1 if kind.startswith('bag') else 2
    path = bags.make(tmp_path, kind, [
        *bags.walk(), *(('/point', 200 * S + i, bags.point(f'frame_{i}', S, version), POINT)
                        for i in range(12)),
        ('/tf_old', 300 * S, [bags.row(S, 'map', 'odom')])])
    for partial in False, True:
        assert topics_of(path, partial=partial) == (102, {
            '/point': {f'frame_{i}' for i in range(12)}, '/tf_old': set()})
    assert not logs


@pytest.mark.parametrize(('definition', 'frames'), [
    ('# a comment\n\nuint8 A=1\nstd_msgs/msg/Header header # first', {'laser'}),
    ('float64 x\nstd_msgs/Header header', set()),
    ('uint8 A=1\n' + '=' * 80 + '\nMSG: std_msgs/Header\nstd_msgs/Header x', set()),
    ('module my { module msg { struct Thing {\n  @verbatim (language="comment", text="one)"\n'
     ' "two")\n  @unit (value="m")\n  std_msgs::msg::Header header; }; }; };', {'laser'}),
    ('module my { module msg { struct Thing { double x; std_msgs::msg::Header y; }; }; };',
     set()),
    ('module my { module msg { struct Other { double x; }; }; };', None),
    ('module my { union Thing switch (long) {}; };', None),  # not understood
    ('', None),  # an unknown type
])
def test_definitions_of_types(tmp_path, definition, frames):
    """Whether messages begin with a header is read from the definition in the bag."""
    path = bags.mcap(
        tmp_path / 'own.mcap', bags.mcap_channel(),
        bags.mcap_channel('/thing', 2, 'my/msg/Thing', definition=definition),
        bags.mcap_message([bags.row(S, 'map', 'odom')]),
        bags.mcap_message(bags.point('laser'), number=2),
        bags.mcap_message(b'\0\1\0\0\1', number=2))  # a damaged one
    assert topics_of(path) == (1, {'/thing': frames})


@pytest.mark.parametrize('statement', [
    "UPDATE message_definitions SET encoding = ''", 'DROP TABLE message_definitions',
    "UPDATE topics SET offered_qos_profiles = '- history: 3'",
    "UPDATE topics SET offered_qos_profiles = '[}'",
    'ALTER TABLE topics DROP offered_qos_profiles'])
def test_parts_of_a_database_that_are_optional(tmp_path, statement):
    """Where definitions are missing, those of rosbags are used; the QoS may be incomplete."""
    path = bags.make(tmp_path, 'db3', [
        *bags.walk(), ('/point', 300 * S, bags.point('laser'), POINT)])
    change(bags.file_of(path), statement)
    assert topics_of(path) == (102, {'/point': {'laser'}})


def change(database, *statements):
    """Change a database by SQL."""
    with closing(sqlite3.connect(database)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()


def test_chunks_without_wanted_messages_are_not_read(tmp_path, logs):
    """The index tells which these are, so damage in them is not noticed."""
    path = bags.make(tmp_path, 'mcap storage', [
        *bags.walk(1), *(('/point', i * S, bags.point('x' * 500_000), POINT)
                         for i in range(200, 220)), *bags.walk(1, begin=300 * S)])
    file = bags.file_of(path)
    data = bytearray(file.read_bytes())
    magic = [found.start() for found in re.finditer(rb'\x28\xb5\x2f\xfd', data)]
    assert len(magic) > 5
    data[magic[-2]:magic[-2] + 4] = bytes(4)
    file.write_bytes(data)
    for partial in False, True:
        assert read(path, partial=partial).frames()[1].length == 22
    with pytest.raises(BagError, match='cannot be read'):
        topics_of(path)  # which reads the headers in these chunks
    assert not logs
    assert topics_of(path, partial=True)[0] == 24
    assert f'{file}: ' in logs[0].getMessage()


@pytest.mark.parametrize('kind', ['db3', 'mcap', 'db3 message', 'mcap storage'])
def test_a_file_of_a_bag(tmp_path, kind):
    """One file of a bag can be read alone, without metadata.yaml and under any name."""
    file = bags.file_of(bags.make(tmp_path, kind, bags.walk()))
    assert len(read(file).frames()) == 2
    assert len(read(file.rename(tmp_path / 'no_suffix')).frames()) == 2


@pytest.mark.parametrize('kind', PLAIN)
def test_what_real_bags_do(tmp_path, kind):
    """Static transforms may come late and in several messages, stamps out of order or twice."""
    def moving(*tenths):
        return [('/tf', 100 * S + i, [bags.row(tenth * S // 10, 'odom', 'base', at(tenth))])
                for i, tenth in enumerate(tenths)]

    def static(time, child, x):
        return '/tf_static', time, [bags.row(0, 'map', child, at(x))]

    buffer = read(bags.make(tmp_path, kind, [
        static(100 * S, 'odom', 1.0), *moving(1000, 1020, 1010, 1010, 1001, 1030, 5000),
        static(101 * S, 'lidar', 2.0), static(102 * S, 'odom', 3.0),
        ('/other', 103 * S, [bags.row(0, 'map', 'not TF')])]))
    assert [(frame.name, frame.is_static, frame.length) for frame in buffer.frames()] == [
        ('odom', True, 1), ('base', False, 6), ('lidar', True, 1)]
    assert buffer.lookup_transform('map', 'lidar', 7).translation[0] == 2.0
    for tenth in 1000, 1001, 1015, 1030, 4000, 5000:
        assert buffer.lookup_transform('map', 'base', tenth * S // 10).translation[0] == (
            pytest.approx(3.0 + tenth))


def test_publishers_of_ros1(tmp_path):
    """Each frame names its own publisher; static transforms keep the order of the bag."""
    def message(number, publisher, child, static=False, x=0.0):
        return ('/tf_static' if static else 'tf', 100 * S + number, [
            bags.row(100 * S + number, 'map', child, at(x))], bags.TF, publisher)

    content = [message(i, f'/node_{i % 3}', f'frame_{i % 3}') for i in range(300)]
    content += [message(300 + i, f'/node_{i % 2}', 'fixed', True, i) for i in range(5)]
    content += [('/tf', 100 * S + 400, bags.ros1([bags.row(100 * S, '/map', '/old')]),
                 'tf/msg/tfMessage', '/old_node')]
    buffer = read(bags.make(tmp_path, 'bag', content))
    assert [(frame.name, frame.authority, frame.length) for frame in buffer.frames()] == [
        *((f'frame_{i}', f'/node_{i}', 100) for i in range(3)),
        ('fixed', '/node_0', 1), ('old', '/old_node', 1)]
    assert buffer.lookup_transform('map', 'fixed').translation[0] == 4.0


def test_publishers_of_one_frame(tmp_path):
    """With a cache_time, as for a listener, the later transform and the later parent win."""
    def message(number, publisher, parent, x, stamp):
        return ('/tf', 100 * S + number, [bags.row(stamp, parent, 'hand', at(x))],
                bags.TF, publisher)

    buffer = read(bags.make(tmp_path, 'bag', [
        message(0, '/a', 'map', 0.0, 99 * S), message(1, '/b', 'odom', 1.0, 100 * S),
        message(2, '/a', 'map', 2.0, 100 * S)]), cache_time=10 * S)
    (frame,) = buffer.frames()
    assert (frame.parent, frame.authority) == ('map', '/a')
    assert buffer.lookup_transform('map', 'hand', 100 * S).translation[0] == 2.0


def test_the_cache_is_as_long_as_the_bag_by_default(tmp_path):
    """All samples are kept, however far apart their stamps are, unless cache_time limits them."""
    path = bags.make(tmp_path, 'mcap', [
        *bags.walk(5, begin=1000 * S), *bags.walk(5, begin=2_000_000_000 * S)])
    assert read(path).frames()[1].length == 102
    for kept in 2 * S, 5 * S:
        frame = read(path, cache_time=kept).frames()[1]
        # Expired samples are dropped before each insertion, so one more may be left.
        assert kept <= frame.latest - frame.oldest <= kept + S // 10


def test_a_bag_has_no_limit_of_samples_unless_asked(tmp_path, logs):
    """By default neither a buffer nor a frame has one, whatever the cache time is."""
    path = bags.make(tmp_path, 'mcap', [
        ('/tf', S + i, [bags.row(S + i, 'map', child)]) for i in range(700) for child in 'ab'])
    assert [frame.length for frame in read(path, cache_time=S // 100).frames()] == [700, 700]
    assert not logs
    assert sum(frame.length for frame in read(path, max_samples=100).frames()) <= 101
    assert 'TF_TOO_MANY_SAMPLES' in messages(logs)


@pytest.mark.parametrize('kind', ['db3', 'mcap', 'mcap storage'])
def test_times_in_no_order(tmp_path, kind):
    """Messages are inserted by time: the last static transform wins."""
    choice, buffer = random.Random(7), TransformBuffer(2**62)
    content = []
    for number in range(60):
        stamp = choice.randrange(100 * S, 200 * S)
        content += [
            ('/tf', stamp, [bags.row(stamp, 'map', f'moving_{number % 10}', at(number))]),
            ('/tf_static', choice.randrange(100 * S, 200 * S), [
                bags.row(0, 'map', f'still_{number % 3}', at(number))]),
            *texts(kind, 1, 300_000)]  # so that there are several chunks
    for topic, _, rows, *_ in sorted(content, key=lambda message: message[1]):
        for stamp, parent, child, pose in rows if topic != '/text' else ():
            buffer.insert(stamp, parent, child, pose, 'not recorded', topic == '/tf_static')
    assert read(bags.make(tmp_path, kind, content)).dump() == buffer.dump()


# Paths, files and metadata


@pytest.mark.parametrize('name', [
    'odd#name', 'pct%20name', pytest.param('what?', marks=on_unix),
    pytest.param('ctrl\nname', marks=on_unix)])
def test_odd_paths(tmp_path, name):
    """The characters of a path are taken literally, also those that are special in a URI."""
    for kind in PLAIN:
        path = bags.make(tmp_path / 'plain', kind, bags.walk(1)).rename(
            tmp_path / f'{name}.{kind}')
        assert len(read(path).frames()) == 2


@pytest.mark.parametrize('kind', PLAIN)
def test_a_namespace(tmp_path, kind):
    """A namespace is accepted with or without slashes; without it, the error names it."""
    path = bags.make(tmp_path, kind, [
        (f'/robot/left{topic}', *rest) for topic, *rest in bags.walk(1)])
    for namespace in 'robot/left', '/robot/left', '/robot/left/':
        assert len(read(path, namespace=namespace).frames()) == 2
    for partial in False, True:
        with pytest.raises(BagError, match=re.escape(
                f'{path} has no TF: no TFMessage on /tf or /tf_static, but in the namespace '
                '/robot/left: pass namespace=')):
            read(path, partial=partial)
        with pytest.raises(BagError, match='no TFMessage on /left/tf or /left/tf_static, but in'):
            read(path, namespace='left', partial=partial)
    with pytest.raises(BagError, match='but on topics without a namespace: omit the namespace'):
        read(bags.make(tmp_path / 'plain', kind, bags.walk(1)), namespace='left')


@pytest.mark.parametrize('kind', PLAIN)
def test_a_bag_without_tf(tmp_path, kind):
    """The error lists the topics that the bag has instead, at most five of them."""
    path = bags.make(tmp_path, kind, [
        (f'/topic_{i:02}', *rest) for i, (_, *rest) in enumerate(texts(kind, 12))])
    empty = bags.make(tmp_path / 'empty', kind, [])
    for partial in False, True:
        with pytest.raises(BagError, match=(
                r'has no TF: no tf2_msgs/msg/TFMessage on /tf or /tf_static; its topics: '
                r'/topic_00 \(std_msgs/msg/String\), .*/topic_04 \(std_msgs/msg/String\) and 7 '
                'more$')):
            read(path, partial=partial)
        with pytest.raises(BagError, match=r'empty has no TF: .* its topics: none$'):
            read(empty, partial=partial)


def test_another_type_or_encoding_on_tf(tmp_path):
    """A topic /tf of another type or encoding is not TF, and the error names it."""
    path = bags.make(tmp_path, 'mcap', [('/tf', S, b'\0\1\0\0\0', 'std_msgs/msg/Bool')])
    with pytest.raises(BagError, match=f'TF: /tf has the type std_msgs/msg/Bool, not {bags.TF}: '):
        read(path)
    path = bags.mcap(tmp_path / 'x.mcap', bags.mcap_channel(encoding='json'))
    with pytest.raises(BagError, match=f'TF: /tf has the type {bags.TF} in json, not {bags.TF}: '):
        read(path)


@pytest.mark.parametrize('kind', PLAIN)
def test_another_type_beside_transforms(tmp_path, logs, kind):
    """The transforms are read, and a warning names the topic of another type."""
    path = bags.make(tmp_path, kind, [
        ('/tf_static', S, [bags.row(S, 'map', 'odom')]), ('/tf', S, bytes(4), POINT)])
    assert [frame.name for frame in read(path).frames()] == ['odom']
    (record,) = logs
    assert f'/tf has the type {POINT}, not {bags.TF}: ' in record.getMessage()
    with bag.open(path) as opened:
        assert len([*opened.messages()]) == 1
        assert ('/tf', POINT, False) in [
            (topic.name, topic.msgtype, topic.is_tf) for topic in opened.topics]


def test_control_characters_of_a_bag(tmp_path):
    """Control characters are escaped in errors, and long names are shortened."""
    path = bags.mcap(tmp_path / 'x.mcap', bags.mcap_channel(
        '/\x1b[2J', msgtype='\x07' + 'x' * 200))
    error = outcome(path)
    assert error.isprintable()
    assert '\\x1b[2J' in error
    assert 'x...x' in error


@pytest.mark.parametrize('partial', [False, True])
def test_what_is_no_bag(tmp_path, partial):
    """The error is one line that names the path; a missing file is a FileNotFoundError."""
    for name, content, why in (
            ('notes.mcap', b'Dear diary', 'is not a bag: a bag is a directory written by'),
            ('empty.db3', b'', 'is not a bag: it is empty'),
            ('packed.mcap.zstd', bags.packed(b'Dear diary', 'zstd'), 'is not a bag: a bag is a')):
        path = tmp_path / name
        path.write_bytes(content)
        error = outcome(path, partial=partial)
        assert error.removeprefix('no TF message can be read: ').startswith(str(path))
        assert why in error
        assert '\n' not in error
    for missing in tmp_path / 'nowhere', tmp_path / 'no*.db3':
        with pytest.raises(FileNotFoundError):
            read(missing, partial=partial)
    (tmp_path / 'directory').mkdir()
    assert 'directory is not a bag' in outcome(tmp_path / 'directory', partial=partial)
    assert outcome([], partial=partial) == 'no path of a bag is given'


@on_unix
def test_a_pipe_is_no_bag(tmp_path):
    """A pipe is refused, since reading it might never end."""
    os.mkfifo(tmp_path / 'pipe')
    assert 'it is no file' in outcome(tmp_path / 'pipe')


def test_a_database_that_was_not_closed(tmp_path):
    """Its newest messages are in a second file, from which they are read."""
    path = bags.make(tmp_path / 'robot', 'db3', bags.walk(3))
    killed = tmp_path / "it's"
    with closing(sqlite3.connect(path / 'robot.db3')) as database:
        database.execute('PRAGMA journal_mode = wal')
        database.execute('INSERT INTO messages (topic_id, timestamp, data) VALUES (2, 0, ?)',
                         [bags.ros2([bags.row(200 * S, 'odom', 'base_link')])])
        database.commit()
        killed.mkdir()
        for file in path.glob('robot.db3*'):
            shutil.copy(file, killed)
    assert (killed / 'robot.db3-wal').stat().st_size
    assert 200 * S in [frame.latest for frame in read(killed / 'robot.db3').frames()]


@pytest.mark.parametrize(('listed', 'why'), [
    ('\n    # of a robot\n    - x.mcap\n  files:\n    - path: "', ''),
    (' ["other/x.\\x6dcap"]', ''), ('\n- x.mcap', ''), (' "', ''), *(
        (listed, 'it has no list of names, relative_file_paths')
        for listed in (' x.mcap', ' [[x.mcap]]', 's: [x.mcap]'))])
def test_odd_metadata(tmp_path, listed, why):
    """The list of files is read, and nothing else; if it cannot be read, the files can."""
    path = bags.make(tmp_path / 'x', 'mcap', bags.walk(1))
    (path / 'metadata.yaml').write_text(f'a: "\nrelative_file_paths:{listed}\n')
    found = outcome(path)
    if not why and listed != ' "':
        assert found == ['odom', 'base_link']
    else:
        assert found.startswith(f'{path} cannot be read: metadata.yaml: {why}')
        assert found.endswith(
            'Its files can be read without it: give them in place of the directory')
    assert len(read(bags.file_of(path)).frames()) == 2


@pytest.mark.parametrize('module', ['mcap', 'rosbags', 'ruamel'])
def test_a_library_that_is_missing(tmp_path, monkeypatch, module):
    """The error says how to install it; it is not damage of the bag."""
    path = bags.make(tmp_path, 'mcap', bags.walk(1))
    for name in [*sys.modules]:
        if name.startswith((f'{module}.', 'puretf._bag.')):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    assert re.fullmatch(f'a library that reads bags cannot be imported .*{module}.*: pip install '
                        'rosbags mcap', outcome(path))


# Damage


MORE = ' More: tf_doctor --explain damaged_bag'


def is_a_part(buffer):
    """Return True if a buffer has the beginning of a walk without gaps, and nothing else."""
    moving = {frame.name: frame for frame in buffer.frames()}.get('base_link')
    if moving is None:
        return True
    number = moving.length - 1
    return (moving.oldest == 100 * S and moving.latest == 100 * S + number * S // 100
            and buffer.lookup_transform('odom', 'base_link').translation == (
                number / 100, 0.0, 0.0))


@pytest.mark.parametrize('kind', KINDS)
def test_a_truncated_file(tmp_path, kind):
    """A truncated file is an error, in one line; the remedy is named only where it helps."""
    path = bags.make(tmp_path, kind, bags.walk(20, 100))
    file = bags.file_of(path)
    whole = file.read_bytes()
    for tenth in 1, 4, 7, 9:
        file.write_bytes(whole[:len(whole) * tenth // 10])
        error = outcome(path)
        assert re.fullmatch(re.escape(str(path)) + r' cannot be read: [^(\n]*\.'
                            '( partial=True reads what is left.)?' + MORE, error)
        left = outcome(path, partial=True)
        assert isinstance(left, list) == (' partial=True reads what is left.' in error), left
        assert isinstance(left, list) or left.endswith(MORE)
        assert kind.startswith('mcap') or not isinstance(left, list)


@pytest.mark.parametrize('kind', [kind for kind in KINDS if kind.startswith('mcap')])
def test_a_file_that_was_cut_off(tmp_path, logs, kind):
    """With partial=True, the beginning of a .mcap file is read, with a warning."""
    content = [*bags.walk(20, 100)]
    for i in range(20, 0, -1):  # so that there are several chunks
        content[100 * i:100 * i] = texts(kind, 1, 300_000)
    file = bags.file_of(bags.make(tmp_path, kind, content))
    whole = file.read_bytes()
    lengths = [0]
    for tenth in 1, 4, 7, 9:
        file.write_bytes(whole[:len(whole) * tenth // 10])
        logs.clear()
        try:
            buffer = read(file, partial=True)
        except BagError:
            assert lengths == [0]
            continue
        assert re.fullmatch(re.escape(str(file)) + r': .*\. Read \d+ TF messages', messages(logs))
        assert is_a_part(buffer)
        lengths.append(sum(frame.length for frame in buffer.frames()))
    assert lengths == sorted(lengths)
    assert lengths[-1] > (1000 if kind == 'mcap' else 0)


HEADER = bags.mcap_channel() + bags.mcap_chunk(bags.mcap_channel() + bags.mcap_message(
    [bags.row(S, 'map', 'before')], S))
TRAILER = bags.mcap_chunk(bags.mcap_message([bags.row(S, 'map', 'after')], S))
CHECKSUM = 'the size or the checksum of a chunk is wrong'
DAMAGES = {
    'zstd': (bags.mcap_chunk(bytes(99), 'zstd').replace(b'\x28\xb5', b'\x28\xb6'),
             'Unable to decompress'),
    'length': (bags.mcap_chunk(bags.mcap_record(5, b'1')), 'a record in a chunk is damaged')}


@pytest.mark.parametrize('damage', DAMAGES)
def test_damaged_chunks(tmp_path, logs, damage):
    """A damaged chunk is an error; with partial=True, it is skipped with a warning."""
    chunk, why = DAMAGES[damage]
    path = bags.mcap(tmp_path / 'x.mcap', HEADER, chunk, TRAILER)
    assert re.search(f'cannot be read: ({why})', outcome(path))
    assert outcome(path, partial=True) == ['before', 'after']
    assert re.search(why, messages(logs))


@pytest.mark.parametrize(('seconds', 'chunk_size'), [(1, 600), (4, 1500)])
def test_a_damaged_chunk_without_checksums(tmp_path, seconds, chunk_size):
    """It is left out as a whole, and its time is named, so that nobody is blamed."""
    from mcap.reader import SeekingReader
    path = bags.checked_mcap(tmp_path / 'x.mcap', seconds=seconds, chunk_size=chunk_size,
                             enable_crcs=False)
    whole, data, damaged = bags.content(path)[0], path.read_bytes(), 0
    with path.open('rb') as file:
        chunks = SeekingReader(file).get_summary().chunk_indexes[1:]
    for begin, chunk in product(range(0, 600, 50), chunks):
        at = chunk.chunk_start_offset + begin
        path.write_bytes(data[:at] + bytes(40) + data[at + 40:])
        with bag.open(path, partial=True) as opened:
            found = [(each.topic.name, each.time) for each in opened.messages()]
            assert len(found) == sum(each.count for each in opened.topics if each.is_tf)
        if lost := [time for name, time, _ in whole if (name, time) not in found]:
            damaged += 1
            first, last = chunk.message_start_time, chunk.message_end_time
            assert opened.missing_spans == [(first, last)]
            assert first <= min(lost) <= max(lost) <= last
    assert damaged >= 10


def test_a_damaged_summary_without_checksums(tmp_path):
    """The error has words, also where the library raises a KeyError."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', enable_crcs=False)
    data, found = path.read_bytes(), set()
    for at in range(len(data) - 1500, len(data), 20):
        path.write_bytes(data[:at] + bytes(40) + data[at + 40:])
        if isinstance(text := outcome(path), str):
            found.add(text.split('cannot be read: ')[1])
    assert [text for text in found if 'expects (KeyError). ' in text]
    assert not [text for text in found if text[0].isdigit()]


def test_a_damaged_chunk_behind_a_missing_part(tmp_path):
    """Both spans are named."""
    from mcap.reader import SeekingReader
    first = bags.mcap(tmp_path / 'robot_0.mcap', HEADER)
    path = bags.checked_mcap(tmp_path / 'robot_2.mcap', enable_crcs=False)
    with path.open('rb') as file:
        chunk = SeekingReader(file).get_summary().chunk_indexes[0]
    data, at = path.read_bytes(), chunk.chunk_start_offset + 250  # the first message
    path.write_bytes(data[:at] + bytes(40) + data[at + 40:])
    with bag.open([first, path], partial=True) as opened:
        times = [each.time for each in opened.messages()]
    assert opened.missing_spans == [
        (chunk.message_start_time, chunk.message_end_time), (times[0], times[1])]
    assert times[0] == S < chunk.message_start_time <= chunk.message_end_time < times[1]


def test_a_damaged_chunk_with_the_channels(tmp_path, logs):
    """The summary repeats them, so the other chunks are read; it tells how much is lost."""
    path = bags.checked_mcap(tmp_path / 'x.mcap')
    flipped(path, path.read_bytes().index(b'odom'))
    assert CHECKSUM in outcome(path)
    assert outcome(path, partial=True) == ['base_link']
    assert f'{CHECKSUM}. {path}: its statistics announce 1 messages of /tf_static, but 0 ' in (
        messages(logs))


def test_a_compressed_file_of_which_nothing_can_be_read(tmp_path):
    """Only that it is cut off is said, and where to read more."""
    path = tmp_path / 'x.mcap.zstd'
    path.write_bytes(bags.packed(bags.checked_mcap(tmp_path / 'x.mcap').read_bytes(), 'zstd')[:30])
    for partial in False, True:
        assert outcome(path, partial=partial).endswith(
            f'Compressed file ended before the end-of-stream marker was reached.{MORE}')


def test_each_reading_of_a_compressed_file_meets_its_damage(tmp_path, logs):
    """And a reading after one that was ended too early meets none."""
    path = tmp_path / 'x.mcap.zstd'
    plain = bags.checked_mcap(tmp_path / 'x.mcap', seconds=300)
    path.write_bytes(bags.packed(plain.read_bytes(), 'zstd'))
    has_ended: list[float] = []

    def end(done):
        if done and not has_ended:
            has_ended.append(done)
            raise KeyboardInterrupt

    with bag.open(path, on_progress=end) as opened:
        with pytest.raises(KeyboardInterrupt):
            opened.read()
        assert opened.read().frames() == read(plain).frames()
    path.write_bytes(path.read_bytes()[:-1000])
    why = 'Compressed file ended before'
    with bag.open(path) as opened:
        for _ in range(2):
            with pytest.raises(BagError, match=why):
                opened.read()
    with bag.open(path, partial=True) as opened:
        for _ in range(2):
            logs.clear()
            opened.read()
            assert why in messages(logs)
            assert not opened.is_whole


def test_a_damaged_message(tmp_path, logs):
    """A compressed message that is cut off is skipped with a warning."""
    content = [*bags.walk(20)]
    (time, stream), cut = content[10][1::-1], bags.packed(bags.ros2(content[10][2]), 'zstd')[:-5]
    path = bags.make(tmp_path, 'mcap', [*content[:10], (stream, time, cut), *content[10:]])
    for partial in False, True:
        with bag.open(path, partial=partial) as opened:
            (frame,) = opened.read().frames()[1:]
            assert not opened.is_whole
        assert frame.length == 201
    assert 'skipped 1 of 203 TF messages, which cannot be decoded: ' in messages(logs)


def test_zeros_at_the_end(tmp_path, logs):
    """A file system may leave zeros at the end of a file after a crash."""
    path = bags.mcap(tmp_path / 'x.mcap', HEADER)
    path.write_bytes(path.read_bytes()[:-50] + bytes(10_000))
    assert outcome(path).endswith(
        f'cannot be read: it ends too early. partial=True reads what is left.{MORE}')
    assert outcome(path, partial=True) == ['before']
    assert str(path) in messages(logs)


@pytest.mark.parametrize('kind', PLAIN)
def test_messages_that_cannot_be_decoded(tmp_path, logs, kind):
    """They are skipped with a warning; a bag that has no other TF messages is an error."""
    bad = [('/tf', 105 * S, b'\0\1\0\0\7\0\0\0' if kind != 'bag' else b'\7\0\0\0')]
    buffer = read(bags.make(tmp_path / 'some', kind, [*bags.walk(), *bad * 3]))
    assert buffer.frames()[1].length == 101
    (record,) = logs
    assert 'skipped 3 of 105 TF messages, which cannot be decoded: impossible count' in (
        record.getMessage())
    with pytest.raises(BagError, match=r'all has no valid transform in its TF messages \(1\)'):
        read(bags.make(tmp_path / 'all', kind, bad))


def test_values_of_a_database_that_are_no_messages_or_topics(tmp_path, logs):
    """They are skipped and counted, whatever their type is."""
    values = "'text'", '7', '1.5', "X''", 'NULL'
    path = bags.file_of(bags.make(tmp_path, 'db3', bags.walk(10)))
    change(path, 'CREATE TABLE other (id INTEGER PRIMARY KEY, topic_id, timestamp, data)',
           'INSERT INTO other SELECT id, topic_id, timestamp, data FROM messages',
           'DROP TABLE messages', 'ALTER TABLE other RENAME TO messages',
           *(f'UPDATE messages SET data = {value} WHERE id = {5 + i}'
             for i, value in enumerate(values)))
    assert read(path).frames()[1].length == 101 - len(values)
    skipped = re.findall('skipped ([0-9]+) of 102 TF messages, which cannot be', messages(logs))
    assert sum(map(int, skipped)) == len(values)


def changed_database(folder, *statements):
    """Return a database without constraints that was changed by SQL."""
    path = bags.file_of(bags.make(folder, 'db3', bags.walk(3)))
    change(path, *(each for table in ('topics', 'messages') for each in (
        f'CREATE TABLE other AS SELECT * FROM {table}', f'DROP TABLE {table}',
        f'ALTER TABLE other RENAME TO {table}')), *statements)
    return path


@pytest.mark.parametrize(('change', 'why'), [
    *((f'UPDATE messages SET timestamp = {value} WHERE id = {number}',
       f'its table messages has {shown}, not a topic of its table topics and nanoseconds from 0 '
       'on.') for number, value, shown
      in [(1, '9e999', 'times from 100001000000 to inf'),
          (1, '-5', 'times from -5 to 103001000000'),
          (3, 'NULL', 'the topic 2 and the time None'),
          (3, '100101000000.5', 'the topic 2 and the time 100101000000.5')]),
    ("UPDATE messages SET topic_id = 'tf' WHERE id = 1",
     "its table messages has the topic 'tf' and "),
    ("UPDATE topics SET id = '1; 2'", "its table topics has the row ('1; 2', "),
    ("UPDATE topics SET name = X'41' WHERE id = 1", "its table topics has the row (1, b'A', "),
    *((f'ALTER TABLE {table} RENAME COLUMN {column} TO other',
       f'it is no database of rosbag2 (no such column: {column}).') for table, column in [
          ('topics', 'id'), ('topics', 'type'), ('messages', 'timestamp')]),
    ('DROP TABLE topics', 'it is no database of rosbag2 (no such table: topics).')])
def test_wrong_values_of_a_database(tmp_path, change, why):
    """The error has the value; with partial=True, no such value is taken."""
    path = changed_database(tmp_path, change)
    assert outcome(path).startswith(f'{path} cannot be read: {why}')
    with bag.open(path, partial=True) as found:
        with suppress(BagError):
            assert all(type(message.time) is int for message in found.messages())
        assert type(found.begin) is type(found.end) is int


@on_unix
def test_a_database_whose_log_cannot_be_read(tmp_path):
    """The error names the log, and the remedy."""
    path = bags.file_of(bags.make(tmp_path, 'db3', bags.walk(3)))
    change(path, 'PRAGMA journal_mode = wal')
    path.with_name(f'{path.name}-wal').symlink_to(bags.file_of(bags.make(tmp_path, 'mcap', [])))
    assert (f'{path} cannot be read: SQLite reports: unable to open database file. To read it '
            f'with {path.name}-wal, end the program that writes them, or copy both into a '
            'directory in which you can write.') in outcome(path)


# Files of mcap that rosbags does not read, or reads in part


#: With these options, a file has a footer with a checksum, and no summary.
NO_SUMMARY: dict[str, Any] = {
    'use_statistics': False, 'use_summary_offsets': False, 'repeat_channels': False,
    'repeat_schemas': False, 'index': 'NONE'}


@pytest.mark.parametrize('options', [
    {}, {'use_statistics': False}, {'use_summary_offsets': False}, {'repeat_channels': False},
    {'repeat_schemas': False}, {'use_chunking': False}, {'index': 'NONE'}, NO_SUMMARY,
    {'index': 'CHUNK'},  # rosbags counts messages by another index, and would skip such chunks
    {'use_statistics': False, 'repeat_channels': False, 'repeat_schemas': False}],
    ids=str)
def test_parts_of_mcap_that_are_optional(tmp_path, logs, options):
    """No message is lost if a file has no index or repeats no channels in it."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', **options)
    for partial in False, True:
        assert [frame.length for frame in read(path, partial=partial).frames()] == [1, 6]
    assert not logs


def test_an_mcap_file_of_ros1(tmp_path):
    """The command mcap convert keeps the encoding of ROS 1."""
    path = bags.mcap(
        tmp_path / 'x.mcap', bags.mcap_channel(msgtype='tf2_msgs/TFMessage', encoding='ros1'),
        bags.mcap_record(5, struct.pack('<HIQQ', 1, 0, S, S) + bags.ros1(
            [bags.row(S, 'map', 'odom')])))
    assert outcome(path) == ['odom']


@pytest.mark.parametrize('count', [1, -1], ids=['one schema', 'all schemas'])
def test_schemas_that_are_unknown(tmp_path, count):
    """A schema of another kind does not keep transforms from being read."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', use_chunking=False, enable_crcs=False)
    path.write_bytes(path.read_bytes().replace(b'ros2msg', b'protobf', count))
    assert [frame.length for frame in read(path).frames()] == [1, 6]


def test_a_message_outside_of_the_chunks(tmp_path):
    """It is read with those in chunks; without a definition of its channel, it is an error."""
    path = bags.mcap(tmp_path / 'x.mcap', HEADER, bags.mcap_message(
        [bags.row(S, 'map', 'outside')], S))
    for partial in False, True:
        assert sorted(outcome(path, partial=partial)) == ['before', 'outside']
    bags.mcap(path, bags.mcap_message([bags.row(S, 'map', 'outside')], S))
    assert 'a message has no channel' in outcome(path)


def flipped(path, at):
    """Flip a bit of a byte of a file."""
    data = bytearray(path.read_bytes())
    data[at] ^= 64
    path.write_bytes(data)


@pytest.mark.parametrize('part', [b'/tf', b'cdr', b'\x0b'])
def test_a_bit_of_the_summary(tmp_path, logs, part):
    """It is an error; with partial=True, all is read without the summary."""
    path = bags.checked_mcap(tmp_path / 'x.mcap')
    data = path.read_bytes()
    (start,) = struct.unpack_from('<Q', data, len(data) - 28)
    flipped(path, data.index(part, start) + len(part) - 1)
    assert outcome(path) == (
        f'{path} cannot be read: the checksum of its summary is wrong. partial=True reads what is '
        'left. More: tf_doctor --explain damaged_bag')
    assert [frame.length for frame in read(path, partial=True).frames()] == [1, 6]
    assert 'the checksum of its summary is wrong' in messages(logs)


def heads(data, kind, begin, end):
    """Return the places of some bytes of all records of a kind, from the begin of a record on."""
    places: list[int] = []
    at = 8
    while at < len(data) - 8:
        if data[at] == kind:
            places += range(at + begin, at + end)
        at += 9 + int.from_bytes(data[at + 1:at + 9], 'little')
    return places


@pytest.mark.parametrize(('kind', 'begin', 'end', 'options'), [
    (6, 0, 25, {}), (7, 0, 15, {}), (12, 0, 17, {}), (6, 9, 25, NO_SUMMARY)], ids=[
        'chunk', 'message index', 'metadata', 'chunk without a summary'])
def test_a_bit_that_no_checksum_covers(tmp_path, kind, begin, end, options):
    """It is an error, or everything is read as without it: nothing is skipped because of it."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', **options)
    whole = bags.content(path)
    assert (len(whole[0]), *whole[1:]) == (7, 100 * S, 101 * S + 1_000_002)
    assert bags.flips(path, (8 * at + at % 8 for at in heads(path.read_bytes(), kind, begin, end)))


@pytest.mark.parametrize(('index', 'why'), [
    ('ALL', 'a chunk is not where the index in its summary says'),
    ('NONE', 'its statistics announce 6 messages of /tf, but 5 were found')])
def test_a_chunk_that_is_not_recognised(tmp_path, logs, index, why):
    """It contradicts the summary; with partial=True, all others are read."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', index=index)
    flipped(path, heads(path.read_bytes(), 6, 0, 1)[-1])
    assert why in bags.content(path)
    assert len(bags.content(path, partial=True)[0]) == 6
    assert why in messages(logs)


@pytest.mark.parametrize(('index', 'why'), [
    ('ALL', 'a message index is not as the messages are'),
    ('NONE', 'its statistics announce 6 messages of /tf, but 5 were found')])
def test_statistics_that_contradict_the_messages(tmp_path, index, why):
    """They, or the index, tell that a channel has changed in a chunk without a checksum."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', index=index)
    data = bytearray(path.read_bytes())
    for at in heads(data, 6, 33, 34):
        data[at:at + 4] = bytes(4)  # no checksum
    (message, *_) = re.finditer(rb'\x05.\0{7}\x02\0', data, re.DOTALL)  # of /tf
    data[message.end() - 2] = 3  # of /chatter
    path.write_bytes(data)
    assert why in bags.content(path)


@pytest.mark.parametrize('kind', [3, 4, 5, 6, 7, 8, 11])
@pytest.mark.parametrize('where', ['file', 'chunk'])
def test_records_that_are_shorter_than_their_fields(tmp_path, kind, where):
    """They are refused; most kinds are ignored in chunks."""
    whole = bags.mcap_message([bags.row(S, 'map', 'odom')], S)
    for size in 0, 5, 21:
        record = bags.mcap_record(kind, (b'\t\0\0\0' + b'\x7f' * 17)[:size])
        path = bags.mcap(tmp_path / 'x.mcap', bags.mcap_channel(), *(
            [record, whole] if where == 'file' else [bags.mcap_chunk(record + whole)]))
        if where == 'file' or kind <= 5:
            assert f'{path} cannot be read: ' in outcome(path)
        else:
            assert outcome(path) == ['odom']


@pytest.mark.parametrize('repeat_channels', [True, False])
def test_a_bit_of_a_chunk(tmp_path, logs, repeat_channels):
    """It is an error, with an index and without; with partial=True, the others are read."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', repeat_channels=repeat_channels)
    flipped(path, path.read_bytes().rindex(b'base_link'))
    assert f'cannot be read: {CHECKSUM}' in outcome(path)
    assert 3 < read(path, partial=True).frames()[1].length < 6
    assert CHECKSUM in messages(logs)


# Progress, and what ends the reading


def test_a_bar_on_a_terminal_and_none_in_a_pipe(tmp_path, monkeypatch, capsys):
    """The progress bar is written to stderr if that is a terminal, and only goes forward."""
    import tqdm
    monkeypatch.setattr(tqdm, 'tqdm', lambda bar=tqdm.tqdm, **kwargs: bar(mininterval=0, **kwargs))
    path = str(bags.make(tmp_path, 'mcap', bags.walk(100)))

    def read(path):
        with BagOption([path]).opened() as bag:
            bag.read()

    read(path)
    assert capsys.readouterr() == ('', '')
    terminal = StringIO()
    monkeypatch.setattr(terminal, 'isatty', lambda: True)
    monkeypatch.setattr(sys, 'stderr', terminal)
    read(path)
    parts = [int(part) for part in re.findall(r'\rreading walk\.mcap [^\r]* (\d+) %',
                                              terminal.getvalue())]
    assert parts[0] == 0
    assert parts == sorted(parts)
    assert parts[-1] > 50
    assert not capsys.readouterr().out


@pytest.mark.parametrize('kind', KINDS)
def test_progress_is_called_back(tmp_path, kind):
    """The callback receives the fraction that has been read, which grows up to 1."""
    def content():
        for i in range(1000):
            yield '/tf', (100 + i) * S, [bags.row((100 + i) * S, 'map', 'odom')]
            yield '/text', (100 + i) * S, random.Random(i).randbytes(9000), bags.STRING

    parts: list[float] = []
    read(bags.make(tmp_path, kind, content()), on_progress=parts.append)
    assert len(parts) > 5
    assert parts == sorted(parts)
    assert parts[0] == 0.0
    assert parts[-1] == 1.0


@pytest.mark.parametrize(('kind', 'error'), [*zip(KINDS, cycle([
    KeyboardInterrupt(), ValueError('enough'), EOFError(), BagError('mine'), ImportError('mine'),
    sqlite3.DatabaseError('mine')]))])
def test_what_the_callback_raises_ends_the_reading(tmp_path, kind, error):
    """read() raises the same exception, also if its type is one by which damage is detected."""
    def fail(least, done):
        if done >= least:
            raise error

    path = bags.make(tmp_path, kind, bags.walk(10))
    for partial, least in product((False, True), (0.0, 0.5, 1.0)):
        with pytest.raises(type(error)) as raised:
            read(path, partial=partial, on_progress=partial_of(fail, least))
        assert raised.value is error


# Limits


LIMIT = MIB
BOMB = 32 * MIB


def peak(path, **kwargs):
    """Read a bag; return the frames or the error, and the peak memory in Python (bytes)."""
    outcome(path, **kwargs)  # so that no module is imported later
    tracemalloc.start()
    try:
        return outcome(path, **kwargs), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def assert_refused_early(path, text, **kwargs):
    """Assert that a bag is refused with a text, before it takes memory."""
    error, memory = peak(path, **kwargs)
    assert re.search(text, error)
    assert memory < BOMB / 2


@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('method', ['zstd', 'lz4'])
def test_a_chunk_that_declares_too_much(tmp_path, logs, method, partial):
    """It is refused in one line before it takes memory, with an index and without."""
    why = (f'takes {BOMB} bytes, more than the limit of {LIMIT}: if this size is expected, pass '
           'a larger max_bytes to bag.read')
    path = bags.mcap(tmp_path / 'bomb.mcap', HEADER, bags.mcap_chunk(bytes(BOMB), method), TRAILER)
    result, memory = peak(path, max_bytes=LIMIT, partial=partial)
    assert memory < BOMB / 2
    if partial:
        assert result == ['before', 'after']
        assert why in messages(logs)
    else:
        assert re.fullmatch(
            rf'{re.escape(str(path))} cannot be read: a chunk of \d+ bytes {why}\..*', result)


def test_a_chunk_without_transforms_may_have_any_size(tmp_path):
    """It is not read."""
    path = bags.file_of(bags.make(tmp_path, 'mcap storage', [
        *texts('mcap', 1, BOMB), *bags.walk(1, begin=300 * S)]))
    assert len(read(path, max_bytes=LIMIT).frames()) == 2


@pytest.mark.parametrize('kind', ['mcap message', 'db3 message'])
def test_a_message_that_is_too_large(tmp_path, kind):
    """A compressed message is refused before it takes memory."""
    path = bags.make(tmp_path, kind, [*bags.walk(1), ('/tf', S, bytes(BOMB))])
    assert_refused_early(
        path, f'takes more than {LIMIT} bytes, more than the limit of {LIMIT}.*max_bytes',
        max_bytes=LIMIT)


@pytest.mark.parametrize('kind', KINDS)
def test_a_limit_that_is_large_enough(tmp_path, logs, kind):
    """Such a limit changes nothing, while a limit of one byte refuses everything."""
    path = bags.make(tmp_path, kind, bags.walk(1))
    assert len(read(path, max_bytes=100_000).frames()) == 2
    assert not logs
    assert 'limit' in outcome(path, max_bytes=1)


@pytest.mark.parametrize('opcode', [3, 5, 6, 9])
def test_a_length_of_exabytes(tmp_path, logs, opcode):
    """Memory is not allocated by the length that a record declares."""
    path = bags.mcap(tmp_path / 'x.mcap', HEADER, bags.mcap_record(
        opcode, b'\1\0' + bytes(100), 2**62))
    why = f'record has length {2**62} that exceeds limit {2**30}'
    assert_refused_early(path, why)
    assert outcome(path, partial=True) == ['before']
    assert why in messages(logs)


def test_a_temporary_directory_without_room(tmp_path, monkeypatch):
    """The error names the directory and the remedy, before the directory is full."""
    path = bags.make(tmp_path, 'db3 file', bags.walk(10))
    monkeypatch.setattr(shutil, 'disk_usage', lambda _: SimpleNamespace(free=20_000))
    error = outcome(path)
    assert re.search(r'takes more than 10000 bytes, half of the free space in \S+: set TMPDIR to '
                     'a directory with more space', error)
    assert '\n' not in error
