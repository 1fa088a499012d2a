"""Copies of buffers, by copy_of, or by dump and load: they answer as the original does."""

from copy import copy, deepcopy
from functools import partial
import json
import pickle
from typing import cast

from hypothesis import given
from hypothesis import strategies as st
import pytest

from puretf import TransformBuffer, TransformException
from puretf._core.engine import engine_of
from puretf.exceptions import tf2_words

NAMES = 'a', '//a', 'b', '/c', 'd', 'e'
#: Their names in the buffer, without the one slash that is removed, and one that is not known.
FRAMES = 'a', '/a', 'b', 'c', 'd', 'e', 'nobody'
CACHE_TIME, TIMES = 9, range(-7, 10)

inserts = st.tuples(
    st.sampled_from([-5, 0, 3, 8]) | st.integers(-6, 8), st.sampled_from(NAMES),
    st.sampled_from(NAMES), st.floats(0.0, 3.0).map(lambda x: (x, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8)),
    st.sampled_from(['you', 'me']), st.sampled_from([False, False, False, True]))


@st.composite
def buffers(draw):
    """Return a buffer whose frames are re-parented, cleared and removed, in any order."""
    buffer = TransformBuffer(CACHE_TIME)
    for step in draw(st.lists(inserts | inserts | st.sampled_from(['', *FRAMES]), min_size=1,
                              max_size=40)):
        if isinstance(step, tuple):
            buffer.insert(*step)
        elif not step:
            buffer.clear()
        elif step in buffer.frame_names() and step != '/a':
            buffer.remove(step)
    return buffer


def reloaded(buffer):
    """Dump a buffer to JSON, and load it."""
    return TransformBuffer.load(json.loads(json.dumps(buffer.dump())))


def answers(buffer, words, times):
    """Return what all lookups answer: a transform, or the error and its words."""
    found = {}
    for key in ((target, source, time) for target in FRAMES for source in FRAMES
                for time in times):
        try:
            found[key] = buffer.lookup_transform(*key)
        except TransformException as error:
            found[key] = type(error), words(error)
    return found


def about(buffer):
    """Return what a buffer tells of its frames."""
    return (buffer.frames(), buffer.all_frames_as_string(), buffer.all_frames_as_yaml(),
            buffer.frame_names())


@given(buffers())
def test_a_copy_is_as_the_original(buffer):
    """All lookups, the texts of their errors, the frames and the dump are the same."""
    engine_of(buffer).tree.missing_part = 'A part is missing: read it.'  # as of a bag
    other = TransformBuffer.copy_of(buffer)
    assert answers(other, str, TIMES[::4]) == answers(buffer, str, TIMES[::4])
    assert (*about(other), other.dump()) == (*about(buffer), buffer.dump())


@given(buffers())
def test_a_loaded_buffer_is_as_the_original(buffer):
    """What explains errors may differ, since limits and refused transforms are not dumped."""
    other = reloaded(buffer)
    assert answers(other, tf2_words, TIMES) == answers(buffer, tf2_words, TIMES)
    frames, *texts = about(other)
    assert frames == [frame._replace(sender=frame.authority) for frame in buffer.frames()]
    assert (*texts, other.dump()) == (*about(buffer)[1:], buffer.dump())


def buffer_of(*stamps, child='a'):
    """Return a buffer with a frame in map, whose x counts the samples."""
    buffer = TransformBuffer()
    for x, stamp in enumerate(stamps):
        buffer.insert(stamp, 'map', child, (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    return buffer


def test_a_copy_is_its_own():
    """What is inserted into the original later, or cleared, is in the copy as before."""
    buffer = buffer_of(1)
    other = TransformBuffer.copy_of(buffer)
    buffer.insert(11, 'map', 'a', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert other.dump() == buffer_of(1).dump()
    buffer.clear()
    cleared = TransformBuffer.copy_of(buffer)
    buffer.insert(2, 'map', 'a', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert other.can_transform('map', 'a')
    assert not cleared.can_transform('map', 'a')
    with pytest.raises(TypeError, match='buffer must be a buffer of puretf, got None'):
        TransformBuffer.copy_of(cast(TransformBuffer, None))


def test_a_loaded_buffer_keeps_all_samples():
    other = reloaded(buffer_of(5))
    for stamp in 1 - 2**63, 2**63 - 1:
        other.insert(stamp, 'map', 'a', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert other.path_stamps('map', 'a').tolist() == [1 - 2**63, 5, 2**63 - 1]


@pytest.mark.parametrize('protocol', range(pickle.HIGHEST_PROTOCOL + 1))
def test_a_buffer_is_not_pickled(protocol):
    """The error names what can be used."""
    for make in copy, deepcopy, partial(pickle.dumps, protocol=protocol):
        with pytest.raises(TypeError, match=(
                r'^a TransformBuffer can be neither pickled nor copied: use its dump\(\) and '
                r'TransformBuffer.load\(\), or TransformBuffer.copy_of\(\)$')):
            make(buffer_of(1))
