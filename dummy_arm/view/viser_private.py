"""
A server of viser that checks requests and messages. It uses private parts of viser.

This module is written for viser 1.1. It relies on the following facts, which
test/unit/test_viser_private.py checks:

- `viser._messages` has the classes of the messages that the page sends. A message is sent as a
  msgpack map, in which `type` is the name of the class; the other keys are the fields of the
  class. `viser._messages` also has the classes of the messages that move a camera.
- To start its server, viser calls `websockets.asyncio.server.serve` by this full name, so the
  function can be replaced. viser passes the argument `process_request`. The function also takes
  the arguments `sock`, `create_connection` and `max_size`.
- `gui._gui_input_handle_from_uuid` maps a uuid to a control of the panel.
- `client._websock_connection.queue_message` sends a message to one client.
"""

from collections.abc import Callable, Iterable
from functools import partial
from http import HTTPStatus
import logging
import socket
from typing import Any, Optional, Union
import warnings

import numpy as np
from numpy.typing import NDArray

from dummy_arm.cli.parser import CommandError

__all__ = ['VISER', 'GuardedServer', 'GuiUpdateMessage', 'SceneNodeClickMessage',
           'ViewerCameraMessage', 'message_of']

#: The versions of viser that can be used, as in setup.py. There is an upper bound, since private
#: parts of viser are used here.
VISER = 'viser>=1.1,<1.2'

try:
    import viser  # isort: skip  (an error is to name it, and not a library that comes with it)
    import msgspec
    import rich
    from viser._messages import (
        GuiUpdateMessage,
        SceneNodeClickMessage,
        SetCameraFarMessage,
        SetCameraFovMessage,
        SetCameraLookAtMessage,
        SetCameraPositionMessage,
        ViewerCameraMessage,
    )
    import websockets.asyncio.server
except ImportError as error:
    raise CommandError(f'viser, which makes the page, cannot be imported ({error}): '
                       f"pip install '{VISER}'") from None

#: The largest size of a message from a client (bytes); viser's own limit is 50 MB.
_LONGEST_MESSAGE = 2**16


def message_of(data: Union[bytes, str], types: Iterable[type]) -> Any:
    """
    Decode a message that a client has sent.

    :param data: the message as received.
    :param types: the classes of `viser._messages` that are allowed.
    :returns: the message; None if `data` is not a valid message of one of these classes.
    """
    if isinstance(data, str):
        return None
    named = {each.__name__: each for each in types}
    try:
        fields = msgspec.msgpack.decode(data, type=dict[str, Any])
        message: Any = msgspec.convert(fields, named[fields.pop('type')])
    except (ValueError, TypeError, KeyError, RecursionError):
        return None
    return message if fields.keys() <= vars(message).keys() else None


class _Connection(websockets.asyncio.server.ServerConnection):
    """A connection that checks the messages of a client before viser receives them."""

    def __init__(self, accepts: Callable[[Any], bool], *args: Any, **kwargs: Any) -> None:
        """
        Create a connection.

        :param accepts: a function that returns True for a message that can be passed on.
        :param args: the positional arguments of the base class.
        :param kwargs: the keyword arguments of the base class.
        """
        self._accepts = accepts
        super().__init__(*args, **kwargs)

    async def recv(self, decode: Optional[bool] = None) -> Any:
        """
        Return the next message that is accepted; drop the messages before it.

        A dropped message does no harm, so the connection stays open. If the connection were
        closed, the page would connect again and again.

        :param decode: as in the base class.
        :returns: the message.
        """
        while True:
            message = await super().recv(decode)
            if self._accepts(message):
                return message


class GuardedServer(viser.ViserServer):
    """A server of viser; a subclass decides which requests and which messages are accepted."""

    def __init__(self, listening: socket.socket) -> None:
        """
        Start the server.

        :param listening: the listening socket that the server uses.
        :raises CommandError: if requests cannot be checked with this version of viser.
        """
        # viser prints with the library `rich`. Without this call, it would print its address, and
        # a line when it stops.
        rich.reconfigure(quiet=True)
        # Without this filter, viser warns of messages to a client that has just disconnected.
        warnings.filterwarnings('ignore', 'Queued a ')
        # Without this level, websockets logs each malformed request as an error with a traceback.
        logging.getLogger('websockets').setLevel(logging.CRITICAL)
        address, port, *_ = listening.getsockname()
        serve = websockets.asyncio.server.serve
        is_guarded = False

        def guarded(handler: Any, host: object = None, port: object = None, *,
                    process_request: Callable[..., Any], **kwargs: Any) -> Any:
            """
            Call `serve` with our socket, limit and checks.

            :param handler: the handler of connections.
            :param host: not used, since the socket has an address.
            :param port: not used, since the socket has a port.
            :param process_request: viser's function, which answers the requests that are accepted.
            :param kwargs: other arguments of `serve`.
            :returns: the result of `serve`.
            """
            nonlocal is_guarded
            is_guarded = True

            def process(connection: Any, request: Any) -> Any:
                """
                Refuse a request with status 403, or let viser answer it.

                :param connection: the connection on which the request has arrived.
                :param request: the request.
                :returns: the response; None if the request opens a WebSocket.
                """
                if why := self.why_refused(request.headers):
                    return connection.respond(HTTPStatus.FORBIDDEN, f'{why}\n')
                return process_request(connection, request)
            # The socket is passed instead of the port: if a port is in use, viser tries the next
            # port.
            return serve(handler, **{
                **kwargs, 'sock': listening, 'process_request': process,
                'create_connection': partial(_Connection, self.accepts),
                'max_size': _LONGEST_MESSAGE})

        websockets.asyncio.server.serve = guarded
        try:
            super().__init__(address, port, label='dummy_arm', verbose=False)
        finally:
            websockets.asyncio.server.serve = serve
        if not is_guarded:
            self.stop()
            listening.close()
            raise CommandError(
                f'viser {viser.__version__} does not start its server by websockets.asyncio.'
                'server.serve, so requests of other pages could not be refused: '
                f"pip install '{VISER}'")

    def why_refused(self, headers: Any) -> str:
        """
        Return why a request is refused.

        :param headers: the headers of the request, as websockets passes them.
        :returns: one line; '' if the request is accepted.
        """
        raise NotImplementedError

    def accepts(self, data: Union[bytes, str]) -> bool:
        """
        Return True if a message of a client can be passed on to viser.

        viser itself checks nothing: a message can set any attribute of a control, to any value.
        If viser cannot read a message, it prints a traceback.

        :param data: the message as received.
        :returns: False if the message is dropped.
        """
        raise NotImplementedError

    def control(self, uuid: str) -> Any:
        """
        Return a control of the panel.

        :param uuid: the identifier that viser has given to the control.
        :returns: the handle of the control; None if no control has this uuid.
        """
        if 'gui' not in vars(self):  # viser starts to serve before it creates `gui`
            return None
        return self.gui._gui_input_handle_from_uuid.get(uuid)

    def turn_cameras(self, clients: Iterable[viser.ClientHandle], position: NDArray[np.float64],
                     look_at: NDArray[np.float64], fov: float, far: float) -> None:
        """
        Move the cameras of clients, and the initial camera.

        viser's own `client.camera` is not used. It raises an exception if the client has sent an
        invalid pose, for example with an up direction of zero length.

        :param clients: the clients whose cameras are moved.
        :param position: (3,): the position of the camera, x, y, z (m).
        :param look_at: (3,): the point in the middle of the picture, x, y, z (m).
        :param fov: the vertical field of view (rad).
        :param far: the distance up to which the camera sees (m).
        """
        camera = self.initial_camera
        camera.position, camera.look_at, camera.fov, camera.far = position, look_at, fov, far
        for client in clients:
            for message in (
                    SetCameraPositionMessage(tuple(position.tolist())),
                    SetCameraLookAtMessage(tuple(look_at.tolist())),
                    SetCameraFovMessage(fov), SetCameraFarMessage(far)):
                client._websock_connection.queue_message(message)

    def request_share_url(self, verbose: bool = True) -> None:
        """
        Do nothing: with viser's own method, every viewer could make the page public by a tunnel.

        :param verbose: not used.
        """
