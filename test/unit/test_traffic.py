"""Rates and delays of received transforms, on clocks that the tests set."""

from types import SimpleNamespace
from typing import Any

from messages import recorded
import pytest

from puretf import Frame
from puretf._core.pose import Row
from puretf._wire import cdr
from puretf_tools.inspection.stamp_clock import StampClock
from puretf_tools.inspection.traffic import NodeTraffic, rate, rate_of, Summary, Traffic

S, MS = 10**9, 10**6
NOW = 1_700_000_000 * S


def message(publisher, time, *children, stamp=None, is_static=False):
    """Return a message as if it had been received; times in ns, `stamp`: one or one for each."""
    stamps = stamp if isinstance(stamp, list) else [
        time if stamp is None else stamp] * len(children)
    return recorded(time, cdr.pack([
        Row(each, 'map', child, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
        for child, each in zip(children, stamps)]), is_static, publisher)


def rows_of(traffic, frame=None):
    """Return the rows by frame and node; the name of a node is the gid without stars."""
    listener: Any = SimpleNamespace(
        names_of=lambda gids: {gid: gid.rstrip('*') for gid in gids},
        is_present=lambda gid: None if gid == '/unknown' else gid.rstrip('*') in (
            '/robot', '/other', '/a'))
    return {(row.frame, row.node): row for row in traffic.by_node(listener, frame)}


class Clock(StampClock):
    """A clock that the tests set: `system_time`, and `time` of the stamps (ns)."""

    system_time = time = NOW

    def __init__(self):
        """Begin at NOW."""
        super().__init__(lambda: self.system_time)

    def at(self, arrivals):
        """Convert times of the system clock (ns)."""
        return arrivals + self.time - self.system_time if self.time else None


@pytest.fixture
def clock():
    """The time of the system, and of the stamps."""
    return Clock()


@pytest.fixture
def traffic(clock):
    """Statistics on this clock."""
    return Traffic(clock)


@pytest.mark.parametrize(('count', 'first', 'last', 'hertz'), [
    (11, 10**9, 2 * 10**9, 10.0), (2, 0, 4 * 10**9, 0.25), (3, 10**9, 10**9, None),
    (1, 10**9, 10**9, None)])
def test_the_rate(count, first, last, hertz):
    """It is that of the steps, of which there is one less; None if there is no time between."""
    assert rate(count, first, last) == hertz
    assert rate_of(Frame('a', 'map', '/node', False, count, last, first)) == hertz


def test_delays_over_the_window(clock, traffic):
    """Average and maximum cover the last ten seconds only."""
    traffic.observe([message('/a', NOW, 'odom', stamp=NOW - 9 * S)])
    for i in range(20 * 50):
        clock.time = clock.system_time = NOW + 5 * S + i * 20 * MS
        traffic.observe([message('/a', clock.time, 'odom', stamp=clock.time - (i % 4) * MS)])
    summary = rows_of(traffic)['odom', '/a'].summary
    assert summary.rate == pytest.approx(50.0)
    assert summary.average_delay == pytest.approx(0.0015, abs=1e-5)
    assert summary.maximum_delay == pytest.approx(0.003)
    clock.time = clock.system_time = clock.time + 12 * S
    assert rows_of(traffic)['odom', '/a'].summary is None
    assert rows_of(traffic)['odom', '/a'].silence == 12.0


def test_one_arrival_has_no_rate(traffic):
    """It has a delay, which may be negative."""
    traffic.observe([message('/a', NOW - S, 'odom')])
    traffic.observe([message('/a', NOW, 'odom', stamp=NOW + MS)])
    assert rows_of(traffic)['odom', '/a'].summary == Summary(None, -0.001, -0.001)


def test_messages_that_were_received_long_ago_do_not_count(traffic):
    """As when nobody has looked at the page for a while."""
    traffic.observe([message('/a', NOW - 60 * S + i * S, 'odom', stamp=0) for i in range(49)])
    assert rows_of(traffic) == {}


def test_traffic_of_frames_and_of_nodes(clock, traffic):
    """A node may have several publishers; its delay is the mean over each message."""
    for i in range(14):
        received = NOW - 13 * S // 10 + i * 100 * MS
        traffic.observe([
            message('/robot', received, '/odom', 'base', stamp=received - 4 * MS),
            message('/other', received, 'cup', '/', stamp=received - (i % 2) * 8 * MS)])
    traffic.observe([message('/robot*', NOW, 'lidar', is_static=True)])
    found = rows_of(traffic)
    assert [*found] == [('base', '/robot'), ('cup', '/other'), ('lidar', '/robot'),
                        ('odom', '/robot'), ('', '/other'), ('', '/robot')]
    assert found['lidar', '/robot'].is_static
    for frame, node, tolerance in (('odom', '/robot', 1e-9), ('base', '/robot', 1e-9),
                                   ('', '/robot', 1e-9), ('', '/other', 2e-3)):
        rate, average, _ = found[frame, node].summary
        assert rate == pytest.approx(10.0)
        assert average == pytest.approx(0.004, abs=tolerance)
    assert found['odom', '/robot'].summary.maximum_delay == 0.004
    assert found['cup', '/other'].summary.maximum_delay == 0.008
    assert not found['', '/robot'].is_static
    assert found['', '/robot'].silence == 0.0
    clock.time += 2 * S
    assert rows_of(traffic)['odom', '/robot'].silence == 2.0


def test_the_time_of_arrival_is_on_the_clock_of_the_stamps(clock, traffic):
    """In simulated time, a delay is the simulated one."""
    clock.time = 100 * S
    traffic.observe([message('/a', NOW - S, 'odom')])
    traffic.observe([message('/a', NOW - 2 * MS, 'odom', stamp=100 * S - 5 * MS)])
    assert rows_of(traffic)['odom', '/a'].summary == Summary(None, 0.003, 0.003)


def test_only_one_frame(traffic):
    """Its rows are those among all."""
    traffic.observe([message('/b', NOW, 'base'), message('/a', NOW, '/odom', 'odometer')])
    assert [*rows_of(traffic, 'odom')] == [('odom', '/a')]


def test_each_frame_has_the_delay_of_its_own_stamp(traffic):
    """This also holds after a frame without a name in the same message."""
    traffic.observe([message('/a', NOW - S, 'odom')])
    traffic.observe([message('/a', NOW, '/', 'odom', 'base', stamp=[
        NOW - late * S for late in (3, 1, 2)])])
    for frame, delay in ('odom', 1.0), ('base', 2.0), ('', 2.0):
        assert rows_of(traffic)[frame, '/a'].summary.average_delay == delay


def test_two_publishers_of_one_node(traffic, clock):
    """They are counted while both send, as when a program is started twice."""
    for second, *names in (0, '/a', '/a*'), (1, '/a', '/a*'), (15, '/a'):
        clock.system_time = clock.time = NOW + second * S
        traffic.observe([message(name, clock.time, 'odom') for name in names])
        assert rows_of(traffic)['odom', '/a'].senders == (len(names) if second else 0)


def test_messages_that_waited_for_the_discovery_are_not_late(traffic):
    """The first messages of a publisher may have waited for the discovery: they have no delay."""
    traffic.observe([message('/a', NOW + i, 'odom', stamp=NOW - S) for i in range(5)])
    assert rows_of(traffic)['odom', '/a'] == NodeTraffic(
        'odom', '/a', False, True, None, None, senders=0)
    # The delay of a publisher whose clock is an hour behind is counted, too.
    traffic.observe([message('/a', NOW + 300 * MS, 'odom', stamp=NOW - 3600 * S)])
    assert rows_of(traffic)['odom', '/a'].summary.maximum_delay == 3600.3


def test_the_number_of_streams_is_bounded(monkeypatch, traffic):
    """Of too many, the first ones are counted."""
    monkeypatch.setattr('puretf_tools.inspection.traffic._MOST_STREAMS', 3)
    traffic.observe([message('/a', NOW, *(f'frame_{i}' for i in range(10)))])
    assert len(rows_of(traffic)) == 3


def test_a_name_that_is_too_long_is_not_counted(traffic):
    """The buffer does not insert such a frame, either."""
    traffic.observe([message('/a', NOW, 'x' * 10**6, 'odom')])
    assert [*rows_of(traffic)] == [('odom', '/a'), ('', '/a')]


def test_time_that_is_set_back(clock, traffic):
    """Earlier statistics are discarded; messages that were in transit then are not counted."""
    clock.time = 1000 * S

    def observe(stamp):
        traffic.observe([message('/a', clock.system_time, 'odom', stamp=stamp)])

    observe(1000 * S)
    clock.system_time += 250 * MS
    late = message('/a', clock.system_time, 'odom', stamp=1000 * S)
    observe(1000 * S)
    assert rows_of(traffic)['odom', '/a'].summary == Summary(None, 0.0, 0.0)
    clock.time = 5 * S
    clock.system_time += MS
    assert rows_of(traffic)['odom', '/a'] == NodeTraffic(
        'odom', '/a', False, True, None, None, senders=0)
    traffic.observe([late])
    assert rows_of(traffic)['odom', '/a'].summary is None
    observe(5 * S)
    assert rows_of(traffic)['odom', '/a'].summary == Summary(None, 0.0, 0.0)


def test_a_clock_that_does_not_run(clock, traffic):
    """Dynamic transforms are not shown as static; they have no delay."""
    clock.time = 0
    traffic.observe([message('/a', NOW + i * S, 'odom') for i in range(3)])
    assert rows_of(traffic)['odom', '/a'] == NodeTraffic(
        'odom', '/a', False, True, None, None, senders=0)


def test_malformed_messages_are_skipped(traffic):
    """They are skipped, since the listener logs them; empty ones do no harm."""
    traffic.observe([recorded(NOW, b'x', publisher='/a'), message('/a', NOW),
                     message('/a', NOW, 'odom')])
    assert ('odom', '/a') in rows_of(traffic)


def test_a_publisher_that_is_gone(traffic):
    """Its rows stay; they are not present, or that is not known."""
    traffic.observe([message(each, NOW, 'odom') for each in ('/gone', '/unknown')])
    assert [row.is_present for row in rows_of(traffic, 'odom').values()] == [False, None]
