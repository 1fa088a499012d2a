"""The command `tf2_monitor`: rates and delays of frames and nodes, paths, missing transforms."""

import re
import signal
import time
from types import SimpleNamespace
from typing import Any, Optional

from conftest import ARM, run_in_terminal, tool
import pytest
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from dummy_arm.inspection.traffic import Delays, Stream, summarize, Summary, Traffic
from dummy_arm.tf import StaticTransformBroadcaster, TransformBroadcaster
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._ros.transform_stamped import message_of
from dummy_arm.tf._wire import cdr
from dummy_arm.tf.exceptions import LookupException
from dummy_arm.tf.publisher_listener import ReceivedMessage
from dummy_arm.tools.tf2_monitor import Chain, format_streams, main

S, MS = 10**9, 10**6
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def received_message(gid, received, *edges: tuple[str, str], stamp=None, is_static=False):
    """Return a message as if it had been received; times in ns."""
    message = ReceivedMessage(cdr.pack(
        Row(received if stamp is None else stamp, *edge, STILL) for edge in edges))
    message.publisher, message.time, message.is_static = gid, received, is_static
    return message


def streams_of(traffic):
    """Return the streams by frame and node; the name of a node is the gid without stars."""
    return {(stream.frame, stream.node): stream for stream in traffic.streams(
        lambda gids: {gid: gid.rstrip('*') for gid in gids}, ['/robot', '/other', '/a'])}


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


def test_traffic_of_frames_and_of_nodes():
    """A node may have several publishers; its delay is the mean over each message."""
    traffic = Traffic(time.time_ns)
    now = time.time_ns()
    for i in range(14):
        received = now - 13 * S // 10 + i * 100 * MS
        traffic.observe([
            received_message('/robot', received, ('map', '/odom'), ('odom', 'base'),
                             stamp=received - 4 * MS),
            received_message('/other', received, ('map', 'cup'), ('map', '/'),
                             stamp=received - (i % 2) * 8 * MS)])
    traffic.observe([received_message('/robot*', now, ('base', 'lidar'), is_static=True)])
    found = streams_of(traffic)
    assert [*found] == [('base', '/robot'), ('cup', '/other'), ('lidar', '/robot'),
                        ('odom', '/robot'), ('', '/other'), ('', '/robot')]
    assert found['lidar', '/robot'].is_static
    for key in ('odom', '/robot'), ('base', '/robot'), ('', '/robot'), ('', '/other'):
        assert found[key].summary.rate == pytest.approx(10.0)
        assert found[key].summary.average_delay == pytest.approx(0.004, abs=2e-3)
    assert found['odom', '/robot'].summary.maximum_delay == pytest.approx(0.004, abs=2e-3)
    assert found['cup', '/other'].summary.maximum_delay == pytest.approx(0.008, abs=2e-3)
    assert not found['', '/robot'].is_static


def test_each_frame_has_the_delay_of_its_own_stamp():
    """This also holds after a frame without a name in the same message."""
    traffic = Traffic(time.time_ns)
    now = time.time_ns()
    traffic.observe([received_message('/a', now - S, ('map', 'odom'))])
    message = ReceivedMessage(cdr.pack([Row(now - late * S, 'map', child, STILL)
                              for child, late in (('/', 3), ('odom', 1), ('base', 2))]))
    message.publisher, message.time = '/a', now
    traffic.observe([message])
    for frame, late in ('odom', 1.0), ('base', 2.0), ('', 2.0):
        assert streams_of(traffic)[frame, '/a'].summary.average_delay == pytest.approx(
            late, abs=1e-2)


def test_messages_that_waited_for_the_discovery_are_not_late():
    """The first messages of a publisher may have waited for the discovery: they have no delay."""
    traffic = Traffic(time.time_ns)
    now = time.time_ns()
    old = [received_message('/a', now + i, ('map', 'odom'), stamp=now - S) for i in range(5)]
    traffic.observe(old)
    found = streams_of(traffic)['odom', '/a']
    assert found == Stream('odom', '/a', False, True, None, None)
    # The delay of a publisher whose clock is an hour behind is counted, too.
    traffic.observe([
        received_message('/a', now + 300 * MS, ('map', 'odom'), stamp=now - 3600 * S)])
    assert streams_of(traffic)['odom', '/a'].summary.maximum_delay == pytest.approx(3600.3, 1e-3)


def test_the_number_of_known_publishers_is_bounded(monkeypatch):
    """Of many publishers, the most recent ones are known, so that their delays are counted."""
    monkeypatch.setattr('dummy_arm.inspection.traffic._MOST_PUBLISHERS', 10)
    traffic = Traffic(time.time_ns)
    now = time.time_ns()
    for i in range(100):
        for late in 0, 300 * MS:
            traffic.observe([
                received_message(f'/{i}', now + late, ('map', f'frame_{i}'), stamp=now)])
    assert len(traffic._since) == 10
    found = streams_of(traffic)
    assert all(found[f'frame_{i}', f'/{i}'].summary for i in range(100))


def test_time_that_is_set_back():
    """Earlier statistics are discarded; messages that were in transit then are not counted."""
    times, system = [1000 * S], [1_700_000_000 * S]
    traffic = Traffic(lambda: times[0], system_clock=lambda: system[0])

    def observe(stamp):
        traffic.observe([received_message('/a', system[0], ('map', 'odom'), stamp=stamp)])

    observe(1000 * S)
    system[0] += 250 * MS
    late = received_message('/a', system[0], ('map', 'odom'), stamp=1000 * S)
    observe(1000 * S)
    assert streams_of(traffic)['odom', '/a'].summary.rate is None
    times[0] = 5 * S
    system[0] += MS
    assert streams_of(traffic)['odom', '/a'] == Stream('odom', '/a', False, True, None, None)
    traffic.observe([late])
    assert streams_of(traffic)['odom', '/a'].summary is None
    observe(5 * S)
    assert streams_of(traffic)['odom', '/a'].summary.maximum_delay == pytest.approx(0, abs=1e-2)


def test_the_net_delay_after_time_was_set_back():
    """Old data do not count; new data count, also if they come when the old time has passed."""
    now = 100 * S
    common: Optional[int] = now

    def latest(*_):
        if common is None:
            raise LookupException('not connected')
        return Time(nanoseconds=common)

    listener: Any = SimpleNamespace(
        now=lambda: now, buffer=SimpleNamespace(get_latest_common_time=latest))
    chain = Chain(listener, ('map', 'robot'))

    def delays():
        chain.sample()
        summary = summarize([chain._ages], now)
        return summary and (summary.average_delay, summary.maximum_delay)

    assert delays() == (0.0, 0.0)
    now = 50 * S
    assert delays() is None  # the buffer still has the data of before
    common = None
    now = 90 * S
    assert delays() is None
    now, common = 103 * S, 102 * S
    assert delays() == (1.0, 1.0)


def test_a_clock_that_does_not_run():
    """Dynamic transforms are not shown as static; they have no delay."""
    traffic = Traffic(lambda: 0)
    traffic.observe([
        received_message('/a', time.time_ns() + i * S, ('map', 'odom')) for i in range(3)])
    assert streams_of(traffic)['odom', '/a'] == Stream('odom', '/a', False, True, None, None)


def test_malformed_messages_are_skipped():
    """Malformed messages are skipped, since the listener logs them; empty ones do no harm."""
    traffic = Traffic(time.time_ns)
    bad = ReceivedMessage(b'\0\1\0\0\7')
    traffic.observe([bad, received_message('/a', 1),
                     received_message('/a', time.time_ns(), ('map', 'odom'))])
    assert ('odom', '/a') in streams_of(traffic)


def test_lines():
    """The columns of the table fit the longest name; unusual streams are marked."""
    moving = Summary(50.04, 0.00123449, 0.25)
    assert format_streams([
        Stream('base_link', '/arm', True, True, None, None),
        Stream('base_link', '/before', True, False, None, None),
        Stream('joint\n1', '/arm', False, True, moving, 0.01),
        Stream('joint\n1', '/before', False, False, moving, 0.01),
        Stream('tool', '/arm', False, True, moving, 0.01),
        Stream('tool', '/b', False, True, moving, 0.01),
        Stream('tool', '/silent', False, True, None, 71.26),
        Stream('tool', '/uncounted', False, True, None, None),
        Stream('', '/arm', False, True, Summary(None, -1000000.5, 12345678.25), 0.01)]) == [
        'Warning: tool is published by /arm and /b; a frame should have one publisher',
        '',
        'Frames:           rate   average delay     max delay  published by',
        '  base_link     static                                /arm',
        '  base_link     static                                /before (gone)',
        '  joint\\n1     50.0 Hz      0.001234 s    0.250000 s  /arm',
        '  joint\\n1     50.0 Hz      0.001234 s    0.250000 s  /before (gone)',
        '  tool         50.0 Hz      0.001234 s    0.250000 s  /arm',
        '  tool         50.0 Hz      0.001234 s    0.250000 s  /b',
        '  tool                      last received 71.3 s ago  /silent',
        '  tool                                                /uncounted',
        '',
        'All Broadcasters:       rate   average delay     max delay  node',
        '                        ? Hz -1000000.500000 s 12345678.250000 s  /arm']


def test_a_long_name_is_abbreviated_and_moves_only_its_own_line():
    """The columns of the other lines are as they would be without the long name."""
    name = 'x' * 3000
    short = f'{"x" * 49}...{"x" * 48}'
    streams = [Stream('base', '/arm', True, True, None, None),
               Stream('\x1b' * 3000, '/arm', True, True, None, None),
               Stream(name, f'/{name}', True, True, None, None),
               Stream(name, '/arm', True, True, None, None)]
    lines = format_streams(streams)
    assert lines[0] == (f'Warning: {short} is published by /{"x" * 48}...{"x" * 48} and /arm; '
                        'a frame should have one publisher')
    assert lines[3] == f'  base      static{"":30}  /arm'
    assert lines[5] == f'  {short}     static{"":30}  /{"x" * 48}...{"x" * 48}'
    assert len(lines[4]) == 2 + len('...') + 97 * len('\\x1b') + 41 + len('  /arm')


@pytest.mark.parametrize('arguments', [('map',), ('map', ''), ('/', 'odom')])
def test_wrong_use(failed, arguments):
    """The exit code is 2, and the error is one line."""
    assert failed(main, *arguments) == (
        2, 'tf2_monitor: give two frames, or none to monitor all frames\n')


def test_the_arm(start):
    """It prints the rates of all frames and nodes; with two frames, those on their path."""
    start(*ARM)
    every = start(*tool('tf2_monitor'))
    chain = start(*tool('tf2_monitor', 'map', '/joint_2'))
    every.line_with('RESULTS: for all frames, over the last 10 s')
    for process in every, chain:
        while not re.search(r'  joint_2  +\d+\.\d Hz.*/dummy_arm\n', process.output):
            assert process.line(), process.output
        for _ in range(3):  # the first rates are of few messages
            process.line_with('RESULTS')
        assert re.search(r'  base_link  +static  +/dummy_arm\n', process.output)
        rates = [float(rate) for rate in re.findall(
            r'  joint_2  +(\d+\.\d) Hz +-?0\.\d{6} s +0\.\d{6} s  /dummy_arm\n', process.output)]
        assert 25.0 < rates[-1] < 60.0  # the rate is 50 Hz, less on a busy machine
        assert re.search(r'\n +\d+\.\d Hz +-?0\.\d{6} s +0\.\d{6} s  /dummy_arm\n', process.output)
    assert '  end_effector ' in every.output
    assert '  end_effector ' not in chain.output.partition('Chain is')[2]
    assert 'Chain is: map -> base_link -> joint_1 -> joint_2\n' in chain.output
    assert re.search(r'Net delay     avg = -?0\.\d{6} s: max = 0\.\d{6} s\n', chain.output)
    for process in every, chain:
        process.end(signal.SIGINT)
        assert process.exit_code() == 0
        assert 'Traceback' not in process.output


def test_late_transforms(start, ros):
    """A node in a namespace publishes 0.25 s late; the net delay of the path is as large."""
    node = Node('late', namespace='/robot', context=ros.context)
    ros.executor.add_node(node)
    broadcaster = TransformBroadcaster(node)

    def send():
        stamp = node.get_clock().now().nanoseconds - S // 4
        broadcaster.sendTransform(message_of(Row(stamp, 'map', 'odom', STILL)))

    node.create_timer(0.05, send)
    process = start(*tool('tf2_monitor', 'map', 'odom'))
    ros.until(lambda: re.search(
        r'  odom  +\d+\.\d Hz +0\.2[5-9]\d{4} s +0\.\d{6} s  /robot/late\n', process.output))
    ros.until(lambda: re.search(r'Net delay     avg = 0\.[23]\d{5} s: max = 0\.[2-9]\d{5} s\n',
                                process.output))
    node.destroy_node()


def test_it_continues_when_something_is_missing(start, ros):
    """It prints what is missing, and continues; a static path has no delay."""
    process = start(*tool('tf2_monitor', 'map', 'robot'))
    ros.until(lambda: 'No transform has been received yet. Publishers on ' in process.output)
    broadcaster = StaticTransformBroadcaster(ros.node)
    broadcaster.sendTransform(message_of(Row(0, 'map', 'robo', STILL)))
    ros.until(lambda: (
        'Waiting for transform map ->  robot: Invalid frame ID "robot" passed to canTransform '
        'argument source_frame - frame does not exist. Frames here, the nearest names first: '
        "'robo', 'map'.\n" in process.output))
    for parent, expected in (
            ('map', 'Chain is: map -> robot\nNet delay     none: all transforms are static, or '
                    'the time is not known\n'),
            ('moon', 'not part of the same tree'), ('map', 'Chain is: ')):
        before = len(process.output)
        broadcaster.sendTransform(message_of(Row(0, parent, 'robot', STILL)))
        ros.until(lambda expected=expected, before=before: expected in process.output[before:])
    assert 'Traceback' not in process.output


def test_two_nodes_that_publish_one_frame(start, ros):
    """It prints a warning, as long as both nodes exist."""
    other = Node('other', context=ros.context)
    for node in ros.node, other:
        StaticTransformBroadcaster(node).sendTransform(message_of(Row(0, 'map', 'odom', STILL)))
    process = start(*tool('tf2_monitor'))
    ros.until(lambda: 'Warning: odom is published by /other and /test; a frame should have one '
              'publisher\n' in process.output)
    before = len(process.output)
    other.destroy_node()
    gone = re.compile(r'  odom +static +/other \(gone\)\n')
    ros.until(lambda: gone.search(process.output, before))
    results = process.output[before:].split('RESULTS')
    assert 'Warning' not in next(filter(gone.search, results))


def test_in_place_on_a_terminal(ros):
    """The output is cut off at the size of the terminal: 80 columns and 24 lines."""
    StaticTransformBroadcaster(ros.node).sendTransform(
        [message_of(Row(0, 'map', f'frame_{i:02}_{"long" * 20}', STILL)) for i in range(30)])
    written = run_in_terminal(
        ros.context.get_domain_id(), *tool('tf2_monitor'),
        until=lambda written: written.count('frame_05') > 1)
    first, second = [screen.splitlines() for screen in written.split('\x1b[H\x1b[2J')
                     if 'frame_05' in screen][:2]
    for lines in first, second:
        assert len(lines) <= 23
        assert max(map(len, lines)) <= 80
    assert first[0] == 'RESULTS: for all frames, over the last 10 s'
    assert first[-1] == '... 14 more lines (pipe the output to see all)'  # there are 36 lines


def test_sim_time_that_is_set_back(start, ros):
    """Earlier statistics are discarded, also those of the path."""
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    broadcaster = TransformBroadcaster(ros.node)
    begin, wall = 1000.0, time.monotonic()

    def tick():
        now = Time(seconds=begin + time.monotonic() - wall)
        clock.publish(Clock(clock=now.to_msg()))
        names, late = (['odom', 'old'], 0.8) if begin == 1000.0 else (['odom'], 0.0)
        stamp = now - Duration(seconds=late)
        broadcaster.sendTransform([
            message_of(Row(stamp.nanoseconds, 'map', name, STILL)) for name in names])

    ros.node.create_timer(0.02, tick)
    process = start(*tool('tf2_monitor', '--ros-args', '-p', 'use_sim_time:=true'))
    chain = start(*tool('tf2_monitor', 'map', 'odom', '--ros-args', '-p', 'use_sim_time:=true'))
    ros.until(lambda: re.search(r'  old +\d+\.\d Hz', process.output)
              and re.search(r'Net delay     avg = (0\.[5-9]|1\.)', chain.output))
    begin, wall = 5.0, time.monotonic()
    before, chain_before = len(process.output), len(chain.output)
    ros.until(lambda: process.output[before:].count('RESULTS') > 3
              and chain.output[chain_before:].count('RESULTS') > 3)
    last = process.output.rpartition('RESULTS')[0].rpartition('RESULTS')[2]
    assert re.search(r'  odom +\d+\.\d Hz +-?0\.[0-4]\d{5} s +-?0\.[0-4]\d{5} s  /test\n', last)
    assert re.search(r'  old +/test\n', last)
    last = chain.output.rpartition('RESULTS')[0].rpartition('RESULTS')[2]
    assert re.search(r'Net delay     avg = -?0\.[0-4]\d{5} s: max = -?0\.[0-4]\d{5} s\n', last)


def test_without_a_clock(start):
    """It prints a warning, and no delay."""
    start(*ARM)
    process = start(
        *tool('tf2_monitor', 'map', 'joint_1', '--ros-args', '-p', 'use_sim_time:=true'))
    process.line_with('Warning: use_sim_time is set, but no message has arrived on /clock')
    process.line_with('Net delay     none: all transforms are static, or the time is not known')
    while not re.fullmatch(r'  joint_1 +/dummy_arm\n', process.line_with('joint_1 ')):
        pass


def test_messages_that_arrive_too_fast_are_reported(start):
    """The warning has the number of messages that are not counted: the rates are too low then."""
    start(*ARM)
    _, code = tool('tf2_monitor')
    process = start('-c', f'from dummy_arm.tf import publisher_listener; '
                    f'publisher_listener._MOST_MESSAGES = 1; {code}')
    line = process.line_with('messages arrived too fast')
    assert re.fullmatch(r'Warning: [1-9]\d* messages arrived too fast to be counted\n', line)


def test_nowhere_to_print(start):
    """A closed stdout is no error."""
    _, code = tool('tf2_monitor')
    process = start('-c', f'import os; os.close(1); {code}')
    time.sleep(2.5)
    process.end(signal.SIGINT)
    assert process.exit_code() == 0
    assert not process.output
