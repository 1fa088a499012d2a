"""When the explanation of an error is written, and what may happen meanwhile."""

import pickle
import re

import pytest

from puretf import TransformBuffer, TransformException
from puretf._causes.facts import OTHER_CLOCK, Surroundings
from puretf._core.engine import engine_of

S = 1_000_000_000
T = 1_700_000_000 * S
STILL = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
FUTURE = 'before that time. More: tf_doctor --explain future'


@pytest.fixture
def buffer():
    """A buffer with the frame base in map, at two times."""
    buffer = TransformBuffer()
    for stamp in T - S, T:
        buffer.insert(stamp, 'map', 'base', STILL)
    return buffer


def error_of(buffer, time, source='base'):
    """Return the error that a lookup raises."""
    with pytest.raises(TransformException) as raised:
        buffer.lookup_transform('map', source, time)
    return raised.value


def test_nobody_is_asked_unless_a_text_is_read(buffer):
    """Lookups that wait raise many errors, of which only the last one is read, once."""
    calls: list[None] = []

    def look():
        calls.append(None)
        return Surroundings()

    engine_of(buffer).look = look
    error = error_of(buffer, T + S)
    assert calls == []
    assert error.causes == ()
    texts = {str(error), str(error), repr(error), str(pickle.loads(pickle.dumps(error)))}
    assert len(calls) == 1
    assert len({text.count('More:') for text in texts}) == 1


def test_nobody_is_asked_while_the_lock_is_held(buffer):
    """A query of the ROS graph takes other locks."""
    engine_of(buffer).look = lambda: Surroundings(now=T, topics=['/tf'])
    with buffer.updated():
        assert str(error_of(buffer, T + 1)).endswith(FUTURE)
    assert 'arrived' in str(error_of(buffer, T + 1))


def test_an_error_survives_what_it_asks(buffer):
    """The node may be destroyed; the error is none of that."""
    def fail():
        raise RuntimeError

    engine_of(buffer).look = fail
    assert str(error_of(buffer, T + 1)).endswith(FUTURE)


UNITS = {'seconds': S, 'milliseconds': 1_000_000, 'microseconds': 1000}


@pytest.mark.parametrize('unit', UNITS)
@pytest.mark.parametrize(('seconds', 'is_told'), [(0, True), (-1, True), (-2, False), (1, False)])
def test_a_time_in_seconds_is_told(buffer, seconds, is_told, unit):
    time = (T // S + seconds) * (S // UNITS[unit])
    error = error_of(buffer, time)
    assert error.causes == ('time_in_seconds',) * is_told
    assert (f'{time} {unit} are within the data, {time} ns are not.' in str(error)) == is_told


@pytest.mark.parametrize(('stamps', 'code', 'remedy'), [
    ([T, T, T], 'frozen_stamp', {'is_static': True}), ([0, 0], 'zero_stamp', {'stamp': T - S})])
def test_the_remedies_for_a_buffer_without_a_listener(stamps, code, remedy):
    """They name the arguments of `insert`."""
    buffer = TransformBuffer()
    for stamp in stamps:
        buffer.insert(stamp, 'map', 'base', STILL)
    error = error_of(buffer, T - S)
    assert error.causes == (code,)
    assert all(f'{argument}=' in str(error) for argument in remedy)
    given = {'stamp': T, 'frame_id': 'map', 'child_frame_id': 'base', 'pose': STILL}
    buffer.insert(**given | remedy)
    assert buffer.can_transform('map', 'base', T - S)


@pytest.mark.parametrize(('unit', 'size'), UNITS.items())
@pytest.mark.parametrize(('units', 'is_told'), [(-1, False), (0, True), (60, True), (61, False)])
def test_stamps_in_seconds_are_told(unit, size, units, is_told):
    """They are integers, so that the last one may be almost a unit before the time."""
    time = T + units * size + size // 2
    wrong, right = (TransformBuffer(cache_time=None) for _ in range(2))
    for i in range(62):
        right.insert(T + i * size, 'map', 'base', STILL)
        if i < 61:
            wrong.insert(T // size + i, 'map', 'base', STILL)
    error = error_of(wrong, time)
    assert error.causes == ('stamps_in_seconds',) * is_told
    assert (f'within the data if their stamps are in {unit}. Insert stamps in ns. ' in str(error)
            ) == is_told
    assert not is_told or right.can_transform('map', 'base', time)


@pytest.mark.parametrize('size', UNITS.values())
@pytest.mark.parametrize('child', ['base', 'tool'])
def test_a_lookup_at_the_latest_time_blames_the_stamps(child, size):
    """The caller has passed no time; only the stamps of one edge can be in seconds."""
    wrong, right = TransformBuffer(cache_time=None), TransformBuffer(cache_time=None)
    for i in range(61):
        for parent, frame in (('map', 'base'), ('base', 'tool')):
            right.insert(T + i * S, parent, frame, STILL)
            wrong.insert((T + i * S) // (size if frame == child else 1), parent, frame, STILL)
    error = wrong.why_not('map', 'tool', 0)
    assert f'the newest stamp of {child!r}' in error
    assert 'Insert stamps in ns.' in error
    assert right.can_transform('map', 'tool')


def test_an_edge_that_ended_before_the_other_is_not_in_another_unit():
    """2 s would be 2000 s in microseconds; but simulations begin at 0."""
    buffer = TransformBuffer(cache_time=None)
    for second, parent, child in ((1, 'map', 'base'), (2, 'map', 'base'),
                                  (1000, 'base', 'tool'), (3000, 'base', 'tool')):
        buffer.insert(second * S, parent, child, STILL)
    for time in (0, S, 2 * S):
        assert 'Insert stamps' not in buffer.why_not('map', 'tool', time)
        assert 'Pass times' not in buffer.why_not('map', 'tool', time)


@pytest.mark.parametrize(('zeros', 'nans', 'cause'), [
    (9, 1, '(9): the quaternion is zero'), (1, 9, '(9): a number is NaN')])
def test_the_most_frequent_refusal_is_told(zeros, nans, cause):
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'base', STILL)
    for pose in [(0.0,) * 7] * zeros + [(*STILL[:6], float('nan'))] * nans:
        buffer.insert(T, 'map', 'tool', pose)
    assert f"Transforms of 'tool' were refused {cause}" in buffer.why_not('map', 'tool', 0)


@pytest.mark.parametrize('stamps', [[0], [0, S // 100], [S, 10 * S], [5, 50 * S]])
@pytest.mark.parametrize('time', [S // 2, 20 * S, T])
def test_stamps_since_the_start_are_in_ns(stamps, time):
    """Read in seconds, those of a simulation would be years, and so any time within them."""
    buffer = TransformBuffer(cache_time=None)
    for stamp in stamps:
        buffer.insert(stamp, 'map', 'base', STILL)
    why = buffer.why_not('map', 'base', time)
    assert 'Insert stamps' not in why


@pytest.mark.parametrize(('cache_time', 'kept'), [(10 * S, '10 s'), (10, '10 ns')])
def test_the_cache_time_that_an_error_names_is_long_enough(logs, cache_time, kept):
    """It is in ns, as a TransformBuffer takes it; 10 was meant as seconds."""
    stamps = [T + second * S for second in range(60)]
    for is_warning in False, True:
        buffer = TransformBuffer(cache_time)
        if is_warning:
            assert not buffer.insert_many(stamps, 'map', 'base', [STILL] * 60)
            text = logs[-1].getMessage()
            assert f'more than cache_time, {kept}. ' in text
        else:
            for stamp in stamps:
                buffer.insert(stamp, 'map', 'base', STILL)
            text = str(error_of(buffer, T))
            assert f'The buffer keeps the last {kept} of each frame. ' in text
        (argument,) = re.findall(r' cache_time=([\d_]+) \(ns\)', text)
        longer = TransformBuffer(cache_time=int(argument))
        assert longer.insert_many(stamps, 'map', 'base', [STILL] * 60)
        assert longer.can_transform('map', 'base', T)


def test_what_was_refused_explains_no_other_time(buffer):
    """It is a cause while nothing newer is accepted, and of times near the data."""
    buffer.insert(T - 20 * S, 'map', 'base', STILL)
    assert error_of(buffer, T + S).causes == ('time_goes_back',)
    assert error_of(buffer, T + OTHER_CLOCK + 1).causes == ()
    buffer.insert(T + S, 'map', 'base', STILL)
    assert error_of(buffer, T + 2 * S).causes == ()


@pytest.mark.parametrize(('unit', 'size'), UNITS.items())
def test_a_stamp_in_seconds_that_is_refused_is_told(buffer, unit, size):
    """It is far before the data; of a simulation, it may be right."""
    assert not buffer.insert(T // size, 'map', 'base', STILL)
    error = error_of(buffer, T + S // 2)
    assert error.causes == ('time_goes_back',)
    assert f'Insert stamps in ns, not in {unit}.' in str(error)
    simulated = TransformBuffer()
    for stamp in 100 * S, 100 * S // size:
        simulated.insert(stamp, 'map', 'base', STILL)
    assert 'Insert stamps' not in str(error_of(simulated, 101 * S))


def test_the_memory_of_facts_is_bounded(buffer):
    """8 parents of a frame, and 1000 frames with refused transforms."""
    for i in range(2000):
        buffer.insert(0, f'parent_{i % 20}', 'tool', STILL, is_static=i % 2 == 0)
        buffer.insert(T, 'map', f'bad_{i}', (float('nan'), *STILL[1:]))
    facts = engine_of(buffer).tree.facts(())
    assert len(facts.parents('tool')) <= 9
    assert sum(bool(facts.refusals(f'bad_{i}')) for i in range(2000)) == 1000
    buffer.clear()
    assert not facts.refusals('bad_0')


def test_errors_of_methods_that_take_no_time(buffer):
    """None blames a time."""
    for method, *names in (buffer.chain, 'map', 'bas'), (buffer.remove, 'bas'):
        with pytest.raises(TransformException) as raised:
            method(*names)
        assert raised.value.causes == ()
