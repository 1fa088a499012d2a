"""Bags that would exhaust the memory, hang or hide damage; and the order of their messages."""

from contextlib import closing
import os
import random
import re
import shutil
import sqlite3
import struct
import subprocess
import sys
from types import SimpleNamespace

from conftest import on_linux, on_unix
import pytest

from dummy_arm.tf import BufferCore
from dummy_arm.tf.bag import BagError, read

bags = pytest.importorskip('bags')
S = bags.S
MIB = 2**20
LIMIT = 4 * MIB
BOMB = 128 * MIB
HEADER = bags.mcap_channel() + bags.mcap_chunk(bags.mcap_channel() + bags.mcap_message(
    [bags.row(S, 'map', 'before')], S))
TRAILER = bags.mcap_chunk(bags.mcap_message([bags.row(S, 'map', 'after')], S))


def messages(logs):
    """Return all that was logged, as one text."""
    return '\n'.join(record.getMessage() for record in logs)


def mcap_bomb(path, method, declared):
    """
    Write an mcap file with a chunk of zeros between two other chunks.

    :param declared: the size that the chunk of zeros declares (bytes); None: its real one.
    """
    return bags.mcap(path / 'bomb.mcap', HEADER, bags.mcap_chunk(
        bytes(BOMB), method, declared), TRAILER)


def ros1_bomb(path, method, declared):
    """
    Write a ROS 1 bag with a chunk of zeros between two other chunks.

    :param declared: the size that the chunk of zeros declares (bytes); None: its real one.
    """
    whole, other = (bags.make(path / f'{child}.bag', 'bag', [
        ('/tf', S, [bags.row(S, 'map', child)])]) for child in ('before', 'after'))
    with whole.open('ab') as file:
        file.write(bags.ros1_chunk(bytes(BOMB), method, declared))
        file.write(other.read_bytes()[len('#ROSBAG V2.0\n') + 4096:])
    return whole


def message_bomb(path, storage, _):
    """Write a bag with a compressed message of zeros between two other messages."""
    return bags.make(path / 'bomb', f'{storage} message', [
        ('/tf', S, [bags.row(S, 'map', 'before')]), ('/tf', S, bytes(BOMB)),
        ('/tf', S, [bags.row(S, 'map', 'after')])])


BOMBS = [(mcap_bomb, 'zstd'), (mcap_bomb, 'lz4'), (ros1_bomb, 'bz2'), (ros1_bomb, 'lz4')]
MESSAGE_BOMBS = [(message_bomb, 'mcap'), (message_bomb, 'db3')]
#: Read a bag; print its frames or the error, and by how much the peak memory grew (kB).
PEAK = """
import sys
from dummy_arm.tf.bag import BagError, read
def peak():
    (line,) = (line for line in open('/proc/self/status') if 'VmHWM' in line)
    return int(line.split()[1])
before = peak()
try:
    print([frame.name for frame in read(
        sys.argv[1], partial=sys.argv[2] == 'True', max_bytes=int(sys.argv[3])).frames()])
except BagError as error:
    print(error)
print(peak() - before)
"""


def peak(path, partial, limit):
    """
    Read a bag in another process.

    :returns: the output of the process, and the growth of its peak memory (bytes).
    """
    done = subprocess.run([sys.executable, '-c', PEAK, str(path), str(partial), str(limit)],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60)
    *output, growth = done.stdout.splitlines()
    return '\n'.join(output), int(growth) * 1024


@on_linux
@pytest.mark.parametrize('declared', [None, 1000])
@pytest.mark.parametrize(('make', 'method'), BOMBS)
def test_a_chunk_that_is_too_large(tmp_path, make, method, declared):
    """It is refused in one line before it takes memory, also if it declares a wrong size."""
    path = make(tmp_path, method, declared)
    output, growth = peak(path, False, LIMIT)
    why = (f'takes {BOMB} bytes, more than the limit of {LIMIT}: if this size is expected, pass '
           'a larger max_bytes to bag.read' if declared is None else
           'takes more than the 1000 bytes that it declares')
    assert re.fullmatch(rf'{re.escape(str(path))} cannot be read: a chunk of \d+ bytes {why}\..*',
                        output)
    assert growth < BOMB / 2
    output, growth = peak(path, True, LIMIT)
    warning, frames = output.split('\n')
    assert re.search(why, warning)
    assert frames == "['before', 'after']"
    assert growth < BOMB / 2


@on_linux
@pytest.mark.parametrize(('make', 'method'), MESSAGE_BOMBS)
def test_a_message_that_is_too_large(tmp_path, make, method):
    """A compressed message is refused before it takes memory."""
    path = make(tmp_path, method, None)
    why = f'takes more than {LIMIT} bytes, more than the limit of {LIMIT}'
    for partial, rest in (False, 'max_bytes'), (True, r"\n\['before', 'after'\]$"):
        output, growth = peak(path, partial, LIMIT)
        assert re.search(f'{why}.*{rest}', output, re.DOTALL)
        assert growth < BOMB / 2


@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('kind', bags.ROS2 + bags.ROS1)
def test_a_limit_that_is_large_enough(tmp_path, logs, kind, partial):
    """Such a limit changes nothing, while a limit of one byte refuses everything."""
    path = bags.make(tmp_path, kind, bags.walk(1))
    assert len(read(path, partial=partial, max_bytes=100_000).frames()) == 2
    assert not logs
    with pytest.raises(BagError, match='max_bytes'):
        read(path, partial=partial, max_bytes=1)


@pytest.mark.parametrize('limit', [0, -1])
def test_a_limit_must_be_positive(tmp_path, limit):
    """Zero and negative numbers are a ValueError, and a float is a TypeError."""
    with pytest.raises(ValueError, match=f'max_bytes must be a positive .*, got {limit}'):
        read(tmp_path, max_bytes=limit)
    with pytest.raises(TypeError):
        read(tmp_path, max_bytes=1.5)  # type: ignore[arg-type]


@on_linux
@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('opcode', [3, 5, 6, 9])
def test_a_length_of_exabytes(tmp_path, opcode, partial):
    """Memory is not allocated by the length that a record declares."""
    path = bags.mcap(tmp_path / 'x.mcap', HEADER, bags.mcap_record(
        opcode, b'\1\0' + bytes(100), 2**62))
    output, growth = peak(path, partial, 2**62)
    assert output.endswith("['before']") if partial else 'cannot be read: ' in output
    assert 'MemoryError' not in output
    assert growth < BOMB / 2


@on_linux
def test_a_file_that_is_compressed_as_a_whole(tmp_path):
    """A huge mcap file is decompressed as a stream, of which nothing is kept."""
    plain = bags.mcap(tmp_path / 'x.mcap', HEADER, bags.mcap_record(0x80, bytes(BOMB)), TRAILER)
    path = bags.make(tmp_path, 'mcap file', bags.walk(1))
    (file,) = path.glob('*.zstd')
    file.write_bytes(bags.packed(plain.read_bytes(), 'zstd'))
    plain.unlink()
    for partial in False, True:
        output, growth = peak(path, partial, LIMIT)
        assert output == "['before', 'after']"
        assert growth < BOMB / 2


@pytest.mark.parametrize('partial', [False, True])
def test_a_temporary_directory_without_room(tmp_path, monkeypatch, partial):
    """The error names the directory and the remedy, before the directory is full."""
    path = bags.make(tmp_path, 'db3 file', bags.walk(10))
    monkeypatch.setattr(shutil, 'disk_usage', lambda _: SimpleNamespace(free=20_000))
    with pytest.raises(BagError, match=(
            r'takes more than 10000 bytes, half of the free space in \S+: set TMPDIR to a '
            'directory with more space')) as caught:
        read(path, partial=partial)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('partial', [False, True])
def test_a_chunk_in_a_chunk(tmp_path, partial):
    """Nested chunks are damage, at any depth."""
    inner = TRAILER
    for _ in range(2000):
        inner = bags.mcap_chunk(inner)
    path = bags.mcap(tmp_path / 'x.mcap', HEADER, inner, TRAILER)
    other = bags.make(tmp_path / 'x.bag', 'bag', bags.walk(1))
    with other.open('ab') as file:
        file.write(bags.ros1_chunk(bags.ros1_chunk(b'')))
    for each in path, other:
        if partial:
            assert len(read(each, partial=True).frames()) == 2
        else:
            with pytest.raises(BagError, match='a chunk is inside another chunk'):
                read(each)


DAMAGES = [
    (bags.mcap_chunk(bags.mcap_message([], S), crc=7), 'the checksum of a chunk is wrong'),
    (bags.mcap_chunk(bags.mcap_message([], S), size=7), 'not the 7 that it declares'),
    (bags.mcap_chunk(bags.mcap_message([], S), 'zstd', size=7), 'not the 7 that it declares'),
    (bags.mcap_chunk(bags.mcap_message([], S), 'zstd', size=999), 'not the 999 that it declares'),
    (bags.mcap_record(6, bytes(32) + struct.pack('<Q', 1000)), 'larger than its record'),
    (bags.mcap_record(6, bytes(28) + b'\1' + bytes(11)), 'the header of a chunk is damaged'),
    (bags.mcap_record(6, b'short'), 'a record ends too early'),
    (bags.mcap_chunk(bags.mcap_record(5, b'1')), 'the length of a record is wrong'),
    (bags.mcap_chunk(bags.mcap_record(5, b'1', 2**63)), 'the length of a record is wrong'),
    (bags.mcap_chunk(bytes(30)), 'the length of a record is wrong'),
    (bags.mcap_record(5, b'1'), 'a record ends too early'),
    (bags.mcap_record(4, b'\1\0\1\0' + b'\xff\xff\xff\xff'), 'EndOfFile')]


@pytest.mark.parametrize(('damage', 'why'), DAMAGES, ids=map(str, range(len(DAMAGES))))
def test_damaged_records(tmp_path, logs, damage, why):
    """A damaged record is an error; with partial=True it is skipped with a warning."""
    path = bags.mcap(tmp_path / 'x.mcap', HEADER, damage, TRAILER)
    with pytest.raises(BagError, match=why):
        read(path)
    assert [frame.name for frame in read(path, partial=True).frames()] == ['before', 'after']
    (record,) = logs
    assert why in record.getMessage()


def test_zeros_at_the_end(tmp_path, logs):
    """A file system may leave zeros at the end of a file after a crash."""
    path = bags.mcap(tmp_path / 'x.mcap', HEADER)
    path.write_bytes(path.read_bytes()[:-50] + bytes(10_000))
    assert [frame.name for frame in read(path, partial=True).frames()] == ['before']
    assert 'no record begins where one should' in logs[0].getMessage()


def of_rosbags(path):
    """Read a bag by rosbags' reader, and insert its transforms one by one in that order."""
    from rosbags.highlevel import AnyReader
    buffer = BufferCore(2**62)
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages(
                [each for each in reader.connections if each.msgtype == bags.TF]):
            for transform in reader.deserialize(data, connection.msgtype).transforms:
                stamp, p = transform.header.stamp, transform.transform.translation
                buffer.insert(
                    stamp.sec * S + stamp.nanosec, transform.header.frame_id,
                    transform.child_frame_id, (p.x, p.y, p.z, 0.0, 0.0, 0.0, 1.0),
                    'not recorded', connection.topic == '/tf_static')
    return buffer


def disordered(count=60):
    """Yield messages of 10 dynamic and 3 static frames, whose times are in no order."""
    choice = random.Random(7)
    text = b'\0\1\0\0' + (300_000).to_bytes(4, 'little') + bytes(300_000)
    for number in range(count):
        stamp = choice.randrange(100 * S, 200 * S)
        yield '/tf', stamp, [bags.row(stamp, 'map', f'moving_{number % 10}', (
            number, *bags.STILL[1:]))]
        yield '/tf_static', choice.randrange(100 * S, 200 * S), [
            bags.row(0, 'map', f'still_{number % 3}', (number, *bags.STILL[1:]))]
        yield '/text', stamp, text, 'std_msgs/msg/String'


@pytest.mark.parametrize('kind', ['db3', 'mcap', 'mcap storage', 'db3 file', 'db3 message'])
def test_times_in_no_order(tmp_path, kind):
    """Messages are inserted by time, as rosbags does: the last static transform wins."""
    path = bags.make(tmp_path, kind, disordered())
    ours, theirs = read(path), of_rosbags(path)
    assert {*ours.frames()} == {*theirs.frames()}
    for frame in ours.frames():
        for stamp in (frame.oldest, frame.latest):
            assert ours.lookup_transform('map', frame.name, stamp) == (
                theirs.lookup_transform('map', frame.name, stamp))


@pytest.mark.parametrize('kind', bags.ROS2)
def test_what_is_read_is_what_rosbags_reads(tmp_path, kind):
    """The buffer equals one that is filled by rosbags, message by message."""
    path = bags.make(tmp_path, kind, bags.walk(20))
    ours, theirs = read(path), of_rosbags(path)
    assert ours.frames() == theirs.frames()
    for tenth in range(1000, 1200):
        assert ours.lookup_transform('map', 'base_link', tenth * S // 10) == (
            theirs.lookup_transform('map', 'base_link', tenth * S // 10))


def test_times_in_no_order_in_a_chunk_without_an_index(tmp_path):
    """The messages of one chunk are inserted by time."""
    still = [bags.mcap_message([bags.row(0, 'map', 'still', (time, *bags.STILL[1:]))], time)
             for time in (3, 5, 4)]
    path = bags.mcap(tmp_path / 'x.mcap', bags.mcap_chunk(
        bags.mcap_channel('/tf_static') + b''.join(still)))
    for partial in False, True:
        assert read(path, partial=partial).lookup_transform('map', 'still').translation[0] == 5.0


def test_chunks_without_tf_are_not_decompressed(tmp_path, logs):
    """The index tells which these are, so only partial=True notices damage in them."""
    text = b'\0\1\0\0' + (2 * MIB).to_bytes(4, 'little') + bytes(2 * MIB)
    path = bags.make(tmp_path, 'mcap storage', [
        *bags.walk(1), *[('/text', 200 * S, text, 'std_msgs/msg/String')] * 3,
        *bags.walk(1, begin=300 * S)])
    (file,) = path.glob('*.mcap')
    data = bytearray(file.read_bytes())
    chunks = [found.start() for found in re.finditer(re.escape(b'zstd'), data)]
    data[chunks[1] + 12:chunks[1] + 16] = bytes(4)
    file.write_bytes(data)
    assert read(path).frames()[1].length == 22
    assert not logs
    assert read(path, partial=True).frames()[1].length == 22
    assert f'{file}: ' in logs[0].getMessage()


def damage_pages(path, first, last):
    """Overwrite pages of a database."""
    data = bytearray(path.read_bytes())
    size = int.from_bytes(data[16:18], 'big')
    data[first * size:last * size] = b'\xff' * size * (last - first)
    path.write_bytes(data)


@pytest.mark.parametrize('places', [[(0.5, 1)], [(0.5, 3)], [(0.3, 1), (0.6, 2)], [(0.1, 20)]])
def test_damaged_records_of_a_database(tmp_path, logs, places):
    """They are skipped and counted, and the records before and after them are read."""
    path = bags.make(tmp_path / 'walk', 'db3', bags.walk(60, 100)) / 'walk.db3'
    with closing(sqlite3.connect(path)) as database:  # so that all pages are of messages
        database.execute('DROP INDEX timestamp_idx')
        database.execute('VACUUM')
    pages = path.stat().st_size // 4096
    for part, count in places:
        damage_pages(path, int(pages * part), int(pages * part) + count)
    with pytest.raises(BagError, match=r'cannot be read: .*malformed.*partial=True \(--partial\)'):
        read(path)
    moving = read(path, partial=True).frames()[1]
    assert (moving.oldest, moving.latest) == (100 * S, 160 * S)
    lost = 6001 - moving.length
    assert 10 * len(places) < lost < 1500
    (record,) = logs
    assert record.getMessage().startswith(f'{path}: ')
    assert f'; skipped {lost} damaged records. Read ' in record.getMessage()


def test_a_database_that_is_damaged_up_to_its_end(tmp_path, logs):
    """The number of damaged records in the warning is then a lower bound."""
    path = bags.make(tmp_path / 'walk', 'db3', bags.walk(60, 100)) / 'walk.db3'
    path.write_bytes(path.read_bytes()[:path.stat().st_size // 2])
    assert read(path, partial=True).frames()[1].length > 1000
    assert re.search('; skipped at least [0-9]+ damaged record', logs[0].getMessage())


@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('value', [
    "'text'", "CAST(X'ff00ff' AS TEXT)", '7', '1.5', "X''", 'NULL'])
def test_values_that_are_no_messages(tmp_path, logs, value, partial):
    """They are skipped and counted, whatever their type is."""
    path = bags.make(tmp_path / 'walk', 'db3', bags.walk(10)) / 'walk.db3'
    with closing(sqlite3.connect(path)) as database:
        database.execute('CREATE TABLE other (id INTEGER PRIMARY KEY, topic_id, timestamp, data)')
        database.execute('INSERT INTO other SELECT id, topic_id, timestamp, data FROM messages')
        database.execute('DROP TABLE messages')
        database.execute('ALTER TABLE other RENAME TO messages')
        database.execute(f'UPDATE messages SET data = {value} WHERE id IN (5, 7)')
        database.commit()
    assert read(path, partial=partial).frames()[1].length == 99
    (record,) = logs
    assert 'skipped 2 of 102 TF messages, which cannot be decoded' in record.getMessage()


@pytest.mark.parametrize('partial', [False, True])
def test_topics_that_are_no_text(tmp_path, partial):
    """Such topics do not prevent the others from being read."""
    path = bags.make(tmp_path / 'walk', 'db3', bags.walk(1)) / 'walk.db3'
    with closing(sqlite3.connect(path)) as database:
        database.execute("INSERT INTO topics VALUES (9, CAST(X'ff' AS TEXT), X'00', '', '', '')")
        database.commit()
    assert len(read(path, partial=partial).frames()) == 2


@on_linux
def test_a_database_that_computes_large_values(tmp_path):
    """A generated column of huge values is refused in one line, before it takes memory."""
    path = bags.make(tmp_path / 'walk', 'db3', bags.walk(1)) / 'walk.db3'
    with closing(sqlite3.connect(path)) as database:
        database.execute('ALTER TABLE messages RENAME TO others')
        database.execute('CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, '
                         f'data AS (zeroblob({BOMB})))')
        database.execute('INSERT INTO messages SELECT id, topic_id, timestamp FROM others')
        database.commit()
    for partial in False, True:
        output, growth = peak(path, partial, LIMIT)
        assert 'map' not in output
        assert output.count('\n') == 0
        assert growth < BOMB / 2


@pytest.mark.parametrize('partial', [False, True])
def test_messages_are_decompressed_where_metadata_declare_it(tmp_path, logs, partial):
    """Otherwise a message that begins like zstd is one that cannot be decoded."""
    packed = bags.packed(bags.ros2([bags.row(105 * S, 'map', 'packed')]), 'zstd')
    path = bags.make(tmp_path / 'plain', 'db3', [*bags.walk(1), ('/tf', 105 * S, packed)])
    for each in path, path / 'plain.db3', tmp_path / 'x.db3':
        if each.name == 'x.db3':
            (path / 'plain.db3').rename(each)
        logs.clear()
        assert len(read(each, partial=partial).frames()) == 2
        assert 'skipped 1 of 13 TF messages' in logs[0].getMessage()


@pytest.mark.parametrize('partial', [False, True])
def test_metadata_beside_a_file(tmp_path, partial):
    """A metadata.yaml that names a file applies to it; old databases have no metadata inside."""
    path = bags.make(tmp_path / 'walk', 'db3 message', bags.walk(1))
    with closing(sqlite3.connect(path / 'walk.db3')) as database:
        database.execute('DROP TABLE metadata')
        database.commit()
    assert len(read(path / 'walk.db3', partial=partial).frames()) == 2
    other = (path / 'walk.db3').rename(path / 'other.db3')
    with pytest.raises(BagError, match='no valid transform'):
        read(other, partial=partial)


def test_metadata_that_cannot_be_read(tmp_path, logs):
    """Unsupported or malformed metadata are an error; with partial=True, a warning."""
    for number, (old, new, why) in enumerate([
            ('version: 9', 'version: 10', 'its version is 10, the newest supported version is 9'),
            ('compression_format: zstd', 'compression_format: rar',
             "its compression format is 'rar', not zstd"),
            ('version: 9', '"', 'metadata.yaml: ')]):
        path = bags.make(tmp_path / str(number), 'db3 message', bags.walk(1))
        metadata = path / 'metadata.yaml'
        assert old in metadata.read_text()
        metadata.write_text(metadata.read_text().replace(old, new))
        with pytest.raises(BagError, match=f'{path} cannot be read: {why}') as caught:
            read(path)
        assert '\n' not in str(caught.value)
        assert len(read(path, partial=True).frames()) == 2
    assert f'{metadata}: ' in messages(logs)


def test_metadata_that_are_too_long(tmp_path):
    """They are not parsed, since that would take minutes."""
    path = bags.make(tmp_path, 'mcap', bags.walk(1))
    with (path / 'metadata.yaml').open('a') as metadata:
        metadata.write('#' * 10_000_000)
    with pytest.raises(BagError, match=r'metadata\.yaml: it has more than 10000000 bytes'):
        read(path)
    assert len(read(path, partial=True).frames()) == 2


def test_a_topic_in_another_encoding(tmp_path):
    """A topic that is not encoded as CDR is not TF, and the error names its encoding."""
    path = bags.mcap(tmp_path / 'x.mcap', bags.mcap_channel(encoding='json'))
    with pytest.raises(BagError, match=re.escape(f'its topics: /tf ({bags.TF} in json)')):
        read(path)


def test_control_characters_of_a_bag(tmp_path):
    """Control characters are escaped in errors, and long names are shortened."""
    path = bags.mcap(tmp_path / 'x.mcap', bags.mcap_channel(
        '/\x1b[2J', msgtype='\x07' + 'x' * 200))
    with pytest.raises(BagError) as caught:
        read(path)
    assert str(caught.value).isprintable()
    assert '\\x1b[2J' in str(caught.value)
    assert '(201 characters)' in str(caught.value)


@on_linux
@pytest.mark.parametrize('partial', [False, True])
@pytest.mark.parametrize('name', [
    'metadata.yaml', 'x.db3', 'x.db3-wal', 'x.db3-journal', 'y.db3.zstd'])
def test_a_pipe_in_a_bag(tmp_path, name, partial):
    """A pipe is refused, since reading it would never end."""
    path = bags.make(tmp_path / 'x', 'db3', bags.walk(1))
    (path / name).unlink(missing_ok=True)
    os.mkfifo(path / name)
    metadata = path / 'metadata.yaml'
    if name[0] == 'y':
        metadata.write_text(metadata.read_text().replace('- x.db3', '- x.db3\n  - y.db3.zstd'))
    output, _ = peak(path, partial, LIMIT)
    assert f'{path / name} is not a bag: it is not a regular file' in output
    assert ('odom' in output) is (partial and name[0] == 'y')


INTERRUPTED = """
import os, signal, sys, time
from dummy_arm.cli.bag_options import read_bag
from dummy_arm.cli.parser import CommandError
from dummy_arm.cli.signals import record_signals
def duration():  # does not depend on what else the machine does
    begin = time.process_time()
    try:
        read_bag(sys.argv[1], '', False)
    except (CommandError, KeyboardInterrupt) as error:
        print(repr(error))
    return time.process_time() - begin
duration()  # to finish the late imports
whole = duration()
record_signals()
signal.signal(signal.SIGPROF, lambda *_: os.kill(os.getpid(), signal.SIGINT))
signal.setitimer(signal.ITIMER_PROF, whole / 5)
print(duration() / whole)
"""


@on_unix
@pytest.mark.parametrize('kind', ['chunk', 'file'])
def test_ctrl_c_while_one_thing_is_decompressed(tmp_path, kind):
    """Ctrl-C ends the reading long before the end of one huge chunk or file."""
    if kind == 'chunk':
        path = bags.make(tmp_path / 'x.bag', 'bag', bags.walk(1))
        with path.open('ab') as file:
            file.write(bags.ros1_chunk(bytes(BOMB), 'bz2'))
    else:
        path = bags.make(tmp_path / 'x', 'mcap file', bags.walk(1))
        head = bags.mcap(tmp_path / 'x.mcap').read_bytes()[:-37]
        head += bags.mcap_record(0x80, b'', 2**40)
        zeros = bags.packed(bytes(BOMB), 'zstd')
        (path / 'x.mcap.zstd').write_bytes(bags.packed(head, 'zstd') + zeros * 8)
    done = subprocess.run([sys.executable, '-c', INTERRUPTED, str(path)], text=True, timeout=60,
                          stdout=subprocess.PIPE)
    _, error, interrupted, ratio = done.stdout.splitlines()
    assert error.startswith('CommandError')
    assert interrupted == 'KeyboardInterrupt()'
    assert float(ratio) < 0.6


def long_message(kind, number=60_000, end=None):
    """
    Return the bytes of a message, of 5 MB by default.

    :param number: the number of its transforms.
    :param end: the index at which the bytes are cut off; None: they are complete.
    """
    rows = [bags.row(S + i, 'map', 'tool', (float(i), *bags.STILL[1:])) for i in range(number)]
    return (bags.ros1 if kind == 'bag' else bags.ros2)(rows)[:end]


@pytest.mark.parametrize('kind', ['mcap', 'bag'])
def test_a_long_message(tmp_path, kind):
    """A long message is inserted whole, and in order with the others."""
    path = bags.make(tmp_path / f'long.{kind}', kind, [
        ('/tf', S, [bags.row(S, 'map', 'tool')]), ('/tf', 2 * S, long_message(kind)),
        ('/tf_static', 3 * S, [bags.row(S, 'map', 'fixed')])])
    buffer = read(path)
    assert [frame.length for frame in buffer.frames()] == [60_000, 1]
    assert buffer.lookup_transform('map', 'tool', S + 12_345).translation[0] == 12_345.0


@pytest.mark.soak
@on_linux
def test_a_long_message_is_not_a_list_of_transforms(tmp_path):
    """A list of its transforms would take six times its memory."""
    data = long_message('bag', 200_000)
    path = bags.make(tmp_path / 'long.bag', 'bag', [('/tf', S, data)])
    output, growth = peak(path, False, LIMIT * 10)
    assert output == "['tool']"
    assert growth < 5 * len(data)


@pytest.mark.parametrize('kind', ['mcap', 'bag'])
def test_a_long_message_that_is_cut_off(tmp_path, logs, kind):
    """It is skipped as a whole, like a short one."""
    path = bags.make(tmp_path / f'long.{kind}', kind, [
        ('/tf', S, [bags.row(S, 'map', 'tool')]), ('/tf', 2 * S, long_message(kind, end=-1))])
    assert read(path).frames()[0].length == 1
    assert 'skipped 1 of 2 TF messages, which cannot be decoded: ' in messages(logs)


def test_ctrl_c_in_a_long_message(tmp_path):
    """The signal is noticed at each of its transforms."""
    path = bags.make(tmp_path / 'long', 'mcap', [('/tf', S, long_message('mcap'))])
    code = ('from dummy_arm.cli import bag_options, signals\n'
            'from dummy_arm.tf import bag, BufferCore\n'
            'class Buffer(BufferCore):\n'
            '    def insert(self, *arguments):\n'
            '        global count\n'
            '        count += 1\n'
            '        if count == 1000:\n'
            '            signals._received.append(2)\n'
            '        return super().insert(*arguments)\n'
            'count, bag.BufferCore = 0, Buffer\n'
            f'try: bag_options.read_bag({str(path)!r}, "", False)\n'
            'except KeyboardInterrupt: print(count)\n')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert done.stdout == '1000\n'


def test_a_bag_has_no_limit_of_samples_unless_asked(tmp_path, logs):
    """By default neither a buffer nor a frame has one, whatever the cache time is."""
    path = bags.make(tmp_path, 'mcap', [
        ('/tf', S + i, [bags.row(S + i, 'map', child)]) for i in range(700) for child in 'ab'])
    assert [frame.length for frame in read(path, cache_time=S // 100).frames()] == [700, 700]
    assert not logs
    assert sum(frame.length for frame in read(path, max_samples=100).frames()) <= 101
    assert 'TF_FULL_BUFFER' in messages(logs)
    logs.clear()
    assert [frame.length for frame in read(
        path, cache_time=S // 20, max_samples=10_000).frames()] == [500, 500]
    assert 'TF_TOO_MANY_SAMPLES' in messages(logs)
