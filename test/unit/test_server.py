"""The server of web_view: its addresses and ports; requests and messages that it refuses."""

import errno
from functools import partial
import re
import socket
from types import SimpleNamespace
import warnings

from environment import ROOT
import pytest
from viewer import CAMERA, CLICK, msgspec, update, Viewer, viser

from dummy_arm.cli.parser import CommandError
from dummy_arm.tf import BufferCore
from dummy_arm.view.server import address_lines, serve, why_refused
from dummy_arm.view.source import BagSource
from dummy_arm.view.view import View
from dummy_arm.view.viser_private import VISER

Headers, ConnectionClosed = (
    pytest.importorskip('websockets').Headers,
    pytest.importorskip('websockets.exceptions').ConnectionClosed)
S = 10**9
T = 1_700_000_000 * S
MESSAGES = viser._messages.Message.get_subclasses()


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
            r"pip install 'viser>=1\.1,<1\.2'$")), serve('127.0.0.1')):
        pass
    assert [server.is_serving() for server in servers] == [False]


def test_the_viser_of_an_error_is_that_of_setup_py():
    """The error recommends the version that is installed with the package."""
    assert f"'view': ['{VISER}', " in (ROOT / 'setup.py').read_text()


@pytest.fixture(scope='module')
def page():
    """The server of a page with two frames."""
    buffer = BufferCore(10**18)
    for second in 0, 1, 2:
        buffer.insert(T + second * S, 'map', 'base', (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        with serve('127.0.0.1') as server:
            View(BagSource(buffer, 'bag'), server).update()
            yield server


@pytest.fixture(scope='module')
def uuids(page):
    """The uuid of each control of the page, by its label."""
    viewer = Viewer(page.get_port())
    labels = 'Axis length (m)', 'Fixed frame', 'Focus on all frames', 'Frame', 'Pause'
    viewer.until(lambda: {*labels} <= {props.get('label') for props in viewer.gui.values()})
    yield {label: viewer.uuid(label) for label in labels}
    viewer.close()


def accepts(page, message):
    """Return True if a message is passed to viser."""
    return page.accepts(msgspec.msgpack.encode(message))


def test_the_messages_of_the_page_are_accepted(page, uuids):
    """Whole numbers may be integers; a click may be on a frame that is gone, or on the scene."""
    for changes in {}, {'position': [1e6, 0, 2**40]}, {'up_direction': [0, 0, 0]}:
        assert accepts(page, {**CAMERA, **changes})
    for index in 0, -1, 2**40, None:
        assert accepts(page, {**CLICK, 'instance_index': index})
    for label, value in (
            ('Axis length (m)', 0.5), ('Axis length (m)', 1), ('Pause', True), ('Frame', 'base'),
            ('Fixed frame', '(none)'), ('Focus on all frames', True)):
        assert accepts(page, update(uuids[label], value=value))


@pytest.mark.parametrize('message', [
    {**CAMERA, 'wxyz': [1.0, 0.0, 0.0]}, {**CAMERA, 'position': [1.0, 2.0, float('nan')]},
    {**CAMERA, 'look_at': [float('inf'), 0.0, 0.0]}, {**CAMERA, 'up_direction': [0.0, 0.0, None]},
    {**CAMERA, 'wxyz': [1.0, 0.0, 0.0, float('inf')]}, {**CAMERA, 'near': float('inf')},
    {**CAMERA, 'up_direction': [0.0, 0.0, float('nan')]},
    {**CAMERA, 'fov': float('nan')}, {**CAMERA, 'far': float('-inf')}, {**CAMERA, 'client': 1},
    {**CAMERA, 'type': []}, {**CLICK, 'instance_index': 1.5}, {**CLICK, 'modifier': 'hyper'}])
def test_a_camera_or_click_that_is_none_is_refused(page, message):
    """Other shapes and types, numbers that are not finite, and additional fields."""
    assert not accepts(page, message)


@pytest.mark.parametrize(('label', 'updates'), [
    ('Axis length (m)', {'value': '1'}), ('Axis length (m)', {'value': True}),
    ('Axis length (m)', {'value': float('nan')}), ('Pause', {'value': 1}),
    ('Frame', {'value': 'nowhere'}), ('Frame', {'value': ['base']}), ('Pause', {}),
    ('Focus on all frames', {'value': []}), ('Pause', {'props': {}}),
    ('Pause', {'value': True, 'update_cb': {}})])
def test_an_update_that_is_none_is_refused(page, uuids, label, updates):
    """A value of another type, or that is no option; and viser itself would set any attribute."""
    assert not accepts(page, update(uuids[label], **updates))
    assert not accepts(page, update('no control', value=True))


def test_no_other_message_is_accepted(page, uuids):
    """Uploads, unrequested answers and the messages of the server are refused."""
    used = {'GuiUpdateMessage', 'ViewerCameraMessage', 'SceneNodeClickMessage'}
    names = {each.__name__ for each in MESSAGES}
    assert names > {'FileTransferStartUpload', 'FileTransferPart', 'ShareUrlRequest', *used}
    for name in names - used:
        for more in {}, {**CAMERA}, {**CLICK}, update(uuids['Pause'], value=True):
            assert not accepts(page, {**more, 'type': name})


NO_MESSAGES = [b'', b'\xc1', b'\x90', b'\x81\xa1\xff\x01', b'\x81\x01\x01', 'text',
               b'\xdf' + b'\xff' * 9, b'\x81\xa1a' + b'\x91' * 60000]


def test_what_is_no_message_harms_nobody(page, capsys):
    """It is refused without an exception, and the page answers this viewer and others."""
    for data in NO_MESSAGES:
        assert not page.accepts(data)
    with socket.create_connection(('127.0.0.1', page.get_port())) as raw:
        raw.sendall(b'GET / HT\xff\r\n\r\n')
    for count in len(NO_MESSAGES), 0:
        viewer = Viewer(page.get_port())
        for each in NO_MESSAGES[:count]:
            viewer.send(each)
        viewer.send(CAMERA)
        viewer.until(partial(viewer.last.get, 'SetCameraLookAtMessage'))
        viewer.close()
    assert capsys.readouterr() == ('', '')


def test_a_long_message_ends_the_connection(page):
    """Otherwise it would be held in memory as a whole."""
    viewer = Viewer(page.get_port())
    viewer.send(bytes(2**16 + 1))
    with pytest.raises(ConnectionClosed, match='1009'):
        viewer.until(lambda: False)
    viewer.close()
