"""Limits that protect the memory, the lock and the terminal from broken or hostile nodes."""

import gc
from itertools import chain, product
import math
import re
import tracemalloc

from hypothesis import given
from hypothesis import strategies as st
from messages import fail_on_error, written
import pytest

from puretf import TransformBuffer, TransformException
from puretf._core.engine import engine_of
from puretf._core.pose import Row
from puretf._wire import cdr
from puretf._wire.encoding import CDR, ROS1
from puretf._wire.message_reader import MessageReader

S = 1_000_000_000
T = 1_700_000_000 * S
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def pose(x):
    """Return a pose x m along the x axis, without rotation."""
    return (float(x), *STILL[1:])


def by_calls(buffer, stamps, children):
    """Insert transforms one by one; x is the index of the stamp."""
    for x, stamp in enumerate(stamps):
        for child in children:
            buffer.insert(stamp, 'map', child, pose(x))


def by_messages(buffer, stamps, children, is_one=False):
    """Insert the same transforms as messages, one for each stamp with all children, or one."""
    rows = [[Row(stamp, 'map', child, pose(x)) for child in children]
            for x, stamp in enumerate(stamps)]
    messages = [*map(cdr.pack, [[*chain.from_iterable(rows)]] if is_one else rows)]
    engine_of(buffer).insert_batches(
        MessageReader(fail_on_error).read(messages, 'default_authority', False))


def by_a_message(buffer, stamps, children):
    """Insert the same transforms as a single message."""
    by_messages(buffer, stamps, children, is_one=True)


@pytest.fixture(params=[by_calls, by_messages])
def insert(request):
    """A function that inserts transforms."""
    return request.param


def lengths(buffer):
    """Return the number of samples of each frame."""
    return {frame.name: frame.length for frame in buffer.frames()}


def logged_texts(logs):
    """Return the texts that were logged."""
    return [record.getMessage() for record in logs]


def test_a_parent_that_expired_is_forgotten():
    """When one parent is left, the history has a single parent again; lookups use it."""
    buffer = TransformBuffer(S)
    for i in range(100):
        buffer.insert(T + i * S // 100, 'odd' if i % 2 else 'even', 'child', pose(i))
    assert set(buffer.dump()['child']['parents']) == {'odd', 'even'}
    assert buffer.can_transform('even', 'child', T + 50 * S // 100)
    for i in range(100, 320):
        buffer.insert(T + i * S // 100, 'odd', 'child', pose(i))
    assert set(buffer.dump()['child']['parents']) == {'odd'}
    assert buffer.lookup_transform('odd', 'child', T + 3 * S).translation[0] == 300.0


def test_a_frame_keeps_10000_samples_per_second_of_cache_time(insert, logs):
    """The newest samples are kept, and the limit is logged once for all frames."""
    buffer = TransformBuffer(S // 20)
    stamps = [T + i for i in range(1200)]
    insert(buffer, stamps, ['a', 'b'])
    assert lengths(buffer) == {'a': 500, 'b': 500}
    assert buffer.lookup_transform('map', 'a', T + 700).translation[0] == 700.0
    assert buffer.lookup_transform('map', 'b', T + 1199).translation[0] == 1199.0
    with pytest.raises(TransformException, match='extrapolation into the past'):
        buffer.lookup_transform('map', 'a', T + 699)
    (text,) = logged_texts(logs)
    assert text.startswith('TF_TOO_MANY_SAMPLES: Dropping the oldest transforms of child_frame_id '
                           '"a" from authority "default_authority"')
    assert 'at most 500 are kept of one frame' in text


@pytest.mark.parametrize('step', [1, S // 10_000], ids=['too many', 'expired'])
def test_what_is_dropped_is_freed(insert, step):
    """After many rounds, the memory holds little more than the samples that are kept."""
    buffer = TransformBuffer(S // 20)
    for round_ in range(5):
        insert(buffer, [T + (round_ * 1000 + i) * step for i in range(1000)], ['a', 'b', 'c'])
        if round_ == 2:
            tracemalloc.start()
    try:
        gc.collect()
        # The arrays are over-allocated, at most by a factor of two.
        assert tracemalloc.get_traced_memory()[0] < 2 * 3 * 500 * (56 + 8)
    finally:
        tracemalloc.stop()


def test_a_frame_with_many_parents_keeps_as_many_parents_as_samples():
    """The parents of samples that exceed the limit are dropped with them."""
    buffer = TransformBuffer(S // 20)
    for i in range(3000):
        buffer.insert(T + i, f'parent_{i % 700}', 'child', pose(i))
    known = buffer.dump()['child']
    assert len(known['parents']) == len(known['stamps']) == 500
    for i in (2500, 2750, 2999):
        assert buffer.lookup_transform(f'parent_{i % 700}', 'child', T + i).translation[0] == i


def test_the_frame_that_gets_a_sample_drops_its_oldest(insert, logs):
    """This happens when the buffer has `max_samples` samples, and is logged once."""
    buffer = TransformBuffer(max_samples=10)
    insert(buffer, [T + i for i in range(5)], ['a'])
    insert(buffer, [T + i for i in range(5)], ['b'])
    assert not logs
    insert(buffer, [T + 100 + i for i in range(3)], ['a'])
    assert lengths(buffer) == {'a': 5, 'b': 5}
    assert [frame.oldest - T for frame in buffer.frames()] == [3, 0]
    assert buffer.lookup_transform('map', 'a', T + 102).translation[0] == 2.0
    insert(buffer, [T + 200], ['b'])
    assert [frame.oldest - T for frame in buffer.frames()] == [3, 1]
    (text,) = logged_texts(logs)
    assert text.startswith(
        'TF_TOO_MANY_SAMPLES: Dropping the oldest transforms of child_frame_id "a" from ')
    assert 'max_samples allows 10 in all' in text


@pytest.mark.parametrize('end', [
    lambda buffer: by_calls(buffer, [T + 10 * S, T + 10 * S + 1], ['a']),  # the others expire
    lambda buffer: buffer.insert(T, 'map', 'a', STILL, is_static=True),
    lambda buffer: buffer.remove('a'),
    lambda buffer: buffer.clear()], ids=['expired', 'static', 'removed', 'cleared'])
def test_a_buffer_is_full_no_longer(insert, logs, end):
    """Samples that are dropped, one way or another, make room for those of another frame."""
    buffer = TransformBuffer(S, max_samples=10)
    insert(buffer, [T + i for i in range(8)], ['a'])
    insert(buffer, [T], ['b'])
    end(buffer)
    insert(buffer, [T + 1 + i for i in range(7)], ['b'])
    assert lengths(buffer)['b'] >= 7
    assert not logs


def test_kept_paths_are_limited():
    """Lookups between all pairs of many frames do not keep a path for each pair."""
    buffer = TransformBuffer()
    names = [f'frame_{i}' for i in range(110)]
    for name in names:
        buffer.insert(T, 'map', name, STILL, 'test', True)
    for target in names:
        for source in names:
            buffer.lookup_transform(target, source)
    assert 0 < len(engine_of(buffer).lookups.paths) <= 10_000


samples = st.lists(st.tuples(
    st.sampled_from([by_calls, by_messages, by_a_message]), st.integers(0, 100), st.integers(1, 5),
    st.lists(st.sampled_from([f'frame_{i}' for i in range(12)]), min_size=1, max_size=12,
             unique=True)), max_size=40)


@given(samples)
def test_a_buffer_has_no_more_samples_than_allowed(inserted):
    """One sample of each frame, the newest, is allowed in addition."""
    buffer = TransformBuffer(S, max_samples=20)
    newest: dict[str, int] = {}
    for insert, begin, number, children in inserted:
        insert(buffer, [T + begin * 1000 + i for i in range(number)], children)
        for child in children:
            newest[child] = max(newest.get(child, 0), T + begin * 1000 + number - 1)
        found = buffer.frames()
        assert {frame.name: frame.latest for frame in found} == newest
        assert sum(frame.length for frame in found) <= 20 + len(found)


def test_no_limit_of_samples():
    """With max_samples=None, neither the buffer nor a frame has a limit."""
    buffer = TransformBuffer(S // 20, max_samples=None)
    by_messages(buffer, [T + i for i in range(1200)], ['a'])
    assert lengths(buffer) == {'a': 1200}
    for wrong in 0, -1:
        with pytest.raises(ValueError, match=f'max_samples must be at least 1, or None, got '
                                             f'{wrong}'):
            TransformBuffer(max_samples=wrong)


LONG = [('x' * 1024, True), ('x' * 1025, False), ('é' * 512, True), ('é' * 513, False),
        ('\U0001f600' * 256, True), ('\U0001f600' * 257, False), ('\udc80' * 342, False)]


@pytest.mark.parametrize(('name', 'is_accepted'), LONG)
def test_a_name_may_have_1024_bytes(name, is_accepted, logs):
    """The limit counts bytes of UTF-8; a leading slash does not count."""
    for is_static, number in product((False, True), (0, 1)):
        edge = (f'/{name}', 'tool') if number else ('map', f'/{name}')
        buffer = TransformBuffer()
        logs.clear()
        assert buffer.insert(T, *edge, STILL, 'somebody', is_static) is is_accepted
        assert bool(buffer.frames()) is is_accepted
        if not is_accepted:
            size = len(name.encode('utf-8', 'surrogatepass'))
            (text,) = logged_texts(logs)
            assert re.fullmatch(
                r'TF_LONG_FRAME_ID: Ignoring transform for child_frame_id ".*" from authority '
                rf'"somebody" because its {"frame_id" if number else "child_frame_id"} has {size} '
                'bytes; at most 1024 are allowed', text)
            assert len(text) < 900


@pytest.mark.parametrize('form', [CDR, ROS1])
def test_names_of_messages_that_are_too_long_are_not_kept(form, logs):
    """They are refused in messages with a known layout, too."""
    buffer, reader = TransformBuffer(), MessageReader(fail_on_error, form)
    rows = [Row(T, 'map', 'x' * 1_000_000, STILL), Row(T, 'map', 'tool', STILL)]
    engine_of(buffer).insert_batches(
        reader.read([written(rows, encoding=form)] * 3, 'default_authority', False))
    assert lengths(buffer) == {'tool': 1}
    (text,) = logged_texts(logs)
    assert 'has 1000000 bytes' in text


HOSTILE = '\x1b[2J\r\n\x07' + 'x' * 200 + '\udc80\u202e'
NAN = (math.nan, *STILL[1:])


@pytest.mark.parametrize(('cause', 'parent', 'child', 'bad', 'stamp'), [
    ('TF_SELF_TRANSFORM', HOSTILE, HOSTILE, STILL, T),
    ('TF_NO_FRAME_ID', '', HOSTILE, STILL, T),
    ('TF_NO_CHILD_FRAME_ID', HOSTILE, '', STILL, T),
    ('TF_NAN_INPUT', 'map', HOSTILE, NAN, T),
    ('TF_DENORMALIZED_QUATERNION', 'map', HOSTILE, (0.0,) * 7, T),
    ('TF_OLD_DATA', 'map', HOSTILE, STILL, T - 100 * S),
    ('TF_TOO_MANY_FRAMES', 'map', f'new{HOSTILE}', STILL, T),
    ('TF_LONG_FRAME_ID', 'map', HOSTILE * 10, STILL, T),
    ('TF_TOO_MANY_SAMPLES', 'map', HOSTILE, STILL, None)])
def test_a_log_line_escapes_and_cuts_names(cause, parent, child, bad, stamp, logs):
    """Names of others cannot control the terminal; the only line break is that of tf2's text."""
    buffer = TransformBuffer(S // 50, max_frames=2)
    buffer.insert(T, 'map', HOSTILE, STILL)
    for i in range(300):
        buffer.insert(T + i if stamp is None else stamp, parent, child, bad, HOSTILE)
    text = next(text for text in logged_texts(logs) if text.startswith(cause))
    assert all(line.isprintable() for line in text.split('\n'))
    assert text.count('\n') == (cause == 'TF_OLD_DATA')
    assert r'\x1b[2J\r\n\x07' in text
    assert f'...{"x" * 46}\\udc80\\u202e' in text
    assert len(text) < 900


def error_text(buffer, name):
    """Return the text of the error for an unknown frame."""
    with pytest.raises(TransformException) as raised:
        buffer.lookup_transform('map', name)
    return str(raised.value)


def test_near_names_are_searched_among_1000():
    """A comparison of the unknown name with a hundred thousand names would take seconds."""
    buffer = TransformBuffer()
    for i in range(3000):
        buffer.insert(T, 'map', f'{"cup" if i < 990 else "left_wheel"}_{i}', STILL, is_static=True)
    assert "Nearest known: 'left_wheel_991'" in error_text(buffer, 'left_wheel_91')
    assert error_text(buffer, 'tool').endswith(
        "Known frames: 'cup_0', 'map', 'cup_1', 'cup_2', 'cup_3' and 2996 more."
        ' More: tf_doctor --explain missing_frame')
    assert "'left_wheel_2991'" not in error_text(buffer, 'left_wheel_2_991')


def test_long_names_are_neither_compared_nor_shown_in_full():
    """A comparison of two long names takes milliseconds."""
    buffer = TransformBuffer()
    for i in range(10):
        buffer.insert(T, 'map', f'{"x" * 500}{i}', STILL, is_static=True)
    first, *others = (f"'{'x' * 49}...{'x' * 47}{i}'" for i in range(4))
    for name in 'tool', 'x' * 500:
        assert f" Known frames: {first}, 'map', {', '.join(others)} and 6 more. More: " in (
            error_text(buffer, name))
