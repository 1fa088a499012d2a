"""Insertion of messages: it has the same result as that of their transforms, one by one."""

import logging
import math
import threading
from typing import Any
import warnings

from ctrl_c import interruptions
from hypothesis import given
from hypothesis import strategies as st
from messages import ArrivedMessages, fail_on_error, written
import numpy as np
import pytest

from puretf import TransformBuffer
from puretf._core.engine import engine_of
from puretf._core.pose import Batch, Row
from puretf._wire import cdr
from puretf._wire.encoding import CDR, ROS1
from puretf._wire.message_reader import MessageReader

S = 1_000_000_000
T = 1_700_000_000
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def insert(buffer, reader, *messages, **kwargs):
    """Read messages, and insert them into a buffer."""
    kwargs = {'authority': 'default_authority', 'is_static': False, **kwargs}
    engine_of(buffer).insert_batches(reader.read(messages, **kwargs))


def read(reader, message):
    """Read a message; return its rows and its batches."""
    batches = reader.read([message], 'somebody', False)
    return ([row for batch in batches if not isinstance(batch, Batch) for row in batch.rows],
            [batch for batch in batches if isinstance(batch, Batch)])


def state(buffer):
    """Return all data of a buffer, as texts, since a NaN is not equal to itself."""
    return {name: str(known) for name, known in buffer.dump().items()}


@pytest.mark.parametrize(('given', 'expected'), [
    ((0, 0, 0, -2), (0, 0, 0, 1)), ((3, 0, 0, -4), (-0.6, 0, 0, 0.8)),
    ((-4, 0, 0, 3), (-0.8, 0, 0, 0.6)), ((9, 0, 0, -1), (9, 0, 0, -1)),
    ((-1, 1, -1, 1), (0.5, -0.5, 0.5, -0.5)), ((0, -2, 1, 0), (0, 2, -1, 0)),
    ((1, 0, -2, -1), (-1, 0, 2, 1)), ((1e150, 0, 0, 0), (1, 0, 0, 0)),
    ((0, 0, 0, 0), None), ((0, 0, math.inf, 1), None), ((math.nan, 0, 0, 1), None),
    ((1e-170, 0, 0, 0), None), ((0, 1e170, 0, 0), None)])
@pytest.mark.parametrize('count', [1, 5, 500])
def test_a_rotation_is_normalised_with_the_sign_of_tf2(given, expected, count):
    """Its w is positive if the angle is less than 120 degrees, else its largest axis is."""
    buffer, reader = TransformBuffer(), MessageReader(fail_on_error)
    turned: Any = (0.0, 0.0, 0.0, *map(float, given))
    messages = [cdr.pack([Row(T * S + i, 'map', 'a', STILL), Row(T * S + i, 'map', 'b', turned)])
                for i in range(count + 1)]
    insert(buffer, reader, messages[0])  # the others have a known layout
    insert(buffer, reader, *messages[1:])
    assert len(buffer.path_stamps('map', 'a')) == count + 1
    if expected is None:
        assert 'b' not in buffer.frame_names()
    else:
        unit = np.array(expected) / np.linalg.norm(expected)
        for stamp in T * S, T * S + count:
            rotation = buffer.lookup_transform('map', 'b', stamp).rotation
            assert rotation == pytest.approx(unit, abs=1e-15)
            assert '-0.0' not in map(str, rotation)


def test_padding_and_what_follows_are_no_matter():
    """In real messages, padding has any value, and changes from message to message."""
    rows = [Row(T * S + 5, 'a', 'bcdef', STILL), Row(T * S + 5, 'bcdef', 'x' * 9, STILL)]
    data = cdr.pack(rows)
    ones = bytearray(data)
    # Two bytes of padding follow 'a\0'; two and four bytes follow 'bcdef\0'.
    ones[22:24] = b'\xff\xff'
    assert CDR.unpack(bytes(ones)) == rows
    reader = MessageReader(fail_on_error)
    for message in data, bytes(ones), data:
        unknown, found = read(reader, message)
        assert bool(unknown) != bool(found)
    assert not unknown
    assert found[0].stamps.tolist() == [T * S + 5]
    longer = data + b'junk'
    read(reader, longer)
    _, (batch,) = read(reader, longer)
    assert batch.children == ['bcdef', 'x' * 9]


def test_a_layout_is_of_all_names():
    """Messages of the same length that differ in the last name only are distinguished."""
    one = cdr.pack([Row(T * S, 'a', 'b', STILL), Row(T * S, 'b', 'c', STILL)])
    other = cdr.pack([Row(T * S, 'a', 'b', STILL), Row(T * S, 'b', 'd', STILL)])
    buffer, reader = TransformBuffer(), MessageReader(fail_on_error)
    for _ in range(2):
        insert(buffer, reader, one, one, other, other, one)
    assert [frame.name for frame in buffer.frames()] == ['b', 'c', 'd']


def test_the_memory_for_layouts_is_bounded():
    """A publisher that sends new names in each message does not fill the memory."""
    reader = MessageReader(fail_on_error)

    def is_known(i):
        names = (f'{i} {"x" * 1000} {j}' for j in range(100))
        return not read(reader, cdr.pack([Row(T * S, 'a', name, STILL) for name in names]))[0]

    assert not any(map(is_known, range(10)))
    assert is_known(0)  # 1 MB of messages were read
    assert not any(map(is_known, range(10, 150)))
    assert not is_known(0)
    assert is_known(149)


numbers = st.floats(-1e3, 1e3) | st.sampled_from([math.nan, math.inf, 0.0])
poses = st.tuples(*[st.floats(-10.0, 10.0)] * 3, *[st.floats(-1.0, 1.0)] * 4)
good_or_bad_poses = st.one_of(poses, poses, poses, st.tuples(*[numbers] * 7))
edges = st.tuples(st.sampled_from(['a', 'b', '//c', 'd', '']), st.sampled_from('abcde'))
layouts = st.lists(st.lists(edges, min_size=1, max_size=4), min_size=1, max_size=3)


@st.composite
def batches(draw):
    """Return batches of messages, whose stamps increase from message to message, or vary."""
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
                Row(stamp, parent, child, draw(good_or_bad_poses))
                for stamp, (parent, child) in zip(stamps, draw(st.sampled_from(kinds)))])
        made.append((batch, draw(st.integers(0, 5)) == 0))
    return made


@pytest.mark.parametrize('encoding', [CDR, ROS1])
@given(made=batches())
def test_messages_are_inserted_as_their_transforms_one_by_one(encoding, made):
    """The samples, parents, static frames and expiry are the same for any messages."""
    fast, slow = TransformBuffer(), TransformBuffer()
    reader = MessageReader(fail_on_error, encoding)
    for batch, is_static in made:
        insert(fast, reader, *(written(rows, encoding=encoding) for rows in batch),
               is_static=is_static)
        for stamp, parent, child, pose in (row for message in batch for row in message):
            slow.insert(stamp, parent, child, pose, is_static=is_static)
        assert state(fast) == state(slow)


def chain(number, stamp, shift=0.0):
    """Return a message with a chain of frames."""
    return cdr.pack([Row(stamp, f'f{i}', f'f{i + 1}', (shift + i, *STILL[1:]))
                      for i in range(number)])


def test_what_the_user_inserts_does_not_overtake_what_was_sent_before():
    """Messages that have arrived are inserted first, although they were not pulled yet."""
    buffer = TransformBuffer()
    source = ArrivedMessages(cdr.pack([Row(T * S, 'a', 'b', STILL)]))
    engine_of(buffer).add_source(source)
    buffer.insert(T * S, 'a', 'b', (1.0, *STILL[1:]), is_static=True)
    assert buffer.frames()[0].is_static
    assert not source.take()


FILES = 'history.py', 'insertion.py', 'tree.py', 'engine.py'


READER = MessageReader(fail_on_error)


def by_messages(buffer, rows):
    """Insert transforms by one message for each, whose layout is known."""
    insert(buffer, READER, *(cdr.pack([row]) for row in rows))


def by_calls(buffer, rows):
    """Insert transforms one by one."""
    for row in rows:
        buffer.insert(*row)


def rows_at(*seconds, parent='a'):
    """Return transforms of one child."""
    return [Row(int(second * S), parent, 'c', (second, *STILL[1:])) for second in seconds]


def of_three(begin, end, interval):
    """Return transforms of one child in turn in one of three parents."""
    return [Row(T * S + i * interval, f'p{i % 3}', 'c', (float(i), *STILL[1:]))
            for i in range(begin, end)]


FIRST = [*rows_at(*range(1, 60)), *rows_at(59.5)]
SEVERAL = [*FIRST, *rows_at(60, 61, parent='b')]
OF_THREE, MORE = of_three(0, 45, 1000), of_three(45, 65, 1000)
ANY, LATER = range(1000), (2 * 10**9, 2 * 10**9 + 1)


@pytest.mark.parametrize(('limits', 'before', 'put', 'rows', 'kept', 'step'), [
    *(pytest.param({'cache_time': 50 * S}, before, put, rows_at(*seconds, parent=parent), ANY, 1,
                   id=f'{seconds} below {parent} {put.__name__}, {len(before)} before')
      for parent in 'ab' for before, put, seconds in (
          (FIRST, by_calls, [60]), (FIRST, by_messages, [60, 61, 62]),
          (FIRST, by_messages, [58.5]), (SEVERAL, by_messages, [200]),
          (SEVERAL, by_calls, [200]))),
    *(pytest.param(limits, OF_THREE, by_calls, MORE, range(20, 66), 97, id=f'{limits}')
      for limits in ({'cache_time': 30_000}, {'max_samples': 40})),
    pytest.param({}, of_three(0, 101, 0), by_calls, of_three(101, 104, 0), (99, 100), 97,
                 id='one stamp')])
def test_ctrl_c_leaves_each_sample_its_stamp_and_parent(limits, before, put, rows, kept, step):
    """What is inserted may be lost; more can be inserted afterwards."""
    buffer = TransformBuffer()

    def prepare():
        nonlocal buffer
        buffer = TransformBuffer(**limits)
        by_messages(buffer, before)
        return lambda: put(buffer, rows)

    for places, _ in enumerate(interruptions(prepare, *FILES, step=step)):  # noqa: B007
        known = buffer.dump()['c']
        samples = [*zip(known['stamps'], known['parents'], known['poses'], strict=True)]
        assert {(stamp, parent, pose[0]) for stamp, parent, pose in samples} <= {
            (row.stamp_ns, row.frame_id, row.pose[0]) for row in (*before, *rows)}
        assert known['stamps'] == sorted(known['stamps'])
        assert len(samples) in (0, *kept)  # 0: the frame was being changed
        later = rows_at(*LATER)
        by_messages(buffer, later)
        assert buffer.dump()['c']['stamps'][-2:] == [row.stamp_ns for row in later]
        assert buffer.lookup_transform('a', 'c', later[1].stamp_ns).translation[0] == LATER[1]
    assert places > 5


def test_of_one_stamp_a_hundred_samples_are_kept():
    """They include the first and the last, which lookups use."""
    buffer = TransformBuffer()
    buffer.insert(T * S, 'a', 'b', STILL)
    for i in range(1000):
        assert buffer.insert(T * S + 10, 'x' if i % 7 == 1 else 'a', 'b', (i + 1, *STILL[1:]))
    buffer.insert(T * S + 20, 'a', 'b', STILL)
    known = buffer.dump()['b']
    assert len(known['parents']) == len(known['stamps']) == len(known['poses']) == 102
    assert set(known['parents']) == {'a', 'x'}
    assert known['poses'][1][0] == 1
    assert buffer.lookup_transform('a', 'b', T * S + 10).translation[0] == 1000
    assert buffer.lookup_transform('a', 'b', T * S + 15).translation[0] == 500
    assert buffer.lookup_transform('a', 'b', T * S + 5).translation[0] == 0.5


def test_more_frames_than_allowed_are_refused_and_logged_once(logs):
    """Transforms between known frames are still inserted."""
    buffer = TransformBuffer(max_frames=4)
    reader = MessageReader(fail_on_error)
    assert buffer.insert(T * S, 'f0', 'f1', STILL)
    assert buffer.insert(T * S, 'f1', 'f2', STILL)
    assert not buffer.insert(T * S, 'new root', 'new', STILL)
    assert buffer.insert(T * S, 'f2', 'f3', STILL)
    for i in range(1, 4):
        insert(buffer, reader, chain(6, (T + i) * S))
    assert set(buffer.frame_names()) == {'f0', 'f1', 'f2', 'f3'}
    assert buffer.lookup_transform('f0', 'f3').stamp == (T + 3) * S
    (text,) = [record.getMessage() for record in logs]
    assert text.startswith('TF_TOO_MANY_FRAMES: Ignoring transform for child_frame_id "new" ')
    assert 'max_frames of the buffer allows 4 frames' in text


def test_numbers_that_are_not_finite_give_no_warning():
    """Neither these numbers nor finite ones whose sum overflows cause a warning of numpy."""
    buffer, reader = TransformBuffer(), MessageReader(fail_on_error)
    for number in range(3):
        for numbers in ((math.inf, -math.inf), (1e308, 1.7e308), (math.nan, 0.0)):
            with warnings.catch_warnings():
                warnings.simplefilter('error')
                insert(buffer, reader, *(cdr.pack([
                    Row((T + number) * S + i, 'a', f'{i}', (*numbers, *STILL[2:]))
                    for i in range(many)])
                    for many in (1, 40)))
    assert buffer.can_transform('a', '39')


def test_a_log_may_look_up_while_transforms_are_refused(monkeypatch):
    """A log handler is called without the lock, so that other threads can look up."""
    found = []
    buffer, reader = TransformBuffer(), MessageReader(fail_on_error)

    class Handler(logging.Handler):
        def emit(self, _):
            thread = threading.Thread(target=lambda: found.append(buffer.can_transform('a', 'b')))
            thread.start()
            thread.join(60.0)

    monkeypatch.setattr(logging.getLogger('puretf'), 'handlers', [Handler()])
    insert(buffer, reader, cdr.pack([Row(T * S, 'a', 'b', STILL), Row(T * S, 'x', 'x', STILL)]))
    assert found == [True]
    assert not buffer.insert(T * S, 'y', 'y', STILL)  # within the same second
    assert found == [True]
