"""The internals of viser 1.1 and websockets on which view/viser_private.py relies."""

import asyncio
from importlib import import_module
import inspect

import pytest

viser = pytest.importorskip('viser', reason='viser, which makes the page, is not installed')
msgspec, websockets, websockets_server = map(
    pytest.importorskip, ('msgspec', 'websockets', 'websockets.asyncio.server'))
viser_private = import_module('dummy_arm.view.viser_private')


@pytest.fixture(scope='module')
def server():
    """A server of an empty page."""
    from dummy_arm.view.server import serve
    with serve('127.0.0.1') as server:
        yield server


def test_messages_are_classes_with_the_fields_that_are_checked():
    """The messages have exactly the fields that the server checks."""
    for message_type, fields in (
            (viser_private.GuiUpdateMessage, {'uuid', 'updates'}),
            (viser_private.SceneNodeClickMessage, {
                'name', 'instance_index', 'ray_origin', 'ray_direction', 'screen_pos', 'modifier',
                'owner'}),
            (viser_private.ViewerCameraMessage, {
                'wxyz', 'position', 'fov', 'near', 'far', 'image_height', 'image_width',
                'look_at', 'up_direction'})):
        assert {*message_type.__annotations__} == fields


def test_a_message_is_a_msgpack_map_with_its_type(server):
    """The server accepts what viser itself makes of a message."""
    control = server.gui.add_slider('size', 0.0, 1.0, 0.1, 0.5)
    message = viser_private.GuiUpdateMessage(control._impl.uuid, {'value': 0.7})
    mapping = message.as_serializable_dict()
    assert mapping == {
        'type': 'GuiUpdateMessage', 'uuid': control._impl.uuid, 'updates': {'value': 0.7}}
    assert server.accepts(msgspec.msgpack.encode(mapping))
    assert viser_private.message_of(
        msgspec.msgpack.encode(mapping), [viser_private.GuiUpdateMessage]) == message


@pytest.mark.parametrize('name', [
    'SetCameraPositionMessage', 'SetCameraLookAtMessage', 'SetCameraFovMessage',
    'SetCameraFarMessage'])
def test_messages_that_turn_a_camera_take_one_value(name):
    """Their other arguments are optional."""
    inspect.signature(getattr(viser_private, name)).bind(1.0)


def test_a_control_is_found_by_its_uuid(server):
    """The control has its value and, if it is a dropdown, its options."""
    control = server.gui.add_dropdown('choice', ('a', 'b'))
    assert server.control(control._impl.uuid) is control
    assert server.control('another') is None
    assert control.value == 'a'
    assert control.options == ('a', 'b')


def test_the_gui_is_made_after_the_server_has_started():
    """So a message may arrive while the server has no attribute `gui` yet."""
    source = inspect.getsource(viser.ViserServer.__init__)
    assert source.index('server.start()') < source.index('self.gui')


def test_a_client_is_sent_messages_by_its_connection():
    """The method `queue_message` of a connection takes one message."""
    queue = inspect.signature(viser.infra.WebsockClientConnection.queue_message)
    assert [*queue.parameters] == ['self', 'message']
    source = inspect.getsource(viser.ClientHandle.__init__)
    assert 'self._websock_connection = ' in source


def test_serve_takes_what_guards_it():
    """It takes a check of requests, a class of connections, a limit of size and a socket."""
    assert {'process_request', 'create_connection', 'max_size', 'kwargs'} <= {
        *inspect.signature(websockets_server.serve.__init__).parameters}
    assert 'sock' in inspect.signature(asyncio.BaseEventLoop.create_server).parameters
    assert [*inspect.signature(
        websockets_server.ServerConnection.recv).parameters] == ['self', 'decode']


def test_a_share_url_is_requested_by_one_method(server):
    """The server overrides this method, which then does nothing."""
    assert [*inspect.signature(viser.ViserServer.request_share_url).parameters] == [
        'self', 'verbose']
    assert server.request_share_url() is None


def test_headers_are_read_by_all_their_values():
    """Requests are checked by `get_all`, which returns each value of a header."""
    headers = websockets.Headers([('Host', 'a'), ('Host', 'b')])
    assert headers.get_all('Host') == ['a', 'b']
    assert headers.get_all('Origin') == []
