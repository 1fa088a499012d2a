"""Rates and delays of received transforms, on clocks that the tests set."""

from types import SimpleNamespace
from typing import Any

import pytest

from puretf_tools.inspection import traffic as module
from puretf_tools.inspection.traffic import Delays, NodeTraffic, summarize, Summary, Traffic

S, MS = 10**9, 10**6
NOW = 1_700_000_000 * S


class Message:
    """A message as if it had been received; times in ns."""

    def __init__(self, publisher, time, *children, stamp=None, is_static=False):
        self.publisher, self.time, self.is_static = publisher, time, is_static
        self._stamps = dict.fromkeys(children, time if stamp is None else stamp)

    def rows(self):
        """Return the transforms."""
        return [SimpleNamespace(stamp_ns=stamp, frame_id='map', child_frame_id=child)
                for child, stamp in self._stamps.items()]

    def find(self, name):
        """Return where the bytes of a name are; -1: nowhere."""
        return b' '.join(child.encode() for child in self._stamps).find(name)


class Malformed(Message):
    """A message that cannot be decoded."""

    def rows(self):
        """Raise the error of the decoder."""
        raise ValueError


def rows_of(traffic):
    """Return the rows by frame and node; the name of a node is the gid without stars."""
    listener: Any = SimpleNamespace(
        names_of=lambda gids: {gid: gid.rstrip('*') for gid in gids},
        is_present=lambda gid: None if gid == '/unknown' else gid in ('/robot', '/other', '/a'))
    return {(row.frame, row.node): row for row in traffic.by_node(listener)}


@pytest.fixture
def clock():
    """The time of the system, and of the stamps: `clock.system`, `clock.now` (ns)."""
    return SimpleNamespace(system=NOW, now=NOW)


@pytest.fixture
def traffic(clock):
    """Statistics on this clock."""
    return Traffic(lambda: clock.now, system_clock=lambda: clock.system)


def test_delays_over_the_window():
    """Average and maximum cover the last ten seconds only."""
    delays = Delays()
    delays.add(0, 9 * S)
    for i in range(20 * 50):
        delays.add(5 * S + i * 20 * MS, (i % 4) * MS)
    now = 5 * S + 999 * 20 * MS
    summary = summarize([delays], now)
    assert summary is not None
    assert summary.rate == pytest.approx(50.0)
    assert summary.average_delay == pytest.approx(0.0015, abs=1e-5)
    assert summary.maximum_delay == pytest.approx(0.003)
    assert summarize([delays], now + 12 * S) is None
    assert summarize([], now) is None
    assert delays.last == now


def test_one_arrival_has_no_rate():
    """It has a delay, which may be negative."""
    delays = Delays()
    delays.add(5 * S, -MS)
    assert summarize([delays], 5 * S) == Summary(None, -0.001, -0.001)


def test_a_little_out_of_order():
    """Arrivals that two threads add out of order are counted."""
    delays = Delays()
    for arrival in 100 * S, 100 * S - MS, 100 * S + MS:
        delays.add(arrival, MS)
    summary = summarize([delays], 100 * S)
    assert summary is not None
    assert summary.rate == pytest.approx(2000.0)
    assert summary[1:] == (0.001, 0.001)


def test_memory_does_not_grow_with_the_rate():
    """At 1000 Hz, it keeps one item for each second, as at 1 Hz."""
    delays = Delays()
    for i in range(60_000):
        delays.add(i * MS, MS)
    assert len(delays.within(60 * S)) <= 11
    summary = summarize([delays], 60 * S)
    assert summary is not None
    assert summary.rate == pytest.approx(1000.0)


def test_traffic_of_frames_and_of_nodes(clock, traffic):
    """A node may have several publishers; its delay is the mean over each message."""
    for i in range(14):
        received = NOW - 13 * S // 10 + i * 100 * MS
        traffic.observe([
            Message('/robot', received, '/odom', 'base', stamp=received - 4 * MS),
            Message('/other', received, 'cup', '/', stamp=received - (i % 2) * 8 * MS)])
    traffic.observe([Message('/robot*', NOW, 'lidar', is_static=True)])
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
    clock.now += 2 * S
    assert rows_of(traffic)['odom', '/robot'].silence == 2.0


def test_the_time_of_arrival_is_on_the_clock_of_the_stamps(clock, traffic):
    """In simulated time, a delay is the simulated one."""
    clock.now = 100 * S
    traffic.observe([Message('/a', NOW - S, 'odom')])
    traffic.observe([Message('/a', NOW - 2 * MS, 'odom', stamp=100 * S - 5 * MS)])
    assert rows_of(traffic)['odom', '/a'].summary == Summary(None, 0.003, 0.003)


def test_only_one_frame():
    """Messages without its name are not decoded; others are not counted."""
    traffic: Any = Traffic(lambda: NOW, 'odom', lambda: NOW)
    traffic.observe([Malformed('/b', NOW, 'base'), Message('/a', NOW, '/odom', 'odometer'),
                     Message('/a', NOW, 'odometer')])
    assert [*rows_of(traffic)] == [('odom', '/a'), ('', '/a')]


def test_each_frame_has_the_delay_of_its_own_stamp(traffic):
    """This also holds after a frame without a name in the same message."""
    traffic.observe([Message('/a', NOW - S, 'odom')])
    message: Any = Message('/a', NOW, '/', 'odom', 'base')
    rows = message.rows()
    for row, late in zip(rows, (3, 1, 2)):
        row.stamp_ns = NOW - late * S
    message.rows = lambda: rows
    traffic.observe([message])
    for frame, delay in ('odom', 1.0), ('base', 2.0), ('', 2.0):
        assert rows_of(traffic)[frame, '/a'].summary.average_delay == delay


def test_messages_that_waited_for_the_discovery_are_not_late(traffic):
    """The first messages of a publisher may have waited for the discovery: they have no delay."""
    traffic.observe([Message('/a', NOW + i, 'odom', stamp=NOW - S) for i in range(5)])
    assert rows_of(traffic)['odom', '/a'] == NodeTraffic('odom', '/a', False, True, None, None)
    # The delay of a publisher whose clock is an hour behind is counted, too.
    traffic.observe([Message('/a', NOW + 300 * MS, 'odom', stamp=NOW - 3600 * S)])
    assert rows_of(traffic)['odom', '/a'].summary.maximum_delay == 3600.3


def test_the_number_of_known_publishers_is_bounded(monkeypatch, traffic):
    """Of many publishers, the most recent ones are known, so that their delays are counted."""
    monkeypatch.setattr(module, '_MOST_PUBLISHERS', 10)

    def observe(i, late):
        traffic.observe([Message(f'/{i}', NOW + late, f'frame_{i}', stamp=NOW)])
        return rows_of(traffic)[f'frame_{i}', f'/{i}'].summary

    for i in range(100):
        assert observe(i, 0) is None
    assert observe(95, 300 * MS) is not None
    assert observe(5, 300 * MS) is None  # it is forgotten, and settles again


def test_the_number_of_streams_is_bounded(monkeypatch, traffic):
    """Of too many, the first ones are counted."""
    monkeypatch.setattr(module, '_MOST', 3)
    traffic.observe([Message('/a', NOW, *(f'frame_{i}' for i in range(10)))])
    assert len(rows_of(traffic)) == 3


def test_a_name_that_is_too_long_is_not_counted(traffic):
    """The buffer does not insert such a frame, either."""
    traffic.observe([Message('/a', NOW, 'x' * 10**6, 'odom')])
    assert [*rows_of(traffic)] == [('odom', '/a'), ('', '/a')]


def test_time_that_is_set_back(clock, traffic):
    """Earlier statistics are discarded; messages that were in transit then are not counted."""
    clock.now = 1000 * S

    def observe(stamp):
        traffic.observe([Message('/a', clock.system, 'odom', stamp=stamp)])

    observe(1000 * S)
    clock.system += 250 * MS
    late = Message('/a', clock.system, 'odom', stamp=1000 * S)
    observe(1000 * S)
    assert rows_of(traffic)['odom', '/a'].summary == Summary(None, 0.0, 0.0)
    clock.now = 5 * S
    clock.system += MS
    assert rows_of(traffic)['odom', '/a'] == NodeTraffic('odom', '/a', False, True, None, None)
    traffic.observe([late])
    assert rows_of(traffic)['odom', '/a'].summary is None
    observe(5 * S)
    assert rows_of(traffic)['odom', '/a'].summary == Summary(None, 0.0, 0.0)


def test_a_clock_that_does_not_run(clock, traffic):
    """Dynamic transforms are not shown as static; they have no delay."""
    clock.now = 0
    traffic.observe([Message('/a', NOW + i * S, 'odom') for i in range(3)])
    assert rows_of(traffic)['odom', '/a'] == NodeTraffic('odom', '/a', False, True, None, None)


def test_malformed_messages_are_skipped(traffic):
    """They are skipped, since the listener logs them; empty ones do no harm."""
    traffic.observe([Malformed('/a', NOW), Message('/a', NOW), Message('/a', NOW, 'odom')])
    assert ('odom', '/a') in rows_of(traffic)


def test_a_publisher_that_is_gone(traffic):
    """Its rows stay; they are not present."""
    traffic.observe([Message('/gone', NOW, 'odom')])
    assert not rows_of(traffic)['odom', '/gone'].is_present
