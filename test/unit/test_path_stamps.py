"""`path_stamps`, compared with a search of the path at each stamp."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from puretf import ConnectivityException, LookupException, TransformBuffer

S = 10**9
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
NAMES = 'abcdef'


def buffer_of(*edges):
    """Return a buffer; an edge is the parent, the child, and the stamps (s), or None: static."""
    buffer = TransformBuffer(10**6 * S)
    for parent, child, stamps in edges:
        for stamp in stamps or [0.0]:
            buffer.insert(round(stamp * S), parent, child, STILL, is_static=stamps is None)
    return buffer


def stamps_of(buffer, target, source):
    """Return the stamps in s."""
    return [stamp / S for stamp in buffer.path_stamps(target, source).tolist()]


def test_a_loop_is_no_path():
    """It is not followed forever; frames on the loop have a path."""
    buffer = buffer_of(('a', 'b', [1.0]), ('b', 'a', [2.0]), ('c', 'd', [3.0]))
    assert stamps_of(buffer, 'a', 'b') in ([1.0], [2.0])
    with pytest.raises(ConnectivityException):
        buffer.path_stamps('c', 'a')


def test_errors():
    """They are those of a lookup."""
    buffer = buffer_of(('map', 'base', [1.0]), ('earth', 'moon', [1.0]))
    with pytest.raises(ConnectivityException, match="between 'map' and 'moon'"):
        buffer.path_stamps('map', 'moon')
    with pytest.raises(LookupException, match=r"source_frame does not exist.* 'base'"):
        buffer.path_stamps('map', 'bose')
    with pytest.raises(TypeError):
        buffer.path_stamps('map', None)
    buffer.clear()
    with pytest.raises(ConnectivityException):
        buffer.path_stamps('map', 'base')


def test_the_buffer_can_grow_afterwards():
    """The result is a copy: an array that numpy uses cannot grow."""
    buffer = buffer_of(('map', 'base', [1.0]))
    stamps = buffer.path_stamps('map', 'base')
    buffer.insert(2 * S, 'map', 'base', STILL)
    assert stamps.tolist() == [S]


def searched(dump, target, source):
    """Return the stamps, by a search of the path at each of them."""
    def parent(name, time):
        """Return the parent at a time, or at the nearest one; None of a root."""
        samples = dump[name]
        if not samples['stamps']:
            return None
        if samples['is_static']:
            return samples['parents'][0]
        earlier = [i for i, stamp in enumerate(samples['stamps']) if stamp <= time]
        return samples['parents'][earlier[-1] if earlier else 0]

    def ancestors(name, time):
        chain = [name]
        while (name := parent(name, time)) is not None:
            chain.append(name)
        return chain

    found = set()
    for name, samples in dump.items():
        for stamp in [] if samples['is_static'] else samples['stamps']:
            up, down = ancestors(source, stamp), ancestors(target, stamp)
            if up[-1] == down[-1] and (name in up) != (name in down):
                found.add(stamp)
    return sorted(found)


@given(st.lists(st.tuples(
    st.integers(1, len(NAMES) - 1), st.integers(0, len(NAMES) - 1), st.integers(-3, 30),
    st.sampled_from([False] * 5 + [True])), min_size=8, max_size=40),
    st.sampled_from(NAMES), st.sampled_from(NAMES))
def test_as_searched(inserts, target, source):
    """Frames change their parents at any time, and become static or dynamic."""
    buffer = TransformBuffer(10**6 * S)
    for child, parent, stamp, is_static in inserts:
        buffer.insert(stamp, NAMES[parent % child], NAMES[child], STILL, is_static=is_static)
    dump = buffer.dump()
    if target not in dump or source not in dump:
        with pytest.raises(LookupException):
            buffer.path_stamps(target, source)
        return
    expected = searched(dump, target, source)
    try:
        assert buffer.path_stamps(target, source).tolist() == expected
    except ConnectivityException:
        assert not expected
