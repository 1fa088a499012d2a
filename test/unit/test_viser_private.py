"""The internals of viser 1.1.1 and websockets on which view/viser_private.py relies."""

import asyncio
from contextlib import closing
import gzip
import inspect
from pathlib import Path
import re
from urllib.request import Request, urlopen

import pytest
from viewer import recorded, Viewer

viser = pytest.importorskip('viser', reason='viser, which makes the page, is not installed')
websockets, websockets_server = map(
    pytest.importorskip, ('websockets', 'websockets.asyncio.server'))
infra = viser.infra._infra


def test_the_websocket_server_exists_before_it_starts():
    """So messages can be guarded before the first client connects."""
    source = inspect.getsource(viser.ViserServer.__init__)
    assert source.index('self._websock_server = server') < source.index('\n        server.start()')


def test_all_messages_of_a_client_pass_one_method_of_server_and_connection():
    """It takes the number of the client, whose WebSocket is in `_live_connections`."""
    for receiver in infra.WebsockServer, infra.WebsockClientConnection:
        assert [*inspect.signature(receiver._handle_incoming_message).parameters] == [
            'self', 'client_id', 'message']
    source = inspect.getsource(infra.WebsockServer._background_worker)
    assert source.count('._handle_incoming_message(client_id, message)') == 2
    assert 'self._live_connections[client_id] = connection' in source


@pytest.mark.parametrize('name', [
    'ViewerCameraMessage', 'SceneNodeClickMessage', 'GuiUpdateMessage',
    'LocalStorageGetItemResponseMessage', 'TransformControlsDragStartMessage',
    'TransformControlsUpdateMessage', 'TransformControlsDragEndMessage'])
def test_the_messages_that_are_allowed_exist(name):
    """Only an update of a control has the field `updates`; handles have a name, and one a pose."""
    fields = getattr(viser._messages, name).__annotations__
    assert ('updates' in fields) == (name == 'GuiUpdateMessage')
    if name.startswith('TransformControls'):
        pose = {'wxyz', 'position'} if name == 'TransformControlsUpdateMessage' else set()
        assert {*fields} == {'name', 'owner'} | pose


def test_a_pose_is_sent_by_two_messages():
    """Its setters send the same."""
    from puretf_tools.view.server import serve
    from puretf_tools.view.viser_private import set_pose
    with serve('127.0.0.1') as server:
        nodes = [server.scene.add_frame(name) for name in ('/a', '/b')]
        serializer = server.get_scene_serializer()
        set_pose(nodes[0], (1.0, 2.0, 3.0), (0.0, 1.0, 0.0, 0.0))
        nodes[1].position, nodes[1].wxyz = (1.0, 2.0, 3.0), (0.0, 1.0, 0.0, 0.0)
        sent = [{**message, 'name': ''} for _, message in recorded(serializer.as_html())[
            'messages'] if message['type'].startswith('Set') and message['name'] in ('/a', '/b')]
    assert len(sent) >= 4
    assert sent[-4:-2] == sent[-2:]
    for node in nodes:
        assert node.position.tolist() == [1.0, 2.0, 3.0]
        assert node.wxyz.tolist() == [0.0, 1.0, 0.0, 0.0]


def test_the_size_of_a_window():
    """A client is sent at most this many messages at once."""
    source = inspect.getsource(infra.AsyncMessageBuffer._window_loop)
    assert 'len(window) < self.max_window_size' in source
    assert 'self._websock_connection = ' in inspect.getsource(viser.ClientHandle.__init__)
    assert hasattr(infra.WebsockClientConnection, 'get_message_buffer')


def test_only_the_event_loop_sets_the_event_for_which_it_waits():
    """A message that is pushed meanwhile by another thread does not stop the page for ever."""
    from puretf_tools.view.server import serve
    with serve('127.0.0.1') as server, closing(Viewer(server.get_port())) as viewer:
        viewer.until(server.get_clients)
        client, = server.get_clients().values()
        for receiver in server._websock_server, client._websock_connection:
            event = type(receiver.get_message_buffer().message_event)()
            event.set()
            assert not event.is_set()
            server.get_event_loop().call_soon_threadsafe(event.set)
            viewer.until(event.is_set)
    for function in infra.AsyncMessageBuffer.push, infra.AsyncMessageBuffer.atomic_end:
        assert 'event_loop.call_soon_threadsafe(self.message_event.set)' in inspect.getsource(
            function)


def test_a_control_is_known_by_its_uuid():
    """Messages of the page change it by this."""
    from puretf_tools.view.server import serve
    from puretf_tools.view.viser_private import uuid_of
    with serve('127.0.0.1') as server:
        text = server.gui.add_text('', '', visible=False)
        assert server.gui._gui_input_handle_from_uuid[uuid_of(text)] is text


CLIENT = Path(viser.__file__).parent / 'client'


def test_the_head_of_the_page():
    """The title stands before the code, which has the shaders and properties that are named."""
    from puretf_tools.view import viser_private
    page = (CLIENT / 'build' / 'index.html').read_text()
    assert page.index('<title>Viser</title>') < page.index('<script')
    assert '<title>TF: &lt;b&gt;</title>' in viser_private.with_head(page, '<b>')
    labels, plot, messages, warning = (
        (CLIENT / 'src' / path).read_text() for path in (
            'label/LabelRenderer.tsx', 'components/UplotComponent.tsx', 'MessageHandler.tsx',
            'BrowserWarning.tsx'))
    changes = viser_private._HEAD.split('const box = ')[1].split('wrap(')[0]
    found = re.findall(r"\['(.*?)',", changes)
    assert len(found) == 4
    for before in found:
        assert labels.count(before) == 1
    assert '(w.__viserTestpoints ??= {})' in plot
    assert 'reg[uuid] = { chart, ' in plot
    assert 'localStorage.getItem(LOCAL_STORAGE_PREFIX + message.key)' in messages
    assert 'id: "webgl-software-rendering"' in warning


def test_the_page_that_is_served():
    """It is compressed, and has our head; a client that takes no gzip gets viser's page."""
    from puretf_tools.view.server import serve
    page = (CLIENT / 'build' / 'index.html').read_bytes()
    with serve('127.0.0.1') as server:
        server.title = '/tf'
        for headers in {}, {'Accept-Encoding': 'gzip'}:
            with urlopen(Request(f'http://127.0.0.1:{server.get_port()}', headers=headers)
                         ) as answer:
                body = answer.read()
            if headers:
                assert b'<title>TF: /tf</title>' in gzip.decompress(body)
            else:
                assert body == page


def test_serve_takes_what_guards_it():
    """It takes a check of requests, a limit of size and a socket."""
    assert {'process_request', 'max_size', 'kwargs'} <= {
        *inspect.signature(websockets_server.serve.__init__).parameters}
    assert 'sock' in inspect.signature(asyncio.BaseEventLoop.create_server).parameters
