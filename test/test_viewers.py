"""The messages that web_view accepts from viewers: those of its page, and no others."""

from dataclasses import fields
import random
import socket
import threading
import time
import warnings

from conftest import TIMEOUT, tool_without_ros
import pytest

from dummy_arm.tf import BufferCore
from dummy_arm.view.source import BagSource

viser = pytest.importorskip('viser', reason='viser, which makes the page, is not installed')
msgspec, zstandard = map(pytest.importorskip, ('msgspec', 'zstandard'))
connect = pytest.importorskip('websockets.sync.client').connect
ConnectionClosed = pytest.importorskip('websockets.exceptions').ConnectionClosed

S = 10**9
T = 1_700_000_000 * S
CAMERA = {'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [1, 2, 3],
          'fov': 0.8, 'near': 0.01, 'far': 1000, 'image_height': 600, 'image_width': 800,
          'look_at': [0, 0.0, 0], 'up_direction': [0.0, 0.0, 1.0]}
CLICK = {'type': 'SceneNodeClickMessage', 'name': '/frames', 'instance_index': 1,
         'ray_origin': [0.0, 0.0, 1.0], 'ray_direction': [0, 0, 1], 'screen_pos': [0.5, 0.5],
         'modifier': None, 'owner': ''}
MESSAGES = viser._messages.Message.get_subclasses()
NUMBERS = 0, -1, 2**31, 2**63, -2**63, 0.5, 1e308, -1e308, float('nan'), float('inf')


class Viewer:
    """A client of the page, which sends the messages of a test."""

    def __init__(self, port):
        """Connect as the page does."""
        self._connection = connect(
            f'ws://127.0.0.1:{port}', subprotocols=[f'viser-v{viser.__version__}'],
            max_size=None, compression=None, close_timeout=1.0)

    def send(self, message):
        """Send bytes, a text or a message."""
        self._connection.send(
            message if isinstance(message, (bytes, str)) else msgspec.msgpack.encode(message))

    def wait(self, condition):
        """Receive messages until one fulfils a condition, and return that one."""
        deadline = time.monotonic() + TIMEOUT
        while True:
            window = self._connection.recv(deadline - time.monotonic())
            size = int.from_bytes(window[8:16], 'little')
            content = zstandard.ZstdDecompressor().decompress(window[16:16 + size])
            for message in msgspec.msgpack.decode(content)['messages']:
                if condition(message):
                    return message

    def controls(self):
        """Return the uuid of each control by its label."""
        uuids = {}

        def is_last(message):
            if label := message.get('props', {}).get('label'):
                uuids[label] = message['uuid']
            return label == 'Focus on all frames'

        self.wait(is_last)
        return uuids

    def close(self):
        """Disconnect."""
        self._connection.close()


@pytest.fixture
def page():
    """The page of a short bag with two frames: `page.server`, `page.update()`."""
    from dummy_arm.view.server import serve
    from dummy_arm.view.view import View
    buffer = BufferCore(10**18)
    for second in 0, 1, 2:
        buffer.insert(T + second * S, 'map', 'base', (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        with serve('127.0.0.1') as server:
            made = View(BagSource(buffer, 'bag'), server)
            made.server = server  # type: ignore[attr-defined]
            made.update()
            yield made


@pytest.fixture
def uuids(page):
    """The uuid of each control of the page, by its label."""
    viewer = Viewer(page.server.get_port())
    yield viewer.controls()
    viewer.close()


def accepted(page, message):
    """Return True if a message is passed to viser."""
    return page.server.accepts(msgspec.msgpack.encode(message))


@pytest.mark.parametrize('changes', [
    {}, {'position': [1e6, 0, 2**40]}, {'up_direction': [0, 0, 0]}])
def test_a_camera_is_accepted(page, changes):
    """The page sends whole numbers as integers."""
    assert accepted(page, {**CAMERA, **changes})


@pytest.mark.parametrize('changes', [
    {'wxyz': [1.0, 0.0, 0.0]}, {'position': [1.0, 2.0, 3.0, 4.0]}, {'position': 'abc'},
    {'position': [1.0, 2.0, float('nan')]}, {'look_at': [float('inf'), 0.0, 0.0]},
    {'up_direction': [0.0, 0.0, None]}, {'fov': float('nan')}, {'near': '0.1'}, {'far': None},
    {'far': float('-inf')}, {'image_height': 1.5}, {'image_width': 'wide'}, {'client': 1},
    {'type': 'CameraMessage'}, {'type': []}, {'type': {}}, {'type': None}])
def test_a_camera_that_is_none_is_refused(page, changes):
    """Other shapes, numbers that are not finite and additional fields are refused."""
    assert not accepted(page, {**CAMERA, **changes})


def test_a_click_is_accepted(page):
    """The frame may be gone by then, and a click on the scene has no index."""
    for index in 0, -1, 2**40, None:
        assert accepted(page, {**CLICK, 'instance_index': index})


@pytest.mark.parametrize('changes', [
    {'instance_index': 'a'}, {'instance_index': 1.5}, {'instance_index': [1]}, {'name': 1},
    {'ray_origin': None}, {'screen_pos': [1.0]}, {'modifier': 'hyper'}, {'modifier': 5}])
def test_a_click_that_is_none_is_refused(page, changes):
    """Fields of other types are refused."""
    assert not accepted(page, {**CLICK, **changes})


@pytest.mark.parametrize(('label', 'value'), [
    ('Axis length (m)', 0.5), ('Axis length (m)', 1), ('Time (s)', 0), ('Pause', True),
    ('Show names', False), ('Frame', 'base'), ('Fixed frame', '(none)'),
    ('Focus on all frames', True)])
def test_a_value_of_a_control_is_accepted(page, uuids, label, value):
    """Whole numbers may be integers."""
    assert accepted(page, update(uuids[label], value=value))


@pytest.mark.parametrize(('label', 'value'), [
    ('Axis length (m)', '1'), ('Axis length (m)', True), ('Axis length (m)', float('nan')),
    ('Axis length (m)', float('inf')), ('Axis length (m)', None), ('Axis length (m)', [0.5]),
    ('Pause', 1), ('Pause', 'yes'), ('Show names', None), ('Frame', 'nowhere'), ('Frame', 5),
    ('Frame', ['base']), ('Frame', {}), ('Frame', 'x' * 10000), ('Focus on all frames', [])])
def test_a_value_that_is_none_is_refused(page, uuids, label, value):
    """A value of another type, or that is not among the options, is refused."""
    assert not accepted(page, update(uuids[label], value=value))


@pytest.mark.parametrize('name', [
    'props', '__dict__', '__class__', 'uuid', 'removed', 'update_cb', 'sync_cb', 'gui_api', ''])
def test_other_attributes_are_refused(page, uuids, name):
    """Viser itself would set them."""
    for uuid in uuids.values():
        assert not accepted(page, update(uuid, **{name: {}}))
        assert not accepted(page, update(uuid, **{name: {}, 'value': True}))
        assert not accepted(page, update(uuid))


def update(uuid, /, **updates):
    """Return the message by which a control changes."""
    return {'type': 'GuiUpdateMessage', 'uuid': uuid, 'updates': updates}


def test_no_other_message_is_accepted(page, uuids):
    """Uploads, unrequested answers and the messages of the server are refused."""
    used = {'GuiUpdateMessage', 'ViewerCameraMessage', 'SceneNodeClickMessage'}
    names = {each.__name__ for each in MESSAGES}
    assert names > {'FileTransferStartUpload', 'FileTransferPart', 'ShareUrlRequest', *used}
    for name in names - used:
        for more in {}, {**CAMERA}, {**CLICK}, update(uuids['Pause'], value=True):
            assert not accepted(page, {**more, 'type': name})


@pytest.mark.parametrize('data', [
    b'', b'\xc1', b'\x90', b'\x81\xa1a', b'\x81\xa1\xff\x01', b'\x81\x01\x01', 'text', '',
    b'\xdf' + b'\xff' * 9, b'\x81\xa1a' + b'\x91' * 60000, b'\xd6\xff\x00\x00\x00\x01'])
def test_what_is_no_message_is_refused(page, data):
    """Malformed data raise no exception."""
    assert not page.server.accepts(data)


def test_a_long_message_ends_the_connection(page):
    """Otherwise it would be held in memory as a whole."""
    viewer = Viewer(page.server.get_port())
    viewer.send(bytes(2**16 + 1))
    with pytest.raises(ConnectionClosed, match='1009'):
        viewer.wait(lambda _: False)
    viewer.close()


@pytest.mark.parametrize('camera', [
    {}, {'up_direction': [0, 0, 0], 'wxyz': [0, 0, 0, 0]}, {'look_at': CAMERA['position']},
    {'position': [1e308] * 3, 'look_at': [-1e308] * 3, 'far': -1e308}])
def test_any_camera_can_be_turned(page, camera):
    """Odd cameras raise no error, nor does a viewer that has left."""
    ready, left = threading.Event(), threading.Event()
    page.server.on_client_connect(lambda _: ready.set())
    page.server.on_client_disconnect(lambda _: left.set())
    viewer = Viewer(page.server.get_port())
    viewer.send({**CAMERA, **camera})
    assert ready.wait(TIMEOUT)
    clients = [*page.server.get_clients().values()]
    page._scene.look_at(page._snapshot, clients)
    turned = viewer.wait(lambda each: (each['type'], each.get('initial')) == (
        'SetCameraLookAtMessage', False))
    assert turned['look_at'][2] == page.server.initial_camera.look_at[2]
    viewer.close()
    assert left.wait(TIMEOUT)
    page._scene.look_at(page._snapshot, clients)


def test_no_message_of_a_viewer_ends_the_process(start, tmp_path):
    """After thousands of odd messages the page answers others, and nothing is printed."""
    bags = pytest.importorskip('bags')
    path = bags.make(tmp_path / 'bag', 'mcap', bags.walk())
    process = start(*tool_without_ros('web_view', '--bag', str(path)))
    port = int(process.line_with('look at http').rsplit(':', 1)[1])
    good = Viewer(port)
    uuids = good.controls()
    for message in CAMERA, update(uuids['Fixed frame'], value='map'):
        good.send(message)
    source = random.Random(1)
    bad = Viewer(port)
    values: list[object] = [{}, None, 'x']
    for uuid in uuids.values():
        for name in 'props', '__dict__', 'value':
            for value in values:
                bad.send(update(uuid, **{name: value}))
    for _ in range(4000):
        bad.send(any_message(source, [*uuids.values()])[:2**16])
    bad.send(update(uuids['Axis length (m)'], value=0.77))  # once this one arrives, all have
    good.wait(lambda each: each.get('updates') == {'value': 0.77})
    bad.close()
    for _ in range(20):
        with socket.create_connection(('127.0.0.1', port)) as raw:
            raw.sendall(b'GET / HTTP/1.1\r\n'[:source.randrange(17)] + source.randbytes(200))
    good.send(update(uuids['Pause'], value=False))
    for _ in range(3):  # by then the last click has been handled, too
        good.wait(lambda each: each.get('uuid') == uuids['Time (s)'])
    for frame, parent in ('base_link', 'odom'), ('odom', 'map'):
        good.send(update(uuids['Frame'], value=frame))
        good.wait(lambda each, parent=parent: f'data-value="parent">{parent}<' in str(
            each.get('updates')))
    good.close()
    process.close()
    assert process.output.splitlines() == [f'look at http://127.0.0.1:{port}']


def any_message(source, uuids):
    """Return bytes, a text or a message of any type, more or less valid."""
    kind = source.randrange(7)
    if kind == 0:
        return source.randbytes(source.choice((0, 1, 10, 1000)))
    if kind == 1:
        return source.choice(('', 'text', '\0', '💥' * 1000))
    if kind == 2:
        return msgspec.msgpack.encode(anything(source, 4))
    if kind == 3:
        each = source.choice(MESSAGES)
        return msgspec.msgpack.encode({
            'type': each.__name__,
            **{field.name: anything(source, 2) for field in fields(each)}})
    message = dict(source.choice((
        CAMERA, CLICK, update(source.choice(uuids), value=anything(source, 1)),
        update(source.choice(uuids), **{source.choice((
            'props', '__dict__', 'value', 'update_cb', 'removed')): anything(source, 2)}))))
    for _ in range(source.randrange(3)):
        message[source.choice([*message, 'excluded_self_client'])] = anything(source, 2)
    data = bytearray(msgspec.msgpack.encode(message))
    if kind == 4:
        data[source.randrange(len(data))] = source.randrange(256)
    return bytes(data)


def anything(source, depth):
    """Return a value of any type, nested up to a depth."""
    kind = source.randrange(8 if depth else 6)
    if kind < 2:
        return source.choice(NUMBERS)
    if kind == 2:
        return source.choice((None, True, False))
    if kind == 3:
        return source.choice(('', 'value', 'map', '__dict__', 'x' * 20000, '/frames', '\0', '💥'))
    if kind == 4:
        return source.randbytes(5)
    if kind == 5:
        return [source.choice(NUMBERS) for _ in range(source.randrange(6))]
    if kind == 6:
        return [anything(source, depth - 1) for _ in range(source.randrange(5))]
    return {source.choice(('value', 'name', '__dict__')): anything(source, depth - 1)}
