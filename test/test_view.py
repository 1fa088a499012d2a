"""The parts of web_view behind its page: snapshots, rods, trails, texts, ports and requests."""

import asyncio
from contextlib import ExitStack
import errno
from itertools import pairwise
from pathlib import Path
import re
import socket
from types import SimpleNamespace
from typing import Optional
from urllib.request import urlopen

from conftest import TIMEOUT, tool, tool_without, tool_without_ros
import numpy as np
import pytest

from dummy_arm.tf import BufferCore
from dummy_arm.view import snapshot as snapshot_module
from dummy_arm.view import source as player_module
from dummy_arm.view.rods import fading, rods
from dummy_arm.view.snapshot import FrameWatcher
from dummy_arm.view.source import Player, Publication
from dummy_arm.view.view import Trail

S = 10**9
T = 1_700_000_000 * S
HALF = 0.5 ** 0.5


def pose(x, y=0.0, z=0.0, rotation=(0.0, 0.0, 0.0, 1.0)):
    """Return a pose."""
    return x, y, z, *rotation


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test sets: `clock[0]` (s)."""
    now = [1000.0]
    for module in snapshot_module, player_module:
        monkeypatch.setattr(module, 'monotonic', lambda: now[0])
    return now


def arm(buffer, stamp, *names):
    """Insert a chain of frames, each 1 m along x from the one before it."""
    for parent, child in pairwise(names):
        buffer.insert(stamp, parent, child, pose(1.0))


def test_what_is_shown():
    """All trees are shown, the largest in its root and others beside it, but no loops."""
    buffer = BufferCore()
    snapshot = FrameWatcher(buffer).snapshot()
    assert (snapshot.fixed, snapshot.deepest) == ('', '')
    assert (len(snapshot.names), snapshot.poses.shape, snapshot.ages.shape) == (0, (0, 7), (0,))
    arm(buffer, T, 'world', 'tree')
    arm(buffer, T, 'map', 'odom', 'base')
    arm(buffer, T, 'map', 'other')
    arm(buffer, T, 'x', 'y', 'x')
    arm(buffer, T, 'y', 'below')
    snapshot = FrameWatcher(buffer).snapshot()
    assert snapshot.fixed == 'map'
    assert snapshot.names == ['map', 'odom', 'other', 'base', 'world', 'tree']
    assert snapshot.parents == [-1, 0, 0, 1, -1, 4]
    assert snapshot.points.tolist() == [
        [0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [0, -2, 0], [1, -2, 0]]
    assert snapshot.poses[:, :3].tolist() == [
        [0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0], [1, 0, 0]]
    assert snapshot.deepest == 'base'
    assert snapshot.trees == {'map': 0.0, 'world': -2.0}
    assert [sorted(loop) for loop in snapshot.loops] == [['x', 'y']]
    assert snapshot.anchor_of('tree') == ('world', -2.0)
    snapshot = FrameWatcher(buffer).snapshot('odom')
    assert dict(zip(snapshot.names, snapshot.points[:, 0])) == {
        'odom': 0, 'map': -1, 'base': 1, 'other': 0, 'world': 0, 'tree': 1}
    assert snapshot.deepest == 'base'  # the same as before: ties are not broken by chance
    assert snapshot.anchor_of('map') == ('odom', 0.0)
    assert FrameWatcher(buffer).snapshot('nowhere').fixed == 'map'
    assert FrameWatcher(buffer).snapshot('below').fixed == 'map'  # a loop


def test_ages_live(clock):
    """A frame is as old as the stalest edge on its path; a root as its youngest descendant."""
    buffer = BufferCore()
    watcher = FrameWatcher(buffer)
    buffer.insert(T, 'map', 'base', pose(1.0), is_static=True)
    arm(buffer, T, 'base', 'upper', 'hand')
    arm(buffer, T, 'world', 'tree')
    watcher.snapshot()
    clock[0] += 10.0
    arm(buffer, T + S, 'upper', 'hand')
    snapshot = watcher.snapshot()
    assert dict(zip(snapshot.names, snapshot.ages)) == {
        'map': 0.0, 'base': 0.0, 'upper': 10.0, 'hand': 10.0, 'world': 10.0, 'tree': 10.0}
    snapshot = watcher.snapshot('hand')
    assert dict(zip(snapshot.names, snapshot.ages)) == {
        'hand': 0.0, 'upper': 0.0, 'base': 10.0, 'map': 10.0, 'world': 10.0, 'tree': 10.0}
    arm(buffer, T + S, 'base', 'upper')
    assert not watcher.snapshot('map').ages[:4].any()


def test_ages_in_a_bag():
    """Ages count from the time that is shown, also in a gap of the data."""
    buffer = BufferCore(10**18)
    for second in 0, 1, 2, 8, 9:
        arm(buffer, T + second * S, 'map', 'base')
    watcher = FrameWatcher(buffer)
    assert watcher.snapshot('', T - S).names == []
    for second, age in (0, 0.0), (2, 0.0), (5, 3.0), (8, 0.0), (12, 3.0):
        snapshot = watcher.snapshot('', T + second * S)
        assert snapshot.ages.tolist() == [age, age]
        assert snapshot.frames['base'].latest == T + min(second, 9) * S - (3 * S if age == 3.0 and
                                                                        second == 5 else 0)


def test_frames_of_a_time():
    """The frames at a time have the parents and the samples that were known by then."""
    buffer = BufferCore()
    for second, parent in enumerate(['left', 'left', 'right', 'right']):
        buffer.insert(T + second * S, parent, 'hand', pose(1.0))
    buffer.insert(T, 'map', 'left', pose(1.0), is_static=True)

    def known(until):
        return [(frame.name, frame.parent, frame.length, frame.latest)
                for frame in buffer.frames(until)]

    assert known(T - 1) == [('left', 'map', 1, 0)]
    assert known(T + S) == [('hand', 'left', 2, T + S), ('left', 'map', 1, 0)]
    assert known(T + 5 * S // 2) == [('hand', 'right', 3, T + 2 * S), ('left', 'map', 1, 0)]
    assert known(0) == known(T + 9 * S) == [('hand', 'right', 4, T + 3 * S),
                                            ('left', 'map', 1, 0)]


FAR = [(1e7, 0.0, 0.0), (-1e200, 1e200, 0.0), (1e308, 1e308, -1e308), (0.0, -1e154, 3.0),
       (3e5, 4e5, -1e9), (-1.7e308, 0.0, 1.0)]


@pytest.mark.parametrize('place', FAR)
def test_what_is_far_is_drawn_nearer(place):
    """It is drawn at 1000 km in the same direction, but its pose is not changed."""
    buffer = BufferCore()
    buffer.insert(T, 'map', 'near', pose(6e5, 8e5))
    buffer.insert(T, 'map', 'far', pose(*place))
    buffer.insert(T, 'x', 'y', pose(*place))
    snapshot = FrameWatcher(buffer).snapshot()
    assert snapshot.far == ['far', 'y']
    assert snapshot.points[snapshot.names.index('near')].tolist() == [6e5, 8e5, 0.0]
    i, y = map(snapshot.names.index, ('far', 'y'))
    assert snapshot.poses[i, :3].tolist() == snapshot.poses[y, :3].tolist() == [*place]
    direction = np.array(place) / np.abs(place).max()
    assert np.linalg.norm(snapshot.points[[i, y]], axis=1) == pytest.approx(1e6)
    for point in snapshot.points[[i, y]]:  # the trees lie 2 m beside each other
        assert point == pytest.approx(1e6 * direction / np.linalg.norm(direction), abs=2.0)


def test_what_is_not_finite_is_not_drawn():
    """Such frames are listed with their descendants, of which none is drawn."""
    buffer = BufferCore()
    for parent, child, x in (('map', 'base', 1.0), ('map', 'lost', float('inf')),
                             ('lost', 'below', 1.0), ('map', 'a', 1e308), ('a', 'b', 1e308)):
        buffer.insert(T, parent, child, pose(x))
    snapshot = FrameWatcher(buffer).snapshot()
    assert {*snapshot.names} == {'map', 'base', 'a'}
    assert {*snapshot.not_finite} == {'lost', 'below', 'b'}


def test_rods():
    """Each frame has rods along its x, y and z axes, and one to its parent."""
    buffer = BufferCore()
    buffer.insert(T, 'map', 'a', pose(0.0, 0.0, 2.0, (0.0, 0.0, HALF, HALF)))
    buffer.insert(T, 'a', 'b', pose(1.0, 2.0, 2.0))
    buffer.insert(T, 'a', 'c', pose(0.0, 0.0, 0.0))
    snapshot = FrameWatcher(buffer).snapshot()
    drawn = rods(snapshot, 0.5, 'b')
    count = len(snapshot.names)
    assert len(drawn.positions) == len(drawn.colors) == 4 * count
    w, x, y, z = drawn.wxyzs.T  # each rod ends on the z axis of its rotation
    ends = drawn.positions + drawn.scales[:, 2:] * np.column_stack(
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    begins = dict(zip(snapshot.names, drawn.positions[:count]))
    for k, axis in enumerate(([0.0, 0.5, 0.0], [-0.5, 0.0, 0.0], [0.0, 0.0, 0.5])):
        i = snapshot.names.index('a') + k * count
        assert ends[i] - drawn.positions[i] == pytest.approx(axis, abs=1e-6)
    for i, name in enumerate(snapshot.names):
        parent = {'a': 'map', 'b': 'a', 'c': 'a'}.get(name, name)
        assert ends[3 * count + i] == pytest.approx(begins[parent], abs=1e-6)
    radii = dict(zip(snapshot.names, drawn.scales[:count, 0]))
    assert radii['b'] > radii['a'] == radii['c'] > 0.0


def test_fading_as_in_rviz():
    """Of 15 s a frame keeps its colour for a third, then turns grey, and then vanishes."""
    colourfulness, thickness = fading(np.array([0.0, 5.0, 7.5, 10.0, 12.5, 15.0, 99.0]))
    assert colourfulness == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0])
    assert thickness == pytest.approx([1.0, 1.0, 1.0, 1.0, 0.5, 0.0, 0.0])


def test_a_trail():
    """The trail covers the last 20 s in any fixed frame, however often it is drawn."""
    buffer = BufferCore(60 * S)
    often, seldom = Trail(buffer), Trail(buffer)
    for i in range(3001):
        buffer.insert(T + i * S // 100, 'map', 'hand', pose(i / 100, 1.0))
        if i % 3 == 0:
            lines = often.draw('map', 'hand', T + i * S // 100, np.array([i / 100, 1.0, 0.0]))
    for trail in lines, seldom.draw('map', 'hand', T + 30 * S, np.array([30.0, 1.0, 0.0])):
        assert trail.shape[0] > 300
        assert (trail[1:, 0] == trail[:-1, 1]).all()
        assert 10.0 <= trail[0, 0, 0] < 10.1
        assert trail[-1, 1].tolist() == [30.0, 1.0, 0.0]
        assert np.ptp(trail[..., 1]) == 0.0
        assert np.diff(trail[:, 0, 0]).max() < 0.1
    back = often.draw('hand', 'map', T + 30 * S, np.array([-30.0, -1.0, 0.0]))
    assert back[-1, 1].tolist() == [-30.0, -1.0, 0.0]
    assert often.draw('map', 'hand', T + S, np.array([1.0, 1.0, 0.0]))[-1, 1].tolist() == [1, 1, 0]
    assert not len(often.draw('map', 'still', 0, np.zeros(3)))


def test_a_player(clock):
    """The player follows the clock, pauses, seeks, and starts again after the end."""
    buffer = BufferCore(10**18)
    for second in 0, 4:
        arm(buffer, T + second * S, 'map', 'base')
    player = Player(buffer.frames())
    assert player.length == 4.0
    clock[0] += 1.5
    player.advance(True)
    assert (player.position, player.time) == (1.5, T + 3 * S // 2)
    clock[0] += 1.0
    player.advance(False)
    assert player.position == 1.5
    player.seek(3.9)
    clock[0] += 1.0
    player.advance(True)
    assert (player.position, player.is_at_end) == (4.0, True)
    player.advance(True)
    assert player.position == 0.0
    player.seek(99.0)
    assert player.time == T + 4 * S
    still = Player([])
    still.advance(True)
    assert (still.length, still.time) == (0.0, 1)


class StubSource:
    """A source with the same facts about every frame."""

    name = '/tf'
    player: Optional[Player] = None

    def __init__(self, buffer, publication):
        """Create a source of a buffer, with the facts about its frames."""
        self.buffer, self._publication = buffer, publication

    def publication(self, frame):
        """Return the facts, whatever the frame is."""
        return self._publication

    def other_topics_hint(self):
        """Return a hint."""
        return 'other <topics>'

    def why_no_frames(self):
        """Return a reason."""
        return 'because'


def test_texts():
    """Names cannot inject HTML, and problems are reported."""
    from dummy_arm.view.details import details, overview
    buffer = BufferCore()
    source = StubSource(buffer, Publication(50.04, 0.00123, '/<i>'))
    assert 'no frames yet. because' in overview(FrameWatcher(buffer).snapshot(), source)
    arm(buffer, T, 'map', '<script>', 'b')
    arm(buffer, T, 'x\n', 'y', 'x\n')
    arm(buffer, T, 'w"orld', 'tree')
    snapshot = FrameWatcher(buffer).snapshot()
    text = overview(snapshot, source)
    assert '/tf: 5 frames' in text
    assert 'not connected to map: w&quot;orld' in text
    assert 'in a loop: ' in text
    assert 'other &lt;topics&gt;' in text
    assert '→ x\\n' in text
    text = details(snapshot, 'b', source)
    assert '<b data-value="parent">&lt;script&gt;</b>' in text
    assert '<td data-value="rate">50.0 Hz</td>' in text
    assert '<td data-value="delay">1.23 ms</td>' in text
    assert '<td data-value="publisher">/&lt;i&gt;</td>' in text
    assert f'{T // S}.000000000 s' in text
    buffer.clear()
    text = details(snapshot, 'b', source)  # as after a jump of time or a long pause
    assert 'parent' in text
    assert 'nan' not in text
    assert 'the fixed frame &lt;b&gt; is not available' in overview(snapshot, source, '<b>')
    assert '&lt;i&gt; is not available.' in details(snapshot, '<i>', source)
    assert 'Click a frame' in details(snapshot, '', source)
    text = details(snapshot, 'map', source)
    assert 'no parent: this is a root' in text
    assert '<b data-value="fixed">map</b>' in text


def test_texts_of_what_is_far():
    """The panel lists frames that are far, with their real numbers, until they vanish."""
    from dummy_arm.view.details import details, overview
    buffer = BufferCore()
    source = StubSource(buffer, Publication(None, None, ''))
    buffer.insert(T, 'map', 'near', pose(1.0))
    assert 'away' not in overview(FrameWatcher(buffer).snapshot(), source)
    buffer.insert(T, 'map', '<far>', pose(1e7, -2.5))
    buffer.insert(T, '<far>', 'tip', pose(1.0))
    buffer.insert(T, 'map', 'lost', pose(float('inf')))
    snapshot = FrameWatcher(buffer).snapshot()
    text = overview(snapshot, source)
    assert 'more than 1,000,000 m away, drawn at that distance: &lt;far&gt;, tip<' in text
    assert 'not shown, since the translation is not finite: lost<' in text
    assert '-translation">10000000.000  -2.500  0.000<' in details(snapshot, '<far>', source)
    text = details(snapshot, 'tip', source)
    assert '"parent-translation">1.000  0.000  0.000<' in text
    assert '"fixed-translation">10000001.000  -2.500  0.000<' in text
    snapshot = snapshot._replace(ages=np.full(len(snapshot.names), 20.0))
    assert 'away' not in overview(snapshot, source)


@pytest.fixture
def bag(tmp_path):
    """The path of a short bag."""
    bags = pytest.importorskip('bags')
    return str(bags.make(tmp_path / 'bag', 'mcap', bags.walk(1)))


def test_an_address_that_is_none(failed, bag):
    """It is refused in one line that says what is accepted."""
    pytest.importorskip('viser')
    from dummy_arm.tools.web_view import main
    for host in '', '..', '192.0.2.1':
        code, error = failed(main, '--bag', bag, '--host', host)
        assert code == 2
        assert len(error.splitlines()) == 1
        assert '--host takes' in error


def test_no_free_port(monkeypatch):
    """The error names the ports that are in use."""
    pytest.importorskip('viser')
    from dummy_arm.cli.parser import CommandError
    from dummy_arm.view import server

    monkeypatch.setattr(socket.socket, 'bind', refusing(errno.EADDRINUSE))
    with (pytest.raises(CommandError, match=r'ports 8080 to 8179 of 127\.0\.0\.1 are all in use'),
          server.serve('127.0.0.1')):
        pass


def refusing(number):
    """Return a function that raises an OSError with an error number."""
    def refuse(*_):
        raise OSError(number, 'refused')
    return refuse


def test_the_next_free_port(capsys):
    """Two pages without --port are served at two ports."""
    pytest.importorskip('viser')
    from dummy_arm.view.server import serve
    with serve('127.0.0.1') as one, serve('127.0.0.1') as other:
        ports = [one.get_port(), other.get_port()]
    assert ports[0] != ports[1]  # in any order, since other tests use such ports, too
    assert min(ports) >= 8080
    assert capsys.readouterr().out.splitlines() == [
        f'look at http://127.0.0.1:{port}' for port in ports]


def test_a_port_that_is_given(start, monkeypatch):
    """The page is served there, whatever viser's environment variables are."""
    monkeypatch.setenv('_VISER_PORT_OVERRIDE', '1')
    port = free_port()
    process = start(*tool('web_view', '--port', str(port)))
    assert process.line() == f'look at http://127.0.0.1:{port}\n'
    with urlopen(f'http://127.0.0.1:{port}', timeout=TIMEOUT) as answer:
        assert answer.status == 200


def free_port():
    """Return a port that is not in use."""
    with socket.create_server(('127.0.0.1', 0)) as found:
        return found.getsockname()[1]


def test_a_port_that_is_taken(failed, bag):
    """It is an error, and no other port is used instead."""
    pytest.importorskip('viser')
    from dummy_arm.tools.web_view import main
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        assert failed(main, '--bag', bag, '--port', str(port)) == (
            1, f'web_view: port {port} of 127.0.0.1 is in use: end the program that uses it, '
            'choose another port, or leave out --port to take the next free one\n')


@pytest.mark.parametrize('text', ['0', '-1', '65536', '8080.0', '80_80', ' 80', '', 'http', '٣',
                                  '9' * 5000])
def test_a_port_that_is_none(failed, text):
    """It is refused in one line that states the limits."""
    from dummy_arm.tools.web_view import main
    code, error = failed(main, '--port', text)
    assert code == 2
    assert len(error.splitlines()) == 1
    assert 'from 1 to 65535' in error


def test_a_port_that_needs_root(failed, monkeypatch, bag):
    """The error blames the port, not the address."""
    pytest.importorskip('viser')
    from dummy_arm.tools.web_view import main
    monkeypatch.setattr(socket.socket, 'bind', refusing(errno.EACCES))
    code, error = failed(main, '--bag', bag, '--port', '80')
    assert code == 1
    assert error == ('web_view: cannot serve at port 80 of 127.0.0.1: Permission denied; '
                     'without root, --port must be at least 1024\n')


def test_address_lines():
    """A line warns of other viewers, unless only this machine can reach the page."""
    pytest.importorskip('viser')
    from dummy_arm.view.server import address_lines
    assert address_lines('127.0.0.1', 8080) == ['look at http://127.0.0.1:8080']
    assert address_lines('::1', 8080) == ['look at http://[::1]:8080']
    assert address_lines('0.0.0.0', 8081) == [
        'look at http://localhost:8081',
        f'everybody who can reach port 8081 of {socket.gethostname()} can look at the page and '
        'use the panel']
    assert address_lines('192.0.2.1', 8080)[0] == 'look at http://192.0.2.1:8080'


OWN = '127.0.0.1:8080'


@pytest.mark.parametrize(('host', 'origin'), [
    (OWN, None), (OWN, f'http://{OWN}'), (OWN, f'HTTP://{OWN}'), ('localhost:1', None),
    ('LocalHost:8080', 'http://localhost:8080'), ('localhost', 'http://localhost:80'),
    ('127.1.2.3:8080', 'http://127.1.2.3:8080'), ('[::1]:8080', 'http://[::1]:8080'),
])
def test_own_pages_are_served(host, origin):
    """A request is accepted if it names this machine, and no other origin."""
    assert refused([host], [origin] if origin else []) == ''


@pytest.mark.parametrize(('host', 'origin'), [
    ('evil.example:8080', None), ('127.0.0.1.evil.example:8080', None), ('127.evil.example', None),
    ('127.0.0.1.:8080', None), ('127.1:8080', None), ('localhost.evil.example', None),
    ('192.0.2.1:8080', None), ('0.0.0.0:8080', None), ('[::2]:8080', None),
    ('127.0.0.1.evil.example', 'http://127.0.0.1.evil.example'),
    (OWN, f'https://{OWN}'), (OWN, 'http://evil.example'), (OWN, 'http://127.0.0.1'),
    (OWN, 'http://127.0.0.1:8081'), (OWN, 'http://localhost:8080'), (OWN, 'null'), (OWN, ''),
    (OWN, OWN), (OWN, f'http://{OWN}/'), (OWN, f'http://{OWN}?'), (OWN, f'http://me@{OWN}'),
    (OWN, 'http://127.0.0.1:http'), (OWN, 'http://127.0.0.1:99999'), (OWN, 'http://[::1'),
    ('', None), (':8080', None), ('localhost:x', None),
    ('localhost:0', 'http://localhost'), ('localhost:99999', None), ('[::1', None), ('[]', None),
    ('me@localhost', None), ('localhost/evil', None), ('evil#localhost', None),
])
def test_other_hosts_and_origins_are_refused(host, origin):
    """No other site that is open in the browser can use the page, by whatever name."""
    why = refused([host], [origin] if origin is not None else [])
    assert len(why.encode().splitlines()) == 1


@pytest.mark.parametrize(('hosts', 'origins'), [
    ([], []), ([OWN, OWN], []), ([OWN], [f'http://{OWN}'] * 2),
])
def test_missing_and_repeated_headers_are_refused(hosts, origins):
    """It would not be clear which of them the browser means."""
    assert 'one Host header' in refused(hosts, origins)


def test_a_page_for_all_is_served_under_any_name():
    """The names of the machine are not known, but other origins are refused nevertheless."""
    assert refused(['robot:8080'], ['http://robot:8080'], is_loopback=False) == ''
    assert refused(['robot:8080'], ['http://evil.example'], is_loopback=False)


def refused(hosts, origins, is_loopback=True):
    """Return `why_refused` for the headers of a request."""
    pytest.importorskip('viser')
    from websockets import Headers

    from dummy_arm.view.server import why_refused
    return why_refused(Headers([*(('Host', host) for host in hosts),
                                *(('Origin', origin) for origin in origins)]), is_loopback)


def test_a_refused_request_is_answered_by_403():
    """This holds for pages and WebSockets, with headers of any bytes."""
    pytest.importorskip('viser')
    from dummy_arm.view.server import serve
    with serve('127.0.0.1') as server:
        own = f'127.0.0.1:{server.get_port()}'.encode()
        socket_headers = (b'Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13'
                          b'\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n')

        def status(*headers, upgrade=b''):
            with socket.create_connection(('127.0.0.1', server.get_port())) as connection:
                connection.sendall(b'GET / HTTP/1.1\r\n%s%s\r\n' % (
                    upgrade, b''.join(header + b'\r\n' for header in headers)))
                with connection.makefile('rb') as answer:
                    return answer.readline().split()[1]

        for upgrade, accepted in (b'', b'200'), (socket_headers, b'101'):
            assert status(b'Host: ' + own, upgrade=upgrade) == accepted
            assert status(b'host: ' + own, b'ORIGIN: http://' + own, upgrade=upgrade) == accepted
            for headers in (
                    (), (b'Host: 127.0.0.1.evil.example',), (b'Host: ' + own, b'Host: ' + own),
                    (b'Host: [::1',), (b'Host: localhost:x',), (b'Host: \xff\xfe',),
                    (b'Host: ' + own, b'Origin: http://evil.example'),
                    (b'Host: ' + own, b'Origin: https://' + own),
                    (b'Host: ' + own, b'Origin: http://[::1'),
                    (b'Host: ' + own, b'Origin: http://127.0.0.1:99999'),
                    (b'Host: ' + own, b'Origin: \xff'),
                    (b'Host: ' + own, *[b'Origin: http://' + own] * 2)):
                assert status(*headers, upgrade=upgrade) == b'403', headers


def test_a_viser_that_cannot_be_guarded(monkeypatch):
    """The error names a version that can be, and nothing is served."""
    viser = pytest.importorskip('viser')
    import websockets.asyncio.server

    from dummy_arm.cli.parser import CommandError
    from dummy_arm.view.server import serve
    servers = []

    class Serve(websockets.asyncio.server.serve):
        """An unguarded class, to which viser keeps a reference; it records its servers."""

        async def __aenter__(self):
            servers.append(await super().__aenter__())
            return servers[-1]

    module = SimpleNamespace(**vars(websockets))
    module.asyncio = SimpleNamespace(server=SimpleNamespace(serve=Serve))
    monkeypatch.setattr(viser.infra._infra, 'websockets', module)
    with (pytest.raises(CommandError, match=(
            rf'^viser {re.escape(viser.__version__)} does not start its server by websockets.*: '
            r"pip install 'viser>=1\.1,<1\.2'$")), serve('127.0.0.1')):
        pass
    assert [server.is_serving() for server in servers] == [False]


def test_the_viser_of_an_error_is_that_of_setup_py():
    """The error recommends the version that is installed with the package."""
    pytest.importorskip('viser')
    from dummy_arm.view.viser_private import VISER
    assert f"'view': ['{VISER}', " in (Path(__file__).parent.parent / 'setup.py').read_text()


class Sent:
    """An update of a control by a viewer, as viser passes it to callbacks."""

    client_id = 1

    def __init__(self, target):
        """Create an update of a control."""
        self.target = target


@pytest.fixture
def view(capsys):
    """A function that creates the view of a source: `view(source)`."""
    pytest.importorskip('viser')
    from dummy_arm.view.server import serve
    from dummy_arm.view.view import View
    with ExitStack() as stack:
        yield lambda source: View(source, stack.enter_context(serve('127.0.0.1')))


def test_a_view_of_what_is_static_or_odd(view):
    """Odd names, numbers and stamps, loops and a cleared buffer raise no error."""
    buffer = BufferCore()
    page = view(StubSource(buffer, Publication(None, None, '')))
    page.update()
    buffer.insert(0, 'map', 'base', pose(1.0), is_static=True)
    for parent, child, x in (('//map', 'bad', 1.0), ('map', 'far', float('inf')), ('a', 'b', 1.0),
                             ('b', 'a', 1.0), ('c', 'zero', 1.0)):
        buffer.insert(0 if child == 'zero' else T, parent, child, pose(x))
    for _ in range(3):
        page.update()
    page._scene.look_at(page._snapshot, [])
    buffer.clear()
    page.update()
    buffer.insert(1, 'map', 'early', pose(1.0))
    for i in range(5):
        buffer.insert(1 + i * S // 30, 'map', 'early', pose(1.0))
        page.update()


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('place', FAR)
def test_a_view_of_what_is_far(view, place):
    """All that is drawn is near, and no number overflows."""
    buffer = BufferCore()
    page = view(StubSource(buffer, Publication(None, None, '')))
    for i in range(5):
        for sign, child in (1, 'far'), (-1, 'hand'):
            buffer.insert(T + i * S, 'map', child, pose(*(sign * x for x in place)))
        buffer.insert(T + i * S, 'far', 'tip', pose(1.0))
        buffer.insert(T + i * S, 'x', 'y', pose(*place))
        page._next_texts = 0.0
        page.update()
    page._panel.fixed.choose('far')
    page.update()
    page._scene.look_at(page._snapshot, [])
    camera = page._server.initial_camera
    rods = page._scene._rods
    for drawn in (rods.batched_positions, rods.batched_scales, page._scene._trail.points,
                  camera.position, camera.look_at):
        assert np.isfinite(drawn).all()
        assert np.abs(drawn).max() < 1e8
    assert 1e6 < camera.far < 1e12


def test_a_view_that_stands_still(view, clock):
    """A paused page keeps its data, also after the buffer has dropped them."""
    buffer = BufferCore()
    page = view(StubSource(buffer, Publication(None, None, '')))
    arm(buffer, T, 'map', 'base', 'hand')
    page.update()
    page._panel._pause.value = True
    arm(buffer, T + 100 * S, 'map', 'base', 'hand')
    for name in 'hand', 'base':
        page._panel.selected.choose(name)
        page._next_texts = 0.0
        page.update()
        assert page._snapshot.stamps[-1] == T
    assert '>base</b>' not in page._panel._details.content
    assert f'{T // S}.000000000 s' in page._panel._details.content
    page._panel._pause.value = False
    page.update()
    assert page._snapshot.stamps[-1] == T + 100 * S


def test_what_is_chosen_stays(view):
    """A choice outlasts new proposals, even while the chosen frame does not exist."""
    buffer = BufferCore()
    arm(buffer, T, 'map', 'base', 'hand')
    page = view(StubSource(buffer, Publication(None, None, '')))
    page.update()
    choice = page._panel.fixed
    assert (choice.name, choice.chosen) == ('map', '')
    choice._dropdown.value = 'base'  # viser sets it before it calls back
    asyncio.run(choice._on_update(Sent(choice._dropdown)))
    choice.set_options(['map', 'base', 'hand', 'more'], 'map')
    assert (choice.name, choice._dropdown.value) == ('base', 'base')
    choice.set_options([], '')
    assert (choice.name, choice._dropdown.value) == ('base', 'base')
    page.update()
    assert page._snapshot.fixed == 'base'
    page._panel.selected.choose('(none)')
    page._next_texts = 0.0
    page.update()
    assert 'Click a frame' in page._panel._details.content


def test_a_stray_stamp_does_not_stretch_a_bag():
    """A node may have published before its clock was set."""
    buffer = BufferCore(10**19)
    arm(buffer, T, 'map', 'base')
    arm(buffer, T + 4 * S, 'map', 'base')
    arm(buffer, 5 * S, 'map', 'stray')
    for child, stamp in ('zero', 0), ('other', T + S):
        arm(buffer, stamp, 'map', child)
    player = Player(buffer.frames())
    assert (player.time, player.length) == (T, 4.0)


def test_without_viser(start):
    """The error says what is missing, and how to install it."""
    process = start(*tool_without(['viser'], 'web_view'))
    assert process.exit_code() == 1
    assert process.output == ('web_view: viser, which makes the page, cannot be imported (No '
                              "module named 'viser'): pip install 'viser>=1.1,<1.2'\n")


def test_without_ros(start):
    """The error says that a bag can be shown without ROS."""
    process = start(*tool_without_ros('web_view'))
    assert process.exit_code() == 1
    assert 'can read a bag without ROS: --bag FILE' in process.output
