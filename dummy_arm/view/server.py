"""The server of the page: viser's, on an address of this machine, and nowhere else."""

from collections.abc import Iterator
from contextlib import contextmanager
import errno
from functools import partial
from ipaddress import ip_address
import os
import socket
from typing import Optional, TYPE_CHECKING
from urllib.parse import urlsplit

from dummy_arm.cli.parser import CommandError, UsageError
from dummy_arm.view.viser_private import Server

if TYPE_CHECKING:
    import websockets

PORT = 8080
_MOST_PORTS = 100
_DEFAULT_PORT = 80  # of http


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
    address, number = listening.getsockname()[:2]
    server = Server(listening, partial(why_refused, is_loopback=ip_address(address).is_loopback))
    try:
        server.gui.configure_theme(show_share_button=False)
        print('\n'.join(told(address, number)))
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
