"""The statistics of messages are those of plain Python."""

from itertools import pairwise
from statistics import median

from hypothesis import example, given
from hypothesis import strategies as st
from messages import recorded
import numpy as np
import pytest

from puretf._wire import cdr
from puretf.transform_table import transform_tables, TransformTable
from puretf_tools.doctor.tf_statistics import Statistics
from puretf_tools.inspection.stamp_clock import StampClock

bags = pytest.importorskip('bags')
S = bags.S
T = 1_700_000_000 * S


def reference(content):
    """Return the statistics of a frame, computed in plain Python from (arrival, stamp, pose)."""
    stamps = [stamp for _, stamp, _ in content]
    steps = [b - a for a, b in pairwise(filter(None, stamps))]
    norms = [sum(v * v for v in pose[3:]) ** 0.5 for _, _, pose in content]
    known = [(arrival - stamp, stamp) for arrival, stamp, _ in content if stamp]
    return {
        'count': len(content), 'zero_stamps': stamps.count(0),
        'backwards': sum(step < 0 for step in steps),
        'step_back': max([-step for step in steps if step < 0], default=0),
        # Not if only the norm differs.
        'changes': sum(a[1] == b[1] != 0 and a[2][:6] != b[2][:6] for a, b in pairwise(content)),
        'unnormalized': sum(abs(norm - 1.0) > 1e-3 for norm in norms),
        'oldest': min([stamp for _, stamp in known], default=0),
        'latest': max([stamp for _, stamp in known], default=0),
        'delays': len(known),
        'late': sum(S // 2 < delay <= 60 * S for delay, _ in known),
        'future': sum(-60 * S <= delay < -S // 10 for delay, _ in known),
        'least_delay': min([delay for delay, _ in known], default=None),
        'greatest_delay': max([delay for delay, _ in known], default=None)}


TENTHS = st.integers(0, 30).map(lambda tenth: tenth * S // 10)
POSES = st.sampled_from([
    bags.STILL, (1.0, *bags.STILL[1:]), (0.0, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8),
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.1)])


def test_a_clock_that_comes_late():
    """All arrivals are on the clock that is known in the end."""
    clock = StampClock()
    clock.is_simulated = True
    statistics = Statistics(clock=clock)

    def count(i):
        statistics.add_messages([recorded(
            T + i * S, cdr.pack([bags.row(100 * S, 'map', 'odom', bags.STILL)]))])

    count(0)
    count(1)
    for i in 2, 3:
        clock.add(T + i * S, (100 + i) * S)
        count(i)
    (track,) = statistics.tracks()
    assert (track['first_time'], track['last_time']) == (100 * S, 103 * S)
    assert (track['delays'], track['least_delay'], track['greatest_delay']) == (4, 0, 3 * S)
    clock.is_simulated = False
    count(4)
    (track,) = statistics.tracks()
    assert (track['count'], track['delays'], track['foreign']) == (5, 5, 5)
    assert track['first_time'] == T


@given(st.lists(st.tuples(TENTHS, TENTHS, POSES), min_size=1, max_size=30),
       st.lists(st.integers(1, 30), max_size=3))
@example([(0, stamp * S, bags.STILL) for stamp in (4, 1, 3, 2)], [2])
def test_statistics(content, ends):
    """The statistics are those of plain Python, however the messages are divided into tables."""
    content = sorted(((T + arrival, T + stamp if stamp else 0, pose)
                      for arrival, stamp, pose in content), key=lambda each: each[0])
    statistics = Statistics()
    begin = 0
    for end in [*sorted(ends), len(content)]:
        for table in transform_tables(
                recorded(arrival, cdr.pack([bags.row(stamp, 'map', 'odom', pose)]))
                for arrival, stamp, pose in content[begin:end]):
            statistics.add(table)
        begin = max(begin, end)
    (track,) = statistics.tracks()
    expected = reference(content)
    if not expected['delays']:
        del expected['least_delay'], expected['greatest_delay']
    assert {name: int(track[name]) for name in expected} == expected


@given(st.lists(st.integers(1, 10**11), min_size=1, max_size=200))
def test_steps(steps):
    """Those of the stamps, whose median is the period."""
    statistics = Statistics()
    stamps = np.cumsum([T, *steps])
    statistics.add(TransformTable('', False, [('map', 'odom')], stamps, stamps[:, None], np.tile(
        np.array(bags.STILL), (len(stamps), 1, 1))))
    (track,) = statistics.tracks()
    assert (track['steps'], track['period'], track['largest_step'][0]) == (
        len(steps), median(steps), max(steps))


def test_too_many_frames():
    """Frames beyond the limit are counted as such, and memory is bounded."""
    statistics = Statistics()
    rows = [bags.row(T, 'map', f'frame_{i}', bags.STILL) for i in range(10_010)]
    for table in transform_tables([recorded(T, cdr.pack(rows))]):
        statistics.add(table)
    assert (statistics.count, statistics.not_counted) == (10_000, 10)
