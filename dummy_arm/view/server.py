"""The server of the page: viser's, on an address of this machine, and nowhere else."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
import errno
from functools import partial
from http import HTTPStatus
from ipaddress import ip_address
import logging
from math import isfinite
import os
import socket
from typing import Any, Optional, Union
from urllib.parse import urlsplit
import warnings

import numpy as np
from numpy.typing import NDArray

from dummy_arm.cli.parser import CommandError, UsageError

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

PORT = 8080
_MOST_PORTS = 100
_DEFAULT_PORT = 80  # of http
#: The messages of the page that are needed: the panel, a camera (the first makes somebody a client
#: of viser's), a click. What else it can send, as an upload, has no use here.
_MESSAGES = {each.__name__: each for each in (
    GuiUpdateMessage, ViewerCameraMessage, SceneNodeClickMessage)}
_LONGEST_MESSAGE = 2**16  # bytes; viser's own limit is 50 MB


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


class Server(viser.ViserServer):
    """
    A server whose viewers can look at the scene and use the panel, and nothing else.

    Only pages that it has served itself can connect to it.
    """

    def __init__(self, listening: socket.socket) -> None:
        """
        Start the server.

        :param listening: the socket at which it serves.
        :raises CommandError: when requests would not be checked.
        """
        address, port, *_ = listening.getsockname()
        is_loopback = ip_address(address).is_loopback
        serve = websockets.asyncio.server.serve
        is_guarded = False

        def guarded(handler: Any, host: object = None, port: object = None, *,
                    process_request: Callable[..., Any], **kwargs: Any) -> Any:
            nonlocal is_guarded
            is_guarded = True

            def process(connection: Any, request: Any) -> Any:
                if why := why_refused(request.headers, is_loopback):
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

    def accepts(self, data: Union[bytes, str]) -> bool:
        """
        Return True if a message of a viewer can be handed to viser.

        viser sets whatever attribute a message names, to whatever value it has, and prints a
        traceback for a message that it cannot read.
        """
        if isinstance(data, str):
            return False
        try:
            fields = msgspec.msgpack.decode(data, type=dict[str, Any])
            message = msgspec.convert(fields, _MESSAGES[fields.pop('type')])
        except (ValueError, TypeError, KeyError, RecursionError):
            return False
        if not fields.keys() <= vars(message).keys():
            return False
        if isinstance(message, ViewerCameraMessage):
            return all(map(isfinite, (
                *message.wxyz, *message.position, *message.look_at, *message.up_direction,
                message.fov, message.near, message.far)))
        return not isinstance(message, GuiUpdateMessage) or self._can_set(
            message.uuid, message.updates)

    def _can_set(self, uuid: str, updates: dict[str, Any]) -> bool:
        """Return True if an update is a value that a control of the panel can have."""
        if 'gui' not in vars(self):  # viser makes it after it has started to serve
            return False
        control = self.gui._gui_input_handle_from_uuid.get(uuid)
        if control is None or updates.keys() != {'value'}:
            return False
        value = updates['value']
        if isinstance(control.value, float):
            return type(value) in (int, float) and isfinite(value)
        return type(value) is type(control.value) and value in getattr(
            control, 'options', (value,))

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


@contextmanager
def served(host: str, port: Optional[int] = None) -> Iterator[Server]:
    """
    Serve a page from here to the end of the block; print where on stdout.

    :param host: a name or address of this machine.
    :param port: from 1 to 65535; None: 8080, or the next that is free.
    :raises UsageError: when there is no such address here.
    :raises CommandError: when the port or, without one, all ports are taken, or it needs root.
    """
    listening = _listening(host, port)
    rich.reconfigure(quiet=True)  # viser tells by it where it serves, and when it ends
    warnings.filterwarnings('ignore', 'Queued a ')  # by viser, for who has just left
    logging.getLogger('websockets').setLevel(logging.CRITICAL)  # of those who are no browser
    server = Server(listening)
    try:
        server.gui.configure_theme(show_share_button=False)
        print('\n'.join(told(*listening.getsockname()[:2])))
        yield server
    finally:
        server.stop()


def why_refused(headers: 'websockets.Headers', is_loopback: bool) -> str:
    """
    Return why a request is refused; '' if it is not.

    Any page in the browser can send requests to a server of this machine. The browser then sends
    the origin of that page, or, where a foreign name resolves to this machine (DNS rebinding),
    that name as the host.

    :param is_loopback: whether the page is served to this machine only.
    """
    hosts, origins = headers.get_all('Host'), headers.get_all('Origin')
    if len(hosts) != 1 or len(origins) > 1:
        return (f'a request has one Host header and at most one Origin header, not {len(hosts)} '
                f'and {len(origins)}')
    own = f'http://{hosts[0]}'
    try:
        scheme, name, port = _origin(own)
        if origins and _origin(origins[0]) != (scheme, name, port):
            return f'for pages of {own!r} only, not of {origins[0]!r}'
    except ValueError:
        return f'malformed Host or Origin header: {", ".join(map(repr, [*hosts, *origins]))}'
    if is_loopback and not _is_of_this_machine(name):
        return f'for this machine only, by localhost or 127.0.0.1, not {hosts[0]!r}'
    return ''


def _origin(url: str) -> tuple[str, str, int]:
    """
    Return the scheme, the name and the port of an origin, in lower case.

    :raises ValueError: when it is malformed, or has more than these.
    """
    parts = urlsplit(url)
    if not parts.hostname or parts.username is not None or url.lower() != (
            f'{parts.scheme}://{parts.netloc}'.lower()):
        raise ValueError(url)
    return parts.scheme, parts.hostname, _DEFAULT_PORT if parts.port is None else parts.port


def _is_of_this_machine(name: str) -> bool:
    try:
        return ip_address(name).is_loopback
    except ValueError:
        return name == 'localhost'


def told(address: str, port: int) -> list[str]:
    """Tell where to look, and who can."""
    ip = ip_address(address)
    place = 'localhost' if ip.is_unspecified else f'[{ip}]' if ip.version == 6 else str(ip)
    lines = [f'look at http://{place}:{port}']
    if not ip.is_loopback:
        lines.append(f'whoever reaches port {port} of {socket.gethostname()} can look, and use '
                     'the panel')
    return lines


def _listening(host: str, port: Optional[int]) -> socket.socket:
    """Open the socket for `served`, with the port given or the first one free."""
    family, address = _address(host)
    ports = range(PORT, PORT + _MOST_PORTS) if port is None else (port,)
    for each in ports:
        try:
            return socket.create_server((address, each), family=family)
        except OSError as error:
            if error.errno == errno.EACCES:
                raise CommandError(
                    f'cannot serve at port {each} of {address}: {os.strerror(errno.EACCES)}; '
                    '--port takes a port from 1024 on without root') from None
            if error.errno != errno.EADDRINUSE:
                raise UsageError(
                    f'cannot serve at {address}: {os.strerror(error.errno or 0)}; --host takes an '
                    'address of this machine, as 127.0.0.1') from None
    if port is None:
        raise CommandError(f'the ports {ports[0]} to {ports[-1]} of {address} are all taken: end '
                           'what has them, or choose another: --port N')
    raise CommandError(f'port {port} of {address} is taken: end what has it, choose another, or '
                       'leave out --port, for the next that is free')


def _address(host: str) -> tuple[socket.AddressFamily, str]:
    """Find the address of a name."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM) if host else []
    except (OSError, UnicodeError):
        found = []
    if not found:
        raise UsageError(f'{host!r} is no address: --host takes one of this machine, as '
                         '127.0.0.1, or 0.0.0.0 for all that it has')
    family, *_, (address, *_) = min(found, key=lambda each: each[0] != socket.AF_INET)
    return family, str(address)
