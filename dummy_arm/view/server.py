"""The server of the page: it refuses requests of other pages, and drops unexpected messages."""

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

#: If no port is given, this port is tried first.
PORT = 8080
#: If no port is given, at most this many ports are tried.
_MAX_PORTS = 100
#: The port of an http URL that does not name a port.
_HTTP_PORT = 80
#: The messages that the page needs to send: a change in the panel, the pose of the camera, and a
#: click. The pose is needed, because viser registers a client when its first pose arrives. All
#: other messages are dropped.
_MESSAGES = GuiUpdateMessage, ViewerCameraMessage, SceneNodeClickMessage


class Server(GuardedServer):
    """
    A server whose viewers can only look at the scene and use the panel.

    Pages of other servers cannot connect to it; see the function `why_refused`.
    """

    def __init__(self, listening: socket.socket) -> None:
        """
        Start the server.

        :param listening: the listening socket that the server uses.
        :raises CommandError: if requests cannot be checked with this version of viser.
        """
        self._is_loopback = ip_address(listening.getsockname()[0]).is_loopback
        super().__init__(listening)

    def why_refused(self, headers: 'Headers') -> str:
        """
        Return why a request is refused.

        :param headers: the headers of the request.
        :returns: one line; '' if the request is accepted.
        """
        return why_refused(headers, self._is_loopback)

    def accepts(self, data: Union[bytes, str]) -> bool:
        """
        Return True if the page needs to send such a message, and the values in it are valid.

        :param data: the message as received.
        :returns: True if the message is passed on to viser; False if it is dropped.
        """
        message = message_of(data, _MESSAGES)
        if isinstance(message, ViewerCameraMessage):
            return all(map(isfinite, (
                *message.wxyz, *message.position, *message.look_at, *message.up_direction,
                message.fov, message.near, message.far)))
        if isinstance(message, GuiUpdateMessage):
            return self._can_set(message.uuid, message.updates)
        return message is not None

    def _can_set(self, uuid: str, updates: dict[str, Any]) -> bool:
        """Return True if an update sets only the value of a control, and the value is allowed."""
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
    Context manager: print the URL of a page, and serve the page until the block ends.

    :param host: a host name or address of this machine.
    :param port: from 1 to 65535; None: the first free port from 8080 to 8179.
    :returns: the server.
    :raises UsageError: if the host is not known, or is not an address of this machine.
    :raises CommandError: if the given port is in use or needs root; if no port is given, and none
        is free; or if requests cannot be checked with this version of viser.
    """
    listening = _listening_socket(host, port)
    server = Server(listening)
    try:
        server.gui.configure_theme(show_share_button=False)
        print('\n'.join(address_lines(*listening.getsockname()[:2])))
        yield server
    finally:
        server.stop()


def why_refused(headers: 'Headers', is_loopback: bool) -> str:
    """
    Return why a request is refused.

    Any web page that is open in a browser can request a WebSocket of this server. The browser adds
    two headers: `Origin`, the server from which the page came, and `Host`, the server to which the
    request goes. If the two are different servers, the request is refused.

    With DNS rebinding, a foreign name resolves to this machine, and both headers have that name.
    Therefore, if `is_loopback` is True, a request is also refused if its `Host` is neither
    localhost nor a loopback address.

    :param headers: the headers of the request.
    :param is_loopback: whether the server can be reached from this machine only.
    :returns: one line; '' if the request is accepted.
    """
    hosts, origins = headers.get_all('Host'), headers.get_all('Origin')
    if len(hosts) != 1 or len(origins) > 1:
        return ('a request must have one Host header and at most one Origin header, got '
                f'{len(hosts)} and {len(origins)}')
    own = f'http://{hosts[0]}'
    try:
        scheme, name, port = _origin(own)
        if origins and _origin(origins[0]) != (scheme, name, port):
            return f'only pages of {own!r} can connect, not pages of {origins[0]!r}'
    except ValueError:
        return f'malformed Host or Origin header: {", ".join(map(repr, [*hosts, *origins]))}'
    if is_loopback and not _is_of_this_machine(name):
        return ('the page is served to this machine only, as localhost or 127.0.0.1, not as '
                f'{hosts[0]!r}')
    return ''


def _origin(url: str) -> tuple[str, str, int]:
    """
    Return the scheme and the host name of an origin, both in lower case, and its port.

    :raises ValueError: if the URL is malformed, or has more parts than these three.
    """
    parts = urlsplit(url)
    if not parts.hostname or parts.username is not None or url.lower() != (
            f'{parts.scheme}://{parts.netloc}'.lower()):
        raise ValueError(url)
    return parts.scheme, parts.hostname, _HTTP_PORT if parts.port is None else parts.port


def _is_of_this_machine(name: str) -> bool:
    try:
        return ip_address(name).is_loopback
    except ValueError:
        return name == 'localhost'


def address_lines(address: str, port: int) -> list[str]:
    """
    Return the lines that are printed about the address of the page.

    :param address: the IP address at which the page is served.
    :param port: the port at which the page is served.
    :returns: a line with the URL to open. If `address` is not a loopback address, a second line
        says who can use the page.
    """
    ip = ip_address(address)
    place = 'localhost' if ip.is_unspecified else f'[{ip}]' if ip.version == 6 else str(ip)
    lines = [f'look at http://{place}:{port}']
    if not ip.is_loopback:
        lines.append(f'everybody who can reach port {port} of {socket.gethostname()} can look at '
                     'the page and use the panel')
    return lines


def _listening_socket(host: str, port: Optional[int]) -> socket.socket:
    """Open the socket for `serve` at a port; if `port` is None, at the first free port."""
    family, address = _address(host)
    ports = range(PORT, PORT + _MAX_PORTS) if port is None else (port,)
    for each in ports:
        try:
            return socket.create_server((address, each), family=family)
        except OSError as error:
            if error.errno == errno.EACCES:
                raise CommandError(
                    f'cannot serve at port {each} of {address}: {os.strerror(errno.EACCES)}; '
                    'without root, --port must be at least 1024') from None
            if error.errno != errno.EADDRINUSE:
                raise UsageError(
                    f'cannot serve at {address}: {os.strerror(error.errno or 0)}; --host takes an '
                    'address of this machine, such as 127.0.0.1') from None
    if port is None:
        raise CommandError(f'ports {ports[0]} to {ports[-1]} of {address} are all in use: end a '
                           'program that uses one, or choose another port with --port N')
    raise CommandError(f'port {port} of {address} is in use: end the program that uses it, choose '
                       'another port, or leave out --port to take the next free one')


def _address(host: str) -> tuple[socket.AddressFamily, str]:
    """Resolve a host name; an IPv4 address is preferred."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM) if host else []
    except (OSError, UnicodeError):
        found = []
    if not found:
        raise UsageError(f'{host!r} is not a known host or address: --host takes an address of '
                         'this machine, such as 127.0.0.1, or 0.0.0.0 for all of its addresses')
    family, *_, (address, *_) = min(found, key=lambda each: each[0] != socket.AF_INET)
    return family, str(address)
