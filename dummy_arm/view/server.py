"""The server of the page: viser's, on an address of this machine, and not_finite else."""

from collections.abc import Iterator
from contextlib import contextmanager
import errno
from ipaddress import ip_address
from math import isfinite
import os
import socket
from typing import Any, Optional, TYPE_CHECKING, Union
from urllib.parse import urlsplit

from dummy_arm.cli.parser import CommandError, UsageError
from dummy_arm.view.viser_private import (
    GuardedServer,
    GuiUpdateMessage,
    message_of,
    SceneNodeClickMessage,
    ViewerCameraMessage,
)

if TYPE_CHECKING:
    from websockets import Headers

PORT = 8080
_MOST_PORTS = 100
_DEFAULT_PORT = 80  # of http
#: The messages of the page that are needed: the panel, a camera (the first makes somebody a client
#: of viser's), a click. What else it can send, as an upload, has no use here.
_MESSAGES = GuiUpdateMessage, ViewerCameraMessage, SceneNodeClickMessage


class Server(GuardedServer):
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
        self._is_loopback = ip_address(listening.getsockname()[0]).is_loopback
        super().__init__(listening)

    def why_refused(self, headers: 'Headers') -> str:
        """Return why a request with these headers is refused; '' if it is not."""
        return why_refused(headers, self._is_loopback)

    def accepts(self, data: Union[bytes, str]) -> bool:
        """Return True if a message is one that the page sends, with values that it can have."""
        message = message_of(data, _MESSAGES)
        if isinstance(message, ViewerCameraMessage):
            return all(map(isfinite, (
                *message.wxyz, *message.position, *message.look_at, *message.up_direction,
                message.fov, message.near, message.far)))
        if isinstance(message, GuiUpdateMessage):
            return self._can_set(message.uuid, message.updates)
        return message is not None

    def _can_set(self, uuid: str, updates: dict[str, Any]) -> bool:
        """Return True if an update is a value that a control of the panel can have."""
        control = self.control(uuid)
        if control is None or updates.keys() != {'value'}:
            return False
        value = updates['value']
        if isinstance(control.value, float):
            return type(value) in (int, float) and isfinite(value)
        return type(value) is type(control.value) and value in getattr(
            control, 'options', (value,))


@contextmanager
def serve(host: str, port: Optional[int] = None) -> Iterator[Server]:
    """
    Serve a page from here to the end of the block; print where on stdout.

    :param host: a name or address of this machine.
    :param port: from 1 to 65535; None: 8080, or the next that is free.
    :raises UsageError: when there is no such address here.
    :raises CommandError: when the port or, without one, all ports are taken, or it needs root.
    """
    listening = _listening(host, port)
    server = Server(listening)
    try:
        server.gui.configure_theme(show_share_button=False)
        print('\n'.join(address_lines(*listening.getsockname()[:2])))
        yield server
    finally:
        server.stop()


def why_refused(headers: 'Headers', is_loopback: bool) -> str:
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


def address_lines(address: str, port: int) -> list[str]:
    """Tell where to look, and who can."""
    ip = ip_address(address)
    place = 'localhost' if ip.is_unspecified else f'[{ip}]' if ip.version == 6 else str(ip)
    lines = [f'look at http://{place}:{port}']
    if not ip.is_loopback:
        lines.append(f'whoever reaches port {port} of {socket.gethostname()} can look, and use '
                     'the panel')
    return lines


def _listening(host: str, port: Optional[int]) -> socket.socket:
    """Open the socket for `serve`, with the port given or the first one free."""
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
