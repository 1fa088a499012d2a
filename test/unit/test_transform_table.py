"""transform_tables: the arrays have what `rows` returns for each message."""

from collections import defaultdict
from itertools import islice

from hypothesis import given
from hypothesis import strategies as st
from messages import recorded, written
import numpy as np
import pytest

from puretf._core.pose import Row
from puretf._wire import cdr
from puretf._wire.encoding import CDR, ROS1
from puretf.transform_table import transform_tables

S = 10**9
NAMES = ['a', 'b', '/a', 'long_name', 'é', 'a\0b', '\udc80', '']
FLOATS = st.floats(-10, 10) | st.just(float('nan'))
ROWS = st.lists(st.builds(
    Row, st.integers(0, 4 * S), st.sampled_from(NAMES), st.sampled_from(NAMES),
    st.tuples(*[FLOATS] * 7)), max_size=3)


MESSAGES = st.lists(st.tuples(
    st.integers(0, 3), ROWS, st.booleans(), st.sampled_from('pq'), st.sampled_from('<<<>')),
    max_size=12)


def by_child(found):
    """Group transforms by publisher, topic and child; keep their order."""
    groups = defaultdict(list)
    for publisher, is_static, time, row in found:
        groups[publisher, is_static, row.child_frame_id].append(
            (time, row.stamp_ns, row.frame_id, row.pose))
    return groups


@pytest.mark.parametrize('encoding', [CDR, ROS1])
@given(messages=MESSAGES, repeats=st.integers(1, 3))
def test_as_rows(messages, repeats, encoding):
    """Per publisher, topic and child, the transforms are those of the messages, in order."""
    contents = [
        recorded(time, written(rows, order if encoding is CDR else '<', encoding), is_static,
                 publisher, encoding)
        for time, rows, is_static, publisher, order in messages * repeats]
    errors: list[ValueError] = []
    found = []
    for table in transform_tables(contents, errors.append):
        children = [child for _, child in table.edges]
        assert len({*children}) == len(children)
        assert table.stamps.shape == (len(table.times), len(children))
        for i, time in enumerate(table.times.tolist()):
            for j, edge in enumerate(table.edges):
                found.append((table.publisher, table.is_static, time, Row(
                    int(table.stamps[i, j]), *edge, tuple(table.poses[i, j].tolist()))))
    expected = [(message.publisher, message.is_static, message.time, row)
                for message in contents for row in message.rows()]
    np.testing.assert_equal(by_child(found), by_child(expected))
    assert not errors


def test_many_messages_are_few_tables():
    """Messages with the same frames are one table, also among those with other frames."""
    messages = [recorded(i, cdr.pack([Row(i, 'map', f'frame_{i % 4}', (0.0,) * 7)]))
                for i in range(1000)]
    tables = [*transform_tables(messages)]
    assert [table.edges for table in tables] == [[('map', f'frame_{i}')] for i in range(4)]
    assert [table.times.tolist() for table in tables] == [[*range(i, 1000, 4)] for i in range(4)]


def test_memory_is_bounded():
    """Tables are yielded before all messages are read."""
    data = cdr.pack([Row(0, 'map', f'frame_{i}', (0.0,) * 7) for i in range(100)])
    taken: list[None] = []

    def endless():
        while True:
            taken.append(None)
            yield recorded(1, data)

    for table in islice(transform_tables(endless()), 3):
        assert 2**19 < len(table.times) * len(data) < 2**21
    assert len(taken) * len(data) < 2**22


def test_malformed_messages():
    """Malformed messages are reported, and the messages around them are converted."""
    good = cdr.pack([Row(5, 'map', 'odom', (0.0,) * 7)])
    errors: list[ValueError] = []
    tables = [*transform_tables(
        [recorded(i, data) for i, data in enumerate([good, good[:-1], b'', good, b'\0\7' + good])],
        errors.append)]
    assert sum(len(table.times) for table in tables) == 2
    assert len(errors) == 3


def test_negative_stamps():
    """The seconds of a stamp are signed in ROS 2, and unsigned in ROS 1."""
    message = recorded(1, cdr.pack([Row(-3 * S + 5, 'map', 'odom', (0.0,) * 7)]))
    (table,) = transform_tables([message, message])
    assert table.stamps.tolist() == [[-3 * S + 5]] * 2
    message = recorded(1, written([Row(2**31 * S, 'map', 'odom', (0.0,) * 7)], encoding=ROS1),
                       encoding=ROS1)
    (table,) = transform_tables([message, message])
    assert table.stamps.tolist() == [[2**31 * S]] * 2


def test_a_child_with_two_parents():
    """Its transforms stay in order."""
    messages = [recorded(i, cdr.pack([Row(i, 'ab'[i % 2], 'x', (0.0,) * 7)])) for i in range(4)]
    assert [table.times.tolist() for table in transform_tables(messages)] == [[0], [1], [2], [3]]
