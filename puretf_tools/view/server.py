"""The server of the page: its address, and the requests of other pages, which it refuses."""

from collections.abc import Iterator
from contextlib import contextmanager
import errno
from functools import partial
from ipaddress import ip_address
import os
import re
import socket
from typing import Optional, TYPE_CHECKING

from puretf_tools.cli.parser import CommandError, UsageError
from puretf_tools.view.viser_private import Server

if TYPE_CHECKING:
    from websockets import Headers

#: The ports that are tried if no port is given.
PORTS = range(8080, 8180)
#: The size of the send buffer of each connection (bytes).
_SEND_BUFFER = 2**16


@contextmanager
def serve(host: str, port: Optional[int] = None) -> Iterator[Server]:
    """Context manager: print the URL of a page, and serve the page until the block ends."""
    listening = _listening_socket(host, port)
    server = Server(listening, partial(
        why_refused, is_loopback=ip_address(listening.getsockname()[0]).is_loopback))
    try:
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
    """
    hosts, origins = headers.get_all('Host'), headers.get_all('Origin')
    if len(hosts) != 1 or len(origins) > 1:
        return ('a request must have one Host header and at most one Origin header, got '
                f'{len(hosts)} and {len(origins)}')
    own = f'http://{hosts[0]}'
    if origins and origins[0].lower() != own.lower():
        return f'only pages of {own!r} can connect, not pages of {origins[0]!r}'
    if is_loopback and not _is_of_this_machine(hosts[0].lower()):
        return ('the page is served to this machine only, as localhost or 127.0.0.1, not as '
                f'{hosts[0]!r}')
    return ''


def _is_of_this_machine(host: str) -> bool:
    name = re.sub(r':\d+\Z', '', host)
    try:
        return ip_address(name[1:-1] if name.startswith('[') else name).is_loopback
    except ValueError:
        return name == 'localhost'


def address_lines(address: str, port: int) -> list[str]:
    """Return a line with the URL to open, and perhaps one that says who else can use the page."""
    ip = ip_address(address)
    place = 'localhost' if ip.is_unspecified else f'[{ip}]' if ip.version == 6 else str(ip)
    lines = [f'look at http://{place}:{port}']
    if not ip.is_loopback:
        lines.append(f'everybody who can reach port {port} of {socket.gethostname()} can look at '
                     'the page and use the panel')
    return lines


def _listening_socket(host: str, port: Optional[int]) -> socket.socket:
    family, address = _address(host)
    ports = PORTS if port is None else (port,)
    for each in ports:
        try:
            listening = socket.create_server((address, each), family=family)
            # On a slow link, what waits in the buffers of connections is old.
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            return listening
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
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise UsageError(f'{host!r} is not a known host or address: --host takes an address of '
                         'this machine, such as 127.0.0.1, or 0.0.0.0 for all of its addresses'
                         ) from None
    family, *_, (address, *_) = min(found, key=lambda each: each[0] != socket.AF_INET)
    return family, str(address)
