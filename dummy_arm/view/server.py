"""The server of the page: viser's, on an address of this machine, and nowhere else."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import errno
from http import HTTPStatus
from ipaddress import ip_address
import logging
import os
import socket
from typing import Any
from urllib.parse import urlsplit

from dummy_arm.command import CommandError, UsageError

try:
    import rich
    import viser
    import websockets.asyncio.server
except ImportError as error:
    raise CommandError(f'viser, which makes the page, cannot be imported ({error}): '
                       'pip install viser') from None

PORT = 8080
_MOST_PORTS = 100
_DEFAULT_PORT = 80  # of http


class Server(viser.ViserServer):
    """A server that cannot be asked by a page to let the internet in."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Refuse; by viser's own, everybody who looks could open a tunnel."""


@contextmanager
def served(host: str) -> Iterator[Server]:
    """
    Serve a page from here to the end of the block; tell where on stdout.

    :param host: a name or address of this machine.
    :raises UsageError: when it is none.
    :raises CommandError: when all ports are taken.
    """
    family, address = _address(host)
    port = _free_port(family, address)
    rich.reconfigure(quiet=True)  # viser tells by it where it serves, and when it ends
    logging.getLogger('websockets').setLevel(logging.CRITICAL)  # of those who are no browser
    with _for_own_pages(ip_address(address).is_loopback):
        server = Server(address, port, label='dummy_arm', verbose=False)
    try:
        server.gui.configure_theme(show_share_button=False)
        print('\n'.join(told(address, server.get_port())))
        yield server
    finally:
        server.stop()


@contextmanager
def _for_own_pages(is_loopback: bool) -> Iterator[None]:
    """Have a server that viser starts refuse who does not look at a page that it has served."""
    serve = websockets.asyncio.server.serve

    def guarded(*arguments: Any, process_request: Callable[..., Any], **how: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            if why := why_refused(request.headers, is_loopback):
                return connection.respond(HTTPStatus.FORBIDDEN, f'{why}\n')
            return process_request(connection, request)
        return serve(*arguments, process_request=process, **how)

    websockets.asyncio.server.serve = guarded
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve


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


def _free_port(family: socket.AddressFamily, address: str) -> int:
    """Find a port that is not taken; viser would try for ever where there is no such address."""
    for port in range(PORT, PORT + _MOST_PORTS):
        try:
            socket.create_server((address, port), family=family).close()
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise UsageError(
                    f'cannot serve at {address}: {os.strerror(error.errno or 0)}; --host takes an '
                    'address of this machine, as 127.0.0.1; a free port is found') from None
        else:
            return port
    raise CommandError(f'the ports {PORT} to {PORT + _MOST_PORTS - 1} of {address} are all taken: '
                       'end what has them')
