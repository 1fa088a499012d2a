"""Messages as bytes into a buffer: the same as their transforms one by one, and much faster."""

from itertools import count
import math
import struct
import sys
import threading
import warnings
import weakref

from conftest import golden_rows
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from dummy_arm.tf import BufferCore, normalization, wire
from dummy_arm.tf.history import History
from dummy_arm.tf.message_reader import MessageReader
from dummy_arm.tf.normalization import normalize_poses, normalized

S = 1_000_000_000
T = 1_700_000_000
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def fail(error):
    """Take no malformed message."""
    raise error


def insert(buffer, reader, *messages, **how):
    """Insert messages into a buffer."""
    buffer.insert_messages(messages, reader, **how)


def read(reader, message):
    """Read a message: rows, and runs."""
    pieces = reader.read([message])
    return ([row for piece in pieces if isinstance(piece, list) for row in piece],
            [piece for piece in pieces if not isinstance(piece, list)])


def samples(history):
    """Give the stamps, poses and parents that have not expired."""
    place, _ = history.place
    rows = range(place.start, len(place.stamps))
    return (place.stamps[place.start:].tolist(), str([history.pose(i) for i in rows]),
            [history.parent_of(i) for i in rows])


def state(buffer):
    """Give all that a buffer knows, but for samples that have expired."""
    return {
        name: None if history is None else (
            history.is_static, history.authority, str(history.pose)) if history.is_static else (
            history.is_static, history.authority, history.latest, *samples(history))
        for name, history in buffer._lookups.tree.histories.items()}


@pytest.mark.parametrize('number', [1, 5, 31, 32, 100, 1000])
@pytest.mark.parametrize('kind', ['near', 'any', 'far', 'half turns', 'bad', 'tiny', 'huge'])
def test_many_rotations_are_normalised_as_one(number, kind):
    """To the last bit, in all branches of the way back from a matrix, and where there is none."""
    random = np.random.default_rng(number)
    poses = random.normal(size=(number, 7))
    if kind == 'near':
        poses[:, 6] += 5.0
    elif kind == 'far':
        poses[:, 6] *= 1e-3
    elif kind == 'half turns':
        poses[:, 3:] = np.eye(4)[random.integers(0, 4, number)]
    elif kind == 'bad':
        poses[0, 3:], poses[number // 2, 4], poses[number // 3, 5] = 0.0, math.nan, math.inf
    elif kind in ('tiny', 'huge'):
        poses[:, 3:] *= 1e-170 if kind == 'tiny' else 1e170
    expected = [(*pose[:3], *normalized(*pose[3:])) for pose in poses.tolist()]
    normalize_poses(poses)
    np.testing.assert_array_equal(poses, expected)
    if kind in ('near', 'any', 'far', 'half turns'):
        assert np.isfinite(poses).all()


def test_golden_messages_are_read_as_unpacked(golden_messages):
    """At first sight and, by their layout, at the second; whatever lies in the padding."""
    reader = MessageReader(fail)
    for case in golden_messages:
        data = bytes.fromhex(case['cdr_hex'])
        rows = golden_rows(case)
        plain = [(sec * S + nanosec, parent.removeprefix('/'), child.removeprefix('/'), *pose)
                 for sec, nanosec, parent, child, *pose in rows]
        for sight in range(2):
            unknown, runs = read(reader, data)
            found = [(sec * S + nanosec, parent.removeprefix('/'), child.removeprefix('/'), *pose)
                     for sec, nanosec, parent, child, *pose in unknown]
            for run in runs:
                found += [(run.stamps[0], parent, child, *struct.unpack('7d', pose))
                          for parent, child, pose in zip(
                              run.edges.parents, run.edges.children, run.poses)]
            np.testing.assert_equal(found, plain)
            if sight and len({row[:2] for row in rows}) == 1:
                assert runs


def test_padding_and_what_follows_are_no_matter():
    """Real messages have anything there, and it may change."""
    rows = [(T, 5, 'a', 'bcdef', *STILL), (T, 5, 'bcdef', 'x' * 9, *STILL)]
    data = wire.pack(rows)
    ones = bytearray(data)
    # After 'a\0' come two bytes of padding, after 'bcdef\0' two and four.
    ones[22:24] = b'\xff\xff'
    assert wire.unpack(bytes(ones)) == rows
    reader = MessageReader(fail)
    for message in data, bytes(ones), data:
        unknown, runs = read(reader, message)
        assert bool(unknown) != bool(runs)
    assert not unknown
    assert runs[0].stamps.tolist() == [T * S + 5]
    longer = data + b'junk'
    reader.read([longer])
    _, (run,) = read(reader, longer)
    assert run.edges.children == ['bcdef', 'x' * 9]


def test_a_layout_is_of_all_names():
    """Messages of one length whose first names are the same are told apart."""
    one = wire.pack([(T, 0, 'a', 'b', *STILL), (T, 0, 'b', 'c', *STILL)])
    other = wire.pack([(T, 0, 'a', 'b', *STILL), (T, 0, 'b', 'd', *STILL)])
    buffer, reader = BufferCore(), MessageReader(fail)
    for _ in range(2):
        insert(buffer, reader, one, one, other, other, one)
    assert [frame.name for frame in buffer.frames()] == ['b', 'c', 'd']


def test_malformed_messages_are_told_and_the_others_inserted():
    """Each with its error, whose text begins with the kind."""
    good = wire.pack([(T, 0, 'a', 'b', *STILL)])
    errors = []
    buffer, reader = BufferCore(), MessageReader(errors.append)
    bad = [b'', b'\0\1\0\0', good[:-1], good[:30], b'\0\7' + good[2:],
           good[:4] + b'\xff\xff\xff\xff' + good[8:], b'\0\1\0\0' + bytes(3)]
    insert(buffer, reader, good, *bad, good)
    assert buffer.can_transform('a', 'b')
    assert [str(error).partition(':')[0] for error in errors] == [
        'unknown encoding', 'truncated', 'truncated', 'impossible count',
        'unknown encoding', 'impossible count', 'truncated']


def test_the_memory_for_layouts_is_bounded(monkeypatch):
    """A peer that sends ever new names does not fill it; old streams are learnt again."""
    monkeypatch.setattr('dummy_arm.tf.message_reader._MOST_BYTES', 10 * len(
        wire.pack([(T, 0, 'a', 'b', *STILL)])))
    reader = MessageReader(fail)
    for i in range(100):
        reader.read([wire.pack([(T, 0, 'a', f'b{i}', *STILL)])])
        assert len(reader._known) <= 11


numbers = st.floats(-1e3, 1e3) | st.sampled_from([math.nan, math.inf, 0.0])
poses = st.tuples(*[st.floats(-10.0, 10.0)] * 3, *[st.floats(-1.0, 1.0)] * 4)
good_or_bad_poses = st.one_of(poses, poses, poses, st.tuples(*[numbers] * 7))
edges = st.tuples(st.sampled_from(['a', 'b', '/c', 'd', '']), st.sampled_from('abcde'))
layouts = st.lists(st.lists(edges, min_size=1, max_size=4), min_size=1, max_size=3)


@st.composite
def batches(draw):
    """Make batches of messages, whose stamps go on from message to message, or jump about."""
    kinds = draw(layouts)
    now = T * S
    made = []
    for _ in range(draw(st.integers(1, 12))):
        batch = []
        in_order = draw(st.integers(0, 3)) > 0
        for _ in range(draw(st.integers(1, 6))):
            now += draw(st.integers(1, 3 * S // 2))
            stamps = [now] * 4 if in_order else [
                now - draw(st.integers(-1, 15)) * S for _ in range(4)]
            batch.append([
                (*divmod(stamp, S), parent, child, *draw(good_or_bad_poses))
                for stamp, (parent, child) in zip(stamps, draw(st.sampled_from(kinds)))])
        made.append((batch, draw(st.integers(0, 5)) == 0))
    return made


@settings(deadline=None, max_examples=300)
@given(batches(), st.sampled_from([1, 1000]))
def test_messages_are_inserted_as_their_transforms_one_by_one(made, many):
    """Whatever is in them: the same samples, parents, static frames and expiry."""
    fast, slow, reader = BufferCore(), BufferCore(), MessageReader(fail)
    fast._intake.refusals.log = slow._intake.refusals.log = lambda _: None
    before, normalization._MANY = normalization._MANY, many
    try:
        for batch, is_static in made:
            insert(fast, reader, *map(wire.pack, batch), is_static=is_static)
            for row in (row for message in batch for row in message):
                slow.insert(row[0] * S + row[1], row[2], row[3], row[4:], is_static=is_static)
            assert state(fast) == state(slow)
    finally:
        normalization._MANY = before


def chain(number, stamp, shift=0.0):
    """Make a message of a chain of frames."""
    return wire.pack([(*divmod(stamp, S), f'f{i}', f'f{i + 1}', shift + i, *STILL[1:])
                      for i in range(number)])


def test_a_stream_of_messages_answers_as_single_transforms_do():
    """Over three times the cache time, in batches of any size."""
    fast, slow, reader = BufferCore(2 * S), BufferCore(2 * S), MessageReader(fail)
    sizes = np.random.default_rng(3).integers(1, 40, 1000)
    stamps = count(T * S, S // 50)
    for size in sizes.tolist()[:40]:
        batch = [chain(40, next(stamps), shift) for shift in range(size)]
        insert(fast, reader, *batch)
        for row in (row for data in batch for row in wire.unpack(data)):
            slow.insert(row[0] * S + row[1], row[2], row[3], row[4:])
        assert state(fast) == state(slow)
    for history in fast._lookups.tree.histories.values():
        assert history is None or len(history.place[0].stamps) <= 1.25 * 100 + 40


def places(buffer):
    """Give where the samples of each frame that moves lie."""
    return [history.place for history in buffer._lookups.tree.histories.values() if history]


def test_frames_that_come_together_have_their_stamps_in_common():
    """From the second message on; the newest may come again."""
    buffer, reader = BufferCore(), MessageReader(fail)
    insert(buffer, reader, *(chain(5, T * S + i) for i in range(3)))
    insert(buffer, reader, chain(5, T * S + 2))
    insert(buffer, reader, chain(5, T * S + 2), chain(5, T * S + 3), chain(5, T * S + 4))
    assert [offset for _, offset in places(buffer)] == [0, 56, 112, 168, 224]
    (common,) = {samples for samples, _ in places(buffer)}
    assert common.stamps.tolist() == [T * S + i for i in range(5)]
    buffer.clear()
    insert(buffer, reader, *(chain(5, T * S + i) for i in range(3)))
    insert(buffer, reader, chain(5, T * S + 3))
    assert len({samples for samples, _ in places(buffer)}) == 1


def test_a_frame_that_comes_alone_too_parts_the_others():
    """As long as it has a sample that they have not; they would be copied again and again."""
    buffer, reader = BufferCore(S), MessageReader(fail)
    insert(buffer, reader, *(chain(5, T * S + i) for i in range(3)))
    buffer.insert(T * S + 100, 'f0', 'f1', (9.0, *STILL[1:]))
    insert(buffer, reader, *(chain(5, T * S + i) for i in range(3, 6)))
    buffer.insert(T * S, 'f5', 'new', STILL)
    insert(buffer, reader, chain(5, T * S + 6))
    assert len({samples for samples, _ in places(buffer)}) == 6
    assert [frame.length for frame in buffer.frames()] == [8, 7, 7, 7, 7, 1]
    for i in range(1, 30):
        insert(buffer, reader, chain(5, T * S + i * S // 10))
    common, *_ = [samples for samples, _ in places(buffer)]
    assert [samples for samples, _ in places(buffer)].count(common) == 5


def test_a_late_message_parts_its_frames_for_a_cache_time():
    """Not for ever; and what they had in common does not stay in memory."""
    buffer, reader = BufferCore(S), MessageReader(fail)
    insert(buffer, reader, chain(5, T * S))
    insert(buffer, reader, *(chain(5, T * S + i) for i in range(1, 10)))
    (common,) = {samples for samples, _ in places(buffer)}
    abandoned = weakref.ref(common)
    del common
    insert(buffer, reader, chain(5, T * S + 3, 7.0))
    insert(buffer, reader, chain(5, T * S + 20))
    assert len({samples for samples, _ in places(buffer)}) == 5
    assert abandoned() is None
    insert(buffer, reader, chain(5, T * S + S // 2))
    assert len({samples for samples, _ in places(buffer)}) == 5
    for i in range(11, 40):
        insert(buffer, reader, chain(5, T * S + i * S // 10))
    assert len({samples for samples, _ in places(buffer)}) == 1
    buffer.clear()
    buffer_samples = [weakref.ref(samples) for samples, _ in places(buffer)]
    buffer.clear()
    assert not any(samples() for samples in buffer_samples)


def test_what_the_user_inserts_does_not_overtake_what_was_sent_before():
    """Though that waits to be inserted."""
    buffer = BufferCore()
    pending = [lambda: buffer._intake.insert(T * S, 'a', 'b', STILL, 'sent', False)]

    class Source:
        def fetch(self):
            while pending:
                pending.pop()()

        def hurry(self):
            pass

    buffer.add_source(Source())
    buffer.insert(T * S, 'a', 'b', (1.0, *STILL[1:]), is_static=True)
    assert buffer.frames()[0].is_static


def test_streams_that_have_frames_in_common_answer_as_single_transforms_do():
    """Those of a chain, parts of it, single frames, late ones, twice the same, after a clear."""
    random = np.random.default_rng(5)
    for _ in range(25):
        fast, slow, reader = BufferCore(2 * S), BufferCore(2 * S), MessageReader(fail)
        fast._intake.refusals.log = slow._intake.refusals.log = lambda _: None
        disturbances = random.choice([0.0, 0.02, 0.2])
        now, sent = T * S, [chain(6, T * S)]
        for _ in range(40):
            batch = []
            for _ in range(random.integers(1, 8)):
                now += int(random.integers(1, S // 4))
                batch.append(chain(6, now, float(random.normal())))
                if random.random() < disturbances:
                    batch.append([
                        chain(int(random.integers(1, 6)), now + 1),
                        chain(6, now - int(random.integers(0, 3 * S)), 5.0),
                        sent[-1], batch[0], chain(6, now, 7.0),
                        wire.pack([(*divmod(now, S), 'f0', f'new {now}', *STILL)]),
                        wire.pack([(*divmod(now, S), 'other', 'f3', *STILL)]),
                    ][random.integers(0, 7)])
            sent += batch
            insert(fast, reader, *batch)
            for row in (row for data in batch for row in wire.unpack(data)):
                slow.insert(row[0] * S + row[1], row[2], row[3], row[4:])
            assert state(fast) == state(slow)
            times = random.integers(now - 3 * S, now + S // 10, 20)
            for source in 'f6', 'f3':
                one, other = (buffer.lookup_transforms('f1', source, times)
                              for buffer in (fast, slow))
                for left, right in zip(one, other):
                    np.testing.assert_array_equal(left, right)
                for time, translation, known in zip(times.tolist(), one[0], one[2]):
                    assert fast.can_transform('f1', source, time) == known
                    if known:
                        np.testing.assert_allclose(
                            fast.lookup_transform('f1', source, time).translation, translation)
            if random.random() < disturbances / 5:
                fast.clear()
                slow.clear()
                now -= 10 * S


def interrupted(work, number):
    """Do work, but raise KeyboardInterrupt at a line of it; tell whether there was such a line."""
    lines = count()

    def trace(frame, event, _):
        if not frame.f_code.co_filename.endswith(
                ('history.py', 'samples.py', 'common_samples.py', 'intake.py')):
            return None
        if event == 'line' and next(lines) == number:
            raise KeyboardInterrupt
        return trace

    sys.settrace(trace)
    try:
        work()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(None)
    return False


@pytest.mark.parametrize('stamps', [[60], [60, 61, 62], [59], [58.5], [10], [200]])
@pytest.mark.parametrize('parent', ['a', 'b'])
@pytest.mark.parametrize('by', ['message', 'insert'])
def test_ctrl_c_at_any_line_leaves_a_history_whole(stamps, parent, by):
    """Every sample has the pose and the parent that belong to its stamp, and more can follow."""
    for line in count():
        buffer, reader = BufferCore(50 * S), MessageReader(fail)

        def put(*seconds, parent='a'):
            insert(buffer, reader, *(  # noqa: B023
                wire.pack([(*divmod(int(second * S), S), parent, 'c', second, *STILL[1:])])
                for second in seconds))

        put(*range(1, 60))
        put(59.5, parent='a')
        if stamps == [200]:
            put(60, 61, parent='b')  # so that there is a list of parents to expire
        work = (lambda: put(*stamps, parent=parent)) if by == 'message' else (
            lambda: [buffer.insert(int(second * S), parent, 'c',  # noqa: B023
                                   (second, *STILL[1:])) for second in stamps])
        was_interrupted = interrupted(work, line)
        put(300, 301)
        history = buffer._lookups.tree.histories['c']
        assert isinstance(history, History)
        stamps_now = history.place[0].stamps
        assert len(history.place[0].poses) == 56 * len(stamps_now)
        assert [history.pose(i)[0] for i in range(len(stamps_now))] == [
            stamp / S for stamp in stamps_now]
        assert history.parents is None or len(history.parents) == len(stamps_now)
        assert stamps_now.tolist() == sorted(stamps_now)
        assert history.latest == 301 * S
        assert buffer.lookup_transform('a', 'c', 301 * S).translation[0] == 301.0
        if not was_interrupted:
            break
    assert line > 10


def test_ctrl_c_at_any_line_leaves_samples_in_common_whole():
    """While frames begin to have them, while rows come and expire, and while they are parted."""
    def row(second, pose):
        return wire.pack([(second, 0, parent, child, pose + i, *STILL[1:])
                          for i, (parent, child) in enumerate(['ab', 'bc', 'cd'])])

    for line in count():
        buffer, reader = BufferCore(50 * S), MessageReader(fail)

        def work():
            for second in range(1, 70):
                insert(buffer, reader, row(second, second))  # noqa: B023
            buffer.insert(69 * S + 1, 'b', 'c', (70.0, *STILL[1:]))  # noqa: B023
            insert(buffer, reader, row(70, 70))  # noqa: B023

        was_interrupted = interrupted(work, line)
        insert(buffer, reader, row(300, 300), row(301, 301))
        for i, (samples, _) in enumerate(places(buffer)):
            assert len(samples.poses) == samples.row * len(samples.stamps)
            history = buffer._lookups.tree.histories['bcd'[i]]
            for index, stamp in enumerate(samples.stamps):
                expected = 70.0 if stamp % S else stamp / S + i
                assert history.pose(index)[0] == expected
            assert history.latest == 301 * S
        if not was_interrupted:
            break
    assert line > 350


@pytest.mark.parametrize('limits', [(30_000, {}), (S, {'max_samples': 40})])
def test_ctrl_c_at_any_line_leaves_each_sample_its_parent(limits):
    """While the oldest of a frame with several parents expire, or are dropped."""
    cache_time, others = limits
    for line in count():
        buffer = BufferCore(cache_time, **others)

        def put(begin, end):
            for i in range(begin, end):
                buffer.insert(T * S + i * 1000, f'p{i % 3}', 'c',  # noqa: B023
                              (float(i), *STILL[1:]))

        put(0, 45)
        was_interrupted = interrupted(lambda: put(45, 65), line)
        history = buffer._lookups.tree.histories['c']
        place, _ = history.place
        assert len(history.parents) == len(place.stamps) == len(place.poses) // 56
        for i in range(place.start, len(place.stamps)):
            number = (place.stamps[i] - T * S) // 1000
            assert history.pose(i)[0] == number
            assert history.parent_of(i) == f'p{number % 3}'
        if not was_interrupted:
            break
    assert line > 100


def test_ctrl_c_at_any_line_at_one_stamp_leaves_each_sample_its_parent():
    """Where the last of a hundred is replaced."""
    for line in count():
        buffer = BufferCore()

        def put(begin, end):
            for i in range(begin, end):
                buffer.insert(T * S, f'p{i % 3}', 'c', (float(i), *STILL[1:]))  # noqa: B023

        put(0, 101)
        was_interrupted = interrupted(lambda: put(101, 104), line)
        put(104, 105)
        history = buffer._lookups.tree.histories['c']
        place, _ = history.place
        assert len(history.parents) == len(place.stamps) == len(place.poses) // 56
        for i in range(len(place.stamps)):
            assert history.parent_of(i) == f'p{int(history.pose(i)[0]) % 3}'
        if not was_interrupted:
            break
    assert line > 20


def test_of_one_stamp_a_hundred_samples_are_kept():
    """A broken clock does not fill the memory: the first and the last are what lookups use."""
    buffer = BufferCore()
    buffer.insert(T * S, 'a', 'b', STILL)
    for i in range(1000):
        assert buffer.insert(T * S + 10, 'x' if i % 7 == 1 else 'a', 'b', (i + 1, *STILL[1:]))
    buffer.insert(T * S + 20, 'a', 'b', STILL)
    history = buffer._lookups.tree.histories['b']
    assert len(history) == 102
    assert history.parents is not None
    place, _ = history.place
    assert len(history.parents) == len(place.stamps) == len(place.poses) // 56 == 102
    assert history.pose(1)[0] == 1
    assert buffer.lookup_transform('a', 'b', T * S + 10).translation[0] == 1000
    assert buffer.lookup_transform('a', 'b', T * S + 15).translation[0] == 500
    assert buffer.lookup_transform('a', 'b', T * S + 5).translation[0] == 0.5


def test_more_frames_than_allowed_are_refused_and_that_is_said_once():
    """Those that are known go on."""
    buffer = BufferCore(max_frames=4)
    said = []
    buffer._intake.refusals.log = said.append
    reader = MessageReader(fail)
    assert buffer.insert(T * S, 'f0', 'f1', STILL)
    assert buffer.insert(T * S, 'f1', 'f2', STILL)
    assert not buffer.insert(T * S, 'new root', 'new', STILL)
    assert buffer.insert(T * S, 'f2', 'f3', STILL)
    for i in range(1, 4):
        insert(buffer, reader, chain(6, (T + i) * S))
    assert set(buffer._lookups.tree.histories) == {'f0', 'f1', 'f2', 'f3'}
    assert buffer.lookup_transform('f0', 'f3').stamp == (T + 3) * S
    assert len(said) == 1
    assert said[0].startswith('TF_TOO_MANY_FRAMES: Ignoring transform for child_frame_id "new" ')
    assert '4 frames are known' in said[0]


def test_messages_wake_those_who_wait_when_told():
    """After a batch, not within."""
    buffer, reader = BufferCore(), MessageReader(fail)
    found = []
    waiting = threading.Thread(target=lambda: found.append(
        buffer.lookup_transform('f0', 'f1', T * S, timeout=20 * S)))
    waiting.start()
    while not buffer.is_waited_for:
        pass
    insert(buffer, reader, chain(1, T * S))
    buffer.on_new_data()
    waiting.join(20.0)
    assert found[0].stamp == T * S
    assert not buffer.is_waited_for


def test_numbers_that_are_not_finite_give_no_warning():
    """Nor do numbers whose sum is not."""
    buffer, reader = BufferCore(), MessageReader(fail)
    for number in range(3):
        for numbers in ((math.inf, -math.inf), (1e308, 1.7e308), (math.nan, 0.0)):
            with warnings.catch_warnings():
                warnings.simplefilter('error')
                insert(buffer, reader, *(wire.pack([
                    (T + number, i, 'a', f'{i}', *numbers, *STILL[2:]) for i in range(many)])
                    for many in (1, 40)))
    assert buffer.can_transform('a', '39')


def test_a_log_may_look_up_while_transforms_are_refused():
    """The lock is not held then."""
    buffer, reader = BufferCore(), MessageReader(fail)
    found = []

    def log(_):
        thread = threading.Thread(target=lambda: found.append(buffer.can_transform('a', 'b')))
        thread.start()
        thread.join(20.0)

    buffer._intake.refusals.log = log
    insert(buffer, reader, wire.pack([(T, 0, 'a', 'b', *STILL), (T, 0, 'x', 'x', *STILL)]))
    assert not found
    buffer.on_new_data()
    assert found == [True]
    assert not buffer.insert(T * S, 'y', 'y', STILL)  # within the same second
