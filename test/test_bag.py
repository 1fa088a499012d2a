"""TF read from bags: of every kind, with the oddities of real ones, damaged, and without TF."""

from contextlib import closing
from itertools import count
import os
from pathlib import Path
import random
import re
import shutil
import sqlite3
import subprocess
import sys

from conftest import on_linux, on_unix, open_terminal
import pytest

from dummy_arm.tf import bag
from dummy_arm.tf._bag.decompression import decompress
from dummy_arm.tf._core.frames import Frame
from dummy_arm.tf.bag import BagError, read

bags = pytest.importorskip('bags')
S = bags.S
KINDS = bags.ROS2 + bags.ROS1
PLAIN = 'db3', 'mcap', 'bag'


def messages(logs):
    """Return all that was logged, as one text."""
    return '\n'.join(record.getMessage() for record in logs)


@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('kind', KINDS)
def test_every_kind_gives_the_same(tmp_path, logs, kind, partial):
    """Every kind of bag gives the same frames and poses; only ROS 1 records the publisher."""
    buffer = read(bags.make(tmp_path, kind, bags.walk()), partial=partial)
    authority = '/sender' if kind.startswith('bag') else 'not recorded'
    assert buffer.frames() == [
        Frame('odom', 'map', authority, True, 1, 0, 0),
        Frame('base_link', 'odom', authority, False, 101, 110 * S, 100 * S)]
    assert buffer.lookup_transform('map', 'base_link', 105 * S + S // 20).translation == (
        pytest.approx((6.05, 2.0, 3.0)))
    assert not logs


@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('kind', KINDS)
def test_messages_of_every_kind(tmp_path, logs, kind, partial):
    """`messages` yields what was written: topics, times of the recording, and transforms."""
    path = bags.make(tmp_path, kind, bags.walk())
    publisher = '/sender' if kind.startswith('bag') else 'not recorded'
    assert [(message.is_static, message.time, message.rows(), message.publisher)
            for message in bag.messages(path, partial=partial)] == [
        (topic == '/tf_static', time, rows, publisher) for topic, time, rows in bags.walk()]
    assert not logs


@pytest.mark.parametrize('kind', PLAIN)
def test_messages_of_odd_bags(tmp_path, logs, kind):
    """What `read` refuses, `messages` refuses, too; a damaged message is left to the caller."""
    path = bags.make(tmp_path, kind, [('/robot/tf', S, [bags.row(S, 'map', 'odom')])])
    assert len([*bag.messages(path, namespace='robot')]) == 1
    with pytest.raises(BagError, match='in the namespace /robot'):
        next(bag.messages(path))
    with pytest.raises(ValueError, match='max_bytes'):
        next(bag.messages(path, max_bytes=0))
    with pytest.raises(FileNotFoundError):
        next(bag.messages(tmp_path / 'missing'))
    with pytest.raises(ZeroDivisionError):
        next(bag.messages(path, namespace='robot', on_progress=lambda done: 1 / 0))
    nonsense = tmp_path / 'nonsense'
    (message,) = bag.messages(bags.make(nonsense, kind, [('/tf', S, b'nonsense')]))
    with pytest.raises(ValueError, match=r'they announce|unknown encoding'):
        message.rows()


@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('kind', KINDS)
def test_headers_of_other_topics(tmp_path, logs, kind, partial):
    """The frames of the first ten messages are read, of topics whose type begins with a header."""
    point = 'geometry_msgs/msg/PointStamped'
    version = 1 if kind.startswith('bag') else 2
    path = bags.make(tmp_path, kind, [
        *bags.walk(), *(('/point', 200 * S + i, bags.point(f'frame_{i}', S, version), point)
                        for i in range(12)),
        ('/tf_old', 300 * S, [bags.row(S, 'map', 'odom')])])
    topics: list[bag.TopicHeaders] = []
    assert len([*bag.messages(path, partial=partial, on_headers=topics.extend)]) == 102
    assert topics == [
        bag.TopicHeaders('/point', point, frozenset(f'frame_{i}' for i in range(10))),
        bag.TopicHeaders('/tf_old', bags.TF, frozenset())]
    assert not logs


@pytest.mark.parametrize(('definition', 'frames'), [
    ('std_msgs/Header header\nfloat64 x', {'laser'}),
    ('# a comment\n\nuint8 A=1\nstd_msgs/msg/Header header # first', {'laser'}),
    ('float64 x\nstd_msgs/Header header', None),
    ('uint8 A=1\n' + '=' * 80 + '\nMSG: std_msgs/Header\nstd_msgs/Header x', None),
    ('module my { struct Thing { @verbatim (text="x")\n std_msgs::msg::Header header; }; };',
     {'laser'}),
    ('module my { struct Thing { double x; std_msgs::msg::Header header; }; };', None),
    ('module my {\n  struct Thing\n  {\n    @verbatim (language="comment", text=\n      "one)"'
     '"two")\n    @unit (value="m") std_msgs::msg::Header header;\n  };\n};', {'laser'}),
    ('module my { struct Thing { ' + '@a ' * 10_000 + 'x y; }; };', None),
    ('module my { union Thing switch (long) {}; };', frozenset()),  # not understood
    ('string<=10 name\nstd_msgs/Header header', None),
    ('uint8[<=3] A\nuint8 B = 1\nstd_msgs/Header header', None),
    ('', frozenset()),  # an unknown type
])
def test_definitions_of_types(tmp_path, definition, frames):
    """Whether messages begin with a header is read from the definition in the bag."""
    path = bags.mcap(
        tmp_path / 'own.mcap', bags.mcap_channel(),
        bags.mcap_channel('/thing', 2, 'my/msg/Thing', definition=definition),
        bags.mcap_message([bags.row(S, 'map', 'odom')]),
        bags.mcap_message(bags.point('laser'), number=2),
        bags.mcap_message(b'\0\1\0\0\1', number=2))  # a damaged one
    topics: list[bag.TopicHeaders] = []
    assert len([*bag.messages(path, on_headers=topics.extend)]) == 1
    assert [topic.frames for topic in topics] == (
        [] if frames is None else [frozenset(frames)] if frames else [None])


def test_types_of_rosbags(tmp_path):
    """Where a bag has no definitions, those of rosbags are used; a damaged table is none."""
    path = bags.make(tmp_path, 'db3', [
        *bags.walk(), ('/point', 300 * S, bags.point('laser'), 'geometry_msgs/msg/PointStamped')])
    (file,) = path.glob('*.db3')
    for statement in ('DROP TABLE IF EXISTS message_definitions',
                      'CREATE TABLE message_definitions (wrong TEXT)'):
        with closing(sqlite3.connect(file)) as database:
            database.execute(statement)
            database.commit()
        topics: list[bag.TopicHeaders] = []
        assert len([*bag.messages(path, on_headers=topics.extend)]) == 102
        assert [topic.frames for topic in topics] == [frozenset(['laser'])]
        assert len(read(path).frames()) == 2


@pytest.mark.soak
def test_many_topics_with_headers(tmp_path):
    """There may be thousands of topics with headers in a database."""
    path = bags.make(tmp_path, 'db3', [*bags.walk(), *(
        (f'/point_{i}', 300 * S, bags.point(f'frame_{i}'), 'geometry_msgs/msg/PointStamped')
        for i in range(1500))])
    topics: list[bag.TopicHeaders] = []
    assert len([*bag.messages(path, on_headers=topics.extend)]) == 102
    assert {topic.frames for topic in topics} == {frozenset([f'frame_{i}']) for i in range(1500)}


def test_chunks_without_wanted_messages(tmp_path, monkeypatch):
    """With an index, only the chunks with wanted messages are decompressed."""
    point = 'geometry_msgs/msg/PointStamped'
    path = bags.make(tmp_path, 'mcap storage', [
        ('/tf', 0, [bags.row(S, 'map', 'odom')]),
        *(('/point', i * S, bags.point('x' * 500_000), point) for i in range(60)),
        ('/tf', 60 * S, [bags.row(S, 'map', 'odom')])])
    sizes = []

    def counted(*arguments):
        sizes.append(len(data := decompress(*arguments)))
        return data

    monkeypatch.setattr('dummy_arm.tf._bag.rosbag2.decompress', counted)
    topics: list[bag.TopicHeaders] = []
    assert len([*bag.messages(path, on_headers=topics.extend)]) == 2
    assert 0 < sum(sizes) < 15_000_000  # of 30 MB
    assert topics[0].frames == frozenset(['x' * 500_000])


def test_a_time_that_is_no_number(tmp_path):
    """A message of a database or of ROS 1 whose time is missing or a text has the time 0."""
    path = bags.make(tmp_path, 'db3', bags.walk(1, 1))
    (file,) = path.glob('*.db3')
    with closing(sqlite3.connect(file)) as database:
        database.execute("UPDATE messages SET timestamp = 'today'")
        database.commit()
    assert [message.time for message in bag.messages(file)] == [0, 0, 0]
    ros1 = bags.make(tmp_path, 'bag', bags.walk(1, 1))
    ros1.write_bytes(ros1.read_bytes().replace(b'time=', b'tame='))
    assert [message.time for message in bag.messages(ros1)] == [0, 0, 0]


@pytest.mark.parametrize('kind', ['db3', 'mcap', 'db3 message', 'mcap storage'])
def test_a_file_of_a_bag(tmp_path, kind):
    """One file of a bag can be read alone, without metadata.yaml and under any name."""
    (file,) = (path for path in bags.make(tmp_path, kind, bags.walk()).iterdir()
               if path.suffix != '.yaml')
    assert len(read(file).frames()) == 2
    assert len(read(file.rename(tmp_path / 'no_suffix')).frames()) == 2


@pytest.mark.parametrize('kind', PLAIN)
def test_what_real_bags_do(tmp_path, kind):
    """Static transforms may come late and in several messages, stamps out of order or twice."""
    def moving(*tenths):
        return [('/tf', 100 * S + i, [bags.row(
            tenth * S // 10, 'odom', 'base', (tenth, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))])
            for i, tenth in enumerate(tenths)]

    def static(time, child, x):
        return '/tf_static', time, [bags.row(0, 'map', child, (x, *bags.STILL[1:]))]

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
            bags.row(100 * S + number, 'map', child, (x, *bags.STILL[1:]))], bags.TF, publisher)

    messages = [message(i, f'/node_{i % 3}', f'frame_{i % 3}') for i in range(3000)]
    messages += [message(3000 + i, f'/node_{i % 2}', 'fixed', True, i) for i in range(5)]
    messages += [('/tf', 100 * S + 4000, bags.ros1([bags.row(100 * S, 'map', 'old')]),
                  'tf/msg/tfMessage', '/old_node')]
    buffer = read(bags.make(tmp_path, 'bag', messages))
    assert [(frame.name, frame.authority, frame.length) for frame in buffer.frames()] == [
        *((f'frame_{i}', f'/node_{i}', 1000) for i in range(3)),
        ('fixed', '/node_0', 1), ('old', '/old_node', 1)]
    assert buffer.lookup_transform('map', 'fixed').translation[0] == 4.0


def test_the_cache_is_as_long_as_the_bag_by_default(tmp_path):
    """All samples are kept, however far apart their stamps are, unless cache_time limits them."""
    path = bags.make(tmp_path, 'mcap', [
        *bags.walk(5, begin=1000 * S), *bags.walk(5, begin=2_000_000_000 * S)])
    assert read(path).frames()[1].length == 102
    for kept in 2 * S, 5 * S:
        frame = read(path, cache_time=kept).frames()[1]
        # Expired samples are dropped before each insertion, so one more may be left.
        assert kept <= frame.latest - frame.oldest <= kept + S // 10


@pytest.mark.parametrize('kind', PLAIN)
def test_a_namespace(tmp_path, kind):
    """A namespace is accepted with or without slashes; without it, the error names it."""
    path = bags.make(tmp_path, kind, [
        (f'/robot/left{topic}', *rest) for topic, *rest in bags.walk()])
    for namespace in 'robot/left', '/robot/left', '/robot/left/':
        assert len(read(path, namespace=namespace).frames()) == 2
    for partial in False, True:
        with pytest.raises(BagError, match=re.escape(
                f'{path} has no TF: no TFMessage on /tf or /tf_static, but in the namespace '
                '/robot/left: pass it as namespace (--namespace)')):
            read(path, partial=partial)
        with pytest.raises(BagError, match='no TFMessage on /left/tf or /left/tf_static, but in'):
            read(path, namespace='left', partial=partial)


@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('kind', PLAIN)
def test_a_bag_without_tf(tmp_path, kind, partial):
    """The error lists the topics that the bag has instead, at most ten of them."""
    text = (5).to_bytes(4, 'little') + b'text\0'
    path = bags.make(tmp_path, kind, [
        (f'/topic_{i:02}', S, text if kind == 'bag' else b'\0\1\0\0' + text,
         'std_msgs/msg/String') for i in range(12)])
    with pytest.raises(BagError, match=(
            r'has no TF: no tf2_msgs/msg/TFMessage on /tf or /tf_static; its topics: /topic_00 '
            r'\(std_msgs/msg/String\), .*/topic_09 \(std_msgs/msg/String\) and 2 more$')):
        read(path, partial=partial)
    empty = bags.make(tmp_path / 'empty', kind, [])
    with pytest.raises(BagError, match=r'empty has no TF: .* its topics: none$'):
        read(empty, partial=partial)


def test_another_type_on_tf(tmp_path):
    """A topic /tf of another type is not TF, and the error names the type."""
    path = bags.make(tmp_path, 'mcap', [('/tf', S, b'\0\1\0\0\0', 'std_msgs/msg/Bool')])
    with pytest.raises(BagError, match=r'its topics: /tf \(std_msgs/msg/Bool\)'):
        read(path)


@pytest.mark.parametrize('partial', [False, True])
def test_what_is_no_bag(tmp_path, partial):
    """The error is one line that names the path; a missing file is a FileNotFoundError."""
    for name, content, why in (
            ('notes.mcap', b'Dear diary', 'is not a bag: a bag is a directory written by'),
            ('empty.db3', b'', 'is not a bag: it is empty'),
            ('packed.db3.zstd', b'\x28\xb5\x2f\xfd....', 'read the directory of its')):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(BagError, match=re.escape(f'{path} ') + f'.*{why}') as caught:
            read(path, partial=partial)
        assert '\n' not in str(caught.value)
    with pytest.raises(FileNotFoundError):
        read(tmp_path / 'nowhere', partial=partial)
    (tmp_path / 'directory').mkdir()
    with pytest.raises(BagError, match='directory is not a bag'):
        read(tmp_path / 'directory', partial=partial)


def test_a_database_of_something_else(tmp_path):
    """An SQLite file without the tables of a bag is refused."""
    with closing(sqlite3.connect(tmp_path / 'x.db3')) as database:
        database.execute('CREATE TABLE friends (name TEXT)')
    for partial in False, True:
        with pytest.raises(BagError, match=r'x\.db3.*(missing tables|no such table)'):
            read(tmp_path / 'x.db3', partial=partial)


def is_a_part(buffer):
    """Return True if a buffer has the beginning of a walk without gaps, and nothing else."""
    moving = {frame.name: frame for frame in buffer.frames()}.get('base_link')
    if moving is None:
        return True
    number = moving.length - 1
    return (moving.oldest == 100 * S and moving.latest == 100 * S + number * S // 100
            and buffer.lookup_transform('odom', 'base_link').translation == (
                number / 100, 0.0, 0.0))


def read_or_not(path, partial=True):
    """Read a bag; return the buffer and '', or None and the error."""
    try:
        return read(path, partial=partial), ''
    except BagError as error:
        return None, str(error)


@pytest.mark.parametrize('kind', KINDS)
def test_a_truncated_file(tmp_path, logs, kind):
    """A truncated file is an error; with partial=True its beginning is read, with a warning."""
    path = bags.make(tmp_path, kind, bags.walk(40, 100))
    (file,) = [path] if path.is_file() else (
        each for each in path.iterdir() if each.suffix != '.yaml')
    whole = file.read_bytes()
    lengths: list[int] = []
    for tenth in range(1, 10):
        file.write_bytes(whole[:len(whole) * tenth // 10])
        with pytest.raises(BagError, match=re.escape(f'{path} cannot be read: ') + (
                r'.*\. If it is damaged or cut off, '
                r'partial=True \(--partial\) reads what is left$')):
            read(path)
        logs.clear()
        buffer, error = read_or_not(path)
        if buffer is None:
            assert f'no TF message can be read from {file}: ' in error
            assert not lengths
        else:
            (record,) = logs
            assert re.fullmatch(re.escape(str(file)) + r': .*\. Read \d+ TF messages',
                                record.getMessage())
            assert is_a_part(buffer)
            lengths.append(sum(frame.length for frame in buffer.frames()))
    assert lengths == sorted(lengths)
    assert lengths[-1] > 2000


@pytest.mark.parametrize('kind', KINDS)
def test_a_damaged_file(tmp_path, kind):
    """Wherever bytes are damaged, the only error is a BagError with a text of one line."""
    path = bags.make(tmp_path, kind, bags.walk(5))
    (file,) = [path] if path.is_file() else (
        each for each in path.iterdir() if each.suffix != '.yaml')
    whole = file.read_bytes()
    choice = random.Random(kind)
    for _ in range(30):
        damaged = bytearray(whole)
        at = choice.randrange(len(damaged))
        damaged[at:at + 8] = choice.randbytes(min(8, len(damaged) - at))
        file.write_bytes(damaged)
        for partial in False, True:
            _, error = read_or_not(path, partial)
            assert '\n' not in error


def test_a_recording_that_was_killed(tmp_path, logs):
    """Without metadata.yaml, the files are read in numeric order, if partial=True asks for it."""
    whole = bags.make(tmp_path, 'mcap', bags.walk(3))
    directory = tmp_path / 'killed'
    directory.mkdir()
    for number in 2, 10:
        part = bags.make(tmp_path / f'part_{number}', 'mcap', [
            ('/tf_static', S, [bags.row(S, 'map', 'newest', (number, *bags.STILL[1:]))])])
        (part / f'part_{number}.mcap').rename(directory / f'robot_{number}.mcap')
    (whole / 'walk.mcap.mcap').rename(directory / 'robot_0.mcap')
    with pytest.raises(BagError, match=(
            r'killed has no metadata.yaml, .*: read one of its files \(robot_0.mcap, '
            r'robot_2.mcap, robot_10.mcap\), .* ros2 bag reindex or read it with partial=True ')):
        read(directory)
    buffer = read(directory, partial=True)
    assert buffer.lookup_transform('map', 'newest').translation[0] == 10.0
    assert len(buffer.frames()) == 3
    (record,) = logs
    assert record.getMessage() == (f'{directory} has no metadata.yaml; reading '
                              'robot_0.mcap, robot_2.mcap, robot_10.mcap')


def test_a_database_that_was_not_closed(tmp_path):
    """Its newest messages are in a second file, which is read with partial=True only."""
    path = bags.make(tmp_path / 'robot', 'db3', bags.walk(3))
    with closing(sqlite3.connect(path / 'robot.db3')) as database:
        database.execute('PRAGMA journal_mode = wal')
        database.execute('INSERT INTO messages (topic_id, timestamp, data) VALUES (2, 0, ?)',
                         [bags.ros2([bags.row(200 * S, 'odom', 'base_link')])])
        database.commit()
        (tmp_path / 'killed').mkdir()
        for file in path.glob('robot.db3*'):
            shutil.copy(file, tmp_path / 'killed')
    killed = tmp_path / 'killed' / 'robot.db3'
    with pytest.raises(BagError, match=(
            r'robot.db3 was not closed .*, and robot.db3-wal has data that are not in the '
            r'database yet: read the bag with partial=True \(--partial\)')):
        read(killed)
    assert read(killed, partial=True).frames()[1].latest == 200 * S


def test_a_bag_of_several_files(tmp_path):
    """All files that ros2 bag record has split a bag into are read; none may be missing."""
    path = bags.make(tmp_path / 'robot', 'db3', bags.walk(3))
    other = bags.make(tmp_path / 'second', 'db3', bags.walk(3, begin=104 * S))
    (other / 'second.db3').rename(path / 'second.db3')
    metadata = path / 'metadata.yaml'
    text = metadata.read_text()
    assert '  - robot.db3\n' in text
    metadata.write_text(text.replace('  - robot.db3\n', '  - robot.db3\n  - second.db3\n'))
    assert read(path).frames()[1].length == 62
    (path / 'second.db3').unlink()
    with pytest.raises(BagError, match=r'files that its metadata\.yaml lists are missing'):
        read(path)


@pytest.mark.parametrize('kind', PLAIN)
def test_messages_that_cannot_be_decoded(tmp_path, logs, kind):
    """They are skipped with a warning; a bag that has no other TF messages is an error."""
    bad = [('/tf', 105 * S, b'\0\1\0\0\7\0\0\0' if kind != 'bag' else b'\7\0\0\0')]
    buffer = read(bags.make(tmp_path / 'some', kind, [*bags.walk(), *bad * 3]))
    assert buffer.frames()[1].length == 101
    (record,) = logs
    assert 'skipped 3 of 105 TF messages, which cannot be decoded: impossible count' in (
        record.getMessage())
    with pytest.raises(BagError, match=r'all has TF messages \(1\), but no valid transform'):
        read(bags.make(tmp_path / 'all', kind, bad))


def test_what_tf2_refuses_is_refused(tmp_path, logs):
    """The warning has the words of tf2's log and names the publisher."""
    read(bags.make(tmp_path, 'bag', [*bags.walk(1), (
        '/tf', 102 * S, [bags.row(102 * S, 'odom', 'odom')], bags.TF, '/culprit')]))
    assert 'TF_SELF_TRANSFORM: Ignoring transform from authority "/culprit"' in messages(logs)


READ = ('import sys; from dummy_arm.cli.bag_options import read_bag; '
        'read_bag(sys.argv[1], "", False)')


@on_unix
def test_a_bar_on_a_terminal_and_none_in_a_pipe(tmp_path):
    """The progress bar is written to stderr if that is a terminal, and only goes forward."""
    *_, (topic, time, rows) = bags.walk()
    data = bags.ros2(rows)
    path = str(bags.make(tmp_path, 'mcap', ((topic, time, data) for _ in range(100_000))))
    done = subprocess.run([sys.executable, '-c', READ, path], capture_output=True, check=True,
                          timeout=60)
    assert not done.stdout + done.stderr
    ours, theirs = open_terminal(100)
    subprocess.run([sys.executable, '-c', READ, path], stderr=theirs, check=True, timeout=60)
    os.close(theirs)
    shown = os.read(ours, 100_000).decode()
    os.close(ours)
    parts = [int(line.split()[-2]) for line in shown.split('\r') if line.endswith(' %')]
    assert 'reading walk.mcap ' in shown
    assert parts[0] == 0
    assert parts == sorted(parts)
    assert parts[-1] > 50


@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('kind', KINDS)
def test_progress_is_called_back(tmp_path, kind, partial):
    """The callback receives the fraction that has been read, which grows up to 1."""
    parts: list[float] = []
    read(bags.make(tmp_path, kind, bags.walk(100)), partial=partial, on_progress=parts.append)
    assert len(parts) > 1
    assert parts == sorted(parts)
    assert 0.0 <= parts[0] < 0.5
    assert parts[-1] == 1.0


@pytest.mark.parametrize('kind', KINDS)
def test_what_the_callback_raises_ends_the_reading(tmp_path, kind):
    """read() raises the same exception, also if its type is one by which damage is detected."""
    def fail(number, error):
        calls = count()

        def on_progress(_):
            if next(calls) >= number:
                raise error
        return on_progress

    path = bags.make(tmp_path, kind, bags.walk(10))
    for partial in False, True:
        parts: list[float] = []
        read(path, partial=partial, on_progress=parts.append)
        steps = {0, 1, len(parts) // 2, len(parts) - 2, len(parts) - 1}
        for error in (KeyboardInterrupt(), ValueError('enough'), EOFError(), BagError('mine'),
                      ImportError('mine'), sqlite3.DatabaseError('mine')):
            for step in steps:
                with pytest.raises(type(error)) as raised:
                    read(path, partial=partial, on_progress=fail(step, error))
                assert raised.value is error


@on_unix
@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('kind', ['mcap', 'bag'])
def test_ctrl_c_ends_a_command_that_reads(tmp_path, kind, partial):
    """It ends long before the end of the bag, also where hardly any messages are TF."""
    text = (5).to_bytes(4, 'little') + b'text\0'
    path = bags.make(tmp_path, kind, [
        *bags.walk(1), *(('/text', 200 * S, text, 'std_msgs/msg/String') for _ in range(300_000)),
        *bags.walk(1, begin=300 * S)])
    code = ('import os, signal, sys, time\n'
            'from dummy_arm.cli.bag_options import read_bag\n'
            'from dummy_arm.cli.signals import record_signals\n'
            'def ended(*_):\n'
            '    os.kill(os.getpid(), signal.SIGINT)\n'
            'begin = time.process_time()\n'  # does not depend on what else the machine does
            'read_bag(sys.argv[1], "", len(sys.argv) > 2)\n'
            'whole = time.process_time() - begin\n'
            'record_signals()\n'
            'signal.signal(signal.SIGPROF, ended)\n'
            'signal.setitimer(signal.ITIMER_PROF, whole / 5)\n'
            'begin = time.process_time()\n'
            'try: read_bag(sys.argv[1], "", len(sys.argv) > 2)\n'
            'except KeyboardInterrupt: print((time.process_time() - begin) / whole)\n')
    done = subprocess.run([sys.executable, '-c', code, str(path), *['partial'] * partial],
                          capture_output=True, text=True, timeout=60)
    # In mcap, rosbags skips the other messages, so the reading may end before the signal.
    if done.stdout or kind == 'bag':
        assert float(done.stdout) < 0.8, done.stderr


def test_a_damaged_chunk_of_many(tmp_path, logs):
    """It is skipped with a warning, and the chunks after it are read."""
    for kind, magic in (('mcap storage', b'\x28\xb5\x2f\xfd'), ('bag lz4', b'\x04\x22\x4d\x18')):
        logs.clear()
        path = bags.make(tmp_path / kind, kind, bags.walk(400, 100))
        file = path if path.is_file() else path / f'{kind}.mcap'
        damaged = bytearray(file.read_bytes())
        second = damaged.index(magic, damaged.index(magic) + 1)
        damaged[second + 20:second + 28] = b'\xff\0' * 4
        file.write_bytes(damaged)
        with pytest.raises(BagError, match='cannot be read'):
            read(path)
        buffer = read(path, partial=True)
        assert 10_000 < buffer.frames()[1].length < 39_000
        assert buffer.frames()[1].latest == 500 * S
        assert f'{file}: ' in messages(logs)


def test_several_damaged_files(tmp_path, logs):
    """A warning names each of the damaged files."""
    directory = tmp_path / 'robot'
    directory.mkdir()
    for number in range(3):
        part = bags.make(tmp_path / f'part_{number}', 'mcap', bags.walk(
            50, 100, begin=(100 + 100 * number) * S))
        data = (part / f'part_{number}.mcap').read_bytes()
        (directory / f'robot_{number}.mcap').write_bytes(data[:-len(data) // 3 or None]
                                                         if number != 1 else data)
    buffer = read(directory, partial=True)
    for number, is_damaged in enumerate((True, False, True)):
        assert (f'robot_{number}.mcap: it ends too early.' in messages(logs)) is is_damaged
    count = sum(frame.length for frame in buffer.frames() if not frame.is_static)
    assert f'Read {count + 3} TF messages' in messages(logs)


@pytest.mark.parametrize('name', [
    'odd#name', 'pct%20name', pytest.param('what?', marks=on_unix),
    pytest.param('ctrl\nname', marks=on_unix)])
def test_odd_paths(tmp_path, name):
    """The characters of a path are taken literally, also those that are special in a URI."""
    for kind in PLAIN:
        path = bags.make(tmp_path / 'plain', kind, bags.walk(1)).rename(
            tmp_path / f'{name}.{kind}')
        assert len(read(path).frames()) == 2
        assert len(read(path, partial=True).frames()) == 2


@on_unix
def test_a_pipe_is_no_bag(tmp_path):
    """A pipe is refused, since reading it might never end."""
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(BagError, match='pipe is not a bag: it is not a regular file'):
        read(tmp_path / 'pipe')


def test_two_publishers_of_one_frame_and_a_short_cache(tmp_path, logs):
    """Messages that are in order in the bag are not discarded as too old."""
    read(bags.make(tmp_path, 'bag', [
        ('/tf', 100 * S + i * S // 10, [bags.row(100 * S + i * S // 10, 'map', 'odom')], bags.TF,
         f'/node_{i % 2}') for i in range(400)]), cache_time=5 * S)
    assert not logs


@on_linux
def test_memory_does_not_grow_with_other_messages(tmp_path):
    """ROS 1 bags are read without rosbags' index, which lists the messages of all topics."""
    text = (5).to_bytes(4, 'little') + b'text\0'
    code = ('import sys\n'
            'from dummy_arm.tf.bag import read\n'
            'for path in sys.argv[1:]:\n'
            '    read(path)\n'
            '    (peak,) = (line for line in open("/proc/self/status") if "VmHWM" in line)\n'
            '    print(peak.split()[1])\n')
    paths = [str(bags.make(tmp_path / f'{count}.bag', 'bag', [
        *bags.walk(1), *(('/text', 200 * S, text, 'std_msgs/msg/String') for _ in range(count))]))
        for count in (1000, 100_000)]
    done = subprocess.run([sys.executable, '-c', code, *paths], stdout=subprocess.PIPE, text=True,
                          check=True, timeout=60)
    few, many = map(int, done.stdout.split())
    assert many - few < 8 * 1024  # kB; the index would be 17 MB


def test_paths_may_be_text(tmp_path):
    """A path is a str or a pathlib.Path."""
    path = bags.make(tmp_path, 'bag', bags.walk())
    assert read(str(path)).frames() == read(Path(path)).frames()
