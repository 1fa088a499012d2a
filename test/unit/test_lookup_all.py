"""lookup_all: the poses of all frames in one frame, compared with single lookups."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from puretf import InvalidArgumentException, LookupException, TransformBuffer, TransformException

S = 10**9
T = 1_700_000_000 * S
NAMES = 'abcdefg'

#: Transforms: the indices of child and parent, tenths of a second after T, is_static, and x (m).
INSERTS = st.lists(st.tuples(
    st.integers(1, len(NAMES) - 1), st.integers(0, len(NAMES) - 1), st.integers(0, 30),
    st.sampled_from([False, False, False, True]), st.floats(-2, 2)), min_size=8, max_size=40)


def pose(x):
    """Return a pose that is different for each x."""
    length = (1 + x * x) ** 0.5
    return x, 1.0, -x, 0.0, x / length, 0.0, 1 / length


def by_lookups(buffer, target, until):
    """Return the transforms of all frames, each by a lookup of its own."""
    found = {}
    for name in buffer.frame_names():
        try:
            latest = buffer.get_latest_common_time(target, name)
            time = min(latest, until) if until else latest
            found[name] = buffer.lookup_transform(target, name, time)
        except TransformException:
            continue
    return found


@given(INSERTS, st.sampled_from(NAMES), st.sampled_from([0, T, T + S, T + 15 * S // 10]))
def test_as_lookups(inserts, target, until):
    """The result is that of single lookups, for equal and different stamps and static edges."""
    buffer = TransformBuffer()
    parents: dict[int, int] = {}  # frames change them only if there is no limit of time
    known: set[str] = set()
    for child, parent, tenth, is_static, x in inserts:
        parent %= child
        if until:
            parent = parents.setdefault(child, parent)
        buffer.insert(T + tenth * S // 10, NAMES[parent], NAMES[child], pose(x),
                      is_static=is_static)
        known |= {NAMES[parent], NAMES[child]}
    if target not in known:
        with pytest.raises(LookupException):
            buffer.lookup_all([target], until)
        return
    placed = buffer.lookup_all([target], until)[0]
    expected = by_lookups(buffer, target, until)
    assert placed.keys() == expected.keys()
    for name, transform in placed.items():
        assert transform.matrix() == pytest.approx(expected[name].matrix(), abs=1e-12)
        if not until:
            assert transform[:3] == expected[name][:3]


def test_a_frame_that_changed_its_parent():
    """A frame is placed at the latest common time of its path, below the parent of that time."""
    buffer = TransformBuffer()
    for i in range(11):
        buffer.insert(T + i * S, 'map', 'left', pose(i / 10))
        buffer.insert(T + i * S, 'map', 'right', pose(-i / 10))
        buffer.insert(T + i * S, 'left' if i < 6 else 'right', 'hand', pose(0.5))
    buffer.insert(T + 3 * S, 'hand', 'tool', pose(0.2))
    for until in 0, T + 2 * S, T + 5 * S, T + 8 * S:
        (placed,), expected = buffer.lookup_all(['map'], until), by_lookups(buffer, 'map', until)
        assert [*placed] == [
            'map', 'left', 'right', 'hand', *(['tool'] if until != T + 2 * S else [])]
        for name, transform in placed.items():
            assert transform.matrix() == pytest.approx(expected[name].matrix(), abs=1e-12)


def test_only_what_is_connected_and_known():
    """Frames of other trees, of loops, and without data up to the given time are left out."""
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'odom', pose(1), is_static=True)
    buffer.insert(T + S, 'odom', 'base', pose(1))
    buffer.insert(T, 'world', 'tree', pose(1))
    buffer.insert(T, 'x', 'y', pose(1))
    buffer.insert(T, 'y', 'x', pose(1))
    assert [*buffer.lookup_all(['map'])[0]] == ['map', 'odom', 'base']
    assert [*buffer.lookup_all(['base'])[0]] == ['base', 'odom', 'map']
    assert [*buffer.lookup_all(['map'], T)[0]] == ['map', 'odom']
    assert [*buffer.lookup_all(['tree'], T)[0]] == ['tree', 'world']
    assert [*buffer.lookup_all(['x'])[0]] == ['x', 'y']


def test_only_over_some_edges():
    """Frames that are connected only by other edges are left out, in both directions."""
    buffer = TransformBuffer()
    for parent, child in ('map', 'odom'), ('odom', 'base'), ('base', 'hand'), ('map', 'post'):
        buffer.insert(T, parent, child, pose(1))
    assert [*buffer.lookup_all(['map'], children=['odom', 'hand'])[0]] == ['map', 'odom']
    up, down = buffer.lookup_all(['hand', 'map'], children={'hand', 'base', 'post'})
    assert [*up] == ['hand', 'base', 'odom']
    assert [*down] == ['map', 'post']


def test_no_such_frame():
    """An unknown or invalid target frame raises the same exception as in a single lookup."""
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'odom', pose(1))
    with pytest.raises(LookupException, match=r"does not exist\. Nearest known: 'odom'"):
        buffer.lookup_all(['odon'])
    with pytest.raises(InvalidArgumentException, match='cannot start with'):
        buffer.lookup_all(['/map'])
    with pytest.raises(TypeError, match="must be names in a list or another iterable, got 'map'"):
        buffer.lookup_all('map')
