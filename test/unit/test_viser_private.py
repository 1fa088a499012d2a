"""The internals of viser 1.1 and websockets on which view/viser_private.py relies."""

import asyncio
import inspect

import pytest

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
    'TransformControlsDragStartMessage', 'TransformControlsUpdateMessage',
    'TransformControlsDragEndMessage'])
def test_the_messages_that_are_allowed_exist(name):
    """Only an update of a control has the field `updates`; handles have a name, and one a pose."""
    fields = getattr(viser._messages, name).__annotations__
    assert ('updates' in fields) == (name == 'GuiUpdateMessage')
    if name.startswith('TransformControls'):
        pose = {'wxyz', 'position'} if name == 'TransformControlsUpdateMessage' else set()
        assert {*fields} == {'name', 'owner'} | pose


def test_serve_takes_what_guards_it():
    """It takes a check of requests, a limit of size and a socket."""
    assert {'process_request', 'max_size', 'kwargs'} <= {
        *inspect.signature(websockets_server.serve.__init__).parameters}
    assert 'sock' in inspect.signature(asyncio.BaseEventLoop.create_server).parameters


def test_headers_are_read_by_all_their_values():
    """Requests are checked by `get_all`, which returns each value of a header."""
    headers = websockets.Headers([('Host', 'a'), ('Host', 'b')])
    assert headers.get_all('Host') == ['a', 'b']
    assert headers.get_all('Origin') == []
