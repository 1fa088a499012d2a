"""
The server of viser with what is not public of viser and websockets, as of viser 1.1.

test/test_viser_private.py has a test for each thing that this relies on:

- `viser._messages`: the messages that the page sends, each a msgpack map with `type`, the name of
  its class, and the fields of that; and those that turn a camera.
- viser starts its server by `websockets.asyncio.server.serve`, found through its module, with
  `process_request`, and takes `sock`, `create_connection` and `max_size`.
- `gui._gui_input_handle_from_uuid` finds a control of the panel, and
  `client._websock_connection.queue_message` sends to one viewer.
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

#: As in setup.py; bounded above, since what is not public of viser is used here.
VISER = 'viser>=1.1,<1.2'

try:
    import msgspec
    import rich
    import viser
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

_LONGEST_MESSAGE = 2**16  # bytes; viser's own limit is 50 MB


def message_of(data: Union[bytes, str], types: Iterable[type]) -> Any:
    """
    Return the message that a viewer has sent.

    :param types: the types that it may have, of `viser._messages`.
    :returns: None if it has another type, other fields, or fields of other types.
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
    """A connection to a viewer, whose messages are checked before viser receives them."""

    def __init__(self, accepts: Callable[[Any], bool], *args: Any, **kwargs: Any) -> None:
        """
        Make a connection, as websockets does.

        :param accepts: returns whether a message is received.
        """
        self._accepts = accepts
        super().__init__(*args, **kwargs)

    async def recv(self, decode: Optional[bool] = None) -> Any:
        """
        Return the next message that is accepted.

        The others are dropped, and the connection stays: were it closed, the page would connect
        again and again for a message that does no harm.
        """
        while True:
            message = await super().recv(decode)
            if self._accepts(message):
                return message


class GuardedServer(viser.ViserServer):
    """A server of viser that asks a subclass about each request and each message of a viewer."""

    def __init__(self, listening: socket.socket) -> None:
        """
        Start the server.

        :param listening: the socket at which it serves.
        :raises CommandError: when requests would not be checked.
        """
        rich.reconfigure(quiet=True)  # viser tells by it where it serves, and when it ends
        warnings.filterwarnings('ignore', 'Queued a ')  # by viser, for who has just left
        logging.getLogger('websockets').setLevel(logging.CRITICAL)  # of those who are no browser
        address, port, *_ = listening.getsockname()
        serve = websockets.asyncio.server.serve
        is_guarded = False

        def guarded(handler: Any, host: object = None, port: object = None, *,
                    process_request: Callable[..., Any], **kwargs: Any) -> Any:
            nonlocal is_guarded
            is_guarded = True

            def process(connection: Any, request: Any) -> Any:
                if why := self.why_refused(request.headers):
                    return connection.respond(HTTPStatus.FORBIDDEN, f'{why}\n')
                return process_request(connection, request)
            # Given a port, viser would take the next one where that is taken.
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
        """Return why a request with these headers is refused; '' if it is not."""
        raise NotImplementedError

    def accepts(self, data: Union[bytes, str]) -> bool:
        """
        Return True if a message of a viewer can be handed to viser.

        viser sets whatever attribute a message names, to whatever value it has, and prints a
        traceback for a message that it cannot read.
        """
        raise NotImplementedError

    def control(self, uuid: str) -> Any:
        """Return a control of the panel; None if there is none of this uuid."""
        if 'gui' not in vars(self):  # viser makes it after it has started to serve
            return None
        return self.gui._gui_input_handle_from_uuid.get(uuid)

    def turn_cameras(self, clients: Iterable[viser.ClientHandle], position: NDArray[np.float64],
                     look_at: NDArray[np.float64], fov: float, far: float) -> None:
        """
        Turn the cameras of clients, and that to which every camera can be reset.

        viser's own `client.camera` raises on some of what a client has told of its camera, as no
        direction upwards; here this is not used.

        :param position: (3,): x, y, z (m).
        :param look_at: (3,): the point in the middle (m).
        :param fov: the angle from top to bottom (rad).
        :param far: the distance up to which it sees (m).
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
        """Refuse; by viser's own, everybody who looks could open a tunnel."""
