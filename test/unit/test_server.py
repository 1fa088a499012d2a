"""The server of web_view: its addresses and ports; requests and messages that it refuses."""

from contextlib import closing, contextmanager
import errno
from functools import partial
import re
import socket
from types import SimpleNamespace
import warnings

from environment import ROOT
import pytest
from viewer import CAMERA, CLICK, POINTER, update, Viewer, viser

from puretf import TransformBuffer
from puretf_tools.cli.parser import CommandError
from puretf_tools.view.feed import BagFeed
from puretf_tools.view.server import address_lines, serve, why_refused
from puretf_tools.view.view import View
from puretf_tools.view.viser_private import HANDLES, VISER

Headers, ConnectionClosed = (
    pytest.importorskip('websockets').Headers,
    pytest.importorskip('websockets.exceptions').ConnectionClosed)
S = 10**9
T = 1_700_000_000 * S


def test_no_free_port(monkeypatch):
    """The error names the ports that are in use."""
    def refuse(*_):
        raise OSError(errno.EADDRINUSE, 'refused')

    monkeypatch.setattr(socket.socket, 'bind', refuse)
    with (pytest.raises(CommandError, match=r'ports 8080 to 8179 of 127\.0\.0\.1 are all in use'),
          serve('127.0.0.1')):
        pass


def test_the_next_free_port(capsys):
    """Two pages without --port are served at two ports."""
    with serve('127.0.0.1') as one, serve('127.0.0.1') as other:
        ports = [one.get_port(), other.get_port()]
    assert ports[0] != ports[1]  # in any order, since other tests use such ports, too
    assert min(ports) >= 8080
    assert capsys.readouterr().out.splitlines() == [
        f'look at http://127.0.0.1:{port}' for port in ports]


def test_address_lines():
    """A line warns of other viewers, unless only this machine can reach the page."""
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
    ('LocalHost:8080', 'http://localhost:8080'), ('localhost', 'http://localhost'),
    ('127.1.2.3:8080', 'http://127.1.2.3:8080'), ('[::1]:8080', 'http://[::1]:8080'),
])
def test_own_pages_are_served(host, origin):
    """A request is accepted if it names this machine, and no other origin."""
    assert refused([host], [origin] if origin else []) == ''


@pytest.mark.parametrize(('host', 'origin'), [
    ('evil.example:8080', None), ('127.0.0.1.evil.example:8080', None), ('127.evil.example', None),
    ('127.0.0.1.:8080', None), ('127.1:8080', None), ('localhost.evil.example', None),
    ('192.0.2.1:8080', None), ('[::2]:8080', None),
    ('127.0.0.1.evil.example', 'http://127.0.0.1.evil.example'),
    (OWN, f'https://{OWN}'), (OWN, 'http://evil.example'), (OWN, 'http://127.0.0.1'),
    (OWN, 'http://127.0.0.1:8081'), (OWN, 'http://localhost:8080'), (OWN, 'null'), (OWN, ''),
    (OWN, OWN), (OWN, f'http://{OWN}/'), (OWN, f'http://{OWN}?'), (OWN, f'http://me@{OWN}'),
    (OWN, 'http://127.0.0.1:http'), (OWN, 'http://127.0.0.1:99999'), (OWN, 'http://[::1'),
    ('', None), (':8080', None), ('localhost:x', None),
    ('localhost:0', 'http://localhost'), ('[::1', None), ('[]', None), ('[localhost]', None),
    ('me@localhost', None), ('localhost/evil', None), ('evil#localhost', None),
])
def test_other_hosts_and_origins_are_refused(host, origin):
    """No other site that is open in the browser can use the page, by whatever name."""
    why = refused([host], [origin] if origin is not None else [])
    assert len(why.encode().splitlines()) == 1


def test_other_requests():
    """A header that is missing or repeated is refused; a page for all has any name."""
    for hosts, origins in ([], []), ([OWN, OWN], []), ([OWN], [f'http://{OWN}'] * 2):
        assert 'one Host header' in refused(hosts, origins)
    assert refused(['robot:8080'], ['http://robot:8080'], is_loopback=False) == ''
    assert refused(['robot:8080'], ['http://evil.example'], is_loopback=False)


def refused(hosts, origins, is_loopback=True):
    """Return `why_refused` for the headers of a request."""
    return why_refused(Headers([*(('Host', host) for host in hosts),
                                *(('Origin', origin) for origin in origins)]), is_loopback)


def test_a_refused_request_is_answered_by_403():
    """This holds for pages and WebSockets, with headers of any bytes."""
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
                    (), (b'Host: 127.0.0.1.evil.example',), (b'Host: [::1',), (b'Host: \xff\xfe',),
                    (b'Host: ' + own, b'Host: ' + own), (b'Host: ' + own, b'Origin: \xff'),
                    (b'Host: ' + own, b'Origin: http://evil.example')):
                assert status(*headers, upgrade=upgrade) == b'403', headers


def test_a_viser_that_cannot_be_guarded(monkeypatch):
    """The error names a version that can be, and nothing is served."""
    import websockets.asyncio.server

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
            r"pip install 'viser>=1\.1\.1,<1\.2'$")), serve('127.0.0.1')):
        pass
    assert [server.is_serving() for server in servers] == [False]


def test_the_viser_of_an_error_is_that_of_setup_py():
    """The error recommends the version that is installed with the package."""
    assert f"'view': ['{VISER}', " in (ROOT / 'setup.py').read_text()


@pytest.fixture(scope='module')
def page():
    """A page with two frames."""
    buffer = TransformBuffer(10**18)
    for second in 0, 1, 2:
        buffer.insert(T + second * S, 'map', 'base', (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        with serve('127.0.0.1') as server:
            view = View(BagFeed(buffer, 'bag'), server)
            view.update()
            yield SimpleNamespace(port=server.get_port(), update=view.update)


@contextmanager
def connected(page):
    """Connect a viewer, and wait until it has received the controls of the page."""
    with closing(Viewer(page.port)) as viewer:
        viewer.until(lambda: viewer.shown() and any(
            props.get('label') == 'Publish' for props in viewer.gui.values()), page.update)
        viewer.last.clear()
        yield viewer


@pytest.fixture
def viewer(page):
    """A viewer of the page."""
    with connected(page) as viewer:
        yield viewer


def test_the_messages_of_the_page_have_effect(page, viewer):
    """The connection stays open; a click may be on nothing that is there."""
    viewer.send(CAMERA)
    for place in [0.5, 0.5], [-1.0, 2**40], [float('nan'), 0.5]:
        viewer.send({**CLICK, 'screen_pos': place})
        viewer.send({**POINTER, 'screen_pos': [place]})
    viewer.press('F')
    viewer.set('Axis length (m)', 1)
    viewer.set('Frame', 'base')
    viewer.set('View', 'all')
    viewer.until(partial(viewer.last.get, 'SetCameraLookAtMessage'), page.update)


def setting(label, value):
    """Return a function that returns the message which sets a control to a value."""
    return lambda uuid: update(uuid(label), value=value)


AXIS, XYZ = 'Axis length (m)', 'x, y, z (m)'
DRAG = {'type': 'TransformControlsUpdateMessage', 'name': HANDLES, 'owner': '',
        'wxyz': [1, 0, 0, 0], 'position': [0, 0, 0]}
#: Functions that return a message by a function which returns the uuid of a control.
NONSENSE = {
    'no msgpack': lambda uuid: b'\xc1',
    'no map': lambda uuid: b'\x90',
    'a text': lambda uuid: 'text',
    'too deep': lambda uuid: b'\x81\xa1a' + b'\x91' * 60000,
    'too long': lambda uuid: bytes(2**16 + 1),
    'no such type': lambda uuid: {'type': 'Nonsense'},
    'a message of the server': lambda uuid: {'type': 'ResetGuiMessage'},
    'a public page': lambda uuid: {'type': 'ShareUrlRequest'},
    'an upload': lambda uuid: {
        'type': 'FileTransferStartUpload', 'source_component_uuid': uuid(AXIS), 'filename': 'a',
        'transfer_uuid': '1', 'mime_type': 'b', 'part_count': 0, 'size_bytes': 0},
    'fields missing': lambda uuid: {'type': 'ViewerCameraMessage'},
    'an answer that is no text': lambda uuid: {
        'type': 'LocalStorageGetItemResponseMessage', 'value': [], 'error': None,
        'request_uuid': 'x'},
    'another attribute': lambda uuid: update(uuid(AXIS), update_cb=[]),
    **{f'{value!r} in {label}': setting(label, value) for label, value in (
        (AXIS, 'metre'), (AXIS, float('nan')), (AXIS, True), ('Frame timeout (s)', None),
        ('Grid', 'x'), ('Include', 1), ('Fixed frame', 0),
        (XYZ, [float('nan'), 0, 0]), (XYZ, [4]), (XYZ, [1, 2, 3, 4]),
        (XYZ, ['x', 0, 0]))},
    **{f'handles {i}': lambda _, changes=changes: {**DRAG, **changes}
       for i, changes in enumerate((
           {'name': '/frames'}, {'name': '/frames', 'type': 'TransformControlsDragStartMessage'},
           {'position': [float('nan'), 0, 0]}, {'position': [0, 0]}, {'position': ['x', 0, 0]},
           {'wxyz': [0, 0, 0, 0]}, {'wxyz': [float('inf'), 0, 0, 0]}, {'wxyz': [1] * 5},
           {'wxyz': 1}))},
    'no direction is up': lambda _: {**CAMERA, 'up_direction': [0, 0, 0]},
    'a camera that looks nowhere': lambda _: {**CAMERA, 'look_at': [float('nan')] * 3},
    'a camera without an angle': lambda _: {**CAMERA, 'fov': 'x'},
}


@pytest.mark.filterwarnings('ignore:Queued a', 'ignore:.viser.')  # of viser
@pytest.mark.parametrize('message', NONSENSE.values(), ids=NONSENSE)
def test_nonsense_ends_its_own_connection(page, viewer, message, capfd):
    """Another viewer can use the page, and nothing is printed but by the log."""
    with connected(page) as bad:
        bad.send(message(bad.uuid))
        with pytest.raises(ConnectionClosed):
            bad.until(lambda: False)
    viewer.send(CAMERA)
    viewer.set('View', 'all')
    viewer.until(partial(viewer.last.get, 'SetCameraLookAtMessage'), page.update)
    assert capfd.readouterr() == ('', '')


@pytest.mark.parametrize('name', ['no msgpack', 'a public page', 'no direction is up'])
def test_nonsense_is_logged(logs, name):
    """By a line that says why a viewer is disconnected."""
    with serve('127.0.0.1') as server, closing(Viewer(server.get_port())) as bad:
        bad.send(NONSENSE[name](bad.uuid))
        with pytest.raises(ConnectionClosed):
            bad.until(lambda: False)
    assert {record.getMessage().partition(':')[0] for record in logs} == {
        'a viewer is disconnected'}


def test_bytes_that_are_no_request(page, capfd):
    """They are answered or not, and nothing is printed."""
    with socket.create_connection(('127.0.0.1', page.port)) as raw:
        raw.sendall(b'GET / HT\xff\r\n\r\n')
        raw.recv(1000)
    assert capfd.readouterr() == ('', '')
